"""What every dialect writes is valid, is read back as it was, and is what stands in `written`."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.robots import Robot, preset_names
from calib.se3 import inverse, rotation_from_wpr
from posedesign.programs import DIALECTS, Arm, PoseProgram, ProgramPose, postures_of
from posedesign.programs.configurations import configuration_of
from posedesign.programs.reading import read_program_bytes
from posedesign.programs.recorded import RecordedProgram
from tests.marks import by_stage
from tests.unit.programs.dialects import (
    CASES,
    HOW,
    POSED,
    TOOL,
    USER,
    arm_of,
    dialect_of,
    each_case,
    each_dialect,
    options_of,
    program_of,
    random_poses,
    robot_of,
    texts_of,
)

WRITTEN = Path(__file__).parent / "written"
POSES = (
    ProgramPose("T 1", np.radians([0, 15, -25, -0.000001, -50, 30])),
    ProgramPose("over", np.radians([10, 15, 20, 5, 25.123456, 0]), via=True),
    ProgramPose("Ö", np.radians([-160, 20, 10, 0.5, -5, 260]), "mind the cable"),
)

NEARLY_SINGULAR = 0.02
"""Smallest singular value of the Jacobian below which rounding moves joints too far to compare."""


def whole(name: str, form: str) -> PoseProgram:
    """The program whose text stands in `written`."""
    how = HOW[name]
    asked = {"measure_output": 5} if how.asks else {}
    kept = {"keep": "register", "first_register": 2} if how.registers else {}
    options = options_of(
        *(name,),
        form=form,
        tool_frame=3,
        speed_percent=25,
        settle_s=0.3,
        comment="cell 7",
        **asked,
        **kept,
    )
    poses = [
        replace(pose, posture_rad=np.resize(pose.posture_rad, robot_of(name).n)) for pose in POSES
    ]
    return PoseProgram("CALPOSE", tuple(poses), options, arm_of(name))


def faults(name: str, paths: tuple[Path, ...]) -> list[str]:
    """What the validator says of files, those left out that hold nothing to check."""
    dialect = DIALECTS[name]
    checked = [path for path in paths if path.suffix.lower() in dialect.suffixes]
    assert checked
    return [f"{path.name}: {problem}" for path in checked for problem in dialect.validate(path)]


def order_of(program: PoseProgram, name: str) -> list[int]:
    """Index of each pose that the file holds, in its order."""
    how = HOW[name]
    kept = [k for k, pose in enumerate(program.poses) if how.passes or not pose.via]
    return sorted(kept, key=lambda k: program.numbers[k]) if how.by_number else kept


def check_read(back: RecordedProgram, program: PoseProgram, name: str) -> None:
    """Everything that was written comes back."""
    how, options = HOW[name], program.options
    assert back.name == (program.name if how.capitals else program.name.lower())
    assert back.maker == (DIALECTS[name].maker or back.maker)
    assert (back.comment, back.fingerprint) == (options.comment * how.title, options.fingerprint)
    assert back.mark.measured == program.measured_count
    assert [p.number for p in back.measured] == [
        p.number for p in back.positions if p.number <= program.measured_count
    ]
    if back.mark.measured:
        assert back.empty_registers == (options.keep == "register" and name in TOUCHED)
    order = order_of(program, name)
    poses = [program.poses[k] for k in order]
    assert [p.number for p in back.positions] == [program.numbers[k] for k in order]
    for position, pose in zip(back.positions, poses, strict=True):
        assert position.name == (pose.name if how.fits(pose.name) else "")
    arm = DIALECTS[name].seen(arm_of(name))
    expected = np.stack([pose.posture_rad for pose in poses])
    if all(p.shown_deg is not None for p in back.positions):
        shown = np.stack([p.shown_deg for p in back.positions if p.shown_deg is not None])
        np.testing.assert_allclose(shown, arm.shown(expected), rtol=0, atol=how.joint_deg)
        most = np.radians(2 * how.joint_deg)  # a FANUC's J3 is the sum of two
        np.testing.assert_allclose(back.postures(arm), expected, rtol=0, atol=most)
    if options.form == "cartesian":
        check_poses(back, expected, arm, name, options.tool_frame)


def check_poses(
    back: RecordedProgram, expected: np.ndarray, arm: Arm, name: str, tool: int
) -> None:
    """Poses of the tool in their frames and arm positions, and the postures ``(N, n)`` of them."""
    how = HOW[name]
    T = np.stack([p.T_user_tool for p in back.positions if p.T_user_tool is not None])
    wanted = arm.tool_poses(expected)
    np.testing.assert_allclose(T[:, :3, 3], wanted[:, :3, 3], rtol=0, atol=how.pose[0])
    np.testing.assert_allclose(T[:, :3, :3], wanted[:, :3, :3], rtol=0, atol=how.pose[1])
    for position in back.positions:
        if how.own_frames:
            np.testing.assert_allclose(np.asarray(position.T_world_user), USER, atol=2e-7)
            np.testing.assert_allclose(np.asarray(position.T_tip_tool), TOOL, atol=2e-7)
        elif DIALECTS[name].numbered_frames:
            assert (position.user_frame, position.tool_frame) == (2, tool)
    if configuration_of(arm.maker):
        assert [p.configuration for p in back.positions] == arm.configurations(expected)
    robot = robot_of(name)
    least = np.linalg.svd(robot.jacobian(expected), compute_uv=False)[:, -1]
    inside = np.array([all(c.margin(q) > 0.01 for c in robot.coupled_limits) for q in expected])
    kept = np.flatnonzero((least > NEARLY_SINGULAR) & inside)
    if len(kept) == 0:
        return
    posed = tuple(replace(back.positions[k], shown_deg=None) for k in kept)
    # whatever tool the cell has, where the file says which one it was written for
    other = replace(arm, T_tip_tool=np.eye(4)) if how.own_frames else arm
    off = postures_of(posed, other, None if how.told else expected[kept]) - expected[kept]
    rounded = np.sqrt(3) * how.pose[0] + 3 * how.pose[1]
    assert (np.linalg.norm(off, axis=1) < rounded / least[kept]).all()


def random_program(name: str, form: str, rng: np.random.Generator) -> PoseProgram:
    """A plan with options of all kinds, chosen by chance."""
    how = HOW[name]
    changes = {
        "form": form,
        "comment": "x" * int(rng.integers(how.text or 50)),
        "speed_percent": int(rng.integers(1, 101)),
        "settle_s": float(rng.choice([0.0, 0.001, 0.5, how.wait_s or 60.0])),
    }
    if how.asks:
        changes["measure_output"] = [None, 1, 7][rng.integers(3)]
        changes["measure_argument"] = ["number", None, -4][rng.integers(3)]
        changes["measure_call"] = [None, "PROBE", "X"][rng.integers(3)]
    if how.registers:
        changes["keep"] = str(rng.choice(["position", "register"]))
    return program_of(name, random_poses(name, rng), "Z" * how.name, **changes)


def check_round_trips(name: str, form: str, count: int, folder: Path) -> None:
    rng = np.random.default_rng(sum(map(ord, name + form)))
    dialect = dialect_of(name)
    for _ in range(count):
        program = random_program(name, form, rng)
        if dialect.companions:  # they are checked against each other
            paths = dialect.write(program, folder)
            assert faults(name, paths) == []
            data, path = read_program_bytes(paths[0]), paths[0]
        else:
            ((file, text),) = list(dialect.files(program).items())[:1]
            data, path = text.replace("\n", dialect.newline).encode(dialect.encoding), Path(file)
            assert [p for p in dialect.check(data, path) if p.level != "note"] == []
        check_read(dialect.parse(data, path), program, name)


@each_case
@pytest.mark.parametrize("count", by_stage(6, 25, 1000))
def test_random_plans_come_back(name: str, form: str, count: int, tmp_path: Path) -> None:
    check_round_trips(name, form, count, tmp_path)


@each_case
def test_a_whole_program_word_by_word(name: str, form: str, tmp_path: Path) -> None:
    program, dialect = whole(name, form), dialect_of(name)
    paths = dialect.write(program, tmp_path)
    texts = {str(path.relative_to(tmp_path)): read_program_bytes(path) for path in paths}
    expected = {
        str(path.relative_to(WRITTEN / f"{name}-{form}")): path.read_text(encoding="utf-8")
        for path in (WRITTEN / f"{name}-{form}").rglob("*")
        if path.is_file()
    }
    for file, text in expected.items():
        assert texts[file].decode(dialect.encoding) == text.replace("\n", dialect.newline)
    assert texts.keys() == expected.keys()
    assert faults(name, paths) == []
    back = dialect.read(paths[0])
    check_read(back, program, name)
    lines = texts[str(paths[0].relative_to(tmp_path))].decode(dialect.encoding).splitlines()
    assert all(re.match(rf" *{HOW[name].line}", lines[p.line - 1]) for p in back.positions)
    assert texts_of(program, name) == texts_of(program, name)  # and does not depend on the clock


@each_case
def test_numbers_have_neither_exponent_nor_minus_zero(name: str, form: str) -> None:
    tiny = np.resize([1e-9, -1e-9, 0.0, -0.0, 1e-14, -1e-14], robot_of(name).n)
    for fingerprint in ("", "abcdef12"):
        text = texts_of(
            program_of(name, [ProgramPose("T", tiny)], form=form, fingerprint=fingerprint), name
        )
        numbers = re.sub(r"9E9|-4\b|PLAN.*|-0[45]\b", "", text)
        assert not re.search(
            r"(?<![\w.])-0?\.?0*(?![\d.])(?<=0)|\d[eE][-+\d]|\bnan\b|\binf\b", numbers
        )


@each_dialect
def test_names_that_no_comment_holds_are_left_out(name: str, tmp_path: Path) -> None:
    how = HOW[name]
    q = np.linspace(-0.2, 0.2, len(how.fit + how.unfit))[:, None] + program_of(name).postures_rad
    poses = [ProgramPose(n, p) for n, p in zip(how.fit + how.unfit, q, strict=True)]
    paths = dialect_of(name).write(program_of(name, poses), tmp_path)
    assert faults(name, paths) == []
    back = dialect_of(name).read(paths[0])
    assert [p.name for p in back.positions] == [*how.fit, *[""] * len(how.unfit)]


@pytest.mark.parametrize("name", [name for name, d in DIALECTS.items() if not d.in_folder])
def test_parts_of_a_plan_go_on_counting(name: str, tmp_path: Path) -> None:
    q = program_of(name).postures_rad + np.linspace(0, 0.5, 5)[:, None]
    poses = [ProgramPose(f"P{k}", p) for k, p in enumerate(q)]
    _, second = program_of(name, poses).split(3)
    back = dialect_of(name).read(dialect_of(name).write(second, tmp_path)[0])
    assert [(p.number, p.name) for p in back.positions] == [(4, "P3"), (5, "P4")]
    assert (back.mark.measured, len(back.measured)) == (5, 2)


def standing(name: str, R: np.ndarray) -> PoseProgram:
    """A program of one pose with a tool whose frame stands so in the world."""
    q = program_of(name).postures_rad[0]
    flange, wanted = robot_of(name).fk(q), np.eye(4)
    wanted[:3, :3], wanted[:3, 3] = R, flange[:3, 3]
    arm = replace(arm_of(name), T_world_user=np.eye(4), T_tip_tool=inverse(flange) @ wanted)
    return replace(program_of(name, form="cartesian", user_frame=0), arm=arm)


@pytest.mark.parametrize("middle_deg", [90.0, -90.0])
@pytest.mark.parametrize("name", POSED)
def test_where_angles_are_degenerate_the_matrix_is_kept(name: str, middle_deg: float) -> None:
    """The middle one of three angles at +-90 deg: the others are then one too many."""
    for R in (
        rotation_from_wpr(np.radians([0.0, middle_deg, 30.0])),
        rotation_from_wpr(np.radians([0.0, middle_deg, 30.0])).T,
    ):
        program = standing(name, R)
        ((file, text), *_) = DIALECTS[name].files(program).items()
        (position,) = dialect_of(name).parse(text.encode(), Path(file)).positions
        assert program.arm is not None
        off = np.asarray(position.T_user_tool) - program.arm.tool_poses(program.postures_rad)[0]
        assert np.abs(off[:3, :3]).max() <= 2 * HOW[name].pose[1]


@pytest.mark.parametrize("name", ["fanuc-ls", "kuka-krl", "yaskawa-jbi"])
def test_half_a_turn_has_one_name(name: str) -> None:
    """Angles are in (-180, 180] deg, also where rounding makes them half a turn."""
    for off in (-1e-9, 1e-9):
        for axis in (0, 2):
            wpr = np.zeros(3)
            wpr[axis] = np.pi + off
            text = texts_of(standing(name, rotation_from_wpr(wpr)), name)
            assert re.search(r"(?<!-)\b180\.0", text)
            assert "-180.0" not in text


# Poses that can be worked out by hand from drawings: joint values as the pendant shows them, where
# user and tool frame are [m], and the text.
HALF = "0.707106781,0.000000000,0.707106781,0.000000000"
CHECK_VALUES = [
    (
        *("fanuc-ls", (0, 0, 0, 0, -90, 0), 0.0, 0.0, "CONFIG : 'N U T, 0, 0, 0',\n"),
        "\tX =  1592.000  mm,\tY =     0.000  mm,\tZ =  1085.000  mm,\n"
        "\tW =   180.000 deg,\tP =     0.000 deg,\tR =     0.000 deg\n",
    ),
    # the forearm stretched and level: x = 25 + 420 + 80, z = 400 + 455 + 35 mm, looking along x
    (
        *("kuka-krl", (0, -90, 90, 0, 0, 0), 0.5, 0.1),
        "{X 125.0000,Y 0.0000,Z 890.0000,A 0.00000,B 90.00000,C 0.00000,S 2,T 2}\n",
    ),
    # x = 302 + 72, z = 290 + 270 + 70 mm, looking along x
    (
        *("abb-rapid", (0, 0, 0, 0, 0, 0), 0.3, 0.1),
        f"p1:=[[174.0000,0.0000,630.0000],[{HALF}],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n",
    ),
    # the controller's base is turned by half a turn against base_link, where this is at +x, +y
    ("ur-script", (0, 0, 0, 0, 0, 0), 0.0, 0.0, "(p[-0.8172000, -0.2329000, 0.0628000, "),
]


@pytest.mark.parametrize(
    ("name", "shown_deg", "user_m", "tool_m", "texts"), [(*c[:4], c[4:]) for c in CHECK_VALUES]
)
def test_poses_are_those_of_drawings(name, shown_deg, user_m, tool_m, texts):
    user, tool = np.eye(4), np.eye(4)
    user[0, 3], tool[2, 3] = user_m, tool_m
    arm = Arm.of(robot_of(name), user, tool)
    pose = ProgramPose("T1", arm.postures(np.array(shown_deg, dtype=float)))
    program = replace(program_of(name, [pose], form="cartesian"), arm=arm)
    assert "".join(texts) in texts_of(program, name)


# Numbers of a pose in the text of a dialect, and RoboDK's function that they are for.
THEIRS = {
    "fanuc-ls": (
        r"X = *(\S+).*Y = *(\S+).*Z = *(\S+).*\n.*W = *(\S+) .*P = *(\S+) .*R = *(\S+)",
        "Fanuc",
    ),
    "kuka-krl": (r"XP\d+=\{X (.+),Y (.+),Z (.+),A (.+),B (.+),C (.+),S", "KUKA"),
    "abb-rapid": (
        r"robtarget p\d+:=\[\[(.+?),(.+?),(.+?)\],\[(.+?),(.+?),(.+?),(.+?)\]",
        "quaternion",
    ),
    "ur-script": (r"user_frame, p\[(.+?), (.+?), (.+?), (.+?), (.+?), (.+?)\]", "UR"),
    "ur-urp": (r"user_frame, p\[(.+?), (.+?), (.+?), (.+?), (.+?), (.+?)\]", "UR"),
    "yaskawa-jbi": (r"C\d{5}=(.+),(.+),(.+),(.+),(.+),(.+)", "Motoman"),
    "staubli-val3": (
        r'x="(.+?)" y="(.+?)" z="(.+?)" rx="(.+?)" ry="(.+?)" rz="(.+?)" sh',
        "Staubli",
    ),
}


@pytest.mark.parametrize("name", POSED)
def test_poses_are_those_of_another_library(name: str) -> None:
    robomath = pytest.importorskip("robodk.robomath", reason="compares with RoboDK's conventions")
    pattern, theirs = THEIRS[name]
    rng = np.random.default_rng(1)
    poses = [ProgramPose(f"T{i}", rng.uniform(-1, 1, robot_of(name).n)) for i in range(20)]
    program = program_of(name, poses, form="cartesian")
    rows = re.findall(pattern, texts_of(program, name))
    for row, T in zip(rows, arm_of(name).tool_poses(program.postures_rad), strict=True):
        place, turn = np.array(row[:3], dtype=float), [float(value) for value in row[3:]]
        place = place if name.startswith("ur-") else place * 1e-3
        if theirs == "quaternion":
            assert np.linalg.norm(turn) == pytest.approx(1.0, abs=2e-9)
            pose = robomath.quaternion_2_pose(turn)
        else:
            pose = getattr(robomath, f"{theirs}_2_Pose")([*place, *turn])
        R = np.array(pose.Rows())[:3, :3]
        np.testing.assert_allclose(R, T[:3, :3], rtol=0, atol=HOW[name].pose[1])
        np.testing.assert_allclose(place, T[:3, 3], rtol=0, atol=HOW[name].pose[0])


# One pose measured by hand at the controller: what stands in the place of what, and pose 2 then.
KEPT = "XM[3]={A1 -10.5,A2 -70.5,A3 60.5,A4 -5.5,A5 35.5,A6 130.5,E1 0.0,E2 0.0}\nENDDAT"
NINES = "9E9,9E9,9E9,9E9,9E9,9E9"
TOUCHED = {
    "kuka-krl": ("ENDDAT", KEPT),
    "abb-rapid": (
        rf"\[\[{NINES}\],\[{NINES}\]\]\];",
        r"[[-10.5,-70.5,60.5,-5.5,35.5,130.5],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]]];",
    ),
    "staubli-val3": (
        r'(?s)(jActual.*?key="2") j1.*?/>',
        r'\1 j1="-10.5" j2="-70.5" j3="60.5" j4="-5.5" j5="35.5" j6="130.5" />',
    ),
    "kawasaki-as": (r"\.JOINTS\n", ".JOINTS\n#calpose.m[3] -10.5 -70.5 60.5 -5.5 35.5 130.5\n"),
    "yaskawa-jbi": (
        r"(?s)(NPOS \d,0,0,)0(.*)//INST",
        r"\g<1>1\2P00003="
        + ",".join(
            str(round(p * v))
            for p, v in zip(
                (1434.2, -1434.2, 1600.0, 1137.8, -1137.8, 682.7),
                (-10.5, -70.5, 60.5, -5.5, 35.5, 130.5),
                strict=True,
            )
        )
        + "\n//INST",
    ),
}


@pytest.mark.parametrize("name", TOUCHED)
def test_touched_up_positions_stand_in_the_place_of_the_planned_ones(name: str) -> None:
    dialect = dialect_of(name)
    ((file, text), *_) = dialect.files(whole(name, "joint")).items()
    planned = dialect.parse(text.encode(), Path(file))
    assert planned.empty_registers
    assert sorted(p.number for p in planned.positions) == [1, 2, 3]
    old, new = TOUCHED[name]
    touched, count = re.subn(old, new, text)
    assert count == 1
    program = dialect.parse(touched.encode(), Path(file))
    assert not program.empty_registers
    # pose 1 is not measured yet: its planned position is no measurement
    assert sorted((p.number, p.name) for p in program.positions) == [(2, ""), (3, "over")]
    (kept,) = program.measured
    np.testing.assert_allclose(
        np.asarray(kept.shown_deg), [-10.5, -70.5, 60.5, -5.5, 35.5, 130.5], atol=8e-4
    )


@pytest.mark.parametrize(("name", "most"), [("fanuc-ls", 9999), ("yaskawa-jbi", 2000)])
def test_a_program_of_too_many_lines_is_split(name, most, tmp_path, monkeypatch):
    """Each part ends at a measured pose and goes on counting."""
    dialect, body = dialect_of(name), re.compile(r"/MN\n((?:.*\n)*?)/POS|NOP\n((?:.*\n)*END\n)")
    rng = np.random.default_rng(2)
    postures = program_of(name).postures_rad + rng.uniform(-0.2, 0.2, (90, 6))
    poses = [ProgramPose(f"T{i}", q, via=i % 3 == 1) for i, q in enumerate(postures)]
    program = program_of(name, poses, "LONGNAME", settle_s=0.0)
    longest = replace(poses[0], comment="mind the cable")

    def lines_of(text: str) -> list[str]:
        found = body.search(text)
        assert found
        return (found[1] or found[2]).splitlines()

    least, each = (
        len(lines_of(texts_of(program_of(name, [longest] * k, settle_s=0.0), name))) for k in (1, 2)
    )
    assert dialect.most_poses(program) == (most - least) // (each - least) + 1
    monkeypatch.setattr(type(dialect), "most_poses", lambda self, program: 40)
    paths = dialect.write(program, tmp_path)
    assert [path.stem for path in paths] == ["LONAME_1", "LONAME_2", "LONAME_3"]
    measured = []
    for path in paths:
        assert faults(name, (path,)) == []
        assert "CALL" in "".join(lines_of(path.read_text())[-2:])
        back = dialect.read(path)
        assert back.mark.measured == 60
        measured += [p.number for p in back.measured]
    assert measured == list(range(1, 61))


@pytest.mark.parametrize("preset", preset_names())
def test_lists_are_for_any_arm(preset: str) -> None:
    robot = Robot.preset(preset)
    postures = np.random.default_rng(robot.n).uniform(robot.lower, robot.upper, (9, robot.n))
    poses = [ProgramPose(f"P{k}", q, via=k % 4 == 2) for k, q in enumerate(postures)]
    any_arm = [name for name, dialect in DIALECTS.items() if dialect.maker is None]
    for name in any_arm:
        if robot.n not in getattr(DIALECTS[name], "counts", (robot.n,)):
            continue
        dialect, program = dialect_of(name), replace(program_of(name, poses), arm=Arm.of(robot))
        (file, text), *_ = dialect.files(program).items()
        assert dialect.check(text.replace("\n", dialect.newline).encode(), Path(file)) == []
        back = dialect.parse(text.encode(), Path(file))
        order = order_of(program, name)
        names = back.positions[0].joint_names
        assert names in ((), robot.joint_names)
        off = back.postures(dialect.seen(Arm.of(robot))) - postures[order]
        assert np.abs(off).max() <= np.radians(2 * HOW[name].joint_deg)


def test_every_dialect_is_asked() -> None:
    assert HOW.keys() == DIALECTS.keys()
    assert len(CASES) > len(DIALECTS)
    assert THEIRS.keys() == set(POSED)
    assert TOUCHED.keys() <= {name for name, how in HOW.items() if how.registers}
