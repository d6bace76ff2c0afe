"""An arm beside a turn-tilt table that carries the targets: from the description to the report."""

import re
from pathlib import Path

import numpy as np
import pytest

from calib import Robot
from calib.errors import FileFormatError, InputError
from calib.identification import covariance_of, identify_batch
from calib.robots import Controller, ExternalAxes
from calib.se3 import apply, inverse
from posedesign.acceptance.places import where_axes_stood
from posedesign.candidates import joint_candidates
from posedesign.cell import Cell
from posedesign.cell.cell import posture_section
from posedesign.cell.file import cell_text
from posedesign.cell.orientations import suggest_base_posture
from posedesign.constraints import Situation
from posedesign.files.csv_tables import Row
from posedesign.files.measurements import read_measurements
from posedesign.files.postures import JointForm, columns_of, postures_in_any_form
from posedesign.planning.optimal import Request, plan_optimal
from posedesign.planning.poses_file import PoseList, read_poses
from posedesign.pose_programs import import_touch_ups, program_options, write_program
from posedesign.programs import PoseProgram, ProgramPose, find_dialect
from posedesign.programs.arm import Arm
from posedesign.report.tour import link_frames
from posedesign.simulation import SimulatedRobot
from tests.cli.conftest import offsets_only
from tests.measured_cells import check_scatter
from tests.positioners import beside_positioner

pytestmark = pytest.mark.usefixtures("one_alternative")

TABLE = ExternalAxes(positioner=2)
PLACE = {"r2000ic165f": 1.6, "irb120": 0.5, "kr6r900sixx": 0.7, "ur10e": 0.8}
MAKERS = {"r2000ic165f": "fanuc", "irb120": "abb", "kr6r900sixx": "kuka", "ur10e": "ur"}
PIN = '[target]\nname = "T1"\nposition_mm = [-120.0, 40.0, 160.0]\n'
PINS = (
    '[[target]]\nname = "T1"\nposition_mm = [-120.0, 40.0, 160.0]\n'
    '[[target]]\nname = "T2"\nposition_mm = [90.0, 110.0, 120.0]\n'
)


def cell_of(folder: Path, arm: str, more: str = PINS, *, box: str = "") -> Cell:
    """A cell with its base posture above the plate, as it is found for a new one."""
    path, tool_m = folder / f"{arm}.urdf", np.array([0.04, 0.01, 0.12])
    path.write_text(beside_positioner(arm, place=PLACE[arm]))
    tip = Robot.preset(arm).tip_frame
    robot = Robot.from_urdf(path, tip=tip, base="plate")
    posture = posture_section(robot, suggest_base_posture(robot, tool_m))
    return Cell.from_text(
        f'[robot]\nurdf = "{path}"\nbase = "plate"\ntip = "{tip}"\n'
        f'controller = "{MAKERS[arm]}"\ncapsule_radius_mm = 40.0\n'
        "[tool]\npoint_mm = [40.0, 10.0, 120.0]\n[base_pose]\n"
        f"positioner_deg = {list(posture.positioner_deg)}\n"
        f"posture_deg = {list(posture.posture_deg)}\n{more}"
        f"[constraints]\ncollisions = false\n{box}[truth]\ndeflection = false\n"
    )


def listed(cell: Cell, count: int = 16) -> PoseList:
    """Poses all around the table."""
    q = joint_candidates(cell, count, np.random.default_rng(0)).postures
    poses = PoseList(tuple(f"P{k + 1}" for k in range(len(q))), q, np.zeros(len(q), dtype=bool))
    assert (np.ptp(poses.measured.postures[:, :2], axis=0) > 0.5).all()
    return poses


