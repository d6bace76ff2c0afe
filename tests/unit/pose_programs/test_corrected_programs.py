"""Programs of all dialects, corrected: what is in them takes the real arm where it was meant."""

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from calib import CalibrationModel, Robot
from calib.correction import corrected_robot
from calib.errors import FileFormatError, InputError
from calib.model.measurements import TouchUp
from calib.model.parameters import (
    JointCompliance,
    LinkGeometry,
    Payload,
    TargetPoints,
    ToolPoint,
    ZeroOffsets,
)
from calib.se3 import FloatArray, inverse, rotation_exp, rotation_from_wpr, rotation_log, transform
from posedesign.pose_programs.correcting import NO_POSTURE, correct_positions, correct_program
from posedesign.pose_programs.from_plan import arm_of as pose_arm_of
from posedesign.programs import (
    DIALECTS,
    Arm,
    Dialect,
    PoseProgram,
    ProgramPose,
    RecordedPosition,
    RecordedProgram,
    registry,
    rewriting,
)
from posedesign.programs.reading import read_program_bytes
from posedesign.programs.recorded import CORRECTED, corrected_by
from posedesign.programs.rewriting import Change, rewritten
from tests import arms
from tests.arms import PULSES
from tests.marks import by_stage
from tests.rails import on_slides
from tests.unit.correction.test_compensation import clear_postures
from tests.unit.programs.dialects import (
    CARRIED,
    EXPORTS,
    HOW,
    POSED,
    TOOL,
    USER,
    arm_of,
    dialect_of,
    each_case,
    options_of,
    robot_of,
)

TOOL_M = TOOL[:3, 3]
SIZES = {"rad": 3e-3, "m": 2e-3}
REACH_M = 4.0
"""Farthest point of the tool of these arms from any of their joints."""

BAR_M = 1e-6
EXACT = 1e-10
counts = pytest.mark.parametrize("count", by_stage(12, 100, 1000))


@cache
def errors_of(robot: Robot) -> tuple[CalibrationModel, FloatArray]:
    """Errors of millimetres that a chain can hold: so there is a second way to compute."""
    blocks = [
        ZeroOffsets(robot, robot.joint_names),
        LinkGeometry(robot),
        ToolPoint(TOOL_M),
        TargetPoints([[1.0, 0.0, 0.5]]),
    ]
    model = CalibrationModel(robot, blocks, TouchUp(1e-5))
    size = np.array([SIZES[unit] for unit in model.units])
    return model, model.nominal + size * np.random.default_rng(1).uniform(-1, 1, model.p)


def files_of(name: str, postures: FloatArray, form: str, folder: Path) -> list[Path]:
    """The files with the positions of a program."""
    poses = tuple(ProgramPose(f"T{i}", q) for i, q in enumerate(postures))
    program = PoseProgram("CALPOSE", poses, options_of(name, form=form), arm_of(name))
    ending = dialect_of(name).suffixes[0]
    files = dialect_of(name).write(program, folder)
    return [path for path in files if path.suffix.lower() == ending]


def corrected(path: Path, name: str, model: CalibrationModel, x: FloatArray, **how: object):
    dialect = dialect_of(name)
    arm = dialect.seen(arm_of(name))
    how = {"tool_m": TOOL_M, "joints": True, **how}
    return correct_positions(dialect, read_program_bytes(path), path, arm, model, x, **how)


def of_controller(p: RecordedPosition, arm: Arm, near: FloatArray) -> FloatArray:
    """The posture that a controller takes, which knows the arm as described.

    A pose by inverse kinematics of its own: the answer of the arm position in the file.
    """
    if p.T_user_tool is None:
        shown = p.shown_deg
        if p.joint_names:
            shown = shown[[p.joint_names.index(name) for name in arm.joint_names]]
        return arm.postures(shown)
    user = USER if p.T_world_user is None else p.T_world_user
    tool = TOOL if p.T_tip_tool is None else p.T_tip_tool
    world = user @ p.T_user_tool @ inverse(tool)
    answers = arm.robot.inverse(arm.controller.T_base_world @ world[None], every_turn=True).of(0)
    if p.configuration is not None:
        words = arm.configurations(answers)
        answers = answers[[p.configuration.allows(said) for said in words]]
    return answers[np.argmin(np.linalg.norm(answers - near, axis=1))]


