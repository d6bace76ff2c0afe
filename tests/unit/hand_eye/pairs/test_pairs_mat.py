"""MATLAB files: arrays 4x4xN of numbers are read, everything else is refused in one line."""

import io
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from calib import mat_file
from calib.errors import CalibError, FileFormatError, InputError
from calib.se3 import FloatArray, inverse, transform
from posedesign.hand_eye.pairs import Pairs, PairSource, stacks, write_pairs
from tests.marks import rest_in_slow


def some_transforms(count: int = 6, seed: int = 3) -> FloatArray:
    rng = np.random.default_rng(seed)
    return transform(Rotation.random(count, rng=rng).as_matrix(), rng.uniform(0.2, 0.9, (count, 3)))


def some_pairs() -> Pairs:
    A, X, Z = some_transforms(), some_transforms(1, 4), some_transforms(1, 5)
    return Pairs(tuple(f"P{i + 1:02d}" for i in range(len(A))), A, inverse(Z) @ A @ X)


def as_matlab(T: FloatArray, unit: str) -> FloatArray:
    """4x4xN, as MATLAB stacks transforms."""
    out = np.moveaxis(T, 0, -1).copy()
    out[:3, 3] *= {"mm": 1e3, "m": 1.0}[unit]
    return out


Save = Callable[..., Path]


@pytest.fixture
def save(tmp_path) -> Save:
    def saved(name: str = "pairs.mat", compress: bool = True, **variables: Any) -> Path:
        savemat(tmp_path / name, variables, do_compression=compress)
        return tmp_path / name

    return saved


@pytest.mark.parametrize(("unit", "compress"), [("mm", True), ("m", False)])
def test_round_trip(save, unit, compress):
    pairs = some_pairs()
    path = save(compress=compress, B=as_matlab(pairs.B, unit), A=as_matlab(pairs.A, unit), n=3.0)
    found = PairSource(path, unit=unit).read()
    np.testing.assert_allclose(found.A, pairs.A, atol=1e-12)
    np.testing.assert_allclose(found.B, pairs.B, atol=1e-12)
    assert (found.names, found.notes) == (pairs.names, ())
    assert found.places[2] == "A(:,:,3)"


@pytest.mark.usefixtures("in_this_process")
def test_variables_by_name_and_two_files(save):
    pairs = some_pairs()
    hand, cam = as_matlab(pairs.A, "m"), as_matlab(inverse(pairs.B), "m")
    one = save(T_hand=hand, T_cam=cam)
    a, b = save("a.mat", T_hand=hand, k=1.0), save("b.MAT", T_cam=cam)
    for keys in (
        {"pairs": one, "variables": ["T_hand", "T_cam"]},
        {"a": a, "b": b},
        {"a": one, "b": one, "variables": ["T_hand", "T_cam"]},
    ):
        found = PairSource(**keys, unit="m", invert="b").read()
        np.testing.assert_allclose(found.A, pairs.A, atol=1e-12)
        np.testing.assert_allclose(found.B, pairs.B, atol=1e-12)


@pytest.mark.usefixtures("in_this_process")
def test_single_precision_is_taken_as_the_nearest_rotation(save):
    pairs = some_pairs()
    path = save(A=as_matlab(pairs.A, "m").astype(np.float32), B=as_matlab(pairs.B, "m"))
    found = PairSource(path, unit="m").read()
    np.testing.assert_allclose(found.A, pairs.A, atol=1e-6)
    R = found.A[:, :3, :3]
    np.testing.assert_allclose(
        np.swapaxes(R, -1, -2) @ R, np.tile(np.eye(3), (6, 1, 1)), atol=1e-12
    )


def refused(path: Path, *words: str, **keys: Any) -> str:
    with pytest.raises(FileFormatError) as caught:
        PairSource(path, **{"unit": "m", **keys}).read()
    assert all(word in str(caught.value) for word in (path.name, *words)), caught.value
    return str(caught.value)


