"""Plan the measuring poses of a robot calibration, and what follows from them.

``posedesign.plan(cell)`` plans, ``posedesign.Cell.load(path)`` reads a cell. Names are loaded when
they are first used, so that ``posedesign --help`` need not wait for the robot libraries.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

__version__ = "0.1.0"

if TYPE_CHECKING:
    from posedesign import programs as programs
    from posedesign import selection as selection
    from posedesign.cell import Cell as Cell
    from posedesign.planning.loop import plan as plan
    from posedesign.planning.optimal import OptimalPlan as OptimalPlan
    from posedesign.planning.optimal import Request as Request
    from posedesign.planning.optimal import plan_fewest as plan_fewest
    from posedesign.planning.optimal import plan_optimal as plan_optimal
    from posedesign.planning.pose_plan import PosePlan as PosePlan
    from posedesign.report.plots import plot as plot
    from posedesign.selection import indices as indices
    from posedesign.selection import select as select
else:
    __getattr__ = load_when_asked(__name__)