@each_case
@counts
def test_targets_keep_their_place_on_the_real_arm(name, form, count, tmp_path):
    robot, dialect = robot_of(name), dialect_of(name)
    model, x = errors_of(robot)
    q = clear_postures(robot, count)
    arm, real = dialect.seen(arm_of(name)), corrected_robot(model, x).robot
    real_tool = np.array([x[model.names.index(f"tool.{axis}")] for axis in "xyz"])
    how, stay = HOW[name], 0
    for path in files_of(name, q, form, tmp_path):
        meant = dialect.read(path)
        done = corrected(path, name, model, x)
        if not done.ok:  # in Yaskawa's ///RCONF above several positions nothing is changed
            assert name == "yaskawa-jbi"
            assert {re.sub(r"[\d,]+", "#", why) for why in done.reasons if why} == {
                "leaves its arm position # for #"
            }
            left = [p.number for p, why in zip(done.positions, done.reasons, strict=True) if why]
            stay += len(left)
            done = corrected(path, name, model, x, leave=left)
        assert done.moved_m.max() > 1e-3
        assert done.error_m.max() < BAR_M / 1e6  # before the numbers are rounded
        again = dialect.parse(done.data, path)
        spin = np.deg2rad(how.joint_deg) * robot.n * REACH_M
        rounding = how.pose[0] * 3 + how.pose[1] if form == "cartesian" else 2 * spin
        for i in done.corrected:
            nominal = of_controller(meant.positions[i], arm, q[meant.positions[i].number - 1])
            wanted = robot.state(nominal).point(TOOL_M)
            command = of_controller(again.positions[i], arm, nominal)
            assert np.linalg.norm(real.state(command).point(real_tool) - wanted) < rounding + EXACT
        assert done.written_m.max() < rounding + EXACT
    assert stay <= count / 100


@each_case
@counts
def test_without_errors_a_program_is_the_same_byte_for_byte(name, form, count, tmp_path):
    model, _ = errors_of(robot_of(name))
    for path in files_of(name, clear_postures(robot_of(name), count), form, tmp_path):
        assert corrected(path, name, model, model.nominal).data == read_program_bytes(path)


def masked(line: str) -> str:
    """A line without the values of its numbers, and blanks before them."""
    return re.sub(r"(?<![\w.])[ ]*[-+]?(\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", "#", line)


@each_case
def test_only_numbers_of_positions_change(name, form, tmp_path):
    model, x = errors_of(robot_of(name))
    (path,) = files_of(name, clear_postures(robot_of(name), 5), form, tmp_path)
    before, after = read_program_bytes(path), corrected(path, name, model, x).data
    assert before != after
    texts = [data.decode("latin-1").split("\n") for data in (before, after)]
    changed = [(a, b) for a, b in zip(*texts, strict=True) if a != b]
    assert all(masked(a) == masked(b) for a, b in changed)
    dialect = dialect_of(name)
    assert dialect.validate(path) == []
    path.write_bytes(after)
    assert dialect.validate(path) == []


