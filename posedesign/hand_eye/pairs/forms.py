"""Forms in which the pose of one side stands in a table: the one definition of their columns.

A pose is a position and an orientation, in any combination of these columns, in any order:

=========================================  ======================================================
``x_mm y_mm z_mm`` or ``x_m y_m z_m``      translation
``w_deg p_deg r_deg``, or ``_rad``         FANUC's W, P, R: turns about fixed x, then y, then z
``qw qx qy qz``                            quaternion; w is the real part
``rx_deg ry_deg rz_deg``, or ``_rad``      rotation vector: axis times angle, as Universal Robots
                                           shows it and OpenCV's ``rvec`` has it
``r11 r12 .. r33``                         rotation matrix, row and column; the last row of the
                                           transform, 0 0 0 1, may follow as ``r41 .. r44``
=========================================  ======================================================

In a file of pairs each name has ``a_`` or ``b_`` before it: ``a_x_mm``, ``b_qw``.

A file holds rotations as exactly as it has decimals. Up to what four decimals leave they are
taken, as the nearest rotation and with a note; what is farther off is no rotation, and is refused
with the place where it stands.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from calib import se3
from calib.errors import FileFormatError, InputError, near_names
from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.files.csv_tables import Row, check_columns, numbers_of
from posedesign.hand_eye.conventions import (
    LENGTHS,
    RADIANS,
    READERS,
    UNKNOWN,
    Convention,
    check_labels,
    count_of,
    has_angles,
    same_count,
)

LARGEST_DEVIATION = 5e-4
"""Largest |RᵀR - I| of a rotation in a file: rounding to four decimals passes (1.7e-4), to three
(1.7e-3, a tenth of a degree) does not, as it would be the largest error of the whole calibration
without anybody seeing it."""

LARGEST_NORM_DEVIATION = 2.1e-3
"""Largest | |q|² - 1 | of a quaternion in a file: rounding to three decimals, as ``tf_echo``
prints them, passes (2e-3). Unlike with a matrix, nothing but rounding comes so close to 1."""


@dataclass(frozen=True)
class Place:
    """Where the poses of one side stand, for messages."""

    path: Path
    lines: tuple[int, ...] = ()  # lines of a table
    variable: str = ""  # name of a variable, in a file that is no table
    marks: tuple[str, str] = ("(:,:,", ")")
    """What stands around the number of a pose, behind the name."""
    first: int = 1  # number of the first pose
    names: tuple[str, ...] = ()  # what each pose is called in the file, or its file in a folder

    def name(self, i: int) -> str:
        """``line 7``, or ``T_cam(:,:,6)`` as MATLAB counts, ``T_cam[5]`` as Python does."""
        if self.names:
            return self.names[i]
        if not self.variable:
            return f"line {self.lines[i]}"
        return f"{self.variable}{self.marks[0]}{i + self.first}{self.marks[1]}"

    def error(
        self, i: int, message: str, *, column: str | None = None, **details: Any
    ) -> FileFormatError:
        """The error of one pose, with hint, value and bound as any."""
        if self.variable or self.names:
            return FileFormatError(message, path=self.path, key=self.name(i), **details)
        row = self.lines[i]
        return FileFormatError(message, path=self.path, row=row, column=column, **details)


def transforms_from_matrices(
    T: FloatArray, place: Place, column: str | None = None
) -> tuple[FloatArray, str]:
    """Rigid transforms ``(N, 4, 4)`` from matrices of a file, and a note where they are rounded."""
    bad = np.asarray(~np.isfinite(T).all(axis=(-2, -1)))
    if bad.any():
        raise place.error(
            int(bad.argmax()),
            "has a number that is not finite" + and_others(bad),
            hint="leave this pose out on both sides",
            column=column,
        )
    _check_last_rows(T, place, column)
    R, note = _rotations_from_matrices(T[:, :3, :3], place, column)
    return se3.transform(R, T[:, :3, 3]), note


def rotations_from_quaternions(
    q: FloatArray, place: Place, column: str | None
) -> tuple[FloatArray, str]:
    """Rotations ``(N, 3, 3)`` from quaternions (w, x, y, z), and a note where they are rounded."""
    with np.errstate(over="ignore"):
        square = (q**2).sum(axis=-1)
    off = np.abs(square - 1.0)
    bad = ~(off <= LARGEST_NORM_DEVIATION)  # also where the square is too large for a float
    if bad.any():
        i = int(bad.argmax())
        raise place.error(
            i,
            f"the quaternion has the norm {math.sqrt(square[i]):.6g}, not 1" + and_others(bad),
            hint="are these four columns one quaternion, and all of it?",
            column=column,
            value=float(math.sqrt(square[i])),
            bound=1.0,
        )
    return se3.rotation_from_quaternion(q), _rounding_note(off, place)


def _rotations_from_matrices(
    M: FloatArray, place: Place, column: str | None
) -> tuple[FloatArray, str]:
    with np.errstate(over="ignore", invalid="ignore"):
        gram = np.swapaxes(M, -1, -2) @ M
        off = np.abs(gram - np.eye(3)).max(axis=(-2, -1))
    bad = ~(off <= LARGEST_DEVIATION)
    if bad.any():
        i = int(bad.argmax())
        hint, wrong = _scale_hint(gram[i]), f"the rotation is not orthonormal (off by {off[i]:.2g})"
        if hint:
            wrong = f"the rotation is scaled by {math.sqrt(np.trace(gram[i]) / 3.0):.4g}"
        raise place.error(
            i,
            wrong + and_others(bad),
            hint=hint or "write rotations with six decimals or more",
            column=column,
            value=float(off[i]),
            bound=LARGEST_DEVIATION,
        )
    left = np.linalg.det(M) < 0.0
    if left.any():
        raise place.error(
            int(left.argmax()),
            "the rotation is left-handed (determinant -1)" + and_others(left),
            hint="an axis is mirrored where the matrix was made",
            column=column,
        )
    return se3.project_to_rotation(M), _rounding_note(off, place)


def _check_last_rows(T: FloatArray, place: Place, column: str | None) -> None:
    off = np.abs(T[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=-1)
    bad = off > se3.RIGID_TOLERANCE
    if not bad.any():
        return
    i = int(bad.argmax())
    shown = " ".join(f"{number:.4g}" for number in T[i, 3])
    transposed = not T[i, :3, 3].any() and T[i, 3, 3] == 1.0
    raise place.error(
        i,
        f"the last row of the matrix is {shown}, not 0 0 0 1" + and_others(bad),
        hint="it is transposed: give it row by row"
        if transposed
        else "is this a 4x4 matrix [R t; 0 0 0 1]?",
        column=column,
    )


def _scale_hint(gram: FloatArray) -> str:
    square = float((np.diag(gram) / 3.0).sum())  # the sum itself may be too large for a float
    if not (np.isfinite(square) and square > 0.0):
        return ""
    pure = np.abs(gram / square - np.eye(3)).max() <= LARGEST_DEVIATION
    return "divide it by this factor, and look where it comes from" if pure else ""


def and_others(bad: BoolArray) -> str:
    """What to add to the error of one of several bad poses ``(N,)``."""
    count = int(bad.sum()) - 1
    return f", and so on in {count} more" if count else ""


def _rounding_note(off: FloatArray, place: Place) -> str:
    worst = int(off.argmax())
    if off[worst] <= se3.RIGID_TOLERANCE:
        return ""
    return (
        f"rotations are rounded, off by up to {off[worst]:.1g} ({place.name(worst)}): the nearest "
        f"ones are taken, good to about {math.degrees(off[worst]):.1g} deg"
    )


FEWEST_TO_JUDGE = 3
"""Rows from which the unit of a column can be doubted."""

FARTHEST_M = 100.0
"""Distance [m] that no flange has from its base, and no camera from its target."""

NEAREST_M = 0.01
"""Distance [m] that every camera has from its target, and every flange from its base."""

ENDLESS_M = 1e6
"""Distance [m] of nothing that has to do with a robot, whatever the unit: such a number is a mark
for a missing one, or damage, and would drown all others."""

ENDLESS_ANGLE = 1e6
"""The same of angles, in degrees or radians: of the decimals of such a number none is left that
says where it points."""


def refuse_endless(
    place: Place, numbers: FloatArray, unit: str = "m", column: str | None = None
) -> None:
    """Refuse lengths [m] and angles [deg or rad] ``(N, 3)`` that nothing has, whatever the unit."""
    bound, said = (
        (ENDLESS_M, "a translation of {:.3g} m is beyond any robot")
        if unit == "m"
        else (ENDLESS_ANGLE, f"an angle of {{:.3g}} {unit} is none")
    )
    largest = np.abs(numbers).max(axis=-1)  # no norm, which would overflow
    bad = largest > bound
    if bad.any():
        i = int(bad.argmax())
        raise place.error(
            i,
            said.format(largest[i]) + and_others(bad),
            hint="leave this pose out on both sides",
            column=column,
            value=float(largest[i]),
            bound=bound,
        )


def check_angles(path: Path, columns: tuple[str, ...], angles: FloatArray, unit: str) -> None:
    """Refuse angles ``(N, 3)`` in deg that look like rad, and the other way round."""
    largest = float(np.abs(angles).max())
    if unit == "deg":
        doubtful = len(angles) >= FEWEST_TO_JUDGE and 0.0 < largest <= 2.0 * math.pi
        other = "rad"
    else:
        doubtful, other = largest > 2.0 * math.pi * 1.001, "deg"
    if doubtful:
        renamed = [column.replace(f"_{unit}", f"_{other}") for column in columns]
        if renamed != list(columns):
            change = f"call the columns {', '.join(renamed)}"
        else:  # the unit stands in no name: `poses_are` says it
            change = f"add {other} to `poses_are`"
        long = {"deg": "degrees", "rad": "radians"}
        raise FileFormatError(
            f"the angles look like {long[other]} (the largest is {largest:.4g})",
            path=path,
            column=f"{columns[0]} to {columns[-1]}",
            hint=f"{change}, or pass `trust_units` if they are {long[unit]}",
            value=largest,
            bound=2.0 * math.pi,
        )


def check_lengths(
    place: Place, p: FloatArray, unit: str, remedy: str, column: str | None = None
) -> None:
    """Refuse translations ``(N, 3)`` [m] read in mm that look like m, and the other way round.
    The remedy says how to give the other unit.
    """
    longest = float(np.linalg.norm(p, axis=-1).max())
    short = unit == "mm" and 0.0 < longest < NEAREST_M and len(p) >= FEWEST_TO_JUDGE
    if short or longest > FARTHEST_M:
        other = "m" if unit == "mm" else "mm"
        known = short or unit == "m"
        raise FileFormatError(
            f"no translation is longer than {1e3 * longest:.3g} mm"
            if short
            else f"a translation is {longest:.4g} m long",
            path=place.path,
            column=column,
            key=place.variable or None,
            hint=(f"if these are {other}, {remedy}; " if known else "")
            + "pass `trust_units` if it is so",
            value=longest,
            bound=NEAREST_M if short else FARTHEST_M,
        )


METRES = MappingProxyType({unit: LENGTHS[unit] for unit in ("mm", "m")})
"""Units of length that names of columns have, in metres."""

_PLACES = {unit: tuple(f"{axis}_{unit}" for axis in "xyz") for unit in METRES}
_LAST_ROW = tuple(f"r4{column}" for column in range(1, 5))
_TURNS: Mapping[str, tuple[str, ...]] = {
    "wpr-deg": ("w_deg", "p_deg", "r_deg"),
    "wpr-rad": ("w_rad", "p_rad", "r_rad"),
    "quaternion": ("qw", "qx", "qy", "qz"),
    "vector-deg": ("rx_deg", "ry_deg", "rz_deg"),
    "vector-rad": ("rx_rad", "ry_rad", "rz_rad"),
    "matrix": tuple(f"r{row}{column}" for row in range(1, 4) for column in range(1, 4)),
}
TURNS = tuple(_TURNS)
"""Names of the forms of an orientation."""

POSE_COLUMNS = frozenset(
    name for names in (*_PLACES.values(), *_TURNS.values(), _LAST_ROW) for name in names
)
"""All names of columns, without ``a_`` and ``b_``."""

_DEGREE = RADIANS["deg"]
READ_AS: Mapping[str, str] = {
    "wpr": "xyz-fixed",
    "vector": "rotation-vector",
    "quaternion": "quaternion-wxyz",
    "matrix": "matrix",
}
"""Conventions of the forms, by the first words of their names."""

_TO_ANGLES: Mapping[str, Callable[[FloatArray], FloatArray]] = {
    "wpr": se3.wpr_from_rotation,
    "vector": se3.rotation_log,
}


@dataclass(frozen=True)
class PoseForm:
    """Form of the pose of one side.

    ``unit`` {"mm", "m"}. ``turn``: one of :data:`TURNS`.
    """

    unit: str = "mm"
    turn: str = "wpr-deg"

    def __post_init__(self) -> None:
        for name, value, known in (("unit", self.unit, METRES), ("turn", self.turn, TURNS)):
            if value not in known:
                raise InputError(
                    f"there is no {name} {value!r} of a pose",
                    hint=near_names(value, known),
                    name=name,
                    value=value,
                )

    @property
    def place_columns(self) -> tuple[str, ...]:
        return _PLACES[self.unit]

    @property
    def turn_columns(self) -> tuple[str, ...]:
        return _TURNS[self.turn]

    def numbers(self, T: FloatArray) -> FloatArray:
        """Numbers of transforms ``(N, 4, 4)``: translation, then orientation, ``(N, 6)`` up."""
        kind, _, unit = self.turn.partition("-")
        R = T[:, :3, :3]
        if kind == "matrix":
            turn = R.reshape(-1, 9)
        elif kind == "quaternion":
            turn = se3.quaternion_from_rotation(R)
        else:
            turn = _TO_ANGLES[kind](R) / (_DEGREE if unit == "deg" else 1.0)
        return np.concatenate([T[:, :3, 3] / METRES[self.unit], turn], axis=-1)


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of one side as they were read."""

    T: FloatArray  # (N, 4, 4) [m]
    place: Place  # where they stand
    names: tuple[str, ...]  # from the column ``pose``; empty where there is none
    notes: tuple[str, ...]  # what is odd about them
    turn: str
    """Reading of the orientation, one of :data:`~posedesign.hand_eye.conventions.READERS`; empty
    where who writes such a file has fixed it."""
    numbers: FloatArray  # (N, 3) or (N, 4) or (N, 9): the orientation as it stands; angles in rad
    is_inverse: bool = False  # whether the file was said to have the inverses
    is_said: bool = True  # whether the convention of the orientation was said, or is a guess
    labels: tuple[str, ...] = ()  # columns of the orientation, in order

    def some(self, rows: IntArray) -> Poses:
        """Some of them."""
        place = self.place
        if place.names:
            place = replace(place, names=tuple(place.names[i] for i in rows))
        elif place.lines:
            place = replace(place, lines=tuple(place.lines[i] for i in rows))
        names = tuple(self.names[i] for i in rows) if self.names else ()
        T, numbers = self.T[rows], self.numbers[rows]
        return replace(self, T=T, numbers=numbers, place=place, names=names)

    def inverted(self) -> Poses:
        """The inverses, of a file that has them the other way round."""
        return replace(self, T=se3.inverse(self.T), is_inverse=not self.is_inverse)

    def turned(self, turn: str) -> FloatArray:
        """The transforms ``(N, 4, 4)`` [m] if the orientation is read in another way."""
        stands = se3.inverse(self.T) if self.is_inverse else self.T
        T = se3.transform(READERS[turn](self.numbers), stands[:, :3, 3])
        return se3.inverse(T) if self.is_inverse else T


