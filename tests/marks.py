"""Marks of parameters."""

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def rest_in_full(values: Iterable[Any], often: Collection[Any]) -> list[Any]:
    """Parameters of a slow test: those named here always, the others when all there is is run."""
    return [v if v in often else pytest.param(v, marks=pytest.mark.full) for v in values]


def by_stage(always: Any, slow: Any, full: Any) -> list[Any]:
    """Parameters of a test that says more of more trials: one for each stage."""
    marks = pytest.mark.slow, pytest.mark.full
    return [always, pytest.param(slow, marks=marks[0]), pytest.param(full, marks=marks)]


def rest_in_slow(values: Iterable[Any], often: Collection[Any]) -> list[Any]:
    """Parameters of a test: those named here always, the others when slow tests are asked for."""
    return [v if v in often else pytest.param(v, marks=pytest.mark.slow) for v in values]
