"""URDF files of real arms: each loads, moves as in Pinocchio, and can be solved for its joints."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from calib import Robot
from calib.errors import CalibError
from tests.arms import missed

pytestmark = pytest.mark.real_data


@pytest.fixture(scope="module")
def urdfs(data_folder) -> list[Path]:
    files = sorted((data_folder / "urdf").glob("*.urdf"))
    if not files:
        pytest.skip(f"no URDF files in {data_folder / 'urdf'}")
    return files


def whole_configuration(model: pin.Model, robot: Robot, q: np.ndarray) -> np.ndarray:
    """The joints of the arm among all joints of the file, the others at zero."""
    whole = pin.neutral(model)
    for name, value in zip(robot.joint_names, q, strict=True):
        whole[model.joints[model.getJointId(name)].idx_q] = value
    return whole


def test_forward_kinematics_is_pinocchios(urdfs):
    for path in urdfs:
        robot, model = Robot.from_urdf(path), pin.buildModelFromUrdf(str(path))
        data, rng = model.createData(), np.random.default_rng(0)
        tip, base = model.getFrameId(robot.tip_frame), model.getFrameId(robot.base_frame)
        for q in rng.uniform(robot.lower, robot.upper, (50, robot.n)):
            whole = whole_configuration(model, robot, q)
            pin.framesForwardKinematics(model, data, whole)
            expected = (data.oMf[base].inverse() * data.oMf[tip]).homogeneous
            np.testing.assert_allclose(robot.fk(q), expected, atol=1e-12, err_msg=path.name)
            J = pin.computeFrameJacobian(model, data, whole, tip, pin.LOCAL_WORLD_ALIGNED)
            columns = [model.joints[model.getJointId(name)].idx_v for name in robot.joint_names]
            R = np.kron(np.eye(2), data.oMf[base].rotation.T)
            np.testing.assert_allclose(
                robot.jacobian(q), R @ J[:, columns], atol=1e-12, err_msg=path.name
            )


def test_inverse_kinematics_closes(urdfs):
    for path in urdfs:
        robot, rng = Robot.from_urdf(path), np.random.default_rng(1)
        middle = (robot.lower + robot.upper) / 2
        # a redundant arm is solved by iteration, which takes longer and starts from the middle
        count, width = (100, 0.5) if robot.n == 6 else (15, 0.3)
        q = middle + rng.uniform(-width, width, (count, robot.n)) * robot.joint_range
        poses = robot.fk(q)
        answers = robot.inverse(poses)
        assert set(answers.pose[answers.inside]) == set(range(count)), path.name
        np.testing.assert_allclose(
            robot.fk(answers.postures), poses[answers.pose], atol=1e-9, err_msg=path.name
        )
        np.testing.assert_array_equal(answers.gap_m, 0.0)
        if robot.n == 6:  # every branch, so the one asked for is among them
            for i in range(count):
                difference = (answers.of(i) - q[i] + np.pi) % (2 * np.pi) - np.pi
                assert np.abs(difference).max(axis=1).min() < 1e-6, path.name


def test_the_preset_is_the_urdf(urdfs):
    path = next((p for p in urdfs if p.stem == "r2000ic165f"), None)
    if path is None:
        pytest.skip("r2000ic165f.urdf is not among the files")
    preset, robot = Robot.preset("r2000ic165f"), Robot.from_urdf(path)
    q = np.random.default_rng(2).uniform(robot.lower, robot.upper, (1000, 6))
    np.testing.assert_allclose(preset.fk(q), robot.fk(q), atol=1e-9)
    np.testing.assert_allclose(preset.jacobian(q), robot.jacobian(q), atol=1e-9)
    assert preset.joint_names == robot.joint_names
    np.testing.assert_allclose(preset.lower, robot.lower, atol=2e-4)
    np.testing.assert_allclose(preset.upper, robot.upper, atol=2e-4)
    np.testing.assert_allclose(preset.speed, robot.speed, rtol=1e-2)
    on_pendant = [Robot.from_urdf(path, base="base"), Robot.preset("r2000ic165f", base="base")]
    np.testing.assert_allclose(on_pendant[0].fk(q), on_pendant[1].fk(q), atol=1e-9)


@pytest.mark.parametrize(
    ("name", "passive"),
    [
        ("irb6640_185_280", {"joint_piston", "joint_cylinder"}),
        ("irb6700_200_260", {"cylinder_joint", "piston_joint"}),
    ],
)
def test_passive_pistons_are_locked(urdfs, name, passive):
    path = next((p for p in urdfs if p.stem == name), None)
    if path is None:
        pytest.skip(f"{name}.urdf is not among the files")
    robot = Robot.from_urdf(path)
    assert robot.n == 6
    assert not passive & set(robot.joint_names)
    notice = next(n for n in robot.notices if n.startswith("locked at zero"))
    assert set(notice.split(": ")[1].split(", ")) == passive


def test_every_arm_is_ready_to_be_planned_for(urdfs):
    for path in urdfs:
        robot = Robot.from_urdf(path)
        assert robot.n in (6, 7), path.name
        assert (robot.lower < robot.upper).all(), path.name
        assert (robot.speed > 0).all(), path.name
        assert robot.model.nq == robot.n, path.name


def test_universal_robots_with_a_straight_wrist(data_folder):
    """The closed form loses some of these poses; they are closed in on from where it ends."""
    robot = Robot.from_urdf(data_folder / "urdf" / "ur5e.urdf")
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (300, 6))
    q[:, 4] = 0.0
    poses = robot.fk(q)
    answers = robot.inverse(poses)
    assert (answers.gap_m == 0).all()
    assert set(answers.pose) == set(range(300))
    np.testing.assert_allclose(robot.fk(answers.postures), poses[answers.pose], atol=1e-8)


def test_the_flange_of_a_panda_is_its_tip(data_folder):
    assert Robot.from_urdf(data_folder / "urdf" / "panda.urdf").tip_frame == "panda_link8"


def test_a_file_expanded_from_xacro_is_the_same_arm(urdfs, tmp_path):
    pytest.importorskip("xacro")
    for path in urdfs[:4]:
        copy = tmp_path / f"{path.stem}.xacro"
        copy.write_bytes(path.read_bytes())
        plain, expanded = Robot.from_urdf(path), Robot.from_urdf(copy)
        q = np.random.default_rng(3).uniform(plain.lower, plain.upper, (20, plain.n))
        np.testing.assert_array_equal(expanded.fk(q), plain.fk(q), err_msg=path.name)
        assert set(expanded.notices) - set(plain.notices) == {
            "expanded from xacro, every argument at its default"
        }


def test_every_joint_of_an_arm_can_be_locked(urdfs):
    for path in urdfs:
        robot = Robot.from_urdf(path)
        q = np.random.default_rng(4).uniform(robot.lower, robot.upper)
        for j, name in enumerate(robot.joint_names):
            held = Robot.from_urdf(path, robot.tip_frame, robot.base_frame, lock=[name])
            assert held.joint_names == robot.joint_names[:j] + robot.joint_names[j + 1 :]
            q_zero = np.where(np.arange(robot.n) == j, 0.0, q)
            expected = robot.fk(q_zero)
            np.testing.assert_allclose(
                held.fk(np.delete(q, j)), expected, atol=1e-12, err_msg=f"{path.name} {name}"
            )


def test_damaged_files_are_refused_in_words(urdfs, tmp_path, capfd):
    rng = np.random.default_rng(5)
    errors = 0
    for path in urdfs:
        data = path.read_bytes()
        for _ in range(30):
            start, stop = np.sort(rng.integers(0, len(data), 2))
            stop = min(stop, start + rng.choice([1, 3, 30, len(data)]))
            copy = tmp_path / "arm.urdf"
            copy.write_bytes(data[:start] + data[stop:])
            try:
                Robot.from_urdf(copy)
            except CalibError as error:
                errors += 1
                words = str(error)
            else:
                words = ""
            assert "\n" not in words
    assert errors > 0
    assert capfd.readouterr() == ("", "")


def test_no_posture_is_lost_of_descriptions_with_rounded_frames(data_folder):
    """Angles of 1.5708, axes against each other, and a factory calibration with frames far away."""
    files = sorted((data_folder / "urdf" / "with_rounding").glob("*.urdf"))
    if not files:
        pytest.skip(f"no URDF files in {data_folder / 'urdf' / 'with_rounding'}")
    for path in files:
        robot = Robot.from_urdf(path)
        q = np.random.default_rng(1).uniform(robot.lower, robot.upper, (500, 6))
        q = q[robot.chain.smallest_singular_values(robot.chain.forward(q)) > 0.01]
        assert missed(robot, q).max() < 1e-6, path.name
