"""Files damaged at random, and hostile options: never a traceback, a warning, or two errors."""

import os
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from posedesign.cli.main import run
from tests.cli.conftest import arm_urdf

CASES = 8
"""Of each kind of file: seconds in all. The same with some thousands is run by hand."""

NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
HOSTILE_NUMBERS = (
    *(b"0", b"-0", b"nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e-320", b"1e999", 400 * b"9"),
    *(b"99999999999999999999", b"1e15", b"-1", b"true", b"null", b'""', b"[]", b"1_0", b"1e12"),
)
HOSTILE_TEXTS = (
    *(b"\0", b"\x1b[31m", b"\n", b'"', b"'", b",", b"#", b"\xff\xfe", b"[", b"{", b"<", b"-"),
    *("\u202e".encode(), "\x9b1m".encode(), b"$x^_", b"=" * 50, b"n" * 3000),
)
HOSTILE_OPTIONS = (
    *("", " ", "-1", "9" * 20, "9" * 400, "nan", "inf", "1e308", "1e-320", "x" * 5000, "a:=b"),
    *("a\x1b[31m\nb\u202e", "\udcff", "/dev/null", "none/such", "nan,nan,nan,1,1,1", "1e308mm"),
)

FILES = {
    "cell.toml": ("check", "cell.toml", "poses.csv"),
    "poses.csv": ("check", "cell.toml", "poses.csv"),
    "touchups.csv": ("identify", "small.toml", "touchups.csv", "--out", "out"),
    "pairs.csv": ("robot-world", "pairs.csv", "--method", "shah", "--out", "out"),
    "identification.json": ("correct", "small.toml", "identification.json", "--out", "out"),
    "arm.urdf": ("new", "--robot", "arm.urdf"),
    "part.stl": ("check", "mesh.toml", "poses.csv"),
    "CALIB01.LS": ("validate", "CALIB01.LS"),
    "ros.yaml": ("import", "cell.toml", "ros.yaml", "--out", "out"),
}
OPTIONS = (
    ("new", "--robot"),
    ("new", "--robot", "arm.urdf", "--xacro-arg"),
    ("new", "--robot", "arm.urdf", "--packages"),
    ("plan", "cell.toml", "--threshold"),
    ("plan", "cell.toml", "--target-accuracy"),
    ("plan", "cell.toml", "--poses"),
    ("plan", "cell.toml", "--wanted-sigma-deg"),
    ("simulate", "cell.toml", "poses.csv", "--seed"),
    ("check", "cell.toml"),
    ("program", "poses.csv", "--format"),
    ("program", "poses.csv", "--format", "fanuc-ls", "--out", "out", "--name"),
    ("import", "cell.toml"),
    ("correct", "cell.toml"),
    ("predict", "cell.toml", "poses.csv", "--box"),
    ("robot-world", "pairs.csv", "--method"),
    ("robot-world", "pairs.csv", "--out", "out", "--noise-mm", "1", "--noise-deg"),
    ("study", "run", "peers", "--trials"),
    ("study", "accuracy", "cell.toml", "--draws"),
    ("study", "plot"),
)

FACET = (
    "facet normal 0 0 1\nouter loop\nvertex {} 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
)


