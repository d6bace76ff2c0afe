"""Answers to A X = Z B as rows of tables, and as JSON with everything."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from calib.robot_world import (
    PAPER_METHODS,
    PairNoise,
    RobotWorldResult,
    result_to_opencv,
)
from calib.se3 import FloatArray, wpr_from_rotation
from posedesign.hand_eye.pairs.certificate import FRAMES, Camera, Proof
from posedesign.hand_eye.pairs.file import DEFAULT_FORM, Pairs
from posedesign.hand_eye.pairs.results import SolverOutcome, places_of

POSE_AXES = (*DEFAULT_FORM.place_columns, *DEFAULT_FORM.turn_columns)
_SIGMA_AXES = ("rx_deg", "ry_deg", "rz_deg", *DEFAULT_FORM.place_columns)

DEFAULT_METHODS = ("ml", "ml-robust", *PAPER_METHODS)


def solver_row(outcome: SolverOutcome) -> dict[str, object]:
    """One solver's answer as a table row."""
    result = outcome.result
    row: dict[str, object] = {
        "method": outcome.method,
        "status": result.status if result else "refused",
        "iterations": result.iterations if result else None,
        **{name: value(result) if result else None for name, value in _LEFT_OVER.items()},
        **_scale_numbers(result),
    }
    for letter in "xz":
        values = _numbers(result.X if letter == "x" else result.Z) if result else [None] * 6
        sigma = _sigma_numbers(result, letter)
        for axis, value in zip(POSE_AXES, values, strict=True):
            row[f"{letter}_{axis}"] = value
        for axis, deviation in zip(_SIGMA_AXES, sigma, strict=True):
            row[f"sigma_{letter}_{axis}"] = deviation
    row["message"] = outcome.said
    return row


def _scale_numbers(result: RobotWorldResult | None) -> dict[str, object]:
    """Factor of B's translations and its deviation; nothing where the pairs do not tell it."""
    scale = result.scale if result else None
    told = scale is not None and np.isfinite(scale.sigma)
    return {
        "scale_of_b": scale.value if scale and told else None,
        "sigma_scale_of_b": scale.sigma if scale and told else None,
        "scale_estimated": ("yes" if result.scale_estimated else "no") if result else None,
    }


_LEFT_OVER: Mapping[str, Callable[[RobotWorldResult], object]] = {
    "residual_rotation_deg": lambda result: np.rad2deg(result.rotation_rms_rad),
    "residual_translation_mm": lambda result: 1e3 * result.translation_rms_m,
    "left_out_rotation_deg": lambda result: np.rad2deg(result.left_out_rotation_rms_rad),
    "left_out_translation_mm": lambda result: 1e3 * result.left_out_translation_rms_m,
    "pairs": lambda result: len(result.used),
    "used": lambda result: int(result.used.sum()),
    # a noise with a covariance of its own for each pair is no two numbers
    "noise_rotation_deg": lambda result: (
        np.rad2deg(result.noise.rotation_rad) if isinstance(result.noise, PairNoise) else None
    ),
    "noise_translation_mm": lambda result: (
        1e3 * result.noise.translation_m if isinstance(result.noise, PairNoise) else None
    ),
    "noise_on": lambda result: result.noise and result.noise.on,
    "noise": lambda result: result.noise and ("estimated" if result.noise_estimated else "given"),
    "chi2": lambda result: result.chi2,
    "freedom": lambda result: result.freedom,
    "chi2_per_freedom": lambda result: result.chi2 and result.chi2 / result.freedom,
    "chi2_probability": lambda result: result.chi2_probability,
}
"""Residuals in numbers, rms, of the pairs that were used, by column."""


_EACH = ("residual_deg", "residual_mm", "left_out_deg", "left_out_mm")


def pair_rows(pairs: Pairs, outcome: SolverOutcome) -> list[dict[str, object]]:
    """Residuals of every pair by one solver, and those that it has when it is left out."""
    result = outcome.result
    count = len(pairs.names)
    nothing = np.full((count, 6), np.nan)
    residuals, left_out = (
        (result.residuals, result.left_out_residuals) if result else (nothing, nothing)
    )
    used = [None] * count if result is None else ["yes" if ok else "no" for ok in result.used]
    columns = zip(*_lengths(residuals), *_lengths(left_out), strict=True)
    names = ("method", "pose", "place", "used", *_EACH)
    return [
        dict(zip(names, (outcome.method, *labels, *numbers), strict=True))
        for *labels, numbers in zip(pairs.names, places_of(pairs), used, columns, strict=True)
    ]


