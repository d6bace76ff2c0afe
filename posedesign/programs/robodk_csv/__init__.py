"""Lists of joint values that macros of RoboDK move a robot along (CSV)."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.program import Form, PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram
from posedesign.programs.robodk_csv.reader import is_beside, parse_robodk_csv
from posedesign.programs.robodk_csv.rules import check_robodk_csv
from posedesign.programs.robodk_csv.writer import render_robodk_csv
from posedesign.programs.writing import NameRule


class RobodkCsv(Dialect):
    """Joint values of each stop in a row, as RoboDK shows them."""

    name: ClassVar[str] = "robodk-csv"
    title: ClassVar[str] = "joint list of RoboDK in CSV"
    maker: ClassVar[str | None] = None
    suffixes: ClassVar[tuple[str, ...]] = (".csv",)
    companions: ClassVar[tuple[str, ...]] = (".txt",)
    forms: ClassVar[tuple[Form, ...]] = ("joint",)
    names: ClassVar[NameRule] = NameRule("a name for a list", 64, small=True)
    encoding: ClassVar[str] = "utf-8"

    def is_companion(self, data: bytes) -> bool:
        """Whether it is the text file that the writer puts beside a list."""
        return is_beside(data)

    def seen(self, arm: Arm) -> Arm:
        """The arm as its pendant shows it: RoboDK's post-processors hand its joints on unchanged.

        Source: ros-industrial-attic/robodk_postprocessors; Fanuc_R30iA.py writes them as J1 to J6.
        """
        return arm

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        """The list, and the names of its rows; see `render_robodk_csv`."""
        return render_robodk_csv(program, arm)

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        """Read the rows back; see `reader`."""
        return parse_robodk_csv(data, path)

    def check(self, data: bytes, path: Path) -> list[Problem]:
        """Check a list strictly; see `rules`."""
        return check_robodk_csv(data, path)
