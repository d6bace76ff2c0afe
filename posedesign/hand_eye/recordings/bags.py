"""Bags of ROS 2 (rosbag2): messages by topic with their times, without an installation of ROS.

A folder with ``metadata.yaml``, or one file of SQLite (``.db3``) or MCAP (``.mcap``). The storage
is read by the package ``rosbags`` in a process of its own with limits, message by message, so that
a bag may be larger than the memory, and a damaged one cannot take more than its share. Messages are
decoded by the definitions of ROS 2 that ``rosbags`` brings along, never by those in the bag: code
is made from definitions.

Times: each message has the time at which it was recorded, by the clock of the recording computer,
and most have a stamp of their own in ``header``, by the clock of who sent them. See
:class:`Times`.

Sources: design of rosbag2, "bag format versions"; ``sensor_msgs``, ``geometry_msgs`` and
``tf2_msgs`` of ROS 2 Humble.
"""

from __future__ import annotations

import json
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from calib.errors import FileFormatError, InputError, near_names
from calib.limited import stream_limited
from calib.se3 import FloatArray, IntArray
from posedesign.files.csv_tables import a_few
from posedesign.files.pictures import LARGEST_PICTURE_BYTES
from posedesign.files.trees import read_tree
from posedesign.hand_eye.pairs.pose_files import natural
from posedesign.hand_eye.recordings.bag_process import MESSAGE

IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
LENSES = ("sensor_msgs/msg/CameraInfo",)
JOINTS = ("sensor_msgs/msg/JointState",)
POSES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped")
FRAMES = ("tf2_msgs/msg/TFMessage",)
"""Types of messages that are read, by what they are."""

ENDINGS = (".mcap", ".db3")

_MEMORY_BYTES = 3_000_000_000
"""Of the process that reads: a chunk of MCAP, compressed and not, or a message."""

_SECONDS, _PATIENCE_S = 7200.0, 120.0
"""Processor time of reading a bag, and longest time until the next message."""

_NO_EXTRA = "reading a bag needs the package rosbags, which is not installed"


@dataclass(frozen=True)
class Topic:
    """A topic of a bag."""

    name: str
    type: str  # such as sensor_msgs/msg/Image
    count: int  # messages


@dataclass(frozen=True, eq=False)
class Message:
    """A message, decoded."""

    topic: Topic
    recorded_ns: int  # when it was recorded, since the epoch
    content: Any  # its fields by name, as ROS calls them

    @property
    def stamp_ns(self) -> int:
        """Its own time since the epoch; 0 where it has none."""
        header = getattr(self.content, "header", None)
        return 0 if header is None else stamp_of(header)


@dataclass(frozen=True, eq=False)
class Times:
    """When the K messages of a topic were sent and recorded."""

    stamp_ns: IntArray  # (K,) since the epoch; 0 where there is none
    recorded_ns: IntArray  # (K,)

    @classmethod
    def of(cls, pairs: Sequence[tuple[int, int]]) -> Times:
        """Return times of pairs of stamp and time of recording [ns]."""
        both = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        return cls(both[:, 0], both[:, 1])

    @property
    def are_stamped(self) -> bool:
        """Return True if all messages have a stamp, and stamps do not go back."""
        return bool((self.stamp_ns > 0).all() and (np.diff(self.stamp_ns) >= 0).all())

    @property
    def delay_s(self) -> float:
        """Time from stamp to recording [s], median."""
        return 1e-9 * float(np.median(self.recorded_ns - self.stamp_ns))

    def ns(self, *, stamped: bool) -> IntArray:
        """Return stamps, or times of recording, ``(K,)`` [ns]."""
        return self.stamp_ns if stamped else self.recorded_ns


LARGEST_DELAY_S = 1.0
"""Two topics whose messages take from stamp to recording times that differ by more have stamps of
different clocks."""


def common_seconds(first: Times, second: Times) -> tuple[FloatArray, FloatArray, str]:
    """Return times of both topics by one clock [s], from the first message on.

    By stamps; else by the times of recording, and why, in words.
    """
    stamped, why = have_one_clock(first, second)
    both = [times.ns(stamped=stamped) for times in (first, second)]
    start = min(int(times.min()) for times in both)
    one, other = (np.asarray(1e-9 * (times - start), dtype=float) for times in both)
    return one, other, why


