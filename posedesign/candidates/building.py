"""Candidates that keep the tool point on a target, that see it, or that a cell asks for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, UnreachableError
from calib.hand_eye.points import seen_point_motion
from calib.model import CalibrationModel
from calib.robots import InverseSolutions
from calib.se3 import (
    BoolArray,
    FloatArray,
    IntArray,
    inverse,
    transform,
    wpr_from_rotation,
)
from posedesign.candidates.candidate_poses import CandidatePoses, checkers_of, targets_of
from posedesign.candidates.postures import (
    IN_WORDS,
    MOST_PER_POSE,
    Configurations,
    asked_for,
    check_configurations,
    check_count,
    even_points,
    evenly,
    feasible_postures,
    no_pose,
    no_posture,
    once,
)
from posedesign.cell import (
    Cell,
    TaskBox,
    cone_rotations_at,
    poses_about_tool,
    wpr_rotations,
)
from posedesign.cell.board_set_up import rotations_to
from posedesign.cell.observations import normal_of, place_of, touched_by_tool
from posedesign.cell.task_box import BOX_OF_REACH
from posedesign.constraints import Checker
from posedesign.files.measurements import TOOL

LEVELS = 16
"""Grids of W, P and R, from the first to the widest angles: 417 poses."""

_SAME_TURN_RAD = 1e-8
"""Orientations of which no entry differs by more are one; forming them rounds 1e-15."""

LARGEST_TURN_RAD = np.pi
"""Of a joint from the base posture: beyond it the arm is where it has been, a full turn apart."""

_FEWEST, _MOST = 1_000, 20_000
"""Draws made at once."""

COORDINATES = 6
"""Of a view: the place in the image (2), the distance, and what :func:`cone_rotations_at` takes."""


def grid_candidates(
    cell: Cell,
    levels: int = LEVELS,
    configurations: str = "nearest",
    *,
    targets_m: ArrayLike | None = None,
    target_names: Sequence[str] | None = None,
) -> CandidatePoses:
    """Postures of all W P R grids of a cell, from its first angles to its largest.

    ``levels``: number of grids (Eq. 13 of [Watanabe2006]_), their angles evenly spaced.
    ``configurations``: see :data:`~posedesign.candidates.Configurations`. ``targets_m`` (K, 3):
    targets [m] in the base frame; each pose touches one, and each grid is laid at each. That of the
    cell by default. ``target_names``: their labels in a model.
    """
    levels = check_count(levels)
    section = cell.config.variations
    start, largest = np.deg2rad([section.start_deg, section.largest_deg])
    wpr = wpr_from_rotation(_base_rotation(cell))
    grids = [wpr_rotations(wpr, angles) for angles in np.linspace(start, largest, levels)]
    rotations = np.concatenate(grids)
    # the base pose is in every grid, and so are all poses of an angle that is held
    rotations = rotations[_distinct(rotations)]
    angles = " to ".join(
        ", ".join(f"{angle:g}" for angle in given)
        for given in (section.start_deg, section.largest_deg)
    )
    return _touching(
        cell,
        lambda: (rotations, None),
        f"W P R varied by {angles} deg in {levels} levels",
        configurations,
        (targets_m, target_names),
    )


def cone_candidates(
    cell: Cell,
    tilt: float,
    count: int,
    rng: np.random.Generator,
    configurations: str = "front",
    *,
    targets_m: ArrayLike | None = None,
    target_names: Sequence[str] | None = None,
) -> CandidatePoses:
    """Postures with the tool tilted up to an angle against the base pose and rolled freely.

    ``tilt``: largest angle between the tool's z and that of the base pose [rad]. ``count``:
    orientations tried at each target; each gives as many postures as it can be taken in. ``rng``:
    scrambles the orientations, which fill the cone evenly. ``configurations``: see
    :data:`~posedesign.candidates.Configurations`. A redundant arm gives at most
    :data:`~posedesign.candidates.postures.MOST_PER_POSE` of each pose. ``targets_m``,
    ``target_names``: see :func:`grid_candidates`.
    """
    if not 0.0 < tilt <= np.pi:
        raise InputError(
            f"a cone of {tilt:g} rad: its tilt is above 0 and at most pi",
            hint="give it in radians",
            name="tilt",
            value=tilt,
            bound=(0.0, np.pi),
        )
    count, base = check_count(count), _base_rotation(cell)
    spread = cell.config.measurement.kind in ("plane", "distance")
    words = ", anywhere on it" if spread else ""

    def drawn() -> tuple[FloatArray, FloatArray | None]:
        points = even_points(count, 6 if spread else 3, rng)
        R = cone_rotations_at(base, tilt, points[:, :3])
        return R, _places_about(cell, points[:, 3:]) if spread else None

    return _touching(
        cell,
        drawn,
        f"cone of {np.rad2deg(tilt):g} deg, rolled freely{words}",
        configurations,
        (targets_m, target_names),
    )


def _places_about(cell: Cell, points: FloatArray) -> FloatArray:
    """Places of the tool point ``(N, 3)`` [m] at points of the unit cube.

    On the part of a plane that may be touched; or about the foot of a ball bar or wire, at all its
    lengths, on the side of the base pose.
    """
    target = cell.config.target
    place = place_of(cell, target)
    if cell.config.measurement.kind == "plane":
        x, y = 2.0 * points[:, :2].T - 1.0
        half = np.array(target.size_mm) / 2e3
        axes = _with_z(normal_of(target) / np.linalg.norm(normal_of(target)))
        return np.asarray(
            place + (x * half[0])[:, None] * axes[:, 0] + y[:, None] * half[1] * axes[:, 1]
        )
    out = cell.target_m - place
    away = float(np.linalg.norm(out))
    pole = out / away if away > 0.0 else np.array([0.0, 0.0, 1.0])
    directions = cone_rotations_at(_with_z(pole), np.pi / 2.0, points)[:, :, 2]
    nearest, farthest = target.nearest_mm / 1e3, (target.farthest_mm or 0.0) / 1e3
    length = nearest + (farthest - nearest) * points[:, 2]
    return np.asarray(place + length[:, None] * directions)


def _touching(
    cell: Cell,
    orient: Callable[[], tuple[FloatArray, FloatArray | None]],
    orientations: str,
    configurations: str,
    asked: tuple[ArrayLike | None, Sequence[str] | None],
) -> CandidatePoses:
    """The pool of orientations ``(M, 3, 3)`` that are called for anew at each target.

    With them come places ``(M, 3)`` [m] of the tool point, where those are not the target's.
    """
    chosen = check_configurations(configurations)
    targets_m, names = targets_of(cell, *asked)
    checkers = checkers_of(cell, targets_m)
    poses = []
    for target_m in targets_m:
        R, places = orient()
        at_m = target_m if places is None else places
        base = cell.base_posture
        poses.append(poses_about_tool(cell.robot, R, cell.tool_m, at_m, base, cell.margin))
    found = [
        feasible_postures(checker, part, cell.base_posture, chosen)
        for checker, part in zip(checkers, poses, strict=True)
    ]
    postures = np.concatenate([q for q, _ in found])
    if not len(postures):
        raise _none_taken(cell, checkers[0], poses[0], chosen)
    turned = [part[pose, :3, :3] for part, (_, pose) in zip(poses, found, strict=True)]
    target = np.repeat(np.arange(len(targets_m)), [len(q) for q, _ in found])
    pool = CandidatePoses(
        postures=postures,
        orientations=np.concatenate(turned),
        target=target,
        targets_m=targets_m,
        target_names=names,
        tried=sum(len(part) for part in poses),
        description=f"{orientations}, {IN_WORDS[chosen]}",
    )
    return pool.take(once(postures))


def _base_rotation(cell: Cell) -> FloatArray:
    return np.asarray(cell.robot.fk(cell.base_posture)[:3, :3])


def _distinct(rotations: FloatArray) -> IntArray:
    """First row of each orientation of ``(M, 3, 3)``, ascending."""
    return np.flatnonzero(once(rotations.reshape(len(rotations), 9), _SAME_TURN_RAD))


def joint_candidates(
    cell: Cell, count: int, rng: np.random.Generator, largest_turn: float = LARGEST_TURN_RAD
) -> CandidatePoses:
    """Postures around the base posture that keep every constraint, wherever the tool point is.

    Drawn evenly in the joints; or, where the cell has a camera, evenly in what it sees of its
    target: over image, distance, tilt and roll, in every branch of the arm within the same bounds.
    Of the two, that is taken of which more draws are feasible: of a thousand postures in all of the
    joints' ranges hardly one sees the target.

    ``count``: postures wanted. Where most draws break a constraint, fewer may be given.
    ``largest_turn``: how far each joint may turn from the base posture [rad].
    """
    count = check_count(count)
    if not largest_turn > 0.0:
        raise InputError(
            f"joints that turn by {largest_turn:g} rad give one posture",
            hint="give how far each joint may turn from the base posture, in radians",
            name="largest_turn",
            value=largest_turn,
            bound=0.0,
        )
    robot, base, camera = cell.robot, cell.base_posture, cell.config.camera
    kept, arm = np.where(robot.sliding, 0.0, cell.margin), slice(robot.n_external, None)
    lower, upper = robot.lower + kept, robot.upper - kept  # external axes go all the way
    lower[arm] = np.maximum(lower, base - largest_turn)[arm]
    upper[arm] = np.minimum(upper, base + largest_turn)[arm]
    joints_at_once = views_at_once = int(np.clip(count, _FEWEST, _MOST))
    each = 64
    if robot.n > 6:  # a redundant arm takes each view in many ways, and long to find them
        views_at_once, each = int(np.clip(count // MOST_PER_POSE, _FEWEST // 10, _FEWEST)), 8

    def joints() -> FloatArray:
        return np.asarray(lower + (upper - lower) * even_points(joints_at_once, robot.n, rng))

    def views() -> FloatArray:
        return viewing_poses(cell, even_points(views_at_once, COORDINATES, rng))

    def within(solutions: InverseSolutions) -> BoolArray:
        q = solutions.postures
        return np.asarray(((q >= lower) & (q <= upper)).all(axis=1))

    def seeing() -> FloatArray:
        solutions = robot.inverse(views(), near=base, margin=cell.margin)
        rows = np.flatnonzero(solutions.inside & within(solutions))
        return np.asarray(solutions.postures[rows[evenly(solutions.pose[rows], MOST_PER_POSE)]])

    def feasible(draw: Callable[[], FloatArray]) -> FloatArray:
        q = draw()
        return np.asarray(q[cell.checker.check(q, every=False).feasible])

    # how to draw, how many at a time, and how many at most for each posture that is wanted
    kinds = [(joints, joints_at_once, 64)]
    if camera is not None:
        kinds.append((seeing, views_at_once, each))
    first = [feasible(draw) for draw, _, _ in kinds]
    best = int(np.argmax([len(q) / kind[1] for q, kind in zip(first, kinds, strict=True)]))
    (draw, tried, most), found = kinds[best], [first[best]]
    at_once = tried
    while sum(map(len, found)) < count and tried < most * max(count, at_once):
        found.append(feasible(draw))
        tried += at_once
    postures = np.concatenate(found)
    postures = postures[once(postures)][:count]
    if not len(postures) and camera is None:
        raise no_posture(cell.checker, joints(), tried)
    if not len(postures):
        otherwise = "only with joints turned farther from the base posture", "raise largest_turn"
        raise no_pose(cell.checker, views(), base, within, otherwise)
    words = f"joints within {np.rad2deg(largest_turn):g} deg of the base posture"
    return _pool_of(cell, postures, tried, words + ", the target in view" * (camera is not None))


def _pool_of(cell: Cell, postures: FloatArray, tried: int, words: str) -> CandidatePoses:
    """Postures ``(N, n)`` [rad] of the cell's own target as a pool, out of so many."""
    return CandidatePoses(
        postures=postures,
        orientations=cell.robot.fk(postures)[:, :3, :3],
        target=np.zeros(len(postures), dtype=np.intp),
        targets_m=cell.target_m[None],
        target_names=(cell.config.target.name,),
        tried=tried,
        description=words,
    )


