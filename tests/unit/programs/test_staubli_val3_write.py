"""VAL 3 projects: the writer, and that what it writes is valid and read back equal."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.errors import InputError
from calib.robots import Robot
from calib.se3 import transform
from posedesign.programs import Arm, PoseProgram, ProgramOptions, ProgramPose, postures_of
from posedesign.programs.staubli_val3 import StaubliVal3

ARM = Arm.of(Robot.preset("tx2_60"))
T_USER = transform(np.diag([-1.0, 1.0, -1.0]), [0.5, -0.25, 0.1])
T_TOOL = transform(np.eye(3), [0.0, 0.05, 0.1])
DIALECT = StaubliVal3()
PATH = Path("Calpose.dtx")

POSES = (
    ProgramPose("T 1", np.radians([0, 15, 100, -115, -90, 0])),
    ProgramPose("over", np.radians([10, 15, 100, -115, -90, 0]), via=True),
    ProgramPose('a "q" <&>', np.radians([-180, 15, 100, -115, -90, 260]), "mind the cable"),
)
OPTIONS = ProgramOptions(
    speed_percent=25,
    settle_s=0.3,
    measure_output=5,
    comment="cell 7",
    fingerprint="abcdef12",
)

DATA = """\
<?xml version="1.0" encoding="utf-8" ?>
<Database xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" \
xmlns="http://www.staubli.com/robotics/VAL3/Data/2">
  <Datas>
    <Data name="jPose" access="public" xsi:type="array" type="jointRx" size="3">
      <Value key="0" j1="0.00000" j2="15.00000" j3="100.00000" j4="-115.00000" j5="-90.00000" \
j6="0.00000" />
      <Value key="1" j1="-180.00000" j2="15.00000" j3="100.00000" j4="-115.00000" \
j5="-90.00000" j6="260.00000" />
      <Value key="2" j1="10.00000" j2="15.00000" j3="100.00000" j4="-115.00000" j5="-90.00000" \
j6="0.00000" />
    </Data>
    <Data name="fUser" access="public" xsi:type="array" type="frame" size="1">
      <Value key="0" x="0.0000" y="0.0000" z="0.0000" rx="0.00000" ry="0.00000" rz="0.00000" \
fatherId="world[0]" />
    </Data>
    <Data name="tTool" access="public" xsi:type="array" type="tool" size="1">
      <Value key="0" x="0.0000" y="50.0000" z="100.0000" rx="0.00000" ry="0.00000" rz="0.00000" \
fatherId="flange[0]" ioLink="valve1" />
    </Data>
    <Data name="mMeasure" access="public" xsi:type="array" type="mdesc" size="1">
      <Value key="0" accel="100" vel="25" decel="100" tmax="99999" rmax="99999" blend="off" \
leave="50" reach="50" />
    </Data>
    <Data name="nTraj" access="public" xsi:type="array" type="num" size="1">
    </Data>
    <Data name="sPlan" access="public" xsi:type="array" type="string" size="1">
      <Value key="0" value="PLAN abcdef12 2 5 382c0ddf" />
    </Data>
    <Data name="sTitle" access="public" xsi:type="array" type="string" size="1">
      <Value key="0" value="cell 7" />
    </Data>
    <Data name="sPose" access="public" xsi:type="array" type="string" size="3">
      <Value key="0" value="T 1" />
      <Value key="1" value="a &quot;q&quot; &lt;&amp;&gt;" />
      <Value key="2" value="over" />
    </Data>
    <Data name="bGo" access="public" xsi:type="array" type="bool" size="1">
    </Data>
    <Data name="doMeasure" access="public" xsi:type="array" type="dio" size="1">
      <Value key="0" link="BasicIO-1\\%Q5" />
    </Data>
  </Datas>
</Database>
"""

START = """\
begin
  // cell 7
  // PLAN abcdef12 2 5 382c0ddf
  resetMotion()
  // POSE 1 T 1
  nTraj=movej(jPose[0],tTool[0],mMeasure)
  waitEndMove()
  delay(0.300)
  doMeasure=true
  delay(0.500)
  doMeasure=false
  call MEASURE(1)
  // POSE 3 over
  nTraj=movej(jPose[2],tTool[0],mMeasure)
  waitEndMove()
  // POSE 2 a "q" <&>
  // mind the cable
  nTraj=movej(jPose[1],tTool[0],mMeasure)
  waitEndMove()
  delay(0.300)
  doMeasure=true
  delay(0.500)
  doMeasure=false
  call MEASURE(2)
