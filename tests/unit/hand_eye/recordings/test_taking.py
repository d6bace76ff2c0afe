"""Stills of bags and videos: when the arm stands, by its joints, its poses or the picture alone."""

from __future__ import annotations

import csv
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from calib.errors import CalibError, FileFormatError, InputError, OutputError
from calib.lens import Lens
from calib.robots import Robot
from calib.se3 import inverse
from posedesign.files import Results
from posedesign.hand_eye.lens_files import read_lens
from posedesign.hand_eye.pictures import read_grey, read_picture_set
from posedesign.hand_eye.recordings import Recording, Taken, take_from_bag, take_from_video
from tests import recordings as r

pytest.importorskip("rosbags", reason="bags are written and read by rosbags, the extra bags")

ROBOT = Robot.preset("ur5e")
NAMES = ROBOT.joint_names
rng = np.random.default_rng(3)
STOPS = np.array([0.1, -1.5, 1.5, -1.5, -1.5, 0.3]) + rng.uniform(-0.25, 0.25, (6, 6))
STOPS[:, 1] += 1.5  # the second joint moves the scene, too
SCENE = r.Scene(STOPS)
MIDDLES = 1.6 * np.arange(6) + 0.5


def take(tmp_path: Path, messages: list, robot: Robot | None = ROBOT, **asked: Any) -> Taken:
    bag = tmp_path / "bag"
    if not bag.exists():
        r.write_bag(bag, "mcap", messages)
    return take_from_bag(Recording(bag, **asked), robot, Results(tmp_path / "out", "camera"))


def rows_of(path: Path) -> list[dict[str, str]]:
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def refusal(tmp_path: Path, messages: list, *given: Any, **asked: Any) -> CalibError:
    with pytest.raises(CalibError) as caught:
        take(tmp_path, messages, *given, **asked)
    assert "\n" not in str(caught.value)
    assert caught.value.hint
    return caught.value


def test_a_still_of_each_stop_with_joints_by_name(tmp_path):
    # a gripper has messages of its own on the topic, and the joints stand in another order
    gripper = [
        ("/joint_states", r.JOINTS, t, r.joint_state(t, ["finger"], [0.0]))
        for t in np.arange(0.0, 9.0, 0.3)
    ]
    order = [3, 0, 5, 1, 2, 4]
    run = SCENE.run()
    arm = np.arange(0.0, run.length_s, 0.02)
    joints = [
        ("/joint_states", r.JOINTS, t, r.joint_state(t, [NAMES[k] for k in order], q[order]))
        for t, q in zip(arm, run.joints_at(arm), strict=True)
    ]
    pictures = [one for one in SCENE.messages(NAMES) if one[1] == r.IMAGE]
    taken = take(tmp_path, [*pictures, *joints, *gripper])
    assert taken.said.startswith("6 stills of 90 pictures of /camera/image_raw are in ")
    assert taken.notes == ()
    found = read_picture_set(taken.pictures, taken.table, ROBOT)
    np.testing.assert_allclose(found.postures, STOPS, atol=1e-9)
    seconds = [float(row["taken_s"]) for row in rows_of(taken.table)]
    assert np.abs(seconds - MIDDLES).max() < 0.45
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "pictures",
        "joints.csv",
        "stills.csv",
    }
    drawn = next(SCENE.pictures(np.array([2.1])))
    apart = read_grey(taken.pictures / "P002.png").astype(float) - drawn
    assert np.abs(apart).mean() < 3.0  # noise of both