def test_from_new_to_report(cli, refuse, tmp_path):
    urdf, path = tmp_path / "robot.urdf", tmp_path / "cell.toml"
    urdf.write_text(beside_positioner("r2000ic165f", place=1.6))
    text = cli("new", "--robot", urdf, "--base", "plate", "--tip", "tool0").out
    assert "positioner_deg = [0.0, 0.0]  # of tilt, turn" in text
    assert 'zero_offsets = ["tilt", "joint_1", "joint_2"' in text
    text = text.replace("# capsule_radius_mm = 280", "capsule_radius_mm = 100 #")
    path.write_text(text.replace('# controller = "fanuc"', 'controller = "fanuc" #'))
    offsets_only(path)
    plan, poses = tmp_path / "plan", tmp_path / "plan" / "poses.csv"
    assert cli("plan", path, "--out", plan).code == 0
    header = next(line for line in poses.read_text().splitlines() if line.startswith("name,"))
    assert "e1_deg,e2_deg,j1_deg" in header
    found = read_poses(poses, 8, external=TABLE)
    assert (np.ptp(found.measured.postures[:, :2], axis=0) > np.deg2rad(60.0)).all()
    cli("program", poses, "--cell", path, "--format", "fanuc-ls", "--out", tmp_path / "ls")
    (written,) = (tmp_path / "ls").glob("*.LS")
    assert re.search(r"E1= +-?\d+\.\d+ deg,\s+E2= +-?\d+\.\d+ deg", written.read_text())
    remarks = re.sub(r"\s*;\s*\d+:\s*!\*\s*", " ", written.read_text())
    assert "zero and direction of E1, taken to be those of tilt" in remarks
    assert "zero and direction of E2, taken to be those of turn" in remarks
    cli("simulate", path, poses, "--out", tmp_path)
    cli("identify", path, tmp_path / "touchups.csv", "--out", tmp_path)
    told = (tmp_path / "identification.json", poses, "--out", tmp_path / "corrected")
    said = cli("correct", path, *told, "--verbose")
    assert said.code == 0
    words = " ".join(said.err.split())
    assert "mastering is of the arm: the zero of" in words
    again = Robot.from_urdf(tmp_path / "corrected" / "corrected.urdf", tip="tool0", base="plate")
    assert again.joint_names == Cell.load(path).robot.joint_names
    assert cli("check", path, poses).code == 0
    assert cli("view", path, poses, "--out", tmp_path / "view.html").code == 0
    assert cli("report", tmp_path).code == 0
    assert "tilt" in (tmp_path / "report.html").read_text()
    options = ("--format", "fanuc-ls", "--form", "cartesian", "--out", tmp_path / "b")
    refuse("program", poses, "--cell", path, *options).says("turns what is measured")
    refuse("correct", path, told[0], written, "--out", tmp_path / "prog").says(
        "programs with such axes are not corrected"
    )
    text = path.read_text().replace("positioner_deg = [0.0, 0.0]", "positioner_deg = [9.0]")
    path.write_text(text)
    refuse("plan", path, "--out", tmp_path / "c").says("1 values for the positioner", "tilt, turn")


@pytest.mark.parametrize(
    ("dialect", "arm"),
    [
        ("fanuc-ls", "r2000ic165f"),
        ("abb-rapid", "irb120"),
        ("kuka-krl", "kr6r900sixx"),
        ("ros-trajectory", "irb120"),
    ],
)
def test_programs_hold_the_table_in_degrees_and_come_back(tmp_path, dialect, arm):
    cell = cell_of(tmp_path, arm, PIN)
    poses = listed(cell)
    options = program_options(cell, poses)
    made = write_program(poses, tmp_path / "out", dialect, options, "CALIB01", cell)
    back = import_touch_ups(cell, [made.paths[0]], poses, keep_untouched=True).touch_ups
    order = [poses.measured.names.index(name) for name in back.names]
    off = np.abs(back.postures - poses.measured.postures[order])
    assert off.max() <= np.deg2rad(1.1e-3)


def test_e1_is_the_tilt_and_e2_the_turn_on_it(tmp_path):
    """As they hang in the description: the tilt first, though the chain has it last."""
    arm = Arm(Controller("kawasaki", np.eye(8), np.eye(4), external=TABLE))
    postures = np.random.default_rng(0).uniform(-2.5, 2.5, (5, 8))
    poses = tuple(ProgramPose(f"P{k}", q) for k, q in enumerate(postures, start=1))
    dialect = find_dialect("kawasaki-as")
    (path,) = dialect.write(PoseProgram("CALIB", poses, arm=arm), tmp_path)
    assert dialect.validate(path) == []
    found = dialect.read(path)
    np.testing.assert_allclose(found.postures(arm), postures, atol=2e-8)
    shown = np.array([p.external_shown for p in found.positions])
    np.testing.assert_allclose(shown, np.rad2deg(postures[:, [1, 0]]), atol=1e-5)


