"""Every word that commands print as a name stands in the glossary.

The words come from the program: the tables that it chooses its words from, and the headings and
labels of what the commands print. What a word means where it stands in a sentence no test can tell.
"""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import get_args

import pytest
from rich.table import Table

from calib.identification.held import Cause
from calib.identification.result import Loss
from calib.identification.solver import Method
from calib.model.measurements import KINDS
from calib.robot_world import METHODS
from posedesign.candidates import CONFIGURATIONS
from posedesign.cell import Cell
from posedesign.cell.schema_sections import Word
from posedesign.cli import output
from posedesign.constraints.checker import Constraint
from posedesign.identification.models import EVERYTHING, FRAMES_ONLY, OFFSETS
from posedesign.motion.route import Passing
from posedesign.planning.pose_plan import PoseStatus, StopReason
from posedesign.programs.recorded import Level
from posedesign.selection.criteria import CRITERIA
from posedesign.selection.indices import Indices

ROOT = Path(__file__).parents[2]
GLOSSARY = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")

UNITS = "mm|deg|kg|px|s|%"
"""At the end of a heading, in brackets or after a line."""


def plain(word: str) -> str:
    """A word as it is compared: ``TCP rms [mm]`` is ``tcp rms``, ``with 16 poses`` has an n.

    What follows a comma says where, as in ``smallest distance, at P20``.
    """
    word = re.sub(rf" \[({UNITS})\]$|_({UNITS})$", "", word.partition(", ")[0].strip("` "))
    return re.sub(r"\b\d+(?= )", "n", word.replace("_", " ")).casefold()


def entries() -> Iterator[str]:
    """The words that the glossary explains."""
    for cell in re.findall(r"^\| ([^|]+) \| ", GLOSSARY, flags=re.MULTILINE):
        yield from re.split(r", ", cell)


EXPLAINED = {plain(entry) for entry in entries()}


def check_explained(words: Iterable[str]) -> None:
    missing = sorted({str(word) for word in words if plain(word) not in EXPLAINED})
    assert not missing, f"not in docs/glossary.md: {missing}"


def every_kind_of(base: type) -> Iterator[type]:
    for kind in base.__subclasses__():
        yield kind
        yield from every_kind_of(kind)


VOCABULARIES: dict[str, Iterable[str]] = {
    "criteria": CRITERIA,
    "indices": Indices.__dataclass_fields__,
    "measurements": KINDS,
    "words of models": get_args(Word),
    "models": (FRAMES_ONLY, OFFSETS, EVERYTHING),
    "losses": get_args(Loss),
    "methods of identification": get_args(Method),
    "methods of A X = Z B": METHODS,
    "configurations": CONFIGURATIONS,
    "where a pose comes from": PoseStatus,
    "why a posture is passed through": Passing,
    "why the loop ended": StopReason,
    "constraints": [
        kind.name
        for kind in every_kind_of(Constraint)
        if hasattr(kind, "name") and kind.__module__.startswith("posedesign")  # not those of tests
    ],
    "levels of problems of a program": get_args(Level),
    "causes of findings": get_args(Cause),
}


@pytest.mark.parametrize("vocabulary", VOCABULARIES)
def test_words_that_the_program_chooses_from(vocabulary):
    words = list(VOCABULARIES[vocabulary])
    assert words
    check_explained(words)


COMMANDS = """
robots
plan cell.toml --method exchange --poses 12 --validation 3 --out best
plan cell.toml --out run
check cell.toml run/poses.csv
score cell.toml run/poses.csv
predict cell.toml run/poses.csv --box 1700,-100,300,2100,200,700 --out run
program run/poses.csv --cell cell.toml --out run
simulate cell.toml run/poses.csv
identify cell.toml rehearsal/touchups.csv --out rehearsal
correct cell.toml rehearsal/identification.json run/poses.csv --out rehearsal
prove cell.toml --identification rehearsal/identification.json --content 0.8 --limit 1mm --out proof
simulate cell.toml proof/poses.csv --seed 5 --out proof
prove cell.toml proof/touchups.csv --identification rehearsal/identification.json --out proof
recheck cell.toml --identification rehearsal/identification.json --out again
next cell.toml rehearsal/touchups.csv --out further
robot-world rehearsal/pairs.csv --certify --out rehearsal
calibrate cell.toml --no-images --out auto
report run
"""


@pytest.mark.slow
def test_headings_and_labels_that_are_printed(cli, demo_work, monkeypatch):
    """What stands over a column, and before the colon of a line."""
    monkeypatch.chdir(demo_work)
    seen: set[str] = set()
    add_column, print_line = Table.add_column, output._print_line

    def adding(table, header="", *rest, **more):
        seen.add(str(header))
        add_column(table, header, *rest, **more)

    def printing(line, stream):
        seen.add(line.what)
        print_line(line, stream)

    monkeypatch.setattr(Table, "add_column", adding)
    monkeypatch.setattr(output, "_print_line", printing)
    for command in COMMANDS.split("\n"):
        if command:
            assert cli(*command.split()).code == 0, command
    assert len(seen) > 80
    robot = Cell.load("cell.toml").robot
    # names of the arm's own, and of what a plan could free of it
    own = {f"sigma_{name}_deg" for name in robot.joint_names}
    check_explained(seen - own - {""})
