"""Files of instruments as they are exported, out of one simulated measurement.

Each writer has the layout of its maker; they are written from what is public, and read by what was
written for the same: the numbers in them are those of the simulation.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from calib.model import CalibrationModel, Setup, simulate
from calib.model.measurements import Measurements, Point, Pose
from calib.model.parameters import TargetFrame, ToolFrame, ToolPoints, ZeroOffsets
from calib.se3 import FloatArray, quaternion_from_rotation, rotation_exp, transform
from posedesign.cell import Cell

CELL = """
[robot]
preset = "{robot}"
{robot_more}
[tool]
point_mm = [0.0, 40.0, 90.0]
[base_pose]
posture_deg = {base}
[parameters]
models = [["zero_offsets"]]
[[noise]]
kind = "point"
three_sigma_mm = 0.06
[[noise]]
kind = "pose"
three_sigma_mm = 0.06
three_sigma_deg = 0.006
[instrument]
{instrument}
"""

REFLECTORS = ("SMR1", "SMR2", "SMR3")
PLACES_M = np.array([[0.0, 0.04, 0.09], [0.06, -0.03, 0.09], [-0.06, -0.03, 0.12]])
BASES = {
    "kr6r900sixx": [0.0, -90.0, 90.0, 0.0, 40.0, 0.0],
    "ur10e": [0.0, -90.0, 90.0, 0.0, 90.0, 0.0],
    "irb6700_200_260": [0.0, 0.0, 10.0, 0.0, 40.0, 0.0],
}


@dataclass(frozen=True)
class Session:
    """An arm with zero offsets under a tracker: N poses, three reflectors, or one frame."""

    robot: str
    q: FloatArray  # (N, n) [rad]
    points: FloatArray  # (N, 3, 3): of each reflector [m]
    poses: FloatArray  # (N, 6): place [m] and rotation vector of the frame on the tool
    starts: FloatArray  # (N,): when the arm came to a pose [s]; it stands for two seconds

    @property
    def names(self) -> list[str]:
        return [f"P{k + 1:02d}" for k in range(len(self.q))]

    def cell(self, folder: Path, instrument: str = "", robot_more: str = "") -> Path:
        path = folder / "cell.toml"
        base = BASES[self.robot]
        path.write_text(
            CELL.format(robot=self.robot, base=base, instrument=instrument, robot_more=robot_more),
            encoding="utf-8",
        )
        return path

    def native(self, kind: str, reflectors: Sequence[str] = ()) -> Measurements:
        """The same as posedesign's own table has it."""
        count = len(self.q)
        if kind == "pose":
            return Measurements(
                self.q, Setup.of(count), ("tracker",), observed=self.poses, names=tuple(self.names)
            )
        labels = tuple(reflectors) or ("tool",)
        used = len(labels)
        return Measurements(
            np.repeat(self.q, used, axis=0),
            Setup.of(count * used, tool=np.tile(np.arange(used), count)),
            ("tracker",),
            labels,
            self.points[:, :used].reshape(-1, 3),
            tuple(np.repeat(self.names, used).tolist()),
        )


@cache
def arm_of(robot: str) -> Cell:
    """The cell of a robot."""
    return Cell.from_text(CELL.format(robot=robot, base=BASES[robot], instrument="", robot_more=""))


def session(robot: str = "kr6r900sixx", count: int = 24, seed: int = 3) -> Session:
    """Measure poses around the base pose of a cell with an arm that has zero offsets."""
    arm = arm_of(robot)
    rng = np.random.default_rng(seed)
    spread = np.deg2rad(35.0) * rng.uniform(-1, 1, (count, arm.robot.n))
    q = np.clip(arm.base_posture + spread, arm.robot.lower + 0.05, arm.robot.upper - 0.05)
    # decimals of a log: what is read is what the arm was at
    q = np.deg2rad(np.round(np.rad2deg(q), 4))
    tracker = transform(rotation_exp(np.array([0.02, -0.01, 2.0])), [1.5, -1.0, 0.4])
    offsets = ZeroOffsets(arm.robot, arm.robot.joint_names[1:-1])
    frame = TargetFrame(tracker, "tracker")
    points = CalibrationModel(
        arm.robot, [offsets, ToolPoints(PLACES_M, REFLECTORS), frame], Point(2e-5)
    )
    own = transform(rotation_exp(np.array([0.1, 0.2, -0.3])), PLACES_M[0])
    pose = CalibrationModel(
        arm.robot, [offsets, ToolFrame(own), frame], Pose([2e-5] * 3 + [3e-5] * 3)
    )
    off = np.deg2rad([0.05, -0.08, 0.06, 0.04])
    x = [model.nominal.copy() for model in (points, pose)]
    for values in x:
        values[:4] += off
    how = Setup.of(3 * count, tool=np.tile(np.arange(3), count))
    read = simulate(points, x[0], np.repeat(q, 3, axis=0), rng, setup=how).observed
    posed = simulate(pose, x[1], q, rng).observed
    assert read is not None
    assert posed is not None
    starts = 100.0 + 5.0 * np.arange(count)
    return Session(robot, q, read.reshape(count, 3, 3), posed, starts)