def test_units_of_external_axes_are_those_of_the_description(tmp_path):
    cell = cell_of(tmp_path, "r2000ic165f", PIN)
    poses = listed(cell, 12)
    options = program_options(cell, poses)
    (path,) = write_program(poses, tmp_path / "out", "fanuc-ls", options, "A", cell).paths
    path.write_bytes(re.sub(rb"(E1= *[-\d.]+) deg", rb"\1  mm", path.read_bytes()))
    with pytest.raises(InputError, match=r"E1 is in mm, and the description's tilt in deg"):
        import_touch_ups(cell, [path], None, keep_untouched=True)
    joints = ",".join(f"j{k}_deg" for k in range(1, 7))
    table = tmp_path / "touchups.csv"
    rows = [f"T1,{e},{e / 2},10.5,20.5,-30.5,5.5,40.5,60.5" for e in (0.4, 1.2, 2.05)]
    for columns, message in (
        ("e1_deg,e2_deg", r"looks like radians \(the largest is"),
        ("e1_mm,e2_deg", "is in another unit than deg"),
        ("e1_deg,e3_deg", "there is no column e2_deg"),
    ):
        table.write_text("\n".join([f"target,{columns},{joints}", *rows, ""]))
        with pytest.raises(FileFormatError, match=message):
            read_measurements(table, 8, external=TABLE)
    table.write_text("\n".join([f"target,e1_deg,e2_deg,{joints}", *rows, ""]))
    q = read_measurements(table, 8, external=TABLE, trust_units=True).data.postures
    np.testing.assert_allclose(np.rad2deg(q[1, :2]), [0.6, 1.2])  # the turn comes first


def test_tables_in_radians_and_metres_have_no_external_axis_in_degrees_or_millimetres(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(beside_positioner("ur10e", rail=True))
    robot = Robot.from_urdf(path, tip=Robot.preset("ur10e").tip_frame, base="plate")
    columns = columns_of(JointForm.ROS, robot)
    row = dict(zip(columns, np.linspace(0.1, 0.9, robot.n), strict=True))
    for column, value, message in (
        ("tilt_rad", -35.0, "looks like degrees"),
        ("rail_m", 900.0, "looks like millimetres"),
    ):
        rows = [Row(2, {c: str(v) for c, v in {**row, column: value}.items()})]
        with pytest.raises(FileFormatError, match=message) as error:
            postures_in_any_form(path, columns, rows, robot, trust_units=False)
        assert error.value.column == column
        q = postures_in_any_form(path, columns, rows, robot, trust_units=True)
        assert q[0, columns.index(column)] == value


def test_a_base_pose_in_radians_is_refused(tmp_path):
    cell = cell_of(tmp_path, "ur10e", PIN)
    text = cell_text(cell.config, tmp_path)
    listed = re.search(r"positioner_deg = \[.*\]", text)
    assert listed is not None
    for values, refused in (("0.5236, -1.2566", True), ("1.5, -0.3", False), ("0.05, 30.0", False)):
        changed = text.replace(listed[0], f"positioner_deg = [{values}]")
        if refused:
            with pytest.raises(FileFormatError, match="looks like radians") as error:
                Cell.from_text(changed)
            assert error.value.key == "base_pose.positioner_deg"
        else:
            Cell.from_text(changed)


@pytest.mark.parametrize("arm", ["ur10e", "r2000ic165f"])
def test_the_table_s_zero_is_found_as_well_as_predicted(tmp_path, arm):
    """By two pins on it: the tilt and all joints of the arm but the last one."""
    pool = '[parameters]\nplanned = ["zero_offsets"]\n[pool]\ncandidates = 300\n'
    cell = cell_of(tmp_path, arm, pool + PINS, box="smallest_singular_value = 0.05\n")
    chosen = plan_optimal(cell, Request(count=30, beside=0))
    assert {"zero_offset.tilt", f"zero_offset.{cell.robot.arm_joints[0]}"} <= {*chosen.model.names}
    assert "zero_offset.turn" not in chosen.model.names
    robot, which = SimulatedRobot.of(cell), cell.which(chosen.labels)
    names = [str(i) for i in range(len(which))]
    data = robot.measure(chosen.postures, which, names, np.random.default_rng(3), trials=400)
    model = chosen.model
    values = identify_batch(model, data.with_labels(model.targets, model.tools))
    sigma = np.sqrt(np.diag(covariance_of(model, chosen.postures, setup=chosen.setup)))
    ratio = np.asarray(values.std(axis=0, ddof=1) / sigma)
    check_scatter(ratio)
    assert ((ratio > 0.9) & (ratio < 1.1)).all()
    k = model.names.index("zero_offset.tilt")
    found = values[:, k].mean() - robot.value("zero_offset.tilt")
    assert abs(found) < 5.0 * sigma[k] / np.sqrt(400)


def test_what_stands_around_says_whether_it_turns(tmp_path):
    post = (
        '[[obstacle]]\nname = "post"\nsize_mm = [100.0, 100.0, 900.0]\n'
        "at_mm = [500.0, 0.0, 450.0]\n"
    )
    with pytest.raises(FileFormatError, match="it is not said whether this turns with it"):
        cell_of(tmp_path, "ur10e", PINS + post)
    cell = cell_of(tmp_path, "ur10e", PINS + post + 'stands_on = "floor"\n')
    (body,) = cell.obstacles
    assert body.link == cell.robot.floor == 2
    q = cell.base_posture.copy()
    q[:2] = 0.7, -0.4
    frames = link_frames(cell, np.array([cell.base_posture, q]))  # as a view draws them
    placed = frames[:, 2] @ body.T_link_body
    np.testing.assert_allclose(placed[0], placed[1], atol=1e-12)
    np.testing.assert_allclose(placed[0, :3, 3], [0.5, 0.0, 0.45], atol=1e-12)
    assert np.abs(frames[0, 0] - frames[1, 0]).max() > 0.1
    turning = cell_of(tmp_path, "ur10e", PINS + post + 'stands_on = "positioner"\n')
    assert turning.obstacles[0].link == 0
    with pytest.raises(FileFormatError, match="a half-space cannot stand on a positioner"):
        cell_of(
            tmp_path,
            "ur10e",
            PINS + '[[obstacle]]\nname = "ground"\nkind = "half-space"\nstands_on = "positioner"\n',
        )


def test_a_workspace_stands_on_the_floor(tmp_path):
    """One side of it: how far the arm is beyond goes by its joints and tool point in the world."""
    box = (
        "workspace_lowest_mm = [-9000.0, -9000.0, -9000.0]\n"
        "workspace_highest_mm = [400.0, 9000.0, 9000.0]\n"
    )
    cell = cell_of(tmp_path, "ur10e", box=box)
    robot, (side,) = cell.robot, cell.solid
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (20, robot.n))
    margin, _ = side.margin(Situation(robot.chain, q, in_full=True))
    T_base_world = robot.T_base_floor(q) @ robot.T_floor_world
    points = [robot.state(q).point(cell.tool_m), *robot.state(q).origins[:, 3:].swapaxes(0, 1)]
    x = [apply(inverse(T_base_world), p)[:, 0] for p in points]
    farthest = np.max(x, axis=0)
    assert (margin <= 0.4 - farthest + 1e-5).all()  # bodies about them reach farther
    assert (margin >= np.minimum(0.4 - farthest, 0.5) - 0.15).all()


