"""Camera, board and lens, and the robot where asked, in one estimate over pixels.

The pictures give a lens and poses of the board, these A X = Z B, and its solution starts the
estimate: the pixels of all points at once, weighed by their noise and by how far the arm stops
from where it says. Both are found from the pictures where they are not given. A picture that
contradicts the others, by a wrong row of joints or points in wrong places, takes no part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib import se3
from calib.chance import chi2_quantile
from calib.errors import InputError
from calib.hand_eye.noise import (
    Deviations,
    arm_deviation,
    deviations,
    pixel_scale,
    squares_of_pictures,
)
from calib.hand_eye.points import pose_of, seen_point_motion
from calib.hand_eye.result import HandEyeResult, PictureStatus
from calib.hand_eye.start import FEWEST_POINTS, board_poses, start_lens
from calib.identification import IdentificationResult, identify, minimise
from calib.identification.robust import not_converged
from calib.lens import Lens, LensName
from calib.model import CalibrationModel, Setup
from calib.model.measurements import BoardShape, BoardView, Measurements, board_views
from calib.model.measurements.board_view import Carried
from calib.model.parameters import (
    BoardErrors,
    LensParameters,
    ParameterBlock,
    TargetFrame,
    ToolFrame,
)
from calib.one_thread import one_blas_thread
from calib.robot_world import RobotWorldResult
from calib.robot_world import solve as solve_robot_world
from calib.robots import Robot
from calib.se3 import BoolArray, FloatArray, IntArray

FEWEST_PICTURES = 4
"""Pictures with the board from which X and Z are estimated: three leave nothing to judge by."""

OUTLIER_CHANCE = 1e-4
"""Probability that noise alone takes a picture as far off as one that is left out."""

SCATTERED = 3.0
"""Scatter of the points of a picture, over that of all, from which it is left out: points lie in
wrong places, or it is blurred."""

_ROUNDS = 30
_SETTLED = 0.01
_NOTHING = np.array([1e-3, 1e-6, 1e-6])
"""Change of the noise that is none, relative and absolute [px, m, rad]."""

_USUAL_PX = 0.3
_USUAL_ARM = (1e-3, 2e-3)
"""Noise to start from [px, m, rad]."""


@dataclass(frozen=True, eq=False)
class Pictures:
    """What pictures of one board show, and where the arm was.

    Attributes
    ----------
    robot : Robot
        :func:`calib.robots.flange_robot` where nothing but poses of the flange is known.
    postures : array (N, n)
        [rad]; NaN for pictures without one, which serve the lens only.
    pixels : array (N, K, 2)
        From the upper left corner of the image; NaN for points that were not seen.
    board : array (K, 3)
        Points in the frame of the board [m].
    size_px : tuple of int
        Width and height of the pictures.
    carried : {"camera", "board"}
        What is on the flange.
    names : tuple of str
        Of the pictures.
    """

    robot: Robot
    postures: FloatArray
    pixels: FloatArray
    board: FloatArray
    size_px: tuple[int, int]
    carried: Carried = "camera"
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        postures, pixels = (
            np.asarray(given, dtype=float) for given in (self.postures, self.pixels)
        )
        board = np.asarray(self.board, dtype=float)
        object.__setattr__(self, "postures", postures)
        object.__setattr__(self, "pixels", pixels)
        object.__setattr__(self, "board", board)
        N = len(pixels)
        if pixels.shape != (N, len(board), 2) or postures.shape != (N, self.robot.n):
            raise InputError(
                f"postures {postures.shape}, pixels {pixels.shape} and points {board.shape} do not "
                "belong together",
                hint="give (N, n), (N, K, 2) and (K, 3)",
                name="pictures",
            )
        if not self.names:
            object.__setattr__(self, "names", tuple(f"P{i + 1:02d}" for i in range(N)))

    @property
    def with_board(self) -> BoolArray:
        """Pictures ``(N,)`` that show enough of the board."""
        return np.asarray(np.isfinite(self.pixels).all(axis=-1).sum(axis=1) >= FEWEST_POINTS)

    @property
    def usable(self) -> BoolArray:
        """Those of them ``(N,)`` whose posture is known, too."""
        return self.with_board & np.isfinite(self.postures).all(axis=1)


@one_blas_thread
def calibrate(
    pictures: Pictures,
    lens: LensName | Lens = "pinhole",
    *,
    free_lens: bool | None = None,
    free: Sequence[ParameterBlock] = (),
    sigma_px: float | None = None,
    arm_sigma: tuple[float, float] | None = None,
    board_errors: Sequence[str] = (),
) -> HandEyeResult:
    """Estimate where camera and board are, the lens, and parameters of the robot.

    Parameters
    ----------
    lens : str or Lens
        The lens as calibrated before, or the name of its model.
    free_lens : bool, optional
        Whether to estimate it; where none is given, by default.
    free : sequence of ParameterBlock
        What else to estimate, of the robot.
    sigma_px : float, optional
        Noise of a coordinate of a point; from the scatter within pictures by default.
    arm_sigma : tuple of two floats, optional
        How far the arm stops from where it says: standard deviations along each axis [m] and
        about each axis [rad]; from what is left between pictures by default.
    board_errors : sequence of str
        Errors of the board's print to estimate: ``scale``, ``bend_x``, ``bend_y``.

    Raises
    ------
    InputError
        Too few pictures, or most of them contradict the others.
    NotIdentifiableError
        The motion, or the views, do not tell what is asked for.
    """
    usable = np.flatnonzero(pictures.usable)
    if len(usable) < FEWEST_PICTURES:
        raise InputError(
            f"{len(usable)} of {len(pictures.names)} pictures show the board and have a posture",
            hint=f"{FEWEST_PICTURES} are needed, 15 to 20 are good",
            name="pictures",
            value=len(usable),
            bound=FEWEST_PICTURES,
        )
    given = lens if isinstance(lens, Lens) else None
    if given is not None and (given.width_px, given.height_px) != tuple(pictures.size_px):
        raise InputError(
            f"the lens is of pictures of {given.width_px} x {given.height_px} pixels, these have "
            f"{pictures.size_px[0]} x {pictures.size_px[1]}",
            hint="calibrate it with pictures of this size",
            name="lens",
        )
    first = lens if isinstance(lens, Lens) else _lens_of(pictures, lens)
    is_free = given is None if free_lens is None else free_lens
    pixels, postures = pictures.pixels[usable], pictures.postures[usable]
    poses, found = board_poses(first, pictures.board, pixels)
    start = _solved_pairs(pictures, postures[found], poses[found])
    data = board_views(postures, pixels, [pictures.names[i] for i in usable])
    problem = _Problem(pictures, data, first, is_free, tuple(free), tuple(board_errors))
    good = found.copy()
    good[found] = start.used
    fit = _fitted(problem, start.X, start.Z, good, sigma_px, arm_sigma)
    return _result(problem, fit, start, usable)


def _lens_of(pictures: Pictures, name: LensName) -> Lens:
    pixels = pictures.pixels[pictures.with_board]
    return start_lens(name, pictures.size_px, pictures.board, pixels)


def _solved_pairs(pictures: Pictures, postures: FloatArray, poses: FloatArray) -> RobotWorldResult:
    """X and Z of A X = Z B from poses of the board."""
    A = pictures.robot.fk(postures)
    B = se3.inverse(poses) if pictures.carried == "camera" else poses
    return solve_robot_world(A, B, "ml-robust")


@dataclass(frozen=True, eq=False)
class _Problem:
    """What is estimated, of which pictures."""

    pictures: Pictures
    data: Measurements
    lens: Lens
    free_lens: bool
    free: tuple[ParameterBlock, ...]
    board_errors: tuple[str, ...]

    def model(
        self,
        X: FloatArray,
        Z: FloatArray,
        sigma_px: float,
        arm_sigma: tuple[float, float],
        *,
        board_errors: Sequence[str] | None = None,
        free_lens: bool | None = None,
    ) -> CalibrationModel:
        """The model about X and Z."""
        errors = self.board_errors if board_errors is None else board_errors
        lens = self.free_lens if free_lens is None else free_lens
        blocks: list[ParameterBlock] = [ToolFrame(X), TargetFrame(Z), *self.free]
        if lens:
            blocks.append(LensParameters(self.lens))
        if errors:
            blocks.append(BoardErrors(free=errors))
        pictures = self.pictures
        kind = BoardView(
            sigma_px,
            BoardShape(pictures.board),
            self.lens,
            pictures.carried,
            arm_sigma if any(arm_sigma) else None,
        )
        return CalibrationModel(pictures.robot, blocks, kind)


@dataclass(frozen=True, eq=False)
class _Fit:
    """A fit to the pictures that agree."""

    model: CalibrationModel
    x: FloatArray
    good: BoolArray
    sigma_px: float
    arm_sigma: tuple[float, float]
    parts: Deviations


def _fitted(
    problem: _Problem,
    X: FloatArray,
    Z: FloatArray,
    good: BoolArray,
    sigma_px: float | None,
    arm_sigma: tuple[float, float] | None,
) -> _Fit:
    """Fit, find the noise, and who is beyond it, in turns, until nothing moves."""
    pixel, arm = sigma_px or _USUAL_PX, arm_sigma or _USUAL_ARM
    model = problem.model(X, Z, pixel, arm)
    x, still = model.nominal, False
    for _ in range(_ROUNDS):
        kept = np.flatnonzero(good)
        model = problem.model(X, Z, pixel, arm)
        x = _minimised(model, problem.data[kept], x)
        if still:  # the noise is that of these pictures: who else is within it?
            again = _within_noise(deviations(model, problem.data, x), arm)
            if 2 * again.sum() < len(again):
                raise _contradiction(int((~again).sum()), len(again))
            if (again == good).all():
                break
            good, still = again, False
            continue
        some = deviations(model, problem.data[kept], x)
        before = np.array([pixel, *arm])
        if sigma_px is None:
            scale = pixel_scale(some)
            pixel *= scale
            some = _with_pixels(some, scale)
        if arm_sigma is None:
            arm = arm_deviation(some)
        after = np.array([pixel, *arm])
        still = bool((np.abs(after - before) <= _SETTLED * after + _NOTHING).all())
    return _Fit(model, x, good, pixel, arm, deviations(model, problem.data, x))


def _within_noise(parts: Deviations, arm: tuple[float, float]) -> BoolArray:
    """Pictures ``(N,)`` whose deviation and scatter the noise explains."""
    near = squares_of_pictures(parts, arm) <= chi2_quantile(1.0 - OUTLIER_CHANCE, 6)
    scatter = np.sqrt(parts.within / np.maximum(parts.within_rows, 1.0))
    return np.asarray(near & (scatter <= SCATTERED))


def _minimised(model: CalibrationModel, data: Measurements, x: FloatArray) -> FloatArray:
    found = minimise(model, data.trials(None), x[None])
    if not found.converged[0]:
        raise not_converged(float(found.change[0]))
    return np.asarray(found.x[0])


def _with_pixels(parts: Deviations, scale: float) -> Deviations:
    """The same for pixels of another noise."""
    return replace(
        parts,
        covariance=parts.covariance * scale**2,
        within=parts.within / scale**2,
        within_blocks=parts.within_blocks / scale**2,
        within_right=parts.within_right / scale**2,
    )


def _contradiction(bad: int, count: int) -> InputError:
    return InputError(
        f"{bad} of {count} pictures contradict the others: which are right cannot be told",
        hint="do pictures and joints belong together, in this order, and did the board stay still?",
        name="pictures",
        value=bad,
        bound=count // 2,
    )


def _result(
    problem: _Problem, fit: _Fit, start: RobotWorldResult, usable: IntArray
) -> HandEyeResult:
    pictures, data = problem.pictures, problem.data
    kept = np.flatnonzero(fit.good)
    estimate = identify(fit.model, data[kept], start=fit.x, name="hand-eye calibration")
    x = estimate.values
    every = fit.parts
    residuals = fit.model.linearise(data.postures, x, data.setup, data.observed).rows
    left = np.full(len(data.names), np.nan)
    left[kept] = _rms(estimate.leave_one_out, data.setup[kept])
    poses = [
        pose_of(block, x[part])
        for block, part in zip(fit.model.parameters[:2], fit.model.slices[:2], strict=True)
    ]
    lens = problem.lens
    for block, part in zip(fit.model.parameters, fit.model.slices, strict=True):
        if isinstance(block, LensParameters):
            lens = lens.with_values(block.all_values(x[part][:, None])[:, 0])
    status: list[PictureStatus] = [
        "no posture" if shows else "no board" for shows in pictures.with_board
    ]
    for i, good in zip(usable.tolist(), fit.good, strict=True):
        status[i] = "used" if good else "contradicts the others"
    N = len(pictures.names)
    distance = _distance(pictures, data, poses[0], poses[1])
    return HandEyeResult(
        carried=pictures.carried,
        X=poses[0],
        Z=poses[1],
        lens=lens,
        lens_estimated=problem.free_lens,
        estimate=estimate,
        sigma_px=fit.sigma_px,
        arm_sigma=fit.arm_sigma,
        names=pictures.names,
        status=tuple(status),
        rms_px=_spread(N, usable, _rms(residuals, data.setup)),
        scatter_px=_spread(
            N, usable, fit.sigma_px * np.sqrt(every.within / np.maximum(every.within_rows, 1.0))
        ),
        off=_spread(N, usable, every.off),
        left_out_px=_spread(N, usable, left),
        distance_m=distance,
        point_sigma_m=_point_sigma(fit.model, estimate, pictures.carried, lens, distance),
        scale=(0.0, np.inf),
        start=start,
        warnings=(),
    )


def _rms(rows: FloatArray, setup: Setup) -> FloatArray:
    """Rms ``(N,)`` of rows ``(N, m)`` that were seen."""
    seen = np.ones(rows.shape, dtype=bool) if setup.seen is None else setup.seen
    squares = np.sum(np.where(seen, rows, 0.0) ** 2, axis=1)
    return np.asarray(np.sqrt(squares / np.maximum(seen.sum(axis=1), 1)))


def _spread(count: int, rows: IntArray, values: FloatArray) -> FloatArray:
    out = np.full((count, *values.shape[1:]), np.nan)
    out[rows] = values
    return out


def _distance(pictures: Pictures, data: Measurements, X: FloatArray, Z: FloatArray) -> float:
    """Median distance [m] of the middle of the board from the camera."""
    middle = np.append(pictures.board.mean(axis=0), 1.0)
    flange = pictures.robot.fk(data.postures)
    if pictures.carried == "camera":
        seen = se3.inverse(flange @ X) @ (Z @ middle)
    else:
        seen = (se3.inverse(Z) @ flange @ X) @ middle
    return float(np.median(np.linalg.norm(seen[:, :3], axis=1)))


def _point_sigma(
    model: CalibrationModel,
    estimate: IdentificationResult,
    carried: Carried,
    lens: Lens,
    distance: float,
) -> float:
    """Standard deviation [m] of a point in the middle of the picture: see `HandEyeResult`."""
    middle = np.array([lens.width_px, lens.height_px]) / 2.0
    point = distance * np.append(lens.rays(middle), 1.0)
    gain = seen_point_motion(model, estimate.values, carried, lens, point[None])[0]
    return float(np.sqrt(np.trace(gain @ estimate.covariance @ gain.T)))
