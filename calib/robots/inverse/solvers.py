"""Which way of inverse kinematics an arm gets."""

from __future__ import annotations

from calib.robots.chain import SerialChain
from calib.robots.inverse.closed_form import ClosedForm
from calib.robots.inverse.iterative import DampedIteration
from calib.robots.inverse.redundant import RedundantArm
from calib.robots.inverse.solutions import InverseKinematics


def solver_for(chain: SerialChain) -> InverseKinematics:
    """The solver that gives most of the postures of a chain."""
    return ClosedForm.of(chain) or RedundantArm.of(chain) or DampedIteration(chain)
