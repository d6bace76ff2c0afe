"""One sequence of KinHEC through all solvers: the benchmark's own, and ours beside them.

The benchmark pairs the streams, selects keyframes and judges errors; ours is one more entry of its
table of solvers. Sequences with clocks of their own are evaluated by the true offset and by the
offset that the benchmark estimates. Ours also takes both streams as they are, and estimates the
offset with X and Z.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from calib.errors import CalibError, InputError
from calib.robot_world import PoseStream, difference, solve, solve_streams
from calib.se3 import FloatArray, inverse

OURS, OURS_SCALE = "ml-robust", "ml-robust, scale"
STREAMS, STREAMS_SCALE = "streams", "streams, scale"
"""Ours by keyframe pairs, and by both streams; the second of each estimates the scale as well."""

ORACLE, ESTIMATED = "oracle", "estimated"
"""The clock that a sequence is evaluated by."""

INSTALL = 'pip install -c constraints.txt -e ".[kinhec]"'

WITHIN = 1.959964
"""Of a normal error with a probability of 95 %, in standard deviations."""


def installed() -> bool:
    """Return True if KinHEC is there."""
    return importlib.util.find_spec("kinhec") is not None


def check_installed(version: str) -> None:
    """Check that KinHEC is there, of the version that the study is of.

    Raises
    ------
    InputError
        It is not installed, or another version is.
    """
    found = import_module("kinhec").__version__ if installed() else None
    if found != version:
        raise InputError(
            f"this study needs KinHEC {version}, and "
            + ("it is not installed" if found is None else f"{found} is installed"),
            hint=f"install it in the checkout: {INSTALL}",
            name="kinhec",
            value=found,
        )


def generate(tier: str, folder: Path, limit: int | None) -> None:
    """Have KinHEC generate a tier into a folder: all of it, or so many sequences a track."""
    import_module("kinhec.pipeline").generate_dataset(
        tier, folder, limit=limit, work_dir=folder / "work", write_card=False, progress=False
    )


def sequences(folder: Path, limit: int | None) -> Iterator[tuple[float, int, Any]]:
    """Sequences of a data set, each after the part of all that is done, and with its number."""
    io = import_module("kinhec.io")
    every = io.load_manifest(folder)
    kept = every if limit is None else every.groupby("track").head(limit)
    for k, (number, row) in enumerate(kept.iterrows()):
        yield k / len(kept), number, io._load_from_row(folder, row)


@dataclass
class Solver:
    """A solver of KinHEC's table that keeps what its last call took, and our result."""

    function: Callable[[Any, np.random.Generator], dict[str, Any]]
    cpu_ms: float = field(default=np.nan, init=False)
    result: Any = field(default=None, init=False)

    def __call__(self, data: Any, rng: np.random.Generator) -> dict[str, Any]:
        self.result, self.cpu_ms = None, np.nan
        start = time.process_time()
        found = self.function(data, rng)
        self.cpu_ms = 1e3 * (time.process_time() - start)
        self.result = found.pop("result", None)
        return found


def by_pairs(*, scale: bool) -> Callable[[Any, np.random.Generator], dict[str, Any]]:
    """Our solver of keyframe poses as KinHEC calls its own."""

    def run(data: Any, rng: np.random.Generator) -> dict[str, Any]:
        A, B = data[:2]
        result = solve(A, B, "ml-robust", estimate_scale=scale)
        return {"X": result.X, "Y": result.Z, "result": result}

    return run


@contextmanager
def registered() -> Iterator[dict[str, Solver]]:
    """KinHEC's table of solvers with ours in it, each with a clock of the processor's time."""
    table: dict[str, Any] = import_module("kinhec.benchmark").SOLVERS
    before = dict(table)
    table[OURS], table[OURS_SCALE] = by_pairs(scale=False), by_pairs(scale=True)
    for name, function in table.items():
        table[name] = Solver(function)
    try:
        yield table
    finally:
        table.clear()
        table.update(before)


