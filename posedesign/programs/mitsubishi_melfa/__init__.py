"""Mitsubishi MELFA-BASIC programs."""

from posedesign.programs.mitsubishi_melfa.spec import MitsubishiMelfa

__all__ = ["MitsubishiMelfa"]
