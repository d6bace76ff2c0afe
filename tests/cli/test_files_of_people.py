"""Commands over folders that hold somebody's files: nothing changes, and one line says so."""

import json
from pathlib import Path

import pytest

from tests.cli.conftest import offsets_only, with_camera

OPTIMAL = ("--method", "exchange", "--poses", "8", "--validation", "2")
COMMANDS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "plan": (("plan", "{cell}"), ("poses.csv", "rounds.csv")),
    "plan, best": (("plan", "{cell}", *OPTIMAL), ("poses.csv", "validation.csv")),
    "next": (("next", "{cell}", "{touchups}"), ("poses.csv",)),
    "simulate": (("simulate", "{sighted}", "{poses}"), ("touchups.csv", "pairs.csv")),
    "identify": (("identify", "{cell}", "{touchups}"), ("identification.json",)),
    "predict": (
        ("predict", "{cell}", "{poses}", "--box", "1500,-300,300,2100,300,900"),
        ("predicted_accuracy.csv",),
    ),
    "correct": (
        ("correct", "{cell}", "{identification}", "{poses}"),
        ("corrected.urdf", "mastering.csv", "corrected_poses.csv"),
    ),
    "robot-world": (("robot-world", "{pairs}"), ("robot_world.csv", "robot_world_pairs.csv")),
    "import": (("import", "{cell}", "{program}", "--poses", "{poses}"), ("touchups.csv",)),
    "study accuracy": (
        ("study", "accuracy", "{cell}", "--draws", "10"),
        ("accuracy_vs_condition.csv", "accuracy_vs_condition.png"),
    ),
    "demo": (
        ("demo", "--draws", "10"),
        (
            *("CALIB01.LS", "cell.toml", "poses.csv", "rounds.csv", "touchups.csv", "pairs.csv"),
            *("identification.json", "robot_world.csv", "robot_world_pairs.csv"),
            *("accuracy_vs_condition.csv", "accuracy_vs_condition.png"),
        ),
    ),
}
"""Words of each command, and the files that it writes into its folder."""

CASES = [(name, file) for name, (_, files) in COMMANDS.items() for file in files]


@pytest.fixture
def inputs(work) -> dict[str, str]:
    """What the commands read, in a folder of its own."""
    files = {key: str(work / f"{key}.csv") for key in ("poses", "touchups", "pairs")}
    files |= {"cell": str(work / "cell.toml"), "program": str(work / "CALIB01.LS")}
    files["sighted"] = str(with_camera(work / "cell.toml"))
    files["identification"] = str(work / "identification.json")
    return files


@pytest.mark.parametrize(("name", "file"), CASES)
def test_a_persons_file_is_not_replaced(refuse, inputs, tmp_path, name, file):
    out = tmp_path / "somebodys"
    out.mkdir()
    (out / file).write_bytes(b"target,j1_deg\nT1,12.5\n")
    words = [word.format(**inputs) for word in COMMANDS[name][0]]
    line = refuse(*words, "--out", out)
    line.says(str(out / file), "is not replaced", "name another")


@pytest.mark.parametrize(
    ("dialect", "file"),
    [
        ("fanuc-ls", "CALIB01.LS"),
        ("fanuc-ls", "CALB01_2.LS"),
        ("ros-trajectory", "CALIB01.yaml"),
        ("moveit-joints", "CALIB01.yaml"),
        ("robot-calibration", "CALIB01.yaml"),
        ("robodk-csv", "CALIB01.csv"),
        ("robodk-csv", "CALIB01.txt"),
    ],
)
def test_a_persons_program_is_not_replaced(refuse, inputs, tmp_path, dialect, file):
    out = tmp_path / "somebodys"
    out.mkdir()
    (out / file).write_bytes(b"mine")
    line = refuse("program", inputs["poses"], "--format", dialect, "--out", out)
    line.says(str(out / file), "is not replaced")


@pytest.mark.parametrize("form", ["usual", "ros", "robodk"])
def test_convert_does_not_replace(done, refuse, inputs, tmp_path, form):
    words = ("convert", inputs["poses"], "--cell", inputs["cell"], "--to", form, "--out")
    done(*words, tmp_path / "new.csv")
    done(*words, tmp_path / "new.csv")
    (tmp_path / "mine.csv").write_bytes(b"mine")
    refuse(*words, tmp_path / "mine.csv").says("does not say where it is from")


