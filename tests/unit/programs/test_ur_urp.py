"""Programs as PolyScope saves them: waypoints, scripts, features, and hostile files."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from calib.errors import CalibError, FileFormatError
from posedesign.programs import read, validate
from posedesign.programs.reading import MOST_BYTES, MOST_LINES, read_program_bytes
from posedesign.programs.sets import set_mark
from tests.unit.programs.dialects import changed, dialect_of, export, program_of, shown

TEXT = export("ur.urp")
URP = dialect_of("ur-urp")


def parse(text: str) -> object:
    return URP.parse(text.encode(), Path("probe.urp")).whole()


def test_waypoints_of_a_tree_are_read_with_names_and_lines() -> None:
    back = URP.parse(TEXT.encode(), Path("probe.urp"))
    assert back.name == "probe_1"
    assert [(p.name, p.line) for p in back.positions] == [("over_part", 22), ("part", 43)]
    np.testing.assert_allclose(
        np.radians(shown(back)[2]), [1.99, -1.7, 1.95, -0.27, 1.32, 0.0036], atol=1e-15
    )
    assert URP.check(TEXT.encode(), Path("probe.urp")) == []


def test_a_program_is_packed_always_alike_and_read_packed_and_unpacked(tmp_path: Path) -> None:
    (path,) = URP.write(program_of("ur-urp"), tmp_path)
    packed = path.read_bytes()
    assert packed[:2] == b"\x1f\x8b"
    assert URP.write(program_of("ur-urp"), tmp_path / "again")[0].read_bytes() == packed
    mark = set_mark(read_program_bytes(path))
    assert mark is not None
    assert (mark.plan, mark.files) == ("abcdef12", 1)
    assert validate(path) == []
    unpacked = tmp_path / "plain.urp"
    unpacked.write_bytes(gzip.decompress(packed))
    for a, b in zip(read(path).positions, read(unpacked).positions, strict=True):
        np.testing.assert_array_equal(a.shown_deg, b.shown_deg)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('referencedName="Joint_0_name"', 'referencedName="Plane_1"', "in_feature_Plane_1"),
        ('reference="../../Move/feature"', 'reference="../../Move[3]/feature"', "in_feature_one"),
        ('type="Fixed" name="part"', 'type="Relative" name="part"', "relative_waypoint"),
        ('type="Fixed" name="part"', 'type="Variable" name="part"', "variable_waypoint"),
        (
            '<JointAngles angles="1.99, -1.7, 1.95, -0.27, 1.32, 0.0036"/>',
            "<Pose/>",
            "waypoint_without_joints",
        ),
        ("1.99, -1.7,", "1.99,", "has no right angles|not six"),
        ("1.99, -1.7,", "9.99, -1.7,", "beyond all limits"),
        ("<children>\n    <Init", "<children>\n    <aa/> <bb/><Init", ""),
        ("</URProgram>", "</URProgra>", "is no whole tree"),
        ("<URProgram ", '<!DOCTYPE x [<!ENTITY a "b">]><URProgram ', "has a DTD or entities"),
    ],
)
def test_what_the_arm_would_not_go_to_is_refused(old: str, new: str, message: str) -> None:
    text = changed(TEXT, old, new)
    if message:
        with pytest.raises(FileFormatError, match=message):
            parse(text)
    else:
        parse(text)


def test_joints_are_those_whatever_the_feature() -> None:
    text = TEXT.replace('positionType="CartesianPose"', 'positionType="JointAngles"')
    text = text.replace("Joint_0_name", "Plane_1")
    assert shown(URP.parse(text.encode(), Path("probe.urp"))).keys() == {1, 2}


def test_scripts_of_a_branch_give_no_certain_value() -> None:
    given = "<cachedContents>q=[1,1,1,1,1,1]\nmovej(q)\n</cachedContents>"
    node = f'<Script type="File">\n{given}\n<file resolves-to="file">a</file></Script>\n'
    straight = changed(TEXT, "        <Wait", node + "        <Wait")
    assert len(shown(URP.parse(straight.encode(), Path("a.urp")))) == 3
    later = node.replace("1,1]", "1,2]").replace("movej(q)\n", "")
    looped = changed(straight, '            <Script type="Line">', later + '<Script type="Line">')
    back = changed(
        looped, "        </Loop>", "        </Loop>\n" + node.replace("q=[1,1,1,1,1,1]", "")
    )
    with pytest.raises(FileFormatError, match="cannot be known"):
        parse(back)


def test_several_nodes_on_one_line_are_not_told_apart() -> None:
    lines = TEXT.split("\n")
    with pytest.raises(FileFormatError, match="several nodes on one line"):
        parse("\n".join([*lines[:15], "".join(lines[15:])]))


@pytest.mark.parametrize("data", [gzip.compress(b" " * (MOST_BYTES + 1)), b"\x1f\x8b\x08rubbish"])
def test_what_unpacks_to_too_much_or_not_at_all_is_refused(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "bomb.urp"
    path.write_bytes(data)
    for call in (read, validate):
        with pytest.raises(FileFormatError, match="damaged or larger than 20 MB"):
            call(path)


def test_a_packed_file_with_something_behind_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "more.urp"
    path.write_bytes(gzip.compress(TEXT.encode()) + b"more")
    with pytest.raises(FileFormatError, match="damaged"):
        read(path)


def test_a_deep_or_a_long_tree_ends() -> None:
    with pytest.raises(CalibError, match="more than 1000000 lines"):
        parse(TEXT.replace("<children>", "<children>" + "\n" * MOST_LINES, 1))
    with pytest.raises(CalibError, match="too many nodes, or too deep"):
        parse("<a>" * 5000)
