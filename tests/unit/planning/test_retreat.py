"""A pin backs off along its axis between the poses: seen by dense samples of whole routes.

Distances are those of points on the pin from the box of the fixture, by formula: nothing here asks
the scenes of the tool.
"""

import re
import tomllib
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from calib.errors import FileFormatError, InputError, UnreachableError
from calib.geometry.ways import WAY_TOLERANCE_M
from calib.robots.move_times import ACCELERATION_S, moving_time_s
from calib.se3 import FloatArray, rotation_angle
from calib.vision.touch_up import follow
from posedesign.candidates import candidates_of
from posedesign.cell import Cell, cell_template
from posedesign.cell.file import parse_config
from posedesign.cell.surroundings import NOT_TOUCHING_M
from posedesign.motion.route import Passing, Route
from posedesign.planning import PoseList, PosePlan, plan
from posedesign.planning.checks import check_poses
from posedesign.planning.optimal import Request, plan_optimal
from posedesign.planning.poses_file import read_poses, write_poses
from posedesign.pose_programs import import_touch_ups, program_options, write_program
from posedesign.pose_programs.from_plan import with_approaches
from posedesign.workflow import plan_poses

MakeCell = Callable[..., Cell]


class Planned(NamedTuple):
    """A plan for a pin."""

    cell: Cell
    found: PosePlan
    listed: PoseList


SAFETY_M, RETREAT_M, CONTACT_M = 0.020, 0.050, 0.005
PIN_RADIUS_MM, PIN_END_MM, PIN_MM = 3.0, 347.0, 150.0
"""A pin beside the gun; its end is described 3 mm short of the tool point (200, -50, 350)."""

FIXTURE_MM = (120.0, 120.0, 492.4)
"""The target is half a millimetre above its top."""

PER_MOVE = 101

ONE_ROUND = {"start_deg": [25.0, 25.0, 25.0], "largest_deg": [25.0, 25.0, 25.0]}


@pytest.fixture(scope="module")
def pin_cell(make_demo_cell) -> MakeCell:
    """The demo cell with a pin in place of the camera, on a fixture that reaches to the target."""
    demo = make_demo_cell()
    gun = demo.config.tool.body[0].model_dump(exclude_none=True)
    floor = demo.config.obstacle[0].model_dump(exclude_none=True)
    pin = {
        "name": "pin",
        "kind": "cylinder",
        "radius_mm": PIN_RADIUS_MM,
        "height_mm": PIN_MM,
        "at_mm": [200.0, -50.0, PIN_END_MM - PIN_MM / 2.0],
    }
    fixture = {"name": "fixture", "size_mm": FIXTURE_MM, "at_mm": [1915.4, 50.0, 246.2]}
    retreat = {"retreat_mm": 1e3 * RETREAT_M, "contact_mm": 1e3 * CONTACT_M}

    def make(**sections: Any) -> Cell:
        usual: dict[str, Any] = {
            "camera": None,
            "tool": {"body": [gun, pin]},
            "obstacle": [floor, fixture],
            "constraints": {"ignore": [["fixture", "pin"]]},
            "plan": retreat,
        }
        for name, keys in sections.items():
            usual[name] = {**usual.get(name, {}), **keys}
        return make_demo_cell(**usual)

    return make


@pytest.fixture(scope="module")
def planned(pin_cell, tmp_path_factory) -> Planned:
    """The cell, its plan of one round of the loop, and the list in its file."""
    cell, folder = pin_cell(variations=ONE_ROUND), tmp_path_factory.mktemp("pin")
    found = plan_poses(cell, folder)
    return Planned(cell, found, read_poses(folder / "poses.csv", 6))


def pin_distance(cell: Cell, q: FloatArray) -> FloatArray:
    """Distance ``(S,)`` [m] of points all over the pin from the fixture; negative inside."""
    angle = np.linspace(0.0, 2.0 * np.pi, 25)[:-1]
    ring = PIN_RADIUS_MM * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    heights = PIN_END_MM - np.linspace(0.0, PIN_MM, 40)
    points = np.concatenate([ring + np.array([200.0, -50.0, z]) for z in heights]) / 1e3
    T = cell.robot.fk(q)
    seen = points @ np.swapaxes(T[:, :3, :3], -1, -2) + T[:, None, :3, 3]
    beyond = np.abs(seen - np.array([1915.4, 50.0, 246.2]) / 1e3) - np.array(FIXTURE_MM) / 2e3
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    return np.asarray((outside + np.minimum(beyond.max(axis=-1), 0.0)).min(axis=1))


