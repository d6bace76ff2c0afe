"""Where camera and board were in each picture, and how far the board is seen from its place.

Drawn of a camera.json alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.se3 import FloatArray
from posedesign.report import figures
from posedesign.report.drawing import BLACK, BLUE, GREEN, GREY, SKY, SMALL, VERMILION
from posedesign.report.hand_eye import short

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

    from posedesign.report.hand_eye import CameraFile, LensShown, Shown

_AXES = (("x", VERMILION, "o"), ("y", GREEN, "s"), ("z", BLUE, "^"))
"""Name, colour and mark of an axis, in all panels."""

_LEAST_WIDTH = 0.1
"""Of the space that is drawn along an axis, in parts of the widest."""

_PYRAMID, _FRAME, _BASE = 0.25, 0.05, 0.12
"""Height of a camera in parts of its distance from the board, and length of the axes of its frame
and of those of the base, in parts of the space."""

_FEW = 20
"""Pictures from which on cameras are drawn smaller, so as not to hide each other."""

_MOST_NAMED = 6
"""Pictures that are left out and named in space; of more, names would stand on each other."""

_WIDEST = 1.5
"""Half of the width of a view over its distance, at most: those of fisheye lenses have no end."""

_LINE = 110
"""Letters of a line below a panel."""

_TALLER = 1.25
"""Height of a panel over the largest deviation of a picture that was used."""


def figure_of_poses(file: CameraFile) -> Figure | None:
    """Draw where camera and board were, and the deviation of the board in each picture.

    None where no picture has both.
    """
    shown = [one for one in file.pictures if np.isfinite(one.off).all()]
    space = _Space.of(file)
    if not shown or space is None:
        return None
    figure = figures.new_figure(9.0)
    top, bottom = figures.rows_of(figure, (1.2, 1.0))
    _draw_space(top, space)
    _draw_deviations(bottom, shown)
    return figure


@dataclass(frozen=True, eq=False)
class _Space:
    """Lines and faces in the base frame [mm], S of them."""

    cameras: dict[str, list[FloatArray]]
    """By "used" and "left out": outlines of cameras ``(L, 3)``."""
    boards: dict[str, list[FloatArray]]  # likewise their rectangles (4, 3)
    frames: FloatArray  # (S, 4, 4): of all of these, and of the base as the first
    part: float  # length of their axes in parts of the space
    named: list[tuple[str, FloatArray]]  # pictures that are left out, and where

    @classmethod
    def of(cls, file: CameraFile) -> _Space | None:
        """The poses of a file; None where it does not have what is drawn."""
        frames = {name: np.array(frame.matrix_m) for name, frame in file.frames.items()}
        lenses = file.lenses or ({} if file.lens is None else {"camera": file.lens})
        corners = _corners(file)
        if not frames or corners is None:
            return None
        cameras: dict[str, list[FloatArray]] = {"used": [], "left out": []}
        boards: dict[str, list[FloatArray]] = {"used": [], "left out": []}
        placed, named = [np.eye(4)], list[tuple[str, FloatArray]]()
        crowded = min(1.0, np.sqrt(_FEW / max(len(file.flange_poses), 1)))
        height = crowded * _PYRAMID * file.distance_mm / 1e3

        def place(T: FloatArray, label: str, group: str) -> None:
            placed.append(T)
            outline = _pyramid(lenses[label], height) if label in lenses else corners
            into = cameras if label in lenses else boards
            into[group].append(1e3 * (outline @ T[:3, :3].T + T[:3, 3]))

        for name, T in frames.items():
            _, parent, label = name.split("_", 2)
            if parent == "base":
                place(T, label, "used")
                continue
            for picture in file.pictures:
                # of several cameras each has pictures of its own
                own = label not in lenses or len(lenses) == 1 or _camera_of(picture) == label
                flange = file.flange_poses.get(picture.picture)
                if flange is None or not own or picture.points == 0:
                    continue
                at = np.array(flange) @ T
                place(at, label, "used" if picture.is_used else "left out")
                if not picture.is_used:
                    named.append((picture.picture, 1e3 * at[:3, 3]))
        return cls(cameras, boards, np.array(placed), _FRAME * crowded, named)

    @property
    def limits(self) -> FloatArray:
        """Lower and upper ends of the space ``(2, 3)`` [mm]."""
        parts = [*self.cameras.values(), *self.boards.values()]
        outlines = [outline for part in parts for outline in part]
        points = np.concatenate([np.zeros((1, 3)), *outlines])
        low, high = points.min(axis=0), points.max(axis=0)
        half = np.maximum(high - low, _LEAST_WIDTH * np.max(high - low)) / 2.0
        middle = (low + high) / 2.0
        return np.array([middle - 1.05 * half, middle + 1.05 * half])


def _camera_of(picture: Shown) -> str:
    return picture.picture.partition("/")[0]


def _corners(file: CameraFile) -> FloatArray | None:
    """Corners of the board ``(4, 3)`` [m] in its own frame, if the file says them."""
    if file.board_box_mm is None:
        return None
    left, top, right, bottom = (value / 1e3 for value in file.board_box_mm)
    return np.array([[left, top, 0], [right, top, 0], [right, bottom, 0], [left, bottom, 0]])


def _pyramid(lens: LensShown, height: float) -> FloatArray:
    """Outline of the view of a lens ``(L, 3)`` [m]: one line that passes each edge."""
    ends = np.array([[0, 0], [lens.width_px, 0], [lens.width_px, lens.height_px]])
    ends = np.vstack([ends, [[0, lens.height_px]]])
    rays = (ends - [lens.cx, lens.cy]) / [lens.fx, lens.fy]
    a, b, c, d = height * np.column_stack([np.clip(rays, -_WIDEST, _WIDEST), np.ones(4)])
    tip = np.zeros(3)
    return np.array([tip, a, b, tip, c, b, a, d, tip, d, c])


def _draw_space(figure: SubFigure, space: _Space) -> None:
    """Draw cameras, boards and frames in the base frame, all axes at one scale."""
    from mpl_toolkits.mplot3d.art3d import (  # type: ignore[import-untyped]
        Line3DCollection,
        Poly3DCollection,
    )

    def add(collection: Any) -> None:
        # what is near the eye reaches beyond the panel
        panel.add_collection3d(collection, autolim=False)
        collection.set_clip_on(False)

    panel: Any = figure.add_subplot(projection="3d", computed_zorder=False)
    low, high = space.limits
    panel.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    panel.set_box_aspect(high - low, zoom=1.15)
    panel.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    panel.tick_params(labelsize=7, pad=0)
    panel.locator_params(nbins=5)
    middle = (low + high) / 2.0
    panel.view_init(elev=22.0, azim=float(np.degrees(np.arctan2(middle[1], middle[0]))) - 60.0)
    for group, colour, face in (("used", BLACK, SKY), ("left out", VERMILION, VERMILION)):
        boards, cameras = space.boards[group], space.cameras[group]
        if boards:
            add(Poly3DCollection(boards, facecolor=face, edgecolor=colour, lw=0.6, alpha=0.35))
        if cameras:
            add(Line3DCollection(cameras, colors=colour, linewidths=0.6))
    widest = float(np.max(high - low))
    for k, (name, colour, _) in enumerate(_AXES):
        at = 1e3 * space.frames[:, :3, 3]
        # those of the base are longer: nothing else is drawn of it
        long = np.full(len(at), space.part * widest)
        long[0] = _BASE * widest
        ends = at + long[:, None] * space.frames[:, :3, k]
        add(Line3DCollection(np.stack([at, ends], axis=1), colors=colour, linewidths=1.0))
        panel.plot([], [], [], color=colour, lw=1.0, label=f"{name} axis")
    panel.text(0.0, 0.0, -0.3 * _BASE * widest, "base", fontsize=SMALL, ha="center", va="top")
    for name, place in space.named if len(space.named) <= _MOST_NAMED else ():
        panel.text(*place, f" {name}", fontsize=7, color=VERMILION, parse_math=False)
    if space.named:
        panel.plot([], [], [], color=VERMILION, lw=3.0, alpha=0.5, label="left out")
    panel.set_title("camera (pyramid) and board (rectangle) in the base frame", fontsize=10)
    panel.legend(fontsize=SMALL, loc="upper left", frameon=False)


def _draw_deviations(figure: SubFigure, shown: Sequence[Shown]) -> None:
    """Draw where the board is seen in each picture, less its place, axis by axis."""
    panels = figure.subplots(2, 1, sharex=True)
    names, at = [one.picture for one in shown], np.arange(len(shown))
    used = np.array([one.is_used for one in shown])
    for panel, what, unit, rows in (
        (panels[0], "position", "mm", np.s_[:3]),
        (panels[1], "rotation", "deg", np.s_[3:]),
    ):
        off = np.array([one.off[rows] for one in shown])
        top = _TALLER * (float(np.abs(off[used]).max(initial=0.0)) or 1.0)
        inside = np.clip(off, -top, top)
        panel.grid(True, alpha=0.25)
        panel.axhline(0.0, color=GREY, lw=0.8)
        for k, (name, colour, mark) in enumerate(_AXES):
            rms = float(np.sqrt(np.mean(off[used, k] ** 2))) if used.any() else np.nan
            beside = at + 0.2 * (k - 1)
            label = f"{'about ' * (unit == 'deg')}{name}: rms {rms:.2g} {unit}"
            panel.plot(beside[used], off[used, k], mark, ms=4, color=colour, label=label)
            # those that are left out may be far off: they stand at the edge then
            panel.plot(beside[~used], inside[~used, k], mark, ms=4, mfc="none", mec=colour)
        panel.set(ylim=(-1.06 * top, 1.06 * top), ylabel=f"{what} [{unit}]")
        panel.legend(
            fontsize=SMALL, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False
        )
    figure.suptitle(
        "the board as the camera sees it in each picture, less its place by the arm, in base axes",
        fontsize=10,
    )
    figure.align_ylabels()
    figures.name_ticks(panels[1], names)
    out = [k for k in range(len(shown)) if not used[k]]
    if out:
        said = [
            f"{figures.shortened(names[k])} ({short(shown[k].off_mm or 0.0)} mm, "
            f"{short(shown[k].off_deg or 0.0)} deg)"
            for k in out[: figures.MOST_NAMED]
        ]
        more = f" and {len(out) - len(said)} more" if len(out) > len(said) else ""
        text = f"left out, hollow marks: {', '.join(said)}{more}"
        panels[1].set_xlabel(fill(text, _LINE), fontsize=SMALL, color=VERMILION, parse_math=False)
