"""An arm by time: joint values, or poses of its flange, of the messages of a bag."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from calib.errors import InputError, near_names
from calib.robots import Robot
from calib.se3 import FloatArray, inverse, rotation_from_quaternion, transform
from posedesign.files.csv_tables import a_few
from posedesign.hand_eye.recordings.bags import FRAMES, Bag, Message, Times, Topic, stamp_of

STILL_PER_S = 5e-3
"""Speed [rad/s, m/s] of a joint, or of the flange, below which the arm stands still: within the
time of a picture it moves by less than it stops off."""

WINDOW_S = 0.3
"""Time over which the arm has to move slower, and shortest stand-still that a picture is taken
of: after a stop the arm and what it carries swing for a few tenths of a second."""

LONGEST_GAP_S = 1.0
"""Between two messages of an arm, beyond which it is not known to stand."""

LONGEST_S = 7 * 86400.0
"""Of a recording: a week."""

MOST_ROWS = 3_000_000
"""Messages of an arm that are kept: half an hour and more at 1 kHz."""


@dataclass(frozen=True, eq=False)
class ArmStream:
    """Joint values, or poses of the flange in the base frame, at M times."""

    source: str  # topic or frames that it is from
    times: Times
    joints: FloatArray | None = None  # (M, n) [rad, m]
    T_base_flange: FloatArray | None = None  # (M, 4, 4) [m]
    held: Mapping[str, FloatArray] = field(default_factory=dict)
    """By name, values (M,) [rad, m] of joints that the robot's description holds."""
    notes: tuple[str, ...] = ()

    @property
    def coordinates(self) -> FloatArray:
        """Numbers ``(M, k)`` that change by no more than the arm moves [rad, m].

        Joint values; or position and rotation matrix over √2, whose distance is the angle for
        small angles: ``||R - 1||_F = 2 √2 sin(angle / 2)``.
        """
        if self.joints is not None:
            return self.joints
        T = self.T_base_flange
        if T is None:
            raise InputError("an arm has neither joints nor poses", name="arm")
        return np.hstack([T[:, :3, 3], T[:, :3, :3].reshape(-1, 9) / np.sqrt(2.0)])

    def each_time_once(self, seconds: FloatArray) -> tuple[ArmStream, FloatArray]:
        """Return rows with rising times, and these ``(M,)`` [s].

        Raises InputError: the times are spread over more than a recording takes.
        """
        if float(np.ptp(seconds)) > LONGEST_S:
            raise InputError(
                f"{self.source}: times are spread over {np.ptp(seconds) / 86400:.3g} days",
                hint="were clocks set meanwhile? cut the bag there",
                name="recording",
            )
        rise, first = np.unique(seconds, return_index=True)
        times = Times(self.times.stamp_ns[first], self.times.recorded_ns[first])
        kept = replace(
            self,
            times=times,
            joints=None if self.joints is None else self.joints[first],
            T_base_flange=None if self.T_base_flange is None else self.T_base_flange[first],
            held={name: values[first] for name, values in self.held.items()},
        )
        return kept, rise


def speeds(seconds: FloatArray, coordinates: FloatArray) -> FloatArray:
    """Return how fast each row ``(M,)`` moves [rad/s, m/s]: range over a window, largest of all."""
    frame = pd.DataFrame(coordinates, index=pd.to_timedelta(seconds, unit="s"))
    window = frame.rolling(pd.Timedelta(seconds=WINDOW_S), center=True)
    span = (window.max() - window.min()).to_numpy().max(axis=1)
    return np.asarray(span / WINDOW_S, dtype=float)


def stand_stills(seconds: FloatArray, coordinates: FloatArray) -> list[tuple[float, float]]:
    """Return when the arm stands, as pairs of begin and end [s].

    Sparse messages, with fewer than two in the window, are compared with their neighbours.
    """
    moves = speeds(seconds, coordinates) > STILL_PER_S
    step = np.abs(np.diff(coordinates, axis=0)).max(axis=1)
    gap = np.diff(seconds)
    apart = (gap > LONGEST_GAP_S) | (step > STILL_PER_S * np.maximum(gap, WINDOW_S))
    found: list[tuple[float, float]] = []
    begin: int | None = None
    for k in range(len(seconds)):
        if begin is not None and (moves[k] or apart[k - 1]):
            found.append((float(seconds[begin]), float(seconds[k - 1])))
            begin = None
        if begin is None and not moves[k]:
            begin = k
    if begin is not None:
        found.append((float(seconds[begin]), float(seconds[-1])))
    return found