@cache
def on_a_rail(name: str) -> Robot:
    """Its arm on a rail, with the controller of its maker."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "arm.urdf"
        path.write_text(on_slides(robot_of(name)).replace('rpy="0 0 1.2"', 'rpy="0 0 0"'))
        robot = Robot.from_urdf(path)
    maker = DIALECTS[name].maker
    return robot.controlled_by(maker) if maker else robot


@pytest.mark.parametrize("name", CARRIED)
def test_on_a_rail_the_arm_alone_is_corrected(name, tmp_path):
    robot, dialect = on_a_rail(name), dialect_of(name)
    model, x = errors_of(robot)
    q, arm = clear_postures(robot, 8), dialect.seen(Arm.of(robot, USER, TOOL))
    poses = tuple(ProgramPose(f"T{i}", row) for i, row in enumerate(q))
    path = dialect.write(PoseProgram("CALPOSE", poses, options_of(name), arm), tmp_path)[0]
    data, how = read_program_bytes(path), {"tool_m": TOOL_M, "joints": True}
    same = correct_positions(dialect, data, path, arm, model, model.nominal, **how)
    assert same.data == data
    done = correct_positions(dialect, data, path, arm, model, x, **how)
    assert done.ok, done.reasons
    assert done.error_m.max() < BAR_M / 1e6
    meant, now = (dialect.parse(content, path) for content in (data, done.data))
    before, after = (program.postures(arm) for program in (meant, now))
    np.testing.assert_array_equal(before[:, 0], after[:, 0])  # as the file has it, to the digit
    real = corrected_robot(model, x).robot
    real_tool = np.array([x[model.names.index(f"tool.{axis}")] for axis in "xyz"])
    off = real.state(after).point(real_tool) - robot.state(before).point(TOOL_M)
    spin = np.deg2rad(HOW[name].joint_deg) * robot.n * REACH_M
    assert np.linalg.norm(off, axis=1).max() < 2 * spin + EXACT
    assert done.moved_m.max() > 1e-3


def test_on_a_rail_the_joint_that_would_turn_is_named(tmp_path):
    robot, dialect = on_a_rail("abb-rapid"), dialect_of("abb-rapid")
    model, x = errors_of(robot)
    arm = dialect.seen(Arm.of(robot, USER, TOOL))
    pose = ProgramPose("T0", np.append(0.5, np.deg2rad([10, 20, 10, 20, 1.0, 30])))
    program = PoseProgram("CALPOSE", (pose,), options_of("abb-rapid"), arm)
    path = dialect.write(program, tmp_path)[0]
    how = {"tool_m": TOOL_M, "joints": True}
    done = correct_positions(dialect, read_program_bytes(path), path, arm, model, x, **how)
    assert re.match(r"next to a singularity: joint_[46] would turn by \d+\.\d deg", done.reasons[0])


@each_case
def test_a_corrected_program_says_so_and_is_as_valid_as_before(name, form, tmp_path):
    for path in files_of(name, clear_postures(robot_of(name), 3), form, tmp_path):
        dialect, before = dialect_of(name), read_program_bytes(path)
        meant = dialect.read(path)
        text = dialect.with_remark(before.decode("latin-1"), CORRECTED.format("1a2b3c4d"))
        path.write_bytes(text.encode("latin-1"))
        assert dialect.validate(path) == []
        said = [p.message for p in dialect.validate(path, ["note"]) if p.rule == "corrected"]
        has_comments = name != "robodk-csv"
        by = "corrected by the identification 1a2b3c4d"
        assert said == [f"positions are of the arm {by}"] * has_comments
        assert corrected_by(before) == ""
        read = dialect.read(path)
        assert (read.mark, read.name) == (meant.mark, meant.name)
        for new, old in zip(read.positions, meant.positions, strict=True):
            assert (new.number, new.name, new.configuration) == (
                *(old.number, old.name),
                old.configuration,
            )
            np.testing.assert_array_equal(new.shown_deg, old.shown_deg)
            np.testing.assert_array_equal(new.T_user_tool, old.T_user_tool)


PEOPLE = sorted(p.name for p in EXPORTS.iterdir() if p.suffix != ".log")
IN_ANOTHER_ORDER = {"fanuc.LS": 35, "kuka.dat": 20}
"""Lines of positions whose values stand in an order that no controller writes."""


def read_export(path: Path) -> tuple[Dialect, RecordedProgram]:
    """The file, with the pulses of a degree where it does not say them."""
    dialect = DIALECTS[registry.dialect_of(path).name]
    try:
        return dialect, dialect.read(path)
    except FileFormatError:
        return dialect.reading(PULSES), dialect.reading(PULSES).read(path)


@pytest.mark.parametrize("file", PEOPLE)
def test_numbers_are_found_in_files_of_controllers_and_people(file):
    path, rng = EXPORTS / file, np.random.default_rng(0)
    (dialect, program), data = read_export(path), read_program_bytes(path)
    same = [Change(p.shown_deg, p.T_user_tool) for p in program.positions]
    changes = []
    for p in program.positions:
        T = None if p.T_user_tool is None else p.T_user_tool.copy()
        if T is not None:
            T[:3, 3] += rng.uniform(-1e-3, 1e-3, 3)
            T[:3, :3] = T[:3, :3] @ rotation_exp(rng.uniform(-1e-3, 1e-3, 3))
        shown = (
            None if p.shown_deg is None else rng.uniform(-0.1, 0.1, p.shown_deg.shape) + p.shown_deg
        )
        changes.append(Change(shown, T))
    if file in IN_ANOTHER_ORDER:
        with pytest.raises(FileFormatError, match="cannot be told from others") as caught:
            rewritten(dialect, data, path, program, changes)
        assert caught.value.row == IN_ANOTHER_ORDER[file]
        return
    assert rewritten(dialect, data, path, program, same)[0] == data
    new, again = rewritten(dialect, data, path, program, changes)
    for p, old, change in zip(again.positions, program.positions, changes, strict=True):
        assert p.line == old.line
        if change.shown_deg is not None:
            np.testing.assert_allclose(p.shown_deg, change.shown_deg, atol=6e-3)  # a pulse
        if change.T_user_tool is not None:
            np.testing.assert_allclose(p.T_user_tool, change.T_user_tool, atol=1e-4)
            off = p.T_user_tool[:3, 3] - change.T_user_tool[:3, 3]
            assert np.abs(off).max() < 1e-6
    texts = [part.decode("latin-1").split("\n") for part in (data, new)]
    for a, b in zip(*texts, strict=True):
        # attributes that are zero are left out
        assert a == b or masked(a) == masked(b) or masked(b).startswith(masked(a).rstrip(" />"))


def test_logs_are_no_programs():
    path = EXPORTS / "ur.log"
    dialect = dialect_of("ur-script")
    program = dialect.read(path)
    with pytest.raises(InputError, match="the log of a run is no program"):
        rewritten(
            dialect, read_program_bytes(path), path, program, [Change()] * len(program.positions)
        )


def one(name: str, posture_deg: list[float], folder: Path, form: str = "cartesian") -> Path:
    return files_of(name, np.deg2rad([posture_deg]), form, folder)[0]


def offset(name: str, joint: int, degrees: float) -> tuple[CalibrationModel, FloatArray]:
    """An arm of which one zero is wrong."""
    model, _ = errors_of(robot_of(name))
    x = model.nominal.copy()
    x[model.names.index(f"zero_offset.{robot_of(name).joint_names[joint]}")] = np.deg2rad(degrees)
    return model, x


@pytest.mark.parametrize(
    ("name", "before", "after"),
    [("kuka-krl", r"S 2,T 2\b", r"S 2,T 3\b"), ("abb-rapid", r"\[0,0,0,0\]", r"\[-1,0,0,0\]")],
)
def test_counts_of_turns_are_those_of_the_command(name, before, after, tmp_path):
    """At zero a correction of any size crosses into another quadrant, or sign."""
    q = {"kuka-krl": [0, -60, 90, 20, 40, 30], "abb-rapid": [0, 20, 10, 20, 40, 30]}[name]
    path = one(name, q, tmp_path)
    model, x = offset(name, 0, 0.2)
    done = corrected(path, name, model, x)
    assert done.ok, done.reasons
    assert re.search(before, path.read_text())
    assert not re.search(after, path.read_text())
    assert re.search(after, done.data.decode())
    assert done.written_m.max() < 2e-7


def test_turns_of_a_fanuc(tmp_path):
    path = one("fanuc-ls", [0, 15, -25, 179.95, -50, 0], tmp_path)
    done = corrected(path, "fanuc-ls", *offset("fanuc-ls", 3, -0.2))
    assert "'N U T, 0, 0, 0'" in path.read_text()
    assert "'N U T, 0, 1, 0'" in done.data.decode()


def test_another_arm_position_is_named_and_nothing_is_written(tmp_path):
    path = one("fanuc-ls", [0, 15, -25, 0, -0.5, 0], tmp_path)
    done = corrected(path, "fanuc-ls", *offset("fanuc-ls", 4, -1.0))
    assert not done.ok
    assert done.data == b""
    assert done.reasons == ("leaves its arm position N U T, 0, 0, 0 for F U T, 0, 0, 0",)
    (row,) = done.rows()
    assert row["position"] == "position 1 (T0)"
    assert row["line"] == done.positions[0].line


def test_singular_and_unreachable_ones_and_those_past_limits_are_named(tmp_path):
    robot = robot_of("abb-rapid")
    wrist = np.rad2deg(robot.upper[3]) - 0.05
    poses = np.deg2rad([[10, 20, 10, 20, 1.0, 30], [10, 20, 10, wrist, 40, 30]])
    (path,) = files_of("abb-rapid", poses, "joint", tmp_path)
    model, x = errors_of(robot)
    done = corrected(path, "abb-rapid", model, x, leave=[2])
    assert re.match(r"next to a singularity: joint_[46] would turn by \d+\.\d deg", done.reasons[0])
    done = corrected(path, "abb-rapid", *offset("abb-rapid", 3, -0.2), leave=[1])
    assert done.reasons[0].startswith("outside limits: joint_4 ")
    # the arm is stretched, and was found to be shorter
    (path,) = files_of("abb-rapid", np.deg2rad([[10, 0, -76.9, 20, 40, 30]]), "joint", tmp_path)
    x = model.nominal.copy()
    x[[i for i, n in enumerate(model.names) if n.startswith("link.joint_3.")]] = -5e-3
    done = corrected(path, "abb-rapid", model, x)
    assert done.reasons[0].startswith("not reached: ")
    assert done.data == b""


def test_joint_targets_stay_unless_they_are_asked_for(tmp_path):
    (path,) = files_of("ur-script", clear_postures(robot_of("ur-script"), 3), "joint", tmp_path)
    model, x = errors_of(robot_of("ur-script"))
    with pytest.raises(InputError, match="has joint targets only"):
        corrected(path, "ur-script", model, x, joints=False)
    with pytest.raises(InputError, match="no position 9 to leave"):
        corrected(path, "ur-script", model, x, leave=[9])
    done = corrected(path, "ur-script", model, x, leave=[2])
    texts = [data.splitlines() for data in (read_program_bytes(path), done.data)]
    moves = [(a, b) for a, b in zip(*texts, strict=True) if a.strip().startswith(b"movej")]
    assert [a == b for a, b in moves] == [False, True, False]
    assert done.notes == ("1 of 3 positions are as they were",)


def test_linear_moves_keep_the_arm_position_that_they_come_from(tmp_path):
    """movel says no arm position: it is that of where the move begins."""
    robot = robot_of("ur-script")
    model, x = errors_of(robot)
    arm = dialect_of("ur-script").seen(Arm.of(robot))
    start = np.deg2rad([20, -100, 110, -80, -90, 10])
    end = start + np.deg2rad([5, -5, 5, 5, 2, 0])
    T = arm.tool_poses(end) @ TOOL
    numbers = ", ".join(f"{v:.9f}" for v in [*T[:3, 3], *rotation_log(T[:3, :3])])
    tool = ", ".join(f"{v:.9f}" for v in [*TOOL_M, *rotation_log(TOOL[:3, :3])])
    joints = ", ".join(f"{v:.9f}" for v in start)
    path = tmp_path / "weld.script"
    path.write_text(
        f"def weld():\n  set_tcp(p[{tool}])\n  movej([{joints}])\n  movel(p[{numbers}])\nend\n"
    )
    done = corrected(path, "ur-script", model, x, joints=False)
    assert done.corrected == (1,)
    assert done.written_m.max() < 3e-8
    again = dialect_of("ur-script").parse(done.data, path)
    command = of_controller(again.positions[1], arm, end)
    assert np.abs(command - end).max() < 0.1
    path.write_text(f"def weld():\n  set_tcp(p[{tool}])\n  movel(p[{numbers}])\nend\n")
    with pytest.raises(InputError, match="nothing says which of several postures is meant"):
        corrected(path, "ur-script", model, x)


def test_positions_of_another_tool_bring_the_tip_to_its_place(tmp_path):
    model, x = errors_of(robot_of("kuka-krl"))
    (path,) = files_of("kuka-krl", clear_postures(robot_of("kuka-krl"), 4), "cartesian", tmp_path)
    done = corrected(path, "kuka-krl", model, x, tool_m=TOOL_M + np.array([0, 0, 0.1]))
    assert "4 positions are of another tool" in done.notes[0]
    real = corrected_robot(model, x).robot
    arm = dialect_of("kuka-krl").seen(arm_of("kuka-krl"))
    again = dialect_of("kuka-krl").parse(done.data, path)
    for before, after in zip(done.positions, again.positions, strict=True):
        nominal = of_controller(before, arm, np.zeros(6))
        command = of_controller(after, arm, nominal)
        np.testing.assert_allclose(real.fk(command), arm.robot.fk(nominal), atol=5e-7)


def test_what_changes_with_the_posture_is_corrected_too(tmp_path):
    robot = robot_of("kuka-krl")
    loads = (Payload(5.0, [0.0, 0.0, 0.1]),)
    blocks = [
        JointCompliance(robot, robot.joint_names[1:3], loads),
        ToolPoint(TOOL_M),
        TargetPoints([[1.0, 0.0, 0.5]]),
    ]
    model = CalibrationModel(robot, blocks, TouchUp(1e-5))
    x = model.nominal.copy()
    x[:2] = 2e-5
    (path,) = files_of("kuka-krl", clear_postures(robot, 10), "cartesian", tmp_path)
    done = corrected(path, "kuka-krl", model, x)
    assert done.moved_m.max() > 3e-4
    assert done.written_m.max() < 2e-7


def test_a_damaged_file_is_refused(tmp_path):
    path = one("kuka-krl", [0, -60, 90, 20, 40, 30], tmp_path)
    whole = path.read_text()
    path.write_text(whole.replace("ENDDAT", ""))
    model, x = errors_of(robot_of("kuka-krl"))
    with pytest.raises(FileFormatError, match="is cut off"):
        corrected(path, "kuka-krl", model, x)
    path.write_text(replace_first_number(whole))
    with pytest.raises(FileFormatError, match="not a number"):
        corrected(path, "kuka-krl", model, x)


def replace_first_number(text: str) -> str:
    """The first coordinate as no number."""
    return re.sub(r"\{X [-\d.]+", "{X abc", text, count=1)


def test_a_frame_by_value_stays_its_own(tmp_path):
    """A module's work object and tool count, whatever the cell has."""
    model, x = errors_of(robot_of("abb-rapid"))
    (path,) = files_of("abb-rapid", clear_postures(robot_of("abb-rapid"), 4), "cartesian", tmp_path)
    dialect = dialect_of("abb-rapid")
    elsewhere = replace(arm_of("abb-rapid"), T_world_user=TOOL, T_tip_tool=USER)
    there = correct_positions(
        dialect, read_program_bytes(path), path, elsewhere, model, x, tool_m=TOOL_M
    )
    assert there.data == corrected(path, "abb-rapid", model, x).data


