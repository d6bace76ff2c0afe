"""Studies 02 to 07 as every study is used: run into a folder, drawn from that folder alone."""

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
from posedesign.study.library import Study, find_study
from studies.real_data import data_folder

RECORDINGS = {
    "panda_touch_ups": ("identification/panda_ball_in_socket",),
    "irb120_measuring_arm": ("identification/abb_irb120",),
    "ur10_motion_capture": ("identification/ur10",),
    "real_pairs": ("robot_world/ur3e_hand_camera", "robot_world/multi_tag", "robot_world/tabb_ds1"),
}
PAPERS = ("li_noise_cases", "hirsh_iterations")
EVERY = (*RECORDINGS, *PAPERS)
TRIALS = 12
"""Of a short form: more than the ten of Li's paper."""


@pytest.fixture
def short(monkeypatch) -> None:
    """Less work for the studies that do not go by their number of trials alone."""
    panda, pairs, li, hirsh = (
        find_study(name).load()
        for name in ("panda_touch_ups", "real_pairs", "li_noise_cases", "hirsh_iterations")
    )
    monkeypatch.setitem(panda.SETTINGS, "model", panda.SETTINGS["model"][:2])
    monkeypatch.setattr(sys.modules[f"{pairs.__name__}.real_rows"], "METHODS", ("ml", "shah"))
    monkeypatch.setattr(pairs, "real_pairs", lambda data, read=pairs.real_pairs: few(read(data)))
    monkeypatch.setitem(li.SETTINGS, "poses", [4, 10])
    monkeypatch.setitem(li.SETTINGS, "workspaces", {"all orientations": 0.0})
    monkeypatch.setitem(hirsh.SETTINGS, "printed", {"cycles": [20] * 3, "problems": [9] * 3})


def few(every: dict[str, Any]) -> dict[str, Any]:
    """Every fifth pair of the long sequences."""
    return {
        name: sides if name == "Tabb" else tuple(side[::5] for side in sides)
        for name, sides in every.items()
    }


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


def written(study: Study) -> Any:
    return json.loads((study.folder / "expected.json").read_text(encoding="utf-8"))


def assert_alike(short: Any, full: Any, where: str = "") -> None:
    """The same keys, as far as the first rows of lists; what a short run cannot tell is None."""
    if isinstance(full, dict) and short is not None:
        assert list(short) == list(full), where
        for key, item in full.items():
            assert_alike(short[key], item, f"{where}/{key}")
    elif isinstance(full, list):
        assert isinstance(short, list), where
        if short and full:
            assert_alike(short[0], full[0], f"{where}/0")
    elif short is not None and full is not None:
        assert isinstance(short, str) == isinstance(full, str), where


def run_and_draw(study: Study, out: Path) -> tuple[Any, list[tuple[str, float]]]:
    """Key figures and progress of a short run, the figures drawn beside its tables."""
    said: list[tuple[str, float]] = []
    options = Options(out, trials=TRIALS, advance=lambda what, part: said.append((what, part)))
    found = study.run(options)
    assert json.loads((out / "figures.json").read_text(encoding="utf-8")) == found
    tables = contents(out)
    drawn = study.plot(out)
    after = contents(out)
    assert {name: after[name] for name in tables} == tables  # drawing changes no table
    assert set(after) - set(tables) == {path.name for path in drawn}
    names = {path.name for path in study.folder.iterdir() if path.suffix in (".png", ".svg")}
    assert {path.name for path in drawn} == names
    for path in drawn:
        if path.suffix == ".png":
            assert image.imread(path)[..., :3].std() > 0.02  # not one colour
        else:
            assert "<path" in path.read_text(encoding="utf-8")
    assert {name for name in tables if name.endswith(".csv")} >= {
        path.name for path in study.folder.glob("*.csv")
    }
    return found, said


@pytest.mark.usefixtures("short", "untouched")
@pytest.mark.parametrize("name", [PAPERS[0], pytest.param(PAPERS[1], marks=pytest.mark.slow)])
def test_studies_of_papers(name, tmp_path, monkeypatch):
    monkeypatch.setenv("POSEDESIGN_DATA", str(tmp_path))  # no real pairs there
    study = find_study(name)
    found, said = run_and_draw(study, tmp_path / "out")
    full = written(study)
    if name == "li_noise_cases":
        simulated = full["table_1"]["simulated"].items()
        full["table_1"] = {"simulated": {k: v for k, v in simulated if k.startswith("all")}}
    assert_alike(found, full)
    assert found["trials"] == TRIALS
    parts = [part for _, part in said]
    assert len(parts) > 5
    assert parts == sorted(parts)
    assert 0.0 <= parts[0] < parts[-1] <= 1.0


@pytest.mark.usefixtures("short", "untouched")
@pytest.mark.real_data
@pytest.mark.slow
@pytest.mark.parametrize("name", RECORDINGS)
def test_studies_of_real_data(name, tmp_path):
    lacking = [part for part in RECORDINGS[name] if not (data_folder() / part).is_dir()]
    if lacking:
        pytest.skip(f"{data_folder() / lacking[0]} does not exist: set POSEDESIGN_DATA")
    study = find_study(name)
    found, said = run_and_draw(study, tmp_path)
    full = written(study)
    if name == "panda_touch_ups":
        full["models"] = full["models"][:2]
    if name == "real_pairs":
        for part, of in full["data"].items():
            of["splits"]["methods"] = {
                method: of["splits"]["methods"][method]
                for method in ("ml, ratio", "ml, on B", "ml", "shah")
            }
            of["warnings"], of["left_out"] = (
                found["data"][part][key] for key in ("warnings", "left_out")
            )
    assert_alike(found, full)
    assert len(said) > 1


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


@pytest.mark.parametrize(
    "name",
    [
        *list(RECORDINGS)[:3],
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("real_pairs", *PAPERS)),
    ],
)
def test_committed_figures_are_those_of_the_committed_tables(name, tmp_path):
    """Drawn again from a copy of the tables in the study's own folder, and nothing else."""
    study = find_study(name)
    for path in (*study.folder.glob("*.csv"), study.folder / "expected.json"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    for path in study.plot(tmp_path):
        assert path.stat().st_size > 5_000
        if path.suffix == ".svg":
            assert path.stat().st_size < 300_000
        else:
            new, old = (image.imread(p)[..., :3] for p in (path, study.folder / path.name))
            assert new.shape == old.shape
            assert abs(new - old).mean() < 0.01  # fonts and anti-aliasing differ a little
