"""A X = Z B: this project, OpenCV and a refinement with scipy on the same pairs.

OpenCV's closed forms are given what their documentation asks for: A is ``T_base_flange``, B
``T_target_camera``; X is ``T_flange_camera``, Z ``T_base_target``. An engineer would refine them
with scipy, as least squares on rotation vectors started at OpenCV's Shah: the residuals are those
of the likelihood, R_B = exp([w]) R and p_B = p + v with w and v divided by their noise; the
Jacobian is by two-point differences.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import cv2
import numpy as np
from scipy.optimize import OptimizeResult, least_squares
from scipy.spatial.transform import Rotation

from calib import se3
from calib.errors import CalibError
from calib.robot_world import PairNoise, add_noise, random_problems, solve
from calib.se3 import FloatArray
from studies.intervals import median_interval

from .peer_clock import in_turns, once, ratio

ROBOT_WORLD = {"SHAH": "shah", "LI": "li-kronecker"}
HAND_EYE = {
    "TSAI": "tsai-lenz",
    "PARK": "park-martin",
    "HORAUD": "horaud-dornaika",
    "ANDREFF": "andreff",
    "DANIILIDIS": "daniilidis",
}
"""OpenCV's methods, with the names that the same ones have here."""

Answer = tuple[FloatArray, FloatArray | None]


def caller(name: str, A: FloatArray, B: FloatArray) -> Callable[[], Answer]:
    """What solves pairs ``(N, 4, 4)``, its lists made beforehand: X, and Z or None ``(4, 4)``."""
    flange, seen = _lists(A), _lists(se3.inverse(B))
    if name in HAND_EYE:
        number = getattr(cv2, f"CALIB_HAND_EYE_{name}")
        return lambda: (_joined(*cv2.calibrateHandEye(*flange, *seen, method=number)), None)
    number = getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{name}")
    to_flange = _lists(se3.inverse(A))

    def robot_world() -> Answer:
        found = cv2.calibrateRobotWorldHandEye(*seen, *to_flange, method=number)
        T_target_base, T_camera_flange = _joined(*found[:2]), _joined(*found[2:])
        return np.linalg.inv(T_camera_flange), np.linalg.inv(T_target_base)

    return robot_world


def _lists(T: FloatArray) -> tuple[list[FloatArray], list[FloatArray]]:
    return list(T[:, :3, :3]), list(T[:, :3, 3])


def _joined(R: FloatArray, p: FloatArray) -> FloatArray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p.ravel()
    return T


def refined(
    A: FloatArray,
    B: FloatArray,
    start: tuple[FloatArray, FloatArray],
    rotation_rad: float,
    translation_m: float,
) -> tuple[FloatArray, FloatArray, OptimizeResult]:
    """X and Z ``(4, 4)`` of pairs ``(N, 4, 4)`` with noise on B, and what scipy says."""
    R_A, p_A, R_B, p_B = A[:, :3, :3], A[:, :3, 3], B[:, :3, :3], B[:, :3, 3]

    def rows(v: FloatArray) -> FloatArray:
        R_X, R_Z = Rotation.from_rotvec(v[:6].reshape(2, 3)).as_matrix()
        R = R_Z.T @ R_A @ R_X
        p = (R_A @ v[6:9] + p_A - v[9:]) @ R_Z
        turn = Rotation.from_matrix(R_B @ R.transpose(0, 2, 1)).as_rotvec()
        return np.concatenate([turn / rotation_rad, (p_B - p) / translation_m]).ravel()

    turns = Rotation.from_matrix([T[:3, :3] for T in start]).as_rotvec()
    first = np.concatenate([turns.ravel(), *(T[:3, 3] for T in start)])
    found = least_squares(rows, first, method="lm", x_scale="jac")
    X, Z = np.eye(4), np.eye(4)
    X[:3, :3], Z[:3, :3] = Rotation.from_rotvec(found.x[:6].reshape(2, 3)).as_matrix()
    X[:3, 3], Z[:3, 3] = found.x[6:9], found.x[9:]
    return X, Z, found


OPENCV = (*ROBOT_WORLD, *HAND_EYE)
SCIPY = "scipy from OpenCV's SHAH"
OURS = ("shah", "ml")
FAR_MM = 1e4
"""Beyond this a figure is a number of no meaning."""


def noise_of(own: Mapping[str, Any], on: str = "B") -> PairNoise:
    """Noise of the study, on one side of the pairs."""
    return PairNoise(np.radians(own["rotation_deg"]), 1e-3 * own["translation_mm"], on)


def by_scipy(A: FloatArray, B: FloatArray, noise: PairNoise) -> tuple[FloatArray, FloatArray, Any]:
    """The refinement, its start included."""
    start = caller("SHAH", A, B)()
    return refined(A, B, start, noise.rotation_rad, noise.translation_m)


