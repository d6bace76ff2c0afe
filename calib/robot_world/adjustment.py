"""Least squares with errors in A, in B or in both: the maximum of the likelihood on SE(3).

The true poses are unknown, too, but held together by ``A X = Z B``: each pair has six unknowns of
its own besides the twelve of X and Z. At any X, Z and true A the true B follows, so that the
equation always holds exactly; its errors at the measured poses are linear in the errors of A and B
there, and eliminating what belongs to a pair alone leaves the white rows of
:mod:`calib.robot_world.errors_of_pairs`. This is Gauss and Helmert's adjustment with
condition equations and unknowns; with errors on one side only it is plain nonlinear least squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib import se3
from calib.batch_last import (
    columns_of,
    cross,
    product,
    rotation_exp,
    rotation_log,
    transposed,
    turn,
    turn_back,
)
from calib.robot_world.algebra import apply_matrix
from calib.robot_world.errors_of_pairs import (
    ErrorModel,
    Errors,
    General,
    derivatives,
    left_over,
)
from calib.robot_world.estimate import Fit
from calib.robot_world.noise import perturb
from calib.robot_world.pairs import PairSets
from calib.robot_world.sizes import Sizes
from calib.se3 import BoolArray, FloatArray, IntArray

ITERATION_LIMIT = 100
"""Far beyond what converges: four or five steps from the closed form at usual noise."""

STEP_TOLERANCE = 1e-6
"""Length of the last step, in standard deviations of X and Z: the one after it would be shorter by
the size of the residual rotations in radians."""

ROUNDING = 1e-13
"""Step, in rad and in parts of the translations, that counts as none whatever the noise is."""

_STALLED = 1e-13
"""Part of the cost that counts as none: rounding of the sum."""

_DAMPING, _DAMPING_FACTOR, _LARGEST_DAMPING = 1e-3, 10.0, 1e12
"""First damping after a step that made things worse, its growth, and where there is no way on."""


@dataclass(frozen=True, eq=False)
class _State:
    """X, Z and the true poses of A as far as they are unknown, as columns and rows of pairs."""

    X: FloatArray
    Z: FloatArray
    R_A: FloatArray
    p_A: FloatArray

    def where(self, better: BoolArray, other: _State, N: int) -> _State:
        """Return this state in the sets that are better, another elsewhere."""
        wide = np.repeat(better, N)
        return _State(
            np.where(better[:, None, None], self.X, other.X),
            np.where(better[:, None, None], self.Z, other.Z),
            np.where(wide, self.R_A, other.R_A),
            np.where(wide, self.p_A, other.p_A),
        )


@dataclass(frozen=True, eq=False)
class _Linear:
    """White rows and derivatives at a state, weighted, and the cost."""

    white: FloatArray
    jacobian: FloatArray
    errors: Errors
    cost: FloatArray

    def times(self, pairs: PairSets, ratio: FloatArray) -> _Linear:
        """Return the rows by noise of B whose sizes ``(2, T)`` are smaller by a ratio."""
        each = np.repeat(pairs.spread(ratio), 3, axis=0)
        white = self.white * each
        cost = (white * white).sum(axis=0).reshape(pairs.T, pairs.N).sum(axis=-1)
        return _Linear(white, self.jacobian * each, self.errors, cost)


def adjust(
    pairs: PairSets,
    model: ErrorModel,
    X: FloatArray,
    Z: FloatArray,
    *,
    weights: FloatArray | None = None,
    sizes: Sizes | None = None,
) -> Fit:
    """Find the likeliest X and Z of T sets from a start ``(T, 4, 4)``.

    Parameters
    ----------
    model : ErrorModel
        Errors of A and B; of the two rotations one at least has some, of the translations, too.
    weights : ndarray (T, N), optional
        How much each pair counts in the sum of squares.
    sizes : Sizes, optional
        Sizes of the noise where these are estimated, too. Their model takes the place of the one
        given.
    """
    T, N = pairs.T, pairs.N
    root = None if weights is None else np.sqrt(weights).reshape(-1)
    model = model if sizes is None else sizes.model
    # origins of base and target in the middle of what is measured: far away they cost digits
    base, target = pairs.mean(pairs.p_A).T, pairs.mean(pairs.p_B).T
    pairs = PairSets(_shifted(pairs.A, -base[:, None]), _shifted(pairs.B, -target[:, None]))
    lever = apply_matrix(Z[:, :3, :3], target)
    state = _State(X, _shifted(Z, lever - base), pairs.R_A, pairs.p_A)
    linear = _linearise(pairs, model, state, root)
    damping, count = np.zeros(T), np.zeros(T, dtype=np.intp)
    moving, stuck = np.ones(T, dtype=bool), np.zeros(T, dtype=bool)
    unit = np.ones((T, 12))
    unit[:, 3:6] = unit[:, 9:] = pairs.size[:, None]
    settled = np.ones(T, dtype=bool)
    for _ in range(ITERATION_LIMIT):
        if sizes is not None:
            ratio, settled = sizes.renew(linear.white, linear.jacobian, moving)
            linear, model = linear.times(pairs, ratio), sizes.model
        step, length = _step(linear, damping, T, N)
        step[~moving] = 0.0
        count += moving
        tried = _moved(pairs, model, state, linear, step, root)
        arrived = (length <= STEP_TOLERANCE) | (np.abs(step / unit).max(axis=-1) <= ROUNDING)
        moving &= ~(arrived & settled)
        if not moving.any():
            state = tried
            break
        new = _linearise(pairs, model, tried, root)
        worse = moving & ~(new.cost <= linear.cost * (1.0 + _STALLED))
        moving &= ~(worse & (length**2 <= _STALLED * linear.cost))
        if worse.any():
            state = tried.where(~worse, state, N)
            linear = _linearise(pairs, model, state, root)
        else:
            state, linear = tried, new
        grown = np.maximum(damping * _DAMPING_FACTOR, _DAMPING)
        damping = np.where(worse, grown, np.where(damping > _DAMPING, damping / 10.0, 0.0))
        stuck |= damping >= _LARGEST_DAMPING
        moving &= ~stuck
    return _fit(pairs, state, linear, (base, target), count, ~(moving | stuck))


def _fit(
    pairs: PairSets,
    state: _State,
    linear: _Linear,
    middles: tuple[FloatArray, FloatArray],
    count: IntArray,
    converged: BoolArray,
) -> Fit:
    """The last state, with the origins of base and target where they were."""
    T, N = pairs.T, pairs.N
    base, target = middles
    lever = apply_matrix(state.Z[:, :3, :3], target)
    jacobian = linear.jacobian.reshape(12, 6, T, N).copy()
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        # turning Z moves its origin against the middle: ζ there is that of the origin + z × lever
        jacobian[6 + k] += lever[:, i, None] * jacobian[9 + j] - lever[:, j, None] * jacobian[9 + i]
    rows = jacobian.transpose(2, 0, 1, 3).reshape(T, 12, 6 * N)
    return Fit(
        state.X,
        _shifted(state.Z, base - lever),
        linear.cost,
        linear.white.reshape(6, T, N),
        jacobian,
        rows @ np.swapaxes(rows, -1, -2),
        count,
        converged,
    )


def _shifted(T: FloatArray, by: FloatArray) -> FloatArray:
    """Transforms with their origins moved by vectors, in the axes that they map to."""
    return se3.transform(T[..., :3, :3], T[..., :3, 3] + by)


def linear_rows(
    pairs: PairSets, model: ErrorModel, X: FloatArray, Z: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """White rows ``(6, T, N)`` and their derivatives ``(12, 6, T, N)`` at X, Z and measured A."""
    linear = _linearise(pairs, model, _State(X, Z, pairs.R_A, pairs.p_A), None)
    shape = (pairs.T, pairs.N)
    return linear.white.reshape(6, *shape), linear.jacobian.reshape(12, 6, *shape)


def _linearise(
    pairs: PairSets,
    model: ErrorModel,
    state: _State,
    root: FloatArray | None,
) -> _Linear:
    """Rows at the true poses that a state implies."""
    R_X, p_X, R_Z, p_Z = _frames(pairs, state)
    a = np.zeros((6, pairs.R_A.shape[-1]))
    if model.on_B:
        R_A, p_A = state.R_A, state.p_A
        m = turn(R_A, p_X)
        R_B = turn_back(R_Z, product(R_A, R_X))
        p_B = turn_back(R_Z, m + p_A - p_Z)
        b = _difference(pairs.R_B, pairs.p_B, R_B, p_B)
        if model.on_A:
            a = _difference(pairs.R_A, pairs.p_A, R_A, p_A)
        q = turn(R_Z, p_B)
    else:
        R_A = product(product(R_Z, pairs.R_B), transposed(R_X))
        m, q = turn(R_A, p_X), turn(R_Z, pairs.p_B)
        a = _difference(pairs.R_A, pairs.p_A, R_A, q + p_Z - m)
        b = np.zeros_like(a)
    e, J = left_over(a, b, m, R_Z), derivatives(R_A, q)
    if isinstance(model, General):
        errors: Errors = model.at(m, R_Z, *_at_errors(model, a, turn(R_Z, b[:3]), m, e, J))
    else:
        errors = model.at(m, R_Z)
    white, jacobian = errors.whiten(e), errors.whiten(J)
    if root is not None:
        white, jacobian = root * white, root * jacobian
    cost = (white * white).sum(axis=0).reshape(pairs.T, pairs.N).sum(axis=-1)
    return _Linear(white, jacobian, errors, cost)


def _at_errors(
    model: General, a: FloatArray, b: FloatArray, m: FloatArray, e: FloatArray, J: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Make e ``(6, S)`` and its derivatives J ``(12, 6, S)`` hold at errors a of A and b of B.

    Of b the rotation vector ``(3, S)`` alone, in the axes of the base. A turn u of the true
    rotation changes the rotation vector w of an error by ``J_r⁻¹(w) u``. That differs from u at
    right angles to w, which does not count where errors are alike in all directions; elsewhere
    steps without it end beside the minimum, or never.

    Returns what the rotation vector of A's error is multiplied by ``(S, 3, 3)`` in e_R, and in its
    lever.
    """
    own = b if model.on_B else a
    M = se3.inverse_left_jacobian(-own[:3].T)
    turned = (M @ J[:, :3].transpose(2, 1, 0)).transpose(2, 1, 0)
    if not model.on_B:
        J[:, 3:] += cross(turned - J[:, :3], m)
    J[:, :3] = turned
    if not (model.on_A and model.on_B):
        one = np.eye(3)[None]
        return one, one
    e[:3] += (M @ a[:3].T[..., None])[..., 0].T - a[:3]
    N = se3.right_jacobian(a[:3].T)
    return M @ N, N


