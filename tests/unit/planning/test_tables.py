"""Tables: what is written is read back, and what is no table is refused."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from calib.errors import CalibError, FileFormatError, OutputError
from calib.model.measurements import touch_ups
from calib.se3 import rotation_from_wpr, transform
from posedesign.files import csv_tables
from posedesign.files import safe as files
from posedesign.files.csv_tables import check_columns, read_rows, write_table
from posedesign.files.measurements import read_measurements, write_measurements
from posedesign.hand_eye.pairs import Pairs, read_pairs, write_pairs
from posedesign.motion.route import Route, Stop
from posedesign.planning import plan
from posedesign.planning.pose_plan import PoseSet, PoseStatus
from posedesign.planning.poses_file import read_poses, write_poses

FILES_BETWEEN_EXAMPLES = settings(
    max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
EXACT = 1e-11
"""[rad, m]: nine decimals of a degree are 1.7e-11 rad, half of which is rounding."""

angles = st.floats(-math.pi, math.pi, width=64)
names = st.text(
    st.characters(exclude_categories=["Cc", "Cs", "Zs", "Zl", "Zp"]),
    min_size=1,
    max_size=12,
)


def postures(n: int, least: int = 1) -> st.SearchStrategy[np.ndarray]:
    """Postures of which one joint at least is clearly in degrees."""
    return arrays.arrays(float, st.tuples(st.integers(least, 6), st.just(n)), elements=angles).map(
        lambda q: np.vstack([q, np.full((1, n), 2.0)])
    )


@FILES_BETWEEN_EXAMPLES
@given(q=postures(6), data=st.data())
def test_touch_ups_round_trip(tmp_path, q, data):
    labels = tuple(data.draw(st.lists(names, min_size=1, max_size=3, unique=True)))
    target = np.array(
        data.draw(st.lists(st.integers(0, len(labels) - 1), min_size=len(q), max_size=len(q)))
    )
    path = write_measurements(tmp_path / "t.csv", touch_ups(q, target, labels))
    found = read_measurements(path, 6).data
    np.testing.assert_allclose(found.postures, q, rtol=0, atol=EXACT)
    assert [found.targets[k] for k in found.target] == [labels[k] for k in target]


@FILES_BETWEEN_EXAMPLES
@given(
    x=arrays.arrays(float, (3, 2, 6), elements=st.floats(-1.0, 1.0)),
    labels=st.lists(names, min_size=3, max_size=3),
)
def test_pairs_round_trip(tmp_path, x, labels):
    wpr = x[..., 3:] * [math.pi, 0.49 * math.pi, math.pi]
    T = transform(rotation_from_wpr(wpr), 10.0 * x[..., :3])
    path = write_pairs(tmp_path / "p.csv", Pairs(tuple(labels), T[:, 0], T[:, 1]))
    found = read_pairs(path, trust_units=True)
    assert found.names == tuple(labels)
    np.testing.assert_allclose(found.A, T[:, 0], rtol=0, atol=3 * EXACT)
    np.testing.assert_allclose(found.B, T[:, 1], rtol=0, atol=3 * EXACT)


def test_pairs_at_the_pole_of_wpr(tmp_path):
    """W and R are not unique at P = 90 deg; the rotation is."""
    wpr = np.array([[0.3, math.pi / 2, -0.2], [1.0, -math.pi / 2, 2.0], [math.pi, 0.0, -math.pi]])
    T = transform(rotation_from_wpr(wpr), np.zeros((3, 3)))
    found = read_pairs(write_pairs(tmp_path / "p.csv", Pairs(("a", "b", "c"), T, T)))
    np.testing.assert_allclose(found.A, T, rtol=0, atol=1e-8)


@FILES_BETWEEN_EXAMPLES
@given(
    share=arrays.arrays(float, st.tuples(st.integers(1, 5), st.just(6)), elements=st.floats(0, 1)),
    dropped=st.sets(st.integers(0, 4)),
)
def test_poses_round_trip(tmp_path, reference_cell, share, dropped):
    robot = reference_cell.robot
    q = np.vstack([robot.lower + share * robot.joint_range, reference_cell.base_posture])
    status = [PoseStatus.DROPPED if i in dropped else PoseStatus.GRID for i in range(len(q))]
    status[-1] = PoseStatus.REPAIRED
    why = tuple("=J5, too far" if s is not PoseStatus.GRID else "" for s in status)
    q[sorted(dropped & set(range(len(q) - 1)))] = np.nan
    turned = np.full(len(q), np.deg2rad(12.0))
    poses = PoseSet(q, tuple(status), why, np.tile(np.eye(3), (len(q), 1, 1)), turned)
    assert poses.reasons[-1] == "=J5, too far; replaced by a pose turned by 12 deg"
    kept = [i for i, s in enumerate(status) if s is not PoseStatus.DROPPED]
    # visited backwards, with a posture in between that is only passed through
    stops = [Stop(poses.kept[k], k) for k in reversed(range(len(kept)))]
    route = Route((stops[0], Stop(reference_cell.base_posture, None), *stops[1:]), {})
    path = write_poses(tmp_path / "q.csv", robot, poses, route, reference_cell.tool_m)
    kept = kept[::-1]
    for count in (6, None):
        found = read_poses(path, count, trust_units=True)
        np.testing.assert_allclose(found.measured.postures, q[kept], rtol=0, atol=EXACT)
        assert found.measured.names == tuple(f"P{i + 1:02d}" for i in kept)
        assert np.flatnonzero(found.via).tolist() == [1]
        np.testing.assert_allclose(found.postures[1], reference_cell.base_posture, atol=EXACT)
    _, rows = read_rows(path)
    assert [row.cells["name"] for row in rows if row.cells["status"] == "via"] == ["V01"]
    for row in rows:
        if row.cells["status"] == "via":
            continue
        i = int(row.cells["name"][1:]) - 1
        assert row.cells["reason"] == poses.reasons[i]
        if i in kept:
            point = [float(row.cells[f"{axis}_mm"]) / 1e3 for axis in "xyz"]
            wanted = robot.state(q[i]).point(reference_cell.tool_m)
            np.testing.assert_allclose(point, wanted, rtol=0, atol=1e-11)
            wpr = np.deg2rad([float(row.cells[f"{axis}_deg"]) for axis in "wpr"])
            np.testing.assert_allclose(
                rotation_from_wpr(wpr), robot.fk(q[i])[:3, :3], rtol=0, atol=3 * EXACT
            )
        else:
            assert row.cells["j1_deg"] == row.cells["x_mm"] == ""


@pytest.mark.parametrize(
    ("status", "via"), [("Via", True), ("VIA", True), ("", False), ("Grid", False)]
)
def test_status_as_people_write_it(tmp_path, status, via):
    columns = ["name", "status", *(f"j{i + 1}_deg" for i in range(6))]
    rows = [
        dict.fromkeys(columns[2:], 10.0 * k) | {"status": s}
        for k, s in enumerate((status, "grid"), 1)
    ]
    path = write_table(tmp_path / "p.csv", columns, rows)
    assert read_poses(path, 6).via.tolist() == [via, False]


def test_unknown_status_is_named(tmp_path):
    columns = ["name", "status", *(f"j{i + 1}_deg" for i in range(6))]
    rows = [dict.fromkeys(columns[2:], 10.0) | {"status": "droped"}]
    path = write_table(tmp_path / "p.csv", columns, rows)
    with pytest.raises(FileFormatError, match="no status 'droped'") as caught:
        read_poses(path, 6)
    assert "dropped" in caught.value.hint


def test_touch_ups_as_the_pendant_shows_them(tmp_path, reference_cell):
    robot = reference_cell.robot
    q = reference_cell.base_posture + np.random.default_rng(1).uniform(-0.5, 0.5, (5, 6))
    assert robot.controller is not None
    columns = [f"pendant_j{i + 1}_deg" for i in range(6)]
    rows = [
        {"target": "T1"} | dict(zip(columns, shown, strict=True))
        for shown in robot.controller.pendant(q)
    ]
    path = write_table(tmp_path / "t.csv", ["target", *columns], rows)
    found = read_measurements(path, 6, controller=robot.controller).data
    np.testing.assert_allclose(found.postures, q, rtol=0, atol=EXACT)
    with pytest.raises(FileFormatError, match="the robot's controller is not known"):
        read_measurements(path, 6)
    poses = read_poses(path, 6, controller=robot.controller)
    np.testing.assert_allclose(poses.postures, q, rtol=0, atol=EXACT)


def test_joints_and_pendant_must_agree(tmp_path, reference_cell):
    """Measurements typed over what the plan left in the pendant's columns must not be lost."""
    robot = reference_cell.robot
    assert robot.controller is not None
    q = np.tile(reference_cell.base_posture, (3, 1))
    own, shown = ([f"{p}j{i + 1}_deg" for i in range(6)] for p in ("", "pendant_"))
    rows = []
    for joints, pendant in zip(np.rad2deg(q), robot.controller.pendant(q), strict=True):
        values = dict(zip(own, joints, strict=True)) | dict(zip(shown, pendant, strict=True))
        rows.append({"target": "T1"} | values)
    path = write_table(tmp_path / "t.csv", ["target", *own, *shown], rows)
    found = read_measurements(path, 6, controller=robot.controller).data
    np.testing.assert_allclose(found.postures, q, atol=EXACT)
    rows[1]["pendant_j3_deg"] += 0.5  # type: ignore[operator]
    path = write_table(tmp_path / "t.csv", ["target", *own, *shown], rows)
    with pytest.raises(FileFormatError, match=r"line 3, column pendant_j3_deg: is 0\.5 deg off"):
        read_measurements(path, 6, controller=robot.controller)