end"""


def files_of(program: PoseProgram, arm: Arm = ARM) -> dict[str, str]:
    return DIALECT.render(program, arm)


def data_of(program: PoseProgram, arm: Arm = ARM) -> str:
    return next(iter(files_of(program, arm).values()))


def one_pose(**options: object) -> PoseProgram:
    return PoseProgram("Calpose", POSES[:1], ProgramOptions(**options))  # type: ignore[arg-type]


def start_of(program: PoseProgram) -> str:
    return files_of(program)["Calpose/start.pgx"]


def test_a_whole_project(tmp_path: Path) -> None:
    arm = replace(ARM, T_tip_tool=T_TOOL)
    paths = DIALECT.write(PoseProgram("Calpose", POSES, OPTIONS, arm), tmp_path)
    names = ["Calpose.dtx", "Calpose.pjx", "start.pgx", "stop.pgx", "MEASURE.pgx"]
    assert list(paths) == [tmp_path / "Calpose" / name for name in names]
    assert paths[0].read_text() == DATA
    assert f"<![CDATA[{START}]]>" in paths[2].read_text()
    assert "  resetMotion()" in paths[3].read_text()
    assert 'name="x_nNumber" type="num" use="value"' in paths[4].read_text()
    listed = re.findall(r'<(?:Program|Data) file="(.*?)" />', paths[1].read_text())
    assert listed == ["start.pgx", "stop.pgx", "MEASURE.pgx", "Calpose.dtx"]
    assert [DIALECT.validate(path) for path in paths] == [[]] * 5
    back = DIALECT.read(paths[0])
    assert (back.name, back.comment, back.maker) == ("Calpose", "cell 7", "staubli")
    assert (back.mark.fingerprint, back.mark.measured) == ("abcdef12", 2)
    assert [(p.number, p.name) for p in back.positions] == [
        (1, "T 1"),
        (2, 'a "q" <&>'),
        (3, "over"),
    ]
    assert [p.number for p in back.measured] == [1, 2]
    assert 'j6="260' in DATA.splitlines()[back.positions[1].line - 1]
    np.testing.assert_allclose(back.postures(arm)[1], POSES[2].posture_rad, atol=1e-12)


def test_poses_of_the_tool() -> None:
    arm = replace(ARM, T_world_user=T_USER, T_tip_tool=T_TOOL)
    program = PoseProgram("Calpose", POSES, replace(OPTIONS, form="cartesian"))
    files = files_of(program, arm)
    text = files["Calpose/Calpose.dtx"]
    assert "jPose" not in "".join(files.values())
    assert 'x="500.0000" y="-250.0000" z="100.0000" rx="180.00000" ry="0.00000"' in text
    assert (
        text.count('shoulder="lefty" elbow="epositive" wrist="wnegative" fatherId="fUser[0]"') == 3
    )
    assert "nTraj=movej(pPose[2],tTool[0],mMeasure)" in files["Calpose/start.pgx"]
    back = DIALECT.parse(text.encode(), PATH)
    order = np.argsort(program.numbers)
    expected = arm.tool_poses(program.postures_rad[order])
    for position, pose in zip(back.positions, expected, strict=True):
        np.testing.assert_allclose(position.T_user_tool, pose, atol=3e-7)


def test_no_settling_no_call_and_no_argument() -> None:
    code = start_of(one_pose(settle_s=0, measure_call=None))
    assert "delay" not in code
    assert "call" not in code
    assert "bGo" not in data_of(one_pose(measure_call=None))
    program = one_pose(measure_call="probe", measure_argument=None)
    assert "call probe()" in start_of(program)
    assert "Parameter" not in files_of(program)["Calpose/probe.pgx"]
    assert "call MEASURE(-7)" in start_of(one_pose(measure_argument=-7))
    assert "delay(0.001)" in start_of(one_pose(settle_s=1e-9))


def test_the_touched_up_position_in_an_array_of_its_own() -> None:
    program = PoseProgram("Calpose", POSES, replace(OPTIONS, keep="register", first_register=3))
    code = files_of(program)["Calpose/start.pgx"]
    assert re.findall(r"call MEASURE\((\d)\)\n  jActual\[(\d)\]=herej\(\)", code) == [
        ("1", "2"),
        ("2", "3"),
    ]
    text = data_of(program)
    assert '"jActual" access="public" xsi:type="array" type="jointRx" size="4"' in text
    assert DIALECT.check(text.encode(), PATH) == []
    planned = DIALECT.parse(text.encode(), PATH)
    assert planned.empty_registers
    assert [p.number for p in planned.positions] == [1, 2, 3]
    assert not DIALECT.parse(
        data_of(replace(program, options=OPTIONS)).encode(), PATH
    ).empty_registers
    head, actual = text.split('<Data name="jActual"')
    touched = actual.replace('key="3" j1="0.00000', 'key="3" j1="-179.00000', 1)
    back = DIALECT.parse(f'{head}<Data name="jActual"{touched}'.encode(), PATH)
    assert not back.empty_registers
    # pose 1 was not measured, and pose 3 is passed through
    assert [p.number for p in back.positions] == [2, 3]
    assert [p.shown_deg[0] for p in back.positions if p.shown_deg is not None] == [-179, 10]


def test_poses_are_read_in_the_frames_of_the_project() -> None:
    arm = replace(ARM, T_world_user=T_USER, T_tip_tool=T_TOOL)
    program = PoseProgram("Calpose", POSES[:2], replace(OPTIONS, form="cartesian"))
    back = DIALECT.parse(data_of(program, arm).encode(), PATH)
    for position in back.positions:
        np.testing.assert_allclose(position.T_world_user, T_USER, atol=1e-7)
        np.testing.assert_allclose(position.T_tip_tool, T_TOOL, atol=1e-7)
    # whatever the cell's own tool: the arm is where the project moves it
    found = postures_of(back.positions, ARM, program.postures_rad)
    np.testing.assert_allclose(found, program.postures_rad, atol=1e-5)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"measure_output": 16}, "measure_output is 16"),
        ({"settle_s": 1e5}, "settle_s is 1"),
        ({"comment": "a ]]> b"}, "would end the code"),
        ({"comment": "two\nlines"}, "cannot stand in a comment"),
        ({"comment": "Stra\u00dfe"}, "cannot stand in a comment"),
        ({"comment": "x" * 61}, "cannot stand in a comment"),
        ({"measure_call": "my measure"}, "is not a VAL 3 name"),
        ({"measure_call": "7up"}, "is not a VAL 3 name"),
        ({"measure_call": "start"}, "is not a VAL 3 name"),
        ({"measure_call": "a" * 16}, "is not a VAL 3 name"),
        ({"measure_call": "jPose"}, "is the name of data"),
    ],
)
def test_what_val3_would_refuse(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        files_of(one_pose(**options))
    assert caught.value.hint


def test_names_that_cannot_stand_in_a_project_are_left_out() -> None:
    poses = tuple(replace(POSES[0], name=name) for name in ("]]>", "\u00e9", "a\nb", "x" * 61))
    files = files_of(PoseProgram("Calpose", poses, OPTIONS))
    assert re.findall(r"// POSE (.*)", files["Calpose/start.pgx"]) == ["1", "2", "3", "4"]
    for name, text in files.items():
        assert DIALECT.check(text.encode("ascii"), Path(Path(name).name)) == []


@pytest.mark.parametrize("name", ["cal pose", "7CAL", "", "../cal", "a/b", "end", "x" * 16])
def test_names_of_projects(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="is not a VAL 3 name"):
        DIALECT.write(PoseProgram(name, POSES, OPTIONS), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_joint_beyond_two_turns() -> None:
    far = (ProgramPose("far", np.radians([0, 0, 0, 0, 0, 721])),)
    for form in ("joint", "cartesian"):
        with pytest.raises(InputError, match="pose 'far': J6 is beyond"):
            files_of(PoseProgram("Calpose", far, replace(OPTIONS, form=form)))


def test_no_minus_zero() -> None:
    tiny = (ProgramPose("", -np.full(6, 1e-9)),)
    for form in ("joint", "cartesian"):
        assert '"-0.0' not in data_of(PoseProgram("Calpose", tiny, replace(OPTIONS, form=form)))


def test_poses_lead_back_to_the_postures() -> None:
    robot = ARM.robot
    assert robot is not None
    rng = np.random.default_rng(5)
    poses = tuple(
        ProgramPose(f"T{i}", q, via=i % 3 == 0)
        for i, q in enumerate(rng.uniform(robot.lower, robot.upper, (30, 6)))
    )
    arm = replace(ARM, T_world_user=T_USER, T_tip_tool=T_TOOL)
    program = PoseProgram("Calpose", poses, replace(OPTIONS, form="cartesian"))
    back = DIALECT.parse(data_of(program, arm).encode(), PATH)
    expected = program.postures_rad[np.argsort(program.numbers)]
    assert [p.configuration for p in back.positions] == arm.configurations(expected)
    found = postures_of(back.positions, arm, near=expected)
    # rounding of 5e-5 mm and 5e-6 deg, made larger where the arm is nearly stretched
    np.testing.assert_allclose(found, expected, atol=2e-5)
