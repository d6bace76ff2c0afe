"""Commands and Python of README and pages, run as printed on the reference cell."""

import importlib.util
import json
import re
import shlex
import shutil
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from posedesign.cell import Cell, cell_template
from posedesign.cell.file import cell_text, parse_config
from posedesign.planning.poses_file import read_poses
from posedesign.pose_programs import program_options
from posedesign.programs import PoseProgram, ProgramPose, write
from posedesign.simulation import SimulatedRobot
from tests.cli.conftest import below_comments, unfolded
from tests.cli.test_camera import write_pictures

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = {
    str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
    for path in sorted((ROOT / "docs").rglob("*.md"))
}


LANGUAGES = {"bash", "python", "toml", "text"}
"""Of code blocks: commands and Python are run, TOML is a part of a cell, text is no code to run."""

STEPS = "docs/how-to/commands.md"
HOW_TO = [name for name in PAGES if name.startswith("docs/how-to/") and name != STEPS]
TUTORIALS = [name for name in PAGES if name.startswith("docs/tutorials/")]

FIGURE = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")

QUICK = {"calibrate": ["--no-images"], "study": ["--draws", "10"]}
"""Options that make a command quick; of ``study`` for ``study accuracy``."""


def blocks(text: str) -> list[tuple[str, str]]:
    """Language and text of each code block."""
    return re.findall(r"^```(\w*)\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)


def commands_of(block: str) -> list[list[str]]:
    """Words of each command line."""
    lines = [shlex.split(line, comments=True) for line in block.splitlines()]
    return [words for words in lines if words]


def run_page(glance, name: str) -> dict[str, Any]:
    """Run all blocks of a page, in the present folder, and return the names that Python has."""
    found: dict[str, Any] = {}
    for language, block in blocks(PAGES[name]):
        if language == "python":
            exec(block, found)  # noqa: S102  our own page
        elif language == "bash":
            for words in commands_of(block):
                run_line(glance, words)
    return found


def run_line(glance, words: list[str]) -> str:
    """Run one command, and return what it says; or write it where ``>`` has it."""
    words, to = (words[:-2], Path(words[-1])) if words[-2:-1] == [">"] else (words, None)
    program, *rest = words
    assert program == "posedesign", words
    if rest[0] != "study" or rest[1] == "accuracy":
        rest += QUICK.get(rest[0], [])
    said = glance(*rest)
    assert said.code == 0, (words, said.err)
    if to is None:
        return str(said.out + said.err)
    to.write_text(said.out)
    return str(said.err)


def notebooks() -> ModuleType:
    """What makes notebooks of tutorials, a hook of the site."""
    spec = importlib.util.spec_from_file_location("notebooks", ROOT / "docs" / "notebooks.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("page", ["README.md", *PAGES])
def test_links_lead_somewhere(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    links = re.findall(r"\]\((?!https?:)([^)#]+)\)", text)
    assert not [link for link in links if not (ROOT / page).parent.joinpath(link).exists()]


def test_the_readme_is_short_and_names_every_page():
    assert len(README.encode()) < 8_000
    assert len(README.splitlines()) < 150
    assert [name for name in PAGES if f"]({name})" not in README] == []


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


@pytest.mark.parametrize("page", PAGES)
def test_every_block_of_code_is_run_or_parsed(page):
    kinds = {language for language, _ in blocks(PAGES[page])}
    assert kinds <= LANGUAGES, "a block has to say what it is, after its ```"
    if kinds & {"bash", "python"}:
        assert page in (STEPS, *HOW_TO, *TUTORIALS), "no test runs the code of this page"


@pytest.mark.parametrize("page", PAGES)
def test_parts_of_cells_are_parts_of_a_cell(page):
    for language, block in blocks(PAGES[page]):
        if language == "toml":
            part = tomllib.loads(block)
            parse_config({**tomllib.loads(cell_template()), **part}, Path(page))


def check_columns_said(written: Path, other: str) -> None:
    """Check that the reference has the columns of a table, but for those that a pattern fits."""
    section = PAGES["docs/reference/files.md"].split(f"\n## {written.name}\n")[1].split("\n## ")[0]
    cells = re.findall(r"^\| (`[^|]*`) \|", section, flags=re.MULTILINE)
    said = {word for cell in cells if ".." not in cell for word in re.findall(r"\w+", cell)}
    (header, *_) = below_comments(written.read_text()).splitlines()
    columns = set(header.split(","))
    assert said - columns <= {"sigma_NAME_UNIT"}
    assert [c for c in columns - said if not other or not re.match(other, c)] == []


def take_pictures_of_the_page(cell: Path) -> None:
    """Pictures of the board of the page about cameras, their joints, and the cell."""
    page = PAGES["docs/how-to/camera.md"]
    board = next(block for language, block in blocks(page) if language == "toml")
    cell.write_text(cell_template("ur10e", surroundings=False) + board)
    write_pictures(cell, Path("pictures"), Path("joints.csv"), count=10)


@pytest.mark.slow
def test_code_of_the_pages_that_say_how(glance, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = [words for _, block in blocks(PAGES[STEPS]) for words in commands_of(block)]
    assert len(lines) == 21
    for words in lines:
        if words[1] in ("network", "streams"):
            continue  # of files that no step before makes: tests of their own run them
        if words[1] == "import":
            touched_up(Path("run/poses.csv"), Path("CALIB01.LS"))
        run_line(glance, [word for word in words if word not in ("--robot", "arm.urdf")])
        if words[1] == "plan":
            shutil.copy("run/poses.csv", "my_poses.csv")
    for written, other in (
        ("run/rounds.csv", r"sigma_"),
        ("run/predicted_accuracy.csv", ""),
        ("rehearsal/robot_world.csv", r"(sigma_)?[xz]_"),
        ("rehearsal/robot_world_pairs.csv", ""),
        ("run/accuracy_vs_condition.csv", ""),
    ):
        check_columns_said(Path(written), other)
    take_pictures_of_the_page(Path("camera_cell.toml"))
    tracker = next(
        code for kind, code in blocks(PAGES["docs/how-to/measured_by.md"]) if kind == "toml"
    )
    raw = {**tomllib.loads(cell_template("ur10e", surroundings=False)), **tomllib.loads(tracker)}
    Path("tracker.toml").write_text(cell_text(parse_config(raw, Path("cell.toml")), Path()))
    found = {name: run_page(glance, name) for name in HOW_TO}
    assert found["docs/how-to/by_sight.md"]["MyRobot"]() is not None
    python = found["docs/how-to/python.md"]
    assert python["plan"].reached
    assert python["result"].status == "converged"
    assert python["X_Z"].covariance.shape == (12, 12)


def run_cell(glance, capsys, code: str, found: dict[str, Any]) -> str:
    """Run a cell of a notebook, in the present folder, and return what it printed."""
    if code.startswith("%%writefile "):
        first, text = code.split("\n", 1)
        Path(first.split()[1]).write_text(text)
        return ""
    lines = code.splitlines()
    if not any(line.startswith("!") for line in lines):
        capsys.readouterr()
        exec(code, found)  # noqa: S102  our own page
        return str(capsys.readouterr().out)
    commands = [words for line in lines for words in commands_of(line.removeprefix("!"))]
    return "\n".join(run_line(glance, words) for words in commands)


def was_printed(shown: str, line: str) -> bool:
    """Whether a line that a page shows is one that was printed; figures may differ a little."""
    if shown.endswith(" ..."):
        shown = shown.removesuffix(" ...")
        line = line[: len(shown)]
    figures, printed = ([float(x) for x in FIGURE.findall(text)] for text in (shown, line))
    return FIGURE.split(shown) == FIGURE.split(line) and printed == pytest.approx(figures, rel=0.05)


@pytest.mark.slow
@pytest.mark.usefixtures("whole_outlook")
@pytest.mark.parametrize("page", TUTORIALS)
def test_a_tutorial_prints_what_it_shows(page, glance, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    notebook = notebooks().notebook_of(PAGES[page], Path(page).stem)
    found: dict[str, Any] = {}
    lines: list[str] = []
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            lines += run_cell(glance, capsys, "".join(cell["source"]), found).splitlines()
    shown = unfolded("".join(text for kind, text in blocks(PAGES[page]) if kind == "text"))
    assert len(lines) > 10
    missing = [s for s in shown.splitlines() if not any(was_printed(s, line) for line in lines)]
    assert missing == []


@pytest.mark.parametrize("page", TUTORIALS)
def test_the_notebook_of_a_tutorial_has_all_of_its_code(page):
    text, stem = PAGES[page], Path(page).stem
    cells = json.loads(json.dumps(notebooks().notebook_of(text, stem)))["cells"]
    keys = {"markdown": set(), "code": {"execution_count", "outputs"}}
    for cell in cells:
        assert set(cell) == {"cell_type", "metadata", "source"} | keys[cell["cell_type"]]
    code = "".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    commands = [
        line for kind, block in blocks(text) if kind == "bash" for line in block.split("\n")
    ]
    assert all(f"!{line}" in code for line in commands if line.startswith("posedesign"))
    assert all(block.rstrip() in code for kind, block in blocks(text) if kind == "python")
    pictures = re.findall(rf"\]\({stem}/(.*?)\)", text)
    assert pictures, "a tutorial ends in a picture"
    assert all(f'Image.open("{path}")' in code for path in pictures)
    figures = [(ROOT / "docs/tutorials" / stem / path) for path in pictures]
    assert all(path.stat().st_size < 150_000 for path in figures)


def test_the_two_commands_are_what_the_makefile_has():
    makefile = (Path(__file__).parents[2] / "Makefile").read_text(encoding="utf-8")
    for target in ("demo", "test"):
        assert f"\nmake {target} " in README
        assert f"\n{target}: " in makefile