def test_planned_poses_carry_what_the_pendant_shows(tmp_path, reference_cell):
    result = plan(reference_cell)
    robot = reference_cell.robot
    path = tmp_path / "q.csv"
    write_poses(path, robot, result.poses, result.route, reference_cell.tool_m)
    for row in read_rows(path)[1]:
        j2, j3 = float(row.cells["j2_deg"]), float(row.cells["j3_deg"])
        assert float(row.cells["pendant_j3_deg"]) == pytest.approx(j3 - j2, abs=1e-8)
        assert row.cells["pendant_j2_deg"] == row.cells["j2_deg"]


@FILES_BETWEEN_EXAMPLES
@given(
    data=st.binary(max_size=300) | st.text(max_size=300).map(lambda t: t.encode("utf-8", "replace"))
)
def test_random_files_raise_nothing_but_known_errors(tmp_path, data):
    path = tmp_path / "random.csv"
    path.write_bytes(data)
    for read in (lambda: read_poses(path, 6), lambda: read_poses(path, None)):
        with pytest.raises(CalibError):
            read()
    with pytest.raises(CalibError):
        read_measurements(path, 6)
    with pytest.raises(CalibError):
        read_pairs(path)


cells = st.sampled_from(
    ["", "1", "-3.5", "nan", "90", "1e3", "1e308", "0x1", "T1", "dropped", '"', "'", "#", "=1", "٣"]
)


