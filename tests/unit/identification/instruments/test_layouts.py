"""Files of instruments give the measurements that were written into them, whatever their layout."""

import numpy as np
import pytest

from calib.se3 import rotation_exp
from posedesign.cell import Cell
from posedesign.identification.instruments import read_measured
from tests import instrument_files as files
from tests.instrument_files import Session, session

ALL = f"reflectors = {list(files.REFLECTORS)}".replace("'", '"')


@pytest.fixture(scope="module")
def kuka() -> Session:
    return session()


@pytest.fixture(scope="module")
def ur() -> Session:
    return session("ur10e")


@pytest.fixture(scope="module")
def abb() -> Session:
    return session("irb6700_200_260")


INSTRUMENTS: dict[str, tuple[files.Writer, str, str]] = {
    "spatial analyzer": (files.spatial_analyzer, f'unit = "mm"\n{ALL}', "points"),
    "name x y z": (files.points_text, 'unit = "mm"', "point"),
    "semicolons and commas": (files.faro_like, files.FARO_COLUMNS, "points"),
    "metres and tabs": (files.api_like, '[instrument.columns]\npose = "No"', "point"),
    "quaternions": (
        files.creaform_like,
        'unit = "mm"\nkind = "pose"\nturn = "quaternion-xyzw"\n[instrument.columns]\n'
        'turn = ["Qx", "Qy", "Qz", "Q0"]\npose = "Name"',
        "pose",
    ),
    "motive bodies": (files.motive, 'kind = "pose"\nmatch = "order"', "pose"),
    "motive marker": (
        lambda s, f: files.motive(s, f, "Millimeters"),
        'match = "order"\nreflectors = ["Tool:Marker 001"]',
        "Tool:Marker 001",
    ),
    "vicon": (files.vicon, 'kind = "pose"\nmatch = "order"', "pose"),
    "vicon quaternions": (
        lambda s, f: files.vicon(s, f, quaternion=True),
        'kind = "pose"\nmatch = "order"',
        "pose",
    ),
}


def native(session: Session, what: str):
    if what == "pose":
        return session.native("pose")
    if what == "points":
        return session.native("point", files.REFLECTORS)
    return session.native("point", () if what == "point" else (what,))


def check_same(table, expected, bound_m: float = 2e-9) -> None:
    """The same postures, labels and readings, within what decimals leave."""
    assert table.data.targets == expected.targets
    assert table.data.tools == expected.tools
    np.testing.assert_array_equal(table.data.setup.tool, expected.setup.tool)
    np.testing.assert_allclose(table.data.postures, expected.postures, atol=1e-9)
    read, wanted = table.data.observed, expected.observed
    np.testing.assert_allclose(read[:, :3], wanted[:, :3], atol=bound_m)
    if wanted.shape[1] == 6:
        R, Q = rotation_exp(read[:, 3:]), rotation_exp(wanted[:, 3:])
        np.testing.assert_allclose(R, Q, atol=1e-9)


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_instruments_give_what_was_written(kuka, tmp_path, name):
    write, section, what = INSTRUMENTS[name]
    cell = Cell.load(kuka.cell(tmp_path, section))
    found = read_measured(cell, write(kuka, tmp_path), files.joint_list(kuka, tmp_path))
    check_same(found.table, native(kuka, what))
    assert found.table.data.names == native(kuka, what).names
    assert found.cell is cell


LOGS: dict[str, tuple[files.Writer, str, float]] = {
    "rtde commas": (files.rtde, "ur", 0.0),
    "rtde spaces": (lambda s, f: files.rtde(s, f, " "), "ur", 0.0),
    "egm": (files.egm, "abb", 0.0),
    "rsi telegrams": (files.rsi_telegrams, "kuka", 0.0),
    "rsi table": (files.rsi_table, "kuka", 0.0),
    "rostopic": (files.rostopic, "ur", 1.6e9),
    "ros2 topic": (files.ros2, "kuka", 1.6e9),
    "plotjuggler": (files.plotjuggler, "abb", 0.0),
}


