"""``posedesign plan --method exchange`` and ``posedesign next`` as people type them."""

import csv
import shlex
from pathlib import Path

import pytest

from posedesign.cli import output
from posedesign.cli.main import run
from posedesign.planning.optimal import refinement
from posedesign.planning.optimal.choose import Planning
from posedesign.planning.poses_file import read_poses
from tests.cli.conftest import refusals, strict_json, with_keys

SMALL = {"pool.candidates": "40"}
EXCHANGE = ("--method", "exchange")


@pytest.fixture(autouse=True)
def _few_sweeps(monkeypatch) -> None:
    """What more of them would still gain decides nothing here."""
    monkeypatch.setattr(refinement, "MOST_SWEEPS", 3)


@pytest.fixture
def cell(change_cell) -> Path:
    """The reference cell with a small pool."""
    return change_cell(SMALL)


@pytest.fixture
def of_ten(change_cell) -> Path:
    """The same, poses planned for the ten parameters of the paper."""
    return change_cell(SMALL | {"parameters.planned": '["zero_offsets"]'})


def test_a_plan_out_of_a_pool(cli, cell, tmp_path):
    out = tmp_path / "run"
    said = cli("plan", cell, *EXCHANGE, "--poses", 8, "--validation", 3, "--out", out, "--json")
    assert said.code == 0
    told = strict_json(said.out)
    assert (told["reached"], told["poses"], told["validation"]) == (True, 8, 3)
    assert told["method"] == "exchange"
    found = told["criterion"]
    assert found["unit"] == "mm"
    assert found["value"] == pytest.approx(told["tcp_rms_mm"])
    assert told["refined"] is True
    assert found["value"] < found["of_the_pool"]
    assert found["bound"] <= found["of_the_pool"]
    assert found["efficiency"] == pytest.approx((found["bound"] / found["of_the_pool"]) ** 2)
    assert [other["poses"] for other in told["other_numbers_of_poses"]] == [7, 9]
    fewer, more = (other["tcp_rms_mm"] for other in told["other_numbers_of_poses"])
    assert fewer > found["of_the_pool"] > more
    expected = told["expected_error"]
    assert expected["rms_mm"] == pytest.approx(found["value"], rel=1e-6)
    assert expected["low_mm"] < expected["median_mm"] < expected["high_mm"]
    assert expected["share_of_arms"] == 0.8
    assert told["files"] == [
        str(out / name) for name in ("poses.csv", "validation.csv", "plan.png")
    ]
    # what was written is what was promised
    scored = strict_json(cli("score", cell, out / "poses.csv", "--json").out)
    for name in ("rms_mm", "median_mm", "low_mm", "high_mm"):
        assert expected[name] == pytest.approx(scored["expected_error"][name], rel=1e-4)
    assert told["indices"]["c_g"] == pytest.approx(scored["indices"]["c_g"], rel=1e-4)
    for name in ("poses.csv", "validation.csv"):
        assert strict_json(cli("check", cell, out / name, "--json").out)["feasible"] is True
    names = read_poses(out / "validation.csv", 6).measured.names
    assert sorted(names) == ["V01", "V02", "V03"]
    program = cli("program", out / "poses.csv", "--cell", cell, "--out", out)
    assert program.code == 0
    assert "8 poses" in program.out


def test_deviations_of_ten_parameters_are_scored_as_they_were_planned(cli, of_ten, tmp_path):
    out = tmp_path / "run"
    said = cli("plan", of_ten, *EXCHANGE, "--poses", 8, "--out", out, "--json")
    told = strict_json(said.out)
    scored = strict_json(cli("score", of_ten, out / "poses.csv", "--json").out)
    assert len(told["predicted"]) == 10
    for ours, theirs in zip(told["predicted"], scored["predicted"], strict=True):
        assert ours["parameter"] == theirs["parameter"]
        assert ours["predicted sigma"] == pytest.approx(theirs["predicted sigma"], rel=1e-4)


