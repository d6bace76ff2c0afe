"""Files of instruments give the measurements that were written into them, whatever their layout."""

import re
from pathlib import Path

import numpy as np
import pytest

from calib import Robot
from calib.errors import FileFormatError
from calib.se3 import FloatArray, rotation_exp
from posedesign.cell import Cell
from posedesign.cell.schema_sections import InstrumentSection
from posedesign.identification.instruments import read_measured
from posedesign.identification.instruments.joint_logs import read_joint_rows
from tests import instrument_files as files
from tests.instrument_files import Session, session
from tests.rails import on_slides

ALL = f"reflectors = {list(files.REFLECTORS)}".replace("'", '"')


@pytest.fixture(scope="module")
def kuka() -> Session:
    return session(count=10)


@pytest.fixture(scope="module")
def ur() -> Session:
    return session("ur10e", 10)


@pytest.fixture(scope="module")
def abb() -> Session:
    return session("irb6700_200_260", 10)


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


@pytest.mark.parametrize(
    ("name", "match"),
    [*((name, "time") for name in LOGS), ("rsi telegrams", "order"), ("rostopic", "order")],
)
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
    assert found.table.notes == ()
    np.testing.assert_allclose(found.table.data.postures, expected.postures, atol=1e-8)
    read = found.table.data.observed
    np.testing.assert_allclose(read[:, :3], expected.observed[:, :3], atol=2e-9)


ON_A_RAIL = np.array([[1.25, *np.linspace(-0.9, 0.9, 6)], [24.5, *np.linspace(0.4, -0.5, 6)]])
"""Postures [m, rad], the second farther along than joints can turn in degrees."""


def on_a_rail(folder: Path, preset: str, maker: str) -> Robot:
    path = folder / "arm.urdf"
    path.write_text(on_slides(preset, (("rail", "0 1 0", "0", "30"),)))
    return Robot.from_urdf(path).controlled_by(maker)


def railed_log(name: str, robot: Robot, q: FloatArray = ON_A_RAIL) -> list[str]:
    """Two rows of a log: what its controller shows, or joints by name in metres and radians."""
    assert robot.controller is not None
    shown, names = robot.controller.pendant(q), robot.joint_names
    if name == "rsi telegrams":
        return [
            "<Rob><AIPos "
            + " ".join(f'A{k + 1}="{v}"' for k, v in enumerate(row[1:]))
            + f'/><EIPos E1="{row[0]}" E2="7.0"/><IPOC>{1000 + 4 * i}</IPOC></Rob>'
            for i, row in enumerate(shown.tolist())
        ]
    if name == "rsi table":
        head, rows = ["E1", *(f"A{k}" for k in range(1, 7)), "IPOC"], shown
    elif name == "egm":
        head = ["R_FB_POS_EJ1", *(f"R_FB_POS_RJ{k}" for k in range(1, 7)), "TIMESTAMP"]
        rows = shown
    elif name == "plotjuggler":
        head, rows = [*(f"/joint_states/{n}/position" for n in names), "__time"], q
    else:
        last = [*range(1, 7), 0]  # by the alphabet, the rail stands last
        texts = [[f"{v:.12f}" for v in row] for row in q[:, last].tolist()]
        order = [names[k] for k in last]
        if name == "ros2 topic":
            return [
                ",".join([f"160000000{i}", "0", "base", *order, *row, *["0"] * 14])
                for i, row in enumerate(texts)
            ]
        head = [f"field.{what}{k}" for what in ("name", "position") for k in range(7)]
        lines = [",".join([*order, *row, str(i)]) for i, row in enumerate(texts)]
        return [",".join([*head, "%time"]), *lines]
    return [",".join(head), *(",".join(map(str, [*row, i])) for i, row in enumerate(rows.tolist()))]


@pytest.mark.parametrize(
    ("name", "preset", "maker"),
    [
        ("rsi telegrams", "kr6r900sixx", "kuka"),
        ("rsi table", "kr6r900sixx", "kuka"),
        ("egm", "irb120", "abb"),
        ("rostopic", "ur10e", "ur"),
        ("ros2 topic", "ur10e", "ur"),
        ("plotjuggler", "ur10e", "ur"),
    ],
)
def test_logs_have_the_rail_that_carries_the_arm(tmp_path, name, preset, maker):
    robot = on_a_rail(tmp_path, preset, maker)
    lines, section = railed_log(name, robot), InstrumentSection()
    path = files.save(tmp_path / "log.csv", lines)
    found = read_joint_rows(path, robot, section)
    np.testing.assert_allclose(found.postures, ON_A_RAIL, atol=1e-9)
    without = [re.sub(r"E(?=[1J])|rail|<EIPos[^>]*>", "X", line) for line in lines]
    files.save(path, without)
    with pytest.raises(FileFormatError, match=r"EIPos for|without the column|no joint|has no"):
        read_joint_rows(path, robot, section)