def times(settings: Mapping[str, Any], short: bool) -> list[dict[str, Any]]:
    """Their time over that of the same method here, and over that of the likeliest X and Z."""
    cv2.setNumThreads(1)
    own, clock = settings["pairs"], settings["clock"]
    rng, noise = np.random.default_rng(settings["seed"]), noise_of(own)
    rows = []
    for n in own["timed"]:
        problem = random_problems(rng, 1, n)
        A, B = (T[0] for T in add_noise(rng, problem.A, problem.B, noise))
        calls: dict[str, Callable[[], object]] = {
            name: caller(name, A, B) for name in OPENCV if name in ROBOT_WORLD or _few(n, own)
        }
        calls[SCIPY] = lambda A=A, B=B: by_scipy(A, B, noise)
        same = ROBOT_WORLD | HAND_EYE | {SCIPY: "ml"}
        for method in {"ml", *(same[name] for name in calls)}:
            calls[f"ours: {method}"] = lambda A=A, B=B, m=method: solve(A, B, m, noise)
        taken = in_turns(calls, clock)
        if not _few(n, own) and not short:  # once: seconds each
            calls |= {f"ours: {same[name]}": _ours(A, B, same[name], noise) for name in HAND_EYE}
            taken |= {name: np.array([once(caller(name, A, B))]) for name in HAND_EYE}
            taken |= in_turns(
                {f"ours: {m}": _ours(A, B, m, noise) for m in HAND_EYE.values()}, clock
            )
        for name in (name for name in taken if not name.startswith("ours: ")):
            for method in dict.fromkeys((same[name], "ml")):
                head = {"job": "A X = Z B", "size": n, "peer": name, "ours": method}
                theirs, mine = taken[name], taken[f"ours: {method}"]
                if len(theirs) == 1:
                    theirs = np.repeat(theirs, len(mine))
                rows.append(head | ratio(theirs, mine))
    return rows


def _few(n: int, own: Mapping[str, Any]) -> bool:
    return bool(n <= own["most_hand_eye"])


def _ours(A: FloatArray, B: FloatArray, method: str, noise: PairNoise) -> Callable[[], object]:
    return lambda: solve(A, B, method, noise)


def errors(settings: Mapping[str, Any], trials: int) -> list[dict[str, Any]]:
    """How far off X and Z are, by every solver on the same pairs."""
    own, rows = settings["pairs"], []
    rng, told = np.random.default_rng(settings["seed"] + 1), noise_of(settings["pairs"])
    for name, case in own["settings"].items():
        for n in own["accuracy_pairs"]:
            problem = random_problems(rng, trials, n, case.get("cone_deg"))
            A, B = add_noise(rng, problem.A, problem.B, noise_of(own, case["on"]))
            for solver in (*(f"ours: {m}" for m in OURS), SCIPY, *OPENCV):
                answers = [_answer(solver, A[t], B[t], told) for t in range(trials)]
                head = {"setting": name, "pairs": n, "solver": solver}
                rows.append(head | _summary(answers, problem.X, problem.Z, own))
    return rows


def _answer(solver: str, A: FloatArray, B: FloatArray, noise: PairNoise) -> Answer | None:
    """X and Z by one solver; None where it refuses."""
    try:
        if solver.startswith("ours: "):
            found = solve(A, B, solver.removeprefix("ours: "), noise)
            return (found.X, found.Z) if found.status == "ok" else None
        if solver == SCIPY:
            return by_scipy(A, B, noise)[:2]
        return caller(solver, A, B)()
    except (CalibError, cv2.error, ValueError, np.linalg.LinAlgError):
        return None


def off(T: FloatArray, truth: FloatArray) -> tuple[float, float]:
    """By how much a transform is off [deg, mm]; infinite where it is none."""
    if not np.isfinite(T).all() or np.linalg.det(T[:3, :3]) < 0.5:
        return np.inf, np.inf
    turn = Rotation.from_matrix(T[:3, :3] @ truth[:3, :3].T).magnitude()
    return float(np.degrees(turn)), 1e3 * float(np.linalg.norm(T[:3, 3] - truth[:3, 3]))


