"""Points that stand on one line as JSON: read as a parser of YAML reads them, only sooner."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from calib.errors import FileFormatError
from posedesign.files.yaml_tree import json_items
from posedesign.programs import DIALECTS, PoseProgram, ProgramOptions, ProgramPose, RecordedProgram

TRAJECTORY = DIALECTS["ros-trajectory"]


def parse(text: str) -> RecordedProgram:
    return TRAJECTORY.parse(text.encode(), Path("x.yaml"))


def written() -> str:
    q = np.random.default_rng(1).uniform(-3, 3, (5, 6))
    poses = tuple(ProgramPose(f"P{i}", row) for i, row in enumerate(q))
    options = ProgramOptions(fingerprint="abcdef12", settle_s=0.0)
    return next(iter(TRAJECTORY.files(PoseProgram("CAL", poses, options)).values()))


def test_every_point_is_read_the_quick_way_and_alike() -> None:
    text = written()
    short, items = json_items(text)
    assert len(items) == 5
    assert "positions" not in short
    assert short.count("\n") == text.count("\n")
    slow = parse(yaml.safe_dump(yaml.safe_load(text)))
    quick = parse(text)
    for a, b in zip(slow.positions, quick.positions, strict=True):
        np.testing.assert_array_equal(a.shown_deg, b.shown_deg)
    rows = text.splitlines()
    assert all('"positions"' in rows[p.line - 1] for p in quick.positions)


def test_a_text_that_looks_like_a_point_is_none() -> None:
    point = '- {"positions": [0.5]}'
    text = f"note: |\n  x\n\n  {point}\njoint_names: [a]\npoints:\n{point}\n"
    assert parse(text).positions[0].shown_deg == pytest.approx(np.degrees([0.5]))
    quoted = f"'a\n{point}\nb'\n"  # one text, of three lines
    assert json_items(quoted)[1]
    with pytest.raises(FileFormatError, match="the trajectory is not a map"):
        parse(quoted)


@pytest.mark.parametrize(
    ("point", "message"),
    [
        ('- {"positions": [0.5], "positions": [0.5]}', "has the key 'positions' twice"),
        ('- {"positions": [NaN]}', "positions: a is 'NaN', not a number"),
        ('- {"positions": [1e400]}', "positions: a is '1e400', not a number"),
        ('- {"positions": [' + "9" * 400 + "]}", "positions: a is '999.*', not a number"),
        ('- {"positions": [' + "9" * 5000 + "]}", "positions: a is '999.*', not a number"),
        ('- {"positions": [99999]}', "beyond"),
        ('- {"positions": [true]}', "positions: a is 'true', not a number"),
        ('- {"positions": ["0.5"]}', "a text in quotes, not a number"),
        ('- {"positions": [13.0]}', "beyond"),
        ('- {"positions": [[0.5]]}', "a is not a number"),
        ('- {"positions": [0.5, 0.5]}', "has 2 values, there are 1 joints"),
        ('- {"positions": []}', "has 0 values"),
        ('- {"positions": {"a": 0.5}}', "positions is not a list"),
        ('- {"velocities": [0.5]}', "positions is missing"),
        ('- {"positions": [0.5]', "is no YAML"),
        ('- {"positions": ' + "[" * 5000 + "]" * 5000 + "}", "nested more than|not a number"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(point: str, message: str) -> None:
    with pytest.raises(FileFormatError, match=message) as caught:
        parse(f'joint_names: [a]\npoints:\n- {{"positions": [0.25]}}\n{point}\n')
    assert caught.value.row in (4, 5)
