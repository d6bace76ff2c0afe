"""Proofs that no other X and Z are likelier, and how far an answer is from what they prove.

The proof is of the likelihood in which a rotation counts by its chord, ``2 sin(angle / 2)``: as of
Langevin's distribution in place of a normal one of angles. Both have their optimum at the same
place but for a part of the residual angles squared, which is said in standard deviations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

from calib.errors import InputError
from calib.robot_world import METHODS, Certificate, RobotWorldResult, certify, difference
from calib.se3 import FloatArray

Camera = Literal["on-flange", "fixed"]


@dataclass(frozen=True)
class Frames:
    """What the letters of A X = Z B mean."""

    A: str
    B: str
    X: str
    Z: str  # A, B, X, Z: name of the transform and, in words, what it is
    other_way: str  # what B often is in place of that, and what to do then


FRAMES: Mapping[Camera, Frames] = MappingProxyType(
    {
        "on-flange": Frames(
            A="T_base_flange: the flange in the base frame, as the controller shows it",
            B="T_target_camera: the camera in the frame of the target",
            X="T_flange_camera: the camera in the flange frame",
            Z="T_base_target: the target in the base frame",
            other_way="if B is T_camera_target, the target as the camera sees it (solvePnP, "
            "target2cam, tag detectors), pass `invert` b",
        ),
        "fixed": Frames(
            A="T_base_flange: the flange in the base frame, as the controller shows it",
            B="T_camera_target: the target in the frame of the camera (solvePnP, target2cam)",
            X="T_flange_target: the target in the flange frame",
            Z="T_base_camera: the camera in the base frame",
            other_way="if B is T_target_camera, the camera in the frame of the target, pass "
            "`invert` b",
        ),
    }
)
"""Frames of a camera on the flange that sees a fixed target, and of a fixed camera that sees a
target on the flange."""

AT_THE_OPTIMUM = 0.05
"""Standard deviations up to which X and Z count as the optimum that is proven: too few for any use
of them to tell."""


@dataclass(frozen=True, eq=False)
class Proof:
    """A certificate, and where the answer that it was asked for stands to it."""

    certificate: Certificate
    sigma_X: float
    sigma_Z: float
    sigma: float
    """sigma_X, sigma_Z, sigma: from the answer to the certificate's X, Z, and both together, in
    standard deviations of the direction that has most of them; NaN where there are no standard
    deviations."""

    @classmethod
    def of(cls, result: RobotWorldResult, certificate: Certificate) -> Proof:
        """Compare an answer with its certificate."""
        moved = np.concatenate(
            [difference(certificate.X, result.X), difference(certificate.Z, result.Z)]
        )
        parts = (slice(0, 6), slice(6, 12), slice(0, 12))
        return cls(certificate, *(_sigmas(moved, result.covariance, part) for part in parts))

    @property
    def status(self) -> str:
        """``"proven"``, of the answer itself; ``"away"`` where the optimum proven is another one;
        ``"not optimal"``; ``"not proven"``.
        """
        if not self.certificate.certified:
            return self.certificate.status
        return "proven" if self.sigma <= AT_THE_OPTIMUM else "away"

    @property
    def message(self) -> str:
        """The status in a sentence."""
        proof = self.certificate
        if not proof.certified:
            return proof.message
        turned, moved = np.degrees(proof.rotation_moved_rad), 1e3 * proof.translation_moved_m
        away = "; ".join(
            f"{name} by {turned[k]:.2g} deg, {moved[k]:.2g} mm, {_shown(sigma)}"
            for k, (name, sigma) in enumerate((("X", self.sigma_X), ("Z", self.sigma_Z)))
        )
        if self.status == "proven":
            return f"{proof.message}; this is off that optimum, {away}"
        return f"the optimum proven is {_shown(self.sigma)} away, {away}; of it: {proof.message}"


def refuse_uncertifiable(methods: Sequence[str], on: str, camera: Camera) -> None:
    """Refuse what no certificate can be asked for, before anything is solved.

    ``on`` says where the noise is.
    """
    if not any(METHODS[method].likelihood for method in methods):
        raise InputError(
            "`certify`: only a maximum of the likelihood can be proven to be one",
            hint="add the method ml",
            name="method",
        )
    if on in _UNPROVABLE and not (on == "seen" and camera == "fixed"):
        what, hint = _UNPROVABLE[on]
        raise InputError(
            f"`noise_on` {on} {what}, of which there is no certificate", hint=hint, name="noise"
        )


_UNPROVABLE: Mapping[str, tuple[str, str]] = {
    "shown": (
        "may find noise on both sides",
        "certify without it, by noise of B, or with `noise_on` a or b and its sizes",
    ),
    "both": (
        "has noise on A and B at once",
        "certify with `noise_on` a or b, the side that has more of it",
    ),
    "seen": ("has another size in each direction", "certify with `noise_on` b"),
}
"""Why noise has no certificate, and what to do."""


def prove(A: FloatArray, B: FloatArray, result: RobotWorldResult) -> Proof | None:
    """Proof for an answer from pairs ``(N, 4, 4)``; None where it has no noise to weigh them by."""
    if result.noise is None:
        return None
    used = result.used
    return Proof.of(result, certify(A[used], B[used], result.X, result.Z, result.noise))


def _shown(sigma: float) -> str:
    return f"{sigma:.2g} sigma" if np.isfinite(sigma) else "an unknown part of a sigma"


def _sigmas(moved: FloatArray, covariance: FloatArray | None, part: slice) -> float:
    """Largest ratio of a shift to its standard deviation, over all directions of a part."""
    if covariance is None:
        return float("nan")
    C, d = covariance[part, part], moved[part]
    size = np.sqrt(np.diag(C))
    if not d.any():
        return 0.0
    if not (size > 0.0).all():
        return float("nan")
    values, axes = np.linalg.eigh(C / np.outer(size, size))
    along = axes.T @ (d / size)
    # a direction that rounding leaves no deviation to
    values = np.maximum(values, np.finfo(float).eps * values[-1])
    return float(np.sqrt((along**2 / values).sum()))
