"""FANUC .LS: the writer, and that what it writes is valid and read back equal."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from calib.errors import InputError, OutputError
from posedesign.cell import Cell
from posedesign.planning import plan
from posedesign.programs import (
    DIALECTS,
    Arm,
    PlanMark,
    PoseProgram,
    ProgramOptions,
    ProgramPose,
    read,
    validate,
    write,
)
from posedesign.programs.fanuc_ls.reader import parse_fanuc_ls
from posedesign.programs.fanuc_ls.rules import check_fanuc_ls
from posedesign.programs.fanuc_ls.writer import NAMES

FANUC = Arm.usual("fanuc")

EXPECTED = """\
/PROG  CALPOSE
/ATTR
OWNER\t\t= MNEDITOR;
COMMENT\t\t= "cell 7";
PROG_SIZE\t= 0;
CREATE\t\t= DATE 26-03-04  TIME 05:06:07;
MODIFIED\t= DATE 26-03-04  TIME 05:06:07;
FILE_NAME\t= ;
VERSION\t\t= 0;
LINE_COUNT\t= 10;
MEMORY_SIZE\t= 0;
PROTECT\t\t= READ_WRITE;
TCD:  STACK_SIZE\t= 0,
      TASK_PRIORITY\t= 50,
      TIME_SLICE\t= 0,
      BUSY_LAMP_OFF\t= 0,
      ABORT_REQUEST\t= 0,
      PAUSE_REQUEST\t= 0;
DEFAULT_GROUP\t= 1,*,*,*,*;
CONTROL_CODE\t= 00000000 00000000;
/MN
   1:  !PLAN abcdef12 2 1 4abaef9f ;
   2:  UFRAME_NUM=2 ;
   3:  UTOOL_NUM=3 ;
   4:J P[1] 25% FINE    ;
   5:  WAIT    .30(sec) ;
   6:  CALL MEASURE(1) ;
   7:  !mind the cable ;
   8:J P[2] 25% FINE    ;
   9:  WAIT    .30(sec) ;
  10:  CALL MEASURE(2) ;
