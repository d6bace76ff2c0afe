"""Two real sets as their owners have them, and mistakes of convention put into them."""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.errors import CalibError
from calib.se3 import FloatArray, inverse
from posedesign.cell import Cell
from posedesign.cli.main import run
from posedesign.hand_eye import Asked, calibration
from posedesign.hand_eye.board_files import board_said, cell_of
from posedesign.hand_eye.pictures import PictureSet, read_picture_set

SETS = {
    "chessboard_eye_in_hand": (
        "robot_poses.yaml",
        "kind=chessboard,columns=10,rows=7,square_mm=18",
        "on-flange",
        16,
    ),
    "charuco_eye_to_hand": ("poses", "target.yaml", "fixed", 16),
}


@pytest.fixture(scope="module", params=SETS)
def owned(request, data_folder) -> Iterator[SimpleNamespace]:
    """A set with its board found once."""
    poses, target, camera, count = SETS[request.param]
    folder = data_folder / "pictures" / request.param
    if "=" not in target:
        target = str(folder / target)
    base = read_picture_set(folder / "pictures", folder / poses)
    board = board_said(target)
    found = calibration.find_boards(base.paths, board)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "find_boards", lambda *_: found)
        yield SimpleNamespace(
            name=request.param,
            folder=folder,
            poses=folder / poses,
            target=target,
            camera=camera,
            count=count,
            base=base,
            board=board,
            cell=cell_of(target),
        )


def test_a_folder_to_a_result_in_one_command(owned, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ["camera", owned.folder / "pictures", "--poses", owned.poses]
    words += ["--target", owned.target, "--camera", owned.camera]
    code = run([str(word) for word in words])
    said = capsys.readouterr()
    assert f"of {owned.count} pictures" in said.out
    assert Path("camera.json").exists()
    # the squares of one are .5 % larger than described, which is estimated and said
    assert code == 0
    assert ("the board seems to be 0.4" in said.err) == owned.name.startswith("charuco")


def degrees(order: str) -> object:
    return lambda R: R.as_euler(order, degrees=True)


WPR, VECTOR = "w_deg,p_deg,r_deg", "rx_rad,ry_rad,rz_rad"
MATRIX = ",".join(f"r{i}{j}" for i in "123" for j in "123")
MISTAKES = {
    **{
        f"{o} moving": (degrees(o), WPR, f"{o.lower()}-moving")
        for o in ("ZYX", "XYZ", "ZYZ", "ZXZ", "YXZ", "YZX", "XYX")
    },
    **{f"{o} fixed": (degrees(o), WPR, f"{o}-fixed") for o in ("xzy", "zyx", "zyz", "yxy", "yzx")},
    "vector for angles": (lambda R: R.as_rotvec(degrees=True), WPR, "rotation-vector"),
    "angles for vector": (lambda R: R.as_euler("xyz"), VECTOR, "xyz-fixed"),
    "KUKA for vector": (lambda R: R.as_euler("ZYX"), VECTOR, "zyx-moving"),
    "xyzw for wxyz": (lambda R: R.as_quat(), "qw,qx,qy,qz", "quaternion-xyzw"),
    "wxyz for xyzw": (lambda R: R.as_quat(scalar_first=True), "qx,qy,qz,qw", "are w x y z"),
    "columns": (lambda R: np.swapaxes(R.as_matrix(), 1, 2).reshape(-1, 9), MATRIX, "by-columns"),
    "radians": (lambda R: R.as_euler("xyz"), WPR, "look like radians"),
}


def given(owned, path: Path, T: FloatArray, numbers: FloatArray, columns: str, scale: float = 1e3):
    rows = np.hstack([scale * T[:, :3, 3], numbers])
    lines = [
        ",".join([name, *(f"{value:.6f}" for value in row)])
        for name, row in zip(owned.base.names, rows, strict=True)
    ]
    path.write_text("\n".join([f"picture,x_mm,y_mm,z_mm,{columns}", *lines]) + "\n")
    return read_picture_set(owned.folder / "pictures", path)


def refusal(owned, out: Path, read, camera: str = "") -> str:
    """What is said of pictures with a mistake; fails where they are taken."""
    with pytest.raises(CalibError) as caught:
        _calibrated(owned, out, read(), camera)
    return f"{caught.value.message} ({caught.value.hint})"


def _calibrated(owned, out: Path, shown: PictureSet, camera: str = "") -> calibration.Calibrated:
    cell: Cell = owned.cell
    asked = Asked(camera or owned.camera, board=owned.board)
    return calibration.calibrate_camera(cell, {"camera": shown}, asked, out)


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_named(owned, tmp_path, mistake):
    numbers, columns, word = MISTAKES[mistake]
    T = owned.base.T_base_flange
    written = numbers(Rotation.from_matrix(T[:, :3, :3]))
    said = refusal(owned, tmp_path, lambda: given(owned, tmp_path / "p.csv", T, written, columns))
    assert word in said
    assert "as well" not in said


def test_what_the_equations_do_not_tell_is_named_with_its_other(owned, tmp_path):
    """Poses of the base in the flange frame are those of the other set-up."""
    T = owned.base.T_base_flange
    other = {"fixed": "on-flange", "on-flange": "fixed"}[owned.camera]
    for poses, camera in ((inverse(T), ""), (T, other)):
        written = degrees("xyz")(Rotation.from_matrix(poses[:, :3, :3]))
        said = refusal(
            owned,
            tmp_path,
            lambda p=poses, w=written: given(owned, tmp_path / "p.csv", p, w, WPR),
            camera,
        )
        assert "those of the base in the flange frame" in said
        assert "as the equations do not tell it from that, the camera is" in said


@pytest.mark.parametrize(("scale", "word"), [(1.0, "if these are m"), (1e2, "are cm, not mm")])
def test_units_are_named(owned, tmp_path, scale, word):
    T = owned.base.T_base_flange
    written = degrees("xyz")(Rotation.from_matrix(T[:, :3, :3]))
    said = refusal(
        owned, tmp_path, lambda: given(owned, tmp_path / "p.csv", T, written, WPR, scale)
    )
    assert word in said


@pytest.mark.parametrize("order", ["ZYX", "ZYZ", "XYZ", "xyz"])
def test_what_nobody_says_is_told_by_the_pictures(owned, tmp_path, order):
    T = owned.base.T_base_flange
    rows = np.hstack([1e3 * T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_euler(order, True)])
    lines = [",".join(f"{value:.6f}" for value in row) for row in rows]
    (tmp_path / "p.csv").write_text("\n".join(["x,y,z,a,b,c", *lines]) + "\n")
    shown = read_picture_set(owned.folder / "pictures", tmp_path / "p.csv")
    notes = _calibrated(owned, tmp_path, shown).notes
    word = f"{order.lower()}-{'moving' if order.isupper() else 'fixed'}"
    assert any(f"does not say what its orientations are: {word}" in note for note in notes)
