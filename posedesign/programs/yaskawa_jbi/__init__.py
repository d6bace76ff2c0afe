"""Yaskawa INFORM jobs (``.JBI``): writer, reader and validator."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.notation import Notation
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import RecordedProgram
from posedesign.programs.yaskawa_jbi import writer
from posedesign.programs.yaskawa_jbi.reader import parse_yaskawa_jbi
from posedesign.programs.yaskawa_jbi.rules import check_yaskawa_jbi
from posedesign.programs.yaskawa_jbi.spec import AXES, EXTERNAL, NAMES, checked, found_in

__all__ = ["YaskawaJbi"]


class YaskawaJbi(Dialect):
    """Yaskawa INFORM jobs.

    Parameters
    ----------
    pulses_per_deg : sequence of float, optional
        Encoder pulses in one degree of S, L, U, R, B, T, signed. They are needed to read jobs that
        do not carry them in comments, and to write joint positions where the options of the
        program have none. InputError where they are not six numbers of a size that arms have.
    pulses_per_mm : sequence of float, optional
        The same in one millimetre of each base axis that carries the arm, signed.
    """

    name = "yaskawa-jbi"
    title = "Yaskawa INFORM job"
    maker = "yaskawa"
    suffixes = (".jbi",)
    remark = (r"^NOP[^\n]*\n", "'{words}")
    names = NAMES
    newline = "\r\n"
    numbered_frames = True
    joint_step_deg = 1e-3
    """About a pulse: arms have some hundreds to thousands in a degree."""
    rules = check_yaskawa_jbi

    external_axes = len(EXTERNAL)

    def __init__(
        self, pulses_per_deg: Sequence[float] = (), pulses_per_mm: Sequence[float] = ()
    ) -> None:
        self.pulses_per_deg = checked(pulses_per_deg) if len(pulses_per_deg) else ()
        axes = EXTERNAL[: max(len(pulses_per_mm), 1)]
        self.pulses_per_mm = (
            checked(pulses_per_mm, "pulses_per_mm", axes) if len(pulses_per_mm) else ()
        )

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        options = program.options
        text = writer.render_yaskawa_jbi(
            program,
            arm,
            options.pulses_per_deg or self.pulses_per_deg,
            options.pulses_per_mm or self.pulses_per_mm,
        )
        return {f"{program.name}.JBI": text}

    def most_poses(self, program: PoseProgram) -> int | None:
        besides, each = writer.lines_besides(program)
        return (writer.MOST_LINES - besides) // each

    def reading(
        self, pulses_per_deg: Sequence[float], pulses_per_mm: Sequence[float] = ()
    ) -> YaskawaJbi:
        known = len(pulses_per_deg) or len(pulses_per_mm)
        return YaskawaJbi(pulses_per_deg, pulses_per_mm) if known else self

    def notation_of(self, text: str) -> Notation:
        """In the pulses of a degree that the job says, or that are known."""
        said = dict(filter(None, (found_in(line.strip(" \t\r'")) for line in text.split("\n"))))
        pulses = [said[axis] for axis in AXES if axis in said] or self.pulses_per_deg
        return Notation(0, 3, 4, np.array(pulses) if len(pulses) == len(AXES) else 1.0)

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        return parse_yaskawa_jbi(data, path, self.pulses_per_deg, self.pulses_per_mm)
