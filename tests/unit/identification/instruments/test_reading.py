"""Names, repeats, drift and temperature of readings; what cannot be read is said in one line."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.errors import CalibError
from posedesign.cell import Cell
from posedesign.identification.checks import without_repeats
from posedesign.identification.instruments import (
    goes_with_temperature,
    is_of_instrument,
    read_measured,
)
from posedesign.identification.instruments.measured import Measured
from tests import instrument_files as files
from tests.instrument_files import Session, session

ALL = 'reflectors = ["SMR1", "SMR2", "SMR3"]\n'
PLAIN = 'unit = "mm"\n'
TABLE = '[instrument.columns]\nreflector = "name"\n'


@pytest.fixture(scope="module")
def taken() -> Session:
    return session()


Read = Callable[..., Measured]


@pytest.fixture
def read(taken, tmp_path) -> Read:
    """Measurements out of lines of an instrument, with joints by the names of poses."""

    def measured(section: str, lines: list[str], joints: Path | None = None) -> Measured:
        cell = Cell.load(taken.cell(tmp_path, section))
        path = files.save(tmp_path / "read.csv", lines)
        return read_measured(cell, path, joints or files.joint_list(taken, tmp_path))

    return measured


def said(error: pytest.ExceptionInfo[CalibError]) -> str:
    line = f"{error.value.message} ({error.value.hint})"
    assert "\n" not in line
    assert len(line) < 700
    assert error.value.hint
    return line


def repeated(taken: Session, count: int, sigma_m: float, rng: np.random.Generator) -> list[str]:
    lines = ["pose,name,x_mm,y_mm,z_mm,temperature_c"]
    for k, places in enumerate(taken.points):
        for label, place in zip(files.REFLECTORS, places, strict=True):
            for _ in range(count):
                cells = 1e3 * (place + sigma_m * rng.standard_normal(3))
                text = ",".join(f"{v:.6f}" for v in cells)
                lines.append(f"{taken.names[k]},{label},{text},{20 + 0.1 * k:.1f}")
    return lines


def test_repeats_are_averaged_and_their_scatter_said(read, taken):
    rng = np.random.default_rng(1)
    lines = repeated(taken, 4, 2e-5, rng)
    found = read(ALL + TABLE, lines)
    assert found.table.notes == ()
    assert found.table.data.count == 72
    assert set(found.table.extra["readings"]) == {"4"}
    expected = taken.native("point", files.REFLECTORS).observed
    off = found.table.data.observed - expected
    assert off.std() == pytest.approx(1e-5, rel=0.2)
    assert "(216 degrees of freedom), as [[noise]] says" in found.table.facts["repeats"]
    assert found.table.facts["temperature"] == "20.0 to 22.3 deg C"
    assert found.table.extra["temperature_c"][3] == "20.100000"


def test_another_scatter_than_stated_is_said_and_may_be_taken(read, taken):
    lines = repeated(taken, 4, 6e-5, np.random.default_rng(2))
    (note,) = read(ALL + TABLE, lines).table.notes
    assert re.search(
        r"a reading scatters by 0\.0[56]\d*, .* another noise than the 0\.02[, ]", note
    )
    found = read(ALL + 'noise = "repeats"\n' + TABLE, lines)
    assert found.table.notes == ()
    noise = next(n for n in found.cell.config.noise if n.kind == "point")
    np.testing.assert_allclose(noise.three_sigma_mm, 3 * 0.06 / 2, rtol=0.15)
    kept = [n for n in found.cell.config.noise if n.kind == "pose"]
    assert len(kept) == 1


def test_references_that_move_are_named(read, taken):
    """A drift, a step, and one that stays; after SIGNIFICANT times the number of references."""
    rng = np.random.default_rng(3)
    lines = ["pose,name,x_mm,y_mm,z_mm"]
    course = {
        "REF1": lambda k: [0.01 * k, 0, 0],
        "REF2": lambda k: [0, 0.3 * (k >= 15), 0],
        "REF3": lambda k: [0, 0, 0],
    }
    for k, places in enumerate(taken.points):
        cells = [(files.REFLECTORS[0], 1e3 * places[0])]
        cells += [
            (name, [500 + i, 0, 0] + np.array(moved(k)) + 0.01 * rng.standard_normal(3))
            for i, (name, moved) in enumerate(course.items())
        ]
        for name, values in cells:
            lines.append(f"{taken.names[k]},{name}," + ",".join(f"{v:.6f}" for v in values))
    section = 'reflectors = ["SMR1"]\nreferences = ["REF1", "REF2", "REF3"]\n' + TABLE
    notes = read(section, lines).table.notes
    assert len(notes) == 2
    assert re.search(r"REF1 drifts by 0\.2\d* mm from line 3 to line 95 \(p = ", notes[0])
    assert re.search(r"REF2 steps by 0\.(29|30)\d* mm before line 64 \(p = ", notes[1])
    quiet = [line for line in lines if "REF1" not in line and "REF2" not in line]
    facts = read(section, quiet).table.facts
    assert facts["drift"].startswith("none seen by the reference REF3, 0.0")


def test_one_reading_of_another_place_hides_no_drift(read, taken):
    """293 mm off in one reading: it is named, and the drift that the others show is found."""
    rng = np.random.default_rng(3)
    lines = ["pose,name,x_mm,y_mm,z_mm"]
    for k, places in enumerate(taken.points):
        nest = np.array([500 + 0.01 * k, 0, 0]) + 0.01 * rng.standard_normal(3)
        nest[2] += 293.0 * (k == 7)
        for name, values in ((files.REFLECTORS[0], 1e3 * places[0]), ("REF1", nest)):
            lines.append(f"{taken.names[k]},{name}," + ",".join(f"{v:.6f}" for v in values))
    section = 'reflectors = ["SMR1"]\nreferences = ["REF1"]\n' + TABLE
    stray, drift = read(section, lines).table.notes
    assert "readings of the reference REF1 are of another place: line 17, left out" in stray
    assert re.search(r"REF1 drifts by 0\.2\d* mm from line 3 to line 49 \(p = ", drift)


def test_a_marker_under_two_names_counts_once(read, taken):
    lines = ["pose,name,x_mm,y_mm,z_mm"]
    for k, places in enumerate(taken.points):
        for name, place in zip(files.REFLECTORS, (*places[:2], places[1]), strict=True):
            text = ",".join(f"{v:.6f}" for v in 1e3 * place)
            lines.append(f"{taken.names[k]},{name},{text}")
    table, notes = without_repeats(read(ALL + TABLE, lines).table)
    assert table.data.tools == files.REFLECTORS[:2]
    assert table.data.count == 2 * len(taken.names)
    assert notes[1] == "SMR3: the same places as another mark of the tool, left out"


@pytest.mark.parametrize("system", ["Cylindrical", "spherical"])
def test_coordinates_that_are_no_x_y_z_are_refused(read, taken, system):
    """The head of the file says so."""
    lines = [f"// Coordinate system: {system}", "// Units: Millimeters"]
    lines += [f"A, {name}, 2161.09, 106.68, 26.92" for name in taken.names]
    with pytest.raises(CalibError) as caught:
        read(PLAIN, lines)
    assert f"line 1: says that its coordinates are {system.lower()}" in str(caught.value)
    assert "Cartesian" in said(caught)


def test_a_posture_that_is_gone_back_to_is_a_reference(taken, tmp_path):
    """The first pose again after every sixth, the tracker sinking meanwhile."""
    order = [k for k in range(24) for k in ([k, 0] if k % 6 == 5 else [k])]
    again = replace(taken, q=taken.q[order], points=taken.points[order].copy())
    again.points[..., 2] += 1e-5 * np.arange(len(order))[:, None]
    cell = Cell.load(taken.cell(tmp_path, PLAIN))
    found = read_measured(
        cell, files.points_text(again, tmp_path), files.joint_list(again, tmp_path)
    )
    (note,) = found.table.notes
    assert "the reference tool at the posture of P01 drifts by 0.2" in note


def test_residuals_that_go_with_the_temperature_are_said(read, taken):
    table = read(ALL + TABLE, repeated(taken, 1, 2e-5, np.random.default_rng(4))).table
    T = np.array([float(cell) for cell in table.extra["temperature_c"]])
    noise = 1e-5 * np.random.default_rng(5).standard_normal((72, 3))
    assert goes_with_temperature(table, noise) == []
    (words,) = goes_with_temperature(table, noise + np.outer(T, [0, 0, 3e-5]))
    slope = re.search(r"along z go with the temperature, by (\S+) mm/K", words)
    assert slope is not None
    assert float(slope[1]) == pytest.approx(0.03, rel=0.2)


def test_unknown_names_are_refused_with_the_near_ones(read, taken):
    lines = repeated(taken, 1, 0.0, np.random.default_rng(0))
    lines[40] = lines[40].replace("SMR", "SRM")
    with pytest.raises(CalibError) as error:
        read(ALL + TABLE, lines)
    line = said(error)
    assert "line 41" in line
    assert "no reflector 'SRM" in line
    assert "did you mean SMR" in line
    with pytest.raises(CalibError) as error:
        read(TABLE, lines)
    assert "name those on the tool in instrument.reflectors" in said(error)


BAD: dict[str, tuple[str, Callable[[list[str]], list[str]], str]] = {
    "no unit": ("", lambda x: ["pose,x,y,z", *x[1:]], "does not say the unit"),
    "two units": ('unit = "m"\n', lambda x: x, "in mm, and the cell that they are in m"),
    "units of axes": ("", lambda x: ["pose,x_mm,y_mm,z_m", *x[1:]], "axes have several units"),
    "no number": (
        "",
        lambda x: [*x[:5], x[5].replace(",", ",a", 1), *x[6:]],
        "line 6, column x_mm",
    ),
    "infinite": ("", lambda x: [*x[:5], "P05,inf,1,2", *x[6:]], "line 6, column x_mm"),
    "beyond": ("", lambda x: [*x[:5], "P05,1e300,1,2", *x[6:]], "within 1e+12"),
    "short row": ("", lambda x: [*x[:5], "P05,1,2", *x[6:]], "line 6: has 3 cells"),
    "empty": ("", lambda x: [], "no rows of data"),
    "header alone": ("", lambda x: x[:1], "no rows of data"),
    "all hidden": ("", lambda x: [x[0], *("P01,,," for _ in x[1:])], "has no reading"),
    "other poses": ("", lambda x: [x[0], *(c.replace("P", "Q") for c in x[1:40])], "23 poses"),
    "long line": ("", lambda x: [x[0], "P01," + "1" * 200_000 + ",1,2"], "is no valid CSV"),
    "quote": ("", lambda x: [x[0], '"P01,1,2,3', *x[2:]], "is no valid CSV"),
    "binary": ("", lambda x: [x[0], "P01,1,2,\x00", *x[2:]], "line"),
    "control": ("", lambda x: [*x[:5], x[5].replace("P05", "P\x1b[5m"), *x[6:]], "cannot be shown"),
    "lines": ("", lambda x: [*x, *[""] * 1_000_001], "more than 1000000 lines"),
    "long names": ("", lambda x: [",".join(f"c{k}" * 50_000 for k in range(9))], "no column x"),
    "blanks": ("", lambda x: ["pose,x" + " _" * 40_000 + "y,z", *x[1:]], "no column x"),
    "twice a column": (
        "",
        lambda x: ["pose,x_mm,y_mm,z_mm,z_mm", *(r + ",1" for r in x[1:])],
        "twi",
    ),
    "no time": ('[instrument.columns]\ntime = "pose"\n', lambda x: x, "'P01' is no time"),
    "by time without": ('match = "time"\n', lambda x: x, "has no times to match by"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_read_is_said_in_one_line(read, taken, name):
    section, edit, words = BAD[name]
    lines = ["pose,x_mm,y_mm,z_mm"]
    for pose, place in zip(taken.names, 1e3 * taken.points[:, 0], strict=True):
        lines.append(f"{pose}," + ",".join(f"{v:.6f}" for v in place))
    if name == "other poses":
        lines = lines[:24]  # nor do their numbers fit
    with pytest.raises(CalibError) as error:
        read(section, edit(lines))
    assert words in said(error)


def creeping(text: str) -> str:
    """The first joint turns all the time."""
    head, *rows = text.strip().split("\n")
    cells = [row.split(",") for row in rows]
    moved = [",".join([c[0], str(float(c[1]) + 1e-3 * k), *c[2:]]) for k, c in enumerate(cells)]
    return "\n".join([head, *moved])


LOGS: dict[str, tuple[files.Writer, str, Callable[[str], str], str]] = {
    "degrees in rtde": (
        files.rtde,
        "ur10e",
        lambda t: re.sub(r"(-?\d\.\d{10})", lambda m: str(57.3 * float(m[1])), t),
        "is in radians",
    ),
    "rtde without a joint": (
        files.rtde,
        "ur10e",
        lambda t: t.replace("actual_q_3", "actual_p_3"),
        "RTDE without the column actual_q_3",
    ),
    "rtde of a kuka": (files.rtde, "kr6r900sixx", lambda t: t, "of a controller of ur"),
    "rsi without an axis": (
        files.rsi_telegrams,
        "kr6r900sixx",
        lambda t: t.replace('A3="', 'B3="', 1),
        "A3 of AIPos is '', not a number",
    ),
    "rsi beyond what can be measured": (
        files.rsi_telegrams,
        "kr6r900sixx",
        lambda t: re.sub(r'A3="[^"]*"', 'A3="1E999"', t, count=1),
        "A3 of AIPos is '1E999', not a number within 1e+12",
    ),
    "rsi without some times": (
        files.rsi_telegrams,
        "kr6r900sixx",
        lambda t: re.sub(r"<IPOC>\d+</IPOC>", "", t, count=1),
        "IPOC",
    ),
    "time that goes back": (
        files.egm,
        "irb6700_200_260",
        lambda t: t.replace("\n100000,", "\n90000,", 1),
        "it has to rise",
    ),
    "another robot": (
        files.rostopic,
        "ur10e",
        lambda t: t.replace("elbow_joint", "knee_joint"),
        "has no joint elbow_joint (did you mean",
    ),
    "an arm that never stands": (files.plotjuggler, "ur10e", creeping, "stands still nowhere"),
    "no joints": (
        files.plotjuggler,
        "ur10e",
        lambda t: t.replace("/position", "/effort"),
        "no joints",
    ),
}


@pytest.mark.parametrize("name", LOGS)
def test_logs_that_cannot_be_read_are_said_in_one_line(tmp_path, name):
    write, robot, edit, words = LOGS[name]
    of = session("ur10e" if write is files.rtde else robot, 8)
    log = write(of, tmp_path)
    log.write_text(edit(log.read_text(encoding="utf-8")), encoding="utf-8")
    cell = Cell.load(session(robot).cell(tmp_path, PLAIN))
    with pytest.raises(CalibError) as error:
        read_measured(cell, files.points_text(of, tmp_path), log)
    assert words in said(error)


def test_readings_without_joints_are_refused(taken, tmp_path):
    cell = Cell.load(taken.cell(tmp_path, PLAIN))
    with pytest.raises(CalibError) as error:
        read_measured(cell, files.points_text(taken, tmp_path))
    assert "give the file of the `joints`" in said(error)


def test_clocks_that_do_not_meet_are_said(taken, tmp_path):
    section = 'kind = "pose"\nmatch = "time"\nclock_offset_s = 9000.0\n'
    cell = Cell.load(taken.cell(tmp_path, section))
    with pytest.raises(CalibError) as error:
        read_measured(cell, files.motive(taken, tmp_path), files.rsi_table(taken, tmp_path))
    line = said(error)
    assert "read after the record of joints ends" in line
    assert "clock_offset_s" in line


def test_clocks_that_meet_and_are_not_one_are_said(taken, tmp_path):
    """Both begin at zero, say: what was read moves while the joints stand."""
    cell = Cell.load(taken.cell(tmp_path, 'kind = "pose"\nclock_offset_s = 92.5\n'))
    with pytest.raises(CalibError) as error:
        read_measured(cell, files.motive(taken, tmp_path), files.rsi_table(taken, tmp_path))
    assert re.search(r"moves at \d+ of 2\d poses while the arm stands still", said(error))


def test_what_was_hidden_is_counted(taken, tmp_path):
    cell = Cell.load(taken.cell(tmp_path, 'kind = "pose"\nmatch = "order"\n'))
    path = files.motive(taken, tmp_path, hidden=7)
    found = read_measured(cell, path, files.joint_list(taken, tmp_path))
    assert any(re.search(r"nothing was seen in 7 of \d+ readings", n) for n in found.table.notes)


def test_only_files_of_instruments_are_taken_for_such(taken, tmp_path):
    """A table with joints of its own stays one, whatever the cell says."""
    own = tmp_path / "touchups.csv"
    own.write_text("# origin\ntarget,j1_deg,j2_deg\nT1,1,2\n", encoding="utf-8")
    for section, expected in (("", False), (PLAIN, True)):
        cell = Cell.load(taken.cell(tmp_path, section))
        assert not is_of_instrument(cell, own)
        assert is_of_instrument(cell, files.points_text(taken, tmp_path)) == expected
        assert is_of_instrument(cell, files.motive(taken, tmp_path))
        assert is_of_instrument(cell, files.vicon(taken, tmp_path))
        assert is_of_instrument(cell, files.spatial_analyzer(taken, tmp_path))
