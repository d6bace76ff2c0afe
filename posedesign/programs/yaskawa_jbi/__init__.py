"""Yaskawa INFORM jobs (``.JBI``)."""

from posedesign.programs.yaskawa_jbi.spec import YaskawaJbi

__all__ = ["YaskawaJbi"]