def test_the_same_numbers_elsewhere_are_refused_and_not_changed(tmp_path):
    """The name of a position holds its joint values: what would be changed is not the position."""
    path = one("fanuc-ls", [1, 2, 3, 4, 5, 6], tmp_path, "joint")
    dialect, text = dialect_of("fanuc-ls"), path.read_text()
    shown = dialect.read(path).positions[0].shown_deg
    values = " ".join(f"{value:g}" for value in np.round(shown, 3))
    named = text.replace('P[1:"T0"]', f'P[1:"{values}"]')
    assert named != text
    path.write_text(named)
    program = dialect.read(path)
    change = Change(program.positions[0].shown_deg + 0.1)
    with pytest.raises(FileFormatError, match="cannot be told from others"):
        rewritten(dialect, read_program_bytes(path), path, program, [change])


def test_equal_positions_are_each_their_own(tmp_path):
    """Of a list of one posture over and over only the one that is to change does."""
    q = np.deg2rad([[10, 20, 10, 20, 40, 30]] * 4)
    (path,) = files_of("abb-rapid", q, "cartesian", tmp_path)
    dialect = dialect_of("abb-rapid")
    program = dialect.read(path)
    T = program.positions[2].T_user_tool.copy()
    T[0, 3] += 1e-3
    changes = [Change(), Change(), Change(None, T), Change()]
    _, again = rewritten(dialect, read_program_bytes(path), path, program, changes)
    for i, p in enumerate(again.positions):
        moved = p.T_user_tool[0, 3] - program.positions[i].T_user_tool[0, 3]
        assert moved == pytest.approx(1e-3 if i == 2 else 0.0, abs=1e-9)


