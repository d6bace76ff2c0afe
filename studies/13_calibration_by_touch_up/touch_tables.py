"""Tables and verdicts as people read them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

DIGITS = 5
"""Significant digits of what is written: more than the sampling leaves."""


def rounded(value: Any) -> Any:
    """Numbers with :data:`DIGITS` digits, in whatever holds them."""
    if isinstance(value, dict):
        return {k: rounded(v) for k, v in value.items()}
    if isinstance(value, list):
        return [rounded(v) for v in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def verdicts(said: Mapping[str, Any]) -> list[str]:
    return []
