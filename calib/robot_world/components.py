"""How the noise of pairs is made, as far as their residuals tell it.

The same in all directions and all on B is what is taken where nothing is known. Two things show in
the residuals of many pairs. Noise of A turns the origin of X about the flange, so that residual
translations go with residual rotations across the lever: its share of the rotations shows, that of
the translations does not, and matters to neither X nor Z. And what a camera sees is less certain
the farther it is away: rotation and place across the line of sight with the distance, depth with
its square. Each is fitted to the residuals by likelihood, and taken where Akaike's criterion says
so by far (Akaike, IEEE Trans. Autom. Control 19, 1974); the rest stays as it was.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

from calib import se3
from calib.errors import InputError
from calib.robot_world.adjustment import adjust
from calib.robot_world.methods import robust
from calib.robot_world.noise import LEAST_NOISE, Noise, PairCovariances, PairNoise, difference
from calib.robot_world.pairs import PairSets, checked_problem
from calib.se3 import BoolArray, FloatArray

FEWEST_PAIRS = 20
"""Pairs from which on the noise is questioned: of fewer, one that is wrong would make it."""

SURELY = 10.0
"""By how much Akaike's criterion has to fall: e⁵ in likelihood, for each parameter e more."""

_FARTHEST = 20.0
"""Distance, over the median, of pairs that are wrong rather than far."""

_TINY = 1e-300

_ROUNDS, _SETTLED = 10, 0.1
"""Rounds of noise, and X and Z by it, at most: until the criterion changes by less than shows."""

_SHARES, _ZOOMS, _SCORES = 9, 3, 8
"""Shares of A that are tried at once, each time between the neighbours of the best one: to half a
hundredth; and steps of the variance that goes with each."""

_LEAST_SHIFT = 12.0
"""Logarithm of the largest variance of translations over the least one looked for."""

_ALL_OF_B = "0 %"

_ALL = 0.97
"""Share that counts as the whole: the covariance of the other side would be next to singular."""


@dataclass(frozen=True, eq=False)
class Component:
    """One way in which noise may be made."""

    name: str  # in words
    criterion: float  # Akaike's, of all pairs used; the constants that all have in common left out
    make: Callable[[], PairCovariances]  # makes the noise of all pairs
    by_distance: bool  # whether it is of what is seen, by its distance or along the line of sight
    gain: float = 0.0  # fall of the criterion from that of noise of B, alike in all directions

    @cached_property
    def noise(self) -> PairCovariances:
        """Noise of all pairs."""
        return self.make()


def shown_noise(A: ArrayLike, B: ArrayLike) -> Noise:
    """Noise of pairs ``(N, 4, 4)`` as their residuals show it, for :func:`solve`.

    Of the pairs that agree; isotropic and on B where nothing else shows. Which side has errors of
    translation cannot be told, and matters to neither X nor Z.

    Raises
    ------
    InputError
        As :func:`~calib.robot_world.solve`.
    """
    pairs = checked_problem(A, B)
    found = robust.estimate(pairs)
    used = np.ones(pairs.N, dtype=bool) if found.weights is None else found.weights[0] > 0
    shown = settled(pairs, found.X, found.Z, used)
    if shown is not None:
        return shown.noise
    sizes = np.maximum(np.ones(2) if found.sigma is None else found.sigma[:, 0], LEAST_NOISE)
    return PairNoise(*sizes.tolist())


def settled(
    pairs: PairSets, X: FloatArray, Z: FloatArray, used: BoolArray, widening: float = 1.0
) -> Component | None:
    """Noise that the residuals of one set show, and X and Z by it; None where isotropic one does.

    Parameters
    ----------
    X, Z : ndarray (1, 4, 4)
        The likeliest by isotropic noise of B, from the pairs used ``(N,)``.
    widening : float
        By how much the standard deviations are larger than what these show, where they were chosen
        by their residuals.
    """
    shown, criterion = None, np.inf
    for _ in range(_ROUNDS):
        best = explain(pairs.A[0], pairs.B[0], X[0], Z[0], used)
        if best is None:
            break
        try:
            model = best.noise.model(pairs)
        except InputError:  # next to exact in one direction beside the others: no noise of pairs
            return None
        fit = adjust(pairs, model, X, Z, weights=used[None].astype(float))
        X, Z = fit.X, fit.Z
        # white rows have a mean square of one for each degree of freedom, as those of any noise
        # that is estimated have
        larger = widening**2 * float(fit.cost[0]) / (6.0 * int(used.sum()) - 12.0)
        shown = replace(best, make=partial(best.noise.times, larger))
        if abs(best.criterion - criterion) < _SETTLED:
            break
        criterion = best.criterion
    return shown