def have_one_clock(first: Times, second: Times) -> tuple[bool, str]:
    """Return True if the stamps of two topics may be compared; else False and why, in words."""
    lacking = [times for times in (first, second) if not times.are_stamped]
    if lacking:
        return False, "messages have no stamps that rise: the times of recording are taken"
    apart = abs(first.delay_s - second.delay_s)
    if apart > LARGEST_DELAY_S:
        return False, (
            f"stamps are of two clocks that are {apart:.3g} s apart: the times of recording are "
            "taken"
        )
    return True, ""


def stamp_of(header: Any) -> int:
    """Time of a header since the epoch [ns]."""
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


@dataclass(frozen=True)
class Bag:
    """A bag of ROS 2 and its topics; messages are read when they are asked for."""

    path: Path
    files: tuple[Path, ...]  # of its storage, in order
    compressed: bool  # whether each message is compressed
    topics: tuple[Topic, ...]

    @classmethod
    def open(cls, path: Path) -> Bag:
        """Open a folder or a file.

        Raises FileFormatError: it is no bag, or damaged. InputError: `rosbags` is not installed.
        """
        _check_extra()
        files, compressed = _storage_of(path)
        bag = cls(path, files, compressed, ())
        parts = bag._parts(())
        found = json.loads(next(parts))
        parts.close()
        topics = tuple(Topic(name, *known) for name, known in sorted(found.items()))
        return cls(path, files, compressed, topics)

    def of_types(self, types: Sequence[str]) -> list[Topic]:
        """Topics of some types that have messages."""
        return [topic for topic in self.topics if topic.type in types and topic.count]

    def named(self, name: str, types: Sequence[str], what: str) -> Topic:
        """Return the topic of a name; InputError where it is not there, or of another type."""
        known = [topic.name for topic in self.of_types(types)]
        found = next((topic for topic in self.topics if topic.name == name), None)
        if found is None:
            near = near_names(name, known) if known else f"it has no {what}"
            raise InputError(f"{self.path}: there is no topic {name}", hint=near, name=name)
        if found.type not in types or not found.count:
            said = f"is of {found.type}" if found.count else "has no messages"
            raise InputError(
                f"{self.path}: {name} {said}",
                hint=f"{what}: {a_few(known)}" if known else f"the bag has no {what}",
                name=name,
            )
        return found

    def only(self, types: Sequence[str], what: str, option: str) -> Topic:
        """Return the one topic of some types; InputError where there is none, or more than one."""
        found = self.of_types(types)
        if len(found) == 1:
            return found[0]
        if found:
            raise InputError(
                f"{self.path} has {len(found)} topics of {what}: "
                + ", ".join(topic.name for topic in found[:8]),
                hint=f"name one: `{option}`",
                name=option,
            )
        there = [f"{topic.name} ({topic.type})" for topic in self.topics if topic.count]
        raise InputError(
            f"{self.path} has no {what}",
            hint=f"it has {', '.join(there[:8])}" if there else "it has no messages",
            name=option,
        )

    def messages(self, *topics: Topic) -> Generator[Message, None, None]:
        """Yield the messages of some topics in the order of their recording.

        Raises FileFormatError: the bag is damaged, or a message is.
        """
        decode = _decoder()
        parts = self._parts([topic.name for topic in topics])
        next(parts)
        try:
            for number, part in enumerate(parts):
                which, time_ns = MESSAGE.unpack_from(part)
                topic = topics[which]
                try:
                    content = decode(part[MESSAGE.size :], topic.type)
                except Exception as error:  # its readers raise what their arithmetic raises
                    raise FileFormatError(
                        f"message {number + 1} of {topic.name} is no {topic.type}, or cut off",
                        path=self.path,
                        hint="record it again, or cut the bag before it",
                    ) from error
                yield Message(topic, time_ns, content)
        finally:
            parts.close()

    def _parts(self, topics: Sequence[str]) -> Generator[bytes, None, None]:
        job = {
            "files": [str(file) for file in self.files],
            "topics": list(topics),
            "compressed": self.compressed,
            "most_bytes": LARGEST_PICTURE_BYTES,
        }
        try:
            parts = stream_limited(
                "posedesign.hand_eye.recordings.bag_process",
                json.dumps(job).encode(),
                memory_bytes=_MEMORY_BYTES,
                seconds=_SECONDS,
                patience_s=_PATIENCE_S,
            )
            for part in parts:
                if part[:1] == b"e":
                    raise self._fault(part[1:].decode("utf-8", "replace"))
                yield part[1:]
        except OSError as error:  # TimeoutError among them
            raise self._fault(str(error)) from error

    def _fault(self, why: str) -> FileFormatError:
        said = " ".join(why.replace(str(self.path), self.path.name).split()).rstrip(".")
        return FileFormatError(
            f"cannot be read as a bag: {said[:200]}",
            path=self.path,
            hint="was the recording ended properly, and copied whole? try `mcap recover` or "
            "sqlite's .recover",
        )


