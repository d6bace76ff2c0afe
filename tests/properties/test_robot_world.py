"""What must not change X and Z: order of the pairs, frames, units, signs."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib import se3
from calib.robot_world import METHODS, PairNoise, PairSets, add_noise, random_problems, solve_batch
from calib.robot_world.methods.registry import CHANGES

SOUND = [name for name in METHODS if name != "hirsh-literal"]
ROUNDING = 1e-9
SEEN = 1e-6
"""What an answer changes by where it does change, in the fixed example."""

seeds = st.integers(0, 2**32 - 1)
pair_counts = st.integers(4, 12)
coordinates = st.floats(-1.0, 1.0)
vectors = st.tuples(coordinates, coordinates, coordinates)
quick = settings(max_examples=3, deadline=None)


@cache
def estimated(method):
    """Of a fixed example."""
    return METHODS[method].estimate(PairSets(*noisy(1, 8)))


def noisy(seed, pairs, trials=4):
    rng = np.random.default_rng(seed)
    problems = random_problems(rng, trials, pairs)
    return add_noise(rng, problems.A, problems.B, PairNoise(np.radians(0.3), 1e-3, "both"))


def assert_same(found, expected, use):
    """The same X and Z, in the trials that identify them well."""
    np.testing.assert_allclose(found.X[use], expected[0][use], atol=ROUNDING)
    np.testing.assert_allclose(found.Z[use], expected[1][use], atol=ROUNDING)


@pytest.mark.parametrize("method", SOUND)
@quick
@given(seed=seeds, pairs=pair_counts, data=st.data())
def test_order_of_the_pairs_changes_nothing(method, seed, pairs, data):
    A, B = noisy(seed, pairs)
    order = data.draw(st.permutations(range(pairs)))
    reference = solve_batch(A, B, method)
    found = solve_batch(A[:, order], B[:, order], method)
    assert_same(found, (reference.X, reference.Z), reference.ok)


FRAMES = ("base", "flange", "target", "camera")


def written_otherwise(A, B, changes, turns, shifts, per_metre):
    """A and B after some of the changes, and how X and Z are read back from the answer.

    The frames, new_old for base and target and old_new for flange and camera, are turned by
    ``turns`` and shifted by ``shifts`` as far as the changes say.
    """
    base, flange, target, camera = (
        se3.transform(
            se3.rotation_exp(turn) if f"{frame} axes" in changes else np.eye(3),
            shift if f"{frame} origin" in changes else np.zeros(3),
        )
        for frame, turn, shift in zip(FRAMES, turns, shifts, strict=True)
    )
    unit = per_metre if "unit" in changes else 1.0

    def back(X, Z):
        X, Z = in_unit(X, 1.0 / unit), in_unit(Z, 1.0 / unit)
        return flange @ X @ se3.inverse(camera), se3.inverse(base) @ Z @ target

    return in_unit(base @ A @ flange, unit), in_unit(target @ B @ camera, unit), back


def in_unit(T, per_metre):
    scaled = T.copy()
    scaled[..., :3, 3] *= per_metre
    return scaled


@pytest.mark.parametrize("method", METHODS)
@quick
@given(
    seed=seeds,
    pairs=pair_counts,
    turns=st.tuples(vectors, vectors, vectors, vectors),
    shifts=st.tuples(vectors, vectors, vectors, vectors),
    per_metre=st.sampled_from([1e3, 39.37, 0.01]),
)
def test_changes_that_a_method_is_invariant_to_change_nothing(
    method, seed, pairs, turns, shifts, per_metre
):
    A, B = noisy(seed, pairs)
    reference = solve_batch(A, B, method)
    changes = METHODS[method].invariant_to
    A, B, back = written_otherwise(A, B, changes, 3.0 * np.array(turns), shifts, per_metre)
    found = METHODS[method].estimate(PairSets(A, B))
    X, Z = back(found.X, found.Z)
    use = reference.ok
    np.testing.assert_allclose(X[use], reference.X[use], atol=ROUNDING)
    np.testing.assert_allclose(Z[use], reference.Z[use], atol=ROUNDING)


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("method", METHODS)
def test_each_change_is_seen_by_the_methods_that_are_not_invariant_to_it(method, change):
    (A, B), reference = noisy(1, 8), estimated(method)
    turns, shifts = [[1.2, -0.7, 0.9]] * 4, [[0.5, -0.3, 0.8]] * 4
    A, B, back = written_otherwise(A, B, {change}, turns, shifts, 1e3)
    found = METHODS[method].estimate(PairSets(A, B))
    X, Z = back(found.X, found.Z)
    moved = max(np.abs(X - reference.X).max(), np.abs(Z - reference.Z).max())
    if change in METHODS[method].invariant_to:
        assert moved < ROUNDING
    else:
        assert moved > SEEN


def test_no_method_is_invariant_to_a_change_that_does_not_exist():
    assert set().union(*(method.invariant_to for method in METHODS.values())) <= set(CHANGES)


@pytest.mark.parametrize("method", SOUND)
@quick
@given(seed=seeds, pairs=pair_counts, data=st.data())
def test_signs_of_the_quaternions_change_nothing(method, seed, pairs, data):
    A, B = noisy(seed, pairs)
    reference = solve_batch(A, B, method)
    flips = data.draw(st.lists(st.sampled_from([1.0, -1.0]), min_size=pairs, max_size=pairs))

    def with_other_signs(rotation):
        quaternion = plain(rotation)
        if quaternion.ndim == 3 and quaternion.shape[1] == pairs:
            quaternion = quaternion * np.array(flips)[:, None]
        return quaternion

    plain = se3.quaternion_from_rotation
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(se3, "quaternion_from_rotation", with_other_signs)
        found = solve_batch(A, B, method)
    assert_same(found, (reference.X, reference.Z), reference.ok)
