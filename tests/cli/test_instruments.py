"""``posedesign identify`` on files of instruments: as good as its own table, and what is wrong."""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from posedesign.files.measurements import write_measurements
from tests import instrument_files as files
from tests.instrument_files import Session, session

pytestmark = pytest.mark.usefixtures("one_alternative")

ALL = 'reflectors = ["SMR1", "SMR2", "SMR3"]\n'
TURNED = (
    'kind = "pose"\nunit = "mm"\nturn = "quaternion-xyzw"\n[instrument.columns]\n'
    'turn = ["Qx", "Qy", "Qz", "Q0"]\npose = "Name"\n'
)
PLAIN = "[measurement]\nweighted = false\n"
"""Without the fit of an arm with everything that may be off, which is most of the time."""

IN_ORDER = 'kind = "pose"\nmatch = "order"\n'


@dataclass(frozen=True)
class Instrument:
    """A layout: its writer, its section of the cell, what it measures, and how it loses a column.

    ``lost`` are what to look for and what to put there, line by line; ``says`` is what is said.
    """

    write: files.Writer
    section: str
    kind: str
    lost: tuple[str, str]
    says: str
    reflectors: tuple[str, ...] = ()

    @property
    def is_stream(self) -> bool:
        return self.section == IN_ORDER


INSTRUMENTS = {
    "spatial analyzer": Instrument(
        files.spatial_analyzer,
        'unit = "mm"\n' + ALL,
        "point",
        (r"^(Cell A, P05, SMR2, [^,]*, [^,]*), [^,]*,", r"\1,"),
        "cells",
        files.REFLECTORS,
    ),
    "name x y z": Instrument(
        files.points_text, 'unit = "mm"\n', "point", (r"^(P05 \S+ \S+) \S+$", r"\1"), "cells"
    ),
    "semicolons": Instrument(
        files.faro_like,
        files.FARO_COLUMNS,
        "point",
        (r"Z \[mm\]", "Height [mm]"),
        "there is no column Z [mm]",
        files.REFLECTORS,
    ),
    "tabs": Instrument(
        files.api_like,
        '[instrument.columns]\npose = "No"\n',
        "point",
        (r"^No\tX\tY\tZ", "No\tX\tY\tHeight"),
        "there is no column z",
    ),
    "quaternions": Instrument(
        files.creaform_like, TURNED, "pose", ("Q0", "Q"), "there is no column Q0"
    ),
    "motive": Instrument(
        files.motive, IN_ORDER, "pose", (r"(Seconds\),X,Y,Z),W", r"\1,V"), "no orientation"
    ),
    "vicon": Instrument(
        files.vicon, IN_ORDER, "pose", ("TX,TY,TZ", "TX,TY,T"), "nothing with all of x, y and z"
    ),
}


@pytest.fixture(scope="module")
def measured() -> Session:
    return session()


@pytest.fixture(params=INSTRUMENTS)
def instrument(request) -> Instrument:
    return INSTRUMENTS[request.param]


QUICK = ("spatial analyzer", "motive")
"""Layouts that are identified with in every run: a table of points, and a body with rotations."""


@pytest.fixture(
    params=[n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in INSTRUMENTS]
)
def identified_with(request) -> Instrument:
    return INSTRUMENTS[request.param]


def edited(path: Path, edit: Callable[[list[str]], list[str]]) -> Path:
    """The file with other lines."""
    lines = edit(path.read_text(encoding="utf-8").split("\n"))
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def written(instrument: Instrument, taken: Session, folder: Path) -> list[Path]:
    """Cell, file of the instrument, and joints."""
    cell = taken.cell(folder, instrument.section + PLAIN)
    return [cell, instrument.write(taken, folder), files.joint_list(taken, folder)]


def identified(cli, out: Path, cell: Path, measurements: Path, *more: object) -> dict:
    said = cli("identify", cell, measurements, *more, "--out", out)
    assert said.code in (0, 1), said.err
    content = json.loads((out / "identification.json").read_text(encoding="utf-8"))
    return content | {"err": said.err, "out": said.out}


def values(content: dict) -> np.ndarray:
    model = next(m for m in content["models"] if m["name"] == "offsets")
    return np.array([p["value"] for p in model["parameters"]])


def test_the_result_is_that_of_the_own_table(cli, measured, identified_with, tmp_path):
    """And the tables that are written beside it say the same, with what was kept."""
    cell, file, joints = written(identified_with, measured, tmp_path)
    found = identified(cli, tmp_path / "a", cell, file, "--joints", joints)
    table = measured.native(identified_with.kind, identified_with.reflectors)
    own = write_measurements(tmp_path / "own.csv", table, [identified_with.kind])
    expected = identified(cli, tmp_path / "b", cell, own)
    np.testing.assert_allclose(values(found), values(expected), rtol=1e-5, atol=1e-5)
    assert found["recommended"] == expected["recommended"] == "offsets"
    again = identified(cli, tmp_path / "c", cell, tmp_path / "a" / "joined.csv")
    np.testing.assert_allclose(values(again), values(found), rtol=1e-5, atol=1e-5)
    residuals = (tmp_path / "a" / "residuals.csv").read_text(encoding="utf-8").split("\n")
    assert len(residuals) == table.count + 3
    assert "at 24 poses" in found["measured"]["measured"]


