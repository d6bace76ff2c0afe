"""What a calibration from pictures answers: where the camera is, how well, what looks wrong."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from calib.se3 import FloatArray, wpr_from_rotation
from posedesign.files import LEAST_POSITIVE, plain
from posedesign.hand_eye.calibration import (
    OFF_AXES,
    lens_as_dict,
    parameter_rows,
    picture_rows,
    result_as_dict,
)
from posedesign.hand_eye.pairs.transforms import FrameNames, forms_of
from posedesign.report import figures
from posedesign.report.answer import Answer, Table
from posedesign.report.drawing import BLUE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from calib.hand_eye import HandEyeResult
    from posedesign.hand_eye import Calibrated

LONG_ARROW = 0.06
"""Length of the longest residual in a figure, in parts of the picture's width."""

SIGNIFICANT = 4.0
"""Standard deviations from which on pictures were taken at another moment than joints were read."""


def answer_of_camera(
    calibrated: Calibrated, files: Sequence[str] = (), names: FrameNames | None = None
) -> Answer:
    """The answer: where cameras and boards are, how surely, the lens, what does not fit.

    ``names``: of the frames, for the forms of other programs.
    """
    called = (names or FrameNames()).of
    result = calibrated.result
    used, every = int(result.used.sum()), len(result.names)
    shown: dict[str, str] = {}
    for frame in result.frames:
        place, turn = 1e3 * frame.sigma_m.max(), np.degrees(frame.sigma_rad).max()
        shown[frame.name] = f"{_six(frame.T)}, sigma {place:.2g} mm and {turn:.2g} deg"
    shown["a point that the camera sees"] = (
        f"the arm is {1e3 * result.point_sigma_m:.2g} mm off it (rms), the camera alone "
        f"{1e3 * result.seen_sigma_m:.2g} mm, at {1e3 * result.distance_m:.0f} mm"
    )
    shown["robot"] = _robot(result)
    for camera in result.lenses:
        name = "lens" if len(result.lenses) == 1 else f"lens of {camera}"
        shown[name] = _lens(lens_as_dict(result, camera))
    pixels = ", ".join(f"{sigma:.2g}" for sigma in result.sigmas_px.values())
    shown["left over"] = (
        f"{_rms(result.rms_px, result.used):.3g} px rms, of pictures left out "
        f"{_rms(result.left_out_px, result.used):.3g} px; points scatter by {pixels} "
        f"px, the arm by {1e3 * result.arm_sigma[0]:.2g} mm and "
        f"{np.degrees(result.arm_sigma[1]):.2g} deg"
    )
    for camera, (value, sigma) in result.time_offsets_s.items():
        name = "time" if len(result.lenses) == 1 else f"time of {camera}"
        way = "after" if value > 0 else "before"
        shown[name] = (
            f"pictures were taken {1e3 * abs(value):.3g} +- {1e3 * sigma:.2g} ms {way} the joints "
            "were read; that is taken into account"
            if abs(value) > SIGNIFICANT * sigma
            else f"pictures and joints are of the same moment, to {1e3 * sigma:.2g} ms"
        )
    unseen = [
        f"{name}: {reason}"
        for name, reason in zip(result.names, calibrated.reasons, strict=True)
        if reason
    ]
    state = "calibrated" if result.is_ok else "not to be trusted"
    return Answer(
        f"{state}: camera and board from {used} of {every} pictures{_with_arm(result)}",
        shown,
        warnings=result.warnings,
        notes=[*calibrated.notes, *unseen],
        details=[
            f"{frame.name}, {form}: {text}"
            for frame in result.frames
            for form, text in forms_of(frame.T, called(frame.parent), called(frame.label)).items()
        ],
        tables=[
            Table("Parameters", parameter_rows(result)),
            Table("Pictures", _printed(calibrated)),
        ],
        files=files,
    )


def _printed(calibrated: Calibrated) -> list[dict[str, object]]:
    """Rows of pictures without the columns that are drawn, and reasons, which are notes."""
    passed = {"reason", *OFF_AXES}
    return [{k: row[k] for k in row if k not in passed} for row in picture_rows(calibrated)]


def _with_arm(result: HandEyeResult) -> str:
    """Errors of the arm in a few words for the verdict."""
    if not result.arm_errors:
        return ""
    largest = max(np.degrees(abs(value)) for value in [0.0, *_offsets(result).values()])
    return f", with joints up to {largest:.2g} deg off" if largest else ", with errors of the arm"


def _offsets(result: HandEyeResult) -> dict[str, float]:
    """Zero offsets by joint [rad], those that are surely there."""
    estimate = result.estimate
    rows = zip(estimate.names, estimate.values, estimate.sigma, strict=True)
    return {
        name.removeprefix(_OFFSET): float(value)
        for name, value, sigma in rows
        if name.startswith(_OFFSET) and abs(value) > _SURELY * sigma
    }


