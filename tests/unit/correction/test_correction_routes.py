"""The ways to use an identification: what each carries, with which tool, how true the table is."""

import json
from pathlib import Path

import numpy as np
import pytest

from calib import CalibrationModel, Robot, identify
from calib.errors import InputError, UnreachableError
from calib.model import Setup, simulate
from calib.model.measurements import Measurements
from calib.se3 import FloatArray
from posedesign.candidates import workplace_of
from posedesign.cell import Cell, TaskBox
from posedesign.cell.models import robot_blocks
from posedesign.files.csv_tables import read_rows, write_table
from posedesign.files.measurements import MeasurementTable
from posedesign.identification.file import IdentifiedModel
from posedesign.identification.models import Models, kinds_of, model_of
from posedesign.planning.poses_file import read_poses
from posedesign.pose_programs.correction import correct
from posedesign.pose_programs.correction_routes import (
    AS_IT_IS,
    DESCRIPTION,
    MASTERING,
    POSES,
    corrected_tool,
    routes_of,
    working_postures,
)

CELL = """
[robot]
preset = "r2000ic165f"
tip = "tool0"
[tool]
point_mm = [200.0, -50.0, 350.0]
mass_kg = 100.0
com_mm = [50.0, 0.0, 150.0]
[base_pose]
posture_deg = [0.0, 15.0, -25.0, 0.0, -50.0, 0.0]
[task_box]
lowest_mm = [1600.0, -300.0, 300.0]
highest_mm = [2100.0, 300.0, 900.0]
[parameters]
prior_offset_deg = 0.1
prior_length_mm = 0.3
prior_angle_deg = 0.02
prior_compliance_urad_nm = 0.5
[[noise]]
kind = "point"
three_sigma_mm = 0.15
"""
WORDS = ("geometry", "compliance", "priors")


@pytest.fixture(scope="module")
def cell() -> Cell:
    return Cell.from_text(CELL)


def identified(
    cell: Cell, names: list[str], values: dict[str, float] | None = None
) -> IdentifiedModel:
    """An identification with these parameters, as described but for these values [SI]."""
    model = model_of(cell, names)
    x = model.nominal.copy()
    for name, value in (values or {}).items():
        x[model.names.index(name)] = value
    sigma = np.where(model.nuisance, 1e-5, 1e-6)
    return IdentifiedModel("mine", cell.robot.name, model, x, sigma, np.diag(sigma**2))


TOOL = ["tool.x", "tool.y", "tool.z", "target.T1.x", "target.T1.y", "target.T1.z"]


def test_more_is_carried_by_more(cell):
    names = ["zero_offset.joint_2", "link.joint_3.z", "compliance.joint_3", *TOOL]
    found = identified(
        cell,
        names,
        {"zero_offset.joint_2": 2e-3, "link.joint_3.z": 1e-3, "compliance.joint_3": 5e-6},
    )
    routes = routes_of(cell, found)
    order = [route.name for route in routes.routes]
    assert order == [POSES, DESCRIPTION, MASTERING, AS_IT_IS]
    plain = routes_of(cell, found, used=found)
    for name in (DESCRIPTION, MASTERING):
        assert routes[name].expected.rms_m < 0.9 * plain[name].expected.rms_m
    for name in (POSES, AS_IT_IS):
        assert routes[name].expected.rms_m == pytest.approx(plain[name].expected.rms_m, rel=1e-9)
    assert routes[POSES].expected.lost_rms_m < 1e-12
    # the first joint is a matter of the base, and of nobody else
    assert not any("joint_1" in name for name in routes[DESCRIPTION].values.model.names)


def test_the_plainest_of_equals_comes_first(cell):
    found = identified(cell, ["zero_offset.joint_2", *TOOL], {"zero_offset.joint_2": 2e-3})
    routes = routes_of(cell, found)
    assert [route.name for route in routes.routes] == [MASTERING, DESCRIPTION, POSES, AS_IT_IS]
    assert [row["not_carried_mm"] for row in routes.rows()][:3] == [0.0] * 3
    assert routes[MASTERING].values.x == pytest.approx(found.x, abs=1e-15)


def test_a_model_that_is_used_is_judged_by_what_is_known(cell):
    known = identified(
        cell,
        ["zero_offset.joint_2", "link.joint_3.z", *TOOL],
        {"zero_offset.joint_2": 2e-3, "link.joint_3.z": 1e-3},
    )
    used = identified(cell, ["zero_offset.joint_2", *TOOL], {"zero_offset.joint_2": 9e-3})
    routes = routes_of(cell, known, used=used)
    assert routes.routes[0].name == AS_IT_IS  # worse than none
    assert routes[MASTERING].values.x[0] == 9e-3
    own = routes_of(cell, used, used=used)
    assert own[MASTERING].expected.lost_rms_m < 1e-12


