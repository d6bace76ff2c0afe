"""What is said of measurements besides numbers: odd rows, gaps, and whose arm it is."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.errors import ConvergenceError, NotIdentifiableError
from calib.identification import DISPLAY
from calib.model import simulate
from calib.model.parameters import LinkGeometry
from posedesign.files import json_text
from posedesign.files.csv_tables import a_few, summed_up
from posedesign.files.measurements import MeasurementTable, read_measurements, write_measurements
from posedesign.identification import identify_models, results_as_dict
from posedesign.identification.checks import missing_poses, without_repeats
from posedesign.identification.comparison import (
    BELIEVABLE,
    beyond_belief,
    is_believable,
)
from tests.marks import rest_in_full

pytestmark = pytest.mark.usefixtures("one_alternative")

OFFSETS = {"parameters": {"models": [["zero_offsets"]]}}


def table_of(tmp_path: Path, lab: Any, kinds: list[str], count: int, **more: Any) -> Any:
    """A table as it is read from a file."""
    measured = lab.measure(kinds, count, **more)
    path = write_measurements(tmp_path / "m.csv", measured.data, measured.kinds)
    return read_measurements(path, 6)


def again(table: MeasurementTable, rows: list[int]) -> MeasurementTable:
    """The table with some of its rows pasted in once more at its end."""
    every = [*range(table.data.count), *rows]
    more = table.some(np.array(every))
    return replace(more, lines=tuple(range(2, 2 + len(every))))


def test_pasted_rows_count_once(tmp_path, lab):
    table = table_of(tmp_path, lab, ["touch-up", "point"], 6)
    same, said = without_repeats(table)
    assert same is table
    assert said == []
    found, said = without_repeats(again(table, [3, 7]))
    assert found.data.names == table.data.names
    assert found.lines == table.lines
    assert said == [
        "rows that repeat another number by number are left out: line 14 as line 5, line 15 as "
        "line 9"
    ]
    found, said = without_repeats(again(table, list(range(12))))
    assert found.data.count == 12
    assert len(said) == 1
    assert said[0].endswith("line 18 as line 6 and 7 more rows")


@pytest.mark.parametrize("index", ["kind", "tool", "target", "payload"])
def test_rows_of_another_set_up_are_no_repeats(tmp_path, lab, index):
    table = table_of(tmp_path, lab, ["touch-up", "view-line"], 4, tools=("a", "b"), targets_each=2)
    double = again(table, [0])
    setup = double.data.setup
    other = getattr(setup, index).copy()
    other[-1] = 1 - other[0]
    changed = replace(double.data, setup=replace(setup, **{index: other}))
    assert without_repeats(replace(double, data=changed))[1] == []
    assert len(without_repeats(double)[1]) == 1


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ([], []),
        (["P01", "P02", "P03"], []),
        (["P02", "P01", "P02", "P04"], ["up to P04 there are no measurements of P03"]),
        (["P003", "P001"], ["up to P003 there are no measurements of P002"]),
        (["P01", "left", "P09"], []),  # names of their own say nothing of gaps
        (["P09"], ["of P01, P02, P03, P04, P05 and 3 more poses"]),
    ],
)
def test_gaps_in_a_plan(names, said):
    found = missing_poses(names)
    assert len(found) == len(said)
    assert all(text in line for text, line in zip(said, found, strict=True))


def test_long_lists_are_summed_up():
    lines = [str(k) for k in range(8)]
    assert summed_up(lines[:5], "rows") == lines[:5]
    assert summed_up(lines, "rows") == [*lines[:5], "and 3 more rows"]
    assert a_few(lines, "poses") == "0, 1, 2, 3, 4 and 3 more poses"
    assert a_few(lines[:1], "poses") == "0"


def measured_by(lab: Any, offset_deg: float, shift_m: float, tmp_path: Path) -> MeasurementTable:
    """Touch-ups of an arm whose first link is off, read for the arm as described."""
    robot = lab.cell.robot
    measured = lab.measure(["touch-up"], 40, blocks=[LinkGeometry(robot, ["link.joint_3.z"])])
    x = measured.x.copy()
    x[measured.truth.names.index("link.joint_3.z")] = shift_m
    x[measured.truth.names.index("zero_offset.joint_3")] = np.deg2rad(offset_deg)
    data = simulate(measured.truth, x, measured.data.postures, setup=measured.data.setup)
    path = write_measurements(tmp_path / "m.csv", data, ("touch-up",))
    return read_measurements(path, 6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("offset_deg", "shift_m", "model", "name"),
    [
        (0.1, 0.002, "geometry", None),
        (0.1, 0.2, "geometry", "link.joint_3.z"),
        (20.0, 0.0, "zero_offsets", "zero_offset.joint_3"),
        (3.0, 0.0, "zero_offsets", None),
    ],
)
def test_whose_arm_it_is(tmp_path, lab, make_cell, offset_deg, shift_m, model, name):
    """Freed links explain any other arm to the last digit: what they say of it has to be looked at.

    An arm of the same make with a link 0.2 m longer is another arm, 2 mm are an error of this one.
    """
    table = measured_by(lab, offset_deg, shift_m, tmp_path)
    cell = make_cell(parameters={"models": [[model]]})
    found = identify_models(cell, table)
    if shift_m == 0.2:
        assert found.recommended is None
        assert "these measurements are not of this robot" in found.reason
        return
    assert found.comparison.recommended in ("everything with priors", "offsets")
    assert found.best.rms_m < 2e-5
    assert beyond_belief(found.best) == name
    said = " ".join(each.said for each in found.contradictions)
    assert ("zero_offset.joint_3 is off by 20 deg, 20.0 times" in said) == (offset_deg == 20.0)
    assert found.is_of_this_robot == (name is None)
    content = results_as_dict(cell, found)
    if name is None:
        assert content["recommended"] == found.comparison.recommended
        return
    assert content["recommended"] is None
    assert f"{name} off by" in found.reason
    assert content["reason"] == found.reason


def test_every_unit_has_a_bound():
    of_readings = {"px", "1", "s"}  # of lenses, boards and clocks: no arm has them
    assert set(BELIEVABLE) == set(DISPLAY) - of_readings


@pytest.mark.slow
def test_residuals_of_decimetres_are_of_another_arm(tmp_path, lab, make_cell):
    table = table_of(tmp_path, lab, ["touch-up"], 40)
    rng = np.random.default_rng(3)
    q = table.data.postures + rng.normal(0.0, 0.1, table.data.postures.shape)
    found = identify_models(
        make_cell(**OFFSETS), replace(table, data=replace(table.data, postures=q))
    )
    assert found.comparison.results[0].rms_m > 0.05
    assert not any(is_believable(result) for result in found.comparison.results)
    assert not found.is_of_this_robot
    assert "not of this robot" in found.reason


def test_where_nothing_fits_the_hint_says_where_to_look(tmp_path, lab, make_cell):
    """One joint counts backwards: nothing converges, or nothing can be told."""
    table = table_of(tmp_path, lab, ["touch-up"], 12)
    q = table.data.postures.copy()
    q[:, 2] = -q[:, 2]
    q[:, 1] = 3.0 * q[:, 1] + 1.0
    data = replace(table.data, postures=q)
    with pytest.raises((ConvergenceError, NotIdentifiableError)) as caught:
        identify_models(make_cell(**OFFSETS), replace(table, data=data))
    assert "are these of this robot, this tool, in URDF joint signs?" in caught.value.hint


def test_what_is_shown_where_nothing_can_be_judged(tmp_path, lab, make_cell):
    """Four touch-ups: twelve equations, ten parameters, and no pose to spare."""
    table = table_of(tmp_path, lab, ["touch-up"], 4)
    cell = make_cell(parameters={"models": [["zero_offsets"]]})
    found = identify_models(cell, table)
    found = replace(found, comparison=replace(found.comparison, recommended=None))
    assert found.best.model == "offsets"
    assert any("only 2 equations are left over" in note for note in found.best.notes)
    assert found.is_of_this_robot
    content = json.loads(json_text(results_as_dict(cell, found)), parse_constant=pytest.fail)
    assert content["recommended"] is None
    assert content["models"][1]["leave_one_out_rms_mm"] is None
    assert content["models"][-1]["name"] == content["reference"] == "everything with priors"


@pytest.mark.slow
@pytest.mark.parametrize("loss", rest_in_full(["least-squares", "graduated"], ("least-squares",)))
def test_gross_errors_are_named(tmp_path, lab, make_cell, loss):
    """Least squares names them and the option; the option says what it left out."""
    table = table_of(tmp_path, lab, ["touch-up"], 40, noise=5e-6)
    q = table.data.postures.copy()
    wrong = [4, 11, 30]
    q[wrong] += np.deg2rad([[0.3, 0.4, -0.3, 0.5, 0.4, 0.0]] * 3) * [[1], [-0.9], [0.8]]
    bad = replace(table, data=replace(table.data, postures=q))
    names = [table.data.names[i] for i in wrong]
    cell = make_cell(parameters={"models": [["zero_offsets"]], "loss": loss})

    def notes(of: MeasurementTable) -> list[str]:
        every = identify_models(cell, of).comparison.results[-1].notes
        return [note for note in every if "far beyond" in note or "left out" in note]

    (note,) = notes(bad)
    if loss == "graduated":
        assert note == f"left out because they contradict the others: {', '.join(names)}"
    else:
        assert 'parameters.loss = "graduated" leaves them out' in note
        said = {n for n in table.data.names if f" {n}," in note or f" {n};" in note}
        assert set(names) >= said != set()
    assert notes(table) == []
