"""Weighted least squares for many trials at once: Gauss-Newton, damped where it has to be.

The steps are solved for from the normal equations, their columns scaled to unit length: units do
not matter, and what the squared condition number costs a step in digits, the next one makes up,
because residuals and gradient are exact. Trials go in batches that stay in the cache of a core, so
cost grows linearly with them.

Where it starts is the robot as described, with the measuring set-up placed: points enter linearly,
or nearly so; frames are found in closed form from the readings first, since a tracker stands
anywhere, and no iteration is left to find it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calib.model import CalibrationModel
from calib.model.measurements import CameraPose, Distance, Measurements, Point, Pose
from calib.model.parameters import Frames
from calib.robot_world import PairSets
from calib.robot_world.identifiability import examine
from calib.robot_world.methods import li_kronecker
from calib.se3 import (
    BoolArray,
    FloatArray,
    IntArray,
    inverse,
    project_to_rotation,
    rotation_exp,
    transform,
)

ITERATIONS = 60
"""Steps after which a fit has failed; calibrations take three to six."""

STEP_TOLERANCE = 1e-7
"""Change of the predictions, in standard deviations of the noise or of the residuals where these
are larger, of the last step. No parameter then moves by more than this part of its own standard
deviation, whatever its unit; and since the last step is taken too, what is left is smaller still.
A step after which the next one would be below it, at the rate at which they shrink, is the last one
as well.
"""

_SMALL = 1e-2
"""Change of the predictions from which on a step tells how large the next one will be."""

_AT_ONCE = 3000
"""Measurements of all trials that are linearised at once."""

MISFIT_TOLERANCE, MISFIT = 1e-2, 10.0
"""The same where the residuals are so many times the noise: no model that is as wrong as that is
worth more digits, and its minimum is approached slowly."""

_WORSE, _FREE_STEPS, _STRICT = 10.0, 15, 1.0 + 1e-6
"""Growth of the sum of squares beyond which a step is taken back and damped. The first steps may
make it somewhat worse: the valleys of poor measuring sets are narrow and bent, and a step along
them climbs a side before the next one comes down."""

_FIRST_DAMPING, _LEAST_DAMPING = 1e-7, 1e-10
"""Added to the unit diagonal of the scaled normal matrix; below the least one, none is."""

_RIDGE = 1e-14
"""Always added: keeps a matrix that is singular in double precision solvable."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Where the iteration ended, for each of T trials."""

    x: FloatArray  # (T, p) [SI]
    cost: FloatArray
    """(T,): sum of the squared rows over their noise, of what is known besides included; before the
    last step, which changes no digit of it."""
    change: FloatArray
    """(T,): of the predictions in the last step, in standard deviations of noise or residuals."""
    converged: BoolArray  # (T,)
    iterations: int  # the most that a trial took


class _Normal(NamedTuple):
    """Normal equations of T trials: matrix (T, p, p), right side (T, p), sum of squares (T,)."""

    matrix: FloatArray
    right: FloatArray
    cost: FloatArray