def save(path: Path, lines: Sequence[str]) -> Path:
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


def _text(values: FloatArray, decimals: int = 9) -> list[str]:
    return [f"{value:.{decimals}f}" for value in values.tolist()]


def quaternions(session: Session) -> FloatArray:
    """(N, 4): w, x, y, z."""
    return quaternion_from_rotation(rotation_exp(session.poses[:, 3:]))


def frames(session: Session, rate: float) -> list[tuple[float, int]]:
    """Times of a recording without end, and the pose at each; below zero where the arm moves."""
    times = np.arange(session.starts[0] - 1.0, session.starts[-1] + 3.5, 1.0 / rate)
    k = np.maximum(np.searchsorted(session.starts, times + 1e-9, side="right") - 1, 0)
    standing = (times <= session.starts[k] + 2.0 + 1e-9) | (times > session.starts[-1])
    return list(zip(times.tolist(), np.where(standing, k, -1).tolist(), strict=True))


def recorded(
    session: Session, taken: Sequence[tuple[float, int]], values: FloatArray
) -> FloatArray:
    """Values ``(T, k)`` at the frames of a recording, of those ``(N, k)`` at the poses.

    They change evenly from one pose to the next while the arm moves.
    """
    times, of = (np.array(each) for each in zip(*taken, strict=True))
    knots = np.stack([session.starts, session.starts + 2.0], axis=1).ravel()
    moving = [np.interp(times, knots, np.repeat(column, 2)) for column in values.T]
    return np.where(of[:, None] < 0, np.stack(moving, axis=1), values[of])


def spatial_analyzer(session: Session, folder: Path) -> Path:
    lines = ["// Exported points", "// Collection, Group, Point, X, Y, Z, offP, offR", ""]
    for name, places in zip(session.names, session.points, strict=True):
        for label, place in zip(REFLECTORS, places, strict=True):
            lines.append(", ".join(["Cell A", name, label, *_text(1e3 * place), "19.05", "0.0"]))
    return save(folder / "tracker.txt", lines)


def points_text(session: Session, folder: Path) -> Path:
    """``name x y z`` with spaces and points, as PolyWorks and trackers write them."""
    rows = zip(session.names, session.points[:, 0], strict=True)
    return save(folder / "points.txt", [" ".join([n, *_text(1e3 * p)]) for n, p in rows])


def faro_like(session: Session, folder: Path) -> Path:
    """A table with lines above it, semicolons, decimal commas, and a temperature."""
    lines = ["Report", "Operator: A. Person", "", "Feature;Target;X [mm];Y [mm];Z [mm];Temp;When"]
    for k, places in enumerate(session.points):
        for label, place in zip(REFLECTORS, places, strict=True):
            cells = [session.names[k], label, *_text(1e3 * place), f"{20 + 0.05 * k:.2f}"]
            when = session.starts[k] + 1.0
            stamp = f"2026-05-31 14:{int(when // 60):02d}:{when % 60:06.3f}"
            lines.append(";".join([*(c.replace(".", ",") for c in cells), stamp]))
    return save(folder / "arm.csv", lines)


FARO_COLUMNS = """reflectors = ["SMR1", "SMR2", "SMR3"]
[instrument.columns]
place = ["X [mm]", "Y [mm]", "Z [mm]"]
reflector = "Target"
pose = "Feature"
temperature = "Temp"
"""


