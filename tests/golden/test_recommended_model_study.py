"""Is the recommended model the one to take: a short form, and what its figures stand on."""

import json
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from calib.se3 import rotation_exp
from posedesign.identification.models import Models
from posedesign.study import Options
from posedesign.study.library import find_study
from studies.intervals import wilson
from studies.simulated_arms import aligned_rms_m

STUDY = find_study("recommended_model")
EXPECTED: dict[str, Any] = json.loads((STUDY.folder / "expected.json").read_text(encoding="utf-8"))
TRIALS = 3


@pytest.fixture(scope="module")
def run() -> ModuleType:
    return STUDY.load()


@pytest.fixture(scope="module")
def arms(run) -> ModuleType:
    return import_module("studies.16_recommended_model.recommended_arms")


@pytest.fixture(scope="module")
def trials(run) -> ModuleType:
    return import_module("studies.16_recommended_model.recommended_trials")


def test_the_interval_of_wilson_is_the_published_one():
    """Eight of ten: .490 to .943 (Newcombe 1998 gives the formula; none of ten ends at .278)."""
    eight = wilson(np.arange(10) < 8)
    assert (eight["low"], eight["high"]) == pytest.approx((0.4902, 0.9433), abs=1e-4)
    none = wilson(np.zeros(10, dtype=bool))
    assert (none["low"], none["high"]) == pytest.approx((0.0, 0.2775), abs=1e-4)


def test_a_base_that_stands_elsewhere_is_no_error_and_a_scale_is():
    rng = np.random.default_rng(1)
    points = rng.standard_normal((200, 3))
    moved = points @ rotation_exp(np.array([0.3, -0.2, 0.5])).T + [1.0, -2.0, 0.5]
    assert aligned_rms_m(moved, points) < 1e-12
    middle = points - points.mean(axis=0)
    size = np.sqrt(np.mean(np.sum(middle**2, axis=1)))
    assert aligned_rms_m(1.01 * moved, points) == pytest.approx(0.01 * size, rel=1e-9)


def test_an_arm_is_the_same_however_it_is_measured(arms):
    drawn = [arms.bench_of("irb120", way).arm(1) for way in ("camera", "tracker")]
    first, second = (dict(zip(one.model.names, one.values, strict=True)) for one in drawn)
    own = [n for n in first if n.startswith(("zero_offset", "link", "compliance"))]
    assert len(own) == 6 + 30 + 6
    assert [first[n] for n in own] == [second[n] for n in own]


def test_qr_keeps_what_the_measurements_tell(arms, trials):
    """As many columns as the matrix has singular values above noise."""
    bench = arms.bench_of("irb120", "tracker")
    arm = bench.arm(0)
    table, q, how = bench.measured(arm, 0)
    whole = trials.all_links(Models(bench.cell, table).candidates()[0].model)
    few = trials.reduced_by_qr(whole, table.data, q, 1e-6)
    J = whole.linearise(q, whole.nominal, how, table.data.observed).white_jacobian
    J = J.reshape(-1, whole.p)
    assert few.p == np.linalg.matrix_rank(J / np.linalg.norm(J, axis=0), tol=1e-8)


def test_each_model_is_held_against_the_arm_as_it_is(arms, trials, monkeypatch):
    """An arm that is off in its zeros alone, measured without noise: offsets leave nothing."""
    bench = arms.bench_of("irb120", "tracker")
    drawn = bench.arm(2)  # neither compliant nor wavy
    kinds = [kind.with_noise(1e-6) for kind in drawn.model.measurements]
    model = drawn.model.with_measurements(kinds)
    arm = arms.Arm(model, drawn.without("link"), False, False, 1e-6)
    monkeypatch.setattr(bench, "arm", lambda trial: arm)
    rows = {row["model"]: row for row in trials.trial_of("irb120", "tracker", 2)}
    assert rows["frames only"]["error_mm"] > 0.05
    for name in ("offsets", "geometry", "QR, least squares", "all sizes known"):
        assert rows[name]["error_mm"] < 1e-4, name
    taken = next(row for row in rows.values() if row["recommended"])
    assert taken["model"] == "offsets"
    assert taken["parameters"] == 4


@pytest.mark.slow
def test_a_short_form_has_the_structure_of_the_full_one(run, tmp_path, monkeypatch):
    """One preset in one way; what was done before a stop is not done again."""
    monkeypatch.setattr(run, "conditions", lambda: [{"preset": "irb120", "way": "tracker"}])
    said: list[float] = []
    found = STUDY.run(Options(tmp_path, TRIALS, advance=lambda what, part: said.append(part)))
    assert said == [0.0, 0.5, 1.0]
    assert set(found) == set(EXPECTED)
    assert [set(row) for row in found["rows"]] == [set(EXPECTED["rows"][0])] * 2
    assert found["rows"][0]["arms"] == TRIALS
    assert sum(found["taken"]["tracker"].values()) == TRIALS
    drawn = STUDY.plot(tmp_path)
    assert {path.suffix for path in drawn} == {".png", ".svg"}
    monkeypatch.setattr(run, "simulate", None)
    assert STUDY.run(Options(tmp_path, TRIALS)) == found


def test_what_is_recommended_harms_no_arm_and_is_near_the_best():
    """Of the full run; the shares that are bars may be what their intervals reach."""
    ways = {row["way"]: row for row in EXPECTED["rows"] if row["preset"] == "all"}
    assert list(ways) == ["touch-up", "camera", "tracker"]
    for row in ways.values():
        assert (row["refused"], row["harms"], row["harms_beyond"]) == (0, 0, 0)
        assert row["blames_low"] <= 0.01  # at odds of a thousand to one
        assert row["compliance_of_rigid"] <= 0.05 * row["compliance_of_rigid_of"]
        for kind in ("covered_smooth", "covered_wavy"):
            assert row[kind] >= 0.9 * row[f"{kind}_of"], (row["way"], kind)
        assert row["recommended_mm"] <= 1.1 * row["best_mm"]
        # whoever knew the sizes knew the noise, too, which no cell gives for a tracker
        known = 1.25 if row["way"] == "tracker" else 1.2
        assert row["recommended_mm"] <= known * row["known_mm"]
    assert sum(row["worse_than_offsets"] for row in ways.values()) <= 3
    assert ways["touch-up"]["near_high"] >= 0.9


def test_its_readme_says_how_many_arms():
    text = (STUDY.folder / "README.md").read_text(encoding="utf-8")
    assert f"{EXPECTED['trials']} arms of each preset" in text