/POS
P[1:"T 1"]{
   GP1:
\tUF : 2, UT : 3,\t
\tJ1=     0.000 deg,\tJ2=    15.000 deg,\tJ3=   -40.000 deg,
\tJ4=     0.000 deg,\tJ5=   -50.000 deg,\tJ6=     0.000 deg
};
P[2]{
   GP1:
\tUF : 2, UT : 3,\t
\tJ1=  -180.000 deg,\tJ2=     0.000 deg,\tJ3=     0.000 deg,
\tJ4=     0.500 deg,\tJ5=    -0.500 deg,\tJ6=   720.000 deg
};
/END
"""

POSES = (
    ProgramPose("T 1", np.radians([0, 15, -25, 0, -50, 0])),
    ProgramPose("a name that is too long", np.radians([-180, 0, 0, 0.5, -0.5, 720])),
)


def render(program: PoseProgram) -> str:
    (text,) = DIALECTS["fanuc-ls"].files(program).values()
    return text


def one_pose(**options: object) -> PoseProgram:
    return PoseProgram("CALPOSE", POSES[:1], ProgramOptions(**options))  # type: ignore[arg-type]


def posed(*values_deg: float) -> PoseProgram:
    return PoseProgram("CALPOSE", (ProgramPose("T1", np.radians(values_deg)),))


def test_a_whole_program(tmp_path: Path) -> None:
    poses = (POSES[0], ProgramPose(POSES[1].name, POSES[1].posture_rad, "mind the cable"))
    options = ProgramOptions(
        user_frame=2,
        tool_frame=3,
        speed_percent=25,
        settle_s=0.3,
        comment="cell 7",
        fingerprint="abcdef12",
        written=datetime(2026, 3, 4, 5, 6, 7),
    )
    path = write(PoseProgram("CALPOSE", poses, options), "fanuc-ls", tmp_path)[0]
    assert path.read_bytes() == EXPECTED.replace("\n", "\r\n").encode("ascii")
    assert validate(path) == []

    back = read(path)
    assert (back.name, back.comment, back.fingerprint) == ("CALPOSE", "cell 7", "abcdef12")
    assert [p.name for p in back.positions] == ["T 1", ""]
    assert [(p.number, p.user_frame, p.tool_frame) for p in back.positions] == [
        (1, 2, 3),
        (2, 2, 3),
    ]
    assert path.read_text().splitlines()[back.positions[1].line - 1] == "P[2]{"
    np.testing.assert_allclose(back.postures()[0], POSES[0].posture_rad, atol=1e-12)


def test_the_default_text_does_not_depend_on_the_clock() -> None:
    assert render(one_pose()) == render(one_pose())
    assert "CREATE\t\t= DATE 00-01-01  TIME 00:00:00;" in render(one_pose())


def instructions(program: PoseProgram) -> list[str]:
    body = render(program).split("/MN\n")[1].split("/POS")[0]
    return [line.split(":", 1)[1] for line in body.splitlines()]


def test_no_settling_and_no_call() -> None:
    assert instructions(one_pose(settle_s=0, measure_call=None)) == [
        "  UFRAME_NUM=0 ;",
        "  UTOOL_NUM=1 ;",
        "J P[1] 10% FINE    ;",
    ]


@pytest.mark.parametrize(
    ("settle_s", "text"), [(1.0, "   1.00"), (0.001, "    .01"), (327.67, " 327.67")]
)
def test_the_wait_has_no_leading_zero_and_is_never_rounded_to_none(
    settle_s: float, text: str
) -> None:
    assert instructions(one_pose(settle_s=settle_s))[3] == f"  WAIT{text}(sec) ;"


@pytest.mark.parametrize("value", [0.0, -0.0, -0.0004, 0.0004])
def test_zero_has_no_sign(value: float) -> None:
    text = render(posed(value, 0, 0, 0, 0, 0))
    assert "J1=     0.000 deg" in text
    assert "-0.000" not in text


angles_deg = st.floats(-360, 360)
option_sets = st.builds(
    ProgramOptions,
    user_frame=st.integers(0, 9),
    tool_frame=st.integers(1, 10),
    speed_percent=st.integers(1, 100),
    settle_s=st.floats(0, 327.67),
    measure_call=st.none() | st.from_regex(r"[A-Z][A-Z0-9_]{0,7}", fullmatch=True),
    comment=st.from_regex(r"[ -!#-&(-:<-~]{0,16}", fullmatch=True),
    fingerprint=st.just("") | st.from_regex(r"[0-9a-f]{4,16}", fullmatch=True),
)


@settings(max_examples=60, deadline=None)
@given(
    postures_deg=arrays(float, st.tuples(st.integers(1, 5), st.just(6)), elements=angles_deg),
    options=option_sets,
    names=st.lists(st.text(max_size=20), min_size=5, max_size=5),
    remarks=st.lists(
        st.from_regex(r"[ -!#-&(-:<-~]{0,32}", fullmatch=True), min_size=5, max_size=5
    ),
)
def test_whatever_is_written_is_valid_and_read_back_to_three_decimals(
    postures_deg: np.ndarray, options: ProgramOptions, names: list[str], remarks: list[str]
) -> None:
    poses = [
        ProgramPose(name, posture, remark)
        for name, posture, remark in zip(names, np.radians(postures_deg), remarks, strict=False)
    ]
    name = "ZZZZZZZZ" if options.measure_call != "ZZZZZZZZ" else "A"
    program = PoseProgram(name, tuple(poses), options)
    data = render(program).replace("\n", "\r\n").encode("ascii")
    assert check_fanuc_ls(data) == []

    back = parse_fanuc_ls(data, "X.LS")
    assert (back.name, back.fingerprint) == (program.name, options.fingerprint)
    assert back.comment == options.comment.strip()
    written = np.round(FANUC.shown(program.postures_rad), 3)
    np.testing.assert_allclose(FANUC.shown(back.postures()), written, atol=1e-9)
    rounding = np.abs(np.degrees(back.postures() - program.postures_rad)).max(axis=0)
    assert (rounding <= np.array([0.5, 0.5, 1.0, 0.5, 0.5, 0.5]) * 1e-3 + 1e-9).all()
    for pose, position in zip(poses, back.positions, strict=True):
        assert position.name in (pose.name, "")
        assert (position.user_frame, position.tool_frame) == (
            options.user_frame,
            options.tool_frame,
        )


@pytest.mark.parametrize(
    ("name", "fits"),
    [
        ("T1", True),
        ("sixteen letters.", True),
        ("seventeen letters", False),
        ("a", True),
        ("ends in space ", False),
        (" starts", False),
        ('quote"s', False),
        ("a]b", False),
        ("é", False),
        ("", False),
    ],
)
def test_a_pose_name_is_written_where_it_fits(name: str, fits: bool) -> None:
    text = render(PoseProgram("CAL", (ProgramPose(name, np.zeros(6)),)))
    assert (f'P[1:"{name}"]{{' in text) == fits
    assert ("P[1]{" in text) != fits


@pytest.mark.parametrize(
    ("name", "proposal"),
    [
        ("CALIBRATION", "CALIBRAT"),
        ("cal pose", "CAL_POSE"),
        ("7up", "P7UP"),
        ("_x", "X"),
        ("", "CALPOSE"),
        ("é", "CALPOSE"),
        ("ABCDEFG-H", "ABCDEFG"),
        ("A\n", "A"),
    ],
)
def test_an_illegal_name_comes_with_a_legal_one(name: str, proposal: str) -> None:
    with pytest.raises(InputError, match="is not a FANUC program name") as caught:
        render(PoseProgram(name, POSES))
    assert f"for instance {proposal}:" in caught.value.hint


@given(st.text())
def test_every_proposed_name_is_legal(name: str) -> None:
    NAMES.check(NAMES.legal(name))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"user_frame": 10}, "user_frame is 10, outside 0 to 9"),
        ({"user_frame": -1}, "user_frame is -1"),
        ({"tool_frame": -1}, "tool_frame is -1, outside 0 to 10"),
        ({"tool_frame": 11}, "tool_frame is 11"),
        ({"settle_s": 327.68}, "settle_s is 327.68"),
        ({"comment": "seventeen letters"}, "comment 'seventeen letters' cannot stand"),
        ({"comment": 'a "b"'}, "cannot stand in a comment"),
        ({"comment": "a; b"}, "cannot stand in a comment"),
        ({"comment": "é"}, "cannot stand in a comment"),
        ({"comment": "a\nb"}, "cannot stand in a comment"),
        ({"measure_call": "measure"}, "for instance MEASURE:"),
        ({"measure_call": "CALPOSE"}, "CALPOSE would call itself"),
    ],
)
def test_options_that_the_controller_would_refuse(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        render(one_pose(**options))


@pytest.mark.parametrize("remark", ["x" * 33, "a;b", "a\r\nb"])
def test_a_remark_that_would_break_the_line_is_refused(remark: str) -> None:
    pose = ProgramPose("T1", np.zeros(6), remark)
    with pytest.raises(InputError, match="comment of pose 'T1'"):
        render(PoseProgram("CAL", (pose,)))


@pytest.mark.parametrize("value", [720.01, -720.01, 1e308])
def test_a_joint_beyond_two_turns_is_refused(value: float) -> None:
    with pytest.raises(InputError, match=r"pose 'T1': J4 is beyond \+-720 deg"):
        render(posed(0, 0, 0, value, 0, 0))


def test_the_pendant_value_is_what_must_stay_within_two_turns() -> None:
    with pytest.raises(InputError, match="J3 is beyond"):
        render(posed(0, -400, 400, 0, 0, 0))


@pytest.mark.parametrize("n", [5, 7])
def test_only_arms_of_six_joints(n: int) -> None:
    with pytest.raises(InputError, match=f"has {n} joint values, an arm of fanuc has 6"):
        render(posed(*[0.0] * n))


def test_a_program_of_too_many_lines_is_split(tmp_path: Path) -> None:
    """9,999 numbered lines: each part ends at a measured pose and goes on counting."""
    way = ProgramPose("", np.radians([5.0, 0, 0, 0, 0, 0]), via=True)
    poses = (POSES[0], way, POSES[0]) * 2000
    options = ProgramOptions(fingerprint="abcdef12", settle_s=0.0)
    paths = write(PoseProgram("LONGNAME", poses, options), "fanuc-ls", tmp_path)
    assert [path.name for path in paths] == ["LONAME_1.LS", "LONAME_2.LS"]
    calls: list[int] = []
    for path in paths:
        assert validate(path) == []
        text = path.read_text()
        lines = text.split("/MN\n")[1].split("/POS")[0].splitlines()
        assert len(lines) <= 9999
        assert "CALL MEASURE" in lines[-1]
        calls += [int(k) for k in re.findall(r"CALL MEASURE\((\d+)\)", text)]
        back = read(path)
        assert back.mark == PlanMark("abcdef12", 4000)
        assert [p.number for p in back.measured] == calls[-len(back.measured) :]
    assert calls == list(range(1, 4001))


def test_a_refused_program_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "CAL.LS"
    path.write_text("old")
    with pytest.raises(InputError):
        write(PoseProgram("too long a name", POSES), "fanuc-ls", tmp_path)
    assert path.read_text() == "old"
    with pytest.raises(OutputError, match="the output folder cannot be made"):
        write(PoseProgram("CAL", POSES), "fanuc-ls", path / "none")


def test_positions_on_the_way_are_passed_and_not_measured(tmp_path: Path) -> None:
    """P[1] and P[2] are measured; P[3], in between, is only passed through."""
    q = np.deg2rad([[0.0, 15, -25, 0, -50, 0], [5, 10, -25, 0, -50, 0], [10, 15, -25, 0, -50, 0]])
    poses = (ProgramPose("P01", q[0]), ProgramPose("", q[1], via=True), ProgramPose("P02", q[2]))
    program = PoseProgram("VIA", poses)
    assert program.numbers == (1, 3, 2)
    text = render(program)
    moves = re.findall(r"J P\[(\d+)\]|CALL MEASURE\((\d+)\)", text)
    assert moves == [("1", ""), ("", "1"), ("3", ""), ("2", ""), ("", "2")]
    assert re.findall(r"^P\[(\d+)", text, re.MULTILINE) == ["1", "2", "3"]
    path = write(program, "fanuc-ls", tmp_path)[0]
    assert validate(path) == []
    np.testing.assert_allclose(read(path).postures(), q[[0, 2, 1]], atol=2e-5)


def test_an_approached_round_comes_back_as_it_was_planned(
    make_cell: Callable[..., Cell], tmp_path: Path
) -> None:
    """Before each CALL every URDF joint has moved by 1 deg to one side; the last move is home."""
    cell = make_cell(plan={"approach": "same-side"})
    found = plan(cell)
    (path,) = write(found, "fanuc-ls", tmp_path, name="ROUND")
    assert validate(path) == []
    back = read(path)
    stored = {
        position.number: q for position, q in zip(back.positions, back.postures(), strict=True)
    }
    steps = re.findall(r"J P\[(\d+)\]|CALL MEASURE\((\d+)\)", path.read_text())
    visited = [stored[int(move)] for move, _ in steps if move]
    np.testing.assert_allclose(visited, [q for _, q, _ in found.stops], atol=2e-5)
    np.testing.assert_allclose(visited[-1], cell.base_posture, atol=2e-5)
    assert steps[-1][0]
    calls = [row for row, (_, call) in enumerate(steps) if call]
    assert [int(steps[row][1]) for row in calls] == list(range(1, 28))
    last = [stored[int(steps[row - 1][0])] - stored[int(steps[row - 2][0])] for row in calls]
    np.testing.assert_allclose(np.abs(last), np.deg2rad(1.0), atol=4e-5)
    assert (np.sign(last) == np.sign(last[0])).all()
