"""Camera, board and lens, and the robot where asked, in one estimate over pixels.

The pictures give a lens and poses of the board, these A X = Z B, and its solution starts the
estimate: the pixels of all points at once, weighed by their noise and by how far the arm stops
from where it says. Both are found from the pictures where they are not given. A picture that
contradicts the others, by a wrong row of joints or points in wrong places, takes no part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calib import se3
from calib.chance import chi2_quantile, f_bound
from calib.errors import ConvergenceError, InputError
from calib.hand_eye.checks import (
    Step,
    Suspicion,
    explain_misfit,
    find_half_turns,
    step_with,
    suspicion_of_arm,
    suspicion_of_board,
    suspicion_of_lens,
    suspicion_of_move,
    unmirrored_poses,
)
from calib.hand_eye.noise import (
    Deviations,
    arm_deviation,
    deviations,
    pixel_scale,
    squares_of_pictures,
)
from calib.hand_eye.result import HandEyeResult, PictureStatus
from calib.hand_eye.start import FEWEST_POINTS, board_poses, lens_parameters, start_lens
from calib.identification import IdentificationResult, identify, minimise
from calib.identification.robust import not_converged
from calib.lens import Lens, LensName, project
from calib.model import CalibrationModel, Setup
from calib.model.measurements import BoardShape, BoardView, Measurements, board_views
from calib.model.measurements.board_view import Carried
from calib.model.parameters import (
    BoardErrors,
    Frames,
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

_MOST_NAMED = 8

_BESIDE = 1.0
"""Rms of the residuals, in sides of a picture, from which a fit has run away."""

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
    half_turn : bool
        Whether the board looks the same after half a turn, so that pictures show it either way
        round: its points then stand in the opposite order.
    """

    robot: Robot
    postures: FloatArray
    pixels: FloatArray
    board: FloatArray
    size_px: tuple[int, int]
    carried: Carried = "camera"
    names: tuple[str, ...] = ()
    half_turn: bool = False

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
    if pictures.half_turn:
        pixels, poses = _the_same_way_round(pictures, postures, pixels, poses, found)
    data = board_views(postures, pixels, [pictures.names[i] for i in usable])
    problem = _Problem(pictures, data, first, is_free, tuple(free), tuple(board_errors))
    try:
        start = _solved_pairs(pictures, postures[found], poses[found])
        good = found.copy()
        good[found] = start.used
        fit = _fitted(problem, start.X, start.Z, good, sigma_px, arm_sigma)
    except (InputError, ConvergenceError) as error:
        why = explain_misfit(
            pictures.robot.fk(postures[found]),
            poses[found],
            pictures.carried,
            [name for name, there in zip(data.names, found, strict=True) if there],
            unmirrored_poses(first, pictures.board, pixels[found]),
        )
        if not why:
            raise
        raise InputError(f"the pictures do not fit together: {why}", name="pictures") from error
    return _result(problem, fit, start, usable)


def _the_same_way_round(
    pictures: Pictures,
    postures: FloatArray,
    pixels: FloatArray,
    poses: FloatArray,
    found: BoolArray,
) -> tuple[FloatArray, FloatArray]:
    """Pixels and poses with the points of a board in one order that looks alike half turned."""
    middle = (pictures.board.max(axis=0) + pictures.board.min(axis=0)) / 2.0
    half = se3.transform(np.diag([-1.0, -1.0, 1.0]), 2.0 * middle * [1.0, 1.0, 0.0])
    flips = np.zeros(len(poses), dtype=bool)
    A = pictures.robot.fk(postures[found])
    flips[found] = find_half_turns(A, poses[found], half, pictures.carried)
    return (
        np.where(flips[:, None, None], pixels[:, ::-1], pixels),
        np.where(flips[:, None, None], poses @ half, poses),
    )


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
            blocks.append(lens_parameters(self.lens))
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
    noise_found: tuple[bool, bool]
    """Of pixels and arm: whether it was found, not given."""
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
    noise_found = sigma_px is None, arm_sigma is None
    model = problem.model(X, Z, pixel, arm)
    x, still = model.nominal, False
    for _ in range(_ROUNDS):
        kept = np.flatnonzero(good)
        model = problem.model(X, Z, pixel, arm)
        x = _minimised(model, problem.data[kept], x, problem.pictures.size_px)
        if still:  # the noise is that of these pictures: who else is within it?
            parts = deviations(model, problem.data, x)
            again = _within_noise(parts, arm, good, arm_found=noise_found[1])
            if 2 * again.sum() < len(again):
                raise _contradiction(int((~again).sum()), len(again))
            if (again == good).all():
                break
            good, still = again, False
            continue
        some = deviations(model, problem.data[kept], x)
        before = np.array([pixel, *arm])
        pixel, arm = _noise_of(some, pixel, arm, noise_found)
        after = np.array([pixel, *arm])
        still = bool((np.abs(after - before) <= _SETTLED * after + _NOTHING).all())
    return _Fit(model, x, good, pixel, arm, noise_found, deviations(model, problem.data, x))