def test_why_there_is_no_still_of_a_stand_still(tmp_path):
    scene = replace(SCENE, stand_s=1.6)
    run = scene.run()
    # no pictures at the second stop, the camera swings at the third, the arm jerks at the fourth
    swing = iter(SCENE.pictures(0.3 * np.sin(np.arange(200.0)) ** 2 + 1.2))
    rows = []
    for topic, kind, t, content in scene.messages(NAMES):
        if kind == r.IMAGE and 2.0 < t < 4.0:
            continue
        if kind == r.IMAGE and 4.4 < t < 6.05:
            content = r.image(t - 0.02, next(swing))
        if kind == r.JOINTS and 7.3 < t < 7.5:
            q = run.joints_at(np.array([t]))[0]
            content = r.joint_state(t, NAMES, q + 0.02 * np.sin((t - 7.3) / 0.2 * np.pi))
        rows.append((topic, kind, t, content))
    taken = take(tmp_path, rows)
    assert taken.said.startswith("4 stills of ")
    assert "1 no picture was taken meanwhile" in taken.said
    assert "1 the picture moves while the arm stands" in taken.said
    assert "1 the arm did not go on since the still before" in taken.said
    listed = rows_of(tmp_path / "out" / "stills.csv")
    assert len(listed) == 7
    assert [row["picture"] for row in listed if row["picture"]] == [
        f"P00{k}.png" for k in range(1, 5)
    ]
    assert all(bool(row["reason"]) != bool(row["picture"]) for row in listed)


def test_one_picture_a_stop_is_taken_as_it_is(tmp_path):
    rows = [one for one in SCENE.messages(NAMES) if one[1] == r.JOINTS]
    triggered = zip(MIDDLES, SCENE.pictures(MIDDLES), strict=True)
    rows += [("/cam", r.IMAGE, t, r.image(t, picture)) for t, picture in triggered]
    found = take(tmp_path, rows)
    assert found.said.startswith("6 stills of 6 pictures of /cam")
    postures = read_picture_set(found.pictures, found.table, ROBOT).postures
    np.testing.assert_allclose(postures, STOPS, atol=1e-9)


def test_an_arm_that_never_stands_is_said(tmp_path):
    scene = replace(SCENE, stand_s=0.0)
    said = refusal(tmp_path, scene.messages(NAMES))
    assert "/joint_states: the arm never stands still for 0.3 s" in said.message
    assert "`moving`" in said.hint
    assert not (tmp_path / "out").exists()


def test_a_moving_arm_has_a_record_about_each_picture(tmp_path):
    scene = replace(SCENE, stand_s=0.0, move_s=1.5)
    taken = take(tmp_path, scene.messages(NAMES), moving=True)
    found = read_picture_set(taken.pictures, taken.table, ROBOT)
    assert 12 <= len(found.paths) <= 20
    assert found.motion is not None
    assert np.abs(found.motion[:, 0]).max() > 0.1
    at = [float(row["time_s"]) for row in rows_of(taken.table) if row["picture"]]
    np.testing.assert_allclose(found.postures, scene.run().joints_at(np.array(at)), atol=2e-3)


def test_clocks_that_differ_by_less_than_a_stop_are_said(tmp_path):
    taken = take(tmp_path, SCENE.messages(NAMES, late_s=0.35))
    assert len(rows_of(taken.table)) == 6
    (note,) = taken.notes
    assert "later than /joint_states: stills are from when both stand" in note
    assert abs(float(note.split(" s later")[0].split()[-1]) - 0.35) < 0.15


def test_clocks_that_differ_by_more_are_refused_until_they_are_shifted(tmp_path):
    stops = STOPS[[0, 0, 1, 2, 2, 2, 3, 4, 4, 5]]  # it stands for longer at some
    messages = replace(SCENE, stops=stops, stand_s=0.6).messages(NAMES, late_s=1.6)
    said = refusal(tmp_path, messages)
    assert "pictures move and stand 1.60 s later than /joint_states" in said.message
    assert said.hint == "if that is so, shift them: `time_offset_s` -1.60"
    taken = take(tmp_path, messages, time_offset_s=-1.6)
    postures = read_picture_set(taken.pictures, taken.table, ROBOT).postures
    np.testing.assert_allclose(postures, STOPS, atol=1e-9)


def test_all_offsets_that_stops_in_step_fit_are_said(tmp_path):
    stops = np.vstack([STOPS, STOPS])
    messages = replace(SCENE, stops=stops).messages(NAMES, late_s=0.8)
    assert "so evenly that it may be" in refusal(tmp_path, messages).hint


