"""Networks: several things on flanges, several around the arms, several arms, in one estimate.

``A_i X_k = Z_l B_i`` for every pair i of what is on the flange (k) and what stands around (l).
Where several arms share what stands around them, ``A_i X_k = V_j Z_l B_i``: V_j takes the frame of
all to the base of arm j, and is the identity for the first arm of each part that hangs together.

The start is in closed form: rotations by the leading singular vectors of all equations
``R_A R_X = R_Z R_B`` at once, as Wise et al. 2025 (arXiv 2507.23045) and Shah's method for one
pair, then translations by least squares. The estimate is the maximum of the likelihood, by the
rows of one pair of frames (:mod:`calib.robot_world.errors_of_pairs`). The noise is estimated with
the frames (variance components, Förstner 1979). An edge, a thing on the flange together with one
around, has a noise of its own where its pairs show another one than the rest.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from calib import se3
from calib.chance import chi2_quantile, f_bound
from calib.errors import ConvergenceError, InputError, NotIdentifiableError
from calib.judgement import FALSE_ALARMS, Finding
from calib.robot_world.adjustment import linear_rows
from calib.robot_world.errors_of_pairs import ErrorModel, Isotropic
from calib.robot_world.methods import robust
from calib.robot_world.noise import Noise, PairCovariances, check_noise, difference, perturb
from calib.robot_world.pairs import FEWEST_PAIRS, PairSets, checked_pairs
from calib.robot_world.poses import Poses, near_pairs, poses_of, restricted
from calib.robot_world.solver import RobotWorldBatch, solve_batch
from calib.se3 import BoolArray, FloatArray, IntArray
from calib.shown import Shown

OTHER_NOISE = 1e-3
"""Probability that an edge with the noise of all others is taken to have another one."""

_FEWEST_OF_AN_EDGE = 8
"""Pairs of an edge from which on that is asked."""

_FEWEST_TO_CHOOSE = 5
"""Pairs of an edge from which on those that contradict the others are looked for in it alone."""

_ITERATIONS = 100
_ARRIVED = 1e-6
"""Length of the last step, in standard deviations of the frames."""

_SETTLED = 1e-4
"""Relative change of the noise that counts as none."""

_ROUNDS = 20
"""Times that pairs are chosen anew at most."""

_LEAST = 1e-9
"""Least noise that is estimated [rad, m]."""

_SINGULAR = 1e-10
"""Eigenvalue of the scaled information, of the mean one, below which a direction is unknown."""

_UNKNOWN = 0.5
"""Standard deviation of a rotation [rad] from which on it counts as unknown."""

_TIED = 1e-9
"""Eigenvalue, of one, below which nothing but the pairs of an edge themselves tells of a place."""

_MOST_NUMBERS = 5_000_000
"""Numbers of the dense derivatives up to which pairs of one pose are asked what they share."""

_Name = TypeVar("_Name", bound=Hashable)


@dataclass(frozen=True, eq=False)
class Network:
    """Pairs of a network, by the numbers of the frames that they are between."""

    A: FloatArray
    B: FloatArray  # A, B (N, 4, 4): measured transforms [m]
    on_flange: tuple[str, ...]  # names of what is on flanges
    around: tuple[str, ...]  # names of what stands around the arms
    arms: tuple[str, ...]
    k: IntArray
    l: IntArray  # noqa: E741
    j: IntArray  # k, l, j (N,): of each pair, what is on the flange, what is around, and the arm

    @classmethod
    def of(
        cls,
        A: ArrayLike,
        B: ArrayLike,
        on_flange: Sequence[str],
        around: Sequence[str],
        arms: Sequence[str] | None,
    ) -> Network:
        """Check pairs ``(N, 4, 4)`` and the names of each."""
        A, B = checked_pairs(A, B, dimensions=3)
        named = []
        for name, given in (
            ("on_flange", on_flange),
            ("around", around),
            ("arms", ["arm"] * len(A) if arms is None else arms),
        ):
            given = list(given)
            if len(given) != len(A):
                raise InputError(
                    f"{len(given)} names in {name} for {len(A)} pairs",
                    hint="give one for each pair",
                    name=name,
                    value=len(given),
                    bound=len(A),
                )
            named.append(_numbered(given))
        both = sorted(set(named[0][0]) & set(named[1][0]))
        if both:
            raise InputError(
                f"{both[0]} is on a flange in some pairs and stands around the arm in others",
                hint="give the two frames names of their own",
                name=both[0],
            )
        (X, k), (Z, l), (arm, j) = named  # noqa: E741
        return cls(A, B, tuple(X), tuple(Z), tuple(arm), k, l, j)

    @property
    def N(self) -> int:
        """Number of pairs."""
        return len(self.A)

    @cached_property
    def edges(self) -> IntArray:
        """Edge of each pair ``(N,)``: of the same things and the same arm."""
        return np.unique(np.stack([self.j, self.k, self.l]), axis=1, return_inverse=True)[1].ravel()

    def pairs_of(self, name: str) -> IntArray:
        """Numbers of the pairs that a frame takes part in."""
        for names, own in ((self.on_flange, self.k), (self.around, self.l), (self.arms, self.j)):
            if name in names:
                return np.flatnonzero(own == names.index(name))
        raise InputError(f"there is no frame {name}", hint=", ".join(self.frames), name=name)

    def name_of_edge(self, edge: int) -> str:
        """Name of an edge in words."""
        i = int(np.flatnonzero(self.edges == edge)[0])
        name = f"{self.on_flange[self.k[i]]} and {self.around[self.l[i]]}"
        return name if len(self.arms) == 1 else f"{name} by {self.arms[self.j[i]]}"

    @cached_property
    def parts(self) -> IntArray:
        """Part of each arm ``(J,)``: arms that what stands around them joins are of one part."""
        J, L = len(self.arms), len(self.around)
        graph = sparse.coo_array((np.ones(self.N), (self.j, J + self.l)), shape=(J + L, J + L))
        return np.asarray(connected_components(graph, directed=False)[1][:J])

    @cached_property
    def reference(self) -> IntArray:
        """The first arm of the part of each arm ``(J,)``: its base is the frame of the part."""
        return np.array([int(np.argmax(self.parts == part)) for part in self.parts])

    @cached_property
    def placed_arms(self) -> tuple[int, ...]:
        """Arms whose bases are unknown."""
        return tuple(np.flatnonzero(self.reference != np.arange(len(self.arms))).tolist())

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the F unknown transforms: on flanges, around, then bases of arms."""
        return (*self.on_flange, *self.around, *(self.arms[j] for j in self.placed_arms))

    @cached_property
    def base_of(self) -> IntArray:
        """Column of the base of each arm ``(J,)`` among the frames; -1 where it is the frame."""
        first = len(self.on_flange) + len(self.around)
        column = np.full(len(self.arms), -1)
        column[list(self.placed_arms)] = first + np.arange(len(self.placed_arms))
        return column


