"""Arm positions and turns of joints in the words of each maker."""

from posedesign.programs.configuration import Configuration
from posedesign.programs.configurations.abb import AbbConfiguration
from posedesign.programs.configurations.fanuc import FanucConfiguration
from posedesign.programs.configurations.kuka import KukaConfiguration
from posedesign.programs.configurations.staubli import StaubliConfiguration
from posedesign.programs.configurations.yaskawa import YaskawaConfiguration

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

__all__ = [
    "CONFIGURATIONS",
    "AbbConfiguration",
    "FanucConfiguration",
    "KukaConfiguration",
    "StaubliConfiguration",
    "YaskawaConfiguration",
]
