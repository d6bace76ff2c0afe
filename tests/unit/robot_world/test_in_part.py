"""Motions that do not tell all: what they tell, what not, and what is known from elsewhere."""

import numpy as np
import pytest

from calib.errors import InputError, NotIdentifiableError
from calib.robot_world import FramePrior, PairNoise, difference, solve_network
from calib.robot_world.network.prior import prior_of_axis
from calib.robot_world.noise import perturb
from calib.se3 import inverse, rotation_exp, transform

NOISE = PairNoise(2e-3, 1e-3)
COUNT = 25
DOWN = np.diag([1.0, -1.0, -1.0])


def motion_of(kind, rng):
    """Poses of the flange, tool down: of an arm of four axes, of a gantry, of a turntable."""
    place = np.array([0.5, 0.0, 0.3]) + rng.uniform(-0.3, 0.3, (COUNT, 3))
    turn = np.zeros((COUNT, 3))
    if kind != "gantry":
        turn[:, 2] = rng.uniform(-2.5, 2.5, COUNT)
    if kind == "turntable":
        place[:] = [0.5, 0.0, 0.3]
    return transform(rotation_exp(turn) @ DOWN, place)


def problem(kind, seed, noise=NOISE):
    rng = np.random.default_rng(seed)
    A = motion_of(kind, rng)
    X = transform(rotation_exp(rng.uniform(-0.6, 0.6, 3)), rng.uniform(-0.1, 0.1, 3))
    Z = transform(rotation_exp(rng.uniform(-1.0, 1.0, 3)), np.array([0.6, 0.1, 0.0]))
    B = perturb(inverse(Z) @ A @ X, rng.standard_normal((COUNT, 6)) * noise.sigma)
    return (A, B, ["camera"] * COUNT, ["tag"] * COUNT), X, Z, rng


def told_error(result, X, Z):
    """Errors of what is told over their covariance, by their number."""
    error = np.concatenate([difference(result["camera"], X), difference(result["tag"], Z)])
    unit = np.tile(np.repeat([1.0, result.size_m], 3), 2)
    error = error / unit
    error = error - result.untold.T @ np.linalg.lstsq(result.untold.T, error, rcond=None)[0]
    values, axes = np.linalg.eigh(result.covariance / np.outer(unit, unit))
    some = values > 1e-10 * values[-1]
    return float(((axes[:, some].T @ error) ** 2 / values[some]).sum() / some.sum())


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("scara", ["the place of camera along z of its flange, and as much the place of tag"]),
        ("gantry", [f"the place of camera along {axis} of its flange" for axis in "xyz"]),
        ("turntable", ["the turn of camera about z", "the place of camera along z"]),
    ],
)
def test_what_is_not_told_is_named(kind, words):
    pairs, _, _, _ = problem(kind, 1)
    with pytest.raises(NotIdentifiableError, match="camera"):
        solve_network(*pairs)
    result = solve_network(*pairs, in_part=True)
    assert not result.is_ok
    assert len(result.not_told) == len(words)
    for said, expected in zip(result.not_told, words, strict=True):
        assert said.startswith(expected)
    assert [row["told"] for row in result.rows()] == ["in part", "in part"]


@pytest.mark.parametrize("kind", ["scara", "gantry"])
def test_what_is_told_is_found_with_its_covariance(kind):
    """The turn of the camera, too: of a SCARA about its axis, of a gantry altogether."""
    errors = []
    for seed in range(20):
        pairs, X, Z, _ = problem(kind, seed)
        errors.append(told_error(solve_network(*pairs, in_part=True, noise=NOISE), X, Z))
    assert 0.7 < np.mean(errors) < 1.4


def test_exact_pairs_tell_all_but_the_height():
    pairs, X, Z, _ = problem("scara", 5, PairNoise(1e-12, 1e-12))
    result = solve_network(*pairs, in_part=True)
    np.testing.assert_allclose(result["camera"][:3, :3], X[:3, :3], atol=1e-9)
    off = difference(result["camera"], X)[3:], difference(result["tag"], Z)[3:]
    np.testing.assert_allclose(off[0][:2], 0, atol=1e-9)
    np.testing.assert_allclose(off[1][:2], 0, atol=1e-9)
    np.testing.assert_allclose(off[0][2], -off[1][2], atol=1e-9)  # the tool looks down


