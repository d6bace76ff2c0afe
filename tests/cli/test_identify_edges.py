"""``posedesign identify`` on files that are wrong, odd, poor, or of something else."""

import csv
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.model import Setup
from calib.model.measurements import Measurements, touch_ups
from calib.se3 import FloatArray, inverse, rotation_from_wpr, rotation_log, transform
from posedesign.cell import Cell
from posedesign.files.measurements import read_measurements, write_measurements
from posedesign.identification import identify_models
from posedesign.report.identification import answer_of_identification
from tests.cli.conftest import offsets_only, rows_of, strict_json

pytestmark = pytest.mark.usefixtures("one_alternative")

PLACES, TURNS = ("x_mm", "y_mm", "z_mm"), ("w_deg", "p_deg", "r_deg")


def save(path: Path, rows: list[dict[str, Any]]) -> Path:
    """Write rows as CSV; columns as in the first."""
    with path.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    return path


def tracked(work: Path, kind: str, count: int = 30) -> Path:
    """A file of readings as an instrument makes them of an arm without errors."""
    cell = Cell.load(work / "cell.toml")
    rng = np.random.default_rng(4)
    q = cell.base_posture + np.deg2rad(25.0) * rng.uniform(-1, 1, (count, 6))
    q = np.clip(q, cell.robot.lower, cell.robot.upper)
    T_base_tool = cell.robot.fk(q) @ transform(np.eye(3), cell.tool_m)
    T_base_tracker = transform(rotation_from_wpr(np.array([0.1, -0.2, 2.0])), [1.0, -3.0, 0.5])
    read = inverse(T_base_tracker) @ T_base_tool
    if kind == "camera-pose":
        read = inverse(read)
    observed: FloatArray = np.concatenate([read[:, :3, 3], rotation_log(read[:, :3, :3])], axis=1)
    if kind == "point":
        observed = observed[:, :3]
    if kind == "distance":
        observed = np.linalg.norm(observed[:, :3], axis=1, keepdims=True)
    data = Measurements(q, Setup.of(count), ("tracker",), observed=observed)
    return write_measurements(work / f"{kind}.csv", data, [kind])


def in_other_units(path: Path, columns: tuple[str, ...], factor: float) -> Path:
    """The same file with some columns times a factor."""
    rows = rows_of(path)
    return save(path, [row | {c: str(float(row[c]) * factor) for c in columns} for row in rows])


@pytest.mark.parametrize(
    ("kind", "columns", "factor", "words"),
    [
        ("point", PLACES, 1e-3, ("column x_mm to z_mm", "moves by", "metres", "by 1000")),
        ("pose", PLACES, 1e-3, ("column x_mm to z_mm", "metres", "by 1000")),
        ("camera-pose", PLACES, 1e-3, ("column x_mm to z_mm", "mm from the instrument", "metres")),
        ("distance", ("distance_mm",), 1e-3, ("column distance_mm", "metres")),
        ("point", PLACES, 1e3, ("column x_mm to z_mm", "spans", "micrometres")),
        ("pose", TURNS, np.pi / 180.0, ("column w_deg to r_deg", "look like radians", "57.29578")),
        ("camera-pose", TURNS, np.pi / 180.0, ("w_deg to r_deg", "look like radians")),
    ],
)
def test_units_that_are_mixed_up(refuse, work, kind, columns, factor, words):
    path = in_other_units(tracked(work, kind), columns, factor)
    line = refuse("identify", work / "cell.toml", path, "--out", work / "out")
    line.says(f"error: {path}", "--trust-units", *words)


def test_units_are_trusted_when_asked(cli, work):
    path = in_other_units(tracked(work, "point"), PLACES, 1e-3)
    said = cli("identify", offsets_only(work / "cell.toml"), path, "--out", work, "--trust-units")
    assert "multiply" not in said.err
    assert said.code != 0  # a tracker in which the arm shrinks by a thousand is believed by no fit


@pytest.mark.parametrize("kind", ["point", "pose", "camera-pose", "distance"])
def test_readings_in_order_are_identified(cli, work, kind):
    path = tracked(work, kind, 40)
    said = cli("identify", offsets_only(work / "cell.toml"), path, "--out", work)
    assert said.code == 0, said.err
    assert f"noise of {kind}, from the residuals: " in said.out
    assert (" mrad" in said.out) == kind.endswith("pose")


