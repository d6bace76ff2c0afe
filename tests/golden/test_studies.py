"""Every study in a short form, against the figures that stand in its folder."""

import json
import re
import textwrap
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import f as f_distribution

from posedesign.study.library import find_study

STUDIES = Path(__file__).parents[2] / "studies"
NUMBER = re.compile(r"(?:\d+\.?\d*|\.\d+)(?:e\d+)?")
SHORT = 20
FULL = 200
CHANCE = 1e-4


@pytest.mark.slow
def test_one_cell_in_depth():
    study = find_study("14_one_cell_in_depth").load()
    found = study.key_figures(study.run(draws=SHORT))
    expected = json.loads((STUDIES / "14_one_cell_in_depth" / "expected.json").read_text())
    assert len(found) == len(expected)
    low, high = np.sqrt(f_distribution.ppf([CHANCE / 2, 1 - CHANCE / 2], SHORT - 1, FULL - 1))
    for short, full in zip(found, expected, strict=True):
        assert short["c_g"] == pytest.approx(full["c_g"], rel=1e-6)
        for name in ("scatter_deg", "scatter_unweighted_deg", "scatter_view_line_deg"):
            assert low < short[name] / full[name] < high, name
        # medians of 20 draws scatter by a few parts in ten at most
        for name in ("plate_before_mm", "plate_after_mm", "x_hirsh_mm", "x_hirsh_identified_mm"):
            assert short[name] == pytest.approx(full[name], rel=0.4), name


def test_every_study_has_its_parts():
    folders = [p for p in STUDIES.iterdir() if p.is_dir() and p.name[:2].isdigit()]
    assert folders
    for folder in folders:
        for part in ("README.md", "study.toml", "run.py", "expected.json"):
            assert (folder / part).is_file(), f"{folder.name} lacks {part}"
        assert folder.name in (STUDIES / "README.md").read_text()
        _, answer, *_ = (folder / "README.md").read_text(encoding="utf-8").split("\n")
        assert answer.startswith(("**Answer.** ", "**In short.** ")), "a page opens with its answer"
        assert len(textwrap.wrap(answer, 105)) <= 5


def test_claims_have_the_figures_of_their_studies():
    """Every number of a verdict stands in the README of the study that the line names."""
    text = (STUDIES / "README.md").read_text(encoding="utf-8")
    lines = [line.strip("| ").split(" | ") for line in text.splitlines() if "/README.md) |" in line]
    claims = [cells for cells in lines if len(cells) == 4]
    assert len(claims) > 15
    for _, _, figures, study in claims:
        folder = study[study.index("(") + 1 : study.index("/")]
        said = set(NUMBER.findall((STUDIES / folder / "README.md").read_text(encoding="utf-8")))
        missing = [number for number in NUMBER.findall(figures) if number not in said]
        assert not missing, f"{folder}: {figures}"


def test_claims_that_chance_has_a_part_in_carry_their_intervals():
    """A median of forty arms that are anywhere between -.82 and .96 is no figure without them."""
    text = (STUDIES / "README.md").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if "/README.md) |" in line]
    drawn = [line for line in lines if " % of " in line or "rank correlation 0." in line]
    assert len(drawn) > 6
    for line in drawn:
        assert re.search(r"[\d.]+ to [\d.]+", line), line


def test_the_table_of_the_accuracy_study_is_its_result():
    """The figures that people read are those that the run wrote, to their last digit."""
    folder = STUDIES / "14_one_cell_in_depth"
    by_angle = {row["d_deg"]: row for row in json.loads((folder / "expected.json").read_text())}
    columns = (
        "d_deg", "c_g", "scatter_deg", "error_deg", "error_rigid_deg", "plate_before_mm",
        "plate_after_mm", "plate_after_rigid_mm", "x_hirsh_mm", "x_hirsh_identified_mm",
    )  # fmt: skip
    table = [
        line.strip("| ").split(" | ")
        for line in (folder / "README.md").read_text().splitlines()
        if line.startswith("| ") and line[2].isdigit()
    ]
    assert len(table) >= 6
    for cells in table:
        row = by_angle[float(cells[0])]
        for name, cell in zip(columns, cells, strict=True):
            digits = len(cell.partition("e")[0].partition(".")[2])
            scale = 10.0 ** int(cell.partition("e")[2] or 0)
            assert abs(float(cell) - row[name]) <= 0.5001 * scale * 10.0**-digits, (name, cells)
