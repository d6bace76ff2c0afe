"""The fewest poses of a pool, against all subsets of small pools."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from calib.errors import InputError, NotIdentifiableError
from calib.robot_world import PairNoise, design, random_problems
from posedesign.selection import select_fewest, wanted_deviations

POOL = 10


def fewest_of(blocks, wanted):
    return select_fewest(
        blocks, wanted_deviations(wanted, 2 if blocks.ndim < 3 else blocks.shape[-1])
    )


def value_of(blocks, wanted) -> float:
    rows = blocks.reshape(-1, blocks.shape[-1])
    if np.linalg.matrix_rank(rows) < rows.shape[1]:
        return np.inf
    return float((sigma_of(blocks) / wanted).max())


def sigma_of(blocks) -> np.ndarray:
    rows = blocks.reshape(-1, blocks.shape[-1])
    return np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))


def best_of_all(blocks, wanted, count: int) -> float:
    """Smallest value of the largest share over all subsets of a size."""
    scaled = blocks * wanted
    each = np.swapaxes(scaled, 1, 2) @ scaled
    subsets = np.array(list(combinations(range(len(blocks)), count)))
    information = each[subsets].sum(axis=1)
    seen = np.linalg.cond(information) < 1e13
    if not seen.any():
        return float("inf")
    variances = np.diagonal(np.linalg.inv(information[seen]), axis1=1, axis2=2)
    return float(np.sqrt(variances.max(axis=1).min()))


def hand_eye_pool(seed: int):
    rng = np.random.default_rng(seed)
    cone_deg = (None, 40.0, 20.0)[seed % 3]
    found = random_problems(rng, 1, POOL, cone_deg)
    noise = PairNoise(3e-4, 1e-4, ("A", "B", "both")[seed // 3 % 3])
    blocks = design.blocks(found.A[0], found.X[0], found.Z[0], noise)
    sigma = sigma_of(blocks)
    return blocks, sigma * np.maximum(
        rng.uniform(1.1, 2.2) * rng.lognormal(sigma=0.1, size=12), 1.01
    )


def test_as_few_as_any_subset():
    for seed in range(12):
        blocks, wanted = hand_eye_pool(seed)
        found = fewest_of(blocks, wanted)
        assert found.reached
        chosen = found.selection
        np.testing.assert_allclose(chosen.sigma, sigma_of(blocks[chosen.indices]), rtol=1e-6)
        assert (chosen.sigma <= wanted * (1 + 1e-8)).all()
        sizes = range(2, POOL + 1)
        fewest = next(n for n in sizes if best_of_all(blocks, wanted, n) <= 1)
        assert chosen.count == fewest
        assert found.at_least <= fewest
        least = best_of_all(blocks, wanted, chosen.count - 1)
        assert found.fewer.count == chosen.count - 1
        assert found.fewer.value > 1
        assert least * (1 - 1e-6) <= found.fewer.value


@pytest.mark.parametrize("seed", range(4))
def test_blocks_of_any_model_will_do(seed):
    """Three rows, seven parameters, of which four may be known as badly as they like."""
    rng = np.random.default_rng(seed)
    blocks = rng.normal(size=(12, 3, 7)) * rng.lognormal(size=7)
    wanted = np.where(np.arange(7) < 3, 1.6 * sigma_of(blocks), np.inf)
    found = fewest_of(blocks, wanted)
    sizes = range(3, 13)
    subsets = ((n, s) for n in sizes for s in combinations(range(12), n))
    fewest = next(n for n, s in subsets if value_of(blocks[list(s)], wanted) <= 1)
    assert found.selection.count == fewest
    assert (found.selection.sigma <= wanted).all()
    assert np.isfinite(found.selection.sigma).all()


def test_one_number_is_meant_for_all():
    blocks, _ = hand_eye_pool(2)
    one = float(1.3 * sigma_of(blocks).max())
    np.testing.assert_array_equal(
        fewest_of(blocks, one).selection.indices,
        fewest_of(blocks, np.full(12, one)).selection.indices,
    )


def test_units_do_not_matter():
    blocks, wanted = hand_eye_pool(4)
    scale = np.where(np.arange(12) % 6 < 3, 180 / np.pi, 1e3)
    found = fewest_of(blocks / scale, wanted * scale)
    expected = fewest_of(blocks, wanted)
    assert found.selection.count == expected.selection.count
    assert found.selection.value == pytest.approx(expected.selection.value, rel=1e-6)


def test_the_whole_pool_reaches_what_it_has():
    blocks, _ = hand_eye_pool(0)
    found = fewest_of(blocks, sigma_of(blocks) * (1 + 1e-10))
    assert found.reached
    assert found.selection.count == POOL
    assert found.fewer.value > 1
    assert found.at_least > POOL / 2


def test_out_of_reach_says_by_how_much():
    blocks, _ = hand_eye_pool(1)
    everything = sigma_of(blocks)
    found = fewest_of(blocks, everything / 1.3)
    assert not found.reached
    np.testing.assert_array_equal(found.selection.indices, np.arange(POOL))
    assert found.selection.value == pytest.approx(1.3)
    assert "1.3" in found.message
    assert "measured 2 times" in found.message  # 1.69
    # two that are alike but for rounding would do
    twice = np.concatenate([blocks * (1 + k * 1e-9) for k in range(2)])
    assert fewest_of(twice, everything / 1.3).reached


def test_a_pool_that_sees_nothing_of_a_parameter_is_refused():
    blocks = np.random.default_rng(0).normal(size=(6, 2, 3))
    blocks[..., 1] = 0.0
    with pytest.raises(NotIdentifiableError, match="column 2"):
        fewest_of(blocks, 1e9)
    parallel = np.repeat(np.random.default_rng(1).normal(size=(6, 2, 1)), 2, axis=2)
    with pytest.raises(NotIdentifiableError, match="column 1, column 2"):
        fewest_of(parallel, 1e9)


def test_a_single_pose_may_do():
    blocks = np.random.default_rng(2).normal(size=(5, 4, 3))
    found = fewest_of(blocks, 100.0)
    assert found.selection.count == 1
    assert found.fewer is None
    assert found.at_least == 1
    assert "fewer cannot" in found.message


@pytest.mark.parametrize(
    ("blocks", "wanted", "words"),
    [
        (np.ones((3, 2)), 1.0, "blocks"),
        (np.ones((0, 2, 2)), 1.0, "blocks"),
        (np.full((3, 2, 2), np.nan), 1.0, "not finite"),
        (np.ones((3, 2, 2)), [1.0, 1.0, 1.0], "2 parameters"),
        (np.ones((3, 2, 2)), 0.0, "above zero"),
        (np.ones((3, 2, 2)), [1.0, -1.0], "above zero"),
        (np.ones((3, 2, 2)), np.inf, "no standard deviation"),
    ],
)
def test_what_cannot_be_chosen_from_is_refused(blocks, wanted, words):
    with pytest.raises(InputError, match=words):
        fewest_of(blocks, wanted)
