"""What keeps an arm, and its user, from going astray: limits, targets, and options that matter."""

import json
from pathlib import Path

import pytest

from tests.cli.conftest import offsets_only


def with_joint_2_at_90_deg(path: Path) -> Path:
    """The same file with the second joint of its third row moved out of the limits."""
    lines = path.read_text().splitlines()
    column = lines[0].split(",").index("j2_deg")
    cells = lines[3].split(",")
    cells[column] = "90.0"
    lines[3] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n")
    return path


def test_an_arm_is_not_sent_beyond_its_limits(refuse, work):
    poses, cell = with_joint_2_at_90_deg(work / "poses.csv"), work / "cell.toml"
    for words in (("simulate", cell, poses), ("program", poses, "--cell", cell)):
        refuse(*words, "--out", work / "out").says(
            ": joint_2 90.0 deg is above 76.0 deg", "URDF signs"
        )


def test_touch_ups_beyond_the_limits_are_named(cli, work):
    touch_ups = with_joint_2_at_90_deg(work / "touchups.csv")
    said = cli("identify", offsets_only(work / "cell.toml"), touch_ups, "--out", work)
    assert f"warning: {touch_ups}: line 4: joint_2 90.0 deg is above 76.0 deg" in said.err


def test_a_target_far_from_the_base_posture_is_worth_a_word(cli, change_cell, work):
    cell = change_cell({"target.position_mm": "[1915.4, 50.0, 693.0]"})
    said = cli("plan", cell, "--out", work / "out")
    assert (
        "warning: the target is 200 mm from where the base posture puts the tool point" in said.err
    )


def test_bodies_that_are_given_in_metres_are_doubted(cli, work):
    path = work / "cell.toml"
    table = 'name = "table"\nkind = "box"\nsize_mm = [0.5, 0.7, 0.4]\nat_mm = [900, 900, 200]'
    path.write_text(path.read_text() + f"\n[[obstacle]]\n{table}\n")
    said = cli("check", path, work / "poses.csv")
    assert "warning: table is 0.7 mm large: is its size in mm?" in said.err


def test_a_study_without_offsets_shows_the_tool(done, change_cell, work, monkeypatch):
    drawn = "posedesign.report.accuracy.draw_accuracy"
    monkeypatch.setattr(drawn, lambda study, path: path)  # longer than the study
    cell = change_cell({"parameters.zero_offsets": "[]", "variations.largest_deg": "[10, 10, 10]"})
    said = done("study", "accuracy", cell, "--draws", 10, "--out", work)
    assert "x sd" in said.out


def test_score_does_not_praise_poses_that_touch_nothing(cli, work, change_csv):
    poses = change_csv("poses.csv", 2, "j1_deg", "40")
    said = cli("score", work / "cell.toml", poses)
    assert said.code == 1
    assert ": the tool point is " in said.err
    assert "mm from the target" in said.err
    assert "; 1 off the target\n" in cli("check", work / "cell.toml", poses).out
    said = cli("simulate", work / "cell.toml", poses, "--out", work / "out")
    assert said.code == 2
    assert "error: pose P" in said.err


def test_predictions_are_those_of_the_estimator_asked_for(cli, change_cell, work):
    cell = change_cell({"measurement.weighted": "false"})
    plan = json.loads(cli("plan", cell, "--out", work / "out", "--json").out)
    assert plan["predicted"][0]["predicted sigma"] == pytest.approx(0.01216, rel=0.01)
    score = json.loads(cli("score", cell, work / "poses.csv", "--json").out)
    assert score["predicted"][0]["predicted sigma"] == pytest.approx(0.01216, rel=0.01)


def test_an_angle_that_is_held(cli, change_cell, work):
    cell = change_cell(
        {"variations.start_deg": "[5, 5, 0]", "variations.largest_deg": "[60, 60, 0]"}
    )
    plan = json.loads(cli("plan", cell, "--out", work / "out", "--json").out)
    assert {row["grid"] + row["repaired"] for row in plan["rounds"]} == {9}
    assert {row["d_r_deg"] for row in plan["rounds"]} == {0}


