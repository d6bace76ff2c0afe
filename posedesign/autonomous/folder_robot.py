"""A robot reached through a folder: programs out, pictures and joint values in.

Whoever serves the folder, a script beside the controller or a person with a memory stick, runs the
programs in the order of their numbers, leaves none out, and answers each with a picture::

    out/MOVE0007.LS       the program of move 7 in the controller's format: one joint move
    out/0007.csv          its joint values, signs of the URDF; written last: move 7 is whole
    out/0007_2.request    a second picture is wanted without a move; then 0007_3, ...
    in/0007.csv           joint values as the controller shows them, if it can say (j1_deg .. in
                          signs of the URDF, or pendant_j1_deg ..)
    in/MOVE0007.LS        or the program with the position as it was recorded on the controller
    in/0007.png           the picture, written last: the arm stands still, and all results are there
    in/0007_2.png         the second picture

A result is best written aside and renamed; one that grows or cannot be read yet is waited for.
Programs are never written over, results never moved or deleted.

Where the camera is connected to this computer, an empty file says in place of each picture that the
arm stands still::

    in/0007.done          written last, by whoever has run the program
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib.errors import FileFormatError, InputError
from calib.se3 import FloatArray
from calib.vision.touch_up import Arms, Drive, RobotAdapter
from calib.vision.touch_up.drive import LARGEST_CORRECTION_RAD, Refuses, check_shown
from posedesign.autonomous.exchange_folder import ExchangeFolder, number_of
from posedesign.autonomous.video_camera import VideoCamera
from posedesign.cell import Cell
from posedesign.constraints import Checker
from posedesign.files import write_text_atomic
from posedesign.files.pictures import ENDINGS, read_picture
from posedesign.motion import Router
from posedesign.planning.poses_file import PoseList, read_robot_poses, write_pose_list
from posedesign.pose_programs import chosen_dialect, program_options
from posedesign.pose_programs.from_plan import arm_of, check_recorded_frames
from posedesign.programs import PoseProgram, ProgramPose, find_dialect, postures_of

if TYPE_CHECKING:
    from calib.vision.camera.rendering import GreyImage


DONE = (".done",)
"""Ending of the file that says that the arm stands still."""

MOST_MOVES = 9999
"""Names of programs have eight characters on the oldest controllers: MOVE and four digits."""


@dataclass
class _Move:
    """The last move: where it was to go, and how far its results are read."""

    number: int  # counted from 1 in the folder
    posture: FloatArray
    written: FloatArray
    """posture, written (n,): as it was commanded, and as it stands in the program, rounded
    [rad]."""
    program: Path  # the file with the position, relative to the folder of programs
    mark: str  # fingerprint that the program carries
    pictures: int = 1  # that were asked for
    waiting: bool = True  # the last of them has not been read yet

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

    ``cell``: whose robot it is, with the ``[program]`` section for speed, frames and time to
    settle. ``folder``: must exist. ``in`` and ``out`` are made in it, and nothing is written
    elsewhere. ``dialect``: format of the programs; by default that of the robot's controller.
    ``camera``: that takes the pictures; by default they come through the folder. ``timeout_s``:
    longest wait for a result [s]. ``poll_s``: time from look to look [s]. A file is read when it
    has not changed between two. Raises InputError: there is no such folder, no dialect, or a time
    out of its range. OutputError: the folder cannot be written.
    """

    def __init__(
        self,
        cell: Cell,
        folder: Path | str,
        dialect: str | None = None,
        *,
        camera: VideoCamera | None = None,
        timeout_s: float = 600.0,
        poll_s: float = 0.5,
    ) -> None:
        chosen = chosen_dialect(cell, _one_pose("base", cell.base_posture), dialect)
        self._cell = cell
        self._dialect = find_dialect(chosen).reading(*cell.config.program.pulses)
        self._arm = arm_of(cell)
        self._seen = self._dialect.seen(self._arm)
        self._exchange = ExchangeFolder(Path(folder), timeout_s, poll_s)
        self._camera = camera
        self._move: _Move | None = None

    @property
    def shows_before_moving(self) -> bool:  # type: ignore[override]
        """False until a move was answered: nobody has said where the arm stands."""
        return self._move is not None

    def identity(self) -> str:
        """The folder that this robot is behind, links resolved."""
        return f"behind {self._exchange.folder.resolve()}"

    def move(self, q: FloatArray) -> None:
        """Write the program that moves the joints to ``(n,)`` [rad]; results are waited for later.

        Raises JointLimitError, InputError: the posture is outside the limits or not finite, the
        format cannot say it, there are results of this number already, or somebody else has ordered
        a move since the last. FileFormatError: the folder cannot be listed: the share that it is on
        is gone. OutputError: a file cannot be written.
        """
        self._cell.robot.check_limits(q)
        before = 0 if self._move is None else self._move.number
        # programs that were run may have been taken away
        last = self._exchange.last_number()
        number = 1 + max(before, last)
        if number > MOST_MOVES:
            raise InputError(
                f"{self._exchange.orders} has had {MOST_MOVES} moves",
                hint="go on with an empty folder",
            )
        if self._move is not None and last > before:
            raise InputError(
                f"{self._exchange.orders} has move {last} of somebody else",
                hint="the arm may be anywhere: let one at a time use the folder, then start again",
            )
        self._exchange.refuse_early(
            lambda name: number_of(name) == number, f"move {number} was written"
        )
        with self._exchange.publishing(last=f"{number:04d}.csv") as aside:
            made = self._written(aside, number, np.array(q, dtype=float))
        self._move = made

    def joints(self) -> FloatArray:
        """Joint values ``(n,)`` [rad] of the move as the controller showed them.

        From the table or the program that came with the picture. Where neither came they are those
        that stand in the program that was run, rounded as it rounds them.

        Raises InputError: there was no move, or they are not those of this move. FileFormatError:
        they, and the picture, have not come in time, or cannot be read.
        """
        made = self._moved()
        shown = self._shown(made)
        if shown is None and made.picture == made.label and made.waiting:
            self._wait(made)
            shown = self._shown(made)
        return made.written.copy() if shown is None else shown

    def grab(self) -> GreyImage:
        """Picture ``(height, width)`` of 8 bits of the move; another one every time it is called.

        Raises InputError: there was no move, joint values that came with the picture are not those
        of this move, or a picture was there before it was asked for. FileFormatError: it has not
        come in time, or cannot be read. OutputError: the request for another picture cannot be
        written.
        """
        made = self._moved()
        if not made.waiting:
            if self._camera is not None:
                return self._camera.grab()
            self._ask_again(made)
        picture = self._wait(made)
        self._shown(made)
        made.waiting = False
        return picture if self._camera is None else self._camera.grab()

    def _wait(self, made: _Move) -> GreyImage:
        """Wait for the picture of a move, or with a camera for no more than the arm's standing."""
        hint = self._hint(made)
        if self._camera is None:
            return self._exchange.wait(made.picture, ENDINGS, read_picture, hint)[0]
        nothing: GreyImage = np.empty((0, 0), dtype=np.uint8)
        return self._exchange.wait(made.picture, DONE, lambda path: nothing, hint)[0]

    def _moved(self) -> _Move:
        if self._move is None:
            raise InputError(
                f"there was no move through {self._exchange.folder} yet",
                hint="move first: only then is known where the arm stands",
            )
        return self._move

    def _hint(self, made: _Move) -> str:
        program = self._exchange.orders / made.program
        result = "the result" if self._camera is None else "an empty file"
        return f"run {program} and save {result} there; asked again, it is waited for again"

    def _written(self, aside: Path, number: int, posture: FloatArray) -> _Move:
        """Write the files of a move where nobody looks for them yet, and check them."""
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
        made.written = self._near(made, self._in_program(made, paths[0]), paths[0])
        write_pose_list(aside / f"{made.label}.csv", listed, self._cell.robot, self._cell.tool_m)
        return made

    def _ask_again(self, made: _Move) -> None:
        """Ask for one more picture of the same move."""
        picture = f"{made.label}_{made.pictures + 1}"
        self._exchange.refuse_early(
            lambda name: Path(name).stem.casefold() == picture, f"picture {picture} was asked for"
        )
        name = f"{picture}.request"
        with self._exchange.publishing(last=name) as aside:
            text = f"wanted: in/{picture}{ENDINGS[0]}\nthe arm stays at: {made.program.stem}\n"
            write_text_atomic(aside / name, text)
        made.pictures += 1
        made.waiting = True

    def _shown(self, made: _Move) -> FloatArray | None:
        """Joint values ``(n,)`` [rad] that came with a move; None where there are none."""
        program = str(made.program.with_suffix(""))
        endings = [s for s in self._dialect.suffixes if s not in self._dialect.companions]
        hint = self._hint(made)
        if self._exchange.find(made.label, [".csv"]) is not None:
            table = partial(self._in_table, made)
            return self._near(made, *self._exchange.wait(made.label, [".csv"], table, hint))
        if self._exchange.find(program, endings) is not None:
            recorded = partial(self._in_program, made)
            return self._near(made, *self._exchange.wait(program, endings, recorded, hint))
        return None

    def _near(self, made: _Move, shown: FloatArray, path: Path) -> FloatArray:
        """The same joint values ``(n,)`` [rad], refused where they are not those of the move."""
        check_shown(
            self._cell.robot,
            made.posture,
            shown,
            shown_within_rad(self._cell),
            event=f"in {path}, where move {made.number} commands",
            hint="was the arm moved, or is it of another move? Values of a pendant stand in "
            "columns pendant_j1_deg ..",
        )
        return shown

    def _in_table(self, made: _Move, path: Path) -> FloatArray:
        """Posture ``(n,)`` [rad] in a table of one pose."""
        listed = read_robot_poses(path, self._cell.robot)
        if len(listed.postures) != 1:
            raise FileFormatError(
                f"has {len(listed.postures)} poses, not one",
                path=path,
                hint="write the joint values of this move alone",
            )
        if number_of(listed.names[0]) not in (0, made.number):
            raise _of_another(path, made)
        return np.asarray(listed.postures[0])

    def _in_program(self, made: _Move, path: Path) -> FloatArray:
        """Posture ``(n,)`` [rad] of the first position in a program."""
        program = self._dialect.read(path)
        if program.fingerprint not in ("", made.mark):
            raise _of_another(path, made)
        positions = tuple(p for p in program.positions if p.number == 1)
        if not positions:
            raise FileFormatError(
                "has no position 1", path=path, hint=f"save {made.program} with its position"
            )
        check_recorded_frames(self._cell, self._dialect, positions, path)
        return np.asarray(postures_of(positions, self._seen, made.posture[None])[0])


