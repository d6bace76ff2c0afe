"""One trial: an arm is touched up by each plan, identified, and held against the arm as it is."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from calib.errors import CalibError
from calib.identification import Workplace
from calib.model import CalibrationModel, Setup, simulate
from calib.se3 import FloatArray
from posedesign.candidates import away_from_singularities, candidates_of, functions_over_work
from posedesign.files.measurements import MeasurementTable
from posedesign.identification import identify_models
from posedesign.selection import mean_deviation, select
from posedesign.study import Task
from studies.simulated_arms import aligned_rms_m

from .promised_arms import GRID, OFFSETS_ALONE, PLANS, Arm, Bench, bench_of

COLUMNS = (
    *("preset", "population", "plan", "trial", "refused", "model"),
    *("work_mm", "box_mm", "nominal_mm", "expected_mm"),
)
"""Columns of the table: a row for each arm and plan. ``work_mm`` is the error found where the arm
works, ``box_mm`` over the task box, ``nominal_mm`` that of the arm as described where it works,
``expected_mm`` the error that identification expects."""


def simulate_task(task: Task) -> dict[str, Any]:
    """Return the rows of all arms of a task, by columns."""
    given = task.condition
    rows = []
    for trial in range(given["first"], given["first"] + given["arms"]):
        rows += trial_of(given["preset"], given["population"], trial)
    return {column: [row[column] for row in rows] for column in COLUMNS}


def trial_of(preset: str, population: str, trial: int) -> list[dict[str, Any]]:
    """Return the rows of one arm, one a plan."""
    bench = bench_of(preset)
    arm = bench.arm(population, trial)
    head = {"preset": preset, "population": population, "trial": trial}
    head["nominal_mm"] = error_mm(arm, arm.model, arm.as_described, bench.work)
    return [
        head | {"plan": name} | found(bench, arm, q, bench.rng(population, trial, k))
        for k, (name, q) in enumerate(bench.plans.items())
    ]


def found(bench: Bench, arm: Arm, q: FloatArray, rng: np.random.Generator) -> dict[str, Any]:
    """Touch up an arm at postures ``(N, n)`` [rad], identify it, and return its errors."""
    try:
        data = simulate(arm.model, arm.values, q, rng)
        if arm.deviation_rad:
            off = arm.deviation_rad * rng.standard_normal(data.postures.shape)
            data = replace(data, postures=data.postures + off)
        table = MeasurementTable(data, ("touch-up",), tuple(range(2, 2 + data.count)))
        trial, result = identify_models(bench.cell, table).shown
    except CalibError as error:
        nothing = dict.fromkeys(("work_mm", "box_mm", "expected_mm"), np.nan)
        return {"refused": True, "model": str(error)[:80], **nothing}
    model, x = trial.candidate.model, result.values
    box = Workplace(bench.in_box, Setup.of(len(bench.in_box)), "the task box")
    return {
        "refused": False,
        "model": trial.name,
        "work_mm": error_mm(arm, model, x, bench.work),
        "box_mm": error_mm(arm, model, x, box),
        "expected_mm": np.nan if trial.expected is None else 1e3 * trial.expected.rms_m,
    }


def error_mm(arm: Arm, model: CalibrationModel, x: FloatArray, at: Workplace) -> float:
    """Return the error [mm] of the tool point of a model with parameters ``(p,)``.

    Root mean square over the postures, after the best rigid motion of the base.
    """
    said = model.view(at.postures, x, at.setup).tool_points
    true = arm.model.view(at.postures, arm.values, at.setup).tool_points
    return 1e3 * aligned_rms_m(said, true)


def limits_of_task(task: Task) -> list[dict[str, Any]]:
    """Return what each plan promises, and what no plan can fall below; one row a plan.

    ``promised_mm`` with its range is what the plan states before anything is measured.
    ``own_mm``: what it states by the parameters that it was chosen for. ``known_mm``: the error to
    expect of whoever knew the sizes of the errors of this population. ``bound_mm``: no choice of as
    many poses falls below it; ``floor_mm``: nor does the whole pool, measured.
    """
    preset, population = task.condition["preset"], task.condition["population"]
    bench = bench_of(preset)
    arms = bench.known(population)
    functions, _ = functions_over_work(bench.cell, arms.model)

    def error_of(blocks: FloatArray) -> float:
        return 1e3 * arms.expected_error(blocks, functions).rms_m

    pool = candidates_of(away_from_singularities(bench.cell))
    blocks = arms.blocks(pool.linearise(arms.model))
    chosen = select(
        blocks,
        len(bench.plans[GRID]),
        mean_deviation(1e3 * functions),
        known=arms.known_rows,
        starts=1,
    )
    limits = {"pool": len(pool), "floor_mm": error_of(blocks), "bound_mm": chosen.bound}
    rows = []
    for name in PLANS:
        promise, q = bench.promises[name], bench.plans[name]
        own_mm = 1e3 * (bench.promised_by_offsets_m if name == OFFSETS_ALONE else promise.rms_m)
        rows.append(
            {
                "preset": preset,
                "population": population,
                "plan": name,
                "poses": len(q),
                "promised_mm": 1e3 * promise.rms_m,
                "promised_low_mm": 1e3 * promise.low_m,
                "promised_high_mm": 1e3 * promise.high_m,
                "promised_median_mm": 1e3 * promise.median_m,
                "own_mm": own_mm,
                "known_mm": error_of(arms.blocks(arms.model.linearise(q))),
                **limits,
            }
        )
    return rows
