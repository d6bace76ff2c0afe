"""The simulated robot and cell behind rehearsals, the demonstration and studies."""

from posedesign.simulation.robot import SimulatedRobot

__all__ = ["SimulatedRobot"]
