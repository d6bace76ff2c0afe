"""A cell with a tracker, its true arm, and an arm as an identification has found it."""

from dataclasses import dataclass

import numpy as np
import pytest

from calib.identification import covariance_of
from calib.se3 import FloatArray
from posedesign.candidates import candidates_of
from posedesign.cell import Cell
from posedesign.files.measurements import MeasurementTable
from posedesign.identification.file import IdentifiedModel
from posedesign.identification.models import model_of
from posedesign.simulation import SimulatedRobot

TRACKER_CELL = """
[robot]
preset = "kr6r900sixx"
tip = "tool0"
[tool]
point_mm = [30.0, 0.0, 120.0]
[base_pose]
posture_deg = [0.0, -60.0, 85.0, 0.0, 65.0, 0.0]
[target]
name = "tracker"
position_mm = [3000.0, 500.0, 800.0]
wpr_deg = [0.0, 0.0, 170.0]
[task_box]
lowest_mm = [450.0, -200.0, 300.0]
highest_mm = [750.0, 200.0, 600.0]
[pool]
candidates = 120
[parameters]
models = [["zero_offsets"]]
[measurement]
kind = "point"
[[noise]]
kind = "point"
three_sigma_mm = 0.06
three_sigma_deg_if_pose
[truth]
tool_error_mm = [0.3, -0.2, 0.1]
target_error_mm = [2.0, 1.0, -1.0]
"""


def tracker_cell(kind: str = "point") -> Cell:
    """The cell with another kind of measurement."""
    turn = "three_sigma_deg = 0.01" if kind == "pose" else ""
    text = TRACKER_CELL.replace('"point"', f'"{kind}"').replace("three_sigma_deg_if_pose", turn)
    return Cell.from_text(text)


@dataclass(frozen=True)
class Found:
    """A cell with an arm that was identified in it, the true values as they were found."""

    cell: Cell
    robot: SimulatedRobot
    identified: IdentifiedModel

    def measured(
        self, q: FloatArray, names: tuple[str, ...], seed: int | None = 0
    ) -> MeasurementTable:
        """What the tracker reads of the true arm at postures [rad]."""
        rng = None if seed is None else np.random.default_rng(seed)
        which = np.zeros(len(q), dtype=np.intp)
        data = self.robot.measure(q, which, names, rng)
        kinds = tuple(kind.name for kind in self.robot.model.measurements)
        return MeasurementTable(data, kinds, tuple(range(2, 2 + data.count)))


def identified_in(cell: Cell) -> Found:
    """The arm of ``[truth]`` as found from 30 poses: its true values, with their covariance."""
    robot = SimulatedRobot.of(cell)
    names = [
        name
        for name in robot.model.names
        if name.startswith(("tool.", "target."))
        or name.removeprefix("zero_offset.") in cell.offset_joints
    ]
    model = model_of(cell, names).with_measurements([cell.measurement])
    x = np.array([robot.value(name) for name in model.names])
    # what the first and the last joint are off, tool and target take up
    for joint in set(cell.robot.arm_joints) - set(cell.offset_joints):
        robot.values[robot.model.names.index(f"zero_offset.{joint}")] = 0.0
    q = candidates_of(cell).postures[:30]
    C = covariance_of(model, q, x=x)
    return Found(
        cell, robot, IdentifiedModel("offsets", cell.robot.name, model, x, np.sqrt(np.diag(C)), C)
    )


@pytest.fixture(scope="session")
def found() -> Found:
    return identified_in(tracker_cell())
