"""What is predicted of X and Z before measuring is how the likeliest X and Z scatter."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from calib import se3
from calib.robot_world import (
    PairCovariances,
    PairNoise,
    add_noise,
    design,
    difference,
    random_problems,
    residuals,
)
from calib.robot_world.noise import perturb
from posedesign.cell import Cell, cell_template
from posedesign.cell.file import parse_config
from posedesign.planning.optimal import plan_fewest
from posedesign.simulation import SimulatedRobot

TRIALS = 150
STEP = 1e-6
FIVE_SIGMA = 5.0


def likeliest(rows, X, Z):
    """X and Z ``(T, 4, 4)`` that make the sums of squares of whitened rows least.

    Gauss-Newton with central differences; ``rows(X, Z)`` gives ``(T, M)``.
    """
    X, Z = (np.broadcast_to(T, (TRIALS, 4, 4)) for T in (X, Z))
    for _ in range(4):
        steps = STEP * np.eye(12)
        moved = [
            rows(perturb(X, s[:6]), perturb(Z, s[6:]))
            - rows(perturb(X, -s[:6]), perturb(Z, -s[6:]))
            for s in steps
        ]
        J = np.stack(moved, axis=-1) / (2 * STEP)
        gradient = np.einsum("tmi,tm->ti", J, rows(X, Z))
        change = -np.linalg.solve(np.swapaxes(J, 1, 2) @ J, gradient[..., None])[..., 0]
        X, Z = perturb(X, change[:, :6]), perturb(Z, change[:, 6:])
    assert np.abs(change).max() < 1e-8
    return X, Z


def check_scatter(errors, covariance):
    """Errors ``(T, 12)`` have this covariance, axis by axis and as a whole."""
    share = errors.std(axis=0, ddof=1) / np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(share, 1.0, atol=FIVE_SIGMA / np.sqrt(2 * TRIALS))
    chi2 = np.einsum("ti,ti->t", errors, np.linalg.solve(covariance, errors.T).T)
    assert chi2.mean() == pytest.approx(12, abs=FIVE_SIGMA * np.sqrt(24 / TRIALS))


@pytest.mark.parametrize("on", ["A", "B", "both"])
def test_the_likeliest_X_and_Z_scatter_as_predicted(on):
    rng = np.random.default_rng(11)
    found = random_problems(rng, 1, 8, 40.0)
    true_A, true_B, X, Z = found.A[0], found.B[0], found.X[0], found.Z[0]
    noise = PairNoise(5e-4, 3e-4, on)
    A, B = (np.broadcast_to(T, (TRIALS, *T.shape)) for T in (true_A, true_B))
    A, B = add_noise(rng, A, B, noise)
    roots = inverse_roots(true_A, true_B, X, Z, noise)

    def rows(T_x, T_z):
        e = residuals(A, B, T_x, T_z)
        return np.einsum("nij,tnj->tni", roots, e).reshape(TRIALS, -1)

    X_found, Z_found = likeliest(rows, X, Z)
    errors = np.concatenate([difference(X_found, X), difference(Z_found, Z)], axis=-1)
    check_scatter(errors, design.covariance(design.blocks(true_A, X, Z, noise)))


def inverse_roots(A, B, X, Z, noise):
    """Whitening ``(N, 6, 6)`` of residuals, from draws alone: no formula of the library enters."""
    rng = np.random.default_rng(0)
    draws = (20_000, *A.shape)
    far = add_noise(rng, np.broadcast_to(A, draws), np.broadcast_to(B, draws), noise)
    e = residuals(*far, X, Z)
    covariance = np.einsum("tni,tnj->nij", e, e) / len(e)
    return np.linalg.inv(np.linalg.cholesky(covariance))


def hand_eye_cell(**measurement) -> Cell:
    """The reference cell with a camera, its robot without errors."""
    raw = tomllib.loads(cell_template(surroundings=False))
    raw["measurement"]["kind"] = "camera-pose"
    raw["measurement"] |= measurement
    raw["truth"] |= {"zero_offsets_deg": [0.0] * 6, "deflection": False}
    return Cell.from_config(parse_config(raw, Path("cell.toml")), Path("cell.toml"))


@pytest.fixture(scope="module")
def planned():
    cell = hand_eye_cell()
    return cell, plan_fewest(cell, 5e-5, np.deg2rad(0.02))


@pytest.mark.slow
def test_the_poses_chosen_reach_what_was_wanted(planned):
    """Pairs of a simulated camera, solved for the likeliest X and Z."""
    cell, chosen = planned
    q = chosen.poses.kept
    assert 5 <= len(q) <= 20
    robot = SimulatedRobot.of(cell)
    rng = np.random.default_rng(12)
    A, B = robot.camera_poses(np.broadcast_to(q, (TRIALS, *q.shape)), rng)
    seen, sigma = se3.inverse(B), np.roll(cell.measurement.sigma, 3)
    X, Z = robot.T_tip_camera, robot.T_base_target

    def rows(T_x, T_z):
        predicted = se3.inverse(A @ T_x[:, None]) @ T_z[:, None]
        return (difference(seen, predicted) / sigma).reshape(TRIALS, -1)

    X_found, Z_found = likeliest(rows, X, Z)
    errors = np.concatenate([difference(X_found, X), difference(Z_found, Z)], axis=-1)
    spread = errors.std(axis=0, ddof=1)
    wanted = np.tile([np.deg2rad(0.02)] * 3 + [5e-5] * 3, 2)
    assert (spread < wanted * (1 + FIVE_SIGMA / np.sqrt(2 * TRIALS))).all()
    # and what decides is no better than it has to be
    assert (spread / wanted).max() > 0.9 - FIVE_SIGMA / np.sqrt(2 * TRIALS)
    lever = np.tile(-np.eye(6), (len(q), 1, 1))
    lever[:, 3:, :3] = -se3.skew(se3.inverse(design.planned_B(A[0], X, Z))[:, :3, 3])
    of_B = lever @ np.diag(sigma**2) @ np.swapaxes(lever, 1, 2)
    noise = PairCovariances(B=of_B, axes="from")
    check_scatter(errors, design.covariance(design.blocks(A[0], X, Z, noise)))


@pytest.mark.slow
def test_what_the_plan_predicts_is_what_the_pairs_predict(planned):
    """The model of the cell and the equation of the pairs are two roads to the same numbers."""
    cell, chosen = planned
    A = cell.robot.fk(chosen.poses.kept)
    turn, shift = cell.measurement.sigma[3], cell.measurement.sigma[0]
    # B⁻¹ carries the noise: the equation read backwards
    noise = PairNoise(float(turn), float(shift), "B")
    blocks = design.blocks(se3.inverse(A), cell.T_base_target, cell.T_tip_camera, noise)
    covariance = design.covariance(blocks)
    places = np.sqrt(np.diag(covariance))[[9, 10, 11, 3, 4, 5]]
    model = chosen.model
    lengths = [k for k, unit in enumerate(model.units) if unit == "m"]
    np.testing.assert_allclose(chosen.selection.sigma[lengths], places, rtol=1e-6)


@pytest.mark.slow
def test_fewer_poses_do_where_they_turn_farther():
    wide, narrow = hand_eye_cell(), hand_eye_cell()
    variations = {"largest_deg": (20.0, 20.0, 20.0)}
    section = narrow.config.variations.model_copy(update=variations)
    config = narrow.config.model_copy(update={"variations": section})
    narrow = Cell.from_config(config, Path("cell.toml"))
    counts = [plan_fewest(cell, 8e-5).selection.count for cell in (wide, narrow)]
    assert 2 * counts[0] < counts[1]


@pytest.mark.slow
def test_the_noise_of_a_camera_may_differ_from_axis_to_axis():
    """Three times the depth noise takes more poses, and is what [[noise]] says."""
    raw = tomllib.loads(cell_template(surroundings=False))
    raw["measurement"]["kind"] = "camera-pose"
    raw["noise"] = [
        {"kind": "camera-pose", "three_sigma_mm": [0.3, 0.3, 0.9], "three_sigma_deg": 0.06}
    ]
    deep = Cell.from_config(parse_config(raw, Path("cell.toml")), Path("cell.toml"))
    np.testing.assert_allclose(deep.measurement.sigma[:3], [1e-4, 1e-4, 3e-4])
    assert (
        plan_fewest(deep, 8e-5).selection.count > plan_fewest(hand_eye_cell(), 8e-5).selection.count
    )
