"""Cells that take pictures of a board, and what a camera sees of it in a few lines of our own."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from calib.hand_eye import Pictures, calibrate
from calib.lens import LINEAR
from calib.se3 import inverse, rotation_exp, rotation_log, transform
from posedesign.cell import Cell, cell_template
from posedesign.cell.file import parse_config

COLUMNS, ROWS = 8, 6
FACING = np.diag([1.0, -1.0, -1.0])


def board_cell(
    preset: str | None = None,
    *,
    square_mm: float = 15.0,
    surroundings: bool = False,
    fixed: bool = False,
    kind: str = "charuco",
    **sections: dict[str, Any],
) -> Cell:
    """A cell of the template with a board of 8 x 6 squares, and changes section by section."""
    raw = tomllib.loads(cell_template(preset, surroundings=surroundings))
    raw["measurement"]["kind"] = "board"
    raw["pool"]["candidates"] = 200
    raw["board"] = {"kind": kind, "columns": COLUMNS, "rows": ROWS, "square_mm": square_mm}
    if kind == "charuco":
        raw["board"] |= {"marker_mm": 0.7 * square_mm, "dictionary": "DICT_5X5_100"}
    raw.setdefault("camera", {}).setdefault("farthest_mm", 700.0)
    if fixed:
        raw["camera"]["mount"] = "fixed"
    if kind == "round-target":
        raw["board"] = {"kind": kind, "diameter_mm": ROWS * square_mm}
    for name, section in sections.items():
        raw.setdefault(name, {}).update(section)
    return Cell.from_config(parse_config(raw, Path("cell.toml")), Path("cell.toml"))


def true_frames(cell: Cell) -> tuple[np.ndarray, np.ndarray]:
    """X and Z of a cell of the template, from its sections and not by the code under test.

    The camera has the axes of the tip, or those of the board on the flange, which faces along z of
    the tip, and looks from the stand-off at the middle of the board.
    """
    config = cell.config
    square, away = (config.board.square_mm or 0.0) / 1e3, config.tool.camera_stand_off_mm / 1e3
    tool = np.array(config.tool.point_mm) / 1e3
    corner = -0.5 * square * np.array([COLUMNS, ROWS, 0.0])  # from the middle, in board axes
    if config.board.kind == "chessboard":
        corner += square * np.array([1.0, 1.0, 0.0])
    T = cell.robot.fk(cell.base_posture)
    target = T[:3, :3] @ tool + T[:3, 3]
    if config.camera.mount == "flange":
        X = transform(np.eye(3), tool - [0.0, 0.0, away])
        return X, transform(T[:3, :3], target + T[:3, :3] @ corner)
    X = transform(FACING, tool + FACING @ corner)
    return X, transform(T[:3, :3] @ FACING, target + away * T[:3, 2])


def seen(cell: Cell, T_base_tip: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points of the board (K, 3) in the frame of the camera (N, K, 3)."""
    X, Z = true_frames(cell)
    if cell.config.camera.mount == "flange":
        T = inverse(T_base_tip @ X) @ Z
    else:
        T = inverse(Z) @ T_base_tip @ X
    return points @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]


def pixels_of(cell: Cell, in_camera: np.ndarray) -> np.ndarray:
    """Pixels of points, without distortion."""
    camera = cell.config.camera
    middle = np.array(camera.image_px) / 2.0
    return camera.focal_px * in_camera[..., :2] / in_camera[..., 2:] + middle


def inside(cell: Cell, in_camera: np.ndarray) -> np.ndarray:
    """Whether points are in the image less its border."""
    camera = cell.config.camera
    pixels, size = pixels_of(cell, in_camera), np.array(camera.image_px)
    there = (pixels >= camera.border_px) & (pixels <= size - camera.border_px)
    return there.all(axis=-1) & (in_camera[..., 2] > 0.0)