def _numbered(names: Sequence[_Name]) -> tuple[list[_Name], IntArray]:
    """Different names in the order in which they come first, and the number of each."""
    found = {name: i for i, name in enumerate(dict.fromkeys(names))}
    return list(found), np.array([found[name] for name in names], dtype=np.intp)


@dataclass(frozen=True, eq=False, repr=False)
class NetworkResult(Shown):
    """Frames of a network with their joint covariance."""

    network: Network
    T: FloatArray
    """(F, 4, 4): of each of :attr:`names` [m]: ``T_flange_k`` of what is on a flange, ``T_base_l``
    of what is around, in the base of the first arm of its part, and ``T_base_j`` of the base of an
    arm there."""
    covariance: FloatArray
    """(6 F, 6 F): of the errors (w, v) of each frame [rad, m], a rotation from the left and a
    translation, in the axes of its parent."""
    used: BoolArray  # (N,): pairs that the estimate rests on
    residuals: FloatArray  # (N, 6): rotation vector [rad] and translation [m] of A X less Z B
    sigma: FloatArray
    """(E, 2): noise of B of each edge [rad, m]; NaN where a noise was given."""
    chi2: float  # sum of the squares of the white rows of the pairs used
    findings: tuple[Finding, ...] = ()  # what looks wrong

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the frames."""
        return self.network.frames

    @property
    def headline(self) -> str:
        net = self.network
        return (
            f"{len(net.on_flange)} on flanges, {len(net.around)} around, {len(net.arms)} arms from "
            f"{int(self.used.sum())} of {net.N} pairs"
        )

    def __getitem__(self, name: str) -> FloatArray:
        """Transform ``(4, 4)`` of a frame by its name."""
        return np.asarray(self.T[self._at(name)])

    def covariance_of(self, name: str) -> FloatArray:
        """Covariance ``(6, 6)`` of the errors (w, v) of a frame."""
        own = 6 * self._at(name)
        return np.asarray(self.covariance[own : own + 6, own : own + 6])

    def sigma_of(self, name: str) -> tuple[float, float]:
        """Standard deviations of a frame, root of the sum over three axes [rad, m]."""
        square = np.diag(self.covariance_of(name))
        return float(np.sqrt(square[:3].sum())), float(np.sqrt(square[3:].sum()))

    @property
    def is_ok(self) -> bool:
        """Return True if no finding changes a frame by more than it is known."""
        return all(one.grade != "not to be trusted" for one in self.findings)

    def rows(self) -> list[dict[str, object]]:
        """One row a frame."""
        net = self.network
        found: list[dict[str, object]] = []
        for name, T in zip(self.names, self.T, strict=True):
            turn, place = self.sigma_of(name)
            found.append(
                {
                    "frame": name,
                    "parent": self.parent_of(name),
                    "pairs": int(self.used[net.pairs_of(name)].sum()),
                    **dict(zip(("x_mm", "y_mm", "z_mm"), (1e3 * T[:3, 3]).tolist(), strict=True)),
                    "sigma_mm": 1e3 * place,
                    "sigma_deg": float(np.degrees(turn)),
                }
            )
        return found

    def parent_of(self, name: str) -> str:
        """``flange``, or the base that the frame ``name`` is given in, by its arm if several."""
        net = self.network
        if name in net.on_flange:
            return "flange"
        first = net.j[net.pairs_of(name)[0]]
        return "base" if len(net.arms) == 1 else f"base of {net.arms[net.reference[first]]}"

    def _at(self, name: str) -> int:
        self.network.pairs_of(name)
        return self.names.index(name)


def solve_network(
    A: ArrayLike,
    B: ArrayLike,
    on_flange: Sequence[str],
    around: Sequence[str],
    arms: Sequence[str] | None = None,
    *,
    noise: Noise | None = None,
    leave_out: bool = True,
) -> NetworkResult:
    """Solve ``A_i X_k = Z_l B_i`` for all frames of a network at once.

    Parameters
    ----------
    A, B : array_like (N, 4, 4)
        Measured transforms [m], as of :func:`calib.robot_world.solve`: ``T_base_flange`` of the arm
        of the pair, and from what is on its flange to what stands around.
    on_flange, around : sequence of str (N)
        What is on the flange in each pair, and what stands around.
    arms : sequence of str (N), optional
        The arm of each pair; one arm by default.
    noise : PairNoise or PairCovariances, optional
        Noise of the transforms. It is estimated by default: of B, the same in all directions, and
        for an edge of its own where its pairs show it.
    leave_out : bool
        Whether pairs that contradict the others take no part.

    Returns
    -------
    NetworkResult
        Frames and their joint covariance.

    Raises
    ------
    InputError
        Shapes or names that do not fit.
    NotIdentifiableError
        The pairs do not identify a frame: it is named.
    ConvergenceError
        The search has not arrived.
    """
    net = Network.of(A, B, on_flange, around, arms)
    check_noise(noise, net.N)
    used = _agreeing(net, noise) if leave_out else np.ones(net.N, dtype=bool)
    classes = np.zeros(net.N, dtype=np.intp)
    fit = _adjusted(net, noise, used, _start(net, used), classes)
    for _ in range(_ROUNDS):
        again = fit.explained() if leave_out else used
        others = fit.other_classes()
        if (again == used).all() and (others == classes).all():
            break
        used, classes = again, others
        fit = _adjusted(net, noise, used, fit.T, classes)
    return fit.result()


@dataclass(frozen=True, eq=False)
class _Rows:
    """White rows of all pairs at frames."""

    white: FloatArray  # (N, 6)
    values: FloatArray
    """(N, 6, 18): derivatives by the errors of what is on the flange, of what is around, and of the
    base of the arm."""
    columns: IntArray
    """(N, 18): of these among the errors of all frames; the base that is the frame has zeros."""
    count: int  # of the errors of all frames

    @property
    def jacobian(self) -> sparse.csr_array:
        """Derivatives ``(6 N, count)`` of all rows."""
        N = len(self.white)
        rows = np.repeat(np.arange(6 * N), 18)
        columns = np.repeat(self.columns, 6, axis=0).ravel()
        return sparse.csr_array((self.values.ravel(), (rows, columns)), (6 * N, self.count))

    def of(self, used: BoolArray) -> _Rows:
        """Return those of the pairs used."""
        return _Rows(self.white[used], self.values[used], self.columns[used], self.count)

    @property
    def cost(self) -> float:
        """Sum of the squares of the white rows."""
        return float(np.sum(self.white**2))

    def taken(self, covariance: FloatArray) -> FloatArray:
        """Share ``(N, 6, 6)`` of the rows of each pair that the frames take up."""
        own = covariance[self.columns[:, :, None], self.columns[:, None]]
        return np.asarray(self.values @ own @ np.swapaxes(self.values, 1, 2))


@dataclass(frozen=True, eq=False)
class _NetworkFit:
    """Frames that the adjustment ended in."""

    net: Network
    noise: Noise | None
    used: BoolArray
    T: FloatArray
    classes: IntArray  # (N,): class of noise of each pair
    sigma: FloatArray | None  # (C, 2): noise of each class, where it is estimated
    rows: _Rows
    covariance: FloatArray

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
        X, Z, _ = _of_pairs(net, T)
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
            self._findings(),
        )

    def _widened(self) -> FloatArray:
        """Covariance with what makes pairs tell less than as many independent ones.

        Each edge as the solver of two frames judges it, and what pairs of a pose share, whatever
        their edges: the larger of the two for each number.
        """
        C, own = self.covariance, np.diag(self.covariance)
        J = self.rows.of(self.used).jacobian
        each = sparse.diags_array(np.repeat(self._of_edges()[self.net.edges[self.used]], 6))
        by_edges = C @ np.asarray((J.T @ each @ J).toarray()) @ C
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
        shared: Poses | None = restricted(self.rows.white.T, J, poses=poses, own=True)
        if shared is None:
            return self.covariance
        spread = self.covariance @ shared.information(J) @ self.covariance
        # never surer than by independent pairs
        factor = np.sqrt(np.maximum(np.diag(spread) / np.diag(self.covariance), 1.0))
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
        """What stands elsewhere for one edge than for the others, if noise does not explain it.

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
        known = np.sqrt(np.diag(self.covariance) * max(noise, np.finfo(float).tiny))
        effect = float(np.max(np.abs(others) / known))
        turn, far = (float(np.linalg.norm(part)) for part in np.split(step, 2))
        i = int(np.flatnonzero(net.edges == edge)[0])
        what, where = net.around[net.l[i]], net.on_flange[net.k[i]]
        return Finding(
            f"{what} seems to stand elsewhere in its pairs with {where} than in those with others, "
            f"by {1e3 * far:.2g} mm and {np.degrees(turn):.2g} deg: has one of the two been moved?",
            effect,
        )