def _robot(result: HandEyeResult) -> str:
    """Errors of the arm that were found; empty where there are none."""
    if not result.arm_errors:
        count = sum(not name.startswith(_OF_SET_UP) for name in result.estimate.names)
        return f"{count} parameters identified, in the tables" if count else ""
    least = _LEAST_PART * result.arm_errors[0].rms_m
    kinds = ", ".join(
        f"{_KINDS.get(error.kind, error.kind)} {1e3 * error.rms_m:.2g} mm"
        for error in result.arm_errors
        if error.rms_m >= least
    )
    offsets = ", ".join(f"{j} {np.degrees(v):+.2g} deg" for j, v in _offsets(result).items())
    return (
        f"its own errors are taken into account: {kinds} (rms at other views)"
        + (f"; zero offsets {offsets}" if offsets else "")
        + f"; corrected by them it is {1e3 * result.corrected_point_sigma_m:.2g} mm off; camera "
        "and board above are for the arm as its controller has it"
    )


_KINDS = {
    "offsets": "zero offsets",
    "lengths": "lengths of links",
    "angles": "angles of links",
    "compliance": "joints that give way",
    "bearing": "bearings that give way",
    "harmonic": "reducers that run unevenly",
}
"""Names of kinds of error where they are not that of their parameters."""

_OFFSET = "zero_offset."
_SURELY = 3.0
"""Standard deviations from which on a zero offset is listed."""

_LEAST_PART = 0.1
"""Part of the largest error from which on others are listed."""

_OF_SET_UP = ("tool", "target", "lens", "board", "time")


def _six(T: FloatArray) -> str:
    place, turn = 1e3 * T[:3, 3], np.degrees(wpr_from_rotation(T[:3, :3]))
    said = (", ".join(f"{value:.3f}" for value in part) for part in (place, turn))
    return "({}) mm, W P R ({}) deg".format(*said)


def _lens(lens: dict[str, Any]) -> str:
    if not lens["estimated"]:
        return "as given"
    values = (f"{n} {lens[n]:.1f} +- {lens['sigma'][n]:.2g}" for n in ("fx", "fy", "cx", "cy"))
    return f"{lens['model']}, {', '.join(values)} px"


