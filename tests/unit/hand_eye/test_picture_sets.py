"""Pictures with their joints: each row at its picture, and whatever does not fit is named."""

import struct
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from calib.errors import CalibError, FileFormatError, InputError
from calib.robots import Robot
from calib.se3 import FloatArray, quaternion_from_rotation, rotation_from_wpr, transform
from posedesign.hand_eye.pictures import PictureSet, read_grey, read_picture_set
from posedesign.programs import Arm, PoseProgram, ProgramOptions, ProgramPose, write

ROBOT = Robot.preset("lrmate200id")
DEGREES = np.array([[10.0, -20, 30, 40, 50, 60], [11, -21, 31, 41, 51, 61], [12, -22, 7, 8, 9, 9]])
NAMES = ("img1.png", "img2.png", "img10.png")


def picture(path: Path, level: int = 0, size: tuple[int, int] = (24, 16)) -> Path:
    scene = np.add.outer(np.arange(size[1]) * 3, np.arange(size[0]) * 4 + level).astype(np.uint8)
    assert cv2.imwrite(str(path), scene)
    return path


@pytest.fixture
def folder(tmp_path):
    place = tmp_path / "pictures"
    place.mkdir()
    for level, name in enumerate(NAMES):
        picture(place / name, level)
    return place


def table(folder: Path, text: str, name: str = "joints.csv") -> Path:
    path = folder.parent / name
    path.write_text(text)
    return path


def joints(folder: Path, names: Sequence[str] = (), degrees: FloatArray = DEGREES) -> Path:
    head = ",".join(["picture"] * bool(names) + [f"j{j}_deg" for j in range(1, 7)])
    return table(folder, "\n".join([head, *lines_of(names, degrees)]) + "\n")


def lines_of(names: Sequence[str], rows: FloatArray) -> list[str]:
    cells = [",".join(map(repr, row)) for row in rows.tolist()]
    return [f"{name},{line}" for name, line in zip(names, cells, strict=True)] if names else cells


def read(folder: Path, poses: Path | None = None, robot: Robot | None = ROBOT) -> PictureSet:
    return read_picture_set(folder, poses, robot)


def refusal(folder: Path, poses: Path | None = None, robot: Robot | None = ROBOT) -> CalibError:
    with pytest.raises(CalibError) as caught:
        read_picture_set(folder, poses, robot)
    assert "\n" not in str(caught.value)
    assert caught.value.hint
    return caught.value


def values(found: PictureSet) -> FloatArray:
    assert found.T_base_flange is None
    assert found.postures is not None
    return found.postures


def test_rows_by_name_in_any_order(folder):
    """With and without ending, in capitals, with the folder before it."""
    path = joints(folder, ("C:\\pics\\IMG10.PNG", "img1", "pictures/img2.png"))
    found = read(folder, path)
    assert found.names == NAMES  # numbers by their value
    assert found.paths == tuple(folder / name for name in NAMES)
    assert found.size_px == (24, 16)
    assert found.notes == ()
    np.testing.assert_allclose(values(found), np.deg2rad(DEGREES[[1, 2, 0]]))


def test_rows_in_the_order_of_names(folder):
    found = read(folder, joints(folder))
    np.testing.assert_allclose(values(found), np.deg2rad(DEGREES))
    (note,) = found.notes
    assert "from img1.png in line 2 to img10.png in line 4" in note


def test_files_that_a_shell_listed(folder):
    given = sorted(folder.iterdir())
    assert [path.name for path in given] != list(NAMES)
    assert read_picture_set(given).names == NAMES


def test_without_poses(folder):
    found = read(folder)
    assert found.postures is None
    assert found.T_base_flange is None


def test_joints_as_the_pendant_shows_them(folder):
    assert ROBOT.controller is not None
    path = joints(folder, NAMES)
    path.write_text(path.read_text().replace(",j", ",pendant_j"))
    expected = ROBOT.controller.posture(DEGREES)
    assert not np.allclose(expected, np.deg2rad(DEGREES))
    np.testing.assert_allclose(values(read(folder, path)), expected)


