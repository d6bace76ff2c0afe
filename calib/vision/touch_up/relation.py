"""The designated relation of target and image, and how far a view is from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.errors import InputError
from calib.se3 import FloatArray
from calib.vision.camera.conic import ellipse_vhs


@dataclass(frozen=True)
class Relation:
    """Where in the image the target is to be, and how large: section 2.1 of [Watanabe2006]_.

    It is the tip of a virtual pin: the place before the lens at which a target is seen so. A view
    is compared with it by the three numbers ``e = (dV, dH, ds)`` of :meth:`error`, which the paper
    has as ``(V - V0, H - H0, 1/s - 1/s0)``.

    Attributes
    ----------
    center_px : tuple of two floats
        H0 and V0: to the right and down from the left upper corner of the image.
    size_px : float
        s0: long axis of the target's ellipse.

    References
    ----------
    .. [Watanabe2006] A. Watanabe et al., A kinematic calibration method for industrial robots using
       autonomous visual measurement, CIRP Annals 55.
    """

    center_px: tuple[float, float]
    size_px: float

    def __post_init__(self) -> None:
        if not (np.isfinite([*self.center_px, self.size_px]).all() and self.size_px > 0.0):
            raise InputError(
                f"the target cannot be designated to be {self.size_px} px large at "
                f"{self.center_px} px",
                hint="give a place in the image and a size above zero",
                name="relation",
            )

    def error(self, ellipses: FloatArray, bias: FloatArray | float = 0.0) -> FloatArray:
        """How far views ``(..., 5)`` [px] are from the relation, ``(..., 3)`` [px].

        ``bias`` ``(..., 3)`` is taken off V, H and s first.

        ``(V - V0) s0/s``, ``(H - H0) s0/s`` and ``s0 (s0/s - 1)``. By Eq. 1 the distance of the
        target is proportional to 1/s, so these three are *linear* in the place of the target
        before the lens, however far off it is: the factor ``s/s0`` that Eq. 2 has in the Jacobian,
        for a Jacobian measured at s0 and used at s, is here taken out of the data. ``s0²`` turns
        the paper's 1/s into pixels.
        """
        vhs = ellipse_vhs(ellipses) - bias
        ratio = self.size_px / vhs[..., 2]
        right, down = self.center_px
        return np.stack(
            [
                (vhs[..., 0] - down) * ratio,
                (vhs[..., 1] - right) * ratio,
                self.size_px * (ratio - 1.0),
            ],
            axis=-1,
        )
