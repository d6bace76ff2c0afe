"""Poses of the tool as FANUC stores them: which posture is meant where CONFIG does not fit."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from calib.errors import InputError, UnreachableError
from posedesign.programs import DIALECTS, Arm, ProgramPose, RecordedProgram, postures_of
from tests.unit.programs.dialects import arm_of, program_of

POSTURES = np.deg2rad([[0.0, 10, -20, 0, -60, 0], [5.0, 10, -20, 0, -60, 0]])
ARM: Arm = arm_of("fanuc-ls")
POSES = [ProgramPose(f"P{i}", q) for i, q in enumerate(POSTURES)]
(TEXT,) = DIALECTS["fanuc-ls"].files(program_of("fanuc-ls", POSES, form="cartesian")).values()


def parse(text: str) -> RecordedProgram:
    return DIALECTS["fanuc-ls"].parse(text.encode(), Path("X.LS"))


def test_a_pose_in_an_arm_position_that_cannot_take_it_is_named() -> None:
    head, tail = TEXT.split('P[2:"P1"]')
    with pytest.raises(UnreachableError, match=r"position 2 \(P1\): .* N U B, 0, 0, 0"):
        parse(f'{head}P[2:"P1"]{tail.replace("N U T", "N U B")}').postures(ARM)
    with pytest.raises(UnreachableError, match=r"position 1 \(P0\): no posture"):
        parse(re.sub(r"Z = +", "Z = 99", TEXT, count=1)).postures(ARM)


def test_without_a_configuration_the_plan_settles_which_posture_is_meant() -> None:
    positions = parse("\n".join(row.split("\t\tCONFIG")[0] for row in TEXT.split("\n"))).positions
    assert all(p.configuration is None for p in positions)
    with pytest.raises(InputError, match=r"position 1 \(P0\): \d+ postures take it"):
        postures_of(positions, ARM)
    found = postures_of(positions, ARM, POSTURES + np.deg2rad(0.5))
    np.testing.assert_allclose(found, POSTURES, atol=2e-3)
