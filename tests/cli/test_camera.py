"""posedesign camera: a folder of pictures and a table of joints in, a calibrated camera out."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from defusedxml import ElementTree

from calib.lens import Lens
from calib.se3 import quaternion_from_rotation, rotation_exp, transform, wpr_from_rotation
from posedesign.cell import Cell, cell_template
from posedesign.files.csv_tables import read_table
from posedesign.hand_eye import calibration
from posedesign.hand_eye.lens_files import read_lens
from posedesign.hand_eye.pictures import read_picture_set
from tests.board_pictures import Camera, take_pictures
from tests.cli.conftest import rendering
from tests.cli.test_glossary import check_explained

LENS = Lens("pinhole", 640, 480, (560.0, 562.0, 322.0, 238.0, -0.12, 0.06, 5e-4, -3e-4, 0.0))
X = transform(rotation_exp(np.array([0.02, -0.03, 0.5])), np.array([0.05, 0.02, 0.06]))
Z = transform(rotation_exp(np.array([np.pi, 0.0, 0.2])), np.array([-0.75, 0.05, 0.0]))
NEAR = np.deg2rad([0.0, -90.0, 90.0, -90.0, -90.0, 0.0])
BOARD = """
[board]
kind = "charuco"
columns = 7
rows = 5
square_mm = 30.0
marker_mm = 22.0
dictionary = "DICT_4X4_50"
"""


@pytest.fixture(scope="module", autouse=True)
def _detected_once():
    """The same pictures are looked at by most tests: what is in each is found once."""
    found, detect = {}, calibration.detect_board

    def detected(picture, board):
        key = picture.tobytes(), board.points.tobytes(), board.words
        if key not in found:
            found[key] = detect(picture, board)
        return found[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "detect_board", detected)
        yield


def write_pictures(cell: Path, folder: Path, joints: Path, count: int) -> np.ndarray:
    """Pictures by the arm of a cell, and the table of their joints, which it returns [rad]."""
    loaded = Cell.load(cell)
    rng = np.random.default_rng(4)
    camera = Camera(LENS, loaded.board, blur_px=0.8, noise=2.0, light=0.1)
    q = take_pictures(folder, loaded.robot, camera, X, Z, count, rng, near=NEAR)
    header = ["picture", *(f"j{k}_deg" for k in range(1, 7))]
    write_rows(joints, header, np.degrees(q))
    return q


def write_rows(path: Path, header: list[str], rows: np.ndarray) -> None:
    lines = [f"img{i + 1}," + ",".join(map(repr, row)) for i, row in enumerate(rows.tolist())]
    path.write_text("\n".join([",".join(header), *lines, ""]))


@pytest.fixture(scope="module")
def taken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a cell, twelve pictures, and their joints."""
    folder = tmp_path_factory.mktemp("camera")
    cell = folder / "cell.toml"
    cell.write_text(cell_template("ur10e", surroundings=False) + BOARD)
    q = write_pictures(cell, folder / "pictures", folder / "joints.csv", 12)
    T = Cell.load(cell).robot.fk(q)
    poses = np.hstack([1e3 * T[:, :3, 3], quaternion_from_rotation(T[:, :3, :3])])
    header = ["picture", "x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"]
    write_rows(folder / "flange.csv", header, poses)
    return folder


