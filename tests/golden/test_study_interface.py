"""Studies as each is used: run in a short form into a folder, drawn from that folder alone."""

import hashlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from matplotlib import image

from calib.errors import InputError
from posedesign.study import Options
from posedesign.study.library import Study, find_study, list_studies
from studies.real_data import data_folder
from tests.marks import rest_in_slow

RECORDINGS = {
    "panda_touch_ups": ("identification/panda_ball_in_socket",),
    "irb120_measuring_arm": ("identification/abb_irb120",),
    "ur10_motion_capture": ("identification/ur10",),
    "real_pairs": ("robot_world/ur3e_hand_camera", "robot_world/multi_tag", "robot_world/tabb_ds1"),
    "choosing_irb120_poses": ("identification/abb_irb120",),
    "choosing_panda_touch_ups": ("identification/panda_ball_in_socket",),
}
FIXED = tuple(RECORDINGS)[:4]
"""Nothing of them is drawn at random."""

TRIALS = {
    "li_noise_cases": 12,  # more than the ten of the paper
    "hirsh_iterations": 12,
    "what_buys_accuracy": 20,
    "which_index_predicts": 20,
    "visual_touch_up": 12,
    "calibration_by_touch_up": 20,
}
"""Of short forms."""

EVERY = (*RECORDINGS, *TRIALS)
LARGEST_SVG = 300_000
MEASURED = {"cell.toml", "cell_given_noise.toml", "measurements.csv"}
"""What ``posedesign identify`` takes, beside the results of some studies of measurements."""

SMALLER: dict[str, dict[str, dict[str, Any]]] = {
    "li_noise_cases": {"": {"poses": [4, 10], "workspaces": {"all orientations": 0.0}}},
    "hirsh_iterations": {"": {"printed": {"cycles": [20] * 3, "problems": [9] * 3}}},
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
"""Settings of studies, by their tables: less of all that is no trial, too."""


@pytest.fixture
def untouched() -> Iterator[None]:
    """Nothing in the studies' own folders changes."""
    folders = [find_study(name).folder for name in EVERY]
    before = [contents(folder) for folder in folders]
    yield
    assert [contents(folder) for folder in folders] == before


def contents(folder: Path) -> dict[str, str]:
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.iterdir()
        if path.is_file()
    }


def make_smaller(study: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    module, name = study.load(), study.name
    if name == "what_buys_accuracy":
        monkeypatch.setattr(module, "VARIANTS", module.VARIANTS[::5])
    if name == "which_index_predicts":
        problems = dict([list(module.SETTINGS["problems"].items())[-1]])
        monkeypatch.setitem(module.SETTINGS, "problems", problems)
    if name == "panda_touch_ups":
        monkeypatch.setitem(module.SETTINGS, "model", module.SETTINGS["model"][:2])
    if name.startswith("choosing"):  # the models with fewest parameters
        monkeypatch.setitem(module.SETTINGS, "model", module.SETTINGS["model"][-2:])
    if name == "real_pairs":
        monkeypatch.setattr(sys.modules[f"{module.__name__}.real_rows"], "METHODS", ("ml", "shah"))
        read = module.real_pairs
        monkeypatch.setattr(module, "real_pairs", lambda data: few(read(data)))
    for part, smaller in SMALLER.get(name, {}).items():
        for key, value in smaller.items():
            monkeypatch.setitem(module.SETTINGS[part] if part else module.SETTINGS, key, value)


def few(every: dict[str, Any]) -> dict[str, Any]:
    """Every fifth pair of the long sequences."""
    return {
        name: sides if name == "Tabb" else tuple(side[::5] for side in sides)
        for name, sides in every.items()
    }


def expected_of(study: Study, found: Any) -> Any:
    """The key figures of the full run, less what the short form leaves out."""
    full = json.loads((study.folder / "expected.json").read_text(encoding="utf-8"))
    if study.name == "li_noise_cases":
        simulated = full["table_1"]["simulated"].items()
        full["table_1"] = {"simulated": {k: v for k, v in simulated if k.startswith("all")}}
    if study.name == "panda_touch_ups":
        full["models"] = full["models"][:2]
    if study.name == "real_pairs":
        for part, of in full["data"].items():
            kept = ("ml, ratio", "ml, on B", "ml", "shah")
            of["splits"]["methods"] = {method: of["splits"]["methods"][method] for method in kept}
            for key in ("warnings", "left_out"):
                of[key] = found["data"][part][key]
    return full


def keys_of(content: Any) -> Any:
    """Structure of key figures: rows of a list are alike, and what they lack tells nothing."""
    if isinstance(content, dict):
        return {key: keys_of(value) for key, value in content.items()}
    if isinstance(content, list):
        rows = [keys_of(value) for value in content if isinstance(value, dict)]
        return {key: row[key] for row in rows for key in row}
    return None if content is None else "a figure"


def assert_alike(short: Any, full: Any, where: str = "") -> None:
    """The same structure; what a short run cannot tell is None."""
    if short is None or full is None:
        return
    assert isinstance(short, dict) == isinstance(full, dict), where
    if isinstance(full, dict):
        assert set(short) == set(full), where
        for key, item in full.items():
            assert_alike(short[key], item, f"{where}/{key}")


def check_short_form(name: str, out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study, said = find_study(name), []
    make_smaller(study, monkeypatch)
    options = Options(out, TRIALS.get(name, 6), advance=lambda what, part: said.append(part))
    found = study.run(options)
    assert json.loads((out / "figures.json").read_text(encoding="utf-8")) == found
    assert_alike(keys_of(found), keys_of(expected_of(study, found)))
    assert len(said) > 1
    assert said == sorted(said)
    assert 0.0 <= said[0] < said[-1] <= 1.0
    tables = contents(out)
    of_study = {path.name for path in study.folder.glob("*.csv")}
    recorded = (
        {"cell.toml", "cell_given_noise.toml", "measurements.csv"} if name in FIXED else set()
    )
    assert of_study <= set(tables) <= of_study | {"figures.json"} | recorded
    drawn = study.plot(out)
    after = contents(out)
    assert {part: after[part] for part in tables} == tables  # drawing changes no table
    assert set(after) - set(tables) == {path.name for path in drawn}
    pictures = {path.name for path in study.folder.iterdir() if path.suffix in (".png", ".svg")}
    assert {path.name for path in drawn} == pictures
    for path in drawn:
        if path.suffix == ".png":
            assert image.imread(path)[..., :3].std() > 0.02  # not one colour
        else:
            assert "<path" in path.read_text(encoding="utf-8")


LONG = pytest.mark.slow, pytest.mark.full


@pytest.mark.usefixtures("untouched")
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=LONG)
        if name == "visual_touch_up"
        else pytest.param(name, marks=() if name == "li_noise_cases" else pytest.mark.slow)
        for name in TRIALS
    ],
)
def test_a_short_form_has_the_structure_of_the_full_one(name, tmp_path, monkeypatch):
    monkeypatch.setenv("POSEDESIGN_DATA", str(tmp_path))  # no real pairs there
    check_short_form(name, tmp_path / "out", monkeypatch)