@FILES_BETWEEN_EXAMPLES
@given(rows=st.lists(st.lists(cells, min_size=0, max_size=9), max_size=6))
def test_nearly_good_files_are_read_or_refused(tmp_path, rows):
    path = tmp_path / "near.csv"
    header = "target,j1_deg,j2_deg,status\n"
    path.write_text(header + "".join(",".join(row) + "\n" for row in rows))
    try:
        found = read_measurements(path, 2).data
    except CalibError:
        pass
    else:
        assert np.isfinite(found.postures).all()
        assert all(found.labels)
        assert found.postures.shape == (len(found.target), 2)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, ""),
        (1.0, "1"),
        (-0.0, "0"),
        (-1e-12, "0"),
        (0.1 + 0.2, "0.3"),
        (1e-9, "0.000000001"),
        (-2.5, "-2.5"),
        (1e9, "1000000000"),
        (math.nan, ""),
        (math.inf, "inf"),
        (-math.inf, "-inf"),
        (np.float64(1.5), "1.5"),
        (3, "3"),
        ("=SUM(A1)", "'=SUM(A1)"),
        ("+1", "'+1"),
        ("@x", "'@x"),
        ("  =x", "'  =x"),  # spreadsheets look past the spaces
        ("\N{FULLWIDTH EQUALS SIGN}x", "'\N{FULLWIDTH EQUALS SIGN}x"),
        ("two\r\nlines", '"two\nlines"'),
        ("-1", "'-1"),
        ("#1", '"\'#1"'),  # pandas takes what stands after a bare # for a comment
        ("'x", "''x"),
        ("plain", "plain"),
    ],
)
def test_written_cells(tmp_path, value, text):
    path = write_table(tmp_path / "a.csv", ["a", "b"], [{"a": value, "b": "end"}])
    assert path.read_bytes().decode() == f"a,b\n{text},end\n"


def test_cells_with_commas_quotes_and_line_ends(tmp_path):
    values = ["a,b", 'say "yes"', "two\nlines", "ä€"]
    write_table(tmp_path / "a.csv", ["a"], [{"a": value} for value in values])
    _, rows = read_rows(tmp_path / "a.csv")
    assert [row.cells["a"] for row in rows] == values


