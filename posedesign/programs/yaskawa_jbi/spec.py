"""Yaskawa INFORM jobs (``.JBI``): writer, reader and validator as one dialect."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram
from posedesign.programs.writing import NameRule
from posedesign.programs.yaskawa_jbi.pulses import checked
from posedesign.programs.yaskawa_jbi.reader import parse_yaskawa_jbi
from posedesign.programs.yaskawa_jbi.rules import check_yaskawa_jbi
from posedesign.programs.yaskawa_jbi.writer import (
    MOST_LINES,
    NAMES,
    lines_besides,
    render_yaskawa_jbi,
)


class YaskawaJbi(Dialect):
    """Yaskawa INFORM jobs.

    Parameters
    ----------
    pulses_per_deg : sequence of float, optional
        Encoder pulses in one degree of S, L, U, R, B, T, signed. They are needed to read jobs that
        do not carry them in comments, and to write joint positions where the options of the
        program have none.

    Raises
    ------
    InputError
        They are not six numbers of a size that arms have.
    """

    name: ClassVar[str] = "yaskawa-jbi"
    title: ClassVar[str] = "Yaskawa INFORM job"
    maker: ClassVar[str | None] = "yaskawa"
    suffixes: ClassVar[tuple[str, ...]] = (".jbi",)
    names: ClassVar[NameRule] = NAMES
    newline: ClassVar[str] = "\r\n"
    numbered_frames: ClassVar[bool] = True
    joint_step_deg: ClassVar[float] = 1e-3
    """About a pulse: arms have some hundreds to thousands in a degree."""

    def __init__(self, pulses_per_deg: Sequence[float] = ()) -> None:
        self.pulses_per_deg = checked(pulses_per_deg) if len(pulses_per_deg) else ()

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        """The job; see `render_yaskawa_jbi` for what is refused."""
        pulses = program.options.pulses_per_deg or self.pulses_per_deg
        return {f"{program.name}.JBI": render_yaskawa_jbi(program, arm, pulses)}

    def most_poses(self, program: PoseProgram) -> int | None:
        """As many as fit into the lines of one job."""
        besides, each = lines_besides(program)
        return (MOST_LINES - besides) // each

    def reading(self, pulses_per_deg: Sequence[float]) -> YaskawaJbi:
        """The dialect that reads with the pulses/deg of an arm, where they are given."""
        return YaskawaJbi(pulses_per_deg) if len(pulses_per_deg) else self

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        """A job; see `reader`."""
        return parse_yaskawa_jbi(data, path, self.pulses_per_deg)

    def check(self, data: bytes, path: Path) -> list[Problem]:
        """Check a job strictly; see `rules`."""
        return check_yaskawa_jbi(data)