# the tool ---------------------------------------------------------------------------------------


def labelled(label: str) -> list[str]:
    return [f"tool.{label}.{axis}" for axis in "xyz"]


def test_a_tool_point_of_any_name_is_the_cells_where_it_sits_there(cell):
    found = identified(cell, ["zero_offset.joint_2", *labelled("p1"), "target.T1.x"])
    tool = corrected_tool(cell, found)
    assert tool.index == 0
    assert tool.parameters == tuple(labelled("p1"))
    assert tool.said == "the tool point 'p1' is taken for the cell's tool"
    routes = routes_of(cell, found)
    np.testing.assert_allclose(routes[MASTERING].tool_m, cell.tool_m, atol=1e-12)


def test_of_several_tool_points_one_is_to_be_named(cell):
    names = ["zero_offset.joint_2", *labelled("p1"), *labelled("p2"), "target.T1.x"]
    found = identified(cell, names, {"tool.p2.x": cell.tool_m[0] + 0.1})
    tool = corrected_tool(cell, found)
    assert tool.index == 2
    assert tool.parameters == ()
    assert "'p1', 'p2'" in tool.said
    assert "name it with `tool`" in tool.said
    assert corrected_tool(cell, found, "p1").parameters == tuple(labelled("p1"))
    with pytest.raises(InputError, match=r"100 mm off tool.point_mm .* tool.point_mm = \[300.00"):
        corrected_tool(cell, found, "p2")
    with pytest.raises(InputError, match=r"no tool point 'p3'.*p1"):
        corrected_tool(cell, found, "p3")
    routes = routes_of(cell, found)
    np.testing.assert_allclose(routes[POSES].tool_m, cell.tool_m, atol=1e-12)
    assert not any("tool point" in said for said in routes.words(MASTERING)[1:])


def test_a_frame_is_no_tool_point(cell):
    found = identified(cell, ["zero_offset.joint_2", "tool.x", "tool.rx", "target.T1.x"])
    tool = corrected_tool(cell, found)
    assert tool.parameters == ()
    assert "a frame was measured in its place" in tool.said


# the box ----------------------------------------------------------------------------------------


def test_a_correction_is_judged_where_plans_and_identifications_are(cell):
    """One meaning of the expected error: the same points, the tool turned as it is measured."""
    q, words = working_postures(cell)
    usual = workplace_of(cell)
    assert len(q) > 2 * len(usual.postures)
    assert words.startswith(usual.words)
    tips = [cell.robot.fk(postures) for postures in (q, usual.postures)]
    middle, other = ((T @ np.append(cell.tool_m, 1.0))[:, :3].mean(axis=0) for T in tips)
    size = np.ptp((tips[0] @ np.append(cell.tool_m, 1.0))[:, :3], axis=0)
    assert (np.abs(middle - other) < 0.2 * size).all()
    base = cell.robot.fk(cell.base_posture)[:3, :3]
    turned = [
        np.arccos(np.clip((np.einsum("ij,kij->k", base, T[:, :3, :3]) - 1.0) / 2.0, -1.0, 1.0))
        for T in tips
    ]
    assert turned[0].mean() == pytest.approx(turned[1].mean(), rel=0.15)


def test_a_box_that_is_given_is_filled(cell):
    lowest, highest = np.array([1.7, -0.2, 0.5]), np.array([1.9, 0.2, 0.9])
    q, words = working_postures(cell, TaskBox(lowest, highest))
    points = (cell.robot.fk(q) @ np.append(cell.tool_m, 1.0))[:, :3]
    share = (points - lowest) / (highest - lowest)
    assert share.min() > -1e-9
    assert share.max() < 1.0 + 1e-9
    assert (np.ptp(share, axis=0) > 0.9).all()
    assert words.startswith(f"the box given, {len(q)} postures")
    again, _ = working_postures(cell, TaskBox(lowest, highest), rng=np.random.default_rng(7))
    assert not np.array_equal(q, again)


def test_a_box_out_of_reach_is_refused(cell):
    with pytest.raises(UnreachableError, match=r"no point of the task box can be reached.*`box`"):
        working_postures(cell, TaskBox(np.full(3, 8.0), np.full(3, 9.0)))


# how true the table is ---------------------------------------------------------------------------


