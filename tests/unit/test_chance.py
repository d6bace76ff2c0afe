"""Quantiles and tails against scipy.stats, whose import they spare."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from calib import chance

FREEDOM = np.array([1.0, 2.0, 3.0, 6.0, 17.0, 400.0])


@pytest.mark.parametrize("p", [1e-6, 0.001, 0.05, 0.5, 0.95, 0.9999])
def test_quantiles_are_those_of_scipy(p: float) -> None:
    np.testing.assert_allclose(chance.normal_quantile(p), stats.norm.ppf(p), rtol=1e-12)
    np.testing.assert_allclose(chance.chi2_quantile(p, FREEDOM), stats.chi2.ppf(p, FREEDOM))
    np.testing.assert_allclose(
        [chance.student_quantile(p, n) for n in FREEDOM], stats.t.ppf(p, FREEDOM), rtol=1e-9
    )
    np.testing.assert_allclose(chance.f_bound(p, 6.0, FREEDOM), stats.f.isf(p, 6.0, FREEDOM), 1e-8)


@pytest.mark.parametrize("value", [0.0, 0.3, 2.0, 40.0])
def test_tails_are_those_of_scipy(value: float) -> None:
    np.testing.assert_allclose(chance.normal_below(-value), stats.norm.cdf(-value), rtol=1e-12)
    np.testing.assert_allclose(chance.chi2_tail(value, FREEDOM), stats.chi2.sf(value, FREEDOM))
    np.testing.assert_allclose(chance.chi2_below(value, FREEDOM), stats.chi2.cdf(value, FREEDOM))
    for n in FREEDOM:
        np.testing.assert_allclose(chance.student_tail(value, n), stats.t.sf(value, n), rtol=1e-9)
        np.testing.assert_allclose(chance.f_tail(value, 3.0, n), stats.f.sf(value, 3.0, n), 1e-9)
    assert np.isnan(chance.chi2_tail(value, 0.0))
