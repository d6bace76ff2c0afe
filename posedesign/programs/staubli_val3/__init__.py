"""Staubli VAL 3 projects."""

from posedesign.programs.staubli_val3.spec import StaubliVal3

__all__ = ["StaubliVal3"]
