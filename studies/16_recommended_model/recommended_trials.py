"""A trial: one arm, measured one way, identified; every model held against the arm as it is.

Two ways of others on the same measurements stand beside them, in a few lines each. Both free six
errors of every joint. One drops the columns that others span, found by QR without pivoting, and
fits the rest by weighted least squares with nothing known beforehand, as figaroh does. The other
keeps all of them and pulls them to the description by a small weight, metres and radians alike,
over measurements that are weighed alike, as MUKCa does (Franzese et al. 2025; its weight of 1e-4 a
site on the mean square of each site).
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from calib.errors import CalibError
from calib.identification import IdentificationResult, identify
from calib.identification.held import MODEL
from calib.model import CalibrationModel, Setup
from calib.model import simulate as measure
from calib.model.measurements import Measurements
from calib.model.parameters import LinkGeometry, ParameterBlock, Part
from calib.se3 import FloatArray
from posedesign.identification import Identified, identify_models, results_as_dict
from posedesign.study import Task
from studies.simulated_arms import aligned_rms_m

from .recommended_arms import Arm, Bench, bench_of

REDUCED, PULLED = "QR, least squares", "pulled to nominal"
EVALUATIONS = 60

Rows = Callable[[FloatArray], FloatArray]


def all_links(baseline: CalibrationModel) -> CalibrationModel:
    """The baseline, which places tool and targets, with six errors of every joint besides."""
    blocks: list[ParameterBlock] = [LinkGeometry(baseline.robot), *baseline.parameters]
    return baseline.with_parameters(blocks)


def reduced_by_qr(
    whole: CalibrationModel, data: Measurements, planned: FloatArray, tolerance: float
) -> CalibrationModel:
    """The model without link errors whose columns are spanned by those of set-up and others.

    At the postures as planned ``(N, n)``: where tool and target meet by the description, what
    touch-ups cannot see is not seen; those that were measured would show it by their residuals.
    """
    J = whole.linearise(planned, whole.nominal, data.setup, data.observed).white_jacobian
    columns = J.reshape(-1, whole.p)
    length = np.linalg.norm(columns, axis=0)
    columns = columns / np.where(length > 0, length, 1.0)
    order = np.concatenate([np.flatnonzero(whole.nuisance), np.flatnonzero(~whole.nuisance)])
    R = np.linalg.qr(columns[:, order], mode="r")
    kept = {whole.names[k] for k in order[np.abs(np.diag(R)) > tolerance]}
    links = whole.parameters[0]
    part = Part(links, [name for name in links.names if name in kept])
    return whole.with_parameters([part, *whole.parameters[1:]])


def by_least_squares(model: CalibrationModel, data: Measurements, start: FloatArray) -> FloatArray:
    """Parameters ``(p,)`` that leave least, in units of the noise and of priors."""

    def rows(x: FloatArray) -> FloatArray:
        found = model.linearise(data.postures, x, data.setup, data.observed)
        return np.concatenate([found.white_rows.ravel(), (x - model.nominal) / model.prior])

    def jacobian(x: FloatArray) -> FloatArray:
        found = model.linearise(data.postures, x, data.setup, data.observed)
        return np.concatenate([found.white_jacobian.reshape(-1, model.p), np.diag(1 / model.prior)])

    return _solved(rows, jacobian, start)


def by_pull(
    model: CalibrationModel, data: Measurements, start: FloatArray, pull: float
) -> FloatArray:
    """Parameters ``(p,)`` that leave least [m, rad], errors of links being pulled to zero."""
    root = np.where(model.nuisance, 0.0, np.sqrt(pull * data.count))

    def rows(x: FloatArray) -> FloatArray:
        found = model.linearise(data.postures, x, data.setup, data.observed)
        return np.concatenate([found.rows.ravel(), root * (x - model.nominal)])

    def jacobian(x: FloatArray) -> FloatArray:
        found = model.linearise(data.postures, x, data.setup, data.observed)
        return np.concatenate([found.jacobian.reshape(-1, model.p), np.diag(root)])

    return _solved(rows, jacobian, start)


def _solved(rows: Rows, jacobian: Rows, start: FloatArray) -> FloatArray:
    found = least_squares(rows, start, jacobian, method="lm", x_scale="jac", max_nfev=EVALUATIONS)
    return np.asarray(found.x)


NOMINAL = "frames only"
"""The arm as described, tool and targets placed."""

KNOWN = "all sizes known"
"""The posterior mean of whoever knew what the arm has, how large, and the noise."""

EMPTY: Mapping[str, Any] = {
    **dict.fromkeys(("preset", "way", "trial", "compliant", "wavy", "noise", "model", "role")),
    **dict.fromkeys(("error_mm", "box_mm", "expected_mm", "expected_low_mm"), np.nan),
    "expected_high_mm": np.nan,
    **dict.fromkeys(("recommended", "reference", "incomplete", "blames"), False),
    "covered": 0,
    "parameters": 0,
    "give_mm": np.nan,
    "seconds": np.nan,
    "said": "",
}
"""The table's columns, a row a model, those of a trial behind each other; and what stands where
there is nothing."""

_INCOMPLETE = re.compile(r"incomplete|leaves something out|does not describe|not covered")

_ERRORS = ("link", "compliance", "harmonic", "lost_motion")
"""First parts of the names of what an arm may have besides zero offsets."""


def simulate(task: Task) -> dict[str, Any]:
    """Rows of all trials of a task, by columns."""
    rows = []
    for trial in range(task.first, task.first + task.trials):
        rows += trial_of(task.condition["preset"], task.condition["way"], trial)
    return {column: [row[column] for row in rows] for column in EMPTY}


def trial_of(preset: str, way: str, trial: int) -> list[dict[str, Any]]:
    """Rows of one trial."""
    bench = bench_of(preset, way)
    arm = bench.arm(trial)
    head = {"preset": preset, "way": way, "trial": trial, "compliant": arm.compliant}
    head |= {"wavy": arm.wavy, "noise": arm.noise}
    empty = {**EMPTY, **head}
    table, q, how = bench.measured(arm, trial)
    start = time.process_time()
    try:
        identified = identify_models(bench.cell, table)
    except CalibError as error:
        return [empty | {"model": NOMINAL, "role": "refused", "said": _short(str(error))}]
    seconds = time.process_time() - start
    content = results_as_dict(bench.cell, identified)
    recommended, reference = content["recommended"], content.get("reference")
    empty["blames"] = _blames(content)
    rows = []
    for one, said in zip(identified.comparison.trials, content["models"], strict=True):
        if one.result is None:
            continue
        model, x = one.candidate.model, one.result.values
        row = empty | {"model": one.name, "role": "model", "seconds": seconds}
        row |= errors(model, x, bench, arm) | _expected(said)
        row["reference"] = one.name == reference
        if one.name == recommended:
            row["recommended"] = True
            row["said"] = _short(content["reason"])
            row["incomplete"] = _says_incomplete(content, said)
            row["give_mm"] = _give_mm(model, x, bench)
            row |= _coverage_of(arm, model, one.result, (q, how))
        rows.append(row)
    for name, model, x in _peers(bench, identified, q):
        rows.append(empty | {"model": name, "role": "peer"} | errors(model, x, bench, arm))
    known = by_least_squares(arm.model, table.data, arm.model.nominal)
    bound = {"model": KNOWN, "role": "bound"} | errors(arm.model, known, bench, arm)
    return [*rows, empty | bound]


def errors(model: CalibrationModel, x: FloatArray, bench: Bench, arm: Arm) -> dict[str, float]:
    """Errors of the tool point at fresh postures [mm], the base laid on the true one."""

    def off_mm(q: FloatArray) -> float:
        said, true = model.view(q, x), arm.model.view(q, arm.values)
        return 1e3 * aligned_rms_m(said.tool_points, true.tool_points)

    return {"error_mm": off_mm(bench.fresh), "box_mm": off_mm(bench.in_box)}


def _expected(said: Mapping[str, Any]) -> dict[str, float]:
    """What the result says of its error over the task box, where it does."""
    found = said.get("expected_box_mm")
    if found is None:
        return {}
    if isinstance(found, Mapping):
        value, low, high = (found.get(k, np.nan) for k in ("value", "low", "high"))
    else:
        value = found
        low, high = said.get("expected_box_interval_mm") or (np.nan, np.nan)
    values = [np.nan if v is None else float(v) for v in (value, low, high)]
    return dict(zip(("expected_mm", "expected_low_mm", "expected_high_mm"), values, strict=True))


def _says_incomplete(content: Mapping[str, Any], said: Mapping[str, Any]) -> bool:
    """Whether the result says that the recommended model leaves something of the arm out."""
    lines = [content["reason"], *content["warnings"], said["message"], *said["notes"]]
    lines += [finding["text"] for finding in content.get("findings", ())]
    return any(_INCOMPLETE.search(line) for line in lines)


def _blames(content: Mapping[str, Any]) -> bool:
    """Whether a mistake in measuring is named: none of these arms suffers one."""
    causes = {finding["cause"] for finding in content.get("findings", ())}
    return bool(causes - MODEL)


def _give_mm(model: CalibrationModel, x: FloatArray, bench: Bench) -> float:
    """How far compliance as identified moves the tool point [mm], rms, the base laid anew."""
    gives = [name.startswith(("compliance.", "bearing")) for name in model.names]
    if not any(gives):
        return 0.0
    stiff = model.view(bench.fresh, np.where(gives, 0.0, x)).tool_points
    return 1e3 * aligned_rms_m(model.view(bench.fresh, x).tool_points, stiff)


def _coverage_of(
    arm: Arm,
    model: CalibrationModel,
    result: IdentificationResult,
    measured: tuple[FloatArray, Setup],
) -> dict[str, int]:
    """How many parameters of the arm there are, and how many intervals of 95 % hold the truth.

    Those of which the result itself says that the prior alone holds them are not counted.
    """
    true = _truth(arm, model, measured)
    told = np.array([name not in result.held_by_prior for name in result.names])
    own = ~result.nuisance & told & np.isfinite(true)
    low, high = result.interval
    held = (low <= true) & (true <= high)
    return {"parameters": int(own.sum()), "covered": int(held[own].sum())}


def _truth(arm: Arm, model: CalibrationModel, measured: tuple[FloatArray, Setup]) -> FloatArray:
    """What the parameters ``(p,)`` of a model truly are.

    Those that priors hold are the arm's own, zero of what it has not. Others stand for those merged
    with them, too: they are what the model finds without noise of an arm that has errors of its
    kinds only.
    """
    if np.isfinite(model.prior).any():
        by_name = dict(zip(arm.model.names, arm.values, strict=True))
        return np.array([by_name.get(name, 0.0) for name in model.names])
    has = {name.partition(".")[0] for name in model.names}
    values = arm.without(*(word for word in _ERRORS if word not in has))
    q, how = measured
    try:
        return identify(model, measure(arm.model, values, q, setup=how)).values
    except CalibError:
        return np.full(model.p, np.nan)


def _peers(
    bench: Bench, identified: Identified, planned: FloatArray
) -> Sequence[tuple[str, CalibrationModel, FloatArray]]:
    """What others would have fitted."""
    baseline = identified.comparison.trials[0]
    data = identified.table.data
    if baseline.result is None:
        return []
    whole = all_links(baseline.candidate.model)
    start = np.where(whole.nuisance, 0.0, whole.nominal)
    start[whole.nuisance] = baseline.result.values
    few = reduced_by_qr(whole, data, planned, bench.settings["qr_tolerance"])
    kept = [whole.names.index(name) for name in few.names]
    return [
        (REDUCED, few, by_least_squares(few, data, start[kept])),
        (PULLED, whole, by_pull(whole, data, start, bench.settings["pull"])),
    ]


def _short(text: str) -> str:
    return " ".join(text.split())[:200]