def find_form(path: Path, columns: Sequence[str], prefix: str) -> PoseForm:
    """The form that the columns with a prefix have."""
    unit = _find(path, columns, prefix, _PLACES, "position")
    turn = _find(path, columns, prefix, _TURNS, "orientation")
    return PoseForm(unit, turn)


def rotations_of(
    numbers: FloatArray, turn: str, place: Place, column: str | None
) -> tuple[FloatArray, str]:
    """Rotations ``(N, 3, 3)`` from numbers, angles in rad, and a note where they are rounded.

    ``turn``: one of :data:`~posedesign.hand_eye.conventions.READERS`.
    """
    kind = turn.partition("-")[0]
    if kind == "quaternion":
        _, note = rotations_from_quaternions(numbers, place, column)
        return READERS[turn](numbers), note
    if kind != "matrix":
        return READERS[turn](numbers), ""
    T = se3.transform(READERS[turn](numbers), np.zeros(3))
    T, note = transforms_from_matrices(T, place, column)
    return T[:, :3, :3], note


@dataclass(frozen=True, eq=False)
class WrittenPoses:
    """Poses of one side as they stand in a file, N of them."""

    place: Place
    places: FloatArray  # (N, 3)
    numbers: FloatArray  # (N, k): the orientation
    convention: Convention  # what the file says of it
    names: tuple[str, ...] = ()  # of the poses, or of their pictures
    labels: tuple[str, ...] = ()  # columns of the orientation
    notes: tuple[str, ...] = ()

    @property
    def is_bare(self) -> bool:
        """Return True if each is six numbers without a word: they may be joint values."""
        return self.numbers.shape[1] == 3 and self.convention.turn == UNKNOWN and not self.labels

    def read(self, said: Convention | None = None, *, trust_units: bool = False) -> Poses:
        """Read them by the convention of the file, or by one that a person says.

        Units that nobody says are told by the size of the numbers, with a note.

        Raises FileFormatError: numbers that make no pose, or of another unit. InputError: the
        convention has another count of numbers.
        """
        given = said or self.convention
        turn = self._turn(given.turn)
        if not given.as_they_stand:
            check_labels(turn, self.labels)
        length = self.convention.length or given.length
        angle = self.convention.angle or given.angle
        notes = list(self.notes)
        if not length:
            length = self._length_by_size()
            notes.append(f"{self.place.path} says no unit of length: {length}, by their size")
        p = self.places * LENGTHS[length]
        refuse_endless(self.place, p)
        if not trust_units:
            check_lengths(self.place, p, length, "say so with `poses_are`")
        numbers = self.numbers
        if has_angles(turn) and numbers.shape[1] == 3:
            if not angle:
                largest = float(np.abs(numbers).max())
                angle = "rad" if largest <= 2.0 * math.pi * 1.001 else "deg"
                notes.append(f"{self.place.path} says no unit of angles: {angle}, by their size")
            refuse_endless(self.place, numbers, angle)
            if not trust_units and self.labels:
                check_angles(self.place.path, self.labels, numbers, angle)
            numbers = numbers * RADIANS[angle]
        taken = turn if turn != UNKNOWN else _GUESSES[numbers.shape[1]]
        R, note = rotations_of(numbers, taken, self.place, None)
        if note:
            notes.append(f"{self.place.path}: {note}")
        T = se3.transform(R, p)
        if given.inverse:
            T = se3.inverse(T)
        return Poses(
            T,
            self.place,
            self.names,
            tuple(notes),
            taken,
            numbers,
            given.inverse,
            turn != UNKNOWN,
            self.labels,
        )

    def _turn(self, said: str) -> str:
        """The orientation that is said; UNKNOWN where nobody says it."""
        turn = said if said != UNKNOWN else self.convention.turn
        count = self.numbers.shape[1]
        if turn == UNKNOWN:
            return turn
        if count_of(turn) != count:
            raise InputError(
                f"{self.place.path} has {count} numbers of the orientation, {turn} has "
                f"{count_of(turn)}",
                hint=f"with {count} numbers are {', '.join(same_count(count)[:5])} ..",
                name="poses_are",
            )
        return turn

    def _length_by_size(self) -> str:
        """Metres or millimetres, by the longest translation; FileFormatError between them."""
        longest = float(np.linalg.norm(self.places, axis=-1).max())
        if longest < 1e3 * NEAREST_M:
            return "m"
        if longest > FARTHEST_M:
            return "mm"
        raise FileFormatError(
            f"says no unit of length, and its longest translation, {longest:.4g}, may be mm or m",
            path=self.place.path,
            hint="say it with `poses_are`, say rotation-vector,mm",
            value=longest,
        )


