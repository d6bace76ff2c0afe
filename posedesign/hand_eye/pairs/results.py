"""Answers to A X = Z B, method by method: what is to be said of them, as rows, and as JSON."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calib.errors import InputError, NotIdentifiableError
from calib.robot_world import (
    METHODS,
    PAPER_METHODS,
    Noise,
    NoiseShown,
    PairCovariances,
    PairNoise,
    RobotWorldResult,
    difference,
    result_to_opencv,
)
from calib.robot_world.accuracy import NOISE_DOUBT
from calib.robot_world.methods import find_method
from calib.robot_world.methods.relative_motions import TOO_MANY
from calib.robot_world.pairs import checked_problem
from calib.robot_world.solver import solve_problem
from calib.se3 import FloatArray, wpr_from_rotation
from posedesign.hand_eye.pairs.certificate import FRAMES, Camera, Proof, prove
from posedesign.hand_eye.pairs.file import DEFAULT_FORM, Pairs

ALL, PAPERS = "all", "papers"

NoiseSide = Literal["a", "b", "both", "seen", "shown"]
_SIDES: Mapping[str, Literal["A", "both"]] = {"a": "A", "both": "both"}
"""The others are of B: what a fixed camera sees is B itself."""

Advance = Callable[[str, float], None]
"""Told what is being done, and the part of all work that is done."""

_LATER = (("standard deviations", "covariance"), ("leaving out pairs", "left_out_residuals"))
"""What takes most of the time of most methods, after solving."""


@dataclass(frozen=True)
class SolverOutcome:
    """What one AX=ZB solver made of the pairs, or why it could not."""

    method: str
    result: RobotWorldResult | None
    problem: str = ""
    left_out: tuple[str, ...] = ()  # where the pairs stand that it did not use, in words
    proof: Proof | None = None
    """Whether no other X and Z are likelier, where that was asked for and can be."""

    @property
    def ok(self) -> bool:
        """Whether there is an answer to be trusted."""
        return self.result is not None and self.result.status == "ok"

    @property
    def said(self) -> str:
        """What the solver says of its answer, or why it has none."""
        return self.result.message if self.result else self.problem


def methods_of(names: str) -> tuple[str, ...]:
    """Methods by their names with commas between them, ``papers`` and ``all`` among them."""
    chosen: list[str] = []
    for name in map(str.strip, names.split(",")):
        if not name:
            raise InputError(
                f"`method` {names!r} lacks a name",
                hint="put one comma between two names, say ml,shah; known: "
                + ", ".join((PAPERS, ALL, *METHODS)),
                name="method",
                value=names,
            )
        several = {ALL: tuple(METHODS), PAPERS: PAPER_METHODS}
        chosen += several[name] if name in several else [find_method(name).name]
    return tuple(dict.fromkeys(chosen))


def asked_noise(
    pairs: Pairs,
    camera: Camera,
    rotation_rad: float | None,
    translation_m: float | None,
    on: NoiseSide | None,
) -> Noise | NoiseShown | None:
    """Noise of pairs, the same in all directions, or how it is to be estimated, if that is said.

    ``camera`` {"on-flange", "fixed"}. ``rotation_rad``, ``translation_m``: standard deviations
    about and along each axis; None: as the residuals show it. ``on`` {"a", "b", "both", "seen",
    "shown"}: the side that has it; seen: the target as the camera sees it, which for a camera on
    the flange is the inverse of B; shown: as the residuals show it.
    """
    if on == "shown":
        return "shown"
    if rotation_rad is None or translation_m is None:
        return "B" if on == "b" else None
    if on == "seen" and camera == "on-flange":
        sigma = PairNoise(rotation_rad, translation_m).sigma
        return PairCovariances.of_seen_target(pairs.B, np.diag(sigma**2))
    return PairNoise(rotation_rad, translation_m, _SIDES.get(on or "b", "B"))


def size_of_noise(noise: Noise | NoiseShown | None) -> Noise | None:
    """Return a noise of known size; None where it is to be estimated."""
    return None if isinstance(noise, str) else noise


def solve_pairs(
    pairs: Pairs,
    methods: Sequence[str],
    noise: Noise | NoiseShown | None = None,
    advance: Advance = lambda what, part: None,
    *,
    estimate_scale: bool = False,
) -> tuple[SolverOutcome, ...]:
    """Solve A X = Z B by several methods.

    ``noise``, ``estimate_scale``: see :func:`calib.robot_world.solve`. ``advance``: told what is
    being done, and the part of all work that is done.
    """
    if not methods:
        raise InputError("no method to solve A X = Z B by", name="methods")
    problem = checked_problem(pairs.A, pairs.B)
    outcomes = []
    refused: NotIdentifiableError | None = None
    for k, method in enumerate(methods):

        def step(what: str, done: int, method: str = method, k: int = k) -> None:
            advance(f"{method}, {what}", (k + done / (1 + len(_LATER))) / len(methods))

        step("solving", 0)
        try:
            chosen = find_method(method)
            result = solve_problem(problem, chosen, noise, estimate_scale=estimate_scale)
        except NotIdentifiableError as error:
            refused = error
            outcomes.append(SolverOutcome(method, None, error.message))
            continue
        except InputError as error:
            # what one method cannot take is no reason to keep back what the others say
            alone = METHODS[method].robust or error.name == TOO_MANY
            if not alone or not any(outcome.result for outcome in outcomes):
                raise
            outcomes.append(SolverOutcome(method, None, error.message))
            continue
        # a result works these out when it is first asked: here, so that progress shows it
        for done, (what, name) in enumerate(_LATER, 1):
            step(what, done)
            getattr(result, name)
        out = tuple(
            place for place, ok in zip(places_of(pairs), result.used, strict=True) if not ok
        )
        outcomes.append(SolverOutcome(method, result, left_out=out))
    advance("writing", 1.0)
    if refused is not None and all(outcome.result is None for outcome in outcomes):
        raise refused
    return tuple(outcomes)


def certified(pairs: Pairs, outcomes: Sequence[SolverOutcome]) -> tuple[SolverOutcome, ...]:
    """Outcomes, those of maximum likelihood with a proof from the pairs that they used."""
    return tuple(
        replace(outcome, proof=prove(pairs.A, _corrected(pairs.B, outcome.result), outcome.result))
        if outcome.result is not None and METHODS[outcome.method].likelihood
        else outcome
        for outcome in outcomes
    )


def _corrected(B: FloatArray, result: RobotWorldResult) -> FloatArray:
    """B with the scale of its translations that a result has estimated."""
    if not result.scale_estimated or result.scale is None:
        return B
    unit = np.ones((4, 4))
    unit[:3, 3] = result.scale.value
    return B * unit


def reached(outcomes: Sequence[SolverOutcome]) -> bool:
    """Whether the answer that was asked for first is to be trusted; the others are compared to it.

    Some of them are at work on what they are not made for. A proof that was asked for and not found
    does count.
    """
    if any(o.proof is not None and o.proof.status != "proven" for o in outcomes):
        return False
    return outcomes[0].ok


def warnings_of(outcomes: Iterable[SolverOutcome], *, misread: bool = False) -> list[str]:
    """What the solvers warn of, each thing once, with the methods that say so.

    Where the pairs are said to be misread already, doubts of the solvers are no news.
    """
    said: list[tuple[str, str]] = []
    for outcome in outcomes:
        result = outcome.result
        if misread and result is not None and result.status == "doubtful":
            continue
        own = [] if outcome.ok else [outcome.said]
        own = [f"{result.status}: {text}" if result else text for text in own]
        more = [] if result is None else [*result.warnings, *result.ambiguities]
        said += [(outcome.method, text) for text in own]
        said += [(outcome.method, text) for text in more if not any(text in t for t in own)]
    return _together(said)


def noise_judged(outcomes: Iterable[SolverOutcome]) -> list[str]:
    """Whether the noise given explains what is left over, each verdict once with the methods."""
    said = []
    for outcome in outcomes:
        result = outcome.result
        if result is None or result.chi2 is None or result.chi2_probability is None:
            continue
        verdict = "explains what is left over"
        if result.chi2_probability < NOISE_DOUBT:
            verdict = "does not explain what is left over: it is larger, or something else is wrong"
        elif result.chi2_probability > 1.0 - NOISE_DOUBT:
            verdict = "is larger than what is left over shows"
        text = (
            f"chi² {result.chi2:.5g} of {result.freedom} degrees of freedom, chi²/freedom "
            f"{result.chi2 / result.freedom:.3g}, probability {result.chi2_probability:.2g}: "
            f"the noise given {verdict}"
        )
        said.append((outcome.method, text))
    return _together(said)


def remarks_of(outcomes: Sequence[SolverOutcome]) -> list[str]:
    """What else the solvers say of their answers, each thing once, with the methods."""
    said = [(outcome.method, outcome.said) for outcome in outcomes if outcome.ok]
    said += [(o.method, f"did not use {', '.join(o.left_out)}") for o in outcomes if o.left_out]
    results = [outcome.result for outcome in outcomes if outcome.ok and outcome.result]
    said += [(o.method, o.proof.message) for o in outcomes if o.proof is not None]
    said += [
        (o.method, "proofs are of noise of B, the same in all directions, as large as residuals")
        for o in outcomes
        if o.proof is not None and o.result is not None and o.result.noise_estimated
    ]
    said += [
        (o.method, f"95 % intervals: up to {(half / sigma).max():.3g} sigma to either side")
        for o in outcomes
        if o.result is not None
        and (half := o.result.half_width_X) is not None
        and (sigma := o.result.sigma_X) is not None
        and (sigma > 0.0).all()
    ]
    said += [
        (o.method, f"by {name}: X moves by {_moved(off[:6])}, Z by {_moved(off[6:])}")
        for o in outcomes
        if o.result is not None
        for name, off in o.result.other_noises
    ]
    said += [("ml-robust", text) for text in _robust_against_all(outcomes)]
    # of one method alone: it is a matter of the poses, and much the same for all
    known = [
        f"known least, by {result.method}: {text}"
        for result in results[:1]
        for text in result.weak_directions
    ]
    return [*_together(said), *known]


def _moved(off: FloatArray) -> str:
    """Rotation and translation ``(6,)`` of a transform that moves, in words."""
    turn, shift = np.degrees(np.linalg.norm(off[:3])), 1e3 * np.linalg.norm(off[3:])
    return f"{shift:.2g} mm and {turn:.2g} deg"


def _robust_against_all(outcomes: Sequence[SolverOutcome]) -> list[str]:
    """How far the answer from the pairs that agree is from the one of all, in a sentence."""
    found = {outcome.method: outcome.result for outcome in outcomes if outcome.result}
    if not {"ml", "ml-robust"} <= found.keys():
        return []
    whole, robust = found["ml"], found["ml-robust"]
    count = int((~robust.used).sum())
    if not count:
        return ["takes all pairs, as ml does: no pair contradicts the others"]
    far = [
        f"{name} {_moved(off)}"
        for name, off in (
            ("X", difference(robust.X, whole.X)),
            ("Z", difference(robust.Z, whole.Z)),
        )
    ]
    return [
        f"without the {count} of {len(robust.used)} pairs that contradict the others, "
        f"{' and '.join(far)} from ml, which takes all"
    ]


def _together(said: Iterable[tuple[str, str]]) -> list[str]:
    """Texts with the methods that say them."""
    methods: dict[str, list[str]] = {}
    for method, text in said:
        methods.setdefault(text, []).append(method)
    return [f"{', '.join(who)}: {text}" for text, who in methods.items()]


def places_of(pairs: Pairs) -> tuple[str, ...]:
    """Where the pairs stand in their file, or what they are called."""
    return pairs.places or pairs.names


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
        "half_width_95_X": result.half_width_X,
        "half_width_95_Z": result.half_width_Z,
        "smallest_found": dict(result.smallest_found),
        "by_other_noises": [
            {"noise": name, "X_moves": off[:6], "Z_moves": off[6:]}
            for name, off in result.other_noises
        ],
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
