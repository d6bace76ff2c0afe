"""D-optimal choice of poses: this project and figaroh on the same blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import peer_figaroh
from peer_clock import once

from calib import CalibrationModel, Robot
from calib.identification.identifiability import sort_out
from calib.measurement import Pose
from calib.parameters import LinkGeometry, TargetFrame, ToolFrame
from calib.se3 import FloatArray, rotation_exp, transform
from posedesign.selection import select


def pool(settings: Mapping[str, Any]) -> FloatArray:
    """Blocks ``(N, 6, p)`` of full poses over their noise, columns of unit root mean square.

    A choice by D does not depend on the scale of columns; solvers of cone programmes do.
    """
    own = settings["selection"]
    robot, rng = Robot.preset(own["robot"]), np.random.default_rng(settings["seed"])
    frames = [
        ToolFrame(transform(rotation_exp([0.1, 0.2, -0.1]), [0.05, 0.0, 0.15])),
        TargetFrame(transform(rotation_exp([0.2, -0.1, 2.0]), [1.5, -1.0, 0.5])),
    ]
    kind = Pose([2e-5] * 3 + [1e-4] * 3)
    q = rng.uniform(-own["joints_rad"], own["joints_rad"], (own["candidates"], robot.n))
    full = CalibrationModel(robot, [*frames, LinkGeometry(robot)], kind)
    kept = sort_out(full.jacobian(q).reshape(-1, full.p), full.names, first=full.nuisance).kept
    links = [full.names[k] for k in kept if full.names[k].startswith("link.")]
    free = LinkGeometry(robot, links[: own["parameters"] - 12])
    model = CalibrationModel(robot, [*frames, free], kind)
    blocks = model.linearise(q).white_jacobian
    return np.asarray(blocks / np.sqrt(np.mean(blocks**2, axis=(0, 1))))


def criterion(information: FloatArray, chosen: Sequence[int] | FloatArray) -> float:
    """Root of the determinant of a choice, per parameter and pose: larger is better."""
    rows = np.asarray(chosen, dtype=int)
    sign, log = np.linalg.slogdet(information[rows].sum(axis=0))
    return float(np.exp(log / information.shape[-1]) / len(rows)) if sign > 0 else 0.0


def compared(settings: Mapping[str, Any], *, with_figaroh: bool) -> list[dict[str, Any]]:
    """What each way chooses: criterion over that of the best proven possible, and the seconds."""
    own, blocks = settings["selection"], pool(settings)
    information = np.einsum("nmp,nmq->npq", blocks, blocks)
    rng, n = np.random.default_rng(settings["seed"] + 1), own["chosen"]
    best = select(blocks, n)
    bound = best.efficiency / criterion(information, best.indices)  # of one over the criterion
    rows: list[dict[str, Any]] = []

    def add(by: str, chosen: Sequence[int], seconds: float, says: str, against: float) -> None:
        row = {"by": by, "poses": len(chosen), "different": len(set(chosen)), "seconds": seconds}
        share = criterion(information, chosen) * against
        rows.append(row | {"of_the_bound": share, "says_of_its_distance": says})

    for name, method, proof in (
        ("exchange, with the bound", "exchange", True),
        ("exchange, no bound asked for", "exchange", False),
        ("DetMax, no bound asked for", "detmax", False),
        ("rounding of the relaxation", "rounding", True),
    ):

        def call(method: str = method, proof: bool = proof) -> Any:
            return select(blocks, n, method=method, bound=proof)

        found = call()
        says = f"proven: {found.efficiency:.4f} of the best" if proof else "nothing"
        add(f"ours: {name}", found.indices.tolist(), _fastest(call), says, bound)
    if with_figaroh:
        _add_figaroh(add, blocks, information, own, rng)
    sets = [rng.choice(len(blocks), n, replace=False) for _ in range(own["random_sets"])]
    shares = [criterion(information, each) for each in sets]
    add("random, median", sets[int(np.argsort(shares)[len(sets) // 2])].tolist(), 0.0, "", bound)
    return rows


def _add_figaroh(
    add: Any,
    blocks: FloatArray,
    information: FloatArray,
    own: Mapping[str, Any],
    rng: np.random.Generator,
) -> None:
    import random

    kept: list[FloatArray] = []
    n, seconds = own["chosen"], once(lambda: kept.append(peer_figaroh.weights(information)))
    order = np.argsort(-kept[0])
    reported = [int(k) for k in order[kept[0][order] > 1e-5]]  # its own threshold
    again = select(blocks, len(reported))
    bound = again.efficiency / criterion(information, again.indices)
    add("figaroh: cone programme, all it keeps", reported, seconds, "nothing", bound)
    best = select(blocks, n)
    bound = best.efficiency / criterion(information, best.indices)
    add("figaroh: cone programme, the heaviest", order[:n].tolist(), seconds, "nothing", bound)
    tried: list[tuple[float, float, list[int]]] = []
    for seed in rng.integers(2**31, size=own["starts"]):
        random.seed(int(seed))
        ended: list[list[int]] = []
        taken = once(lambda ended=ended: ended.append(peer_figaroh.detmax(information, n)[0]))
        tried.append((criterion(information, ended[0]), taken, ended[0]))
    tried.sort(key=lambda each: each[0])
    middle, top = tried[len(tried) // 2], tried[-1]
    add("figaroh: DetMax, median start", middle[2], middle[1], "nothing", bound)
    every = sum(each[1] for each in tried)
    add(f"figaroh: DetMax, best of {len(tried)}", top[2], every, "nothing", bound)


def _fastest(call: Any, rounds: int = 5) -> float:
    return float(np.median([once(call) for _ in range(rounds)]))