def _one_pose(name: str, posture: FloatArray) -> PoseList:
    return PoseList((name,), np.atleast_2d(posture), np.zeros(1, dtype=bool))


def _of_another(path: Path, made: _Move) -> InputError:
    return InputError(
        f"{path} is the result of another move than {made.number}",
        hint="save the result of each move under its own number",
        name=str(path),
    )


_SAFETY = 0.5
"""Part of the safety distance that a loop keeps: poses are planned with all of it, and the loop
moves the arm on from there by what the robot is off."""


def drive_of(cell: Cell, arms: Arms, tell: Callable[[str], None] = lambda text: None) -> Drive:
    """The drive that a cell asks for; ``tell`` is told what could not be checked."""
    nearer = {"safety_distance_mm": _SAFETY * cell.config.constraints.safety_distance_mm}
    loose = replace(cell, config=cell.config.changed(constraints=nearer))
    return Drive(
        cell.robot,
        arms,
        float(np.deg2rad(cell.config.touch_up.approach_deg)),
        refusals_of(loose),
        Router.of_cell(loose).between,
        shown_within_rad=shown_within_rad(cell),
        tell=tell,
    )


def shown_within_rad(cell: Cell) -> float:
    """How far joints may be shown off what was commanded [rad]."""
    return float(np.deg2rad(cell.config.touch_up.shown_within_deg))