@pytest.mark.slow
def test_a_plan_reads_well_in_a_narrow_terminal(cli, cell, tmp_path, monkeypatch):
    monkeypatch.setattr(output, "PIPE_WIDTH", 80)
    for words in ((), ("--criterion", "D"), ("--criterion", "sigma:zero_offset.joint_2")):
        out = tmp_path / "run"
        said = cli("plan", cell, *EXCHANGE, "--poses", 8, *words, "--out", out)
        assert said.code == 0
        drawn = [line for line in said.out.splitlines() if line[:1] in "┏┃┡│└"]
        assert max(map(len, drawn)) <= 80
        assert "8 poses, " in said.out
        assert "proven: no 8 poses of the pool are " in said.out
        assert "8, refined" in said.out
        assert "nan" not in said.out.lower()
        assert f"\nwrote: {out / 'poses.csv'}, " in said.out


def test_as_many_poses_as_there_is_time_for(cli, cell, tmp_path):
    """The round takes no longer, one pose more would, and two minutes more buy accuracy."""
    said = cli("plan", cell, "--minutes", 5, "--no-refine", "--out", tmp_path / "run", "--json")
    assert said.code == 0
    told = strict_json(said.out)
    assert told["cycle_time_s"] <= 300.0
    one_more = (*EXCHANGE, "--poses", told["poses"] + 1, "--no-refine")
    longer = strict_json(cli("plan", cell, *one_more, "--out", tmp_path / "more", "--json").out)
    assert longer["cycle_time_s"] > 300.0
    fewer, more = told["other_numbers_of_poses"]
    assert fewer["poses"] + 3 <= told["poses"] <= more["poses"] - 3
    assert fewer["tcp_rms_mm"] > told["tcp_rms_mm"] > more["tcp_rms_mm"]
    shown = cli("plan", cell, "--minutes", 5, "--no-refine", "--out", tmp_path / "run")
    text = " ".join(shown.out.split())
    assert f"{told['poses']} poses, " in text
    assert "of 5 min" in text
    assert "2 min more" in text


def test_the_fewest_poses_for_an_accuracy_of_the_tool_point(cli, cell, tmp_path):
    accuracy = ("--target-accuracy", "0.2mm")
    said = cli("plan", cell, "--poses", "auto", *accuracy, "--out", tmp_path / "run", "--json")
    assert said.code == 0
    told = strict_json(said.out)
    assert told["tcp_worst_rms_mm"] <= 0.2
    assert told["criterion"]["wanted"] == pytest.approx(0.2)
    assert told["at_least"] <= told["poses"]
    assert told["other_numbers_of_poses"][0]["tcp_worst_rms_mm"] > 0.2
    assert told["message"].startswith(f"{told['poses']} poses reach tcp-worst ")
    assert "0.2 mm is wanted" in told["message"]
    assert "proven: fewer" in told["message"]


@pytest.mark.parametrize("ten", [True, False])
def test_out_of_reach_is_valid_json_too(cli, cell, change_cell, tmp_path, ten):
    """More measurements help ten parameters; no touch-up shows how long the arm is."""
    cell = change_cell(SMALL | {"parameters.planned": '["zero_offsets"]'}) if ten else cell
    said = cli("plan", cell, "--target-accuracy", "1um", "--out", tmp_path / "run", "--json")
    assert said.code == 1
    told = strict_json(said.out)
    assert (told["reached"], told["files"], told["cycle_time_s"]) == (False, [], None)
    assert "out of reach: all " in told["message"]
    assert ("each would have to be measured" in told["message"]) == ten
    assert not (tmp_path / "run").exists()


def test_a_condition_number_needs_no_noise(cli, change_cell, tmp_path, rendered):
    cell = change_cell(SMALL | {"measurement.weighted": "false"})
    words = ("--criterion", "c_g", "--poses", 8, "--no-refine", "--out", tmp_path / "run", "--json")
    told = strict_json(cli("plan", cell, *words).out)
    assert told["criterion"]["name"] == "C_G"
    assert told["criterion"]["value"] == pytest.approx(told["indices"]["c_g"])
    assert (tmp_path / "run" / "plan.png").stat().st_size > 5_000


