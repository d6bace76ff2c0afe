"""The methods that solve A X = Z B, one file each, and their register."""

from calib.robot_world.methods.registry import METHODS, PAPER_METHODS, Method, find_method

__all__ = ["METHODS", "PAPER_METHODS", "Method", "find_method"]