def _noise_of(
    parts: Deviations, pixel: float, arm: tuple[float, float], found: tuple[bool, bool]
) -> tuple[float, tuple[float, float]]:
    """Noise of pixels and arm, what of it is to be found."""
    if found[0]:
        scale = pixel_scale(parts)
        pixel *= scale
        parts = _with_pixels(parts, scale)
    return pixel, arm_deviation(parts) if found[1] else arm


def _within_noise(
    parts: Deviations, arm: tuple[float, float], used: BoolArray, *, arm_found: bool
) -> BoolArray:
    """Pictures ``(N,)`` whose deviation and scatter the noise explains.

    Where it was found from as many pictures, it is less surely what it is.
    """
    squares = squares_of_pictures(parts, arm, used)
    bound = float(chi2_quantile(1.0 - OUTLIER_CHANCE, 6))
    if arm_found:
        freedom = max(3 * int(used.sum()) - 6, 1)  # of places alone, or turns: X and Z take six
        bound = 6.0 * float(f_bound(OUTLIER_CHANCE, 6, freedom))
    scatter = np.sqrt(parts.within / np.maximum(parts.within_rows, 1.0))
    return np.asarray((squares <= bound) & (scatter <= SCATTERED))


def _minimised(
    model: CalibrationModel, data: Measurements, x: FloatArray, size_px: tuple[int, int]
) -> FloatArray:
    found = minimise(model, data.trials(None), x[None])
    if not found.converged[0]:
        raise not_converged(float(found.change[0]))
    rows = model.linearise(data.postures, found.x[0], data.setup, data.observed).rows
    if np.sqrt(np.mean(rows**2)) > _BESIDE * max(size_px):
        raise ConvergenceError(
            "the estimate has not converged: it shows the board far beside where it was seen",
            hint="are lengths of the arm and the board in the units that are said?",
        )
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
        _pose_of(block, x[part])
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
    board, suspicions = _suspicions(problem, fit)
    warnings = [*_outliers_in_words(data.names, fit.good), *suspicions]
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
        scale=_scale(estimate, board),
        start=start,
        warnings=tuple(warnings),
    )


