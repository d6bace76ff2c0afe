"""Mitsubishi MELFA-BASIC V and VI programs, of joint positions.

A file ``NAME.mb5`` of numbered steps, with the positions J1, J2, ... in a list behind them, as RT
ToolBox saves them. Touched-up positions are taught into J1, J2, ... themselves. Nothing was loaded
on a controller, and poses are not written: structure flags are not known well enough.
"""

from __future__ import annotations

from dataclasses import replace

from calib.errors import InputError
from posedesign.programs.arm import Arm
from posedesign.programs.joint_programs import JointDialect, Phrases
from posedesign.programs.mitsubishi_melfa.reader import parse_mitsubishi_melfa
from posedesign.programs.mitsubishi_melfa.rules import check_mitsubishi_melfa
from posedesign.programs.program import PoseProgram
from posedesign.programs.writing import NameRule, plain_all, shown_deg

__all__ = ["MitsubishiMelfa"]

SIGNS = "signs of the joints, which are those of the robot's description"


class MitsubishiMelfa(JointDialect):
    """Programs of MELFA arms; joints are those of the description, whatever the pendant shows."""

    name = "mitsubishi-melfa"
    title = "Mitsubishi MELFA-BASIC program"
    maker = None
    suffixes = (".mb5", ".mb6")
    names = NameRule("a MELFA program name", 12)
    newline = "\r\n"
    phrases = Phrases(
        remark="'{}",
        head=("Servo On", "Cnt 0", "JOvrd {percent}"),
        move=("Mov J{number}",),
        wait="Dly {time}",
        pulse=("M_Out({output})=1 Dly {time}",),
        call='CallP "{call}",{argument}',
        keep="",
        most_output=4096,
    )
    reader = parse_mitsubishi_melfa
    rules = check_mitsubishi_melfa

    def most_poses(self, program: PoseProgram) -> int | None:
        return 3000  # of eight steps, of 32,767

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        """The file. It says that nobody has compared the signs of the joints."""
        if arm.n > 8:
            raise InputError("a joint position has at most 8 values", name="poses", value=arm.n)
        return super().render(replace(program, not_checked=(*program.not_checked, SIGNS)), arm)

    def lines(self, program: PoseProgram, arm: Arm, steps: list[str]) -> list[str]:
        """Numbered steps, and the positions behind them."""
        rows = zip(program.numbers, shown_deg(arm, program.poses), strict=True)
        listed = [f"J{number}=({','.join(plain_all(row, 5))})" for number, row in rows]
        # a call without an argument has no comma
        said = [step.removesuffix(",") if step[0] == "C" else step for step in steps]
        return [f"{k} {step}" for k, step in enumerate([*said, "End"], start=1)] + listed
