"""Pairs as other tools save them: read to the same A and B, or refused in one line."""

import io
import json
import os
import re
import struct
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from calib.errors import CalibError, FileFormatError, InputError
from calib.se3 import FloatArray, inverse, quaternion_from_rotation, rotation_exp, transform
from posedesign.files import trees
from posedesign.hand_eye.pairs import Pairs, PairSource, stacks
from posedesign.hand_eye.pairs.certificate import Camera
from posedesign.hand_eye.pairs.file import pair_columns, write_pairs

RNG = np.random.default_rng(8)
COUNT = 6


def some(count: int = COUNT) -> FloatArray:
    return transform(rotation_exp(RNG.normal(size=(count, 3))), RNG.uniform(0.2, 0.9, (count, 3)))


A, X, Z = some(), some(1)[0], some(1)[0]
B = inverse(Z) @ A @ X
PAIRS = Pairs(tuple(f"P{i + 1:02d}" for i in range(COUNT)), A, B)


def in_mm(T: FloatArray) -> FloatArray:
    out = T.copy()
    out[:, :3, 3] *= 1e3
    return out


def check(found: Pairs, atol: float = 1e-12, notes: tuple[str, ...] = ()) -> None:
    np.testing.assert_allclose(found.A, A, atol=atol)
    np.testing.assert_allclose(found.B, B, atol=atol)
    assert found.notes == notes
    assert found.misread == ""


def refusal(path: Path, **keys: Any) -> CalibError:
    with pytest.raises(CalibError) as caught:
        PairSource(path, **keys).read()
    assert "\n" not in str(caught.value)
    assert path.name in caught.value.message
    assert caught.value.hint
    return caught.value


# NumPy


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
@pytest.mark.parametrize("last", [False, True])
def test_arrays_of_numpy(tmp_path, save, last):
    path = tmp_path / "p.npz"
    arrays = {"A": in_mm(A), "B": in_mm(B), "note": np.array(["of", "me"]), "n": np.arange(3)}
    if last:  # as MATLAB stacks them, and in its order
        arrays["A"] = np.asfortranarray(np.moveaxis(arrays["A"], 0, -1))
    save(path, **arrays)
    found = PairSource(path, unit="mm").read()
    check(found)
    assert found.places[2] == "A[2]"
    check(PairSource(a=path, b=path, variables=["A", "B"], unit="mm").read())


def test_arrays_of_numpy_that_do_not_fit(tmp_path):
    path = tmp_path / "p.npz"
    np.savez(path, A=A, B=B[:, :3], whole=A.astype(int), turning=A + 1j * A)
    assert "key B: is 6x3x4 double, not 4x4xN double" in refusal(path, unit="m").message
    found = refusal(path, unit="m", variables=["A", "whole"]).message
    assert "key whole: is 6x4x4 int64" in found
    assert "4x4x6 complex" in refusal(path, unit="m", variables=["A", "turning"]).message
    assert "there is no variable 'C'" in refusal(path, unit="m", variables=["A", "C"]).message
    assert "does not say its unit" in refusal(path).message
    with pytest.raises(InputError, match="`columns` is for tables, not for files of matrices"):
        PairSource(path, unit="m", columns=["qw"])


def refusal_of(data: bytes, folder: Path) -> str:
    path = folder / "p.npz"
    path.write_bytes(data)
    return refusal(path, unit="m").message