def _agreeing(net: Network, noise: Noise | None) -> BoolArray:
    """Pairs ``(N,)`` that agree with the others of their edge."""
    used = np.ones(net.N, dtype=bool)
    known = None if isinstance(noise, PairCovariances) else noise
    for edge in range(net.edges.max() + 1):
        own = np.flatnonzero(net.edges == edge)
        if len(own) >= _FEWEST_TO_CHOOSE:
            found = robust.estimate(PairSets(net.A[own][None], net.B[own][None]), known)
            if found.weights is not None:
                used[own] = found.weights[0] > 0
    return used


def _start(net: Network, used: BoolArray) -> FloatArray:
    """Frames ``(F, 4, 4)`` in closed form; see the module."""
    K, L, J = len(net.on_flange), len(net.around), len(net.arms)
    A, B, k = net.A[used], net.B[used], net.k[used]
    # what stands around has a frame in the base of each arm that sees it
    seen, m = np.unique(net.j[used] * L + net.l[used], return_inverse=True)
    M = len(seen)
    R = np.zeros((K + M, 3, 3))
    graph = sparse.coo_array((np.ones(len(A)), (k, K + m)), shape=(K + M, K + M))
    parts = connected_components(graph, directed=False)[1]
    products = np.einsum("nba,ndc->nacbd", A[:, :3, :3], B[:, :3, :3]).reshape(len(A), 9, 9)
    for part in np.unique(parts):
        own_k, own_m = np.flatnonzero(parts[:K] == part), np.flatnonzero(parts[K:] == part)
        if not len(own_m):
            continue
        inside = np.flatnonzero(parts[k] == part)
        C = np.zeros((len(own_k), len(own_m), 9, 9))
        rows, columns = np.searchsorted(own_k, k[inside]), np.searchsorted(own_m, m[inside])
        np.add.at(C, (rows, columns), products[inside])
        of_k = np.sqrt(np.bincount(rows, minlength=len(own_k)))
        of_m = np.sqrt(np.bincount(columns, minlength=len(own_m)))
        C /= (of_k[:, None] * of_m)[..., None, None]
        flat = C.transpose(0, 2, 1, 3).reshape(9 * len(own_k), 9 * len(own_m))
        U, _, Vt = np.linalg.svd(flat, full_matrices=False)
        both = np.concatenate(
            [
                U[:, 0].reshape(-1, 3, 3) / of_k[:, None, None],
                Vt[0].reshape(-1, 3, 3) / of_m[:, None, None],
            ]
        )
        both *= np.where(np.linalg.det(both).sum() < 0.0, -1.0, 1.0)
        R[np.concatenate([own_k, K + own_m])] = se3.project_to_rotation(both)
    n = len(A)
    at = np.arange(3 * n).reshape(n, 3)
    axes = np.arange(3)
    blocks = [
        (np.repeat(at, 3, axis=1), np.tile(3 * k[:, None] + axes, 3), A[:, :3, :3].reshape(n, 9)),
        (at, 3 * (K + m)[:, None] + axes, np.full((n, 3), -1.0)),
    ]
    rows, columns, values = (np.concatenate([b[c].ravel() for b in blocks]) for c in range(3))
    G = sparse.csr_array((values, (rows, columns)), shape=(3 * n, 3 * (K + M)))
    right = (np.einsum("nab,nb->na", R[K + m], B[:, :3, 3]) - A[:, :3, 3]).ravel()
    p = np.linalg.lstsq((G.T @ G).toarray(), G.T @ right, rcond=1e-12)[0].reshape(-1, 3)
    T = se3.transform(R, p)
    return _assembled(net, T[:K], T[K:], seen, J, L)