def off_axis(cell: Cell, q: FloatArray, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How far tool points are back along the tool's axis at a pose, and off it ``(S,)`` [m]."""
    T = cell.robot.fk(pose)
    off = cell.robot.state(q).point(cell.tool_m) - (T[:3, :3] @ cell.tool_m + T[:3, 3])
    back = -off @ T[:3, 2]
    return back, np.linalg.norm(off + back[:, None] * T[:3, 2], axis=1)


def check_route(cell: Cell, postures: FloatArray, via: np.ndarray) -> None:
    """The base posture first: it touches as the poses do."""
    touches = ~via
    for i, (a, b) in enumerate(pairwise(postures)):
        q = a + (b - a) * np.linspace(0.0, 1.0, PER_MOVE)[:, None]
        distance = pin_distance(cell, q)
        if not (touches[i] or touches[i + 1]):
            assert distance.min() >= SAFETY_M - WAY_TOLERANCE_M
            continue
        assert touches[i] != touches[i + 1], "a pose is left for another without a retreat"
        back, off = off_axis(cell, q, a if touches[i] else b)
        assert back.max() == pytest.approx(RETREAT_M, abs=1e-4)
        assert (off <= 0.05 * RETREAT_M).all()
        assert distance[back >= CONTACT_M].min() >= NOT_TOUCHING_M - WAY_TOLERANCE_M
        assert distance[back >= RETREAT_M - 1e-4].min() >= SAFETY_M - WAY_TOLERANCE_M


def of_route(cell: Cell, route: Route) -> tuple[FloatArray, np.ndarray]:
    """The base posture and the stops, and which of them are passed."""
    postures = np.array([cell.base_posture, *(stop.posture for stop in route.stops)])
    return postures, np.array([False, *(stop.pose is None for stop in route.stops)])


def test_a_pin_is_never_planned_through_its_fixture(planned):
    """And it would be: the straight moves between the same poses run it into the fixture."""
    cell, found, _ = planned
    assert len(found.postures) == 27
    check_route(cell, *of_route(cell, found.route))
    passed = [stop.passing for stop in found.route.stops if stop.pose is None]
    assert passed.count(Passing.RETREAT) == 2 * 27 + 1
    assert found.route.stops[-1].passing is Passing.RETURN
    direct = np.vstack([cell.base_posture, found.postures])
    parts = np.linspace(0.2, 0.8, 7)[:, None]
    between = direct[:-1, None] + np.diff(direct, axis=0)[:, None] * parts
    assert pin_distance(cell, between.reshape(-1, 6)).min() < -0.01


def test_chosen_poses_back_off_too(pin_cell):
    cell = pin_cell(pool={"candidates": 40})
    found = plan_optimal(cell, Request(count=6, validation=2, beside=0))
    for route in (found.route, found.validation_route):
        assert route is not None
        check_route(cell, *of_route(cell, route))


def test_a_pin_along_another_axis(pin_cell):
    """Backed off against x of the tip, 50 mm."""
    cell = pin_cell(tool={"axis": [2.0, 0.0, 0.0]}, constraints={"ignore": []})
    assert cell.retreat is not None
    back, reasons = cell.retreat.back_off(cell.base_posture[None])
    T, T_back = cell.robot.fk(cell.base_posture), cell.robot.fk(back[0])
    np.testing.assert_allclose(T_back[:3, :3], T[:3, :3], atol=1e-7)
    np.testing.assert_allclose(T_back[:3, 3], T[:3, 3] - 0.05 * T[:3, 0], atol=1e-7)
    assert "pin 3.6 mm from fixture" in reasons[0], "beside the gun it slides along the fixture"


@pytest.mark.parametrize("robot", ["ur10e", "panda"])
def test_arms_back_off_straight_on_their_branch(robot):
    """60 mm along the tool, its orientation kept; a move that the joints would bend is refused."""
    raw = tomllib.loads(cell_template(robot, surroundings=False))
    raw["plan"]["retreat_mm"] = 60.0
    raw["pool"] = {"candidates": 40, "tilt_deg": 60.0}
    cell = Cell.from_config(parse_config(raw, Path("cell.toml")), Path("cell.toml"))
    bare = {**raw, "plan": {**raw["plan"], "retreat_mm": 0.0}}
    free = Cell.from_config(parse_config(bare, Path("cell.toml")), Path("cell.toml"))
    q = candidates_of(free).postures
    assert cell.retreat is not None
    back, reasons = cell.retreat.back_off(q)
    good = np.array([not why for why in reasons])
    assert good.mean() > 0.7
    np.testing.assert_array_equal(cell.checker.check(q).feasible, good)
    parts = np.linspace(0.0, 1.0, 41)[:, None]
    for pose, away in zip(q[good], back[good], strict=True):
        T = cell.robot.fk(away + (pose - away) * parts)
        T_pose = cell.robot.fk(pose)
        turn = rotation_angle(T_pose[:3, :3].T @ T[:, :3, :3])
        assert turn[0] < 1e-7
        assert turn.max() <= np.deg2rad(1.01)
        distance, off = off_axis(cell, away + (pose - away) * parts, pose)
        assert distance[0] == pytest.approx(0.06, abs=1e-7)
        assert (np.diff(distance) < 0.0).all()
        assert off.max() <= 0.05 * 0.06 * 1.01


def test_the_time_of_the_retreats_is_part_of_the_round(planned):
    """Every move of the path, from the base posture on, at the speed of the program."""
    cell, found, _ = planned
    postures, _ = of_route(cell, found.route)
    speeds = cell.robot.speed * cell.config.program.speed_percent / 100.0
    moving = moving_time_s(postures, speeds, ACCELERATION_S)
    assert found.route.cycle_time_s == pytest.approx(moving + 27 * cell.config.plan.dwell_s)


def test_lists_without_retreats_are_not_clear(planned):
    """The poses can be taken, and no motion between them; with the retreats all is well."""
    cell, _, listed = planned
    assert all(verdict.ok for verdict in check_poses(cell, listed))
    bare = check_poses(cell, listed.measured)
    assert all(verdict.feasible for verdict in bare)
    assert not any(verdict.way_clear for verdict in bare)
    assert "pin" in bare[1].way
    assert "fixture" in bare[1].way


def test_sideways_is_not_along_the_tool(pin_cell):
    """A passed posture at the height of a retreat and 30 mm beside it leads to no pose."""
    cell = pin_cell()
    assert cell.retreat is not None
    T = cell.robot.fk(cell.base_posture)[None]
    T[:, :3, 3] += -0.05 * T[:, :3, 2] + 0.03 * T[:, :3, 0]
    beside, _ = follow(cell.robot, cell.base_posture[None], T)
    back, _ = cell.retreat.back_off(cell.base_posture[None])
    q = cell.base_posture[None]
    assert cell.retreat.is_along(back, q)[0]
    assert not cell.retreat.is_along(beside, q)[0]
    listed = PoseList(("V1", "P1"), np.vstack([beside, q]), np.array([True, False]))
    assert [v.way_clear for v in check_poses(cell, listed)] == [False, False]


def test_the_pin_without_a_retreat_is_refused(pin_cell):
    with pytest.raises(FileFormatError, match="without a retreat") as caught:
        pin_cell(plan={"retreat_mm": 0.0})
    assert caught.value.key == "constraints.ignore"
    assert "plan.retreat_mm" in str(caught.value)
    pin_cell(plan={"retreat_mm": 0.0}, constraints={"collisions": False})  # said by the person


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"approach": "same-side"}, "not all joints come from one side"),
        ({"contact_mm": 50.0}, "not above contact_mm"),
        ({"retreat_mm": 30.0, "stop_short_mm": 30.0}, "stop_short_mm 30 is not below retreat_mm"),
    ],
)
def test_retreats_that_cannot_be(pin_cell, keys, said):
    with pytest.raises(FileFormatError, match=said):
        pin_cell(plan=keys)