@pytest.fixture
def there(taken: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same in a folder of its own, which is the present one."""
    shutil.copytree(taken, tmp_path / "there")
    monkeypatch.chdir(tmp_path / "there")
    return tmp_path / "there"


def errors_in_sigmas(frame: dict, true: np.ndarray) -> np.ndarray:
    """Errors of a place over its standard deviations."""
    return (np.array(frame["xyz_mm"]) - 1e3 * true[:3, 3]) / frame["sigma_xyz_mm"]


def _link_and_parent(urdf: Path) -> tuple[str | None, str | None]:
    """The camera's link in a ``camera.urdf``, and the link that it is mounted on."""
    root = ElementTree.parse(urdf).getroot()
    (link,), (parent,) = root.findall("link"), root.findall("joint/parent")
    return link.get("name"), parent.get("link")


def test_a_camera_is_calibrated(there, glance):
    with rendering():
        said = glance("camera", "cell.toml", "pictures", "--joints", "joints.csv", "--transforms")
    assert said.code == 0, said.err
    assert said.out.startswith("calibrated: camera and board from 12 of 12 pictures")
    found = json.loads((there / "camera.json").read_text())
    assert np.abs(errors_in_sigmas(found["T_flange_camera"], X)).max() < 4.0
    assert np.abs(errors_in_sigmas(found["T_base_board"], Z)).max() < 4.0
    # better than a tenth of a millimetre in a picture of 640 x 480
    assert max(found["T_flange_camera"]["sigma_xyz_mm"]) < 0.2
    assert found["noise"]["pixel_sigma"] < 0.05
    lens, sigma = read_lens(there / "camera.json"), found["lens"]["sigma"]
    for name, value, true in zip(lens.names, lens.values, LENS.values, strict=True):
        assert abs(value - true) < 5.0 * sigma[name], name
    assert len((there / "camera_pictures.csv").read_text().splitlines()) == 2 + 12
    drawn = [f"{stem}.{ending}" for stem in ("camera", "camera_poses") for ending in ("png", "svg")]
    for name in (*drawn, "camera_info.yaml", "lens.json", "camera.urdf"):
        assert (there / name).stat().st_size > 100
    assert _link_and_parent(there / "camera.urdf") == ("camera", "tool0")
    np.testing.assert_allclose(read_lens(there / "camera_info.yaml").values, lens.values, atol=1e-9)
    with (there / "camera_pictures.csv").open() as file:
        columns = next(line for line in file if not line.startswith("#")).strip().split(",")
    labels = re.findall(r"^([a-z][^:\n]*): ", said.out, flags=re.MULTILINE | re.IGNORECASE)
    check_explained([*columns, *(label for label in labels if label != "calibrated")])
    # and the lens by itself is taken as known
    said = glance(
        "camera", "cell.toml", "pictures", "--joints", "joints.csv", "--lens", "camera.json",
        "--out", "known", "--transforms", "--frames", "flange=wrist,camera=eye_optical",
    )  # fmt: skip
    assert said.code == 0, said.err
    assert "lens: as given" in said.out
    assert _link_and_parent(there / "known/camera.urdf") == ("eye_optical", "wrist")
    called = json.loads((there / "known/transforms.json").read_text())["frames"]
    assert called["base"] == "base_link"

    assert glance("report", ".").code == 0
    page = (there / "report.html").read_text()
    for said in (
        "Camera and board",
        "T_flange_camera: (",
        "Residuals of the pictures",
        "Poses of camera and board, and the board as each picture shows it",
        '<a href="camera_pictures.pdf">',
        "off_rz_deg",
        "img12.png",
    ):
        assert said in page
    other = found | {"lens": found["lens"] | {"fx": 0.0}}
    for content in ({"ok": True}, other):
        (there / "camera.json").write_text(json.dumps(content))
        said = glance("report", ".", "--overwrite")
        assert said.code == 2
        assert "camera.json: is no file that the command camera wrote" in said.err
    # frames of names that the command does not write are passed over
    (there / "camera.json").write_text(json.dumps(found | {"T_x": found["T_base_board"]}))
    assert glance("report", ".", "--overwrite").code == 0


def test_a_target_of_kalibr_takes_the_place_of_the_board(there, glance):
    """It describes another board than the one in the pictures, and that is said."""
    (there / "april.yaml").write_text(
        "target_type: 'aprilgrid'\ntagCols: 6\ntagRows: 4\ntagSize: 0.02\ntagSpacing: 0.3\n"
    )
    command = ("camera", "cell.toml", "pictures", "--joints", "joints.csv", "--target")
    said = glance(*command, "april.yaml")
    assert said.code == 2
    assert "AprilGrid of Kalibr of 6 x 4 every 26 mm" in said.err
    (there / "none.yaml").write_text("target_type: 'sphere'\n")
    said = glance(*command, "none.yaml")
    assert said.code == 2
    assert "has the target_type 'sphere'" in said.err


def test_poses_of_the_flange_do_as_well(there, glance):
    words = ("camera", "cell.toml", "pictures", "--joints", "flange.csv", "--transforms", "--json")
    said = glance(*words)
    assert said.code == 0, said.err
    # the base of a controller need not be that of the links
    assert _link_and_parent(there / "camera.urdf") == ("camera", "flange")
    found = json.loads(said.out)
    assert np.abs(errors_in_sigmas(found["T_flange_camera"], X)).max() < 4.0
    said = glance(
        "camera", "cell.toml", "pictures", "--joints", "flange.csv", "--free", "zero_offsets",
        "--out", "free",
    )  # fmt: skip
    assert said.code == 2
    assert "poses of the flange say nothing of the joints" in said.err


def test_poses_of_the_flange_need_no_cell(there, glance):
    """The board is described beside the command, and angles may be those of any maker."""
    board = "kind=charuco,columns=7,rows=5,square_mm=30,marker_mm=22,dictionary=DICT_4X4_50"
    command = ("camera", "pictures", "--poses", "flange.csv", "--target", board)
    found = json.loads(glance(*command, "--json").out)
    assert np.abs(errors_in_sigmas(found["T_flange_camera"], X)).max() < 4.0
    flange = read_picture_set(there / "pictures", there / "flange.csv")
    T = flange.T_base_flange
    abc = np.rad2deg(wpr_from_rotation(T[:, :3, :3]))[:, ::-1]  # KUKA's A, B, C are R, P, W
    rows = zip(flange.names, np.hstack([1e3 * T[:, :3, 3], abc]).tolist(), strict=True)
    lines = [",".join([name, *map(repr, row)]) for name, row in rows]
    (there / "kuka.csv").write_text(
        "\n".join(["picture,x_mm,y_mm,z_mm,w_deg,p_deg,r_deg", *lines]) + "\n"
    )
    command = ("camera", "pictures", "--poses", "kuka.csv", "--target", board, "--out", "kuka")
    said = glance(*command)
    assert said.code == 2
    assert "if in the poses the three numbers are zyx-moving (kuka-abc" in said.err
    assert "--poses-are zyx-moving" in said.err
    said = glance(*command, "--poses-are", "zyx-moving", "--json")
    assert said.code == 0, said.err
    again = json.loads(said.out)
    np.testing.assert_allclose(
        again["T_flange_camera"]["matrix_m"], found["T_flange_camera"]["matrix_m"], atol=1e-6
    )


def test_a_cell_that_is_left_out_and_needed(there, glance):
    said = glance("camera", "pictures", "--poses", "flange.csv")
    assert said.code == 2
    assert "no cell is given, and no board is described" in said.err
    said = glance("camera", "pictures", "--poses", "joints.csv", "--target", "kind=chessboard")
    assert said.code == 2
    said = glance(
        "camera", "pictures", "--poses", "joints.csv", "--target",
        "kind=chessboard,columns=7,rows=5,square_mm=30",
    )  # fmt: skip
    assert said.code == 2
    assert "joint values need the robot" in said.err


def test_two_cameras_of_one_stop(there, glance):
    for name in ("left", "right"):
        shutil.copytree(there / "pictures", there / "both" / name)
    said = glance("camera", "cell.toml", "both", "--joints", "joints.csv", "--out", "both_out")
    assert said.code == 0, said.err
    found = json.loads((there / "both_out" / "camera.json").read_text())
    left, right = (np.array(found[f"T_flange_{name}"]["xyz_mm"]) for name in ("left", "right"))
    np.testing.assert_allclose(left, right, atol=1e-3)
    assert set(found["lenses"]) == {"left", "right"}
    assert "left/img1.png,used" in (there / "both_out" / "camera_pictures.csv").read_text()
    assert len(found["flange_poses"]) == 24
    sheets = (there / "both_out" / "camera_pictures.pdf").read_bytes()
    assert b"/Count 2 " in sheets  # of twelve pictures each


def test_wrong_rows_and_pictures_without_a_board_are_named(there, glance):
    lines = (there / "joints.csv").read_text().splitlines()
    three, four = (line.split(",", 1) for line in lines[3:5])
    lines[3:5] = [",".join([three[0], four[1]]), ",".join([four[0], three[1]])]
    (there / "joints.csv").write_text("\n".join([*lines, ""]))
    cv2.imwrite(str(there / "pictures" / "img5.png"), np.full((480, 640), 90, np.uint8))
    said = glance("camera", "cell.toml", "pictures", "--joints", "joints.csv", "--verbose")
    assert said.code == 0, said.err
    assert "from 9 of 12 pictures" in said.out
    assert "left out, as they contradict the others: img3.png, img4.png" in said.err
    assert "img5.png: no board" in said.err
    rows = {row.cells["picture"]: row.cells for row in read_table("camera_pictures.csv").rows}
    assert [rows[f"img{k}.png"]["points"] for k in (3, 5)] == ["24", "0"]
    assert rows["img3.png"]["status"] == "contradicts the others"
    assert rows["img5.png"]["reason"].startswith("no board: ")


@pytest.mark.parametrize("kept", [(), ("img1.png", "img2.png")], ids=["none", "two"])
def test_pictures_are_drawn_where_the_calibration_fails(there, glance, kept):
    """None shows the board, or too few do: the sheets say what was found."""
    for path in (there / "pictures").iterdir():
        if path.name not in kept:
            level = 60 + int(path.stem.removeprefix("img"))
            cv2.imwrite(str(path), np.full((480, 640), level, np.uint8))
    said = glance("camera", "cell.toml", "pictures", "--joints", "joints.csv", "--out", "out")
    assert said.code == 2
    assert "camera_pictures.pdf shows what was found in each picture" in " ".join(said.err.split())
    assert [path.name for path in (there / "out").iterdir()] == ["camera_pictures.pdf"]
    again = glance("camera", "cell.toml", "pictures", "--joints", "joints.csv", "--out", "out")
    assert again.err == said.err  # what is there is its own, and is replaced


def test_what_looks_wrong_is_not_to_be_trusted(there, glance):
    text = (there / "cell.toml").read_text().replace("square_mm = 30.0", "square_mm = 31.0")
    (there / "cell.toml").write_text(text.replace("marker_mm = 22.0", "marker_mm = 22.7"))
    said = glance("camera", "cell.toml", "pictures", "--joints", "joints.csv", "--transforms")
    assert said.code == 1
    assert said.out.startswith("not to be trusted")
    assert "the board seems to be 3." in said.err
    assert not (there / "camera_info.yaml").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["pictures"], "the pictures have no joints and no poses of the flange (give --joints: a "),
        (["pictures", "--joints", "joints.csv", "--camera", "fixed"], "eye-in-hand"),
        (["pictures", "--joints", "joints.csv", "--lens", "pinhol"], "did you mean pinhole"),
        (["pictures", "--joints", "joints.csv", "--lens", "no.json"], "no.json"),
        (["pictures", "--joints", "joints.csv", "--arm-mm", "0.1"], "give both --arm-mm and"),
        (["pictures", "--joints", "joints.csv", "--board-errors", "size"], "has no 'size'"),
        (["nowhere", "--joints", "joints.csv"], "nowhere"),
    ],
)
def test_errors_in_one_line(there, glance, words, said):
    found = glance("camera", "cell.toml", *words)
    assert found.code == 2
    assert said in " ".join(found.err.split())
    assert found.err.count("error:") == 1