def test_joints_by_their_names_in_ros(folder):
    head = ",".join(["picture", *(f"{name}_rad" for name in ROBOT.joint_names)])
    rows = [
        ",".join([n, *map(repr, q)]) for n, q in zip(NAMES, (DEGREES / 60).tolist(), strict=True)
    ]
    path = table(folder, "\n".join([head, *rows]))
    np.testing.assert_allclose(values(read(folder, path)), DEGREES / 60)


@pytest.mark.parametrize("rotation", ["wpr", "quaternion"])
def test_poses_of_the_flange(folder, rotation):
    T = transform(rotation_from_wpr(np.deg2rad(DEGREES[:, 3:])), DEGREES[:, :3] / 100)
    head = "picture,x_mm,y_mm,z_mm,w_deg,p_deg,r_deg"
    rows = np.column_stack([DEGREES[:, :3] * 10, DEGREES[:, 3:]])
    if rotation == "quaternion":
        head = "picture,x_m,y_m,z_m,qw,qx,qy,qz"
        rows = np.column_stack([T[:, :3, 3], quaternion_from_rotation(T[:, :3, :3])])
    lines = [
        ",".join([n, *map(repr, r)]) for n, r in zip(NAMES[1:], rows[1:].tolist(), strict=True)
    ]
    found = read(folder, table(folder, "\n".join([head, *lines])), robot=None)
    assert found.postures is None
    assert found.T_base_flange is not None
    np.testing.assert_allclose(found.T_base_flange[1:], T[1:], atol=1e-12)
    assert np.isnan(found.T_base_flange[0]).all()
    assert found.notes == ("img1.png: no pose is given, used for the lens only",)


def test_joints_count_where_there_are_poses_too(folder):
    text = joints(folder, NAMES).read_text().splitlines()
    lines = [line + end for line, end in zip(text, [",x_mm", *[",1"] * 3], strict=True)]
    found = read(folder, table(folder, "\n".join(lines)))
    assert "the joints are taken" in found.notes[0]
    np.testing.assert_allclose(values(found), np.deg2rad(DEGREES))


@pytest.mark.parametrize(("mark", "said"), [(";", "semicolons"), ("\t", "tabs"), ("  ", "spaces")])
def test_tables_of_other_programs(folder, mark, said):
    text = joints(folder, NAMES, DEGREES + 0.5).read_text().replace(",", mark)
    found = read(folder, table(folder, text.replace(".5", ",5"), "joints.txt"))
    np.testing.assert_allclose(values(found), np.deg2rad(DEGREES + 0.5))
    assert found.notes[0].endswith(f"{said} stand between the cells, and commas in numbers")


def test_numbers_with_points_and_commas(folder):
    text = joints(folder, NAMES).read_text().replace(",", ";").replace("-21.0", "-21,0")
    error = refusal(folder, table(folder, text))
    assert "line 3: has numbers with a comma, and line 2 has some with a point" in error.message


@pytest.mark.parametrize("header", ["", "J1,J2,J3,J4,J5,J6\n"])
def test_a_list_of_robodk(folder, header):
    text = header + "\n".join(",".join(map(str, row)) for row in DEGREES.tolist())
    assert ROBOT.controller is not None
    found = read(folder, table(folder, text))
    np.testing.assert_allclose(values(found), ROBOT.controller.posture(DEGREES))


@pytest.mark.parametrize("dialect", ["moveit-joints", "ros-trajectory", "fanuc-ls"])
def test_programs(folder, tmp_path, dialect):
    program = PoseProgram(
        "CALIB", tuple(ProgramPose(f"P{i}", q) for i, q in enumerate(np.deg2rad(DEGREES)))
    )
    path = write(replace(program, arm=Arm.of(ROBOT)), dialect, tmp_path)[0]
    np.testing.assert_allclose(values(read(folder, path)), np.deg2rad(DEGREES), atol=1e-4)
    assert "the robot is not known" in refusal(folder, path, robot=None).message


