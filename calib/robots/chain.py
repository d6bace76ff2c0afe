"""Forward kinematics and Jacobian of a serial chain over arrays of postures.

The kernel of everything that is done in batches: Monte Carlo trials times measuring poses. It
holds plain arrays, taken once from the Pinocchio model, and loops over the joints only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.se3 import FloatArray, skew, transform


@dataclass(frozen=True, eq=False)
class ChainState:
    """Where every joint and the tip of a chain are, in the base frame.

    Attributes
    ----------
    rotations : array (..., n, 3, 3)
        ``R_base_link`` of the link that each joint moves.
    origins : array (..., n, 3)
        A point on each joint axis [m].
    axes : array (..., n, 3)
        Unit vector of each joint axis.
    R_base_tip : array (..., 3, 3)
    p_base_tip : array (..., 3)
        [m]
    """

    rotations: FloatArray
    origins: FloatArray
    axes: FloatArray
    R_base_tip: FloatArray
    p_base_tip: FloatArray

    @property
    def T_base_tip(self) -> FloatArray:
        """Pose of the tip, ``(..., 4, 4)``."""
        return transform(self.R_base_tip, self.p_base_tip)

    def point(self, p_tip: FloatArray) -> FloatArray:
        """Points fixed to the tip, ``(..., 3)`` [m] in tip axes, seen from the base."""
        return (self.R_base_tip @ p_tip[..., None])[..., 0] + self.p_base_tip

    def jacobian(self, point: FloatArray) -> FloatArray:
        """Geometric Jacobian ``(..., 6, n)`` of a point of the last link.

        Parameters
        ----------
        point : array (..., 3)
            The point [m], in the base frame.

        Returns
        -------
        array (..., 6, n)
            Rows 0 to 2: velocity of the point [m/rad]; rows 3 to 5: angular velocity; both in
            base axes.
        """
        linear = np.cross(self.axes, point[..., None, :] - self.origins)
        return np.swapaxes(np.concatenate([linear, self.axes], axis=-1), -1, -2)


@dataclass(frozen=True, eq=False)
class SerialChain:
    """n revolute joints in a row.

    Attributes
    ----------
    placements : array (n, 4, 4)
        Frame of each joint at zero, in the frame of the link before it (the first: in the base).
    axes : array (n, 3)
        Unit vector of each joint axis in its own frame.
    T_link_tip : array (4, 4)
        The tip in the frame of the last link.
    """

    placements: FloatArray
    axes: FloatArray
    T_link_tip: FloatArray

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.axes)

    @cached_property
    def _turn(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rodrigues' terms (n, 3, 3): R_placement R(q) = A + sin(q) B + (1 - cos(q)) C."""
        R = self.placements[:, :3, :3]
        K = skew(self.axes)
        return R, R @ K, R @ K @ K

    def forward(self, q: FloatArray) -> ChainState:
        """State of the chain at postures ``(..., n)`` [rad]."""
        A, B, C = self._turn
        batch = q.shape[:-1]
        step = A + np.sin(q)[..., None, None] * B + (1.0 - np.cos(q))[..., None, None] * C
        rotations = np.empty((*batch, self.n, 3, 3))
        origins = np.empty((*batch, self.n, 3))
        rotations[..., 0, :, :] = step[..., 0, :, :]
        origins[..., 0, :] = self.placements[0, :3, 3]
        for j in range(1, self.n):
            R = rotations[..., j - 1, :, :]
            origins[..., j, :] = R @ self.placements[j, :3, 3] + origins[..., j - 1, :]
            rotations[..., j, :, :] = R @ step[..., j, :, :]
        axes = (rotations @ self.axes[..., None])[..., 0]
        last = rotations[..., -1, :, :]
        return ChainState(
            rotations=rotations,
            origins=origins,
            axes=axes,
            R_base_tip=last @ self.T_link_tip[:3, :3],
            p_base_tip=last @ self.T_link_tip[:3, 3] + origins[..., -1, :],
        )
