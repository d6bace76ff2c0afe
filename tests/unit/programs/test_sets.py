"""Files of one program belong together, and give way to a newer program as a whole."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import pytest

from calib.errors import InputError, OutputError
from calib.robots import POSITIVE_AXES
from posedesign.cell import Cell
from posedesign.files import Results
from posedesign.pose_programs import import_touch_ups
from posedesign.programs import DIALECTS, Dialect, PoseProgram, ProgramOptions, ProgramPose
from posedesign.programs.reading import read_program_bytes
from posedesign.programs.sets import SetMark, set_mark

PULSES = (1000.0,) * 6


def program(
    count: int = 3, step_deg: float = 1.0, plan: str = "abcdef12", joints: int = 6
) -> PoseProgram:
    poses = tuple(
        ProgramPose(f"P{k}", np.deg2rad(step_deg) * np.resize([k % 90, 30, 40, 10, 50, 0], joints))
        for k in range(1, count + 1)
    )
    options = ProgramOptions(fingerprint=plan, pulses_per_deg=PULSES)
    return PoseProgram("CAL", poses, options)


def joints_of(name: str) -> int:
    return len(POSITIVE_AXES.get(DIALECTS[name].maker or "", range(6)))


def contents(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.mark.parametrize("name", DIALECTS)
def test_a_mark_of_the_set_in_what_is_written(tmp_path: Path, name: str) -> None:
    dialect = DIALECTS[name]
    paths = dialect.write(program(joints=joints_of(name)), tmp_path)
    marks = [mark for path in paths if (mark := set_mark(read_program_bytes(path)))]
    assert marks
    assert set(marks) == {SetMark("abcdef12", len(paths), marks[0].digest)}
    read = dialect.reading(PULSES).read(paths[0])
    assert (read.fingerprint, read.mark.measured) == ("abcdef12", 3)
    assert not [
        p for path in paths if path.suffix in dialect.suffixes for p in dialect.validate(path)
    ]


@pytest.mark.parametrize("name", DIALECTS)
def test_a_newer_program_takes_the_place_of_ones_own(tmp_path: Path, name: str) -> None:
    results, dialect = Results(tmp_path, "program"), DIALECTS[name]
    dialect.write(program(joints=joints_of(name)), results)
    dialect.write(program(joints=joints_of(name)), results)
    paths = dialect.write(program(4, plan="00c0ffee", joints=joints_of(name)), results)
    assert {str(p.relative_to(tmp_path)) for p in paths} == set(contents(tmp_path))
    assert dialect.reading(PULSES).read(paths[0]).fingerprint == "00c0ffee"


@pytest.mark.parametrize("name", DIALECTS)
def test_what_a_person_touched_is_not_replaced(tmp_path: Path, name: str) -> None:
    said: list[str] = []
    results, dialect = Results(tmp_path, "program"), DIALECTS[name]
    for path in dialect.write(program(joints=joints_of(name)), results):
        whole = path.read_bytes()
        path.write_bytes(whole.replace(b"3", b"4", 1) if b"3" in whole else whole + b" ")
        before = contents(tmp_path)
        with pytest.raises(OutputError, match="is not replaced") as caught:
            dialect.write(program(4, joints=joints_of(name)), results)
        assert "\n" not in str(caught.value)
        assert contents(tmp_path) == before
        path.write_bytes(whole)
    path.write_bytes(b"mine")
    dialect.write(
        program(4, joints=joints_of(name)),
        Results(tmp_path, "program", overwrite=True, say=said.append),
    )
    assert said
    assert b"mine" in contents(tmp_path).values()


@pytest.mark.parametrize("name", ["fanuc-ls", "yaskawa-jbi"])
def test_parts_of_a_longer_program_are_removed_or_kept(tmp_path, name, monkeypatch):
    dialect, results = DIALECTS[name], Results(tmp_path, "program")
    monkeypatch.setattr(type(dialect), "most_poses", lambda self, program: 2)
    long = dialect.write(program(7), results)
    assert len(long) == 4
    other = tmp_path / f"OTHER_1{long[0].suffix}"
    other.write_bytes(long[0].read_bytes().replace(b"CAL_1", b"OTHER_1"))
    short = dialect.write(program(3, plan="00c0ffee"), results)
    assert set(contents(tmp_path)) == {path.name for path in (*short, other)}
    long = dialect.write(program(7), results)
    long[3].write_bytes(long[3].read_bytes().replace(b"50", b"51"))
    before = contents(tmp_path)
    with pytest.raises(OutputError, match=rf"{long[0].stem}|{long[3].stem}"):
        dialect.write(program(3), results)
    assert contents(tmp_path) == before


def test_a_folder_is_swapped_as_a_whole(tmp_path: Path) -> None:
    dialect, results = DIALECTS["staubli-val3"], Results(tmp_path, "program")
    paths = dialect.write(program(), results)
    body = next(path for path in paths if path.stem == "MEASURE")
    body.write_text(body.read_text().replace("popUpMsg", "trigger"))
    with pytest.raises(OutputError, match="CAL"):
        dialect.write(program(4), results)
    assert "trigger" in body.read_text()
    dialect.write(program(4), Results(tmp_path, "program", overwrite=True))
    assert "trigger" in (tmp_path / "CAL.1" / body.name).read_text()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["CAL", "CAL.1"]


def killed_between_files(dialect: Dialect, folder: Path) -> int:
    """Status of a process that is killed when the second file of a program is put in its place."""
    child = os.fork()
    if not child:
        replace, done = Path.replace, []

        def once(self: Path, target: Path) -> Path:
            if done:
                os.kill(os.getpid(), signal.SIGKILL)
            done.append(target)
            return replace(self, target)

        Path.replace = once  # type: ignore[method-assign,assignment]
        try:
            dialect.write(program(4, plan="00c0ffee"), folder)
        finally:
            os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def test_a_kill_between_two_files_is_found(tmp_path: Path, reference_cell: Cell) -> None:
    dialect = DIALECTS["kuka-krl"]
    dat, src = dialect.write(program(), tmp_path)
    assert killed_between_files(dialect, tmp_path) == -signal.SIGKILL
    assert b"00c0ffee" in dat.read_bytes()
    assert b"abcdef12" in src.read_bytes()
    for path in (dat, src):
        (problem,) = [p for p in dialect.validate(path) if p.rule == "set"]
        assert "do not belong together" in problem.message
        assert "plan 00c0ffee" in problem.message
        assert "plan abcdef12" in problem.message
        with pytest.raises(InputError, match="do not belong together"):
            import_touch_ups(reference_cell, [path], None, "kuka-krl", keep_untouched=True)
    dialect.write(program(4, plan="00c0ffee"), tmp_path)
    assert not dialect.validate(dat)


def test_files_of_two_folders_that_do_not_belong_together(tmp_path, reference_cell):
    dialect = DIALECTS["kuka-krl"]
    dat, _ = dialect.write(program(), tmp_path / "monday")
    _, src = dialect.write(program(4, plan="00c0ffee"), tmp_path / "tuesday")
    with pytest.raises(InputError, match="do not belong together"):
        import_touch_ups(reference_cell, [dat, src], None, keep_untouched=True)


def test_a_mark_that_a_person_wrote_is_none() -> None:
    for text in (b"SEE PLAN face 2\n", b"! my PLAN 1a2b 3\n", b"PLAN beef\n"):
        assert set_mark(text) is None
    assert set_mark(b"   1:  !PLAN 00c0ffee 12 ;\r\n") == SetMark("00c0ffee")
