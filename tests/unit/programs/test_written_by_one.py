"""What only one controller's writer does; the rest is tested of all of them together."""

from __future__ import annotations

import importlib
import os
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.errors import InputError
from posedesign.cell import Cell
from posedesign.planning import plan
from posedesign.pose_programs import import_touch_ups
from posedesign.programs import DIALECTS, Arm, Load, PoseProgram, ProgramPose, read, validate, write
from tests.unit.programs.dialects import arm_of, program_of, robot_of, texts_of
from tests.unit.programs.test_written_and_read import POSES, WRITTEN, faults, random_program

FAR = np.radians([-170.0, -100.123456, -100.123456, -180.123456, -100.123456, -300.123456])


def checked(program: PoseProgram, name: str) -> str:
    """The text of a program of one file, which breaks no rule."""
    ((file, text),) = DIALECTS[name].files(program).items()
    assert [p for p in DIALECTS[name].check(text.encode(), Path(file)) if p.level == "error"] == []
    return text


def test_abb_has_names_for_faceplate_and_world() -> None:
    program = replace(program_of("abb-rapid", form="cartesian"), arm=Arm.of(robot_of("abb-rapid")))
    text = checked(program, "abb-rapid")
    assert "tooldata" not in text
    assert "wobjdata" not in text
    assert "fine,tool0\\WObj:=wobj0;" in text
    joint = checked(program_of("abb-rapid"), "abb-rapid")
    assert "tooldata" not in joint  # MoveAbsJ knows no tool frame, and the load is not known
    assert "wobjdata" not in joint  # nor a work object
    assert "fine,tool0;" in joint


@pytest.mark.parametrize("form", ["joint", "cartesian"])
def test_the_tool_of_an_abb_has_the_load_of_the_arm(form: str) -> None:
    loaded = replace(arm_of("abb-rapid"), load=Load(2.3456, np.array([0.01, -0.0021, 0.05])))
    program = replace(program_of("abb-rapid", form=form), arm=loaded)
    text = checked(program, "abb-rapid")
    tool = re.search(r"PERS tooldata tCalib:=(.*);", text)
    assert tool
    assert tool[1].startswith("[TRUE,[[10.0000,-20.0000,150.0000],[0.707106781,")
    assert tool[1].endswith(",[2.346,[10.00,-2.10,50.00],[1,0,0,0],0,0,0]]")
    assert "not known" not in text
    assert "fine,tCalib" in text
    # at the faceplate, too: tool0 carries nothing
    at_tip = replace(program, arm=replace(loaded, T_tip_tool=np.eye(4)))
    assert "fine,tCalib" in checked(at_tip, "abb-rapid")
    none = replace(program, arm=replace(loaded, load=Load(0.0, np.zeros(3))))
    nothing = checked(none, "abb-rapid")
    assert ("tool0" in nothing) == (form == "joint")
    assert ("[0.001,[0,0,0.001]," in nothing) == (form == "cartesian")


def test_the_routine_of_the_longest_name_of_an_abb_is_no_longer() -> None:
    text = checked(program_of("abb-rapid", call="C" * 32), "abb-rapid")
    assert f"PROC {'C' * 28}_run()" in text


def test_programs_of_older_versions_for_an_abb_are_read() -> None:
    text = (WRITTEN / "abb-rapid-joint/CALPOSE.mod").read_text()
    old = re.sub(r".*speeddata.*\n", "", text).replace("vCalib", "vmax")
    old = old.replace("PROC CALPOSE_run()", "PROC main()\n    VelSet 20,5000;")
    old = old.replace("  ENDPROC", "    VelSet 100,5000;\n  ENDPROC")
    abb, path = DIALECTS["abb-rapid"], Path("CALPOSE.mod")
    assert [p for p in abb.check(old.encode(), path) if p.level != "note"] == []
    found, expected = (
        [p.shown_deg for p in abb.parse(t.encode(), path).positions] for t in (old, text)
    )
    np.testing.assert_array_equal(found, expected)


def test_the_speed_of_a_ur_is_a_share_of_that_of_the_slowest_joint() -> None:
    robot = robot_of("ur-script")
    slow = replace(robot, speed=np.array([1.0, 2.0, np.nan, 4.0, 5.0, 6.0]))
    still = replace(robot, speed=np.full(6, 1e-9))
    for arm, percent, said in (
        (Arm.of(slow), 10, "v=0.1000)"),
        (Arm.usual("ur"), 10, "v=0.3142)"),
        (Arm.of(still), 1, "v=0.0001)"),
    ):
        program = replace(program_of("ur-script", speed_percent=percent), arm=arm)
        assert said in texts_of(program, "ur-script")


def test_the_payload_of_a_ur_is_the_load() -> None:
    program = program_of("ur-script")
    assert "set_payload" not in texts_of(program, "ur-script")
    assert "user_frame" not in texts_of(program, "ur-script")
    load = Load(2.5, np.array([0.0, -0.01, 0.06]))
    text = checked(replace(program, arm=replace(arm_of("ur-script"), load=load)), "ur-script")
    lines = [line.strip() for line in text.splitlines()]
    k = lines.index("set_payload(2.5000, [0.000000, -0.010000, 0.060000])")
    assert lines[k - 1].startswith("set_tcp(")
    for bad in (Load(-1.0, load.com_m), Load(np.nan, load.com_m), Load(1.0, 1e3 * load.com_m)):
        with pytest.raises(InputError, match="of the load is"):
            texts_of(replace(program, arm=replace(arm_of("ur-script"), load=bad)), "ur-script")


