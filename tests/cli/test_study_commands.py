"""``posedesign study list, run, plot``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from posedesign.study.library import find_study, list_studies

STUDIES = Path(__file__).parents[2] / "studies"


def test_list_names_every_study_and_its_question(cli) -> None:
    rows = json.loads(cli("study", "list", "--json").out)
    folders = sorted(p.name for p in STUDIES.iterdir() if (p / "run.py").exists())
    assert [row["study"] for row in rows] == [name.partition("_")[2] for name in folders]
    assert all(row["question"].endswith("?") for row in rows)
    assert "what_buys_accuracy" in cli("study", "list").out


@pytest.mark.parametrize("study", list_studies(), ids=lambda study: study.name)
def test_every_study_can_be_run_and_drawn(study) -> None:
    """That it does is for the tests of each study."""
    module = study.load()
    assert callable(module.study)
    assert callable(module.plot)
    assert module.study.__doc__


def test_run_draws_and_goes_on(cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    settings = find_study("accuracy_vs_condition").load().SETTINGS
    monkeypatch.setitem(settings, "presets", ["irb120"])
    monkeypatch.setitem(settings, "thresholds", 4)
    words = ("study", "run", "accuracy_vs_condition", "--trials", "10")
    said = cli(*words)
    assert said.code == 0, said.err
    out = tmp_path / "study-results" / "accuracy_vs_condition"
    for name in ("accuracy_vs_condition.csv", "relations.csv", "accuracy_vs_condition.svg"):
        assert (out / name).stat().st_size > 1000
        assert name in said.out
    before = {path.name: path.read_bytes() for path in out.glob("*.csv")}
    again = cli(*words, "--json")
    assert json.loads(again.out)["trials"] == 10
    assert {path.name: path.read_bytes() for path in out.glob("*.csv")} == before
    (out / "accuracy_vs_condition.png").unlink()
    assert cli("study", "plot", "01").code == 0
    assert (out / "accuracy_vs_condition.png").exists()


def test_refusals(refuse, tmp_path: Path) -> None:
    refuse("study", "run", "acuracy_vs_condition").says(
        "acuracy", "did you mean accuracy_vs_condition"
    )
    refuse("study", "plot", "accuracy_vs_condition", "--out", tmp_path).says(
        "no results", "run it first"
    )


def test_no_scheduler(cli, tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="needs Dask (posedesign[cluster])")
    said = cli("study", "run", "01", "--out", tmp_path, "--scheduler", "nowhere")
    assert said.code == 2
    assert said.err == (
        "error: there is no Dask scheduler at nowhere (start one with: dask scheduler, and workers "
        "with: dask worker ADDRESS)\n"
    )
