"""Points of a board as a camera sees them: the measurement that hand-eye calibration starts from.

Either the camera is on the tool and the board around the arm (eye-in-hand), or the board is on the
tool and the camera around the arm (eye-to-hand). The tool frame of the model is that of the one,
its target frame that of the other.

Rows are pixels, x and y of each point. Where the arm stops is not where it says, by some tenths of
a millimetre: all points of a picture are then off together. That deviation is not estimated picture
by picture but marginalised: the noise of a picture's rows is that of its pixels plus what a
Gaussian deviation of the tip does to them, to first order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from calib.batch_last import turn, turn_back
from calib.errors import InputError
from calib.lens import Lens, project
from calib.model.context import MeasurementContext, Setup, reading_label
from calib.model.measurements.data import Measurements
from calib.model.measurements.kinds import Measurement
from calib.se3 import BoolArray, FloatArray, IntArray

Carried = Literal["camera", "board"]


@dataclass(frozen=True, eq=False)
class BoardShape:
    """Points ``(K, 3)`` [m] of a board in its own frame, and how errors of its print move them."""

    points: FloatArray

    def __post_init__(self) -> None:
        points = np.asarray(self.points, dtype=float)
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
            raise InputError("a board needs points (K, 3)", name="board")
        object.__setattr__(self, "points", points)

    @property
    def by_errors(self) -> FloatArray:
        """Derivative ``(3, K, 3)`` of the points by scale, bend_x and bend_y."""
        middle = (self.points.max(axis=0) + self.points.min(axis=0)) / 2.0
        half = np.maximum(np.ptp(self.points, axis=0) / 2.0, np.finfo(float).tiny)
        out = np.zeros((3, *self.points.shape))
        out[0] = self.points
        for k in range(2):
            out[1 + k, :, 2] = ((self.points[:, k] - middle[k]) / half[k]) ** 2
        return out


class _Seen(NamedTuple):
    """Rows of one camera at S postures: ``(2K, S)`` and their derivatives.

    ``by_twist`` (2K, 6, S) of the tool against its target; ``by_lens`` (L, 2K, S);
    ``by_board`` (3, 2K, S).
    """

    rows: FloatArray
    by_twist: FloatArray
    by_lens: FloatArray
    by_board: FloatArray


class BoardView(Measurement):
    """Pixels of the points of a board.

    Parameters
    ----------
    sigma_px : float or None
        Standard deviation of a coordinate of a point in a picture. None: it is estimated.
    board : BoardShape
    lens : Lens
        Of the camera; values that are identified are those of the model's `LensParameters`.
    carried : {"camera", "board"}
        What the tool is: the camera (eye-in-hand) or the board (eye-to-hand).
    arm_sigma : tuple of two floats, optional
        Standard deviations of where the tip stops: along each axis [m], about each axis [rad].
    camera_label, board_label : str
        Names of both in the parameters of the model.
    border_px : float, optional
        Points nearer to the edge of the image count as not seen, where nothing says which are
        (planning). None: all are seen.
    """

    name = "board"
    unit = "px"
    sees_rotation = True

    def __init__(
        self,
        sigma_px: float | None,
        board: BoardShape,
        lens: Lens,
        carried: Carried = "camera",
        arm_sigma: tuple[float, float] | None = None,
        *,
        camera_label: str = "camera",
        board_label: str = "board",
        border_px: float | None = None,
    ) -> None:
        self.board, self.lens, self.carried = board, lens, carried
        self.rows = 2 * len(board.points)
        super().__init__(0.5 if sigma_px is None else sigma_px)
        self.estimated = sigma_px is None
        self.arm_sigma = arm_sigma
        self._lens_label = reading_label("lens", camera_label, "camera")
        self._board_label = reading_label("board", board_label, "board")
        self.border_px = border_px

    @property
    def labels(self) -> tuple[str, str]:
        """What it reads by: labels of its lens and of the errors of its board."""
        return self._lens_label, self._board_label

    def predict(self, view: MeasurementContext) -> FloatArray:
        """See :meth:`Measurement.predict`: x and y of each point [px], from the upper left."""
        return self._seen(view).rows

    def differentiate(
        self, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        by_twist = self._seen(view).by_twist
        if motion.shape[-1] == by_twist.shape[-1]:
            return np.asarray(np.einsum("rts,pts->prs", by_twist, motion, optimize=True))
        return np.asarray(np.einsum("rts,pt->prs", by_twist, motion[..., 0], optimize=True))

    def differentiate_reading(self, label: str, view: MeasurementContext) -> FloatArray | None:
        if label == self._lens_label:
            return self._seen(view).by_lens
        return self._seen(view).by_board if label == self._board_label else None

    def whiten(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        return np.asarray(rows / self.sigma_of(view))

    def colour(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        return np.asarray(rows * self.sigma_of(view))

    def sigma_of(self, view: MeasurementContext) -> FloatArray:
        """Noise of the pixels of each picture ``(1, S)``, or of all ``(1, 1)``."""
        return self.sigma[:1, None]

    def _seen(self, view: MeasurementContext) -> _Seen:
        """Pixels and derivatives; rows that were not seen are without derivative."""
        if id(self) in view.found:
            return cast(_Seen, view.found[id(self)])
        width = view.q.shape[1]
        lens = view.errors.readings.get(self._lens_label)
        values = np.array(self.lens.values)[:, None] if lens is None else lens
        points = self.board.points.T[:, :, None]  # (3, K, 1)
        by_errors = self.board.by_errors.transpose(0, 2, 1)[..., None]  # (3, 3, K, 1)
        errors = view.errors.readings.get(self._board_label)
        if errors is not None:
            points = points + np.einsum("eck,es->cks", by_errors[..., 0], errors)
        in_hand = self.carried == "camera"
        tool = np.broadcast_to(view.tool, (3, 3, width))
        target = np.broadcast_to(view.target, (3, 3, width))
        error = np.broadcast_to(view.error, (3, width))
        board, camera = (target, tool) if in_hand else (tool, target)
        # from the tool point to each point, in base axes
        arm = _each(turn, board, points) - (error[:, None] if in_hand else 0.0)
        from_camera = arm if in_hand else arm + error[:, None]
        seen = project(self.lens.name, values, _each(turn_back, camera, from_camera))
        K = points.shape[1]
        # by_point is in the axes of the camera: rows of it in base axes, (2, 3, K, S)
        by_base = np.stack([_each(turn, camera, row) for row in seen.by_point])
        sign = -1.0 if in_hand else 1.0
        by_twist = np.empty((K, 2, 6, width))
        by_turn = _cross_points(arm, by_base)
        by_twist[:, :, :3] = sign * by_base.transpose(2, 0, 1, 3)
        by_twist[:, :, 3:] = sign * by_turn.transpose(2, 0, 1, 3)
        by_board = np.empty((3, K, 2, width))
        for e in range(3):
            moved = _each(turn, board, by_errors[e])
            by_board[e] = np.einsum("rcks,cks->krs", by_base, np.broadcast_to(moved, arm.shape))
        by_lens = np.broadcast_to(seen.by_lens, (len(values), 2, K, width)).transpose(0, 2, 1, 3)
        found = _Seen(
            seen.pixels.transpose(1, 0, 2).reshape(2 * K, width),
            by_twist.reshape(2 * K, 6, width),
            by_lens.reshape(len(values), 2 * K, width),
            by_board.reshape(3, 2 * K, width),
        )
        there = view.seen_last
        if there is None and self.border_px is not None:
            there = np.repeat(self.inside(found.rows, view, from_camera), 2, axis=0)
        if there is not None:
            there = there[: self.rows]
            found = _Seen(
                found.rows,
                found.by_twist * there[:, None],
                found.by_lens * there,
                found.by_board * there,
            )
        view.found[id(self)] = found
        return found

    def inside(
        self, rows: FloatArray, view: MeasurementContext, from_camera: FloatArray
    ) -> BoolArray:
        """Which points ``(K, S)`` are in the image, clear of its border, and before the lens."""
        pixels = rows.reshape(-1, 2, rows.shape[-1])
        size = np.array([self.lens.width_px, self.lens.height_px])[None, :, None]
        border = self.border_px or 0.0
        in_image = ((pixels >= border) & (pixels <= size - border)).all(axis=1)
        in_hand = self.carried == "camera"
        axis = np.broadcast_to(view.tool if in_hand else view.target, (3, 3, rows.shape[-1]))[2]
        depth = np.einsum("cs,cks->ks", axis, from_camera)
        squares = np.einsum("cks,cks->ks", from_camera, from_camera)
        shown = (depth > 0.0) & (squares <= (1.0 + self.lens.steepest**2) * depth**2)
        return np.asarray(in_image & shown)


class BoardViews(BoardView):
    """Pixels of several boards, by several cameras: each picture is of one of each.

    Parameters
    ----------
    looks : mapping of (str, str) to BoardView
        By the labels of what is on the flange and of what stands around the arm, each with the
        noise of its camera.
    arm_sigma : tuple of two floats, optional
        As of `BoardView`. Pictures of one stop of the arm share its deviation.
    """

    def __init__(
        self,
        looks: Mapping[tuple[str, str], BoardView],
        arm_sigma: tuple[float, float] | None = None,
    ) -> None:
        self.looks = dict(looks)
        largest = max(self.looks.values(), key=lambda look: look.rows)
        sigma = float(largest.sigma[0])
        super().__init__(sigma, largest.board, largest.lens, largest.carried, arm_sigma)

    def sigma_of(self, view: MeasurementContext) -> FloatArray:
        out = np.ones((1, view.q.shape[1]))
        for look, _, columns in self._looked(view):
            out[:, columns] = look.sigma[0]
        return out

    def predict(self, view: MeasurementContext) -> FloatArray:
        return self._gathered(view, lambda look, part, columns: look.predict(part))

    def differentiate(
        self, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        def moved(look: BoardView, part: MeasurementContext, columns: IntArray) -> FloatArray:
            own = motion[..., columns] if motion.shape[-1] > 1 else motion
            return look.differentiate(own, part, rows)

        return self._gathered(view, moved)

    def differentiate_reading(self, label: str, view: MeasurementContext) -> FloatArray | None:
        if not any(label in look.labels for look in self.looks.values()):
            return None

        def read(look: BoardView, part: MeasurementContext, columns: IntArray) -> FloatArray | None:
            return look.differentiate_reading(label, part)

        return self._gathered(view, read)

    def _gathered(self, view: MeasurementContext, ask: _Ask) -> FloatArray:
        """Rows ``(..., m, S)`` of all looks at their pictures; noughts where one has none."""
        asked = [(ask(look, part, columns), columns) for look, part, columns in self._looked(view)]
        known = [(rows, columns) for rows, columns in asked if rows is not None]
        shape = known[0][0].shape[:-2] if known else ()
        out = np.zeros((*shape, self.rows, view.q.shape[1]))
        for rows, columns in known:
            out[..., : rows.shape[-2], columns] = rows
        return out

    def _looked(self, view: MeasurementContext) -> list[_Look]:
        """Each look with the view of its pictures, and their columns."""
        if id(self) not in view.found:
            view.found[id(self)] = list(self._parts(view))
        return cast("list[_Look]", view.found[id(self)])

    def _parts(self, view: MeasurementContext) -> Iterator[_Look]:
        setup = view.setup
        trials = view.q.shape[1] // max(setup.count, 1)
        for (tool, target), look in self.looks.items():
            own = np.flatnonzero(
                (setup.tool == view.tools.index(tool))
                & (setup.target == view.targets.index(target))
            )
            if own.size:
                columns = (own + setup.count * np.arange(trials)[:, None]).ravel()
                yield look, view.part(columns, own), columns


_Look = tuple[BoardView, MeasurementContext, IntArray]
_Ask = Callable[[BoardView, MeasurementContext, "IntArray"], "FloatArray | None"]


def _each(
    turning: Callable[[FloatArray, FloatArray], FloatArray],
    columns: FloatArray,
    vectors: FloatArray,
) -> FloatArray:
    """Vectors ``(3, K, S)`` in other axes, by :func:`turn` or :func:`turn_back`."""
    return turning(columns, vectors.transpose(1, 0, 2)).transpose(1, 0, 2)


def _cross_points(arm: FloatArray, by_base: FloatArray) -> FloatArray:
    """``a x g``: derivative ``(2, 3, K, S)`` by turns of what goes with ``g · (w x a)``."""
    out = np.empty_like(by_base)
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        out[:, k] = arm[i] * by_base[:, j] - arm[j] * by_base[:, i]
    return out


def board_views(
    postures: ArrayLike,
    pixels: ArrayLike,
    names: Sequence[str] = (),
    *,
    tools: Sequence[str] = ("tool",),
    targets: Sequence[str] = ("tracker",),
    tool: ArrayLike = 0,
    target: ArrayLike = 0,
    motion: FloatArray | None = None,
) -> Measurements:
    """Views of boards as measurements.

    Parameters
    ----------
    postures : array_like (N, n)
        [rad]
    pixels : array_like (N, K, 2)
        NaN for points that were not seen.
    names : sequence of str, optional
        Of the stops of the arm; pictures of one stop share a name.
    tools, targets, tool, target, motion
        Labels, indices of each picture, and how the arm moved, as of `Setup`.
    """
    given = np.asarray(pixels, dtype=float)
    rows = given.reshape(len(given), -1)
    how = Setup.of(len(rows), tool=tool, target=target)
    seen = np.isfinite(rows)
    index = {name: k for k, name in enumerate(dict.fromkeys(names))}
    stop = np.array([index[name] for name in names]) if len(index) < len(names) else None
    setup = replace(how, seen=seen, stop=stop, motion=motion)
    q, observed = np.asarray(postures, dtype=float), np.where(seen, rows, 0.0)
    return Measurements(q, setup, tuple(targets), tuple(tools), observed, tuple(names))
