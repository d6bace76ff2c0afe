"""The robot as identified: a kinematic chain that holds what a chain can hold.

Zero offsets and link geometry move the frames of joints, in every posture alike: a chain with
these frames is the robot as it was found. What changes from posture to posture is no part of any
chain (compliance, harmonics, scale, lost motion): it is named, so that nobody takes the chain for
all that was identified. :mod:`calib.correction.compensation` corrects postures for everything.

Writing the identified robot as a URDF.

A robot that came from a file keeps that file: only the ``origin`` of joints that moved is written
anew, everything else stays as it stands, byte for byte. A robot that came from elsewhere is
written from what is known of it (:mod:`calib.robots.urdf_anew`).

Nothing is written to disk here: the content is returned, for whoever asks to put away whole.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, RobotModelError
from calib.model import CalibrationModel, Setup
from calib.model.context import ArmErrors
from calib.model.parameters import ParameterBlock
from calib.robots import Robot
from calib.robots.description.urdf import Description, read_description
from calib.robots.description.urdf_kinematics import numbers, shown, spread
from calib.robots.robot import with_placements
from calib.robots.urdf_anew import rpy_of, urdf_of, words_for_comment
from calib.se3 import FloatArray, inverse, rotation_exp, rotation_from_wpr, transform


@dataclass(frozen=True, eq=False)
class CorrectedRobot:
    """A robot with its identified kinematics."""

    robot: Robot  # same joints, limits, masses, tip and controller; other joint frames
    nominal: Robot  # as described
    left_out: tuple[str, ...]
    """What was identified and no chain can hold, in words: kind of error and parameters."""

    @property
    def corrections(self) -> FloatArray:
        """How each joint's frame sits off its place as described, ``(n, 4, 4)`` [m].

        In its own axes at zero: ``T_described_corrected``. Those of a positioner on the link that
        they hang on, as descriptions have them.
        """
        found = inverse(self.nominal.joint_origins) @ self.robot.joint_origins
        along = self.nominal.outlying_m
        if along.any():  # from the frame at the arm to the one that is described
            slid = transform(np.eye(3), along[:, None] * self.nominal.chain.axes)
            found = slid @ found @ inverse(slid)
        return np.asarray(found)

    @property
    def moved(self) -> tuple[str, ...]:
        """Joints whose frames are not where the description has them."""
        same = (self.robot.joint_origins == self.nominal.joint_origins).all(axis=(1, 2))
        pairs = zip(self.nominal.chain_joints, same, strict=True)
        return tuple(name for name, is_same in pairs if not is_same)


def corrected_robot(model: CalibrationModel, x: ArrayLike) -> CorrectedRobot:
    """The robot of a model at identified parameters ``(p,)`` [SI], as far as a chain can hold it.

    The tip is that of the description: where the tool sits on it, and where the targets are, are
    no matter of the robot. What the set-up absorbs (the zero offset of joint 1, by targets that
    are not surveyed) stays as described.
    """
    values = check_values(model, x)
    robot = model.robot
    errors = ArmErrors(np.zeros((robot.n, 1)))
    anywhere = np.zeros((robot.n, 1))  # what a chain holds is the same in every posture
    left_out = []
    for block, part in zip(model.parameters, model.slices, strict=True):
        if not block.beyond_chain:
            block.displace(values[part, None], errors, anywhere, Setup.of(1))
        elif _does_something(block, values[part], robot):
            listed = ", ".join(block.names) or "as described"
            left_out.append(f"{block.beyond_chain} ({listed})")
    placements = robot.chain.placements.copy()
    for joint, off in errors.displacements().items():
        placements[joint] @= transform(off.rotation[..., 0], off.translation[..., 0])
    for j in np.flatnonzero(errors.joints[:, 0]):
        along, slides = robot.chain.axes[j] * errors.joints[j, 0], robot.sliding[j]
        turn = np.eye(3) if slides else rotation_exp(along)
        moved = transform(turn, along if slides else np.zeros(3))
        if j < robot.floor:  # a description has it where a positioner's joint hangs
            placements[j + 1] = moved @ placements[j + 1]
        else:
            placements[j] @= moved
    corrected = with_placements(robot, placements, errors.joints[:, 0])
    said = "joint frames as identified, not as described"
    corrected = replace(corrected, notices=(*robot.notices, said))
    return CorrectedRobot(corrected, robot, tuple(left_out))


def check_values(model: CalibrationModel, x: ArrayLike) -> FloatArray:
    """One set of parameters as an array ``(p,)``."""
    values = np.asarray(x, dtype=float)
    if values.shape != (model.p,):
        raise InputError(
            f"the model has {model.p} parameters, the values have shape {values.shape}",
            hint="give one set of values",
            name="x",
        )
    if not np.isfinite(values).all():
        name = model.names[int(np.flatnonzero(~np.isfinite(values))[0])]
        raise InputError(f"the value of {name} is not a finite number", name=name)
    return values


def _does_something(block: ParameterBlock, values: FloatArray, robot: Robot) -> bool:
    """Whether a block displaces the arm at its values: one that is identified as zero does not."""
    rng = np.random.default_rng(0)
    q = rng.uniform(robot.lower, robot.upper, (8, robot.n)).T
    errors = ArmErrors(np.zeros((robot.n, 1)))
    block.displace(values[:, None], errors, np.ascontiguousarray(q), Setup.of(8))
    return bool(errors.joints.any() or errors.displaced)


_TAG = re.compile(rb"""<[^\s/>]+(?:\s+[^\s=]+\s*=\s*(?:"[^"]*"|'[^']*'))*\s*/?>""")
"""A start tag of well-formed XML in an encoding that has ASCII in it."""