def refusals_of(cell: Cell) -> Refuses:
    """Why moves must not be made: joint limits, and collisions as far as the cell has bodies.

    A motion from where an arm really stands is checked as the planner checks its own; no joint
    travels farther in it than a planned one, but for what corrections have added at both ends.

    Bodies that may meet at the target keep their distance there, too, unlike in a plan: the loop
    corrects sideways, and where the target is it has yet to find.
    """
    checker = Checker(cell.robot, cell.solid)
    travel = cell.ways.largest_travel + 2.0 * LARGEST_CORRECTION_RAD
    ways = replace(cell.ways, largest_travel=travel)

    def refuses(start: FloatArray, end: FloatArray) -> list[str]:
        reasons = [""] * len(end)
        known = np.isfinite(start).all(axis=1) & cell.config.constraints.ways
        found = ways.check(start[known], end[known])
        for k, reason, part in zip(
            np.flatnonzero(known).tolist(), found.reasons, found.part.tolist(), strict=True
        ):
            reasons[k] = f"on the way, {reason}" if reason and part < 1.0 else reason
        alone = checker.check(end[~known], every=False)
        for i, k in enumerate(np.flatnonzero(~known).tolist()):
            reasons[k] = "" if alone.feasible[i] else alone.reason(i)
        return reasons

    return refuses
