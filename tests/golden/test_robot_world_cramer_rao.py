"""Errors of the likeliest X and Z against the Cramér-Rao bound, which is worked out here.

The bound is that of the measurements as functions of X and Z, and of the true A where A and B are
both measured, by central differences: nothing of the method's own derivatives is in it.
"""

import numpy as np
import pytest

from calib import se3
from calib.robot_world import PairNoise, add_noise, difference, random_problems, solve, solve_batch
from calib.robot_world.noise import perturb
from tests.marks import rest_in_full

BLOCKS = {
    "X rotation": slice(0, 3),
    "X translation": slice(3, 6),
    "Z rotation": slice(6, 9),
    "Z translation": slice(9, 12),
}
STEP = 1e-6
NOISE = {"rotation_rad": np.radians(0.5), "translation_m": 1e-3}
LARGEST = 1.05
"""Error over the bound, root mean square: what the method must keep to."""


def derivative(function, count, reference):
    """Central differences ``(T, N, 6, count)`` of transforms by errors about the truth."""
    columns = []
    for step in STEP * np.eye(count):
        ends = (difference(function(sign * step), reference) for sign in (1.0, -1.0))
        columns.append(np.subtract(*ends) / (2.0 * STEP))
    return np.stack(columns, axis=-1)


def cramer_rao(problems, noise):
    """Bounds ``(T, 12, 12)`` on the covariance of X and Z."""
    A, B, X, Z = problems.A, problems.B, problems.X, problems.Z
    weight = np.diag(noise.sigma**-2.0)

    def moved(step):
        return perturb(X, step[:6])[:, None], perturb(Z, step[6:])[:, None]

    def implied_A(step):
        x, z = moved(step)
        return z @ B @ se3.inverse(x)

    def implied_B(step):
        x, z = moved(step)
        return se3.inverse(z) @ A @ x

    if noise.on == "A":
        J = derivative(implied_A, 12, A)
        return np.linalg.inv(np.einsum("tnki,kl,tnlj->tij", J, weight, J))
    J = derivative(implied_B, 12, B)
    information = np.swapaxes(J, -1, -2) @ weight @ J
    if noise.on == "both":
        # each true A is unknown, too: six more parameters a pair, eliminated here
        G = derivative(lambda step: se3.inverse(Z)[:, None] @ perturb(A, step) @ X[:, None], 6, B)
        own = weight + np.swapaxes(G, -1, -2) @ weight @ G
        mixed = np.swapaxes(G, -1, -2) @ weight @ J
        information = information - np.swapaxes(mixed, -1, -2) @ np.linalg.solve(own, mixed)
    return np.linalg.inv(information.sum(axis=1))


def errors_over_bound(method, pairs, cone_deg, on, problems, draws, *, given=True):
    """Error over the bound in each block, and the standard deviation that chance gives it."""
    rng = np.random.default_rng([pairs, draws])
    noise = PairNoise(**NOISE, on=on)
    truth = random_problems(rng, problems, pairs, cone_deg)
    bound = cramer_rao(truth, noise)
    A, B, X, Z = (np.repeat(T, draws, axis=0) for T in (truth.A, truth.B, truth.X, truth.Z))
    found = solve_batch(*add_noise(rng, A, B, noise), method, noise if given else None)
    # now and then an ill-conditioned set of few poses creeps: it counts all the same
    assert found.converged.mean() > 0.999
    error = np.concatenate([difference(found.X, X), difference(found.Z, Z)], axis=-1)
    # sets that are refused, since the noise hides their motion, have no error to speak of
    seen = found.degenerate.reshape(problems, draws).mean(axis=1) < 0.05
    assert seen.mean() >= 0.98
    bound, error = bound[seen], error[np.repeat(seen, draws)]
    out = {}
    for name, block in BLOCKS.items():
        own = bound[:, block, block]
        least = np.trace(own, axis1=1, axis2=2)
        # each problem in units of its own bound, so that no ill-conditioned one decides
        square = (error[:, block] ** 2).sum(axis=1) / np.repeat(least, draws)
        # the variance of a sum of squares of normal numbers is 2 tr C²
        spread = 2.0 * (own**2).sum(axis=(1, 2)) / least**2
        chance = 0.5 * np.sqrt(spread.mean() / len(error))
        out[name] = np.sqrt(square.mean()), chance
    return out


def assert_reaches(ratios, deviations):
    """At most 5 % above the bound, and no farther below it than chance allows."""
    for name, (ratio, chance) in ratios.items():
        assert deviations * chance < LARGEST - 1.0, f"{name}: too few trials for a test of 5 %"
        assert 1.0 - deviations * chance < ratio < LARGEST, f"{name}: {ratio:.3f} ± {chance:.3f}"


@pytest.mark.slow
@pytest.mark.parametrize("on", ["B", "A", "both"])
@pytest.mark.parametrize("pairs", [5, 20])
def test_error_reaches_the_bound(pairs, on):
    """Chance is 1.3 % at most with 2,000 trials: at the bound, 5 % is 3.5 deviations or more."""
    assert_reaches(errors_over_bound("ml", pairs, None, on, 100, 20), 3.5)


@pytest.mark.slow
@pytest.mark.parametrize("cone_deg", rest_in_full([None, 40.0], (40.0,)))
@pytest.mark.parametrize("on", ["B", "A", "both"])
@pytest.mark.parametrize("pairs", rest_in_full([5, 10, 20, 50], (10,)))
def test_error_reaches_the_bound_closely(pairs, on, cone_deg):
    """4,000 trials: chance is 1 % at most, 5 % is five deviations."""
    assert_reaches(errors_over_bound("ml", pairs, cone_deg, on, 100, 40), 4.5)


@pytest.mark.slow
@pytest.mark.parametrize("pairs", rest_in_full([10, 20], (10,)))
def test_estimated_noise_costs_next_to_nothing(pairs):
    """The two sizes of the noise weigh rotations against translations: a rough ratio will do."""
    assert_reaches(errors_over_bound("ml", pairs, None, "B", 100, 40, given=False), 4.5)


def test_methods_that_do_not_weigh_by_the_noise_miss_the_bound():
    """The bound is no looser than it should be: others are seen to be farther from it."""
    ratios = errors_over_bound("shah", 20, None, "B", 100, 20)
    assert ratios["X translation"][0] > 1.2
    assert ratios["Z rotation"][0] > 2.0
    assert ratios["Z translation"][0] > 2.0


@pytest.mark.slow
def test_noise_that_the_residuals_show_reaches_the_bound():
    """Noise of A in a narrow cone, of unknown size and side: taken for B's it costs twice that."""
    rng = np.random.default_rng(3)
    trials = 60
    noise = PairNoise(**NOISE, on="A")
    problems = random_problems(rng, trials, 50, 15.0)
    bound = cramer_rao(problems, noise)
    A, B = add_noise(rng, problems.A, problems.B, noise)
    squares = np.zeros((2, trials, len(BLOCKS)))
    for t in range(trials):
        for k, asked in enumerate(("B", None)):
            found = solve(A[t], B[t], "ml", asked)
            error = [difference(found.X, problems.X[t]), difference(found.Z, problems.Z[t])]
            error = np.concatenate(error)
            squares[k, t] = [
                (error[part] ** 2).sum() / np.trace(bound[t, part, part])
                for part in BLOCKS.values()
            ]
    taken, shown = np.sqrt(squares.mean(axis=1))
    assert (taken[1:] > 2.0).all()
    # sampling of as many trials with three numbers each, at three sigma
    assert (shown < 1.0 + 3.0 / np.sqrt(2.0 * trials)).all()
