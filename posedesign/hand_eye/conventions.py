"""Conventions in which poses are written: angles of all orders, vectors, quaternions, matrices.

Orientations are numbers in the order in which they stand:

==========================  ====================================================================
``zyx-moving``              three angles about the moving axes z, y, x: ``Rz Ry Rx``. So for each
                            of the twelve orders of axes
``zyx-fixed``               three angles about the fixed axes z, then y, then x: ``Rx Ry Rz``.
                            Likewise
``yzx-moving-of-rxryrz``    angles that stand in the order of their axes x, y, z, turned in another
                            one, ``Ry Rz Rx``; likewise ``xzy``, ``yxz`` and ``zxy``
``rotation-vector``         axis times angle: Rodrigues, OpenCV's ``rvec``
``quaternion-wxyz``         quaternion with the real part first; ``quaternion-xyzw``: with it last
``matrix``                  rotation matrix row by row; ``matrix-by-columns``
==========================  ====================================================================

Makers and tools have names of their own for them, with the units that they show (:data:`MAKERS`).

Sources: the manuals of the makers as far as ``posedesign.programs`` writes their languages; the
table "Euler angles" in the appendix of Mech-Mind's suite manual (2.0) for FANUC, Yaskawa, Denso,
Mitsubishi, KUKA, Epson, Kawasaki, Comau, Doosan and Stäubli; uFactory's manual of xArm; HALCON's
``create_pose``; ROS's REP 103; OpenCV's ``Rodrigues``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from types import MappingProxyType

import numpy as np

from calib import se3
from calib.errors import InputError, near_names
from calib.se3 import FloatArray

Reader = Callable[[FloatArray], FloatArray]
"""Rotations ``(N, 3, 3)`` from numbers ``(N, k)``, angles in rad."""

LENGTHS: Mapping[str, float] = MappingProxyType({"mm": 1e-3, "m": 1.0, "cm": 1e-2, "inch": 0.0254})
"""Units of length, in metres."""

RADIANS: Mapping[str, float] = MappingProxyType({"deg": np.pi / 180.0, "rad": 1.0})
"""Units of angles, in radians."""

INVERSE = "inverse"
"""Word for the pose of the base in the flange frame, or in general the inverse of the pose."""

AS_THEY_STAND = "as-they-stand"
"""Word for numbers whose names do not say the axes, though they look like it."""

UNKNOWN = "unknown"
"""Word for three or four numbers of which nobody says what they are."""

_OF_AXES = "-of-rxryrz"


def _about(axes: str, numbers: FloatArray) -> FloatArray:
    """Return ``R1 R2 R3 (N, 3, 3)`` of angles ``(N, 3)`` [rad] about the axes in that order."""
    unit = np.eye(3)
    turns = [
        se3.rotation_exp(numbers[:, k, None] * unit["xyz".index(a)]) for k, a in enumerate(axes)
    ]
    return np.asarray(turns[0] @ turns[1] @ turns[2])


def _moving(axes: str) -> Reader:
    return lambda numbers: _about(axes, numbers)


def _fixed(axes: str) -> Reader:
    return lambda numbers: _about(axes[::-1], numbers[:, ::-1])


def _moving_by_axis(axes: str) -> Reader:
    order = ["xyz".index(axis) for axis in axes]
    return lambda numbers: _about(axes, numbers[:, order])


_ORDERS = tuple(f"{a}{b}{c}" for a in "xyz" for b in "xyz" for c in "xyz" if a != b and b != c)
"""The twelve orders of axes."""

_EULER: Mapping[str, Reader] = {
    "xyz-fixed": se3.rotation_from_wpr,
    "xyz-moving": se3.rotation_from_moving_xyz,
    **{f"{axes}-moving": _moving(axes) for axes in _ORDERS if axes != "xyz"},
    **{f"{axes}-fixed": _fixed(axes) for axes in _ORDERS if axes != "xyz"},
    # xyz and zyx of angles in the order of the axes are xyz-moving and xyz-fixed
    **{
        f"{axes}-moving{_OF_AXES}": _moving_by_axis(axes)
        for axes in map("".join, permutations("xyz"))
        if axes not in ("xyz", "zyx")
    },
}

READERS: Mapping[str, Reader] = MappingProxyType(
    {
        **_EULER,
        "rotation-vector": se3.rotation_exp,
        "quaternion-wxyz": se3.rotation_from_quaternion,
        "quaternion-xyzw": lambda q: se3.rotation_from_quaternion(np.roll(q, 1, axis=-1)),
        "matrix": lambda numbers: numbers.reshape(-1, 3, 3),
        "matrix-by-columns": lambda numbers: np.swapaxes(numbers.reshape(-1, 3, 3), -1, -2),
    }
)
"""Readers of the orientations by their names."""


def count_of(turn: str) -> int:
    """Return how many numbers an orientation has."""
    return {"quaternion": 4, "matrix": 9}.get(turn.partition("-")[0], 3)


def same_count(count: int) -> tuple[str, ...]:
    """Return the names of the orientations that have so many numbers."""
    return tuple(name for name in READERS if count_of(name) == count)


def has_angles(turn: str) -> bool:
    """Return True if the numbers of an orientation are in deg or rad."""
    return turn == UNKNOWN or count_of(turn) == 3


@dataclass(frozen=True)
class Convention:
    """Convention of a pose; what is empty is not said."""

    turn: str  # one of :data:`READERS`, or UNKNOWN
    angle: str = ""  # {"deg", "rad", ""}
    length: str = ""  # one of :data:`LENGTHS`
    inverse: bool = False
    as_they_stand: bool = False  # whether names of columns are no names of axes

    @property
    def words(self) -> str:
        """The words that say it."""
        parts = [self.turn, self.angle, self.length, INVERSE if self.inverse else ""]
        parts.append(AS_THEY_STAND if self.as_they_stand else "")
        return ",".join(part for part in parts if part)


_WPR, _ABC, _OAT = (
    Convention(f"{turn}", "deg", "mm") for turn in ("xyz-fixed", "zyx-moving", "zyz-moving")
)

MAKERS: Mapping[str, Convention] = MappingProxyType(
    {
        "fanuc-wpr": _WPR,
        "yaskawa-rxryrz": _WPR,
        "denso-rxryrz": _WPR,
        "mitsubishi-abc": _WPR,
        "xarm-rpy": _WPR,
        "kuka-abc": _ABC,
        "epson-uvw": _ABC,
        "staubli-rxryrz": Convention("xyz-moving", "deg", "mm"),
        "kawasaki-oat": _OAT,
        "doosan-abc": _OAT,
        "comau-euler": _OAT,
        "abb-quaternion": Convention("quaternion-wxyz", "", "mm"),
        "ur-rotation-vector": Convention("rotation-vector", "rad", "m"),
        "opencv-rvec": Convention("rotation-vector", "rad"),
        "ros-quaternion": Convention("quaternion-xyzw", "", "m"),
        "ros-rpy": Convention("xyz-fixed", "rad", "m"),
        "halcon-gba": Convention("xyz-moving", "deg", "m"),
        "halcon-abg": Convention("xyz-fixed", "deg", "m"),
    }
)
"""Words of makers and tools, with the units that their pendants and files have."""


def convention_of(words: str) -> Convention:
    """Return the convention that words with commas between them say.

    One word is of a maker or names an orientation. ``deg``, ``rad``, the units of length,
    ``inverse`` and ``as-they-stand`` may follow, and count more than what the maker shows.

    Raises InputError: a word that is not known, or no orientation.
    """
    found: Convention | None = None
    more: list[str] = []
    for word in (part.strip().casefold() for part in words.split(",")):
        if word in MAKERS or word in READERS:
            if found is not None:
                raise InputError(
                    f"`poses_are` {words!r} says the orientation twice",
                    hint="say it once",
                    name="poses_are",
                    value=words,
                )
            found = MAKERS.get(word) or Convention(word)
        elif word in (*RADIANS, *LENGTHS, INVERSE, AS_THEY_STAND):
            more.append(word)
        else:
            known = (*MAKERS, *READERS, *RADIANS, *LENGTHS, INVERSE, AS_THEY_STAND)
            raise InputError(
                f"`poses_are` {word!r} is not known",
                hint=_meant(word, known),
                name="poses_are",
                value=words,
            )
    if found is None:
        found = Convention(UNKNOWN)
    for word in more:
        if word == INVERSE:
            found = replace(found, inverse=True)
        elif word == AS_THEY_STAND:
            found = replace(found, as_they_stand=True)
        elif word in RADIANS:
            found = replace(found, angle=word)
        else:
            found = replace(found, length=word)
    return found


_ALSO_CALLED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "axis-angle": ("rotation-vector",),
        "angle-axis": ("rotation-vector",),
        "rodrigues": ("rotation-vector", "opencv-rvec"),
        "rvec": ("rotation-vector", "opencv-rvec"),
        "rotvec": ("rotation-vector", "ur-rotation-vector"),
        "euler": ("zyx-moving", "xyz-moving", "zyz-moving", "xyz-fixed"),
        "rpy": ("xyz-fixed", "ros-rpy", "xarm-rpy"),
        "roll-pitch-yaw": ("xyz-fixed", "ros-rpy", "xarm-rpy"),
        "wpr": ("fanuc-wpr", "xyz-fixed"),
        "quaternion": ("quaternion-wxyz", "quaternion-xyzw"),
        "universal-robots": ("ur-rotation-vector",),
        "inverted": (INVERSE,),
        **dict.fromkeys(("millimeter", "millimeters", "millimetre", "millimetres"), ("mm",)),
        **dict.fromkeys(("meter", "meters", "metre", "metres"), ("m",)),
        **dict.fromkeys(("inches", "in"), ("inch",)),
        **dict.fromkeys(("degree", "degrees"), ("deg",)),
        **dict.fromkeys(("radian", "radians"), ("rad",)),
    }
)
"""Words that people have for conventions, and the words here that are meant."""


def _meant(word: str, known: Sequence[str]) -> str:
    """Hint for a word that is not known: what people call so, or the words that have it in them."""
    plain = re.sub(r"[\s_]+", "-", word)
    held = [name for name in known if len(plain) > 1 and plain in name.split("-")]
    meant = _ALSO_CALLED.get(plain) or ((plain,) if plain in known else ()) or held[:5]
    if meant:
        return f"did you mean {' or '.join(meant)}?"
    return near_names(word, known)


def named(turn: str) -> str:
    """Return an orientation with the makers that have it: ``zyx-moving (kuka-abc, epson-uvw)``."""
    makers = [word for word, convention in MAKERS.items() if convention.turn == turn]
    return f"{turn} ({', '.join(makers)})" if makers else turn


def labels_fit(turn: str, labels: Iterable[str]) -> bool:
    """Return True if numbers named by their axes stand in the order of an orientation.

    ``labels``: ``rx ry rz`` in the order of the file; True where they name no axes.
    """
    axes = _axes(labels)
    order = "xyz" if turn.endswith(_OF_AXES) else turn.partition("-")[0]
    return turn not in _EULER or len({*order}) < 3 or order == axes or {*axes} != {*"xyz"}


def check_labels(turn: str, labels: Sequence[str]) -> None:
    """Check that numbers that are named by their axes stand in the order of an orientation.

    Raises InputError: the first number is named after another axis than the first of the angles.
    """
    if labels_fit(turn, labels):
        return
    axes, first = _axes(labels), "x" if turn.endswith(_OF_AXES) else turn[0]
    raise InputError(
        f"`poses_are` {turn} has the first number about {first}, and it is called r{axes[0]}",
        hint=f"say {_same_by_labels(turn, axes)} if the names are right, else {turn},"
        f"{AS_THEY_STAND}",
        name="poses_are",
        value=turn,
    )


def _axes(labels: Iterable[str]) -> str:
    """Return the axes that labels name: ``xyz`` of ``rx_deg ry_deg rz_deg``."""
    found = [
        re.fullmatch(r"(?:[ab]_)?r([xyz])(?:_deg|_rad)?", label.casefold()) for label in labels
    ]
    return "".join(match[1] if match else "?" for match in found)


def _same_by_labels(turn: str, axes: str) -> str:
    """Return the orientation that turns alike, each number about the axis that it is named by."""
    order, _, kind = turn.partition("-")
    product = order if kind == "moving" else order[::-1]
    if product == axes:
        return f"{axes}-moving"
    if product == axes[::-1]:
        return f"{axes}-fixed"
    return f"{product}-moving{_OF_AXES}"
