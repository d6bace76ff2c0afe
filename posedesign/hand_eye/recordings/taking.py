"""From a recording to an ordinary folder of pictures with a table: what ``camera`` begins with.

:mod:`.written_stills` has the files. The same command with this folder and this table in place of
the recording gives the same result.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Generator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from calib.errors import CalibError, FileFormatError, InputError
from calib.hand_eye.pictures import NEAR_S, rows_near
from calib.lens import Lens
from calib.robots import Robot
from calib.se3 import FloatArray
from calib.vision.camera.rendering import GreyImage
from posedesign.files import LEAST_POSITIVE, Results
from posedesign.files.csv_tables import Row
from posedesign.hand_eye.lens_files import ros_lens
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
    common_seconds,
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
from posedesign.hand_eye.recordings.timed_tables import TimedTable
from posedesign.hand_eye.recordings.videos import frames_of
from posedesign.hand_eye.recordings.written_stills import READ, Advance, StillsFolder, Taken

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

    def __post_init__(self) -> None:
        for name, value, least in (
            ("stand_s", self.stand_s, LEAST_POSITIVE),
            ("time_offset_s", self.time_offset_s, -math.inf),
        ):
            if not (math.isfinite(value) and value >= least):
                raise InputError(
                    f"`{name}` is {value:g}",
                    hint=f"give seconds{'' if least < 0 else ' above zero'}",
                    name=name,
                    value=value,
                )


@dataclass(eq=False)
class _Seen:
    """What the first pass over all pictures tells."""

    stillness: StillnessOfPictures = field(default_factory=StillnessOfPictures)
    numbers: list[int] = field(default_factory=list)  # of those that could be decoded
    faults: list[CalibError] = field(default_factory=list)  # of those that could not

    def add(self, number: int, picture: GreyImage) -> None:
        """Take in a picture and its number in the recording."""
        self.stillness.add(picture)
        self.numbers.append(number)


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
    folder = StillsFolder(results, images.name, of_poses=arm.joints is None)
    seen, times, decoder = _Seen(), list[tuple[int, int]](), PictureDecoder()
    for number, stamps, picture in _pictures_of_bag(bag, images, decoder, seen.faults):
        seen.add(number, picture)
        times.append(stamps)
        advance(f"picture {number + 1}", READ * (number + 1) / images.count)
    if not times:
        first = seen.faults[0]
        raise FileFormatError(first.message, path=bag.path, key=images.name, hint=first.hint)
    if lens is not None and (lens.width_px, lens.height_px) != decoder.size_px:
        raise InputError(
            f"{bag.path}: the lens is of pictures of {lens.width_px} by {lens.height_px} pixels, "
            f"and {images.name} has other ones",
            hint="are they made smaller, or cut? have the lens estimated",
            name="lens",
        )
    seconds, arm_seconds, why = common_seconds(Times.of(times), arm.times)
    arm, arm_seconds = arm.each_time_once(arm_seconds)
    seconds = seconds + recording.time_offset_s
    notes = [*arm.notes, *([f"{images.name}, {arm.source}: {why}"] if why else [])]
    if recording.moving:
        stands = _of_moving_arm(seconds, seen.stillness, arm_seconds)
    else:
        stands = stills_with_arm(seconds, seen.stillness, arm, arm_seconds, recording.stand_s)
        clocks = check_clocks(seconds, seen.stillness, arm, arm_seconds, stands)
        notes += [clocks] if clocks else []
    stills = _stills(stands, recording, len(seconds))
    wanted = {seen.numbers[one.picture] for one in stills}
    frames = (picture for _, _, picture in _pictures_of_bag(bag, images, decoder, [], wanted))
    names = folder.pictures(frames, len(stills), advance)
    at = seconds[[one.picture for one in stills]]
    if recording.moving:
        table = folder.record(names, at, arm, arm_seconds, robot)
    else:
        rows = [nearest(arm_seconds, time) for time in at.tolist()]
        table = folder.arm_table(names, at, arm, rows, robot)
    return folder.done(stands, seconds, seen.faults, table, lens, notes)


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
    listed = TimedTable.read(table) if table is not None else None
    folder = StillsFolder(results, recording.path.name)
    seen, times = _Seen(), list[float]()
    for frame in frames_of(recording.path):
        seen.add(frame.number, frame.picture)
        times.append(frame.time_s + recording.time_offset_s)
        advance(f"picture {frame.number + 1}", frame.part * READ)
    seconds = np.array(times)
    stands = stills_of_pictures(seconds, seen.stillness, recording.stand_s)
    rows: list[Row] = []
    if listed is not None:
        stands, rows = listed.of_stands(stands, seconds, np.array(seen.numbers))
    stills = _stills(stands, recording, len(seconds))
    wanted = {seen.numbers[one.picture] for one in stills}
    frames = (frame.picture for frame in frames_of(recording.path, wanted))
    names = folder.pictures(frames, len(stills), advance)
    own = table if listed is None else folder.rows_of(listed.table, names, rows)
    return folder.done(stands, seconds, [], own, None, [])


def _stills(stands: Sequence[StandStill], recording: Recording, count: int) -> list[StandStill]:
    stills = [one for one in stands if one.picture >= 0]
    if not stills:
        raise InputError(
            f"{recording.path}: no still can be taken of {count} pictures: {why_not(stands)}",
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
) -> Generator[tuple[int, tuple[int, int], GreyImage], None, None]:
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


def _lens_of(bag: Bag, images: Topic) -> Lens:
    """The lens of the camera_info beside a topic of pictures."""
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
    return ros_lens(bag.path, found)


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
    part = np.minimum(np.floor((seconds - begin) / every), MOST_MOVING - 1).astype(int)
    sharpness = np.where(near, seen.sharpness, -1.0)
    found = []
    for k in np.unique(part[near]).tolist():
        of = np.flatnonzero((part == k) & near)
        best = int(of[np.argmax(sharpness[of])])
        found.append(StandStill(float(seconds[of[0]]), float(seconds[of[-1]]), best))
    return found
