"""Kawasaki AS programs.

A file ``NAME.as`` as controllers save and load it: the program, then its positions ``#NAME.p[1]``,
``#NAME.p[2]``, ... ``BREAK`` behind every move has the arm stop there, also where it passes only.
Touched-up positions are taught into ``#NAME.p[n]``; or, with ``keep = "register"``, ``HERE`` stores
them in ``#NAME.m[n]`` behind the call. Nothing was loaded on a controller.
"""

from __future__ import annotations

from typing import ClassVar

from posedesign.programs.arm import Arm
from posedesign.programs.joint_programs import JointDialect, Phrases
from posedesign.programs.kawasaki_as.reader import parse_kawasaki_as
from posedesign.programs.kawasaki_as.rules import check_kawasaki_as
from posedesign.programs.program import PoseProgram
from posedesign.programs.writing import NameRule, plain_all, shown_deg

__all__ = ["KawasakiAs"]


class KawasakiAs(JointDialect):
    """Programs of Kawasaki arms with their joint positions."""

    name: ClassVar[str] = "kawasaki-as"
    title: ClassVar[str] = "Kawasaki AS program"
    maker: ClassVar[str | None] = "kawasaki"
    suffixes: ClassVar[tuple[str, ...]] = (".as", ".pg")
    # names of variables have at most 15 characters, two of which are ".p"; case does not matter
    names: ClassVar[NameRule] = NameRule("a name of an AS program", 13, small=True)
    newline: ClassVar[str] = "\r\n"
    phrases: ClassVar[Phrases] = Phrases(
        remark="  ; {}",
        head=("  SPEED {percent} ALWAYS",),
        move=("  JMOVE #{name}.p[{number}]", "  BREAK"),
        wait="  TWAIT {time}",
        pulse=("  PULSE {output},{time}", "  TWAIT {time}"),  # a pulse does not hold the program up
        call="  CALL {call}({argument})",
        keep="  HERE #{name}.m[{register}]",
        most_output=999,  # inputs are numbered from 1001
    )
    reader = parse_kawasaki_as
    rules = check_kawasaki_as

    def lines(self, program: PoseProgram, arm: Arm, steps: list[str]) -> list[str]:
        """The program, and its positions."""
        rows = zip(program.numbers, shown_deg(arm, program.poses), strict=True)
        listed = [f"#{program.name}.p[{n}] {' '.join(plain_all(row, 6))}" for n, row in rows]
        return [f".PROGRAM {program.name}()", *steps, ".END", ".JOINTS", *listed, ".END"]
