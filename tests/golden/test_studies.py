"""Every study in a short form, against the figures that stand in its folder."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.stats import f as f_distribution

STUDIES = Path(__file__).parents[2] / "studies"
SHORT = 20
FULL = 200
CHANCE = 1e-4


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"study_{name}", STUDIES / name / "run.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_accuracy_vs_condition() -> None:
    study = load("01_accuracy_vs_condition")
    found = study.key_figures(study.run(draws=SHORT))
    expected = json.loads((STUDIES / "01_accuracy_vs_condition" / "expected.json").read_text())
    assert len(found) == len(expected)
    low, high = np.sqrt(f_distribution.ppf([CHANCE / 2, 1 - CHANCE / 2], SHORT - 1, FULL - 1))
    for short, full in zip(found, expected, strict=True):
        assert short["c_g"] == pytest.approx(full["c_g"], rel=1e-6)
        for name in ("scatter_deg", "scatter_unweighted_deg", "scatter_view_line_deg"):
            assert low < short[name] / full[name] < high, name
        # medians of 20 draws scatter by a few parts in ten at most
        for name in ("plate_before_mm", "plate_after_mm", "x_hirsh_mm", "x_hirsh_identified_mm"):
            assert short[name] == pytest.approx(full[name], rel=0.4), name


def test_every_study_has_its_parts() -> None:
    folders = [p for p in STUDIES.iterdir() if p.is_dir() and p.name[:2].isdigit()]
    assert folders
    for folder in folders:
        for part in ("README.md", "study.toml", "run.py", "expected.json"):
            assert (folder / part).is_file(), f"{folder.name} lacks {part}"
        assert folder.name in (STUDIES / "README.md").read_text()
