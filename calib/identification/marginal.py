"""The marginal likelihood of a linearised problem: how likely measurements are, whatever x is.

Gaussian throughout, so in closed form, and its gradient too. Parameters that nothing is known of
are integrated out as well (restricted maximum likelihood: Patterson and Thompson, Biometrika 58,
1971; Harville, J. Am. Stat. Assoc. 72, 1977): a parameter that fits noise makes it no smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.errors import ConvergenceError
from calib.identification.least_squares import column_lengths
from calib.model import CalibrationModel
from calib.model.measurements import Measurements
from calib.se3 import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class LinearEvidence:
    """Marginal likelihood of a linearised problem, as a function of its standard deviations.

    Parameters are ``x = nominal + unit z``; rows of the class c over their noise, ``B_c z - y_c``,
    have the variance ``exp(2 t_c)``. Those of the last class have the variance 1: what is measured
    with noise that is given, and what is known besides.

    Attributes
    ----------
    nominal, unit : array (p,)
    pull : array (p,)
        ``unit`` over the standard deviation of each parameter, in units of that of its group.
    grams : array (C + 1, p + 1, p + 1)
        ``[B y]ᵀ[B y]`` of each class.
    counts : array (C,)
        Rows of each class but the last.
    members : tuple of array
        Columns of the parameters of each of G groups.
    constant : float
        What of the logarithm no standard deviation changes.
    """

    nominal: FloatArray
    unit: FloatArray
    pull: FloatArray
    grams: FloatArray
    counts: FloatArray
    members: tuple[IntArray, ...]
    constant: float

    def _solve(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Best parameters z ``(p,)``, their covariance ``(p, p)``, and half log of its inverse."""
        from scipy.linalg import cho_factor, cho_solve

        gram = np.einsum("c,cij->ij", self._precisions(theta), self.grams)
        H = gram[:-1, :-1].copy()
        for columns, log_sigma in zip(self.members, theta, strict=False):
            H[columns, columns] += self.pull[columns] ** 2 * np.exp(-2.0 * log_sigma)
        try:
            factor = cho_factor(H, lower=True)
        except np.linalg.LinAlgError:
            raise ConvergenceError(
                "sizes of priors cannot be found: at some of them rounding hides what the "
                "measurements tell",
                hint="give the noise of the measurements, or free fewer parameters",
            ) from None
        covariance = cho_solve(factor, np.eye(len(H)))
        half_log = float(np.log(np.diag(factor[0])).sum())
        return np.asarray(covariance @ gram[:-1, -1]), np.asarray(covariance), half_log

    def _precisions(self, theta: FloatArray) -> FloatArray:
        return np.append(np.exp(-2.0 * theta[len(self.members) :]), 1.0)

    def parameters(self, theta: FloatArray) -> FloatArray:
        """Likeliest parameters ``(p,)`` [SI]."""
        return np.asarray(self.nominal + self.unit * self._solve(theta)[0])

    def sensitivity(self, theta: FloatArray) -> FloatArray:
        """Derivatives ``(p, G + C)`` of the likeliest parameters [SI], see :meth:`log_evidence`.

        Of ``H z = b``, in closed form: differences would amplify the rounding of the solution.
        """
        z, covariance, _ = self._solve(theta)
        columns_of = []
        for g, columns in enumerate(self.members):
            pull = np.zeros(len(z))
            pull[columns] = 2.0 * (self.pull[columns] * np.exp(-theta[g])) ** 2 * z[columns]
            columns_of.append(pull)
        ends = np.append(z, -1.0)
        for gram, precision in zip(self.grams[:-1], self._precisions(theta), strict=False):
            columns_of.append(2.0 * precision * (gram[:-1] @ ends))
        moved = covariance @ np.array(columns_of).reshape(-1, len(z)).T
        return np.asarray(self.unit[:, None] * moved)

    def log_evidence(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """Logarithm of the marginal likelihood, and its gradient ``(G + C,)``.

        Parameters
        ----------
        theta : array (G + C,)
            Logarithms of the standard deviations of the groups [SI], then of the noise of the
            classes over what they start with.
        """
        z, covariance, half_log = self._solve(theta)
        ends = np.append(z, -1.0)
        squares = np.einsum("i,cij,j->c", ends, self.grams, ends)  # of the residuals of each class
        precisions = self._precisions(theta)
        value = self.constant - 0.5 * squares @ precisions - half_log
        gradient = np.empty_like(theta)
        for g, columns in enumerate(self.members):
            share = (self.pull[columns] * np.exp(-theta[g])) ** 2
            value -= 0.5 * share @ z[columns] ** 2 + len(columns) * theta[g]
            spread = z[columns] ** 2 + covariance[columns, columns]
            gradient[g] = share @ spread - len(columns)
        taken = np.einsum("ij,cij->c", covariance, self.grams[:-1, :-1, :-1])
        value -= self.counts @ theta[len(self.members) :]
        gradient[len(self.members) :] = precisions[:-1] * (squares[:-1] + taken) - self.counts
        return float(value), gradient


def linear_evidence(
    model: CalibrationModel,
    data: Measurements,
    x: FloatArray,
    members: Sequence[IntArray],
    weights: FloatArray,
) -> LinearEvidence:
    """Linearise at parameters ``(p,)``, with weights ``(N,)`` of the squares of measurements.

    Priors of the members of a group are in the proportions that the model has them in.
    """
    tied, shares = np.zeros(model.p, dtype=bool), np.ones(model.p)
    for columns in members:
        tied[columns] = True
        shares[columns] = proportions(model.prior[columns])
    fixed = model.with_prior(np.where(tied, np.inf, model.prior))
    linear = model.linearise(data.postures, x, data.setup, data.observed)
    weighed = linear.weighed(weights)
    rows, J = weighed.white_rows, weighed.white_jacobian
    known, K = fixed.known(x[None])
    unit = 1.0 / column_lengths(np.concatenate([J.reshape(-1, model.p), K[0]]))
    classes, counts = noise_classes(model, data), []
    there = _there(model, data)
    grams = np.zeros((len(classes) + 1, model.p + 1, model.p + 1))
    rest = there.copy()
    for c, own in enumerate(classes):
        grams[c] = _gram(rows[own], J[own], x - model.nominal, unit)
        counts.append(float(own.sum()))
        rest &= ~own
    grams[-1] = _gram(rows[rest], J[rest], x - model.nominal, unit)
    grams[-1] += _gram(known[0], K[0], x - model.nominal, unit)
    # densities of the rows as they were, before noise and weights divided them, and of what is
    # known besides
    sigma = np.ones(there.shape)
    for k, kind in enumerate(model.measurements):
        sigma[data.setup.kind == k, : kind.rows] = kind.sigma
    given = fixed.prior[np.isfinite(fixed.prior)]
    constant = float(
        np.log(np.sqrt(weights)[:, None] / sigma)[there].sum()
        + np.log(unit).sum()
        - np.log(given).sum()
    )
    constant -= float(np.log(shares).sum())
    constant -= sum(np.log(known.sigma_m) for known in model.distances)
    left = int(there.sum()) + known.shape[1] + int(tied.sum()) - model.p
    constant -= 0.5 * left * np.log(2.0 * np.pi)
    return LinearEvidence(
        model.nominal, unit, unit / shares, grams, np.array(counts), tuple(members), constant
    )


def proportions(prior: FloatArray) -> FloatArray:
    """Standard deviations of a group over their root mean square; equal where it has none."""
    if not np.isfinite(prior).all():
        return np.ones_like(prior)
    return np.asarray(prior / np.sqrt(np.mean(prior**2)))


def _gram(rows: FloatArray, J: FloatArray, moved: FloatArray, unit: FloatArray) -> FloatArray:
    """``[B y]ᵀ[B y]`` of rows (M,) with the derivative (M, p), off the nominal values by (p,)."""
    both = np.column_stack([J * unit, J @ moved - rows])
    return np.asarray(both.T @ both)


def _there(model: CalibrationModel, data: Measurements) -> BoolArray:
    """Rows ``(N, m)`` that measurements have, others fill the block."""
    if data.setup.seen is not None:
        return data.setup.seen
    return np.arange(model.rows) < model.rows_read(data.setup)[:, None]


def noise_classes(model: CalibrationModel, data: Measurements) -> list[BoolArray]:
    """Rows ``(N, m)`` of each noise to be found: of a kind, those that start with the same.

    Its lengths and its angles apart, and axes apart that were given different noise.
    """
    found = []
    for k, kind in enumerate(model.measurements):
        measured = data.setup.kind == k
        if not (kind.estimated and measured.any()):
            continue
        is_angle = np.arange(kind.rows) >= kind.rows - kind.turns
        alike = np.unique(np.column_stack([is_angle, kind.sigma]), axis=0, return_inverse=True)[1]
        for part in range(alike.max() + 1):
            own = np.zeros((data.count, model.rows), dtype=bool)
            own[np.ix_(measured, np.flatnonzero(alike.ravel() == part))] = True
            found.append(own)
    return found