def explain(
    A: FloatArray, B: FloatArray, X: FloatArray, Z: FloatArray, used: BoolArray
) -> Component | None:
    """The way in which the noise of one set is made; None where isotropic noise of B will do.

    X and Z ``(4, 4)`` are the likeliest by isotropic noise of B, from the pairs used ``(N,)``.
    """
    if used.sum() < FEWEST_PAIRS:
        return None
    square = (difference(A @ X, Z @ B)[used] ** 2).sum(axis=0).reshape(2, 3).sum(axis=1)
    plain = _criterion(square, np.full(2, 3.0 * used.sum()))
    others = [_shared(A, B, X, Z, used), *_seen(A, B, X, Z, used)]
    best = min(others, key=lambda one: one.criterion)
    return replace(best, gain=plain - best.criterion) if best.criterion < plain - SURELY else None


def allowed(
    A: FloatArray, B: FloatArray, X: FloatArray, Z: FloatArray, used: BoolArray
) -> tuple[Component, ...]:
    """Noises of one set that are about as likely as the likeliest one, simple ones among them."""
    error, count = difference(A @ X, Z @ B)[used], int(used.sum())
    square = (error**2).sum(axis=0).reshape(2, 3).sum(axis=1)
    variance = np.repeat(np.maximum(square / (3.0 * count), LEAST_NOISE**2), 3) * _loose(count)
    plain = Component(
        "noise of B, the same in all directions",
        _criterion(square, np.full(2, 3.0 * count)),
        lambda: PairCovariances(B=np.diag(variance)),
        False,
    )
    of_A = replace(_shared(A, B, X, Z, used, 1.0), name="noise of A, the same in all directions")
    every = [plain, of_A, _shared(A, B, X, Z, used), *_seen(A, B, X, Z, used)]
    least = min(one.criterion for one in every)
    likely = [one for one in every if one.criterion < least + SURELY]
    return tuple({one.name: one for one in likely if not one.name.startswith(_ALL_OF_B)}.values())


def _loose(count: int) -> float:
    """Variance over what residuals show, of which X and Z have taken up twelve numbers."""
    return 6.0 * count / (6.0 * count - 12.0)


def _criterion(squares: FloatArray, counts: FloatArray, more: float = 0.0) -> float:
    """Akaike's criterion of normal numbers in groups, each with the variance that it shows."""
    return float((counts * np.log(squares / counts + _TINY)).sum()) + more + 2.0 * len(counts)


def _shared(
    A: FloatArray,
    B: FloatArray,
    X: FloatArray,
    Z: FloatArray,
    used: BoolArray,
    least: float = 0.0,
) -> Component:
    """Noise of A and B: the share of A in the rotations, which is ``least`` or more."""
    error, count = difference(A @ X, Z @ B)[used], int(used.sum())
    e_R, e_p = error[:, :3], error[:, 3:]
    m = A[used, :3, :3] @ X[:3, 3]
    across = np.cross(e_R, m)
    turn = float((e_R**2).sum()) / (3.0 * count)
    length2 = (m**2).sum(axis=1)
    along = (e_p * m).sum(axis=1) ** 2 / np.where(length2 > 0.0, length2, 1.0)
    lever = _Lever(
        along,
        (e_p**2).sum(axis=1) - along,
        (e_p * across).sum(axis=1),
        (across**2).sum(axis=1),
        turn * length2,
    )
    low, high = least, 1.0
    for _ in range(_ZOOMS):
        shares = np.linspace(low, high, _SHARES)
        worse, shifts = lever.fitted(shares)
        best = int(np.argmin(worse))
        low, high = shares[max(best - 1, 0)], shares[min(best + 1, _SHARES - 1)]
    share, shift = float(shares[best]), float(shifts[best])
    rotations = 3.0 * count * np.log(turn + _TINY)
    criterion = float(rotations + worse[best] - 3.0 * count + 6.0)

    def noise() -> PairCovariances:
        loose = _loose(count)
        # of translations the sides cannot be told apart; where all is on A, so are they
        sides = np.diag(np.repeat([share * turn, 0.5 * shift], 3) * loose)
        others = np.diag(np.repeat([(1.0 - share) * turn, 0.5 * shift], 3) * loose)
        if not 1.0 - _ALL < share < _ALL:
            whole = np.diag(np.repeat([turn, shift], 3) * loose)
            return PairCovariances(A=whole) if share > 0.5 else PairCovariances(B=whole)
        return PairCovariances(A=sides, B=others)

    return Component(
        f"{100.0 * share:.0f} % of the variance of rotations is of A", criterion, noise, False
    )