_ATTRIBUTE = re.compile(rb"""\s+([^\s=]+)\s*=\s*("[^"]*"|'[^']*')""")


def corrected_urdf(
    corrected: CorrectedRobot,
    source: Path | None = None,
    packages: Iterable[Path] = (),
    xacro_args: Iterable[str] = (),
    *,
    said: Sequence[str] = (),
) -> bytes:
    """The content of a URDF of the identified robot.

    It reads back to the kinematics of ``corrected.robot``. A comment at its head says what it is,
    and what was identified and is not in it.

    Parameters
    ----------
    source : path, optional
        The URDF or xacro file that the nominal robot was read from; it is not changed. Meshes
        that it names relative to itself are to be copied along. None: a robot from no file.
    packages, xacro_args
        What the file was read with, see :meth:`calib.robots.Robot.from_urdf`.
    said : sequence of str
        What else the comment is to say.

    Raises
    ------
    RobotModelError
        The file cannot be read any more, or has no such joints.
    """
    comment = words_for_comment(corrected.left_out, said)
    if source is None:
        return urdf_of(corrected.robot, comment)
    description = read_description(source, packages, xacro_args)
    changes = _moved_origins(corrected, description, source)
    return _edited(description.text, changes, comment, source)


def _moved_origins(
    corrected: CorrectedRobot, description: Description, path: Path
) -> dict[str, dict[str, str]]:
    """Attributes of the new origin of every joint that moved, by its name."""
    origins = {}
    for joint in description.root.findall("joint"):
        found = joint.find("origin")
        xyz, rpy = ("0 0 0" if found is None else found.get(key, "0 0 0") for key in ("xyz", "rpy"))
        origins[joint.get("name", "")] = xyz, rpy
    changes = {}
    pairs = zip(corrected.nominal.chain_joints, corrected.corrections, strict=True)
    for name, T_described_corrected in pairs:
        if name not in corrected.moved:
            continue
        place, turn = (numbers(text) for text in origins.get(name, ("", "")))
        if len(place) != 3 or len(turn) != 3:
            raise RobotModelError(
                f"{path}: has no joint {shown(name)} with an origin that can be read",
                hint="is it the file that the robot was read from?",
                name=name,
            )
        T_link_joint = transform(rotation_from_wpr(turn), place) @ T_described_corrected
        changes[name] = {
            "xyz": spread(T_link_joint[:3, 3].tolist()),
            "rpy": spread(rpy_of(T_link_joint[:3, :3]).tolist()),
        }
    return changes