def test_where_the_camera_is_stands_in_the_cell(there, glance):
    """These pictures are by a camera on the flange: the other set-up is told, and can be said."""
    text = (there / "cell.toml").read_text().replace('kind = "touch-up"', 'kind = "board"')
    (there / "cell.toml").write_text(text + '\n[camera]\nmount = "fixed"\n')
    words = ("camera", "cell.toml", "pictures", "--joints", "joints.csv")
    found = glance(*words)
    assert found.code == 2
    assert "camera on the flange" in found.err
    assert glance(*words, "--camera", "on-flange").code == 0


def test_a_cell_without_a_board_is_refused(there, glance):
    (there / "cell.toml").write_text(cell_template("ur10e", surroundings=False))
    found = glance("camera", "cell.toml", "pictures", "--joints", "joints.csv")
    assert found.code == 2
    assert "describes no calibration board" in found.err


REHEARSED = """
[robot]
preset = "ur5e"
[tool]
point_mm = [0.0, 60.0, 300.0]
camera_stand_off_mm = 270.0
[base_pose]
posture_deg = [0.0, -90.0, 90.0, -90.0, -90.0, 0.0]
[camera]
image_px = [480, 384]
focal_px = 420.0
[constraints]
collisions = false
[measurement]
kind = "board"
[truth]
zero_offsets_deg = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
tool_error_mm = [2.0, -1.0, 3.0]
[board]
kind = "charuco"
columns = 7
rows = 5
square_mm = 20.0
marker_mm = 15.0
dictionary = "DICT_4X4_50"
"""


