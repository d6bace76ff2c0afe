"""Is what a plan promises what is found: a short form, and what its figures stand on."""

import json
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd
import pytest

from posedesign.study import Options
from posedesign.study.library import find_study
from studies.simulated_arms import across_axes

STUDY = find_study("promised_and_found")
EXPECTED: dict[str, Any] = json.loads((STUDY.folder / "expected.json").read_text(encoding="utf-8"))
TEXT = (STUDY.folder / "README.md").read_text(encoding="utf-8")
TRIALS = 3


@pytest.fixture(scope="module")
def run() -> ModuleType:
    return STUDY.load()


@pytest.fixture(scope="module")
def arms(run) -> ModuleType:
    return import_module("studies.18_promised_and_found.promised_arms")


@pytest.fixture(scope="module")
def table(run) -> ModuleType:
    return import_module("studies.18_promised_and_found.promised_table")


@pytest.fixture(scope="module")
def trials(run) -> ModuleType:
    return import_module("studies.18_promised_and_found.promised_trials")


def row_of(preset: str, population: str, plan: str) -> dict[str, Any]:
    wanted = {"preset": preset, "population": population, "plan": plan}
    return next(row for row in EXPECTED["rows"] if wanted.items() <= row.items())


def test_an_arm_has_the_errors_of_its_population_and_no_others(arms):
    bench = arms.bench_of("irb120")
    built, offsets = bench.arm("as built", 1), bench.arm("offsets", 1)
    words = {name.partition(".")[0] for name in built.model.names}
    assert words == {"zero_offset", "link", "compliance", "tool", "target"}
    assert {name.partition(".")[0] for name in offsets.model.names} == {
        "zero_offset",
        "tool",
        "target",
    }
    assert len(across_axes(bench.cell.robot)) == 30
    # what is drawn has the sizes of the settings: 200 arms of 6 offsets
    drawn = [bench.arm("offsets", trial).values[:6] for trial in range(200)]
    assert np.rad2deg(np.std(drawn)) == pytest.approx(0.1, rel=0.1)  # 1200 draws: 2 %
    known = bench.known("offsets").model
    assert known.prior[:6] == pytest.approx(np.deg2rad(0.1))
    assert np.isinf(known.prior[6:]).all()


def test_usual_arms_are_those_of_the_promise(arms):
    """Their mean squares are the priors of the reference, kind by kind; some are never negative."""
    bench = arms.bench_of("irb120")
    reference = bench.known("usual")
    drawn = np.array([bench.arm("usual", trial).values for trial in range(400)])
    for columns, size in reference.kinds:
        shares = drawn[:, columns] / reference.model.prior[columns]
        # the logarithm is of one normal draw an arm, so its spread tells of the sizes
        sizes = np.log(np.sqrt(np.mean(shares**2, axis=1)))
        assert np.mean(sizes) + size.log_sd**2 == pytest.approx(0.0, abs=0.3)
        assert np.std(sizes) >= 0.9 * size.log_sd
    words = np.array([name.partition(".")[0] for name in reference.model.names])
    assert (drawn[:, np.isin(words, arms.POSITIVE)] >= 0).all()
    assert bench.arm("usual", 0).deviation_rad == reference.deviation_rad > 0


def test_arms_that_could_have_no_errors_are_left_out(run):
    every = [(one["preset"], one["population"]) for one in run.populations()]
    assert ("kr6r900sixx", "compliance") not in every  # its masses are not known
    assert ("kr6r900sixx", "uneven") in every
    arms = [one["arms"] for one in run.conditions(run.populations(), 25)]
    # 25 arms of each preset that are as built, uneven and usual, 20 of each other kind
    assert sum(arms) == 4 * 3 * 25 + (4 + 4 + 3 + 3) * 20
    assert max(arms) == 10