def test_stamps_of_a_simulator_count_from_its_start(tmp_path):
    rows = SCENE.messages(NAMES)
    for _, _, _, content in rows:
        content.header.stamp.sec -= r.START_NS // 10**9 - 50
    taken = take(tmp_path, rows)
    assert taken.notes == ()
    at = [float(row["taken_s"]) for row in rows_of(taken.table)]
    assert np.abs(np.array(at) - MIDDLES).max() < 0.5


def test_stamps_of_a_camera_that_counts_from_its_start_are_not_taken(tmp_path):
    rows = []
    for topic, kind, t, content in SCENE.messages(NAMES):
        if kind == r.IMAGE:
            content.header.stamp.sec -= r.START_NS // 10**9
        rows.append((topic, kind, t, content))
    taken = take(tmp_path, rows)
    assert len(rows_of(taken.table)) == 6
    assert "two clocks" in taken.notes[0]


def poses_and_frames() -> tuple[list, np.ndarray]:
    run = SCENE.run()
    arm = np.arange(0.0, run.length_s, 0.02)
    T = ROBOT.fk(run.joints_at(arm))
    stand = np.eye(4)
    stand[:3, 3] = 0.1, 0.2, 0.3
    rows = [one for one in SCENE.messages(NAMES) if one[1] == r.IMAGE]
    rows += [
        ("/tool", r.POSE, t + 0.001, r.pose_stamped(t, pose))
        for t, pose in zip(arm, T, strict=True)
    ]
    rows += [
        (
            "/tf",
            r.TF,
            t + 0.001,
            r.transforms(
                r.transform_stamped(t, stand @ pose, "stand", "wrist"),
                r.transform_stamped(t, np.eye(4), "wrist", "finger"),
            ),
        )
        for t, pose in zip(arm, T, strict=True)
    ]
    fixed = r.transforms(
        r.transform_stamped(0.0, inverse(stand), "base", "nothing"),
        r.transform_stamped(0.0, stand, "stand", "base"),
        r.transform_stamped(0.0, stand, "wrist", "flange"),
    )
    rows.append(("/tf_static", r.TF, 0.0, fixed))
    return rows, ROBOT.fk(STOPS)


def test_poses_of_a_topic_or_of_frames_in_place_of_joints(tmp_path):
    rows, flange = poses_and_frames()
    taken = take(tmp_path, rows, None)  # the only topic of poses
    assert taken.table == tmp_path / "out" / "poses.csv"
    found = read_picture_set(taken.pictures, taken.table)
    np.testing.assert_allclose(found.T_base_flange, flange, atol=1e-8)
    assert "taken for those of the flange in base" in taken.notes[0]
    taken = take(tmp_path, rows, None, tf="base,/flange")
    found = read_picture_set(taken.pictures, taken.table)
    stand = np.eye(4)
    stand[:3, 3] = 0.1, 0.2, 0.3
    np.testing.assert_allclose(found.T_base_flange, flange @ stand, atol=1e-8)


@pytest.mark.parametrize(
    ("tf", "message"),
    [
        ("base", "is not two names of frames"),
        ("bas,flange", "there is no frame bas"),
        ("base,base", "no transforms lead from base to base"),
    ],
)
def test_frames_that_are_not_there_are_named(tmp_path, tf, message):
    rows, _ = poses_and_frames()
    assert message in refusal(tmp_path, rows, None, tf=tf).message


def test_what_of_the_arm_is_meant_is_asked_for(tmp_path):
    rows, _ = poses_and_frames()
    only_tf = [one for one in rows if one[1] in (r.TF, r.IMAGE)]
    assert "base frame and the flange frame" in refusal(tmp_path, only_tf).hint
    joints = [one for one in SCENE.messages(NAMES) if one[1] == r.JOINTS]
    other = tmp_path / "other"
    other.mkdir()
    pictures = [one for one in rows if one[1] == r.IMAGE]
    said = refusal(other, [*pictures, *joints], None, joint_topic="/joint_states")
    assert "the robot is not known" in said.message
    third = tmp_path / "third"
    third.mkdir()
    wrong = [
        (topic, kind, t, r.joint_state(t, [f"x{name}" for name in NAMES], [0.0] * 6))
        for topic, kind, t, _ in joints
    ]
    said = refusal(third, [*pictures, *wrong])
    assert "has no message with the joint shoulder_pan_joint" in said.message
    assert "xshoulder_pan_joint" in str(said)