_GUESSES = {3: "xyz-fixed", 4: "quaternion-wxyz", 9: "matrix"}
"""Reading of numbers that holds until the pairs tell what they are."""


def read_poses_of(
    path: Path,
    columns: Sequence[str],
    rows: Sequence[Row],
    prefix: str,
    *,
    trust_units: bool,
    said: Convention | None = None,
) -> Poses:
    """Poses from the columns of a table whose names begin with a prefix.

    ``said``: the convention, where the names of the columns do not say it, or say another one.
    """
    raw = pose_columns(columns, said, prefix)
    if raw is not None:
        ordered = said is not None and said.turn != UNKNOWN
        written = _written_columns(path, rows, *raw, ordered=ordered)
        return written.read(said, trust_units=trust_units)
    form = find_form(path, columns, prefix)
    place = Place(path, tuple(row.line for row in rows))
    places, turns = (
        tuple(prefix + name for name in names) for names in (form.place_columns, form.turn_columns)
    )
    what, turn = f"{places[0]} to {places[-1]}", f"{turns[0]} to {turns[-1]}"
    p = numbers_of(path, rows, places) * METRES[form.unit]
    refuse_endless(place, p, "m", what)
    numbers = numbers_of(path, rows, turns)
    kind, _, unit = form.turn.partition("-")
    if unit:
        refuse_endless(place, numbers, unit, turn)
        if not trust_units:
            check_angles(path, turns, numbers, unit)
        numbers = numbers * _DEGREE if unit == "deg" else numbers
    last = [prefix + name for name in _LAST_ROW] if kind == "matrix" else []
    if any(name in columns for name in last):
        _check_there(path, columns, last)
        T = se3.transform(numbers.reshape(-1, 3, 3), np.zeros(3))
        T[:, 3] = numbers_of(path, rows, last)
        transforms_from_matrices(T, place, turn)
    R, note = rotations_of(numbers, READ_AS[kind], place, turn)
    if not trust_units:
        named = ", ".join(prefix + name for name in _PLACES["m" if form.unit == "mm" else "mm"])
        check_lengths(place, p, form.unit, f"call the columns {named}", what)
    names = tuple(row.cells["pose"] for row in rows) if "pose" in columns else ()
    notes = (f"{path}, {turns[0]} ..: {note}",) if note else ()
    T = se3.transform(R, p)
    return Poses(T, place, names, notes, READ_AS[kind], numbers, labels=turns)


