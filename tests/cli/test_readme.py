"""Commands and Python of README and pages, run as printed on the reference cell."""

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

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = {
    str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
    for path in sorted((ROOT / "docs").rglob("*.md"))
}


def blocks(text: str, language: str = "") -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("page", ["README.md", *PAGES])
def test_links_lead_somewhere(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    links = re.findall(r"\]\((?!https?:)([^)#]+)\)", text)
    assert not [link for link in links if not (ROOT / page).parent.joinpath(link).exists()]


def test_the_readme_is_short_and_names_every_page():
    assert len(README.encode()) < 8_000
    assert len(README.splitlines()) < 150
    named = [name for name in PAGES if not name.startswith("docs/tutorials/")]
    assert [name for name in named if f"]({name})" not in README] == []


def test_commands_of_the_readme_are_there(cli):
    rows = re.findall(r"^\| `posedesign ([\w-]+)[^`]*` \|", README, flags=re.MULTILINE)
    assert len(rows) == 8
    further = re.search(r"Further ones: (.*?)\.\n", README)
    assert further is not None
    for command in (*rows, *re.findall(r"`([\w-]+)`", further[1])):
        assert cli(command, "--help").code == 0, command


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
def test_commands_and_python_of_the_pages(cli, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (steps,) = (
        block
        for block in blocks(PAGES["docs/how-to/commands.md"])
        if block.startswith("posedesign new")
    )
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
    (by_sight,) = blocks(PAGES["docs/how-to/by_sight.md"], "python")
    (python,) = blocks(PAGES["docs/how-to/robots.md"], "python")
    exec(by_sight, found)  # noqa: S102  our own page
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
