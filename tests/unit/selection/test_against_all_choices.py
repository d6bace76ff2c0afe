"""Exchange against all choices out of small pools, and bounds that none of them beats."""

from functools import cache
from itertools import combinations

import numpy as np
import pytest

from posedesign.selection import criterion_by_name, largest_deviation, select
from tests.marks import rest_in_full


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


POOL, CHOSEN = 16, 7
"""11,440 choices: more than are tried all at once, few enough to be tried here."""

KINDS = ("D", "A", "E", "O5", "G", "C_G", "cond_2", "O2", "O4")
FOUND = 0.95
"""Part of the problems in which the best of all choices is found."""

PROBLEMS = 50


def shares(kind: str, seeds: range) -> tuple[np.ndarray, np.ndarray]:
    """Of each problem: value found over the best (at least 1), best over the bound (at least 1)."""
    lost, slack = [], []
    for seed in seeds:
        J, L = random_pool(np.random.default_rng(seed), POOL)
        best = best_value(J, CHOSEN, kind, L)
        criterion = (
            largest_deviation(L) if kind == "G" else criterion_by_name(kind, J.shape[2], CHOSEN)
        )
        found = select(J, CHOSEN, criterion)
        sign = 1 if criterion.smaller_is_better else -1
        lost.append((found.value / best) ** sign)
        slack.append((best / found.bound) ** sign)
    return np.array(lost), np.array(slack)


@pytest.mark.parametrize("kind", KINDS)
def test_best_of_all_choices(kind):
    lost, slack = shares(kind, range(2))
    assert (lost >= 1.0 - 1e-9).all()  # nothing is better than the best: both count alike
    assert np.median(lost) == pytest.approx(1.0, abs=1e-6)
    assert lost.max() < 1.1
    assert (slack >= 1.0 - 1e-12).all()


@pytest.mark.slow
@pytest.mark.parametrize("kind", rest_in_full(KINDS, ("D", "A")))
def test_nearly_always_the_best_of_all_choices(kind):
    lost, slack = shares(kind, range(1000, 1000 + PROBLEMS))
    assert (lost < 1.0 + 1e-6).mean() >= FOUND
    assert (slack >= 1.0 - 1e-12).all()


@pytest.mark.parametrize("method", ["detmax", "greedy", "rounding"])
def test_other_methods_find_no_better_one(method):
    for seed in range(2):
        J, _ = random_pool(np.random.default_rng(seed), 16)
        best = best_value(J, 7, "D")
        found = select(J, 7, "D", method)
        assert len(found.indices) == 7
        assert found.value <= best * (1 + 1e-9)
        assert found.value > 0.5 * best
        assert found.bound >= best * (1 - 1e-12)
