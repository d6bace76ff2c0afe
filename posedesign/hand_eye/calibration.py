"""The steps of the command ``camera``: pictures and poses in, camera, lens and tables out.

Columns of ``camera_points.csv``:

======================  =========================================================================
``picture``             name of the picture
``point``               number of the point of the board, from 0: as ``Board.points`` has them
``x_px``, ``y_px``      where it is, from the left upper corner of the image
``residual_x_px``       by how much the result shows it elsewhere; empty for what was not used
``residual_y_px``       the same down the image
======================  =========================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calib.errors import FileFormatError, InputError
from calib.hand_eye import ArmErrors, HandEyeResult, Pictures, PlacedFrame, calibrate
from calib.hand_eye.start import FEWEST_POINTS, board_poses, start_lens
from calib.identification import DISPLAY
from calib.lens import Lens, LensName
from calib.model.context import reading_label
from calib.model.measurements.board_view import Carried
from calib.robots import (
    NO_EXTERNAL_AXES,
    ExternalAxes,
    flange_robot,
    posture_of_pose,
    shown_of,
)
from calib.se3 import (
    FloatArray,
    check_transforms,
    inverse,
    quaternion_from_rotation,
    wpr_from_rotation,
)
from calib.vision.boards import Board, BoardSighting, detect_board
from calib.vision.camera.rendering import GreyImage
from posedesign.cell import Cell
from posedesign.cell.data import CameraFound
from posedesign.cell.models import everything, robot_blocks
from posedesign.cell.reference import USUAL_SIZES
from posedesign.files import Claim, Results, write_json_atomic
from posedesign.files.csv_tables import write_table
from posedesign.files.pictures import read_grey, small_picture
from posedesign.files.postures import external_as_dict
from posedesign.files.trees import number, numbers, read_tree
from posedesign.hand_eye.lens_files import read_lens
from posedesign.hand_eye.pairs.certificate import Camera
from posedesign.hand_eye.pairs.forms import Poses
from posedesign.hand_eye.pairs.readings import FEWEST_PAIRS, Sides, misfit_of, told
from posedesign.hand_eye.pictures import PictureSet

Advance = Callable[[str, float], None]
Look = Callable[[str, "Sightings"], None]
"""Is told what the pictures of a camera show."""


@dataclass(frozen=True, eq=False)
class Sightings:
    """What N pictures show of a board of K points."""

    pixels: FloatArray
    """(N, K, 2): from the left upper corner of the image; NaN where a point is not seen."""
    reasons: tuple[str, ...]  # why a picture shows none of them; empty where it shows some
    thumbnails: tuple[GreyImage, ...] = ()  # the pictures, small

    @property
    def shown(self) -> int:
        """Pictures that show the board."""
        return sum(not reason for reason in self.reasons)


def find_boards(
    paths: Sequence[Path], board: Board, advance: Advance = lambda what, part: None
) -> Sightings:
    """Find a board in pictures, one at a time.

    Raises FileFormatError: a picture that cannot be read.
    """
    found: list[BoardSighting] = []
    thumbnails: list[GreyImage] = []
    for k, path in enumerate(paths):
        advance(path.name, k / max(len(paths), 1))
        picture = read_grey(path)
        found.append(detect_board(picture, board))
        thumbnails.append(small_picture(picture))
    pixels = np.array([one.pixels for one in found]).reshape(len(paths), len(board.points), 2)
    reasons = ["" if one.is_ok else f"{one.status}: {one.message}" for one in found]
    return Sightings(pixels, tuple(reasons), tuple(thumbnails))


CAMERA_FILES = (
    ("camera.json", "calibrated camera"),
    ("camera_pictures.csv", "pictures of a calibrated camera"),
    ("camera_points.csv", "points of the board in pictures"),
)
"""Names of the files, and what they say that they are."""

_DETECTING = 0.9
"""Part of the work that finding the board is."""


@dataclass(frozen=True)
class Asked:
    """What is to be estimated, and what is known."""

    camera: Camera = "on-flange"  # eye-in-hand, or eye-to-hand with the board on the flange
    lens: LensName | Lens = "pinhole"  # model of a lens that is estimated, or one that is known
    free: tuple[str, ...] = ()
    """Words of what of the robot is estimated, too, such as ``zero_offsets``."""
    board_errors: tuple[str, ...] = ()  # of ``scale``, ``bend_x``, ``bend_y``
    pixel_sigma: float | None = None
    """Noise of a coordinate of a point [px]; from the pictures by default."""
    arm_sigma: tuple[float, float] | None = None
    """How far the arm stops from where it says [m, rad]; likewise."""
    board: Board | None = None  # in place of the one that the cell describes


@dataclass(frozen=True, eq=False)
class Calibrated:
    """The result with what is to be said of its files."""

    result: HandEyeResult
    asked: Asked
    board: Board
    reasons: tuple[str, ...]  # why a picture does not show the board; empty where it does
    pixels: FloatArray
    """(N, K, 2): points of all pictures, also of those that were not used; NaN where not seen."""
    T_base_flange: FloatArray
    """(N, 4, 4): pose of the flange by the arm, as its controller has it [m]; NaN where not known.
    """
    postures: FloatArray  # (N, n): of each picture [rad]; NaN where it is not known
    with_joints: bool  # whether they are joint values, and not poses of the flange
    notes: tuple[str, ...] = ()  # what is odd about the files
    external: ExternalAxes = NO_EXTERNAL_AXES  # what the first joints are


def arm_of(cell: Cell) -> ArmErrors:
    """Return what may be off on the arm of a cell, with the sizes that arms were found to have."""
    return ArmErrors(robot_blocks(cell, everything(cell)), USUAL_SIZES)


def board_of(cell: Cell) -> Board:
    """The calibration board of a cell; InputError where it describes none."""
    if cell.board is None:
        raise InputError(
            "the cell describes no calibration board",
            hint="add a section [board]; posedesign new shows one",
            name="board",
        )
    return cell.board


def calibrate_camera(
    cell: Cell,
    pictures: Mapping[str, PictureSet],
    asked: Asked,
    out: Path | Results,
    advance: Advance = lambda what, part: None,
    look: Look = lambda camera, found: None,
) -> Calibrated:
    """Find the board, estimate, and write ``camera.json`` and the tables beside it.

    ``pictures``: by the name of the camera; ``camera`` where there is one. ``look`` is called with
    what the pictures of each camera show, before the estimate. Raises InputError: no
    poses, no board in the pictures, or nothing that fits them. NotIdentifiableError: the motion, or
    the views, do not tell what is asked for.
    """
    board = asked.board or board_of(cell)
    claims = Results.of(out, "camera").claim("computed", *CAMERA_FILES)
    sets, reasons, notes = [], list[str](), list[str]()
    count = sum(len(one.paths) for one in pictures.values())
    for camera, shown in pictures.items():
        _check_poses(cell, shown, asked)
        part = _part(advance, len(reasons) / count, len(shown.paths) / count)
        found = find_boards(shown.paths, board, part)
        look(camera, found)
        if not found.shown:
            raise InputError(
                f"none of {len(shown.paths)} pictures shows the board: {shown.names[0]}: "
                f"{found.reasons[0]}",
                hint=f"it is described as: {board.words}",
                name="pictures",
            )
        read = _by_convention(shown, board, found.pixels, asked)
        notes += read.notes
        sets.append(_seen(cell, read, board, found.pixels, asked, camera))
        reasons += found.reasons
    advance("camera, board and lens", _DETECTING)
    with_joints = all(shown.postures is not None for shown in pictures.values())
    result = calibrate(
        sets,
        asked.lens,
        free=robot_blocks(cell, asked.free) if asked.free else (),
        sigma_px=asked.pixel_sigma,
        arm_sigma=asked.arm_sigma,
        board_errors=asked.board_errors,
        # what the pictures are asked to free is all that may be off then
        arm=None if asked.free or not with_joints else arm_of(cell),
    )
    calibrated = Calibrated(
        result,
        asked,
        board,
        tuple(reasons),
        # pictures that were used have their points in the order of the board
        np.where(
            np.isfinite(result.pixels), result.pixels, np.concatenate([one.pixels for one in sets])
        ),
        np.concatenate([_flange_poses(one) for one in sets]),
        np.concatenate([one.postures for one in sets]),
        with_joints,
        tuple(dict.fromkeys(notes)),
        cell.robot.external,
    )
    _write(calibrated, claims)
    return calibrated


def _flange_poses(pictures: Pictures) -> FloatArray:
    """Poses of the flange ``(N, 4, 4)`` [m]; NaN where the posture is not known."""
    T = np.full((len(pictures.postures), 4, 4), np.nan)
    known = np.isfinite(pictures.postures).all(axis=1)
    T[known] = pictures.robot.fk(pictures.postures[known])
    return T


def as_calibrated(cell: Cell, path: Path) -> tuple[Cell, FloatArray]:
    """A cell with the camera of a ``camera.json``, and the postures ``(N, n)`` of its pictures.

    Camera, board and lens are where they were found, and points and arm scatter as they did.

    Raises FileFormatError: the file has no joints, several cameras, or is none of this kind.
    """
    tree = read_tree(path)
    found = tree if isinstance(tree, dict) else {}
    fixed = found.get("camera") == "fixed"
    names = ("T_flange_board", "T_base_camera") if fixed else ("T_flange_camera", "T_base_board")
    frames = [found.get(name) for name in names]
    X, Z = (numbers(f.get("matrix_m"), 4, 4) if isinstance(f, dict) else None for f in frames)
    keys, noise = ("pixel_sigma", "arm_sigma_mm", "arm_sigma_deg"), found.get("noise")
    scatter = [number(noise.get(key)) if isinstance(noise, dict) else np.nan for key in keys]
    joints = found.get("joints_deg")
    rows = list(joints.values()) if isinstance(joints, dict) else []
    taken = numbers(rows, len(rows), cell.robot.n) if rows else None
    if X is None or Z is None or taken is None or not np.isfinite(scatter).all():
        raise FileFormatError(
            "does not have one camera, its noise and the joints of its pictures",
            path=path,
            hint="give a camera.json that was made of one camera and a table of joints of this arm",
        )
    pixel, arm_mm, arm_deg = (3.0 * max(value, 0.0) for value in scatter)
    three = {"arm_three_sigma_mm": arm_mm, "arm_three_sigma_deg": arm_deg}
    config = cell.config.changed(measurement={"board_three_sigma_px": max(pixel, 1e-3), **three})
    carried: Carried = "board" if fixed else "camera"
    camera = CameraFound(
        read_lens(path), carried, check_transforms(X, names[0]), check_transforms(Z, names[1])
    )
    return replace(cell, config=config, camera_found=camera), cell.robot.of_shown(taken)


def _part(advance: Advance, before: float, share: float) -> Advance:
    """Progress of a part of the pictures."""
    return lambda what, part: advance(what, _DETECTING * (before + share * part))


def _check_poses(cell: Cell, shown: PictureSet, asked: Asked) -> None:
    if cell.robot.floor and asked.camera != "on-flange":
        raise InputError(
            f"a camera that stands around the arm does not turn with {cell.robot.base_frame}, "
            "which a positioner carries",
            hint="name a link on the floor as robot.base",
            name="camera",
        )
    if cell.robot.floor and shown.postures is None:
        raise InputError(
            f"poses of the flange do not say how {cell.robot.base_frame} stands, which a "
            "positioner carries",
            hint="give the joints of each picture, those of the positioner among them",
            name="joints",
        )
    if shown.postures is None and shown.T_base_flange is None:
        raise InputError(
            "the pictures have no joints and no poses of the flange",
            hint="give `joints`: a table with the name of each picture in the column picture, and "
            "j1_deg j2_deg .. of the arm, or x_mm y_mm z_mm w_deg p_deg r_deg of its flange; "
            "without a cell `poses` of the flange, also a folder with a file for each picture",
            name="joints",
        )
    if shown.postures is None and asked.free:
        raise InputError(
            "poses of the flange say nothing of the joints: the robot cannot be identified",
            hint="give the joints of each picture",
            name="joints",
        )


def _by_convention(shown: PictureSet, board: Board, pixels: FloatArray, asked: Asked) -> PictureSet:
    """Pictures with the poses of the flange by the convention that they were written in.

    Raises InputError: the pictures do not fit them by the convention that was said, and do by
    another one; or nobody said it, and the pictures do not tell it.
    """
    poses, rows, placed = shown.written, shown.written_rows, shown.T_base_flange
    if poses is None or rows is None or placed is None:
        return shown
    seen = np.isfinite(pixels).all(axis=-1).sum(axis=1) >= FEWEST_POINTS
    usable = np.flatnonzero(seen & (rows >= 0))
    if len(usable) < FEWEST_PAIRS or board.ambiguous_half_turn:
        if not poses.is_said:
            raise InputError(
                f"{poses.place.path} does not say what its orientations are, and these pictures "
                "do not tell it",
                hint="say it with `poses_are`, say kuka-abc or quaternion-xyzw",
                name="poses_are",
            )
        return shown
    lens = asked.lens
    if not isinstance(lens, Lens):
        lens = start_lens(lens, shown.size_px, board.points, pixels[seen])
    T_camera_board, good = board_poses(lens, board.points, pixels[usable])
    usable, T_camera_board = usable[good], T_camera_board[good]
    in_hand = asked.camera == "on-flange"
    B = inverse(T_camera_board) if in_hand else T_camera_board
    flange = poses.some(rows[usable])
    seen_poses = Poses(B, flange.place, (), (), "", np.zeros((len(B), 0)))
    sides = _SIDES[asked.camera]
    flange, _ = told(flange, seen_poses, lambda A, B: (A, B), sides)
    misfit = misfit_of(flange, seen_poses, lambda A, B: (A, B), sides)
    if misfit is not None and misfit.explained:
        raise InputError(misfit.text, name="poses_are")
    if poses.is_said:
        return shown
    whole = poses.turned(flange.turn)
    T = np.where((rows >= 0)[:, None, None], whole[rows], np.nan)
    new = [note for note in flange.notes if note not in poses.notes]
    return replace(shown, T_base_flange=T, notes=(*shown.notes, *new))


def _sides(other: str, word: Camera) -> Sides:
    return Sides(
        "the pictures and the poses of the flange",
        "the poses",
        "the pictures",
        "if the poses are those of the base in the flange frame (`poses_are` .. inverse), or, as "
        f"the equations do not tell it from that, the camera is {other} (`camera` {word})",
    )


_SIDES: Mapping[Camera, Sides] = {
    "on-flange": _sides("fixed and the board on the flange (eye-to-hand)", "fixed"),
    "fixed": _sides("on the flange and the board stands still (eye-in-hand)", "on-flange"),
}
"""Names of the poses of the flange and of the pictures, by where the camera is."""


def _seen(
    cell: Cell, shown: PictureSet, board: Board, pixels: FloatArray, asked: Asked, camera: str
) -> Pictures:
    """What the estimate takes: joints of the arm of the cell, or poses of its flange alone."""
    if shown.postures is not None:
        robot, postures = cell.robot, shown.postures
    else:
        T = shown.T_base_flange
        robot, postures = flange_robot(), np.full((len(shown.names), 6), np.nan)
        if T is not None:
            known = np.isfinite(T).all(axis=(1, 2))
            postures[known] = posture_of_pose(T[known])
    return Pictures(
        robot,
        postures,
        pixels,
        board.points,
        shown.size_px,
        "camera" if asked.camera == "on-flange" else "board",
        shown.names,
        board.ambiguous_half_turn,
        camera,
        motion=shown.motion,
    )


def _write(calibrated: Calibrated, claims: Sequence[Claim]) -> None:
    camera, each, points = claims
    result, pixels = calibrated.result, calibrated.pixels
    write_json_atomic(camera, result_as_dict(calibrated))
    rows = picture_rows(calibrated)
    write_table(each, list(rows[0]), rows)
    seen = np.argwhere(np.isfinite(pixels).all(axis=-1)).tolist()
    left = result.residuals_px
    write_table(
        points,
        ["picture", "point", "x_px", "y_px", "residual_x_px", "residual_y_px"],
        [
            {
                "picture": result.names[i],
                "point": k,
                "x_px": round(float(pixels[i, k, 0]), 4),
                "y_px": round(float(pixels[i, k, 1]), 4),
                "residual_x_px": _or_none(left[i, k, 0]),
                "residual_y_px": _or_none(left[i, k, 1]),
            }
            for i, k in seen
        ],
    )


OFF_AXES = tuple(
    f"off_{turn}{axis}_{unit}" for turn, unit in (("", "mm"), ("r", "deg")) for axis in "xyz"
)
"""Columns of the deviation of each picture along and about the axes of the base."""


def picture_rows(calibrated: Calibrated) -> list[dict[str, object]]:
    """One row a picture: what it shows, how well that fits, and why it was left out.

    The deviation is of the board: where the camera sees its middle, less where the arm has it.
    """
    result = calibrated.result
    # an arm with the camera that stands farther to the left sees the board farther to the right
    side = 1.0 if result.carried == "board" else -1.0
    off = side * result.off * np.repeat([1e3, np.rad2deg(1.0)], 3)
    points = np.isfinite(calibrated.pixels).all(axis=-1).sum(axis=1)
    rows = []
    for row, reason, count, each in zip(
        result.rows(), calibrated.reasons, points.tolist(), off.tolist(), strict=True
    ):
        first = {"picture": row["picture"], "status": row["status"], "reason": reason}
        rows.append(first | {"points": count} | row | dict(zip(OFF_AXES, each, strict=True)))
    return rows


def _or_none(value: float) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None


def result_as_dict(calibrated: Calibrated) -> dict[str, Any]:
    """The result for ``camera.json``: millimetres, degrees, pixels."""
    result = calibrated.result
    lenses = {name: lens_as_dict(result, name) for name in result.lenses}
    factor = np.array([DISPLAY[unit][1] for unit in result.estimate.units])
    shown = shown_of(calibrated.postures.shape[1], calibrated.external)
    joints = {
        name: (shown * posture).tolist()
        for name, posture, used in zip(result.names, calibrated.postures, result.used, strict=True)
        if used and calibrated.with_joints
    }
    offsets = {
        camera: {"value": 1e3 * value, "sigma": 1e3 * sigma}
        for camera, (value, sigma) in result.time_offsets_s.items()
    }
    return {
        "camera": calibrated.asked.camera,
        "board": calibrated.board.words,
        "board_box_mm": (1e3 * calibrated.board.box).tolist(),
        "ok": result.is_ok,
        "warnings": list(result.warnings),
        **{frame.name: frame_as_dict(frame) for frame in result.frames},
        **({"lens": next(iter(lenses.values()))} if len(lenses) == 1 else {"lenses": lenses}),
        "noise": {
            "pixel_sigma": result.sigma_px,
            **({} if len(lenses) == 1 else {"pixel_sigma_of": result.sigmas_px}),
            "arm_sigma_mm": 1e3 * result.arm_sigma[0],
            "arm_sigma_deg": float(np.degrees(result.arm_sigma[1])),
        },
        **({"time_offset_ms": offsets} if offsets else {}),
        "point_sigma_mm": 1e3 * result.point_sigma_m,
        "seen_sigma_mm": 1e3 * result.seen_sigma_m,
        "distance_mm": 1e3 * result.distance_m,
        "board_scale": {"value": result.scale[0], "sigma": result.scale[1]},
        **({"arm_errors": _arm_errors_as_dict(result)} if result.arm_errors else {}),
        "parameters": parameter_rows(result),
        "covariance": {
            "names": list(result.estimate.names),
            "units": [DISPLAY[unit][0] for unit in result.estimate.units],
            "matrix": (result.estimate.covariance * np.outer(factor, factor)).tolist(),
        },
        "pictures": picture_rows(calibrated),
        "flange_poses": {
            name: T.tolist()
            for name, T in zip(result.names, calibrated.T_base_flange, strict=True)
            if np.isfinite(T).all()
        },
        **({"joints_deg": joints} if joints else {}),
        **(external_as_dict(calibrated.external) if joints else {}),
    }


def _arm_errors_as_dict(result: HandEyeResult) -> dict[str, Any]:
    """Errors of the arm that were found, and what holds for an arm that is corrected by them."""
    return {
        "rms_mm": {error.kind: 1e3 * error.rms_m for error in result.arm_errors},
        "corrected": {
            **{frame.name: frame_as_dict(frame) for frame in result.true_frames},
            "point_sigma_mm": 1e3 * result.corrected_point_sigma_m,
        },
    }


def parameter_rows(result: HandEyeResult) -> list[dict[str, Any]]:
    """Parameters as people read them; cx and cy as OpenCV and ROS count them."""
    rows = []
    for row in result.estimate.displayed():
        is_center = row.name.startswith("lens") and row.name.endswith((".cx", ".cy"))
        value = row.value - 0.5 if is_center else row.value
        rows.append({"parameter": row.name, "value": value, "sigma": row.sigma, "unit": row.unit})
    return rows


def frame_as_dict(frame: PlacedFrame) -> dict[str, Any]:
    """A transform in the forms that people and programs take, with standard deviations."""
    T = frame.T
    return {
        "xyz_mm": (1e3 * T[:3, 3]).tolist(),
        "wpr_deg": np.degrees(wpr_from_rotation(T[:3, :3])).tolist(),
        "sigma_xyz_mm": (1e3 * frame.sigma_m).tolist(),
        "sigma_rotation_deg": np.degrees(frame.sigma_rad).tolist(),
        "quaternion_wxyz": quaternion_from_rotation(T[:3, :3]).tolist(),
        "matrix_m": T.tolist(),
    }


def lens_as_dict(result: HandEyeResult, camera: str) -> dict[str, Any]:
    """The lens, by the convention of OpenCV and ROS: pixels count from the middle of the first."""
    lens = result.lenses[camera]
    K, distortion = lens.to_opencv()
    sigma = dict(zip(result.estimate.names, result.estimate.sigma.tolist(), strict=True))
    stem = reading_label("lens", camera, "camera")
    return {
        "model": lens.name,
        "estimated": f"{stem}.fx" in sigma,
        "width_px": lens.width_px,
        "height_px": lens.height_px,
        "fx": K[0, 0],
        "fy": K[1, 1],
        "cx": K[0, 2],
        "cy": K[1, 2],
        "distortion": dict(zip(lens.names[4:], distortion.tolist(), strict=True)),
        "sigma": {name: sigma.get(f"{stem}.{name}") for name in lens.names},
    }