@dataclass(frozen=True, eq=False)
class _Lever:
    """Squares ``(n,)`` of residual translations by m, the vector from the flange to X's origin.

    Along m, and across it, at right angles; mixed: the product of the translation with ``e_R x m``,
    and turned: the square of that, which is across m; rotation: the variance of the rotations times
    the square of m.
    """

    along: FloatArray
    across: FloatArray
    mixed: FloatArray
    turned: FloatArray
    rotation: FloatArray

    def fitted(self, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Minus twice the log-likelihood, and variance of translations, of shares of A ``(k,)``.

        The variance by Fisher's scores.
        """
        s = shares[:, None]
        across = np.maximum(self.across - 2.0 * s * self.mixed + s**2 * self.turned, 0.0)
        more = s * (1.0 - s) * self.rotation
        shift = (self.along + across).mean(axis=1, keepdims=True) / 3.0 + _TINY
        least = np.exp(-_LEAST_SHIFT) * shift
        for _ in range(_SCORES):
            both = shift + more
            part = shift / both
            slope = 1.0 - self.along / shift + part * (2.0 - across / both)
            step = -slope.sum(axis=1) / (1.0 + 2.0 * part**2).sum(axis=1)
            shift = np.maximum(shift * np.exp(np.clip(step, -2.0, 2.0))[:, None], least)
        both = shift + more
        worse = np.log(shift) + self.along / shift + 2.0 * np.log(both) + across / both
        return worse.sum(axis=1), shift[:, 0]


def _seen(
    A: FloatArray, B: FloatArray, X: FloatArray, Z: FloatArray, used: BoolArray
) -> list[Component]:
    """Noise that grows with the distance, of the target as B or its inverse has it."""
    implied = se3.inverse(Z) @ A @ X
    found = []
    for inverse in (False, True):
        own, true = (se3.inverse(B), se3.inverse(implied)) if inverse else (B, implied)
        error = difference(own, true)
        far = np.linalg.norm(own[:, :3, 3], axis=1)
        middle = float(np.median(far[used]))
        if middle <= 0.0 or far[used].min() <= middle / _FARTHEST or far.max() > _FARTHEST * middle:
            continue
        sight = own[:, :3, 3] / np.where(far > 0.0, far, 1.0)[:, None]
        for growth in ((0.0, 0.0, 0.0), (1.0, 1.0, 2.0)):
            found.append(_of_distance(error, sight, far / middle, growth, used, own, inverse))
    return found


def _of_distance(
    error: FloatArray,
    sight: FloatArray,
    far: FloatArray,
    growth: tuple[float, float, float],
    used: BoolArray,
    own: FloatArray,
    inverse: bool,
) -> Component:
    """Rotation, place across the line of sight, depth, each by its power of the distance."""
    depth = (error[:, 3:] * sight).sum(axis=1)
    squares = np.stack(
        [
            (error[:, :3] ** 2).sum(axis=1),
            (error[:, 3:] ** 2).sum(axis=1) - depth**2,
            depth**2,
        ]
    )
    size = far ** (2.0 * np.array(growth)[:, None])
    count = int(used.sum())
    counts = np.array([3.0, 2.0, 1.0]) * count
    own_squares = (squares / size)[:, used].sum(axis=1)
    more = float((np.array([3.0, 2.0, 1.0])[:, None] * np.log(size[:, used])).sum())
    variance = own_squares / counts * _loose(count)

    def noise() -> PairCovariances:
        along = sight[:, :, None] * sight[:, None, :]
        C = np.zeros((len(far), 6, 6))
        C[:, :3, :3] = (variance[0] * size[0])[:, None, None] * np.eye(3)
        C[:, 3:, 3:] = (variance[1] * size[1])[:, None, None] * (np.eye(3) - along)
        C[:, 3:, 3:] += (variance[2] * size[2])[:, None, None] * along
        return (
            PairCovariances.of_seen_target(se3.inverse(own), C) if inverse else PairCovariances(B=C)
        )

    grows = "grows with the distance" if growth[0] else "is not the same along the line of sight"
    what = "the inverse of B" if inverse else "B"
    return Component(f"noise of {what} {grows}", _criterion(own_squares, counts, more), noise, True)
