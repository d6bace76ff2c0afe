"""Bags of ROS 2: topics, messages and times of both storages; what is damaged or lies is named."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest

from calib.errors import CalibError, FileFormatError, InputError
from posedesign.hand_eye.recordings import bags
from posedesign.hand_eye.recordings.bags import IMAGES, JOINTS, Bag, Times, have_one_clock
from tests import recordings as r

pytest.importorskip("rosbags", reason="bags are written and read by rosbags, the extra bags")

NAMES = ("a", "b")


def messages(count: int = 5) -> list:
    rows = [
        ("/joints", r.JOINTS, 0.1 * k + 0.02, r.joint_state(0.1 * k, NAMES, [k, -k]))
        for k in range(count)
    ]
    flat = np.arange(12, dtype=np.uint8).reshape(3, 4)
    return [*rows, ("/image", r.IMAGE, 0.25, r.image(0.2, flat)), ("/text", r.POSE, 0.3, b"\0")]


@pytest.fixture(params=["mcap", "sqlite3"])
def storage(request) -> r.Storage:
    return request.param


def read_joints(path: Path) -> list[list[float]]:
    bag = Bag.open(path)
    found = bag.messages(bag.named("/joints", JOINTS, "joint values"))
    return [message.content.position.tolist() for message in found]


def test_a_bag_has_topics_and_messages_with_two_times(tmp_path, storage):
    bag = Bag.open(r.write_bag(tmp_path / "bag", storage, messages()))
    assert [(topic.name, topic.type, topic.count) for topic in bag.topics] == [
        ("/image", r.IMAGE, 1),
        ("/joints", r.JOINTS, 5),
        ("/text", r.POSE, 1),
    ]
    found = list(bag.messages(bag.only(JOINTS, "joint values", "joint_topic")))
    assert [message.content.position[0] for message in found] == [0, 1, 2, 3, 4]
    assert found[3].stamp_ns - r.START_NS == 300_000_000
    assert found[3].recorded_ns - r.START_NS == 320_000_000
    (picture,) = bag.messages(bag.only(IMAGES, "pictures", "image_topic"))
    assert picture.content.data.tolist() == list(range(12))


def test_a_bag_is_a_folder_or_its_file_with_and_without_metadata(tmp_path, storage):
    folder = r.write_bag(tmp_path / "bag", storage, messages())
    want = read_joints(folder)
    assert len(want) == 5
    file = next(path for path in folder.iterdir() if path.suffix in bags.ENDINGS)
    assert read_joints(file) == want
    (folder / "metadata.yaml").unlink()
    assert read_joints(folder) == want


def test_a_bag_that_was_split_is_read_file_after_file(tmp_path, storage):
    rows = [one for one in messages(6) if one[0] == "/joints"]
    whole = r.write_bag(tmp_path / "bag", storage, rows[:3])
    second = r.write_bag(tmp_path / "second", storage, rows[3:])
    ending = {"mcap": ".mcap", "sqlite3": ".db3"}[storage]
    (whole / f"bag{ending}").rename(whole / f"bag_9{ending}")
    shutil.copy(second / f"second{ending}", whole / f"bag_10{ending}")
    (whole / "metadata.yaml").unlink()
    assert [values[0] for values in read_joints(whole)] == [0, 1, 2, 3, 4, 5]
    about = f"""rosbag2_bagfile_information:
  relative_file_paths: [bag_9{ending}, bag_10{ending}]
  compression_mode: ''
