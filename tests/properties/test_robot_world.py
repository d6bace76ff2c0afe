"""What must not change X and Z: order of the pairs, frames, units, signs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib import se3
from calib.robot_world import METHODS, PairNoise, PairSets, add_noise, random_problems, solve_batch

SOUND = [name for name in METHODS if name != "hirsh-literal"]
ANY_ROTATION = ["li-kronecker", "li-kronecker-literal", "li-dual-quaternion", "zhuang", "hirsh"]
"""Methods whose answer turns with the axes of any frame."""
ANY_ORIGIN = ["li-kronecker", "zhuang", "hirsh"]
"""Methods whose answer moves with the origins of base, flange and target."""
ROUNDING = 1e-9

seeds = st.integers(0, 2**32 - 1)
pair_counts = st.integers(4, 12)
coordinates = st.floats(-1.0, 1.0)
vectors = st.tuples(coordinates, coordinates, coordinates)
quick = settings(max_examples=15, deadline=None)


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


def change_frames(A, B, base, flange, target, camera):
    """A and B seen from other frames: new_old for base and target, old_new for flange, camera."""
    return base @ A @ flange, target @ B @ camera


def expected_after(found, base, flange, target, camera):
    return se3.inverse(flange) @ found.X @ camera, base @ found.Z @ se3.inverse(target)


@pytest.mark.parametrize("method", ANY_ROTATION)
@quick
@given(seed=seeds, pairs=pair_counts, turns=st.tuples(vectors, vectors, vectors, vectors))
def test_axes_of_the_frames_change_nothing(method, seed, pairs, turns):
    A, B = noisy(seed, pairs)
    reference = solve_batch(A, B, method)
    frames = [se3.transform(se3.rotation_exp(3.0 * np.array(turn)), np.zeros(3)) for turn in turns]
    found = solve_batch(*change_frames(A, B, *frames), method)
    assert_same(found, expected_after(reference, *frames), reference.ok)


@pytest.mark.parametrize("method", ANY_ORIGIN)
@quick
@given(seed=seeds, pairs=pair_counts, shifts=st.tuples(vectors, vectors, vectors))
def test_origins_of_base_flange_and_target_change_nothing(method, seed, pairs, shifts):
    A, B = noisy(seed, pairs)
    reference = solve_batch(A, B, method)
    frames = [se3.transform(np.eye(3), shift) for shift in (*shifts, (0.0, 0.0, 0.0))]
    found = solve_batch(*change_frames(A, B, *frames), method)
    assert_same(found, expected_after(reference, *frames), reference.ok)


@pytest.mark.parametrize("method", ANY_ORIGIN)
@quick
@given(seed=seeds, pairs=pair_counts, per_metre=st.sampled_from([1e3, 39.37, 0.01]))
def test_unit_of_length_changes_nothing(method, seed, pairs, per_metre):
    A, B = noisy(seed, pairs)
    reference = solve_batch(A, B, method)
    scaled = [T.copy() for T in (A, B)]
    for T in scaled:
        T[..., :3, 3] *= per_metre
    found = METHODS[method].estimate(PairSets(*scaled))
    for estimate, expected in ((found.X, reference.X), (found.Z, reference.Z)):
        estimate[..., :3, 3] /= per_metre
        use = reference.ok
        np.testing.assert_allclose(estimate[use], expected[use], atol=ROUNDING)


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


@pytest.mark.parametrize("method", SOUND)
@quick
@given(seed=seeds, pairs=st.integers(3, 30), cone_deg=st.sampled_from([None, 40.0, 15.0]))
def test_exact_without_noise(method, seed, pairs, cone_deg):
    problems = random_problems(np.random.default_rng(seed), 5, pairs, cone_deg)
    found = solve_batch(problems.A, problems.B, method)
    np.testing.assert_allclose(found.X[found.ok], problems.X[found.ok], atol=1e-8)
    np.testing.assert_allclose(found.Z[found.ok], problems.Z[found.ok], atol=1e-8)