@pytest.mark.parametrize("name", LOGS)
@pytest.mark.parametrize("match", ["time", "order"])
def test_logs_of_joints_give_what_the_arm_was_at(request, tmp_path, name, match):
    """By time on one clock, and in order without one; units and signs are those of the log."""
    write, arm, epoch = LOGS[name]
    taken = request.getfixturevalue(arm)
    section = f'unit = "mm"\nkind = "pose"\nturn = "quaternion-xyzw"\nmatch = "{match}"\n'
    section += f"clock_offset_s = {epoch}\n" if match == "time" else ""
    section += '[instrument.columns]\nturn = ["Qx", "Qy", "Qz", "Q0"]\npose = "Name"\ntime = "Time"'
    cell = Cell.load(taken.cell(tmp_path, section))
    log = write(taken, tmp_path)
    found = read_measured(cell, files.creaform_like(taken, tmp_path), log)
    expected = taken.native("pose")
    assert found.notes == ()
    np.testing.assert_allclose(found.table.data.postures, expected.postures, atol=1e-8)
    read = found.table.data.observed
    np.testing.assert_allclose(read[:, :3], expected.observed[:, :3], atol=2e-9)


def test_two_recordings_go_together_by_time(kuka, tmp_path):
    """Motion capture and joints on two clocks that are so far apart."""
    cell = Cell.load(kuka.cell(tmp_path, 'kind = "pose"\nclock_offset_s = 90.0'))
    found = read_measured(cell, files.motive(kuka, tmp_path), files.rsi_table(kuka, tmp_path))
    check_same(found.table, kuka.native("pose"))
    assert "by time" in found.facts["measured"]
    assert any("the arm was not at rest" in note and "left out" in note for note in found.notes)
    counts = [int(n) for n in found.table.extra["readings"]]
    assert min(counts) >= 20  # of 41 in two seconds


def test_joints_in_the_same_file(kuka, tmp_path):
    lines = ["x_mm,y_mm,z_mm,a,b,c,d,e,f"]
    for q, p in zip(np.rad2deg(kuka.q), 1e3 * kuka.points[:, 0], strict=True):
        lines.append(",".join(f"{v:.9f}" for v in (*p, *q)))
    path = files.save(tmp_path / "all.csv", lines)
    section = 'joint_unit = "deg"\n[instrument.columns]\njoints = ["a", "b", "c", "d", "e", "f"]'
    found = read_measured(Cell.load(kuka.cell(tmp_path, section)), path)
    check_same(found.table, kuka.native("point"))


def test_reflectors_in_turn_where_the_file_has_no_names(kuka, tmp_path):
    """Rows of three reflectors a pose, and joints, both without names of columns."""
    lines = [",".join(f"{v:.9f}" for v in 1e3 * p) for p in kuka.points.reshape(-1, 3)]
    joints = [",".join(f"{v:.9f}" for v in np.rad2deg(q)) for q in kuka.q]
    section = (
        f'unit = "mm"\nheader = ["x", "y", "z"]\njoint_unit = "deg"\n{ALL}\n'
        'joint_header = ["q1", "q2", "q3", "q4", "q5", "q6"]'
    )
    found = read_measured(
        Cell.load(kuka.cell(tmp_path, section)),
        files.save(tmp_path / "arm.csv", lines),
        files.save(tmp_path / "q.csv", joints),
    )
    check_same(found.table, kuka.native("point", files.REFLECTORS))


def test_the_program_of_the_poses_gives_the_joints(kuka, tmp_path):
    """As of pictures, a list of the controller may stand for the joints."""
    values = files.shown(kuka, kuka.q)
    path = files.save(tmp_path / "list.csv", [",".join(f"{v:.9f}" for v in row) for row in values])
    cell = Cell.load(kuka.cell(tmp_path, 'unit = "mm"'))
    found = read_measured(cell, files.points_text(kuka, tmp_path), path)
    check_same(found.table, kuka.native("point"))