def test_programs_of_poses(folder, tmp_path):
    poses = tuple(ProgramPose(f"P{i}", q) for i, q in enumerate(np.deg2rad(DEGREES)))
    options = ProgramOptions(form="cartesian")
    path = write(PoseProgram("CALIB", poses, options, Arm.of(ROBOT)), "fanuc-ls", tmp_path)[0]
    assert "is the pose of a tool" in refusal(folder, path).message


def test_empty_cells_are_no_pose(folder):
    text = joints(folder, NAMES).read_text().splitlines()
    text[2] = "img2.png" + 6 * ","
    found = read(folder, table(folder, "\n".join(text)))
    assert np.isnan(values(found)).any(axis=1).tolist() == [False, True, False]
    assert found.notes == ("img2.png: no pose is given, used for the lens only",)
    text[2] = "img2.png,1" + 5 * ","
    assert "an empty cell" in refusal(folder, table(folder, "\n".join(text))).message
    text[1:] = [f"{name}{6 * ','}" for name in NAMES]
    assert "no pose in any row" in refusal(folder, table(folder, "\n".join(text))).message


def test_rows_of_a_plan_that_are_not_measured(folder):
    text = joints(folder, degrees=DEGREES[[0, 2, 1, 1, 2]]).read_text().splitlines()
    ends = (",status", ",grid", ",via", ",repaired", ",dropped", ",grid")
    path = table(folder, "\n".join(line + end for line, end in zip(text, ends, strict=True)))
    found = read(folder, path)
    np.testing.assert_allclose(values(found), np.deg2rad(DEGREES))
    assert found.notes[0].endswith("2 rows are via or dropped, passed over")


def test_rows_of_pictures_that_are_not_there(folder):
    found = read(folder, joints(folder, ("img1", "img2", "img3")))
    assert "no such picture, passed over: line 4 'img3'" in found.notes[0]
    assert "img10.png: no pose" in found.notes[1]
    error = refusal(folder, joints(folder, ("a", "b", "c")))
    assert "line 2, column picture: no row names a picture that is there" in error.message


def test_rows_that_do_not_fit(folder):
    error = refusal(folder, joints(folder, degrees=DEGREES[:2]))
    assert "has 2 rows, and there are 3 pictures" in error.message
    error = refusal(folder, joints(folder, ("img1", "img2", "img1.png")))
    assert "line 4, column picture: gives a second pose of img1.png, after line 2" in error.message
    picture(folder / "img1.bmp", 7)
    error = refusal(folder, joints(folder, ("img1", "img2", "img10")))
    assert "line 2, column picture: may be img1.bmp, img1.png" in error.message


def test_names_of_pictures_under_another_name(folder):
    path = joints(folder, NAMES[::-1])
    path.write_text(path.read_text().replace("picture", "file"))
    assert "column file: names pictures" in refusal(folder, path).message


def test_tables_without_poses(folder):
    path = table(folder, "picture,a\nimg1,1\n")
    assert "there is no column j1_deg" in refusal(folder, path).message
    assert "no pose of the flange" in refusal(folder, path, robot=None).message
    assert "joint values need the robot" in refusal(folder, joints(folder), robot=None).message
    path = joints(folder, NAMES, DEGREES / 60)
    assert "look like radians" in refusal(folder, path).message
    found = read_picture_set(folder, path, ROBOT, trust_units=True)
    np.testing.assert_allclose(values(found), np.deg2rad(DEGREES / 60))


@pytest.mark.parametrize("ending", ["", ","])
def test_lists_without_a_header_and_a_robot_are_poses_of_the_flange(folder, ending):
    """The pictures tell the convention later; the last line has no comma where the others do."""
    rows = [[100.0 + i, 20.0, 300.0, 1.0, 0.2 * i, -0.3] for i in range(len(NAMES))]
    text = f"{ending}\n".join(",".join(map(str, row)) for row in rows) + "\n"
    found = read(folder, table(folder, text, "location.txt"), robot=None)
    assert found.written is not None
    assert found.T_base_flange is not None
    np.testing.assert_allclose(found.written.numbers, np.array(rows)[:, 3:])
    np.testing.assert_allclose(found.T_base_flange[:, :3, 3] * 1e3, np.array(rows)[:, :3])