_RAW_PLACES = tuple(
    tuple(f"{before}{axis}{after}" for axis in "xyz")
    for before in ("", "t", "p", "pos_", "t_", "p_")
    for after in ("", "_mm", "_m", "_cm", "_inch")
)
_RAW_TURNS = (
    ("qx", "qy", "qz", "qw"),
    ("quat_x", "quat_y", "quat_z", "quat_w"),
    ("rx", "ry", "rz", "rw"),
    ("q0", "q1", "q2", "q3"),
    ("q1", "q2", "q3", "q4"),
    ("a", "b", "c", "d"),
    ("n1", "n2", "n3", "n4"),
    *(
        tuple(f"{name}{unit}" for name in names)
        for names in (
            ("rx", "ry", "rz"),
            ("a", "b", "c"),
            ("o", "a", "t"),
            ("w", "p", "r"),
            ("u", "v", "w"),
            ("roll", "pitch", "yaw"),
            ("ex", "ey", "ez"),
            ("n1", "n2", "n3"),
        )
        for unit in ("", "_deg", "_rad")
    ),
    tuple(f"r{row}{column}" for row in range(1, 4) for column in range(1, 4)),
)
"""Names that columns have in lists of people: without a unit, or in a convention that is said."""


def pose_columns(
    columns: Sequence[str], said: Convention | None = None, prefix: str = ""
) -> tuple[list[str], list[str]] | None:
    """Columns of position and orientation of a list whose form is said, or that says none.

    None where the names of the columns say the form, and nothing else does.
    """
    small = {column.casefold(): column for column in columns}

    def there(sets: Sequence[tuple[str, ...]]) -> list[str]:
        found = [names for names in sets if all(prefix + name in small for name in names)]
        if not found:
            return []
        own = {prefix + name for name in found[0]}
        return [column for key, column in small.items() if key in own]  # in the order of the file

    places, turns = there(_RAW_PLACES), there(_RAW_TURNS)
    if said is not None and said.turn != UNKNOWN and len(places) == 3:
        count = count_of(said.turn)
        if len(turns) != count:
            rest = [c for c in columns if c not in places and c.casefold() not in _NO_NUMBERS]
            turns = rest[:count] if len(rest) >= count else turns
    if not places or not turns:
        return None
    is_raw = places[0][-2:] in ("_m", "mm")
    known = is_raw and any(
        all(prefix + name in columns for name in names) for names in _TURNS.values()
    )
    return None if known and said is None else (places, turns)


