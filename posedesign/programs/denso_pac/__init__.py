"""Denso PacScript programs.

A file ``NAME.pcs``: a ``Move`` to each position, which stands in it. ``@E`` has the arm stop there,
its encoders asked, before the next step. The measuring call is another program. Touched-up
positions are typed into the moves; positions in the controller's variables (``J[1]``) are not in
the file. Nothing was loaded on a controller.
"""

from __future__ import annotations

from typing import ClassVar

from posedesign.programs.arm import Arm
from posedesign.programs.denso_pac.reader import parse_denso_pac
from posedesign.programs.denso_pac.rules import check_denso_pac
from posedesign.programs.joint_programs import JointDialect, Phrases
from posedesign.programs.program import PoseProgram
from posedesign.programs.writing import NameRule

__all__ = ["DensoPac"]


class DensoPac(JointDialect):
    """Programs of Denso arms with an RC8 or RC9 controller."""

    name: ClassVar[str] = "denso-pac"
    title: ClassVar[str] = "Denso PacScript program"
    maker: ClassVar[str | None] = "denso"
    suffixes: ClassVar[tuple[str, ...]] = (".pcs",)
    # no limit of a name's length is known
    names: ClassVar[NameRule] = NameRule("a PacScript name", 32, small=True)
    newline: ClassVar[str] = "\r\n"
    phrases: ClassVar[Phrases] = Phrases(
        remark="  ' {}",
        head=("  TakeArm Keep = 0", "  Speed {percent}"),
        move=("  Move P, @E J({joints})",),
        wait="  Delay {ms}",
        pulse=("  Set IO[{output}]", "  Delay {ms}", "  Reset IO[{output}]"),
        call="  Call {call}({argument})",
        keep="",
        most_output=4096,
    )
    reader = parse_denso_pac
    rules = check_denso_pac

    def lines(self, program: PoseProgram, arm: Arm, steps: list[str]) -> list[str]:
        """The routine that a program begins with."""
        call, argument = program.options.measure_call, program.options.measure_argument
        bare = call is not None and argument is None
        kept = [step.removesuffix("()") for step in steps] if bare else steps
        return ["Sub Main", *kept, "End Sub"]