def _summary(
    answers: list[Answer | None], X: FloatArray, Z: FloatArray, own: Mapping[str, Any]
) -> dict[str, Any]:
    """Medians with 95 % intervals over the trials; failures are there as infinite errors."""
    none = (np.inf, np.inf)
    off_X = np.array([none if a is None else off(a[0], X[t]) for t, a in enumerate(answers)])
    bad = (off_X > [own["failed_deg"], own["failed_mm"]]).any(axis=1)
    row: dict[str, Any] = {"refused": sum(a is None for a in answers), "failed": int(bad.sum())}
    for part, column in (("X_deg", off_X[:, 0]), ("X_mm", off_X[:, 1])):
        row |= _median(part, column)
    given = [(a[1], Z[t]) for t, a in enumerate(answers) if a is not None and a[1] is not None]
    off_Z = np.array([off(*pair) for pair in given]) if given else np.full((1, 2), np.nan)
    for part, column in (("Z_deg", off_Z[:, 0]), ("Z_mm", off_Z[:, 1])):
        row |= _median(part, column)
    return row


def _median(name: str, values: FloatArray) -> dict[str, float]:
    """Median and its 95 % interval."""
    low, high = median_interval(values)
    return {name: float(np.median(values)), f"{name}_low": low, f"{name}_high": high}


def optimum(settings: Mapping[str, Any], trials: int) -> dict[str, Any]:
    """Whether scipy's refinement ends where the likeliest X and Z are."""
    own = settings["pairs"]
    rng, noise = np.random.default_rng(settings["seed"] + 2), noise_of(own)
    problem = random_problems(rng, trials, own["accuracy_pairs"][0])
    A, B = add_noise(rng, problem.A, problem.B, noise)
    apart, higher = [], []
    for t in range(trials):
        mine, (X, _, found) = solve(A[t], B[t], "ml", noise), by_scipy(A[t], B[t], noise)
        apart.append(np.abs(mine.X - X).max())
        higher.append(2.0 * found.cost - (mine.chi2 or 0.0))
    return {
        "trials": trials,
        "largest_difference_of_X": float(max(apart)),
        "scipy_higher": int(np.sum(np.array(higher) > 1e-6)),
        "ours_higher": int(np.sum(np.array(higher) < -1e-6)),
    }


def refusals(settings: Mapping[str, Any]) -> list[dict[str, str]]:
    """What every solver says of pairs that cannot be solved."""
    noise, rows = noise_of(settings["pairs"]), []
    for case, (A, B, X) in _impossible(settings).items():
        row = {"pairs": case}
        for solver in ("ours: ml", SCIPY, *OPENCV):
            row[solver] = _said(solver, A, B, X, noise)
        rows.append(row)
    return rows


def _said(solver: str, A: FloatArray, B: FloatArray, X: FloatArray, noise: PairNoise) -> str:
    try:
        if solver.startswith("ours: "):
            found = solve(A, B, solver.removeprefix("ours: "), noise)
            if found.status != "ok":
                return f"status: {found.status}"
            answer: FloatArray = found.X
        else:
            with np.errstate(all="ignore"):  # of what is no number
                answer = (by_scipy(A, B, noise) if solver == SCIPY else caller(solver, A, B)())[0]
    except (CalibError, cv2.error, ValueError, np.linalg.LinAlgError) as error:
        return type(error).__name__
    if not np.isfinite(answer).all():
        return "returns NaN"
    if np.linalg.det(answer[:3, :3]) < 0.5:
        return "returns no rotation"
    deg, mm = off(answer, X)
    return f"returns X, {deg:.0f} deg and {f'{mm:.0f} mm' if mm < FAR_MM else 'over 10 m'} off"


def _impossible(
    settings: Mapping[str, Any],
) -> dict[str, tuple[FloatArray, FloatArray, FloatArray]]:
    """Pairs ``(12, 4, 4)`` that do not determine X, or are no poses, with the X they came from."""
    rng, n = np.random.default_rng(settings["seed"] + 3), 12
    problem = random_problems(rng, 1, n)
    X, Z, A = problem.X[0], problem.Z[0], problem.A[0]

    def with_A(A: FloatArray) -> tuple[FloatArray, FloatArray]:
        return add_noise(rng, A, np.linalg.inv(Z) @ A @ X, noise_of(settings["pairs"]))

    parallel, one_axis = A.copy(), A.copy()
    parallel[:, :3, :3] = A[0, :3, :3]
    turns = Rotation.from_rotvec(np.outer(np.linspace(0, 2.5, n), [0.0, 0.0, 1.0])).as_matrix()
    one_axis[:, :3, :3] = A[0, :3, :3] @ turns
    usual_A, usual_B = with_A(A)
    mirrored, broken = usual_A.copy(), usual_A.copy()
    mirrored[:, :3, 2] *= -1.0
    broken[3, 0, 3] = np.nan
    return {
        "turned about one axis": (*with_A(one_axis), X),
        "not turned at all": (*with_A(parallel), X),
        "left-handed A": (mirrored, usual_B, X),
        "a NaN in A": (broken, usual_B, X),
        "A and B in different order": (usual_A, usual_B[::-1].copy(), X),
    }
