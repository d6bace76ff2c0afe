"""Published recordings read as they are: columns named in the cell, nothing converted beforehand.

The same arms through tables of posedesign's own are in ``test_irb120`` and ``test_ur10``.
"""

import numpy as np
import pytest

from posedesign.cell import Cell
from posedesign.files.measurements import read_measurements
from posedesign.identification.instruments import read_measured

pytestmark = pytest.mark.real_data

IRB120 = """
[instrument]
frame = "arm"
unit = "mm"
header = ["x", "y", "z"]
reflectors = ["p1", "p2", "p3"]
joint_header = ["q1", "q2", "q3", "q4", "q5", "q6"]
joint_unit = "deg"
"""

UR10 = """
[instrument]
kind = "pose"
frame = "{frame}"
unit = "m"
turn = "wpr-rad"
joint_unit = "rad"
[instrument.columns]
place = ["x1", "y1", "z1"]
turn = ["phix1", "phiy1", "phiz1"]
joints = ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint",
    "wrist_2_joint", "wrist_3_joint"]
"""


@pytest.fixture
def tables(load_study, tmp_path):
    """Cell and table of a study, made from the published files."""

    def made(folder, data_folder):
        cell, table = load_study(folder).write_tables(data_folder, tmp_path)
        return (cell[0] if isinstance(cell, list) else cell), table

    return made


def test_a_measuring_arm_with_three_points_a_pose(tables, data_folder, tmp_path):
    from tests.real_data.test_irb120 import FOLDER

    measured = data_folder / "identification" / "abb_irb120"
    if not measured.is_dir():
        pytest.skip(f"{measured} does not exist")
    path, table = tables(FOLDER, data_folder)
    expected = read_measurements(table, 6).data
    path.write_text(path.read_text(encoding="utf-8") + IRB120, encoding="utf-8")
    found = read_measured(
        Cell.load(path), measured / "CaliPosition.csv", measured / "CaliJointAngles.csv"
    )
    assert found.table.notes == ()
    data = found.table.data
    assert (data.count, len(data.tools)) == (108, 3)
    np.testing.assert_array_equal(data.setup.tool, expected.setup.tool)
    np.testing.assert_allclose(data.postures, expected.postures, atol=1e-11)
    np.testing.assert_allclose(data.observed, expected.observed, atol=1e-11)


def test_motion_capture_with_joints_in_the_same_file(tables, data_folder, tmp_path):
    from tests.real_data.test_ur10 import FOLDER

    measured = data_folder / "identification" / "ur10"
    if not measured.is_dir():
        pytest.skip(f"{measured} does not exist")
    path, table = tables(FOLDER, data_folder)
    expected = read_measurements(table, 6).data
    section = UR10.format(frame=expected.targets[0])
    path.write_text(path.read_text(encoding="utf-8") + section, encoding="utf-8")
    found = read_measured(Cell.load(path), measured / "calibration.csv")
    assert found.table.notes == ()
    data = found.table.data
    assert data.count == expected.count == 23
    np.testing.assert_allclose(data.postures, expected.postures, atol=1e-11)
    np.testing.assert_allclose(data.observed, expected.observed, atol=1e-9)
