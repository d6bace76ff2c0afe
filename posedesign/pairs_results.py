"""Answers to A X = Z B, method by method, and what is to be said of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calib.errors import InputError, NotIdentifiableError
from calib.robot_world import (
    METHODS,
    PAPER_METHODS,
    Certificate,
    PairCovariances,
    PairNoise,
    RobotWorldResult,
    certify,
    solve,
)
from calib.robot_world.methods import find_method
from calib.robot_world.noise import Noise
from posedesign.pairs_file import Pairs
from posedesign.pairs_frames import Camera

ALL, PAPERS = "all", "papers"

NoiseOn = Literal["A", "B", "both", "seen"]


@dataclass(frozen=True)
class SolverOutcome:
    """What one AX=ZB solver made of the pairs, or why it could not.

    Attributes
    ----------
    method : str
    result : RobotWorldResult or None
    problem : str
    left_out : tuple of str
        Where the pairs stand that it did not use, in words.
    certificate : Certificate or None
        Whether no other X and Z are likelier, where that was asked for.
    """

    method: str
    result: RobotWorldResult | None
    problem: str = ""
    left_out: tuple[str, ...] = ()
    certificate: Certificate | None = None

    @property
    def ok(self) -> bool:
        """Whether there is an answer to be trusted."""
        return self.result is not None and self.result.status == "ok"

    @property
    def said(self) -> str:
        """What the solver says of its answer, or why it has none."""
        return self.result.message if self.result else self.problem


def methods_of(names: str) -> tuple[str, ...]:
    """Methods by their names with commas between them, or ``papers``, or ``all``.

    Raises
    ------
    InputError
        An unknown name; the hint has the near ones.
    """
    if names == ALL:
        return tuple(METHODS)
    chosen: list[str] = []
    for name in (part.strip() for part in names.split(",")):
        chosen += PAPER_METHODS if name == PAPERS else [find_method(name).name]
    return tuple(dict.fromkeys(chosen))


def noise_of(
    pairs: Pairs, camera: Camera, rotation_rad: float, translation_m: float, on: NoiseOn
) -> Noise:
    """Noise of pairs, the same in all directions.

    Parameters
    ----------
    pairs : Pairs
    camera : {"on-flange", "fixed"}
    rotation_rad, translation_m : float
        Standard deviations about and along each axis.
    on : {"A", "B", "both", "seen"}
        The side that has it; seen: the target as the camera sees it, which for a camera on the
        flange is the inverse of B.
    """
    if on != "seen":
        return PairNoise(rotation_rad, translation_m, on)
    noise = PairNoise(rotation_rad, translation_m, "B")
    if camera == "fixed":
        return noise
    return PairCovariances.of_seen_target(pairs.B, np.diag(noise.sigma**2))


def solve_pairs(
    pairs: Pairs, methods: Sequence[str], noise: Noise | None = None
) -> tuple[SolverOutcome, ...]:
    """Solve A X = Z B by several methods.

    Raises
    ------
    InputError
        An unknown method, or too few pairs.
    NotIdentifiableError
        No method has an answer because the motions do not allow one.
    """
    if not methods:
        raise InputError("no method to solve A X = Z B by", name="methods")
    outcomes = []
    refused: NotIdentifiableError | None = None
    for method in methods:
        try:
            result = solve(pairs.A, pairs.B, method, noise)
            out = tuple(
                place for place, ok in zip(places_of(pairs), result.used, strict=True) if not ok
            )
            outcomes.append(SolverOutcome(method, result, left_out=out))
        except NotIdentifiableError as error:
            refused = error
            outcomes.append(SolverOutcome(method, None, error.message))
    if refused is not None and all(outcome.result is None for outcome in outcomes):
        raise refused
    return tuple(outcomes)


def certified(pairs: Pairs, outcomes: Sequence[SolverOutcome]) -> tuple[SolverOutcome, ...]:
    """Outcomes, those of maximum likelihood with a certificate, of the pairs that they used.

    Raises
    ------
    InputError
        No method of maximum likelihood is among them, or the noise is on both sides, or not the
        same in all directions: there is no certificate.
    """
    if not any(METHODS[outcome.method].likelihood for outcome in outcomes):
        raise InputError(
            "only a maximum of the likelihood can be proven to be one",
            hint="add the method ml",
            name="method",
        )
    found = []
    for outcome in outcomes:
        result = outcome.result
        likelihood = METHODS[outcome.method].likelihood
        if result is None or result.noise is None or not likelihood:
            found.append(outcome)
            continue
        if not isinstance(result.noise, PairNoise):
            raise InputError(
                "there is a certificate only for noise that is the same in all directions",
                hint="give the noise on a or on b",
                name="noise",
            )
        A, B = pairs.A[result.used], pairs.B[result.used]
        proof = certify(A, B, result.X, result.Z, result.noise)
        found.append(replace(outcome, certificate=proof))
    return tuple(found)


def warnings_of(outcomes: Iterable[SolverOutcome]) -> list[str]:
    """What the solvers warn of, each thing once, with the methods that say so."""
    said: list[tuple[str, str]] = []
    for outcome in outcomes:
        result = outcome.result
        texts = [] if outcome.ok else [outcome.said]
        texts += [] if result is None else [*result.warnings, *result.ambiguities]
        said += [(outcome.method, text) for text in texts]
    return _together(said)


def remarks_of(outcomes: Sequence[SolverOutcome]) -> list[str]:
    """What else the solvers say of their answers, each thing once, with the methods."""
    said = [(outcome.method, outcome.said) for outcome in outcomes if outcome.ok]
    said += [(o.method, f"did not use {', '.join(o.left_out)}") for o in outcomes if o.left_out]
    results = [outcome.result for outcome in outcomes if outcome.ok and outcome.result]
    said += [(o.method, o.certificate.message) for o in outcomes if o.certificate is not None]
    # of one method alone: it is a matter of the poses, and much the same for all
    known = [
        f"known least, by {result.method}: {text}"
        for result in results[:1]
        for text in result.weak_directions
    ]
    return [*_together(said), *known]


def _together(said: Iterable[tuple[str, str]]) -> list[str]:
    """Texts with the methods that say them."""
    methods: dict[str, list[str]] = {}
    for method, text in said:
        methods.setdefault(text, []).append(method)
    return [f"{', '.join(who)}: {text}" for text, who in methods.items()]


def places_of(pairs: Pairs) -> tuple[str, ...]:
    """Where the pairs stand in their file, or what they are called."""
    return pairs.places or pairs.names
