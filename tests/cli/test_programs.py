"""Programs from the command line: written for any controller, validated, and brought back."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.robots import Robot
from posedesign.programs import DIALECTS, Arm
from tests.cli.conftest import offsets_only

ChangeCell = Callable[[Mapping[str, str]], Path]
Cli = Callable[..., Any]
Refuse = Callable[..., Any]

FANUC = Arm.usual("fanuc")


def touch_up(program: Path, touchups: Path, poses: Path) -> list[str]:
    """Re-teach the positions of a FANUC program as the simulated robot touched them up."""
    text = program.read_bytes().decode()
    with touchups.open() as file:
        found = {
            row["pose"]: [float(row[f"j{j}_deg"]) for j in (1, 2, 3, 4, 5, 6)]
            for row in csv.DictReader(line for line in file if not line.startswith("#"))
        }
    with poses.open() as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        names = [row["name"] for row in rows if row["status"] not in ("via", "dropped")]
    for number, name in enumerate(names, start=1):
        shown = FANUC.shown(np.deg2rad(found[name]))
        start = text.index(f'P[{number}:"{name}"]')
        end = text.index("};", start)
        body = text[start:end]
        for j, value in enumerate(shown, start=1):
            body = re.sub(rf"J{j}=\s*\S+ deg", f"J{j}= {value:.3f} deg", body)
        text = text[:start] + body + text[end:]
    program.write_bytes(text.encode())
    return names


def test_the_way_there_and_back(cli: Cli, done: Cli, work: Path) -> None:
    """What comes back from the program is what was touched up, and identifies the same robot."""
    cell, poses = offsets_only(work / "cell.toml"), work / "poses.csv"
    out = work / "out"
    said = done("program", poses, "--cell", cell, "--out", out)
    planned, written = map(float, re.findall(r"(?:planned|written) (\S+?),?(?:\s|$)", said.out))
    assert written == pytest.approx(planned, rel=0.01)
    refused = cli("import", cell, out / "CALIB01.LS", "--poses", poses, "--out", out)
    assert (refused.code, refused.out) == (2, "")
    assert "no position differs from the plan: none was touched up" in refused.err
    names = touch_up(out / "CALIB01.LS", work / "touchups.csv", poses)
    done("validate", out / "CALIB01.LS")
    back = done("import", cell, out / "CALIB01.LS", "--poses", poses, "--out", out)
    assert re.search(r"stored to 0.001 deg: that moves the tool point by 0\.0\d+ mm", back.err)
    assert back.out.startswith("How far")
    assert "27 touch-ups" in back.out
    assert f"wrote: {out / 'touchups.csv'}" in back.out
    with (out / "touchups.csv").open() as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    assert [row["pose"] for row in rows] == names
    found = [
        cli("identify", cell, path, "--out", out, "--json").out
        for path in (work / "touchups.csv", out / "touchups.csv")
    ]
    models = [json.loads(text)["models"][1]["parameters"] for text in found]
    off = [abs(a["value"] - b["value"]) / a["sigma"] for a, b in zip(*models, strict=True)]
    assert max(off) < 3.0  # the program's third decimal is as large as the noise
    assert max(off[:4]) > 0.0


def test_import_says_what_it_did_as_json(cli: Cli, done: Cli, work: Path) -> None:
    cell, poses, program = work / "cell.toml", work / "poses.csv", work / "CALIB01.LS"
    done("program", poses, "--cell", cell, "--out", work)
    names = touch_up(program, work / "touchups.csv", poses)
    text = program.read_text()
    text = text.replace(text[text.index("P[27:") : text.index("P[28:")], "", 1)
    program.write_text(re.sub(r" *\d+:J P\[27\].*\n", "", text))
    said = json.loads(
        cli("import", cell, program, "--poses", poses, "--out", work / "back", "--json").out
    )
    assert said["missing"] == [names[26]]
    assert said["untouched"] == []
    assert len(said["warnings"]) == 1  # of the rounding
    assert len(said["moved_mm"]) == said["touch_ups"] == 26
    assert 0.0 < max(said["moved_mm"]) < 20.0


def test_a_program_of_another_plan(done: Cli, refuse: Refuse, work: Path) -> None:
    cell, poses = work / "cell.toml", work / "poses.csv"
    done("program", poses, "--cell", cell, "--out", work)
    lines = poses.read_text().splitlines()
    poses.write_text("\n".join([*lines[:-2], lines[-1]]) + "\n")
    line = refuse("import", cell, work / "CALIB01.LS", "--poses", poses, "--out", work / "back")
    line.says("was written from the plan", "the poses are the plan", "name the poses.csv")


@pytest.mark.parametrize("dialect", DIALECTS)
def test_formats_are_those_of_the_library(dialect: str, cli: Cli, done: Cli, work: Path) -> None:
    """Without a cell each has what it needs, but the pulses of a Yaskawa, and a seventh joint."""
    poses = work / "poses.csv"
    poses.write_text(f"# controller: {DIALECTS[dialect].maker or 'fanuc'}\n" + poses.read_text())
    words = ("program", poses, "--format", dialect, "--out", work / "out")
    said = cli(*words)
    if dialect == "yaskawa-jbi":
        assert said.code == 2
        assert all(f" {axis}" in said.err for axis in "SLURBT"), said.err
        return
    if dialect == "franky-python":
        assert said.code == 2
        assert "has 6 joint values, an arm of franka has 7" in said.err
        return
    assert said.code == 0
    files = [path for path in (work / "out").rglob("*") if path.is_file()]
    checked = [path for path in files if path.suffix.lower() in DIALECTS[dialect].suffixes]
    assert checked
    done("validate", *checked, "--format", dialect)


def test_what_a_format_takes_for_granted_is_said(done: Cli, work: Path) -> None:
    """Not in the program alone: nobody has compared the signs of a MELFA's joints."""
    words = ("--cell", work / "cell.toml", "--format", "mitsubishi-melfa", "--out", work)
    said = done("program", work / "poses.csv", *words)
    assert "not checked: signs of the joints" in said.out


