"""Plan the measuring poses of a robot calibration, and what follows from them.

``posedesign.plan(cell)`` plans, ``posedesign.Cell.load(path)`` reads a cell. Names are loaded when
they are first used, so that ``posedesign --help`` need not wait for the robot libraries.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

__version__ = "0.1.0"

if TYPE_CHECKING:
    from posedesign import programs, selection
    from posedesign.cell import Cell
    from posedesign.planning.loop import plan
    from posedesign.planning.optimal import OptimalPlan, Request, plan_fewest, plan_optimal
    from posedesign.planning.pose_plan import PosePlan
    from posedesign.report.plots import plot
    from posedesign.selection import indices, select
else:
    __getattr__ = load_when_asked(__name__)

__all__ = [
    "Cell",
    "OptimalPlan",
    "PosePlan",
    "Request",
    "__version__",
    "indices",
    "plan",
    "plan_fewest",
    "plan_optimal",
    "plot",
    "programs",
    "select",
    "selection",
]
