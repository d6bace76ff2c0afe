"""Touch-ups taken from a running program: one row of ``touchups.csv`` as each arrives.

The file is whole after every row, so that a stop loses nothing: begun again, it goes on with the
rows that are there, and none of them is ever changed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.errors import InputError
from calib.se3 import FloatArray
from posedesign.cell import Cell
from posedesign.files import Claim
from posedesign.files.csv_tables import as_read, read_table, write_table
from posedesign.files.measurements import read_measurements
from posedesign.files.origin import read_whole
from posedesign.files.postures import joint_columns
from posedesign.planning import NEAR_TARGET_M, off_target, outside_limits
from posedesign.planning.poses_file import PoseList
from posedesign.pose_programs.from_plan import arm_of, check_names_differ, stopping_short
from posedesign.pose_programs.touch_ups import UNMOVED_DEG, near_others, tool_moved_m
from posedesign.programs import find_dialect

_BY_HAND = "changed by hand:"
"""Begins the comment of a list that holds such rows."""

TARGET = "T1"
"""What touch-ups touch where nobody says more, as in imported ones."""


def check_recorded(cell: Cell, plan: PoseList) -> None:
    """Refuse a robot that is none of Universal Robots', and a plan in which poses share a name."""
    maker = arm_of(cell).maker
    if maker not in (None, "ur"):
        raise InputError(
            f"the robot's controller is one of {maker}, not of ur",
            hint="save the program and import it",
            name="robot.controller",
        )
    check_names_differ(plan.measured)


@dataclass(eq=False)
class Recording:
    """The touch-ups of a plan so far, and the file that they are kept in."""

    cell: Cell
    plan: PoseList
    file: Claim
    columns: list[str]
    rows: list[dict[str, object]]
    """By column, in the order of arrival; those of an earlier start first, as they are."""
    by_hand: str = ""
    """That rows of an earlier start stood in a file that was changed since it was written, in words
    that the file then says; empty where none did."""

    @classmethod
    def resume(cls, cell: Cell, plan: PoseList, file: Claim) -> Recording:
        """Begin, or go on with what is in the file and was recorded for the same plan.

        Raises FileFormatError: what is in the file cannot be read.
        """
        columns = ["target", *joint_columns(cell.robot.n, cell.robot.external), "pose"]
        if not cell.is_plain:
            columns += ["kind", "tool", "payload"]
        rows: list[dict[str, object]] = []
        by_hand = ""
        there, intact = read_whole(file.path)
        if there is not None and (there.command, there.inputs) == (
            file.origin.command,
            file.origin.inputs,
        ):
            loads = [load.name for load in cell.config.payload]
            read_measurements(
                file.path, cell.robot.n, external=cell.robot.external, payloads=loads
            )  # says what is wrong in it
            table = read_table(file.path)
            columns += [column for column in table.columns if column not in columns]
            rows = [{c: as_read(cell) for c, cell in row.cells.items()} for row in table.rows]
            by_hand = next((said for said in table.comments if said.startswith(_BY_HAND)), "")
            if not intact:
                names = ", ".join(str(row.get("pose")) for row in rows)
                by_hand = (
                    f"{_BY_HAND} the file of these rows was, and they are as they stood: {names}"
                )
        return cls(cell, plan.measured, file, columns, rows, by_hand)

    @property
    def missing(self) -> tuple[str, ...]:
        """Poses of the plan that have no row yet."""
        there = {str(row.get("pose")) for row in self.rows}
        return tuple(name for name in self.plan.names if name not in there)

    def _of(self, number: int) -> dict[str, object]:
        """What a pose is of, by column, where the cell measures more than one thing."""
        if self.cell.is_plain:
            return {}
        (k,) = self.cell.which([self.plan.labels[number - 1]])
        seen = self.cell.observations[int(k)]
        if seen.reads:
            raise InputError(
                f"{self.plan.names[number - 1]} is read by {seen.target}, and not touched up",
                hint="its reading comes in the file of the instrument",
            )
        return {**seen.labels, "kind": seen.kind}

    def take(self, number: int, shown_rad: FloatArray) -> tuple[str, float]:
        """Keep the joints ``(n,)`` [rad] as the controller shows them at a pose of the program.

        Returns its name, and how far the tool point of the nominal arm is from where the plan has
        it [m]. Raises InputError: they are not taken: there is no such pose, it has a row, or they
        cannot be its touch-up. OutputError: the row cannot be written.
        """
        if not 1 <= number <= len(self.plan.names):
            raise InputError(f"there is no pose {number} in the plan of {len(self.plan.names)}")
        name, planned = self.plan.names[number - 1], self.plan.postures[[number - 1]]
        if name not in self.missing:
            raise InputError(f"{name} is there already: its row stays as it is")
        arm = find_dialect("ur-script").seen(arm_of(self.cell))
        if len(shown_rad) != arm.n:
            raise InputError(f"{name} came with {len(shown_rad)} joints, the robot has {arm.n}")
        q = arm.postures(np.degrees(shown_rad))[None]
        untouched = (planned, stopping_short(self.cell, self.plan).postures[[number - 1]])
        if any(np.abs(q - at).max() <= np.deg2rad(UNMOVED_DEG) for at in untouched):
            raise InputError(f"{name} stands as planned: it was not touched up")
        doubts = outside_limits(self.cell, [name], q)
        doubts += off_target(self.cell, [name], q, NEAR_TARGET_M)
        doubts += [f"{name}: stands nearer to {k}" for k in near_others([name], q, self.plan)[1]]
        if doubts:
            raise InputError(doubts[0], hint="is it the program of another plan?")
        row = dict(zip(joint_columns(arm.n), np.degrees(q[0]).tolist(), strict=True))
        rows = [*self.rows, {"target": TARGET, **row, "pose": name, **self._of(number)}]
        write_table(self.file, self.columns, rows, [self.by_hand] if self.by_hand else [])
        self.rows = rows
        return name, float(tool_moved_m(self.cell, q, planned)[0])
