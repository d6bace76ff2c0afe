"""URScript numbers, as scripts and logs have them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from calib.se3 import FloatArray
from posedesign.programs.reading import MOST_JOINT_DEG, MOST_POSITION_MM, number, refuse

JOINTS = 6

_CONTROL = re.compile(rb"[\x00-\x08\x0b-\x1f\x7f]")
_DEGREES = re.compile(r"d2r\(\s*([-+.\deE]{1,40})\s*\)", re.ASCII)


def decoded(data: bytes, path: Path | str) -> str:
    """Text of a file; comments may be in any language, control characters are refused."""
    data = data.replace(b"\r\n", b"\n")
    bad = _CONTROL.search(data)
    if bad:
        row = data.count(b"\n", 0, bad.start()) + 1
        refuse(f"holds the byte 0x{bad[0][0]:02x}: it is no text", path, row, "name a text file")
    return data.decode("latin-1")


def joints_deg(text: str, what: str, path: Path | str, row: int) -> FloatArray:
    """Joint values ``(6,)`` [deg] of what stands inside the brackets of a list [rad]."""
    most = float(np.radians(MOST_JOINT_DEG))
    return np.degrees(_six(text, what, most, path, row))


def pose_values(text: str, what: str, path: Path | str, row: int) -> FloatArray:
    """Coordinates [m] and rotation vector [rad] ``(6,)`` of what stands inside ``p[...]``."""
    return np.array(_six(text, what, MOST_POSITION_MM / 1e3, path, row))


def _six(text: str, what: str, most: float, path: Path | str, row: int) -> list[float]:
    parts = text.split(",")
    if len(parts) != JOINTS:
        refuse(f"{what} has {len(parts)} values, not six", path, row, "is this another robot's?")
    values = []
    for j, part in enumerate(parts, start=1):
        stripped = part.strip()
        degrees = _DEGREES.fullmatch(stripped)
        value = number(degrees[1] if degrees else stripped, f"{what}: value {j}", path, row, 1e9)
        values.append(float(np.radians(value)) if degrees else value)
        if abs(values[-1]) > most:
            reason = f"{what}: value {j} is {stripped[:30]}, beyond +-{most:.4g}"
            refuse(reason, path, row, "joints are in radians, coordinates in metres")
    return values
