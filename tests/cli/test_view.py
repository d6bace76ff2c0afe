"""``posedesign view`` as a person types it."""

import os
import re
import signal
import subprocess
import sys
import urllib.request

import numpy as np
import pytest

from calib.se3 import inverse
from posedesign.cell import Cell
from posedesign.files import Results
from posedesign.hand_eye.pairs import Pairs, write_pairs

pytest.importorskip("viser", reason="needs viser (posedesign[view])")

POSES = (
    "name,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg\nP1,0,15,-25,0,-50,10\nP2,5,15,-25,0,-50,0\n"
)


BAD = "2 poses: 1 cannot be taken; 0 motions between them not clear; 2 off the target"
"""What is to be said of the poses."""


@pytest.fixture
def files(cli, tmp_path):
    cell, poses = tmp_path / "cell.toml", tmp_path / "poses.csv"
    cell.write_text(cli("new").out)
    poses.write_text(POSES)
    return cell, poses


def test_view_writes_one_file(cli, done, files, tmp_path):
    page = tmp_path / "scene.html"
    said = cli("view", *files, "--out", page)
    assert (said.code, said.out) == (0, f"{BAD}\nwrote {page}\n")
    text = page.read_text(encoding="utf-8")
    assert text.startswith(
        "<!doctype html>\n<!-- origin: planned scene in 3-D by view from cell.toml ("
    )
    assert '"2: P2"' in text
    done("view", files[0], "--out", page)  # its own file
    page.write_text(text + " ")
    refused = cli("view", *files, "--out", page)
    assert refused.code == 2
    assert "was changed since it was written" in refused.err


def test_view_shows_measured_pairs(cli, files, tmp_path):
    cell = Cell.load(files[0])
    flanges = cell.robot.fk(cell.base_posture + np.random.default_rng(1).normal(0, 0.2, (5, 6)))
    B = inverse(cell.T_base_target) @ flanges @ cell.T_tip_camera
    (pairs,) = Results(tmp_path, "simulate").claim("simulated", ("pairs.csv", "pairs"))
    write_pairs(pairs, Pairs(("P1", "P2", "P3", "P4", "P5"), flanges, B))
    page = tmp_path / "scene.html"
    said = cli("view", *files, "--pairs", pairs, "--out", page)
    assert (said.code, said.out) == (0, f"{BAD}\nwrote {page}\n")
    assert said.err.startswith("SIMULATED, not for a robot: from ")
    assert page.read_text().startswith(
        "<!doctype html>\n<!-- origin: simulated scene in 3-D by view from "
    )


def test_view_refuses_poses_of_another_arm(cli, files):
    files[1].write_text("name,j1_deg,j2_deg\nP1,10,20\n")
    said = cli("view", *files)
    assert (said.code, said.out) == (2, "")
    assert "j3_deg" in said.err


def test_view_serves_until_ctrl_c(files):
    command = [sys.executable, "-m", "posedesign", "view", *files, "--port", "18080"]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        text=True,
        # a shell that runs tests in the background has its children ignore Ctrl-C
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as running:
        try:
            assert running.stdout.readline() == f"{BAD}\n"
            line = running.stdout.readline()
            address = re.fullmatch(
                r"the cell is at (http://127\.0\.0\.1:\d+), until Ctrl-C\n", line
            )
            with urllib.request.urlopen(address[1], timeout=30) as answer:  # noqa: S310
                assert b"</html>" in answer.read()
            os.kill(running.pid, signal.SIGINT)
            assert running.wait(timeout=60) == 0
            assert running.stdout.read() == ""
        finally:
            running.kill()
