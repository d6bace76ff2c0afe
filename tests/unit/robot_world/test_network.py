"""Several cameras, targets and arms in one estimate, against the truth and another optimiser."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import least_squares

from calib.errors import InputError, NotIdentifiableError
from calib.robot_world import PairNoise, difference, solve, solve_network
from calib.robot_world.noise import perturb
from calib.se3 import inverse, rotation_exp, transform

NOISE = PairNoise(2e-3, 1e-3)


@dataclass
class Scene:
    """Pairs of a network, and the true frames by name."""

    A: np.ndarray
    B: np.ndarray
    on_flange: list[str]
    around: list[str]
    arms: list[str]
    truth: dict[str, np.ndarray]

    @property
    def pairs(self):
        return self.A, self.B, self.on_flange, self.around, self.arms

    def only(self, kept):
        """The scene with some of the pairs."""
        names = (list(np.array(one)[kept]) for one in (self.on_flange, self.around, self.arms))
        return Scene(self.A[kept], self.B[kept], *names, self.truth)


def drawn(rng, count, turn, far):
    return transform(
        rotation_exp(rng.uniform(-turn, turn, (count, 3))), rng.uniform(-far, far, (count, 3))
    )


def scene_of(seed, *, cameras=3, targets=3, arms=2, each=15, noise=NOISE):
    """Cameras on the flanges of arms in turn; all see the first target, and some of the others."""
    rng = np.random.default_rng(seed)
    X, Z, W = drawn(rng, cameras, 1.5, 0.2), drawn(rng, targets, 1.5, 1.5), drawn(rng, arms, 1.5, 2)
    W[0] = np.eye(4)
    parts = []
    for c in range(cameras):
        j = c % arms
        for t in range(targets):
            if t and rng.random() > 0.6:
                continue
            A = drawn(rng, each, 1.0, 0.6)
            true = inverse(inverse(W[j]) @ Z[t]) @ A @ X[c]
            B = perturb(true, rng.standard_normal((each, 6)) * noise.sigma)
            parts.append((A, B, [f"camera {c}"] * each, [f"tag {t}"] * each, [f"arm {j}"] * each))
    A, B = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    names = [[name for part in parts for name in part[k]] for k in (2, 3, 4)]
    truth = {f"camera {c}": T for c, T in enumerate(X)} | {f"tag {t}": T for t, T in enumerate(Z)}
    return Scene(A, B, *names, truth | {f"arm {j}": T for j, T in enumerate(W) if j})


def off(result, truth):
    """Error of each frame over its covariance, a sixth of chi²."""
    found = []
    for name in result.names:
        error = difference(result[name], truth[name])
        found.append(error @ np.linalg.solve(result.covariance_of(name), error) / 6)
    return np.array(found)


def test_exact_pairs_give_the_truth():
    scene = scene_of(3, noise=PairNoise(1e-12, 1e-12))
    result = solve_network(*scene.pairs)
    assert result.is_ok
    for name in result.names:
        np.testing.assert_allclose(result[name], scene.truth[name], atol=1e-9)


def test_two_frames_are_those_of_the_single_solver():
    """The same likelihood, so the same optimum and covariance, for noise on either side."""
    scene = scene_of(5, cameras=1, targets=1, arms=1)
    for noise in (NOISE, PairNoise(2e-3, 1e-3, on="A")):
        one = solve(scene.A, scene.B, "ml", noise)
        result = solve_network(*scene.pairs, noise=noise, leave_out=False)
        np.testing.assert_allclose(result["camera 0"], one.X, atol=1e-7)
        np.testing.assert_allclose(result["tag 0"], one.Z, atol=1e-7)
        assert result.chi2 == pytest.approx(one.chi2, rel=1e-6)
        covariance = np.block(
            [
                [result.covariance[:6, :6], result.covariance[:6, 6:12]],
                [result.covariance[6:12, :6], result.covariance[6:12, 6:12]],
            ]
        )
        fitted = solve(scene.A, scene.B, "ml", noise).covariance
        ratio = np.sqrt(np.diag(covariance) / np.diag(fitted))
        assert np.ptp(ratio) < 1e-4  # the single solver widens by a misfit of its own
    estimated = solve(scene.A, scene.B, "ml", "B")
    result = solve_network(*scene.pairs, leave_out=False)
    np.testing.assert_allclose(result["camera 0"], estimated.X, atol=1e-6)


def test_the_optimum_is_that_of_another_optimiser():
    """By scipy, from the truth, over all frames with the base of the second arm among them."""
    scene = scene_of(7, each=8)
    names = list(scene.truth)

    def residuals(x):
        T = {n: perturb(scene.truth[n], x[6 * i : 6 * i + 6]) for i, n in enumerate(names)}
        base = [T.get(arm, np.eye(4)) for arm in scene.arms]
        X = np.stack([T[name] for name in scene.on_flange])
        Z = np.stack([T[name] for name in scene.around])
        true = inverse(Z) @ np.stack(base) @ scene.A @ X
        return (difference(scene.B, true) / NOISE.sigma).ravel()

    found = least_squares(residuals, np.zeros(6 * len(names)), xtol=1e-14, ftol=1e-14)
    result = solve_network(*scene.pairs, noise=NOISE, leave_out=False)
    assert result.chi2 == pytest.approx(2 * found.cost, rel=1e-8)
    for i, name in enumerate(names):
        expected = perturb(scene.truth[name], found.x[6 * i : 6 * i + 6])
        np.testing.assert_allclose(result[name], expected, atol=1e-6)
    J = found.jac
    at = [6 * names.index(name) + k for name in result.names for k in range(6)]
    sigma = np.sqrt(np.diag(np.linalg.inv(J.T @ J)))[at]
    np.testing.assert_allclose(np.sqrt(np.diag(result.covariance)), sigma, rtol=0.02)


@pytest.mark.slow
def test_the_covariance_is_that_of_the_errors():
    """60 networks: the mean of chi² over its freedom, with the noise given and estimated."""
    given, estimated = [], []
    for seed in range(60):
        scene = scene_of(seed)
        given += list(off(solve_network(*scene.pairs, noise=NOISE), scene.truth))
        estimated += list(off(solve_network(*scene.pairs), scene.truth))
    assert 0.85 < np.mean(given) < 1.2
    assert 0.85 < np.mean(estimated) < 1.25


def test_gross_errors_take_no_part():
    scene = scene_of(11)
    rng = np.random.default_rng(12)
    bad = rng.choice(len(scene.A), 10, replace=False)
    scene.B[bad] = perturb(scene.B[bad], 0.2 * rng.standard_normal((10, 6)))
    result = solve_network(*scene.pairs)
    assert not result.used[bad].any()
    assert result.used.sum() >= len(scene.A) - 12
    assert off(result, scene.truth).max() < 4


def test_an_edge_with_a_noise_of_its_own_has_it():
    scene = scene_of(13, arms=1, targets=2, each=40)
    own = np.array(scene.on_flange) == "camera 1"
    rng = np.random.default_rng(14)
    scene.B[own] = perturb(scene.B[own], rng.standard_normal((own.sum(), 6)) * 5 * NOISE.sigma)
    result = solve_network(*scene.pairs)
    edge = result.network.edges[np.flatnonzero(own)[0]]
    expected = np.hypot(1, 5) * np.array([2e-3, 1e-3])
    np.testing.assert_allclose(result.sigma[edge], expected, rtol=0.25)


def test_what_was_moved_between_two_cameras_is_named():
    scene = scene_of(15, arms=1)
    own = (np.array(scene.on_flange) == "camera 1") & (np.array(scene.around) == "tag 0")
    assert len(set(zip(scene.on_flange, scene.around, strict=True))) > 4
    assert not solve_network(*scene.pairs).findings
    scene.B[own] = transform(np.eye(3), np.array([-0.006, 0, 0])) @ scene.B[own]
    (found,) = solve_network(*scene.pairs).findings
    assert found.text.startswith("tag 0 seems to stand elsewhere in its pairs with camera 1")


def test_arms_that_share_nothing_have_bases_of_their_own():
    scene = scene_of(17, cameras=2, targets=1)
    apart = [f"{name} of {arm}" for name, arm in zip(scene.around, scene.arms, strict=True)]
    result = solve_network(scene.A, scene.B, scene.on_flange, apart, scene.arms)
    assert set(result.names) == {"camera 0", "camera 1", "tag 0 of arm 0", "tag 0 of arm 1"}
    assert result.parent_of("tag 0 of arm 0") == "base of arm 0"
    assert result.parent_of("tag 0 of arm 1") == "base of arm 1"


def test_a_frame_that_turns_about_one_axis_is_named():
    scene = scene_of(19, arms=1)
    own = np.flatnonzero(np.array(scene.on_flange) == "camera 2")
    kept = np.setdiff1d(np.arange(len(scene.A)), own[1:])  # one pair of the third camera
    few = scene.only(kept)
    assert solve_network(*few.pairs).names  # of a target that others place: one pair is enough
    alone = few.around.copy()
    alone[few.on_flange.index("camera 2")] = "tag 9"
    with pytest.raises(NotIdentifiableError, match=r"camera 2|tag 9"):
        solve_network(few.A, few.B, few.on_flange, alone, few.arms)


def test_names_are_checked():
    scene = scene_of(21, arms=1)
    with pytest.raises(InputError, match="names in around"):
        solve_network(scene.A, scene.B, scene.on_flange, scene.around[:-1])
    with pytest.raises(InputError, match="on a flange in some pairs"):
        solve_network(scene.A, scene.B, scene.on_flange, scene.on_flange)


def test_poses_that_come_back_make_it_no_surer():
    """The same poses of the arm, each off by the same in all its pairs."""
    rng = np.random.default_rng(23)
    scene = scene_of(23, cameras=1, targets=1, arms=1, each=20)
    A = np.tile(scene.A, (4, 1, 1))
    true = inverse(scene.truth["tag 0"]) @ scene.A @ scene.truth["camera 0"]
    once = perturb(true, rng.standard_normal((20, 6)) * NOISE.sigma)
    B = perturb(np.tile(once, (4, 1, 1)), rng.standard_normal((80, 6)) * 0.1 * NOISE.sigma)
    names = ["camera 0"] * 80, ["tag 0"] * 80
    again, alone = (
        solve_network(*pairs).sigma_of("camera 0")
        for pairs in ((A, B, *names), (scene.A, once, *(name[:20] for name in names)))
    )
    assert again[1] == pytest.approx(alone[1], rel=0.25)