def is_bag(path: Path) -> bool:
    """Return True if a path has the ending of a bag, or is a folder that holds one."""
    if not path.is_dir():
        return path.suffix.casefold() in ENDINGS
    try:
        return any(entry.suffix.casefold() in ENDINGS for entry in path.iterdir())
    except OSError:
        return False  # who reads pictures says why


def _storage_of(path: Path) -> tuple[tuple[Path, ...], bool]:
    """Files of a bag in order, and whether each message in them is compressed."""
    if not path.exists():
        raise FileFormatError("there is no such file or folder", path=path, hint="check the path")
    if path.is_dir():
        return _storage_in(path)
    if path.suffix.casefold() == ".bag":
        raise FileFormatError(
            "is a bag of ROS 1",
            path=path,
            hint="convert it: rosbags-convert --src FILE.bag --dst FOLDER",
        )
    if path.suffix.casefold() not in ENDINGS:
        raise FileFormatError(
            "is no bag of ROS 2",
            path=path,
            hint=f"give its folder, or a file with the ending {' or '.join(ENDINGS)}",
        )
    return (path,), False


def _storage_in(folder: Path) -> tuple[tuple[Path, ...], bool]:
    about = folder / "metadata.yaml"
    tree = read_tree(about) if about.is_file() else {}
    info = tree.get("rosbag2_bagfile_information") if isinstance(tree, dict) else None
    said = info if isinstance(info, dict) else {}
    mode = str(said.get("compression_mode", "")).casefold()
    listed = said.get("relative_file_paths")
    try:
        names = listed if isinstance(listed, list) else [entry.name for entry in folder.iterdir()]
    except OSError as error:
        raise FileFormatError(
            f"cannot be listed: {error.strerror or error}",
            path=folder,
            hint="check that the folder can be read",
        ) from error
    # a name in it may lead anywhere: only its last part counts
    files = [folder / PurePath(str(name).replace("\\", "/")).name for name in names]
    files = [file for file in files if listed is not None or file.suffix.casefold() in ENDINGS]
    if mode == "file" or any(file.suffix.casefold() == ".zstd" for file in files):
        raise FileFormatError(
            "is compressed as a file",
            path=folder,
            hint="unpack it (zstd -d FILE.zstd), and give the file",
        )
    lost = [file.name for file in files if not file.is_file()]
    if lost or not files:
        raise FileFormatError(
            f"has no file {a_few(lost)}" if lost else "holds no .mcap or .db3",
            path=folder,
            hint="is it the folder of one bag, copied whole?",
        )
    if listed is None:
        files.sort(key=lambda file: natural(file.name))
    return tuple(files), mode == "message"


def _check_extra() -> None:
    from importlib.util import find_spec

    if find_spec("rosbags") is None:
        raise InputError(_NO_EXTRA, hint="pip install posedesign[bags]", name="bag")


@cache
def _decoder() -> Any:
    """Decode bytes (CDR) of a message by its type."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr
