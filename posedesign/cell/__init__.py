"""The cell: a robot with its tool, its target and its measurement, ready to be planned for."""

from posedesign.cell.cell import Cell, usual_offsets

__all__ = ["Cell", "usual_offsets"]
