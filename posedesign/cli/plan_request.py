"""The words of ``plan`` and ``next``: how many poses, by what, how good."""

from __future__ import annotations

import math
import re

from calib.errors import InputError, near_names
from posedesign.planning.optimal.request import USUAL_POSES, Request
from posedesign.selection import METHODS

_LENGTH = re.compile(r"\s*([0-9.]+(?:e[+-]?[0-9]+)?)\s*(mm|um|µm|m)?\s*", re.IGNORECASE)

_IN_M = {"mm": 1e-3, "um": 1e-6, "µm": 1e-6, "m": 1.0}


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
        value = float(found[1]) if found else math.nan
    except ValueError:
        value = math.nan
    if found is None or not math.isfinite(value) or value <= 0.0:
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
    minutes: float | None = None,
) -> Request | None:
    """The request of a command line; None where the grid of the paper is what is asked for.

    Raises InputError: options that do not go together.
    """
    limit = target_accuracy is not None or sigma_mm is not None or sigma_deg is not None
    given = {
        "--poses": poses,
        "--minutes": minutes,
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
    method, every = None if method is None else method.strip().lower(), ["wpr", *METHODS]
    if method is not None and method not in every:
        raise InputError(
            f"there is no method {method[:40]!r}", hint=near_names(method, every), name="method"
        )
    if method == "wpr":
        if asked:
            raise InputError(
                f"{asked[0]} does not go with --method wpr, whose poses are those of the grid",
                hint="leave it out, or take --method exchange",
                name=asked[0],
            )
        return None
    alone = ["--criterion", "--target-accuracy", "--wanted-sigma-mm"]
    alone += ["--wanted-sigma-deg"] * (sigma_mm is None)
    wants = [name for name in alone if given[name] is not None]
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
    if minutes is not None and (poses is not None or limit or threshold is not None):
        other = next(
            name
            for name in ("--poses", "--target-accuracy", "--threshold", *alone)
            if given.get(name) is not None and name != "--criterion"
        )
        raise InputError(
            f"--minutes decides how many poses there are, and so does {other}",
            hint="leave one of the two out",
            name="--minutes",
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
        sigma_rad=None if sigma_deg is None else math.radians(sigma_deg),
        threshold=threshold,
        validation=validation,
        # the fewest poses reach what is wanted as they are, and robust ones are for other robots
        refine=count is not None and robust == "none" if refine is None else refine,
        robust=robust.strip().lower(),
        time_s=None if minutes is None else 60.0 * minutes,
    )
