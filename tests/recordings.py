"""Recordings of an arm that stops at poses: pictures of its camera and its joints, as bags."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.lens import Lens
from calib.robots import Robot
from calib.se3 import FloatArray, inverse, quaternion_from_rotation
from tests.board_pictures import Camera

Storage = Literal["mcap", "sqlite3"]

START_NS = 1_700_000_000_000_000_000
"""Of the recording, since the epoch."""


@dataclass(frozen=True, eq=False)
class Run:
    """An arm that goes from stop to stop, with a camera on its flange."""

    robot: Robot
    camera: Camera
    X: FloatArray  # (4, 4): T_flange_camera
    Z: FloatArray  # (4, 4): T_base_board
    stops: FloatArray  # (S, n) [rad]
    stand_s: float = 0.8
    move_s: float = 0.7
    rate_hz: float = 10.0  # of pictures

    @property
    def length_s(self) -> float:
        """Time from the first picture to the end."""
        return len(self.stops) * self.stand_s + (len(self.stops) - 1) * self.move_s

    def joints_at(self, time_s: FloatArray) -> FloatArray:
        """Joints ``(K, n)``: it stands first, then goes on without a jerk, and so on.

        An arm that never stands has the same speed from stop to stop.
        """
        period = self.stand_s + self.move_s
        time = np.clip(np.atleast_1d(time_s), 0.0, self.length_s - 1e-9)
        stop = (time // period).astype(int)
        part = np.clip((time - stop * period - self.stand_s) / self.move_s, 0.0, 1.0)
        smooth = part**3 * (10.0 - 15.0 * part + 6.0 * part**2) if self.stand_s else part
        after = np.minimum(stop + 1, len(self.stops) - 1)
        return self.stops[stop] + smooth[:, None] * (self.stops[after] - self.stops[stop])

    def picture_times(self) -> FloatArray:
        """Times [s] of the pictures."""
        return np.arange(round(self.length_s * self.rate_hz)) / self.rate_hz + 0.013

    def pictures(self, seed: int = 3) -> Iterator[NDArray[np.uint8]]:
        """Pictures at these times."""
        rng = np.random.default_rng(seed)
        for q in self.joints_at(self.picture_times()):
            T_base_camera = self.robot.fk(q) @ self.X
            yield self.camera.take(inverse(T_base_camera) @ self.Z, rng)


def write_bag(
    path: Path,
    storage: Storage,
    messages: Sequence[tuple[str, str, float, Any]],
    **options: Any,
) -> Path:
    """Write messages (topic, type, time [s], content) as a bag of ROS 2."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    writer = Writer(path, version=9, storage_plugin=plugin)
    if options.get("compression"):
        from rosbags.rosbag2 import CompressionFormat, CompressionMode

        writer.set_compression(CompressionMode[options["compression"]], CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, kind, _, _ in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
        for topic, kind, time_s, content in sorted(messages, key=lambda one: one[2]):
            raw = content if isinstance(content, bytes) else store.serialize_cdr(content, kind)
            writer.write(connections[topic], START_NS + round(1e9 * time_s), raw)
    return path


def types() -> dict[str, Any]:
    """Classes of messages by their names."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE).types


def header(time_s: float, frame: str = "") -> Any:
    """Header with a stamp."""
    of = types()
    ns = START_NS + round(1e9 * time_s)
    stamp = of["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
    return of["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def image(time_s: float, picture: NDArray[Any], encoding: str = "mono8", **other: Any) -> Any:
    """``sensor_msgs/Image`` of an array ``(height, width[, channels])``."""
    data = np.ascontiguousarray(picture).view(np.uint8).ravel()
    height, width = picture.shape[:2]
    fields = {
        "header": header(time_s),
        "height": height,
        "width": width,
        "encoding": encoding,
        "is_bigendian": 0,
        "step": len(data) // height,
        "data": data,
    }
    return types()["sensor_msgs/msg/Image"](**(fields | other))


def compressed(time_s: float, picture: NDArray[Any], ending: str = ".jpg") -> Any:
    """``sensor_msgs/CompressedImage`` of a picture."""
    done, data = cv2.imencode(ending, picture)
    assert done
    said = "mono8; jpeg compressed mono8" if ending == ".jpg" else "mono8; png compressed mono8"
    return types()["sensor_msgs/msg/CompressedImage"](
        header=header(time_s), format=said, data=data.ravel()
    )


def joint_state(time_s: float, names: Sequence[str], values: Sequence[float]) -> Any:
    """``sensor_msgs/JointState``."""
    none = np.zeros(0)
    return types()["sensor_msgs/msg/JointState"](
        header=header(time_s),
        name=list(names),
        position=np.array(values, dtype=float),
        velocity=none,
        effort=none,
    )


def pose_stamped(time_s: float, T: FloatArray, frame: str = "base") -> Any:
    """``geometry_msgs/PoseStamped``."""
    of, q = types(), quaternion_from_rotation(T[:3, :3])
    return of["geometry_msgs/msg/PoseStamped"](
        header=header(time_s, frame),
        pose=of["geometry_msgs/msg/Pose"](
            position=of["geometry_msgs/msg/Point"](*T[:3, 3].tolist()),
            orientation=of["geometry_msgs/msg/Quaternion"](*q[1:].tolist(), q[0]),
        ),
    )


def transform_stamped(time_s: float, T: FloatArray, parent: str, child: str) -> Any:
    """``geometry_msgs/TransformStamped``."""
    of, q = types(), quaternion_from_rotation(T[:3, :3])
    return of["geometry_msgs/msg/TransformStamped"](
        header=header(time_s, parent),
        child_frame_id=child,
        transform=of["geometry_msgs/msg/Transform"](
            translation=of["geometry_msgs/msg/Vector3"](*T[:3, 3].tolist()),
            rotation=of["geometry_msgs/msg/Quaternion"](*q[1:].tolist(), q[0]),
        ),
    )


def transforms(*edges: Any) -> Any:
    """``tf2_msgs/TFMessage``."""
    return types()["tf2_msgs/msg/TFMessage"](transforms=list(edges))


def lens_message(time_s: float, lens: Lens) -> Any:
    """``sensor_msgs/CameraInfo`` of a lens."""
    names = {"pinhole": "plumb_bob", "rational": "rational_polynomial", "fisheye": "equidistant"}
    K, terms = lens.to_opencv()
    of = types()
    return of["sensor_msgs/msg/CameraInfo"](
        header=header(time_s),
        height=lens.height_px,
        width=lens.width_px,
        distortion_model=names[lens.name],
        d=np.asarray(terms, dtype=float).ravel(),
        k=K.ravel(),
        r=np.eye(3).ravel(),
        p=np.hstack([K, np.zeros((3, 1))]).ravel(),
        binning_x=0,
        binning_y=0,
        roi=of["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False),
    )


@dataclass(frozen=True, eq=False)
class Scene:
    """A texture that shifts with the first two joints of an arm, and is drawn in no time."""

    stops: FloatArray  # (S, n) [rad]
    stand_s: float = 1.0
    move_s: float = 0.6
    rate_hz: float = 10.0

    def run(self) -> Run:
        """The same arm as a run whose own pictures are not drawn."""
        nothing: Any = None
        return Run(
            nothing, nothing, nothing, nothing, self.stops, self.stand_s, self.move_s, self.rate_hz
        )

    def pictures(self, at_s: FloatArray | None = None) -> Iterator[NDArray[np.uint8]]:
        """Pictures ``(120, 160)`` at times [s]; those of the run by default."""
        rng = np.random.default_rng(5)
        texture = cv2.GaussianBlur(rng.uniform(0, 255, (700, 700)).astype(np.float32), (0, 0), 3)
        texture = 128 + 8 * (texture - texture.mean())
        run = self.run()
        for q in run.joints_at(run.picture_times() if at_s is None else at_s):
            M = np.array([[1, 0, -270 - 200 * q[0]], [0, 1, -290 - 200 * q[1]]])
            shifted = cv2.warpAffine(texture, M, (160, 120))
            noisy = shifted + 2 * rng.standard_normal(shifted.shape)
            yield np.clip(noisy, 0, 255).astype(np.uint8)

    def messages(
        self,
        names: Sequence[str],
        *,
        late_s: float = 0.0,
        joints_hz: float = 50.0,
        topics: tuple[str, str] = ("/camera/image_raw", "/joint_states"),
    ) -> list[tuple[str, str, float, Any]]:
        """Messages of pictures and joints; stamps of the pictures are late by so much [s]."""
        run = self.run()
        times = run.picture_times()
        arm = np.arange(0.0, run.length_s, 1.0 / joints_hz)
        return [
            *(
                (topics[0], IMAGE, t + late_s + 0.02, image(t + late_s, picture))
                for t, picture in zip(times, self.pictures(), strict=True)
            ),
            *(
                (topics[1], JOINTS, t + 0.001, joint_state(t, names, q))
                for t, q in zip(arm, run.joints_at(arm), strict=True)
            ),
        ]


IMAGE, JOINTS = "sensor_msgs/msg/Image", "sensor_msgs/msg/JointState"
COMPRESSED, LENS = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"
POSE, TF = "geometry_msgs/msg/PoseStamped", "tf2_msgs/msg/TFMessage"
"""Types of messages."""
