"""The simulated robot and cell behind rehearsals, the demonstration and studies."""

from posedesign.simulation.accuracy_study import (
    IDENTIFIED_ARM,
    AccuracyStudy,
    Finding,
    accuracy_study,
    effective_truth,
    pick,
    spread_interval,
)
from posedesign.simulation.plate import PLATE_PITCH_M, PlateTest
from posedesign.simulation.rehearsal import (
    SimulatedRobot,
    circle_target,
    true_cell,
    true_observer,
)

__all__ = [
    "IDENTIFIED_ARM",
    "PLATE_PITCH_M",
    "AccuracyStudy",
    "Finding",
    "PlateTest",
    "SimulatedRobot",
    "accuracy_study",
    "circle_target",
    "effective_truth",
    "pick",
    "spread_interval",
    "true_cell",
    "true_observer",
]