def test_a_comma_at_the_end_of_a_row_below_names_is_refused(folder):
    """It may be an empty cell behind a number with a decimal comma."""
    text = "x_mm,y_mm,z_mm,w_deg,p_deg,r_deg\n" + "1,2,3,4,5,6,\n" * len(NAMES)
    assert "has 7 cells, the header has 6" in str(refusal(folder, table(folder, text), robot=None))


@pytest.mark.parametrize("name", ["poses.yml", "poses.ls", "poses.csv", "poses"])
def test_poses_that_are_not_there(folder, name):
    assert "No such file" in str(refusal(folder, folder.parent / name, robot=None))


def test_units_of_a_list_without_names_are_said_beside_its_convention(folder):
    path = table(folder, "100,20,300,1.0,0.2,-0.3\n" * len(NAMES), "location.txt")
    with pytest.raises(FileFormatError, match="look like radians") as caught:
        read_picture_set(folder, path, None, poses_are="fanuc-wpr")
    assert "add rad to `poses_are`" in (caught.value.hint or "")


def test_the_same_picture_twice(folder):
    (folder / "img11.png").write_bytes((folder / "img2.png").read_bytes())
    found = read(folder)
    assert found.names == NAMES
    assert found.notes == ("img11.png is left out: the same file as img2.png, byte for byte",)
    names = (*NAMES[:2], "img11.png")
    rows = np.vstack([DEGREES[:2], DEGREES[1]])
    assert read(folder, joints(folder, names, rows)).names == NAMES
    error = refusal(folder, joints(folder, names))
    assert "the same file as img2.png, byte for byte, at another pose" in error.message
    # of two the one stays that has a pose
    found = read(folder, joints(folder, ("img1.png", "img10.png", "img11.png")))
    assert found.names == ("img1.png", "img10.png", "img11.png")
    assert found.notes[0].startswith("img2.png is left out")


