"""Corrected URDFs of real arms read back to what was identified, and are else the same file."""

from pathlib import Path

import numpy as np
import pytest

from calib import CalibrationModel, Robot
from calib.correction import corrected_robot, corrected_urdf
from calib.model.measurements import TouchUp
from calib.model.parameters import (
    LinkGeometry,
    TargetPoints,
    ToolPoint,
    ZeroOffsets,
    gravity_torque,
)

pytestmark = pytest.mark.real_data


@pytest.fixture(scope="module")
def urdfs(data_folder) -> list[Path]:
    files = sorted((data_folder / "urdf").glob("*.urdf"))
    if not files:
        pytest.skip(f"no URDF files in {data_folder / 'urdf'}")
    return files


def model_of(path: Path) -> CalibrationModel:
    robot = Robot.from_urdf(path)
    blocks = [LinkGeometry(robot), ZeroOffsets(robot, robot.joint_names)]
    tool, target = ToolPoint([0.0, 0.0, 0.1]), TargetPoints([[1.0, 0.0, 0.5]])
    return CalibrationModel(robot, [*blocks, tool, target], TouchUp(1e-5))


def values_of(model: CalibrationModel) -> np.ndarray:
    size = np.array([1e-3 if unit == "m" else 4e-3 for unit in model.units])
    return model.nominal + size * np.random.default_rng(0).uniform(-1, 1, model.p)


def test_corrected_urdfs_read_back(urdfs, tmp_path):
    for source in urdfs:
        before = source.read_bytes()
        model = model_of(source)
        robot, x = model.robot, values_of(model)
        out = tmp_path / source.name
        out.write_bytes(corrected_urdf(corrected_robot(model, x), source))
        again = Robot.from_urdf(out, tip=robot.tip_frame, base=robot.base_frame)
        q = np.random.default_rng(1).uniform(robot.lower, robot.upper, (200, robot.n))
        real = model.view(q, x).T_base_tip
        assert np.abs(robot.fk(q) - real).max() > 1e-3
        np.testing.assert_allclose(again.fk(q), real, atol=1e-12, err_msg=source.name)
        for key in ("lower", "upper", "speed", "link_mass", "link_com"):
            np.testing.assert_array_equal(getattr(again, key), getattr(robot, key))
        assert source.read_bytes() == before


def test_nothing_but_origins_and_a_comment_changes(urdfs):
    for source in urdfs:
        model = model_of(source)
        text = corrected_urdf(corrected_robot(model, values_of(model)), source)
        old, new = source.read_bytes().splitlines(), text.splitlines()
        extra = [line for line in new if line.startswith(b"<!-- Joint origins as identified")]
        assert len(extra) == 1, source.name
        new.remove(extra[0])
        pairs = list(zip(old, new, strict=True))
        changed = [(a, b) for a, b in pairs if a != b]
        assert len(changed) <= model.robot.n, source.name
        assert all(b"origin" in b for _, b in changed), source.name


def test_urdfs_written_anew_read_back(urdfs, tmp_path):
    for source in urdfs:
        model = model_of(source)
        robot, x = model.robot, values_of(model)
        corrected = corrected_robot(model, x)
        out = tmp_path / source.name
        out.write_bytes(corrected_urdf(corrected))
        again = Robot.from_urdf(out, tip=robot.tip_frame, base=robot.base_frame)
        q = np.random.default_rng(1).uniform(robot.lower, robot.upper, (200, robot.n))
        real = model.view(q, x).T_base_tip
        np.testing.assert_allclose(again.fk(q), real, atol=1e-12, err_msg=source.name)
        np.testing.assert_allclose(
            gravity_torque(again, q), gravity_torque(corrected.robot, q), atol=1e-9
        )


def test_corrected_arms_find_their_postures(urdfs):
    for source in urdfs:
        model = model_of(source)
        robot = corrected_robot(model, values_of(model)).robot
        if robot.n != 6:  # of a redundant arm any posture will do
            continue
        rng = np.random.default_rng(2)
        q = rng.uniform(robot.lower, robot.upper, (400, 6))
        clear = robot.chain.smallest_singular_values(robot.state(q)) > 0.05
        q = q[clear]
        answers = robot.inverse(robot.fk(q))
        lost = 0
        for i, row in enumerate(q):
            found = answers.postures[answers.pose == i]
            apart = np.remainder(found - row + np.pi, 2 * np.pi) - np.pi
            lost += not (np.abs(apart).max(axis=1, initial=0.0) < 1e-6).any()
        assert lost <= 0.01 * len(q), source.name
