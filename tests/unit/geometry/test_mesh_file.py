"""Meshes of every format, and files that are not what they should be."""

import builtins
import os
import re
import struct
from pathlib import Path

import numpy as np
import pytest

from calib.errors import FileFormatError, InputError
from calib.robots.description import mesh_file
from calib.robots.description.mesh_file import read_mesh

CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])

OBJ = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS) + "".join(
    f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in FACES
)

STL = "solid a\n" + "".join(
    "facet normal 0 0 1\nouter loop\n"
    + "".join("vertex {} {} {}\n".format(*CORNERS[i]) for i in face)
    + "endloop\nendfacet\n"
    for face in FACES
) + "endsolid a\n"  # fmt: skip

BINARY_STL = b"solid, as some exporters begin".ljust(80) + struct.pack("<I", len(FACES))
for face in FACES:
    BINARY_STL += struct.pack("<12fH", 0, 0, 1, *CORNERS[face].ravel(), 0)


def ply(vertices: np.ndarray, faces: list[list[int]], count: int | None = None) -> str:
    header = f"""ply
format ascii 1.0
comment TextureFile ../texture.png
element vertex {count or len(vertices)}
property float x
property float y
property float z
element face {len(faces)}
property list uchar int vertex_indices
end_header
"""
    rows = [*vertices.tolist(), *([len(face), *face] for face in faces)]
    return header + "".join(" ".join(map(str, row)) + "\n" for row in rows)


NODE = '<node><instance_geometry url="#g"/></node>'


def dae(nodes: str = NODE, library: str = "", head: str = "") -> str:
    numbers = " ".join(map(str, CORNERS.ravel()))
    corners = " ".join(map(str, FACES.ravel()))
    return f"""<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset>{head}</asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="12">{numbers}</float_array><technique_common>
<accessor source="#a" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4" material="m"><input semantic="VERTEX" source="#v" offset="0"/>
<p>{corners}</p></triangles></mesh></geometry></library_geometries>
<library_nodes>{library}</library_nodes>
<library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene>
</COLLADA>
"""


@pytest.fixture
def read(tmp_path):
    def of(name: str, content: str | bytes, **options):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_mesh(path, **options)

    return of


def surface(mesh) -> set[frozenset[tuple[float, ...]]]:
    """The triangles, whatever their order."""
    return {frozenset(map(tuple, mesh.vertices[t].round(9).tolist())) for t in mesh.triangles}


EXPECTED = {frozenset(map(tuple, CORNERS[face].tolist())) for face in FACES}


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.stl", STL),
        ("a.STL", BINARY_STL),
        ("a.obj", OBJ),
        ("a.ply", ply(CORNERS, FACES.tolist())),
        ("a.dae", dae()),
    ],
    ids=["ascii.stl", "binary.STL", "obj", "ply", "dae"],
)
def test_every_format(read, name, content):
    mesh = read(name, content)
    assert mesh.vertices.shape == (4, 3)  # equal ones are merged
    assert mesh.vertices.dtype == float
    assert surface(mesh) == EXPECTED
    scaled = read(name, content, scale=(0.001, 2.0, -1.0))
    np.testing.assert_allclose(scaled.vertices.min(axis=0), [0, 0, -3])
    np.testing.assert_allclose(scaled.vertices.max(axis=0), [0.001, 4, 0])


def test_several_solids_become_one(read):
    shifted = re.sub(r"vertex (\S+)", lambda m: f"vertex {float(m[1]) + 5}", STL)
    mesh = read("a.stl", STL + shifted.replace("solid a", "solid b"))
    assert len(mesh.triangles) == 8
    assert mesh.vertices[:, 0].max() == 6.0


def test_polygons_become_triangles(read):
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [-1, 0.5, 0]])
    quads = read("a.ply", ply(square, [[0, 1, 2, 3], [0, 3, 4]]))
    lines = "".join("v {} {} {}\n".format(*p) for p in square)
    many = read("a.obj", lines + "f 1 2 3 4\nf 1 4 5\n")
    for mesh in (quads, many, read("b.obj", lines + "f 1 2 3 4 5\n")):
        a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
        assert area == pytest.approx(1.5)


def test_corners_with_textures_and_comments_in_any_code_page(read):
    lines = "vt 0 0\nvt 1 1\nvn 0 0 1\nusemtl größe\n" + OBJ.replace(
        "f 1 3 2", "f 1/1/1 3/2/1 2/1/1"
    )
    assert surface(read("a.obj", lines.encode("latin-1"))) == EXPECTED


def test_places_and_units_of_collada(read):
    there = f"<node><translate>10 0 0</translate><rotate>0 0 1 90</rotate>{NODE}</node>"
    mesh = read("a.dae", dae(NODE + there, head='<unit name="cm" meter="0.01"/>'))
    assert len(mesh.triangles) == 8
    # pycollada turns in single precision
    np.testing.assert_allclose(mesh.vertices.min(axis=0), [0, 0, 0], atol=1e-8)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), [0.1, 0.02, 0.03], atol=1e-8)
    assert [0.08, 0, 0] in mesh.vertices.round(7).tolist()


def test_triangles_without_an_area_between_equal_corners_are_left_out(read):
    mesh = read("a.obj", OBJ + "f 1 1 2\nv 1 0 0\nf 2 5 3\n")
    assert surface(mesh) == EXPECTED


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.obj", "mtllib ../secret.mtl\nusemtl x\n" + OBJ),
        ("a.ply", ply(CORNERS, FACES.tolist())),
        (
            "a.dae",
            dae('<node><instance_geometry url="#g"><bind_material><technique_common>'
                '<instance_material symbol="m" target="file:///etc/hostname#x"/>'
                "</technique_common></bind_material></instance_geometry>"
                '<instance_camera url="file:///etc/hostname#c"/></node>').replace(
                "<library_nodes>",
                '<library_images><image id="i"><init_from>../secret.png</init_from></image>'
                "</library_images><library_nodes>",
            ),
        ),
    ],
    ids=["obj", "ply", "dae"],
)  # fmt: skip
def test_no_other_file_is_read(read, tmp_path, monkeypatch, name, content):
    opened = []
    real = os.open, builtins.open, Path.open

    def note(path, *args, **options):
        opened.append(Path(path).name)
        return real[1](path, *args, **options)

    monkeypatch.setattr(builtins, "open", note)
    monkeypatch.setattr(Path, "open", lambda self, *a, **k: note(self, *a, **k))
    monkeypatch.setattr(os, "open", lambda *a, **k: opened.append(str(a)) or real[0](*a, **k))
    monkeypatch.setattr("socket.socket", None)
    (tmp_path / name).write_text(content)
    opened.clear()
    assert surface(read_mesh(tmp_path / name)) == EXPECTED
    assert opened == [name]


def laughing() -> str:
    """Forty nodes, each of which uses the next one twice."""
    each = '<node id="n{}"><instance_node url="#n{}"/><instance_node url="#n{}"/></node>'
    library = "".join(each.format(i, i + 1, i + 1) for i in range(40))
    return dae('<node><instance_node url="#n0"/></node>', library + f'<node id="n40">{NODE}</node>')


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.stl", "", "has no triangles"),
        ("a.stl", "hello", "has no triangles"),
        ("a.stl", BINARY_STL[:-10], "cannot be read as .stl: its length is not what it says"),
        ("a.stl", STL.replace("vertex 1", "vertex one", 1), "cannot be read as .stl"),
        ("a.stl", STL.replace("normal 0", "normal x").replace("vertex 1", "vertex one"), "cannot"),
        ("a.stl", STL.replace("vertex 1.0", "vertex nan", 1), "coordinates that are no numbers"),
        ("a.stl", b"\0" * 80 + b"\xff" * 4, "its length is not what it says"),
        ("a.obj", "", "has no triangles"),
        ("a.obj", OBJ.replace("f ", "l "), "has no triangles"),
        ("a.obj", OBJ.replace("1.0", "one", 1), "cannot be read as .obj"),
        ("a.obj", OBJ.replace("1.0", "inf", 1), "has coordinates that are no numbers"),
        ("a.obj", OBJ.replace("1.0", "1e30", 1), "reaches 1e+30 m from its origin"),
        ("a.obj", OBJ + "f 1 2 9\n", "cannot be read as .obj"),
        ("a.obj", "v 1 1 1\n" * 3 + "f 1 2 3\n", "is a single point"),
        ("a.ply", "", "cannot be read as .ply"),
        ("a.ply", "ply\nformat ascii 1.0\n", "cannot be read as .ply"),
        ("a.ply", ply(CORNERS, [[0, 1, 4]]), "triangles of vertices that do not exist (4 do)"),
        ("a.ply", ply(CORNERS, [[0, 1, -1]]), "triangles of vertices that do not exist (4 do)"),
        ("a.ply", ply(CORNERS, [[0, 1, 2]], count=10**12), ""),
        ("a.ply", ply(CORNERS, []), "has no triangles"),
        ("a.dae", "", "cannot be read as .dae: it is no XML"),
        ("a.dae", "PK\x03\x04", "cannot be read as .dae: it is no XML"),
        ("a.dae", "<html/>", "cannot be read as .dae: it is no COLLADA"),
        ("a.dae", dae(nodes=""), "has no triangles"),
        (
            "a.dae",
            '<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/hostname">]><COLLADA>&e;</COLLADA>',
            "it defines or fetches XML entities",
        ),
        ("a.dae", dae(NODE.replace("#g", "file:///b.dae#g")), "refers to another file"),
        ("a.dae", dae(NODE.replace("#g", "#h")), "cannot be read as .dae"),
        ("a.dae", dae(head='<unit meter="0"/>'), "its unit is 0.0 m"),
        ("a.dae", dae(head='<unit meter="inch"/>'), "cannot be read as .dae"),
        ("a.dae", laughing(), "its shapes, with all uses of them, have"),
        (
            "a.dae",
            dae(library='<node id="n"><instance_node url="#n"/></node>'),
            "its nodes use each other in a circle",
        ),
        (
            "a.dae",
            dae(library="<node>" * 50_000 + "</node>" * 50_000),
            "cannot be read as .dae: maximum recursion depth exceeded",
        ),
        ("a.step", "", "is no mesh file known here (.step)"),
        ("mesh", "", "is no mesh file known here (no suffix)"),
    ],
)
def test_files_that_cannot_be_used(read, tmp_path, capfd, name, content, says):
    with pytest.raises(FileFormatError) as caught:
        read(name, content)
    assert caught.value.message.startswith(f"{tmp_path / name}: {says}") or (
        says in caught.value.message
    )
    assert "\n" not in str(caught.value)
    assert caught.value.hint
    assert caught.value.path == tmp_path / name
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "dae"])
@pytest.mark.parametrize("start", [b"", b"ply\n", b"solid ", b"<COLLADA>", b"v 1 2 3\n"])
def test_garbage(read, suffix, start):
    with pytest.raises(FileFormatError):
        read(f"a.{suffix}", start + np.random.default_rng(0).bytes(3000))


