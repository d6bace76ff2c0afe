"""The numbers that files and options may hold: one bound for all of them."""

from __future__ import annotations

import json
import math
from typing import Any

LARGEST_NUMBER = 1e12
"""Of all files and options, in mm, degrees or whatever their unit is: nothing that can be measured
is larger, and what is computed of such numbers stays far within what a float holds."""

LEAST_POSITIVE = 1e-12
"""Of numbers that have to be above zero: what is divided by them stays finite as well."""

_LARGEST_IN_JSON = 1e300
"""Results such as chi2 and condition numbers may be larger than what is measured."""


_MOST_DIGITS = 19
"""Of a whole number: seeds have as many, and more are none of pixels, moves or poses."""


def usable(value: object) -> float:
    """A number of a file or an option as a float; NaN where it is none, or beyond the bound."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return math.nan
    return float(value) if abs(value) <= LARGEST_NUMBER else math.nan


def load_json(data: bytes | str) -> Any:
    """The content of a JSON text.

    Raises
    ------
    ValueError
        It is no JSON in UTF-8, is nested too deep, or holds a number that no result has.
    """
    try:
        text = data if isinstance(data, str) else data.decode("utf-8-sig")
        return json.loads(text, parse_int=_whole, parse_float=_decimal, parse_constant=_decimal)
    except RecursionError as error:
        raise ValueError("nested too deep") from error


def _decimal(text: str) -> float:
    value = float(text)
    if not abs(value) <= _LARGEST_IN_JSON:  # nor NaN
        raise ValueError(f"{text[:40]} is not a finite number within {_LARGEST_IN_JSON:g}")
    return value


def _whole(text: str) -> int:
    if len(text) > _MOST_DIGITS:
        raise ValueError(f"{text[:40]} is not a finite number within 2^63")
    return int(text)
