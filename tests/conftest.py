"""Cells that tests plan for, and a hypothesis profile that gives the same run every time."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from posedesign.cell import Cell
from posedesign.config import parse_config
from posedesign.template import cell_template

settings.register_profile("repeatable", database=None, deadline=None, derandomize=True)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def reference_cell() -> Cell:
    """The reference cell, as ``posedesign new`` prints it."""
    return Cell.from_text(cell_template())


@pytest.fixture(scope="session")
def make_cell() -> Callable[..., Cell]:
    """The reference cell with keys of its sections replaced: ``make_cell(plan={...})``."""

    def make(**sections: dict[str, Any]) -> Cell:
        raw = tomllib.loads(cell_template())
        for name, keys in sections.items():
            raw[name] = {**raw.get(name, {}), **keys}
        return Cell.from_config(parse_config(raw, Path("cell.toml")), Path("cell.toml"))

    return make
