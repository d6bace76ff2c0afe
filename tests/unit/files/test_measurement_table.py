"""Tables of measurements: what is written is read back, of every kind and every mixture."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.errors import FileFormatError, InputError
from calib.model.measurements import KINDS
from calib.se3 import rotation_angle, rotation_exp
from posedesign.files.csv_tables import read_rows, write_table
from posedesign.files.measurements import read_measurements, write_measurements
from posedesign.identification.checks import check_readings

EXACT = 4e-11
"""[rad, m]: nine decimals of mm and degrees, through W, P and R and back."""

MIXTURES = [
    *([kind] for kind in KINDS),
    ["touch-up", "plane"],
    ["pose", "touch-up"],
    ["point", "distance", "view-line"],
    list(KINDS),
]


def named(kinds: list[str]) -> str:
    """The id of a mixture."""
    return "+".join(kinds)


@pytest.mark.parametrize("kinds", MIXTURES, ids=named)
def test_round_trip(tmp_path, lab, kinds):
    measured = lab.measure(kinds, 6, tools=("tool", "ball"), targets_each=2, noise=1e-4)
    data = measured.data
    path = write_measurements(tmp_path / "m.csv", data, measured.kinds)
    table = read_measurements(path, 6)
    found = table.data
    np.testing.assert_allclose(found.postures, data.postures, rtol=0, atol=EXACT)
    assert table.kinds == measured.kinds
    assert table.lines == tuple(range(2, 2 + data.count))
    assert found.names == data.names
    assert table.notes == ()
    for index in ("kind", "tool", "target", "payload"):
        np.testing.assert_array_equal(getattr(found.setup, index), getattr(data.setup, index))
    assert (found.targets, found.tools) == (data.targets, data.tools)
    if not any(KINDS[kind].reads for kind in kinds):
        assert found.observed is None
        return
    assert found.observed is not None
    assert data.observed is not None
    for k, kind in enumerate(kinds):
        own = data.setup.kind == k
        lengths = KINDS[kind].rows - KINDS[kind].turns
        got, wanted = found.observed[own], data.observed[own]
        if not KINDS[kind].reads:
            assert not got.any()
            continue
        np.testing.assert_allclose(got[:, :lengths], wanted[:, :lengths], rtol=0, atol=EXACT)
        if KINDS[kind].turns:
            R = np.swapaxes(rotation_exp(got[:, 3:6]), -1, -2) @ rotation_exp(wanted[:, 3:6])
            assert rotation_angle(R).max() < EXACT


def test_only_columns_that_are_needed(tmp_path, lab):
    def columns(kinds: list[str], **more: Any) -> list[str]:
        measured = lab.measure(kinds, 3, **more)
        path = write_measurements(tmp_path / "m.csv", measured.data, measured.kinds)
        return [c for c in read_rows(path)[0] if not c.startswith("j")]

    places, turns = ["x_mm", "y_mm", "z_mm"], ["w_deg", "p_deg", "r_deg"]
    assert columns(["touch-up"]) == ["target", "pose", "kind"]
    assert columns(["point"], tools=("a", "b")) == ["target", "pose", "kind", "tool", *places]
    assert columns(["pose"]) == ["target", "pose", "kind", *places, *turns]
    assert columns(["distance", "plane"]) == ["target", "pose", "kind", "distance_mm"]


def test_payloads_by_name(tmp_path, lab):
    measured = lab.measure(["touch-up"], 4, payload=[0, 2, 1, 0])
    path = write_measurements(tmp_path / "m.csv", measured.data, measured.kinds, ["bag", "box"])
    rows = read_rows(path)[1]
    assert [row.cells["payload"] for row in rows] == ["", "box", "bag", ""]
    table = read_measurements(path, 6, payloads=["bag", "box"])
    assert table.data.setup.payload.tolist() == [0, 2, 1, 0]
    with pytest.raises(FileFormatError, match=r"line 3, column payload: .* no payload 'box'") as e:
        read_measurements(path, 6, payloads=["boxes"])
    assert "boxes" in e.value.hint
    with pytest.raises(FileFormatError) as e:
        read_measurements(path, 6)
    assert "[[payload]]" in e.value.hint


def test_without_kinds_they_are_those_of_the_cell(tmp_path, lab):
    measured = lab.measure(["view-line"], 3)
    path = write_measurements(tmp_path / "m.csv", measured.data)
    assert "kind" not in read_rows(path)[0]
    assert read_measurements(path, 6, kind="view-line").kinds == ("view-line",)
    assert read_measurements(path, 6).kinds == ("touch-up",)


def test_what_cannot_be_written(tmp_path, lab):
    measured = lab.measure(["touch-up", "plane"], 3, payload=1)
    path = tmp_path / "m.csv"
    with pytest.raises(InputError, match="a payload of the measurements has no name"):
        write_measurements(path, measured.data, measured.kinds)
    with pytest.raises(InputError, match="a kind of the measurements has no name"):
        write_measurements(path, measured.data, ["touch-up"], ["box"])
    trials = measured.data.repeated(2)
    with pytest.raises(InputError, match="one set"):
        write_measurements(path, trials, measured.kinds, ["box"])
    assert not path.exists()


def test_some_rows_keep_their_lines(tmp_path, lab):
    measured = lab.measure(["plane", "touch-up"], 3)
    path = write_measurements(tmp_path / "m.csv", measured.data, measured.kinds)
    table = read_measurements(path, 6)
    assert table.of_kind("touch-up").tolist() == [3, 4, 5]
    assert table.of_kind("touch-up", "plane").size == 6
    assert table.of_kind("pose").size == 0
    few = table.some(np.array([1, 4]))
    assert few.lines == (3, 6)
    assert few.data.names == ("M2", "M5")
    assert few.kinds == table.kinds


Rows = list[dict[str, object]]


def rows_of(path: Path) -> tuple[list[str], Rows]:
    """Columns and rows of a table, to be changed."""
    columns, rows = read_rows(path)
    return columns, [dict(row.cells) for row in rows]


def written(tmp_path: Path, lab: Any, kinds: list[str]) -> tuple[Path, list[str], Rows]:
    """A table of some kinds, with its columns and rows."""
    measured = lab.measure(kinds, 4)
    path = write_measurements(tmp_path / "m.csv", measured.data, measured.kinds)
    return path, *rows_of(path)


def test_a_reading_that_is_missing_is_named(tmp_path, lab):
    path, columns, rows = written(tmp_path, lab, ["point", "distance"])
    rows[2]["y_mm"] = ""
    write_table(path, columns, rows)
    with pytest.raises(FileFormatError, match="line 4, column y_mm: a point needs x_mm") as e:
        read_measurements(path, 6)
    assert e.value.hint == "fill it, remove the row"
    rows[2]["distance_mm"] = "12"
    write_table(path, columns, rows)
    with pytest.raises(FileFormatError) as e:
        read_measurements(path, 6)
    assert "or call it a distance" in e.value.hint


@pytest.mark.parametrize(
    ("kinds", "called", "message", "hint"),
    [
        (["point"], "pose", "a pose is read from .*there is no w_deg", "or call it a point"),
        (["distance"], "point", "a point is read from .*there is no x_mm", "call it a distance"),
        (["point"], "distance", "a distance is read from", "or call it a point"),
        (["touch-up"], "distance", "there is no column distance_mm", "known: target"),
        (["point"], "Pont", "line 2, column kind: there is no kind of .* 'Pont'", "point"),
    ],
)
def test_a_kind_that_the_columns_do_not_fit(tmp_path, lab, kinds, called, message, hint):
    path, columns, rows = written(tmp_path, lab, kinds)
    write_table(path, columns, [row | {"kind": called} for row in rows])
    with pytest.raises(FileFormatError, match=message) as e:
        read_measurements(path, 6)
    assert hint in e.value.hint


def test_readings_that_nobody_reads_are_noted(tmp_path, lab):
    path, columns, rows = written(tmp_path, lab, ["point"])
    write_table(path, [c for c in columns if c != "kind"], rows)
    (note,) = read_measurements(path, 6).notes
    assert "x_mm, y_mm, z_mm of 4 rows are not read, because a touch-up has no readings" in note
    write_table(path, columns, [row | {"distance_mm": "1"} for row in rows])
    assert read_measurements(path, 6).notes == ()  # no such column
    write_table(path, [*columns, "distance_mm"], [row | {"distance_mm": "1"} for row in rows])
    (note,) = read_measurements(path, 6).notes
    assert "distance_mm of 4 rows are not read, because a point has x_mm, y_mm, z_mm" in note


def test_a_plane_is_nothing_else(tmp_path, lab):
    path, columns, rows = written(tmp_path, lab, ["plane", "touch-up"])
    for row in rows:
        row["target"] = "T1"
    write_table(path, columns, rows)
    with pytest.raises(
        FileFormatError,
        match="line 6, column target: T1 is the target of a touch-up here, and a plane on line 2",
    ):
        read_measurements(path, 6)


@pytest.mark.parametrize("column", ["target", "pose", "tool"])
@pytest.mark.parametrize("character", ["\x1b", "\x9b", "\x7f", "\n"])
def test_names_do_not_steer_the_terminal(tmp_path, lab, column, character):
    path, columns, rows = written(tmp_path, lab, ["touch-up"])
    rows[1] |= {"tool": "tool", column: f"T{character}[31m"}
    write_table(path, [*columns, "tool"], rows)
    with pytest.raises(FileFormatError, match=f"column {column}: .* cannot be shown"):
        read_measurements(path, 6)


def test_one_pose_has_one_posture(tmp_path, lab):
    path, columns, rows = written(tmp_path, lab, ["touch-up"])
    rows[3]["pose"] = rows[1]["pose"]
    write_table(path, columns, rows)
    with pytest.raises(FileFormatError, match="pose M2 has other joint values on line 3"):
        read_measurements(path, 6)


def scaled(rows: Rows, factors: dict[str, float]) -> Rows:
    """Rows with some columns in another unit."""
    return [
        row | {key: float(str(row[key])) * factor for key, factor in factors.items()}
        for row in rows
    ]


PLACES = ("x_mm", "y_mm", "z_mm")
TURNS = ("w_deg", "p_deg", "r_deg")


@pytest.mark.parametrize(
    ("kind", "factors", "column", "hint"),
    [
        ("point", dict.fromkeys(PLACES, 1e-3), "x_mm to z_mm", "metres, multiply them by 1000"),
        ("pose", dict.fromkeys(PLACES, 1e-3), "x_mm to z_mm", "metres, multiply them by 1000"),
        ("point", dict.fromkeys(PLACES, 1 / 25.4), "x_mm to z_mm", "inches, multiply them by 25.4"),
        ("point", dict.fromkeys(PLACES, 1e3), "x_mm to z_mm", "micrometres"),
        ("camera-pose", dict.fromkeys(PLACES, 1e-3), "x_mm to z_mm", "metres"),
        ("distance", {"distance_mm": 1e-3}, "distance_mm", "metres"),
        ("distance", {"distance_mm": 1e3}, "distance_mm", "micrometres"),
        ("pose", dict.fromkeys(TURNS, np.pi / 180.0), "w_deg to r_deg", "57.29578"),
        ("camera-pose", dict.fromkeys(TURNS, np.pi / 180.0), "w_deg to r_deg", "57.29578"),
    ],
)
def test_units_of_readings(tmp_path, lab, kind, factors, column, hint):
    path, columns, rows = written(tmp_path, lab, [kind])
    check_readings(lab.cell, read_measurements(path, 6))  # as they are they are believed
    write_table(path, columns, scaled(rows, factors))
    with pytest.raises(FileFormatError) as e:
        check_readings(lab.cell, read_measurements(path, 6))
    assert e.value.column == column
    assert e.value.message.startswith(str(path))
    assert hint in e.value.hint


def test_turns_that_are_written_otherwise(tmp_path, lab):
    """Rotation vectors in the columns of W, P and R."""
    measured = lab.measure(["pose"], 30)
    path = write_measurements(tmp_path / "m.csv", measured.data, measured.kinds)
    columns, rows = rows_of(path)
    vectors = np.rad2deg(measured.data.observed[:, 3:6]).tolist()
    rows = [row | dict(zip(TURNS, v, strict=True)) for row, v in zip(rows, vectors, strict=True)]
    write_table(path, columns, rows)
    with pytest.raises(FileFormatError, match="otherwise than the arm") as e:
        check_readings(lab.cell, read_measurements(path, 6))
    assert "W, P, R turn about fixed x, y, z in this order" in e.value.hint


def test_a_point_that_the_arm_turns_about_may_stand_still(tmp_path, lab):
    """Touch-ups that a tracker watches: the tool point does not move, the readings do not."""
    measured = lab.measure(["touch-up"], 20)
    readings = np.random.default_rng(2).normal(0.5, 1e-4, (20, 3))
    data = replace(measured.data, observed=readings)
    path = write_measurements(tmp_path / "m.csv", data, ["point"])
    check_readings(lab.cell, read_measurements(path, 6))


def test_one_wrong_rotation_does_not_condemn_the_table(tmp_path, lab):
    path, columns, rows = written(tmp_path, lab, ["pose"])
    rows[0]["r_deg"] = float(str(rows[0]["r_deg"])) + 90.0
    write_table(path, columns, rows)
    check_readings(lab.cell, read_measurements(path, 6))


def test_more_measurements_than_can_be_identified_are_refused_at_once(tmp_path):
    path = tmp_path / "m.csv"
    row = "T1,0,0,0,0,0,0\n"
    path.write_text("target,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg\n" + row * 50_001)
    with pytest.raises(FileFormatError, match="holds 50001 measurements, 50000 are the most"):
        read_measurements(path, 6)
