"""Meshes from files that may come from anywhere: one file is read, and nothing that it names.

COLLADA (.dae) files from anywhere, cut down to their shapes before a reader sees them.

Materials, images, lights, cameras, animations and the description of the author are what refers to
other files and what readers stumble over. None of it is a shape.
"""

from __future__ import annotations

import io
import logging
import math
import re
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import ParseError, tostring

import defusedxml
import numpy as np
from defusedxml.ElementTree import fromstring
from trimesh.exchange.dae import load_collada
from trimesh.exchange.obj import load_obj
from trimesh.exchange.ply import load_ply
from trimesh.exchange.stl import load_stl
from trimesh.geometry import triangulate_quads

from calib.errors import FileFormatError, InputError
from calib.robots.shapes import Mesh
from calib.se3 import FloatArray, IntArray

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element


LARGEST_MESH_BYTES = 50_000_000
"""A million triangles in the most compact format. Collision meshes have some thousand."""

LARGEST_TRIANGLES = 1_000_000

LARGEST_COORDINATE_M = 1000.0
"""Nothing in a cell is farther away; larger numbers are a wrong unit, or no numbers at all."""

_STL_HEADER_BYTES, _STL_TRIANGLE_BYTES = 84, 50

_LONGEST_REASON = 150

_SOLID, _END_SOLID, _END_FACET, _VERTEX = (
    re.compile(rb"^[ \t]*" + word + rb"\b", re.MULTILINE | re.IGNORECASE)
    for word in (b"solid", b"endsolid", b"endfacet", b"vertex")
)

# its readers log tracebacks where they go on: what matters of them is checked here
logging.getLogger("trimesh").setLevel(logging.CRITICAL)


def read_mesh(path: Path | str, scale: Sequence[float] = (1.0, 1.0, 1.0)) -> Mesh:
    """Read the triangles of a mesh file.

    Several objects in a file become one mesh. The unit of length that a COLLADA file names is
    applied, its upward axis is not, as in ROS. Equal vertices are merged.

    Parameters
    ----------
    path : path
        A file ``.stl`` (binary or ASCII), ``.obj``, ``.ply`` or ``.dae``. Materials, textures and
        other files that it names are not looked for.
    scale : sequence of 3 floats
        Metres of one unit of the file, along each axis; negative to mirror it.

    Raises
    ------
    FileFormatError
        There is no such file, its format is not known, it cannot be read or is too large, or it
        has no triangles, or coordinates that cannot be.
    InputError
        The scale has not three finite values other than zero.
    """
    path = Path(path)
    factors = np.asarray(scale, dtype=float)
    if factors.shape != (3,) or not (np.isfinite(factors).all() and factors.all()):
        raise InputError(
            f"the scale of {path} is {tuple(scale)}",
            hint="give three factors, not zero",
            name="scale",
        )
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        what = f"is no mesh file known here ({path.suffix or 'no suffix'})"
        raise _wrong(path, what, "give a file " + ", ".join(_READERS))
    vertices, triangles = _triangles(reader, _read(path), path)
    with np.errstate(invalid="ignore", over="ignore"):
        vertices = vertices * factors
    return checked_mesh(vertices, triangles, path)


def checked_mesh(vertices: FloatArray, triangles: IntArray, path: Path) -> Mesh:
    """The mesh of vertices ``(V, 3)`` [m] and triangles ``(F, 3)`` that stand in a file."""
    count, largest = len(triangles), LARGEST_TRIANGLES
    if not count:
        raise _wrong(path, "has no triangles", "export a surface; is the file complete?")
    if count > largest:
        what = f"has {count} triangles, more than {largest}"
        raise _wrong(path, what, _SIMPLIFY, value=count, bound=largest)
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise _wrong(path, f"has triangles of vertices that do not exist ({len(vertices)} do)")
    used = vertices[triangles.ravel()]
    if not np.isfinite(used).all():
        raise _wrong(path, "has coordinates that are no numbers")
    farthest, bound = float(np.abs(used).max()), LARGEST_COORDINATE_M
    if farthest > bound:
        what = f"reaches {farthest:.3g} m from its origin, more than {bound:g} m"
        hint = "set the scale: 0.001 for a file in mm"
        raise _wrong(path, what, hint, value=farthest, bound=bound)
    if not np.ptp(used, axis=0).any():
        raise _wrong(path, "is a single point")
    kept, rows = np.unique(used, axis=0, return_inverse=True)
    corners = np.asarray(rows, dtype=np.intp).reshape(-1, 3)
    a, b, c = corners.T
    real = (a != b) & (b != c) & (c != a)  # one with two corners in one point encloses nothing
    return Mesh(kept, corners[real] if real.any() else corners)


