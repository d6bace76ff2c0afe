"""What a user asks of a choice of poses."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from calib.errors import InputError, near_names
from posedesign.files import LARGEST_NUMBER, LEAST_POSITIVE, usable
from posedesign.selection import METHODS

MOST_POSES = 1000
"""More than a thousand touch-ups is a slip of the keyboard."""

USUAL_POSES = 27
"""As many as the grid of Watanabe et al. 2006 has."""

ROBUST = ("none", "average", "worst")

_LENGTH = re.compile(r"\s*([0-9.]+(?:e[+-]?[0-9]+)?)\s*(mm|um|µm|m)?\s*", re.IGNORECASE)
_IN_M = {"mm": 1e-3, "um": 1e-6, "µm": 1e-6, "m": 1.0}


@dataclass(frozen=True)
class Request:
    """What is wanted.

    ``method``: of :data:`posedesign.selection.METHODS`. ``count``: poses; None: the fewest that
    reach what is wanted. ``criterion``: of :data:`posedesign.planning.optimal.objective.GOALS`, or
    ``sigma:NAME`` for one parameter. ``accuracy_m``: largest root mean square error of the tool
    point over the task box [m]. ``sigma_m``, ``sigma_rad``: largest standard deviation of each
    parameter that is a length, and of each that is an angle. ``threshold``: value of the criterion
    to be reached. ``validation``: poses to choose besides, for a test. ``refine``: turn the tool at
    the chosen poses, off the pool, for as long as that helps. ``robust``: ``"none"``: choose for
    the robot as described; ``"average"``, ``"worst"``: for what is known of it before measuring.
    """

    method: str = "exchange"
    count: int | None = USUAL_POSES
    criterion: str = "tcp"
    accuracy_m: float | None = None
    sigma_m: float | None = None
    sigma_rad: float | None = None
    threshold: float | None = None
    validation: int = 0
    refine: bool = False
    robust: str = "none"

    def __post_init__(self) -> None:
        for name, value in (
            ("the target accuracy", self.accuracy_m),
            ("a wanted standard deviation", self.sigma_m),
            ("a wanted standard deviation", self.sigma_rad),
            ("the threshold", self.threshold),
        ):
            if value is not None and not usable(value) >= LEAST_POSITIVE:
                raise InputError(
                    f"{name} is not above zero and finite",
                    hint=f"give a number from {LEAST_POSITIVE:g} to {LARGEST_NUMBER:g}",
                    name="wanted",
                    value=value,
                    bound=(LEAST_POSITIVE, LARGEST_NUMBER),
                )
        if self.count is not None and not 1 <= self.count <= MOST_POSES:
            raise InputError(
                f"{self.count} poses", hint=f"ask for 1 to {MOST_POSES}, or auto", name="poses"
            )
        if not 0 <= self.validation <= MOST_POSES:
            raise InputError(
                f"{self.validation} poses for validation",
                hint=f"ask for 0 to {MOST_POSES}",
                name="validation",
            )
        if self.robust not in ROBUST:
            raise InputError(
                f"there is no robustness {self.robust[:40]!r}",
                hint="one of " + ", ".join(ROBUST),
                name="robust",
            )
        if self.count is None and not self.has_limit:
            raise InputError(
                "auto takes the fewest poses that reach an accuracy, and none is given",
                hint="give --target-accuracy 0.2mm, --wanted-sigma-mm or --threshold, or a number "
                "of poses",
                name="poses",
            )

    @property
    def has_limit(self) -> bool:
        """Whether some value is to be reached."""
        return self.accuracy_m is not None or self.threshold is not None or self.wants_sigma

    @property
    def wants_sigma(self) -> bool:
        """Whether standard deviations of all parameters are what is wanted."""
        return self.sigma_m is not None or self.sigma_rad is not None


def parse_count(text: str) -> int | None:
    """A number of poses, or None for ``auto``."""
    word = text.strip().lower()
    if word == "auto":
        return None
    if not (word.isascii() and word.isdigit() and len(word) < 8):
        raise InputError(
            f"{text[:40]!r} is no number of poses", hint="give a number, or auto", name="poses"
        )
    return int(word)


def parse_length(text: str) -> float:
    """A length [m] of text such as ``0.2mm``, ``50um``; millimetres where no unit is given."""
    found = _LENGTH.fullmatch(text[:80])
    try:
        value = float(found[1]) if found else np.nan
    except ValueError:
        value = np.nan
    if found is None or not np.isfinite(value) or value <= 0.0:
        raise InputError(
            f"{text[:40]!r} is no accuracy", hint="give a length above zero, such as 0.2mm"
        )
    return value * _IN_M[(found[2] or "mm").lower()]


def request_of_words(
    method: str | None,
    poses: str | None,
    criterion: str | None,
    target_accuracy: str | None,
    threshold: float | None,
    sigma_mm: float | None,
    sigma_deg: float | None,
    validation: int,
    refine: bool | None,
    robust: str = "none",
    *,
    keep: bool = False,
) -> Request | None:
    """The request of a command line; None where the grid of the paper is what is asked for.

    Raises InputError: options that do not go together.
    """
    limit = target_accuracy is not None or sigma_mm is not None or sigma_deg is not None
    given = {
        "--poses": poses,
        "--criterion": criterion,
        "--target-accuracy": target_accuracy,
        "--threshold": threshold,
        "--wanted-sigma-mm": sigma_mm,
        "--wanted-sigma-deg": sigma_deg,
        "--validation": validation or None,
        "--refine": refine,
        "--robust": None if robust == "none" else robust,
        "--keep": keep or None,
    }
    asked = [name for name, value in given.items() if value is not None]
    if method is None and not asked:
        return None
    method = None if method is None else method.strip().lower()
    _check_method(method)
    if method == "wpr":
        if asked:
            raise InputError(
                f"{asked[0]} does not go with --method wpr, whose poses are those of the grid",
                hint="leave it out, or take --method exchange",
                name=asked[0],
            )
        return None
    wants = [
        name
        for name, value in (
            ("--criterion", criterion),
            ("--target-accuracy", target_accuracy),
            ("--wanted-sigma-mm", sigma_mm),
            ("--wanted-sigma-deg", sigma_deg if sigma_mm is None else None),
        )
        if value is not None
    ]
    if len(wants) > 1:
        raise InputError(
            f"{wants[0]} and {wants[1]} are two things to choose by", hint="give one", name="plan"
        )
    if threshold is not None and limit:
        raise InputError(
            f"--threshold is a value of --criterion, and {wants[0]} is one of its own",
            hint="leave one of the two out",
            name="--threshold",
        )
    count = USUAL_POSES if not (limit or threshold is not None) else None
    if poses is not None:
        count = parse_count(poses)
    return Request(
        method="exchange" if method is None else method,
        count=count,
        criterion=criterion or "tcp",
        accuracy_m=None if target_accuracy is None else parse_length(target_accuracy),
        sigma_m=None if sigma_mm is None else sigma_mm / 1e3,
        sigma_rad=None if sigma_deg is None else float(np.deg2rad(sigma_deg)),
        threshold=threshold,
        validation=validation,
        # the fewest poses reach what is wanted as they are, and robust ones are for other robots
        refine=count is not None and robust == "none" if refine is None else refine,
        robust=robust.strip().lower(),
    )


def _check_method(method: str | None) -> None:
    every = ["wpr", *METHODS]
    if method is not None and method not in every:
        raise InputError(
            f"there is no method {method[:40]!r}", hint=near_names(method, every), name="method"
        )