def read_joints(bag: Bag, topic: Topic, robot: Robot) -> ArmStream:
    """Read the joints of a robot from messages of ``sensor_msgs/JointState``.

    Messages without all joints of the robot, as of a gripper on the same topic, are passed over.
    Raises InputError: no message has all of them.
    """
    names, held = robot.joint_names, [joint.name for joint in robot.held]
    times: list[tuple[int, int]] = []
    rows: list[FloatArray] = []
    others: dict[str, None] = {}
    order: dict[tuple[str, ...], tuple[list[int], list[int]] | None] = {}
    for message in bag.messages(topic):
        called = tuple(message.content.name)
        if called not in order:
            where = {name: i for i, name in enumerate(called)}
            whole = all(name in where for name in names)
            picked = [where[name] for name in names] if whole else []
            order[called] = (picked, [where.get(name, -1) for name in held]) if whole else None
        which = order[called]
        values = np.asarray(message.content.position, dtype=float)
        if which is None or len(values) != len(called):
            others |= dict.fromkeys(name[:60] for name in called[:40])
            continue
        more = [values[i] if i >= 0 else np.nan for i in which[1]]
        _keep(times, rows, message, np.append(values[which[0]], more))
    if not rows:
        lost = [name for name in names if name not in others]
        raise InputError(
            f"{bag.path}: {topic.name} has no message with "
            + (f"the joint {a_few(lost)}" if lost else "positions of all joints")
            + f" of the robot; it has {', '.join(list(others)[:10])}",
            hint=near_names(lost[0], others)
            if lost
            else "record the topic that the arm's controller publishes",
            name="joint_topic",
        )
    both = np.array(rows)
    n = len(names)
    kept = {name: both[:, n + i] for i, name in enumerate(held) if np.isfinite(both[0, n + i])}
    return ArmStream(topic.name, Times.of(times), joints=_finite(bag, both[:, :n]), held=kept)


def read_poses(bag: Bag, topic: Topic) -> ArmStream:
    """Read poses of the flange from messages of PoseStamped or TransformStamped."""
    times: list[tuple[int, int]] = []
    rows: list[FloatArray] = []
    frames: dict[str, None] = {}
    for message in bag.messages(topic):
        content = message.content
        frames.setdefault(str(content.header.frame_id)[:60])
        _keep(times, rows, message, _numbers_of(content))
    said = f"{topic.name}: poses are taken for those of the flange in {', '.join(frames) or '?'}"
    T = _transforms(bag, np.array(rows))
    return ArmStream(topic.name, Times.of(times), T_base_flange=T, notes=(said,))


def read_frames(bag: Bag, base: str, flange: str) -> ArmStream:
    """Read poses of one frame in another from ``/tf`` and ``/tf_static``.

    At the times of the link on the path between them that has the most messages; the other links
    are taken as they were nearest in time. Raises InputError: no path of frames joins both.
    """
    topics = bag.of_types(FRAMES)
    if not topics:
        bag.only(FRAMES, "transforms (tf)", "tf")  # says what there is
    edges = _edges(bag, topics)
    up, down = _path(bag, edges, base, flange)
    moving = [child for child in (*up, *down) if len(edges[child].rows) > 1]
    lead = max(moving or (*up, *down), key=lambda child: len(edges[child].rows))
    at = Times.of(edges[lead].times)

    def chain(children: Sequence[str]) -> FloatArray:
        T = np.broadcast_to(np.eye(4), (len(at.stamp_ns), 4, 4))
        for child in reversed(children):
            T = T @ edges[child].at(bag, at)
        return T

    whole = inverse(chain(up)) @ chain(down)
    return ArmStream(f"tf {base} to {flange}", at, T_base_flange=np.asarray(whole))


@dataclass(eq=False)
class _Edge:
    """Pose of a frame in its parent by time."""

    parent: str
    times: list[tuple[int, int]]
    rows: list[FloatArray]

    def at(self, bag: Bag, times: Times) -> FloatArray:
        """Transforms at the nearest times."""
        T = _transforms(bag, np.array(self.rows))
        if len(T) == 1:
            return T
        own = Times.of(self.times)
        order = np.argsort(own.stamp_ns, kind="stable")
        stamps = own.stamp_ns[order]
        after = np.clip(np.searchsorted(stamps, times.stamp_ns), 1, len(stamps) - 1)
        before = times.stamp_ns - stamps[after - 1] < stamps[after] - times.stamp_ns
        return np.asarray(T[order[after - before]])


