"""FANUC teach pendant programs in ASCII (``.LS``), and position registers (``POSREG.VA``)."""

from posedesign.programs.fanuc_ls.dialect import FanucLs

__all__ = ["FanucLs"]
