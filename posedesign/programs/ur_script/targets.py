"""URScript expressions that a move can have as its target, as far as their text tells them."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from posedesign.programs.ur_script.values import JOINTS

_ASSIGNED = re.compile(r"(?:(?:global|local)\s+)?([A-Za-z_]\w{0,99})\s*=(.*)", re.ASCII)
_LIST = re.compile(r"(p?)\s*\[([^\[\]]*)\]", re.ASCII)
_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
_ELEMENT = re.compile(r"(?:(?:global|local)\s+)?([A-Za-z_]\w{0,99})\s*[\[.][^=]*=", re.ASCII)
_CALL = re.compile(r"(get_inverse_kin|pose_trans)\s*\(", re.ASCII)
_KEYWORD = re.compile(r"\s*([A-Za-z_]\w{0,99})\s*=(?!=)(.*)", re.ASCII | re.DOTALL)
_STEM = re.compile(r"(.+)_[qp]")
_POINTS = re.compile(r"[()\[\],]")

_DEEPEST = 4
"""get_inverse_kin(pose_trans(frame, pose)) with variables needs no more."""


_INVERSE = ("x", "qnear", "maxPositionError", "maxOrientationError", "tcp")
"""Parameters of get_inverse_kin."""

_ACTIVE_TCP = "active_tcp"
"""Its default: the TCP that was set."""


@dataclass(frozen=True)
class Target:
    """A list of joints, or a pose, or both, as they stand.

    Attributes
    ----------
    row : int
        Line on which it stands.
    variable : str
        That holds it; empty where it stands in the move itself.
    joints, pose : str or None
        What is inside the brackets.
    frames : tuple of str
        Poses of the frames that the pose is in, as they stand, from the base frame on.
    tcp : str or None
        Pose of the TCP that is brought there, as it stands, where the expression says which.
    """

    row: int
    variable: str
    joints: str | None = None
    pose: str | None = None
    frames: tuple[str, ...] = ()
    tcp: str | None = None

    @property
    def name(self) -> str:
        """The variable's name without PolyScope's _q and _p."""
        stem = _STEM.fullmatch(self.variable)
        return stem[1] if stem else self.variable


class Variables:
    """Lists that were assigned so far."""

    def __init__(self) -> None:
        self._lists: dict[str, Target] = {}
        self.forgotten: tuple[str, int] | None = None

    def assign(self, code: str, row: int) -> None:
        """Take a statement; others than assignments are ignored.

        A list that an element of is assigned to is not known any more.
        """
        code = code.strip()
        assigned = _ASSIGNED.fullmatch(code)
        if not assigned:
            element = _ELEMENT.match(code)
            if element and self._lists.pop(element[1], None):
                self.forgotten = self.forgotten or (element[1], row)
            return
        found = _LIST.fullmatch(assigned[2].strip())
        if found:
            joints, pose = (None, found[2]) if found[1] else (found[2], None)
            self._lists[assigned[1]] = Target(row, assigned[1], joints, pose)
        else:
            self._lists.pop(assigned[1], None)

    def joint_targets(self, *, of_polyscope: bool) -> dict[tuple[str, int], Target]:
        """Variables that hold joints, each with the pose that PolyScope stores beside it.

        ``of_polyscope``: only those that it names.
        """
        out = {}
        for name, target in self._lists.items():
            if of_polyscope and not name.endswith("_q"):
                continue
            if target.joints is not None and target.joints.count(",") == JOINTS - 1:
                beside = self._lists.get(f"{target.name}_p")
                pose = beside.pose if beside is not None and name.endswith("_q") else None
                out[name, target.row] = replace(target, pose=pose)
        return out

    def target(
        self, text: str, row: int, *, planned: bool = False, depth: int = 0
    ) -> Target | None:
        """What an expression is; None where its text does not tell.

        ``planned``: joints beside a pose in the move itself are those of the pose.
        """
        text = text.strip()
        found = _LIST.fullmatch(text)
        if found:
            joints, pose = (None, found[2]) if found[1] else (found[2], None)
            return Target(row, "", joints, pose)
        if _NAME.fullmatch(text):
            return self._lists.get(text)
        call = _CALL.match(text)
        arguments = split_arguments(text, call.end()) if call else None
        if call is None or arguments is None or depth > _DEEPEST:
            return None
        if call.end() + sum(len(part) + 1 for part in arguments) != len(text):
            return None  # something is behind its closing bracket
        if call[1] == "pose_trans":
            return self._in_frame(arguments, row, depth)
        return self._inverse(arguments, row, planned, depth)

    def _in_frame(self, arguments: list[str], row: int, depth: int) -> Target | None:
        given = by_name(arguments, ("p_from", "p_from_to"))
        inner = self.target(given.get("p_from_to", ""), row, depth=depth + 1)
        frame = self.target(given.get("p_from", ""), row, depth=depth + 1)
        if inner is None or inner.pose is None or frame is None or frame.pose is None:
            return None
        return replace(inner, frames=(*frame.frames, frame.pose, *inner.frames))

    def _inverse(self, arguments: list[str], row: int, planned: bool, depth: int) -> Target | None:
        given = by_name(arguments, _INVERSE)
        pose = self.target(given.get("x", ""), row, depth=depth + 1)
        if pose is None or pose.pose is None:
            return None
        tcp = given.get("tcp", _ACTIVE_TCP).strip()
        if tcp not in (_ACTIVE_TCP, '""'):
            named = self.target(tcp, row, depth=depth + 1)
            if named is None or named.pose is None or named.frames:
                return None
            pose = replace(pose, tcp=named.pose)
        near = self.target(given.get("qnear", ""), row, depth=depth + 1)
        if near is None or near.joints is None:
            return pose
        in_pair = bool(pose.variable) and (pose.variable, near.variable) == (
            f"{pose.name}_p",
            f"{pose.name}_q",
        )
        in_move = planned and not pose.variable and not near.variable
        return replace(pose, joints=near.joints) if in_pair or in_move else pose


def by_name(arguments: list[str], names: tuple[str, ...]) -> dict[str, str]:
    """Arguments of a call by the names of its parameters, given by place or ``name=value``."""
    given = {}
    for k, text in enumerate(arguments):
        keyword = _KEYWORD.match(text) if "=" in text else None
        if keyword:
            given[keyword[1]] = keyword[2]
        elif k < len(names):
            given[names[k]] = text
    return given


def split_arguments(text: str, start: int) -> list[str] | None:
    """Arguments of a call, from behind its opening bracket on; None where it is not closed."""
    arguments: list[str] = []
    depth, begin = 0, start
    for found in _POINTS.finditer(text, start):
        character, at = found[0], found.start()
        if character in "([":
            depth += 1
        elif character == ")" and depth == 0:
            return [*arguments, text[begin:at]]
        elif character in ")]":
            depth -= 1
        elif character == "," and depth == 0:
            arguments.append(text[begin:at])
            begin = at + 1
    return None
