"""Proof that a solution of A X = Z B is the global optimum of its likelihood."""

from calib.robot_world.certificate.certify import Certificate, LocalMinimum, certify, minimise
from calib.robot_world.certificate.polynomial import Weights, cost_weights

__all__ = ["Certificate", "LocalMinimum", "Weights", "certify", "cost_weights", "minimise"]