def rows_of(
    sequence: Any, number: int, solvers: Mapping[str, Solver], scaled: bool
) -> list[dict[str, Any]]:
    """A row for each clock and solver of a sequence.

    Parameters
    ----------
    sequence : kinhec.io.Sequence
    number : int
        Its place in the index, which is the seed that KinHEC gives to its own solvers.
    scaled : bool
        Whether to run ours with the scale of translations estimated, too.
    """
    evaluate = import_module("kinhec.benchmark").evaluate_sequence
    names = [name for name in solvers if name != OURS_SCALE or scaled]
    rows = []
    for clock in (ORACLE,) if sequence.synchronous else (ORACLE, ESTIMATED):
        rng = np.random.default_rng(number)
        for said in evaluate(sequence, names, sync=clock, rng=rng):
            solver = solvers[said["solver"]]
            row = _errors(sequence, clock, said["solver"], said) | {"cpu_ms": solver.cpu_ms}
            if solver.result is not None:
                row |= _judged_pairs(solver.result, sequence, solver.cpu_ms)
            rows.append(row)
    if not sequence.synchronous:
        rows += [_by_streams(sequence, scale) for scale in ((False, True) if scaled else (False,))]
    return rows


def _errors(sequence: Any, clock: str, name: str, said: Mapping[str, Any]) -> dict[str, Any]:
    """What KinHEC says of one call; errors are infinite where there is no answer."""
    found = {
        "sequence": sequence.id,
        "track": sequence.manifest["track"],
        "clock": clock,
        "solver": name,
        "answered": bool(said["ok"]),
        "error": said["error"],
        "offset_ms": said["time_offset_err_ms"],
    }
    for frame in "XY":
        for key, unit in (("rot_err_deg", "deg"), ("trans_err_mm", "mm")):
            value = said.get(f"{frame}_{key}", np.nan) if said["ok"] else np.inf
            found[f"{frame}_{unit}"] = float(value)
    return found


def _judged_pairs(result: Any, sequence: Any, cpu_ms: float) -> dict[str, Any]:
    """Status and intervals of our answer from pairs, which are worked out when asked for."""
    start = time.process_time()
    status, covariance = result.status, result.covariance
    own = {"status": status, "cpu_all_ms": cpu_ms + 1e3 * (time.process_time() - start)}
    return own | _intervals(result.X, result.Z, covariance, sequence)


def _intervals(
    X: FloatArray, Z: FloatArray, covariance: FloatArray | None, sequence: Any
) -> dict[str, Any]:
    """Components of X and Z within their 95 % intervals, and the largest error over its sigma."""
    if covariance is None or not np.isfinite(covariance).all():
        return {}
    error = np.concatenate([difference(X, sequence.X), difference(Z, sequence.Y)])
    size = np.abs(error) / np.sqrt(np.diag(covariance))
    within = size < WITHIN
    return {
        "within_X": int(within[:6].sum()),
        "within_Y": int(within[6:].sum()),
        "farthest": float(size.max()),
    }


def _by_streams(sequence: Any, scale: bool) -> dict[str, Any]:
    """Ours from both streams as they are, the offset of the clocks estimated."""
    seen = sequence.camera.T_cam_target_meas
    there = np.isfinite(seen).all(axis=(1, 2))
    B = np.full_like(seen, np.nan)
    B[there] = inverse(seen[there]) if sequence.eye_in_hand else seen[there]
    said: dict[str, Any] = {"ok": False, "error": "", "time_offset_err_ms": np.nan}
    judged: dict[str, Any] = {}
    start = time.process_time()
    try:
        robot = PoseStream.of(sequence.robot.t, sequence.robot.T_base_ee_meas, "robot")
        camera = PoseStream.of(sequence.camera.t, B, "camera")
        found = solve_streams(robot, camera, estimate_scale=scale)
    except CalibError as error:
        said["error"] = f"{type(error).__name__}: {error}"
        cpu_ms = 1e3 * (time.process_time() - start)
    else:
        cpu_ms = 1e3 * (time.process_time() - start)
        off_s = found.offset_s - sequence.time_offset
        metrics = import_module("kinhec.metrics")
        said |= metrics.calibration_errors(found.X, sequence.X, found.Z, sequence.Y)
        said |= {"ok": True, "time_offset_err_ms": 1e3 * abs(off_s)}
        status = found.pairs.status
        judged = {
            "status": "doubtful" if status == "ok" and not found.is_ok else status,
            "cpu_all_ms": 1e3 * (time.process_time() - start),
            "offset_in_sigma": abs(off_s) / found.sigma_offset_s,
        }
        judged |= _intervals(found.X, found.Z, found.covariance, sequence)
    name = STREAMS_SCALE if scale else STREAMS
    return _errors(sequence, ESTIMATED, name, said) | {"cpu_ms": cpu_ms} | judged