def api_like(session: Session, folder: Path) -> Path:
    """Metres and tabs, the unit in a line of its own."""
    lines = ["No\tX\tY\tZ", "\tm\tm\tm"]
    for name, place in zip(session.names, session.points[:, 0], strict=True):
        lines.append("\t".join([name, *_text(place, 12)]))
    return save(folder / "api.txt", lines)


def creaform_like(session: Session, folder: Path) -> Path:
    """Poses with quaternions, real part last."""
    lines = ["Name,Time,X,Y,Z,Qx,Qy,Qz,Q0"]
    for k, q in enumerate(quaternions(session)):
        place = _text(1e3 * session.poses[k, :3])
        turn = _text(q[[1, 2, 3, 0]], 12)
        lines.append(",".join([session.names[k], f"{session.starts[k] + 1:.3f}", *place, *turn]))
    return save(folder / "ctrack.csv", lines)


def motive(
    session: Session, folder: Path, unit: str = "Meters", rate: float = 20.0, hidden: int = 0
) -> Path:
    """A recording of one rigid body and one of its markers."""
    factor = {"Meters": 1.0, "Millimeters": 1e3}[unit]
    head = (
        "Format Version,1.23,Take Name,Take 1,Capture Frame Rate,20.000000,Rotation Type,"
        f"Quaternion,Length Units,{unit},Coordinate Space,Global"
    )
    body, marker = "Tool", "Tool:Marker 001"
    lines = [
        head,
        "",
        ",Type," + ",".join(["Rigid Body"] * 8 + ["Rigid Body Marker"] * 3 + ["Marker"] * 3),
        ",Name," + ",".join([body] * 8 + [marker] * 6),
        ",ID," + ",".join(["1"] * 14),
        ",,"
        + ",".join(["Rotation"] * 4 + ["Position"] * 3 + ["Mean Marker Error"])
        + ","
        + ",".join(["Position"] * 6),
        "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,,X,Y,Z,X,Y,Z",
    ]
    turns = quaternions(session)
    taken = frames(session, rate)
    places = recorded(session, taken, session.poses[:, :3])
    points = recorded(session, taken, session.points[:, 0])
    for i, ((time, k), place, point) in enumerate(zip(taken, places, points, strict=True)):
        q = turns[max(k, 0)]
        cells = [*_text(q[[1, 2, 3, 0]], 12), *_text(factor * place), "0.000100"]
        cells += ["9.0"] * 3 + _text(factor * point)
        if i < hidden:
            cells = [""] * len(cells)
        lines.append(",".join([str(i), f"{time - 90:.6f}", *cells]))
    return save(folder / "take.csv", lines)


def vicon(session: Session, folder: Path, quaternion: bool = False) -> Path:
    """A recording of one segment, with a second section after it."""
    angle = ["RX", "RY", "RZ", *["RW"] * quaternion]
    unit = [""] * 4 if quaternion else ["deg"] * 3
    lines = [
        "Segments",
        "20",
        ",,Arm:Tool" + "," * (len(angle) + 2),
        ",".join(["Frame", "Sub Frame", *angle, "TX", "TY", "TZ"]),
        ",".join(["", "", *unit, "mm", "mm", "mm"]),
    ]
    turns = quaternions(session)
    taken = frames(session, 20.0)
    places = recorded(session, taken, session.poses[:, :3])
    for (time, k), place in zip(taken, places, strict=True):
        k = max(k, 0)
        turn = turns[k][[1, 2, 3, 0]] if quaternion else np.rad2deg(session.poses[k, 3:])
        frame = str(round((time - 90) * 20))
        lines.append(",".join([frame, "0", *_text(turn, 12), *_text(1e3 * place)]))
    lines += ["", "Trajectories", "20", ",,Arm:M1,,", "Frame,Sub Frame,X,Y,Z", ",,mm,mm,mm"]
    return save(folder / "nexus.csv", [*lines, "1,0,1,2,3"])


def joint_list(session: Session, folder: Path) -> Path:
    """Posedesign's own columns, by the names of poses."""
    n = session.q.shape[1]
    lines = [",".join(["pose", *(f"j{k + 1}_deg" for k in range(n))])]
    lines += [
        ",".join([name, *_text(np.rad2deg(q))])
        for name, q in zip(session.names, session.q, strict=True)
    ]
    return save(folder / "joints.csv", lines)


