"""Errors of the arm beside camera and board: how large they are, found from the pictures.

An arm whose joints have zero offsets, or whose links are not as described, leaves a pattern in the
pictures that a new deviation at each stop explains badly. Everything that may be off on the arm is
a parameter with a prior. Parameters of a kind share one size. The sizes and the deviation of the
arm from stop to stop are components of variance: they are those for which the pictures are
likeliest, whatever camera, board, lens and errors are (restricted maximum likelihood, as in
:mod:`calib.identification.deviations`, and empirical Bayes, as in
:mod:`calib.identification.evidence`). A size is log-normal about that of arms which were measured.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri

from calib.errors import ConvergenceError
from calib.identification.deviations import LEAST_ARM, Deviations
from calib.identification.evidence import groups_of
from calib.identification.prior_arms import UsualSize
from calib.model import CalibrationModel
from calib.model.parameters import ParameterBlock
from calib.se3 import FloatArray, IntArray

_MOST_ARM = (0.05, 0.05)
"""Largest deviation of an arm [m, rad]."""

_WITHIN = 5.0
"""Standard deviations of the logarithm of a size within which it is looked for."""


@dataclass(frozen=True, eq=False)
class ArmErrors:
    """Everything that may be off on an arm."""

    blocks: Sequence[ParameterBlock]  # with priors
    usual: Mapping[str, UsualSize]
    """Sizes on arms that were measured, by the names of :func:`groups_of`. Kinds of error that are
    not listed keep their priors."""


@dataclass(frozen=True, eq=False)
class Sizes:
    """Components of variance of a model: two of the deviation, one for each kind of error."""

    model: CalibrationModel  # with the priors that sizes are shares of
    names: tuple[str, ...]  # of the G kinds of error
    members: tuple[IntArray, ...]  # columns of each
    usual: tuple[UsualSize, ...]

    @classmethod
    def of(cls, model: CalibrationModel, arm: ArmErrors | None) -> Sizes:
        """Return the components of a model that frees the errors of an arm."""
        found = [] if arm is None else groups_of(model, 1.0, 1.0)
        kinds = [group for group in found if arm is not None and group.name in arm.usual]
        members = [np.array([model.names.index(n) for n in one.parameters]) for one in kinds]
        usual = [arm.usual[one.name] for one in kinds if arm is not None]
        return cls(model, tuple(one.name for one in kinds), tuple(members), tuple(usual))

    @cached_property
    def sized(self) -> IntArray:
        """Columns of all parameters whose size is to be found."""
        return np.concatenate([np.zeros(0, dtype=np.intp), *self.members])

    @cached_property
    def centre(self) -> FloatArray:
        """Logarithms ``(G,)`` of the usual sizes, as shares of the priors."""
        return np.log([size.share for size in self.usual])

    @cached_property
    def within(self) -> FloatArray:
        """Standard deviations ``(G,)`` of the logarithms of the sizes over arms."""
        return np.array([size.log_sd for size in self.usual])

    def prior(self, log_share: FloatArray) -> FloatArray:
        """Return the standard deviations ``(p,)`` of all parameters [SI]."""
        prior = self.model.prior.copy()
        for own, log in zip(self.members, log_share, strict=True):
            prior[own] *= np.exp(log)
        return prior

    def without(self) -> IntArray:
        """Return the columns of what is estimated without the errors of the arm."""
        return np.setdiff1d(np.arange(self.model.p), self.sized)

    def unlikely(
        self, parts: Deviations, x: FloatArray, theta: FloatArray, *, alone: bool = False
    ) -> tuple[float, FloatArray]:
        """Return minus twice the logarithm of the restricted likelihood, and its slope.

        Parameters
        ----------
        parts : Deviations
            At the parameters x ``(p,)``.
        theta : array (2 + G,)
            Logarithms of the deviation [m, rad] and of the sizes, as shares of the priors.
        alone : bool
            Without the errors of the arm: ``theta`` is that of the deviation.
        """
        old, new = self.without(), self.sized
        columns = old if alone else np.arange(self.model.p)
        H = parts.by_parameters[..., columns]
        M, k, p = H.shape
        part = np.repeat(np.eye(2), 3, axis=0)[:k]
        variance = np.exp(2.0 * theta[:2])
        V = parts.covariance + np.diag(part @ variance)
        # by a root of V: of an arm that hardly stops off its inverse has few digits
        root = np.linalg.cholesky(V)
        both = np.concatenate(
            [H, parts.off[..., None], np.broadcast_to(np.eye(k), V.shape)], axis=2
        )
        white = np.linalg.solve(root, both)
        J, y, inverse_root = (
            white[..., :p].reshape(M * k, p),
            white[..., p].ravel(),
            white[..., -k:],
        )
        within = parts.within_blocks.sum(axis=0)
        known, right = parts.known_block.copy(), parts.known_right.copy()
        known[new], known[:, new], right[new] = 0.0, 0.0, 0.0
        A = J.T @ J + (within + known)[np.ix_(columns, columns)]
        b = y @ J + (parts.within_right.sum(axis=0) + right)[columns]
        value, log_sigma = 0.0, np.zeros(0)
        off, precision = np.zeros(0), np.zeros(0)
        if not alone and len(new):
            sigma = self.prior(theta[2:])[new]
            log_sigma, precision = np.log(sigma), 1.0 / sigma**2
            off = (x - self.model.nominal)[new]
            A[new, new] += precision
            b[new] += off * precision
            value = float(2.0 * log_sigma.sum() + np.sum(off**2 * precision))
        unit = np.sqrt(np.diag(A))
        factor, failed = dpotrf(A / np.outer(unit, unit))
        if failed:
            raise ConvergenceError(
                "the pictures do not tell camera and board from the errors of the arm"
            )
        upper = np.triu(dpotri(factor)[0])
        C = (upper + np.triu(upper, 1).T) / np.outer(unit, unit)
        step = -C @ b
        value += float(y @ y + b @ step)
        value += 2.0 * float(np.log(np.diagonal(root, axis1=1, axis2=2)).sum())
        value += 2.0 * float(np.log(np.diag(factor)).sum() + np.log(unit).sum())
        # what V⁻¹ and its projection take of each component: squares of the rows of V^(-1/2)
        left = np.einsum("mji,mj->mi", inverse_root, (y + J @ step).reshape(M, k)).ravel()
        taken = np.swapaxes(inverse_root, 1, 2) @ J.reshape(M, k, p)
        own = np.sum(inverse_root**2, axis=1).ravel() - left**2
        taken = taken.reshape(M * k, p)
        own = own - np.sum((taken @ C) * taken, axis=1)
        slope = [*(2.0 * variance * (own.reshape(M, k).sum(axis=0) @ part))]
        if len(off):
            squares = np.zeros(self.model.p)
            squares[new] = ((off + step[new]) ** 2 + np.diag(C)[new]) * precision
            slope += [2.0 * (len(m) - squares[m].sum()) for m in self.members]
            far = (theta[2:] - self.centre) / self.within
            value += float(far @ far)
            slope = [*slope[:2], *(np.array(slope[2:]) + 2.0 * far / self.within)]
        return value, np.array(slope)

    def likeliest(
        self,
        parts: Deviations,
        x: FloatArray,
        theta: FloatArray,
        *,
        arm_known: bool = False,
        alone: bool = False,
    ) -> tuple[FloatArray, float]:
        """Return the likeliest components, from some to start from, and their :meth:`unlikely`.

        ``arm_known``: the deviation of the arm is given.
        """
        from scipy.optimize import minimize

        theta = theta[:2] if alone else theta
        low, high = np.log(LEAST_ARM), np.log(_MOST_ARM)
        if arm_known:
            low = high = theta[:2]
        if not alone:
            low = np.append(low, self.centre - _WITHIN * self.within)
            high = np.append(high, self.centre + _WITHIN * self.within)
        counts = [6.0 * len(parts.off) / 2.0] * 2 + [len(own) for own in self.members]
        unit = 1.0 / np.sqrt(2.0 * np.array(counts[: len(theta)]))

        def asked(t: FloatArray) -> tuple[float, FloatArray]:
            value, slope = self.unlikely(parts, x, t * unit, alone=alone)
            return value, slope * unit

        found = minimize(
            asked,
            np.clip(theta, low, high) / unit,
            jac=True,
            method="L-BFGS-B",
            bounds=list(zip(low / unit, high / unit, strict=True)),
            options={"maxiter": 200, "ftol": 1e-10, "gtol": 1e-4},
        )
        return np.clip(found.x * unit, low, high), float(found.fun)