@pytest.mark.usefixtures("untouched")
@pytest.mark.real_data
@pytest.mark.slow
@pytest.mark.parametrize("name", RECORDINGS)
def test_so_has_one_of_measurements(name, tmp_path, monkeypatch):
    lacking = [part for part in RECORDINGS[name] if not (data_folder() / part).is_dir()]
    if lacking:
        pytest.skip(f"{data_folder() / lacking[0]} does not exist: set POSEDESIGN_DATA")
    check_short_form(name, tmp_path, monkeypatch)


@pytest.mark.parametrize("name", RECORDINGS)
def test_without_the_recordings_it_says_where_it_looked(name, tmp_path, monkeypatch):
    study, nowhere = find_study(name), tmp_path / "nowhere"
    monkeypatch.setenv("POSEDESIGN_DATA", str(nowhere))
    with pytest.raises(InputError) as caught:
        study.run(Options(tmp_path / "out"))
    said = str(caught.value)
    assert "\n" not in said
    assert str(nowhere / RECORDINGS[name][0]) in said
    assert "POSEDESIGN_DATA" in said
    assert "../shared/data" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", [*TRIALS, "pictures_of_a_board"])
def test_too_few_trials_are_refused_before_any_work(name, tmp_path):
    with pytest.raises(InputError, match="1 trials") as caught:
        find_study(name).run(Options(tmp_path, 1))
    assert "or more" in str(caught.value.hint)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("study", list_studies(), ids=lambda study: study.name)
def test_its_readme_has_its_commands_figures_and_tables(study):
    text = (study.folder / "README.md").read_text(encoding="utf-8")
    for command in ("run", "plot"):
        assert f"posedesign study {command} {study.name}" in text
    assert study.question.endswith("?")
    for picture in study.folder.glob("*.png"):
        assert f"({picture.name})" in text
    expected = json.loads((study.folder / "expected.json").read_text(encoding="utf-8"))
    for part in study.markdown(expected).split("\n\n"):  # some print more than their pages have
        lines = [line for line in part.splitlines() if line.startswith(("|", "**"))]
        assert "\n".join(lines) in text


@pytest.mark.parametrize("name", rest_in_slow(EVERY, ("panda_touch_ups",)))
def test_committed_figures_are_those_of_the_committed_tables(name, tmp_path):
    """Drawn again from a copy of the tables in the study's own folder, and nothing else."""
    study = find_study(name)
    for path in (*study.folder.glob("*.csv"), study.folder / "expected.json"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    for path in study.plot(tmp_path):
        assert path.parent == tmp_path
        assert path.stat().st_size > 5_000
        if path.suffix == ".svg":
            assert path.stat().st_size < LARGEST_SVG
        else:
            new, old = (image.imread(p)[..., :3] for p in (path, study.folder / path.name))
            assert new.shape == old.shape
            assert abs(new - old).mean() < 0.01  # fonts and anti-aliasing differ a little