def minimise(
    model: CalibrationModel,
    data: Measurements,
    x: FloatArray,
    *,
    weights: FloatArray | None = None,
    free: BoolArray | None = None,
    weighted: bool = True,
    iterations: int = ITERATIONS,
) -> Fit:
    """Least squares from parameters ``(T, p)`` for postures ``(T, N, n)``.

    Parameters
    ----------
    data : Measurements
        With a leading dimension of T trials.
    x : array (T, p)
    weights : array (T, N), optional
        Of the squares of each measurement, besides its noise.
    free : array (p,) of bool, optional
        Parameters to move; all by default.
    weighted : bool
        Divide the rows by the noise, or all by the same number.
    """
    size = max(1, _AT_ONCE // max(data.count, 1))
    parts = [slice(start, start + size) for start in range(0, max(len(x), 1), size)]
    with np.errstate(all="ignore"):  # a trial that runs away is told by not converging
        fits = [
            _minimise(
                *(model, data.trials(part), x[part], None if weights is None else weights[part]),
                *(free, weighted, iterations),
            )
            for part in parts
        ]
    return Fit(
        np.concatenate([fit.x for fit in fits]),
        np.concatenate([fit.cost for fit in fits]),
        np.concatenate([fit.change for fit in fits]),
        np.concatenate([fit.converged for fit in fits]),
        max(fit.iterations for fit in fits),
    )


def _minimise(
    model: CalibrationModel,
    data: Measurements,
    x: FloatArray,
    weights: FloatArray | None,
    free: BoolArray | None,
    weighted: bool,
    iterations: int,
) -> Fit:
    here = _normal(model, data, x, weights, weighted)
    equations = max(model.equations(data.setup), 1)
    damping = np.zeros(len(x))
    before = change = np.full(len(x), np.inf)
    done = np.zeros(len(x), dtype=bool)
    count = 0
    while count < iterations:
        count += 1
        step, change = _step(here, damping, free)
        misfit = np.sqrt(np.maximum(here.cost / equations, 1.0))
        change /= misfit
        done = change < np.where(misfit > MISFIT, MISFIT_TOLERANCE, STEP_TOLERANCE)
        # steps shrink at a rate that only gets better: what would follow this one is known
        following = change * np.minimum(change / before, 1.0)
        done |= (change < _SMALL) & (following < STEP_TOLERANCE)
        before = change
        if done.all() or not np.isfinite(change).any():
            x = x + step
            break
        there = _normal(model, data, x + step, weights, weighted)
        most = _WORSE if count <= _FREE_STEPS else _STRICT
        good = done | (there.cost <= most * here.cost + STEP_TOLERANCE)
        x = np.where(good[:, None], x + step, x)
        pairs = zip(there, here, strict=True)
        here = _Normal(*(np.where(good[(...,) + (None,) * (a.ndim - 1)], a, b) for a, b in pairs))
        damping = np.where(good, damping / 10.0, np.maximum(10.0 * damping, _FIRST_DAMPING))
        damping[damping < _LEAST_DAMPING] = 0.0
    return Fit(x, here.cost, change, done, count)


def _step(
    normal: _Normal, damping: FloatArray, free: BoolArray | None
) -> tuple[FloatArray, FloatArray]:
    """Step ``(T, p)`` [SI], and by how much it moves the predictions ``(T,)``."""
    H, g = normal.matrix, normal.right
    if free is not None:
        H, g = H[:, free][:, :, free], g[:, free]
    length = np.sqrt(np.diagonal(H, axis1=1, axis2=2))
    scale = np.where(length > 0, length, 1.0)
    scaled = H / (scale[:, :, None] * scale[:, None, :])
    p = scaled.shape[1]
    scaled[:, np.arange(p), np.arange(p)] += (_RIDGE + damping)[:, None]
    right = g / scale
    try:
        found = np.linalg.solve(scaled, right[..., None])[..., 0]
    except np.linalg.LinAlgError:  # one trial that has run away would stop them all
        found = np.full(right.shape, np.nan)
        for t in range(len(scaled)):
            if np.isfinite(scaled[t]).all() and np.linalg.matrix_rank(scaled[t]) == p:
                found[t] = np.linalg.solve(scaled[t], right[t])
    # |J step|² = stepᵀ H step; for an undamped step that is stepᵀ g, without the rounding of H
    change = np.sqrt(np.maximum(np.einsum("tp,tp->t", found, right), 0.0))
    step = -found / scale
    if free is not None:
        whole = np.zeros((len(step), len(free)))
        whole[:, free] = step
        step = whole
    return step, np.where(damping > 0, np.maximum(change, 1.0), change)


def _normal(
    model: CalibrationModel,
    data: Measurements,
    x: FloatArray,
    weights: FloatArray | None,
    weighted: bool,
) -> _Normal:
    linear = model.linearise_at(data, x)
    rows, J = linear.over_noise_last(weighted)
    trials, count = len(x), data.count
    if weights is not None:
        root = np.sqrt(weights).ravel()
        rows, J = rows * root, J * root
    p, m, _ = J.shape
    A = J.reshape(p, m, trials, count).transpose(2, 0, 1, 3).reshape(trials, p, m * count)
    r = rows.reshape(m, trials, count).transpose(1, 0, 2).reshape(trials, m * count)
    matrix = A @ np.swapaxes(A, 1, 2)
    right = (A @ r[..., None])[..., 0]
    cost = np.einsum("tk,tk->t", r, r)
    known, K = model.known(x)
    if known.shape[1]:
        matrix += np.swapaxes(K, 1, 2) @ K
        right += np.einsum("tkp,tk->tp", K, known)
        cost += np.einsum("tk,tk->t", known, known)
    return _Normal(matrix, right, cost)


def column_lengths(columns: FloatArray) -> FloatArray:
    """Lengths ``(p,)`` of columns ``(M, p)``, 1 for columns of noughts."""
    length = np.linalg.norm(columns, axis=0)
    return np.where(length > 0, length, 1.0)


def orthonormal(columns: FloatArray) -> FloatArray:
    """Orthonormal columns that span those ``(M, p)``, whatever their units."""
    return np.linalg.qr(columns / column_lengths(columns))[0]


_STEPS = 5
_FEWEST_POSES = 3
_LITTLE = 0.5
"""Share of the residuals below which a set-up that was placed is near enough: the rest is for the
arm."""


def first_guess(
    model: CalibrationModel, data: Measurements, *, weighted: bool = True
) -> FloatArray:
    """Parameters ``(p,)`` that place the set-up.

    Those of the model itself where they explain the measurements better: where no length of the arm
    is seen, a set-up that is placed in closed form may be a mirror image.
    """
    if not model.nuisance.any():
        return model.nominal.copy()
    found = _placed(model, data, weighted=weighted)
    squares = [
        float(np.sum(model.linearise_at(data, x).over_noise_last(weighted)[0] ** 2))
        for x in (found, model.nominal)
    ]
    return found if not squares[1] < squares[0] else model.nominal.copy()


def _placed(model: CalibrationModel, data: Measurements, *, weighted: bool) -> FloatArray:
    """Parameters ``(p,)`` with tools and targets found from the measurements."""
    x = model.nominal.copy()
    _Placing(model, data, x).place_frames()
    free = model.nuisance
    placed = x != model.nominal
    if placed[free].all():
        return x
    for _ in range(_STEPS):
        linear = model.linearise_at(data, x)
        rows, J = linear.over_noise_last(weighted)
        known, K = model.known(x[None])
        J = np.concatenate([J.reshape(model.p, -1).T, K[0]])
        r = np.concatenate([rows.ravel(), known[0]])
        # the shortest step where tool and target cannot be told apart
        step = np.linalg.lstsq(J[:, free], -r, rcond=1e-9)[0]
        if not np.isfinite(step).all():
            break
        x[free] += step
        moved = np.linalg.norm(J[:, free] @ step)
        if moved < 1.0 or (placed.any() and moved < _LITTLE * np.linalg.norm(r)):
            break
    return x


@dataclass(frozen=True, eq=False)
class _Placing:
    """Frames with free rotations, and anchors of distances, found in closed form from readings."""

    model: CalibrationModel
    data: Measurements
    x: FloatArray  # (p,): written to

    def place_frames(self) -> None:
        """Write to x where they are."""
        model, data = self.model, self.data
        if data.observed is None:
            return
        kinds = np.array([type(kind) for kind in model.measurements], dtype=object)
        kinds = kinds[data.setup.kind]
        for block in model.parameters:
            turns = isinstance(block, Frames) and "rad" in block.units
            for label in block.targets:
                rows = np.flatnonzero(data.setup.target == model.targets.index(label))
                of = {k: rows[kinds[rows] == k] for k in (Pose, CameraPose, Point, Distance)}
                poses = np.concatenate([of[Pose], of[CameraPose]])
                enough = len(poses) >= _FEWEST_POSES
                if enough and not turns:
                    enough = self._nominal(model.tools[data.setup.tool[poses[0]]], "tools")[1]
                if enough:
                    self._from_poses(data.observed, poses, kinds[poses] == CameraPose)
                elif turns and len(of[Point]) >= 2 * _FEWEST_POSES:
                    self._from_points(data.observed, of[Point], block.targets[0])
                elif not turns and block.size and len(of[Distance]) > _FEWEST_POSES:
                    self._from_distances(data.observed, of[Distance], label)

    def _set(self, label: str, T: FloatArray, side: str) -> None:
        """Put the frame of a label at a pose, as far as its axes are free."""
        for block, part in zip(self.model.parameters, self.model.slices, strict=True):
            if isinstance(block, Frames) and label in getattr(block, side):
                self.x[part] = block.values_at(T, block.labels.index(label), self.x[part])

    def _nominal(self, label: str, side: str) -> tuple[FloatArray, bool]:
        """Nominal pose of a label, and whether its rotation is free."""
        for block in self.model.parameters:
            if isinstance(block, Frames) and label in getattr(block, side):
                return block.T_nominal[block.labels.index(label)], "rad" in block.units
        return np.eye(4), False  # a point of a body, which is placed as a whole: near the tip

    def _from_poses(self, observed: FloatArray, rows: IntArray, by_camera: BoolArray) -> None:
        """Tool and target of the first pair of labels that was measured often enough."""
        setup = self.data.setup
        tool, target = setup.tool[rows[0]], setup.target[rows[0]]
        alike = (setup.tool[rows] == tool) & (setup.target[rows] == target)
        rows, by_camera = rows[alike], by_camera[alike]
        if len(rows) < _FEWEST_POSES:
            return
        B = transform(rotation_exp(observed[rows, 3:6]), observed[rows, :3])
        B[by_camera] = inverse(B[by_camera])  # target to tool, whichever side looked
        A = self.model.robot.fk(self.data.postures[rows])
        tool_label, target_label = self.model.tools[tool], self.model.targets[target]
        X, tool_turns = self._nominal(tool_label, "tools")
        Z, target_turns = self._nominal(target_label, "targets")
        if tool_turns and target_turns:
            pairs = PairSets(A[None], B[None])
            if examine(pairs).degenerate[0]:
                return  # from these alone; priors may know more, or the parameters be named
            found = li_kronecker.estimate(pairs)
            X, Z = found.X[0], found.Z[0]
        elif target_turns:
            Z = _mean(A @ X @ inverse(B))
        elif tool_turns:
            X = _mean(inverse(A) @ Z @ B)
        self._set(tool_label, X, "tools")
        self._set(target_label, Z, "targets")

    def _from_points(self, observed: FloatArray, rows: IntArray, target: str) -> None:
        """The instrument's frame and the points on the tool, by linear least squares.

        ``R_i t_k + p_i = Z y_ik + z``: linear in t, Z and z, with Z made a rotation afterwards.
        """
        T, of = self.model.robot.fk(self.data.postures[rows]), self.data.setup.tool[rows]
        y = observed[rows, :3]
        tools = sorted(set(of.tolist()))
        A = np.zeros((len(rows), 3, 12 + 3 * len(tools)))
        for axis in range(3):
            A[:, axis, 3 * axis : 3 * axis + 3] = -y
            A[:, axis, 9 + axis] = -1.0
        for k, tool in enumerate(tools):
            A[of == tool, :, 12 + 3 * k : 15 + 3 * k] = T[of == tool, :3, :3]
        if len(rows) * 3 < A.shape[2]:
            return
        found = np.linalg.lstsq(A.reshape(len(rows) * 3, -1), -T[:, :3, 3].ravel(), rcond=None)[0]
        R = project_to_rotation(found[:9].reshape(3, 3))
        # once more with the rotation held: what made it one has moved the rest
        rest = A[:, :, 9:].reshape(len(rows) * 3, -1)
        right = (y @ R.T - T[:, :3, 3]).ravel()
        found = np.linalg.lstsq(rest, right, rcond=None)[0]
        self._set(target, transform(R, found[:3]), "targets")
        for k, tool in enumerate(tools):
            place = transform(np.eye(3), found[3 + 3 * k : 6 + 3 * k])
            self._set(self.model.tools[tool], place, "tools")

    def _from_distances(self, observed: FloatArray, rows: IntArray, target: str) -> None:
        """Where spheres about the nominal tool points meet: ``2 p·a - |a|² = |p|² - d²``."""
        data = self.data
        p = self.model.view(data.postures[rows], self.x, data.setup[rows]).tool_points
        A = np.column_stack([2.0 * p, -np.ones(len(rows))])
        right = np.sum(p**2, axis=1) - observed[rows, 0] ** 2
        if np.linalg.matrix_rank(A - A.mean(axis=0)) < 3:
            return  # the points lie in a plane: either side would do
        place = np.linalg.lstsq(A, right, rcond=None)[0][:3]
        self._set(target, transform(np.eye(3), place), "targets")


def _mean(T: FloatArray) -> FloatArray:
    return transform(project_to_rotation(T[:, :3, :3].mean(axis=0)), T[:, :3, 3].mean(axis=0))
