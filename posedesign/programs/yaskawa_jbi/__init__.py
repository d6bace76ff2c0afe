"""Yaskawa INFORM jobs (``.JBI``)."""

from posedesign.programs.yaskawa_jbi.dialect import YaskawaJbi

__all__ = ["YaskawaJbi"]
