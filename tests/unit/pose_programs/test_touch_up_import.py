"""Touched-up positions come back from a program as the touch-ups that they are."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.errors import InputError
from posedesign.cell import Cell, cell_template
from posedesign.files.measurements import write_measurements
from posedesign.planning import plan
from posedesign.planning.poses_file import PoseList, write_pose_list
from posedesign.pose_programs import (
    chosen_dialect,
    import_touch_ups,
    program_options,
    write_program,
)
from posedesign.pose_programs.from_plan import arm_of, with_approaches
from posedesign.programs import PoseProgram, ProgramPose, write
from posedesign.simulation import SimulatedRobot


@pytest.fixture(scope="module")
def planned(reference_cell) -> PoseList:
    found = plan(reference_cell)
    stops = found.stops
    return PoseList(
        tuple(name for name, _, _ in stops),
        np.stack([q for _, q, _ in stops]),
        np.array([via for _, _, via in stops]),
    )


@pytest.fixture(scope="module")
def touched(reference_cell, planned) -> np.ndarray:
    """Where the simulated robot, with its errors, stands when the tool meets the target."""
    robot = SimulatedRobot.of(reference_cell)
    postures = robot.touch_up(planned.measured.postures, np.random.default_rng(3)).postures
    return np.asarray(postures)


def returned(
    cell: Cell,
    planned: PoseList,
    touched: np.ndarray,
    folder: Path,
    form: str = "joint",
    **how: object,
) -> Path:
    """The program with positions re-taught, as a backup of the controller would have it."""
    options = replace(program_options(cell, planned, form), **how)  # type: ignore[arg-type]
    arrived = iter(touched)
    poses = tuple(
        ProgramPose(name, q if via else next(arrived), via=bool(via))
        for name, q, via in zip(planned.names, planned.postures, planned.via, strict=True)
    )
    return write(PoseProgram("BACK", poses, options, arm_of(cell)), "fanuc-ls", folder)[0]


@pytest.mark.parametrize(("form", "off_deg"), [("joint", 1.1e-3), ("cartesian", 2e-3)])
def test_what_was_touched_up_comes_back(form, off_deg, reference_cell, planned, touched, tmp_path):
    path = returned(reference_cell, planned, touched, tmp_path, form)
    back = import_touch_ups(reference_cell, [path], planned)
    assert back.touch_ups.names == planned.measured.names
    assert np.abs(np.rad2deg(back.touch_ups.postures - touched)).max() < off_deg
    point = reference_cell.robot.state
    tool = reference_cell.tool_m
    moved = point(touched).point(tool) - point(planned.measured.postures).point(tool)
    np.testing.assert_allclose(back.moved_mm, 1e3 * np.linalg.norm(moved, axis=1), atol=0.06)
    assert (back.untouched, back.missing) == ((), ())
    assert len(back.warnings) == (form == "joint")
    assert all("joints are stored to 0.001 deg" in line for line in back.warnings)


def test_what_rounding_adds_is_what_it_moves_the_tool_by(
    reference_cell, planned, touched, tmp_path
):
    """Against the real thing: positions rounded, and where the tool point then is."""
    q = np.concatenate([touched + k * 1.234e-5 for k in range(40)])
    arm = arm_of(reference_cell)
    rounded = arm.postures(np.round(arm.shown(q), 3))
    point = reference_cell.robot.state
    tool = reference_cell.tool_m
    moved = np.linalg.norm(point(rounded).point(tool) - point(q).point(tool), axis=1)
    path = returned(reference_cell, planned, touched, tmp_path)
    (said,) = import_touch_ups(reference_cell, [path], planned).warnings
    told = float(said.split("tool point by ")[1].split(" mm")[0])
    assert told == pytest.approx(1e3 * np.sqrt((moved**2).mean()), rel=0.1)


def test_the_order_of_measuring_is_that_of_the_plan_not_of_the_file(make_cell, tmp_path):
    """With postures passed through in between, which never count as touch-ups."""
    cell = make_cell(plan={"approach": "same-side"})
    found = plan(cell)
    listed = PoseList.of_route(found.poses, found.route)
    assert listed.via.sum() >= 27
    touched = SimulatedRobot.of(cell).touch_up(listed.measured.postures, None).postures
    back = import_touch_ups(cell, [returned(cell, listed, touched, tmp_path)], listed)
    assert back.touch_ups.names == found.names
    np.testing.assert_allclose(back.touch_ups.postures, touched, atol=2e-5)


def test_poses_that_were_not_touched_up_are_left_out(reference_cell, planned, touched, tmp_path):
    some = touched.copy()
    some[[2, 5]] = planned.measured.postures[[2, 5]]
    path = returned(reference_cell, planned, some, tmp_path)
    names = planned.measured.names
    back = import_touch_ups(reference_cell, [path], planned)
    assert back.untouched == (names[2], names[5])
    assert back.touch_ups.names == tuple(n for n in names if n not in back.untouched)
    kept = import_touch_ups(reference_cell, [path], planned, keep_untouched=True)
    assert kept.touch_ups.names == names
    with pytest.raises(InputError, match=r"was written from the plan .*: without it nobody"):
        import_touch_ups(reference_cell, [path])
    blind = import_touch_ups(reference_cell, [path], keep_untouched=True)
    assert blind.touch_ups.count == len(names)
    assert np.isnan(blind.moved_mm).all()


def test_a_program_of_another_plan_is_refused(reference_cell, planned, touched, tmp_path):
    other = replace(planned, postures=planned.postures + np.deg2rad(0.01))
    path = returned(reference_cell, other, touched, tmp_path)
    with pytest.raises(InputError, match=r"was written from the plan [0-9a-f]{8}, the poses are"):
        import_touch_ups(reference_cell, [path], planned)
    path.write_text(path.read_text().replace("PLAN", "NOTE"))
    back = import_touch_ups(reference_cell, [path], planned)
    assert back.warnings[0] == f"{path}: does not say which plan it was written from"


def test_parts_of_a_program_are_put_together(reference_cell, planned, touched, tmp_path):
    path = returned(reference_cell, planned, touched, tmp_path)
    text = path.read_text()
    stored, end = text.index("/POS\n") + 5, text.index("/END")
    start = text.index("P[10:", stored)
    first, second = tmp_path / "A.LS", tmp_path / "B.LS"
    first.write_text(re.sub(r" *\d+:J P\[\d\d\].*\n", "", text[:start]) + text[end:])
    second.write_text(re.sub(r" *\d+:J P\[\d\] .*\n", "", text[:stored]) + text[start:])
    back = import_touch_ups(reference_cell, [second, first], planned)
    assert sorted(back.touch_ups.names) == sorted(planned.measured.names)
    part = import_touch_ups(reference_cell, [first], planned)
    assert part.missing == planned.measured.names[9:]
    with pytest.raises(InputError, match=r"pose P\d\d is in a file before it, too"):
        import_touch_ups(reference_cell, [first, first], planned)


def test_registers_come_back_by_their_numbers(make_cell, planned, touched, tmp_path):
    cell = make_cell(program={"keep": "register", "first_register": 31})
    lines = ["[*POSREG*]$POSREG  Storage: SHADOW  Access: RW  : ARRAY[1,100] OF Position Reg"]
    lines += [
        "    [1,1] =   'HOME'   Group: 1",
        "  J1 = 1.000 deg   J2 = 2.000 deg   J3 = 3.000 deg",
    ]
    lines += ["  J4 = 4.000 deg   J5 = 5.000 deg   J6 = 6.000 deg"]
    for k, q in enumerate(arm_of(cell).shown(touched)):
        lines.append(f"    [1,{31 + k}] =   ''   Group: 1")
        values = [f"  J{j + 1} = {value:.3f} deg" for j, value in enumerate(q)]
        lines += ["".join(values[:3]), "".join(values[3:])]
    path = tmp_path / "POSREG.VA"
    path.write_text("\n".join(lines) + "\n")
    back = import_touch_ups(cell, [path], planned)
    assert back.touch_ups.names == planned.measured.names
    np.testing.assert_allclose(back.touch_ups.postures, touched, atol=2e-5)


def test_a_list_in_csv_comes_back_by_its_names(reference_cell, planned, touched, tmp_path):
    measured = planned.measured
    path = tmp_path / "results.csv"
    plan_of = (f"fingerprint: {planned.fingerprint}",)  # as an edited poses.csv has it
    turned = PoseList(measured.names[::-1], touched[::-1], measured.via, comments=plan_of)
    write_pose_list(path, turned, reference_cell.robot, reference_cell.tool_m)
    back = import_touch_ups(reference_cell, [path], planned)
    assert back.touch_ups.names == measured.names[::-1]
    np.testing.assert_allclose(back.touch_ups.postures, touched[::-1], atol=1e-10)
    text = path.read_text().replace(f"{measured.names[3]},", "X9,", 1)
    path.write_text(text)
    with pytest.raises(InputError, match="pose X9 is not in the plan"):
        import_touch_ups(reference_cell, [path], planned)


def test_what_is_odd_is_said(reference_cell, planned, touched, tmp_path):
    off = touched.copy()
    off[0, 0] += np.deg2rad(20.0)
    off[1, 4] = np.deg2rad(-126.0)
    path = returned(reference_cell, planned, off, tmp_path)
    warnings = import_touch_ups(reference_cell, [path], planned).warnings
    assert any("from the target" in line for line in warnings)
    assert any("-126" in line for line in warnings)


def test_a_program_of_a_cell_is_judged_as_it_is_rounded(reference_cell, planned, tmp_path):
    options = program_options(reference_cell, planned)
    written = write_program(planned, tmp_path, "fanuc-ls", options, "CALIB01", reference_cell)
    assert written.problems == ()
    assert written.largest_rounding_deg < 1.1e-3
    assert written.c_g_rounded == pytest.approx(written.c_g, rel=1e-3)
    assert written.c_g_rounded != written.c_g
    assert not written.warning
    worse = replace(written, c_g_rounded=1.02 * (written.c_g or 0.0))
    assert "rounding moved C_G by +2.0%" in worse.warning


def test_each_pose_is_approached_from_one_side(reference_cell, planned):
    listed = with_approaches(reference_cell, planned.measured, 1.0)
    steps = np.rad2deg(listed.postures[1::2] - listed.postures[::2])
    assert listed.via.tolist() == [True, False] * 27
    np.testing.assert_allclose(np.abs(steps), 1.0)
    assert (steps == steps[0]).all() or np.allclose(steps, steps[0])
    assert listed.measured.names == planned.measured.names
    with pytest.raises(InputError, match="pass `cell`"):
        with_approaches(None, planned, 1.0)
    with pytest.raises(InputError, match="approach_deg is 0"):
        with_approaches(reference_cell, planned, 0.0)


def test_a_list_that_is_approached_is_not_approached_again(make_cell):
    cell = make_cell(plan={"approach": "same-side"})
    found = plan(cell)
    with pytest.raises(InputError, match="approached from one side already"):
        with_approaches(cell, PoseList.of_route(found.poses, found.route), 1.0)


def test_the_dialect_is_that_of_the_controller(reference_cell, planned, tmp_path):
    assert chosen_dialect(reference_cell, planned, None) == "fanuc-ls"
    panda = Cell.from_text(cell_template("panda"))
    assert chosen_dialect(panda, planned, None) == "franky-python"
    with pytest.raises(
        InputError, match=r"an unknown maker \(pass `cell`, or choose with `format`"
    ):
        chosen_dialect(None, planned, None)
    assert chosen_dialect(None, planned, "kuka-krl") == "kuka-krl"
    listed = replace(planned, comments=("controller: fanuc",))
    assert chosen_dialect(None, listed, None) == "fanuc-ls"
    assert chosen_dialect(None, listed, "ros-trajectory") == "ros-trajectory"
    with pytest.raises(InputError, match="controller of fanuc, kuka-krl is for one of kuka"):
        chosen_dialect(None, listed, "kuka-krl")


def test_user_frame_zero_is_the_world(make_cell):
    cell = make_cell(program={"user": {"at_mm": [1.0, 0.0, 0.0]}})
    with pytest.raises(InputError, match="user frame 0 of a FANUC is the world"):
        arm_of(cell)
    moved = arm_of(make_cell(program={"user_frame": 2, "user": {"at_mm": [1.0, 0.0, 0.0]}}))
    np.testing.assert_allclose(moved.T_world_user[:3, 3], [1e-3, 0, 0])
    np.testing.assert_allclose(moved.T_tip_tool[:3, 3], cell.tool_m)


def test_a_foreign_program_is_not_joined_by_its_numbers(reference_cell, planned, touched, tmp_path):
    """Without a mark of the plan, positions have to be near those of the plan."""
    path = returned(reference_cell, planned, touched, tmp_path)
    path.write_text(path.read_text().replace("!PLAN", "!NOTE"))
    back = import_touch_ups(reference_cell, [path], planned)
    assert back.warnings
    far = touched.copy()
    far[3, 1] += np.deg2rad(3.0)
    path = returned(reference_cell, planned, far, tmp_path)
    path.write_text(path.read_text().replace("!PLAN", "!NOTE"))
    name = planned.measured.names[3]
    with pytest.raises(InputError, match=rf"position 4 is .* mm from where the plan has {name}"):
        import_touch_ups(reference_cell, [path], planned)
    # the way back to the base posture cannot be told from a pose
    assert import_touch_ups(reference_cell, [path]).touch_ups.count == 28


def test_names_that_several_positions_have_are_told_apart(
    reference_cell, planned, touched, tmp_path
):
    path = returned(reference_cell, planned, touched, tmp_path)
    text = path.read_text().replace("!PLAN", "!NOTE")
    for name in planned.measured.names[:3]:
        text = text.replace(f'"{name}"', '"App"')
    path.write_text(text)
    names = import_touch_ups(reference_cell, [path]).touch_ups.names
    assert names[:3] == ("App_1", "App_2", "App_3")
    assert len(set(names)) == len(names)


def test_poses_in_other_frames_are_refused(make_cell, planned, touched, tmp_path):
    user = {"user_frame": 3, "user": {"at_mm": [100.0, 0.0, 0.0]}}
    cell = make_cell(program=user)
    path = returned(cell, planned, touched, tmp_path, "cartesian")
    assert import_touch_ups(cell, [path], planned).touch_ups.count == 27
    for other, message in (
        ({"user_frame": 2, "user": user["user"]}, "is in user frame 3, the cell has 2"),
        ({**user, "tool_frame": 5}, "is in tool frame 1, the cell has 5"),
        ({"user_frame": 3}, "poses in user frame 3 need to know where it is"),
    ):
        with pytest.raises(InputError, match=message):
            import_touch_ups(make_cell(program=other), [path], planned)
    text = path.read_text()
    path.write_text(text.replace("\tUF : 3, UT : 1,", "\tUF : F, UT : F,"))
    warnings = import_touch_ups(cell, [path], planned).warnings
    assert any("does not say in which frames" in line for line in warnings)


def test_poses_are_not_written_into_a_frame_that_nobody_knows(make_cell, planned, tmp_path):
    cell = make_cell(program={"user_frame": 3, "form": "cartesian"})
    options = program_options(cell, planned)
    with pytest.raises(InputError, match="poses in user frame 3 need to know where it is"):
        write_program(planned, tmp_path, "fanuc-ls", options, "CAL", cell)
    joint = replace(options, form="joint")
    assert not write_program(planned, tmp_path, "fanuc-ls", joint, "CAL", cell).note
    world = make_cell(program={"form": "cartesian"})
    written = write_program(
        planned, tmp_path, "fanuc-ls", program_options(world, planned), "CAL", world
    )
    assert "tool frame 1 is taken to be the cell's tool point (200, -50, 350) mm" in written.note


def test_one_pose_has_no_condition_to_move(reference_cell, planned, tmp_path):
    one = PoseList(planned.names[:1], planned.postures[:1], planned.via[:1])
    options = program_options(reference_cell, one)
    assert not write_program(one, tmp_path, "fanuc-ls", options, "CAL", reference_cell).warning


def test_poses_that_were_exchanged_are_found_out(reference_cell, planned, touched, tmp_path):
    """All touch the same target: only the joints tell them apart."""
    two = touched.copy()
    two[[4, 9]] = two[[9, 4]]
    names = planned.measured.names
    back = import_touch_ups(
        reference_cell, [returned(reference_cell, planned, two, tmp_path)], planned
    )
    assert back.doubtful
    assert any(f"{names[4]}: stands nearer to {names[9]}" in line for line in back.warnings)
    shifted = returned(reference_cell, planned, np.roll(touched, 9, axis=0), tmp_path)
    with pytest.raises(InputError, match="27 of 27 positions stand at other poses of the plan"):
        import_touch_ups(reference_cell, [shifted], planned)


def test_two_poses_of_one_name_are_refused(reference_cell, planned, touched, tmp_path):
    path = returned(reference_cell, planned, touched, tmp_path)
    names = (planned.names[0], planned.names[0], *planned.names[2:])
    double = replace(planned, names=names)
    with pytest.raises(InputError, match=f"there are two poses {names[0]}"):
        import_touch_ups(reference_cell, [path], double)
    options = program_options(reference_cell, double)
    with pytest.raises(InputError, match=f"there are two poses {names[0]}"):
        write_program(double, tmp_path, "fanuc-ls", options, "CAL", reference_cell)


def test_a_list_of_touch_ups_needs_no_import(reference_cell, planned, tmp_path):
    path = tmp_path / "touchups.csv"
    measured = SimulatedRobot.of(reference_cell).touch_up(planned.measured.postures, None)
    write_measurements(path, measured)
    with pytest.raises(InputError, match="is a list of touch-ups already"):
        import_touch_ups(reference_cell, [path], planned)


@pytest.mark.parametrize(
    ("preset", "dialect"), [("kr6r900sixx", "kuka-krl"), ("tx2_60", "staubli-val3")]
)
def test_all_files_of_a_program_may_be_named(preset, dialect, tmp_path):
    cell = Cell.from_text(cell_template(preset, surroundings=False))
    found = plan(cell)
    listed = PoseList.of_route(found.poses, found.route)
    touched = SimulatedRobot.of(cell).touch_up(listed.measured.postures, None).postures
    arrived = iter(touched)
    poses = tuple(
        ProgramPose(name, q if via else next(arrived), via=bool(via))
        for name, q, via in zip(listed.names, listed.postures, listed.via, strict=True)
    )
    program = PoseProgram("BACK", poses, program_options(cell, listed), arm_of(cell))
    paths = write(program, dialect, tmp_path)
    assert len(paths) > 1
    back = import_touch_ups(cell, sorted(paths), listed)
    assert back.touch_ups.names == found.names
    with pytest.raises(InputError, match="is a folder"):
        import_touch_ups(cell, [tmp_path], listed)
