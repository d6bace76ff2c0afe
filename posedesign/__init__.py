"""Plan the measuring poses of a robot calibration, and what follows from them.

``posedesign.plan(cell)`` plans, ``posedesign.Cell.load(path)`` reads a cell. Names are loaded when
they are first used, so that ``posedesign --help`` need not wait for the robot libraries.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from posedesign import indices, programs, selection
    from posedesign.cell import Cell
    from posedesign.fewest import plan_fewest
    from posedesign.planner import plan
    from posedesign.pose_plan import PosePlan

__all__ = ["Cell", "PosePlan", "indices", "plan", "plan_fewest", "programs", "selection"]

_WHERE = {
    "Cell": "posedesign.cell",
    "PosePlan": "posedesign.pose_plan",
    "plan": "posedesign.planner",
    "plan_fewest": "posedesign.fewest",
}


def __getattr__(name: str) -> object:
    if name in _WHERE:
        return getattr(import_module(_WHERE[name]), name)
    if name in ("indices", "programs", "selection"):
        return import_module(f"posedesign.{name}")
    raise AttributeError(f"module 'posedesign' has no attribute {name!r}")