def test_a_module_with_an_array_of_targets(tmp_path):
    """All elements begin in one line."""
    q = clear_postures(robot_of("abb-rapid"), 3)
    (path,) = files_of("abb-rapid", q, "joint", tmp_path)
    values = re.findall(r":=(\[\[.*\]\]);", path.read_text())
    lines = ["MODULE weld", "  CONST jointtarget jp{3}:=[" + ",".join(values) + "];", "ENDMODULE"]
    path.write_text("\n".join(lines))
    model, x = errors_of(robot_of("abb-rapid"))
    done = corrected(path, "abb-rapid", model, x)
    assert done.written_m.max() < 2e-7
    again = dialect_of("abb-rapid").parse(done.data, path)
    assert [p.number for p in again.positions] == [1, 2, 3]


@pytest.mark.parametrize("name", ["fanuc-ls", "kuka-krl", "staubli-val3"])
def test_targets_whose_angles_have_no_unique_triple(name, tmp_path):
    """At a second angle of 90 deg, where tools stand level."""
    robot = robot_of(name)
    q = clear_postures(robot, 5)
    model, x = errors_of(robot)
    level = Arm.of(robot).tool_poses(q[:1])[0, :3, :3].T @ rotation_from_wpr([0.3, np.pi / 2, 0.2])
    tool = transform(level, TOOL_M)
    arm, dialect = Arm.of(robot, USER, tool), dialect_of(name)
    poses = tuple(ProgramPose(f"T{i}", posture) for i, posture in enumerate(q))
    program = PoseProgram("CALPOSE", poses, options_of(name, form="cartesian"), arm)
    path = dialect.write(program, tmp_path)[0]
    seen, data = dialect.seen(arm), read_program_bytes(path)
    asked = {"tool_m": TOOL_M}
    same = correct_positions(dialect, data, path, seen, model, model.nominal, **asked)
    assert same.data == data
    done = correct_positions(dialect, data, path, seen, model, x, **asked)
    assert done.written_m.max() < 3 * HOW[name].pose[0] + HOW[name].pose[1]


