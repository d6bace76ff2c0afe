"""VAL 3 projects: the reader takes what controllers save, and says the line of what it refuses."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from calib.errors import FileFormatError
from posedesign.programs import RecordedProgram, registry
from posedesign.programs.configurations import StaubliConfiguration
from posedesign.programs.rewriting import Change, rewritten
from posedesign.programs.staubli_val3 import StaubliVal3
from tests.unit.programs.dialects import changed, export, refused, shown

DIALECT = StaubliVal3()
PATH = Path("x.dtx")

HEAD = """\
<?xml version="1.0" encoding="utf-8"?>
<Database xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmlns="http://www.staubli.com/robotics/VAL3/Data/2">
  <Datas>
"""
TAIL = """\
  </Datas>
</Database>
"""
EXPORT = export("staubli.dtx")


def parse(text: str, path: Path = PATH) -> RecordedProgram:
    return DIALECT.parse(text.encode("utf-8"), path).whole()


def test_a_project_of_others_is_read() -> None:
    program = parse(EXPORT.replace("\n", "\r\n"))
    assert (program.name, program.comment, program.fingerprint) == ("x", "", "")
    assert [p.name for p in program.positions] == [
        "jPark[0]",
        "jJoint[0]",
        "jJoint[2]",
        "pPoint[0]",
        "pPoint[1]",
    ]
    assert shown(program) == {
        1: [0, 0, 90, 0, 90, 0],
        2: [-8.97077, 0.68477, 0, 0, 0, -79.46655],
        3: [10, 0, 0, -0.5, 0, 0],
    }
    first, second = program.positions[3:]
    assert first.T_user_tool is not None
    np.testing.assert_allclose(first.T_user_tool[:3, 3], [0.885, -0.122343, 0.737831])
    np.testing.assert_allclose(
        first.T_user_tool[:3, :3], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-15
    )
    assert first.T_world_user is not None
    np.testing.assert_allclose(first.T_world_user[:3, 3], [0.1, 0, 0])
    assert first.T_tip_tool is None
    elsewhere = parse(EXPORT.replace('fatherId="world[0]"', 'fatherId="cell:fOther[0]"'))
    assert elsewhere.positions[3].T_world_user is None
    assert first.configuration == StaubliConfiguration(False, None, False)
    assert second.configuration is None
    lines = EXPORT.splitlines()
    assert "79.46655" in lines[program.positions[1].line - 1]


def test_the_program_beside_says_which_positions_are_moved_to(tmp_path: Path) -> None:
    path = tmp_path / "x.dtx"
    path.write_text(EXPORT)
    (tmp_path / "start.pgx").write_text(
        "begin\n  nTraj=movel( pPoint[1] ,tTool,mFast)\n  // movej(jPark,tTool,mFast)\n"
        "  movej(jJoint[2],tTool,mFast)\n movej(jJoint[2],tTool,mFast)\n movej(jNone[0],t,m)\nend"
    )
    program = DIALECT.read(path)
    assert [(p.number, p.name) for p in program.positions] == [(1, "pPoint[1]"), (2, "jJoint[2]")]
    # what it changes before is not what it moves to
    (tmp_path / "start.pgx").write_text(
        "begin\n jJoint[0]=herej()\n jJoint[2].j1=3\n movej(jJoint[2],tTool,mFast)\n"
        "  movel(pPoint[1],tTool,mFast)\nend"
    )
    program = DIALECT.read(path)
    assert [p.name for p in program.positions] == ["pPoint[1]"]
    assert "jJoint[2] is changed by start.pgx, line 3" in program.unread[0].message
    (tmp_path / "start.pgx").write_text("begin\nend")
    assert len(registry.read(path).positions) == 5


SMALL = (
    HEAD
    + """\
    <Data name="jPose" access="public" xsi:type="array" type="jointRx" size="3">
      <Value key="0" j1="1.5" j2="2" j3="3" j4="4" j5="5" j6="6" />
      <Value key="1" j1="2.5" j2="2" j3="3" j4="4" j5="5" j6="6" />
      <Value key="2" j1="3.5" j2="2" j3="3" j4="4" j5="5" j6="6" />
    </Data>
    <Data name="sPlan" access="public" xsi:type="array" type="string" size="1">
      <Value key="0" value="PLAN abcdef12 2" />
    </Data>
    <Data name="sPose" access="public" xsi:type="array" type="string" size="3">
      <Value key="1" value="left" />
    </Data>
"""
    + TAIL
)
POSED = (
    SMALL.replace("jPose", "pPose")
    .replace("jointRx", "pointRx")
    .replace(
        'j1="', 'fatherId="cell:fUser[0]" shoulder="lefty" elbow="epositive" wrist="wpositive" x="'
    )
    .replace("j2", "y")
    .replace("j3", "z")
    .replace("j4", "rx")
    .replace("j5", "ry")
    .replace("j6", "rz")
)
KEPT = SMALL.replace(
    '    <Data name="sPlan"',
    """\
    <Data name="jActual" access="public" xsi:type="array" type="jointRx" size="3">
      <Value key="1" j1="1.25" j2="2" j3="3" j4="4" j5="5" j6="6" />
      <Value key="2" j1="2.25" j2="2" j3="3" j4="4" j5="5" j6="6" />
    </Data>
    <Data name="nFirst" access="public" xsi:type="array" type="num" size="1">
      <Value key="0" value="2" />
    </Data>
    <Data name="sPlan\"""",
)


