"""Answers to A X = Z B, method by method, and what is to be said of them."""

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
)
from calib.robot_world.accuracy import NOISE_DOUBT
from calib.robot_world.methods import find_method
from calib.robot_world.methods.relative_motions import TOO_MANY
from calib.robot_world.pairs import checked_problem
from calib.robot_world.solver import solve_problem
from calib.se3 import FloatArray
from posedesign.pairs.certificate import Camera, Proof, prove
from posedesign.pairs.file import Pairs

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
    """What one AX=ZB solver made of the pairs, or why it could not.

    Attributes
    ----------
    left_out : tuple of str
        Where the pairs stand that it did not use, in words.
    proof : Proof or None
        Whether no other X and Z are likelier, where that was asked for and can be.
    """

    method: str
    result: RobotWorldResult | None
    problem: str = ""
    left_out: tuple[str, ...] = ()
    proof: Proof | None = None

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

    Parameters
    ----------
    camera : {"on-flange", "fixed"}
    rotation_rad, translation_m : float or None
        Standard deviations about and along each axis; None: as the residuals show it.
    on : {"a", "b", "both", "seen", "shown"} or None
        The side that has it; seen: the target as the camera sees it, which for a camera on the
        flange is the inverse of B; shown: as the residuals show it.
    """
    if on == "shown":
        return "shown"
    if rotation_rad is None or translation_m is None:
        return "B" if on == "b" else None
    if on == "seen" and camera == "on-flange":
        sigma = PairNoise(rotation_rad, translation_m).sigma
        return PairCovariances.of_seen_target(pairs.B, np.diag(sigma**2))
    return PairNoise(rotation_rad, translation_m, _SIDES.get(on or "b", "B"))


def solve_pairs(
    pairs: Pairs,
    methods: Sequence[str],
    noise: Noise | NoiseShown | None = None,
    advance: Advance = lambda what, part: None,
    *,
    estimate_scale: bool = False,
) -> tuple[SolverOutcome, ...]:
    """Solve A X = Z B by several methods.

    Parameters
    ----------
    noise, estimate_scale
        See :func:`calib.robot_world.solve`.
    advance : callable, optional
        Told what is being done, and the part of all work that is done.
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
    said += [("ml-robust", text) for text in _robust_against_all(outcomes)]
    # of one method alone: it is a matter of the poses, and much the same for all
    known = [
        f"known least, by {result.method}: {text}"
        for result in results[:1]
        for text in result.weak_directions
    ]
    return [*_together(said), *known]


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
        f"{name} {1e3 * np.linalg.norm(off[3:]):.2g} mm and "
        f"{np.degrees(np.linalg.norm(off[:3])):.2g} deg"
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
