"""Proof that a solution of A X = Z B is the global optimum of its likelihood."""

from calib.robot_world.certificate.certify import Certificate, certify
from calib.robot_world.certificate.local import LocalMinimum, minimise
from calib.robot_world.certificate.polynomial import Weights, cost_weights

__all__ = ["Certificate", "LocalMinimum", "Weights", "certify", "cost_weights", "minimise"]