def test_a_tool_without_an_axis(pin_cell):
    with pytest.raises(FileFormatError, match="axis has no length"):
        pin_cell(tool={"axis": [0.0, 0.0, 0.0]})


def test_no_room_to_back_off_from_the_base_posture(pin_cell):
    with pytest.raises(UnreachableError, match="no posture 1500 mm back along the tool"):
        plan(pin_cell(plan={"retreat_mm": 1500.0}))


POSITION = re.compile(r"P\[(\d+)[^\]]*\]\{(.*?)\};", re.DOTALL)
JOINT = re.compile(r"J\d=\s*(-?[\d.]+) deg")


def postures_in(cell: Cell, text: str) -> dict[int, FloatArray]:
    """Postures ``(n,)`` [rad] of the positions of a program, by number."""
    controller = cell.robot.controller
    assert controller is not None
    return {
        int(number): controller.posture(np.array([float(v) for v in JOINT.findall(body)]))
        for number, body in POSITION.findall(text)
    }


def test_the_program_backs_off(planned, tmp_path):
    """From a file of poses to a program, its motions read line by line and sampled; and back."""
    cell, _, listed = planned
    assert {why for why, via in zip(listed.reasons, listed.via, strict=True) if via} == {
        "retreat",
        "return to base",
    }
    written = write_program(
        listed, tmp_path, "fanuc-ls", program_options(cell, listed), "PIN", cell
    )
    assert written.problems == ()
    text = (tmp_path / "PIN.LS").read_text()
    stored = postures_in(cell, text)
    moves = [int(number) for number in re.findall(r"^\s*\d+:J P\[(\d+)", text, re.MULTILINE)]
    path = np.array([cell.base_posture, *(stored[number] for number in moves)])
    check_route(cell, path, np.array([False, *(number > 27 for number in moves)]))

    # all positions touched up, those that are passed, too: only those of poses come back
    shifted = re.sub(r"(J6=\s*)(-?[\d.]+)", lambda m: f"{m[1]}{float(m[2]) + 0.05:.3f}", text)
    (tmp_path / "PIN.LS").write_text(shifted)
    found = import_touch_ups(cell, [tmp_path / "PIN.LS"], listed)
    assert sorted(found.touch_ups.names) == sorted(listed.measured.names)


