"""Arm positions and turns of joints in the words of each maker."""

from calib.errors import InputError
from calib.robots import Robot
from calib.se3 import FloatArray
from posedesign.programs.configuration import Configuration
from posedesign.programs.configurations.abb import AbbConfiguration as AbbConfiguration
from posedesign.programs.configurations.fanuc import FanucConfiguration as FanucConfiguration
from posedesign.programs.configurations.kuka import KukaConfiguration as KukaConfiguration
from posedesign.programs.configurations.staubli import StaubliConfiguration as StaubliConfiguration
from posedesign.programs.configurations.yaskawa import YaskawaConfiguration as YaskawaConfiguration

CONFIGURATIONS: dict[str, type[Configuration]] = {
    kind.maker: kind
    for kind in (
        FanucConfiguration,
        KukaConfiguration,
        AbbConfiguration,
        YaskawaConfiguration,
        StaubliConfiguration,
    )
}
"""By maker. A new maker is a new file and one entry here."""


def configuration_of(maker: str) -> type[Configuration] | None:
    """The words of a maker for arm positions; None where it has none."""
    return CONFIGURATIONS.get(maker)


def words(robot: Robot, postures: FloatArray) -> list[str]:
    """The configuration of each posture ``(N, n)`` [rad]; empty where there are no words for it."""
    kind = configuration_of(robot.controller.maker) if robot.controller else None
    if kind is None:
        return [""] * len(postures)
    try:
        return [found.words for found in kind.of(robot, postures)]
    except InputError:  # an arm with another wrist than the words are for
        return [""] * len(postures)