def _frames(pairs: PairSets, state: _State) -> tuple[FloatArray, ...]:
    """Columns and origins of X and of Z for each pair."""
    return tuple(
        pairs.spread(part)
        for T in (state.X, state.Z)
        for part in (columns_of(T[:, :3, :3]), T[:, :3, 3].T)
    )


def _difference(R: FloatArray, p: FloatArray, R_true: FloatArray, p_true: FloatArray) -> FloatArray:
    """Errors (w, v) ``(6, S)`` of rotations (columns) and translations."""
    return np.concatenate([rotation_log(product(R, transposed(R_true))), p - p_true])


def _step(linear: _Linear, damping: FloatArray, T: int, N: int) -> tuple[FloatArray, FloatArray]:
    """Change ``(T, 12)`` of X and Z, and its length ``(T,)`` in standard deviations."""
    rows = linear.jacobian.reshape(12, 6, T, N).transpose(2, 0, 1, 3).reshape(T, 12, 6 * N)
    right = linear.white.reshape(6, T, N).transpose(1, 0, 2).reshape(T, 6 * N, 1)
    information = rows @ np.swapaxes(rows, -1, -2)
    diagonal = np.diagonal(information, axis1=1, axis2=2)
    # in units of each parameter: radians and metres differ by the unit of length
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = information * scale[:, :, None] * scale[:, None, :]
    scaled += damping[:, None, None] * np.eye(12)
    gradient = (rows @ right)[..., 0] * scale
    try:
        step = -np.linalg.solve(scaled, gradient[..., None])[..., 0]
    except np.linalg.LinAlgError:
        step = -(np.linalg.pinv(scaled) @ gradient[..., None])[..., 0]
    length = np.sqrt(np.clip(-(step * gradient).sum(axis=-1), 0.0, None))
    return step * scale, length


def _moved(
    pairs: PairSets,
    model: ErrorModel,
    state: _State,
    linear: _Linear,
    step: FloatArray,
    root: FloatArray | None,
) -> _State:
    """State after a step: X and Z, and the true A that are the likeliest with them."""
    X, Z = perturb(np.stack([state.X, state.Z]), step.reshape(-1, 2, 6).swapaxes(0, 1))
    if not (model.on_A and model.on_B):
        return _State(X, Z, state.R_A, state.p_A)
    white = linear.white + (linear.jacobian * pairs.spread(step.T)[:, None]).sum(axis=0)
    if root is not None:
        white = white / np.where(root > 0.0, root, np.inf)
    a = linear.errors.errors_of_A(white)
    return _State(X, Z, product(rotation_exp(-a[:3]), pairs.R_A), pairs.p_A - a[3:])
