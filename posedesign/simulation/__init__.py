"""The simulated robot and cell behind rehearsals, the demonstration and studies."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from posedesign.simulation.accuracy import IDENTIFIED_ARM as IDENTIFIED_ARM
    from posedesign.simulation.accuracy import PLATE_PITCH_M as PLATE_PITCH_M
    from posedesign.simulation.accuracy import AccuracyStudy as AccuracyStudy
    from posedesign.simulation.accuracy import Finding as Finding
    from posedesign.simulation.accuracy import PlateTest as PlateTest
    from posedesign.simulation.accuracy import accuracy_study as accuracy_study
    from posedesign.simulation.accuracy import effective_truth as effective_truth
    from posedesign.simulation.accuracy import pick as pick
    from posedesign.simulation.rehearsal import SimulatedRobot as SimulatedRobot
    from posedesign.simulation.rehearsal import circle_target as circle_target
    from posedesign.simulation.rehearsal import target_of as target_of
    from posedesign.simulation.rehearsal import true_cell as true_cell
    from posedesign.simulation.rehearsal import true_observer as true_observer
else:
    __getattr__ = load_when_asked(__name__)