@pytest.mark.parametrize(
    ("words", "said"),
    refusals(r"""
--method exchagne => no method 'exchagne' | did you mean exchange?
--method '' => no method '' | exchange
--method fisher => no method 'fisher' | known: wpr, exchange, detmax
--criterion tpc => no criterion 'tpc' | did you mean tcp?
--criterion Q => no criterion 'Q' | known: tcp, tcp-worst, sigma:NAME, D
--criterion sigmoid => no criterion 'sigmoid'
--criterion sigma => none is named | such as sigma:zero_offset.joint_1
--criterion sigma: => none is named
--criterion sigma:zero_offset.joint2 =>
  no parameter 'zero_offset.joint2' | did you mean zero_offset.joint_2
--poses 0 => 0 poses | 1 to 1000, or auto
--poses -3 => '-3' is no number of poses | give a number, or auto
--poses 1e9 => '1e9' is no number of poses
--poses 99999999999999 => is no number of poses
--poses abc => 'abc' is no number of poses
--poses '' => '' is no number of poses
--poses auto => none is given | --target-accuracy 0.2mm
--target-accuracy 0 => '0' is no accuracy | such as 0.2mm
--target-accuracy nan => 'nan' is no accuracy
--target-accuracy -1mm => '-1mm' is no accuracy
--target-accuracy '5 parsecs' => '5 parsecs' is no accuracy
--target-accuracy 0,2mm => '0,2mm' is no accuracy
--target-accuracy 1e400mm => is no accuracy
--threshold 0 => threshold is not above zero | give a number from 1e-12
--threshold nan => threshold is not above zero
--threshold inf => threshold is not above zero and finite
--threshold many => '--threshold' | --help
--criterion C_G --poses 27 --threshold 850 => no set of 27 poses from this pool can be below 850
--target-accuracy 1mm --criterion D => --criterion and --target-accuracy are two things | give one
--target-accuracy 1mm --wanted-sigma-deg 1 =>
  --target-accuracy and --wanted-sigma-deg are two things
--target-accuracy 1mm --threshold 1 =>
  --threshold is a value of --criterion, and --target-accuracy is one of its own
--method wpr --poses 5 => --poses does not go with --method wpr | --method exchange
--method WPR --validation 5 => --validation does not go with
--method wpr --keep poses.csv => --keep does not go with
--minutes 5 --poses 5 => --minutes decides | --poses
--minutes 5 --target-accuracy 0.1mm => so does --target-accuracy
--minutes 0.5 => 0.5 min are not enough: 4 poses | min (allow more time
--minutes 0 => the time is not above zero
--minutes 5 --method wpr => --minutes does not go with
--method exchange --validation -1 => -1 poses for validation | 0 to 1000
--method exchange --robust wurst => no robustness 'wurst' | worst
--wanted-sigma-mm 0 => wanted standard deviation is not above zero
--wanted-sigma-mm nan => wanted standard deviation is not above zero
"""),
)
def test_mistyped_plans(refuse, cell, tmp_path, words, said):
    refuse("plan", cell, *shlex.split(words[0]), "--out", tmp_path / "out").says(*said)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"measurement.weighted": "false"}, ("measurement.weighted = true",)),
        ({"pool.tilt": "40"}, ("key pool.tilt", "did you mean tilt_deg?")),
        ({"pool.tilt_deg": "0"}, ("key pool.tilt_deg", "greater than 0")),
        ({"pool.tilt_deg": "181"}, ("key pool.tilt_deg", "180")),
        ({"pool.tilt_deg": "nan"}, ("key pool.tilt_deg",)),
        ({"pool.kind": '"cones"'}, ("key pool.kind", "'cone'")),
        ({"pool.kind": '"joints"'}, ("do not touch the target", 'pool.kind = "cone"')),
        ({"pool.configurations": '"back"'}, ("key pool.configurations", "'front'")),
        ({"pool.candidates": "0"}, ("key pool.candidates",)),
        ({"pool.candidates": "1"}, ("cannot identify", "is absorbed by the tool point")),
        ({"pool.candidates": "10"}, ("27 poses of", "candidates")),
        ({"pool.seed": "-1"}, ("key pool.seed",)),
    ],
    ids=lambda value: ", ".join(value) if isinstance(value, dict) else "",
)
def test_cells_that_cannot_be_planned_for(refuse, change_cell, keys, said):
    path = change_cell(SMALL | keys)
    refuse("plan", path, *EXCHANGE, "--out", path.parent / "out").says(*said)


