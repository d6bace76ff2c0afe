"""The judgement of findings: how often a finding may be false, and how loud it is said.

A finding is a cause that a detector names for residuals: a target that was moved, a wrong scale, a
joint that counts the other way. Every detector states its null hypothesis, under which it has to
stay silent. The detectors of one command together raise a false alarm in at most
:data:`FALSE_ALARMS` of the sets for which all null hypotheses hold. The rate is measured on
placebos, see the page "Findings" of the documentation.

The grade of a finding is decided by its effect on the answer, not by its significance. The effect
is the change of the answer when the cause is taken into account, in standard deviations of the
answer.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

FALSE_ALARMS = 1 / 200
"""Largest share of sets without any fault for which one command names a cause."""

Grade = Literal["note", "warning", "not to be trusted"]
"""Loudness of a finding. Only the last grade makes a command exit with 1 and withhold its files."""

WARNING_SIGMAS = 1.0
"""Change of the answer, in its standard deviations, from which a finding is a warning."""

DISTRUST_SIGMAS = 3.0
"""Change of the answer, in its standard deviations, from which the answer is not to be trusted.
The 95 % interval of the answer then excludes the value with the cause taken into account."""


def grade_of(sigmas: float) -> Grade:
    """Return the grade of a finding that changes the answer by so many standard deviations.

    A change that is not known (NaN) counts as large.
    """
    if sigmas < WARNING_SIGMAS:
        return "note"
    return "warning" if sigmas < DISTRUST_SIGMAS else "not to be trusted"


@dataclass(frozen=True)
class Finding:
    """A cause that a detector names, and its effect on the answer."""

    text: str
    sigmas: float
    """Change of the answer when the cause is taken into account, in its standard deviations."""
    is_accounted: bool = field(default=False, kw_only=True)
    """True where the answer takes the cause into account: it is then no reason to distrust it."""

    @property
    def grade(self) -> Grade:
        """Loudness of the finding."""
        return "warning" if self.is_accounted else grade_of(self.sigmas)


def level_of_each(detectors: int) -> float:
    """Return the significance level of each of so many detectors of one command.

    By Bonferroni's inequality all of them together keep :data:`FALSE_ALARMS`.
    """
    return FALSE_ALARMS / max(detectors, 1)