@pytest.mark.parametrize("name", ["fanuc-ls", "ur-script", "staubli-val3"])
def test_all_that_are_out_of_reach_are_named(name, tmp_path):
    robot = robot_of(name)
    model, x = errors_of(robot)
    (path,) = files_of(name, clear_postures(robot, 5), "cartesian", tmp_path)
    dialect = dialect_of(name)
    program = dialect.read(path)
    changes = [Change()] * 5
    for i in (1, 3):
        far = program.positions[i].T_user_tool.copy()
        far[2, 3] += 5.0
        changes[i] = Change(None, far)
    path.write_bytes(rewritten(dialect, read_program_bytes(path), path, program, changes)[0])
    done = corrected(path, name, model, x)
    assert [bool(why) for why in done.reasons] == [False, True, False, True, False]
    assert done.reasons[1] == NO_POSTURE
    assert done.data == b""
    assert [row["position"] for row in done.rows()] == ["position 2 (T1)", "position 4 (T3)"]
    left = corrected(path, name, model, x, leave=[2, 4])
    assert left.ok
    assert left.written_m.max() < 1e-6


def test_files_of_more_numbers_than_any_program_has_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(rewriting, "MOST_NUMBERS", 2000)
    path = one("kuka-krl", [0, -60, 90, 20, 40, 30], tmp_path)
    model, x = errors_of(robot_of("kuka-krl"))
    assert corrected(path, "kuka-krl", model, x).ok
    path.write_text(path.read_text() + ";" + "1 " * 2001 + "\n")
    with pytest.raises(FileFormatError, match="holds more than 2000 numbers"):
        corrected(path, "kuka-krl", model, x)


