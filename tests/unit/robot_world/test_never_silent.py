"""Pairs that do not fit, or do not identify X and Z, are refused or doubted by name."""

import collections

import numpy as np
import pytest

from calib import se3
from calib.errors import CalibError, InputError, NotIdentifiableError
from calib.robot_world import METHODS, PairNoise, add_noise, random_problems, solve, solve_batch
from tests.hostile_pairs import SPOILT, hostile_sets, is_silently_wrong, viewing_pairs

SMALL = PairNoise(np.radians(0.1), 1e-3, "B")


def measured(seed, pairs, cone_deg=None, noise=SMALL):
    rng = np.random.default_rng(seed)
    problems = random_problems(rng, 1, pairs, cone_deg)
    return add_noise(rng, problems.A[0], problems.B[0], noise)


def swapped(A, B):
    B = B.copy()
    B[[1, 4]] = B[[4, 1]]
    return A, B


def permuted(A, B):
    order = np.random.default_rng(1).permutation(len(B))
    while (order == np.arange(len(B))).any():
        order = np.random.default_rng(order[0] + 2).permutation(len(B))
    return A, B[order]


MISTAKES = {
    "permuted": permuted,
    "reversed": lambda A, B: (A, B[::-1]),
    "a row of B missing": lambda A, B: (A[:-1], B[1:]),
    "a row of A missing": lambda A, B: (A[1:], B[:-1]),
    "rolled": lambda A, B: (A, np.roll(B, 1, axis=0)),
    "B inverted": lambda A, B: (A, se3.inverse(B)),
    "A inverted": lambda A, B: (se3.inverse(A), B),
    "two swapped": swapped,
}
OFTEN = "permuted", "a row of B missing", "two swapped"
SAID = {
    "reversed": "reversed order",
    "a row of B missing": "one row",
    "a row of A missing": "one row",
    "B inverted": "one side inverted",
    "A inverted": "one side inverted",
    "permuted": "do not belong together",
}


def what_is_said(A, B, method, noise=None):
    """Text of the error, or all that the result says; empty where it says nothing."""
    try:
        result = solve(A, B, method, noise)
    except CalibError as error:
        return str(error)
    said = " ".join(result.warnings)
    if result.status != "ok":
        said += f"{result.status}: {result.message}"
    if not result.used.all():
        said += result.message
    return said


@pytest.mark.parametrize(
    ("mistake", "seeds"),
    [
        *((mistake, range(1)) for mistake in OFTEN),
        *(pytest.param(m, range(m in OFTEN, 3), marks=pytest.mark.slow) for m in MISTAKES),
    ],
)
@pytest.mark.parametrize("method", METHODS)
def test_no_method_is_silent_about_pairs_in_disorder(method, mistake, seeds):
    for seed in seeds:
        A, B = MISTAKES[mistake](*measured(seed, 12, 40.0 if seed % 2 else None))
        assert what_is_said(A, B, method), f"{method} is silent about {mistake}"


@pytest.mark.parametrize("mistake", SAID)
@pytest.mark.parametrize("pairs", [6, 12])
def test_the_mistake_is_named(mistake, pairs):
    for seed in range(2):
        for method in ("ml", "shah")[seed:]:
            A, B = MISTAKES[mistake](*measured(seed, pairs))
            said = what_is_said(A, B, method)
            assert SAID[mistake] in said, said


