"""The fewest poses of a pool, against all subsets of small pools."""

from itertools import combinations

import numpy as np
import pytest

from calib.errors import InputError, NotIdentifiableError
from calib.robot_world import PairNoise, design, random_problems
from posedesign.selection import select, select_fewest, wanted_deviations
from posedesign.selection.indices import o1

POOL = 10


def fewest_of(blocks, wanted):
    return select_fewest(
        blocks, wanted_deviations(wanted, 2 if blocks.ndim < 3 else blocks.shape[-1])
    )


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


def fewest_by_brute_force(blocks, wanted) -> int:
    return next(n for n in range(1, len(blocks) + 1) if best_of_all(blocks, wanted, n) <= 1 + 1e-9)


def test_as_few_as_any_subset():
    """All choices of so small pools are tried, so that the number is proven, too."""
    for seed in range(24):
        blocks, wanted = hand_eye_pool(seed)
        found = fewest_of(blocks, wanted)
        chosen = found.selection
        assert found.reached
        np.testing.assert_allclose(chosen.sigma, sigma_of(blocks[chosen.indices]), rtol=1e-6)
        assert (chosen.sigma <= wanted * (1 + 1e-8)).all()
        assert chosen.count == fewest_by_brute_force(blocks, wanted)
        assert found.at_least == chosen.count
        assert "proven: fewer cannot" in found.message
        least = best_of_all(blocks, wanted, chosen.count - 1)
        assert found.fewer.count == chosen.count - 1
        assert found.fewer.value == pytest.approx(least, rel=1e-6)
        assert found.fewer.value > 1


@pytest.mark.parametrize("seed", range(3))
def test_pools_of_which_not_all_choices_are_tried(seed):
    """By the relaxation and exchange: no fewer than proven, as few as any subset."""
    rng = np.random.default_rng(seed)
    blocks = rng.normal(size=(18, 2, 4)) * np.exp(0.5 * rng.normal(size=(18, 1, 1)))
    wanted = 1.7 * sigma_of(blocks)
    found = fewest_of(blocks, wanted)
    fewest = fewest_by_brute_force(blocks, wanted)
    assert found.reached
    assert found.at_least <= fewest == found.selection.count
    assert found.at_least >= fewest - 2
    if found.at_least < fewest:
        assert f"fewer than {found.at_least} cannot" in found.message


@pytest.mark.parametrize("seed", range(6))
def test_blocks_of_any_model_will_do(seed):
    """Three rows, seven parameters, of which four may be known as badly as they like."""
    rng = np.random.default_rng(seed)
    blocks = rng.normal(size=(12, 3, 7)) * rng.lognormal(size=7)
    wanted = np.where(np.arange(7) < 3, 1.6 * sigma_of(blocks), np.inf)
    found = fewest_of(blocks, wanted)
    subsets = ((n, s) for n in range(3, 13) for s in combinations(range(12), n))
    fewest = next(n for n, s in subsets if (sigma_of(blocks[list(s)]) <= wanted).all())
    assert found.selection.count == fewest
    assert (found.selection.sigma <= wanted * (1 + 1e-9)).all()
    assert np.isfinite(found.selection.sigma).all()


@pytest.mark.parametrize("name", ["D", "A", "E", "O1", "O5", "C_G", "cond_2"])
def test_any_criterion(name):
    """The value that the best of five poses has is reached by five, and by no fewer."""
    rng = np.random.default_rng(3)
    blocks = rng.normal(size=(11, 2, 3)) * np.exp(0.7 * rng.normal(size=(11, 1, 1)))
    five, four = (select(blocks, n, name) for n in (5, 4))
    cost = five.criterion.cost_of
    found = select_fewest(blocks, name, five.value)
    assert found.reached
    assert cost(found.selection.value) <= cost(five.value) * (1 + 1e-8)
    if five.criterion.falls_with_poses:
        assert found.selection.count == found.at_least == 5
        assert found.fewer.value == pytest.approx(four.value, rel=1e-9)
    else:
        assert found.at_least <= found.selection.count
        assert found.selection.criterion.name == name


