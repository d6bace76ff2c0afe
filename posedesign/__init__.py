"""Plan the measuring poses of a robot calibration, and what follows from them.

``posedesign.plan(cell)`` plans, ``posedesign.Cell.load(path)`` reads a cell. Names are loaded when
they are first used, so that ``posedesign --help`` need not wait for the robot libraries.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from posedesign import programs, selection
    from posedesign.cell import Cell
    from posedesign.planning.loop import plan
    from posedesign.planning.optimal import OptimalPlan, Request, plan_fewest, plan_optimal
    from posedesign.planning.pose_plan import PosePlan
    from posedesign.selection import indices, select

__all__ = [
    "Cell",
    "OptimalPlan",
    "PosePlan",
    "Request",
    "indices",
    "plan",
    "plan_fewest",
    "plan_optimal",
    "programs",
    "select",
    "selection",
]

_WHERE = {
    "Cell": "posedesign.cell",
    "PosePlan": "posedesign.planning.pose_plan",
    "plan": "posedesign.planning.loop",
    "OptimalPlan": "posedesign.planning.optimal",
    "Request": "posedesign.planning.optimal",
    "plan_fewest": "posedesign.planning.optimal",
    "plan_optimal": "posedesign.planning.optimal",
    "select": "posedesign.selection",
}


def __getattr__(name: str) -> object:
    if name in _WHERE:
        return getattr(import_module(_WHERE[name]), name)
    if name == "indices":
        return import_module("posedesign.selection.indices")
    if name in ("programs", "selection"):
        return import_module(f"posedesign.{name}")
    raise AttributeError(f"module 'posedesign' has no attribute {name!r}")