_NO_NUMBERS = ("pose", "picture", "time_s", "image", "name", "index", "id")


def _written_columns(
    path: Path,
    rows: Sequence[Row],
    places: Sequence[str],
    turns: Sequence[str],
    *,
    ordered: bool,
) -> WrittenPoses:
    """Poses of a list as they stand; ``ordered``: quaternions in the order of the columns."""
    units = [names[0].rpartition("_")[2].casefold() for names in (places, turns)]
    length = units[0] if "_" in places[0] and units[0] in LENGTHS else ""
    angle = units[1] if units[1] in RADIANS else ""
    names = ("pose", "picture")
    called = next((n for n in names if n in rows[0].cells), "")
    turn = UNKNOWN
    if len(turns) == 4 and {name[-1].casefold() for name in turns} == {*"wxyz"} and not ordered:
        turns = sorted(turns, key=lambda name: "wxyz".index(name[-1].casefold()))
        turn = "quaternion-wxyz"
    return WrittenPoses(
        Place(path, tuple(row.line for row in rows)),
        numbers_of(path, rows, places),
        numbers_of(path, rows, turns),
        Convention(turn if len(turns) != 9 else "matrix", angle, length),
        tuple(row.cells[called] for row in rows) if called == "pose" else (),
        tuple(turns),
    )


