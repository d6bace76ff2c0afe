"""The command that calibrates a camera from pictures of a board: camera."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from posedesign.cli.output import DONE, NOT_REACHED, progress, rehearsed_words, results_in, tell
from posedesign.cli.plan_commands import AsJson, CellFile, OutFolder, Overwrite, TrustUnits, Verbose
from posedesign.cli.robot_world_command import CameraPlace, listed

if TYPE_CHECKING:
    from calib.lens import Lens, LensName

PicturesArgument = Annotated[
    Path,
    typer.Argument(
        help="A folder of pictures of the board that [board] describes; of several cameras a "
        "folder each in it, with the same names for pictures of one stop."
    ),
]
JointsOption = Annotated[
    Path | None,
    typer.Option(
        "--joints",
        help="Joints of each picture (j1_deg ..), or poses of the flange (x_mm .. r_deg and other "
        "forms), by the column picture or in the order of the pictures; or a list for ROS or "
        "RoboDK.",
    ),
]
CameraOption = Annotated[
    CameraPlace | None,
    typer.Option(
        help="on-flange: eye-in-hand. fixed: eye-to-hand, the board on the flange. Default: as "
        "camera.mount of the cell says."
    ),
]
LensOption = Annotated[
    str,
    typer.Option(
        help="Estimate a pinhole (5 terms of distortion), rational (8) or fisheye lens; or a file "
        "of a lens that is known: camera.json, camera_info.yaml."
    ),
]
FreeOption = Annotated[
    str,
    typer.Option(
        "--free",
        help="What of the robot to identify with it, with commas: zero_offsets, geometry, "
        "compliance, priors.",
    ),
]
BoardErrorsOption = Annotated[
    str, typer.Option("--board-errors", help="Of the board: scale, bend_x, bend_y.")
]
PixelSigma = Annotated[
    float | None,
    typer.Option("--pixel-sigma", help="Noise of a point [px]; from the pictures by default."),
]
ArmMm = Annotated[
    float | None,
    typer.Option(
        "--arm-mm", help="How far the arm stops from where it says [mm]; from the pictures."
    ),
]
ArmDeg = Annotated[float | None, typer.Option("--arm-deg", help="The same of its turn [deg].")]
TargetOption = Annotated[
    Path | None,
    typer.Option(help="A target of Kalibr (YAML) in place of the board of the cell."),
]
OrderOption = Annotated[
    Literal["name", "time"],
    typer.Option(help="Order of the pictures: by name, or by the time that they were taken at."),
]
TransformsOption = Annotated[
    bool,
    typer.Option(
        "--transforms",
        help="Write camera, board and lens for other tools, too: ROS 2, URDF, easy_handeye2, "
        "OpenCV, camera_info.yaml.",
    ),
]


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command()(camera)


def camera(
    cell: CellFile,
    pictures: PicturesArgument,
    joints: JointsOption = None,
    camera: CameraOption = None,
    lens: LensOption = "pinhole",
    free: FreeOption = "",
    target: TargetOption = None,
    board_errors: BoardErrorsOption = "",
    pixel_sigma: PixelSigma = None,
    arm_mm: ArmMm = None,
    arm_deg: ArmDeg = None,
    order: OrderOption = "name",
    out: OutFolder = Path(),
    transforms: TransformsOption = False,
    as_json: AsJson = False,
    verbose: Verbose = False,
    trust_units: TrustUnits = False,
    overwrite: Overwrite = False,
) -> int:
    """Calibrate a camera from pictures of a board: its place, its lens, and the board's place.

    One estimate over all pixels, with standard deviations; pictures that contradict the others
    take no part, and what looks wrong is named.
    """
    from posedesign.cell import Cell
    from posedesign.hand_eye import Asked
    from posedesign.hand_eye.calibration import board_of, result_as_dict
    from posedesign.hand_eye.lens_files import kalibr_board
    from posedesign.hand_eye.pictures import cameras_in, read_picture_set
    from posedesign.report.hand_eye import answer_of_camera
    from posedesign.workflow import calibrate_from_pictures

    loaded = Cell.load(cell)
    board = board_of(loaded) if target is None else kalibr_board(target)  # said before all else
    asked = Asked(
        camera or ("fixed" if loaded.camera_stands else "on-flange"),
        lens_of(lens),
        tuple(listed(free)),
        tuple(listed(board_errors)),
        pixel_sigma,
        arm_sigma_of(arm_mm, arm_deg),
        board,
    )
    results = results_in(out, "camera", cell, joints, overwrite=overwrite)
    shown = {
        name: read_picture_set(folder, joints, loaded.robot, order=order, trust_units=trust_units)
        for name, folder in cameras_in(pictures).items()
    }
    with progress("calibrating the camera", with_time_left=True) as advance:
        found, files = calibrate_from_pictures(
            loaded, shown, asked, results, advance, transforms=transforms
        )
    tell(
        answer_of_camera(found, [str(path) for path in files]),
        verbose=verbose,
        first=rehearsed_words(joints),
        content=result_as_dict(found) if as_json else None,
    )
    return DONE if found.result.is_ok else NOT_REACHED


def lens_of(text: str) -> LensName | Lens:
    """The model of a lens by its name, or the lens of a file."""
    from calib.errors import InputError, near_names
    from calib.lens import DISTORTION
    from posedesign.hand_eye.lens_files import read_lens

    name: LensName
    for name in ("pinhole", "rational", "fisheye"):
        if text == name:
            return name
    if not Path(text).exists() and "." not in text:
        raise InputError(
            f"--lens {text}: there is no such lens, and no such file",
            hint=near_names(text, tuple(DISTORTION)),
            name="lens",
        )
    return read_lens(Path(text))


def arm_sigma_of(mm: float | None, deg: float | None) -> tuple[float, float] | None:
    """How far the arm stops from where it says [m, rad], if both are given."""
    from calib.errors import InputError

    if mm is None and deg is None:
        return None
    if mm is None or deg is None or not (mm >= 0 and deg >= 0):
        raise InputError(
            "give both --arm-mm and --arm-deg, not below zero, or neither",
            hint="without them both are found from the pictures",
            name="arm",
        )
    return mm / 1e3, math.radians(deg)
