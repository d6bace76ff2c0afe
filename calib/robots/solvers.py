"""Which way of inverse kinematics an arm gets."""

from __future__ import annotations

from calib.robots.chain import SerialChain
from calib.robots.closed_form import ClosedForm
from calib.robots.inverse import InverseKinematics
from calib.robots.iterative import DampedIteration
from calib.robots.redundant import RedundantArm


def solver_for(chain: SerialChain) -> InverseKinematics:
    """The solver that gives most of the postures of a chain."""
    return ClosedForm.of(chain) or RedundantArm.of(chain) or DampedIteration(chain)