def _find(
    path: Path, columns: Sequence[str], prefix: str, forms: Mapping[str, tuple[str, ...]], what: str
) -> str:
    """The one form that is there as a whole."""
    there = {
        name: sum(prefix + column in columns for column in needed) for name, needed in forms.items()
    }
    whole = [name for name, needed in forms.items() if there[name] == len(needed)]
    if len(whole) > 1:
        first, second = (prefix + forms[name][0] for name in whole[:2])
        raise FileFormatError(
            f"gives the {what} a second time, after {first}",
            path=path,
            row=1,
            column=second,
            hint=f"leave one {what} out",
        )
    if whole:
        return whole[0]
    most = max(there, key=lambda name: there[name])
    if there[most]:
        _check_there(path, columns, [prefix + column for column in forms[most]])
    choices = " or ".join(f"{prefix}{needed[0]} .." for needed in forms.values())
    without = [c for c in columns if c.lower().removeprefix(prefix) in tuple("xyzwpr")]
    hint = f"call the columns {choices}"
    if what != "position" and {*"wxyz"} <= {c.lower().removeprefix(prefix) for c in without}:
        four = " ".join(f"{prefix}q{axis}" for axis in "wxyz")
        hint = f"if w x y z are a quaternion, call the columns {four}"
    elif without:
        hint = f"say the unit: {without[0]}_{'mm' if what == 'position' else 'deg'}, say"
    raise FileFormatError(
        f"there is no {what}: no column {prefix}{next(iter(forms.values()))[0]}",
        path=path,
        row=1,
        hint=hint,
    )


def _check_there(path: Path, columns: Sequence[str], needed: Sequence[str]) -> None:
    """Check that columns are there, those with a unit in their names in that unit."""
    if needed[0].endswith(("_mm", "_m", "_deg", "_rad")):
        check_columns(path, columns, needed)
        return
    for column in needed:
        if column not in columns:
            raise FileFormatError(
                f"there is no column {column}", path=path, row=1, hint=near_names(column, columns)
            )
