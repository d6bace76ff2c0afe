"""A tour through the poses of a cell: where its bodies stand, in which colour, and what is said.

All in plain arrays and words: :mod:`posedesign.report.scene` draws it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
import trimesh

from calib.geometry import Box, Capsule, Cylinder, HalfSpace, Mesh, Solid
from calib.geometry.ways import TOUCH_M
from calib.robot_world import solve
from calib.se3 import BoolArray, FloatArray, IntArray, apply, inverse, transform
from posedesign.cell import Cell
from posedesign.cell.observations import touched_by_tool
from posedesign.constraints import Collision
from posedesign.constraints.checker import ROUNDING
from posedesign.constraints.space import Workspace
from posedesign.hand_eye.pairs import Pairs
from posedesign.planning.checks import PoseVerdict, check_poses
from posedesign.planning.poses_file import PoseList

Colour = tuple[int, int, int]

STEP_RAD = float(np.deg2rad(3.0))
"""Largest joint travel between two pictures of a motion."""

MOST_FRAMES = 3000
"""Pictures of all motions together; of long tours they stand farther apart."""

PERIOD_S, HOLD_S = 0.05, 1.0
"""Time between two pictures, and time that the arm is shown at a pose."""

MOST_TRIANGLES = 20_000
"""Of one mesh; finer ones are drawn coarser, which keeps pages small, and checked as they are."""

BASE_POSTURE = "base posture"


class Shade(IntEnum):
    """Meaning of the colour of a body; of several that hold, the last counts."""

    ARM, TOOL, OBSTACLE, UNCHECKED, NEAR, CONTACT = range(6)


SHADES: dict[Shade, tuple[str, Colour]] = {
    Shade.ARM: ("arm", (168, 178, 190)),
    Shade.TOOL: ("tool", (0, 114, 178)),
    Shade.OBSTACLE: ("obstacle", (200, 178, 130)),
    Shade.UNCHECKED: ("not checked for collisions", (204, 121, 167)),
    Shade.NEAR: ("closer than the clearance", (240, 160, 0)),
    Shade.CONTACT: ("in contact or out of bounds", (214, 30, 40)),
}
TARGET, SLIDE, VIEW, BOX, WORKSPACE = (
    ("target and its normal, or instrument", (0, 158, 115)),
    ("way of a slide", (40, 40, 40)),
    ("view of the camera", (86, 180, 233)),
    ("task box", (90, 60, 160)),
    ("workspace", (110, 110, 110)),
)


@dataclass(frozen=True)
class Lines:
    """Segments ``points (M, 2, 3)`` [m], in the frame of a link (0: the base)."""

    name: str
    link: int
    points: FloatArray
    colour: Colour


@dataclass(frozen=True, eq=False)
class Tour:
    """The base posture, then the poses of a list, and the straight joint motions between them."""

    frames: FloatArray  # (F, n): postures [rad] in the order in which they are shown
    stops: IntArray  # (N,): the row of each stop
    verdicts: tuple[PoseVerdict, ...]  # on the stops
    shades: IntArray
    """(F, B): :class:`Shade` of each body of ``cell.scene`` at each of them."""
    seen: FloatArray
    """(M, 2, 4, 4): cameras of pairs that were measured, and the targets that they saw, in the
    base."""

    @classmethod
    def of(cls, cell: Cell, poses: PoseList | None = None, pairs: Pairs | None = None) -> Tour:
        """The tour through a list of poses; without one, the base posture alone."""
        listed = PoseList((BASE_POSTURE,), cell.base_posture[None], np.zeros(1, dtype=bool))
        if poses is not None:
            listed = PoseList(
                (BASE_POSTURE, *poses.names),
                np.vstack([listed.postures, poses.postures]),
                np.append(listed.via, poses.via),
            )
        if not cell.is_hand_eye and len(cell.observations) > 1:
            first, others = cell.observations[0].labels, [] if poses is None else poses.labels
            extra = {c: (first[c], *(given.get(c, "") for given in others)) for c in first}
            listed = replace(listed, extra=extra)
        frames, stops = interpolate(listed.postures)
        measured = np.zeros(len(frames), dtype=bool)
        measured[stops] = ~listed.via
        if cell.retreat is not None:
            far = np.linalg.norm(
                cell.robot.state(frames).point(cell.tool_m) - cell.target_m, axis=1
            )
            measured |= far <= cell.retreat.contact_m
        seen = np.empty((0, 2, 4, 4)) if pairs is None else cameras_and_targets(pairs)
        return cls(frames, stops, check_poses(cell, listed), shades(cell, frames, measured), seen)

    @property
    def times_s(self) -> FloatArray:
        return np.append(0.0, np.cumsum(self.stands_s)[:-1])

    @property
    def stands_s(self) -> FloatArray:
        """How long each posture is shown ``(F,)``: stops longer, unless they are passed through."""
        stands = np.full(len(self.frames), PERIOD_S)
        stands[self.stops] = [PERIOD_S if verdict.via else HOLD_S for verdict in self.verdicts]
        return stands

    @property
    def names(self) -> list[str]:
        """Names of the stops, told apart by their number."""
        return [f"{k}: {v.name}{' (via)' * v.via}" for k, v in enumerate(self.verdicts)]


def interpolate(postures: FloatArray) -> tuple[FloatArray, IntArray]:
    """Postures ``(F, n)`` on straight joint motions through others ``(N, n)``, and their rows."""
    travel = np.abs(np.diff(postures, axis=0)).max(axis=1)
    step = max(STEP_RAD, float(travel.sum()) / MOST_FRAMES)
    counts = np.maximum(1, np.ceil(travel / step)).astype(np.intp)
    moves = [
        np.linspace(start, end, count + 1)[1:]
        for start, end, count in zip(postures, postures[1:], counts, strict=False)
    ]
    return np.vstack([postures[:1], *moves]), np.append(0, np.cumsum(counts)).astype(np.intp)


def link_frames(cell: Cell, q: FloatArray) -> FloatArray:
    """``T_base_link`` of base and links ``(F, n + 1, 4, 4)`` at postures ``(F, n)`` [rad]."""
    state = cell.robot.state(q)
    moved = transform(state.rotations, state.origins)
    found = np.concatenate([np.broadcast_to(np.eye(4), (len(q), 1, 4, 4)), moved], axis=1)
    robot = cell.robot
    if robot.floor:
        found = inverse(robot.T_base_floor(q) @ robot.T_floor_world)[:, None] @ found
    return found


def shades(cell: Cell, q: FloatArray, measured: BoolArray) -> IntArray:
    """:class:`Shade` ``(F, B)`` of the bodies of ``cell.scene`` at postures ``(F, n)`` [rad].

    ``measured`` (F,): where the tool may touch what it is to touch.
    """
    bodies = cell.scene.bodies
    groups = len(cell.robot.bodies), len(cell.tool_bodies), len(cell.obstacles)
    usual = np.repeat([Shade.ARM, Shade.TOOL, Shade.OBSTACLE], groups)
    row = {id(body): b for b, body in enumerate(bodies)}

    def involved(kept: Collision) -> Iterator[tuple[int, int]]:
        """Pairs, and the bodies of this scene in them: sides of a workspace are none."""
        for pair, both in enumerate(kept.scene.pairs):
            yield from (
                (pair, row[i]) for i in (id(kept.scene.bodies[b]) for b in both) if i in row
            )

    against = [c for c in (*cell.solid, *cell.solid_passing) if not isinstance(c, Workspace)]
    checked = {body for kept in against for _, body in involved(kept)}
    usual[[b not in checked for b in range(len(bodies))]] = Shade.UNCHECKED
    found = np.tile(usual, (len(q), 1))
    for which, solid in ((measured, cell.solid), (~measured, cell.solid_passing)):
        rows = np.flatnonzero(which)
        for kept in solid:
            distance = kept.scene.distances(q[rows], kept.keep_m) + ROUNDING
            contact, near = distance < min(kept.keep_m, TOUCH_M), distance < kept.keep_m
            now = np.where(contact, Shade.CONTACT, np.where(near, Shade.NEAR, Shade.ARM))
            for pair, body in involved(kept):
                found[rows, body] = np.maximum(found[rows, body], now[:, pair])
    return found


def cameras_and_targets(pairs: Pairs) -> FloatArray:
    """Cameras and the targets that they saw ``(M, 2, 4, 4)``, of pairs A X = Z B in the base.

    The camera is on the flange where the pairs say that it is, and the targets lie one upon the
    other as far as they agree.
    """
    cameras = pairs.A @ solve(pairs.A, pairs.B).X
    return np.stack([cameras, cameras @ inverse(pairs.B)], axis=1)


def surface(solid: Solid, far_m: float) -> tuple[FloatArray, IntArray]:
    """Vertices ``(V, 3)`` [m] and triangles ``(F, 3)`` to draw a solid with.

    ``far_m``: how far a half-space is drawn from the origin of its frame.
    """
    if isinstance(solid, Mesh):
        fine = len(solid.triangles) > MOST_TRIANGLES
        return _coarser(solid) if fine else (solid.vertices, solid.triangles)
    if isinstance(solid, HalfSpace):
        corners = far_m * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        return corners, np.array([[0, 1, 2], [0, 2, 3]])
    make = trimesh.creation
    if isinstance(solid, Box):
        made = make.box(solid.size_m)
    elif isinstance(solid, Cylinder):
        made = make.cylinder(radius=solid.radius_m, height=solid.length_m, sections=48)
    elif isinstance(solid, Capsule):
        made = make.capsule(solid.length_m, solid.radius_m, count=[24, 24])
    else:
        made = make.icosphere(subdivisions=3, radius=solid.radius_m)
    return np.asarray(made.vertices), np.asarray(made.faces)


def _coarser(mesh: Mesh) -> tuple[FloatArray, IntArray]:
    """A mesh with one vertex, their middle, for all those in a cube of a sixtieth of its size."""
    step = float(np.ptp(mesh.vertices, axis=0).max()) / 60.0
    cubes = np.floor(mesh.vertices / step)
    of = np.unique(cubes, axis=0, return_inverse=True)[1].reshape(-1)
    sums = [np.bincount(of, weights=along) for along in mesh.vertices.T]
    triangles = np.unique(of[mesh.triangles], axis=0)
    a, b, c = triangles.T
    kept = triangles[(a != b) & (b != c) & (c != a)]
    return np.stack(sums, axis=1) / np.bincount(of)[:, None], kept


def lines(cell: Cell, tour: Tour) -> tuple[Lines, ...]:
    """What is drawn of a cell besides its bodies."""
    chain, section = cell.robot.chain, cell.config
    shaped = {body.link for body in cell.robot.bodies}
    ends = enumerate([*chain.placements[:, :3, 3], chain.T_link_tip[:3, 3]])
    # what a positioner moves, and what it stands on, is not along the lines between its axes
    known = {*shaped, *range(cell.robot.floor + bool(cell.robot.floor))}
    bare = [(j, np.array([[np.zeros(3), end]])) for j, end in ends if j not in known and end.any()]
    unseen = SHADES[Shade.UNCHECKED][1]
    found = [Lines(f"link_{j}_without_shape", j, line, unseen) for j, line in bare]
    if touched_by_tool(section):  # an instrument is elsewhere, and has none
        normal = [cell.target_m, cell.target_m + 0.05 * chain.reach_m * cell.target_normal]
        found.append(Lines("normal", 0, np.array([normal]), TARGET[1]))
    # what slides would float in the air: the way that its joint has
    for j in np.flatnonzero(cell.robot.sliding).tolist():
        way = np.outer([cell.robot.lower[j], cell.robot.upper[j]], chain.axes[j])
        found.append(Lines(f"slide_{j}", j, apply(chain.placements[j], way)[None], SLIDE[1]))
    if len(tour.seen):
        found.append(Lines("sights", 0, tour.seen[:, :, :3, 3], VIEW[1]))
    camera, box, limits = section.camera, section.task_box, section.constraints
    if camera is not None:
        # corners of the image at the nearest and at the farthest depth, x fastest
        signs = np.array([[x, y] for y in (-1, 1) for x in (-1, 1)])
        half = np.array(camera.image_px) / 2.0 / camera.focal_px
        rays = np.column_stack([signs * half, np.ones(4)])
        seen = np.vstack([rays * camera.nearest_mm, rays * camera.farthest_mm]) / 1e3
        link, T = cell.robot.n, chain.T_link_tip @ cell.T_tip_camera
        if cell.camera_stands:
            link, T = 0, cell.board_set_up.Z
        found.append(Lines("view", link, (seen @ T[:3, :3].T + T[:3, 3])[_EDGES], VIEW[1]))
    if box is not None:
        found.append(Lines("task_box", 0, _edges(box.lowest_mm, box.highest_mm), BOX[1]))
    low, high = limits.workspace_lowest_mm, limits.workspace_highest_mm
    if low is not None and high is not None:
        edges = apply(cell.robot.T_floor_world, _edges(low, high))
        found.append(Lines("workspace", cell.robot.floor, edges, WORKSPACE[1]))
    return tuple(found)


_EDGES = np.array([[a, a | bit] for bit in (1, 2, 4) for a in range(8) if not a & bit])
"""Edges of a box, its corners numbered by the bits of x, y and z."""


def _edges(lowest_mm: Sequence[float], highest_mm: Sequence[float]) -> FloatArray:
    corners = [[(lowest_mm, highest_mm)[c >> k & 1][k] for k in range(3)] for c in range(8)]
    return np.asarray(np.array(corners)[_EDGES] / 1e3)


def words(verdict: PoseVerdict) -> list[str]:
    """The clearance at a pose, and what is wrong with it, line by line."""
    far = verdict.distance_mm
    said = ["clearance: not checked" if far is None else f"clearance: {verdict.nearest}"]
    said.append(f"tightest: {verdict.tightest}: {verdict.says}")
    if not verdict.feasible:
        said[-1] = f"CANNOT BE TAKEN: {verdict.says}"
    if verdict.way:
        said.append(f"THE WAY TO IT: {verdict.way}")
    return said


def legend(cell: Cell, tour: Tour) -> list[tuple[str, Colour]]:
    """Words and colours: of bodies as far as there are any, and what is amiss always."""
    drawn = {line.colour for line in lines(cell, tour)}
    drawn |= {SHADES[Shade(shade)][1] for shade in np.unique(tour.shades).tolist()}
    drawn |= {TARGET[1], *(SHADES[shade][1] for shade in (Shade.NEAR, Shade.CONTACT))}
    return [
        one for one in (*SHADES.values(), TARGET, SLIDE, VIEW, BOX, WORKSPACE) if one[1] in drawn
    ]