def base_anew(points: FloatArray, wanted: FloatArray) -> float:
    """Root mean square distance after the rigid motion that fits best: Kabsch's SVD."""
    a, b = points - points.mean(axis=0), wanted - wanted.mean(axis=0)
    U, _, Vt = np.linalg.svd(a.T @ b)
    turn = Vt.T @ np.diag([1.0, 1.0, np.linalg.det(Vt.T @ U.T)]) @ U.T
    return float(np.sqrt(np.mean(np.sum((a @ turn.T - b) ** 2, axis=1))))


class Arm:
    """A simulated arm whose zeros, links and reducers are off, measured, identified, corrected.

    Off as far as the priors of its model say, so that the covariance is what it claims to be: what
    is tried is what correct makes of it.
    """

    def __init__(self, folder: Path, seed: int) -> None:
        rng = np.random.default_rng(seed)
        folder.mkdir()
        file = folder / "cell.toml"
        file.write_text(CELL)
        self.cell = cell = Cell.load(file)
        turned = np.deg2rad([40.0, 20.0, 20.0, 60.0, 40.0, 90.0])
        q = cell.base_posture + turned * rng.uniform(-1, 1, (45, cell.robot.n))
        empty = Measurements(q, Setup.of(45), ("tracker",))
        table = MeasurementTable(empty, ("point",), tuple(range(45)))
        blocks = [*robot_blocks(cell, WORDS), *Models(cell, table).set_up]
        self.truth = CalibrationModel(cell.robot, blocks, kinds_of(cell, ["point"]))
        spread = np.where(self.truth.nuisance, 2e-3, np.nan_to_num(self.truth.prior, posinf=0.0))
        self.x = self.truth.nominal + spread * rng.standard_normal(self.truth.p)
        found = identify(self.truth, simulate(self.truth, self.x, q, rng))
        parameters = [
            {"name": row.name, "value": row.value, "unit": row.unit, "sigma": row.sigma}
            for row in found.displayed()
        ]
        model = {"name": "all", "parameters": parameters}
        model["covariance_si"] = found.covariance.tolist()
        content = {"robot": cell.robot.name, "recommended": "all", "models": [model]}
        written = folder / "identification.json"
        written.write_text(json.dumps(content))
        # fresh poses in the box, the tool turned as the table takes it to be turned
        self.q = working_postures(cell, rng=rng)[0]
        self.poses = folder / "poses.csv"
        columns = [f"j{k + 1}_deg" for k in range(cell.robot.n)]
        rows = [dict(zip(columns, row, strict=True)) for row in np.rad2deg(self.q)]
        write_table(self.poses, columns, rows)
        self.out = folder / "out"
        self.done = correct(cell, file, written, self.out, poses=self.poses)

    def real(self, q: FloatArray) -> FloatArray:
        return self.truth.view(q, self.x).tool_points

    def errors_m(self) -> dict[str, float]:
        """What the written files do to the arm, over fresh poses."""
        robot, routes = self.cell.robot, self.done.routes

        def taken(arm: Robot, q: FloatArray, tool_m: FloatArray) -> FloatArray:
            return np.asarray((arm.fk(q) @ np.append(tool_m, 1.0))[..., :3])

        urdf = Robot.from_urdf(self.out / "corrected.urdf", tip=robot.tip_frame)
        shown = [float(r.cells["correction_deg"]) for r in read_rows(self.out / "mastering.csv")[1]]
        assert robot.controller is not None
        mastered = robot.controller.posture(robot.controller.pendant(self.q) + shown)
        commands = read_poses(self.out / "corrected_poses.csv", robot.n).postures
        wanted = taken(robot, self.q, self.cell.tool_m)
        return {
            AS_IT_IS: base_anew(self.real(self.q), taken(robot, self.q, routes[AS_IT_IS].tool_m)),
            MASTERING: base_anew(
                self.real(self.q), taken(robot, mastered, routes[MASTERING].tool_m)
            ),
            DESCRIPTION: base_anew(
                self.real(self.q), taken(urdf, self.q, routes[DESCRIPTION].tool_m)
            ),
            POSES: base_anew(self.real(commands), wanted),
        }


@pytest.mark.slow
def test_the_table_is_true_of_arms(tmp_path):
    """From measurements to files, and from the files to fresh poses: in the median within 15 %."""
    ratios: dict[str, list[float]] = {}
    for seed in range(20):
        arm = Arm(tmp_path / str(seed), seed)
        for name, error in arm.errors_m().items():
            expected = arm.done.routes[name].expected.rms_m
            ratios.setdefault(name, []).append(error / expected)
    for name, found in ratios.items():
        assert np.median(found) == pytest.approx(1.0, abs=0.15), (name, np.round(found, 2))
