"""What a calibration from pictures answers: where the camera is, how well, what looks wrong."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.se3 import FloatArray, wpr_from_rotation
from posedesign.hand_eye.calibration import lens_as_dict, parameter_rows
from posedesign.pairs.transforms import forms_of
from posedesign.report import figures
from posedesign.report.answer import Answer, Table
from posedesign.report.drawing import BLUE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from calib.hand_eye import HandEyeResult
    from posedesign.hand_eye import Calibrated

LONG_ARROW = 0.06
"""Length of the longest residual in a figure, in parts of the picture's width."""


def answer_of_camera(calibrated: Calibrated, files: Sequence[str] = ()) -> Answer:
    """The answer: where cameras and boards are, how surely, the lens, what does not fit."""
    result = calibrated.result
    used, every = int(result.used.sum()), len(result.names)
    shown: dict[str, str] = {}
    for frame in result.frames:
        place, turn = 1e3 * frame.sigma_m.max(), np.degrees(frame.sigma_rad).max()
        shown[frame.name] = f"{_six(frame.T)}, sigma {place:.2g} mm and {turn:.2g} deg"
    shown["a point that the camera sees"] = (
        f"{1e3 * result.point_sigma_m:.2g} mm (sigma) seen from the {result.frames[0].parent}, at "
        f"{1e3 * result.distance_m:.0f} mm"
    )
    for camera in result.lenses:
        name = "lens" if len(result.lenses) == 1 else f"lens of {camera}"
        shown[name] = _lens(lens_as_dict(result, camera))
    shown["left over"] = (
        f"{_rms(result.rms_px, result.used):.3g} px rms, of pictures left out "
        f"{_rms(result.left_out_px, result.used):.3g} px; points scatter by {result.sigma_px:.2g} "
        f"px, the arm by {1e3 * result.arm_sigma[0]:.2g} mm and "
        f"{np.degrees(result.arm_sigma[1]):.2g} deg"
    )
    robot = sum(not name.startswith(_OF_SET_UP) for name in result.estimate.names)
    shown["robot"] = f"{robot} parameters identified, in the tables" if robot else ""
    unseen = [
        f"{name}: {reason}"
        for name, reason in zip(result.names, calibrated.reasons, strict=True)
        if reason
    ]
    state = "calibrated" if result.is_ok else "not to be trusted"
    return Answer(
        f"{state}: camera and board from {used} of {every} pictures",
        shown,
        warnings=result.warnings,
        notes=[*calibrated.notes, *unseen],
        details=[
            f"{frame.name}, {form}: {text}"
            for frame in result.frames
            for form, text in forms_of(frame.T, frame.parent, frame.label).items()
        ],
        tables=[
            Table("Parameters", parameter_rows(result)),
            Table("Pictures", result.rows()),
        ],
        files=files,
    )


_OF_SET_UP = ("tool", "target", "lens", "board")


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


def figure_of_camera(result: HandEyeResult) -> Figure:
    """Residuals of all points over the picture, and of each picture with and without itself."""
    figure = figures.new_figure(6.4)
    top, bottom = figures.rows_of(figure, (1.6, 1.0))
    (panel,) = figures.panels_of(top)
    _draw_arrows(panel, result)
    left = {
        "in the estimate": np.nan_to_num(result.rms_px),
        "left out of it": np.nan_to_num(result.left_out_px),
    }
    shown = np.isfinite(result.rms_px)
    names = [name for name, is_shown in zip(result.names, shown, strict=True) if is_shown]
    figures.residuals_by_pose(
        bottom,
        names,
        {label: values[shown] for label, values in left.items()},
        ~result.used[shown],
        "px",
    )
    return figure


def _draw_arrows(panel: object, result: HandEyeResult) -> None:
    """Residuals of the points where they are in the picture, many times as long."""
    from matplotlib.axes import Axes

    if not isinstance(panel, Axes):
        raise TypeError("a panel is drawn into")
    off = result.residuals_px[result.used]
    seen = result.pixels[result.used]
    known = np.isfinite(off).all(axis=-1)
    length = np.linalg.norm(off[known], axis=-1)
    typical = float(np.quantile(length, 0.99)) if length.size else 1.0
    longer = LONG_ARROW * result.lens.width_px / max(typical, 1e-9)
    panel.quiver(
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
        title=f"residuals of points, {longer:.0f} times as long: no pattern is what is hoped for",
    )
    panel.title.set_fontsize(10)