ROUND = (
    REHEARSED[: REHEARSED.index("[board]")]
    + """
[board]
kind = "round-target"
diameter_mm = 100.0
"""
)


def write_rehearsal(text: str, count: int) -> None:
    """A cell and poses about its base pose."""
    Path("cell.toml").write_text(text)
    rng = np.random.default_rng(2)
    base = np.array([0.0, -90.0, 90.0, -90.0, -90.0, 0.0])
    off = rng.uniform(-1, 1, (count, 6)) * [2.0, 2.0, 2.0, 8.0, 8.0, 30.0]
    rows = [",".join(map(repr, row)) for row in (base + off).tolist()]
    header = ",".join(f"j{k}_deg" for k in range(1, 7))
    Path("poses.csv").write_text("\n".join([header, *rows, ""]))


@pytest.mark.parametrize("text", [REHEARSED, ROUND], ids=["charuco", "round target"])
def test_a_rehearsal_with_pictures(tmp_path, monkeypatch, glance, text):
    monkeypatch.chdir(tmp_path)
    write_rehearsal(text, 8)
    said = glance("simulate", "cell.toml", "poses.csv", "--out", "rehearsal")
    assert said.code == 0, said.err
    assert "8 pictures of the board, SIMULATED" in said.out
    said = glance(*said.out.splitlines()[-1].removeprefix("next: posedesign ").split())
    assert said.code == 0, said.err
    assert said.out.startswith("SIMULATED")
    found = json.loads(Path("rehearsal/camera.json").read_text())
    expected = Cell.load(Path("cell.toml")).board_set_up.X[:3, 3] * 1e3 + [2.0, -1.0, 3.0]
    frame = found["T_flange_camera"]
    assert (np.abs(frame["xyz_mm"] - expected) < 4.0 * np.array(frame["sigma_xyz_mm"])).all()
    # the arm has no errors but its own: nothing is added that the cell's truth does not say
    assert found["noise"]["arm_sigma_mm"] < 0.02
    assert max(frame["sigma_xyz_mm"]) < 0.2