def _recorded(session: Session, rate: float = 50.0) -> list[tuple[float, FloatArray]]:
    taken = frames(session, rate)
    return [
        (time, q) for (time, _), q in zip(taken, recorded(session, taken, session.q), strict=True)
    ]


def shown(session: Session, q: FloatArray) -> FloatArray:
    """What the controller shows [deg]."""
    controller = arm_of(session.robot).robot.controller
    assert controller is not None
    return controller.pendant(q)


def rtde(session: Session, folder: Path, mark: str = ",") -> Path:
    names = [
        "timestamp",
        *(f"target_q_{k}" for k in range(6)),
        *(f"actual_q_{k}" for k in range(6)),
    ]
    lines = [mark.join(names)]
    for time, q in _recorded(session):
        values = np.deg2rad(shown(session, q))
        lines.append(mark.join([f"{time:.3f}", *["0.0"] * 6, *_text(values, 10)]))
    return save(folder / "rtde.csv", lines)


def egm(session: Session, folder: Path) -> Path:
    joints = [f"R_FB_POS_{kind}J{k + 1}" for kind in "RE" for k in range(6)]
    lines = [",".join(["TIMESTAMP", *joints])]
    for time, q in _recorded(session):
        values = _text(shown(session, q))
        lines.append(",".join([str(round(1e3 * time)), *values, *["0"] * 6]))
    return save(folder / "egm.csv", lines)


def rsi_telegrams(session: Session, folder: Path) -> Path:
    lines = []
    for time, q in _recorded(session):
        axes = " ".join(f'A{k + 1}="{v:.9f}"' for k, v in enumerate(shown(session, q).tolist()))
        lines += [
            f'<Rob Type="KUKA"><RIst X="0.0" Y="0.0" Z="0.0" A="0" B="0" C="0"/><AIPos {axes}/>',
            f'<Delay D="0"/><IPOC>{round(1e3 * time)}</IPOC></Rob>',
        ]
    return save(folder / "rsi.xml", lines)


def rsi_table(session: Session, folder: Path) -> Path:
    lines = [";".join(["IPOC", *(f"AIPos.A{k + 1}" for k in range(6))])]
    for time, q in _recorded(session):
        lines.append(";".join([str(round(1e3 * time)), *_text(shown(session, q))]))
    return save(folder / "rsi.csv", lines)


def _names(session: Session) -> tuple[str, ...]:
    return arm_of(session.robot).robot.joint_names


def rostopic(session: Session, folder: Path) -> Path:
    order = [2, 1, 0, 3, 4, 5]
    names = [_names(session)[k] for k in order]
    head = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
    head += [f"field.{what}{k}" for what in ("name", "position", "velocity") for k in range(6)]
    lines = [",".join(head)]
    for i, (time, q) in enumerate(_recorded(session)):
        stamp = str(1_600_000_000_000_000_000 + round(1e9 * time))
        cells = [stamp, str(i), stamp, "", *names, *_text(q[order], 12), *["0.0"] * 6]
        lines.append(",".join(cells))
    return save(folder / "joint_states.csv", lines)


def ros2(session: Session, folder: Path) -> Path:
    names = list(_names(session))
    lines = []
    for time, q in _recorded(session):
        seconds, rest = divmod(round(1e9 * time), 1_000_000_000)
        cells = [str(1_600_000_000 + seconds), str(rest), "base", *names, *_text(q, 12)]
        lines.append(",".join([*cells, *["0.0"] * 12]))
    return save(folder / "echo.csv", lines)


def plotjuggler(session: Session, folder: Path) -> Path:
    head = ["__time", *(f"/joint_states/{name}/position" for name in _names(session))]
    lines = [",".join(head)]
    lines += [",".join([f"{t:.6f}", *_text(q, 12)]) for t, q in _recorded(session)]
    return save(folder / "plot.csv", lines)


Writer = Callable[[Session, Path], Path]


def shuffled(session: Session, seed: int = 0) -> Session:
    """Poses in another order."""
    order = np.random.default_rng(seed).permutation(len(session.q))
    return replace(
        session, q=session.q[order], points=session.points[order], poses=session.poses[order]
    )
