"""``posedesign study list, run, plot``."""

import json
import sys
from pathlib import Path
from types import ModuleType

import pytest

from posedesign.study import library, runner
from posedesign.study.library import find_study, list_studies

STUDIES = Path(__file__).parents[2] / "studies"


def test_list_names_every_study_and_its_question(cli):
    rows = json.loads(cli("study", "list", "--json").out)
    folders = sorted(p.name for p in STUDIES.iterdir() if (p / "run.py").exists())
    assert [row["study"] for row in rows] == [name.partition("_")[2] for name in folders]
    assert all(row["question"].endswith("?") for row in rows)
    needs = {row["number"]: row["needs"] for row in rows}
    assert "POSEDESIGN_DATA" in needs["07"]
    assert not needs["01"]
    assert "what_buys_accuracy" in cli("study", "list").out


@pytest.mark.parametrize("study", list_studies(), ids=lambda study: study.name)
def test_every_study_can_be_run_and_drawn(study):
    """That it does is for the tests of each study."""
    module = study.load()
    assert callable(module.study)
    assert callable(module.plot)
    assert module.study.__doc__


RUN = """
from pathlib import Path

import pandas as pd

from posedesign.files import make_folder

WORKERS = True


def study(options):
    make_folder(options.out)
    trials = options.trials or 3
    rows = pd.DataFrame({"trial": range(trials)})
    rows.to_csv(options.out / "small.csv", index=False)
    return {"trials": trials, "jobs": options.workers.jobs, "restart": options.restart}


def plot(folder):
    rows = pd.read_csv(folder / "small.csv")
    if (folder / "small.parquet").exists():
        pd.read_parquet(folder / "small.parquet")
    rows["trial"].mean() + 1.0
    path = folder / "small.txt"
    path.write_text(f"{len(rows)} rows")
    return [path]
"""


@pytest.fixture
def small_study(tmp_path, monkeypatch) -> str:
    """A study that takes no time, in a folder of studies of its own."""
    folder = tmp_path / "studies" / "07_small"
    folder.mkdir(parents=True)
    (folder / "run.py").write_text(RUN)
    monkeypatch.setattr(library, "studies_folder", lambda: tmp_path / "studies")
    monkeypatch.setitem(sys.modules, "studies", ModuleType("studies"))
    monkeypatch.delitem(sys.modules, "studies.07_small", raising=False)
    monkeypatch.chdir(tmp_path)
    find_study("small").load()
    return "small"


def test_run_and_plot(cli, done, small_study, tmp_path):
    said = done("study", "run", small_study, "--trials", "5")
    out = Path("study-results") / "small"
    wrote = f"wrote {out / 'small.csv'}\nwrote {out / 'small.txt'}\n"
    assert said.out.startswith(wrote)
    assert "07_small/README.md" in said.out.removeprefix(wrote)
    assert (tmp_path / out / "small.txt").read_text() == "5 rows"
    words = ("study", "run", "07", "--jobs", "2", "--restart", "--out", "here", "--json")
    assert json.loads(cli(*words).out) == {"trials": 3, "jobs": 2, "restart": True}
    (tmp_path / "here" / "small.txt").unlink()
    assert cli("study", "plot", "7", "--out", "here").out == f"wrote {Path('here') / 'small.txt'}\n"
    assert (tmp_path / "here" / "small.txt").read_text() == "3 rows"


@pytest.mark.parametrize("name", ["small.csv", "figures.json", "any.svg"])
def test_results_of_others_are_not_replaced(cli, refuse, small_study, tmp_path, name):
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / name).write_text("mine")
    words = ("study", "run", small_study, "--out", "here", "--restart")
    refuse(*words).says(f"here/{name}", "is not of the study small", "another output folder")
    (tmp_path / "here" / "about.json").write_text('{"mine": 1}')
    refuse(*words).says(f"here/{name}")


def test_edited_results_are_not_replaced(done, refuse, small_study, tmp_path):
    words = ("study", "run", small_study, "--out", "here")
    for _ in range(2):
        done(*words, "--trials", "4")
    table = tmp_path / "here" / "small.csv"
    table.write_text(table.read_text() + "99\n")
    done("study", "plot", small_study, "--out", "here")
    refuse(*words).says("small.csv was changed since the study wrote it")
    picture = tmp_path / "here" / "mine.png"
    picture.write_bytes(b"mine")
    refuse("study", "plot", small_study, "--out", "here").says("mine.png")


def test_damaged_tables(refuse, small_study, tmp_path):
    (tmp_path / "here").mkdir()
    damaged = ("", 'a,b\n1,2,3\n"', "other\n1\n", "trial\nx\n", "trial\n\xff", "\0\0")
    for text in damaged:
        (tmp_path / "here" / "small.csv").write_bytes(text.encode("latin-1"))
        refuse("study", "plot", small_study, "--out", "here").says("here", "--restart")
    (tmp_path / "here" / "small.csv").write_text("trial\n1\n")
    for data in (b"", b"PAR1", b"PAR1" + 60 * b"x" + b"PAR1"):
        (tmp_path / "here" / "small.parquet").write_bytes(data)
        refuse("study", "plot", small_study, "--out", "here").says("here", "--restart")


