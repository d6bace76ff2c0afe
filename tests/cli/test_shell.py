"""The console script in a process of its own: start, pipes, Ctrl-C, what is imported."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from posedesign.cell import cell_template
from tests.cli.conftest import with_keys

COMMAND = (sys.executable, "-c", "from posedesign.cli.main import main; main()")
SCRIPT = Path(sys.executable).with_name("posedesign")
HEAVY = ("pinocchio", "numpy", "scipy", "pandas", "matplotlib", "cvxpy", "eaik")


def shell(*words: object, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *map(str, words)], capture_output=True, text=True, timeout=60, **options
    )


def modules_after(statement: str) -> set[str]:
    done = subprocess.run(
        [sys.executable, "-c", f"import sys\n{statement}\nprint(*sys.modules, file=sys.stderr)"],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    return {name.partition(".")[0] for name in done.stderr.split()}


def test_help_does_not_wait_for_the_robot_libraries():
    """Nor for click: Typer brings its own since 0.26, and a package nobody asked for may be gone.

    One process for all: what any of them needs, each of them may wait for.
    """
    run = "from posedesign.cli.main import run\n"
    words = ("['--help']", "['plan', '--help']", "['robot-world', '--help']", "['plan']")
    each = ["import posedesign, calib", *(f"{run}run({typed})" for typed in words)]
    assert modules_after("\n".join(each)).isdisjoint((*HEAVY, "click"))
    small = "posedesign.plan\nrun(['robots'])\nrun(['new'])\nrun(['validate', 'none.LS'])"
    small += "\nfrom posedesign.cell import Cell, cell_template"
    small += "\nCell.from_text(cell_template()).model()"
    unused = {"scipy", "pandas", "matplotlib", "cvxpy", "cv2", "joblib"}
    assert modules_after(f"import posedesign\n{run}{small}").isdisjoint(unused)


def test_console_script_answers_with_exit_codes_and_tables_in_a_pipe_are_not_cut(tmp_path):
    words = [SCRIPT] if SCRIPT.exists() else list(COMMAND)
    short = {"variations.largest_deg": "[9, 9, 9]", "measurement.weighted": "false"}
    (tmp_path / "cell.toml").write_text(with_keys(cell_template(), short))
    said = subprocess.run(
        [*words, "plan", "cell.toml", "--verbose"],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=tmp_path,
        # compiled files are where those of the other tests are
        env={name: text for name, text in os.environ.items() if name.startswith("PYTHON")}
        | {"COLUMNS": "40", "PATH": ""},
    )
    assert said.returncode == 1
    assert said.stderr == ""  # all that the cell asks for is checked
    assert "variation limit" in said.stdout
    assert "…" not in said.stdout
    for heading in ("round", "d_w_deg", "repaired", "cond_2_g", "sigma_joint_2_deg"):
        assert heading in said.stdout
    assert "\x1b" not in said.stdout
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "cell.toml",
        "plan.png",
        "plan.svg",
        "poses.csv",
        "rounds.csv",
    ]


def test_error_goes_to_standard_error_alone(tmp_path):
    """Of a path that is no text, too."""
    typed = [*COMMAND, "plan", b"no\xff\x1b.toml"]
    said = subprocess.run(typed, capture_output=True, timeout=60, cwd=tmp_path)
    assert (said.returncode, said.stdout) == (2, b"")
    assert said.stderr.startswith(rb"error: no\udcff\x1b.toml: cannot be read")
    first, *folded = said.stderr.decode().splitlines()
    assert len(first) <= 100
    assert all(line.startswith("  ") and len(line) <= 100 for line in folded)
    assert "Traceback" not in said.stderr.decode()


def test_json_in_a_pipe_is_all_that_is_printed():
    said = shell("study", "list", "--json")
    assert (said.returncode, said.stderr) == (0, "")
    assert json.loads(said.stdout)


def test_reader_that_stops_reading(tmp_path):
    """``posedesign --help | head -1``"""
    with subprocess.Popen(
        [*COMMAND, "--help"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        said = process.stderr.read()
        assert process.wait(timeout=60) == 0
    assert said == b""


@pytest.fixture
def not_reached(tmp_path) -> Path:
    """A cell with a pose that its robot cannot take, and a program that is none: exit code 1."""
    (tmp_path / "cell.toml").write_text(cell_template(surroundings=False))
    joints = ",".join(f"j{k}_deg" for k in range(1, 7))
    name = "P1 red \u202e"
    (tmp_path / "poses.csv").write_text(f"name,{joints}\n{name},0,500,0,0,0,0\n")
    (tmp_path / "bad.LS").write_text("/PROG BAD\n")
    return tmp_path


@pytest.mark.skipif(os.name != "posix", reason="a shell of POSIX")
@pytest.mark.parametrize(
    ("command", "codes"),
    [
        ('"$@" check cell.toml poses.csv | true; echo "${PIPESTATUS[0]}"', "1\n"),
        ('"$@" validate bad.LS --json >&- 2>&- <&-; echo $?', "1\n"),
        ('"$@" plan --nothing 2>&1 | true; echo "${PIPESTATUS[0]}"', "2\n"),
        ('PYTHONIOENCODING=ascii "$@" robots >/dev/null; echo $?', "0\n"),
    ],
)
def test_what_becomes_of_the_output_does_not_change_the_exit_code(not_reached, command, codes):
    said = subprocess.run(
        ["bash", "-c", command, "-", *COMMAND],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=not_reached,
    )
    assert said.stdout == codes
    assert "Traceback" not in said.stderr


def test_names_from_files_steer_no_terminal(cli, not_reached):
    """Marks that turn the direction of writing are shown by their codes; escapes are refused."""
    cell, poses = not_reached / "cell.toml", not_reached / "poses.csv"
    said = cli("check", cell, poses)
    assert said.code == 1
    assert r"P1 red \u202e" in said.out
    poses.write_text(poses.read_text().replace("P1 red \u202e", '"P1 \x1b[31m\nred \x9b1m"'))
    refused = cli("check", cell, poses)
    assert refused.code == 2
    assert r"'P1 \x1b[31m\nred \x9b1m' has a character that cannot be shown" in refused.err
    everything = said.out + said.err + refused.out + refused.err
    assert all(c.isprintable() or c == "\n" for c in everything)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes of POSIX")
def test_ctrl_c_says_stopped_and_leaves_no_half_file(tmp_path):
    folder, pairs = tmp_path / "out", tmp_path / "pairs.csv"
    os.mkfifo(pairs)
    with (
        subprocess.Popen(
            [*COMMAND, "robot-world", pairs, "--out", folder],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            # a shell that runs the tests in the background has its children ignore Ctrl-C
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        ) as process,
        pairs.open("wb"),  # goes on when the other end is open: it reads, and waits for more
    ):
        process.send_signal(signal.SIGINT)
        out, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said == b"stopped\n"
    assert out == b""
    assert not folder.exists() or list(folder.iterdir()) == []