@pytest.mark.parametrize(
    ("name", "preset", "maker"),
    [
        ("rsi telegrams", "kr6r900sixx", "kuka"),
        ("rsi table", "kr6r900sixx", "kuka"),
        ("egm", "irb120", "abb"),
    ],
)
def test_an_axis_of_a_log_that_moves_is_described_or_refused(tmp_path, name, preset, maker):
    """E2 beside a rail, or the rail itself where the description has none."""
    robot = on_a_rail(tmp_path, preset, maker)
    alone = Robot.preset(preset).controlled_by(maker)
    lines, section = railed_log(name, robot), InstrumentSection()
    path = files.save(tmp_path / "log.csv", lines)
    with pytest.raises(FileFormatError, match=r"E\w*1( of EIPos)? moves, and the robot's"):
        read_joint_rows(path, alone, section)
    if name == "rsi telegrams":
        lines = [lines[0], lines[1].replace('E2="7.0"', 'E2="7.1"')]
    else:
        second = {"rsi table": "E2", "egm": "R_FB_POS_EJ2"}[name]
        lines = [f"{second},{lines[0]}", f"7.0,{lines[1]}", f"7.1,{lines[2]}"]
    files.save(path, lines)
    with pytest.raises(FileFormatError, match=r"E\w*2( of EIPos)? moves, and the robot's"):
        read_joint_rows(path, robot, section)
    files.save(path, [line.replace("7.1", "7.005") for line in lines])
    assert len(read_joint_rows(path, robot, section).postures) == 2


@pytest.mark.parametrize("name", ["rostopic", "ros2 topic", "plotjuggler", "table"])
def test_a_joint_that_the_cell_holds_stands_there_in_the_log(tmp_path, name):
    """It carries the arm: what is read elsewhere is of another base."""
    robot = on_a_rail(tmp_path, "ur10e", "ur")
    q, texts = ON_A_RAIL.copy(), []
    for rail in ((1.25, 24.5), (1.25, 1.25), (1.0, 1.0)):
        q[:, 0] = rail
        lines = railed_log("plotjuggler" if name == "table" else name, robot, q)
        if name == "table":
            head = [f"{joint}_{'rad' if k else 'm'}" for k, joint in enumerate(robot.joint_names)]
            lines[0] = ",".join([*head, "time_s"])
        texts.append(lines)
    held = Robot.from_urdf(tmp_path / "arm.urdf", held_m={"rail": 1.25}).controlled_by("ur")
    path, section = tmp_path / "log.csv", InstrumentSection()
    files.save(path, texts[0])
    with pytest.raises(FileFormatError, match=r"rail(_m)? moves, and the cell holds it"):
        read_joint_rows(path, held, section)
    files.save(path, texts[1])
    found = read_joint_rows(path, held, section).postures
    np.testing.assert_allclose(found, ON_A_RAIL[:, 1:], atol=1e-9)
    files.save(path, texts[2])
    with pytest.raises(FileFormatError, match="stands at 1000, and the cell holds it at 1250"):
        read_joint_rows(path, held, section)


@pytest.mark.parametrize("shown", ["", "pendant_"])
def test_an_external_axis_of_a_table_is_described_or_refused(tmp_path, shown):
    columns = [f"{shown}{name}" for name in ("e1_mm", *(f"j{k}_deg" for k in range(1, 7)))]
    path = files.save(
        tmp_path / "q.csv", [",".join(["pose", *columns]), "P1,400,10,20,30,40,50,60"]
    )
    with pytest.raises(FileFormatError, match="e1_mm: the robot has 0 external axes only"):
        read_joint_rows(path, Robot.preset("ur10e"), InstrumentSection())


def test_a_log_without_external_axes_is_none_of_an_arm_on_a_rail(tmp_path):
    head = [*(f"actual_q_{k}" for k in range(6)), "timestamp"]
    path = files.save(tmp_path / "log.csv", [",".join(head), "0,0,0,0,0,0,0"])
    robot = on_a_rail(tmp_path, "ur10e", "ur")
    with pytest.raises(FileFormatError, match="a log of RTDE, which has no external axes"):
        read_joint_rows(path, robot, InstrumentSection())


def test_two_recordings_go_together_by_time(kuka, tmp_path):
    """Motion capture and joints on two clocks that are so far apart."""
    cell = Cell.load(kuka.cell(tmp_path, 'kind = "pose"\nclock_offset_s = 90.0'))
    found = read_measured(cell, files.motive(kuka, tmp_path), files.rsi_table(kuka, tmp_path))
    check_same(found.table, kuka.native("pose"))
    assert "by time" in found.table.facts["measured"]
    assert any(
        "the arm was not at rest" in note and "left out" in note for note in found.table.notes
    )
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
