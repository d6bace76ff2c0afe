"""Planned sets are free of collisions, as an independent check by brute force sees it.

The ways are sampled densely, and all distances are computed by Pinocchio's own geometry model: the
planner's kinematics, bounds, pair selection and bisection play no part in it.
"""

from itertools import pairwise

import coal
import numpy as np
import pinocchio as pin
import pytest

from calib.geometry import Body, Box, Capsule, HalfSpace
from calib.robots import preset_names
from posedesign.cell import Cell, cell_template
from posedesign.cell.template import REFERENCE
from posedesign.planning import PosePlan, plan

SAMPLES_A_WAY = 60
ON_THE_WAY_M = 2e-3
"""Ways are proven clear but for motions of a millimetre."""

QUICK = {REFERENCE, "lrmate200id", "ur5e"}


def coal_shape(body: Body) -> tuple[object, np.ndarray]:
    """The solid for Pinocchio, and its place."""
    solid = body.solid
    if isinstance(solid, Capsule):
        return coal.Capsule(solid.radius_m, solid.length_m), body.T_link_body
    if isinstance(solid, Box):
        return coal.Box(*solid.size_m), body.T_link_body
    assert isinstance(solid, HalfSpace)
    normal = body.T_link_body[:3, 2]
    return coal.Halfspace(normal, float(normal @ body.T_link_body[:3, 3])), np.eye(4)


class BruteForce:
    """Distances between all bodies of a cell that could meet, by Pinocchio alone."""

    def __init__(self, cell: Cell) -> None:
        robot = cell.robot
        self.model, self.geometry = robot.model, pin.GeometryModel()
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, pin.neutral(self.model))
        T_root_base = data.oMf[self.model.getFrameId(robot.base_frame)].homogeneous
        bodies = [*robot.bodies, *cell.tool_bodies, *cell.obstacles]
        for i, body in enumerate(bodies):
            shape, T = coal_shape(body)
            joint = self.model.getJointId(robot.joint_names[body.link - 1]) if body.link else 0
            placement = pin.SE3(T if body.link else T_root_base @ T)
            self.geometry.addGeometryObject(pin.GeometryObject(f"{i}", joint, placement, shape))
        arm, tool = len(robot.bodies), len(robot.bodies) + len(cell.tool_bodies)
        excluded = {frozenset(pair) for pair in cell.scene.excluded}
        self.names = []
        keep_m = cell.config.constraints.safety_distance_mm / 1e3
        keeps = []
        for i, one in enumerate(bodies):
            for j in range(i + 1, len(bodies)):
                other = bodies[j]
                if i >= tool:  # two obstacles
                    continue
                if j >= tool and one.link == 0:  # the base stands on the floor
                    continue
                if j < tool and abs(one.link - other.link) < 2:
                    continue
                if j < arm and frozenset((one.name, other.name)) in excluded:
                    continue
                self.geometry.addCollisionPair(pin.CollisionPair(i, j))
                self.names.append((one.name, other.name))
                keeps.append(0.0 if j < arm else keep_m)  # links keep no distance from each other
        self._keeps = np.array(keeps)
        self._data, self._geometry_data = data, pin.GeometryData(self.geometry)

    def least_room(self, q: np.ndarray) -> tuple[float, tuple[str, str]]:
        """Distance less the one asked for, of the pair that has least."""
        pin.updateGeometryPlacements(self.model, self._data, self.geometry, self._geometry_data, q)
        pin.computeDistances(self.geometry, self._geometry_data)
        distances = [r.min_distance for r in self._geometry_data.distanceResults]
        room = np.array(distances) - self._keeps
        k = int(np.argmin(room))
        return float(room[k]), self.names[k]


def check_plan(cell: Cell, result: PosePlan) -> None:
    assert result.reached
    assert len(result.postures) >= 20
    brute = BruteForce(cell)
    for name, q in zip(result.names, result.postures, strict=True):
        room, pair = brute.least_room(q)
        assert room >= -1e-6, f"{name}: {pair} {1e3 * room:.1f} mm"
    stops = [cell.base_posture, *(stop.posture for stop in result.route.stops)]
    for start, end in pairwise(stops):
        for part in np.linspace(0.0, 1.0, SAMPLES_A_WAY):
            room, pair = brute.least_room(start + part * (end - start))
            assert room >= -ON_THE_WAY_M, f"{pair} {1e3 * room:.1f} mm"


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in QUICK else pytest.mark.slow) for n in preset_names()]
)
def test_planned_sets_of_presets_have_no_collision(name):
    cell = Cell.from_text(cell_template(name))
    check_plan(cell, plan(cell))


def test_brute_force_sees_a_collision(demo_cell):
    """The check can fail: the arm bent down into the floor, 0.3 m of it below."""
    q = demo_cell.base_posture + np.deg2rad([0.0, 60.0, -10.0, 0.0, 0.0, 0.0])
    room, pair = BruteForce(demo_cell).least_room(q)
    assert room < -0.05
    assert "floor" in pair or "fixture" in pair
