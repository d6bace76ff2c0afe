"""Robots, measurements and estimation: what a calibration is made of.

Knows nothing of pose planning. Names are loaded when they are first used: errors and conventions
must not wait for the robot libraries.

The paper that all of it began with is cited as [Watanabe2006]_.

.. [Watanabe2006] A. Watanabe et al., A kinematic calibration method for industrial robots using
   autonomous visual measurement, CIRP Annals 55.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from calib import robot_world as robot_world
    from calib.identification import IdentificationResult as IdentificationResult
    from calib.identification import identify as identify
    from calib.model import CalibrationModel as CalibrationModel
    from calib.robots import Robot as Robot
    from calib.robots import preset_names as preset_names
else:
    __getattr__ = load_when_asked(__name__)
