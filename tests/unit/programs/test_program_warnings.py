"""The head of every program says what was not checked, and what was written in spite of what."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from posedesign.files import Results, write_text_atomic
from posedesign.files.origin import checksum
from posedesign.planning.poses_file import ALL_CHECKED, PoseList, read_poses
from posedesign.pose_programs import program_options, write_program
from posedesign.programs import DIALECTS, PoseProgram, ProgramOptions, ProgramPose
from posedesign.programs.program import MOST_WARNINGS
from posedesign.programs.reading import read_program_bytes
from tests.unit.programs.dialects import PULSES, arm_of, dialect_of, middle, program_of

HOSTILE = "collisions with \"gun\" ; 'table' é ]]> \n END <a>& \\ and " + "x" * 400


def program(name: str, **warnings: tuple[str, ...] | str) -> PoseProgram:
    plain = program_of(name, [ProgramPose(f"P0{k}", middle(name) + 0.01 * k) for k in (1, 2, 3)])
    return replace(plain, arm=arm_of(name, frames=False), **warnings)  # type: ignore[arg-type]


def words_of(text: str) -> str:
    """What the comments with a star say, their lines put together."""
    found = re.findall(r"\* ([^\n]*?)[ ;]*$", text.replace("\r", ""), flags=re.MULTILINE)
    return " ".join(" ".join(found).split())


@pytest.mark.parametrize("name", DIALECTS)
def test_the_head_says_what_was_not_checked(name: str, tmp_path: Path) -> None:
    dialect = DIALECTS[name]
    warned = program(
        name,
        not_checked=("collisions: constraints.collisions is false", HOSTILE),
        simulated=("corrected_poses.csv (0a1b2c3d), simulated corrected poses by correct",),
        made_from=("cell.toml (4e5f6a7b)",),
        corrected_by="1a2b3c4d",
        forced=tuple(f"P{k:02d}: forearm and table run {k} mm into each other" for k in range(40)),
    )
    files = dialect.write(warned, tmp_path)
    said = words_of("\n".join(read_program_bytes(path).decode() for path in files))
    assert said.startswith("SIMULATED, NOT FOR A ROBOT: corrected_poses.csv (0a1b2c3d), simulated")
    assert "FROM: cell.toml (4e5f6a7b)" in said
    assert "CORRECTED BY 1a2b3c4d: not the poses of the plan" in said
    assert "NOT CHECKED: collisions: constraints.collisions is false" in said
    assert "WRITTEN IN SPITE OF: P03: forearm and table run 3 mm into each other" in said
    assert f"WRITTEN IN SPITE OF: and {41 - MOST_WARNINGS} more" in said
    # nothing that is read back, or that the controller checks, is another for it
    plain = dialect.write(program(name), tmp_path / "plain")
    reader = dialect_of(name)
    for path in files:
        if path.suffix.lower() in dialect.suffixes:
            assert not dialect.validate(path)
            notes = " ".join(problem.message for problem in dialect.validate(path, ["note"]))
            assert "corrected by the identification 1a2b3c4d" in notes
    one, two = reader.read(files[0]), reader.read(plain[0])
    assert (one.name, one.comment, one.mark) == (two.name, two.comment, two.mark)
    for ours, theirs in zip(one.positions, two.positions, strict=True):
        assert (ours.number, ours.name) == (theirs.number, theirs.name)


@pytest.mark.parametrize("name", DIALECTS)
def test_a_warning_is_no_title(name: str, tmp_path: Path) -> None:
    """Without a fingerprint it is the first remark of the file."""
    unmarked = replace(
        program(name, not_checked=("anything",)), options=ProgramOptions(pulses_per_deg=PULSES)
    )
    read = dialect_of(name).read(DIALECTS[name].write(unmarked, tmp_path)[0])
    assert read.comment == ""


def listed(*comments: str) -> PoseList:
    pose = program("ur-script").poses[0]
    return PoseList(
        ("P01",), pose.posture_rad[None], np.array([False]), comments=("posedesign: x", *comments)
    )


@pytest.mark.parametrize(
    ("comments", "said"),
    [
        (("not checked: the view of the target", "not checked: ways"), "the view of the target"),
        ((), "anything: the list of poses does not say what was"),
        ((f"not checked: {ALL_CHECKED}",), ALL_CHECKED),
        (
            ("not checked: the view of the target", "fingerprint: 00000000"),
            "anything: the list was changed after planning",
        ),
    ],
)
def test_without_a_cell_the_list_of_poses_says_it(comments, said, tmp_path):
    poses = listed(*comments)
    options = program_options(None, poses)
    written = write_program(poses, tmp_path, "ros-trajectory", options, "CALIB01")
    assert written.not_checked[0] == said
    assert f"NOT CHECKED: {said}" in words_of(written.paths[0].read_text())


def test_a_list_that_is_read_keeps_what_it_says(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    path.write_text(
        "# not checked: link_1 against link_3, gun against table: they touch\n"
        "name,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg\nP01,1.5,2,3,4,5,60\n"
    )
    said = read_poses(path, 6).not_checked
    assert said == ("link_1 against link_3, gun against table: they touch",)


def test_a_program_says_from_which_files_it_is_made(tmp_path: Path) -> None:
    """What comes of a simulated robot first, whatever command wrote it, and through any other."""
    (tmp_path / "cell.toml").write_text("# mine\n")
    poses, out = listed(), Results(tmp_path, "plan")
    sources = []
    for kind, name in (("planned", "poses.csv"), ("simulated", "my corrected; 'poses'.csv")):
        (claim,) = out.claim(kind, (name, "measuring poses"))
        sources.append(write_text_atomic(claim, f"name,j1_deg\n{kind},1\n"))
    inputs = (*map(Path, sources), tmp_path / "cell.toml", tmp_path / "none.csv")
    results = Results(tmp_path / "out", "program", inputs)
    options = program_options(None, poses)
    written = write_program(poses, results, "fanuc-ls", options, "CALIB01")
    plan, corrected, cell = (checksum(path) for path in inputs[:3])
    said = words_of(written.paths[0].read_text())
    assert said.startswith(
        f"SIMULATED, NOT FOR A ROBOT: my_corrected_poses_.csv ({corrected}), simulated measuring "
        "poses by plan NOT CHECKED: "
    )
    assert said.endswith(
        f"FROM: poses.csv ({plan}), planned measuring poses by plan FROM: cell.toml ({cell})"
    )
    assert not written.problems