def changed(T: FloatArray, pose: int, change: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """4x4xN with one of the matrices changed."""
    out = as_matlab(T, "m")
    out[:, :, pose] = change(out[:, :, pose])
    return out


POSES: dict[str, tuple[Callable[[FloatArray], FloatArray], tuple[str, ...]]] = {
    "transposed": (lambda T: T.T, ("not 0 0 0 1", "transposed: give it row by row")),
    "left-handed": (lambda T: T @ np.diag([1.0, 1.0, -1.0, 1.0]), ("left-handed",)),
    "scaled": (lambda T: T @ np.diag([1.01, 1.01, 1.01, 1.0]), ("scaled by 1.01",)),
    "sheared": (lambda T: T @ np.diag([1.01, 1.0, 1.0, 1.0]), ("not orthonormal (off by 0.02",)),
    "empty": (lambda T: 0.0 * T, ("last row", "0 0 0 0")),
    "not a number": (lambda T: T * [1.0, 1.0, 1.0, np.nan], ("not finite", "leave this pose out")),
    "infinite": (lambda T: T + np.diag([0.0, np.inf, 0.0, 0.0]), ("not finite",)),
    "huge": (lambda T: T * [1e300, 1.0, 1.0, 1.0], ("not orthonormal",)),
}


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.parametrize("kind", POSES)
def test_matrix_that_is_no_transform(save, kind):
    change, words = POSES[kind]
    pairs = some_pairs()
    path = save(A=as_matlab(pairs.A, "m"), B=changed(pairs.B, 4, change))
    refused(path, "key B(:,:,5)", *words)


@pytest.mark.usefixtures("in_this_process")
def test_variables_that_do_not_fit(save):
    pairs = some_pairs()
    A = as_matlab(pairs.A, "m")
    path = save(
        hand=A,
        cam=A,
        flat=A[:, :, 0],
        wrong=np.moveaxis(A, -1, 0),
        whole=(10 * A).astype(np.int32),
        text="4x4",
        cell=np.array([{"T": A}, "B"], dtype=object),
        struct={"T": A},
        turning=A + 1j * A,
    )
    refused(path, "which of its variables are A and B", "hand: 4x4x6 double", "`variables`")
    refused(path, "no variable 'camm'", "did you mean cam?", variables=["hand", "camm"])
    for name, what in (
        ("flat", "4x4 double"),
        ("wrong", "6x4x4 double"),
        ("text", "1x3 char"),
        ("cell", "1x2 cell"),
        ("struct", "1x1 struct"),
    ):
        refused(path, f"key {name}: is {what}, not 4x4xN", "cat(3, T{:})", variables=["hand", name])
    whole = "key whole: is 4x4x6 int32: whole numbers, which rotations are not made of"
    refused(path, whole, "in double", variables=["hand", "whole"])
    turning = "key turning: is 4x4x6 complex double, and transforms are real"
    refused(path, turning, "save real() of it", variables=["hand", "turning"])
    two = save("two.mat", hand=A, cam=A)
    refused(two, "`variables` hand,cam")
    with pytest.raises(FileFormatError, match=r"two\.mat: does not say which .*cam"):
        PairSource(a=two, b=two, unit="m").read()
    refused(save("none.mat"), "it is empty")
    refused(save("few.mat", A=A, B=A[:, :, :5]), "key B: has 5 poses, A has 6")


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (np.int16, "is 4x4x6 int16: whole numbers"),
        (np.uint8, "is 4x4x6 uint8: whole numbers"),
        (np.complex128, "is 4x4x6 complex double, and transforms are real"),
    ],
)
def test_kind_that_is_none_is_said_without_names(save, kind, words):
    """Of A and B themselves, and of the only variable of a file."""
    A = as_matlab(some_pairs().A, "m")
    other = (100.0 * np.abs(A)).astype(kind) * (1j if kind is np.complex128 else 1)
    refused(save(A=A, B=other), f"key B: {words}")
    one, alone = save("a.mat", T=A), save("b.mat", seen=other)
    with pytest.raises(FileFormatError, match=f"b.mat, key seen: {words}"):
        PairSource(a=one, b=alone, unit="m").read()


@pytest.mark.usefixtures("in_this_process")
def test_translation_beyond_any_robot(save):
    pairs = some_pairs()
    far = changed(pairs.B, 2, lambda T: T + np.outer([1.0, 0, 0, 0], [0, 0, 0, 1e307]))
    for unit in ("m", "mm"):
        refused(
            save(A=as_matlab(pairs.A, unit), B=far),
            "key B(:,:,3): a translation of 1e+30",
            unit=unit,
            trust_units=True,
        )


@pytest.mark.usefixtures("in_this_process")
def test_unit_that_cannot_be(save):
    pairs = some_pairs()
    for unit, other, words in (("mm", "m", "is longer than"), ("m", "mm", "m long")):
        path = save(A=as_matlab(pairs.A, other), B=as_matlab(pairs.B, unit))
        refused(path, "key A", words, f"if these are {other}, say `unit` {other}", unit=unit)
        PairSource(path, unit=unit, trust_units=True).read()


OPTIONS: dict[str, tuple[dict[str, Any], str]] = {
    "no unit": ({"pairs": Path("p.mat")}, "p.mat does not say its unit.*`unit` mm or `unit` m"),
    "inches": ({"pairs": Path("p.mat"), "unit": "inch"}, "`unit` cannot be 'inch'"),
    "one name": ({"pairs": Path("p.mat"), "unit": "m", "variables": ["A"]}, "has 1 names"),
    "columns": (
        {"pairs": Path("p.mat"), "unit": "m", "columns": ["qw"]},
        "`columns` is for tables",
    ),
    "nothing": ({}, "one file of pairs, or one with `a` and one with `b`"),
    "one side": ({"a": Path("a.csv")}, "one with `a` and one with `b`"),
    "everything": ({k: Path("p.csv") for k in ("pairs", "a", "b")}, "one file of pairs, or"),
    "invert": ({"pairs": Path("p.csv"), "invert": "c"}, "`invert` cannot be 'c'"),
    "convention": ({"pairs": Path("p.csv"), "convention": "halcon"}, "`convention` cannot be"),
}


@pytest.mark.parametrize("case", OPTIONS.values(), ids=OPTIONS)
def test_options_that_do_not_go_together(case):
    keys, words = case
    with pytest.raises(InputError, match=words):
        PairSource(**keys)


