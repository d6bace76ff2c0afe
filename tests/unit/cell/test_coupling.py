"""An arm whose controller shows joint 3 with joint 2 in it: files, programs, doubts."""

import re
from pathlib import Path

import numpy as np
import pytest

from calib.errors import CalibError, FileFormatError
from posedesign.cell import Cell, cell_template
from posedesign.files.csv_tables import Row
from posedesign.files.postures import postures_of
from posedesign.programs import DIALECTS, Arm, PoseProgram, ProgramOptions, ProgramPose

COUPLING = """
[[robot.coupling]]
joint = "joint_3"
of = "joint_2"
ratio = 1.0

[tool]"""


def coupled(preset: str = "irb120") -> Cell:
    text = cell_template(preset, surroundings=False)
    return Cell.from_text(text.replace("\n[tool]", COUPLING, 1))


def test_a_program_has_the_values_of_the_controller():
    cell = coupled()
    q = np.deg2rad([[10.0, 20.0, -30.0, 5.0, 40.0, 60.0]])
    arm, dialect = Arm.of(cell.robot), DIALECTS["abb-rapid"]
    poses = (ProgramPose("P1", q[0]),)
    options = ProgramOptions(fingerprint="abcdef12", measure_output=1)
    text = "".join(dialect.files(PoseProgram("CALIB", poses, options, arm)).values())
    written = re.search(r"jointtarget \w+:=\[\[([^]]*)\]", text)
    np.testing.assert_allclose(
        np.array(written[1].split(","), float), [10.0, 20.0, -10.0, 5.0, 40.0, 60.0]
    )
    back = dialect.parse(text.encode(), Path("CALIB.mod"))
    np.testing.assert_allclose(back.postures(dialect.seen(arm)), q, atol=1e-6)


def test_descriptions_know_nothing_of_it():
    cell, dialect = coupled(), DIALECTS["ros-trajectory"]
    seen = dialect.seen(Arm.of(cell.robot))
    np.testing.assert_allclose(seen.shown(np.full(6, 0.1)), np.rad2deg(np.full(6, 0.1)))


def test_pendant_columns_are_read_with_it(tmp_path):
    cell = coupled()
    shown = [10.0, 20.0, -10.0, 5.0, 40.0, 60.0]
    columns = [f"pendant_j{k}_deg" for k in range(1, 7)]
    rows = [Row(2, dict(zip(columns, map(str, shown), strict=True)))]
    q = postures_of(tmp_path / "a.csv", columns, rows, 6, cell.robot.controller, False)
    np.testing.assert_allclose(np.rad2deg(q[0]), [10.0, 20.0, -30.0, 5.0, 40.0, 60.0])


def test_a_coupling_needs_a_controller_and_joints():
    urdf_like = cell_template("panda", surroundings=False).replace("\n[tool]", COUPLING, 1)
    with pytest.raises(CalibError, match="no joint 'joint_3' to couple"):
        Cell.from_text(urdf_like)


def test_an_arm_that_has_one_is_doubted_without_it(tmp_path):
    from tests.arms import urdf_from

    joints = [
        ((0, 0, 0.68), (0, 0, 0), "0 0 1", 165),
        ((0.2, 0, 0), (0, 0, 0), "0 1 0", 95),
        ((0, 0, 0.89), (0, 0, 0), "0 1 0", 65),
        ((0, 0, 0.15), (0, 0, 0), "1 0 0", 200),
        ((0.88, 0, 0), (0, 0, 0), "0 1 0", 120),
        ((0.14, 0, 0), (0, 0, 0), "1 0 0", 400),
    ]
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(urdf_from(joints).replace('name="arm"', 'name="abb_irb4400l_30_243"'))
    text = cell_template(str(urdf)).replace("# controller", "controller", 1)
    text = text.replace("collisions = true", "collisions = false")
    cell = Cell.from_text(text)
    assert cell.robot.controller.maker == "abb"
    assert any("IRB 4400 shows J3 with J2 in it" in said for said in cell.doubts)
    given = COUPLING.replace("joint_", "j")
    told = Cell.from_text(text.replace("\n[tool]", given, 1))
    assert not any("IRB 4400" in said for said in told.doubts)
    without = text.replace('controller = "abb"', '# controller = "abb"')
    with pytest.raises(FileFormatError, match="the controller is not known"):
        Cell.from_text(without.replace("\n[tool]", given, 1))