def test_lines_are_counted_as_an_editor_does(tmp_path):
    (tmp_path / "a.csv").write_text('# note\n\nname,j1_deg,by\nP1,90,"two\nlines"\nP2,none,me\n')
    with pytest.raises(FileFormatError) as caught:
        read_poses(tmp_path / "a.csv", 1)
    assert (caught.value.row, caught.value.column, caught.value.value) == (6, "j1_deg", "none")


@pytest.mark.parametrize("text", ["1", "+1", "-1.5", ".5", "5.", "1e-3", "1E+3", " 7 ", "'-7"])
def test_numbers_that_people_and_spreadsheets_write(tmp_path, text):
    (tmp_path / "a.csv").write_text(f"j1_deg\n{text}\n")
    found = read_poses(tmp_path / "a.csv", 1).postures
    assert np.rad2deg(found[0, 0]) == pytest.approx(float(text.strip("' ")))


@pytest.mark.parametrize(
    ("rows", "refused"),
    [
        ([[0.1], [0.2], [-6.28]], True),
        ([[0.1], [0.2], [-6.29]], False),
        ([[0.1], [0.2]], False),  # two rows say too little
        ([[0.0], [0.0], [0.0]], False),  # zero is zero in every unit
    ],
)
def test_radians_are_recognised(tmp_path, rows, refused):
    path = write_table(tmp_path / "a.csv", ["j1_deg"], [{"j1_deg": row[0]} for row in rows])
    if refused:
        with pytest.raises(FileFormatError, match="look like radians") as caught:
            read_poses(path, 1)
        assert "57.29578" in caught.value.hint
        assert caught.value.value == 6.28
    expected = np.deg2rad(rows)
    found = read_poses(path, 1, trust_units=refused).postures
    np.testing.assert_allclose(found, expected)


@pytest.mark.parametrize(
    ("found", "said", "hint"),
    [
        (["j1_rad", "j2_deg"], "is in another unit than deg", "call the column j1_deg"),
        (["j_1_deg", "j2_deg"], "there is no column j1_deg", "did you mean j_1_deg"),
        (["x", "y"], "there is no column j1_deg", "known: x, y"),
        (["j1_deg"], "there is no column j2_deg", "did you mean j1_deg"),
        (["j1_deg", "j2_deg", "j3_deg"], "the robot has 2 joints only", "another robot"),
    ],
)
def test_columns(found, said, hint):
    with pytest.raises(FileFormatError, match=said) as caught:
        check_columns(Path("a.csv"), found, ["j1_deg", "j2_deg"], joints=True)
    assert hint in caught.value.hint
    assert caught.value.row == 1


def test_columns_in_any_order_and_more_of_them(tmp_path):
    (tmp_path / "a.csv").write_text("who,j2_deg,target,j1_deg\nme,20,T1,10\n")
    found = read_measurements(tmp_path / "a.csv", 2).data
    np.testing.assert_allclose(np.rad2deg(found.postures), [[10.0, 20.0]])


def test_poses_without_names_are_numbered(tmp_path):
    (tmp_path / "a.csv").write_text("j1_deg,j2_deg\n10,20\n30,40\n")
    assert read_poses(tmp_path / "a.csv", None).names == ("P01", "P02")


@pytest.mark.parametrize("moment", ["write", "rename"])
@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_table_that_fails_leaves_the_old_one(tmp_path, monkeypatch, moment, error):
    path = tmp_path / "a.csv"
    path.write_text("old\n")

    def fail(*_: object) -> None:
        raise error

    if moment == "rename":
        monkeypatch.setattr(Path, "replace", fail)
    else:
        monkeypatch.setattr(files.os, "fsync", fail)
    expected = OutputError if isinstance(error, OSError) else KeyboardInterrupt
    with pytest.raises(expected):
        write_table(path, ["a"], [{"a": 1.0}] * 1000)
    monkeypatch.undo()
    assert path.read_text() == "old\n"
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]


def test_rows_that_cannot_be_made_leave_the_old_table(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("old\n")

    def rows() -> object:
        yield {"a": 1.0}
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_table(path, ["a"], rows())
    assert path.read_text() == "old\n"
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]


def test_a_large_table_is_refused_before_it_is_read(tmp_path, monkeypatch):
    path = tmp_path / "a.csv"
    path.write_text("j1_deg\n" + "10\n" * 100)
    monkeypatch.setattr(csv_tables, "LARGEST_CSV_BYTES", 100)
    with pytest.raises(FileFormatError, match="is larger than"):
        read_rows(path)