@pytest.mark.parametrize("seeds", [3, pytest.param(15, marks=pytest.mark.slow)])
def test_few_pairs_in_disorder_are_seldom_overlooked(seeds):
    """Of four pairs some fit by chance, one in twenty-five; never of six."""
    overlooked = {4: 0, 6: 0}
    for pairs in overlooked:
        for name in ("reversed", "B inverted", "A inverted", "rolled"):
            for seed in range(seeds):
                A, B = MISTAKES[name](*measured(100 + seed, pairs))
                overlooked[pairs] += not what_is_said(A, B, "ml")
    assert overlooked[6] == 0
    assert overlooked[4] <= max(2, 4 * seeds // 15)


@pytest.mark.parametrize("pairs", [8, 12, 20])
def test_two_swapped_pairs_are_named(pairs):
    for seed in range(2):
        A, B = swapped(*measured(seed, pairs))
        said = what_is_said(A, B, "ml")
        assert "pairs 2, 5 (counted from 1)" in said, said
        assert f"contradict the other {pairs - 2}" in said
        assert "exchanged with each other they fit" in said
        assert "ml-robust leaves such pairs out" in said
        result = solve(A, B, "ml-robust")
        assert {1, 4} <= set(np.flatnonzero(~result.used))


def test_one_gross_pair_is_named():
    A, B = measured(7, 10)
    B[3, :3, :3] = B[3, :3, :3] @ se3.rotation_exp([1.0, 0.5, -0.8])
    assert "pair 4 (counted from 1)" in what_is_said(A, B, "ml")


@pytest.mark.parametrize("pairs", [10, 20])
@pytest.mark.parametrize("method", ["ml", "shah"])
def test_one_pair_slightly_off_is_named(method, pairs):
    for seed in range(2):
        A, B = measured(seed, pairs)
        B[3, :3, 3] += [0.08, 0.0, 0.0]
        said = what_is_said(A, B, method)
        assert "pair 4 (counted from 1) is more than 4 times as far off as the median" in said


@pytest.mark.slow
@pytest.mark.parametrize("cone_deg", [None, 40.0])
@pytest.mark.parametrize("pairs", [5, 10, 30])
def test_good_pairs_raise_no_doubts(pairs, cone_deg):
    """One warning in a hundred sets at most: three in twenty are one chance in a thousand."""
    warned = 0
    for seed in range(20):
        noise = PairNoise(np.radians(0.2), 1e-3)
        result = solve(*measured(200 + seed, pairs, cone_deg, noise), noise=noise)
        assert result.status == "ok"
        # how little they tell of the scale is no doubt of the pairs
        warned += any("would go unnoticed" not in said for said in result.warnings)
    assert warned <= 2


def poses(rotation_vectors, seed=0):
    rng = np.random.default_rng(seed)
    return se3.transform(
        se3.rotation_exp([0.2, 0.1, -0.4]) @ se3.rotation_exp(rotation_vectors),
        rng.uniform(-0.5, 0.5, (len(rotation_vectors), 3)),
    )


def seen(A, seed=1):
    problems = random_problems(np.random.default_rng(seed), 1, 3)
    return se3.inverse(problems.Z[0]) @ A @ problems.X[0]


OBLIQUE = np.array([0.6, -0.48, 0.64])
ALONG = "translation of X along the common axis"
UNFIT = {
    "translations": (poses(np.zeros((8, 3))), "translation of X", "differ by translations only"),
    "identical": (
        np.tile(poses(np.zeros((1, 3))), (8, 1, 1)),
        "translation of X",
        "all poses are the same",
    ),
    "one axis": (
        poses(np.linspace(-2.0, 2.5, 8)[:, None] * [0.0, 0.0, 1.0]),
        f"{ALONG} (0, 0, 1)",
        "about the axis (0, 0, 1) of the flange; Z takes up the one",
    ),
    "oblique axis": (
        poses(np.linspace(-2.0, 2.5, 8)[:, None] * OBLIQUE),
        f"{ALONG} (0.6, -0.48, 0.64)",
        "and the rotations do not show the other",
    ),
    "two poses": (
        poses(np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.2]])[[0, 1, 0, 1, 1]]),
        ALONG,
        "about the",
    ),
}


@pytest.mark.parametrize("unfit", UNFIT)
@pytest.mark.parametrize("method", METHODS)
def test_motion_that_identifies_nothing_is_refused(method, unfit):
    """OpenCV's calibrateHandEye and calibrateRobotWorldHandEye return numbers for all of these."""
    A, parameter, reason = UNFIT[unfit]
    with pytest.raises(NotIdentifiableError) as caught:
        solve(A, seen(A), method)
    assert caught.value.parameters[0].startswith(parameter)
    assert reason in str(caught.value)
    assert not solve_batch(A[None], seen(A)[None], method).ok.any()


@pytest.mark.parametrize("on", ["A", "B", "both"])
@pytest.mark.parametrize("unfit", UNFIT)
def test_noise_does_not_make_it_identifiable(unfit, on):
    A, _, _ = UNFIT[unfit]
    rng = np.random.default_rng(2)
    for sigma_deg in (0.01, 0.1, 1.0):
        noise = PairNoise(np.radians(sigma_deg), 1e-3, on)
        with pytest.raises((NotIdentifiableError, InputError)):
            solve(*add_noise(rng, A, seen(A), noise), "ml", noise)


def test_few_pairs_whose_second_axis_may_be_noise_are_doubted():
    """Four poses about one axis but for a degree, of which noise makes a part."""
    said = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        turns = np.linspace(-1.5, 1.5, 4)[:, None] * [0.0, 0.0, 1.0]
        A = poses(turns + 0.02 * rng.normal(size=(4, 3)), seed)
        said.append(
            what_is_said(*add_noise(rng, A, seen(A), PairNoise(np.radians(0.3), 1e-3)), "ml")
        )
    assert sum("4 pairs hardly show how large the noise is" in text for text in said) >= 1


@pytest.mark.parametrize("on", ["A", "B", "both"])
def test_noise_does_not_turn_translations_into_disorder(on):
    """What noise leaves is of the size of what the poses turn, and no sign of wrong pairs."""
    A, _, _ = UNFIT["translations"]
    rng = np.random.default_rng(3)
    for sigma_deg in (0.01, 0.3, 1.0):
        measured_pairs = add_noise(rng, A, seen(A), PairNoise(np.radians(sigma_deg), 1e-3, on))
        with pytest.raises(NotIdentifiableError, match="translation of X"):
            solve(*measured_pairs)


