"""A bad cell or URDF: one line that says what, where and what to do; exit code 2; no file."""

import pytest

from posedesign.cell import file as config
from tests.cli.conftest import keys_of, offsets_only, refusals

CELL_CASES = refusals(r"""
preset that does not exist | robot.preset = "r2000ic165" => did you mean r2000ic165f
preset nowhere near | robot.preset = "kuka" => known: gp7, hp3, | r2000ic165f
tip that does not exist | robot.tip = "tol0" => 'tol0' | did you mean tool0?
base that does not exist | robot.base = "base_lnk" => 'base_lnk' | base_link
base that is the tip | robot.base = "tool0" => no moving joint | another tip
preset and urdf | robot.urdf = "a.urdf" => either preset or urdf
preset that is a number | robot.preset = 5 => string | 5
control characters | robot.preset = "a\u0000b" => not allowed here
unknown key | plan.condition_treshold = 1e5 => did you mean condition_threshold?
unknown key with an alias near | variations.rase = "best" => did you mean raise?
tool point of two values | tool.point_mm = [1.0, 2.0] => is missing
tool point of four values | tool.point_mm = [1, 2, 3, 4] => too many values
tool point as text | tool.point_mm = "200, 0, 0" => should be a list in [ ]
tool point not finite | tool.point_mm = [nan, 0.0, 0.0] => finite number | nan
tool point in another solar system | tool.point_mm = [1e9, 0.0, 0.0] => 1000000
mass below zero | tool.mass_kg = -1.0 => greater than or equal to 0 | -1
posture of five joints | base_pose.posture_deg = [0, 15, -25, 0, -50] =>
  has 6 joints, the posture has 5 values | joint_1, joint_2
posture of seven joints | base_pose.posture_deg = [0, 15, -25, 0, -50, 0, 0] =>
  has 6 joints, the posture has 7 values
posture with text | base_pose.posture_deg = [0, "x", 0, 0, 0, 0] => number | 'x'
posture not finite | base_pose.posture_deg = [0, inf, 0, 0, 0, 0] => finite
posture in radians | base_pose.posture_deg = [0.0, 0.2618, -0.4363, 0.0, -0.8727, 0.0] =>
  looks like radians | degrees
posture outside the limits | base_pose.posture_deg = [0, 80, -25, 0, -50, 0] =>
  outside the limits | joint_2 80.0 deg is above 76.0 deg | inside the limits
variation below zero | variations.start_deg = [-1, 5, 5] => equal to 0, not -1
margin that leaves nothing | plan.limit_margin_deg = 70 =>
  leaves nothing of the range of joint_2 | below 68 deg
deflection of a rigid arm | truth.stiffness_nm_per_rad = [1e6, 1e6] => 2 values for 6 joints
step below zero | variations.step_deg = [5, -5, 5] => equal to 0.1, not -5
rounds without end | variations.step_deg = [5, 1e-9, 5] => equal to 0.1, not 1e-09
variation beyond half a turn | variations.largest_deg = [60, 60, 200] => 180, not 200
start above the largest | variations.start_deg = [5, 70, 5] => start_deg 70 is above largest_deg 60
raise in a way unknown | variations.raise = "twice" => 'together' or 'best'
threshold below zero | plan.condition_threshold = -1.0 => greater than 0 | -1
threshold as text | plan.condition_threshold = "low" => valid number | 'low'
margin below zero | plan.limit_margin_deg = -5.0 => greater than or equal to 0
repair neither true nor false | plan.repair = 3 => boolean | 3
offset of an unknown joint | parameters.zero_offsets = ["joint_2", "joint_33"] =>
  no joint 'joint_33' | joint_3
offset twice | parameters.zero_offsets = ["joint_2", "joint_2"] => listed twice
offsets as text | parameters.zero_offsets = "joint_2" => should be a list
tool axes in another order | parameters.tool_axes = "zx" => another order | 'zx'
tool point along a view line | measurement.kind = "view-line" => tool_axes | to "xy"
unknown kind | measurement.kind = "touchup" => 'camera-pose' or 'board'
noise of zero | measurement.three_sigma_mm = [0.02, 0.0, 0.1] => greater than 0
noise below zero | measurement.three_sigma_mm = [0.02, -1, 0.1] => greater than 0 | -1
one noise for three axes | measurement.three_sigma_mm = 0.02 => should be a list
camera noise of zero | measurement.camera_three_sigma_mm = 0.0 => greater than 0
camera angle noise of zero | measurement.camera_three_sigma_deg = 0 => greater than 0
seed with a fraction | truth.seed = 1.5 => valid integer | 1.5
offsets of two joints | truth.zero_offsets_deg = [0.1, 0.2] =>
  2 values for 6 joints | one value for each joint
speed above full speed | program.speed_percent = 200 => less than or equal to 100
empty target name | target.name = "" => at least 1 character
line end in a target name | target.name = "a\nb" => not allowed here
""")