def test_the_table_counts_what_it_is_given(table):
    """Errors twice those of the grid on one preset, half of them on the other; one arm refused."""
    trials, limits = [], []
    for preset, factor in (("one", 2.0), ("other", 0.5)):
        for plan, times in (("grid", 1.0), ("exchange", factor)):
            limits.append(
                {"preset": preset, "population": "as built", "plan": plan, "promised_mm": times}
                | {"promised_low_mm": 0.5, "promised_high_mm": 1.5, "promised_median_mm": times}
                | {"own_mm": 1.0, "known_mm": 1.0}
            )
            for trial, error in enumerate((1.0, 1.0, 1.0, np.nan)):
                trials.append(
                    {"preset": preset, "population": "as built", "plan": plan, "trial": trial}
                    | {"refused": bool(np.isnan(error)), "work_mm": times * error}
                    | {"box_mm": 3.0 * error, "nominal_mm": 3.0, "expected_mm": 2.0 * times}
                )
    rows = table.summary(pd.DataFrame(trials), pd.DataFrame(limits))
    by = {(row["preset"], row["plan"]): row for row in rows}
    both = by["all", "exchange"]
    assert (both["arms"], both["refused"]) == (8, 2)
    assert both["over_promised"] == pytest.approx(1.0)
    assert both["over_expected"] == pytest.approx(0.5)
    assert both["over_grid"] == pytest.approx(np.sqrt((2.0**2 + 0.5**2) / 2.0))
    assert both["box_over_grid"] == pytest.approx(1.0)
    assert both["better"] == both["inside"] == both["above"] == 0.5
    assert by["one", "exchange"]["found_mm"] == pytest.approx(2.0)
    assert by["other", "exchange"]["over_grid"] == pytest.approx(0.5)


def test_an_arm_without_errors_is_found_as_it_is(arms, trials):
    """Nothing is left of an arm that is as described but for noise: some hundredths of a mm."""
    bench = arms.bench_of("irb120")
    drawn = bench.arm("offsets", 0)
    arm = arms.Arm(drawn.model, drawn.as_described)
    q = bench.plans["grid"]
    rows = trials.found(bench, arm, q, np.random.default_rng(1))
    assert not rows["refused"]
    assert rows["work_mm"] < 0.05
    assert trials.error_mm(arm, arm.model, arm.values, bench.work) < 1e-9


@pytest.mark.slow
def test_a_short_form_has_the_structure_of_the_full_one(run, tmp_path, monkeypatch):
    """One preset and population; what was done before a stop is not done again."""
    one = [{"preset": "irb120", "population": "as built"}]
    monkeypatch.setattr(run, "populations", lambda: one)
    found = STUDY.run(Options(tmp_path, TRIALS))
    assert set(found) == set(EXPECTED)
    assert [set(row) for row in found["rows"]] == [
        set(row_of(preset, "as built", plan))
        for preset in ("all", "irb120")
        for plan in ("grid", "exchange", "offsets alone")
    ]
    assert [row["arms"] for row in found["rows"]] == [TRIALS] * 6
    assert set(found["floors"][0]) == set(EXPECTED["floors"][0])
    drawn = STUDY.plot(tmp_path)
    assert {path.suffix for path in drawn} == {".png", ".svg"}
    monkeypatch.setattr(run, "simulate", None)
    assert STUDY.run(Options(tmp_path, TRIALS)) == found


def ends(row: dict[str, Any], name: str) -> str:
    return f"{row[name]:.2f} ({row[f'{name}_low']:.2f} to {row[f'{name}_high']:.2f})"


def share(row: dict[str, Any], name: str) -> str:
    low, high = (f"{100 * row[f'{name}_{end}']:.0f}" for end in ("low", "high"))
    return f"{100 * row[name]:.0f} % ({low} to {high})"


def presets_of(population: str, plan: str, name: str) -> str:
    of = [r for r in EXPECTED["rows"] if (r["population"], r["plan"]) == (population, plan)]
    values = [row[name] for row in of if row["preset"] != "all"]
    return f"{min(values):.2f} to {max(values):.2f}"


