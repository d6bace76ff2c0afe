"""The likeliest frames of a network, the noise with them, and what looks wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from calib import se3
from calib.chance import chi2_quantile, f_bound
from calib.errors import ConvergenceError, NotIdentifiableError
from calib.judgement import FALSE_ALARMS, Finding
from calib.robot_world.errors_of_pairs import ErrorModel, Isotropic
from calib.robot_world.methods import robust
from calib.robot_world.network.graph import REMEDY, Network, of_pairs
from calib.robot_world.network.prior import FramePrior
from calib.robot_world.network.result import NetworkResult
from calib.robot_world.network.rows import Rows, rows_at
from calib.robot_world.noise import Noise, PairCovariances, difference, perturb
from calib.robot_world.pairs import FEWEST_PAIRS, PairSets
from calib.robot_world.poses import near_pairs, poses_of, restricted
from calib.robot_world.solver import RobotWorldBatch, solve_batch
from calib.se3 import BoolArray, FloatArray, IntArray

OTHER_NOISE = 1e-3
"""Probability that an edge with the noise of all others is taken to have another one."""

_FEWEST_OF_AN_EDGE = 8
"""Pairs of an edge from which on it is asked for a noise of its own, and judged alone."""

_ITERATIONS = 200
_ARRIVED = 1e-6
"""Length of the last step, in standard deviations of the frames."""

_SETTLED = 1e-4
"""Relative change of the noise that counts as none."""

_STALLED = 1e-12
"""Part of the cost that counts as none: rounding of the sum."""

_DAMPING, _LARGEST_DAMPING = 1e-3, 1e12

_LEAST = 1e-7
"""Least noise that is estimated [rad, m]: by less, rounding of the information would tell what
nothing tells."""

_UNKNOWN = 0.5
"""Standard deviation from which on a direction is not told: of rotations [rad], of translations in
parts of the motion of the arm."""

_TIED = 1e-9
"""Eigenvalue, of one, below which nothing but the pairs of an edge themselves tells of a place."""

_MOST_NUMBERS = 5_000_000
"""Numbers of the dense derivatives up to which pairs of one pose are asked what they share."""


@dataclass(frozen=True, eq=False)
class _Told:
    """Knowledge of the errors of all frames, by pairs and priors."""

    covariance: FloatArray  # (6 F, 6 F), without the directions that are not told
    untold: FloatArray  # (q, 6 F): these, translations in units of the motion

    @classmethod
    def by(cls, information: FloatArray, unit: FloatArray) -> _Told:
        """Divide by what is known: ``unit`` (6 F,) is one in rotations, the motion in places."""
        values, axes = np.linalg.eigh(information * np.outer(unit, unit))
        told = values > _UNKNOWN**-2
        some = axes[:, told] * unit[:, None]
        return cls((some / values[told]) @ some.T, _simplest(axes[:, ~told].T))


def _simplest(directions: FloatArray) -> FloatArray:
    """Return directions ``(q, 6 F)`` that span the same, those with turns first.

    Of three that only shift, each shifts the first frame along an axis.
    """
    q = len(directions)
    if not q:
        return directions
    moved = directions.reshape(q, -1, 6)
    U, values, _ = np.linalg.svd(moved[:, :, :3].reshape(q, -1), full_matrices=True)
    directions = np.asarray(U.T @ directions, dtype=float)
    turns = int((values > _TURNS).sum())
    shifts = directions[turns:]
    if len(shifts) == 3:
        by_frame = shifts.reshape(3, -1, 6)[:, :, 3:]
        first = by_frame[:, np.argmax((by_frame**2).sum(axis=(0, 2)) > _TURNS)]
        if np.linalg.matrix_rank(first, tol=_TURNS) == 3:
            shifts = np.asarray(np.linalg.solve(first, shifts), dtype=float)
            shifts /= np.linalg.norm(shifts, axis=1, keepdims=True)
            directions = np.concatenate([directions[:turns], shifts])
    return directions


_TURNS = 1e-3
"""Part of a direction, of length one, from which on it turns a frame."""


def adjusted(
    net: Network,
    noise: Noise | None,
    priors: Sequence[FramePrior],
    used: BoolArray,
    T: FloatArray,
    classes: IntArray,
) -> NetworkFit:
    """Find the likeliest frames, and the noise where it is unknown, from a start.

    Parameters
    ----------
    used : ndarray of bool (N,)
        Pairs that count.
    T : ndarray (F, 4, 4)
        Where to start.
    classes : ndarray of int (N,)
        Class of noise of each pair.

    Raises
    ------
    NotIdentifiableError
        Fewer pairs than frames.
    ConvergenceError
        The search has not arrived.
    """
    if used.sum() < FEWEST_PAIRS or used.sum() < len(T) - len(priors):
        raise NotIdentifiableError(
            net.frames, [f"only {int(used.sum())} pairs agree, for {len(T)} frames"], hint=REMEDY
        )
    sigma = _shown(net, T, used, classes) if noise is None else None
    model: ErrorModel
    if sigma is not None:
        model = _isotropic(sigma[classes])
    elif noise is not None:
        model = noise.model(PairSets(net.A[None], net.B[None]))
    unit = np.tile(np.repeat([1.0, net.size_m], 3), len(T))
    damping, settled = 0.0, noise is not None
    rows = rows_at(net, model, T)
    for _ in range(_ITERATIONS):
        some = rows.of(used)
        J = some.jacobian
        information, gradient = (J.T @ J).toarray(), J.T @ some.white.ravel()
        cost = some.cost + _with_priors(net, priors, T, information, gradient)
        told = _Told.by(information, unit)
        if damping:
            size = np.sqrt(np.maximum(np.diag(information), unit**-2.0))
            scaled = information / np.outer(size, size) + damping * np.eye(len(size))
            step = -np.linalg.solve(scaled, gradient / size) / size
        else:
            step = -told.covariance @ gradient
        length = float(np.sqrt(max(-step @ gradient, 0.0)))
        tried = perturb(T, step.reshape(-1, 6))
        new = rows_at(net, model, tried)
        worse = new.of(used).cost + _with_priors(net, priors, tried) > cost * (1.0 + _STALLED)
        if worse and length > _ARRIVED:
            damping = max(10.0 * damping, _DAMPING)
            if damping > _LARGEST_DAMPING:
                break
            continue
        T, rows, damping = tried, new, damping / 10.0 if damping > _DAMPING else 0.0
        if sigma is not None:
            again = _renewed(rows, used, classes, told.covariance, sigma)
            settled = bool((np.abs(again / sigma - 1.0) < _SETTLED).all())
            sigma, model = again, _isotropic(again[classes])
            rows = rows_at(net, model, T)
        if length <= _ARRIVED and settled:
            return NetworkFit(net, noise, used, T, classes, sigma, rows, told)
    raise ConvergenceError("the frames of the network have not converged")


def _with_priors(
    net: Network,
    priors: Sequence[FramePrior],
    T: FloatArray,
    information: FloatArray | None = None,
    gradient: FloatArray | None = None,
) -> float:
    """Add what priors tell to the information and the gradient, and return what they cost."""
    cost = 0.0
    for prior in priors:
        at = net.frames.index(prior.frame)
        white, own = prior.white(T[at]), slice(6 * at, 6 * at + 6)
        cost += float(white @ white)
        if information is not None and gradient is not None:
            information[own, own] += prior.root.T @ prior.root
            gradient[own] += prior.root.T @ white
    return cost


def _isotropic(sigma: FloatArray) -> Isotropic:
    """Errors of B with standard deviations ``(N, 2)`` of rotation and translation."""
    return Isotropic(np.concatenate([np.zeros_like(sigma.T), sigma.T]))


def _shown(net: Network, T: FloatArray, used: BoolArray, classes: IntArray) -> FloatArray:
    """Noise ``(C, 2)`` that residuals show."""
    X, Z, _ = of_pairs(net, T)
    square = difference(net.A @ X, Z @ net.B) ** 2
    sums = np.stack([square[:, :3].sum(axis=1), square[:, 3:].sum(axis=1)])
    count = np.bincount(classes, used)
    by_class = [np.bincount(classes, used * one) / np.maximum(3.0 * count, 1.0) for one in sums]
    return np.asarray(np.maximum(np.sqrt(np.stack(by_class, axis=1)), _LEAST))


def _renewed(
    rows: Rows,
    used: BoolArray,
    classes: IntArray,
    covariance: FloatArray,
    sigma: FloatArray,
) -> FloatArray:
    """Noise ``(C, 2)`` from what the frames leave of the rows of each class."""
    taken = np.einsum("naa->na", rows.taken(covariance))
    widening = robust.widening() if not used.all() else 1.0
    out = np.empty_like(sigma)
    for side, own in enumerate((slice(0, 3), slice(3, 6))):
        left = np.bincount(classes, used * (rows.white[:, own] ** 2).sum(axis=1))
        freedom = np.bincount(classes, used * (3.0 - taken[:, own].sum(axis=1)))
        out[:, side] = sigma[:, side] * widening * np.sqrt(left / np.maximum(freedom, 1.0))
    return np.asarray(np.maximum(out, _LEAST))


@dataclass(frozen=True, eq=False)
class NetworkFit:
    """Frames that the adjustment ended in."""

    net: Network
    noise: Noise | None
    used: BoolArray
    T: FloatArray
    classes: IntArray  # (N,): class of noise of each pair
    sigma: FloatArray | None  # (C, 2): noise of each class, where it is estimated
    rows: Rows
    told: _Told

    @property
    def covariance(self) -> FloatArray:
        """Covariance ``(6 F, 6 F)`` of the errors of all frames, by independent pairs."""
        return self.told.covariance

    def explained(self) -> BoolArray:
        """Pairs ``(N,)`` that the noise explains, each held against the frames of the others."""
        side = np.where(self.used, -1.0, 1.0)[:, None, None]
        spread = np.eye(6) * (1.0 + 1e-9) + side * self.rows.taken(self.covariance)
        r = self.rows.white
        square = np.einsum("na,na->n", r, np.linalg.solve(spread, r[..., None])[..., 0])
        return np.asarray(square <= chi2_quantile(1.0 - robust.CHANCE, 6))

    def other_classes(self) -> IntArray:
        """Class of noise of each pair ``(N,)``: 0 but for edges whose pairs show another noise."""
        classes = np.zeros(self.net.N, dtype=np.intp)
        if self.sigma is None:
            return classes
        edges, taken = self.net.edges, np.einsum("naa->na", self.rows.taken(self.covariance))
        stands_out = np.zeros(edges.max() + 1, dtype=bool)
        count = np.bincount(edges, self.used)
        shared = self.sigma[0]
        for side, own in enumerate((slice(0, 3), slice(3, 6))):
            square = (self.rows.white[:, own] ** 2).sum(axis=1)
            square *= (self.sigma[self.classes, side] / shared[side]) ** 2
            sums = np.bincount(edges, self.used * square)
            freedom = np.bincount(edges, self.used * (3.0 - taken[:, own].sum(axis=1)))
            rest = np.maximum(freedom.sum() - freedom, 1.0)
            ratio = sums / np.maximum(freedom, 1.0)
            high = f_bound(OTHER_NOISE / 2.0, np.maximum(freedom, 1.0), rest)
            low = 1.0 / f_bound(OTHER_NOISE / 2.0, rest, np.maximum(freedom, 1.0))
            stands_out |= (ratio > high) | (ratio < low)
        stands_out &= count >= _FEWEST_OF_AN_EDGE
        if stands_out.sum() > len(count) - 1:
            stands_out[np.argmax(count)] = False
        number = np.where(stands_out, np.cumsum(stands_out), 0)
        return np.asarray(number[edges])

    def result(self) -> NetworkResult:
        net, T = self.net, self.T.copy()
        X, Z, _ = of_pairs(net, T)
        covariance = self._widened().copy()
        places = len(net.on_flange) + len(net.around)
        for at in range(places, len(T)):  # V to the base in the frame of its part, V⁻¹
            own, R = slice(6 * at, 6 * at + 6), T[at, :3, :3]
            M = np.zeros((6, 6))
            M[:3, :3] = M[3:, 3:] = -R.T
            M[3:, :3] = -R.T @ se3.skew(T[at, :3, 3])
            covariance[own] = M @ covariance[own]
            covariance[:, own] = covariance[:, own] @ M.T
            T[at] = se3.inverse(T[at])
        sigma = np.full((net.edges.max() + 1, 2), np.nan)
        if self.sigma is not None:
            sigma[net.edges] = self.sigma[self.classes]
        return NetworkResult(
            net,
            T,
            covariance,
            self.used,
            difference(net.A @ X, Z @ net.B),
            sigma,
            self.rows.of(self.used).cost,
            self.told.untold,
            net.size_m,
            self._findings(),
        )

    def _widened(self) -> FloatArray:
        """Covariance with what makes pairs tell less than as many independent ones.

        Each edge as the solver of two frames judges it, and what pairs of a pose share, whatever
        their edges: the larger of the two for each number.
        """
        C = self.covariance
        own = np.maximum(np.diag(C), np.finfo(float).tiny)
        J = self.rows.of(self.used).jacobian
        more = np.repeat(self._of_edges()[self.net.edges[self.used]] - 1.0, 6)
        by_edges = C + C @ np.asarray((J.T @ sparse.diags_array(more) @ J).toarray()) @ C
        factor = np.sqrt(np.maximum(np.diag(by_edges) / own, 1.0))
        factor = np.maximum(factor, np.sqrt(np.diag(self._by_poses()) / own))
        return np.asarray(C * np.outer(factor, factor))

    @cached_property
    def _alone(self) -> dict[int, tuple[IntArray, RobotWorldBatch]]:
        """Pairs used of each edge that has enough, and its two frames from these alone."""
        net, found = self.net, {}
        noise = None if isinstance(self.noise, PairCovariances) else self.noise
        for edge in range(net.edges.max() + 1):
            own = np.flatnonzero((net.edges == edge) & self.used)
            if len(own) >= _FEWEST_OF_AN_EDGE:
                alone = solve_batch(net.A[own][None], net.B[own][None], "ml", noise or "B")
                if not alone.degenerate[0]:
                    found[edge] = own, alone
        return found

    def _of_edges(self) -> FloatArray:
        """Variance of the frames by each edge alone, over that by independent pairs, ``(E,)``.

        An edge of few pairs has the middle one of the others.
        """
        more = np.full(self.net.edges.max() + 1, np.nan)
        for edge, (own, alone) in self._alone.items():
            H = self.rows.values[own, :, :12].reshape(-1, 12)
            free = np.diag(np.linalg.pinv(H.T @ H, hermitian=True))
            if alone.covariance is not None:
                more[edge] = np.median(np.diag(alone.covariance[0]) / free)
        usual = np.nanmedian(more) if np.isfinite(more).any() else 1.0
        return np.asarray(np.maximum(np.where(np.isfinite(more), more, usual), 1.0))

    def _by_poses(self) -> FloatArray:
        """Covariance with what pairs of the same pose of an arm share taken into account."""
        net, p = self.net, self.covariance.shape[0]
        if 6 * net.N * p > _MOST_NUMBERS or self.noise is not None:
            return self.covariance
        apart = net.A.copy()
        apart[:, :3, 3] += 1e3 * net.j[:, None]  # poses of different arms are never the same
        poses = poses_of(near_pairs(apart[None])[0], self.used)
        if poses is None:
            return self.covariance
        J = np.asarray(self.rows.jacobian.toarray()).reshape(net.N, 6, p).transpose(2, 1, 0)
        shared = restricted(self.rows.white.T, J, poses=poses, own=True)
        if shared is None:
            return self.covariance
        spread = self.covariance @ shared.information(J) @ self.covariance
        # never surer than by independent pairs
        own = np.maximum(np.diag(self.covariance), np.finfo(float).tiny)
        factor = np.sqrt(np.maximum(np.diag(spread) / own, 1.0))
        return np.asarray(self.covariance * np.outer(factor, factor))

    def _findings(self) -> tuple[Finding, ...]:
        net, found = self.net, []
        left = np.bincount(net.edges, ~self.used) / np.bincount(net.edges)
        for edge in np.flatnonzero(left > 0.5).tolist():
            said = f"most pairs of {net.name_of_edge(edge)} contradict the others: has it moved?"
            found.append(Finding(said, np.nan))
        for edge, (_, alone) in self._alone.items():
            if not alone.ok[0]:
                said = (
                    f"pairs of {net.name_of_edge(edge)} are in doubt: solve them alone to see why"
                )
                found.append(Finding(said, np.nan))
        moved = self._moved()
        return tuple(found) if moved is None else (*found, moved)

    def _moved(self) -> Finding | None:
        """Find what stands elsewhere for one edge than for others, if noise does not explain it.

        The place of what is around is tried as another one for each edge, in one step.
        """
        net, rows = self.net, self.rows.of(self.used)
        edges, J = net.edges[self.used], rows.jacobian
        freedom = 6.0 * len(edges) - len(self.covariance) - 6.0
        best: tuple[float, int, FloatArray, FloatArray] | None = None
        for edge in np.unique(edges).tolist():
            own = np.flatnonzero(edges == edge)
            by_place = np.zeros((len(edges), 6, 6))
            by_place[own] = rows.values[own, :, 6:12]
            E = by_place.reshape(-1, 6)
            mixed = np.asarray(J.T @ E)
            S = E.T @ E - mixed.T @ self.covariance @ mixed
            alone = np.sqrt(np.maximum(np.diag(E.T @ E), np.finfo(float).tiny))
            step = -np.linalg.pinv(S / np.outer(alone, alone), rcond=_TIED, hermitian=True) @ (
                E.T @ rows.white.ravel() / alone
            )
            gain = float(-step @ (E.T @ rows.white.ravel() / alone))
            if best is None or gain > best[0]:
                best = gain, edge, step / alone, -self.covariance @ mixed @ (step / alone)
        if best is None or freedom < 1.0:
            return None
        gain, edge, step, others = best
        noise = max(rows.cost - gain, 0.0) / freedom
        chance = FALSE_ALARMS / len(np.unique(edges))
        if gain <= 6.0 * noise * float(f_bound(chance, 6.0, freedom)):
            return None
        if gain <= float(chi2_quantile(1.0 - chance, 6)):  # less than the least noise
            return None
        known = np.sqrt(np.diag(self.covariance) * max(noise, np.finfo(float).tiny))
        effect = float(np.max(np.abs(others) / np.maximum(known, np.finfo(float).tiny)))
        turn, far = (float(np.linalg.norm(part)) for part in np.split(step, 2))
        i = int(np.flatnonzero(net.edges == edge)[0])
        what, where = net.around[net.l[i]], net.on_flange[net.k[i]]
        return Finding(
            f"{what} seems to stand elsewhere in its pairs with {where} than in those with others, "
            f"by {1e3 * far:.2g} mm and {np.degrees(turn):.2g} deg: has one of the two been moved?",
            effect,
        )