@pytest.mark.slow
def test_each_command_runs_over_its_own_files(cli, work):
    cell, out = offsets_only(work / "cell.toml", judged=True), work / "out"
    for line in (
        ("plan", cell),
        ("simulate", with_camera(cell), out / "poses.csv"),
        ("identify", cell, out / "touchups.csv"),
        ("correct", cell, out / "identification.json", out / "poses.csv"),
        ("robot-world", out / "pairs.csv", "--method", "shah"),
    ):
        for _ in range(2):
            said = cli(*line, "--out", out)
            assert said.code in (0, 1), (line, said)
    assert not [path for path in out.iterdir() if path.suffix == ".1"]


def test_no_camera_is_invented(cli, work):
    """Pairs of a camera that the cell does not have would be taken for ones that it could give."""
    said = cli("simulate", work / "cell.toml", work / "poses.csv", "--out", work / "out", "--json")
    assert [Path(name).name for name in json.loads(said.out)["files"]] == ["touchups.csv"]
    assert [path.name for path in (work / "out").iterdir()] == ["touchups.csv"]


def test_simulated_is_said_in_the_headline(cli, work):
    cell, out = offsets_only(work / "cell.toml"), work / "out"
    assert "SIMULATED" in cli("simulate", with_camera(cell), work / "poses.csv", "--out", out).out
    for line in (
        ("identify", cell, out / "touchups.csv"),
        ("correct", cell, out / "identification.json", work / "poses.csv"),
        ("robot-world", out / "pairs.csv", "--method", "shah"),
        ("next", cell, out / "touchups.csv"),
    ):
        said = cli(*line, "--out", out)
        assert said.out.startswith("SIMULATED, not for a robot: from "), line
    for name in ("mastering.csv", "corrected_poses.csv"):
        assert "# SIMULATED, not for a robot: from" in (out / name).read_text()
    assert '"kind": "simulated"' in (out / "identification.json").read_text()


def test_a_rehearsal_goes_into_a_folder_of_its_own(done, work, monkeypatch):
    monkeypatch.chdir(work)
    before = (work / "touchups.csv").read_bytes()
    done("simulate", "cell.toml", "poses.csv")
    assert (work / "rehearsal" / "touchups.csv").is_file()
    assert (work / "touchups.csv").read_bytes() == before


@pytest.mark.parametrize("made", ["program", "touchups.csv"])
def test_a_plan_that_is_in_use_is_not_replaced(done, refuse, work, made):
    cell, out = work / "cell.toml", work / "out"
    done("plan", cell, "--out", out)
    done("plan", cell, "--out", out)
    if made == "program":
        done("program", out / "poses.csv", "--cell", cell, "--out", out)
        refuse("plan", cell, "--out", out).says("poses.csv belongs to CALIB01.LS")
    else:
        (out / made).write_text("target,j1_deg\nT1,1\n")
        refuse("plan", cell, "--out", out).says("poses.csv belongs to touchups.csv")
    refuse("next", cell, work / "touchups.csv", "--out", out).says("holds planned measuring poses")
    before = (out / "poses.csv").read_bytes()
    text = cell.read_text().replace("start_deg = [5.0, 5.0, 5.0]", "start_deg = [7.0, 7.0, 7.0]")
    cell.write_text(text)
    said = done("plan", cell, "--out", out, "--overwrite")
    assert "poses.csv: what was there is kept as poses.csv.1" in said.err
    assert (out / "poses.csv.1").read_bytes() == before


def test_nothing_of_an_earlier_plan_stays_beside_a_new_one(cli, done, work):
    cell, out = work / "cell.toml", work / "out"
    done("plan", cell, "--out", out)
    said = cli("plan", cell, *OPTIMAL, "--out", out)
    assert f"{out / 'rounds.csv'} was of an earlier time: removed" in said.err
    assert sorted(path.name for path in out.iterdir()) == [
        "plan.png",
        "plan.svg",
        "poses.csv",
        "validation.csv",
    ]
    (out / "validation.csv").write_text((out / "validation.csv").read_text() + "mine\n")
    said = cli("plan", cell, "--out", out)
    assert f"{out / 'validation.csv'} is of an earlier time" in said.err
    names = ["plan.png", "plan.svg", "poses.csv", "rounds.csv", "validation.csv"]
    assert sorted(path.name for path in out.iterdir()) == names


def test_an_edited_result_is_kept(done, refuse, work):
    cell, out = work / "cell.toml", work / "out"
    done("plan", cell, "--out", out)
    edited = (out / "poses.csv").read_text().replace("P14", "mine", 1)
    (out / "poses.csv").write_text(edited)
    refuse("plan", cell, "--out", out).says("was changed since it was written")
    words = ("convert", out / "poses.csv", "--cell", cell, "--out", out / "poses.csv")
    refuse(*words).says("holds planned measuring poses")
    refuse(*words, "--to", "robodk").says("holds planned measuring poses")