def test_folders_without_pictures(folder, tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    assert "there are no pictures" in refusal(empty).message
    (empty / "notes.docx").write_text("-")
    assert "only notes.docx" in refusal(empty).message
    assert "cannot be read" in refusal(tmp_path / "nothing").message
    picture(empty / "img1.png", 9)
    with pytest.raises(InputError, match=r"several pictures have the name img1\.png"):
        read_picture_set([folder, empty])


def test_what_else_is_in_the_folder(folder):
    path = joints(folder, NAMES).rename(folder / "joints.csv")
    (folder / "._img1.png").write_text("of another system")
    assert read(folder, path).notes == ()
    (folder / "img4.webp").write_text("-")
    assert read(folder, path).notes == ("no pictures, passed over: img4.webp",)


def test_pictures_that_cannot_be_read(folder):
    (folder / "img3.png").write_bytes(b"")
    error = refusal(folder)
    assert isinstance(error, FileFormatError)
    assert error.message == f"{folder / 'img3.png'}: is empty"
    (folder / "img4.png").write_bytes((folder / "img2.png").read_bytes()[:50])
    assert refusal(folder).message.endswith("nor can img4.png be read")


def test_pictures_of_other_sizes(folder):
    picture(folder / "img3.png", size=(16, 24))
    error = refusal(folder)
    assert "has 16 by 24 pixels, where 3 others have 24 by 16" in error.message
    assert "turned" in error.hint
    picture(folder / "img0.png", size=(12, 8))
    error = refusal(folder)
    assert error.message.endswith("; so have other sizes img3.png")
    assert "one size" in error.hint


def with_exif(path: Path, taken: str = "", turned: int = 1, fraction: str = "") -> None:
    exif = Image.Exif()
    exif[274] = turned
    if taken:
        exif.get_ifd(34665)[36867] = taken
    if fraction:
        exif.get_ifd(34665)[37521] = fraction
    with Image.open(path) as image:
        image.load()
    image.save(path, exif=exif)


@pytest.mark.parametrize("ending", [".png", ".jpg"])
def test_order_of_the_times_they_were_taken(folder, ending):
    names = [f"img{k}{ending}" for k in (1, 2, 10)]
    for path in folder.iterdir():
        path.unlink()
    for level, name in enumerate(names):
        picture(folder / name, level)
    second, before = "2024:05:01 10:00:02", "2023:12:31 23:59:59"
    for name, when, part in zip(names, (second, second, before), ("5", "4", ""), strict=True):
        with_exif(folder / name, when, fraction=part)
    found = read_picture_set(folder, joints(folder), ROBOT, order="time")
    assert list(found.names) == [names[k] for k in (2, 1, 0)]
    assert "in the order of their times, from img10" in found.notes[0]
    with_exif(folder / names[1], second, fraction="5")
    found = read_picture_set(folder, order="time")
    assert found.notes == (
        f"{names[0]}, {names[1]}: taken at the same time as another, in the order of names",
    )
    picture(folder / names[1], 99)
    with pytest.raises(InputError, match=rf"{names[1]}: the file does not say when") as caught:
        read_picture_set(folder, order="time")
    assert caught.value.hint


def test_a_note_to_turn_the_picture_is_named_and_not_followed(folder):
    before = read_grey(folder / "img2.png")
    with_exif(folder / "img2.png", turned=6)
    (note,) = read(folder).notes
    assert note.startswith("img2.png: a note in the file asks to turn the picture; it stays")
    np.testing.assert_array_equal(read_grey(folder / "img2.png"), before)


def levels() -> NDArray[np.int64]:
    return np.arange(24 * 16).reshape(16, 24) * 10  # up to 3830: twelve bits


@pytest.mark.parametrize("ending", [".png", ".pgm", ".tif"])
@pytest.mark.parametrize(("factor", "shift"), [(1, 4), (16, 8)])
def test_sixteen_bits_are_shifted_by_the_brightest_pixel(tmp_path, ending, factor, shift):
    path = tmp_path / f"deep{ending}"
    assert cv2.imwrite(str(path), (levels() * factor).astype(np.uint16))
    found = read_grey(path)
    assert found.dtype == np.uint8
    np.testing.assert_array_equal(found, levels() * factor >> shift)
    assert read_picture_set([path]).size_px == (24, 16)


def test_dark_pictures_of_sixteen_bits_stay_as_they_are(tmp_path):
    path = tmp_path / "dark.png"
    assert cv2.imwrite(str(path), (levels() // 16).astype(np.uint16))
    np.testing.assert_array_equal(read_grey(path), levels() // 16)


def test_a_tiff_of_sixteen_bits_of_another_byte_order(tmp_path):
    tags = {256: 24, 257: 16, 258: 16, 259: 1, 262: 1, 273: 8, 277: 1, 278: 16, 279: 768}
    data = levels().astype(">u2").tobytes()
    lines = b"".join(struct.pack(">HHII", tag, 4, 1, value) for tag, value in tags.items())
    head = b"MM" + struct.pack(">HI", 42, 8 + len(data))
    path = tmp_path / "deep.tif"
    path.write_bytes(head + data + struct.pack(">H", len(tags)) + lines + bytes(4))
    np.testing.assert_array_equal(read_grey(path), levels() >> 4)


@pytest.mark.parametrize("channels", [2, 4])
def test_transparency(tmp_path, channels):
    """Opaque it is nothing; where it is not, the levels under it are whatever they are."""
    scene = np.full((16, 24, channels), 90, np.uint8)
    scene[..., -1] = 255
    path = tmp_path / "a.png"
    Image.fromarray(scene).save(path)
    np.testing.assert_array_equal(read_grey(path), np.full((16, 24), 90))
    scene[3, 4, -1] = 254
    Image.fromarray(scene).save(path)
    with pytest.raises(FileFormatError, match="is transparent in places"):
        read_grey(path)


def test_kinds_that_no_camera_of_ours_writes(tmp_path):
    path = tmp_path / "deep.png"
    assert cv2.imwrite(str(path), np.zeros((16, 24, 3), np.uint16))
    assert "not 8 bits a colour" in refusal(tmp_path).message
