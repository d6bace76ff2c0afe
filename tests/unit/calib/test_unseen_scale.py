"""What an identification says of the scale of all lengths."""

from __future__ import annotations

import numpy as np
import pytest

from calib import CalibrationModel, Robot, identify, se3
from calib.identification.report import unseen_scale
from calib.model.context import Setup
from calib.model.measurements import Measurement, Point, TouchUp
from calib.model.measurements.simulate import simulate
from calib.model.parameters import LinkGeometry, TargetPoints, ToolPoint, ZeroOffsets
from calib.model.priors import KnownDistance

ROBOT = Robot.preset("panda")  # its flange is 107 mm off the last joint: no link, and no tool
POSTURE = np.deg2rad([0.0, -30.0, 10.0, -130.0, 20.0, 100.0, 30.0])
BALL_M = np.array([0.02, 0.01, 0.1])
APART_M = 0.2


def model_of(kind: Measurement, *, links: bool, distances: tuple[KnownDistance, ...] = ()):
    place = se3.apply(ROBOT.fk(POSTURE), BALL_M)
    places = [place, place + np.array([0.0, APART_M, 0.0])]
    blocks = [ZeroOffsets(ROBOT, ROBOT.joint_names[1:6], 1e-2)]
    if links:
        blocks.append(LinkGeometry(ROBOT, prior_m=1e-3, prior_rad=2e-3))
    blocks += [ToolPoint(BALL_M), TargetPoints(places, ["a", "b"])]
    return CalibrationModel(ROBOT, blocks, kind, distances)


def scale_of(model: CalibrationModel) -> tuple[float, bool]:
    """What the linearisation leaves open, and whether the result says so."""
    rng = np.random.default_rng(0)
    q = POSTURE + rng.uniform(-0.35, 0.35, (40, ROBOT.n))
    setup = Setup.of(40, target=[0, 1] * 20)
    data = simulate(model, model.nominal, q, rng, setup=setup)
    result = identify(model, data)
    linear = model.linearise(data.postures, result.values, setup, data.observed)
    return unseen_scale(linear, result.values), any("the scale of" in n for n in result.notes)


def test_touch_ups_say_nothing_of_it() -> None:
    share, said = scale_of(model_of(TouchUp(1e-4), links=True))
    assert share > 1.0
    assert said


def test_links_that_are_held_carry_it() -> None:
    assert scale_of(model_of(TouchUp(1e-4), links=False)) == (0.0, False)


@pytest.mark.parametrize("sigma_m", [1e-4, 2e-3])
def test_a_known_distance_shows_it(sigma_m: float) -> None:
    """As well as it is known, and as both targets are touched twenty times each."""
    known = KnownDistance("a", "b", APART_M, sigma_m)
    share, said = scale_of(model_of(TouchUp(1e-4), links=True, distances=(known,)))
    expected = np.sqrt(sigma_m**2 + 2 * 1e-4**2 / 20) / APART_M
    assert share == pytest.approx(expected, rel=0.02)
    assert said == (sigma_m > 1e-3)


def test_an_instrument_shows_it() -> None:
    share, said = scale_of(model_of(Point(1e-4), links=True))
    assert share < 2e-4
    assert not said