def test_the_newton_raphson_of_the_paper(cli, change_cell, work):
    by = {}
    offsets_only(work / "cell.toml")
    for method in ("gauss-newton", "newton-raphson"):
        cell = change_cell({"parameters.method": f'"{method}"'})
        said = cli("identify", cell, work / "touchups.csv", "--out", work, "--json")
        content = json.loads(said.out)
        by[method] = [p["value"] for p in content["models"][1]["parameters"]]
    assert by["gauss-newton"] == pytest.approx(by["newton-raphson"], rel=1e-4, abs=1e-5)


def test_a_stiffness_of_ones_own_makes_the_arm_deflect(done, change_cell, work):
    files = []
    for stiffness in ("[1e6, 1e6, 1e6, 1e6, 1e6, 1e6]", "[1e9, 1e9, 1e9, 1e9, 1e9, 1e9]"):
        cell = change_cell({"truth.stiffness_nm_per_rad": stiffness})
        done("simulate", cell, work / "poses.csv", "--out", work / "out")
        files.append((work / "out" / "touchups.csv").read_text())
    assert files[0] != files[1]


def test_arms_of_few_joints_are_planned_for_what_reads_the_tool_anywhere(cli, done, tmp_path):
    """Turned about one point they show little; joint values of a pool need not."""
    joints = "".join(
        f"""<link name="l{i + 1}"/><joint name="j{i + 1}" type="revolute"><parent link="l{i}"/>
        <child link="l{i + 1}"/><origin xyz="0.3 0 0.1"/><axis xyz="0 {i % 2} {1 - i % 2}"/>
        <limit lower="-2" upper="2" velocity="1" effort="1"/></joint>"""
        for i in range(4)
    )
    (tmp_path / "arm.urdf").write_text(f'<robot name="short"><link name="l0"/>{joints}</robot>')
    offsets = {"j2": 0.3, "j3": -0.2}
    config = (
        '[robot]\nurdf = "arm.urdf"\n[tool]\npoint_mm = [10, 0, 10]\n'
        "[base_pose]\nposture_deg = [10, 20, 30, 40]\n[constraints]\ncollisions = false\n"
        f'[parameters]\nzero_offsets = {list(offsets)}\nmodels = [["zero_offsets"]]\n'
        f"[truth]\nzero_offsets_deg = [0.0, {offsets['j2']}, {offsets['j3']}, 0.0]\n"
        "deflection = false\n"
    )
    tracker = (
        '[target]\nposition_mm = [2500, 500, 800]\n[measurement]\nkind = "point"\n'
        '[[noise]]\nkind = "point"\nthree_sigma_mm = 0.1\n'
    )
    touched, read = tmp_path / "touched.toml", tmp_path / "read.toml"
    touched.write_text(config)
    read.write_text(config + tracker)
    planned = cli("plan", touched, "--out", tmp_path / "touched")
    assert planned.code == 1  # one way to turn left: worse than was asked for
    assert (tmp_path / "touched" / "poses.csv").is_file()
    said = cli("plan", read, "--out", tmp_path)
    assert said.code == 2
    assert "the loop turns the tool about one point, and short has 4 axes" in said.err
    assert "method exchange" in said.err
    done("plan", read, "--method", "exchange", "--out", tmp_path)
    done("simulate", read, tmp_path / "poses.csv", "--out", tmp_path)
    done("identify", read, tmp_path / "measurements.csv", "--out", tmp_path)
    models = json.loads((tmp_path / "identification.json").read_text())["models"]
    (model,) = (model for model in models if model["name"] == "offsets")
    found = {p["name"].removeprefix("zero_offset."): p for p in model["parameters"]}
    for joint, true in offsets.items():
        assert found[joint]["value"] == pytest.approx(true, abs=4.0 * found[joint]["sigma"])
        assert found[joint]["sigma"] < 0.1


