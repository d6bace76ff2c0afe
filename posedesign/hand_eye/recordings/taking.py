"""From a recording to an ordinary folder of pictures with a table: what ``camera`` begins with.

=======================  ===========================================================================
``pictures/P001.png ..``  the stills, in grey
``joints.csv``            joints of each (``<joint>_rad``), or the rows of the table that was given
``poses.csv``             poses of the flange in place of them
``stills.csv``            the stand-stills: from when to when, and the still or why there is none
``lens_of_bag.yaml``      the lens of ``camera_info``, where it is asked for
=======================  ===========================================================================

The same command with this folder and this table in place of the recording gives the same result.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Collection, Generator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from calib.errors import CalibError, FileFormatError, InputError, OutputError
from calib.hand_eye.pictures import NEAR_S, rows_near
from calib.robots import Robot
from calib.se3 import FloatArray, quaternion_from_rotation
from posedesign.files import Results, folder_inside, write_bytes_atomic, write_text_atomic
from posedesign.files.csv_tables import (
    AsItIs,
    Row,
    Table,
    a_few,
    as_read,
    number_of,
    numbers_of,
    read_table,
    write_table,
)
from posedesign.files.origin import origin_of
from posedesign.files.pictures import ENDINGS
from posedesign.files.postures import RADIAN_DECIMALS, JointForm, cells_of, columns_of
from posedesign.hand_eye.lens_files import camera_info, ros_lens
from posedesign.hand_eye.recordings.arm_streams import (
    WINDOW_S,
    ArmStream,
    read_frames,
    read_joints,
    read_poses,
)
from posedesign.hand_eye.recordings.bags import (
    FRAMES,
    IMAGES,
    JOINTS,
    LENSES,
    POSES,
    Bag,
    Times,
    Topic,
    have_one_clock,
)
from posedesign.hand_eye.recordings.images import PictureDecoder
from posedesign.hand_eye.recordings.stillness import StillnessOfPictures
from posedesign.hand_eye.recordings.stills import (
    StandStill,
    check_clocks,
    nearest,
    stills_of_pictures,
    stills_with_arm,
    why_not,
)
from posedesign.hand_eye.recordings.videos import Frame, frames_of

Advance = Callable[[str, float], None]

PICTURES = "pictures"
"""Folder of the stills."""

_STILL = "still of a recording"
_JOINTS_TABLE = ("joints.csv", "joints of pictures")
_POSES_TABLE = ("poses.csv", "poses of pictures")
_STILLS_TABLE = ("stills.csv", "stand-stills of a recording")
_LENS_FILE = ("lens_of_bag.yaml", "lens of a bag")

_MEASURING = 0.9
"""Part of the work that the first pass over all pictures is."""

_SLACK_S = 0.25
"""A row of a table belongs to a stand-still that it is no further away from in time."""

_AGREE = 0.01
"""Cells of rows of one stand-still differ by less than this part of their range in the table."""

MOST_MOVING = 60
"""Pictures that are taken of an arm that moves."""

_MOVING_EVERY_S = 0.5
"""Time between them at least."""


@dataclass(frozen=True)
class Recording:
    """A bag or a video, and what of it is to be taken."""

    path: Path
    image_topic: str = ""
    joint_topic: str = ""
    pose_topic: str = ""
    tf: str = ""  # names of the base frame and the flange frame, with a comma between them
    lens_of_bag: bool = False
    stand_s: float = WINDOW_S  # shortest stand-still that a picture is taken of
    time_offset_s: float = 0.0  # added to the times of the pictures
    moving: bool = False  # whether pictures of a moving arm are taken, with a record of its joints


@dataclass(frozen=True)
class Taken:
    """The folder that the stills of a recording were written into."""

    pictures: Path
    table: Path | None  # None where nothing is known of the arm
    lens: Path | None
    said: str  # how many stills were taken, and why no others, in a line
    notes: tuple[str, ...] = ()


@dataclass(eq=False)
class _Seen:
    """What the first pass over all pictures tells."""

    stillness: StillnessOfPictures = field(default_factory=StillnessOfPictures)
    numbers: list[int] = field(default_factory=list)  # of those that could be decoded
    faults: list[CalibError] = field(default_factory=list)  # of those that could not


def take_from_bag(
    recording: Recording,
    robot: Robot | None,
    results: Results,
    advance: Advance = lambda what, part: None,
) -> Taken:
    """Write the stills of a bag, and the joints or poses of the arm at each.

    ``robot``: the arm of the cell; None where there is no cell. Raises FileFormatError: the bag
    cannot be read. InputError: a topic is not there, or which is meant cannot be told; the arm
    never stands; clocks differ.
    """
    bag = Bag.open(recording.path)
    images = (
        bag.named(recording.image_topic, IMAGES, "pictures")
        if recording.image_topic
        else bag.only(IMAGES, "pictures", "image_topic")
    )
    lens = _lens_of(bag, images) if recording.lens_of_bag else None
    arm = _arm_of(bag, recording, robot)
    seen, times, decoder = _Seen(), list[tuple[int, int]](), PictureDecoder()
    for number, stamps, picture in _pictures_of_bag(bag, images, decoder, seen.faults):
        seen.stillness.add(picture)
        seen.numbers.append(number)
        times.append(stamps)
        advance(f"picture {number + 1}", _MEASURING * (number + 1) / images.count)
    if not times:
        first = seen.faults[0]
        raise FileFormatError(first.message, path=bag.path, key=images.name, hint=first.hint)
    taken_at = Times.of(times)
    stamped, why = have_one_clock(taken_at, arm.times)
    arm, arm_seconds = arm.each_time_once(arm.times.seconds(bag.start_ns, stamped=stamped))
    seconds = taken_at.seconds(bag.start_ns, stamped=stamped) + recording.time_offset_s
    notes = [*arm.notes, *([f"{images.name}, {arm.source}: {why}"] if why else [])]
    writer = _Writer(results, images.name)
    if recording.moving:
        stands = _of_moving_arm(seconds, seen.stillness, arm_seconds)
    else:
        stands = stills_with_arm(seconds, seen.stillness, arm, arm_seconds, recording.stand_s)
        clocks = check_clocks(seconds, seen.stillness, arm, arm_seconds, stands)
        notes += [clocks] if clocks else []
    stills = _stills(stands, recording, writer.source, len(seconds))
    numbers = {seen.numbers[one.picture]: one.picture for one in stills}
    frames = (
        Frame(numbers[number], float(seconds[numbers[number]]), picture)
        for number, _, picture in _pictures_of_bag(bag, images, decoder, [], numbers)
    )
    names = writer.pictures(frames, len(stills), advance)
    rows = [nearest(arm_seconds, float(seconds[one.picture])) for one in stills]
    if recording.moving:
        table = writer.record(
            names, seconds[[one.picture for one in stills]], arm, arm_seconds, robot
        )
    else:
        table = writer.arm_table(names, seconds[[one.picture for one in stills]], arm, rows, robot)
    return writer.done(stands, seconds, seen.faults, table, lens, notes)


def take_from_video(
    recording: Recording,
    table: Path | None,
    results: Results,
    advance: Advance = lambda what, part: None,
) -> Taken:
    """Write the stills of a video, and the rows of a table that belong to them.

    ``table``: with a column ``time_s`` [s] from the start of the video, or ``frame``, the number of
    a picture from 0; else it is left as it is, its rows are those of the stills in their order.
    Raises FileFormatError: video or table cannot be read. InputError: the picture never stands, or
    no row of the table is of a stand-still.
    """
    listed = _Timed.read(table) if table is not None else None
    seen, seconds = _Seen(), list[float]()
    for frame in frames_of(recording.path):
        seen.stillness.add(frame.picture)
        seen.numbers.append(frame.number)
        seconds.append(frame.time_s + recording.time_offset_s)
        advance(f"picture {frame.number + 1}", 0.5 * _MEASURING)
    at = np.array(seconds)
    writer = _Writer(results, recording.path.name)
    stands = stills_of_pictures(at, seen.stillness, recording.stand_s)
    rows: list[Row] = []
    if listed is not None:
        stands, rows = listed.of_stands(stands, at, np.array(seen.numbers))
    stills = _stills(stands, recording, writer.source, len(at))
    numbers = {seen.numbers[one.picture]: one.picture for one in stills}
    frames = (
        Frame(numbers[frame.number], frame.time_s, frame.picture)
        for frame in frames_of(recording.path, numbers)
    )
    names = writer.pictures(frames, len(stills), advance)
    own = table if listed is None else writer.rows_of(listed.table, names, rows)
    return writer.done(stands, at, [], own, None, [])


def _stills(
    stands: Sequence[StandStill], recording: Recording, source: str, count: int
) -> list[StandStill]:
    stills = [one for one in stands if one.picture >= 0]
    if not stills:
        raise InputError(
            f"{recording.path}: no still can be taken of {count} pictures of {source}: "
            f"{why_not(stands)}",
            hint="let the arm stand for a second at each pose, with the camera on",
            name="recording",
        )
    return stills


def _arm_of(bag: Bag, recording: Recording, robot: Robot | None) -> ArmStream:
    """The arm by the topic or the frames that are named; else by the one topic of joints."""
    if recording.tf:
        frames = [name.strip().lstrip("/") for name in recording.tf.split(",")]
        if len(frames) != 2 or not all(frames):
            raise InputError(
                f"`tf` {recording.tf!r} is not two names of frames",
                hint="name the base frame and the flange frame: base_link,tool0",
                name="tf",
            )
        return read_frames(bag, *frames)
    if recording.pose_topic:
        return read_poses(bag, bag.named(recording.pose_topic, POSES, "poses"))
    if recording.joint_topic:
        topic = bag.named(recording.joint_topic, JOINTS, "joint values")
    else:
        alone = not bag.of_types(JOINTS) or robot is None
        if alone and len(bag.of_types(POSES)) == 1:
            return read_poses(bag, bag.of_types(POSES)[0])
        if alone and bag.of_types(FRAMES) and not bag.of_types(POSES):
            raise InputError(
                f"{bag.path} has transforms (tf), and no "
                + ("joints or poses" if robot is not None else "poses, and there is no cell"),
                hint="name the base frame and the flange frame: `tf` base_link,tool0, say",
                name="tf",
            )
        if robot is None:
            return read_poses(bag, bag.only(POSES, "poses", "pose_topic"))
        topic = bag.only(JOINTS, "joint values", "joint_topic")
    if robot is None:
        raise InputError(
            f"{topic.name} has joint values, and the robot is not known",
            hint="give the cell, or poses of the flange: `pose_topic`, `tf`",
            name="joint_topic",
        )
    return read_joints(bag, topic, robot)


def _pictures_of_bag(
    bag: Bag,
    topic: Topic,
    decoder: PictureDecoder,
    faults: list[CalibError],
    wanted: Collection[int] | None = None,
) -> Generator[tuple[int, tuple[int, int], Any], None, None]:
    """Pictures by number, with stamp and time of recording [ns]; faults of those that are not."""
    for number, message in enumerate(bag.messages(topic)):
        if wanted is not None and number not in wanted:
            continue
        try:
            picture = decoder.decode(message.content)
        except CalibError as error:
            said = f"picture {number + 1} of {topic.name} {error.message}"
            faults.append(InputError(said, hint=error.hint))
            continue
        yield number, (message.stamp_ns, message.recorded_ns), picture


def _lens_of(bag: Bag, images: Topic) -> str:
    """The lens of the camera_info beside a topic of pictures, as ``camera_info.yaml``."""
    places = images.name.split("/")
    beside = ["/".join([*places[:k], "camera_info"]) for k in (-1, -2)]
    topic = next((one for one in bag.of_types(LENSES) if one.name in beside), None)
    if topic is None:
        topic = bag.only(LENSES, "lens (camera_info)", "lens")
    messages = bag.messages(topic)
    content = next(messages).content
    messages.close()
    rectified = any(place.startswith("image_rect") for place in places)
    terms = np.zeros(5) if rectified else np.asarray(content.d)
    K = np.asarray(content.p).reshape(3, 4)[:, :3] if rectified else np.asarray(content.k)
    found = {
        "camera_matrix": K.ravel().tolist(),
        "distortion_model": "plumb_bob" if rectified else str(content.distortion_model)[:40],
        "distortion_coefficients": terms.tolist(),
        "image_width": int(content.width),
        "image_height": int(content.height),
    }
    return camera_info(ros_lens(bag.path, found))


def _of_moving_arm(
    seconds: FloatArray, seen: StillnessOfPictures, arm_seconds: FloatArray
) -> list[StandStill]:
    """Pictures of a moving arm: of each stretch of time the sharpest, where joints are about it."""
    near = np.array([len(rows_near(arm_seconds, at)) > 0 for at in seconds.tolist()])
    if not near.any():
        raise InputError(
            f"no picture has the arm within {NEAR_S:g} s before and after it, four times or more",
            hint="record the arm ten times a second or more",
            name="moving",
        )
    begin, end = seconds[near].min(), seconds[near].max()
    every = max(_MOVING_EVERY_S, (end - begin) / MOST_MOVING)
    part = np.floor((seconds - begin) / every).astype(int)
    sharpness = np.where(near, seen.sharpness, -1.0)
    found = []
    for k in np.unique(part[near]).tolist():
        of = np.flatnonzero((part == k) & near)
        best = int(of[np.argmax(sharpness[of])])
        found.append(StandStill(float(seconds[of[0]]), float(seconds[of[-1]]), best))
    return found


@dataclass(frozen=True, eq=False)
class _Timed:
    """A table whose rows are of times or pictures of a video."""

    path: Path
    table: Table
    column: str  # time_s or frame
    values: FloatArray  # (R,): of the column
    numbers: FloatArray  # (R, c): cells of the columns that have nothing but numbers

    @classmethod
    def read(cls, path: Path) -> _Timed | None:
        """Read it; None where it has neither column, or names pictures."""
        if not path.is_file() or path.suffix.casefold() not in (".csv", ".txt", ".tsv", ".dat"):
            return None
        try:
            table = read_table(path, loose=True)
        except FileFormatError:
            return None  # who reads poses says better what is wrong
        column = next((name for name in ("time_s", "frame") if name in table.columns), None)
        if column is None or "picture" in table.columns:
            return None
        values = numbers_of(path, table.rows, [column])[:, 0]
        cells = np.array(
            [[number_of(row.cells[name]) for name in table.columns] for row in table.rows]
        )
        others = np.array(table.columns) != column
        return cls(path, table, column, values, cells[:, others & np.isfinite(cells).all(axis=0)])

    def of_stands(
        self, stands: Sequence[StandStill], seconds: FloatArray, numbers: FloatArray
    ) -> tuple[list[StandStill], list[Row]]:
        """Return the stand-stills that have a row, or why they have none; and these rows."""
        by_time = self.column == "time_s"
        span = np.ptp(self.numbers, axis=0)
        kept: list[StandStill] = []
        rows: list[Row] = []
        for one in stands:
            if one.picture < 0:
                kept.append(one)
                continue
            inside = (seconds >= one.begin_s) & (seconds <= one.end_s)
            about = seconds[inside] if by_time else numbers[inside]
            slack = _SLACK_S if by_time else 0.0
            own = np.flatnonzero(
                (self.values >= about.min() - slack) & (self.values <= about.max() + slack)
            )
            within = own[(self.values[own] >= about.min()) & (self.values[own] <= about.max())]
            own = within if len(within) else own
            at = seconds[one.picture] if by_time else numbers[one.picture]
            if not len(own):
                kept.append(StandStill(one.begin_s, one.end_s, -1, "no row of the table is of it"))
            elif (np.ptp(self.numbers[own], axis=0) > _AGREE * span).any():
                kept.append(
                    StandStill(one.begin_s, one.end_s, -1, "the arm moves by the table meanwhile")
                )
            else:
                kept.append(one)
                rows.append(self.table.rows[int(own[nearest(self.values[own], float(at))])])
        return kept, rows


@dataclass(eq=False)
class _Writer:
    """Writes the stills and their tables into the output folder, and nothing beside it."""

    results: Results
    source: str  # topic or file of the pictures, in words

    def __post_init__(self) -> None:
        own = self.results
        # they are of the recording alone: another cell takes the same ones
        self._own = Results(own.folder, own.command, (), own.overwrite, own.say)
        self.folder = own.folder / PICTURES
        self._pictures = Results(self.folder, own.command, (), own.overwrite, own.say)
        others = [path.name for path in self._there() if not self._is_still(path)]
        if others:
            raise OutputError(
                f"{self.folder} holds other pictures: {a_few(others)}",
                hint="name another output folder: `out`",
                name=str(self.folder),
            )

    def _there(self) -> list[Path]:
        if not self.folder.is_dir():
            return []
        return sorted(p for p in self.folder.iterdir() if p.suffix.casefold() in ENDINGS)

    @staticmethod
    def _is_still(path: Path) -> bool:
        origin = origin_of(path)
        return origin is not None and origin.purpose == _STILL

    def pictures(
        self, frames: Generator[Frame, None, None], count: int, advance: Advance
    ) -> list[str]:
        """Write the pictures of the stills in their order; return their names."""
        names = [f"P{k + 1:03d}.png" for k in range(count)]
        folder_inside(self.folder)
        claims = self._pictures.claim("measured", *((name, _STILL) for name in names))
        for k, (claim, frame) in enumerate(zip(claims, frames, strict=True)):
            advance(claim.path.name, _MEASURING + (1.0 - _MEASURING) * k / count)
            data = io.BytesIO()
            Image.fromarray(frame.picture).save(data, "PNG")
            write_bytes_atomic(claim, data.getvalue())
        old = [path.name for path in self._there() if path.name not in names]
        self._pictures.remove(*((name, _STILL) for name in old))
        return names

    def arm_table(
        self,
        names: Sequence[str],
        seconds: FloatArray,
        arm: ArmStream,
        rows: Sequence[int],
        robot: Robot | None,
    ) -> Path:
        """Write joints or poses of the stills."""
        columns, cells = _cells_of(arm, robot)
        listed = [
            {
                "picture": name,
                "taken_s": round(at, 6),
                **dict(zip(columns, cells(row), strict=True)),
            }
            for name, at, row in zip(names, seconds.tolist(), rows, strict=True)
        ]
        return self._table(arm, ["picture", *columns, "taken_s"], listed)

    def record(
        self,
        names: Sequence[str],
        seconds: FloatArray,
        arm: ArmStream,
        arm_seconds: FloatArray,
        robot: Robot | None,
    ) -> Path:
        """Write the pictures with their times, and the record of the arm about them."""
        columns, cells = _cells_of(arm, robot)
        near = np.zeros(len(arm_seconds), dtype=bool)
        for at in seconds.tolist():
            near |= np.abs(arm_seconds - at) <= NEAR_S
        listed: list[dict[str, object]] = [
            {"picture": name, "time_s": round(at, 6)}
            for name, at in zip(names, seconds.tolist(), strict=True)
        ]
        listed += [
            {
                "time_s": round(float(arm_seconds[row]), 6),
                **dict(zip(columns, cells(row), strict=True)),
            }
            for row in np.flatnonzero(near).tolist()
        ]
        return self._table(arm, ["picture", "time_s", *columns], listed)

    def _table(
        self, arm: ArmStream, columns: Sequence[str], rows: Sequence[dict[str, object]]
    ) -> Path:
        both = (_JOINTS_TABLE, _POSES_TABLE)
        own, other = both if arm.joints is not None else both[::-1]
        (claim,) = self._own.claim("measured", own)
        self._own.remove(other)
        return write_table(claim, columns, rows)

    def rows_of(self, table: Table, names: Sequence[str], rows: Sequence[Row]) -> Path:
        """Write rows of a table with their pictures, in the words of the table."""
        dropped = ("time_s", "frame")
        columns = [name for name in table.columns if name not in dropped]
        (claim,) = self._own.claim("measured", _JOINTS_TABLE)
        self._own.remove(_POSES_TABLE)
        listed = [
            {"picture": name, **{column: as_read(row.cells[column]) for column in columns}}
            for name, row in zip(names, rows, strict=True)
        ]
        return write_table(claim, ["picture", *columns], listed)

    def done(
        self,
        stands: Sequence[StandStill],
        seconds: FloatArray,
        faults: Sequence[CalibError],
        table: Path | None,
        lens: str | None,
        notes: Sequence[str],
    ) -> Taken:
        """Write the list of stand-stills and the lens; return all with what is to be said."""
        (claim,) = self._own.claim("computed", _STILLS_TABLE)
        stills = 0
        listed: list[dict[str, object]] = []
        for one in stands:
            stills += one.picture >= 0
            shown = {"picture": f"P{stills:03d}.png", "taken_s": round(seconds[one.picture], 6)}
            listed.append(
                {
                    "begin_s": round(one.begin_s, 3),
                    "end_s": round(one.end_s, 3),
                    **(shown if one.picture >= 0 else {}),
                    "reason": one.reason,
                }
            )
        write_table(claim, ["begin_s", "end_s", "picture", "taken_s", "reason"], listed)
        why = why_not(stands)
        said = (
            f"{stills} stills of {len(seconds)} pictures of {self.source} are in {self.folder}"
            + (f"; of {len(stands) - stills} more stand-stills none: {why}" if why else "")
        )
        if faults:
            notes = [*notes, f"{len(faults)} pictures are passed over: {faults[0].message}"]
        file = None
        if lens is not None:
            (own,) = self._own.claim("measured", _LENS_FILE)
            file = write_text_atomic(own, lens)
        else:
            self._own.remove(_LENS_FILE)
        return Taken(self.folder, table, file, said, tuple(notes))


def _cells_of(
    arm: ArmStream, robot: Robot | None
) -> tuple[list[str], Callable[[int], list[object]]]:
    """Columns of joints or poses of an arm, and the cells of a row."""
    joints, poses = arm.joints, arm.T_base_flange
    if joints is not None and robot is not None:
        held = {joint.name: joint for joint in robot.held if joint.name in arm.held}
        names = [f"{name}_{'m' if joint.slides else 'rad'}" for name, joint in held.items()]

        def joint_cells(row: int) -> list[object]:
            more = [AsItIs(f"{arm.held[name][row]:.{RADIAN_DECIMALS}f}") for name in held]
            return [*cells_of(JointForm.ROS, robot, joints[row]), *more]

        return [*columns_of(JointForm.ROS, robot), *names], joint_cells
    if poses is None:
        raise InputError("an arm has neither joints nor poses", name="arm")

    def pose_cells(row: int) -> list[object]:
        T = poses[row]
        return [*(1e3 * T[:3, 3]).tolist(), *quaternion_from_rotation(T[:3, :3]).tolist()]

    return ["x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"], pose_cells
