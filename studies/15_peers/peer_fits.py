"""Ten parameters from touch-ups by everybody who is installed: accuracy, and time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from calib import CalibrationModel, identify
from calib.errors import CalibError
from calib.identification import identify_batch
from calib.model.parameters import ZeroOffsets
from calib.se3 import FloatArray
from studies.intervals import median_interval, share

from .peer_clock import Call, in_turns, once, ratio
from .peer_figaroh import Figaroh
from .peer_pybotics import Pybotics
from .peer_touch_ups import TouchUps


def ours(problem: TouchUps, trial: int = 0) -> FloatArray:
    """All of :func:`identify`: covariance and leave-one-out included."""
    return identify(problem.model, problem.data.trials(trial)).values


def ours_at_once(problem: TouchUps) -> FloatArray:
    """All trials in one call: the estimates alone."""
    return identify_batch(problem.model, problem.data)


def fit_by_scipy(problem: TouchUps, trial: int = 0) -> FloatArray:
    """scipy with finite differences over this project's predictions, weighed as here."""
    data, model = problem.data.trials(trial), problem.model

    def rows(x: FloatArray) -> FloatArray:
        return model.white_residuals(data, x).ravel()

    return np.asarray(least_squares(rows, model.nominal, method="lm", x_scale="jac").x)


OURS, AT_ONCE, SCIPY = "ours", "ours, all trials at once", "scipy over our predictions"
FIGAROH, COORDINATES = "figaroh", "pybotics' arm, coordinates"
DISTANCES = "pybotics, its distances"
SAME = 1e-3
"""Of our error: below this two answers are as good as one another."""

Fit = Callable[[int], FloatArray]


def problems(settings: Mapping[str, Any], trials: int) -> dict[str, TouchUps]:
    """One of each noise."""
    own, seed = settings["touch_ups"], settings["seed"]
    names = own["noise_mm"]
    return {name: TouchUps.drawn(own, name, trials, seed + k) for k, name in enumerate(names)}


def fits(problem: TouchUps, peers: tuple[str, ...], folder: Path) -> dict[str, Fit]:
    """What estimates the ten parameters of a trial, by everybody."""
    by: dict[str, Fit] = {
        OURS: lambda trial: ours(problem, trial),
        SCIPY: lambda trial: fit_by_scipy(problem, trial),
    }
    if "figaroh" in peers:
        by[FIGAROH] = lambda trial: Figaroh(problem, trial, folder).fit()
    if "pybotics" in peers:
        arm = Pybotics(problem)
        by[COORDINATES] = lambda trial: arm.fit(problem.postures(trial), coordinates=True)
        by[DISTANCES] = lambda trial: arm.fit(problem.postures(trial))
    return by


def errors(
    settings: Mapping[str, Any], trials: int, kinked: int, peers: tuple[str, ...]
) -> list[dict[str, Any]]:
    """By how much the tool point is off in other postures, and what is left at the touch-ups."""
    rows = []
    for noise, problem in problems(settings, trials).items():
        with TemporaryDirectory() as folder:
            by = fits(problem, peers, Path(folder))
            reference = np.array([problem.tool_error_mm(by[OURS](t)) for t in range(trials)])
            for name, fit in by.items():
                count = kinked if name == DISTANCES else trials
                if count:
                    found = [fit(t) for t in range(count)]
                    rows.append(_row(noise, name, problem, found, reference))
    return rows


def _row(
    noise: str, name: str, problem: TouchUps, found: list[FloatArray], ours: FloatArray
) -> dict[str, Any]:
    off = np.array([problem.tool_error_mm(x) for x in found])
    left = [
        np.sqrt(problem.unweighted(x, t) / problem.data.postures.shape[1])
        for t, x in enumerate(found)
    ]
    low, high = median_interval(off)
    against = share(off > (1.0 + SAME) * ours[: len(off)])
    return {
        "noise": noise, "by": name, "trials": len(off),
        "tool_error_mm": float(np.median(off)),
        "tool_error_low_mm": low, "tool_error_high_mm": high,
        "of_ours": float(np.median(off) / np.median(ours[: len(off)])),
        "ours_nearer": against["share"],
        "ours_nearer_low": against["low"], "ours_nearer_high": against["high"],
        "left_mm": float(np.median(left)),
    }  # fmt: skip


def times(
    settings: Mapping[str, Any], clock: Mapping[str, Any], kinked: int, peers: tuple[str, ...]
) -> list[dict[str, Any]]:
    """Their time over that of ``identify``, which ends with covariance and leave-one-out."""
    trials = settings["touch_ups"]["trials"]
    problem = next(iter(problems(settings, trials).values()))
    with TemporaryDirectory() as folder:
        by = fits(problem, peers, Path(folder))
        kink = by.pop(DISTANCES, None)
        calls: dict[str, Call] = {name: lambda fit=fit: fit(0) for name, fit in by.items()}
        if FIGAROH in by:  # what it reads and sets up is not counted
            ready = Figaroh(problem, 0, Path(folder))
            calls[FIGAROH] = ready.fit
        calls[AT_ONCE] = lambda: ours_at_once(problem)
        taken = in_turns(calls, clock)
        if kink is not None and kinked:
            taken[DISTANCES] = np.full(clock["turns"], once(lambda: kink(0)))
    taken[AT_ONCE] = taken[AT_ONCE] / trials
    head = {"job": "ten parameters", "size": problem.data.postures.shape[1], "ours": "identify"}
    ours = taken.pop(OURS)
    return [head | {"peer": name} | ratio(own, ours) for name, own in taken.items()]


def facts(settings: Mapping[str, Any], peers: tuple[str, ...]) -> dict[str, Any]:
    """Whether the arms are the same, and who notices that an offset cannot be told."""
    problem = next(iter(problems(settings, 2).values()))
    model, said = problem.model, {}
    want = model.view(problem.held, model.nominal).point.T - model.nominal[7:]
    joints = (model.robot.joint_names[0], model.robot.joint_names[-1])
    dropped: dict[str, dict[str, Any]] = {"ours": {j: _ours_says(problem, j) for j in joints}}
    if "figaroh" in peers:
        with TemporaryDirectory() as folder:
            arm = Figaroh(problem, 0, Path(folder))
            said["figaroh_apart_m"] = float(np.abs(arm.points(problem.held) - want).max())
            dropped["figaroh"] = {j: "drops it" if arm.absorbed(j) else "keeps it" for j in joints}
            said["figaroh_own_parameters"] = list(arm.own_parameters)
    if "pybotics" in peers:
        apart = np.abs(Pybotics(problem).points(problem.held) - want).max()
        said["pybotics_apart_m"] = float(apart)
    return said | {"offset_that_cannot_be_told": dropped}


def _ours_says(problem: TouchUps, joint: str) -> str:
    """What :func:`identify` makes of the offset of a joint beside the ten parameters."""
    robot = problem.model.robot
    offsets = ZeroOffsets(robot, [*robot.joint_names[1:5], joint])
    parameters = [offsets, *problem.model.parameters[1:]]
    model = CalibrationModel(robot, parameters, problem.model.measurement)
    try:
        found = identify(model, problem.data.trials(0))
    except CalibError as error:
        return type(error).__name__
    return f"status: {found.status}"