def test_values_that_are_no_numbers_are_refused(tmp_path):
    rows = SCENE.messages(NAMES)
    rows.append(("/joint_states", r.JOINTS, 2.0, r.joint_state(2.0, NAMES, [np.nan] * 6)))
    assert "no numbers" in refusal(tmp_path, rows).message


def test_the_lens_of_the_bag_is_that_beside_its_pictures(tmp_path):
    lens = Lens("rational", 160, 120, (150.0, 151.0, 80.5, 60.25, *np.linspace(0.1, 0.01, 8)))
    other = replace(lens, values=(99.0, *lens.values[1:]))
    rows = [
        *SCENE.messages(NAMES),
        ("/camera/camera_info", r.LENS, 0.1, r.lens_message(0.1, lens)),
        ("/other/camera_info", r.LENS, 0.1, r.lens_message(0.1, other)),
    ]
    taken = take(tmp_path, rows, lens_of_bag=True)
    np.testing.assert_allclose(read_lens(taken.lens).values, lens.values, rtol=1e-12)
    again = take(tmp_path, rows)
    assert again.lens is None
    assert not taken.lens.exists()


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("width", 320, "the lens is of pictures of 320 by 120 pixels"),
        ("k", np.zeros(9), "cannot be"),
        ("distortion_model", "", "a distortion_model that is not known"),
        ("d", np.full(12, 0.1), "has 12 terms of distortion"),
    ],
)
def test_a_lens_that_is_not_that_of_the_pictures_is_refused(tmp_path, field, value, message):
    lens = Lens("pinhole", 160, 120, (150.0, 151.0, 80.5, 60.25, 0.1, 0.0, 0.0, 0.0, 0.0))
    content = r.lens_message(0.1, lens)
    setattr(content, field, value)
    rows = [*SCENE.messages(NAMES), ("/camera/camera_info", r.LENS, 0.1, content)]
    assert message in refusal(tmp_path, rows, lens_of_bag=True).message
    assert not (tmp_path / "out").exists()


def test_pictures_that_cannot_be_decoded_are_passed_over_and_counted(tmp_path):
    rows = SCENE.messages(NAMES)
    damaged = [k for k, one in enumerate(rows) if one[1] == r.IMAGE][3:5]
    for k in damaged:
        rows[k][3].height = 10**6
    taken = take(tmp_path, rows)
    assert len(rows_of(taken.table)) == 6
    assert "2 pictures are passed over: picture 4 of /camera/image_raw claims" in taken.notes[-1]
    for _, kind, _, content in rows:
        if kind == r.IMAGE:
            content.encoding = "../../etc"
    other = tmp_path / "all"
    other.mkdir()
    assert "has the encoding '../../etc'" in refusal(other, rows).message


def test_a_second_run_replaces_its_own_stills_and_no_others(tmp_path):
    rows = SCENE.messages(NAMES)
    taken = take(tmp_path, rows)
    few = tmp_path / "few"
    few.mkdir()
    r.write_bag(few / "bag", "mcap", [one for one in rows if one[2] < 3.0])
    again = take_from_bag(Recording(few / "bag"), ROBOT, Results(tmp_path / "out", "camera"))
    assert sorted(path.name for path in again.pictures.iterdir()) == ["P001.png", "P002.png"]
    (taken.pictures / "mine.jpg").write_bytes(b"\xff")
    with pytest.raises(OutputError, match=r"holds other pictures: mine.jpg"):
        take(tmp_path, rows)
    assert (taken.pictures / "mine.jpg").read_bytes() == b"\xff"


def test_a_table_of_somebody_else_is_kept_and_said_before_the_work(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "joints.csv").write_text("j1_deg\n1\n")
    said = refusal(tmp_path, SCENE.messages(NAMES))
    assert "joints.csv does not say where it is from" in said.message
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["joints.csv"]


