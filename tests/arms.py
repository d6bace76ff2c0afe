"""An arm of every maker: a preset, or a small description with the numbers of a public one."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from calib.robots import Robot
from posedesign.cell import Cell, cell_template
from posedesign.programs.dialect import Dialect

PRESETS = {
    "fanuc": "r2000ic165f",
    "kuka": "kr6r900sixx",
    "abb": "irb120",
    "ur": "ur5e",
    "yaskawa": "gp7",
    "staubli": "tx2_60",
    "franka": "panda",
    None: "panda",
}

PULSES = (1434.2, -1434.2, 1600.0, 1137.8, -1137.8, 682.7)
"""Of an arm of Yaskawa in one degree."""

Vector = tuple[float, float, float]
Joint = tuple[Vector, Vector, str, float | tuple[float, float]]
"""Origin [m], its roll, pitch and yaw [deg], axis, and the limits, or one on both sides [deg]."""

DESCRIPTIONS: dict[str, list[Joint]] = {
    # Kawasaki RS007N: its own khi_robot, rs007n_macro.xacro
    "kawasaki": [
        ((0, 0, 0.36), (0, 0, 0), "0 0 -1", 180),
        ((0, 0, 0), (0, -90, 0), "0 0 1", 135),
        ((0.355, 0, 0), (0, 0, 0), "0 0 -1", 155),
        ((0.0925, 0, 0), (0, 90, 0), "0 0 1", 200),
        ((0, 0, 0.2825), (0, -90, 0), "0 0 -1", 125),
        ((0.078, 0, 0), (0, 90, 0), "0 0 1", 360),
    ],
    # Doosan M1013: its own doosan-robot2, m1013.urdf
    "doosan": [
        ((0, 0, 0.1525), (0, 0, 0), "0 0 1", 150),
        ((0, 0.0345, 0), (0, -90, -90), "0 0 1", 150),
        ((0.62, 0, 0), (0, 0, 90), "0 0 1", 150),
        ((0, -0.559, 0), (90, 0, 0), "0 0 1", 150),
        ((0, 0, 0), (-90, 0, 0), "0 0 1", 150),
        ((0, -0.121, 0), (90, 0, 0), "0 0 1", 150),
    ],
    # Denso VS-060: its own denso_robot_ros, vs060.urdf, the smaller limit of joint 3 on both sides
    "denso": [
        ((0, 0, 0.1815), (0, 0, 0), "0 0 1", 170),
        ((0, 0, 0.1635), (0, 0, 0), "0 1 0", 120),
        ((0, 0, 0.305), (0, 0, 0), "0 1 0", 125),
        ((-0.01, 0, 0.1645), (0, 0, 0), "0 0 1", 270),
        ((0, 0, 0.1355), (0, 0, 0), "0 1 0", 120),
        ((0, 0, 0.07), (0, 0, 0), "0 0 1", 360),
    ],
}


def urdf_of(maker: str) -> str:
    """A description without shapes."""
    return urdf_from(DESCRIPTIONS[maker])


def urdf_from(joints: list[Joint], flange_m: float | None = None) -> str:
    """A description without shapes of these joints, and of a flange along the last z."""
    parts = ['<robot name="arm"><link name="l0"/>']
    for k, (xyz, rpy, axis, limit) in enumerate(joints, start=1):
        turn = " ".join(map(str, np.radians(rpy)))
        least, most = np.radians(limit if isinstance(limit, tuple) else (-limit, limit))
        parts.append(
            f'<link name="l{k}"/><joint name="j{k}" type="revolute"><parent link="l{k - 1}"/>'
            f'<child link="l{k}"/><origin xyz="{" ".join(map(str, xyz))}" rpy="{turn}"/>'
            f'<axis xyz="{axis}"/><limit lower="{least}" upper="{most}" velocity="3" effort="1"/>'
            "</joint>"
        )
    if flange_m is not None:
        parts.append(
            f'<joint name="mount" type="fixed"><parent link="l{len(joints)}"/>'
            f'<child link="flange"/><origin xyz="0 0 {flange_m}"/></joint><link name="flange"/>'
        )
    return "\n".join([*parts, "</robot>"])


def arm_from(joints: list[Joint], flange_m: float | None = None) -> Robot:
    """The arm of such a description."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "arm.urdf"
        path.write_text(urdf_from(joints, flange_m))
        return Robot.from_urdf(path)


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Largest joint difference, full turns aside [rad]."""
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi).max(axis=-1)


def missed(robot: Robot, q: np.ndarray) -> np.ndarray:
    """How far the nearest answer to each posture is from it [rad]; all answers close."""
    poses = robot.fk(q)
    answers = robot.inverse(poses)
    np.testing.assert_allclose(robot.fk(answers.postures), poses[answers.pose], atol=1e-9)
    out = np.full(len(q), np.inf)
    np.minimum.at(out, answers.pose, apart(answers.postures, q[answers.pose]))
    return out


@cache
def robot_of(maker: str | None) -> Robot:
    """An arm with the controller of this maker; of any for None."""
    if maker in PRESETS:
        return Robot.preset(PRESETS[maker])
    with TemporaryDirectory() as folder:
        path = Path(folder) / "arm.urdf"
        path.write_text(urdf_of(str(maker)))
        return Robot.from_urdf(path).controlled_by(str(maker))


def cell_for(dialect: Dialect) -> Cell:
    """A cell of an arm that programs of a dialect move: where its maker is open, of as many joints.

    Some move arms of any number of joints, some of six alone.
    """
    counts: tuple[int, ...] = getattr(dialect, "counts", (7,))
    return cell_of("ur" if dialect.maker is None and 7 not in counts else dialect.maker)


@cache
def cell_of(maker: str | None) -> Cell:
    """A cell of this arm; one of Yaskawa's has encoder pulses."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "arm.urdf"
        if maker in PRESETS:
            text = cell_template(PRESETS[maker], surroundings=False)
        else:
            path.write_text(urdf_of(str(maker)))
            text = cell_template(str(path))
            text = re.sub("^# controller[ :].*", f'controller = "{maker}"', text, flags=re.M)
        if maker == "yaskawa":
            text = text.replace("[program]\n", f"[program]\npulses_per_deg = {list(PULSES)}\n")
        return Cell.from_text(text)
