"""A proof and rechecks of a real arm: an IRB 120 by configurations that were kept back.

Two thirds of the 36 configurations are identified from. The others prove the accuracy, and are
rechecks of an arm that has not changed since, or whose recorded joints are off by a known angle.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from posedesign.acceptance.file import RULE, AcceptanceFile
from posedesign.cell import Cell
from posedesign.workflow import identify_file, judge_acceptance_test, recheck_file

pytestmark = pytest.mark.real_data

STUDY = Path(__file__).parents[2] / "studies" / "03_irb120_measuring_arm"


@dataclass(frozen=True)
class KeptBack:
    """A cell, what was identified, and a table of what was kept back: its header and its rows."""

    cell: Cell
    identification: Path
    header: str
    rows: tuple[str, ...]

    def table(self, path: Path, rows: tuple[str, ...], joint_3_deg: float = 0.0) -> Path:
        """A table of some rows, with the third joint shown off by an angle."""
        column = self.header.split(",").index("j3_deg")
        shown = []
        for row in rows:
            cells = row.split(",")
            cells[column] = repr(float(cells[column]) + joint_3_deg)
            shown.append(",".join(cells))
        path.write_text("\n".join([self.header, *shown, ""]))
        return path

    def of(self, configurations: slice) -> tuple[str, ...]:
        """Rows of some of the configurations."""
        names = list(dict.fromkeys(row.split(",")[0] for row in self.rows))[configurations]
        return tuple(row for row in self.rows if row.split(",")[0] in names)


@pytest.fixture(scope="module")
def kept(load_study, data_folder, tmp_path_factory) -> KeptBack:
    if not (data_folder / "identification" / "abb_irb120").is_dir():
        pytest.skip("no recordings of the IRB 120")
    folder = tmp_path_factory.mktemp("proven")
    cell_file, measured = load_study(STUDY).write_tables(data_folder, folder)
    cell, lines = Cell.load(cell_file), measured.read_text(encoding="utf-8").splitlines()
    header = next(line for line in lines if line.startswith("pose,"))
    rows = [line for line in lines if line.startswith("C")]
    back = set(np.random.default_rng(0).permutation(36)[::3].tolist())
    own = {k: [x for x in rows if (int(x[1:3]) - 1 in back) == k] for k in (True, False)}
    fitted = folder / "fitted"
    fitted.mkdir()
    (fitted / "measurements.csv").write_text("\n".join([header, *own[False], ""]))
    identify_file(cell, fitted / "measurements.csv", fitted)
    return KeptBack(cell, fitted / "identification.json", header, tuple(own[True]))


def proven(kept: KeptBack, folder: Path, limit_mm: float) -> AcceptanceFile:
    """The verdict of a test by all that was kept back."""
    table = kept.table(folder / "measurements.csv", kept.rows)
    rule = {
        "test": "places",
        "limit_mm": limit_mm,
        "content": 0.75,
        "confidence": 0.95,
        "allowed": 0,
        "cycles": 1,
        "poses": sorted({row.split(",")[0] for row in kept.rows}),
        "statement": "at least 75 % of the places are within the limit",
        "where": "configurations that were kept back",
    }
    (folder / RULE).write_text(json.dumps(rule))
    return judge_acceptance_test(kept.cell, table, folder, kept.identification)


def test_the_identified_arm_is_better_by_far_where_it_was_not_identified(kept, tmp_path):
    found = proven(kept, tmp_path, limit_mm=0.4)
    before, after = found.arms
    assert found.passed
    assert not before.passed
    assert before.rms_mm[0] > 20 * after.rms_mm[0]
    assert after.rms_mm[0] < 0.25
    assert not found.notes  # no row, and no posture, that was identified from


def test_four_configurations_tell_the_arm_from_one_whose_joint_is_off(kept, tmp_path):
    """Sums of squares are of chi-square: 108 in all, with a deviation of 14.7."""
    outcomes = []
    for first in (0, 4, 8):
        rows = kept.of(slice(first, first + 4))
        table = kept.table(tmp_path / "same.csv", rows)
        outcomes.append(recheck_file(kept.cell, table, kept.identification, tmp_path))
        off = kept.table(tmp_path / "off.csv", rows, joint_3_deg=0.2)
        hit = recheck_file(kept.cell, off, kept.identification, tmp_path)
        assert not hit.same
        best = hit.explanations[0]
        assert best.cause == f"zero of {kept.cell.robot.joint_names[2]}"
        # the pendant shows more than before by as much as the zero has moved back
        assert np.rad2deg(best.change[0]) == pytest.approx(-0.2, abs=0.04)
    assert [each.same for each in outcomes] == [True] * 3
    assert {each.freedom for each in outcomes} == {36}
    assert sum(each.square for each in outcomes) == pytest.approx(3 * 36, abs=3 * 14.7)
