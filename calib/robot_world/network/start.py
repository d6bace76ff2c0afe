"""Frames of a network to start from, in closed form.

Rotations by the leading singular vectors of all equations ``R_A R_X = R_Z R_B`` at once, as Wise et
al. 2025 (arXiv 2507.23045) and Shah's method for one pair, then translations by least squares.
Where the rotations do not tell, as of arms that turn about one axis, the frames of one edge are
found by translations too, and the others from these, one after the other.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from calib import se3
from calib.errors import NotIdentifiableError
from calib.robot_world.network.graph import REMEDY, Network
from calib.robot_world.network.prior import FramePrior
from calib.se3 import BoolArray, FloatArray, IntArray

_CLOSE = 1.0 - 1e-3
"""Second singular value, of the first, from which on rotations alone do not tell the frames: poses
then tilt by less than 3 deg."""

_ANGLES = 90
"""Turns about a common axis that are tried."""

_TINY = 1e-12


def start(net: Network, used: BoolArray, priors: Sequence[FramePrior] = ()) -> FloatArray:
    """Return frames ``(F, 4, 4)`` to start from; see the module."""
    K, L, J = len(net.on_flange), len(net.around), len(net.arms)
    A, B, k = net.A[used], net.B[used], net.k[used]
    # what stands around has a frame in the base of each arm that sees it
    seen, m = np.unique(net.j[used] * L + net.l[used], return_inverse=True)
    M = len(seen)
    frames = np.full((K + M, 4, 4), np.nan)
    graph = sparse.coo_array((np.ones(len(A)), (k, K + m)), shape=(K + M, K + M))
    parts = connected_components(graph, directed=False)[1]
    known = {prior.frame: prior.T for prior in priors if prior.is_whole}
    for part in np.unique(parts[K:]).tolist():
        inside = np.flatnonzero(parts[k] == part)
        own = A[inside], B[inside], k[inside], K + m[inside]
        members = np.flatnonzero(parts == part)
        R = _rotations(*own, members, K)
        if R is not None:
            frames[members] = se3.transform(R, _places(*own, members, R))
            continue
        for name, T in known.items():
            if name in net.on_flange and parts[net.on_flange.index(name)] == part:
                frames[net.on_flange.index(name)] = T
            elif name in net.around:
                at = np.flatnonzero(seen == net.reference[0] * L + net.around.index(name))
                if len(at) and parts[K + at[0]] == part:
                    frames[K + at[0]] = T
        _grown(*own, frames, members)
    return _assembled(net, frames[:K], frames[K:], seen, J, L)


def _rotations(
    A: FloatArray, B: FloatArray, k: IntArray, m: IntArray, members: IntArray, K: int
) -> FloatArray | None:
    """Rotations ``(n, 3, 3)`` of the members of a part; None where they are not told."""
    own_k, own_m = members[members < K], members[members >= K]
    rows, columns = np.searchsorted(own_k, k), np.searchsorted(own_m, m)
    C = np.zeros((len(own_k), len(own_m), 9, 9))
    # <R_A R_X, R_Z R_B> by the numbers of R_X and of R_Z
    products = np.einsum("nba,ndc->nacbd", A[:, :3, :3], B[:, :3, :3]).reshape(len(A), 9, 9)
    np.add.at(C, (rows, columns), products)
    of_k = np.sqrt(np.bincount(rows, minlength=len(own_k)))
    of_m = np.sqrt(np.bincount(columns, minlength=len(own_m)))
    C /= (of_k[:, None] * of_m)[..., None, None]
    U, values, Vt = np.linalg.svd(
        C.transpose(0, 2, 1, 3).reshape(9 * len(own_k), 9 * len(own_m)), full_matrices=False
    )
    if values[1] > _CLOSE * values[0]:
        return None
    both = np.concatenate(
        [
            U[:, 0].reshape(-1, 3, 3) / of_k[:, None, None],
            Vt[0].reshape(-1, 3, 3) / of_m[:, None, None],
        ]
    )
    both *= np.where(np.linalg.det(both).sum() < 0.0, -1.0, 1.0)
    return se3.project_to_rotation(both)


def _places(
    A: FloatArray, B: FloatArray, k: IntArray, m: IntArray, members: IntArray, R: FloatArray
) -> FloatArray:
    """Origins ``(n, 3)`` of the members by least squares; the shortest where they are not told."""
    n = len(A)
    k, m = np.searchsorted(members, k), np.searchsorted(members, m)
    at, axes = np.arange(3 * n).reshape(n, 3), np.arange(3)
    blocks = [
        (np.repeat(at, 3, axis=1), np.tile(3 * k[:, None] + axes, 3), A[:, :3, :3].reshape(n, 9)),
        (at, 3 * m[:, None] + axes, np.full((n, 3), -1.0)),
    ]
    rows, columns, values = (np.concatenate([b[c].ravel() for b in blocks]) for c in range(3))
    G = sparse.csr_array((values, (rows, columns)), shape=(3 * n, 3 * len(members)))
    right = (np.einsum("nab,nb->na", R[m], B[:, :3, 3]) - A[:, :3, 3]).ravel()
    found = np.linalg.lstsq((G.T @ G).toarray(), G.T @ right, rcond=1e-10)[0]
    return np.asarray(found.reshape(-1, 3))


def _grown(
    A: FloatArray, B: FloatArray, k: IntArray, m: IntArray, frames: FloatArray, members: IntArray
) -> None:
    """Fill in the frames of a part from those known, or from those of its largest edge."""
    edges, edge, count = np.unique(
        np.stack([k, m]), axis=1, return_inverse=True, return_counts=True
    )
    edge = edge.ravel()
    if not np.isfinite(frames[members]).all(axis=(1, 2)).any():
        own = np.flatnonzero(edge == np.argmax(count))
        frames[edges[0, np.argmax(count)]], _ = _of_one_edge(A[own], B[own])
    for _ in members:
        for e in np.argsort(-count).tolist():
            own = np.flatnonzero(edge == e)
            x, z = edges[:, e]
            have_x, have_z = (np.isfinite(frames[at]).all() for at in (x, z))
            if have_x and not have_z:
                frames[z] = mean_of(A[own] @ frames[x] @ se3.inverse(B[own]))
            elif have_z and not have_x:
                frames[x] = mean_of(se3.inverse(A[own]) @ frames[z] @ B[own])


def _of_one_edge(A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray]:
    """X and Z ``(4, 4)`` where all rotations are about one axis, or there are none.

    ``X⁻¹ (A_1⁻¹ A_i) X = B_1⁻¹ B_i``: X takes the axis of the one to that of the other. The turn
    about it is the one with which the translations fit best.
    """
    one, other = (
        se3.rotation_log(np.swapaxes(T[:1, :3, :3], -1, -2) @ T[:, :3, :3]) for T in (A, B)
    )
    a, b = (np.linalg.svd(w, full_matrices=False)[2][0] for w in (one, other))
    b = b * np.where((one @ a) @ (other @ b) < 0.0, -1.0, 1.0)
    across = np.cross(b, a)
    sine = float(np.linalg.norm(across))
    angle = float(np.arctan2(sine, a @ b))
    if sine < _TINY:
        across = np.cross(b, np.eye(3)[np.argmin(np.abs(b))])
        sine = float(np.linalg.norm(across))
    first = se3.rotation_exp(angle * across / sine)
    turns = np.linspace(0.0, 2.0 * np.pi, _ANGLES, endpoint=False)
    candidates = [se3.rotation_exp(turn * a) @ first for turn in turns]
    # translations alone tell the rotation of Z where the arm moves in three directions
    p, q = (T[:, :3, 3] - T[:, :3, 3].mean(axis=0) for T in (A, B))
    R_Z = se3.project_to_rotation((p.T @ q)[None])[0]
    candidates.append(_mean_rotation(np.swapaxes(A[:, :3, :3], -1, -2) @ R_Z @ B[:, :3, :3]))
    best: tuple[float, FloatArray, FloatArray] | None = None
    N = len(A)
    G = np.concatenate([A[:, :3, :3].reshape(3 * N, 3), -np.tile(np.eye(3), (N, 1))], axis=1)
    inverse = np.linalg.pinv(G, rcond=1e-6)
    size = float(np.sqrt((q**2).sum(axis=1).mean())) or 1.0
    for R_X in candidates:
        R_Z = _mean_rotation(A[:, :3, :3] @ R_X @ np.swapaxes(B[:, :3, :3], -1, -2))
        right = (B[:, :3, 3] @ R_Z.T - A[:, :3, 3]).ravel()
        place = inverse @ right
        gaps = A[:, :3, :3] @ R_X - R_Z @ B[:, :3, :3]
        cost = float(((G @ place - right) ** 2).sum() / size**2 + (gaps**2).sum())
        if best is None or cost < best[0]:
            X, Z = se3.transform(R_X, place[:3]), se3.transform(R_Z, place[3:])
            best = cost, X, Z
    if best is None:
        raise ValueError("nothing was tried")
    return best[1], best[2]


def _assembled(
    net: Network, X: FloatArray, seen_at: FloatArray, seen: IntArray, J: int, L: int
) -> FloatArray:
    """Frames from those in the base of each arm: arm by arm from what is known already."""
    V, Z = np.full((J, 4, 4), np.nan), np.full((L, 4, 4), np.nan)
    by_arm = [(int(s) // L, int(s) % L, T) for s, T in zip(seen, seen_at, strict=True)]
    V[np.unique(net.reference)] = np.eye(4)
    open_arms = set(range(J))
    while open_arms:
        ready = [j for j in sorted(open_arms) if np.isfinite(V[j]).all()]
        for j in ready:
            for arm, target, T in by_arm:
                if arm == j and not np.isfinite(Z[target]).all():
                    Z[target] = se3.inverse(V[j]) @ T
            open_arms.discard(j)
        for j in sorted(open_arms):
            both = [
                T @ se3.inverse(Z[target])
                for arm, target, T in by_arm
                if arm == j and np.isfinite(Z[target]).all()
            ]
            if both:
                V[j] = mean_of(np.stack(both))
        if not ready:
            break
    frames = np.concatenate([X, Z, V[list(net.placed_arms)]])
    missing = np.flatnonzero(~np.isfinite(frames).all(axis=(1, 2))).tolist()
    if missing:
        raise NotIdentifiableError(
            [net.frames[at] for at in missing],
            ["no pair of it agrees with the others"],
            hint=REMEDY,
        )
    return frames


def mean_of(T: FloatArray) -> FloatArray:
    """Return the mean of transforms ``(n, 4, 4)``."""
    return se3.transform(_mean_rotation(T[:, :3, :3]), T[:, :3, 3].mean(axis=0))


def _mean_rotation(R: FloatArray) -> FloatArray:
    return np.asarray(se3.project_to_rotation(R.mean(axis=0)[None])[0])
