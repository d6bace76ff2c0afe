"""The best of all subsets, criterion by criterion, from the definitions alone."""

from __future__ import annotations

from functools import cache
from itertools import combinations

import numpy as np


@cache
def members(pool: int, chosen: int) -> np.ndarray:
    """All subsets, as rows of zeros and ones."""
    subsets = np.array(list(combinations(range(pool), chosen)))
    found = np.zeros((len(subsets), pool))
    found[np.arange(len(subsets))[:, None], subsets] = 1.0
    return found


def best_value(J: np.ndarray, chosen: int, kind: str, L: np.ndarray | None = None) -> float:
    """The best value over all subsets of ``chosen`` of the blocks ``(N, m, p)``."""
    inside = members(len(J), chosen)
    p = J.shape[2]
    M = (inside @ (np.swapaxes(J, 1, 2) @ J).reshape(len(J), -1)).reshape(-1, p, p)
    if kind == "D":
        return float(np.exp(np.linalg.slogdet(M)[1] / p).max())
    if kind == "A":
        return float(np.trace(np.linalg.inv(M), axis1=1, axis2=2).min())
    if kind == "G":
        errors = np.einsum("krp,npq,krq->nk", L, np.linalg.inv(M), L, optimize=True)
        return float(np.sqrt(errors.max(axis=1).min()))
    if kind == "C_G":
        size = np.where(inside[:, :, None] > 0, np.abs(J).max(axis=1), 0.0).max(axis=1)
        H = M / size[:, :, None] / size[:, None, :]
        norms = [np.abs(each).sum(axis=-1).max(axis=-1) for each in (H, np.linalg.inv(H))]
        return float((norms[0] * norms[1]).min())
    if kind == "cond_2":
        length = np.sqrt(np.einsum("npp->np", M))
        M = M / length[:, :, None] / length[:, None, :]
    values = np.linalg.eigvalsh(M)
    least, most = values[:, 0], values[:, -1]
    return float(
        {
            "E": least.max(),
            "O5": (1.0 / (values**-0.5).sum(axis=1)).max(),
            "cond_2": np.sqrt((most / least).min()),
            "O2": np.sqrt((least / most).max()),
            "O4": (least / np.sqrt(most)).max(),
        }[kind]
    )


def random_pool(rng: np.random.Generator, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Blocks ``(N, m, p)`` of any shape, poses of unlike strength, and functions ``(K, r, p)``."""
    p, m = int(rng.integers(3, 7)), int(rng.integers(1, 4))
    J = rng.normal(size=(size, m, p)) * np.exp(0.7 * rng.normal(size=(size, 1, 1)))
    return J + 0.5 * rng.normal(size=(1, 1, p)), rng.normal(size=(6, 3, p))
