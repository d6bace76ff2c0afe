"""What must not change a certificate: units, frames, the order of the pairs, the candidate."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib import se3
from calib.robot_world import PairNoise, add_noise, random_problems
from calib.robot_world.certificate import certify

seeds = st.integers(0, 2**32 - 1)
pair_counts = st.integers(5, 12)
sides = st.sampled_from(["A", "B"])
coordinates = st.floats(-2.0, 2.0)
vectors = st.tuples(coordinates, coordinates, coordinates)
quick = settings(max_examples=12, deadline=None)


def noisy(seed, pairs, side):
    rng = np.random.default_rng(seed)
    noise = PairNoise(np.radians(0.5), 1e-3, side)
    problems = random_problems(rng, 1, pairs, 60.0)
    A, B = add_noise(rng, problems.A[0], problems.B[0], noise)
    return A, B, problems.X[0], problems.Z[0], noise


def frame(turn, shift):
    return se3.transform(se3.rotation_exp(turn), shift)


def assert_same_proof(found, reference):
    assert found.cost == pytest.approx(reference.cost, rel=1e-8)
    assert found.bound == pytest.approx(reference.bound, rel=1e-7)
    assert found.smallest_eigenvalue == pytest.approx(reference.smallest_eigenvalue, rel=1e-6)
    assert found.certified == reference.certified
    assert found.unique == reference.unique


@quick
@given(seed=seeds, pairs=pair_counts, side=sides, unit=st.sampled_from([1e3, 1e-3, 39.37]))
def test_unit_of_length_changes_nothing(seed, pairs, side, unit):
    A, B, X, Z, noise = noisy(seed, pairs, side)
    reference = certify(A, B, X, Z, noise)
    scaled = [T.copy() for T in (A, B, X, Z)]
    for T in scaled:
        T[..., :3, 3] *= unit
    found = certify(*scaled, PairNoise(noise.rotation_rad, unit * noise.translation_m, side))
    assert_same_proof(found, reference)
    np.testing.assert_allclose(found.X[:3, :3], reference.X[:3, :3], atol=1e-10)
    np.testing.assert_allclose(found.X[:3, 3] / unit, reference.X[:3, 3], atol=1e-10)
    np.testing.assert_allclose(found.Z[:3, 3] / unit, reference.Z[:3, 3], atol=1e-10)


@quick
@given(
    seed=seeds,
    pairs=pair_counts,
    turns=st.tuples(vectors, vectors, vectors),
    shifts=st.tuples(vectors, vectors, vectors),
)
def test_base_flange_and_target_change_nothing(seed, pairs, turns, shifts):
    A, B, X, Z, noise = noisy(seed, pairs, "B")
    base, flange, target = (frame(w, p) for w, p in zip(turns, shifts, strict=True))
    reference = certify(A, B, X, Z, noise)
    found = certify(
        base @ A @ flange,
        target @ B,
        se3.inverse(flange) @ X,
        base @ Z @ se3.inverse(target),
        noise,
    )
    assert_same_proof(found, reference)
    np.testing.assert_allclose(flange @ found.X, reference.X, atol=1e-9)
    np.testing.assert_allclose(se3.inverse(base) @ found.Z @ target, reference.Z, atol=1e-9)


@quick
@given(seed=seeds, pairs=pair_counts, side=sides, data=st.data())
def test_order_of_the_pairs_and_the_candidate_change_nothing(seed, pairs, side, data):
    A, B, X, Z, noise = noisy(seed, pairs, side)
    order = data.draw(st.permutations(range(pairs)))
    turn, shift = data.draw(vectors), data.draw(vectors)
    reference = certify(A, B, X, Z, noise)
    near = frame(0.1 * np.array(turn), 0.1 * np.array(shift))
    found = certify(A[order], B[order], X @ near, near @ Z, noise)
    assert_same_proof(found, reference)
    np.testing.assert_allclose(found.X, reference.X, atol=1e-10)
    np.testing.assert_allclose(found.Z, reference.Z, atol=1e-10)


@quick
@given(seed=seeds, pairs=st.integers(3, 6), side=sides, noise_deg=st.floats(0.01, 20.0))
def test_no_rotations_cost_less_than_the_bound(seed, pairs, side, noise_deg):
    rng = np.random.default_rng(seed)
    noise = PairNoise(np.radians(noise_deg), 2e-3 * noise_deg, side)
    problems = random_problems(rng, 1, pairs, 40.0)
    A, B = add_noise(rng, problems.A[0], problems.B[0], noise)
    starts = [
        (frame(rng.normal(size=3) * 2.0, np.zeros(3)), frame(rng.normal(size=3) * 2.0, np.zeros(3)))
        for _ in range(5)
    ]
    proofs = [certify(A, B, X, Z, noise) for X, Z in starts]
    least = min(proof.cost for proof in proofs)
    assert max(proof.bound for proof in proofs) <= least
    for proof in proofs:
        if proof.certified:
            assert proof.cost - least <= 2e-6 * max(least, 1.0)