def _none_taken(
    cell: Cell, checker: Checker, poses: FloatArray, configurations: Configurations
) -> UnreachableError:
    return no_pose(
        checker,
        poses,
        cell.base_posture,
        lambda solutions: asked_for(solutions, configurations),
        (
            "only with the first joint on the other side of the base posture",
            'take configurations = "all"',
        ),
    )


def viewing_poses(cell: Cell, points: FloatArray) -> FloatArray:
    """Tip poses ``(N, 4, 4)`` that see the target, at points ``(N, 6)`` of the unit cube.

    All that a cell allows its camera: the middle of the target anywhere in the image less its
    border, at any distance, the face of the target tilted any way, and the camera rolled freely
    about the line of sight. Of a board not its middle but enough of its points are in the image,
    where it is squarely seen.
    """
    camera = cell.config.camera
    if camera is None:
        raise InputError("the cell has no camera", name="camera")
    if cell.sees_board:
        return _board_poses(cell, points)
    u, v, distance = points[:, :3].T
    room_px = np.array(camera.image_px) / 2.0 - camera.border_px
    across = (2.0 * np.stack([u, v], axis=-1) - 1.0) * room_px / camera.focal_px
    nearest_m, farthest_m = camera.nearest_mm / 1e3, camera.farthest_mm / 1e3
    away_m = nearest_m + (farthest_m - nearest_m) * distance
    # a frame whose z is the line of sight: tilted against the normal, and in the camera's own frame
    tilt = float(np.deg2rad(camera.largest_tilt_deg))
    R_base_sight = cone_rotations_at(_with_z(-cell.target_normal), tilt, points[:, 3:])
    R_camera_sight = rotations_to(across)
    R_base_camera = R_base_sight @ np.swapaxes(R_camera_sight, -1, -2)
    lens = cell.target_m - away_m[:, None] * R_base_sight[:, :, 2]
    return np.asarray(transform(R_base_camera, lens) @ inverse(cell.T_tip_camera))


