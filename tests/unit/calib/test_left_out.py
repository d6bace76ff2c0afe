"""Targets left out: no measurement has a say in its own prediction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib import CalibrationModel, identify
from calib.identification.comparison import Candidate, compare
from calib.identification.least_squares import minimise
from calib.identification.left_out import free_points, targets_left_out
from calib.model.measurements import Setup, TouchUp
from calib.model.measurements.simulate import simulate
from calib.model.parameters import TargetPoints

NOISE_M = 1e-4


def test_places_are_fitted_to_other_poses_by_the_noise(touching, make_model) -> None:
    """Axes of unlike noise, weights, a pose touched twice: as refits of the place without it."""
    kind = TouchUp([1e-4, 2e-4, 5e-4])
    truth = make_model((2, 3, 4, 5), kind, targets=3)
    shifts = [np.array([0.0, 0.3, 0.4]) * k for k in range(3)]
    q = np.vstack([touching(7, seed=k, shift=shift) for k, shift in enumerate(shifts)])
    setup = Setup.of(21, target=np.repeat(np.arange(3), 7))
    data = simulate(truth, truth.nominal, q, np.random.default_rng(0), setup=setup)
    data = replace(data, names=tuple(f"P{max(i, 1)}" for i in range(21)))
    fitted = identify(truth, data)
    result = replace(fitted, weights=np.random.default_rng(1).uniform(0.1, 1.0, 21))
    found = targets_left_out(truth, data, result)
    place = free_points(truth, data)[0]
    assert place.sum() == 3
    start = fitted.values[None]
    others = minimise(
        truth, data.trials(None), start, weights=(result.weights * (data.target != 0))[None]
    ).x
    for pose in (0, 3):
        own = np.flatnonzero(data.pose == pose)
        rest = result.weights * (data.target == 0) * (data.pose != pose)
        x = minimise(truth, data.trials(None), others, weights=rest[None], free=place).x[0]
        rows = truth.linearise(data.postures[own], x, data.setup[own]).rows
        np.testing.assert_allclose(found[own], rows, rtol=1e-4, atol=1e-9)


def test_a_target_touched_once_says_nothing(touching, make_model, target_m) -> None:
    """Fourteen touches at one target and one at each of five: once all errors came out as zero."""
    each = (14, 1, 1, 1, 1, 1)
    shifts = np.array([0.0, 0.06, 0.08]) * np.arange(6)[:, None]
    places = TargetPoints(target_m + shifts, tuple("ABCDEF"))
    frames, truth = (
        CalibrationModel(m.robot, [*m.parameters[:-1], places], TouchUp(NOISE_M))
        for m in (make_model((), TouchUp(NOISE_M)), make_model((2, 3, 4, 5), TouchUp(NOISE_M)))
    )
    x = truth.nominal.copy()
    x[:4] = [10e-3, -10e-3, 8e-3, 15e-3]
    q = np.vstack([touching(n, seed=k, shift=shifts[k]) for k, n in enumerate(each)])
    setup = Setup.of(19, target=np.repeat(np.arange(6), each))
    data = simulate(truth, x, q, np.random.default_rng(0), setup=setup)
    found = compare([Candidate("frames only", frames), Candidate("offsets", truth)], data)
    assert np.isnan(found.trials[0].target_out_m[14:]).all()
    assert found.criterion == "leave-one-out"
    assert found.recommended == "offsets"
    assert "of 19 measurements can be predicted with their target left out" in found.reason