def _edited(text: bytes, changes: dict[str, dict[str, str]], comment: str, path: Path) -> bytes:
    """The text with new origins, and a comment before its outermost element."""
    root, places = _places(text, path)
    edits: list[tuple[int, int, bytes]] = [(root, root, f"<!-- {comment} -->\n".encode())]
    for name, values in changes.items():
        joint, origin = places[name]
        if origin is None:
            start = end = _tag_end(text, joint, path)
            prefix = _prefix(text, joint)
            written = " ".join(f'{key}="{value}"' for key, value in values.items())
            edits.append((start, end, b"<" + prefix + f"origin {written}/>".encode()))
        else:
            end = _tag_end(text, origin, path)
            edits.append((origin, end, _with_attributes(text[origin:end], values)))
    for start, end, new in sorted(edits, reverse=True):
        text = text[:start] + new + text[end:]
    return text


def _places(text: bytes, path: Path) -> tuple[int, dict[str, tuple[int, int | None]]]:
    """Byte places of the outermost element, and of each joint with its origin, if it has one.

    The text has been read by a parser that refuses document types, so there are no entities.
    """
    root: list[int] = []
    joints: dict[str, tuple[int, int | None]] = {}
    above: list[str] = []
    parser: Any = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        local, here = tag.rpartition(":")[2], parser.CurrentByteIndex
        if not above:
            root.append(here)
        elif len(above) == 1 and local == "joint":
            joints[attributes.get("name", "")] = here, None
            local = "joint:" + attributes.get("name", "")
        elif len(above) == 2 and above[1].startswith("joint:") and local == "origin":
            name = above[1].removeprefix("joint:")
            joint, origin = joints[name]
            joints[name] = joint, here if origin is None else origin
        above.append(local)

    def end(tag: str) -> None:
        above.pop()

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(text, True)
    for place in (*root, *(p for pair in joints.values() for p in pair if p is not None)):
        if _TAG.match(text, place) is None:
            raise RobotModelError(
                f"{path}: is in an encoding that it cannot be changed in",
                hint="save it as UTF-8",
                name=str(path),
            )
    return root[0], joints


def _tag_end(text: bytes, start: int, path: Path) -> int:
    match = _TAG.match(text, start)
    if match is None:
        raise RobotModelError(f"{path}: has a tag that cannot be read", name=str(path))
    return match.end()


def _prefix(text: bytes, start: int) -> bytes:
    """Name space prefix of a tag, with its colon; empty without one."""
    name = re.split(rb"[\s/>]", text[start + 1 : start + 200], maxsplit=1)[0]
    prefix, colon, _ = name.rpartition(b":")
    return prefix + colon


def _with_attributes(tag: bytes, values: dict[str, str]) -> bytes:
    """A start tag with some of its attributes set, all others as they are."""
    left = dict(values)

    def changed(match: re.Match[bytes]) -> bytes:
        key = match[1].decode("ascii", "replace")
        if key == "quat_xyzw" and "rpy" in values:
            return b""  # which may not stand beside it
        if key not in left:
            return match[0]
        before = match[0][: match.start(2) - match.start()]
        return before + f'"{left.pop(key)}"'.encode()

    tag = _ATTRIBUTE.sub(changed, tag)
    for key, value in left.items():
        head = re.match(rb"<[^\s/>]+", tag)
        cut = head.end() if head else 1
        tag = tag[:cut] + f' {key}="{value}"'.encode() + tag[cut:]
    return tag
