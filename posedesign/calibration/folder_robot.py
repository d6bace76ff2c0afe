"""A robot reached through a folder: programs out, pictures and joint values in.

Whoever serves the folder, a script beside the controller or a person with a memory stick, runs the
programs in the order of their numbers and leaves none out, and answers each with a picture::

    out/MOVE0007.LS       the program of move 7 in the controller's format: one joint move
    out/0007.csv          its joint values, signs of the URDF; written last: move 7 is whole
    out/0007_2.request    a second picture is wanted without a move; then 0007_3, ...
    in/0007.csv           joint values as the controller shows them, if it can say (j1_deg .. in
                          signs of the URDF, or pendant_j1_deg ..)
    in/MOVE0007.LS        or the program with the position as it was recorded on the controller
    in/0007.png           the picture, written last: the arm stands still, and all results are there
    in/0007_2.png         the second picture

A result is written aside and renamed, if possible; one that grows or cannot be read yet is waited
for. Programs are never written over, results never moved or deleted.
"""

from __future__ import annotations

import os
import re
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from calib.errors import FileFormatError, InputError, OutputError
from calib.se3 import FloatArray
from calib.visual.adapter import RobotAdapter
from posedesign.calibration.picture_file import ENDINGS, read_picture
from posedesign.cell import Cell
from posedesign.files import make_folder, write_text_atomic
from posedesign.program_frames import arm_of, check_recorded_frames
from posedesign.programming import chosen_dialect, program_options
from posedesign.programs import Dialect, PoseProgram, ProgramPose, find_dialect, postures_of
from posedesign.programs.program import in_range
from posedesign.tables import PoseList, read_robot_poses, write_pose_list

if TYPE_CHECKING:
    from calib.camera.rendering import GreyImage

FAR_DEG = 0.1
"""Joints that differ by more from what was commanded are not those of this move. Controllers stop
within some thousandths of a degree of a fine position and show hundredths at least; a hand on the
jog keys, or a pendant's J3 in the column of the URDF's, moves a joint by far more."""

MOST_MOVES = 9999
"""Names of programs have eight characters on the oldest controllers: MOVE and four digits."""

LONGEST_S = 7 * 24 * 3600.0
"""Longest wait: over a week-end that nobody is at the cell, and some days more."""

_NUMBERED = re.compile(r"(?:move)?(\d{4})(?!\d).*", re.ASCII | re.DOTALL)

T = TypeVar("T")


@dataclass
class _Move:
    """The move that the arm makes or has made.

    Attributes
    ----------
    number : int
        Of the move, counted from 1 in the folder.
    posture, written : array (n,)
        As it was commanded, and as it stands in the program, rounded [rad].
    program : Path
        The file with the position, in the folder of programs.
    mark : str
        Fingerprint that the program carries.
    pictures : int
        That were asked for.
    waiting : bool
        The last of them has not been read yet.
    """

    number: int
    posture: FloatArray
    written: FloatArray
    program: Path
    mark: str
    pictures: int = 1
    waiting: bool = True

    @property
    def label(self) -> str:
        """Name of its files without ending."""
        return f"{self.number:04d}"

    @property
    def picture(self) -> str:
        """Name of the last picture that was asked for, without ending."""
        return self.label if self.pictures == 1 else f"{self.label}_{self.pictures}"