def test_points_of_a_project_that_is_not_in_millimetres_are_refused(tmp_path: Path) -> None:
    path, listed = tmp_path / "x.dtx", tmp_path / "x.pjx"
    joints = re.sub('    <Data name="pPoint".*?</Data>\n', "", EXPORT, flags=re.DOTALL)
    project = (
        '<?xml version="1.0" encoding="utf-8" ?>\n'
        '<Project xmlns="http://www.staubli.com/robotics/VAL3/Project/3">\n'
        '  <Parameters version="s7.3.1" stackSize="5000" millimeterUnit="false" />\n'
        '  <Database>\n    <Data file="x.dtx" />\n  </Database>\n</Project>\n'
    )
    path.write_text(EXPORT, encoding="utf-8")
    listed.write_text(project)
    with pytest.raises(FileFormatError, match="not in millimetres") as caught:
        parse(EXPORT, path)
    assert (caught.value.row, str(listed) in str(caught.value)) == (3, True)
    assert parse(joints, path).positions
    for other in (project.replace("false", "true"), project.replace("x.dtx", "y.dtx"), "<"):
        listed.write_text(other)
        assert len(parse(EXPORT, path).positions) == 5


def test_projects_as_they_are_written() -> None:
    program = parse(SMALL)
    assert [(p.number, p.name) for p in program.positions] == [(1, ""), (2, "left"), (3, "")]
    assert [p.number for p in program.measured] == [1, 2]
    assert shown(program)[2] == [2.5, 2, 3, 4, 5, 6]
    assert {number: row[0] for number, row in shown(parse(KEPT)).items()} == {
        1: 1.25,
        2: 2.25,
        3: 3.5,
    }
    assert all(p.T_user_tool is not None for p in parse(POSED).positions)


def test_poses_that_were_not_stored_are_left_out() -> None:
    zeros = KEPT.replace('j1="1.25" j2="2" j3="3" j4="4" j5="5" j6="6"', 'j2="-0.000" j3="0"')
    none = re.sub(r'\n.*j1="1.25".*', "", KEPT)
    for text in (zeros, none):
        assert {number: row[0] for number, row in shown(parse(text)).items()} == {2: 2.25, 3: 3.5}