WRONG: dict[str, tuple[str, Callable[[list[dict[str, Any]]], object], tuple[str, ...]]] = {
    "an empty reading": (
        "point",
        lambda rows: rows[3].update(y_mm=""),
        ("line 5, column y_mm: a point needs x_mm, y_mm, z_mm", "fill it, remove the row"),
    ),
    "a reading that is no number": (
        "pose",
        lambda rows: rows[1].update(p_deg="1,5"),
        ("line 3, column p_deg: '1,5' is not a finite number",),
    ),
    "an infinite reading": (
        "distance",
        lambda rows: rows[0].update(distance_mm="1e999"),
        ("line 2, column distance_mm: '1e999' is not a finite number",),
    ),
    "a kind that is mistyped": (
        "point",
        lambda rows: rows[2].update(kind="ponit"),
        ("line 4, column kind: there is no kind of measurement 'ponit'", "did you mean point"),
    ),
    "a kind without its columns": (
        "point",
        lambda rows: rows[2].update(kind="pose"),
        ("line 4, column kind: a pose is read from", "there is no w_deg", "or call it a point"),
    ),
    "an unknown payload": (
        "point",
        lambda rows: [row.update(payload="gun") for row in rows],
        ("line 2, column payload: the cell has no payload 'gun'", "[[payload]]"),
    ),
    "a plane that is touched up": (
        "point",
        lambda rows: [row.update(kind="touch-up" if k else "plane") for k, row in enumerate(rows)],
        ("line 3, column target: tracker is the target of a touch-up here, and a plane on line 2",),
    ),
    "a name that steers the terminal": (
        "point",
        lambda rows: rows[5].update(target="\x1b[2J"),
        ("line 7, column target: '\\x1b[2J' has a character that cannot be shown",),
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_one_line_says_what_is_wrong_and_where(refuse, work, case):
    kind, change, words = WRONG[case]
    path = tracked(work, kind)
    rows = rows_of(path)
    change(rows)
    save(path, rows)
    refuse("identify", work / "cell.toml", path, "--out", work / "out").says(f"{path}, ", *words)


def test_readings_without_the_word_for_them(cli, work):
    """Without the column kind they would be touch-ups whose readings are thrown away."""
    cell = offsets_only(work / "cell.toml")
    path = tracked(work, "point")
    rows = [{k: v for k, v in row.items() if k != "kind"} for row in rows_of(path)]
    said = cli("identify", cell, save(path, rows), "--out", work)
    assert said.code != 0
    rows[0]["target"] = rows[0]["target"]
    touched = rows_of(work / "touchups.csv")
    path = save(work / "both.csv", [row | dict.fromkeys(PLACES, "1") for row in touched])
    said = cli("identify", cell, path, "--out", work)
    assert said.code == 0
    assert (
        "x_mm, y_mm, z_mm of 27 rows are not read, because a touch-up has no readings" in said.err
    )


def test_a_known_distance_to_a_target_that_is_not_there(refuse, work):
    cell = work / "cell.toml"
    with cell.open("a") as stream:
        stream.write('[[known_distance]]\ntargets = ["T1", "T9"]\nlength_mm = 500.0\n')
    line = refuse("identify", cell, work / "touchups.csv", "--out", work / "out")
    line.says("a distance to the target 'T9' is known, and it was not measured", "T1")


def test_rows_that_are_there_twice(cli, work):
    cell = offsets_only(work / "cell.toml")
    lines = (work / "touchups.csv").read_text().splitlines()
    path = work / "twice.csv"
    path.write_text("\n".join([*lines, lines[4]]) + "\n")
    said = cli("identify", cell, path, "--out", work / "one", "--json")
    assert said.err == (
        f"warning: {path}: rows that repeat another number by number are left out: line 29 as "
        "line 5\n"
    )
    assert json.loads(said.out)["measurements"] == 27
    path.write_text("\n".join([*lines, *lines[1:]]) + "\n")
    said = cli("identify", cell, path, "--out", work / "two", "--json")
    assert said.err.count("\n") == 1
    assert "line 33 as line 6 and 22 more rows" in said.err


def test_poses_that_are_missing(cli, work):
    rows = rows_of(work / "touchups.csv")
    kept = [row for row in rows if row["pose"] not in ("P03", "P11")]
    path = save(work / "few.csv", kept)
    said = cli("identify", offsets_only(work / "cell.toml"), path, "--out", work)
    assert said.code == 0
    assert "of the poses up to P27 there are no measurements of P03, P11" in said.err


def test_targets_that_are_seen_once(cli, work):
    rows = rows_of(work / "touchups.csv")
    rows[6]["target"], rows[9]["target"] = "S8", "S9"
    said = cli(
        "identify", offsets_only(work / "cell.toml"), save(work / "m.csv", rows), "--out", work
    )
    assert said.code == 0
    assert "measured once, which says nothing but where they are: S8, S9" in said.err


def test_many_rows_outside_the_limits(cli, work):
    rows = [row | {"j4_deg": "380"} for row in rows_of(work / "touchups.csv")]
    said = cli(
        "identify", offsets_only(work / "cell.toml"), save(work / "m.csv", rows), "--out", work
    )
    lines = [line for line in said.err.splitlines() if "joint limits" in line or "is above" in line]
    assert len(lines) == 6
    assert "line 2: joint_4 380.0 deg is above" in lines[0]
    assert lines[-1].endswith("and 22 more rows outside the joint limits")


def test_joints_that_nothing_shows(refuse, change_cell, work):
    joints = ", ".join(f'"joint_{i}"' for i in range(1, 7))
    cell = offsets_only(change_cell({"parameters.zero_offsets": f"[{joints}]"}))
    line = refuse("identify", cell, work / "touchups.csv", "--out", work / "out")
    line.says(
        "cannot identify zero_offset.joint_1, zero_offset.joint_6",
        "zero_offset.joint_6 is absorbed by the tool point",
        "leave them out",
    )


def knocked(work: Path, share: float, size_deg: float = 0.5) -> tuple[Path, list[str]]:
    """Touch-ups of which a share is wrong, and the names of these poses."""
    rng = np.random.default_rng(8)
    rows = rows_of(work / "touchups.csv")
    wrong = rng.choice(len(rows), round(share * len(rows)), replace=False).tolist()
    for i in wrong:
        for j in (2, 3, 5):
            off = size_deg * rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.0)
            rows[i][f"j{j}_deg"] = str(float(rows[i][f"j{j}_deg"]) + off)
    return save(work / "knocked.csv", rows), [rows[i]["pose"] for i in wrong]


def poses_in(text: str) -> set[str]:
    """Names of planned poses in a text."""
    return set(re.findall(r"P\d\d", text))


@pytest.mark.slow
def test_gross_errors_are_left_out_by_name(cli, change_cell, work):
    """A fifth of the touch-ups are wrong."""
    path, wrong = knocked(work, 0.2)
    said = cli("identify", work / "cell.toml", path, "--out", work)
    # tails as heavy as these are weighed by Student's loss
    (note,) = [line for line in said.err.splitlines() if "weighed down because they" in line]
    named = poses_in(note)
    assert len(named & set(wrong)) >= 3
    assert len(named - set(wrong)) <= 1  # beside such slips a good one may look far off

    cell = change_cell({"parameters.loss": '"least-squares"'})
    said = cli("identify", cell, path, "--out", work / "plain")
    (note,) = [line for line in said.err.splitlines() if "far beyond the others" in line]
    assert 'parameters.loss = "graduated" leaves them out' in note
    named = poses_in(note)
    assert named
    assert named <= set(wrong)

    cell = change_cell({"parameters.loss": '"graduated"'})
    said = cli("identify", cell, path, "--out", work)
    assert said.code == 0
    (note,) = [line for line in said.err.splitlines() if "contradict the others" in line]
    assert poses_in(note) == set(wrong)
    (largest,) = [line for line in said.out.splitlines() if line.startswith("largest residuals")]
    assert not poses_in(largest) & set(wrong)
    models = json.loads((work / "identification.json").read_text())["models"]
    best = next(m for m in models if m["name"] == "offsets + compliance")
    assert {r["pose"] for r in best["residuals"] if r["weight"] == 0} == set(wrong)


def test_planned_poses_are_no_measurements(cli, refuse, work):
    cell = offsets_only(work / "cell.toml")
    line = refuse("identify", cell, work / "poses.csv", "--out", work / "out")
    line.says("poses.csv, line 1: holds planned poses, not measurements", "posedesign simulate")
    rows = [{"target": "T1"} | row for row in rows_of(work / "poses.csv")]
    said = cli("identify", cell, save(work / "m.csv", rows), "--out", work)
    assert "these postures were planned, not measured" in said.err


def test_one_row_in_radians(cli, work):
    rows = rows_of(work / "touchups.csv")
    rows[3] |= {f"j{k}_deg": str(np.deg2rad(float(rows[3][f"j{k}_deg"]))) for k in range(1, 7)}
    said = cli(
        "identify", offsets_only(work / "cell.toml"), save(work / "m.csv", rows), "--out", work
    )
    assert said.code != 0
    assert "m.csv: line 5: the tool point as described is " in said.err


@pytest.mark.slow
def test_eight_touch_ups_are_enough_to_choose_by(cli, work):
    """Priors hold what so few do not tell: every model can be judged."""
    rows = rows_of(work / "touchups.csv")[:8]
    words = ("identify", work / "cell.toml", save(work / "m.csv", rows), "--out", work, "--json")
    content = strict_json(cli(*words).out)
    (best,) = (m for m in content["models"] if m["name"] == content["recommended"])
    low, high = best["expected_box_interval_mm"]
    assert 0.0 < low < best["expected_box_mm"] < high


def test_good_touch_ups_are_not_suspected(identified_once):
    assert identified_once.said.err == ""


@pytest.mark.slow
def test_more_wrong_than_right(refuse, change_cell, work):
    path, _ = knocked(work, 0.7, 1.0)
    cell = offsets_only(change_cell({"parameters.loss": '"graduated"'}), judged=True)
    refuse("identify", cell, path, "--out", work / "out").says("contradict", "measurements")


def other_arm(work: Path, preset: str) -> Path:
    """Touch-ups of another arm than the cell's."""
    from posedesign.cell import cell_template
    from posedesign.planning import plan

    cell = Cell.from_text(cell_template(preset, surroundings=False))
    q = plan(cell).poses.postures
    q = q[np.isfinite(q).all(axis=1)]
    return write_measurements(work / "other.csv", touch_ups(q))


@pytest.mark.slow
def test_touch_ups_of_another_arm(cli, work):
    """Links freed to be a metre off would explain them; nobody should believe that."""
    path = other_arm(work, "lrmate200id")
    said = cli("identify", work / "cell.toml", path, "--out", work)
    assert said.code == 1
    assert "not of this robot" in said.err
    assert "recommended" not in said.out
    assert "Identified" not in said.out
    content = json.loads((work / "identification.json").read_text())
    assert content["recommended"] is None
    assert "not of this robot" in content["reason"]


def test_residuals_of_decimetres(cli, work, rendered):
    rng = np.random.default_rng(1)
    rows = rows_of(work / "touchups.csv")
    for row in rows:
        for j in range(1, 7):
            row[f"j{j}_deg"] = str(float(row[f"j{j}_deg"]) + rng.normal(0.0, 4.0))
    cell = offsets_only(work / "cell.toml", judged=True)
    said = cli("identify", cell, save(work / "m.csv", rows), "--out", work)
    assert said.code == 1
    assert "these measurements are not of this robot" in said.err
    assert "Identified" not in said.out
    assert not (work / "identification.png").exists()


def test_four_touch_ups(cli, work):
    """As many as are needed, and hardly more: said, and no NaN in the file."""
    rows = rows_of(work / "touchups.csv")[:4]
    said = cli("identify", work / "cell.toml", save(work / "m.csv", rows), "--out", work)
    assert said.code == 0
    assert re.search(r"only \d equations are left over to test the model by", said.err)
    assert re.search(r"Identified: (frames only|offsets)", said.out)
    assert "nan" not in said.out
    content = strict_json((work / "identification.json").read_text())
    assert content["recommended"] in (None, "frames only", "offsets")
    assert content["models"][0]["name"] == "frames only"


def test_json_is_all_that_is_printed(cli, work):
    cell = offsets_only(work / "cell.toml")
    said = cli("identify", cell, work / "touchups.csv", "--out", work, "--json")
    assert strict_json(said.out) == json.loads((work / "identification.json").read_text())


def test_values_lie_in_their_intervals(identified_once):
    for model in identified_once.content["models"]:
        for parameter in model["parameters"]:
            assert parameter["low"] < parameter["value"] < parameter["high"]


def test_numbers_have_the_decimals_that_they_deserve(identified_once):
    said, content = identified_once.said, identified_once.content
    best = next(m for m in content["models"] if m["name"] == content["recommended"])
    for parameter in best["parameters"]:
        (line,) = [
            line
            for line in said.out.splitlines()
            if line.startswith(f"│ {parameter['name']} ") and "│" in line
        ]
        value, change, sigma, low, high = (cell.strip() for cell in line.split("│")[2:7])
        decimals = {len(text.partition(".")[2]) for text in (value, change, sigma, low, high)}
        assert len(decimals) == 1
        assert float(sigma) == pytest.approx(parameter["sigma"], rel=0.06)
        assert abs(float(value) - parameter["value"]) < 0.06 * parameter["sigma"]
        assert float(low) <= float(value) <= float(high)


def test_parameters_that_are_not_told_are_listed(capsys, work):
    cell = Cell.load(offsets_only(work / "cell.toml"))
    found = identify_models(cell, read_measurements(work / "touchups.csv", 6))
    notes = tuple(f"harmonic.joint_{k}.sin1 is absorbed by the targets" for k in range(1, 8))
    comparison = found.comparison
    trials = tuple(
        replace(trial, candidate=replace(trial.candidate, notes=notes))
        for trial in comparison.trials
    )
    answer = answer_of_identification(replace(found, comparison=replace(comparison, trials=trials)))
    said = " ".join(answer.details)
    assert "7 parameters of the arm are not in this model" in said
    assert "harmonic.joint_1.sin1 is absorbed by the targets" in said
    assert "and 2 more, see identification.json" in said


TURRET = """<robot name="turret"><link name="foot"/><link name="yoke"/><link name="head"/>
<joint name="pan" type="revolute"><parent link="foot"/><child link="yoke"/>
<origin xyz="0 0 0.25"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/>
</joint><joint name="tilt" type="revolute"><parent link="yoke"/><child link="head"/>
<origin xyz="0 0 0.06"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
</joint></robot>"""

TURRET_CELL = """
[robot]
urdf = "turret.urdf"
tip = "head"
[tool]
point_mm = [40.0, 20.0, 110.0]
[base_pose]
posture_deg = [0.0, 0.0]
[constraints]
collisions = false
[measurement]
kind = "{kind}"
[[noise]]
kind = "{kind}"
three_sigma_mm = 0.09
{turns}
[target]
name = "tracker"
position_mm = [2000.0, -1000.0, 700.0]
wpr_deg = [0.0, 0.0, 30.0]
"""


@pytest.mark.parametrize("kind", ["point", "pose"])
def test_two_joints_whose_axes_meet(cli, tmp_path, kind):
    """No length of such an arm is seen, so nothing is said of scales, units and signs.

    The instrument in closed form was a mirror image, and a fit without sizes a traceback.
    """
    (tmp_path / "turret.urdf").write_text(TURRET)
    turns = "three_sigma_deg = 0.06" if kind == "pose" else ""
    path = tmp_path / "cell.toml"
    path.write_text(TURRET_CELL.format(kind=kind, turns=turns))
    cell, rng = Cell.load(path), np.random.default_rng(8)
    q = rng.uniform([-1.8, -0.9], [1.8, 0.9], (24, 2))
    T_base_tool = cell.robot.fk(q) @ transform(np.eye(3), cell.tool_m)
    wpr = np.radians([0.3, -0.5, 31.0])
    T = inverse(transform(rotation_from_wpr(wpr), [1.98, -1.03, 0.71])) @ T_base_tool
    read = np.concatenate([T[:, :3, 3], rotation_log(T[:, :3, :3])], axis=1)
    read += rng.standard_normal(read.shape) * np.repeat([3e-5, np.radians(0.02)], 3)
    observed = read[:, :3] if kind == "point" else read
    data = Measurements(q, Setup.of(24), ("tracker",), observed=observed)
    file = write_measurements(tmp_path / "read.csv", data, [kind])
    said = cli("identify", path, file, "--out", tmp_path / "out")
    assert (said.code, "recommended: frames only" in said.out) == (0, True), said
    for word in ("scale", "sign", "inches", "mm for m"):
        assert word not in said.err
