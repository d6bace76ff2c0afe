"""Options, commands and folders that cannot be used: one line, exit code 2, no file."""

import shlex
from pathlib import Path

import pytest

from tests.cli.conftest import refusals


def test_too_few_pairs(refuse, work):
    lines = (work / "pairs.csv").read_text().splitlines()
    (work / "pairs.csv").write_text("\n".join(lines[:3]) + "\n")
    line = refuse("robot-world", work / "pairs.csv", "--out", work / "out")
    line.says("2 pose pairs", "at least 3")


def test_pairs_all_alike(refuse, work):
    lines = (work / "pairs.csv").read_text().splitlines()
    (work / "pairs.csv").write_text("\n".join([lines[0], *[lines[1]] * 9]) + "\n")
    line = refuse("robot-world", work / "pairs.csv", "--out", work / "out")
    line.says("cannot identify", "all poses are the same")


@pytest.mark.parametrize(
    ("options", "words"),
    refusals(r"""
--format fanuc => 'fanuc' | did you mean fanuc-ls?
--format kuka => 'kuka' | did you mean kuka-krl?
--format siemens => 'siemens' | known: fanuc-ls
--form polar => form is 'polar' | known: joint, cartesian
--form cartesian => poses of the tool need the robot
--approach-deg 1 => pass --cell
--name ../x => '../x' is not a FANUC program name | letter first
--name 'A B' => 'A B' is not a FANUC program name
--name TOOLONGNAME => at most 8 characters
"""),
)
def test_options_of_program(cli, work, options, words):
    options = shlex.split(options[0])
    usual = () if "--format" in options else ("--format", "fanuc-ls")
    said = cli("program", work / "poses.csv", "--out", work / "out", *usual, *options)
    assert said.code == 2
    assert said.err.count("\n") == 1
    assert all(word in said.err for word in ("error: ", *words))
    assert not [path for path in (work / "out").glob("*") if path.is_file()]


def test_program_of_seven_joints(refuse, work):
    text = "name," + ",".join(f"j{i}_deg" for i in range(1, 8)) + "\nP1,10,20,30,40,50,60,70\n"
    (work / "poses.csv").write_text(text)
    words = ("program", work / "poses.csv", "--out", work / "out")
    refuse(*words).says("unknown maker", "pass --cell", "--format")
    line = refuse(*words, "--format", "fanuc-ls")
    line.says("has 7 joint values", "an arm of fanuc has 6")


WRITERS = {
    "plan": ("plan", "cell.toml"),
    "simulate": ("simulate", "cell.toml", "poses.csv"),
    "identify": ("identify", "cell.toml", "touchups.csv"),
    "robot-world": ("robot-world", "pairs.csv"),
    "program": ("program", "poses.csv", "--format", "fanuc-ls"),
    "study": ("study", "accuracy", "cell.toml", "--draws", "10"),
    "demo": ("demo", "--draws", "10"),
}


def typed(work: Path, words: tuple[str, ...]) -> list[str]:
    return [str(work / word) if "." in word else word for word in words]


@pytest.mark.parametrize("words", WRITERS.values(), ids=WRITERS)
def test_file_in_place_of_the_output_folder(refuse, work, words):
    (work / "taken").write_text("mine")
    for out in (work / "taken", work / "taken" / "below"):
        line = refuse(*typed(work, words), "--out", out)
        line.says(f"{out}: the output folder cannot be made", "--out")


FIRST_FILES = {
    "plan": "poses.csv",
    "simulate": "touchups.csv",
    "identify": "identification.json",
    "robot-world": "robot_world.csv",
    "program": "CALIB01.LS",
    "demo": "cell.toml",
}


@pytest.mark.parametrize("command", FIRST_FILES)
def test_folder_in_place_of_an_output_file(refuse, work, command):
    blocked = work / "out" / FIRST_FILES[command]
    blocked.mkdir(parents=True)
    line = refuse(*typed(work, WRITERS[command]), "--out", work / "out")
    line.says(f"{blocked} is not an ordinary file")


@pytest.mark.parametrize(
    ("words", "said"),
    refusals(r"""
plna cell.toml => No such command 'plna'. Did you mean 'plan'?
plan => Missing argument 'cell'. (see posedesign plan --help)
plan a.toml b.toml => unexpected extra argument(s) (b.toml)
plan a.toml --outt x => No such option: --outt
plan --help-me => No such option: --help-me
study => Missing command. (see posedesign study --help)
study acuracy => No such command 'acuracy'. Did you mean 'accuracy'?
study accuracy --draws 9 => '--draws': Input should be greater than or equal
study accuracy --draws many => '--draws': Input should be a valid integer
study run x --trials 0 => '--trials': Input should be greater than or equal
study run x --jobs 0 => '--jobs': Input should be greater than or equal
demo --draws -5 => '--draws': Input should be greater than or equal to 10
demo --draws => Option '--draws' requires an argument
simulate a b --seed -1 => '--seed': Input should be greater than or equal
"""),
)
def test_mistyped_commands(refuse, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    refuse(*shlex.split(words[0])).says(*said, "--help)")


HUGE = "9" * 400


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("study", "accuracy", "--draws", "999999999"), ("--draws", "less than or equal to")),
        (("study", "run", "peers", "--trials", "99999999999999999999"), ("--trials", "less than")),
        (("simulate", "cell.toml", "poses.csv", "--seed", HUGE), ("--seed", "less than")),
        (("plan", "cell.toml", "--threshold", "1e-320"), ("the threshold is not above zero",)),
        (("plan", "cell.toml", "--target-accuracy", "1e308"), ("the target accuracy is not",)),
        (("plan", "cell.toml", "--wanted-sigma-deg", "1e308"), ("wanted standard deviation",)),
        (
            ("robot-world", "pairs.csv", "--noise-deg", "1e308", "--noise-mm", "1"),
            ("no standard deviation",),
        ),
        (("import", "cell.toml", ".", "--out", "back"), ("is a folder",)),
        (("score", "cell.toml", "x" * 5000), ("cannot be read: File name too long",)),
    ],
    ids=lambda value: " ".join(value)[:50],
)
def test_numbers_and_names_beyond_all_bounds(refuse, work, monkeypatch, words, said):
    monkeypatch.chdir(work)
    if len(words[-1]) > 1000:  # the one line of an error is cut
        monkeypatch.setattr("posedesign.cli.main.LONGEST_LINE", 900)
        said = ("...",)
    refuse(*words).says(*said)


def test_a_machine_that_has_not_enough(cli, work, monkeypatch):
    """Memory and the system's own errors are one line, too."""

    def lacking(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr("posedesign.workflow.plan_poses", lacking)
    said = cli("plan", work / "cell.toml", "--out", work / "out")
    assert said.code == 2
    assert said.err.splitlines()[-1].startswith("error: the memory is not enough")


def test_a_choice_that_is_none_names_the_one_that_was_meant(refuse, work):
    for word in ("on_flange", "flange", "on-flang"):
        line = refuse("robot-world", work / "pairs.csv", "--camera", word)
        line.says(f"'--camera': '{word}' is not one of", "; did you mean on-flange?", "--help)")


def test_a_cell_in_the_place_of_the_pictures_is_named(refuse, work):
    cell, folder = work / "cell.toml", work / "pictures"
    folder.mkdir()
    first = "give first the cell, then the folder"
    refuse("camera", cell).says(f"{cell} has no pictures, it is a cell", first)
    refuse("camera", folder, cell).says(f"{folder} is a folder, and no cell", first)
    refuse("camera", cell, cell).says(f"{cell} has no pictures, it is a cell", first)