def test_its_prose_has_its_figures():
    """Each sentence as it follows from the key figures."""
    usual, built, uneven = (row_of("all", p, "exchange") for p in ("usual", "as built", "uneven"))
    grids = [row_of("all", p, "grid") for p in ("usual", "as built", "uneven")]
    alone = [row_of("all", p, "offsets alone") for p in ("usual", "as built", "uneven")]
    one_kind = ("offsets", "compliance", "lost motion", "links")
    kinds = [row_of("all", p, "exchange")["over_promised"] for p in one_kind]
    lost = [row_of("all", "lost motion", p)["over_known"] for p in ("grid", "exchange")]
    built_floors = [row for row in EXPECTED["floors"] if row["population"] == "as built"]
    over = {
        name: "{:.2f} to {:.2f}".format(*(f([r[name] for r in built_floors]) for f in (min, max)))
        for name in ("floor_over_grid", "bound_over_grid", "exchange_over_grid")
    }
    on_reference = [
        row_of("reference", p, "offsets alone") for p in ("usual", "as built", "uneven")
    ]
    each = [row for row in EXPECTED["rows"] if row["preset"] != "all"]
    arms = sum(row["arms"] for row in each if row["plan"] == "grid")
    refused = sum(row["refused"] for row in each)
    for said in (
        f"the exchange leaves {ends(usual, 'over_promised')} of the error that it promises, and "
        f"{100 * usual['inside']:.0f} % of the arms are in its range",
        f"arms as built have {built['over_promised']:.2f} of the promise left, uneven ones "
        f"{uneven['over_promised']:.2f}.",
        f"chosen poses leave {usual['over_grid']:.2f}, {built['over_grid']:.2f} and "
        f"{uneven['over_grid']:.2f} of the error of the W P R grid.",
        f"{arms} simulated arms",
        f"{ends(grids[0], 'over_promised')} with the grid, {ends(usual, 'over_promised')} with the "
        f"exchange and {ends(alone[0], 'over_promised')} with the exchange for offsets alone; by "
        f"preset {presets_of('usual', 'exchange', 'over_promised')}",
        f"{share(grids[0], 'inside')}, {share(usual, 'inside')} and {share(alone[0], 'inside')} of",
        f"{ends(grids[1], 'over_promised')} of it is found with the grid and "
        f"{ends(built, 'over_promised')} with the exchange; by preset "
        f"{presets_of('as built', 'exchange', 'over_promised')}",
        f"its error is {built['over_known']:.2f} of the one",
        f"{ends(grids[2], 'over_promised')} of it is found with the grid and "
        f"{ends(uneven, 'over_promised')} with the exchange; by preset "
        f"{presets_of('uneven', 'grid', 'over_promised')} and "
        f"{presets_of('uneven', 'exchange', 'over_promised')}. {100 * grids[2]['above']:.0f} % of "
        f"the arms are above the range with the grid, {100 * uneven['above']:.0f} % with",
        f"{lost[0]:.1f} times the error to expect where its shape and size are known with the "
        f"grid, {lost[1]:.1f} times",
        f"{ends(usual, 'over_grid')} of the grid's error on usual arms, {ends(built, 'over_grid')} "
        f"on arms as built and {ends(uneven, 'over_grid')} on uneven ones, and is better on "
        f"{100 * usual['better']:.0f}, {100 * built['better']:.0f} and "
        f"{100 * uneven['better']:.0f} %",
        "it gains less: {:.2f}, {:.2f} and {:.2f}.".format(
            *(row["box_over_grid"] for row in (usual, built, uneven))
        ),
        "leaves {:.2f}, {:.2f} and {:.2f} of the grid's error; on the reference cell {:.2f}, "
        "{:.2f} and {:.2f}.".format(*(row["over_grid"] for row in (*alone, *on_reference))),
        "{:.2f} of the promise is found on arms with offsets alone, {:.2f} with compliance, {:.2f} "
        "with lost motion, {:.2f} with links.".format(*kinds),
        f"would leave {over['floor_over_grid']} of the error of the grid's 27; the best 27 cannot "
        f"leave less than {over['bound_over_grid']}, and the exchange leaves "
        f"{over['exchange_over_grid']}.",
        f"{refused} of {3 * arms:,} identifications",
    ):
        assert said in TEXT


def test_no_plan_is_below_its_bound_and_no_choice_below_the_whole_pool():
    """Of those who know the sizes; the bound is proven to a thousandth."""
    for row in EXPECTED["floors"]:
        assert row["floor_mm"] <= 1.001 * row["bound_mm"]
        assert row["bound_mm"] <= 1.001 * row["exchange_mm"]