"""
    (whole / "metadata.yaml").write_text(about)
    assert [values[0] for values in read_joints(whole)] == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize(("kind", "mode"), [("sqlite3", "MESSAGE"), ("mcap", "STORAGE")])
def test_compressed_messages_and_chunks_are_read(tmp_path, kind, mode):
    plain = r.write_bag(tmp_path / "plain", kind, messages())
    bag = r.write_bag(tmp_path / "bag", kind, messages(), compression=mode)
    assert read_joints(bag) == read_joints(plain)


def refusal(path: Path, error: type[CalibError] = FileFormatError) -> CalibError:
    with pytest.raises(error) as caught:
        read_joints(path)
    assert "\n" not in str(caught.value)
    assert caught.value.hint
    return caught.value


def test_files_compressed_as_a_whole_are_named(tmp_path):
    bag = r.write_bag(tmp_path / "bag", "sqlite3", messages(), compression="FILE")
    said = refusal(bag)
    assert said.message.endswith("is compressed as a file")
    assert "zstd -d" in said.hint


def test_a_bag_that_is_cut_off_is_named(tmp_path, storage):
    folder = r.write_bag(tmp_path / "bag", storage, messages(400))
    file = next(path for path in folder.iterdir() if path.suffix in bags.ENDINGS)
    data = file.read_bytes()
    last = [len(data) - 20] if storage == "mcap" else []  # SQLite may have free bytes at the end
    for part in (0, 7, 60, len(data) // 2, *last):
        file.write_bytes(data[:part])
        assert "cannot be read as a bag" in refusal(folder).message


def test_bytes_that_are_changed_raise_one_line_or_change_values(tmp_path, storage):
    folder = r.write_bag(tmp_path / "bag", storage, messages(40))
    file = next(path for path in folder.iterdir() if path.suffix in bags.ENDINGS)
    data = file.read_bytes()
    rng = np.random.default_rng(1)
    said = []
    for at in rng.integers(0, len(data), 6).tolist():
        file.write_bytes(data[:at] + rng.bytes(16) + data[at + 16 :])
        try:
            read_joints(folder)
        except CalibError as error:
            said.append(str(error))
    assert said
    assert not any("\n" in text for text in said)


def test_a_message_that_unpacks_to_more_than_a_picture_is_refused(tmp_path):
    from rosbags.rosbag2.writer import zstd

    bag = r.write_bag(tmp_path / "bag", "sqlite3", messages(), compression="MESSAGE")
    bomb = zstd.compress(bytes(400_000_000))
    with sqlite3.connect(bag / "bag.db3") as there:
        there.execute("UPDATE messages SET data = ?", (bomb,))
    there.close()
    assert "has 200 MB" in refusal(bag).message


def test_a_chunk_that_unpacks_to_more_than_the_memory_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(bags, "_MEMORY_BYTES", 500_000_000)
    zeros = ("/joints", r.JOINTS, 0.5, bytes(400_000_000))
    bag = r.write_bag(tmp_path / "bag", "mcap", [*messages(), zeros], compression="STORAGE")
    assert (bag / "bag.mcap").stat().st_size < 100_000
    assert "memory" in refusal(bag).message


def test_names_in_metadata_lead_nowhere_else(tmp_path):
    folder = r.write_bag(tmp_path / "bag", "sqlite3", messages())
    shutil.move(folder / "bag.db3", tmp_path / "other.db3")
    about = folder / "metadata.yaml"
    about.write_text(about.read_text().replace("bag.db3", "../other.db3"))
    assert "has no file other.db3" in refusal(folder).message


def test_other_files_are_named(tmp_path):
    assert "no such file or folder" in refusal(tmp_path / "none").message
    for name, word in (("run.bag", "ROS 1"), ("run.txt", "no bag of ROS 2")):
        (tmp_path / name).write_bytes(b"#ROSBAG V2.0\n")
        assert word in refusal(tmp_path / name).message
    (tmp_path / "empty").mkdir()
    assert "holds no .mcap or .db3" in refusal(tmp_path / "empty").message


def test_a_message_that_is_cut_off_is_named(tmp_path, storage):
    rows = messages()
    whole = rows[0]
    bag = r.write_bag(tmp_path / "bag", storage, [*rows, (*whole[:2], 0.9, b"\0\1\0\0\7")])
    assert "message 6 of /joints is no sensor_msgs/msg/JointState" in refusal(bag).message


def test_topics_are_named_where_which_is_meant_cannot_be_told(tmp_path):
    two = [("/left/image", r.IMAGE, 0.1, b""), ("/right/image", r.IMAGE, 0.1, b"")]
    bag = Bag.open(r.write_bag(tmp_path / "bag", "mcap", [*messages(), *two[:1]]))
    with pytest.raises(InputError, match="2 topics of pictures: /image, /left/image"):
        bag.only(IMAGES, "pictures", "image_topic")
    with pytest.raises(InputError, match="did you mean /left/image"):
        bag.named("/lef/image", IMAGES, "pictures")
    with pytest.raises(InputError, match=r"/joints is of sensor_msgs/msg/JointState"):
        bag.named("/joints", IMAGES, "pictures")
    with pytest.raises(InputError, match=r"has no lens.*/joints \(sensor_msgs"):
        bag.only(bags.LENSES, "lens (camera_info)", "lens")


def test_without_the_extra_it_is_named(tmp_path, monkeypatch):
    bag = r.write_bag(tmp_path / "bag", "mcap", messages())
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    said = refusal(bag, InputError)
    assert said.hint == "pip install posedesign[bags]"


def test_stamps_of_two_clocks_are_not_compared():
    rise = np.arange(1, 6) * 100_000_000
    own, same = Times(rise, rise + 5_000_000), Times(rise, rise + 80_000_000)
    assert have_one_clock(own, same) == (True, "")
    other = Times(rise, rise + 7_000_000_000)
    is_one, why = have_one_clock(own, other)
    assert not is_one
    assert "two clocks that are" in why
    bare = Times(np.zeros(5, dtype=np.intp), rise)
    assert "no stamps" in have_one_clock(own, bare)[1]