def _board_poses(cell: Cell, points: FloatArray) -> FloatArray:
    """The same ``(N, 4, 4)`` where camera and board are those of pictures of a board.

    Distances are even in their logarithm: a board twice as far off is half as large.
    """
    there = cell.board_set_up
    low, high = np.log([there.nearest_m, there.farthest_m])
    away_m = np.exp(low + (high - low) * points[:, 2])
    sight = cone_rotations_at(np.eye(3), there.largest_tilt, points[:, 3:])
    return there.tip_poses(there.views(2.0 * points[:, :2] - 1.0, away_m, sight))


MOST_DRAWS = 16
"""Times as many views as are wanted that are drawn at most: of the usual camera's one in four can
be taken."""


def view_candidates(
    cell: Cell, count: int, rng: np.random.Generator, configurations: str = "nearest"
) -> CandidatePoses:
    """Postures that see a board anywhere in the image, at any distance and tilt, rolled freely.

    ``count``: postures wanted; fewer where most views cannot be taken. ``configurations``: see
    :data:`~posedesign.candidates.Configurations`; where the robot is taken as it is, all postures
    of a view tell the same.
    """
    count, chosen = check_count(count), check_configurations(configurations)
    at_once = int(np.clip(count, _FEWEST // 4, _MOST))
    if cell.robot.n > 6:
        at_once = max(1, at_once // MOST_PER_POSE)
    found, tried = [np.empty((0, cell.robot.n))], 0
    while sum(map(len, found)) < count and tried < MOST_DRAWS * count:
        poses = viewing_poses(cell, even_points(at_once, COORDINATES, rng))
        found.append(feasible_postures(cell.checker, poses, cell.base_posture, chosen)[0])
        tried += at_once
    postures = np.concatenate(found)
    if not len(postures):
        raise _none_taken(cell, cell.checker, poses, chosen)
    postures = postures[once(postures)][:count]
    return _pool_of(cell, postures, tried, f"the board anywhere in view, {IN_WORDS[chosen]}")


def _with_z(z: FloatArray) -> FloatArray:
    """A rotation ``(3, 3)`` with this third column, a unit vector."""
    x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def candidates_of(cell: Cell) -> CandidatePoses:
    """Candidates of a cell, by its section ``[pool]``.

    ``auto`` is the view cone for what is touched, joints for what an instrument reads, all W P R
    grids for a camera that sees a target, and the board anywhere in view for pictures of one. Of
    several targets, pins or payloads each has its share.

    Raises InputError: postures that do not touch the target, for a measurement that does.
    UnreachableError: the robot can take none of them.
    """
    if cell.is_hand_eye:
        return _candidates_of_part(cell, cell.config.pool.candidates)
    parts = cell.parts
    each = -(-cell.config.pool.candidates // len(parts))
    found: dict[int, CandidatePoses] = {}
    lost: dict[int, UnreachableError] = {}
    for k, part in enumerate(parts):
        try:
            found[k] = _candidates_of_part(part, each)
        except UnreachableError as error:
            lost[k] = error
    _check_all_reached(cell, lost)
    pools = list(found.values())
    if parts == (cell,) and cell.observations[0].tools == (TOOL,):
        return pools[0]
    which = [np.full(len(pool), k) for k, pool in found.items()]
    said = dict.fromkeys(pool.description for pool in pools)
    return CandidatePoses(
        postures=np.concatenate([pool.postures for pool in pools]),
        orientations=np.concatenate([pool.orientations for pool in pools]),
        target=np.concatenate(which),
        targets_m=np.array([part.target_m for part in parts]),
        target_names=tuple(map(str, cell.observations)),
        tried=sum(pool.tried for pool in pools),
        description="; ".join(said),
        cell=cell,
    )


def _check_all_reached(cell: Cell, lost: Mapping[int, UnreachableError]) -> None:
    """Refuse a target, or a point of the tool, that no pose can be of."""
    kept = [seen for k, seen in enumerate(cell.observations) if k not in lost]
    targets = {seen.target for seen in kept}
    tools = {label for seen in kept for label in seen.tools}
    for k, error in lost.items():
        seen = cell.observations[k]
        if seen.target in targets and tools.issuperset(seen.tools):
            continue
        if len(cell.observations) > 1:
            error.message = f"{seen}: {error.message}"
        raise error


def _candidates_of_part(cell: Cell, count: int) -> CandidatePoses:
    """Candidates of a cell of which a pose is of one thing only."""
    section, reads = cell.config.pool, not cell.is_hand_eye and cell.observations[0].reads
    kind, measured = section.kind, cell.config.measurement.kind
    if kind == "auto":
        kind = "views" if cell.sees_board else "wpr" if cell.is_hand_eye else "cone"
        if measured in ("point", "pose"):
            kind = "joints"
    if kind == "wpr":
        return grid_candidates(cell, configurations="nearest")
    rng = np.random.default_rng(section.seed)
    if kind == "views":
        if not cell.sees_board:
            raise InputError(
                f"views are of a board, and {measured} is what is measured",
                hint='set pool.kind = "cone"',
                name="pool.kind",
            )
        return view_candidates(cell, count, rng)
    if kind == "joints":
        if not (cell.is_hand_eye or reads):
            raise InputError(
                f"postures drawn in the joints do not touch the target, as {measured} needs",
                hint='set pool.kind = "cone"',
                name="pool.kind",
            )
        return joint_candidates(cell, count, rng)
    tilt = float(np.deg2rad(section.tilt_deg))
    return cone_candidates(cell, tilt, count, rng, section.configurations)


def away_from_singularities(cell: Cell) -> Cell:
    """The cell with the distance from singularities that chosen poses keep.

    The best poses lie at the edge of what an arm can do. Near full reach a millimetre of correction
    in a touch-up takes degrees of a joint, or cannot be made at all.
    """
    least = cell.config.pool.smallest_singular_value
    section = cell.config.constraints
    if cell.is_hand_eye or section.smallest_singular_value >= least:
        return cell
    stricter = section.model_copy(update={"smallest_singular_value": least})
    config = cell.config.model_copy(update={"constraints": stricter})
    return replace(cell, config=config, singularity_setting="pool.smallest_singular_value")


def with_kept(
    cell: Cell, pool: CandidatePoses, postures: FloatArray, of: IntArray
) -> CandidatePoses:
    """The pool with poses of the user's own ``(k, n)`` [rad] as its first ones.

    ``of`` (k,): the observation of each.
    """
    k = len(postures)
    return replace(
        pool,
        postures=np.concatenate([postures, pool.postures]),
        orientations=np.concatenate([cell.robot.fk(postures)[:, :3, :3], pool.orientations]),
        target=np.concatenate([of, pool.target]),
        tried=pool.tried + k,
    )


def box_of_cell(cell: Cell) -> tuple[TaskBox, str]:
    """The task box of a cell, and where it is from in words."""
    section = cell.config.task_box
    if section is not None:
        lowest, highest = np.array(section.lowest_mm) / 1e3, np.array(section.highest_mm) / 1e3
        return TaskBox(lowest, highest, section.steps), "the task box of the cell"
    half = BOX_OF_REACH * cell.robot.chain.reach_m
    middle = "target" if touched_by_tool(cell.config) else "tool point of the base posture"
    words = f"a cube of {2e3 * half:.0f} mm about the {middle} (the cell has no [task_box])"
    return TaskBox(cell.target_m - half, cell.target_m + half), words


IN_PICTURE = 0.8
"""Part of the picture, from its middle, over which it is looked at where a camera sees points."""


def functions_of_picture(cell: Cell, model: CalibrationModel) -> tuple[FloatArray, str]:
    """How what the camera sees moves with X, or Z, and the lens, at nine points of its picture.

    ``(9, 3, p)``, seen from what the camera is on: the flange, or the base.
    """
    there = cell.board_set_up
    T = there.cameras(cell.robot.fk(cell.base_posture))
    away_m = float(np.linalg.norm(T[:3, 3]))
    lens = there.lens
    grid = np.array([[x, y] for y in (-1, 0, 1) for x in (-1, 0, 1)])
    size = np.array([lens.width_px, lens.height_px])
    rays = lens.rays(size * (1.0 + IN_PICTURE * grid) / 2.0)
    points = away_m * np.column_stack([rays, np.ones(len(rays))])
    frame = (model.tools if there.carried == "camera" else model.targets)[0]
    motion = seen_point_motion(model, model.nominal, frame, lens, points)
    return motion, f"the picture at {1e3 * away_m:.0f} mm"