def _assembled(
    net: Network, X: FloatArray, seen_at: FloatArray, seen: IntArray, J: int, L: int
) -> FloatArray:
    """Frames from those in the base of each arm: arm by arm from what is known already."""
    V, Z = np.full((J, 4, 4), np.nan), np.full((L, 4, 4), np.nan)
    by_arm = {(int(s) // L, int(s) % L): T for s, T in zip(seen, seen_at, strict=True)}
    V[np.unique(net.reference)] = np.eye(4)
    open_arms = set(range(J))
    while open_arms:
        ready = [j for j in sorted(open_arms) if np.isfinite(V[j]).all()]
        for j in ready:
            for (arm, l), T in by_arm.items():  # noqa: E741
                if arm == j and not np.isfinite(Z[l]).all():
                    Z[l] = se3.inverse(V[j]) @ T
            open_arms.discard(j)
        for j in sorted(open_arms):
            both = [
                T @ se3.inverse(Z[l])
                for (arm, l), T in by_arm.items()  # noqa: E741
                if arm == j and np.isfinite(Z[l]).all()
            ]
            if both:
                V[j] = _mean(np.stack(both))
        if not ready:
            break
    frames = np.concatenate([X, Z, V[list(net.placed_arms)]])
    for at in np.flatnonzero(~np.isfinite(frames).all(axis=(1, 2))).tolist():
        raise NotIdentifiableError(
            [net.frames[at]], ["it is in no pair that agrees with the others"], hint=_REMEDY
        )
    return frames


def _mean(T: FloatArray) -> FloatArray:
    """Mean of transforms ``(n, 4, 4)``."""
    R = se3.project_to_rotation(T[:, :3, :3].mean(axis=0)[None])[0]
    return se3.transform(R, T[:, :3, 3].mean(axis=0))


def _of_pairs(net: Network, T: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """X, Z and base V ``(N, 4, 4)`` of each pair; Z in the base of its arm."""
    K, L = len(net.on_flange), len(net.around)
    V = np.tile(np.eye(4), (net.N, 1, 1))
    base = net.base_of[net.j]
    V[base >= 0] = T[base[base >= 0]]
    return T[net.k], V @ T[K : K + L][net.l], V


def _rows_at(net: Network, model: ErrorModel, T: FloatArray) -> _Rows:
    """White rows at frames ``(F, 4, 4)``."""
    N, K = net.N, len(net.on_flange)
    X, Z, V = _of_pairs(net, T)
    each = PairSets(net.A[:, None], net.B[:, None])
    white, J = linear_rows(each, model, X, Z)
    white, J = white[:, :, 0].T, J[:, :, :, 0].transpose(2, 1, 0)  # (N, 6), (N, 6, 12)
    by_Z = J[:, :, 6:]
    inner = np.zeros((N, 6, 6))  # of Z in the base of the arm, by errors of Z where all are
    inner[:, :3, :3] = inner[:, 3:, 3:] = V[:, :3, :3]
    base = net.base_of[net.j]
    own = np.flatnonzero(base >= 0)
    values = np.concatenate([J[:, :, :6], by_Z @ inner, np.zeros((N, 6, 6))], axis=2)
    if len(own):
        lever = np.tile(np.eye(6), (len(own), 1, 1))
        lever[:, 3:, :3] = -se3.skew(Z[own, :3, 3] - V[own, :3, 3])
        values[own, :, 12:] = by_Z[own] @ lever
    frames = np.stack([net.k, K + net.l, np.maximum(base, 0)], axis=1)
    columns = (6 * frames[:, :, None] + np.arange(6)).reshape(N, 18)
    return _Rows(white, values, columns, 6 * len(T))


def _adjusted(
    net: Network, noise: Noise | None, used: BoolArray, T: FloatArray, classes: IntArray
) -> _NetworkFit:
    """Find the likeliest frames, and the noise where it is unknown, from a start."""
    if 6 * used.sum() < 6 * len(T) or used.sum() < FEWEST_PAIRS:
        raise NotIdentifiableError(
            net.frames, [f"only {int(used.sum())} pairs agree, for {len(T)} frames"], hint=_REMEDY
        )
    sigma = _shown(net, T, used, classes) if noise is None else None
    model: ErrorModel
    if sigma is not None:
        model = _isotropic(sigma[classes])
    elif noise is not None:
        model = noise.model(PairSets(net.A[None], net.B[None]))
    damping, settled = 0.0, noise is not None
    rows = _rows_at(net, model, T)
    for _ in range(_ITERATIONS):
        some = rows.of(used)
        J = some.jacobian
        information, gradient = (J.T @ J).toarray(), J.T @ some.white.ravel()
        unit = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
        scaled = information / np.outer(unit, unit)
        covariance = _inverse(net, scaled) / np.outer(unit, unit)
        if damping:
            step = -np.linalg.solve(scaled + damping * np.eye(len(unit)), gradient / unit) / unit
        else:
            step = -covariance @ gradient
        length = float(np.sqrt(max(-step @ gradient, 0.0)))
        tried = perturb(T, step.reshape(-1, 6))
        new = _rows_at(net, model, tried)
        if new.of(used).cost > some.cost * (1.0 + 1e-12) and length > _ARRIVED:
            damping = max(10.0 * damping, 1e-3)
            if damping > 1e12:
                break
            continue
        T, rows, damping = tried, new, damping / 10.0 if damping > 1e-3 else 0.0
        if sigma is not None:
            again = _renewed(net, rows, used, classes, covariance, sigma)
            settled = bool((np.abs(again / sigma - 1.0) < _SETTLED).all())
            sigma, model = again, _isotropic(again[classes])
            rows = _rows_at(net, model, T)
        if length <= _ARRIVED and settled:
            _refuse_unknown(net, covariance)
            return _NetworkFit(net, noise, used, T, classes, sigma, rows, covariance)
    raise ConvergenceError("the frames of the network have not converged")


def _isotropic(sigma: FloatArray) -> Isotropic:
    """Errors of B with standard deviations ``(N, 2)`` of rotation and translation."""
    return Isotropic(np.concatenate([np.zeros_like(sigma.T), sigma.T]))


def _shown(net: Network, T: FloatArray, used: BoolArray, classes: IntArray) -> FloatArray:
    """Noise ``(C, 2)`` that residuals show."""
    X, Z, _ = _of_pairs(net, T)
    square = difference(net.A @ X, Z @ net.B) ** 2
    sums = np.stack([square[:, :3].sum(axis=1), square[:, 3:].sum(axis=1)])
    count = np.bincount(classes, used)
    by_class = [np.bincount(classes, used * one) / np.maximum(3.0 * count, 1.0) for one in sums]
    return np.asarray(np.maximum(np.sqrt(np.stack(by_class, axis=1)), _LEAST))


def _renewed(
    net: Network,
    rows: _Rows,
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


def _inverse(net: Network, scaled: FloatArray) -> FloatArray:
    """Inverse of the scaled information.

    Raises
    ------
    NotIdentifiableError
        A direction is unknown: the frame that it moves most is named.
    """
    values, axes = np.linalg.eigh(scaled)
    if values[0] < _SINGULAR:
        share = (axes[:, 0] ** 2).reshape(-1, 6).sum(axis=1)
        raise _unknown(net, int(np.argmax(share)))
    return np.asarray((axes / values) @ axes.T)


def _refuse_unknown(net: Network, covariance: FloatArray) -> None:
    """Refuse frames whose rotation is not known to half a radian."""
    turn = np.sqrt(np.diag(covariance).reshape(-1, 6)[:, :3].max(axis=1))
    if turn.max() > _UNKNOWN:
        raise _unknown(net, int(np.argmax(turn)))


def _unknown(net: Network, frame: int) -> NotIdentifiableError:
    return NotIdentifiableError(
        [net.frames[frame]],
        ["the flange turns about one axis while it is seen, or it has too few pairs"],
        hint=_REMEDY,
    )


_REMEDY = "turn the flange about two axes while it is seen"
