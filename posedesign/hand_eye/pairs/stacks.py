"""Files of matrices: 4x4 transforms stacked under a name, or as blocks of a text.

==================  ============================================================================
``.mat``            MATLAB, version 5 to 7: arrays 4x4xN
``.npz .npy``       NumPy: arrays Nx4x4 or 4x4xN; without pickles, which would be run
``.xml .yaml``      OpenCV's persistence, and its JSON: a list of 4x4 matrices, or one matrix with
``.yml .json``      16 numbers a row, or one with the transforms below each other; so, too, what
                    Python's ``cv2.FileStorage.write`` makes of an array Nx4x4
text                four numbers a line, each four lines a transform; their count may come first
==================  ============================================================================

None of them says its unit of length. In files of NumPy and OpenCV, and in other JSON and YAML,
rotations Nx3x3 or rotation vectors and translations Nx3 make transforms where they have the names
``R_gripper2base`` and ``t_gripper2base``, as OpenCV calls them, ``rvec_..`` and ``tvec_..``, or
``R`` and ``t``: of ``gripper2base``, ``target2cam`` or whatever follows.
"""

from __future__ import annotations

import io
import math
import re
import warnings
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib import se3
from calib.errors import FileFormatError, near_names
from calib.mat_file import LARGEST_MAT_BYTES, Variable, read_variables
from calib.se3 import FloatArray
from posedesign.files import read_bytes_bounded
from posedesign.files.csv_tables import (
    LARGEST_CSV_BYTES,
    LONGEST_SHOWN,
    is_number,
    numbers_of,
    parse_table,
)
from posedesign.files.trees import matrix, numbers
from posedesign.hand_eye.conventions import Convention
from posedesign.hand_eye.pairs.forms import (
    METRES,
    Place,
    Poses,
    WrittenPoses,
    check_lengths,
    refuse_endless,
    transforms_from_matrices,
)

WHOLE_NUMBERS = tuple(f"{sign}int{bits}" for bits in (8, 16, 32, 64) for sign in ("", "u"))
"""Kinds that they cannot be, however their numbers are stacked."""

_MAGIC = b"MATLAB 5.0 MAT-file"
_HDF5 = (b"MATLAB 7.3", b"\x89HDF\r\n\x1a\n")


@dataclass(frozen=True)
class StackFile:
    """A file of matrices that was looked into."""

    path: Path
    variables: Mapping[str, Variable]  # by name; arrays are 4x4xN, whatever their order in the file
    marks: tuple[str, str] = ("(:,:,", ")")
    """What stands around the number of a transform, behind the name."""
    first: int = 1  # number of the first
    lines: tuple[int, ...] = ()  # lines where transforms begin, in a text
    notes: tuple[str, ...] = ()  # what is odd about it
    hint: str = "stack the transforms along the third dimension: cat(3, T{:})"
    """What to do where something is no stack of transforms."""

    @property
    def stacks(self) -> tuple[str, ...]:
        """Names of the variables that are 4x4xN numbers."""
        return tuple(name for name, variable in self.variables.items() if _is_stack(variable))

    def poses(self, name: str, unit: str, *, trust_units: bool) -> Poses:
        """Transforms of a variable."""
        T = self._array(name)
        place = Place(self.path, self.lines, "" if self.lines else name, self.marks, self.first)
        T[:, :3, 3] *= METRES[unit]
        T, note = transforms_from_matrices(T, place)
        refuse_endless(place, T[:, :3, 3])
        if not trust_units:
            other = "m" if unit == "mm" else "mm"
            check_lengths(place, T[:, :3, 3], unit, f"say `unit` {other}")
        notes = (f"{self.path}, {name}: {note}",) if note else ()
        return Poses(T, place, (), self.notes + notes, "matrix", T[:, :3, :3].reshape(-1, 9))

    def written(self, name: str, length: str = "") -> WrittenPoses:
        """Transforms of a variable as they stand, in a unit of length that may not be known."""
        T = self._array(name)
        place = Place(self.path, self.lines, "" if self.lines else name, self.marks, self.first)
        return WrittenPoses(
            place,
            T[:, :3, 3],
            T[:, :3, :3].reshape(-1, 9),
            Convention("matrix", "", length),
            notes=self.notes,
        )

    def _array(self, name: str) -> FloatArray:
        """Matrices ``(N, 4, 4)`` in the unit of the file."""
        if name not in self.variables:
            raise FileFormatError(
                f"there is no variable {name[:LONGEST_SHOWN]!r}",
                path=self.path,
                hint=near_names(name, self.stacks or self.variables),
                value=name,
            )
        variable = self.variables[name]
        if variable.array is None or not _is_stack(variable):
            raise _no_stack(self, name, variable)
        return np.moveaxis(variable.array, -1, 0).copy()