_SIMPLIFY = "give a simplified mesh for collisions"


def _wrong(
    path: Path, what: str, hint: str = "export it again", value: object = None, bound: object = None
) -> FileFormatError:
    return FileFormatError(what, path=path, hint=hint, value=value, bound=bound)


def _read(path: Path) -> bytes:
    try:
        if not path.is_file():  # a pipe would be waited for without end
            raise _wrong(path, "is no file", "give the path of a mesh file")
        with path.open("rb") as file:
            data = file.read(LARGEST_MESH_BYTES + 1)
    except OSError as error:
        what = f"cannot be read: {error.strerror}"
        raise _wrong(path, what, "check the path and its rights") from error
    if len(data) > LARGEST_MESH_BYTES:
        what = f"has more than {LARGEST_MESH_BYTES / 1e6:.0f} MB"
        raise _wrong(path, what, _SIMPLIFY, value=len(data), bound=LARGEST_MESH_BYTES)
    return data


def _triangles(
    reader: Callable[[bytes], list[tuple[FloatArray, IntArray]]], data: bytes, path: Path
) -> tuple[FloatArray, IntArray]:
    """Vertices (V, 3) in units of the file, triangles (F, 3)."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            # numpy's word for text that is no number, on which it stops reading in silence
            warnings.filterwarnings("error", message="string or file could not be read")
            parts = reader(data)
        count = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
        if not parts:
            return np.empty((0, 3)), np.empty((0, 3), dtype=np.intp)
        vertices = np.concatenate([np.asarray(v, dtype=float) for v, _ in parts])
        triangles = np.concatenate([f + n for (_, f), n in zip(parts, count, strict=False)])
    # readers of half a dozen formats fail on broken files in every way that there is
    except Exception as error:
        reason = " ".join(str(error).split())[:_LONGEST_REASON] or type(error).__name__
        printed = "".join(c if c.isprintable() else " " for c in reason)
        what = f"cannot be read as {path.suffix.lower()}: {printed}"
        raise _wrong(path, what, "export it again; binary .stl is the simplest format") from error
    return vertices, triangles


def _text(data: bytes) -> bytes:
    """UTF-8 text: names in comments may be in any code page, and mean nothing here."""
    return data.decode("utf-8", errors="replace").encode()


def _stl(data: bytes) -> list[tuple[FloatArray, IntArray]]:
    triangles = int.from_bytes(data[80:84], "little")
    if len(data) != _STL_HEADER_BYTES + triangles * _STL_TRIANGLE_BYTES:
        if b"\0" in data:
            raise ValueError("its length is not what it says: it is cut off, or no STL")
        data = _text(data)
        starts, ends = (len(pattern.findall(data)) for pattern in (_SOLID, _END_SOLID))
        facets, corners = (len(pattern.findall(data)) for pattern in (_END_FACET, _VERTEX))
        if starts != ends or corners != 3 * facets:
            raise ValueError(
                f"{starts} solids with {ends} ends, {facets} facets with {corners} corners: it is "
                "cut off or damaged"
            )
    return list(_parts(load_stl(io.BytesIO(data))))


def _obj(data: bytes) -> list[tuple[FloatArray, IntArray]]:
    return list(_parts(load_obj(io.BytesIO(_text(data)), resolver=None, skip_materials=True)))


def _ply(data: bytes) -> list[tuple[FloatArray, IntArray]]:
    return list(_parts(load_ply(io.BytesIO(data), resolver=None, skip_materials=True)))


def _dae(data: bytes) -> list[tuple[FloatArray, IntArray]]:
    shapes, unit_m = read_shapes(data, LARGEST_MESH_BYTES)
    found = load_collada(io.BytesIO(shapes), resolver=None, ignore_broken=False)
    return [(vertices * unit_m, faces) for vertices, faces in _parts(found)]


_READERS: Mapping[str, Callable[[bytes], list[tuple[FloatArray, IntArray]]]] = {
    ".stl": _stl,
    ".obj": _obj,
    ".ply": _ply,
    ".dae": _dae,
}


def _parts(loaded: dict[str, Any]) -> Iterator[tuple[FloatArray, IntArray]]:
    """Vertices (V, 3) and triangles (F, 3) of what trimesh hands on: one mesh, or a scene."""
    shapes = loaded.get("geometry", {"": loaded})
    for place in loaded.get("graph") or [{"geometry": name} for name in shapes]:
        mesh = shapes[place["geometry"]]
        if "faces" not in mesh or not len(mesh["faces"]):
            continue
        vertices = np.asarray(mesh["vertices"], dtype=float)
        faces = np.asarray(triangulate_quads(mesh["faces"]))
        if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.shape[1:] != (3,):
            raise ValueError("its vertices or faces have another form")
        T = np.asarray(place.get("matrix", np.eye(4)), dtype=float)
        with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is found later
            placed = vertices @ T[:3, :3].T + T[:3, 3]
        yield placed, faces.astype(np.intp, casting="same_kind")


_LIBRARIES = ("library_geometries", "library_nodes", "library_visual_scenes", "scene")
_LOOKS = ("bind_material", "instance_camera", "instance_light", "instance_controller", "extra")

_INSTANCE_COST = 1000
"""Characters that one more use of a shape or node is counted as: it takes memory, too."""


def read_shapes(data: bytes, largest: int) -> tuple[bytes, float]:
    """Cut a COLLADA file down to its shapes: a file with nothing else in it, and its unit [m].

    Parameters
    ----------
    largest : int
        How many characters of numbers the shapes may have, counted once for each use of them.

    Raises
    ------
    ValueError
        It is no COLLADA file, refers to other files, or shapes use each other without end.
    """
    try:
        root = fromstring(data, forbid_dtd=True)
    except defusedxml.DefusedXmlException as error:
        raise ValueError("it defines or fetches XML entities") from error
    except ParseError as error:
        raise ValueError(f"it is no XML ({error})") from error
    if _name(root) != "COLLADA":
        raise ValueError("it is no COLLADA")
    unit = root.find("{*}asset/{*}unit")
    unit_m = 1.0 if unit is None else float(unit.get("meter", "1"))
    if not (math.isfinite(unit_m) and unit_m > 0.0):
        raise ValueError(f"its unit is {unit_m} m")
    for parent in list(root.iter()):
        for child in list(parent):
            if _name(child) in _LOOKS or (parent is root and _name(child) not in _LIBRARIES):
                parent.remove(child)
    for element in root.iter():
        for key in ("url", "source"):
            if not element.get(key, "#").startswith("#"):
                raise ValueError(f"a <{_name(element)}> refers to another file")
    size = _size_of_scenes(root)
    if size > largest:
        raise ValueError(f"its shapes, with all uses of them, have {size:.3g} characters")
    return tostring(root, encoding="utf-8"), unit_m


def _name(element: Element) -> str:
    """Tag without its namespace."""
    return str(element.tag).rsplit("}", 1)[-1]


def _size_of_scenes(root: Element) -> int:
    """Characters of numbers that all scenes stand for, with each use of a geometry."""
    by_id = {e.get("id"): e for e in root.iter() if e.get("id") is not None}
    known: dict[Element, int] = {}
    opened: set[Element] = set()

    def size_of(element: Element) -> int:
        if _name(element) == "geometry":
            return _INSTANCE_COST + sum(len(e.text or "") for e in element.iter())
        if element in known:
            return known[element]
        if element in opened:
            raise ValueError("its nodes use each other in a circle")
        opened.add(element)
        size = _INSTANCE_COST + sum(size_of(child) for child in element)
        if _name(element) in ("instance_node", "instance_geometry", "instance_visual_scene"):
            used = by_id.get(element.get("url", "#")[1:])
            size += 0 if used is None else size_of(used)
        opened.discard(element)
        known[element] = size
        return size

    totals: dict[str, int] = defaultdict(int)  # each geometry is counted at least once
    for library in root:
        totals[_name(library)] += sum(size_of(child) for child in library)
    return max(totals.values(), default=0)