@pytest.mark.parametrize("keys", [{"unit": "m"}, {"variables": ["A", "B"]}])
def test_options_of_matrices_with_a_table(tmp_path, keys):
    path = write_pairs(tmp_path / "p.csv", some_pairs())
    with pytest.raises(InputError, match=r"for files of matrices.*names of its columns"):
        PairSource(path, **keys).read()


HEADER = b"MATLAB 5.0 MAT-file, made by a test".ljust(124) + b"\x00\x01IM"

FILES: dict[str, tuple[bytes, tuple[str, ...]]] = {
    "nothing": (b"", ("no MATLAB file",)),
    "text": (b"qw,qx\n1,0\n" * 50, ("no MATLAB file of version 5 to 7", "the right file?")),
    "version 7.3": (
        b"MATLAB 7.3 MAT-file, Platform".ljust(512) + b"\x89HDF\r\n\x1a\n",
        ("version 7.3 (HDF5)", "-v7')"),
    ),
    "HDF5": (b"\x89HDF\r\n\x1a\n" + bytes(600), ("version 7.3",)),
    "HDF5 behind a block": (bytes(512) + b"\x89HDF\r\n\x1a\n", ("version 7.3",)),
    "version 4": (struct.pack("<5i", 0, 4, 4, 0, 2) + b"A\0" + bytes(128), ("no MATLAB file",)),
    "a header only": (HEADER, ("which of its variables", "it is empty")),
    "half a header": (HEADER[:100], ("damaged or cut off",)),
    "no byte order": (HEADER[:126] + b"XX", ("damaged or cut off",)),
    "half a tag": (HEADER + b"\x0e\0\0\0", ("damaged or cut off",)),
    "no variable": (HEADER + struct.pack("<II", 9, 8) + bytes(8), ("damaged or cut off",)),
    "longer than the file": (HEADER + struct.pack("<II", 14, 4_000_000_000), ("damaged or cut",)),
    "rubbish inside": (HEADER + struct.pack("<II", 14, 64) + bytes(range(64)), ("damaged or cut",)),
    "rubbish compressed": (HEADER + struct.pack("<II", 15, 8) + bytes(8), ("damaged or cut off",)),
}


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.parametrize("name", FILES)
def test_files_that_are_none(tmp_path, name):
    data, words = FILES[name]
    path = tmp_path / "p.mat"
    path.write_bytes(data)
    refused(path, *words)


@pytest.mark.parametrize("name", rest_in_slow(FILES, ["rubbish compressed"]))
def test_files_that_are_none_where_they_do_no_harm(tmp_path, name):
    """In the process of its own."""
    data, words = FILES[name]
    path = tmp_path / "p.mat"
    path.write_bytes(data)
    refused(path, *words)


def test_file_that_is_not_there(tmp_path):
    refused(tmp_path / "no.mat", "cannot be read: No such file")


def test_few_bytes_that_unfold_to_many(save, monkeypatch):
    for module in (mat_file, stacks):
        monkeypatch.setattr(module, "LARGEST_MAT_BYTES", 1_000_000)
    path = save(A=np.zeros((4, 4, 100_000)))
    assert path.stat().st_size < 30_000
    refused(path, "unfolds to more than 1 MB")
    path.write_bytes(HEADER + bytes(1_000_000))
    refused(path, "is larger than 1 MB")


def test_what_crashes_the_reader_is_damaged(save, monkeypatch):
    """In its own process: a crash, and what takes more memory than it has."""
    A = as_matlab(some_pairs().A, "m")
    path = save(A=A, B=A)
    monkeypatch.setattr(mat_file, "_MEMORY_BYTES", 20_000_000)
    refused(path, "damaged or cut off")


@pytest.mark.slow
def test_lengths_inside_that_are_not_true(save):
    """Dimensions of gigabytes over an array of bytes."""
    A = as_matlab(some_pairs().A, "m")
    path = save(A=A, B=A, compress=False)
    data = path.read_bytes()
    for count in (7, 2**20, 2**31 - 1, -6):
        path.write_bytes(
            data.replace(struct.pack("<iii", 4, 4, 6), struct.pack("<iii", 4, 4, count))
        )
        refused(path)


@pytest.mark.slow
@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    places=st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(0, 255)), min_size=1, max_size=8),
    keep=st.floats(0.05, 1.0),
)
def test_damaged_files_raise_nothing_but_known_errors(tmp_path, places, keep):
    A = as_matlab(some_pairs().A, "m")
    stream = io.BytesIO()
    cell = np.array(["a", {"T": A}], dtype=object)
    savemat(stream, {"A": A, "B": A, "s": {"x": [1, 2]}, "c": cell})
    data = bytearray(stream.getvalue())
    for place, value in places:
        data[128 + int(place * (len(data) - 129))] = value
    path = tmp_path / "damaged.mat"
    path.write_bytes(bytes(data[: max(128, int(keep * len(data)))] if keep < 0.9 else data))
    try:
        found = PairSource(path, unit="m").read()
    except CalibError:
        return
    assert np.isfinite(found.A).all()