def _rms(values: FloatArray, used: np.ndarray) -> float:
    known = values[used & np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


Row = tuple[float, float, float, float]
Matrix = tuple[Row, Row, Row, Row]
"""A transform in a file [m]."""


class Frame(BaseModel):
    """What a camera.json has of a transform."""

    matrix_m: Matrix
    xyz_mm: tuple[float, float, float]
    wpr_deg: tuple[float, float, float]
    sigma_xyz_mm: tuple[float, float, float]
    sigma_rotation_deg: tuple[float, float, float]


class Shown(BaseModel):
    """What it has of a picture."""

    picture: str
    status: str
    reason: str = ""
    points: int | None = None
    rms_px: float | None = None
    left_out_px: float | None = None
    off_mm: float | None = None
    off_deg: float | None = None
    off_x_mm: float | None = None
    off_y_mm: float | None = None
    off_z_mm: float | None = None
    off_rx_deg: float | None = None
    off_ry_deg: float | None = None
    off_rz_deg: float | None = None

    @property
    def is_used(self) -> bool:
        """Return True if the estimate rests on it."""
        return self.status == "used"

    @property
    def off(self) -> FloatArray:
        """Deviation of the board along [mm] and about [deg] the axes of the base ``(6,)``.

        NaN where it is not known.
        """
        return np.array([getattr(self, key) for key in OFF_AXES], dtype=float)


class Noise(BaseModel):
    """What it has of the noise."""

    pixel_sigma: float
    arm_sigma_mm: float
    arm_sigma_deg: float


class LensShown(BaseModel):
    """What it has of a lens."""

    width_px: int
    height_px: int
    fx: Annotated[float, Field(ge=LEAST_POSITIVE)]
    fy: Annotated[float, Field(ge=LEAST_POSITIVE)]
    cx: float
    cy: float


class CorrectedShown(BaseModel):
    """What it has of an arm that is corrected."""

    point_sigma_mm: float


class ArmErrorsShown(BaseModel):
    """What it has of errors of the arm."""

    rms_mm: dict[str, float]
    corrected: CorrectedShown


_PARENTS = ("T_flange_", "T_base_")


class CameraFile(BaseModel):
    """What a page needs of a camera.json; transforms are keys besides."""

    model_config = ConfigDict(extra="allow")

    ok: bool
    board: str
    board_box_mm: tuple[float, float, float, float] | None = None
    flange_poses: dict[str, Matrix] = {}
    lens: LensShown | None = None
    lenses: dict[str, LensShown] = {}
    warnings: list[str] = []
    noise: Noise
    point_sigma_mm: float
    distance_mm: float
    parameters: list[dict[str, Any]] = []
    pictures: list[Shown]
    arm_errors: ArmErrorsShown | None = None

    @property
    def frames(self) -> dict[str, Frame]:
        """Transforms by name."""
        more = self.model_extra or {}
        return {k: Frame.model_validate(more[k]) for k in more if k.startswith(_PARENTS)}


def shown_camera(calibrated: Calibrated) -> CameraFile:
    """Return what a page shows of a result, as its camera.json has it."""
    return CameraFile.model_validate(plain(result_as_dict(calibrated)))


def lines_of_camera(file: CameraFile) -> list[str]:
    """What a camera.json says, in sentences, the verdict first."""
    used = sum(one.is_used for one in file.pictures)
    state = "calibrated" if file.ok else "not to be trusted"
    lines = [f"{state}: camera and board from {used} of {len(file.pictures)} pictures"]
    lines += [
        f"{name}: ({_three(frame.xyz_mm)}) mm, W P R ({_three(frame.wpr_deg)}) deg, sigma "
        f"{max(frame.sigma_xyz_mm):.2g} mm and {max(frame.sigma_rotation_deg):.2g} deg"
        for name, frame in file.frames.items()
    ]
    lines.append(
        f"a point that the camera sees at {file.distance_mm:.0f} mm: the arm is "
        f"{file.point_sigma_mm:.2g} mm off it (rms to expect); points scatter by "
        f"{file.noise.pixel_sigma:.2g} px, the arm by "
        f"{file.noise.arm_sigma_mm:.2g} mm and {file.noise.arm_sigma_deg:.2g} deg"
    )
    if file.arm_errors is not None:
        kinds = ", ".join(
            f"{_KINDS.get(kind, kind)} {mm:.2g} mm"
            for kind, mm in file.arm_errors.rms_mm.items()
            if mm >= _LEAST_PART * max(file.arm_errors.rms_mm.values())
        )
        lines.append(
            f"errors of the arm are taken into account ({kinds}); camera and board above are for "
            "the arm as its controller has it; corrected by these errors it is "
            f"{file.arm_errors.corrected.point_sigma_mm:.2g} mm off"
        )
    return lines + [f"warning: {text}" for text in file.warnings] + [file.board]


def short(value: float) -> str:
    """A size to two digits, without powers of ten."""
    return f"{value:.0f}" if value >= 100.0 else f"{value:.2g}"


def _three(values: tuple[float, float, float]) -> str:
    return ", ".join(f"{value:.3f}" for value in values)


def figure_of_pictures(pictures: Sequence[Shown]) -> Figure:
    """Residual of each picture, in the estimate and left out of it."""
    known = [one for one in pictures if one.rms_px is not None]
    figure = figures.new_figure(3.0)
    _draw_pictures(
        figure,
        [one.picture for one in known],
        np.array([one.rms_px or np.nan for one in known]),
        np.array([np.nan if one.left_out_px is None else one.left_out_px for one in known]),
        np.array([not one.is_used for one in known]),
    )
    return figure


def _draw_pictures(
    figure: Figure | SubFigure,
    names: Sequence[str],
    rms_px: FloatArray,
    left_out_px: FloatArray,
    outliers: np.ndarray,
) -> None:
    left = {"in the estimate": rms_px, "left out of it": np.where(outliers, rms_px, left_out_px)}
    figures.residuals_by_pose(figure, names, left, outliers, "px")


def figure_of_camera(result: HandEyeResult) -> Figure | None:
    """Points about each picture's best board, and residuals of pictures, also left out.

    None where no picture has a residual.
    """
    shown = np.isfinite(result.rms_px)
    if not shown.any():
        return None
    figure = figures.new_figure(6.4)
    top, bottom = figures.rows_of(figure, (1.6, 1.0))
    (panel,) = figures.panels_of(top)
    _draw_arrows(panel, result)
    names = [name for name, is_shown in zip(result.names, shown, strict=True) if is_shown]
    rms, left = result.rms_px[shown], result.left_out_px[shown]
    _draw_pictures(bottom, names, rms, left, ~result.used[shown])
    return figure


def _draw_arrows(panel: Axes, result: HandEyeResult) -> None:
    """Residuals of the points where they are in the picture, many times as long.

    What the arm stopped off is taken out of them: it moves all points of a picture together, and
    would hide what the lens does.
    """
    off = result.within_px[result.used]
    seen = result.pixels[result.used]
    known = np.isfinite(off).all(axis=-1)
    length = np.linalg.norm(off[known], axis=-1)
    typical = float(np.quantile(length, 0.99)) if length.size else 1.0
    longer = LONG_ARROW * result.lens.width_px / max(typical, 1e-9)
    arrows = panel.quiver(
        *seen[known].T,
        *off[known].T,
        angles="xy",
        scale_units="xy",
        scale=1.0 / longer,
        width=0.0012,
        color=BLUE,
    )
    panel.set(
        xlim=(0, result.lens.width_px),
        ylim=(result.lens.height_px, 0),
        aspect="equal",
        xlabel="x [px]",
        ylabel="y [px]",
    )
    known_px = float(f"{typical:.0e}")
    panel.quiverkey(
        arrows, 1.08, 0.97, known_px, f"{known_px:g} px", labelpos="E", fontproperties={"size": 9}
    )
    panel.set_title(
        "left over at the points, the board placed anew in each picture:\n"
        "a pattern over the image is a lens that the model does not fit",
        fontsize=10,
    )