def open_mat(path: Path) -> StackFile:
    """Look into a MATLAB file."""
    data = read_bytes_bounded(path, most_bytes=LARGEST_MAT_BYTES)
    if data.startswith(_HDF5) or data[512:].startswith(_HDF5[1]):
        raise FileFormatError(
            "is a MATLAB file of version 7.3 (HDF5)",
            path=path,
            hint="save it again with save('file.mat', 'A', 'B', '-v7')",
        )
    if not data.startswith(_MAGIC):
        raise FileFormatError(
            "is no MATLAB file of version 5 to 7", path=path, hint="is it the right file?"
        )
    try:
        return StackFile(path, read_variables(data))
    except OverflowError as error:
        raise FileFormatError(
            f"unfolds to more than {LARGEST_MAT_BYTES / 1e6:g} MB",
            path=path,
            hint="save the two variables alone",
        ) from error
    except OSError as error:
        raise FileFormatError(
            "is damaged or cut off",
            path=path,
            hint="save it again with save('file.mat', .., '-v7')",
        ) from error


_PYTHON_HINT = "store N transforms as one array of Nx4x4 numbers"


def open_npz(path: Path) -> StackFile:
    """Look into a file of NumPy's ``savez``."""
    data = read_bytes_bounded(path, most_bytes=LARGEST_MAT_BYTES)
    arrays: dict[str, Variable | Any] = {}
    if path.suffix.casefold() == ".npy":
        data = _as_archive(path, data)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            parts = archive.infolist()
            if sum(part.file_size for part in parts) > LARGEST_MAT_BYTES:
                raise FileFormatError(
                    f"unfolds to more than {LARGEST_MAT_BYTES / 1e6:g} MB",
                    path=path,
                    hint="save the two arrays alone",
                )
            for part in parts:
                if part.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                    raise ValueError("packed otherwise than NumPy does")
                arrays[part.filename.removesuffix(".npy")] = _numpy_array(archive.read(part))
    except (OSError, ValueError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise FileFormatError(
            f"is no file of NumPy's savez, or damaged: {' '.join(str(error).split())[:100]}",
            path=path,
            hint="save it again with numpy.savez(file, A=.., B=..)",
        ) from error
    given = {name: array for name, array in arrays.items() if not isinstance(array, Variable)}
    variables = {
        name: array if isinstance(array, Variable) else _stacked(array)
        for name, array in arrays.items()
    }
    rows = {name: _rows_of_array(array) for name, array in given.items()}
    return StackFile(path, _joined(rows) | variables, ("[", "]"), 0, hint=_PYTHON_HINT)


def _as_archive(path: Path, data: bytes) -> bytes:
    """A file of NumPy's ``save`` as one of its ``savez``."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(f"{path.stem}.npy", data)
    return stream.getvalue()


def _rows_of_array(array: Any) -> FloatArray | None:
    """Rotations or vectors of an array ``(N, 9)`` or ``(N, 3)``; None where it is neither."""
    for shape, count in (((3, 3), 9), ((3, 1), 3), ((3,), 3)):
        if array.ndim == 1 + len(shape) and array.shape[1:] == shape and array.dtype.kind == "f":
            return np.asarray(array, dtype=float).reshape(-1, count)
    return None


_WORDS = (("r_", "t_"), ("rvec_", "tvec_"), ("rvecs_", "tvecs_"))
_ALONE = (("r", "t"), ("rvec", "tvec"), ("rvecs", "tvecs"), ("rotations", "translations"))
"""Beginnings of names of rotations and translations, and names without an end."""


def _joined(rows: Mapping[str, FloatArray | None]) -> dict[str, Variable]:
    """Transforms of rotations ``(N, 9)`` or ``(N, 3)`` and translations ``(N, 3)`` by names."""
    small = {name.casefold(): found for name, found in rows.items() if found is not None}
    named = [
        (name, place + name.removeprefix(turn), name.removeprefix(turn))
        for turn, place in _WORDS
        for name in small
        if name.startswith(turn)
    ]
    named += [(turn, place, "poses") for turn, place in _ALONE if turn in small]
    found: dict[str, Variable] = {}
    for turn, place, name in named:
        R, places = small[turn], small.get(place)
        if places is None or places.shape != (len(R), 3) or name in found:
            continue
        R = R.reshape(-1, 3, 3) if R.shape[1] == 9 else se3.rotation_exp(R)
        T = np.zeros((len(R), 4, 4))
        T[:, :3, :3], T[:, :3, 3], T[:, 3, 3] = R, places, 1.0
        found[name] = _stacked(T)
    return found


def _numpy_array(data: bytes) -> Any:
    """An array of NumPy, or its kind where that has no numbers.

    ValueError where its header and its numbers do not fit.
    """
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    readers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    if version not in readers:
        raise ValueError(f"an array of the version {version}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            shape, by_columns, kind = readers[version](stream)
    except Exception as error:  # it parses Python: anything may come out of that
        # what it says of a node of Python's own has the address of that
        raise ValueError(re.sub(r":? <.*", "", str(error))) from error
    if kind.kind not in "fc":
        return Variable("object" if kind.hasobject else kind.name, tuple(shape))
    if min(shape, default=0) < 0 or math.prod(shape) * kind.itemsize != len(data) - stream.tell():
        raise ValueError("an array of another size than its header says")
    array = np.frombuffer(data, kind, offset=stream.tell())
    return array.reshape(shape, order="F" if by_columns else "C")


def _stacked(array: Any) -> Variable:
    """An array Nx4x4, 4x4xN or 4x4 as 4x4xN; others by their shape alone."""
    if array.ndim == 2 and array.shape == (4, 4):
        array = array[None]
    if array.ndim == 3 and array.shape[1:] == (4, 4):
        array = np.moveaxis(array, 0, -1)
    if array.ndim != 3 or array.shape[:2] != (4, 4):
        return Variable("double", array.shape)
    return Variable(
        "double", array.shape, array.astype(complex if array.dtype.kind == "c" else float)
    )


def rows_of(value: Any, counts: Sequence[int]) -> FloatArray | None:
    """Return a stack of so many numbers each ``(N, count)``; None where it is none."""
    whole = matrix(value)
    if whole is not None:
        for count in counts:
            if whole.size % count == 0 and count in (whole.shape[1], 3 * whole.shape[1]):
                return whole.reshape(-1, count)
        return None
    if not isinstance(value, list) or not value:
        return None
    for count in counts:
        rows = [vector_of(item, count) for item in value]
        if all(row is not None for row in rows):
            return np.stack([row for row in rows if row is not None])
    return None


def vector_of(value: Any, count: int) -> FloatArray | None:
    """Return so many numbers of a list, nested or not, or of a matrix of OpenCV."""
    whole = matrix(value)
    if whole is not None:
        return whole.ravel() if whole.size == count else None
    if isinstance(value, dict):
        keys = {3: "xyz", 4: "xyzw"}.get(count, "")
        small = {key.casefold(): v for key, v in value.items()}
        return numbers([small.get(key) for key in keys], count) if keys else None
    if count == 9 and isinstance(value, list) and len(value) == 3:
        return _flat(numbers(value, 3, 3))
    if count == 3 and isinstance(value, list) and value and isinstance(value[0], list):
        return _flat(numbers(value, 3, 1))
    return numbers(value, count)


def _flat(array: FloatArray | None) -> FloatArray | None:
    return None if array is None else array.ravel()


def open_opencv(path: Path, tree: Any) -> StackFile:
    """Look into a file of OpenCV's, of which :func:`~posedesign.files.trees.read_tree` is known."""
    variables: dict[str, Variable] = {}
    for name, value in tree.items() if isinstance(tree, dict) else ():
        several = isinstance(value, list) and len(value) > 0
        found = [matrix(item) for item in (value if several else [value])]
        arrays = [array for array in found if array is not None]
        if len(arrays) < len(found):
            continue
        if several and all(array.shape == (4, 4) for array in arrays):
            variables[name] = _stacked(np.stack(arrays))
        elif not several and (arrays[0].shape[1] == 16 or arrays[0].shape[1:] == (4,)):
            rows = arrays[0].ravel()
            fits = len(rows) % 16 == 0
            variables[name] = _stacked(rows.reshape(-1, 4, 4) if fits else arrays[0])
        else:
            variables[name] = Variable("double", (len(found),) * several + arrays[0].shape)
    stacked = {
        name: rows_of(value, (9, 3))
        for name, value in (tree.items() if isinstance(tree, dict) else ())
    }
    variables = _joined(stacked) | variables
    if not variables:
        raise FileFormatError(
            "holds no samples of MoveIt or easy_handeye, and no matrix of OpenCV",
            path=path,
            hint="is it the right file?",
        )
    return StackFile(path, variables, ("[", "]"), 0, hint=_PYTHON_HINT)


def open_blocks(path: Path) -> StackFile | None:
    """Look into a text of 4x4 blocks; None where it is none, but a table, say."""
    if not path.is_file():  # a pipe can be read once only
        return None
    data = read_bytes_bounded(path, most_bytes=LARGEST_CSV_BYTES)
    lines = data.decode("utf-8-sig", "replace").splitlines()
    first = next((i for i, line in enumerate(lines) if line.strip()[:1] not in ("", "#")), None)
    if first is None:
        return None
    words = re.split(r"[;\s]+", lines[first].strip(" ;,\t"))
    words = words[0].split(",") if len(words) == 1 else [word.rstrip(",") for word in words]
    count = int(words[0]) if len(words) == 1 and re.fullmatch("[0-9]{1,8}", words[0]) else None
    if count is not None:
        lines[first] = ""
    elif len(words) != 4 or not all(map(is_number, words)):
        return None
    columns = ["1", "2", "3", "4"]
    table = parse_table(path, "\n".join(lines), columns, loose=True)
    T = numbers_of(path, table.rows, columns)
    if len(T) % 4 or count not in (None, len(T) // 4):
        said = f", and says that it has {count} transforms" if count is not None else ""
        raise FileFormatError(
            f"has {len(T)} lines of four numbers{said}",
            path=path,
            hint="four lines are a transform: is one missing?",
        )
    stack = _stacked(T.reshape(-1, 4, 4))
    starts = tuple(row.line for row in table.rows[::4])
    return StackFile(path, {"blocks": stack}, lines=starts, notes=table.notes)


OPENCV_NAMES = {
    "a": {"gripper2base": False, "base2gripper": True},
    "b": {"target2cam": False, "cam2target": True},
}
"""OpenCV's names of poses of the flange and of the target in the camera, and whether they are the
inverse of these."""


def pick_two(file: StackFile, variables: Sequence[str]) -> tuple[str, str]:
    """The variables that are A and B: those that were named, ``A`` and ``B``, or OpenCV's names."""
    if variables:
        return variables[0], variables[1]
    known = [next((n for n in names if n in file.stacks), "") for names in OPENCV_NAMES.values()]
    if all(known):
        return known[0], known[1]
    if "A" in file.variables and "B" in file.variables:
        return "A", "B"
    two = ",".join(file.stacks[:2]) if len(file.stacks) == 2 else "NAME_OF_A,NAME_OF_B"
    raise FileFormatError(
        f"does not say which of its variables are A and B ({_listed(file)})",
        path=file.path,
        hint=f"name A, then B, with `variables` {two}",
    )


def pick_one(file: StackFile, variable: str) -> str:
    """The variable of a file with one side: the one that was named, or the only 4x4xN one."""
    if variable:
        return variable
    known = file.stacks or tuple(file.variables)
    if len(known) == 1:
        return known[0]
    raise FileFormatError(
        f"does not say which of its variables to take ({_listed(file)})",
        path=file.path,
        hint="name that of A, then that of B, with `variables` NAME,NAME",
    )


def _listed(file: StackFile) -> str:
    if not file.variables:
        return "it is empty"
    known = list(file.variables.items())
    shown = [f"{name[:LONGEST_SHOWN]}: {variable.described}" for name, variable in known[:8]]
    return ", ".join(shown) + (f" and {len(known) - 8} more" if len(known) > 8 else "")


def _no_stack(file: StackFile, name: str, variable: Variable) -> FileFormatError:
    """What keeps a variable from being transforms, and what to do."""
    said = f"is {variable.described}, not 4x4xN double"
    hint = file.hint
    if variable.is_stacked and variable.kind in WHOLE_NUMBERS:
        said = f"is {variable.described}: whole numbers, which rotations are not made of"
        hint = "save what it was made from, in double; double() does not bring its decimals back"
    elif variable.is_stacked and variable.is_complex:
        said = f"is {variable.described}, and transforms are real"
        hint = "if its imaginary part is mere rounding, save real() of it"
    return FileFormatError(said, path=file.path, key=name, hint=hint, value=variable.described)


def _is_stack(variable: Variable) -> bool:
    return variable.may_be_transforms and not variable.is_complex
