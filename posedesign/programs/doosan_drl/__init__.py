"""Doosan DRL programs, which are Python.

A file ``NAME.drl``: a ``movej`` to each position, which stands in it. The measuring call is defined
in the program: as written it asks the operator on the pendant whether the tool is at its target,
and logs the joint values then shown; put another body there to trigger an instrument. Touched-up
positions are typed into the moves, or taught into them in the pendant's editor: the language keeps
none. Speeds are percents of the slowest joint's. Nothing was loaded on a controller.
"""

from __future__ import annotations

from typing import ClassVar

from posedesign.programs.arm import Arm
from posedesign.programs.doosan_drl.reader import parse_doosan_drl
from posedesign.programs.doosan_drl.rules import FUNCTIONS, WORDS, check_doosan_drl
from posedesign.programs.joint_programs import JointDialect, Phrases
from posedesign.programs.program import PoseProgram
from posedesign.programs.writing import NameRule

__all__ = ["DoosanDrl"]


class DoosanDrl(JointDialect):
    """Programs of Doosan arms."""

    name: ClassVar[str] = "doosan-drl"
    title: ClassVar[str] = "Doosan DRL program"
    maker: ClassVar[str | None] = "doosan"
    suffixes: ClassVar[tuple[str, ...]] = (".drl",)
    names: ClassVar[NameRule] = NameRule(
        "a DRL name",
        32,
        small=True,
        reserved=frozenset(map(str.upper, [*FUNCTIONS, *WORDS.split()])),
    )
    phrases: ClassVar[Phrases] = Phrases(
        remark="# {}",
        head=(),
        move=("movej(posj({joints}), vel={speed}, acc={speed})", "mwait()"),
        wait="wait({time})",
        pulse=(
            "set_digital_output({output}, ON)",
            "wait({time})",
            "set_digital_output({output}, OFF)",
        ),
        call="{call}({argument})",
        keep="",
        most_output=16,
    )
    reader = parse_doosan_drl
    rules = check_doosan_drl

    def lines(self, program: PoseProgram, arm: Arm, steps: list[str]) -> list[str]:
        """The measuring call, and the steps."""
        measuring = (
            f"def {program.options.measure_call}(number=0):",
            f'    tp_popup("{program.options.question} Pose " + str(number))',
            '    tp_log("POSE " + str(number) + " q=" + str(get_current_posj()))',
        )
        return [*(measuring if program.options.measure_call else ()), *steps]
