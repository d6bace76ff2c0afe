"""Calibration of a robot that moves, at the cell: its adapters, and what they read."""