@pytest.mark.parametrize(
    ("source", "old", "new", "line", "message"),
    [
        (SMALL, "</Database>\n", "", 16, "is no whole XML file"),
        (SMALL, "Database", "Project", 16, "is no whole XML file"),
        (SMALL, 'j1="1.5"', 'j1="1.5', 5, "is no whole XML file"),
        (SMALL, 'encoding="utf-8"', 'encoding="foo"', 1, "is no whole XML file: unknown encoding"),
        (SMALL, "<Datas>", "<Datas>&x;", 3, "is no whole XML file"),
        (SMALL, "<Database", "<!DOCTYPE a [<!ENTITY x 'y'>]>\n<Database", 2, "has a DTD or ent"),
        (SMALL, 'key="1" j1', 'key="0" j1', 6, r"jPose\[0\] is there twice"),
        (SMALL, 'key="2"', 'key="3"', 7, r"jPose\[3\] is beyond its size"),
        (SMALL, 'size="3"', 'size="4"', 4, r"jPose\[3\] is not there"),
        (SMALL, 'size="3"', 'size="x"', 4, "jPose has the size 'x'"),
        (SMALL, 'size="3"', 'size="100001"', 4, "jPose has the size"),
        (SMALL, '"sPlan"', '"jPose"', 9, "'jPose' is there twice"),
        (SMALL, 'name="sPlan"', "", 9, "an array has no name"),
        (SMALL, '"jPose"', '"jJoint"', None, "has sPlan, but no jPose"),
        (SMALL, "jointRx", "string", None, "has sPlan, but no jPose"),
        (SMALL, 'j1="1.5"', 'j1="nan"', 5, r"jPose\[0\]: j1 is 'nan', not a number"),
        (SMALL, 'j1="1.5"', 'j1="1_5"', 5, r"jPose\[0\]: j1 is '1_5', not a number"),
        (SMALL, 'j1="1.5"', 'j1=""', 5, r"jPose\[0\]: j1 is '', not a number"),
        (SMALL, 'j1="1.5"', 'j1="721"', 5, r"jPose\[0\]: j1 .* beyond"),
        (SMALL, 'size="3"', 'size="0"', 5, r"jPose\[0\] is beyond its size"),
        (POSED, 'x="1.5"', 'x="1e9"', 5, r"pPose\[0\]: x .* beyond"),
        (POSED, "lefty", "left", 5, r"pPose\[0\]: config"),
        (
            POSED,
            "cell:fUser[0]",
            "cell:fPart[0]",
            6,
            r"pPose\[1\] is in 'cell:fUser\[0\]', points before in",
        ),
        (KEPT, 'value="2"', 'value="x"', 14, "nFirst is 'x'"),
        (KEPT, 'value="2"', 'value="0"', 14, "nFirst is '0'"),
        (
            KEPT,
            'type="jointRx" size="3">\n      <Value key="1" j1="1.25',
            'size="3">\n      <Value key="1" j1="1.25',
            9,
            "jActual is of type ''",
        ),
        (KEPT, '"nFirst"', '"nLast"', None, "nFirst is ''"),
        (HEAD + TAIL, "utf-8", "UTF-8", None, "holds no positions"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(source, old, new, line, message):
    refused("staubli-val3", "x.dtx", changed(source, old, new), line, message)


OLD = """\
<?xml version="1.0" encoding="utf-8"?>
<dataList xmlns="DataNameSpace">
  <dioSection>
    <dio size="1" name="Cil_actuador" public="false" />
  </dioSection>
  <frameSection>
    <frame name="world" public="false">
      <fFather alias="" name="" fatherIndex="0" />
      <valueFrame index="0">
        <tfValue x="0" y="0" z="0" rx="0" ry="0" rz="0" />
      </valueFrame>
    </frame>
    <frame name="fPart" public="false">
      <fFather alias="" name="world" fatherIndex="0" />
      <valueFrame index="0">
        <tfValue x="100" y="0" z="0" rx="0" ry="0" rz="90" />
      </valueFrame>
    </frame>
  </frameSection>
  <jointSection>
    <joint name="j" public="false" size="2">
      <valueJoint index="1">
        <jointValue j1="-46.18419" j2="-6.77518" j3="-20.5" j4="71.4" j5="49.6" j6="-302.5" />
      </valueJoint>
    </joint>
  </jointSection>
  <pointSection>
    <point name="p1" public="false">
      <pFather alias="" name="world" fatherIndex="0" />
      <valuePoint index="0">
        <tpValue x="366.58" y="-390.36" z="-359.79" rx="180" ry="0" rz="0" />
        <cpValue shoulder="ssame" elbow="esame" wrist="wsame" />
      </valuePoint>
    </point>
    <point name="p2" public="false">
      <pFather alias="" name="fPart" fatherIndex="0" />
      <valuePoint index="0">
        <tpValue x="50" y="0" z="0" rx="0" ry="0" rz="0" />
        <cpValue shoulder="lefty" elbow="epositive" wrist="wnegative" />
      </valuePoint>
    </point>
  </pointSection>
</dataList>
"""


def test_data_files_of_the_versions_before_seven_are_read_and_rewritten() -> None:
    joints, first, second = (program := parse(OLD)).positions
    assert [p.name for p in program.positions] == ["j[1]", "p1[0]", "p2[0]"]
    assert shown(program) == {1: [-46.18419, -6.77518, -20.5, 71.4, 49.6, -302.5]}
    assert OLD.splitlines()[joints.line - 1].strip() == '<valueJoint index="1">'
    assert first.configuration is None
    assert second.configuration == StaubliConfiguration(False, False, True)
    T_world = [p.T_world_user @ p.T_user_tool for p in (first, second)]
    np.testing.assert_allclose(
        [T[:3, 3] for T in T_world], [[0.36658, -0.39036, -0.35979], [0.1, 0.05, 0]]
    )
    np.testing.assert_allclose(T_world[1][:3, 0], [0, 1, 0], atol=1e-15)
    further = first.T_user_tool.copy()
    further[0, 3] += 0.001
    changes = [Change(), Change(T_user_tool=further), Change()]
    data, _ = rewritten(DIALECT, OLD.encode(), PATH, program, changes)
    assert data.decode() == OLD.replace("366.58", "367.5800")
    refused(
        "staubli-val3", "x.dtx", changed(OLD, 'name="fPart" f', 'name="fX" f'), 37, "points before"
    )


def test_another_root_is_refused() -> None:
    with pytest.raises(FileFormatError, match="is no data file of a VAL 3 project"):
        parse("<?xml version='1.0'?>\n<svg/>")


@pytest.mark.parametrize("name", ["x.pjx", "start.pgx"])
def test_the_other_files_of_a_project_hold_no_positions(name: str) -> None:
    with pytest.raises(FileFormatError, match="holds no positions") as caught:
        parse(SMALL, Path(name))
    assert "NAME.dtx" in caught.value.hint


def test_entities_are_not_expanded() -> None:
    bomb = '<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa">' + "".join(
        f'<!ENTITY {chr(98 + i)} "{f"&{chr(97 + i)};" * 10}">' for i in range(9)
    )
    text = SMALL.replace("<Database", bomb + "]>\n<Database", 1).replace("left", "&j;")
    with pytest.raises(FileFormatError, match="has a DTD or entities"):
        parse(text)
    assert [p.rule for p in DIALECT.check(text.encode(), PATH)] == ["xml"]
