"""The reference cell: how good 27 touch-ups can be, tilted up to 45 deg and rolled freely.

An independent exchange over 2,400 to 3,000 postures came to C_G 1.40e4 with the arm in front, and
18.8 where it reaches over its back as well; a grid of W, P and R at 50 deg has 4.27e4.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from calib.model import CalibrationModel, Linearisation
from posedesign.candidates import CandidatePoses, cone_candidates
from posedesign.cell import Cell
from posedesign.planning import off_target
from posedesign.planning.loop import identification_jacobian
from posedesign.selection import Selection, condition_inf, select

POSES, ORIENTATIONS, TILT = 27, 1500, np.deg2rad(45.0)
CONFIGURATIONS = {"front": 1.45e4, "all": 20.0}
"""Arm configurations, and the C_G that has to be reached in them."""


@dataclass(frozen=True)
class Candidates:
    """Postures to choose from, and what they tell."""

    pool: CandidatePoses
    model: CalibrationModel
    linear: Linearisation


@pytest.fixture(scope="module", params=CONFIGURATIONS)
def candidates(request, reference_cell) -> Candidates:
    rng = np.random.default_rng(0)
    pool = cone_candidates(reference_cell, TILT, ORIENTATIONS, rng, request.param)
    assert len(pool) >= ORIENTATIONS
    model = reference_cell.model()
    return Candidates(pool, model, pool.linearise(model))


def check_poses(cell: Cell, candidates: Candidates, found: Selection) -> None:
    """27 different poses of the cone that can be taken, on target."""
    chosen = candidates.pool.take(found.indices)
    assert len(np.unique(found.indices)) == POSES
    assert cell.checker.check(chosen.postures).feasible.all()
    names = [str(i) for i in found.indices]
    assert off_target(cell, names, chosen.postures, 1e-9) == []
    z = cell.robot.fk(chosen.postures)[:, :3, 2]
    down = cell.robot.fk(cell.base_posture)[:3, 2]
    assert np.arccos(np.clip(z @ down, -1.0, 1.0)).max() <= TILT + 1e-9


def test_condition_number(reference_cell, candidates, request):
    configurations = request.node.callspec.params["candidates"]
    found = select(identification_jacobian(candidates.linear), POSES, "C_G", starts=1, bound=False)
    check_poses(reference_cell, candidates, found)
    # from the Jacobian of the chosen postures alone
    q = candidates.pool.postures[found.indices]
    c_g = condition_inf(candidates.model.jacobian(q))
    assert c_g == pytest.approx(found.value, rel=1e-6)
    assert c_g <= CONFIGURATIONS[configurations]


def efficiency_of(white: np.ndarray, weights: np.ndarray, rows: np.ndarray, k: int) -> float:
    """D-efficiency of rows against weights (N,), by slogdet alone.

    Of the first k parameters with the others marginalised: the determinant of the Schur complement
    of the information.
    """

    def log_det(information: np.ndarray) -> float:
        whole = np.linalg.slogdet(information)[1]
        rest = np.linalg.slogdet(information[k:, k:])[1] if k < len(information) else 0.0
        return float(whole - rest)

    length = np.sqrt(np.einsum("nmp,nmp->p", white, white))
    J = white / length
    chosen = np.einsum("nmp,nmq->pq", J[rows], J[rows])
    relaxed = np.einsum("n,nmp,nmq->pq", weights, J, J, optimize=True)
    return float(np.exp((log_det(chosen) - log_det(relaxed)) / k))


@pytest.mark.parametrize("interest", [None, [0, 1, 2, 3]], ids=["all parameters", "offsets"])
def test_d_efficiency_is_proven(reference_cell, candidates, interest):
    white = candidates.linear.white_jacobian
    found = select(white, POSES, "D", interest=interest, starts=1)
    check_poses(reference_cell, candidates, found)
    assert found.efficiency >= 0.97
    assert found.relaxation is not None
    weights = found.relaxation.weights
    assert weights.sum() == pytest.approx(POSES, rel=1e-6)
    assert weights.min() >= 0.0
    assert weights.max() <= 1.0 + 1e-9
    # the best weights are at least as good as the best choice, and the proof allows for both
    k = 10 if interest is None else 4
    against_weights = efficiency_of(white, weights, found.indices, k)
    assert found.efficiency <= against_weights + 1e-6
    assert against_weights >= 0.97