def test_a_program_may_stop_short(pin_cell, planned, tmp_path):
    """Each move in ends 10 mm before the target; what is jogged on from there is a touch-up."""
    cell = pin_cell(variations=ONE_ROUND, plan={"stop_short_mm": 10.0})
    poses, route = planned.found.poses, planned.found.route
    path = tmp_path / "poses.csv"
    write_poses(path, cell.robot, poses, route, cell.tool_m, stop_short_mm=10.0)
    listed = read_poses(path, 6)
    assert all(verdict.ok for verdict in check_poses(cell, listed))
    options = program_options(cell, listed)
    with pytest.raises(InputError, match="stop 10 mm short of these poses") as caught:
        write_program(listed, tmp_path, "fanuc-ls", options, "PIN")
    assert "`cell`" in str(caught.value)
    written = write_program(listed, tmp_path, "fanuc-ls", options, "PIN", cell)
    assert written.problems == ()
    text = (tmp_path / "PIN.LS").read_text()
    assert "STOPS SHORT OF THE TARGET: 10 mm" in re.sub(r" ;\s+\d+:  !\* ", " ", text)
    stored = postures_in(cell, text)
    poses = np.array([stored[k] for k in range(1, 28)])
    for q, touching, away in zip(
        poses,
        listed.measured.postures,
        listed.postures[np.flatnonzero(~listed.via) - 1],
        strict=True,
    ):
        back, _ = off_axis(cell, q[None], touching)
        assert back[0] == pytest.approx(0.010, abs=5e-5)  # bent by up to 1 in 20, and rounded
        part = (q - away) @ (touching - away) / ((touching - away) @ (touching - away))
        np.testing.assert_allclose(q, away + part * (touching - away), atol=2e-5)

    with pytest.raises(InputError, match="none was touched up"):
        import_touch_ups(cell, [tmp_path / "PIN.LS"], listed)
    with pytest.raises(InputError, match="none was touched up"):
        import_touch_ups(cell, [tmp_path / "poses.csv"], listed)
    first = next(body for number, body in POSITION.findall(text) if number == "1")
    jogged = re.sub(r"(J6=\s*)(-?[\d.]+)", lambda m: f"{m[1]}{float(m[2]) + 0.05:.3f}", first)
    (tmp_path / "PIN.LS").write_text(text.replace(first, jogged))
    found = import_touch_ups(cell, [tmp_path / "PIN.LS"], listed)
    assert found.touch_ups.names == (listed.measured.names[0],)
    assert len(found.untouched) == 26


def test_formats_without_passed_postures_are_refused(planned, tmp_path):
    cell, _, listed = planned
    for name in ("moveit-joints", "robot-calibration"):
        with pytest.raises(InputError, match="would not back off"):
            write_program(listed, tmp_path, name, program_options(cell, listed), "PIN", cell)
    with pytest.raises(InputError, match="along its own axis"):
        with_approaches(cell, listed, 1.0)