def refused(cli, cell: Path, file: Path, joints: Path) -> str:
    """The one line of a refusal."""
    said = cli("identify", cell, file, "--joints", joints, "--out", cell.parent / "out")
    assert said.code == 2, said.out
    lines = [line for line in said.err.split("\n") if line and not line.startswith("warning")]
    assert len(lines) == 1, lines
    assert lines[0].startswith("error: ")
    return lines[0]


def test_a_missing_column(cli, measured, instrument, tmp_path):
    cell, file, joints = written(instrument, measured, tmp_path)
    old, new = instrument.lost
    text = file.read_text(encoding="utf-8")
    changed = re.sub(old, new, text, flags=re.MULTILINE)
    assert changed != text
    file.write_text(changed, encoding="utf-8")
    line = refused(cli, cell, file, joints)
    assert str(file) in line
    assert instrument.says in line


@pytest.mark.parametrize(("factor", "unit"), [(1e-3, "metres"), (1 / 25.4, "inches")])
def test_another_unit(cli, measured, instrument, tmp_path, factor, unit):
    """Numbers are in metres or inches where file or cell say millimetres."""
    other = replace(
        measured,
        points=measured.points * factor,
        poses=measured.poses * np.repeat([factor, 1.0], 3),
    )
    line = refused(cli, *written(instrument, other, tmp_path))
    assert "moves by" in line
    # of a recording without a clock its standstills are no longer seen
    assert ("is its unit right?" if instrument.is_stream else unit) in line


@pytest.mark.parametrize(
    ("unit", "factor", "words"),
    [
        ("in", 1.0, "as if readings were in mm for inches"),
        ("cm", 1.0, "as if readings were in mm for cm"),
        ("mm", 0.1, "as if readings were in cm for mm"),
        ("m", 1.0, "what was read spans"),
    ],
)
def test_another_unit_than_the_cell_says(cli, measured, tmp_path, unit, factor, words):
    """Units that are not so far off are found by the fit."""
    cell = measured.cell(tmp_path, f'unit = "{unit}"\n')
    other = replace(measured, points=measured.points * factor)
    file, joints = files.points_text(other, tmp_path), files.joint_list(other, tmp_path)
    said = cli("identify", cell, file, "--joints", joints, "--out", tmp_path / "out")
    assert said.code != 0
    assert [line for line in said.err.split("\n") if words in line], said


def test_exchanged_axes(cli, measured, identified_with, tmp_path):
    """Y and z exchanged are a mirrored frame, which no reader sees: the fit says it."""
    order = [0, 2, 1]
    poses = np.concatenate([measured.poses[:, order], measured.poses[:, 3:]], axis=1)
    other = replace(measured, points=measured.points[:, :, order], poses=poses)
    cell, file, joints = written(identified_with, other, tmp_path)
    said = cli("identify", cell, file, "--joints", joints, "--out", tmp_path / "out")
    assert said.code != 0
    lines = [line for line in (said.err + said.out).split("\n") if "as if" in line]
    assert lines, said
    assert "axes" in lines[0] or "axis" in lines[0]
    assert "right-handed frame" in lines[0]


def test_rows_that_are_there_twice(cli, measured, identified_with, tmp_path):
    """Are left out and named; of a recording they are frames at one time."""
    cell, file, joints = written(identified_with, measured, tmp_path)
    before = identified(cli, tmp_path / "a", cell, file, "--joints", joints)
    edited(file, lambda lines: [*lines[:15], *lines[10:15], *lines[15:]])
    after = identified(cli, tmp_path / "b", cell, file, "--joints", joints)
    np.testing.assert_allclose(values(after), values(before), atol=1e-9)
    said = [line for line in after["warnings"] if "number by number" in line]
    assert len(said) == 1
    assert "left out" in said[0]


def test_a_gap(cli, measured, identified_with, tmp_path):
    """Poses that were not recorded are named; of a recording in order, their number is."""
    cell, file, joints = written(identified_with, measured, tmp_path)
    if identified_with.is_stream:

        def without(lines: list[str]) -> list[str]:
            return [*lines[:400], *lines[500:]]

        edited(file, without)
        line = refused(cli, cell, file, joints)
        assert re.search(r"has \d+ standstills, and \S+ 24 poses", line)
        return
    edited(file, lambda lines: [line for line in lines if not re.search(r"\bP0[56]\b", line)])
    found = identified(cli, tmp_path / "a", cell, file, "--joints", joints)
    said = [line for line in found["warnings"] if "nothing was read" in line]
    assert len(said) == 1
    assert "of 2 poses" in said[0]
    assert "P05, P06" in said[0]
