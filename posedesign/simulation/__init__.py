"""The simulated robot and cell behind rehearsals, the demonstration and studies."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from posedesign.simulation.accuracy import (
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
        target_of,
        true_cell,
        true_observer,
    )
else:
    __getattr__ = load_when_asked(__name__)

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
    "target_of",
    "true_cell",
    "true_observer",
]
