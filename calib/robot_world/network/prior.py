"""Priors of frames: knowledge from a drawing, a rule, axes that are parallel."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from calib import se3
from calib.errors import InputError
from calib.robot_world.noise import difference
from calib.se3 import FloatArray

_ALONG_AXIS = 1e-9
"""Part of a direction along an axis that counts as none."""


@dataclass(frozen=True, eq=False)
class FramePrior:
    """Normal knowledge of a frame, in the axes of its parent; nothing where sigma is infinite.

    Attributes
    ----------
    frame : str
        Name of the frame.
    T : ndarray (4, 4)
        The frame as it is known [m].
    sigma_m, sigma_rad : float or array_like (3,)
        Standard deviations of its place along each axis of the parent, and of its turn about each;
        infinite where it is not known.
    free_axis : array_like (3,), optional
        Direction in the parent about which the turn is not known, where others are: of an axis that
        is parallel to another.
    """

    frame: str
    T: FloatArray
    sigma_m: ArrayLike = np.inf
    sigma_rad: ArrayLike = np.inf
    free_axis: ArrayLike | None = None
    root: FloatArray = field(init=False)
    """(6, 6): takes the difference (w, v) of the frame from T to white numbers."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "T", se3.rigid(self.T, f"the prior of {self.frame}"))
        root = np.zeros((6, 6))
        for own, name in ((slice(0, 3), "sigma_rad"), (slice(3, 6), "sigma_m")):
            sigma = np.broadcast_to(np.asarray(getattr(self, name), dtype=float), 3)
            if not (sigma > 0.0).all():
                raise InputError(
                    f"{name} of the prior of {self.frame} is {sigma.tolist()}",
                    hint="give standard deviations above 0, inf where nothing is known",
                    name=name,
                )
            root[own, own] = np.diag(1.0 / sigma)
        if self.free_axis is not None:
            axis = np.asarray(self.free_axis, dtype=float)
            axis = axis / np.linalg.norm(axis)
            root[:3, :3] = root[:3, :3] @ (np.eye(3) - np.outer(axis, axis))
        object.__setattr__(self, "root", root)

    @property
    def is_whole(self) -> bool:
        """Return True if all six numbers of the frame are known."""
        return bool(np.linalg.matrix_rank(self.root) == 6)

    def white(self, T: FloatArray) -> FloatArray:
        """Return white rows ``(6,)`` of the frame at T; their derivatives are :attr:`root`."""
        return np.asarray(self.root @ difference(T, self.T))


def prior_of_axis(
    frame: str, axis: str, direction: ArrayLike, sigma_rad: float, sigma_m: ArrayLike = np.inf
) -> FramePrior:
    """Return the prior that an axis of a frame has a direction of its parent.

    Parameters
    ----------
    axis : {"x", "y", "z"}
        Axis of the frame.
    direction : array_like (3,)
        In the axes of the parent.
    """
    d = np.asarray(direction, dtype=float)
    length = float(np.linalg.norm(d))
    if d.shape != (3,) or not np.isfinite(length) or length <= _ALONG_AXIS:
        raise InputError(f"{frame}: the direction of its {axis} axis has no length", name=frame)
    d = d / length
    own = np.eye(3)["xyz".index(axis)]
    turn = np.cross(own, d)
    sine, cosine = float(np.linalg.norm(turn)), float(own @ d)
    if sine < _ALONG_AXIS:  # parallel, or half a turn about any axis across it
        turn = np.roll(own, 1) * (0.0 if cosine > 0.0 else 1.0)
        sine = float(np.linalg.norm(turn)) or 1.0
    R = se3.rotation_exp(turn / sine * np.arctan2(np.linalg.norm(np.cross(own, d)), cosine))
    return FramePrior(frame, se3.transform(R, np.zeros(3)), sigma_m, sigma_rad, d)