def test_increments_of_a_fanuc_are_no_positions(tmp_path):
    path = one("fanuc-ls", [0, 15, -25, 10, -50, 0], tmp_path)
    model, x = errors_of(robot_of("fanuc-ls"))
    assert corrected(path, "fanuc-ls", model, x).ok
    text = path.read_text()
    path.write_text(text.replace("FINE   ", "FINE INC   "))
    assert path.read_text() != text
    with pytest.raises(FileFormatError, match=r"line \d+: moves by an increment \(INC\): P\["):
        corrected(path, "fanuc-ls", model, x)


def test_numbers_behind_tabs_as_post_processors_write_them(tmp_path):
    path = one("fanuc-ls", [0, 15, -25, 10, -50, 0], tmp_path)
    model, x = errors_of(robot_of("fanuc-ls"))
    text = re.sub(r"= +(-?[\d.]+) +(mm|deg)", r"=\t\g<1>000\t\2", path.read_text())
    path.write_text(text)
    done = corrected(path, "fanuc-ls", model, x)
    assert done.written_m.max() < 1e-9  # six decimals stay six
    assert corrected(path, "fanuc-ls", model, model.nominal).data == read_program_bytes(path)


@pytest.mark.parametrize("name", POSED)
def test_a_program_of_each_maker_from_its_files(name, tmp_path):
    """With the frames of the cell, or those that the file has by value."""
    dialect = dialect_of(name)
    cell = arms.cell_of(dialect.maker)
    robot = cell.robot
    names = [f"zero_offset.{joint}" for joint in robot.joint_names[1:5]]
    found = {
        "robot": robot.name,
        "joints": list(robot.joint_names),
        "models": [
            {
                "name": "mine",
                "parameters": [
                    {"name": n, "value": 0.1, "unit": "deg", "sigma": 0.001} for n in names
                ],
            }
        ],
        "recommended": "mine",
    }
    identification = tmp_path / "identification.json"
    identification.write_text(json.dumps(found))
    q = clear_postures(robot, 4)
    options = options_of(name, form="cartesian", user_frame=0)
    poses = tuple(ProgramPose(f"T{i}", posture) for i, posture in enumerate(q))
    program = PoseProgram("CALPOSE", poses, options, pose_arm_of(cell))
    (path, *_) = dialect.write(program, tmp_path / "programs")
    before = read_program_bytes(path)
    done = correct_program(cell, identification, path, tmp_path / "out")
    assert done.ok
    assert done.files == (tmp_path / "out" / path.name,)
    assert (done.files[0].read_bytes()[:2] == b"\x1f\x8b") == (name == "ur-urp")
    assert any("calibration of the factory" in note for note in done.notes) == (
        dialect.maker == "ur"
    )
    assert read_program_bytes(path) == before
    # the zeros of four joints are off by a tenth of a degree: the command is less by that
    arm = dialect.seen(pose_arm_of(cell))
    for p, nominal in zip(dialect.read(done.files[0]).positions, q, strict=True):
        user = np.eye(4) if p.T_world_user is None else p.T_world_user
        tool = arm.T_tip_tool if p.T_tip_tool is None else p.T_tip_tool
        T = arm.controller.T_base_world @ user @ p.T_user_tool @ inverse(tool)
        turned = np.zeros(robot.n)
        turned[1:5] = np.deg2rad(0.1)
        np.testing.assert_allclose(T, robot.fk(nominal - turned), atol=3e-5)
        np.testing.assert_allclose(T[:3, 3], robot.fk(nominal - turned)[:3, 3], atol=1e-5)
