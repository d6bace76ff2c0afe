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
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag
from scipy.linalg.lapack import dpotrf, dpotri

from calib.errors import ConvergenceError
from calib.identification.deviations import LEAST_ARM, Deviations
from calib.identification.evidence import groups_of
from calib.identification.prior_arms import UsualSize
from calib.model import CalibrationModel
from calib.model.parameters import ParameterBlock
from calib.se3 import BoolArray, FloatArray, IntArray, rotation_log

_MOST_ARM = (0.05, 0.05)
"""Largest deviation of an arm [m, rad]."""

_WITHIN = 3.0
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

    def prior(self, log_share: FloatArray) -> FloatArray:
        """Return the standard deviations ``(p,)`` of all parameters [SI]."""
        prior = self.model.prior.copy()
        for own, log in zip(self.members, log_share, strict=True):
            prior[own] *= np.exp(log)
        return prior

    @cached_property
    def without(self) -> IntArray:
        """Columns of what is estimated without the errors of the arm."""
        return np.setdiff1d(np.arange(self.model.p), self.sized)

    def kinds(self, x: FloatArray) -> Kinds:
        """Return the kinds of error at parameters ``(p,)``."""
        log_prior = np.zeros(self.model.p)
        log_prior[self.sized] = np.log(self.model.prior[self.sized])
        within = np.array([size.log_sd for size in self.usual])
        return Kinds(self.members, log_prior, x - self.model.nominal, self.centre, within)


@dataclass(frozen=True, eq=False)
class Kinds:
    """G kinds of parameters, each with a size that is to be found."""

    members: Sequence[IntArray]  # columns of each
    log_prior: FloatArray  # (p,): logarithms of the standard deviations that sizes are shares of
    off: FloatArray  # (p,): parameters less their nominal values
    centre: FloatArray
    within: FloatArray
    """centre, within (G,): mean and standard deviation of the logarithm of a size."""


NO_KINDS = Kinds((), np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0))
"""Nothing but the deviation of the arm."""


def some_columns(parts: Deviations, columns: IntArray) -> Deviations:
    """Return the deviations by some of the parameters."""
    return replace(
        parts,
        by_parameters=parts.by_parameters[..., columns],
        left_jacobian=parts.left_jacobian[..., columns],
        known_block=parts.known_block[np.ix_(columns, columns)],
        known_right=parts.known_right[columns],
    )


def with_move(parts: Deviations, own: IntArray, behind: BoolArray) -> Deviations:
    """Return the deviations by a camera or a board, too, that was moved between two stops.

    Parameters
    ----------
    own : array (6,)
        Columns of its position and rotation.
    behind : array (M,) of bool
        Stops after the move.
    """
    H = np.where(behind[:, None, None], parts.by_parameters[..., own], 0.0)
    return _with_columns(parts, H, np.repeat(_MOVED, 3) ** -2.0)


_MOVED = np.array([3e-3, 5e-3])
"""Size of a move [m, rad]: what is moved farther is left out, or refused."""


def with_pattern(parts: Deviations, flange: FloatArray) -> tuple[Deviations, Kinds]:
    """Return the deviations by a pattern of the pose, too, and its sizes.

    The errors of an arm whose joints nobody gave: shift and turn of the tip change linearly with
    the pose of the flange.

    Parameters
    ----------
    flange : array (N, 4, 4)
        Its pose at each picture [m].
    """
    M, k, p = parts.by_parameters.shape
    T = flange[np.unique(parts.stops, return_index=True)[1]]
    pose = np.concatenate(
        [T[:, :3, 3], rotation_log(T[:1, :3, :3].swapaxes(1, 2) @ T[:, :3, :3])], 1
    )
    pose = (pose - pose.mean(axis=0)) / np.maximum(pose.std(axis=0), np.finfo(float).tiny)
    H = np.einsum("ij,mc->mijc", np.eye(k), pose).reshape(M, k, -1)
    n = H.shape[2]
    shift = np.arange(n) < n // 2
    members = [p + np.flatnonzero(shift), p + np.flatnonzero(~shift)]
    m, rad = np.log(_PATTERN).tolist()
    log_prior = np.append(np.zeros(p), np.where(shift, m, rad))
    kinds = Kinds(members, log_prior, np.zeros(p + n), np.zeros(2), np.full(2, _PATTERN_WITHIN))
    return _with_columns(parts, H, np.ones(n)), kinds


_PATTERN, _PATTERN_WITHIN = (3e-4, 5e-4), float(np.log(3.0))
"""Size of a pattern [m, rad] for a change of the pose by its standard deviation, and the standard
deviation of its logarithm."""