class FolderRobot(RobotAdapter):
    """A robot that reads programs from a folder and answers in it; see the module.

    A move returns when its program is written; the picture tells that it was made, so
    :meth:`grab` and :meth:`joints` wait for it. After a time-out the same call goes on waiting.

    Parameters
    ----------
    cell : Cell
        Whose robot it is, with the ``[program]`` section for speed, frames and time to settle.
    folder : Path or str
        Must exist: a share that is not there is not replaced by a folder on this disk. ``in`` and
        ``out`` are made in it, and nothing is written elsewhere.
    dialect : str, optional
        Format of the programs; by default that of the robot's controller.
    timeout_s : float
        Longest wait for a result [s].
    poll_s : float
        Time from look to look [s]. A file is taken when it has not changed between two.

    Raises
    ------
    InputError
        There is no such folder, no dialect, or a time out of its range.
    OutputError
        The folder cannot be written.
    """

    def __init__(
        self,
        cell: Cell,
        folder: Path | str,
        dialect: str | None = None,
        *,
        timeout_s: float = 600.0,
        poll_s: float = 0.5,
    ) -> None:
        in_range("timeout_s", timeout_s, 0.0, LONGEST_S)
        in_range("poll_s", poll_s, 1e-3, 60.0)
        chosen = chosen_dialect(cell, _one_pose("base", cell.base_posture), dialect)
        self._cell = cell
        self._dialect = find_dialect(chosen).reading(cell.config.program.pulses_per_deg)
        self._arm = arm_of(cell)
        self._seen = self._dialect.seen(self._arm)
        self._timeout_s, self._poll_s = timeout_s, poll_s
        self._folder = Path(folder)
        self._out, self._in = _places(self._folder)
        self._move: _Move | None = None
        self._last = 0

    def move(self, q: FloatArray) -> None:
        """Write the program that moves the joints to ``(n,)`` [rad]; results are waited for later.

        Raises
        ------
        JointLimitError, InputError
            The posture is outside the limits, or not finite, or the format cannot say it, or
            results of this number were there before.
        OutputError
            A file cannot be written.
        """
        self._cell.robot.check_limits(q)
        posture = np.array(q, dtype=float)
        number = 1 + max([self._last, *(_number_of(entry) for entry in _entries(self._out))])
        if number > MOST_MOVES:
            raise InputError(
                f"{self._out} has had {MOST_MOVES} moves", hint="go on in an empty folder"
            )
        self._refuse_stale(lambda name: _number_of(name) == number, f"move {number} was written")
        with self._staging() as aside:
            made = self._written(aside, number, posture)
            self._publish(aside)
        self._last, self._move = number, made

    def joints(self) -> FloatArray:
        """Joint values ``(n,)`` [rad] of the move as the controller showed them.

        From the table or the program that came with the picture. Where neither came they are those
        that stand in the program that was run, rounded as it rounds them.

        Raises
        ------
        InputError
            There was no move, or they are not those of this move.
        FileFormatError
            They, and the picture, have not come in time, or cannot be read.
        """
        made = self._moved()
        shown = self._shown(made)
        if shown is None:
            self._wait(made.label, ENDINGS, read_picture)
            shown = self._shown(made)
        return made.written.copy() if shown is None else shown

    def grab(self) -> GreyImage:
        """Picture ``(height, width)`` of 8 bits of the move; another one every time it is called.

        Raises
        ------
        InputError
            There was no move, joint values that came with the picture are not those of this move,
            or a picture was there before it was asked for.
        FileFormatError
            It has not come in time, or cannot be read.
        OutputError
            The request for another picture cannot be written.
        """
        made = self._moved()
        if not made.waiting:
            self._ask_again(made)
        picture = self._wait(made.picture, ENDINGS, read_picture)
        self._shown(made)
        made.waiting = False
        return picture

    def _moved(self) -> _Move:
        if self._move is None:
            raise InputError(
                f"there was no move through {self._folder} yet",
                hint="move first: only then is known where the arm stands",
            )
        return self._move

    def _written(self, aside: Path, number: int, posture: FloatArray) -> _Move:
        """Write the files of a move where nobody looks for them, and read them back."""
        name = f"MOVE{number:04d}"
        listed = _one_pose(name, posture)
        options = replace(
            program_options(self._cell, listed, "joint"),
            measure_call=None,
            measure_output=None,
            keep="position",
        )
        program = PoseProgram(name, (ProgramPose(name, posture),), options, self._arm)
        paths = self._dialect.write(program, aside)
        for path in paths:
            if path.suffix.lower() not in self._dialect.suffixes:
                continue
            for problem in self._dialect.validate(path):
                raise InputError(
                    f"{path.name} would be refused: {problem}", hint="look at [program] in the cell"
                )
        made = _Move(number, posture, posture, paths[0].relative_to(aside), options.fingerprint)
        made.written = self._in_program(paths[0], made)
        write_pose_list(aside / f"{made.label}.csv", listed, self._cell.robot, self._cell.tool_m)
        return made

    @contextmanager
    def _staging(self) -> Iterator[Path]:
        """A folder of this robot's own that files are written in before anybody sees them."""
        try:
            with tempfile.TemporaryDirectory(prefix=".making-", dir=self._folder) as name:
                yield Path(name)
        except OSError as error:
            raise OutputError(
                f"{self._out} cannot be written: {error.strerror or error}",
                hint="check that it is there, can be written and has free space",
                name=str(self._out),
            ) from error

    def _publish(self, aside: Path) -> None:
        """Rename the files into the folder of programs, the table of the joint values last."""
        files = [path for path in aside.rglob("*") if path.is_file()]
        for path in sorted(files, key=lambda path: _table_of(path.name) is not None):
            target = self._out / path.relative_to(aside)
            target.parent.mkdir(exist_ok=True)
            os.replace(path, target)  # a link that stands there is replaced, not followed

    def _ask_again(self, made: _Move) -> None:
        """Ask for one more picture of the same move."""
        picture = f"{made.label}_{made.pictures + 1}"
        self._refuse_stale(
            lambda name: Path(name).stem.casefold() == picture, f"picture {picture} was asked for"
        )
        with self._staging() as aside:
            text = f"wanted: in/{picture}{ENDINGS[0]}\nstands at: {made.program.stem}\n"
            write_text_atomic(aside / f"{picture}.request", text)
            self._publish(aside)
        made.pictures += 1
        made.waiting = True

    def _refuse_stale(self, is_its: Callable[[str], bool], event: str) -> None:
        """Refuse a result that is there before it was asked for."""
        early = next((name for name in sorted(_entries(self._in)) if is_its(name)), None)
        if early is not None:
            raise InputError(
                f"{self._in / early} was there before {event}: it is the result of something else",
                hint=f"move what is in {self._in} elsewhere, then go on",
                name=early,
            )

    def _shown(self, made: _Move) -> FloatArray | None:
        """Joint values ``(n,)`` [rad] that came with a move; None where there are none."""
        endings = [s for s in self._dialect.suffixes if s not in self._dialect.companions]
        for label, ending, read in (
            (made.label, (".csv",), self._in_table),
            (str(made.program.with_suffix("")), tuple(endings), self._in_program),
        ):
            if self._find(label, ending) is None:
                continue
            shown = self._wait(label, ending, lambda path, read=read: read(path, made))
            off = np.rad2deg(np.abs(shown - made.posture))
            worst = int(np.argmax(off))
            if off[worst] > FAR_DEG:
                joint = self._cell.robot.joint_names[worst]
                raise InputError(
                    f"{self._find(label, ending)}: {joint} is {off[worst]:.3g} deg off what move "
                    f"{made.number} commands",
                    hint="was the arm moved, or is it of another move? Values of a pendant stand "
                    "in columns pendant_j1_deg ..",
                    name=joint,
                    value=float(np.rad2deg(shown[worst])),
                    bound=float(np.rad2deg(made.posture[worst])),
                )
            return shown
        return None
