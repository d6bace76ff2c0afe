"""Faults of simulated measurements have to be named, and nothing where there is none."""

from collections import Counter
from typing import Any

import numpy as np
import pytest

from calib.identification.diagnosis import diagnose
from calib.identification.held import MODEL, tuned
from posedesign.identification.models import Models
from tests.fault_trials import (
    ARMS,
    FAULTS,
    MEASURED,
    draw_arm,
    makes_sense,
    noncentrality,
    table_of,
)

CASES = [(fault, kind) for fault in FAULTS for kind in MEASURED if makes_sense(fault, kind)]

SEEN = 14.9
"""Noncentrality from which chi² of the true fault has a power of 0.9 at a level of 0.01."""

SETS: dict[str, dict[str, Any]] = {"plain": {}, "noise": {"noise": 3.0}, "waves": {"waves": True}}


def named(fault: str, kind: str, seed: int) -> str:
    """``named``, ``other``, ``silent``, or ``unseen``: silent where nothing could be seen."""
    rng = np.random.default_rng([seed, CASES.index((fault, kind))])
    arm = draw_arm(ARMS[seed % len(ARMS)], kind, rng)
    data, wanted = FAULTS[fault](arm, np.random.default_rng([seed, 1]), rng)
    model = Models(arm.cell, table_of(arm, data)).of_arm()
    found = diagnose(model, data)
    causes = {each.cause for first in found[:1] for each in (first, *first.also)}
    if causes & set(wanted):
        return "named"
    if causes:
        return "other"
    bare = FAULTS[fault](arm, np.random.default_rng([seed, 1]), None)[0]
    usual = tuned(model, arm.measured(rng))
    assert usual is not None
    return "unseen" if noncentrality(arm, bare, usual.held) < SEEN else "silent"


@pytest.mark.slow
@pytest.mark.parametrize("trials", [1, pytest.param(10, marks=pytest.mark.full)])
def test_faults_are_named(trials):
    said = Counter(
        named(fault, kind, seed + 31 * k)
        for k, (fault, kind) in enumerate(CASES)
        for seed in range(trials)
    )
    seen = said.total() - said["unseen"]
    assert said["silent"] <= 0.02 * seen
    assert said["named"] >= 0.95 * seen


@pytest.mark.slow
@pytest.mark.parametrize("count", [12, pytest.param(108, marks=pytest.mark.full)])
def test_nothing_is_named_that_is_not_there(count):
    """With the noise as given, three times as large, and with what models leave out of an arm.

    Few trials measure each arm in each way once, many of them in each set-up.
    """
    false = trials = 0
    for seed in range(count):
        how = list(SETS)[seed // len(ARMS) % len(SETS)]
        for kind in MEASURED if count > 12 else (MEASURED[seed % len(MEASURED)],):
            trials += 1
            rng = np.random.default_rng([seed, 99, MEASURED.index(kind)])
            arm = draw_arm(ARMS[seed % len(ARMS)], kind, rng, **SETS[how])
            data = arm.measured(rng)
            found = diagnose(Models(arm.cell, table_of(arm, data)).of_arm(), data)
            false += any(finding.cause not in MODEL for finding in found)
            false += bool(found) and how == "plain"
    assert false <= 0.02 * trials