def test_a_height_by_rule_tells_the_rest():
    """One number of the target is enough for an arm of four axes."""
    errors = []
    for seed in range(20):
        pairs, X, Z, rng = problem("scara", seed)
        height = Z[:3, 3] + [0.2, -0.1, 5e-4 * rng.standard_normal()]  # x and y are not known
        prior = FramePrior("tag", transform(np.eye(3), height), sigma_m=[np.inf, np.inf, 5e-4])
        result = solve_network(*pairs, priors=[prior], noise=NOISE)
        assert result.is_ok
        error = np.concatenate([difference(result["camera"], X), difference(result["tag"], Z)])
        errors.append(error @ np.linalg.solve(result.covariance, error) / 12)
    assert 0.7 < np.mean(errors) < 1.4


@pytest.mark.parametrize("kind", ["scara", "gantry", "turntable"])
def test_a_drawing_of_the_mount_tells_the_rest(kind):
    errors = []
    for seed in range(20):
        pairs, X, Z, rng = problem(kind, seed)
        drawn = perturb(X, rng.standard_normal(6) * np.repeat([0.01, 0.002], 3))
        prior = FramePrior("camera", drawn, 0.002, 0.01)
        result = solve_network(*pairs, priors=[prior], noise=NOISE)
        error = np.concatenate([difference(result["camera"], X), difference(result["tag"], Z)])
        errors.append(error @ np.linalg.solve(result.covariance, error) / 12)
    assert 0.7 < np.mean(errors) < 1.4


def test_a_prior_beside_enough_pairs_weighs_by_its_sigma():
    """Against the two as independent measurements: the mean by their inverse covariances."""
    rng = np.random.default_rng(9)
    A = transform(rotation_exp(rng.uniform(-1, 1, (COUNT, 3))), rng.uniform(-0.3, 0.3, (COUNT, 3)))
    X, Z = np.eye(4), transform(np.eye(3), np.array([0.5, 0.0, 0.0]))
    B = perturb(inverse(Z) @ A @ X, rng.standard_normal((COUNT, 6)) * NOISE.sigma)
    names = ["camera"] * COUNT, ["tag"] * COUNT
    alone = solve_network(A, B, *names, noise=NOISE)
    sigma = np.sqrt(np.diag(alone.covariance_of("camera")))
    prior = FramePrior("camera", X, sigma[3:], sigma[:3])
    both = solve_network(A, B, *names, noise=NOISE, priors=[prior])
    H = np.linalg.inv(alone.covariance_of("camera"))
    root = prior.root.T @ prior.root
    expected = np.linalg.solve(H + root, H @ difference(alone["camera"], X))
    np.testing.assert_allclose(difference(both["camera"], X), expected, atol=2e-6)
    ratio = np.diag(both.covariance_of("camera")) / np.diag(np.linalg.inv(H + root))
    np.testing.assert_allclose(ratio, 1.0, rtol=0.02)


@pytest.mark.parametrize("axis", "xyz")
@pytest.mark.parametrize("direction", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0.3, -0.5, 0.7)])
def test_an_axis_has_a_direction_whatever_the_turn_about_it(axis, direction):
    prior = prior_of_axis("tag", axis, direction, 0.01)
    d = np.array(direction) / np.linalg.norm(direction)
    own = np.eye(3)["xyz".index(axis)]
    np.testing.assert_allclose(prior.T[:3, :3] @ own, d, atol=1e-12)
    turned = prior.T.copy()
    turned[:3, :3] = rotation_exp(0.7 * d) @ turned[:3, :3]
    np.testing.assert_allclose(prior.white(turned), 0, atol=1e-9)
    across = np.cross(d, [0.1, 0.9, -0.4])
    turned[:3, :3] = rotation_exp(0.01 * across / np.linalg.norm(across)) @ prior.T[:3, :3]
    assert np.linalg.norm(prior.white(turned)) == pytest.approx(1.0)


def test_priors_are_checked():
    pairs, X, _, _ = problem("scara", 2)
    with pytest.raises(InputError, match="no frame lens"):
        solve_network(*pairs, priors=[FramePrior("lens", X, 1e-3, 1e-3)])
    with pytest.raises(InputError, match="standard deviations above 0"):
        FramePrior("camera", X, 0.0, 1e-3)
    with pytest.raises(InputError, match="has no length"):
        prior_of_axis("tag", "z", (0, 0, 0), 0.01)