def _with_columns(parts: Deviations, H: FloatArray, precision: FloatArray) -> Deviations:
    """Return the deviations by further parameters, which move whole stops.

    Parameters
    ----------
    H : array (M, k, n)
        Derivative of the deviations by these parameters, which are zero now.
    precision : array (n,)
        What is known of them: inverse squares of standard deviations.
    """
    n = len(precision)
    left = np.zeros((*parts.left_jacobian.shape[:2], n))
    return replace(
        parts,
        by_parameters=np.concatenate([parts.by_parameters, H], axis=2),
        left_jacobian=np.concatenate([parts.left_jacobian, left], axis=2),
        known_block=block_diag(parts.known_block, np.diag(precision)),
        known_right=np.append(parts.known_right, np.zeros(n)),
    )


def unlikely(parts: Deviations, kinds: Kinds, theta: FloatArray) -> tuple[float, FloatArray]:
    """Return minus twice the logarithm of the restricted likelihood, and its slope.

    Parameters
    ----------
    theta : array (2 + G,)
        Logarithms of the deviation [m, rad] and of the sizes.
    """
    H, new = parts.by_parameters, np.concatenate([np.zeros(0, dtype=np.intp), *kinds.members])
    M, k, p = H.shape
    part = np.repeat(np.eye(2), 3, axis=0)[:k]
    variance = np.exp(2.0 * theta[:2])
    # by a root of V: of an arm that hardly stops off its inverse has few digits
    root = np.linalg.cholesky(parts.covariance + np.diag(part @ variance))
    unit = np.broadcast_to(np.eye(k), (M, k, k))
    white = np.linalg.solve(root, np.concatenate([H, parts.off[..., None], unit], axis=2))
    J, y = white[..., :p].reshape(M * k, p), white[..., p].ravel()
    inverse_root = white[..., -k:]
    known, right = parts.known_block.copy(), parts.known_right.copy()
    known[new], known[:, new], right[new] = 0.0, 0.0, 0.0  # what sizes say takes its place
    A = J.T @ J + parts.within_blocks.sum(axis=0) + known
    b = y @ J + parts.within_right.sum(axis=0) + right
    log_sigma, off = np.zeros(0), kinds.off[new] if len(new) else np.zeros(0)
    for own, log in zip(kinds.members, theta[2:], strict=True):
        log_sigma = np.append(log_sigma, kinds.log_prior[own] + log)
    precision = np.exp(-2.0 * log_sigma)
    A[new, new] += precision
    b[new] += off * precision
    length = np.sqrt(np.diag(A))
    factor, failed = dpotrf(A / np.outer(length, length))
    if failed:
        raise ConvergenceError("the pictures do not tell camera and board from errors of the arm")
    upper = np.triu(dpotri(factor)[0])
    C = (upper + np.triu(upper, 1).T) / np.outer(length, length)
    step = -C @ b
    far = (theta[2:] - kinds.centre) / kinds.within
    value = y @ y + b @ step + off**2 @ precision + far @ far
    logs = np.log(np.diagonal(root, axis1=1, axis2=2)).sum() + np.log(np.diag(factor)).sum()
    value += 2.0 * (logs + np.log(length).sum() + log_sigma.sum())
    # what V⁻¹ and its projection take of each component: squares of the rows of V^(-1/2)
    left = np.einsum("mji,mj->mi", inverse_root, (y + J @ step).reshape(M, k))
    taken = (np.swapaxes(inverse_root, 1, 2) @ J.reshape(M, k, p)).reshape(M * k, p)
    own = np.sum(inverse_root**2, axis=1) - left**2
    own = own - np.sum((taken @ C) * taken, axis=1).reshape(M, k)
    squares = np.zeros(p)
    squares[new] = ((off + step[new]) ** 2 + np.diag(C)[new]) * precision
    of_sizes = [2.0 * (len(own) - squares[own].sum()) for own in kinds.members]
    slope = np.append(2.0 * variance * (own.sum(axis=0) @ part), of_sizes)
    slope[2:] += 2.0 * far / kinds.within
    return float(value), slope


def likeliest(
    parts: Deviations, kinds: Kinds, theta: FloatArray, *, arm_known: bool = False
) -> tuple[FloatArray, float]:
    """Return the likeliest components, from some to start from, and their :func:`unlikely`.

    ``arm_known``: the deviation of the arm is given.
    """
    from scipy.optimize import minimize

    low, high = np.log(LEAST_ARM), np.log(_MOST_ARM)
    if arm_known:
        low = high = theta[:2]
    low = np.append(low, kinds.centre - _WITHIN * kinds.within)
    high = np.append(high, kinds.centre + _WITHIN * kinds.within)
    counts = [3.0 * len(parts.off)] * 2 + [len(own) for own in kinds.members]
    unit = 1.0 / np.sqrt(2.0 * np.array(counts))

    def asked(t: FloatArray) -> tuple[float, FloatArray]:
        value, slope = unlikely(parts, kinds, t * unit)
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
