"""What commands say at a glance: few lines that fit, the verdict first, the next command last."""

from __future__ import annotations

import os
import shlex

import pytest

from posedesign.cli.main import run
from posedesign.report.answer import MOST_LINES, WIDTH
from tests.cli.conftest import with_compliance

COMMANDS = {
    "plan cell.toml --out o": "threshold reached: C_G ",
    "check cell.toml poses.csv": "27 poses: 0 cannot be taken; 0 motions",
    "score cell.toml poses.csv": "C_G 9.719e+04 is below 1e+05",
    "program poses.csv --cell cell.toml --out o": "27 poses, 0 objections to the program",
    "identify cell.toml touchups.csv --out o": "recommended: offsets + compliance",
    "next cell.toml touchups.csv --out o": "go on: tool point known to ",
    "robot-world pairs.csv --out o": "solved: A X = Z B by ml from 27 of 27 pairs",
}
AFTER = {"plan": "program", "identify": "correct", "next": "program"}


@pytest.mark.parametrize("words", COMMANDS)
def test_answers_fit_a_glance(words, work, capsys, monkeypatch):
    monkeypatch.chdir(work)
    with_compliance(work / "cell.toml")
    capsys.readouterr()
    assert run(words.split()) == 0
    said = capsys.readouterr()
    lines = said.out.splitlines() + said.err.splitlines()
    assert len(lines) <= MOST_LINES, lines
    assert max(map(len, lines)) <= WIDTH
    assert said.out.startswith(COMMANDS[words])
    name = words.split()[0]
    if name in AFTER:
        last = said.out.splitlines()[-1]
        assert last.startswith(f"next: posedesign {AFTER[name]} ")
        files = [word for word in shlex.split(last)[3:] if "." in word]
        assert all(os.path.isfile(file) for file in files)