@pytest.mark.slow
def test_a_plan_that_is_stopped_leaves_the_last_one_whole(cli, cell, tmp_path, monkeypatch):
    out = tmp_path / "run"
    words = ("plan", cell, *EXCHANGE, "--poses", 8, "--validation", 2, "--out", out)
    assert cli(*words).code == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}

    def stop(*given: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Planning, "_with_validation", stop)
        said = cli(*words[:4], "--poses", 9, *words[6:])
    assert (said.code, said.err.splitlines()[-1]) == (output.STOPPED, "stopped")
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    assert cli(*words).code == 0  # and again: the same files
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_own_poses_are_among_the_chosen(cli, cell, work):
    rows = (work / "poses.csv").read_text().splitlines()
    (work / "own.csv").write_text("\n".join(rows[:3]) + "\n")
    said = cli("plan", cell, "--poses", 8, "--keep", work / "own.csv", "--out", work / "run")
    assert said.code == 0
    own = read_poses(work / "own.csv", 6).measured.postures
    q = read_poses(work / "run" / "poses.csv", 6).measured.postures
    assert len(q) == 8
    for posture in own:
        assert abs(q - posture).max(axis=1).min() < 1e-6


@pytest.fixture(scope="module")
def measured_once(_work, tmp_path_factory) -> str:
    """The table of six touch-ups, planned and simulated."""
    out = tmp_path_factory.mktemp("first")
    cell, poses = out / "cell.toml", out / "poses.csv"
    cell.write_text(with_keys((_work / "cell.toml").read_text(), SMALL))
    assert run(["plan", str(cell), *EXCHANGE, "--poses", "6", "--out", str(out)]) == 0
    assert run(["simulate", str(cell), str(poses), "--out", str(out)]) == 0
    return (out / "touchups.csv").read_text()


@pytest.fixture
def measured(measured_once, tmp_path) -> Path:
    """A file with six touch-ups, simulated."""
    path = tmp_path / "first" / "touchups.csv"
    path.parent.mkdir()
    path.write_text(measured_once)
    return path


def test_rounds_of_next_go_on_until_they_stop(cli, of_ten, measured, tmp_path):
    """Plan a few, touch up, and so on: each time with all touch-ups so far in one file."""
    every, errors = tmp_path / "all.csv", []
    every.write_text(measured.read_text())
    for turn in range(12):
        out = tmp_path / f"turn{turn}"
        said = cli("next", of_ten, every, "--least-gain", 0.04, "--out", out, "--json")
        assert said.code == 0
        told = strict_json(said.out)
        assert told["identified"] is True
        errors.append(told["tcp_rms_mm"][0] / told["noise_scale"])
        if not told["go_on"]:
            break
        assert told["poses"] == [f"P{told['measured'] + k:02d}" for k in (1, 2, 3)]
        assert told["files"] == [str(out / "poses.csv")]
        simulated = ("simulate", of_ten, out / "poses.csv", "--seed", turn, "--out", out)
        assert cli(*simulated).code == 0
        rows = (out / "touchups.csv").read_text().splitlines()[2:]
        every.write_text(every.read_text() + "\n".join(rows) + "\n")
    assert told["go_on"] is False
    assert told["message"].startswith("stop: ")
    assert 6 < told["measured"] <= 30  # one of n of a kind gains 1 / (2 n)
    assert errors == sorted(errors, reverse=True)