def test_the_mean_singular_value_is_over_the_poses_chosen():
    """O1 has the number of poses in it, which is not known beforehand."""
    blocks = np.random.default_rng(4).normal(size=(30, 2, 3))
    found = select_fewest(blocks, "O1", 1.2)
    assert found.reached
    assert found.selection.value == pytest.approx(o1(blocks[found.selection.indices]))
    assert found.selection.value >= 1.2 * (1 - 1e-9)


def test_kept_poses_and_known_rows_count():
    blocks, wanted = hand_eye_pool(2)
    plain = fewest_of(blocks, wanted)
    criterion = wanted_deviations(wanted, 12)
    kept = select_fewest(blocks, criterion, keep=[0, 9])
    assert {0, 9} <= set(kept.selection.indices)
    assert kept.selection.count >= plain.selection.count
    rest = blocks[1:9]
    known = select_fewest(rest, criterion, known=blocks[[0, 9]])
    assert known.selection.count == kept.selection.count - 2


def test_interest_is_handed_on():
    blocks = np.random.default_rng(5).normal(size=(12, 2, 4))
    own = select(blocks, 4, "A", interest=[1])
    found = select_fewest(blocks, "A", own.value, interest=[1])
    assert found.selection.count == 4
    assert found.selection.value == pytest.approx(own.value)


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
    found = fewest_of(blocks / scale, wanted * scale).selection
    expected = fewest_of(blocks, wanted).selection
    np.testing.assert_array_equal(found.indices, expected.indices)
    np.testing.assert_allclose(found.sigma, expected.sigma * scale, rtol=1e-9)


def test_the_whole_pool_reaches_what_it_has():
    blocks, _ = hand_eye_pool(0)
    found = fewest_of(blocks, sigma_of(blocks))
    assert found.reached
    assert found.selection.count == POOL
    assert found.fewer.value > 1


def test_out_of_reach_says_by_how_much():
    blocks, _ = hand_eye_pool(1)
    everything = sigma_of(blocks)
    found = fewest_of(blocks, everything / 1.5)
    assert not found.reached
    assert found.fewer is None
    assert found.at_least == POOL
    np.testing.assert_array_equal(found.selection.indices, np.arange(POOL))
    assert found.selection.value == pytest.approx(1.5)
    assert "out of reach" in found.message
    assert "measured 3 times" in found.message  # 2.25


@pytest.mark.slow
def test_more_candidates_that_are_as_good_would_do():
    blocks, _ = hand_eye_pool(1)
    rng = np.random.default_rng(0)
    more = np.concatenate([blocks * (1 + 1e-3 * rng.normal(size=blocks.shape)) for _ in range(3)])
    assert fewest_of(more, sigma_of(blocks) / 1.5).reached


def test_out_of_reach_of_a_condition():
    blocks = np.random.default_rng(6).normal(size=(9, 2, 3))
    found = select_fewest(blocks, "cond_2", 1.0 + 1e-6)
    assert not found.reached
    assert "measured" not in found.message
    assert found.at_least <= 2  # more poses need not lower it: nothing is proven of fewer


def test_a_pool_that_sees_nothing_of_a_parameter_is_refused():
    blocks = np.random.default_rng(0).normal(size=(6, 2, 3))
    blocks[..., 1] = 0.0
    with pytest.raises(NotIdentifiableError, match="column 2"):
        fewest_of(blocks, 1e9)


def test_a_single_pose_may_do():
    blocks = np.random.default_rng(2).normal(size=(5, 4, 3))
    found = fewest_of(blocks, 100.0)
    assert found.selection.count == 1
    assert found.fewer is None
    assert found.at_least == 1


@pytest.mark.parametrize(
    ("blocks", "wanted", "says"),
    [
        (np.ones((4, 3)), 1.0, "blocks"),
        (np.ones((4, 3, 2)), [1.0, 1.0, 1.0], "2 parameters"),
        (np.ones((4, 3, 2)), 0.0, "above zero"),
        (np.ones((4, 3, 2)), [1.0, np.nan], "above zero"),
        (np.ones((4, 3, 2)), np.inf, "no standard deviation"),
    ],
)
def test_what_cannot_be_chosen_from_is_refused(blocks, wanted, says):
    with pytest.raises(InputError, match=says):
        fewest_of(blocks, wanted)


def test_starts_are_checked():
    with pytest.raises(InputError, match="0 starts"):
        select_fewest(hand_eye_pool(0)[0], "D", 1.0, starts=0)