def outcome_as_dict(
    pairs: Pairs, outcome: SolverOutcome, camera: Camera = "on-flange", *, opencv: bool = False
) -> dict[str, object]:
    """Everything that one solver says, for JSON: the row of the table, and in m and rad the rest.
    The camera's place tells what X and Z are called; ``opencv`` adds them in OpenCV's names.
    """
    frames, result = FRAMES[camera], outcome.result
    content: dict[str, object] = {
        **solver_row(outcome),
        "frames": {letter: getattr(frames, letter) for letter in "ABXZ"},
        "each_pair": pair_rows(pairs, outcome),
    }
    if result is None:
        return content
    content |= {
        "X": result.X,
        "Z": result.Z,
        "covariance": result.covariance,
        "covariance_with_scale": result.scale.covariance if result.scale else None,
        "residuals": result.residuals,
        "rank": result.rank,
        "warnings": result.warnings,
        "noise_made": result.noise_made,
        "weak_directions": result.weak_directions,
        "ambiguities": result.ambiguities,
        "alternatives": [{"X": X, "Z": Z} for X, Z in result.alternatives],
    }
    if outcome.proof is not None:
        content["certificate"] = _proof_as_dict(outcome.proof)
    if opencv:
        content["opencv"] = dict(zip(OPENCV_NAMES, result_to_opencv(result), strict=True))
    return content


def _proof_as_dict(proof: Proof) -> dict[str, object]:
    """A proof; what has two values has that of X, then that of Z."""
    found = proof.certificate
    return {
        "status": proof.status,
        "message": proof.message,
        "chi2": found.cost,
        "bound": found.bound,
        "relative_gap": found.relative_gap,
        "unique": found.unique,
        "X": found.X,
        "Z": found.Z,
        "away_deg": np.rad2deg(found.rotation_moved_rad),
        "away_mm": 1e3 * found.translation_moved_m,
        "away_sigma": (proof.sigma_X, proof.sigma_Z),
        "away_sigma_both": proof.sigma,
    }


OPENCV_NAMES = ("base2world", "gripper2cam")


def opencv_rows(outcomes: Iterable[SolverOutcome]) -> list[dict[str, object]]:
    """The answers as ``cv2.calibrateRobotWorldHandEye`` names and returns them."""
    return [
        {
            "method": outcome.method,
            "transform": name,
            **dict(zip(POSE_AXES, _numbers(T), strict=True)),
        }
        for outcome in outcomes
        if outcome.result is not None
        for name, T in zip(OPENCV_NAMES, result_to_opencv(outcome.result), strict=True)
    ]


def largest_sigma(outcome: SolverOutcome, letter: str) -> tuple[float | None, float | None]:
    """Largest standard deviation of X or Z along any axis [mm], and about any [deg]."""
    sigma = _sigma_numbers(outcome.result, letter)
    turn = [value for value in sigma[:3] if value is not None]
    place = [value for value in sigma[3:] if value is not None]
    return max(place, default=None), max(turn, default=None)


def _numbers(T: FloatArray) -> list[float]:
    return [*(1e3 * T[:3, 3]), *np.rad2deg(wpr_from_rotation(T[:3, :3]))]


def _sigma_numbers(result: RobotWorldResult | None, letter: str) -> list[float | None]:
    """Standard deviations [deg, mm], or nothing six times."""
    sigma = None if result is None else (result.sigma_X if letter == "x" else result.sigma_Z)
    if sigma is None:
        return [None] * 6
    return [*np.rad2deg(sigma[:3]).tolist(), *(1e3 * sigma[3:]).tolist()]


def _lengths(residuals: FloatArray) -> tuple[list[float], list[float]]:
    """Angles [deg] and distances [mm] of residuals ``(N, 6)``."""
    angles, distances = (np.linalg.norm(residuals[:, at : at + 3], axis=-1) for at in (0, 3))
    return np.rad2deg(angles).tolist(), (1e3 * distances).tolist()
