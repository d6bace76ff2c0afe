"""First guesses of the measuring set-up, the robot taken as described.

Points enter linearly, or nearly so. Frames are found in closed form from the readings first: a
tracker stands anywhere, and no iteration is left to find it.
"""

from __future__ import annotations

import numpy as np

from calib.model import CalibrationModel
from calib.model.measurements import CameraPose, Distance, Measurements, Point, Pose
from calib.model.parameters import Frames, ParameterBlock
from calib.robot_world import PairSets
from calib.robot_world.identifiability import examine
from calib.robot_world.methods import li_kronecker
from calib.se3 import FloatArray, IntArray, inverse, project_to_rotation, rotation_exp, transform

_STEPS = 5
_FEWEST_POSES = 3
_LITTLE = 0.5
"""Share of the residuals below which a set-up that was placed is near enough: the rest is for the
arm."""


def first_guess(
    model: CalibrationModel, data: Measurements, *, weighted: bool = True
) -> FloatArray:
    """Parameters ``(p,)`` that place the set-up."""
    x = model.nominal.copy()
    if not model.nuisance.any():
        return x
    _place_frames(model, data, x)
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


def _place_frames(model: CalibrationModel, data: Measurements, x: FloatArray) -> None:
    """Write to x where frames with free rotations, and anchors of distances, are."""
    observed = data.observed
    if observed is None:
        return
    kinds = np.array([type(kind) for kind in model.measurements], dtype=object)[data.setup.kind]
    for block in model.parameters:
        turns = isinstance(block, Frames) and "rad" in block.units
        for k, label in enumerate(block.targets):
            rows = np.flatnonzero(data.setup.target == model.targets.index(label))
            of = {kind: rows[kinds[rows] == kind] for kind in (Pose, CameraPose, Point, Distance)}
            poses = np.concatenate([of[Pose], of[CameraPose]])
            enough = len(poses) >= _FEWEST_POSES
            if enough and not turns:
                tool = model.tools[data.setup.tool[poses[0]]]
                enough = _nominal(model, tool, "tools")[1]
            if enough:
                _from_poses(model, data, observed, x, poses, kinds)
            elif turns and len(of[Point]) >= 2 * _FEWEST_POSES:
                _from_points(model, data, observed, x, block, of[Point])
            elif not turns and block.size and len(of[Distance]) > _FEWEST_POSES:
                _from_distances(model, data, observed, x, block, k, of[Distance])


def _set(model: CalibrationModel, x: FloatArray, label: str, T: FloatArray, side: str) -> None:
    """Put the frame of a label at a pose, as far as its axes are free."""
    for block, part in zip(model.parameters, model.slices, strict=True):
        if isinstance(block, Frames) and label in getattr(block, side):
            values = block.values_at(T, block.labels.index(label), x[part])
            x[part] = values


def _nominal(model: CalibrationModel, label: str, side: str) -> tuple[FloatArray, bool]:
    """Nominal pose of a label, and whether its rotation is free."""
    for block in model.parameters:
        if isinstance(block, Frames) and label in getattr(block, side):
            return block.T_nominal[block.labels.index(label)], "rad" in block.units
    return np.eye(4), False  # a point of a body, which is placed as a whole: near the tip


def _from_poses(
    model: CalibrationModel,
    data: Measurements,
    observed: FloatArray,
    x: FloatArray,
    rows: IntArray,
    kinds: np.ndarray,
) -> None:
    """Tool and target of the first pair of labels that was measured often enough."""
    tool, target = data.setup.tool[rows[0]], data.setup.target[rows[0]]
    rows = rows[(data.setup.tool[rows] == tool) & (data.setup.target[rows] == target)]
    if len(rows) < _FEWEST_POSES:
        return
    read = observed[rows]
    B = transform(rotation_exp(read[:, 3:6]), read[:, :3])
    seen = np.array([kind is CameraPose for kind in kinds[rows]])
    B[seen] = inverse(B[seen])  # target to tool, whichever side looked
    A = model.robot.fk(data.postures[rows])
    tool_label, target_label = model.tools[tool], model.targets[target]
    X, tool_turns = _nominal(model, tool_label, "tools")
    Z, target_turns = _nominal(model, target_label, "targets")
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
    _set(model, x, tool_label, X, "tools")
    _set(model, x, target_label, Z, "targets")


def _from_points(
    model: CalibrationModel,
    data: Measurements,
    observed: FloatArray,
    x: FloatArray,
    block: ParameterBlock,
    rows: IntArray,
) -> None:
    """The instrument's frame and the points on the tool, by linear least squares.

    ``R_i t_k + p_i = Z y_ik + z``: linear in t, Z and z, with Z made a rotation afterwards.
    """
    T = model.robot.fk(data.postures[rows])
    y = observed[rows, :3]
    tools = sorted(set(data.setup.tool[rows].tolist()))
    A = np.zeros((len(rows), 3, 12 + 3 * len(tools)))
    for axis in range(3):
        A[:, axis, 3 * axis : 3 * axis + 3] = -y
        A[:, axis, 9 + axis] = -1.0
    for k, tool in enumerate(tools):
        own = data.setup.tool[rows] == tool
        A[own, :, 12 + 3 * k : 15 + 3 * k] = T[own, :3, :3]
    if len(rows) * 3 < A.shape[2]:
        return
    found = np.linalg.lstsq(A.reshape(len(rows) * 3, -1), -T[:, :3, 3].ravel(), rcond=None)[0]
    R = project_to_rotation(found[:9].reshape(3, 3))
    # once more with the rotation held: what made it one has moved the rest
    rest = A[:, :, 9:].reshape(len(rows) * 3, -1)
    right = (y @ R.T - T[:, :3, 3]).ravel()
    found = np.linalg.lstsq(rest, right, rcond=None)[0]
    _set(model, x, block.targets[0], transform(R, found[:3]), "targets")
    for k, tool in enumerate(tools):
        place = transform(np.eye(3), found[3 + 3 * k : 6 + 3 * k])
        _set(model, x, model.tools[tool], place, "tools")


def _from_distances(
    model: CalibrationModel,
    data: Measurements,
    observed: FloatArray,
    x: FloatArray,
    block: ParameterBlock,
    k: int,
    rows: IntArray,
) -> None:
    """Where spheres about the nominal tool points meet: ``2 p·a - |a|² = |p|² - d²``."""
    p = model.view(data.postures[rows], x, data.setup[rows]).tool_points
    A = np.column_stack([2.0 * p, -np.ones(len(rows))])
    right = np.sum(p**2, axis=1) - observed[rows, 0] ** 2
    if np.linalg.matrix_rank(A - A.mean(axis=0)) < 3:
        return  # the points lie in a plane: either side would do
    place = np.linalg.lstsq(A, right, rcond=None)[0][:3]
    _set(model, x, block.targets[k], transform(np.eye(3), place), "targets")


def _mean(T: FloatArray) -> FloatArray:
    return transform(project_to_rotation(T[:, :3, :3].mean(axis=0)), T[:, :3, 3].mean(axis=0))