def take_pictures(cell: Cell, q: np.ndarray, rng: np.random.Generator) -> Pictures:
    """What is found in pictures at postures, the arm off and the pixels noisy as the cell says."""
    section, points = cell.config.measurement, cell.board.points
    T = cell.robot.fk(q)
    shift, turn = rng.standard_normal((2, len(q), 3))
    T[:, :3, 3] += section.arm_three_sigma_mm / 3e3 * shift
    T[:, :3, :3] = rotation_exp(np.deg2rad(section.arm_three_sigma_deg) / 3.0 * turn) @ T[:, :3, :3]
    there = seen(cell, T, points)
    pixels = pixels_of(cell, there)
    pixels += section.board_three_sigma_px / 3.0 * rng.standard_normal(pixels.shape)
    pixels[~inside(cell, there)] = np.nan
    carried = "camera" if cell.config.camera.mount == "flange" else "board"
    return Pictures(cell.robot, q, pixels, points, cell.config.camera.image_px, carried)


def calibration_errors(
    cell: Cell, q: np.ndarray, trials: int, rng: np.random.Generator
) -> np.ndarray:
    """Errors (T, p) of X, Z and the lens, in the order of the model, of simulated calibrations."""
    section, lens = cell.config.measurement, cell.board_set_up.lens
    arm = section.arm_three_sigma_mm / 3e3, np.deg2rad(section.arm_three_sigma_deg) / 3.0
    errors = []
    for _ in range(trials):
        found = calibrate(
            take_pictures(cell, q, rng),
            "pinhole" if cell.estimates_lens else lens,
            sigma_px=section.board_three_sigma_px / 3.0,
            arm_sigma=arm,
        )
        row: list[float] = []
        for T, true in zip((found.X, found.Z), true_frames(cell), strict=True):
            row += [*(T[:3, 3] - true[:3, 3]), *rotation_log(true[:3, :3].T @ T[:3, :3])]
        if cell.estimates_lens:
            focal = cell.config.camera.focal_px
            linear = [focal, focal, *(np.array(cell.config.camera.image_px) / 2.0)]
            row += [*(np.array(found.lens.values) - [*linear, *[0.0] * 5])]
            assert len(linear) == len(LINEAR)
        errors.append(row)
    return np.array(errors)


def check_constraints(cell: Cell, q: np.ndarray) -> None:
    """Check distance, tilt, share in view, joint limits, and what stands in between."""
    camera, board = cell.config.camera, cell.board
    T = cell.robot.fk(q)
    left, top, right, bottom = board.box
    corners = np.array([[x, y, 0.0] for x in (left, right) for y in (top, bottom)])
    rim = np.vstack([corners, corners.mean(axis=0)])
    there = seen(cell, T, rim)
    away = 1e3 * np.linalg.norm(there, axis=2)
    assert (away >= camera.nearest_mm - 1e-6).all()
    assert (away <= camera.farthest_mm + 1e-6).all()
    normal = np.cross(there[:, 2] - there[:, 0], there[:, 1] - there[:, 0])  # into the board
    cosine = np.einsum("nk,nk->n", normal, there[:, 4])
    cosine /= np.linalg.norm(normal, axis=1) * np.linalg.norm(there[:, 4], axis=1)
    tilt = np.rad2deg(np.arccos(np.minimum(cosine, 1.0)))  # rounding at no tilt
    assert (tilt <= camera.largest_tilt_deg + 1e-6).all()
    share = inside(cell, seen(cell, T, board.points)).mean(axis=1)
    whole = cell.config.board.kind != "charuco"
    assert (share >= (1.0 if whole else camera.share_in_view)).all()
    robot, margin = cell.robot, np.deg2rad(cell.config.plan.limit_margin_deg)
    assert (q >= robot.lower + margin - 1e-9).all()
    assert (q <= robot.upper - margin + 1e-9).all()
    T_base_camera = T @ true_frames(cell)[0]
    if camera.mount == "fixed":
        T_base_camera = np.broadcast_to(true_frames(cell)[1], T.shape)
    part = np.linspace(0.01, 0.97, 200)[:, None, None, None]
    R, lens = T_base_camera[:, :3, :3], T_base_camera[:, None, :3, 3]
    lines = part * (there @ np.swapaxes(R, 1, 2)) + lens
    for body in cell.config.obstacle:
        off = np.abs(1e3 * lines - np.array(body.at_mm))
        if body.kind == "box":
            assert not (off < np.array(body.size_mm) / 2.0).all(axis=-1).any()
        elif body.kind == "sphere":
            assert (np.linalg.norm(1e3 * lines - body.at_mm, axis=-1) >= body.radius_mm).all()
        else:  # the floor
            assert (1e3 * lines[..., 2] > body.at_mm[2]).all()
