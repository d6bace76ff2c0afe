"""What comes back from a controller's file: its positions, or the faults found in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posedesign.programs.program import FloatArray


@dataclass(frozen=True, eq=False)
class RecordedPosition:
    """One position as a controller stores it.

    Parameters
    ----------
    number : int
        The number it has in the program, e.g. 3 for FANUC's ``P[3]``.
    name : str
        Its name on the controller; empty where it has none.
    posture_rad : ndarray (n,)
        Joint values [rad], in the signs of the URDF.
    user_frame, tool_frame : int or None
        Frames it was recorded in; None where the file leaves them open.
    line : int
        Line of the file where it starts, counted from 1.
    """

    number: int
    name: str
    posture_rad: FloatArray
    user_frame: int | None
    tool_frame: int | None
    line: int


@dataclass(frozen=True, eq=False)
class RecordedProgram:
    """A program read back from a controller's file.

    Parameters
    ----------
    name, comment : str
        Name and title of the program.
    fingerprint : str
        Mark of the plan it was written from; empty where it carries none.
    positions : tuple of RecordedPosition
        At least one, in the order of the file.
    """

    name: str
    comment: str
    fingerprint: str
    positions: tuple[RecordedPosition, ...]

    @property
    def postures_rad(self) -> FloatArray:
        """Postures of all positions, shape (N, n) [rad], in the signs of the URDF."""
        return np.stack([position.posture_rad for position in self.positions])


@dataclass(frozen=True)
class Problem:
    """Something in a program that a controller would refuse, or run in another way than meant.

    Parameters
    ----------
    line : int
        Line of the file, counted from 1 as an editor shows it.
    rule : str
        Name of the rule it breaks.
    message : str
        What is wrong.
    """

    line: int
    rule: str
    message: str

    def __str__(self) -> str:
        return f"line {self.line}: {self.message} [{self.rule}]"
