"""What is said of findings, and where it is said."""

import json
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from calib.errors import NotIdentifiableError
from calib.identification.held import Cause, Finding
from posedesign.files import json_text
from posedesign.files.measurements import MeasurementTable, read_measurements, write_measurements
from posedesign.identification import identify_models, results_as_dict
from posedesign.identification.findings import as_dict, in_words
from posedesign.report.identification import answer_of_identification

pytestmark = pytest.mark.usefixtures("one_alternative")

THINGS: dict[str, tuple[str, ...]] = {
    "harmonic": ("joint_2", "1"),
    "zero": ("joint_2", "+90"),
    "sign and zero": ("joint_2", "180"),
    "coupling": ("joint_3", "joint_2", "less"),
    "coupled joints": ("joint_3", "joint_2"),
    "mistyped joint": ("joint_4",),
    "joint scale": ("joint_4",),
    "swapped joints": ("joint_3", "joint_2"),
    "swapped axes": ("x", "y"),
    "shifted rows": ("later",),
    "shifted labels": ("earlier",),
    "wrong label": ("A1",),
}
JOINTS = ("harmonic", "sign", "zero", "sign and zero", "coupling", "swapped joints")


@pytest.fixture(scope="module")
def table(lab, tmp_path_factory) -> MeasurementTable:
    """Touch-ups of three targets, as read from a file."""
    measured = lab.measure(["touch-up"], 27, targets_each=3, noise=2e-5)
    path = tmp_path_factory.mktemp("said") / "m.csv"
    return read_measurements(write_measurements(path, measured.data, measured.kinds), 6)


@pytest.mark.parametrize("cause", get_args(Cause))
def test_every_cause_has_words(table, cause):
    part = "joint" if cause in (*JOINTS, "all signs", "joint unit") else "target"
    finding = Finding(cause, THINGS.get(cause, ("A0",)), part, (3, 7), 1e-3, "m", 0.03, 1e-4, 40.0)
    said = in_words(finding, table)
    assert "residual 0.1 in place of 30 mm; " in said
    assert "\n" not in said
    content = json.loads(json_text(as_dict(finding, table)))
    assert content["text"] == said
    assert content["poses"] == ["M4", "M8"]
    assert content["size"] == pytest.approx(1.0)
    assert content["lines"] == [5, 9]


def test_what_an_arm_could_be_bent_to_is_said_by_its_odds(table):
    finding = Finding("scale", ("point",), "instrument", (), 0.01, "", 3e-5, 3e-5, 46.0)
    assert "point seem to be 1 % too long: errors of the arm that explain it as well are 1e20 " in (
        in_words(finding, table)
    )


@pytest.mark.parametrize(("size", "gross"), [(0.01, True), (-0.003, True), (0.0005, False)])
def test_a_scale_that_no_arm_is_off_by(size, gross):
    """A tracker that is 1 % long has links identified that are 1 % long; warm arms grow by less."""
    finding = Finding("scale", ("point",), "instrument", (), size, "", 3e-5, 3e-5, 46.0)
    assert finding.is_gross == gross
    assert not replace(finding, cause="step", size=5e-3).is_gross
    assert replace(finding, cause="sign", size=np.nan).is_gross


@pytest.mark.slow
def test_another_arm_is_said_to_be_one(table, make_cell, capsys):
    """Also where a gap of the model is named: that is no reason why it is another arm."""
    cell = make_cell(parameters={"models": [["zero_offsets"]]})
    q = table.data.postures + np.random.default_rng(3).normal(0.0, 0.05, (27, 6))
    found = identify_models(cell, replace(table, data=replace(table.data, postures=q)))
    gap = Finding("harmonic", ("joint_2", "1"), "joint", (), 1e-3, "rad", 0.1, 0.05, 20.0)
    for findings in ((), (gap,)):
        answer = answer_of_identification(replace(found, findings=findings))
        assert "not of this robot" in " ".join(answer.warnings)


def test_causes_that_fit_as_well_are_named_with_it(table):
    other = Finding("zero", ("joint_2", "180"), "joint", (), np.nan, "", 0.03, 1e-4, 40.0)
    finding = replace(other, cause="sign", things=("joint_1",), also=(other,))
    said = in_words(finding, table)
    assert said.startswith(
        "as if joint_1 were counted the other way (or as if the zero of joint_2 were 180 deg off):"
    )


def test_a_joint_counted_the_other_way(table, make_cell, capsys):
    """It is said first, it is the reason why no model is recommended, and it is in the file."""
    cell = make_cell(parameters={"models": [["zero_offsets"]]})
    q = table.data.postures.copy()
    q[:, 2] *= -1.0
    found = identify_models(cell, replace(table, data=replace(table.data, postures=q)))
    assert [finding.cause for finding in found.findings] == ["sign"]
    assert not found.is_of_this_robot
    content = results_as_dict(cell, found)
    assert content["recommended"] is None
    assert content["reason"] == found.reason == content["findings"][0]["text"]
    (warning,) = answer_of_identification(found).warnings
    assert warning.startswith("as if joint_3 were counted the other way: residual")


def test_steady_measurements_say_nothing(table, make_cell):
    found = identify_models(make_cell(parameters={"models": [["zero_offsets"]]}), table)
    assert found.findings == ()
    assert found.is_of_this_robot


@pytest.mark.slow
def test_a_refusal_is_hinted_at_by_name(table, make_cell):
    """Where the cell asks for what cannot be told, the mistake comes first."""
    asked = {"models": [["zero_offsets"]], "zero_offsets": ["joint_1", "joint_2", "joint_3"]}
    cell, data = make_cell(parameters=asked), table.data
    target = data.setup.target.copy()
    target[3] = 2 - target[3]
    for labels, hint in ((data.setup.target, False), (target, True)):
        mixed = replace(data, setup=replace(data.setup, target=labels))
        with pytest.raises(NotIdentifiableError) as caught:
            identify_models(cell, replace(table, data=mixed))
        assert ("as if M4 (line 5) were of the target" in caught.value.hint) == hint


@pytest.mark.parametrize(("sigmas", "grade"), [(0.5, "note"), (2.0, "warning"), (4.0, "distrust")])
def test_a_finding_is_as_loud_as_its_effect(table, make_cell, sigmas, grade):
    """Only one that changes the answer by much withholds it, however likely it is."""
    found = identify_models(make_cell(parameters={"models": [["zero_offsets"]]}), table)
    step = Finding("step", ("A0",), "target", (9,), 1e-3, "m", 3e-4, 3e-5, 40.0)
    step = replace(step, change_m=5e-5, sigmas=sigmas)
    found = replace(found, findings=(step,))
    answer = answer_of_identification(found)
    said = next(text for text in (*answer.warnings, *answer.notes) if "moved by 1 mm" in text)
    assert f"changes the errors of the arm by 0.05 mm ({sigmas:.1f} sigma)" in said
    assert (said in answer.notes) == (grade == "note")
    assert (found.recommended is None) == (grade == "distrust") == (not found.is_trusted)
    assert found.is_of_this_robot
    if grade == "distrust":
        assert found.reason == said
        assert answer.verdict.startswith("no model: what was found changes the answer")
    assert results_as_dict(make_cell(), found)["findings"][0]["grade"].startswith(grade[:4]) == (
        grade != "distrust"
    )


def test_a_load_that_nobody_described_has_words(table):
    load = Finding("step", ("payload",), "payload", (9,), 2e-3, "m", 3e-4, 3e-5, 40.0)
    assert in_words(load, table).startswith(
        "from M10 (line 11) on the flange seems to carry a load that is not described, which bends "
    )
