"""The camera on the tool, and what it sees."""

from calib.camera.pinhole import PinholeCamera

__all__ = ["PinholeCamera"]