@pytest.mark.parametrize(("given", "words"), CELL_CASES)
def test_key_of_the_cell(refuse, change_cell, work, given, words):
    line = refuse("plan", change_cell(keys_of(given)), "--out", work / "out")
    section = "tool_axes" if "tool_axes" in words else given[0].split(".")[0]
    line.says(str(work / "cell.toml"), section, *words, "(")


@pytest.mark.parametrize(
    "command",
    [
        ("score", "{cell}", "{work}/poses.csv"),
        ("simulate", "{cell}", "{work}/poses.csv", "--out", "{work}/out"),
        ("identify", "{cell}", "{work}/touchups.csv", "--out", "{work}/out"),
        ("program", "{work}/poses.csv", "--cell", "{cell}", "--out", "{work}/out"),
        ("study", "accuracy", "{cell}", "--draws", "10", "--out", "{work}/out"),
    ],
    ids=lambda words: words[0],
)
def test_every_command_refuses_a_bad_cell(refuse, change_cell, work, command):
    cell = change_cell({"plan.condition_treshold": "1.0"})
    line = refuse(*(word.format(cell=cell, work=work) for word in command))
    line.says(str(cell), "plan.condition_treshold", "condition_threshold?")


CELL_TEXTS = {
    "nothing in it": (b"", ("robot", "is missing")),
    "a section that does not exist": (b"[tooll]\nmass_kg = 1\n", ("tooll", "did you mean tool")),
    "a value for a section": (b"robot = 5\n", ("robot", "table")),
    "no TOML": (b"robot preset\n", ("no valid TOML", "line 1", "mend")),
    "a table twice": (b"[robot]\n[robot]\n", ("no valid TOML", "line 2")),
    "half a string": (b'[robot]\npreset = "r2\n', ("no valid TOML", "line 2")),
    "binary": (bytes(range(256)), ("not UTF-8", "save it as UTF-8")),
    "UTF-16": ("[robot]\n".encode("utf-16"), ("not UTF-8",)),
    "nested deep": (b"a = " + b"[" * 100_000, ("no valid TOML",)),
    "a number of ten thousand digits": (b"a = " + b"9" * 10_000, ("no valid TOML",)),
    "a CSV": (b"name,j1_deg\nP1,0.5\n", ("no valid TOML", "line 1")),
}


@pytest.mark.parametrize(("data", "words"), CELL_TEXTS.values(), ids=CELL_TEXTS)
def test_text_of_the_cell(refuse, work, data, words):
    path = work / "cell.toml"
    path.write_bytes(data)
    refuse("plan", path, "--out", work / "out").says(str(path), *words)


def test_cell_that_is_not_there(refuse, work):
    line = refuse("plan", work / "nosuch.toml", "--out", work / "out")
    line.says("nosuch.toml: cannot be read: No such file", "posedesign new > cell.toml")
    refuse("plan", work, "--out", work / "out").says("Is a directory")


def test_cell_that_is_too_large(refuse, work, monkeypatch):
    monkeypatch.setattr(config, "LARGEST_CELL_BYTES", 100)
    refuse("plan", work / "cell.toml", "--out", work / "out").says("cell.toml", "is larger")
    refuse("plan", "/dev/zero", "--out", work / "out").says("/dev/zero", "is larger")


