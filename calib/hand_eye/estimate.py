"""Cameras, boards and lenses, and the robot where asked, in one estimate over pixels.

The pictures give a lens and poses of the board, these A X = Z B, and its solution starts the
estimate: the pixels of all points at once, weighed by their noise and by how far the arm stops
from where it says. Both are found from the pictures where they are not given. A picture that
contradicts the others, by a wrong row of joints or points in wrong places, takes no part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from calib.chance import chi2_quantile, f_bound
from calib.errors import ConvergenceError, InputError
from calib.hand_eye import checks
from calib.hand_eye.arm import (
    NO_KINDS,
    ArmErrors,
    Sizes,
    likeliest,
    some_columns,
    with_move,
    with_pattern,
)
from calib.hand_eye.noise import squares_of_pictures, wrong_points
from calib.hand_eye.pictures import Pictures
from calib.hand_eye.points import poses_of, seen_point_motion
from calib.hand_eye.problem import Noise, Prepared, Problem
from calib.hand_eye.result import ArmError, HandEyeResult, PictureStatus
from calib.hand_eye.views import Views
from calib.identification import IdentificationResult, identify, minimise
from calib.identification.deviations import (
    LEAST_ARM,
    Deviations,
    arm_deviation,
    deviations,
    noise_within,
)
from calib.identification.robust import not_converged
from calib.judgement import Finding
from calib.lens import Lens, LensName
from calib.model import CalibrationModel, Linearisation, Setup
from calib.model.measurements import Measurements
from calib.model.parameters import AXES, BoardErrors, LensParameters, ParameterBlock
from calib.one_thread import one_blas_thread
from calib.se3 import BoolArray, FloatArray, IntArray

OUTLIER_CHANCE = 1e-4
"""Probability that noise alone takes a picture as far off as one that is left out."""

SCATTERED = 3.0
"""Scatter of the points of a picture, over that of all, from which it is left out: points lie in
wrong places, or it is blurred."""

_MOST_ROUNDS_OF_POINTS = 3
"""Times that points in wrong places are looked for: taken out, they no longer hide others."""

LEAST_SCATTER_PX = 0.25
"""Scatter that no picture is left out for, however little the others have."""

_MOST_NAMED = 8

_BESIDE = 1.0
"""Rms of the residuals, in sides of a picture, from which a fit has run away."""

_USUAL_PX = 0.3
_USUAL_ARM = (1e-3, 2e-3)
"""Noise to start from [px, m, rad]."""

_ROUNDS = 30

_LESS_AT_ONCE = 10.0
"""Factor by which the deviation of the arm falls from one fit to the next at most."""

TOLD_APART = 10.0
"""Twice the logarithm of how much likelier one cause has to be than another to be named alone."""

ERRORS_OF_ARM = 20.0
"""Twice the logarithm of how much likelier pictures have to be by an arm with errors than by one
that only stops off, before its errors are taken into account."""


@one_blas_thread
def calibrate(
    pictures: Pictures | Sequence[Pictures],
    lens: LensName | Lens | Mapping[str, LensName | Lens] = "pinhole",
    *,
    free_lens: bool | None = None,
    free: Sequence[ParameterBlock] = (),
    sigma_px: float | None = None,
    arm_sigma: tuple[float, float] | None = None,
    board_errors: Sequence[str] = (),
    arm: ArmErrors | None = None,
) -> HandEyeResult:
    """Estimate where cameras and boards are, the lenses, and parameters of the robot.

    Parameters
    ----------
    pictures : Pictures or sequence of Pictures
        Of one board by one camera; or several such, of one robot, with cameras and boards by name.
    lens : str, Lens or mapping of these
        The lens as calibrated before, or the name of its model; of each camera by its name.
    free_lens : bool, optional
        Whether to estimate it; where none is given, by default.
    free : sequence of ParameterBlock
        What else to estimate, of the robot.
    sigma_px : float, optional
        Noise of a coordinate of a point; from the scatter within pictures by default, for each
        camera its own.
    arm_sigma : tuple of two floats, optional
        How far the arm stops from where it says: standard deviations along each axis [m] and
        about each axis [rad]; from what is left between pictures by default.
    board_errors : sequence of str
        Errors of the board's print to estimate: ``scale``, ``bend_x``, ``bend_y``. Without any,
        those that the pictures show are estimated where prints are off by as much.
    arm : ArmErrors, optional
        What may be off on the arm. It is taken into account where the pictures show it.

    Raises
    ------
    InputError
        Too few pictures, or most of them contradict the others.
    NotIdentifiableError
        The motion, or the views, do not tell what is asked for.
    """
    sets = [pictures] if isinstance(pictures, Pictures) else list(pictures)
    prepared = [
        Prepared.of(one, lens[one.camera] if isinstance(lens, Mapping) else lens, free_lens)
        for one in sets
    ]
    problem = Problem(tuple(prepared), tuple(free), tuple(board_errors))
    whole = problem if arm is None else replace(problem, free=(*free, *arm.blocks), arm=arm)
    good = np.concatenate([one.good for one in prepared])
    noise = sigma_px, arm_sigma
    try:
        try:
            fit = _fitted(problem, good, *noise)
        except ConvergenceError:
            if arm is None:
                raise
            problem, fit = whole, _fitted(whole, good, *noise)  # errors too large to go without
    except (InputError, ConvergenceError) as error:
        raise prepared[0].explained(error) from error
    moved, or_else = _likeliest_move(problem, fit), ""
    if problem.arm is None and (moved or arm is not None):
        cause = _cause(whole, fit, moved)
        if cause == "arm" and arm is not None:
            with suppress(InputError, ConvergenceError):  # else the deviation stands for them
                problem, fit = whole, _fitted(whole, good, *noise, fit)
                moved = _likeliest_move(problem, fit)
        elif cause != "move":
            or_else = "the arm has errors of its own"
    size, prints = _of_prints(problem, fit)
    lenses = _of_lenses(problem, fit)
    rivals = [one.gain for one in lenses] + ([moved.over] if moved else [])
    taken = next(
        (one for one in prints if one.is_printed and one.gain >= max([0.0, *rivals])), None
    )
    if taken:
        with suppress(InputError, ConvergenceError):  # else it is named, and not in the answer
            problem = replace(problem, board_errors=taken.errors)
            fit = _fitted(problem, good, *noise, fit)
            moved, lenses = _likeliest_move(problem, fit), _of_lenses(problem, fit)
            prints = [replace(taken, is_accounted=True)]
    suspicions = [*prints, *lenses]
    if moved:
        suspicions.append(moved.suspicion(_frames(fit.model), or_else))
    if arm_off := checks.suspicion_of_arm(fit.noise.arm):
        suspicions.append(arm_off)
    return _result(problem, fit, size, sorted(suspicions, key=lambda one: -one.gain))


def _likeliest_move(problem: Problem, fit: _Fit) -> checks.Move | None:
    """Return the move of a camera or a board that the pictures show, if they show one."""
    data = fit.data[np.flatnonzero(fit.good)]
    names = list(dict.fromkeys(data.names))
    moment = np.array([names.index(name) for name in data.names])
    each = replace(data, setup=replace(data.setup, stop=moment))
    parts = deviations(fit.model.linearise_at(each, fit.x), turns=True)
    groups = np.zeros(len(names), dtype=np.intp)
    groups[moment] = data.setup.stops
    return checks.likeliest_move(
        parts,
        groups,
        fit.noise.arm,
        _frames(fit.model),
        names,
        arm_known=not fit.noise_found[1],
    )


def _frames(model: CalibrationModel) -> dict[str, IntArray]:
    """Return the columns of the position and rotation of each camera and board."""
    return {
        label: np.array([model.names.index(f"{stem}.{label}.{axis}") for axis in AXES])
        for stem, labels in (("tool", model.tools), ("target", model.targets))
        for label in labels
    }


def _cause(
    whole: Problem, fit: _Fit, moved: checks.Move | None
) -> Literal["none", "arm", "move", "either"]:
    """Return the cause that makes the pictures likeliest: errors of the arm, a move, or neither.

    By one linearisation at a fit without either, and restricted likelihoods. Without joints, errors
    of the arm are those of a deviation that changes with the pose of the flange.
    """
    data = fit.data[np.flatnonzero(fit.good)]
    noise = replace(fit.noise, log_shares=whole.sizes.centre)
    model = whole.model(noise)
    linear = model.linearise_at(data, _at(model, fit))
    parts, sizes = deviations(linear, turns=True), whole.sizes
    simple = some_columns(parts, sizes.without)
    kinds = sizes.kinds(linear.values[:, 0])
    if whole.arm is None:
        flange = model.robot.fk(data.postures)
        parts, kinds = with_pattern(parts, flange)
    find = partial(likeliest, arm_known=not fit.noise_found[1])
    theta = np.log(np.maximum(noise.arm, LEAST_ARM))
    try:
        _, alone = find(simple, NO_KINDS, theta)
        _, arm = find(parts, kinds, np.append(theta, kinds.centre))
        move = np.inf
        if moved:
            move = alone - moved.step.gain
            if len(moved.behind) == len(parts.off):
                _, move = find(with_move(simple, moved.columns, moved.behind), NO_KINDS, theta)
    except ConvergenceError:
        return "none"
    if alone - min(arm, move) < ERRORS_OF_ARM:
        return "move" if moved else "none"
    if abs(arm - move) < TOLD_APART:
        return "either"
    return "arm" if arm < move else "move"


def _at(model: CalibrationModel, fit: _Fit) -> FloatArray:
    """Return the parameters ``(p,)`` of a fit, of a model that may have more; these at nominal."""
    fitted = dict(zip(fit.model.names, fit.x, strict=True))
    pairs = zip(model.names, model.nominal, strict=True)
    return np.array([fitted.get(name, nominal) for name, nominal in pairs])


@dataclass(frozen=True, eq=False)
class _Fit:
    """A fit to the pictures that agree; ``parts`` are those of all stops.

    ``data`` is without points in wrong places.
    """

    model: CalibrationModel
    data: Measurements
    x: FloatArray
    good: BoolArray
    noise: Noise
    noise_found: tuple[bool, bool]
    """Of pixels and arm: whether it was found, not given."""
    parts: Deviations


def _fitted(
    problem: Problem,
    good: BoolArray,
    sigma_px: float | None,
    arm_sigma: tuple[float, float] | None,
    start: _Fit | None = None,
) -> _Fit:
    """Fit, find the noise, and who is beyond it, in turns, until nothing moves."""
    pixel = dict.fromkeys(problem.lenses, sigma_px or _USUAL_PX)
    noise = Noise(pixel, arm_sigma or _USUAL_ARM, problem.sizes.centre)
    if start is not None:
        noise = replace(start.noise, log_shares=problem.sizes.centre)
    cameras = np.array(problem.cameras)
    noise_found = sigma_px is None, arm_sigma is None
    data, model = problem.data, problem.model(noise)
    stops, rounds = data.setup.stops, 0
    x, still = model.nominal if start is None else _at(model, start), False
    for _ in range(_ROUNDS):
        kept = np.flatnonzero(good)
        model = problem.model(noise)
        x, linear = _minimised(model, data[kept], x, problem.largest_px)
        if still:  # the noise is that of these pictures: who else is within it?
            parts = deviations(linear if good.all() else model.linearise_at(data, x), turns=True)
            if rounds < _MOST_ROUNDS_OF_POINTS:
                rounds += 1
                wrong = _wrong_points(parts, data)
                if wrong.any():
                    seen = _seen(data.setup) & ~np.repeat(wrong, 2, axis=1)
                    data, still = replace(data, setup=replace(data.setup, seen=seen)), False
                    continue
            used = np.zeros(len(parts.off), dtype=bool)
            used[stops[good]] = True
            each = np.array([noise.pixel[camera] for camera in problem.cameras])
            again = _within_noise(parts, each, noise.arm, used, arm_found=noise_found[1])
            if 2 * again.sum() < len(again):
                raise _contradiction(int((~again).sum()), len(again))
            if (again == good).all():
                return _Fit(model, data, x, good, noise, noise_found, parts)
            good, still = again, False
            continue
        some = deviations(linear, turns=True)
        before = noise
        noise = _noise_of(problem.sizes, some, cameras[kept], noise, noise_found, x)
        still = noise.is_near(before)
    parts = deviations(model.linearise_at(data, x), turns=True)
    return _Fit(model, data, x, good, noise, noise_found, parts)


def _wrong_points(parts: Deviations, data: Measurements) -> BoolArray:
    """Points ``(N, K)`` in wrong places, of pictures most of whose points stay."""
    points = _seen(data.setup)[:, ::2]
    wrong = wrong_points(parts, points)
    return np.asarray(wrong & (2 * wrong.sum(axis=1) < points.sum(axis=1))[:, None])


def _noise_of(
    sizes: Sizes,
    parts: Deviations,
    cameras: NDArray[np.str_],
    noise: Noise,
    found: tuple[bool, bool],
    x: FloatArray,
) -> Noise:
    """Return the noise of each camera and of the arm, and sizes of its errors, what is unknown."""
    if found[0]:
        # errors of the arm move whole boards: they are no part of what is left within pictures
        inside = some_columns(parts, sizes.without)
        scale = {camera: noise_within(inside, cameras == camera)[0] for camera in noise.pixel}
        pixel = {camera: scale[camera] * sigma for camera, sigma in noise.pixel.items()}
        noise = replace(noise, pixel=pixel)
        parts = parts.of_noise(np.array([scale[camera] for camera in cameras]))
    if len(sizes.sized):
        theta = np.append(np.log(np.maximum(noise.arm, LEAST_ARM)), noise.log_shares)
        theta, _ = likeliest(parts, sizes.kinds(x), theta, arm_known=not found[1])
        # not all at once: far from a solution a fit cannot follow too narrow a valley
        arm = np.maximum(np.exp(theta[:2]), np.array(noise.arm) / _LESS_AT_ONCE)
        arm = np.where(arm > 2.0 * np.array(LEAST_ARM), arm, 0.0)
        m, rad = arm.tolist() if found[1] else noise.arm
        return replace(noise, arm=(m, rad), log_shares=theta[2:])
    return replace(noise, arm=arm_deviation(parts, noise.arm)) if found[1] else noise


def _within_noise(
    parts: Deviations,
    pixel: FloatArray,
    arm: tuple[float, float],
    used: BoolArray,
    *,
    arm_found: bool,
) -> BoolArray:
    """Pictures ``(N,)`` whose scatter, and stop, the noise explains.

    Where it was found from as many of them, it is less surely what it is.
    """
    squares = squares_of_pictures(parts, arm, used)
    bound = float(chi2_quantile(1.0 - OUTLIER_CHANCE, 6))
    if arm_found:
        freedom = max(3 * int(used.sum()) - 6, 1)  # of places alone, or turns: X and Z take six
        bound = 6.0 * float(f_bound(OUTLIER_CHANCE, 6, freedom))
    scatter = np.sqrt(parts.scatter)
    within = (scatter <= SCATTERED) | (scatter * pixel <= LEAST_SCATTER_PX)
    return np.asarray((squares <= bound)[parts.stops] & within)


def _minimised(
    model: CalibrationModel, data: Measurements, x: FloatArray, largest_px: float
) -> tuple[FloatArray, Linearisation]:
    found = minimise(model, data.trials(None), x[None])
    if not found.converged[0]:
        raise not_converged(float(found.change[0]))
    linear = model.linearise_at(data, found.x[0])
    if np.sqrt(np.mean(linear.rows**2)) > _BESIDE * largest_px:
        raise ConvergenceError(
            "the estimate has not converged: it shows the board far beside where it was seen",
            hint="are lengths of the arm and the board in the units that are said?",
        )
    return found.x[0], linear


def _contradiction(bad: int, count: int) -> InputError:
    return InputError(
        f"{bad} of {count} pictures contradict the others: which are right cannot be told",
        hint="do pictures and joints belong together, in this order, and did the board stay still?",
        name="pictures",
        value=bad,
        bound=count // 2,
    )


def _result(
    problem: Problem, fit: _Fit, size: checks.Step | None, suspicions: Sequence[checks.Suspicion]
) -> HandEyeResult:
    data, stops = fit.data, fit.data.setup.stops
    kept = np.flatnonzero(fit.good)
    estimate = identify(fit.model, data[kept], start=fit.x, name="hand-eye calibration")
    x = estimate.values
    residuals = fit.model.linearise_at(data, x).rows
    observed = residuals if data.observed is None else data.observed
    left = np.full(len(data.names), np.nan)
    left[kept] = _rms(estimate.leave_one_out, data.setup[kept])
    true_poses = poses_of(fit.model, x)
    lenses = _lenses_of(problem, fit.model, x)
    first = problem.prepared[0].pictures
    at_work = _at_work(problem, fit, estimate, true_poses, lenses)
    poses = at_work.poses
    X, Z = (poses[label] for label in first.labels)
    pixel = np.array([fit.noise.pixel[camera] for camera in problem.cameras])
    middles, depths = _middles(problem, true_poses)
    distance = float(np.median(depths[: len(problem.prepared[0].usable)]))
    lens = lenses[first.camera]
    middle = np.array([lens.width_px, lens.height_px]) / 2.0
    point = distance * np.append(lens.rays(middle), 1.0)
    (gain,) = seen_point_motion(fit.model, x, first.camera, lens, point[None], first.camera)
    names, status, at = _listed(problem, fit.good)
    off = fit.parts.off[stops]
    off[:, :3] += np.cross(off[:, 3:], middles)

    def listed(values: FloatArray) -> FloatArray:
        """Of all pictures, NaN for those that were not usable."""
        out = np.full((len(names), *values.shape[1:]), np.nan)
        out[at] = values
        return out

    return HandEyeResult(
        carried=first.carried,
        X=X,
        Z=Z,
        labels=first.labels,
        poses=poses,
        true_poses=true_poses,
        arm_errors=at_work.arm_errors,
        lens=lens,
        lenses=lenses,
        lens_estimated=problem.prepared[0].free_lens,
        estimate=estimate,
        sigma_px=fit.noise.pixel[first.camera],
        sigmas_px=fit.noise.pixel,
        arm_sigma=fit.noise.arm,
        names=names,
        status=status,
        rms_px=listed(_rms(residuals, data.setup)),
        scatter_px=listed(pixel * np.sqrt(fit.parts.scatter)),
        pixels=listed(_of_points(observed, data.setup)),
        residuals_px=listed(_of_points(residuals, data.setup)),
        within_px=listed(_of_points(pixel[:, None] * fit.parts.left, data.setup)),
        off=listed(off),
        left_out_px=listed(left),
        distance_m=distance,
        point_sigma_m=at_work.error_m,
        corrected_point_sigma_m=at_work.corrected_error_m,
        seen_sigma_m=float(np.sqrt(np.trace(gain @ estimate.covariance @ gain.T))),
        scale=_scale(estimate, size),
        start=problem.prepared[0].start,
        findings=(
            *_outliers(problem, data.names, fit.good),
            *(checks.as_estimated(one, estimate) for one in suspicions),
        ),
    )


@dataclass(frozen=True, eq=False)
class _AtWork:
    """Camera and board for the controller, and the errors to expect of the first camera."""

    poses: dict[str, FloatArray]
    error_m: float
    corrected_error_m: float
    arm_errors: tuple[ArmError, ...]


def _at_work(
    problem: Problem,
    fit: _Fit,
    estimate: IdentificationResult,
    poses: dict[str, FloatArray],
    lenses: Mapping[str, Lens],
) -> _AtWork:
    """Return what an arm does at other views of the board, see :mod:`calib.hand_eye.views`."""
    taken, x, used = dict(poses), estimate.values, 0
    found: _AtWork | None = None
    for one in problem.prepared:
        pictures, good = one.pictures, fit.good[used : used + len(one.usable)]
        used += len(good)
        lens = lenses[pictures.camera]
        views = Views.drawn(pictures, lens, poses, one.postures[good])
        flange = fit.model.tip_poses(views.postures, x)
        lost = 0.0
        if problem.arm is not None:
            taken |= views.best_poses(poses, flange)
            lost = float(np.mean(np.sum(views.apart(poses, flange, taken)[:, 0] ** 2, axis=1)))
        if found is not None:
            continue
        L, lever = views.unknown(fit.model, x, pictures.camera, lens)
        unknown = float(np.mean(np.einsum("vip,pq,viq->v", L, estimate.covariance, L)))
        m, rad = fit.noise.arm
        unknown += 3.0 * m**2 + 2.0 * rad**2 * float(np.mean(lever**2))
        J = L.reshape(-1, fit.model.p)
        frames = J[:, np.concatenate(list(_frames(fit.model).values()))]
        errors = []
        for name, own in zip(problem.sizes.names, problem.sizes.members, strict=True):
            shift = J[:, own] @ (x - fit.model.nominal)[own]
            shift = shift - frames @ np.linalg.lstsq(frames, shift, rcond=1e-9)[0]
            errors.append(ArmError(name, float(np.sqrt(3.0 * np.mean(shift**2)))))
        errors.sort(key=lambda error: -error.rms_m)
        both = float(np.sqrt(lost + unknown)), float(np.sqrt(unknown))
        found = _AtWork(taken, *both, tuple(errors))
    return cast(_AtWork, found)


def _lenses_of(problem: Problem, model: CalibrationModel, x: FloatArray) -> dict[str, Lens]:
    found = {camera: lens for camera, (lens, _) in problem.lenses.items()}
    for block, part in zip(model.parameters, model.slices, strict=True):
        if isinstance(block, LensParameters):
            values = block.all_values(x[part][:, None])[:, 0]
            found[block.label] = block.lens.with_values(values)
    return found


def _listed(
    problem: Problem, good: BoolArray
) -> tuple[tuple[str, ...], tuple[PictureStatus, ...], IntArray]:
    """Names and status of all pictures, and where among them those are that were usable."""
    names: list[str] = []
    status: list[PictureStatus] = []
    at: list[int] = []
    several = len(problem.lenses) > 1
    for one in problem.prepared:
        pictures = one.pictures
        at += (len(names) + one.usable).tolist()
        names += [f"{pictures.camera}/{n}" if several else n for n in pictures.names]
        status += [
            "copy" if usable else "no posture" if shows else "no board"
            for usable, shows in zip(pictures.usable, pictures.with_board, strict=True)
        ]
    for i, is_good in zip(at, good.tolist(), strict=True):
        status[i] = "used" if is_good else "contradicts the others"
    return tuple(names), tuple(status), np.array(at)


def _of_prints(
    problem: Problem, fit: _Fit
) -> tuple[checks.Step | None, list[checks.PrintSuspicion]]:
    """Try another size of the boards, and a bend: the step for the first, and findings.

    Nothing where errors of the boards are estimated.
    """
    frames, found = list(_frames(fit.model).values()), []
    sizes = []
    for board in () if problem.board_errors else problem.boards:
        size, every = (
            _tried(problem, fit, BoardErrors(board, errors).names, board_errors=errors)
            for errors in (("scale",), ("scale", "bend_x", "bend_y"))
        )
        sizes.append(size)
        found.append(checks.suspicion_of_print(board, size, every, frames))
    first = sizes[0] if sizes else None
    return first, sorted((one for one in found if one is not None), key=lambda one: -one.gain)


def _of_lenses(problem: Problem, fit: _Fit) -> list[checks.Suspicion]:
    """Return findings of lenses that were given."""
    frames, found = list(_frames(fit.model).values()), []
    for camera, (lens, is_free) in problem.lenses.items():
        if not is_free:
            step = _tried(problem, fit, LensParameters(lens, camera).names, free_lens=True)
            found.append(checks.suspicion_of_lens(step, lens, frames))
    return [one for one in found if one is not None]


def _tried(problem: Problem, fit: _Fit, new: Sequence[str], **more: Any) -> checks.Step:
    """Try further parameters under the noise that is left with them.

    The noise of the fit has taken them up.
    """
    kept = np.flatnonzero(fit.good)
    data, cameras = fit.data[kept], np.array(problem.cameras)[kept]
    model = problem.model(fit.noise, **more)
    x = _at(model, fit)
    parts = deviations(model.linearise_at(data, x), turns=True)
    noise = _noise_of(problem.sizes_with(**more), parts, cameras, fit.noise, fit.noise_found, x)
    return checks.step_with(problem.model(noise, **more), data, x, new)


def _scale(estimate: IdentificationResult, board: checks.Step | None) -> tuple[float, float]:
    """How much larger the first board seems to be, and its standard deviation."""
    name = next((n for n in estimate.names if n.startswith("board") and "scale" in n), "")
    if name:
        return estimate.value(name), float(estimate.sigma[estimate.names.index(name)])
    return (0.0, np.inf) if board is None else (float(board.values[0]), float(board.sigma[0]))


def _outliers(problem: Problem, names: Sequence[str], good: BoolArray) -> list[Finding]:
    """Pictures that contradict the others, and whether all of them are at one end."""
    out = np.flatnonzero(~good)
    if not len(out):
        return []
    first, last = int(out[0]), int(out[-1])
    if len(problem.prepared) == 1 and len(out) > 2 and last - first + 1 == len(out):
        moved = "the board or the camera was moved; they take no part"
        if last == len(good) - 1:
            text = f"all pictures from {names[first]} on contradict those before: {moved}"
            return [Finding(text, np.nan)]
        if first == 0:
            text = f"all pictures before {names[last + 1]} contradict those from it on: {moved}"
            return [Finding(text, np.nan)]
    shown = ", ".join(names[i] for i in out[:_MOST_NAMED].tolist())
    more = f" and {len(out) - _MOST_NAMED} more" if len(out) > _MOST_NAMED else ""
    text = (
        f"left out, as they contradict the others: {shown}{more} (wrong joints, or points in wrong "
        "places?)"
    )
    return [Finding(text, 0.0, is_accounted=True)]


def _rms(rows: FloatArray, setup: Setup) -> FloatArray:
    """Rms ``(N,)`` of rows ``(N, m)`` that were seen."""
    seen = _seen(setup)
    squares = np.sum(np.where(seen, rows, 0.0) ** 2, axis=1)
    return np.asarray(np.sqrt(squares / np.maximum(seen.sum(axis=1), 1)))


def _of_points(rows: FloatArray, setup: Setup) -> FloatArray:
    """Residuals ``(N, K, 2)`` of the points of each picture; NaN where not seen."""
    return np.where(_seen(setup), rows, np.nan).reshape(len(rows), -1, 2)


def _seen(setup: Setup) -> BoolArray:
    """Rows ``(N, m)`` that were seen: views of boards say which."""
    return cast(BoolArray, setup.seen)


def _middles(problem: Problem, poses: Mapping[str, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Middle of the board of each picture, from the flange in base axes ``(N, 3)`` [m].

    And its distance from the camera ``(N,)``.
    """
    places, depths = [], []
    for one in problem.prepared:
        pictures = one.pictures
        flange = pictures.robot.fk(one.postures)
        X, Z = (poses[label] for label in pictures.labels)
        on_flange = flange @ X
        camera, board = (on_flange, Z) if pictures.carried == "camera" else (Z, on_flange)
        at = board @ np.append(pictures.board.mean(axis=0), 1.0)
        places.append(at[..., :3] - flange[:, :3, 3])
        depths.append(np.linalg.norm(at[..., :3] - camera[..., :3, 3], axis=-1))
    return np.concatenate(places), np.concatenate(depths)