def test_a_fanuc_program_is_written_for_a_fanuc_only(cli, done, work):
    """The pendant's J3 of another arm would be wrong by its J2."""
    robot = """<robot name="{name}"><link name="l0"/>{joints}</robot>"""
    joint = """<link name="l{n}"/><joint name="j{n}" type="revolute"><parent link="l{m}"/>
        <child link="l{n}"/><origin xyz="{xyz}"/><axis xyz="{axis}"/>
        <limit lower="-4" upper="4" velocity="1" effort="1"/></joint>"""
    places = ["0 0 .67", ".312 0 0", "0 0 1.075", "0 0 .225", "1.28 0 0", ".215 0 0"]
    axes = ["0 0 1", "0 1 0", "0 -1 0", "-1 0 0", "0 -1 0", "-1 0 0"]
    joints = "".join(joint.format(n=i + 1, m=i, xyz=places[i], axis=axes[i]) for i in range(6))
    (work / "arm.urdf").write_text(robot.format(name="other", joints=joints))
    new = cli("new", "--robot", work / "arm.urdf")
    assert 'say before planning whose it is, for programs need it: robot.controller = "f' in new.err
    (work / "other.toml").write_text(new.out)
    planned = done("plan", work / "other.toml", "--out", work / "other")
    assert 'robot.controller = "fanuc" perhaps; then posedesign program' in planned.out
    words = ("program", work / "other" / "poses.csv", "--cell", work / "other.toml", "--out", work)
    said = cli(*words)
    assert said.code == 2
    assert 'an unknown maker (set robot.controller = "fanuc" in the cell' in said.err
    assert "choose with --format: ros-trajectory, moveit-joints" in said.err
    said = cli(*words, "--format", "fanuc-ls")
    assert said.code == 2
    assert "other has an unknown controller: its joints would be taken in the wrong" in said.err
    assert not (work / "CALIB01.LS").exists()
    (work / "other.toml").write_text(new.out.replace("# controller =", "controller ="))
    done(*words)


@pytest.mark.slow
@pytest.mark.usefixtures("rendered")
def test_a_study_on_an_arm_without_room_for_the_plate(done, change_cell, work):
    cell = change_cell(
        {
            "base_pose.posture_deg": "[0.0, 70.0, -10.0, 0.0, -20.0, 0.0]",
            "variations.largest_deg": "[10, 10, 10]",
        }
    )
    said = done("study", "accuracy", cell, "--draws", 10, "--out", work)
    assert "note: plate test left out: point" in said.err
    assert (work / "accuracy_vs_condition.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    "words",
    [
        ("check", "{cell}", "{poses}"),
        ("score", "{cell}", "{poses}"),
        ("program", "{poses}", "--cell", "{cell}"),
        ("convert", "{poses}", "--cell", "{cell}", "--to", "ros"),
        ("simulate", "{cell}", "{poses}"),
        ("predict", "{cell}", "{poses}", "--box", "1500,-300,300,2100,300,900"),
    ],
    ids=lambda words: words[0],
)
def test_poses_that_were_changed_after_planning_are_told(cli, work, words):
    """Their program would carry another plan's margins, indices and what was checked."""
    poses = work / "poses.csv"
    poses.write_text(f"# fingerprint: 0123456789ab\n{poses.read_text()}")
    said = [word.format(cell=work / "cell.toml", poses=poses) for word in words]
    out = ["--out", work / "out"] * (words[0] not in ("check", "score"))
    err = cli(*said, *out).err
    assert f"warning: {poses}: the postures are others than those that were planned" in err


def test_poses_of_another_robot_are_refused_by_name(cli, refuse, work, tmp_path):
    """Both arms take most of these joint values: limits alone say nothing."""
    poses = work / "poses.csv"
    head = "# posedesign: measuring poses of m20ia\n"
    poses.write_text(head + poses.read_text())
    for command in (
        ("program", poses, "--cell", work / "cell.toml"),
        ("simulate", work / "cell.toml", poses),
    ):
        refuse(*command, "--out", tmp_path / "out").says("robot 'm20ia', not of 'r2000ic165f'")
    said = cli("check", work / "cell.toml", poses)
    assert "warning" in said.err
    assert "robot 'm20ia', not of 'r2000ic165f'" in said.err
    poses.write_text(poses.read_text().replace("m20ia", "r2000ic165f"))
    assert "not of" not in cli("check", work / "cell.toml", poses).err


def test_a_tool_heavier_than_the_robot_carries_is_warned_of(cli, change_cell, work):
    assert "carries" not in cli("check", work / "cell.toml", work / "poses.csv").err
    change_cell({"tool.mass_kg": "1060.0"})
    said = cli("check", work / "cell.toml", work / "poses.csv")
    assert "warning: the tool weighs 1060 kg, and the robot carries 165 kg at most" in said.err