def _edges(bag: Bag, topics: Sequence[Topic]) -> dict[str, _Edge]:
    """Links between frames by the name of the child, as they were last said to hang."""
    edges: dict[str, _Edge] = {}
    count = 0
    for message in bag.messages(*topics):
        for one in message.content.transforms:
            child, parent = (
                str(name).lstrip("/") for name in (one.child_frame_id, one.header.frame_id)
            )
            edge = edges.setdefault(child, _Edge(parent, [], []))
            if edge.parent != parent:
                raise InputError(
                    f"{bag.path}: the frame {child[:60]} hangs on {edge.parent[:60]} and on "
                    f"{parent[:60]}",
                    hint="record one robot, or take the topic of its joints",
                    name="tf",
                )
            count += 1
            _check_count(count)
            edge.times.append((stamp_of(one.header), message.recorded_ns))
            edge.rows.append(_numbers_of(one))
    return edges


def _path(
    bag: Bag, edges: Mapping[str, _Edge], base: str, flange: str
) -> tuple[list[str], list[str]]:
    """Frames from the base, and from the flange, up to the frame that both hang on."""
    known = {*edges, *(edge.parent for edge in edges.values())}
    for name in (base, flange):
        if name not in known:
            raise InputError(
                f"{bag.path}: there is no frame {name}",
                hint=near_names(name, sorted(known)),
                name="tf",
            )
    chains = [list(_ancestors(edges, name)) for name in (base, flange)]
    common = next((name for name in chains[0] if name in chains[1]), None)
    if common is None or base == flange:
        raise InputError(
            f"{bag.path}: no transforms lead from {base} to {flange}",
            hint="record /tf and /tf_static from the start, and name two frames of one robot",
            name="tf",
        )
    up, down = (chain[: chain.index(common)] for chain in chains)
    return up, down


def _ancestors(edges: Mapping[str, _Edge], name: str) -> Iterator[str]:
    """A frame and those that it hangs on, each once."""
    seen: set[str] = set()
    while name not in seen:
        seen.add(name)
        yield name
        if name not in edges:
            return
        name = edges[name].parent


def _keep(
    times: list[tuple[int, int]], rows: list[FloatArray], message: Message, values: FloatArray
) -> None:
    _check_count(len(rows))
    times.append((message.stamp_ns, message.recorded_ns))
    rows.append(values)


def _check_count(count: int) -> None:
    if count >= MOST_ROWS:
        raise InputError(
            f"the bag has more than {MOST_ROWS:,} messages of the arm",
            hint="cut it, or record at a lower rate",
            name="bag",
        )


def _numbers_of(content: Any) -> FloatArray:
    """Position and quaternion (w, x, y, z) ``(7,)`` of a pose or a transform with a header."""
    if hasattr(content, "pose"):
        p, q = content.pose.position, content.pose.orientation
    else:
        p, q = content.transform.translation, content.transform.rotation
    return np.array([p.x, p.y, p.z, q.w, q.x, q.y, q.z], dtype=float)


def _transforms(bag: Bag, rows: FloatArray) -> FloatArray:
    """Transforms ``(M, 4, 4)`` of position and quaternion ``(M, 7)``."""
    rows = _finite(bag, rows)
    norms = np.linalg.norm(rows[:, 3:], axis=1)
    if not ((norms > 0.99) & (norms < 1.01)).all():
        raise InputError(
            f"{bag.path}: message {int(np.argmax(np.abs(norms - 1.0))) + 1} has a quaternion that "
            "is no rotation",
            hint="its length is not 1: record it again",
            name="bag",
        )
    return transform(rotation_from_quaternion(rows[:, 3:]), rows[:, :3])


def _finite(bag: Bag, rows: FloatArray) -> FloatArray:
    if not np.isfinite(rows).all():
        raise InputError(
            f"{bag.path}: a message of the arm has values that are no numbers",
            hint="record it again, or cut the bag before it",
            name="bag",
        )
    return rows