def test_validate_says_line_and_rule(cli: Cli, done: Cli, work: Path) -> None:
    path = work / "CALIB01.LS"
    done("program", work / "poses.csv", "--format", "fanuc-ls", "--out", work)
    path.write_bytes(path.read_bytes().replace(b"CALL MEASURE(3)", b"CALL MEASURE(-3)"))
    said = cli("validate", path)
    assert said.code == 1
    verdict, problem = said.out.splitlines()
    assert verdict == f"{path}: FANUC teach pendant program in ASCII: 1 problem(s)"
    assert re.fullmatch(r"- line \d+: .* \[negative-argument\]", problem)
    answer = json.loads(cli("validate", path, "--json").out)
    assert (answer["valid"], answer["files"][0]["format"]) == (False, "fanuc-ls")
    assert answer["files"][0]["problems"][0]["rule"] == "negative-argument"


def test_validate_says_the_verdict_first_and_all_rows_on_request(glance: Cli, work: Path) -> None:
    path = work / "list.csv"
    path.write_text("1,2,3,4,5,6,text\n" * 40)
    short = glance("validate", path).out.splitlines()
    assert short[0].endswith("40 problem(s) that a controller would refuse")
    assert len(short) <= 12
    assert short[-1] == "- and 31 more: see --verbose"
    assert len(glance("validate", path, "--verbose").out.splitlines()) == 41


def test_validate_of_what_is_no_program(done: Cli, refuse: Refuse, work: Path) -> None:
    refuse("validate", work / "cell.toml").says("no controller's programs end in .toml")
    refuse("validate", work / "none.LS").says("none.LS", "cannot be read")
    done("plan", work / "cell.toml", "--out", work / "run")
    refuse("validate", work / "run" / "poses.csv").says("holds measuring poses", "posedesign check")
    (work / "x.yaml").write_text("a: 1\n")
    refuse("validate", work / "x.yaml").says("x.yaml", "is none of", "--format")


def test_what_the_cell_says_is_in_the_program(done, change_cell, work):
    cell = change_cell(
        {
            "program.measure_argument": "5",
            "program.measure_output": "12",
            "program.measure_pulse_s": "0.2",
            "program.keep": '"register"',
            "program.first_register": "11",
            "program.form": '"cartesian"',
        }
    )
    done("program", work / "poses.csv", "--cell", cell, "--out", work)
    text = (work / "CALIB01.LS").read_text()
    for word in ("DO[12]=PULSE,0.2sec", "CALL MEASURE(5)", "PR[37]=LPOS", "CONFIG : 'N U T, 0, 0"):
        assert word in text
    assert "J1=" not in text
    done("program", work / "poses.csv", "--cell", cell, "--form", "joint", "--out", work)
    assert "J1=" in (work / "CALIB01.LS").read_text()


def test_a_pose_that_breaks_a_coupled_limit_is_named(cli: Cli, work: Path) -> None:
    """Joints 2 and 3 inside their own limits, and too far apart for the FANUC's J3."""
    robot = Robot.preset("r2000ic165f")
    lines = (work / "poses.csv").read_text().splitlines()
    (coupled,) = robot.coupled_limits
    q = np.deg2rad([0.0, -55.0, 178.0, 0.0, -50.0, 0.0])
    assert (robot.lower <= q).all()
    assert (q <= robot.upper).all()
    assert coupled.margin(q) < 0
    row = next(i for i, line in enumerate(lines) if not line.startswith("#")) + 1
    cells = lines[row].split(",")
    first = lines[row - 1].split(",").index("j1_deg")
    cells[first : first + 6] = [f"{value:g}" for value in np.rad2deg(q)]
    (work / "poses.csv").write_text("\n".join([*lines[:row], ",".join(cells), *lines[row + 1 :]]))
    said = cli("program", work / "poses.csv", "--cell", work / "cell.toml", "--out", work / "out")
    assert said.code == 2
    assert cells[0] in said.err
    assert coupled.name in said.err


def test_an_approach_is_put_before_each_pose(done: Cli, work: Path) -> None:
    words = ("program", work / "poses.csv", "--cell", work / "cell.toml", "--out", work)
    done(*words, "--approach-deg", "1")
    moves = re.findall(r"J P\[(\d+)\]|CALL MEASURE\((\d+)\)", (work / "CALIB01.LS").read_text())
    calls = [i for i, (_, call) in enumerate(moves) if call]
    assert len(calls) == 27
    assert all(int(moves[i - 2][0]) > 27 for i in calls)