def test_stills_are_not_written_through_a_link(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "out").mkdir()
    os.symlink(tmp_path / "elsewhere", tmp_path / "out" / "pictures")
    assert "is a link" in refusal(tmp_path, SCENE.messages(NAMES)).message
    assert not list((tmp_path / "elsewhere").iterdir())


def video(path: Path, scene: r.Scene = SCENE) -> Path:
    fourcc = cv2.VideoWriter.fourcc(*("MJPG" if path.suffix == ".avi" else "mp4v"))
    writer = cv2.VideoWriter(str(path), fourcc, scene.rate_hz, (160, 120))
    for picture in scene.pictures():
        writer.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


def table(path: Path, column: str, values: np.ndarray, joints: np.ndarray = STOPS) -> Path:
    head = [*([column] if column else []), *(f"j{k}_deg" for k in range(1, 7))]
    rows = np.degrees(joints) if not column else np.column_stack([values, np.degrees(joints)])
    path.write_text("\n".join([",".join(head), *(",".join(map(repr, v)) for v in rows.tolist())]))
    return path


def take_video(tmp_path: Path, listed: Path | None, name: str = "run.avi", **asked: Any) -> Taken:
    file = tmp_path / name
    if not file.exists():
        video(file)
    return take_from_video(Recording(file, **asked), listed, Results(tmp_path / "out", "camera"))


@pytest.mark.parametrize("name", ["run.avi", "run.mp4"])
@pytest.mark.parametrize("column", ["time_s", "frame", ""])
def test_stills_of_a_video_with_a_table(tmp_path, name, column):
    values = {"time_s": MIDDLES, "frame": np.round(10 * MIDDLES), "": MIDDLES}[column]
    taken = take_video(tmp_path, table(tmp_path / "t.csv", column, values), name)
    assert taken.said.startswith(f"6 stills of 90 pictures of {name} are in ")
    found = read_picture_set(taken.pictures, taken.table, ROBOT)
    np.testing.assert_allclose(found.postures, STOPS, atol=1e-9)


def test_a_record_of_joints_of_a_video_says_where_the_arm_moved(tmp_path):
    run = SCENE.run()
    arm = np.arange(0.0, run.length_s, 0.05)
    q = run.joints_at(arm)
    own = (arm > 3.4) & (arm < 4.0)
    q[own, 5] += 2.0 * (arm[own] - 3.4)  # it turns, and the picture does not show it
    kept = (arm < 6.0) | (arm > 7.8)
    arm, q = arm[kept], q[kept]
    taken = take_video(tmp_path, table(tmp_path / "t.csv", "time_s", arm, q))
    assert "1 the arm moves by the table meanwhile" in taken.said
    assert "1 no row of the table is of it" in taken.said
    found = read_picture_set(taken.pictures, taken.table, ROBOT)
    np.testing.assert_allclose(found.postures, STOPS[[0, 1, 3, 5]], atol=1e-9)


def test_a_video_that_shows_no_stop_or_is_none_is_named(tmp_path):
    video(tmp_path / "moves.avi", replace(SCENE, stand_s=0.0))
    with pytest.raises(InputError, match=r"the picture never stands still for 0.3 s"):
        take_video(tmp_path, None, "moves.avi")
    data = video(tmp_path / "run.mp4").read_bytes()
    for name, content in (
        ("cut.mp4", data[: len(data) // 2]),
        ("list.mp4", b"#EXTM3U\n/etc/passwd\n"),
        ("empty.avi", b""),
        ("head.avi", b"RIFF\xff\xff\xff\xffAVI LIST" + bytes(100)),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(FileFormatError, match="cannot be read as a video") as caught:
            take_video(tmp_path, None, name)
        assert "\n" not in str(caught.value)
    with pytest.raises(FileFormatError, match="No such file"):
        take_from_video(Recording(tmp_path / "x.mp4"), None, Results(tmp_path / "out", "camera"))


def test_a_table_of_no_time_of_the_video_is_refused(tmp_path):
    listed = table(tmp_path / "t.csv", "time_s", MIDDLES + 1000.0)
    with pytest.raises(InputError, match="6 no row of the table is of it"):
        take_video(tmp_path, listed)
