"""Pictures of a board that a simulated arm with a simulated camera takes: ``simulate``."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from calib.errors import InputError
from calib.lens import Lens
from calib.model.measurements import TouchUp
from calib.se3 import FloatArray, inverse, rotation_from_wpr
from calib.vision.boards.picture import T_BOARD_PLATE, BoardPlate
from calib.vision.camera import Camera, render
from posedesign.cell import Cell
from posedesign.files import Results, folder_inside, write_bytes_atomic
from posedesign.files.csv_tables import write_table
from posedesign.files.postures import joint_columns
from posedesign.planning.poses_file import PoseList
from posedesign.simulation import SimulatedRobot
from posedesign.simulation.rehearsal import imaging_of

JOINTS = ("joints.csv", "joints of pictures")
"""Name of the table, and what it says that it is."""

PICTURES = "pictures"
"""Folder of the pictures."""


def simulate_pictures(
    cell: Cell,
    poses: PoseList,
    out: Path | Results,
    seed: int,
    advance: Callable[[str, float], None] = lambda what, part: None,
) -> list[Path]:
    """Take a picture at each pose with the arm and the camera of ``[truth]``.

    Camera and board are off by the errors of the cell's truth, and so is the arm: what it stops off
    is what its own errors do, and no noise is added to that. The table has the joints that the
    controller shows.

    Returns the pictures, in the order of the poses. Raises InputError: a lens that pictures are not
    drawn with.
    """
    results = Results.of(out, "simulate")
    (table,) = results.claim("simulated", JOINTS)
    folder = results.folder / PICTURES
    names = [f"{name}.png" for name in poses.measured.names]
    pictures = Results(folder, "simulate", results.inputs, results.overwrite, results.say)
    claims = pictures.claim("simulated", *((name, "picture") for name in names), bare=True)
    rng = np.random.default_rng(seed)
    q = poses.measured.postures
    seen = _seen_from(cell, q)
    camera, plate = _camera(cell), BoardPlate(cell.board_set_up.board)
    imaging = imaging_of(cell)
    folder_inside(folder)
    for k, (claim, T) in enumerate(zip(claims, seen, strict=True)):
        advance(claim.path.name, k / len(claims))
        picture = render(camera, [(plate, T @ T_BOARD_PLATE)], imaging, rng)
        data = io.BytesIO()
        Image.fromarray(picture).save(data, "PNG")
        write_bytes_atomic(claim, data.getvalue())
    columns = ["picture", *joint_columns(cell.robot.n, cell.robot.external)]
    rows = [
        dict(zip(columns, [name, *values], strict=True))
        for name, values in zip(names, cell.robot.shown(q).tolist(), strict=True)
    ]
    write_table(table, columns, rows)
    return [claim.path for claim in claims]


def _seen_from(cell: Cell, q: FloatArray) -> FloatArray:
    """Poses ``T_camera_board (N, 4, 4)`` as they really are."""
    truth, there = cell.config.truth, cell.board_set_up
    robot = SimulatedRobot.of(cell, TouchUp(1e-4))
    T_base_tip = robot.model.view(q, robot.values).T_base_tip
    X, Z = there.X.copy(), there.Z.copy()
    X[:3, 3] += np.array(truth.tool_error_mm) / 1e3
    X[:3, :3] = X[:3, :3] @ rotation_from_wpr(np.deg2rad(truth.camera_error_deg))
    Z[:3, 3] += np.array(truth.target_error_mm) / 1e3
    Z[:3, :3] = Z[:3, :3] @ rotation_from_wpr(np.deg2rad(truth.target_turn_deg))
    if there.carried == "camera":
        return np.asarray(inverse(T_base_tip @ X) @ Z)
    return np.asarray(inverse(Z) @ T_base_tip @ X)


def _camera(cell: Cell) -> Camera:
    """The lens of the cell, or of the truth where that has a distortion of its own."""
    lens: Lens = cell.board_set_up.lens
    if lens.name != "pinhole":
        raise InputError(
            f"pictures by a {lens.name} lens are not simulated",
            hint='set camera.lens = "pinhole" to rehearse',
            name="camera.lens",
        )
    fx, fy, cx, cy = lens.values[:4]
    k1, k2, p1, p2, k3 = lens.distortion
    own = cell.config.truth.imaging.distortion
    distortion = own if any(own) else (k1, k2, p1, p2, k3)
    return Camera(lens.width_px, lens.height_px, fx, fy, (cx, cy), distortion)