@pytest.mark.parametrize("cut", range(100, 1500, 200))
@pytest.mark.parametrize("name", ["a.obj", "a.ply", "a.dae", "a.stl"])
def test_files_that_are_cut_off_are_read_or_refused(read, name, cut):
    """Never another exception; text formats may end anywhere."""
    whole = {"a.obj": OBJ, "a.ply": ply(CORNERS, FACES.tolist()), "a.dae": dae(), "a.stl": STL}
    try:
        mesh = read(name, whole[name][:cut])
    except FileFormatError:
        return
    assert np.isfinite(mesh.vertices).all()
    assert len(mesh.triangles) <= 4


def test_what_is_no_file(tmp_path):
    with pytest.raises(FileFormatError, match="is no file"):
        read_mesh(tmp_path / "missing.stl")
    (tmp_path / "folder.stl").mkdir()
    with pytest.raises(FileFormatError, match="is no file"):
        read_mesh(tmp_path / "folder.stl")
    os.mkfifo(tmp_path / "pipe.stl")
    with pytest.raises(FileFormatError, match="is no file"):
        read_mesh(tmp_path / "pipe.stl")
    with pytest.raises(FileFormatError, match="is no file"):
        read_mesh(tmp_path / "zero\0byte.stl")


def test_a_file_that_may_not_be_read(tmp_path, monkeypatch):
    def refuse(self, mode):
        raise PermissionError(13, "Permission denied", str(self))

    (tmp_path / "a.stl").write_text(STL)
    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(FileFormatError, match="cannot be read: Permission denied"):
        read_mesh(tmp_path / "a.stl")


def test_files_that_are_too_large(read, monkeypatch):
    monkeypatch.setattr(mesh_file, "LARGEST_MESH_BYTES", len(STL) - 1)
    with pytest.raises(FileFormatError, match="has more than 0 MB") as caught:
        read("a.stl", STL)
    assert caught.value.bound == len(STL) - 1
    monkeypatch.undo()
    monkeypatch.setattr(mesh_file, "LARGEST_TRIANGLES", 3)
    with pytest.raises(FileFormatError, match="has 4 triangles, more than 3"):
        read("a.stl", STL)


@pytest.mark.parametrize("scale", [(1, 1), (0, 1, 1), (1, np.nan, 1), (1, 1, np.inf)])
def test_scales_that_cannot_be(read, scale):
    with pytest.raises(InputError, match="the scale of"):
        read("a.stl", STL, scale=scale)


@pytest.mark.parametrize(
    ("before", "after"), [("endsolid", ""), ("endfacet\n", ""), ("vertex 1 0 0\n", "")]
)
def test_a_damaged_text_stl_is_refused(tmp_path, before, after):
    facet = "facet normal 0 0 {}\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    facet += "endloop\nendfacet\n"
    text = f"solid a\n{facet.format(1)}{facet.format(1)}endsolid a\n"
    path = tmp_path / "a.stl"
    path.write_text(text)
    assert len(read_mesh(path).triangles) == 2
    path.write_text(text.replace(before, after, 1))
    with pytest.raises(FileFormatError, match="cut off or damaged"):
        read_mesh(path)


def test_readers_of_meshes_log_nothing(tmp_path, caplog):
    """Normals are not used; trimesh logs a traceback where they are no numbers."""
    text = "solid a\nfacet normal 0 0 x\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    (tmp_path / "a.stl").write_text(text + "endloop\nendfacet\nendsolid a\n")
    assert len(read_mesh(tmp_path / "a.stl").triangles) == 1
    assert caplog.text == ""