def test_an_arm_with_zero_offsets_is_named_and_taken_into_account(tmp_path, monkeypatch, glance):
    """The verdict says it, the sigmas cover it, and the file has camera and board of both arms."""
    monkeypatch.chdir(tmp_path)
    offsets = "zero_offsets_deg = [0.03, 0.08, -0.06, 0.05, 0.1, -0.04]"
    write_rehearsal(re.sub(r"zero_offsets_deg = .*", offsets, REHEARSED), 14)
    said = glance("simulate", "cell.toml", "poses.csv", "--out", "rehearsal")
    words = said.out.splitlines()[-1].removeprefix("next: posedesign ").split()
    said = glance(*words, "--verbose", "--transforms")
    assert said.code == 0, said.err
    assert re.search(r"calibrated: camera and board from 14 of 14 pictures, with joints", said.out)
    assert "its own errors are taken into account: zero offsets" in said.out
    found = json.loads(Path("rehearsal/camera.json").read_text())
    expected = Cell.load(Path("cell.toml")).board_set_up.X[:3, 3] * 1e3 + [2.0, -1.0, 3.0]
    corrected = found["arm_errors"]["corrected"]
    for frame in (found["T_flange_camera"], corrected["T_flange_camera"]):
        assert (np.abs(frame["xyz_mm"] - expected) < 4.0 * np.array(frame["sigma_xyz_mm"])).all()
    assert corrected["point_sigma_mm"] < found["point_sigma_mm"]
    # other tools take the arm as its controller has it
    written = json.loads(Path("rehearsal/transforms.json").read_text())["T_flange_camera"]["data"]
    matrix = np.array(found["T_flange_camera"]["matrix_m"])
    np.testing.assert_allclose(np.reshape(written, (4, 4)), matrix, atol=1e-9)
    assert glance("report", "rehearsal").code == 0
    page = Path("rehearsal/report.html").read_text()
    assert "errors of the arm are taken into account" in page