def zipped(**files: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(f"{name}.npy", data)
    return out.getvalue()


def saved(array: Any) -> bytes:
    out = io.BytesIO()
    np.save(out, array)
    return out.getvalue()


def test_pickles_are_not_run(tmp_path):
    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return (Path.touch, (tmp_path / "was run",))

    data = zipped(A=saved(A), B=saved(np.array([Trap()], dtype=object)))
    assert "key B: is 1 object" in refusal_of(data, tmp_path)
    assert not (tmp_path / "was run").exists()


def test_files_of_numpy_that_are_damaged(tmp_path, monkeypatch):
    good = zipped(A=saved(A), B=saved(B))
    for data in (b"", b"text", good[:200], good[:60] + b"\xff\xff" + good[62:]):
        assert "is no file of NumPy's savez, or damaged" in refusal_of(data, tmp_path)
    shapes = (b"(9**9,4,)", b"(-6,4,-4)", b"(9999999,", b"(6L,4, 4)", b"(((((((((", b"'\\N{x}',8)")
    headers = [saved(A).replace(b"(6, 4, 4)", shape) for shape in shapes]
    for array in (saved(A)[:-1], *headers, b""):
        said = refusal_of(zipped(A=array, B=saved(B)), tmp_path)
        assert "or damaged" in said
        assert " at 0x" not in said
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("A.npy", saved(A))
    assert "packed otherwise than NumPy does" in refusal_of(out.getvalue(), tmp_path)
    version = saved(A)[:6] + b"\x03" + saved(A)[7:]
    assert "the version (3, 0)" in refusal_of(zipped(A=version), tmp_path)
    monkeypatch.setattr(stacks, "LARGEST_MAT_BYTES", 10_000)
    bomb = zipped(A=bytes(1_000_000))
    assert len(bomb) < 10_000
    assert "unfolds to more than 0.01 MB" in refusal_of(bomb, tmp_path)


# OpenCV


def stored(path: Path, write: Callable[[cv2.FileStorage], None]) -> Path:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("of", "a robot and its camera")
    write(storage)
    storage.release()
    return path


def as_list(storage: cv2.FileStorage, name: str, T: FloatArray) -> None:
    storage.startWriteStruct(name, cv2.FILE_NODE_SEQ)
    for matrix in T:
        storage.write("", matrix)
    storage.endWriteStruct()


ENDINGS = (".xml", ".yaml", ".yml", ".json")
FORMS: dict[str, Callable[[cv2.FileStorage, str, FloatArray], None]] = {
    "list": as_list,
    "array": lambda storage, name, T: storage.write(name, T),
    "rows of 16": lambda storage, name, T: storage.write(name, T.reshape(-1, 16)),
    "below each other": lambda storage, name, T: storage.write(name, T.reshape(-1, 4)),
}


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("form", FORMS)
def test_matrices_of_opencv(tmp_path, ending, form):
    def write(storage: cv2.FileStorage) -> None:
        for name, T in (("T_hand", A), ("T_eye", inverse(B))):
            FORMS[form](storage, name, in_mm(T))

    path = stored(tmp_path / f"p{ending}", write)
    found = PairSource(path, unit="mm", variables=["T_hand", "T_eye"], invert="b").read()
    check(found, 1e-10)
    assert found.places[5] == "T_hand[5]"


@pytest.mark.parametrize("ending", ENDINGS)
def test_matrices_of_opencv_that_are_no_transforms(tmp_path, ending):
    def write(storage: cv2.FileStorage) -> None:
        storage.write("A", A)
        storage.write("K", np.eye(3))
        storage.write("five", np.ones((5, 4)))
        storage.write("whole", np.ones((4, 4), dtype=np.int32))
        as_list(storage, "tall", np.ones((2, 3, 3)))

    path = stored(tmp_path / f"p{ending}", write)
    assert (
        "there is no variable 'whole'" in refusal(path, unit="m", variables=["A", "whole"]).message
    )
    for name, shape in (("K", "3x3"), ("five", "5x4"), ("tall", "2x3x3")):
        found = refusal(path, unit="m", variables=["A", name]).message
        assert f"key {name}: is {shape} double" in found
    if ending != ".xml":
        assert "does not say its unit" in refusal(path, variables=["A", "A"]).message
    path = stored(path, lambda storage: None)
    assert "no matrix of OpenCV" in refusal(path, unit="m").message


# texts with blocks, and tables with other separators


def blocks(T: FloatArray, between: str = " ", count: bool = True) -> str:
    text = "\n\n".join(
        "\n".join(between.join(f"{value:.12f}" for value in row) for row in matrix) for matrix in T
    )
    return f"{len(T)}\n{text}\n" if count else text


@pytest.mark.parametrize("count", [True, False])
@pytest.mark.parametrize("between", [" ", "\t", ", ", ",", ";", "  "])
def test_blocks_of_four_lines(tmp_path, count, between):
    a, b = tmp_path / "a.txt", tmp_path / "b.txt"
    a.write_text(blocks(in_mm(A), between, count))
    b.write_text("# target in the camera\n" + blocks(in_mm(B), between, count))
    found = PairSource(a=a, b=b, unit="mm").read()
    np.testing.assert_allclose(found.A, A, atol=1e-9)
    np.testing.assert_allclose(found.B, B, atol=1e-9)
    assert found.places[1] == f"line {6 + count}"
    said = {"\t": "tabs", ";": "semicolons", ",": "", ", ": ""}.get(between, "spaces")
    assert [f"{path}: {said} stand between the cells" for path in (a, b) if said] == list(
        found.notes
    )


def test_blocks_with_commas_in_numbers(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text(blocks(A).replace(".", ","))
    found = PairSource(a=path, b=path, unit="m").read()
    np.testing.assert_allclose(found.A, A, atol=1e-9)
    assert found.notes[0].endswith("a.txt: spaces stand between the cells, and commas in numbers")


def test_blocks_that_do_not_fit(tmp_path):
    path = tmp_path / "a.txt"
    lines = blocks(A).splitlines()

    def said(text: str, **keys: Any) -> str:
        path.write_text(text)
        with pytest.raises(CalibError) as caught:
            PairSource(a=path, b=path, **{"unit": "m", **keys}).read()
        return caught.value.message

    assert "has 23 lines of four numbers, and says that it has 6" in said("\n".join(lines[:-1]))
    assert "has 24 lines of four numbers, and says that it has 7" in said(
        "\n".join(["7", *lines[1:]])
    )
    assert "line 4: has 5 cells, 4 are named" in said("\n".join([*lines[:3], lines[3] + " 1"]))
    assert "line 4, column 2: '-' is not" in said("\n".join([*lines[:3], "1 - 3 4"]))
    assert "line 7: the last row of the matrix is" in said(
        "\n".join([*lines[:9], "0 0 1 1", *lines[10:]])
    )
    assert "does not say its unit" in said(blocks(A), unit=None)
    found = refusal(path, unit="m")
    assert "holds the poses of one side" in found.message
    assert "`a` or `b`" in found.hint


@pytest.mark.parametrize("mark", [";", "\t", " "])
def test_tables_with_other_separators(tmp_path, mark):
    path = write_pairs(tmp_path / "p.csv", PAIRS)
    path.write_text(path.read_text().replace(",", mark).replace(".", ","))
    found = PairSource(path).read()
    np.testing.assert_allclose(found.B, B, atol=1e-9)
    (note,) = found.notes
    assert "stand between the cells, and commas in numbers" in note
    path.write_text("\n".join(path.read_text().splitlines()[1:]))
    columns = ["-", *pair_columns("a"), *pair_columns("b")]
    found = PairSource(path, columns=columns).read()
    np.testing.assert_allclose(found.A, A, atol=1e-9)
    assert found.notes == (note,)


def test_a_separator_inside_of_a_cell_is_none(tmp_path):
    path = write_pairs(tmp_path / "p.csv", PAIRS)
    head, *lines = path.read_text().splitlines()
    for column in ("note; of whom", "note\tof whom", "note of whom"):
        path.write_text("\n".join([f"{head},{column}", *(f"{line},1;5" for line in lines)]))
        check(PairSource(path).read(), 1e-9)


def test_a_table_out_of_a_pipe(tmp_path):
    path = write_pairs(tmp_path / "p.csv", PAIRS)
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with subprocess.Popen(["cp", str(path), str(pipe)]):
        check(PairSource(pipe).read(), 1e-9)


# samples


def message(T: FloatArray) -> dict[str, dict[str, float]]:
    w, x, y, z = quaternion_from_rotation(T[:3, :3]).tolist()
    return {
        "translation": dict(zip("xyz", T[:3, 3].tolist(), strict=True)),
        "rotation": {"x": x, "y": y, "z": z, "w": w},
    }


SEEN = {"on-flange": inverse(B), "fixed": B}
"""``T_camera_target``, whatever is fixed."""


def moveit(camera: Camera) -> list[dict[str, list[float]]]:
    return [
        {"effector_wrt_world": a.ravel().tolist(), "object_wrt_sensor": b.ravel().tolist()}
        for a, b in zip(A, SEEN[camera], strict=True)
    ]


def robot(camera: Camera) -> FloatArray:
    """As both easy_handeye look it up."""
    return A if camera == "on-flange" else inverse(A)


def easy_handeye2(camera: Camera, said: str = "") -> dict[str, Any]:
    samples = [
        {"robot": message(a), "tracking": message(b)}
        for a, b in zip(robot(camera), SEEN[camera], strict=True)
    ]
    return {"parameters": {"name": "c", "calibration_type": said}, "samples": samples}


def easy_handeye(camera: Camera) -> dict[str, Any]:
    hand, seen = ([message(T) for T in side] for side in (robot(camera), SEEN[camera]))
    return {"hand_world_samples": hand, "camera_marker_samples": seen}


CAMERAS: tuple[Camera, ...] = ("on-flange", "fixed")
SAVED: dict[str, Callable[[Camera], Any]] = {
    "moveit": moveit,
    "moveit test data": lambda camera: [
        [a.tolist(), b.tolist()] for a, b in zip(A, SEEN[camera], strict=True)
    ],
    "easy_handeye2": easy_handeye2,
    "easy_handeye": easy_handeye,
    "easy_handeye, answer": lambda camera: {"samples": easy_handeye(camera)},
    "easy_handeye, lists": lambda camera: {
        name: {"transforms": side} for name, side in easy_handeye(camera).items()
    },
}


def write(path: Path, content: Any) -> Path:
    dump = json.dumps if path.suffix == ".json" else yaml.safe_dump
    path.write_text(dump(content))
    return path


def assumed(path: Path, camera: Camera) -> str:
    words = {"fixed": "fixed", "on-flange": "on the flange"}[camera]
    return f"{path} does not say where the camera is: taken as {words}, by `camera`"


@pytest.mark.parametrize("ending", [".yaml", ".json", ".samples"])
@pytest.mark.parametrize("kind", SAVED)
@pytest.mark.parametrize("camera", CAMERAS)
def test_samples(tmp_path, ending, kind, camera):
    path = write(tmp_path / f"s{ending}", SAVED[kind](camera))
    found = PairSource(path, camera=camera).read()
    check(found, notes=(assumed(path, camera),))
    side = {"m": "effector_wrt_world", "e": "robot"}[kind[0]]
    side = "hand_world_samples" if kind.startswith("easy_handeye") and "2" not in kind else side
    assert found.places[3] == f"{side}[3]"


def test_numbers_as_yaml_has_them(tmp_path):
    """Python writes 5e-05, which YAML 1.1 takes for a word; the node of ROS ends with ---."""
    content = moveit("on-flange")
    text = json.dumps(content, indent=1)
    text = re.sub(r"\b0\.0\b", "0e-05", re.sub(r"(?<=\s)1\.0\b", "10.0E-1", text))
    assert "0e-05" in text
    assert "10.0E-1" in text
    path = tmp_path / "s.yaml"
    path.write_text("# of MoveIt\n" + text + "\n---\n")
    check(PairSource(path).read(), notes=(assumed(path, "on-flange"),))


def test_where_the_camera_is_by_the_file(tmp_path):
    for camera, said in (("on-flange", "eye_in_hand"), ("fixed", "eye_on_base")):
        path = write(tmp_path / "s.yaml", easy_handeye2(camera, said))
        check(PairSource(path, camera=camera).read())
        other = next(c for c in CAMERAS if c != camera)
        found = refusal(path, camera=other)
        assert isinstance(found, InputError)
        assert "says that the camera is" in found.message
        assert found.hint == f"say `camera` {camera}"


def test_samples_that_are_broken(tmp_path):
    path = tmp_path / "s.yaml"
    content = moveit("on-flange")
    content[4]["object_wrt_sensor"].pop()
    assert "key object_wrt_sensor[4]: is no transform" in refusal(write(path, content)).message
    content[4]["object_wrt_sensor"].append(2.0)
    found = refusal(write(path, content))
    assert "object_wrt_sensor[4]: the last row of the matrix is 0 0 0 2" in found.message
    easy = easy_handeye2("on-flange")
    easy["samples"][2]["robot"]["rotation"]["w"] = 3.0
    assert "robot[2]: the quaternion has the norm" in refusal(write(path, easy)).message
    del easy["samples"][2]["robot"]["rotation"]
    assert "robot[2]: is no transform" in refusal(write(path, easy)).message
    easy = easy_handeye("on-flange")
    easy["hand_world_samples"].pop()
    assert "has 6 poses" in refusal(write(path, easy)).message


def test_samples_in_another_unit(tmp_path):
    content = [
        {name: in_mm(np.reshape(T, (1, 4, 4))).ravel().tolist() for name, T in item.items()}
        for item in moveit("on-flange")
    ]
    path = write(tmp_path / "s.yaml", content)
    found = refusal(path)
    assert "key effector_wrt_world: a translation is" in found.message
    assert "divide them by 1000" in found.hint
    PairSource(path, trust_units=True).read()


def test_options_that_samples_do_not_need(tmp_path):
    path = write(tmp_path / "s.yaml", moveit("on-flange"))
    for keys in ({"convention": "opencv"}, {"columns": ["qw"]}):
        assert "says itself what A and B are" in refusal(path, **keys).message
    with pytest.raises(InputError, match="for files of matrices"):
        PairSource(path, unit="m").read()
    with pytest.raises(FileFormatError, match="holds both sides") as caught:
        PairSource(a=path, b=path).read()
    assert "without `a` and `b`" in caught.value.hint


# whatever calls itself one of these


HOSTILE: dict[str, tuple[bytes, str]] = {
    "nothing": (b"", "holds 0 documents"),
    "two": (b"a: 1\n---\nb: 2\n", "holds 2 documents"),
    "a word": (b"word", "no matrix of OpenCV"),
    "an empty list": (b"[]", "no matrix of OpenCV"),
    "aliases": (b"a: &a [1, 1]\nb: [*a, *a]\n", "line 1: has an anchor"),
    "deep": (b"[" * 100_000, "cannot be understood"),
    "deep YAML": (b"a: " + b"[" * 100_000, "is nested more than"),
    "no YAML": (b"a: [1\nb: 2", "is no YAML"),
    "no text": (b"a: \xff\xfe", "is not text in UTF-8"),
    "a tag": (b"a: !!python/object:os.system ls\n", "has a tag"),
    "no JSON": (b'{"a": NaN}', "cannot be understood"),
    "no XML": (b"<a><b></a>", "cannot be understood: mismatched tag"),
    "entities": (b'<!DOCTYPE a [<!ENTITY b "bb">]><a>&b;</a>', "cannot be understood"),
    "deep XML": (b"<a>" * 5_000 + b"</a>" * 5_000, "nested more than"),
    "parts of one name": (b"<a><b>1</b><b>2</b><c>3</c></a>", "two parts of one name"),
    "a matrix of many": (
        b"A:\n  rows: 1000000\n  cols: 1000000\n  dt: d\n  data: [1]\n",
        "no matrix of OpenCV",
    ),
    "a matrix of a part": (
        b"A:\n  rows: 0.5\n  cols: 32\n  dt: d\n  data: [1]\n",
        "no matrix of OpenCV",
    ),
}


@pytest.mark.parametrize("ending", [".yaml", ".json", ".xml"])
@pytest.mark.parametrize("name", HOSTILE)
def test_files_of_keys_that_are_hostile(tmp_path, name, ending):
    data, said = HOSTILE[name]
    path = tmp_path / f"p{ending}"
    path.write_bytes(data)
    assert said in refusal(path, unit="m").message


def test_files_of_keys_that_are_large(tmp_path, monkeypatch):
    monkeypatch.setattr(trees, "LARGEST_TREE_BYTES", 100)
    assert "is larger" in refusal(write(tmp_path / "s.yaml", moveit("fixed"))).message


def test_damage_anywhere(tmp_path):
    """One byte of each kind of file is another: pairs or one line, and nothing else."""
    rng = np.random.default_rng(4)
    said: set[str] = set()
    stored(tmp_path / "p.xml", lambda storage: as_list(storage, "A", A))
    np.savez(tmp_path / "p.npz", A=A, B=B)
    write(tmp_path / "p.yaml", moveit("fixed"))
    (tmp_path / "p.txt").write_text(blocks(A))
    for path in sorted(tmp_path.iterdir()):
        whole = bytearray(path.read_bytes())
        for _ in range(60):
            broken = whole.copy()
            broken[rng.integers(len(broken))] = rng.integers(256)
            path.write_bytes(bytes(broken))
            unit = None if path.suffix == ".yaml" else "m"
            sides = {"pairs": path} if unit is None else {"a": path, "b": path}
            keys: dict[str, Any] = (
                {"variables": ["A", "A"]} if path.suffix in (".xml", ".npz") else {}
            )
            try:
                PairSource(**sides, unit=unit, **keys).read()
            except CalibError as error:
                said.add(str(error))
    assert len(said) > 50
    assert not any("\n" in text for text in said)


def test_the_length_of_a_header_is_not_trusted(tmp_path):
    data = bytearray(saved(A))
    data[8:10] = struct.pack("<H", 65000)
    assert "or damaged" in refusal_of(zipped(A=bytes(data)), tmp_path)
