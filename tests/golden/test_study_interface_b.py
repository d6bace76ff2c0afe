"""Studies 08 to 13 as studies: run in a short form into a folder, drawn from what stands there."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from calib.errors import InputError
from posedesign.study import Options
from posedesign.study.library import Study, find_study
from studies.real_data import data_with

TABLES = {
    "choosing_irb120_poses": {"choosing_irb120_poses.csv"},
    "choosing_panda_touch_ups": {"choosing_panda_touch_ups.csv"},
    "what_buys_accuracy": {"what_buys_accuracy.csv"},
    "which_index_predicts": {"chosen.csv", "ranked.csv", "held.csv"},
    "visual_touch_up": {
        "visual_touch_up.csv",
        "visual_less_pin.csv",
        "cloud_touch_up.csv",
        "cloud_stereo.csv",
    },
    "calibration_by_touch_up": {"variation.csv", "plate.csv", "data_sets.csv"},
}
FIGURES = {name: {name} for name in TABLES} | {"calibration_by_touch_up": {"variation", "plate"}}
RECORDINGS = {
    "choosing_irb120_poses": "identification/abb_irb120",
    "choosing_panda_touch_ups": "identification/panda_ball_in_socket",
}
SMALLER: dict[str, dict[str, dict[str, Any]]] = {
    "choosing_irb120_poses": {"": {"counts": [9]}},
    "which_index_predicts": {
        "chosen": {"candidates": 120, "starts": 1, "random_sets": 5},
        "ranked": {"candidates": 800},
        "held": {"candidates": 300, "arms_drawn": 4},
    },
    "calibration_by_touch_up": {
        "": {"thresholds": [1e7, 1e6, 1e5, 2.7e4], "pictures_data_sets": 3, "causes_data_sets": 10},
        "robots": {"thresholds": [1e7, 2.7e4], "count": 4},
    },
}
"""Settings of studies, by their tables."""

RESULTS = {".csv", ".json", ".png", ".svg"}
LARGEST_SVG = 300_000


@pytest.fixture
def untouched() -> Iterator[None]:
    """No results are written beside the studies."""
    folders = [find_study(name).folder for name in TABLES]

    def results() -> dict[Path, int]:
        files = [path for folder in folders for path in folder.iterdir()]
        return {p: p.stat().st_mtime_ns for p in files if p.suffix in RESULTS}

    before = results()
    yield
    assert results() == before


def keys_of(content: Any) -> Any:
    """Structure of key figures: rows of a list are alike, and what they lack tells nothing."""
    if isinstance(content, dict):
        return {key: keys_of(value) for key, value in content.items()}
    if isinstance(content, list):
        rows = [keys_of(value) for value in content if isinstance(value, dict)]
        return {key: row[key] for row in rows for key in row}
    return None


def make_smaller(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Less of all that is no trial, too: full sizes are for the tests of the figures."""
    module = find_study(name).load()
    if name == "what_buys_accuracy":
        monkeypatch.setattr(module, "VARIANTS", module.VARIANTS[::5])
    if name == "which_index_predicts":
        problems = dict([list(module.SETTINGS["problems"].items())[-1]])
        monkeypatch.setitem(module.SETTINGS, "problems", problems)
    if name in RECORDINGS:  # the models with fewest parameters
        monkeypatch.setitem(module.SETTINGS, "model", module.SETTINGS["model"][-2:])
    for part, smaller in SMALLER.get(name, {}).items():
        for key, value in smaller.items():
            monkeypatch.setitem(module.SETTINGS[part] if part else module.SETTINGS, key, value)


def check_drawn(study: Study, out: Path) -> None:
    paths = study.plot(out)
    assert {path.name for path in paths} == {
        f"{stem}.{kind}" for stem in FIGURES[study.name] for kind in ("png", "svg")
    }
    for path in paths:
        assert path.parent == out
        start = path.read_bytes()[:200]
        assert start.startswith(b"\x89PNG") if path.suffix == ".png" else b"<?xml" in start
        assert path.stat().st_size > 10_000
        if path.suffix == ".svg":
            assert path.stat().st_size < LARGEST_SVG


def check_short_form(name: str, trials: int, out: Path) -> None:
    study, said = find_study(name), []
    options = Options(out, trials, advance=lambda what, part: said.append(part))
    figures = study.run(options)
    assert {path.name for path in out.iterdir()} == TABLES[name] | {"figures.json"}
    expected = json.loads((study.folder / "expected.json").read_text(encoding="utf-8"))
    assert keys_of(figures) == keys_of(expected)
    assert json.loads((out / "figures.json").read_text(encoding="utf-8")) == figures
    assert said == sorted(said)
    assert 0.0 <= said[0] <= said[-1] < 1.0
    check_drawn(study, out)


@pytest.mark.usefixtures("untouched")
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name == "which_index_predicts" else pytest.mark.slow)
        for name in TABLES
    ],
)
def test_a_figure_needs_nothing_but_tables_and_key_figures(name, tmp_path):
    study = find_study(name)
    for part in (*TABLES[name], "expected.json"):
        shutil.copy(study.folder / part, tmp_path)
    check_drawn(study, tmp_path)


@pytest.mark.slow
@pytest.mark.usefixtures("untouched")
@pytest.mark.parametrize(
    ("name", "trials"),
    [
        ("what_buys_accuracy", 20),
        ("which_index_predicts", 20),
        pytest.param("visual_touch_up", 12, marks=pytest.mark.full),
        ("calibration_by_touch_up", 20),
    ],
)
def test_a_short_form_has_the_structure_of_the_full_one(name, trials, tmp_path, monkeypatch):
    make_smaller(name, monkeypatch)
    check_short_form(name, trials, tmp_path)


@pytest.mark.slow
@pytest.mark.real_data
@pytest.mark.usefixtures("untouched")
@pytest.mark.parametrize("name", list(RECORDINGS))
def test_so_has_one_of_measurements(name, tmp_path, monkeypatch):
    try:
        data_with(RECORDINGS[name])
    except InputError as error:
        pytest.skip(str(error))
    make_smaller(name, monkeypatch)
    check_short_form(name, 6, tmp_path)


@pytest.mark.parametrize("name", [name for name in TABLES if name not in RECORDINGS])
def test_too_few_trials_are_refused_before_any_work(name, tmp_path):
    with pytest.raises(InputError, match="1 trials") as caught:
        find_study(name).run(Options(tmp_path, 1))
    assert "or more" in str(caught.value.hint)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", list(TABLES))
def test_its_readme_has_its_commands(name):
    study = find_study(name)
    text = (study.folder / "README.md").read_text(encoding="utf-8")
    for command in ("run", "plot"):
        assert f"posedesign study {command} {name} " in text
    assert study.question.endswith("?")
    for stem in FIGURES[name]:
        assert f"({stem}.png)" in text
        for kind in ("png", "svg"):
            assert (study.folder / f"{stem}.{kind}").stat().st_size > 10_000
