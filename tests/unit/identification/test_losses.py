"""What robust losses cost in certainty, and noise that weights do not make smaller."""

from dataclasses import replace

import numpy as np
import pytest

from calib.errors import ConvergenceError, InputError
from calib.identification import robust
from calib.identification.identifiability import covariance_at
from calib.identification.robust import WEIGHTS, Solved, consistency, fit_robustly, variance_factor
from calib.model import Setup, simulate
from calib.model.measurements import Distance, Measurements, TouchUp
from calib.se3 import FloatArray
from tests.marks import rest_in_full

SIGMA_M = 2e-5
ROBUST = ["huber", "cauchy", "student-t"]
ALL = ["least-squares", *ROBUST]
COUNT, FREE = 25, 65  # touch-ups, and equations left over with the ten parameters of the model


def covariance(solved: Solved, data: Measurements) -> FloatArray:
    linear = solved.model.linearise(data.postures, solved.x, data.setup, data.observed)
    return covariance_at(replace(linear, root=np.sqrt(solved.weights / solved.inflation)))


@pytest.fixture(scope="module")
def trials(make_model, touching):
    """Many sets of touch-ups with Gaussian noise."""
    model = make_model(measurement=TouchUp(SIGMA_M))
    rng = np.random.default_rng(0)
    return model, simulate(model, model.nominal, touching(COUNT), rng, trials=200)


@pytest.mark.parametrize("rows", [1, 3, 6])
@pytest.mark.parametrize("loss", ROBUST)
def test_the_constants_are_those_of_gaussian_noise(loss, rows):
    """Against draws, and against the mean derivative of w r by differences."""
    draws, step = 100_000, 1e-4
    r = np.random.default_rng(rows).normal(size=(draws, rows))

    def psi(r: FloatArray) -> FloatArray:
        return WEIGHTS[loss](np.sum(r**2, axis=1), np.full(draws, rows))[:, None] * r

    ahead = np.eye(rows)[0] * step
    slope = (psi(r + ahead) - psi(r - ahead))[:, 0] / (2 * step)
    near = {"abs": 5 * np.std(slope) / np.sqrt(draws)}
    assert consistency(loss, rows) == pytest.approx(slope.mean(), **near)
    w = WEIGHTS[loss](np.sum(r**2, axis=1), np.full(draws, rows))
    expected = np.mean(psi(r) ** 2) * w.mean() / slope.mean() ** 2
    # the slope is the least certain of the three, and squared
    assert variance_factor(loss, rows) == pytest.approx(
        expected, rel=3 * near["abs"] / slope.mean()
    )


@pytest.mark.parametrize("share", [0.3, 1.0])
@pytest.mark.parametrize("loss", ["least-squares", "graduated"])
def test_full_weights_cost_nothing(loss, share):
    assert consistency(loss, 3, share) == pytest.approx(1.0, rel=1e-3)
    assert variance_factor(loss, 3, share) == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize("loss", ALL)
def test_the_noise_that_is_estimated_is_that_of_the_good_ones(make_model, trials, loss):
    _, data = trials
    unknown = make_model(measurement=TouchUp(None))
    used = 5
    found = [fit_robustly(unknown, data.trials(t), unknown.nominal, loss=loss) for t in range(used)]
    variance = np.mean([solved.model.measurement.sigma[0] ** 2 for solved in found])
    # four standard deviations of the mean of so many chi²
    assert variance / SIGMA_M**2 == pytest.approx(1.0, abs=4 * np.sqrt(2 / (FREE * used)))


@pytest.mark.slow
@pytest.mark.parametrize("estimated", [False, True])
@pytest.mark.parametrize("loss", rest_in_full(ALL, ("huber",)))
def test_errors_are_as_large_as_the_covariance_says(make_model, trials, loss, estimated):
    truth, data = trials
    model = make_model(measurement=TouchUp(None if estimated else SIGMA_M))
    p, count = model.p, len(data.postures)
    squares = []
    for t in range(count):
        solved = fit_robustly(model, data.trials(t), truth.nominal, loss=loss)
        off = solved.x - truth.nominal
        squares.append(off @ np.linalg.solve(covariance(solved, data.trials(t)), off))
    mean = p * FREE / (FREE - 2) if estimated else p  # of Hotelling's distribution, or of chi²
    assert np.mean(squares) == pytest.approx(mean, abs=4 * np.sqrt(2 * p / count))


@pytest.mark.parametrize("loss", ALL)
def test_a_noise_that_one_measurement_cannot_show_is_asked_for(make_model, touching, loss):
    truth = make_model(measurement=[TouchUp(SIGMA_M), Distance(5e-3)])
    setup = Setup.of(13, kind=[0] * 12 + [1])
    x = truth.nominal.copy()
    data = simulate(truth, x, touching(13), np.random.default_rng(0), setup=setup)
    unknown = truth.with_measurements([TouchUp(SIGMA_M), Distance(None)])
    with pytest.raises(InputError, match="noise of the kind distance cannot be estimated from 1 m"):
        fit_robustly(unknown, data, x, loss=loss)
    # nothing is asked of a kind that nothing was measured with
    alone = simulate(truth, x, touching(12), np.random.default_rng(0), setup=setup[:12])
    fit_robustly(unknown, alone, x, loss=loss)


@pytest.mark.parametrize("loss", ROBUST)
def test_weights_that_do_not_come_to_rest_are_an_error(make_model, trials, loss, monkeypatch):
    model, data = trials
    q = data.postures[0].copy()
    q[7, 1] += 0.01
    spoilt = replace(data.trials(0), postures=q)
    monkeypatch.setattr(robust, "_ROUNDS", 1)
    with pytest.raises(ConvergenceError, match="have not come to rest after 1 rounds"):
        fit_robustly(model, spoilt, model.nominal, loss=loss)


@pytest.mark.parametrize("estimated", [False, True])
@pytest.mark.parametrize("loss", ROBUST)
def test_a_gross_error_is_named_by_every_loss_that_weighs_down(make_model, trials, loss, estimated):
    _, data = trials
    model = make_model(measurement=TouchUp(None if estimated else SIGMA_M))
    clean = data.trials(0)
    q = clean.postures.copy()
    q[7, 1] += 0.01
    solved = fit_robustly(model, replace(clean, postures=q), model.nominal, loss=loss)
    assert np.flatnonzero(solved.suspects).tolist() == [7]
    assert not solved.outliers.any()
    assert not fit_robustly(model, clean, model.nominal, loss=loss).suspects.any()


def test_what_is_left_out_is_no_suspect(make_model, trials):
    model, data = trials
    q = data.postures[0].copy()
    q[7, 1] += 0.01
    spoilt = replace(data.trials(0), postures=q)
    solved = fit_robustly(model, spoilt, model.nominal, loss="graduated")
    assert np.flatnonzero(solved.outliers).tolist() == [7]
    assert not solved.suspects.any()
