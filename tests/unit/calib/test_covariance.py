"""Predicted covariance against the scatter of simulated identifications."""

from __future__ import annotations

import numpy as np
import pytest

from calib.identification import covariance_of, identify_batch
from calib.model.measurements import TouchUp, ViewLine
from calib.model.measurements.simulate import simulate

TRIALS = 600


@pytest.mark.parametrize("kind", ["touch-up", "view line"])
@pytest.mark.parametrize("weighted", [True, False])
def test_covariance_is_the_scatter_of_the_estimates(make_model, touching, kind, weighted):
    model = make_model()
    if kind == "view line":
        model = make_model(measurement=ViewLine([1e-5, 4e-5]), free="xy")
    q = touching(20, tilt=0.8)
    x = model.nominal.copy()
    x[:4] = np.deg2rad([0.2, -0.3, 0.1, 0.2])
    clean = simulate(model, x, q)
    data = simulate(model, x, q, np.random.default_rng(0), trials=TRIALS)
    estimates = identify_batch(model, data, weighted=weighted)
    predicted = covariance_of(model, clean.postures, x, weighted=weighted)
    # in axes in which the prediction is the unit matrix, every direction is tested alike
    root = np.linalg.cholesky(predicted)
    white = np.linalg.solve(root, (estimates - x).T).T
    np.testing.assert_allclose(white.mean(axis=0), 0.0, atol=5 / np.sqrt(TRIALS))
    scatter = np.cov(white.T)
    np.testing.assert_allclose(np.diag(scatter), 1.0, atol=5 * np.sqrt(2 / TRIALS))
    off = scatter - np.diag(np.diag(scatter))
    np.testing.assert_allclose(off, 0.0, atol=5 / np.sqrt(TRIALS))


def test_weighting_by_the_noise_is_never_worse(make_model, touching):
    model, q = make_model(), touching(20)
    gain = covariance_of(model, q, weighted=False) - covariance_of(model, q)
    sigma = np.sqrt(np.diag(covariance_of(model, q)))
    assert np.linalg.eigvalsh(gain / np.outer(sigma, sigma)).min() > -1e-6


def test_covariance_scales_with_the_noise_and_the_number_of_rounds(make_model, touching):
    q = touching(12)
    once = covariance_of(make_model(measurement=TouchUp(1e-5)), q)
    louder = covariance_of(make_model(measurement=TouchUp(3e-5)), q)
    twice = covariance_of(make_model(measurement=TouchUp(1e-5)), np.concatenate([q, q]))
    np.testing.assert_allclose(louder, 9 * once, rtol=1e-6)
    np.testing.assert_allclose(twice, once / 2, rtol=1e-6)
    # equal noise in all rows: weighting changes nothing
    plain = covariance_of(make_model(measurement=TouchUp(1e-5)), q, weighted=False)
    np.testing.assert_allclose(plain, once, rtol=1e-6)