def test_a_new_arm_position_of_a_yaskawa_is_said_once() -> None:
    q = np.array([[0.1, 0.2, 0.1, 0, -1, 0], [0.2, 0.2, 0.1, 0, -1, 0], [0.1, 0.2, 0.1, 3, 1, 0]])
    program = program_of("yaskawa-jbi", [ProgramPose("", row) for row in q], form="cartesian")
    kinds = re.findall(r"(?m)^(///RCONF|C\d{5}=)", checked(program, "yaskawa-jbi"))
    assert kinds == ["///RCONF", "C00000=", "C00001=", "///RCONF", "C00002="]


def test_lines_of_a_kuka_are_short(tmp_path: Path) -> None:
    poses = [ProgramPose("N" * 80, FAR, comment="C" * 80)] * 3
    for form in ("joint", "cartesian"):
        program = program_of(
            *("kuka-krl", poses, "N" * 24),
            form=form,
            first_register=32000,
            keep="register",
            comment="T" * 80,
            measure_call="M" * 24,
            fingerprint="0123456789abcdef",
        )
        files = write(replace(program, first=99_997), "kuka-krl", tmp_path)
        assert faults("kuka-krl", files) == []
        lines = "\n".join(file.read_text() for file in files).splitlines()
        assert max(len(line) for line in lines if line[:5] != ";FOLD") < 120


def test_planned_positions_of_a_kuka_are_no_touch_ups(reference_cell: Cell) -> None:
    path = WRITTEN / "kuka-krl-joint/CALPOSE.dat"
    for keep in (False, True):
        with pytest.raises(InputError, match="no register holds a touched-up position"):
            import_touch_ups(reference_cell, [path], keep_untouched=keep)


def test_a_position_that_the_pendant_of_a_kuka_touched_up_is_read_with_its_frames() -> None:
    pose = "E6POS XP1={X 525.0,Y -10.0,Z 890.25,A 10.5,B -12.0,C 178.5,S 2,T 35}"
    text = (WRITTEN / "kuka-krl-joint/CALPOSE.dat").read_text()
    text, count = re.subn("E6AXIS XP1=.*", pose, text)
    assert count == 1
    first, second, _ = DIALECTS["kuka-krl"].parse(text.encode(), Path("CALPOSE.dat")).positions
    assert (first.shown_deg, first.tool_frame, first.user_frame) == (None, 3, 2)
    assert second.shown_deg is not None


def parse_with(folder: str) -> Any:
    """Function that tells the syntax errors of a text by a parser generated from a grammar."""
    sys.path.insert(0, folder)
    antlr4 = pytest.importorskip("antlr4", reason="runs the parser of the grammar")
    listener: Any = importlib.import_module("antlr4.error.ErrorListener").ErrorListener
    lexer_of = importlib.import_module("krlLexer").krlLexer
    parser_of = importlib.import_module("krlParser").krlParser

    def errors(text: str) -> list[str]:
        found: list[str] = []

        class Listener(listener):  # type: ignore[misc]
            def syntaxError(self, *what: Any) -> None:
                found.append(str(what[2:5]))

        lexer = lexer_of(antlr4.InputStream(text))
        parser = parser_of(antlr4.CommonTokenStream(lexer))
        for machine in (lexer, parser):
            machine.removeErrorListeners()
            machine.addErrorListener(Listener())
        parser.module()
        return found

    return errors


@pytest.mark.skipif(
    "POSEDESIGN_KRL_PARSER" not in os.environ,
    reason="POSEDESIGN_KRL_PARSER names no folder with a parser generated from the KRL grammar",
)
def test_a_parser_of_the_public_grammar_takes_what_is_written() -> None:
    errors = parse_with(os.environ["POSEDESIGN_KRL_PARSER"])
    rng = np.random.default_rng(4)
    for form in ("joint", "cartesian") * 8:
        for text in DIALECTS["kuka-krl"].files(random_program("kuka-krl", form, rng)).values():
            assert errors(text.replace("\n", "\r\n")) == []
    dat, src = DIALECTS["kuka-krl"].files(program_of("kuka-krl", POSES)).values()
    assert errors(dat.replace(",A3", " A3"))
    assert errors(src.replace("WAIT SEC", "WAIT SEK"))


def test_the_pendant_value_of_a_fanuc_is_what_must_stay_within_two_turns() -> None:
    pose = ProgramPose("T1", np.radians([0, -400, 400, 0, 0, 0]))
    with pytest.raises(InputError, match="J3 is beyond"):
        texts_of(program_of("fanuc-ls", [pose]), "fanuc-ls")


def test_an_approached_round_comes_back_as_it_was_planned(make_cell, tmp_path):
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