def test_base_pose_out_of_reach(refuse, change_cell, work):
    stretched = {
        "base_pose.posture_deg": "[0.0, 60.0, 60.0, 0.0, -60.0, 0.0]",
        "target.position_mm": "[3400.0, 50.0, 1040.0]",
    }
    line = refuse("plan", change_cell(stretched), "--out", work / "out")
    line.says("the base pose cannot be taken", "out of reach by", "mm", "move the target")


@pytest.mark.parametrize("position", ["[9000.0, 0.0, 500.0]", "[1.915, 0.05, 0.493]"])
def test_target_far_from_the_base_pose(refuse, change_cell, work, position):
    cell = change_cell({"target.position_mm": position})
    line = refuse("plan", cell, "--out", work / "out")
    line.says("the target is", "mm from where the base posture puts", "target.position_mm in mm")


def test_base_pose_inside_the_margin(refuse, change_cell, work):
    line = refuse("plan", change_cell({"plan.limit_margin_deg": "65.0"}), "--out", work / "out")
    line.says("the base pose cannot be taken", " deg is ", "lower plan.limit_margin_deg")


@pytest.mark.parametrize("joint", ["joint_1", "joint_6"])
@pytest.mark.parametrize("command", ["plan", "identify"])
def test_joint_that_cannot_be_identified_is_named(refuse, change_cell, work, joint, command):
    joints = sorted({"joint_2", "joint_3", "joint_4", "joint_5", joint})
    cell = offsets_only(change_cell({"parameters.zero_offsets": str(joints).replace("'", '"')}))
    words = [command, cell, *([work / "touchups.csv"] if command == "identify" else [])]
    line = refuse(*words, "--out", work / "out")
    if command == "plan":
        line.says(f"no pose can tell zero_offset.{joint}:", f"leave {joint} out of parameters")
    else:
        line.says(f"cannot identify zero_offset.{joint}:", "leave it out")
    line.says("absorbed by")


def test_score_names_the_joint_that_cannot_be_identified(cli, change_cell, work):
    cell = change_cell({"parameters.zero_offsets": '["joint_1", "joint_2"]'})
    said = cli("score", cell, work / "poses.csv")
    assert said.code == 1
    assert "cannot identify zero_offset.joint_1" in said.out


def test_new_names_near_presets(refuse):
    line = refuse("new", "--robot", "r2000ic165")
    line.says("'r2000ic165' is neither a preset nor a URDF", "did you mean r2000ic165f")


URDF_TEXTS = {
    "cut off": (b'<robot name="a"><link name="l0"/>', ("not well-formed XML", "line 1")),
    "not a robot": (b"<sdf/>", ("<sdf>, not <robot>", "convert")),
    "entities": (
        b'<!DOCTYPE r [<!ENTITY a "aa">]><robot name="&a;"/>',
        ("entities are not accepted", "DOCTYPE"),
    ),
    "xacro": (
        b'<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:a/></robot>',
        ("xacro", "xacro file.xacro > file.urdf"),
    ),
}


@pytest.mark.parametrize(("data", "words"), URDF_TEXTS.values(), ids=URDF_TEXTS)
def test_text_of_the_urdf(refuse, tmp_path, data, words):
    path = tmp_path / "arm.urdf"
    path.write_bytes(data)
    refuse("new", "--robot", path).says(str(path), *words)


def test_urdf_that_is_not_there(refuse, cli, make_urdf, tmp_path):
    line = refuse("new", "--robot", tmp_path / "no.urdf")
    line.says("no.urdf: cannot be read: No such file", "posedesign robots")
    urdf = make_urdf()
    (tmp_path / "cell.toml").write_text(cli("new", "--robot", urdf).out)
    urdf.unlink()
    line = refuse("plan", tmp_path / "cell.toml", "--out", tmp_path / "out")
    line.says(str(tmp_path / "cell.toml"), "robot", f"{urdf}: cannot be read")


def test_urdf_changed_under_the_cell(refuse, cli, make_urdf, tmp_path):
    (tmp_path / "cell.toml").write_text(cli("new", "--robot", make_urdf()).out)
    make_urdf({"a3": {"lower": 1.0, "upper": -1.0}})
    line = refuse("plan", tmp_path / "cell.toml", "--out", tmp_path / "out")
    line.says("small.urdf", "joint 'a3'", "limits reversed")
