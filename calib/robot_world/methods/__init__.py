"""The methods that solve A X = Z B, one file each, and their register."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from calib.robot_world.methods.registry import METHODS as METHODS
    from calib.robot_world.methods.registry import PAPER_METHODS as PAPER_METHODS
    from calib.robot_world.methods.registry import Method as Method
    from calib.robot_world.methods.registry import find_method as find_method
else:
    __getattr__ = load_when_asked(__name__)