def test_a_fault_in_drawing_is_no_damaged_table(
    cli, done, refuse, small_study, tmp_path, monkeypatch
):
    done("study", "run", small_study, "--out", "here")
    words = ("study", "plot", small_study, "--out", "here")

    def faulty(folder: Path) -> list[Path]:
        return [folder / {"a": "b"}["c"]]

    monkeypatch.setattr(find_study(small_study).load(), "plot", faulty)
    with pytest.raises(KeyError):
        cli(*words)
    with pytest.raises(KeyError):
        cli("study", "run", small_study, "--out", "there")
    (tmp_path / "here" / "small.csv").write_text("trial\n7\n")
    refuse(*words).says("small.csv was changed since the study wrote it", "KeyError: 'c'")
    monkeypatch.setattr(find_study(small_study).load(), "plot", lambda _: [Path("no").read_text()])
    with pytest.raises(FileNotFoundError):
        find_study(small_study).plot(tmp_path / "here")


def test_what_a_run_left_that_failed_is_its_own(cli, done, small_study, monkeypatch):
    module = find_study(small_study).load()
    study = module.study

    def stopped(options: library.Options) -> None:
        study(options)
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "study", stopped)
    assert cli("study", "run", small_study, "--out", "here").code == 130
    monkeypatch.setattr(module, "study", study)
    done("study", "run", small_study, "--out", "here")


def test_the_note_of_another_study_opens_nothing(refuse, small_study, tmp_path):
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "small.csv").write_text("mine")
    words = ("study", "run", small_study, "--out", "here")
    (tmp_path / "here" / "about.json").write_text('{"study": "08_large"}')
    refuse(*words).says("here/small.csv", "is not of the study small")


def test_the_own_folder_has_the_figures_that_tests_hold_it_to(done, refuse, small_study, tmp_path):
    own = tmp_path / "studies" / "07_small"
    refuse("study", "run", small_study, "--out", own, "--trials", "4").says("7_small", "--out")
    (own / "figures.json").write_text("{}")
    (own / "any.png").write_text("mine")
    done("study", "run", small_study, "--out", own)
    assert (own / "expected.json").read_text() == "{}"
    assert not (own / "figures.json").exists()


def test_studies_are_found_in_a_checkout_alone(cli, refuse, small_study, tmp_path, monkeypatch):
    monkeypatch.undo()
    monkeypatch.setattr(library, "__file__", str(tmp_path / "site" / "posedesign" / "study" / "l"))
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    monkeypatch.delenv(library.NAMED_BY, raising=False)
    assert [s.name for s in list_studies()] == ["small"]  # in a folder above
    monkeypatch.chdir(Path(tmp_path.anchor))
    refuse("study", "list").says("no part of the package", "checkout", library.NAMED_BY)
    monkeypatch.setenv(library.NAMED_BY, str(tmp_path / "studies"))
    assert "small" in cli("study", "list").out
    monkeypatch.setenv(library.NAMED_BY, str(tmp_path))
    refuse("study", "run", "small").says("no studies in", str(tmp_path))


@pytest.mark.slow
@pytest.mark.usefixtures("rendered")
def test_run_draws_and_goes_on(cli, done, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    settings = find_study("accuracy_vs_condition").load().SETTINGS
    monkeypatch.setitem(settings, "presets", ["irb120"])
    monkeypatch.setitem(settings, "thresholds", 4)
    words = ("study", "run", "accuracy_vs_condition", "--trials", "10")
    said = done(*words)
    out = tmp_path / "study-results" / "accuracy_vs_condition"
    for name in ("accuracy_vs_condition.csv", "relations.csv", "accuracy_vs_condition.svg"):
        assert (out / name).stat().st_size > 1000
        assert name in said.out
    before = {path.name: path.read_bytes() for path in out.glob("*.csv")}
    again = cli(*words, "--json")
    assert json.loads(again.out)["trials"] == 10
    assert {path.name: path.read_bytes() for path in out.glob("*.csv")} == before
    (out / "accuracy_vs_condition.png").unlink()
    done("study", "plot", "01")
    assert (out / "accuracy_vs_condition.png").exists()


def test_refusals(refuse, tmp_path):
    refuse("study", "run", "acuracy_vs_condition").says(
        "acuracy", "did you mean accuracy_vs_condition"
    )
    refuse("study", "plot", "accuracy_vs_condition", "--out", tmp_path).says(
        "no results", "run it first"
    )
    refuse("study", "plot", "hirsh_iterations", "--out", tmp_path).says(
        "hirsh_iterations.csv", "run it first"
    )
    refuse("study", "run", "01", "--trials", "1", "--out", tmp_path).says("1 trials", "2 or more")
    refuse("study", "run", "hirsh_iterations", "--jobs", "2").says("one process", "--jobs")
    refuse("study", "run", "01", "--jobs", "1000000").says("1000000 jobs", "from 1 to")


def test_no_scheduler(cli, tmp_path, monkeypatch):
    pytest.importorskip("distributed", reason="needs Dask (posedesign[cluster])")
    monkeypatch.setattr(runner, "_CONNECT_S", 0.2)
    said = cli("study", "run", "01", "--out", tmp_path, "--scheduler", "nowhere")
    assert said.code == 2
    assert said.err == (
        "error: there is no Dask scheduler at nowhere (start one with: dask scheduler, and workers "
        "with: dask worker ADDRESS)\n"
    )
