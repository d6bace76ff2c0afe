"""An arm on a rail: from the description to programs, and from measurements to a better rail."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes

from calib import Robot
from calib.errors import FileFormatError, InputError
from calib.identification import covariance_of, identify_batch
from calib.robots import ExternalAxes
from calib.se3 import inverse
from posedesign.acceptance.recheck import Watch, plan_recheck
from posedesign.candidates import joint_candidates
from posedesign.candidates.limits import limits_of
from posedesign.candidates.postures import in_front
from posedesign.cell import Cell
from posedesign.cell.cell import moved_as_base, usual_offset_joints
from posedesign.cell.file import cell_text
from posedesign.files.csv_tables import read_table
from posedesign.files.measurements import MeasurementTable, read_measurements
from posedesign.files.postures import joint_columns, postures_in_any_form
from posedesign.hand_eye import as_calibrated
from posedesign.identification.file import read_file
from posedesign.motion import Router
from posedesign.planning.loop import Replacements
from posedesign.planning.optimal import Request, plan_optimal
from posedesign.planning.poses_file import PoseList, read_poses
from posedesign.pose_programs import import_touch_ups, program_options, write_program
from posedesign.pose_programs.from_plan import arm_of
from posedesign.report.acceptance import answer_of_recheck_plan
from posedesign.report.page import _measured_deg
from posedesign.report.plots import figure_of_identification
from posedesign.simulation import SimulatedRobot
from posedesign.simulation.pictures import simulate_pictures
from tests.arms import PULSES
from tests.board_pictures import Camera as BoardCamera
from tests.board_pictures import take_pictures
from tests.cli.conftest import offsets_only
from tests.cli.test_camera import BOARD, LENS, NEAR, X, Z, write_rows
from tests.measured_cells import TRACKER, check_scatter
from tests.rails import on_slides
from tests.unit.acceptance.conftest import identified_in

pytestmark = pytest.mark.usefixtures("one_alternative")

RAIL = ExternalAxes(slides=1)
POSTURE = {
    "r2000ic165f": [6.0, 12.0, -40.0, -2.0, -40.0, -73.0],
    "irb120": [0.0, 10.0, 20.0, 0.0, 50.0, 0.0],
    "kr6r900sixx": [0.0, -70.0, 100.0, 0.0, 60.0, 0.0],
    "gp7": [0.0, 10.0, -20.0, 0.0, -60.0, 0.0],
}
FORMATS = {
    "fanuc-ls": "r2000ic165f",
    "abb-rapid": "irb120",
    "kuka-krl": "kr6r900sixx",
    "yaskawa-jbi": "gp7",
}
MAKERS = {"r2000ic165f": "fanuc", "irb120": "abb", "kr6r900sixx": "kuka", "gp7": "yaskawa"}


def railed(
    folder: Path, arm: str, more: str = "", *, held: bool = False, speed: str = "1.2"
) -> Cell:
    path = folder / f"{arm}.urdf"
    path.write_text(on_slides(arm).replace('velocity="1.2"', f'velocity="{speed}"'))
    return Cell.from_text(
        f'[robot]\nurdf = "{path}"\ncontroller = "{MAKERS[arm]}"\ncapsule_radius_mm = 60.0\n'
        f"{'held_mm = { rail = 400.0 }' if held else ''}\n"
        "[tool]\npoint_mm = [40.0, 10.0, 120.0]\n[base_pose]\n"
        f"{'' if held else 'slides_mm = [400.0]'}\nposture_deg = {POSTURE[arm]}\n{more}"
        "[constraints]\ncollisions = false\n[truth]\ndeflection = false\n"
    )


def listed(cell: Cell, count: int = 14) -> PoseList:
    """Poses along the whole rail."""
    q = joint_candidates(cell, count, np.random.default_rng(0)).postures
    assert np.ptp(q[:, 0]) > 0.5
    return PoseList(tuple(f"P{k + 1}" for k in range(len(q))), q, np.zeros(len(q), dtype=bool))


def test_from_new_to_identify(cli, refuse, tmp_path):
    urdf, cell = tmp_path / "robot.urdf", tmp_path / "cell.toml"
    urdf.write_text(on_slides("r2000ic165f"))
    text = cli("new", "--robot", urdf).out
    assert "slides_mm = [500.0]  # of rail" in text
    assert '["zero_offsets", "scale"]' in text  # and not for an arm that stands
    assert '"scale"]' not in cli("new", "--robot", "r2000ic165f").out
    text = text.replace("# capsule_radius_mm = 280", "capsule_radius_mm = 200 #")
    cell.write_text(text.replace('# controller = "fanuc"', 'controller = "fanuc" #'))
    offsets_only(cell)
    assert cli("plan", cell, "--out", tmp_path / "plan").code == 0
    poses = tmp_path / "plan" / "poses.csv"
    found = read_poses(poses, 7, external=RAIL)
    assert found.postures.shape[1] == 7
    said = cli("program", poses, "--cell", cell, "--format", "fanuc-ls", "--out", tmp_path / "ls")
    assert "rounded by at most 0.001 deg, slides by 0 mm" in said.out
    (written,) = (tmp_path / "ls").glob("*.LS")
    assert "J6=" in written.read_text()
    assert "E1=" in written.read_text()
    remarks = re.sub(r"\s*;\s*\d+:\s*!\*\s*", " ", written.read_text())
    assert "NOT CHECKED: zero and direction of E1, taken to be those of rail" in remarks
    cli("simulate", cell, poses, "--out", tmp_path / "sim")
    touched = tmp_path / "sim" / "touchups.csv"
    assert touched.read_text().splitlines()[1].startswith("target,e1_mm,j1_deg")
    cli("identify", cell, touched, "--out", tmp_path / "sim")
    found = tmp_path / "sim" / "identification.json"
    drawn = _measured_deg(tmp_path / "sim", content := read_file(found))
    figure = figure_of_identification(content, drawn)
    assert figure is not None
    units = [axes.get_xlabel() for axes in figure.findobj(Axes) if "[" in axes.get_xlabel()]
    assert units == ["rail [mm]", *(f"joint_{k} [deg]" for k in range(1, 7))]
    said = cli("correct", cell, found, poses, "--out", tmp_path / "corrected")
    assert said.code == 0
    rows = (tmp_path / "corrected" / "mastering.csv").read_text()
    assert "J1,joint_1" in rows
    assert "rail" not in rows
    # a zero position mastering of the whole group would take where the rail stands for its zero
    assert ". E1 at 0 meanwhile, or left out" in rows
    said = " ".join(
        cli("correct", cell, found, "--out", tmp_path / "again", "--verbose").err.split()
    )
    assert "stands turned on rail looks like a zero of joint_1 that is off" in said
    assert "e1_mm" in (tmp_path / "corrected" / "corrected_poses.csv").read_text()
    corrected = Robot.from_urdf(tmp_path / "corrected" / "corrected.urdf")
    assert (corrected.lower[0], corrected.upper[0]) == (-1.5, 2.5)
    said = cli("correct", cell, found, written, "--joints", "--out", tmp_path / "prog")
    assert said.code == 0
    places = [
        re.findall(r"E1=.*", path.read_text())
        for path in (written, tmp_path / "prog" / written.name)
    ]
    assert places[0] == places[1]
    cell.write_text(cell.read_text().replace("slides_mm = [500.0]", "slides_mm = [0.0, 1.0]"))
    refuse("plan", cell, "--out", tmp_path / "plan2").says(
        "2 values for the slides of", "slides_mm"
    )
    cell.write_text(cell.read_text().replace("slides_mm = [0.0, 1.0]", "slides_mm = [2600.0]"))
    refuse("plan", cell, "--out", tmp_path / "plan2").says("rail 2600.0 mm is above 2490.0 mm")


@pytest.mark.parametrize("dialect", [*FORMATS, "ros-trajectory"])
def test_programs_hold_the_external_axis_and_come_back(tmp_path, dialect):
    pulses = f"[program]\npulses_per_deg = {[*PULSES]}\npulses_per_mm = [1310.72]\n"
    cell = railed(tmp_path, FORMATS.get(dialect, "irb120"), pulses)
    poses = listed(cell)
    made = write_program(
        poses, tmp_path / "out", dialect, program_options(cell, poses), "CALIB01", cell
    )
    back = import_touch_ups(cell, [made.paths[0]], poses, keep_untouched=True).touch_ups
    order = [poses.measured.names.index(name) for name in back.names]
    off = np.abs(back.postures - poses.measured.postures[order])
    assert off.max(axis=0)[0] <= 1e-6  # micrometres of the rail
    assert off.max() <= np.deg2rad(1.1e-3)
    assert made.largest_rounding_mm == pytest.approx(1e3 * off[:, 0].max(), abs=1e-9)
    assert made.largest_rounding_deg == pytest.approx(np.rad2deg(off[:, 1:].max()), abs=1e-9)


def test_the_ends_of_a_rail_are_left_out_and_its_unit_is_looked_at(tmp_path):
    cell = railed(tmp_path, "irb120")
    assert (cell.robot.lower[0], cell.robot.upper[0]) == (-1.49, 2.49)
    path = tmp_path / "cell.toml"
    text = cell_text(cell.config, tmp_path)
    for wrong, message in (
        ("[0.4]", r"looks like metres \(largest value 0.4\)"),
        ("[]", "0 values for the slides of .*: rail"),
    ):
        changed = re.sub(r"slides_mm = \[[^]]*\]", f"slides_mm = {wrong}", text)
        with pytest.raises(FileFormatError, match=message):
            Cell.from_text(changed, path)
    with pytest.raises(FileFormatError, match="1500 mm leaves little of the range of rail"):
        railed(tmp_path, "irb120", "[plan]\nslide_margin_mm = 1500.0\n")


def test_a_rail_in_metres_is_not_read_as_millimetres(tmp_path):
    path, joints = tmp_path / "touchups.csv", ",".join(f"j{k}_deg" for k in range(1, 7))
    rows = [f"T1,{e},10.5,20.5,-30.5,5.5,40.5,60.5" for e in (0.4, 1.2, 2.05)]
    path.write_text("\n".join([f"target,e1_mm,{joints}", *rows, ""]))
    with pytest.raises(FileFormatError, match=r"looks like metres \(the largest is 2.05\)"):
        read_measurements(path, 7, external=RAIL)
    assert read_measurements(path, 7, external=RAIL, trust_units=True).data.count == 3
    parked = [
        row.replace(f",{e},", ",0.35,") for row, e in zip(rows, (0.4, 1.2, 2.05), strict=True)
    ]
    path.write_text("\n".join([f"target,e1_mm,{joints}", *parked, ""]))
    assert read_measurements(path, 7, external=RAIL).data.postures[0, 0] == pytest.approx(0.35e-3)


def test_what_cannot_be_said_of_a_rail_is_refused(tmp_path):
    cell = railed(tmp_path, "gp7")
    poses = listed(cell, 12)
    options = program_options(cell, poses)
    for dialect, message in (
        ("robodk-csv", r"rail slides, and the external axes of .* are not written"),
        ("yaskawa-jbi", "pulses_per_deg has 0 values"),
    ):
        with pytest.raises(InputError, match=message):
            write_program(poses, tmp_path / "out", dialect, options, "A", cell)
    fanuc = railed(tmp_path, "r2000ic165f", '[program]\nform = "cartesian"\n')
    poses = listed(fanuc, 12)
    with pytest.raises(InputError, match="where its controller has the world is not known"):
        write_program(
            poses, tmp_path / "out", "fanuc-ls", program_options(fanuc, poses), "A", fanuc
        )


@pytest.mark.parametrize("dialect", ["kuka-krl", "abb-rapid"])
def test_poses_on_a_rail_need_the_world_that_it_moves_in(tmp_path, dialect):
    world = "{ at_mm = [100.0, -900.0, 0.0], wpr_deg = [0.0, 0.0, 90.0] }"
    form = f'[program]\nform = "cartesian"\nworld = {world}\n'
    cell = railed(tmp_path, FORMATS[dialect], form)
    poses = listed(cell, 12)
    options = program_options(cell, poses)
    made = write_program(poses, tmp_path / "out", dialect, options, "A", cell)
    back = import_touch_ups(cell, [made.paths[0]], poses, keep_untouched=True).touch_ups
    order = [poses.measured.names.index(name) for name in back.names]
    assert np.abs(back.postures - poses.measured.postures[order]).max() <= 2e-5
    without = railed(tmp_path, FORMATS[dialect], '[program]\nform = "cartesian"\n')
    with pytest.raises(InputError, match="where its controller has the world is not known"):
        write_program(poses, tmp_path / "out2", dialect, options, "A", without)
    fanuc = railed(tmp_path, "r2000ic165f", form)
    with pytest.raises(InputError, match=r"program.world is of .* a controller of kuka or abb"):
        arm_of(fanuc)


def test_a_rail_that_the_description_does_not_know_is_refused(tmp_path):
    cell = railed(tmp_path, "r2000ic165f")
    poses = listed(cell, 12)
    made = write_program(
        poses, tmp_path / "out", "fanuc-ls", program_options(cell, poses), "A", cell
    )
    alone = railed(tmp_path, "r2000ic165f", held=True)
    with pytest.raises(FileFormatError, match=r"E1 differs .* describe the slide in the URDF"):
        import_touch_ups(alone, [made.paths[0]], None, keep_untouched=True)


def test_an_axis_besides_the_rail_stands_still_and_a_rail_that_was_moved_is_seen(tmp_path):
    cell = railed(tmp_path, "r2000ic165f")
    poses = listed(cell, 12)
    made = write_program(
        poses, tmp_path / "out", "fanuc-ls", program_options(cell, poses), "A", cell
    )
    path, text = made.paths[0], made.paths[0].read_bytes().decode()
    places = re.findall(r"E1= +(\S+) ", text)
    moved = text.replace(f" {places[0]} ", f" {float(places[0]) + 0.02:.3f} ", 1)
    path.write_bytes(moved.encode())
    assert len(import_touch_ups(cell, [path], poses).touch_ups.names) == 1
    both = re.sub(r"(E1= +\S+  mm)", r"\1,\tE2=   250.000  mm", moved)
    path.write_bytes(both.encode())
    (said,) = (w for w in import_touch_ups(cell, [path], poses).warnings if "E2" in w)
    assert "E2 stands at 250 mm in all positions and is not in the robot's description" in said
    path.write_bytes(both.replace("E2=   250.000", "E2=   251.000", 1).encode())
    with pytest.raises(FileFormatError, match="E2 differs"):
        import_touch_ups(cell, [path], poses)


def test_a_rail_that_lost_its_zero_is_found_by_a_recheck(tmp_path):
    cell = railed(tmp_path, "r2000ic165f", "[pool]\ncandidates = 60\n")
    found = identified_in(cell)
    watch = Watch.of(cell, found.identified, {}, ["touch-up"])
    plan = plan_recheck(cell, watch, 4)
    assert 0.0 < plan.smallest()["zero of rail"] < 2e-3
    assert re.search(r"zero of rail [\d.]+ mm", answer_of_recheck_plan(cell, plan).figures["zeros"])
    data = found.robot.touch_up(plan.poses.kept, np.random.default_rng(2))
    rows = tuple(range(2, 6))
    assert watch.test(MeasurementTable(data, ("touch-up",), rows)).same
    off = data.postures - np.array([3e-3, *[0.0] * 6])
    outcome = watch.test(MeasurementTable(replace(data, postures=off), ("touch-up",), rows))
    assert not outcome.same
    assert "zero of rail" in {each.cause for each in outcome.possible}


@pytest.mark.parametrize("arm", ["irb120", "r2000ic165f"])
def test_the_rail_s_own_errors_are_found_as_well_as_predicted(tmp_path, arm):
    """By a tracker that sees reflectors: offsets of the arm, direction and scale of the rail."""
    planned = 'planned = ["zero_offsets", "scale"]'
    more = (
        '[[target]]\nname = "tracker"\nkind = "point"\nposition_mm = [3000.0, 1500.0, 900.0]\n'
        f'[parameters]\n{planned}\n[measurement]\nkind = "point"\n{TRACKER}'
        "[pool]\ncandidates = 300\n"
    )
    cell = railed(tmp_path, arm, more)
    chosen = plan_optimal(cell, Request(count=30, beside=0))
    assert "scale.rail" in chosen.model.names
    robot, which = SimulatedRobot.of(cell), cell.which(chosen.labels)
    names = [str(i) for i in range(len(which))]
    data = robot.measure(chosen.postures, which, names, np.random.default_rng(3), trials=200)
    model = chosen.model
    values = identify_batch(model, data.with_labels(model.targets, model.tools))
    sigma = np.sqrt(np.diag(covariance_of(model, chosen.postures, setup=chosen.setup)))
    check_scatter(np.asarray(values.std(axis=0, ddof=1) / sigma))
    k = model.names.index("scale.rail")
    assert abs(values[:, k].mean()) < 5.0 * sigma[k] / np.sqrt(200)  # it is where it says


def test_sides_are_those_of_the_first_joint_that_turns(tmp_path):
    more = '[plan]\nrepair_base_joint_deg = 20.0\n[[pool.limit]]\nside = "front"\nmost = 3\n'
    cell = railed(tmp_path, "r2000ic165f", more)
    pool = joint_candidates(cell, 200, np.random.default_rng(0))
    (limit,) = limits_of(cell, pool)
    front = in_front(pool.postures[:, 1], cell.base_posture[1])
    assert 0.2 < front.mean() < 0.8
    np.testing.assert_array_equal(limit.A[0] > 0, front)
    found = Replacements(cell).postures(1)
    assert np.ptp(found[:, 0]) > 1.0
    assert np.abs(found[:, 1] - cell.base_posture[1]).max() <= np.deg2rad(20.0)


def test_rows_of_one_pose_differ_in_millimetres(tmp_path):
    table = tmp_path / "touchups.csv"
    joints = ",".join(f"j{k}_deg" for k in range(1, 7))
    table.write_text(
        f"target,e1_mm,{joints},pose\nT1,400,1,2,3,4,5,6,P1\nT1,401.5,1,2,3,4,5,6,P1\n"
    )
    with pytest.raises(FileFormatError, match=r"P1 has other joint values .* \(by 1.5 mm\)"):
        read_measurements(table, 7, external=RAIL)


def test_on_a_lift_along_the_first_axis_its_zero_is_still_the_target_s(cli, tmp_path):
    urdf, cell = tmp_path / "robot.urdf", tmp_path / "cell.toml"
    upright = on_slides("r2000ic165f", [("lift", "0 0 1", "0", "0.8")])
    urdf.write_text(upright.replace('rpy="0.02 -0.03 0.01"', 'rpy="0 0 0"'))
    cell.write_text(
        cli("new", "--robot", urdf).out.replace("collisions = true", "collisions = false")
    )
    robot = Cell.load(cell).robot
    assert moved_as_base(robot) == ("lift", "joint_1")
    assert usual_offset_joints(robot) == ("joint_2", "joint_3", "joint_4", "joint_5")
    assert cli("plan", cell, "--out", tmp_path / "plan").code == 0
    assert moved_as_base(railed(tmp_path, "r2000ic165f").robot) == ("rail",)


def test_a_camera_s_file_has_the_joints_of_its_pictures_as_they_were(cli, tmp_path):
    urdf, path = tmp_path / "robot.urdf", tmp_path / "cell.toml"
    urdf.write_text(on_slides("ur10e"))
    path.write_text(
        f'[robot]\nurdf = "{urdf}"\n[tool]\npoint_mm = [40.0, 10.0, 120.0]\n[base_pose]\n'
        f"slides_mm = [400.0]\nposture_deg = {np.rad2deg(NEAR).tolist()}\n"
        f"[constraints]\ncollisions = false\n{BOARD}"
    )
    cell = Cell.load(path)
    T_floor_arm = cell.robot.fk(cell.base_posture) @ inverse(Robot.preset("ur10e").fk(NEAR))
    camera = BoardCamera(LENS, cell.board, blur_px=0.8, noise=2.0, light=0.1)
    rng, at = np.random.default_rng(4), cell.base_posture
    q = take_pictures(
        tmp_path / "pictures", cell.robot, camera, X, T_floor_arm @ Z, 12, rng, near=at
    )
    assert np.ptp(q[:, 0]) > 1.0
    write_rows(
        tmp_path / "joints.csv",
        ["picture", *joint_columns(7, RAIL)],
        cell.robot.shown(q),
    )
    told = ("--joints", tmp_path / "joints.csv", "--out", tmp_path)
    assert cli("camera", path, tmp_path / "pictures", *told).code == 0
    tree = json.loads((tmp_path / "camera.json").read_text())
    assert tree["slides"] == 1
    np.testing.assert_allclose(list(tree["joints_deg"].values()), cell.robot.shown(q))
    np.testing.assert_allclose(as_calibrated(cell, tmp_path / "camera.json")[1], q)


def test_joints_of_drawn_pictures_are_in_millimetres_and_degrees(tmp_path):
    camera = "[camera]\nimage_px = [320, 240]\n"
    cell = railed(tmp_path, "irb120", f'[measurement]\nkind = "board"\n{camera}{BOARD}')
    poses = PoseList(("P1",), cell.base_posture[None], np.zeros(1, dtype=bool))
    simulate_pictures(cell, poses, tmp_path / "drawn", 0)
    table = read_table(tmp_path / "drawn" / "joints.csv")
    found = postures_in_any_form(Path("joints.csv"), table.columns, table.rows, cell.robot, False)
    np.testing.assert_allclose(found, cell.base_posture[None])


def test_a_rail_comes_from_one_side_by_millimetres(tmp_path):
    more = '[plan]\napproach = "same-side"\napproach_deg = 5.0\n[pool]\ncandidates = 100\n'
    chosen = plan_optimal(railed(tmp_path, "r2000ic165f", more), Request(count=12, beside=0))
    poses = PoseList.of_route(chosen.poses, chosen.route)
    measured = np.flatnonzero(~poses.via)
    last = poses.postures[measured] - poses.postures[measured - 1]
    np.testing.assert_allclose(np.abs(last[:, 0]), 0.01)
    np.testing.assert_allclose(np.abs(last[:, 1:]), np.deg2rad(5.0))
    assert (np.ptp(last, axis=0) < 1e-9).all()


def test_a_rail_without_a_speed_is_not_as_fast_in_metres_as_joints_are_in_radians(tmp_path):
    timed = []
    for speed in ("1.2", "0"):
        cell = railed(tmp_path, "r2000ic165f", speed=speed)
        there = cell.base_posture.copy()
        there[0] += 0.9
        timed.append(Router.of_cell(cell).route(there[None]).moving_s)
    assert timed[1] == pytest.approx(1.2 * timed[0], rel=0.02)  # at 1.0 m/s