@pytest.mark.parametrize("method", METHODS)
def test_a_batch_is_not_ok_where_a_single_problem_is_refused_or_ambiguous(method):
    A = np.stack([UNFIT[name][0][:5] for name in UNFIT] + [measured(9, 5)[0]] * 2)
    B = np.stack([seen(a) for a in A])
    B[-1] = B[-1][::-1]
    batch = solve_batch(A, B, method)
    for trial in range(len(A)):
        try:
            status = solve(A[trial], B[trial], method).status
        except CalibError:
            status = "refused"
        assert batch.ok[trial] == (status == "ok"), trial


def test_millimetres_on_one_side_are_doubted():
    A, B = measured(12, 10)
    B[:, :3, 3] *= 1e3
    assert what_is_said(A, B, "ml")


MOVES_MEANWHILE = ("target bumped", "camera bumped", "target drifts", "time offset")
"""What the order of the pairs alone tells: a single bump looks like noise of the size of it."""


def silent(seed, count):
    """What is wrong with the sets that are silently wrong."""
    return [hostile.what for hostile in hostile_sets(seed, count) if is_silently_wrong(hostile)]


@pytest.mark.slow
def test_hardly_any_mistake_is_silent():
    """Three of each kind but of what moves meanwhile; 1,000 in the next test."""
    found = silent(3, 3 * len(SPOILT))
    assert [text for text in found if not text.startswith(MOVES_MEANWHILE)] == []
    assert len(found) <= 2


@pytest.mark.slow
@pytest.mark.full
def test_of_a_thousand_hardly_any_is_silent():
    """One when this was written: a scale that is 1.4 % off, with a probability by chance of 1.01
    ten-thousandths where less than one is named.
    """
    kinds = collections.Counter(text.split(";")[0] for text in silent(0, 1000))
    assert not kinds - collections.Counter({"scale of B": 1}), kinds


def looking(seed, pairs, noise, **view):
    rng = np.random.default_rng(seed)
    problems = viewing_pairs(rng, pairs, **view)
    return add_noise(rng, problems.A[0], problems.B[0], noise)


@pytest.mark.parametrize("method", [name for name in METHODS if name != "hirsh-literal"])
def test_absurd_standard_deviations_are_not_ok(method):
    """Poses that turn by some degrees, seen by a camera that is off by a degree."""
    A, B = looking(1, 30, PairNoise(np.radians(1.0), 3e-3), tilt_deg=4.0, roll_deg=2.0)
    result = solve(A, B, method)
    assert result.status != "ok"
    if result.status == "doubtful" and not result.warnings:
        assert "do not identify X and Z by this method" in result.message
        assert "known least are rotation of" in result.message


def test_what_is_known_least_is_named():
    """Twelve poses that turn by some degrees."""
    A, B = looking(0, 12, PairNoise(np.radians(0.6), 3e-3), tilt_deg=6.0, roll_deg=3.0)
    assert "by this method: known least are rotation of" in solve(A, B).message


@pytest.mark.parametrize("method", ["ml", "ml-robust"])
def test_nor_in_a_batch(method):
    A, B = looking(1, 30, PairNoise(np.radians(1.0), 3e-3), tilt_deg=4.0, roll_deg=2.0)
    assert not solve_batch(A[None], B[None], method).ok.any()


@pytest.mark.parametrize("method", ["shah", "park-martin"])
def test_pairs_that_single_ones_decide_are_not_ok(method):
    """Nine poses turned about nearly one axis, and one that turns otherwise."""
    rng = np.random.default_rng(2)
    vectors = np.linspace(-1.0, 1.0, 10)[:, None] * [0.0, 0.0, 1.0]
    vectors += rng.normal(scale=2e-3, size=vectors.shape)
    vectors[4] = [0.8, -0.3, 0.1]
    A = se3.transform(se3.rotation_exp(vectors), rng.uniform(-0.4, 0.4, (10, 3)))
    X, Z = viewing_pairs(rng, 1).X[0], viewing_pairs(rng, 1).Z[0]
    A, B = add_noise(rng, A, se3.inverse(Z) @ A @ X, PairNoise(1e-3, 1e-3))
    result = solve(A, B, method)
    assert result.status == "doubtful"
    assert "pairs that are left out are off by" in result.message


def test_good_pairs_are_ok():
    """Twelve pairs tell the scale to half a percent: that alone is said."""
    for seed in range(6):
        result = solve(*looking(seed, 12, PairNoise(np.radians(0.1), 1e-3)))
        assert result.status == "ok", result.message
        assert all("the pairs tell the scale of B's " in text for text in result.warnings)
