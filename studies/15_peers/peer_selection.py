"""D-optimal choice of poses: this project and figaroh on the same blocks."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from calib import CalibrationModel, Robot
from calib.identification.identifiability import sort_out
from calib.model.measurements import Pose
from calib.model.parameters import LinkGeometry, TargetFrame, ToolFrame
from calib.se3 import FloatArray, rotation_exp, transform
from posedesign.selection import select

from . import peer_figaroh as peer_figaroh
from .peer_clock import Call, in_turns, ratio

KEPT = 1e-5
"""Weight above which figaroh keeps a pose."""


def pool(settings: Mapping[str, Any]) -> FloatArray:
    """Blocks ``(N, 6, p)`` of full poses over their noise; all of them together tell alike of all.

    A choice by D does not depend on the units and the mixture of parameters; that of a solver of
    cone programmes does. With the mean information the identity all of them can do it.
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
    blocks = blocks / np.sqrt(np.mean(blocks**2, axis=(0, 1)))
    mean = np.einsum("nmp,nmq->pq", blocks, blocks) / len(blocks)
    return np.asarray(blocks @ np.linalg.inv(np.linalg.cholesky(mean)).T)


def criterion(information: FloatArray, chosen: Sequence[int] | FloatArray) -> float:
    """Root of the determinant of a choice, per parameter and pose: larger is better."""
    rows = np.asarray(chosen, dtype=int)
    sign, log = np.linalg.slogdet(information[rows].sum(axis=0))
    return float(np.exp(log / information.shape[-1]) / len(rows)) if sign > 0 else 0.0


def compared(settings: Mapping[str, Any], *, with_figaroh: bool) -> list[dict[str, Any]]:
    """What each way chooses: criterion over the proven bound of as many different poses."""
    own, blocks = settings["selection"], pool(settings)
    information = np.einsum("nmp,nmq->npq", blocks, blocks)
    rng, n = np.random.default_rng(settings["seed"] + 1), own["chosen"]
    rows: list[dict[str, Any]] = []
    bound = cache(lambda count: _bound(blocks, information, count))

    def add(by: str, chosen: Sequence[int], says: str = "nothing") -> None:
        share = criterion(information, chosen) * bound(len(chosen))
        row = {"by": by, "poses": len(chosen), "different": len(set(chosen))}
        rows.append(row | {"of_the_bound": share, "says_of_its_distance": says})

    for name, method in (
        ("exchange", "exchange"),
        ("DetMax", "detmax"),
        ("rounding of the relaxation", "rounding"),
    ):
        found = select(blocks, n, method=method)
        says = f"proven: {found.efficiency:.4f} of the best"
        add(f"ours: {name}", found.indices.tolist(), says)
    if with_figaroh:
        weights = peer_figaroh.weights(information)
        order = np.argsort(-weights)
        kept = [int(k) for k in order[weights[order] > KEPT]]
        add("figaroh: cone programme, all it keeps", kept)
        add("figaroh: cone programme, the heaviest", order[:n].tolist())
        ends = [_detmax(information, n, seed) for seed in rng.integers(2**31, size=own["starts"])]
        ends.sort(key=lambda chosen: criterion(information, chosen))
        add("figaroh: DetMax, median start", ends[len(ends) // 2])
        add(f"figaroh: DetMax, best of {len(ends)}", ends[-1])
    sets = [rng.choice(len(blocks), n, replace=False) for _ in range(own["random_sets"])]
    sets.sort(key=lambda chosen: criterion(information, chosen))
    add("random, median", sets[len(sets) // 2].tolist())
    return rows


def times(
    settings: Mapping[str, Any], clock: Mapping[str, Any], *, with_figaroh: bool
) -> list[dict[str, Any]]:
    """Time of figaroh's two ways over that of the exchange with its bound."""
    if not with_figaroh:
        return []
    n, blocks = settings["selection"]["chosen"], pool(settings)
    information = np.einsum("nmp,nmq->npq", blocks, blocks)
    calls: dict[str, Call] = {
        "ours": lambda: select(blocks, n),
        "figaroh: cone programme": lambda: peer_figaroh.weights(information),
        "figaroh: DetMax, one start": lambda: _detmax(information, n, settings["seed"]),
    }
    taken = in_turns(calls, clock)
    ours = taken.pop("ours")
    head = {"job": "choice of poses", "size": len(blocks), "ours": "exchange and bound"}
    return [head | {"peer": name} | ratio(own, ours) for name, own in taken.items()]


def _detmax(information: FloatArray, n: int, seed: int) -> list[int]:
    """What figaroh's DetMax ends with from one start."""
    random.seed(int(seed))
    return peer_figaroh.detmax(information, n)[0]


def _bound(blocks: FloatArray, information: FloatArray, n: int) -> float:
    """One over the criterion that no choice of so many exceeds."""
    best = select(blocks, n)
    return best.efficiency / criterion(information, best.indices)
