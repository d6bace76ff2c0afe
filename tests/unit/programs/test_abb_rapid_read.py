"""ABB RAPID: the reader takes what controllers and people write, and names what it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.errors import FileFormatError
from calib.se3 import transform
from posedesign.programs import Arm, RecordedProgram, postures_of
from posedesign.programs.abb_rapid import AbbRapid
from tests.unit.programs.dialects import changed, export, refused

# In the manner of a controller and of people: header, attributes, statements divided among lines,
# arrays, positions in motions, data of other types.
EXPORT = export("abb.mod")

SMALL = """\
MODULE CAL
  ! PLAN abcdef12 2
  CONST jointtarget jp1:=[[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget p2:=[[7,8,9],[0,0,1,0],[0,-1,2,3],[9E9,9E9,9E9,9E9,9E9,9E9]];
ENDMODULE
"""


def parse(text: str, name: str = "X.mod") -> RecordedProgram:
    return AbbRapid().parse(text.encode("latin-1"), Path(name)).whole()


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_a_controller_export_is_read(newline: str) -> None:
    program = parse(EXPORT.replace("\n", newline))
    assert (program.name, program.maker) == ("TouchUp", "abb")
    assert program.comment == 'after service; "not a string'
    assert (program.fingerprint, program.mark.measured) == ("00c0ffee", 10)
    found = {p.number: p for p in program.positions}
    lines = EXPORT.splitlines()
    assert [(p.number, p.name, lines[p.line - 1].strip()[:12]) for p in program.positions] == [
        (10, "", "CONST robtar"),
        (2, "", "LOCAL CONST"),
        (11, "jHome", "PERS jointta"),
        (12, "Corner", "pers robtarg"),
        (13, "jTable{1}", "CONST jointt"),
        (14, "jTable{2}", "CONST jointt"),
        (15, "", "MoveAbsJ [[7"),
        (16, "", "MoveJ\\Conc, "),
    ]
    np.testing.assert_array_equal(np.asarray(found[2].shown_deg), [10, -5.5, 20, 0.5, 45, -30])
    np.testing.assert_array_equal(np.asarray(found[14].shown_deg), [6, 5, 4, 3, 2, 1])
    np.testing.assert_array_equal(np.asarray(found[15].shown_deg), [7, 8, 9, 10, 11, 12])
    assert found[10].configuration is not None
    assert found[10].configuration.words == "[0,-1,0,1]"
    up = transform([[0, 0, 1], [0, 1, 0], [-1, 0, 0]], [0.6005, -0.01, 0.70025])
    np.testing.assert_allclose(np.asarray(found[10].T_user_tool), up, atol=1e-8)
    flat = transform(np.diag([1, -1, -1]), [0.001, 0.002, 0.003])
    np.testing.assert_allclose(np.asarray(found[16].T_user_tool), flat, atol=1e-15)


J1 = "jp1:=[[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]]"


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("ENDMODULE\n", "", 5, "is cut off: ENDMODULE is not its end"),
        ("ENDMODULE\n", "ENDMODULE\nmore\n", 7, "is cut off: ENDMODULE is not its end"),
        ("MODULE CAL\n", "", 1, "does not begin with MODULE"),
        (SMALL, "", 1, "does not begin with MODULE"),
        (SMALL[SMALL.index("  CONST") : SMALL.index("ENDM")], "", None, "holds no positions"),
        (J1, "jp1", 3, "jp1 has no value"),
        (J1, "jp1{1}", 3, "has no value"),
        (J1, J1.replace(":=", "="), 3, "cannot make sense of"),
        (J1, J1.replace("1,2,3", "1,2"), 3, r"jp1 has not the lists of 6, 6 numbers"),
        (J1, J1.replace("[9E9", "9E9"), 3, "cannot make sense of"),
        (J1, J1.replace("1,2,3,4,5,6", "9E9,9E9,9E9,9E9,9E9,9E+09"), 3, "jp1 has no value"),
        (J1, J1 + "]", 3, "cannot make sense of"),
        (J1, J1.replace("2,3", "2 3"), 3, "cannot make sense of"),
        (J1, J1.replace("2,3", "2,,3"), 3, "cannot make sense of"),
        (J1, J1.replace("2,3", "2,3[1]"), 3, "cannot make sense of"),
        (J1, J1.replace("2,3", "9E9,3"), 3, r"jp1: axis 2 has no value \(9E9\)"),
        (J1, J1.replace("2,3", "x,3"), 3, "jp1: axis 2 is 'x', not a number"),
        (J1, J1.replace("2,3", "nan,3"), 3, "jp1: axis 2 is 'nan', not a number"),
        (J1, J1.replace("2,3", "2.0.0,3"), 3, "cannot make sense of"),
        (J1, J1.replace("2,3", "720.5,3"), 3, r"jp1: axis 2 is 720.5 deg, beyond \+-720"),
        (J1, J1.replace(",9E9]", ",x]"), 3, "eax_f is 'x', not a number"),
        (J1, "j p1:=[[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]]", 3, "cannot make sense of"),
        (J1, J1.replace("jp1", "jp1{2}"), 3, r"jp1\{1\} has not the lists"),
        (J1, J1.replace("jp1", "jp1{2,3}"), 3, r"jp1\{2,3\} has 2 elements"),
        (J1 + ";", J1, 3, "cannot make sense of"),
        ("CONST jointtarget", "CONST jointarget", 3, "cannot make sense of .CONST"),
        ("CONST jointtarget", "CNST jointtarget", 3, "cannot make sense of .CNST"),
        ("p2:=", "JP1:=", 4, "JP1 is there twice"),
        ("[7,8,9]", "[7,8,1e6]", 4, r"p2: z is 1e6 mm, beyond \+-100000"),
        ("[0,0,1,0]", "[0,0,1,0.1]", 4, "p2: the quaternion's norm is 1.0050, not 1"),
        ("[0,0,1,0]", "[0,0,1.1,0]", 4, r"p2: q3 is 1.1, beyond \+-1.002"),
        ("[0,-1,2,3]", "[0,-1,2,8]", 4, "p2: confdata"),
        ("[0,-1,2,3]", "[0,-1,2]", 4, "p2 has not the lists of 3, 4, 4, 6 numbers"),
        ("CAL\n", "CAL\n\0", 2, "holds the byte 0x00"),
        (
            "ENDMODULE",
            "MoveC [[1]],p2,v1,fine,tool0;\nENDMODULE",
            5,
            "the position has not the lists of 3, 4, 4, 6",
        ),
        ("ENDMODULE", "MoveJ [[1]],v1,fine,tool0;\nENDMODULE", 5, "the position has not the"),
        ("ENDMODULE", "MoveJ [[1],v1,fine,tool0;\nENDMODULE", 5, "cannot make sense of"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(old, new, line, message):
    refused("abb-rapid", "X.mod", changed(SMALL, old, new), line, message)


FRAMED = r"""MODULE CAL
  PERS tooldata tA:=[TRUE,[[10,0,100],[0.70710678,0,0.70710678,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
  PERS tooldata tB:=[FALSE,[[0,0,0],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
  PERS wobjdata wA:=[FALSE,TRUE,"",[[500,0,0],[0.70710678,0,0,0.70710678]],[[0,20,0],[1,0,0,0]]];
  PERS wobjdata wB:=[FALSE,FALSE,"STN1",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  PERS wobjdata wC:=[TRUE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  CONST robtarget p1:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST jointtarget jp2:=[[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC main()
    # 1
    MoveAbsJ jp2\NoEOffs,vmax,fine,tB;
  ENDPROC
ENDMODULE
"""


def framed(code: str) -> RecordedProgram:
    return parse(FRAMED.replace("    # 1", code))


@pytest.mark.parametrize(
    "motion",
    [
        r"MoveJ p1,vmax,fine,tA\WObj:=wA;",
        r"MoveJ p1,vmax,fine,tA,\WObj:=wA;",
        r"MoveL \Conc, P1 \ID:=3, v100 \T:=5, z10 \Inpos:=inpos50, ta \TLoad:=l1 \WObj := WA ;",
        "IF a THEN\nMoveJ p1,vmax,\nfine,tA\\WObj:=wA;\nENDIF\nMoveJ p1,v5,z1,tA\\WObj:=wA;",
        # of arc welding and of events, as public welding cells have them
        r"MoveLDO p1,vmax,fine,tA\WObj:=wA,do1,1;",
        r"TriggL p1,vmax,trig1\T2:=trig2,fine,tA\WObj:=wA;",
        r"ArcLStart p1,v5,seam1,weld1\Weave:=weave1,fine,tA\WObj:=wA;",
    ],
)
def test_frames_of_the_module_are_those_of_the_motion(motion: str) -> None:
    pose, joints = framed(motion).positions
    tip_tool = transform([[0, 0, 1], [0, 1, 0], [-1, 0, 0]], [0.01, 0, 0.1])
    world_user = transform([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.48, 0, 0])
    np.testing.assert_allclose(np.asarray(pose.T_tip_tool), tip_tool, atol=1e-8)
    np.testing.assert_allclose(np.asarray(pose.T_world_user), world_user, atol=1e-8)
    assert joints.T_tip_tool is None
    assert joints.T_world_user is None


@pytest.mark.parametrize(
    ("motion", "tool", "base"),
    [
        ("", False, False),
        ("MoveJ p1,vmax,fine,tool0;", True, True),
        ("MoveJ p1,vmax,fine,tElse;", False, True),
        (r"MoveJ p1,vmax,fine,tool0\WObj:=wElse;", True, False),
        ("MoveJ Offs(p1,0,0,9),vmax,fine,tool0;", False, False),
        (r"tA.tframe.trans.x:=5; MoveJ p1,vmax,fine,tA\WObj:=wA;", False, True),
        (r"wA:=wB; MoveJ p1,vmax,fine,tA\WObj:=wA;", True, False),
    ],
)
def test_frames_are_known_as_far_as_the_module_says(motion: str, tool: bool, base: bool) -> None:
    pose, _ = framed(motion).positions
    assert (pose.T_tip_tool is not None, pose.T_world_user is not None) == (tool, base)


@pytest.mark.parametrize(
    ("code", "line", "message"),
    [
        ("MoveJ p1,v1,fine,tB;", 3, "TB is a tool that stands in the cell"),
        (r"MoveJ p1,v1,fine,tA\WObj:=wB;", 5, "WB is a work object that moves"),
        (r"MoveJ p1,v1,fine,tA\WObj:=wC;", 6, "WC is a work object that moves"),
        ("MoveJ p1,v1,fine,tA;\nMoveL p1,v1,fine,tool0;", 11, "p1 is used in other frames"),
        ("MoveJ p1,v1,fine,tA;\nMoveL p1,v1,fine,tA\\WObj:=wA;", 11, "p1 is used in other frames"),
        ("p1.trans.x:=20;", 10, "p1 is changed by the program"),
        ("IF a THEN\np1 . rot := q;\nENDIF", 11, "p1 is changed by the program"),
        ("x:=3;\njp2.robax.rax_1:=20;", 11, "jp2 is changed by the program"),
        ("x:=3;\nPDispOn p1,tool0;\nMoveJ p1,v1,fine,tA;", 12, "p1 may be displaced"),
        ("MoveJ p1,v1,fine,tA;\nPDispOn p1,tool0;", 10, "p1 may be displaced"),
        ("PDispOn p1,tool0;\nIF a PDispOff;\nMoveJ p1,v1,fine,tA;\nPDispOff;", 12, "displaced"),
    ],
)
def test_what_moves_a_pose_in_silence_is_refused(code: str, line: int, message: str) -> None:
    refused("abb-rapid", "X.mod", FRAMED.replace("    # 1", code), line, message)


def test_what_is_moved_to_without_a_displacement_is_read() -> None:
    code = "MoveJ p1,v1,fine,tA;\nPDispOn p1,tool0;\nMoveJ p9,v1,fine,tA;\nPDispOff;\n"
    for motions in (code, code + "MoveL p1,v1,fine,tA;"):
        pose, _ = framed(motions).whole().positions
        assert pose.T_tip_tool is not None


def test_parts_that_have_a_name_are_read() -> None:
    # as a public generator (Robots, for Grasshopper) writes them: of all positions
    text = (
        "MODULE m\nVAR extjoint extj:=[5,9E9,9E9,9E9,9E9,9E9];\nVAR confdata conf:=[0,-1,0,1];\n"
        "PROC main()\nMoveAbsJ [[0,0,0,0,30,0],extj],v100,fine,tool0;\n"
        "MoveL [[1,2,3],[1,0,0,0],Conf,extj],v100,fine,tool0;\n#ENDPROC\nENDMODULE\n"
    )
    _, second = parse(text.replace("#", "")).positions
    assert second.configuration is not None
    assert (second.configuration.words, second.external_shown) == ("[0,-1,0,1]", (5.0,))
    # one that the program changes is calculated
    assert len(parse(text.replace("#", "conf:=[0,0,0,0];\n")).positions) == 1


def test_what_no_axis_reaches_is_an_axis_that_is_not_there() -> None:
    # as people write it for 9E9 in public modules
    assert len(parse(changed(SMALL, J1, J1.replace("9E9", "1e9"))).positions) == 2


def test_a_list_is_read_however_it_is_divided_and_however_long() -> None:
    # more characters than one statement may have
    element = "[[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    for comma in (",", ",\n", "\n , ", ", ! next\n"):
        text = SMALL.replace(J1, f"j{{600}}:=[{comma.join([element] * 600)}]")
        assert len(parse(text).positions) == 601
        assert not [p for p in AbbRapid().check(text.encode(), Path("X.mod")) if p.level == "error"]


@pytest.mark.parametrize(
    ("code", "line"),
    [
        ("wA := = wB;", 10),
        ("MoveAbsJ jp2 v5,fine,tool0;", 10),
        ("[[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]];", 10),
        ("q:=[[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]];", 10),
        ("SearchL di1,q,[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v5,tool0;", 10),
    ],
)
def test_a_statement_that_is_none_stops_the_reader_where_it_matters(code: str, line: int) -> None:
    text = FRAMED.replace("    # 1", code)
    refused("abb-rapid", "X.mod", text, line, "cannot make sense of")


@pytest.mark.parametrize(
    "code",
    [
        "MoveAbsJ [joints,[9e9,9e9,9e9,9e9,9e9,9e9]],v5,fine,tool0;",  # calculated
        "<SMT>",
    ],
)
def test_a_statement_about_no_position_is_passed_over(code: str) -> None:
    assert len(framed(code).positions) == 2


ARC = "[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"


def test_both_positions_of_a_circle_are_read() -> None:
    before = len(framed("").positions)
    program = framed(f"MoveC {ARC},{ARC.replace('[1,2,3]', '[4,5,6]')},v5,fine,tool0;")
    found = [p.T_user_tool for p in program.positions[before:] if p.T_user_tool is not None]
    np.testing.assert_allclose([1e3 * T[:3, 3] for T in found], [[1, 2, 3], [4, 5, 6]])


def test_one_statement_spoils_its_own_position_alone() -> None:
    twice = FRAMED.replace("    # 1", r"MoveL p1,v5,fine,tA; MoveL p1,v5,fine,tA\WObj:=wA;")
    program = AbbRapid().parse(twice.encode("latin-1"), Path("X.mod"))
    assert len(program.positions) == 2
    assert [p.label for p in program.positions if p.fault] == ["position 1"]
    with pytest.raises(FileFormatError, match="p1 is used in other frames"):
        postures_of(program.positions, Arm.usual("abb", 6))
    changed_ = FRAMED.replace("    # 1", "p1:=CRobT(); MoveL p1,v5,fine,tA;")
    program = AbbRapid().parse(changed_.encode("latin-1"), Path("X.mod"))
    assert [p.number for p in program.positions] == [2]
    assert "p1 is changed by the program" in program.unread[0].message
