"""The README's own commands and its Python, run as printed on the reference cell."""

import re
import shlex
import shutil
from pathlib import Path
from typing import Any

import pytest

from posedesign.cell import Cell
from posedesign.planning.poses_file import read_poses
from posedesign.pose_programs import program_options
from posedesign.programs import PoseProgram, ProgramPose, write
from posedesign.simulation import SimulatedRobot

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")


def blocks(language: str = "") -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", README, flags=re.MULTILINE | re.DOTALL)


def touched_up(poses: Path, program: Path) -> None:
    """The program as it is saved on the controller after touching up."""
    cell = Cell.load("cell.toml")
    listed = read_poses(poses, cell.robot.n)
    measured = SimulatedRobot.of(cell).touch_up(listed.measured.postures, None).postures
    postures = listed.postures.copy()
    postures[~listed.via] = measured
    stops = zip(listed.names, postures, listed.via, strict=True)
    taught = tuple(ProgramPose(name, q, via=bool(via)) for name, q, via in stops)
    write(PoseProgram("CALIB01", taught, program_options(cell, listed)), "fanuc-ls", program.parent)


@pytest.mark.slow
def test_commands_and_python_of_the_readme(cli, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (steps,) = (block for block in blocks() if block.startswith("posedesign new"))
    lines = [line.partition("#")[0].strip() for line in steps.splitlines()]
    assert len(lines) == 18
    for line in lines:
        words = shlex.split(line.replace("--robot arm.urdf", "").partition(">")[0])
        assert words.pop(0) == "posedesign"
        if words[:2] == ["study", "accuracy"]:
            words += ["--draws", "10"]
        if words[0] == "calibrate":
            words += ["--no-images"]
        if words[0] == "import":
            touched_up(Path("run/poses.csv"), Path("CALIB01.LS"))
        said = cli(*words)
        assert said.code == 0, (line, said.err)
        if words[0] == "new":
            Path("cell.toml").write_text(said.out)
        if words[0] == "plan":
            shutil.copy("run/poses.csv", "my_poses.csv")
    found: dict[str, Any] = {}
    by_sight, python = blocks("python")
    exec(by_sight, found)  # noqa: S102  our own README
    assert callable(found["calibrate_robot"])
    assert found["MyRobot"]() is not None
    exec(python, found)  # noqa: S102
    assert found["plan"].reached
    assert found["result"].status == "converged"
    assert found["X_Z"].covariance.shape == (12, 12)


def test_the_two_commands_are_what_the_makefile_has():
    makefile = (Path(__file__).parents[2] / "Makefile").read_text(encoding="utf-8")
    for target in ("demo", "test"):
        assert f"\nmake {target} " in README
        assert f"\n{target}: " in makefile
