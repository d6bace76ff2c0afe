"""Causes that explain what pictures and their postures leave over, in words.

Null hypotheses: the board is as described; the lens that was given is that of the pictures; camera
and board stood still; the arm stops where it says but for a deviation that is new at each stop, and
for errors of its own. After the fit each mistake that is known is tried as further parameters,
under the noise that is left with them. One step of least squares says how large it would be, and
how much it explains, in chi squares of the noise. Errors of the arm are parameters with priors all
the while, where they were found: a size of the board or a move is not named for what they explain.
A size of the board by which prints are off, and a bend, are then estimated with the rest.
Where there is no fit, the same is asked of A X = Z B.

All checks together name a cause in at most one of two hundred sets without any. A cause is graded
by its effect on camera and board, see :mod:`calib.judgement`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import block_diag

from calib import se3
from calib.chance import chi2_quantile
from calib.errors import CalibError
from calib.hand_eye.arm import with_move
from calib.hand_eye.start import board_poses, start_lens
from calib.identification import IdentificationResult
from calib.identification.deviations import Deviations, arm_deviation
from calib.judgement import DISTRUST_SIGMAS, Finding, level_of_each
from calib.lens import Lens
from calib.model import CalibrationModel
from calib.model.measurements import Measurements
from calib.model.measurements.board_view import Carried
from calib.model.parameters import BoardErrors
from calib.robot_world import PairSets, residuals, solve_batch
from calib.robot_world.scale import by_rotations_first
from calib.se3 import BoolArray, FloatArray, IntArray

DETECTORS = 5
"""Checks of one set: size and bend of the board, doubt of the size, lens, move, arm."""

CHANCE = level_of_each(DETECTORS) / 10.0
"""Probability that normal noise makes one of the checks say something. Real pictures scatter with
heavier tails: at a tenth of the level they keep it."""

LEAST_SCALE = 1e-3
"""Share by which the size of a print is off anyway."""

DOUBTED = 2.5
"""Standard deviations by which a size of the board is off from which on a result is in doubt, where
X or Z would move with it by more than they are known: the pictures do not tell the size well enough
to say that it is wrong, and not well enough to say that it is right."""

PRINTED = 0.015
"""Share by which prints are off: a size of the board farther off is another board, or another
unit."""

FAR_OFF = np.array([2e-3, 5e-3])
"""Deviation of an arm [m, rad] that is hardly scatter alone: its zeros, or its model, are wrong."""

TOO_FAR_OFF = np.array([10e-3, 20e-3])
"""Deviation of an arm [m, rad] that even the cheapest do not have: its poses are wrong."""

FAR_BETTER = 0.3
"""Residual, in parts of that of the pictures as given, of what is said to be meant."""


@dataclass(frozen=True)
class Suspicion(Finding):
    """A cause that would explain a part of the residuals."""

    gain: float  # reduction of chi² over that which noise alone reaches


@dataclass(frozen=True, eq=False)
class Step:
    """One step of least squares with some parameters more."""

    values: FloatArray
    sigma: FloatArray  # values, sigma (k,): of the new parameters
    gain: float  # by how much chi² is lower with them
    moved: FloatArray  # (p - k,): by how much the others move with them
    moved_sigma: FloatArray
    """(p - k,): standard deviations of the others where the new ones are known."""

    @property
    def is_sure(self) -> bool:
        """Whether noise alone gains as much less often than `CHANCE`."""
        return self.over > 0

    @property
    def over(self) -> float:
        """Gain over what noise alone gains."""
        return self.gain - float(chi2_quantile(1.0 - CHANCE, len(self.values)))


def effect_of(step: Step, frames: Iterable[IntArray]) -> float:
    """Return the change of the answer, in its standard deviations, when a cause is accounted for.

    Parameters
    ----------
    frames : iterable of array (6,)
        Columns of the position and the rotation of each camera and board.
    """
    parts = [half for own in frames for half in (own[:3], own[3:])]
    lengths = np.linalg.norm([[step.moved[own], step.moved_sigma[own]] for own in parts], axis=2)
    return float(np.max(lengths[:, 0] / np.maximum(lengths[:, 1], np.finfo(float).tiny)))


def step_with(
    model: CalibrationModel, data: Measurements, x: FloatArray, new: Sequence[str]
) -> Step:
    """Try parameters that a model has beyond those of a fit; ``x`` (p,) has them at nominal."""
    linear = model.linearise(data.postures, x, data.setup, data.observed)
    J, r = linear.white_jacobian.reshape(-1, model.p), linear.white_rows.ravel()
    known, K = (part[0] for part in model.known(x[None]))
    H, g = J.T @ J + K.T @ K, J.T @ r + K.T @ known
    return _stepped(H, g, np.isin(model.names, new))


def _stepped(H: FloatArray, g: FloatArray, new: np.ndarray) -> Step:
    """The step of the new parameters, the others marginalised."""
    unit = np.sqrt(np.maximum(np.diag(H), np.finfo(float).tiny))
    H, g = H / np.outer(unit, unit), g / unit
    old = ~new
    inner = np.linalg.lstsq(
        H[np.ix_(old, old)], np.column_stack([H[old][:, new], g[old]]), rcond=1e-13
    )[0]
    S = H[np.ix_(new, new)] - H[new][:, old] @ inner[:, :-1]
    b = g[new] - H[new][:, old] @ inner[:, -1]
    values = -np.linalg.lstsq(S, b, rcond=1e-12)[0]
    sigma = np.sqrt(np.maximum(np.diag(np.linalg.pinv(S, rcond=1e-12)), 0.0))
    known = np.diag(np.linalg.pinv(H[np.ix_(old, old)], rcond=1e-13, hermitian=True))
    return Step(
        values / unit[new],
        sigma / unit[new],
        float(-values @ b),
        -(inner[:, :-1] @ values) / unit[old],
        np.sqrt(np.maximum(known, 0.0)) / unit[old],
    )


@dataclass(frozen=True)
class PrintSuspicion(Suspicion):
    """Errors of the print of a board: its size or a bend."""

    board: str  # its name
    errors: tuple[str, ...]  # what to estimate, as ``board_errors`` of ``calibrate``
    is_printed: bool  # whether prints are off by as much


def suspicion_of_print(
    board: str, size: Step, every: Step, frames: Sequence[IntArray]
) -> PrintSuspicion | None:
    """Return the finding that a board is larger than described, or bent.

    Parameters
    ----------
    board : str
        Its name.
    size, every : Step
        With the error scale alone; with scale, bend_x, bend_y.
    frames : sequence of array (6,)
        As of :func:`effect_of`.
    """
    if every.is_sure:
        text, step = text_of_print(every.values, every.sigma), every
        bent = text.startswith(_BENT)
        more = (
            "mount it on something flat, or estimate it (bend)"
            if bent
            else "check the size of its squares, the printer's scaling, and the unit; or estimate "
            "it (scale)"
        )
    else:
        step, bent = size, False
        scale, sigma = float(step.values[0]), float(step.sigma[0])
        known = abs(scale) < DOUBTED * np.hypot(sigma, LEAST_SCALE)
        if known or effect_of(step, frames) < DISTRUST_SIGMAS:
            return None
        text = (
            "the result rests on the stated size of the board, which is in doubt: measured by the "
            f"arm it is {_off_size(scale, sigma)}"
        )
        more = "measure its squares, or estimate it (scale)"
    sized = not bent or abs(float(step.values[0])) > DOUBTED * step.sigma[0]
    return PrintSuspicion(
        f"{text}; {more}",
        effect_of(step, frames),
        max(step.over, 0.0),
        board=board,
        errors=(*(("scale",) if sized else ()), *(("bend_x", "bend_y") if bent else ())),
        # what is only in doubt is none that the pictures show: estimated now and then by chance, it
        # would make sound answers scatter
        is_printed=every.is_sure and abs(float(step.values[0])) < PRINTED,
    )


def as_estimated(suspicion: Suspicion, estimate: IdentificationResult) -> Suspicion:
    """Return a finding as it reads where its cause was estimated; another as it is."""
    if not (isinstance(suspicion, PrintSuspicion) and suspicion.is_accounted):
        return suspicion
    names = BoardErrors(suspicion.board, ("scale", "bend_x", "bend_y")).names
    own = [estimate.names.index(name) if name in estimate.names else -1 for name in names]
    values, sigma = (
        np.where(np.array(own) < 0, other, of_all[own])
        for of_all, other in ((estimate.values, 0.0), (estimate.sigma, np.inf))
    )
    text = f"{text_of_print(values, sigma)}; estimated with the rest"
    if not text.startswith(_BENT):
        text += ": measure its squares; if they are as described, lengths of the arm are off"
    return replace(suspicion, text=text)


_BENT = "the board seems to be bent"


def text_of_print(values: FloatArray, sigma: FloatArray) -> str:
    """Return in words the surest of the errors scale, bend_x, bend_y ``(k,)``, or scale alone."""
    k = int(np.argmax(np.abs(values) / np.maximum(sigma, np.finfo(float).tiny)))
    if k == 0:
        size = _off_size(float(values[0]), float(sigma[0]))
        return f"the board seems to be {size}, measured by the arm"
    edges = ("left and right", "upper and lower")[k - 1]
    return f"{_BENT}: its {edges} edges lie {1e3 * values[k]:+.2g} mm behind its middle"


def _off_size(scale: float, sigma: float) -> str:
    way = "larger" if scale > 0 else "smaller"
    return f"{100 * abs(scale):.2g} +- {100 * sigma:.1g} % {way} than described"


def suspicion_of_lens(step: Step, lens: Lens, frames: Sequence[IntArray]) -> Suspicion | None:
    """Of a lens that was given: it is not that of these pictures."""
    if not step.is_sure:
        return None
    focal = lens.values[0]
    return Suspicion(
        f"the lens given is not that of these pictures: with a focal length of "
        f"{focal + step.values[0]:.0f} in place of {focal:.0f} px and another distortion they fit "
        "better; estimate it with them",
        effect_of(step, frames),
        step.over,
    )


@dataclass(frozen=True, eq=False)
class Move:
    """A camera or a board that seems to have been moved between two pictures."""

    which: str  # what was moved
    columns: IntArray  # (6,): of its place among the parameters
    behind: BoolArray  # (M,): stops after the move
    name: str  # of the first picture after it
    step: Step
    over: float  # gain over that which noise alone reaches

    @property
    def words(self) -> str:
        """The cause in one word, such as ``step`` or ``scale``."""
        far, turn = (float(np.linalg.norm(part)) for part in np.split(self.step.values, 2))
        return (
            f"the {self.which} seems to have been moved before {self.name}, by {1e3 * far:.2g} mm "
            f"and {np.degrees(turn):.2g} deg"
        )

    def suspicion(self, frames: Mapping[str, IntArray], or_else: str = "") -> Suspicion:
        """Return it as a finding; ``or_else``: another cause that is as likely."""
        own = frames[self.which]
        moved = np.linalg.norm(self.step.values.reshape(2, 3), axis=1)
        known = np.linalg.norm(self.step.moved_sigma[own].reshape(2, 3), axis=1)
        effect = max(effect_of(self.step, frames.values()), float(np.max(moved / known)))
        what = "calibrate with the pictures before or after it alone"
        if or_else:
            return Suspicion(f"{self.words}, or {or_else}: {_NOT_TOLD}; {what}", effect, self.over)
        return Suspicion(f"{self.words}: {what}", effect, self.over)


_NOT_TOLD = "these pictures do not tell which"


def likeliest_move(
    parts: Deviations,
    groups: IntArray,
    arm_sigma: tuple[float, float],
    frames: Mapping[str, IntArray],
    names: Sequence[str],
    *,
    arm_known: bool = False,
) -> Move | None:
    """Return the move between two pictures that explains most, if noise does not explain it.

    How far it moves the answer is asked under the noise that is left with it.

    Parameters
    ----------
    parts : Deviations
        Of the pictures that were used, each moment a stop of its own, in their order.
    groups : array (M,)
        Posture of each stop: those of one posture share the deviation of the arm.
    frames : mapping of str to array (6,)
        What may have been moved, and the columns of its place among the parameters.
    names : sequence of str
        Of the stops.
    arm_known : bool
        Whether the deviation of the arm was given: it then stays with a move.
    """
    M = len(parts.off)
    if M < 8:
        return None
    find = partial(_best_of_moves, parts, groups, arm_sigma, frames)
    split, which, step = find(np.arange(M))
    over = step.gain - float(chi2_quantile(1.0 - CHANCE / (len(frames) * M), 6))
    if over <= 0.0:
        return None
    # a few pictures that are farther off than others look like a move in any order
    rng, as_good = np.random.default_rng(0), 0
    for _ in range(_ORDERS):
        as_good += find(rng.permutation(M))[2].gain >= step.gain * (1.0 - _TIED)
        if as_good > _AS_GOOD:
            return None
    behind = np.arange(M) >= split
    if not arm_known:
        left = arm_deviation(with_move(parts, frames[which], behind), arm_sigma)
        moved = _steps_of_moves(parts, groups, left, frames, [(behind, which)])
        step = replace(moved[0], gain=step.gain)
    return Move(which, frames[which], behind, names[split], step, over)


_ORDERS, _AS_GOOD, _TIED = 99, 1, 1e-9
"""Orders of the pictures that a move is held against, of how many a move may explain as much, and
the part by which two are equal. Of eight pictures nearly every order has the same split."""


def _best_of_moves(
    parts: Deviations,
    groups: IntArray,
    arm_sigma: tuple[float, float],
    frames: Mapping[str, IntArray],
    rank: IntArray,
) -> tuple[int, str, Step]:
    """Return the move that explains most, before which number, and of what.

    ``rank`` (M,): place of each stop in the order that is tried.
    """
    M = len(rank)
    splits = [(split, which) for split in range(3, M - 2) for which in frames]
    masks = [(rank >= split, which) for split, which in splits]
    steps = _steps_of_moves(parts, groups, arm_sigma, frames, masks)
    best = int(np.argmax([step.gain for step in steps]))
    return *splits[best], steps[best]


def _steps_of_moves(
    parts: Deviations,
    groups: IntArray,
    arm_sigma: tuple[float, float],
    frames: Mapping[str, IntArray],
    moves: Sequence[tuple[BoolArray, str]],
) -> list[Step]:
    """Return the step for each move: which stops are after it ``(M,)``, and of what was moved."""
    M, k = parts.off.shape
    shared = np.kron(groups[:, None] == groups, np.diag(np.repeat(np.array(arm_sigma) ** 2, 3)))
    alone = len(np.unique(groups)) == M
    if alone:
        root = np.linalg.cholesky(parts.covariance + shared[:k, :k])
    else:
        again = np.diag(np.repeat(_within_postures(parts, groups) ** 2, 3))
        root = np.linalg.cholesky(block_diag(*(parts.covariance + again)) + shared)

    def white(rows: FloatArray) -> FloatArray:
        """Rows ``(M, 6, n)`` over the noise, ``(6 M, n)``."""
        if alone:
            return np.linalg.solve(root, rows).reshape(M * k, -1)
        return np.linalg.solve(root, rows.reshape(M * k, -1))

    H, y = white(parts.by_parameters), white(parts.off[..., None])[:, 0]
    A = H.T @ H + parts.within_blocks.sum(axis=0) + parts.known_block
    right = H.T @ y + parts.within_right.sum(axis=0) + parts.known_right
    unit = np.sqrt(np.maximum(np.diag(A), np.finfo(float).tiny))
    C = np.linalg.pinv(A / np.outer(unit, unit), rcond=1e-13, hermitian=True) / np.outer(unit, unit)
    known = np.sqrt(np.maximum(np.diag(C), 0.0))
    steps = []
    for behind, which in moves:
        own = frames[which]
        if alone:
            J = np.where(np.repeat(behind, k)[:, None], H[:, own], 0.0)
        else:
            J = white(np.where(behind[:, None, None], parts.by_parameters[..., own], 0.0))
        B = C @ (H.T @ J)  # the others move with it by minus this
        S, b = J.T @ (J - H @ B), J.T @ y - B.T @ right
        values = -np.linalg.lstsq(S, b, rcond=1e-12)[0]
        sigma = np.sqrt(np.maximum(np.diag(np.linalg.pinv(S, rcond=1e-12)), 0.0))
        steps.append(Step(values, sigma, float(-values @ b), -B @ values, known))
    return steps


def _within_postures(parts: Deviations, groups: IntArray) -> FloatArray:
    """Return how far stops of one posture differ beyond the noise, ``(2,)`` [m, rad].

    An arm comes back to a posture as exactly as it repeats.
    """
    count = np.bincount(groups)[groups]
    sums = np.zeros((groups.max() + 1, parts.off.shape[1]))
    np.add.at(sums, groups, parts.off)
    squares = (parts.off - sums[groups] / count[:, None]) ** 2
    freedom = max(len(groups) - len(np.unique(groups)), 1)
    noise = np.diagonal(parts.covariance, axis1=1, axis2=2)[count > 1].mean(axis=0)
    beyond = (squares.sum(axis=0) / freedom - noise).reshape(2, 3).mean(axis=1)
    return np.asarray(np.sqrt(np.maximum(beyond, 0.0)))


def suspicion_of_arm(arm_sigma: tuple[float, float]) -> Suspicion | None:
    """An arm that is farther off than arms stop."""
    if (np.array(arm_sigma) < FAR_OFF).all():
        return None
    return Suspicion(
        f"the arm seems to be off by {1e3 * arm_sigma[0]:.2g} mm and "
        f"{np.degrees(arm_sigma[1]):.2g} deg from picture to picture: are joints and pictures of "
        "the same moment, and of this arm? If so, its zero offsets are to be identified, too",
        np.nan,
        0.0,
        is_accounted=bool((np.array(arm_sigma) < TOO_FAR_OFF).all()),
    )


def explain_misfit(
    A: FloatArray,
    poses: FloatArray,
    carried: Carried,
    names: Sequence[str],
    mirrored: Iterator[FloatArray],
) -> str:
    """Say why no X and Z fit ``T_base_flange`` and ``T_camera_board`` ``(N, 4, 4)``.

    By what would fit far better; empty where nothing does. ``mirrored`` are the poses if the
    pictures are mirrored ones.
    """
    before = _misfit(A, poses, carried)
    said, least = "", FAR_BETTER * before
    if _misfit(A, poses, "board" if carried == "camera" else "camera") < least:
        return {
            "camera": "they do with the board on the flange and a camera that stands still "
            "(eye-to-hand)",
            "board": "they do with the camera on the flange and a board that stands still "
            "(eye-in-hand)",
        }[carried]
    for split in range(_FEWEST_APART, len(A) - _FEWEST_APART + 1):
        halves = slice(0, split), slice(split, None)
        worse = max(_misfit(A[own], poses[own], carried) for own in halves)
        if worse < least:
            least = worse
            said = (
                f"the pictures before {names[split]} fit each other, and those from it on: the "
                "board or the camera was moved; calibrate with the pictures of one place alone"
            )
    B = se3.inverse(poses) if carried == "camera" else poses
    factor = float(by_rotations_first(PairSets(A[None], B[None]))[0])
    if abs(np.log(factor)) > _ANOTHER_UNIT:
        scaled = poses.copy()
        scaled[:, :3, 3] *= factor
        if (other := _misfit(A, scaled, carried)) < least:
            least = other
            said = (
                f"they do with a board {factor:.3g} times as large: check the size of its squares "
                "and its unit, and the unit of the flange's places"
            )
    if any(_misfit(A, turned, carried) < least for turned in mirrored):
        said = "the pictures are mirrored: have the camera's driver not flip them"
    return said


_ANOTHER_UNIT = 0.5
"""Logarithm of a scale from which on it is said where nothing fits."""

_FEWEST_APART = 4
"""Pictures before and behind a move, from which each part has X and Z of its own."""


def _misfit(A: FloatArray, poses: FloatArray, carried: Carried) -> float:
    """Median of what A X = Z B leaves over: rotations [rad], and places in parts of the motion.

    Rotations in mirrored pictures are conjugate to the true ones by half a turn, and fit as well.
    """
    B = se3.inverse(poses) if carried == "camera" else poses
    found = solve_batch(A[None], B[None], "shah")
    if not np.isfinite(found.X).all():
        return float("inf")
    rows = residuals(A, B, found.X[0], found.Z[0])
    moved = float(np.linalg.norm(A[:, :3, 3].std(axis=0)))
    turns, places = (np.median(np.linalg.norm(r, axis=1)) for r in (rows[:, :3], rows[:, 3:]))
    return float(turns + places / max(moved, np.finfo(float).tiny))


def unmirrored_poses(lens: Lens, board: FloatArray, pixels: FloatArray) -> Iterator[FloatArray]:
    """Poses ``(N, 4, 4)`` of the board if the pictures are mirrored.

    Points of a board that looks alike in a mirror are then told in another order, too.
    """
    flipped = pixels.copy()
    flipped[..., 0] = lens.width_px - flipped[..., 0]
    turned = board.copy()
    turned[:, 0] = board[:, 0].max() + board[:, 0].min() - board[:, 0]
    size = lens.width_px, lens.height_px
    for points in (board, turned):
        with contextlib.suppress(CalibError):
            straight = start_lens(lens.name, size, points, flipped)
            poses, found = board_poses(straight, points, flipped)
            if found.all():
                yield poses


def find_half_turns(
    A: FloatArray, poses: FloatArray, half_turn: FloatArray, carried: Carried
) -> BoolArray:
    """Which pictures ``(N,)`` show a board the other way round that looks alike after half a turn.

    The arm knows by how much it has turned between two pictures, and so by how much the board has
    to have turned in them. The pictures agree with the one that most of them agree with. Poses
    ``(N, 4, 4)`` are ``T_base_flange`` and ``T_camera_board``; the half turn is about its middle.
    """
    both = np.stack([poses, poses @ half_turn])
    N = len(A)
    turned = [_angles_between(both[0], other) for other in both]
    arm = _angles_between(A, A)
    off = np.array([np.abs(angles - arm) for angles in turned])  # (2, N, N)
    cost = np.minimum(off.min(axis=0), _LARGE_RAD).sum(axis=1)
    reference = int(np.argmin(cost))
    flips = np.asarray(off[1, reference] < off[0, reference])
    for _ in range(5):  # a turn by 90 deg says nothing alone
        chosen = np.where(flips[:, None, None], both[1], both[0])
        B = [se3.inverse(T) if carried == "camera" else T for T in (chosen, *both)]
        found = solve_batch(A[None], B[0][None], "shah")
        if not np.isfinite(found.X).all():
            break
        left = [np.linalg.norm(residuals(A, T, found.X[0], found.Z[0])[:, :3], axis=1) for T in B]
        before, flips = flips, left[2] < left[1]
        if (before == flips).all():
            break
    return flips if flips.sum() <= N - flips.sum() else ~flips


_LARGE_RAD = 0.2
"""Difference of turns that is counted as no more: of a wrong row of joints."""


def _angles_between(one: FloatArray, other: FloatArray) -> FloatArray:
    """Angles ``(N, N)`` [rad] between rotations of poses ``(N, 4, 4)``."""
    trace = np.einsum("iab,jab->ij", one[:, :3, :3], other[:, :3, :3])
    return np.asarray(np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0)))