def _suspicions(problem: _Problem, fit: _Fit) -> tuple[Step | None, list[str]]:
    """What errors of the board would be, and what looks wrong, what explains most first."""
    kept = np.flatnonzero(fit.good)
    data, found = problem.data[kept], list[Suspicion | None]()
    fitted = dict(zip(fit.model.names, fit.x, strict=True))

    def tried(new: Sequence[str], **more: Any) -> Step:
        """With the noise that is left with them: without, it has taken them up."""
        model = problem.model(X, Z, fit.sigma_px, fit.arm_sigma, **more)
        pairs = zip(model.names, model.nominal, strict=True)
        x = np.array([fitted.get(name, nominal) for name, nominal in pairs])
        noise = _noise_of(deviations(model, data, x), fit.sigma_px, fit.arm_sigma, fit.noise_found)
        return step_with(problem.model(X, Z, *noise, **more), data, x, new)

    X, Z = (block.T_nominal[0] for block in fit.model.parameters[:2] if isinstance(block, Frames))
    board = None
    if not problem.board_errors:
        every = BoardErrors(free=("scale", "bend_x", "bend_y"))
        board = tried(every.names, board_errors=("scale", "bend_x", "bend_y"))
        found.append(suspicion_of_board(board))
    if not problem.free_lens:
        step = tried(LensParameters(problem.lens).names, free_lens=True)
        found.append(suspicion_of_lens(step, problem.lens))
    in_hand = problem.pictures.carried == "camera"
    words = ("camera", "board") if in_hand else ("board", "camera")
    frames = dict(zip(words, np.arange(12).reshape(2, 6), strict=True))
    parts = deviations(fit.model, data, fit.x)
    found.append(suspicion_of_move(parts, fit.arm_sigma, frames, data.names))
    found.append(suspicion_of_arm(fit.arm_sigma))
    order = sorted((s for s in found if s is not None), key=lambda one: -one.gain)
    return board, [one.text for one in order]


def _scale(estimate: IdentificationResult, board: Step | None) -> tuple[float, float]:
    """How much larger the board seems to be, and its standard deviation."""
    name = "board.board.scale"
    if name in estimate.names:
        return estimate.value(name), float(estimate.sigma[estimate.names.index(name)])
    return (0.0, np.inf) if board is None else (float(board.values[0]), float(board.sigma[0]))


def _outliers_in_words(names: Sequence[str], good: BoolArray) -> list[str]:
    """Pictures that contradict the others, and whether all of them are at one end."""
    out = np.flatnonzero(~good)
    if not len(out):
        return []
    first, last = int(out[0]), int(out[-1])
    if len(out) > 2 and last - first + 1 == len(out):
        moved = "the board or the camera was moved; they take no part"
        if last == len(good) - 1:
            return [f"all pictures from {names[first]} on contradict those before: {moved}"]
        if first == 0:
            return [f"all pictures before {names[last + 1]} contradict those from it on: {moved}"]
    shown = ", ".join(names[i] for i in out[:_MOST_NAMED].tolist())
    more = f" and {len(out) - _MOST_NAMED} more" if len(out) > _MOST_NAMED else ""
    return [
        f"left out, as they contradict the others: {shown}{more} (wrong joints, or points in wrong "
        "places?)"
    ]


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
    which = 0 if carried == "camera" else 1
    block, part = model.parameters[which], model.slices[which]
    x, covariance = estimate.values, estimate.covariance
    middle = np.array([lens.width_px, lens.height_px]) / 2.0
    point = distance * np.append(lens.rays(middle), 1.0)
    gain = np.zeros((3, model.p))
    for k in range(part.start, part.stop):
        ahead, behind = (
            _pose_of(block, x[part] + step * (np.arange(model.p)[part] == k))
            for step in (_STEP, -_STEP)
        )
        gain[:, k] = ((ahead - behind) @ np.append(point, 1.0))[:3] / (2.0 * _STEP)
    for other, own in zip(model.parameters, model.slices, strict=True):
        if isinstance(other, LensParameters):
            seen = project(lens.name, np.array(lens.values)[:, None], point[:, None, None])
            across = np.linalg.solve(seen.by_point[:, :2, 0, 0], -seen.by_lens[:, :, 0, 0].T)
            moved = other.picked(np.vstack([across, np.zeros(across.shape[1])]).T).T
            gain[:, own] = _pose_of(block, x[part])[:3, :3] @ moved
    return float(np.sqrt(np.trace(gain @ covariance @ gain.T)))


_STEP = 1e-6
"""Of differences of poses [m, rad]: their curvature is far below rounding then."""


def _pose_of(block: ParameterBlock, values: FloatArray) -> FloatArray:
    if not isinstance(block, Frames):
        raise TypeError("X and Z are frames")
    return np.asarray(block.poses(values)[0])
