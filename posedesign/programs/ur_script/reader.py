"""Universal Robots URScript programs (``.script``): the reader of what is written and generated.

Positions are the targets of ``movej``, ``movel`` and ``movep`` in their order: lists of joints and
poses ``p[...]``, there or in variables (``q1=[...]``, ``global Waypoint_1_q=[...]``), also inside
``get_inverse_kin`` and ``pose_trans``; a target that is moved to again is one position. Without any
move the lists of joints in variables are taken: all of a file that is nothing but lists, those that
PolyScope names (``Waypoint_1_q``) of a program, whose other lists are speeds and forces. Numbers
are those of comments ``# POSE n name`` above the moves, where there are any: other targets then
stand behind all.

A pose whose joints stand beside it has both: PolyScope stores ``Waypoint_1_p`` and ``Waypoint_1_q``
together, and below ``# POSE n`` the joints are those planned. Any other ``qnear`` only says which
arm position is near, and a pose with it is a pose alone. What cannot be known from the text, like
``movej(pose_add(...))`` or a list that an element of was assigned to, is refused, but for moves
that are none of the numbered poses.

Poses are in the base frame, or in the frames of ``pose_trans``, and of the TCP that ``set_tcp`` has
set above the move, or that ``get_inverse_kin`` names. A TCP that cannot be known from the text, or
is set in a branch, a loop or a function in another way, leaves the tool frame open. A pose that is
moved to with two TCPs is refused.

What the robot did is in the log of a run, not in the script: see :mod:`.log`.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.se3 import FloatArray, rotation_exp, transform
from posedesign.programs.reading import refuse
from posedesign.programs.recorded import PlanMark, RecordedPosition, RecordedProgram
from posedesign.programs.ur_script.targets import Target, Variables, by_name, split_arguments
from posedesign.programs.ur_script.values import decoded, joints_deg, pose_values

_DEF = re.compile(r"\s*def\s+([A-Za-z]\w{0,63})\s*\(", re.ASCII)
_OPENS = re.compile(r"\s*(?:def|thread|if|while|for|sec|switch)\b.*:\s*", re.ASCII)
_ENDS = re.compile(r"\s*end\b", re.ASCII)
_MOVE = re.compile(r"(?<![\w.])(movej|movel|movep|movec)\s*\(", re.ASCII)
_SET_TCP = re.compile(r"(?<![\w.])set_tcp\s*\(", re.ASCII)
_POSE = re.compile(r"\s*POSE\s+(\d{1,6})(?!\w)\s*(.*)", re.ASCII)
_TITLE = re.compile(r"\s*Title:\s*(.*)")
_STRING = re.compile(r'"[^"]*"')


def parse_ur_script(data: bytes, path: Path | str) -> RecordedProgram:
    """Program in the content of a file; see the module.

    Raises
    ------
    FileFormatError
        The file is no script, is cut off, or holds a position that cannot be read.
    """
    reader = _ScriptReader(path)
    lines = decoded(data, path).split("\n")
    for row, line in enumerate(lines, start=1):
        reader.feed(line, row)
    if reader.depth > 0:
        refuse("is cut off: a def, if, while, ... has no end", path, len(lines), "copy it again")
    positions = reader.positions()
    if not positions:
        refuse("holds no positions", path, None, "name a script with movej, or the log of its run")
    name = reader.name or Path(path).stem
    return RecordedProgram(name, reader.title, reader.mark, positions, "ur")


class _ScriptReader:
    """Goes through the statements, one line at a time."""

    def __init__(self, path: Path | str) -> None:
        self.path = path
        self.name = self.title = ""
        self.mark = PlanMark()
        self.depth = 0
        self._is_program = False
        self._variables = Variables()
        self._tcp: str | None = None
        self._found: dict[tuple[str, int], Target] = {}
        self._poses: dict[tuple[str, int], tuple[int, str]] = {}
        self._numbers: dict[int, tuple[str, int]] = {}
        self._pose: tuple[int, str, int] | None = None
        self._unknown: tuple[str, int] | None = None

    def feed(self, line: str, row: int) -> None:
        """Take one more line."""
        # texts in quotes may hold anything
        code, mark, comment = (_STRING.sub('""', line) if '"' in line else line).partition("#")
        if mark:
            self._comment(comment, row)
        if not code or code.isspace():
            return
        definition = _DEF.match(code)
        if definition and not self.name:
            self.name = definition[1]
        if _OPENS.fullmatch(code):
            self.depth += 1
            self._is_program = True
        elif _ENDS.match(code):
            self.depth -= 1
        move = _MOVE.search(code)
        tcp = _SET_TCP.search(code) if "set_tcp" in code else None
        if tcp:
            self._set_tcp(code, tcp.end(), row)
        if move:
            self._move(move[1], code, move.end(), row)
        else:
            self._variables.assign(code, row)

    def positions(self) -> tuple[RecordedPosition, ...]:
        """All positions, numbered."""
        self._no_pose_left()
        if self._unknown is not None and not self._poses:
            text, row = self._unknown
            reason = f"the target {text[:40]!a} cannot be known from the text"
            refuse(reason, self.path, row, "move to a list of joints, or read the log of a run")
        found = self._found or self._listed()
        numbers = [number for number, _ in self._poses.values()]
        last = max([*numbers, self.mark.measured or 0]) if numbers else 0
        out: list[RecordedPosition] = []
        posed: list[tuple[int, Target]] = []
        frames = next((target.frames for target in found.values() if target.pose is not None), ())
        for key, target in found.items():
            last += key not in self._poses
            number, name = self._poses.get(key, (last, target.name))
            what = f"position {number}"
            shown = None
            if target.joints is not None:
                shown = joints_deg(target.joints, what, self.path, target.row)
            if target.pose is not None:
                posed.append((len(out), target))
                if target.frames != frames:
                    reason = f"{what} is in another frame than positions before"
                    hint = "use one frame in pose_trans, or joints"
                    refuse(reason, self.path, target.row, hint)
            out.append(RecordedPosition(number, name, target.row, shown))
        if posed:
            self._add_poses(out, posed, frames)
        return tuple(out)

    def _listed(self) -> dict[tuple[str, int], Target]:
        """Lists of joints of a file without moves."""
        if self._variables.forgotten is not None:
            name, row = self._variables.forgotten
            reason = f"an element of {name[:30]} is changed: what it is then is not known"
            refuse(reason, self.path, row, "give whole lists")
        return self._variables.joint_targets(of_polyscope=self._is_program)

    def _add_poses(
        self,
        out: list[RecordedPosition],
        posed: list[tuple[int, Target]],
        frames: tuple[str, ...],
    ) -> None:
        """Give positions their poses and frames, all in the same user frame."""
        T_world_user = np.eye(4)
        for text in frames:
            T_world_user = (
                T_world_user @ self._transforms([(text, "the frame", posed[0][1].row)])[0]
            )
        rows = {target.tcp: target.row for _, target in reversed(posed) if target.tcp is not None}
        tools = {tcp: self._transforms([(tcp, "the TCP", row)])[0] for tcp, row in rows.items()}
        poses = self._transforms(
            [(t.pose or "", f"position {out[i].number}", t.row) for i, t in posed]
        )
        for (i, target), pose in zip(posed, poses, strict=True):
            out[i] = replace(
                out[i],
                T_user_tool=pose,
                T_world_user=T_world_user,
                T_tip_tool=None if target.tcp is None else tools[target.tcp],
            )

    def _transforms(self, texts: list[tuple[str, str, int]]) -> FloatArray:
        """Poses ``(N, 4, 4)`` of what stands in brackets, with what it is and its line."""
        values = np.stack([pose_values(text, what, self.path, row) for text, what, row in texts])
        return transform(rotation_exp(values[:, 3:]), values[:, :3])

    def _comment(self, text: str, row: int) -> None:
        pose, title = _POSE.fullmatch(text), _TITLE.fullmatch(text)
        if pose:
            self._no_pose_left()
            self._pose = (int(pose[1]), pose[2].strip(), row)
        elif title:
            self.title = self.title or title[1].strip()
        elif text.lstrip().startswith("PLAN") and not self.mark.fingerprint:
            self.mark = PlanMark.found_in(text) or self.mark

    def _no_pose_left(self) -> None:
        if self._pose is not None:
            reason = f"POSE {self._pose[0]} is not followed by a move to a position"
            refuse(reason, self.path, self._pose[2], "put the move back, or remove the comment")

    def _set_tcp(self, code: str, start: int, row: int) -> None:
        arguments = split_arguments(code, start) or [""]
        given = by_name(arguments, ("pose",)).get("pose", "")
        target = self._variables.target(given, row)
        known = target is not None and not target.frames
        tcp = target.pose if target is not None and known else None
        # inside a branch, a loop or a function nobody knows when it is set
        self._tcp = tcp if self.depth <= 1 or tcp == self._tcp else None

    def _move(self, kind: str, code: str, start: int, row: int) -> None:
        arguments = split_arguments(code, start)
        if arguments is None:
            refuse(f"{kind} has no closing bracket", self.path, row)
        given = by_name(arguments, ("q",))
        text = given.get("q", given.get("pose", arguments[0]))
        target = None
        if kind != "movec":
            target = self._variables.target(text, row, planned=self._pose is not None)
        if target is None:
            self._no_pose_left()
            self._unknown = self._unknown or (text.strip(), row)
            return
        if target.pose is not None and target.tcp is None:
            target = replace(target, tcp=self._tcp)
        key = (target.variable, target.row)
        if self._found.setdefault(key, target).tcp != target.tcp:
            reason = f"moves to {target.variable[:30]} with another TCP than before"
            refuse(reason, self.path, row, "give it one TCP, or move to joints")
        if self._pose is None:
            return
        number, name, line = self._pose
        self._pose = None
        if self._poses.setdefault(key, (number, name))[0] != number:
            refuse("is the position of two poses", self.path, line, "give each its own")
        if number < 1:
            refuse("poses are counted from 1", self.path, line)
        if self._numbers.setdefault(number, key) != key:
            refuse(f"POSE {number} is there twice", self.path, line, "remove one of them")