def test_who_measures_from_the_floor_is_told_so(tmp_path):
    seen = '[[target]]\nname = "tracker"\nkind = "point"\nposition_mm = [2000.0, 0.0, 500.0]\n'
    noise = '[[noise]]\nkind = "point"\nthree_sigma_mm = 0.03\n'
    for more, message in (
        (seen + noise, "it is not said whether tracker turns with plate"),
        (seen + 'stands_on = "floor"\n' + noise, "tracker does not turn with plate"),
    ):
        with pytest.raises(FileFormatError, match=message):
            cell_of(tmp_path, "ur10e", more)
    assert cell_of(tmp_path, "ur10e", seen + 'stands_on = "positioner"\n' + noise)


def test_new_has_a_camera_on_the_flange_and_its_board_on_the_plate(cli, refuse, tmp_path):
    urdf = tmp_path / "robot.urdf"
    urdf.write_text(beside_positioner("ur10e", place=PLACE["ur10e"]))
    named = ("--robot", urdf, "--base", "plate", "--tip", "tool0")
    text = cli("new", *named, "--camera", "flange").out
    cell = Cell.from_text(text + "\n[constraints]\ncollisions = false\n" * ("[constr" not in text))
    floor, stand = cell.obstacles
    assert (floor.link, stand.link) == (cell.robot.floor, 0)
    low = stand.T_link_body[2, 3] - stand.solid.size_m[2] / 2.0
    assert low == pytest.approx(0.0, abs=1e-4)  # on the plate
    refuse("new", *named, "--camera", "fixed").says("does not turn with plate")


def test_a_test_of_the_arm_says_of_which_angles_of_the_table_it_is(tmp_path):
    robot = cell_of(tmp_path, "ur10e").robot
    q = np.zeros((5, robot.n))
    (said,) = where_axes_stood(robot, q)
    assert said.startswith("E1, E2 hardly moved: ")
    q[0, 1] = 1.2  # the tilt, by a third of its range
    assert where_axes_stood(robot, q)[0].startswith("E2 hardly moved: ")
    q[0, 0] = 3.0
    assert where_axes_stood(robot, q) == []
    assert where_axes_stood(Robot.preset("ur10e"), q[:, 2:]) == []