def test_next_before_everything_is_identified(cli, cell, measured):
    lines = measured.read_text().splitlines()[1:]
    measured.write_text("\n".join(lines[:3]) + "\n")
    said = cli("next", cell, measured, "--poses", 4, "--out", measured.parent / "next")
    assert said.code == 0
    assert "go on: 2 touch-ups do not yet identify everything" in said.out
    last = max(line.split(",")[-1] for line in lines[1:3])  # as the way leads, not as numbered
    assert f"P{int(last[1:]) + 1:02d}" in said.out
    told = strict_json(cli("next", cell, measured, "--out", measured.parent / "next", "--json").out)
    assert told["identified"] is False
    assert "cannot identify target.T1" in told["why_not"]


def test_next_before_ten_parameters_are_identified(cli, of_ten, measured):
    measured.write_text("\n".join(measured.read_text().splitlines()[1:4]) + "\n")
    next_to = measured.parent / "next"
    told = strict_json(cli("next", of_ten, measured, "--out", next_to, "--json").out)
    assert told["identified"] is False
    assert "6 equations for 10 parameters" in told["why_not"]


def test_next_says_when_the_accuracy_is_reached(cli, cell, measured):
    said = cli(
        "next", cell, measured, "--target-accuracy", "5mm", "--out", measured.parent / "next"
    )
    assert said.out.count("stop: tool point known to") == 1
    assert "5 mm is reached" in said.out


@pytest.mark.parametrize(
    ("words", "said"),
    refusals(r"""
--least-gain 0 => a least gain of 0 | between 0 and 1
--least-gain 1 => a least gain of 1
--least-gain 2 => a least gain of 2
--least-gain nan => a least gain of nan
--least-gain some => '--least-gain' | --help
--target-accuracy 0 => '0' is no accuracy | such as 0.2mm
--target-accuracy soon => 'soon' is no accuracy
--poses 0 => '--poses' | --help
--poses 101 => '--poses' | --help
--poses auto => '--poses' | --help
--criterion tpc => no criterion 'tpc' | did you mean tcp?
--criterion sigma => none is named
"""),
)
def test_mistyped_nexts(refuse, cell, work, words, said):
    typed = (work / "touchups.csv", *shlex.split(words[0]))
    refuse("next", cell, *typed, "--out", work / "out").says(*said)


def test_files_that_next_cannot_use(refuse, cell, work):
    out = ("--out", work / "out")
    refuse("next", cell, work / "none.csv", *out).says("cannot be read")
    (work / "empty.csv").write_text("")
    refuse("next", cell, work / "empty.csv", *out).says("has no rows")
    rows = list(csv.reader((work / "touchups.csv").read_text().splitlines()))
    (work / "header.csv").write_text(",".join(rows[0]) + "\n")
    refuse("next", cell, work / "header.csv", *out).says("has no rows")
    refuse("next", cell, work / "poses.csv", *out).says("planned poses", "simulate")
    refuse("next", cell, work / "pairs.csv", *out).says("no column target")
    k = rows[0].index("target")
    for i, row in enumerate(rows[1:]):
        row[k] = "AB"[i % 2]
    (work / "two.csv").write_text("\n".join(map(",".join, rows)) + "\n")
    refuse("next", cell, work / "two.csv", *out).says("of one target", "A, B", "leave out")


def test_next_is_of_touch_ups(refuse, change_cell, work):
    path = change_cell({"measurement.kind": '"camera-pose"'})
    refuse("next", path, work / "touchups.csv", "--out", work / "out").says(
        "camera", 'measurement.kind = "touch-up"'
    )


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["irb120", "gp7", "panda"])
def test_small_arms_and_a_redundant_one(cli, tmp_path, robot):
    text = cli("new", "--robot", robot).out
    path = tmp_path / "cell.toml"
    path.write_text(text.replace("candidates = 1500", "candidates = 40"))
    out = tmp_path / "run"
    assert cli("plan", path, *EXCHANGE, "--poses", 8, "--out", out).code == 0
    assert strict_json(cli("check", path, out / "poses.csv", "--json").out)["feasible"] is True
