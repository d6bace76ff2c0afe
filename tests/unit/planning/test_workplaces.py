"""Where an arm will work: the same whatever order its measurements are in, and evenly filled."""

import numpy as np
import pytest

from calib.model import Setup
from posedesign.candidates.workplaces import WORK_POSTURES, workplace
from posedesign.cell import Cell

CELL = """
[robot]
preset = "irb120"
[tool]
point_mm = [0.0, 0.0, 100.0]
[base_pose]
posture_deg = [0.0, 0.0, 0.0, 0.0, 30.0, 0.0]
[measurement]
kind = "point"
[[noise]]
kind = "point"
three_sigma_mm = 0.1
[[target]]
name = "tracker"
position_mm = [2500.0, 0.0, 500.0]
"""


@pytest.fixture(scope="module")
def cell() -> Cell:
    return Cell.from_text(CELL)


def test_the_order_of_measurements_changes_nothing(cell):
    """The expected error of one and the same table moved by a tenth and more."""
    rng = np.random.default_rng(0)
    middle, width = np.radians([0, 10, 0, 0, 30, 0]), np.radians([50, 30, 30, 90, 40, 150])
    q = middle + rng.uniform(-1.0, 1.0, (30, 6)) * width
    setup = Setup.of(30, tool=np.arange(30) % 3)
    order = rng.permutation(30)
    one, other = workplace(cell, q, setup), workplace(cell, q[order], setup[order])
    np.testing.assert_array_equal(other.postures, one.postures)
    np.testing.assert_array_equal(other.setup.tool, one.setup.tool)
    points = cell.robot.state(one.postures).point(cell.tool_m)
    assert 2 * len(points) >= WORK_POSTURES


def test_points_of_a_task_box_are_even():
    """Means over the box are known to a third of what random points would tell them to."""
    box = "[task_box]\nlowest_mm = [300.0, -50.0, 400.0]\nhighest_mm = [400.0, 50.0, 500.0]\n"
    cell = Cell.from_text(CELL + box)
    q = np.tile(cell.base_posture, (4, 1)) + 1e-3 * np.arange(4)[:, None]
    at = workplace(cell, q, Setup.of(4))
    points = cell.robot.state(at.postures).point(cell.tool_m)
    assert len(points) == WORK_POSTURES  # every point is reached
    unit = (points - [0.35, 0.0, 0.45]) / 0.1
    assert (np.abs(unit) <= 0.5 + 1e-9).all()
    usual = np.sqrt(1.0 / 12.0 / len(unit))
    assert (np.abs(unit.mean(axis=0)) < usual / 3.0).all()
    quarters = np.histogram2d(unit[:, 0], unit[:, 1], bins=2)[0] / len(unit)
    assert (np.abs(quarters - 0.25) < 0.1).all()