@pytest.fixture(scope="module")
def damaged(_work, tmp_path_factory) -> Path:
    """A folder with a file of every kind, whole."""
    folder = tmp_path_factory.mktemp("whole")
    for name in ("cell.toml", "poses.csv", "touchups.csv", "pairs.csv"):
        shutil.copy(_work / name, folder / name)
    text = (folder / "cell.toml").read_text()
    models = re.compile(r"\nmodels = \[.*?\n\]", re.DOTALL)
    small = models.sub("\nmodels = [['zero_offsets']]", text)
    (folder / "small.toml").write_text(small)
    mesh = (
        '\n[[obstacle]]\nname = "m"\nkind = "mesh"\nmesh = "part.stl"\nat_mm = [0.0, 0.0, -9e3]\n'
    )
    (folder / "mesh.toml").write_text(text + mesh)
    facets = "".join(map(FACET.format, range(3)))
    (folder / "part.stl").write_text(f"solid a\n{facets}endsolid a\n")
    (folder / "arm.urdf").write_text(arm_urdf())
    cell, out = str(folder / "cell.toml"), str(folder)
    for form in ("fanuc-ls", "ros-trajectory"):
        words = ("program", folder / "poses.csv", "--cell", cell, "--format", form, "--out", out)
        assert run(list(map(str, words))) in (0, 1)
    (folder / "CALIB01.yaml").rename(folder / "ros.yaml")
    words = ("identify", folder / "small.toml", folder / "touchups.csv", "--out", out)
    assert run(list(map(str, words))) in (0, 1)
    return folder


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """The content with a number, some bytes or a line changed."""
    for _ in range(rng.choice([1, 1, 1, 3])):
        how = rng.integers(8)
        numbers = list(NUMBER.finditer(data))
        start = int(rng.integers(len(data) + 1))
        if how <= 3 and numbers:
            found = numbers[rng.integers(len(numbers))]
            new = HOSTILE_NUMBERS[rng.integers(len(HOSTILE_NUMBERS))]
            data = data[: found.start()] + new + data[found.end() :]
        elif how == 4:
            data = data[:start] + data[start + int(rng.choice([1, 5, 50, 10**6])) :]
        elif how == 5:
            data = data[:start] + HOSTILE_TEXTS[rng.integers(len(HOSTILE_TEXTS))] + data[start:]
        elif how == 6:
            data = data[:start] + bytes([rng.integers(256)]) + data[start + 1 :]
        else:
            lines = data.split(b"\n")
            a, b = rng.integers(len(lines), size=2)
            lines[a], lines[b] = lines[b], lines[a]
            data = b"\n".join(lines)
    return data


def check(said: Any, words: object) -> None:
    """One line where it was refused, and nothing that a terminal obeys."""
    assert said.code in (0, 1, 2), words
    errors = [line for line in said.err.splitlines() if line.startswith("error: ")]
    assert len(errors) == (said.code == 2), (words, said.err)
    assert "Traceback" not in said.err + said.out
    assert all(c.isprintable() or c == "\n" for c in said.err + said.out), words
    assert all(len(line) < 2000 for line in errors), words


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_a_damaged_file(cli, damaged, tmp_path, monkeypatch, name):
    rng = np.random.default_rng(sorted(FILES).index(name))
    whole = (damaged / name).read_bytes()
    for case in range(CASES):
        folder = tmp_path / str(case)
        shutil.copytree(damaged, folder)
        monkeypatch.chdir(folder)
        (folder / name).write_bytes(mutated(whole, rng))
        check(cli(*FILES[name]), (name, case))


@pytest.mark.parametrize("share", [0.25, pytest.param(1.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("words", OPTIONS, ids=" ".join)
def test_a_hostile_option(cli, damaged, tmp_path, monkeypatch, words, share):
    """A quarter of the values for each option, another one for the next; all of them when slow."""
    shutil.copytree(damaged, tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")
    every = round(1 / share)
    for value in HOSTILE_OPTIONS[OPTIONS.index(words) % every :: every]:
        check(cli(*words, value), (*words, value[:40]))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes of POSIX")
def test_a_pipe_in_place_of_a_file(cli, damaged, tmp_path, monkeypatch):
    monkeypatch.setattr("calib.limited.PATIENCE_S", 0.05)
    for name, words in FILES.items():
        folder = tmp_path / name
        shutil.copytree(damaged, folder)
        monkeypatch.chdir(folder)
        (folder / name).unlink()
        os.mkfifo(folder / name)
        said = cli(*words)
        assert said.code == 2, (name, said)
        check(said, name)
