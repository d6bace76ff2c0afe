"""Measurements of real arms with the cells that they are identified by."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from calib.model.measurements import Measurements
from posedesign.cell import Cell
from posedesign.files.measurements import MeasurementTable, read_measurements
from posedesign.identification.instruments import read_measured
from posedesign.study.library import find_study

TOUCHED = """
[robot]
preset = "panda"
tip = "panda_link8"
[tool]
point_mm = [0.0, 0.0, 100.0]
[base_pose]
posture_deg = [0.0, 0.0, 0.0, -90.0, 0.0, 90.0, 0.0]
[measurement]
three_sigma_mm = [0.3, 0.3, 0.3]
"""

TRACKED = """
[robot]
preset = "{preset}"
[tool]
point_mm = [0.0, 0.0, 100.0]
[base_pose]
posture_deg = [0.0, 0.0, 0.0, 0.0, {fifth}, 0.0]
[target]
name = "tracker"
position_mm = [2500.0, 0.0, 500.0]
[measurement]
kind = "point"
[[noise]]
kind = "point"
three_sigma_mm = 0.1
[instrument]
unit = "mm"
frame = "tracker"
reflectors = [{reflectors}]
"""

RealSet = tuple[Cell, MeasurementTable]


def panda(data: Path, folder: Path, site: str = "front") -> RealSet:
    """Touch-ups of both sockets of a site by a ball."""
    lines = ["target," + ",".join(f"j{i}_deg" for i in range(1, 8))]
    for hole in (0, 1):
        path = data / "panda_ball_in_socket" / site / f"hole_{hole}.csv"
        for q in np.rad2deg(np.loadtxt(path, delimiter=",")):
            lines.append(f"{site}_{hole}," + ",".join(f"{v:.9f}" for v in q))
    table, cell = folder / f"{site}.csv", folder / "panda.toml"
    table.write_text("\n".join(lines) + "\n")
    cell.write_text(TOUCHED)
    return Cell.load(cell), read_measurements(table, 7)


def tracked(
    data: Path, folder: Path, preset: str, fifth: float, marks: list[str], first: int, last: int
) -> RealSet:
    """Some of the poses of a set before a laser tracker."""
    kept = [
        line
        for line in (data / "tracker.txt").read_text().splitlines()
        if first <= int(line.split()[0][1:]) <= last and line.split()[1] in marks
    ]
    read, cell = folder / f"{preset}_{first}.txt", folder / f"{preset}.toml"
    read.write_text("\n".join(kept) + "\n")
    names = ", ".join(f'"{mark}"' for mark in marks)
    cell.write_text(TRACKED.format(preset=preset, fifth=fifth, reflectors=names))
    found = read_measured(Cell.load(cell), read, data / "joints.csv")
    return found.cell, found.table


def irb120(data: Path, folder: Path, first: int, last: int) -> RealSet:
    """Three reflectors of an IRB 120."""
    marks = ["SMR1", "SMR2", "SMR3"]
    return tracked(data / "irb120_tracker", folder, "irb120", 30.0, marks, first, last)


def r2000ic(data: Path, folder: Path) -> RealSet:
    """Three reflectors of an R-2000iC, in blocks that move one joint at a time."""
    marks = ["N1", "N2", "N3"]
    return tracked(data / "r2000ic_tracker", folder, "r2000ic165f", -90.0, marks, 1, 36)


def of_study(name: str, data: Path, folder: Path) -> RealSet:
    """The set of a study."""
    cells, table = find_study(name).load().write_tables(data.parent, folder)
    cell = Cell.load(cells[0] if isinstance(cells, list) else cells)
    return cell, read_measurements(table, cell.robot.n)


SETS: dict[str, Callable[[Path, Path], RealSet]] = {
    "panda_ball_in_socket": panda,
    "abb_irb120": lambda data, folder: of_study("03_irb120_measuring_arm", data, folder),
    "ur10": lambda data, folder: of_study("04_ur10_motion_capture", data, folder),
    "irb120_tracker, 60 poses": lambda data, folder: irb120(data, folder, 1, 60),
    "irb120_tracker, 40 others": lambda data, folder: irb120(data, folder, 61, 100),
    "r2000ic_tracker": r2000ic,
}
"""By name, from the folder ``identification`` and one that tables are written to."""


def shuffled(data: Measurements, rng: np.random.Generator) -> Measurements:
    """The same poses in another order."""
    order = rng.permutation(int(data.pose.max()) + 1)
    return data[np.concatenate([np.flatnonzero(data.pose == p) for p in order])]
