"""Pose pairs as they are measured in a cell, and all that goes wrong with them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from calib import se3
from calib.errors import CalibError
from calib.robot_world import PairNoise, Problems, add_noise, difference, random_problems, solve
from calib.se3 import FloatArray


def viewing_pairs(
    rng: np.random.Generator,
    count: int,
    *,
    tilt_deg: float = 25.0,
    roll_deg: float = 30.0,
    distance_m: tuple[float, float] = (0.5, 1.0),
) -> Problems:
    """One problem of a camera on the flange that looks at a target, without noise.

    From about one distance, which changes by a tenth; its axis at most so far from the normal of
    the target and turned about it by plus and minus the roll. The target stays within some
    centimetres of one place in the view. The poses are in the order of a tour.
    """
    X = se3.transform(Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.1, 0.1, 3))
    Z = se3.transform(
        Rotation.random(rng=rng).as_matrix(), np.array([1.0, 0.0, 0.3]) + rng.uniform(-0.3, 0.3, 3)
    )
    tilt = np.radians(tilt_deg) * np.sqrt(rng.random(count))
    around = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
    away = np.stack(
        [np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), np.cos(tilt)], axis=-1
    )
    far = rng.uniform(*distance_m) * rng.uniform(0.9, 1.1, (count, 1))
    B = se3.transform(
        _looking_along(-away, np.radians(roll_deg) * rng.uniform(-1.0, 1.0, count)),
        far * away + rng.uniform(-0.03, 0.03, (count, 3)),
    )
    A = Z @ B @ se3.inverse(X)
    return Problems(A[None], B[None], X[None], Z[None])


def _looking_along(axis: FloatArray, roll_rad: FloatArray) -> FloatArray:
    """Rotations ``(N, 3, 3)`` with their z along unit vectors ``(N, 3)``, rolled about them."""
    x = np.cross([0.0, 1.0, 0.0], axis)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    upright = np.stack([x, np.cross(axis, x), axis], axis=-1)
    return upright @ se3.rotation_exp(roll_rad[:, None] * [0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Hostile:
    """A set of pairs with something wrong, and the answer that it was made from."""

    what: str  # what is wrong with it
    A: FloatArray
    B: FloatArray  # A, B (N, 4, 4)
    X: FloatArray
    Z: FloatArray  # X, Z (4, 4)


Spoilt = tuple[FloatArray, FloatArray]


def _scaled(rng: np.random.Generator, A: FloatArray, B: FloatArray) -> Spoilt:
    return A, _lengths(B, float(np.exp(rng.uniform(np.log(0.5), np.log(3.0)))))


def _other_unit(rng: np.random.Generator, A: FloatArray, B: FloatArray) -> Spoilt:
    return A, _lengths(B, float(rng.choice([1e-3, 0.1, 10.0, 25.4, 1e3])))


def _unit_of_A(rng: np.random.Generator, A: FloatArray, B: FloatArray) -> Spoilt:
    return _lengths(A, float(rng.choice([0.1, 0.5, 2.0, 10.0]))), B


def _lengths(T: FloatArray, factor: float) -> FloatArray:
    return se3.transform(T[:, :3, :3], factor * T[:, :3, 3])


def _rows_late(rng: np.random.Generator, A: FloatArray, B: FloatArray) -> Spoilt:
    late = int(rng.integers(1, 4))
    return (A[late:], B[:-late]) if rng.random() < 0.5 else (A[:-late], B[late:])


def _time_offset(rng: np.random.Generator, A: FloatArray, B: FloatArray) -> Spoilt:
    """Poses of the robot from a part of a step later, along the way to the next."""
    part = rng.uniform(0.05, 0.9)
    turn = se3.rotation_log(np.swapaxes(A[:-1, :3, :3], -1, -2) @ A[1:, :3, :3])
    R = A[:-1, :3, :3] @ se3.rotation_exp(part * turn)
    p = (1.0 - part) * A[:-1, :3, 3] + part * A[1:, :3, 3]
    return se3.transform(R, p), B[:-1]


def _moved(rng: np.random.Generator) -> FloatArray:
    """A bump of 5 to 50 mm and 0.5 to 5 deg."""
    way, axis = rng.normal(size=(2, 3))
    way *= rng.uniform(0.005, 0.05) / np.linalg.norm(way)
    axis *= np.radians(rng.uniform(0.5, 5.0)) / np.linalg.norm(axis)
    return se3.transform(se3.rotation_exp(axis), way)


def _bumped_target(rng: np.random.Generator, A: FloatArray, B: FloatArray) -> Spoilt:
    half, bump = len(A) // 2, _moved(rng)
    return A, np.concatenate([B[:half], bump @ B[half:]])


def _bumped_camera(rng: np.random.Generator, A: FloatArray, B: FloatArray) -> Spoilt:
    half, bump = len(A) // 2, _moved(rng)
    return A, np.concatenate([B[:half], B[half:] @ bump])


def _drifting_target(rng: np.random.Generator, A: FloatArray, B: FloatArray) -> Spoilt:
    way = rng.normal(size=3)
    way *= rng.uniform(0.01, 0.05) / np.linalg.norm(way)
    along = np.linspace(0.0, 1.0, len(B))[:, None]
    return A, se3.transform(B[:, :3, :3], B[:, :3, 3] + along * way)


def _swapped_rows(rng: np.random.Generator, A: FloatArray, B: FloatArray) -> Spoilt:
    i, j = rng.choice(len(B), 2, replace=False)
    B = B.copy()
    B[[i, j]] = B[[j, i]]
    return A, B


def _shuffled(rng: np.random.Generator, A: FloatArray, B: FloatArray) -> Spoilt:
    return A, B[rng.permutation(len(B))]


def _inverted(rng: np.random.Generator, A: FloatArray, B: FloatArray) -> Spoilt:
    return (se3.inverse(A), B) if rng.random() < 0.5 else (A, se3.inverse(B))


def _transposed(rng: np.random.Generator, A: FloatArray, B: FloatArray) -> Spoilt:
    return A, se3.transform(np.swapaxes(B[:, :3, :3], -1, -2), B[:, :3, 3])


def _mixed_quaternions(rng: np.random.Generator, A: FloatArray, B: FloatArray) -> Spoilt:
    q = np.roll(se3.quaternion_from_rotation(B[:, :3, :3]), 1, axis=-1)
    return A, se3.transform(Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix(), B[:, :3, 3])


def _no_rotations(rng: np.random.Generator, A: FloatArray, B: FloatArray) -> Spoilt:
    return A, se3.transform(np.broadcast_to(np.eye(3), (len(B), 3, 3)), B[:, :3, 3])


def _outliers(rng: np.random.Generator, A: FloatArray, B: FloatArray) -> Spoilt:
    wrong = rng.choice(len(B), max(1, int(rng.uniform(0.02, 0.35) * len(B))), replace=False)
    B = B.copy()
    for i in wrong:
        B[i] = B[i] @ _moved(rng)
    return A, B


def _duplicates(rng: np.random.Generator, A: FloatArray, B: FloatArray) -> Spoilt:
    some = rng.choice(len(A), int(rng.integers(2, 6)), replace=False)
    rows = np.concatenate([some, rng.choice(some, len(A) - len(some))])
    return A[rows], B[rows]


SPOILT: dict[str, Callable[[np.random.Generator, FloatArray, FloatArray], Spoilt]] = {
    "nothing": lambda rng, A, B: (A, B),
    "scale of B": _scaled,
    "unit of B": _other_unit,
    "unit of A": _unit_of_A,
    "rows late": _rows_late,
    "time offset": _time_offset,
    "target bumped half way": _bumped_target,
    "camera bumped half way": _bumped_camera,
    "target drifts": _drifting_target,
    "two rows swapped": _swapped_rows,
    "rows shuffled": _shuffled,
    "one side inverted": _inverted,
    "rotations transposed": _transposed,
    "quaternions in another order": _mixed_quaternions,
    "rotations left out": _no_rotations,
    "outliers": _outliers,
    "duplicates": _duplicates,
}
"""What is done to good pairs, which come as a tour of poses."""

VIEWS: dict[str, Callable[[np.random.Generator, int], Problems]] = {
    "looking": viewing_pairs,
    "looking, little tilt": lambda rng, N: viewing_pairs(rng, N, tilt_deg=10.0, roll_deg=8.0),
    "anywhere": lambda rng, N: _in_a_tour(random_problems(rng, 1, N)),
    "cone": lambda rng, N: _in_a_tour(random_problems(rng, 1, N, 40.0)),
    "tiny rotations": lambda rng, N: _in_a_tour(random_problems(rng, 1, N, 3.0)),
    "one axis": lambda rng, N: _turned(rng, rng.uniform(-1.5, 1.5, (N, 1)) * _axis(rng)),
    "half turns": lambda rng, N: _turned(rng, np.pi * np.eye(3)[rng.integers(0, 3, N)]),
}
"""How the poses lie."""


def _axis(rng: np.random.Generator) -> FloatArray:
    axis = rng.normal(size=3)
    return np.asarray(axis / np.linalg.norm(axis))


def _turned(rng: np.random.Generator, vectors: FloatArray) -> Problems:
    """One problem with the rotations ``(N, 3)`` of A given."""
    found = random_problems(rng, 1, len(vectors))
    A = se3.transform(se3.rotation_exp(vectors), found.A[0, :, :3, 3])
    return Problems(A[None], (se3.inverse(found.Z[0]) @ A @ found.X[0])[None], found.X, found.Z)


def _in_a_tour(found: Problems) -> Problems:
    """Poses in an order in which each is near the one before it."""
    p, order = found.A[0, :, :3, 3], [0]
    while len(order) < len(p):
        far = np.linalg.norm(p - p[order[-1]], axis=1)
        far[order] = np.inf
        order.append(int(far.argmin()))
    return Problems(found.A[:, order], found.B[:, order], found.X, found.Z)


def hostile_sets(seed: int, count: int) -> Iterator[Hostile]:
    """Sets of 3 to 60 noisy pairs, each with one mistake of :data:`SPOILT` in turn."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        what = list(SPOILT)[k % len(SPOILT)]
        view = str(rng.choice(list(VIEWS), p=[0.35, 0.1, 0.15, 0.2, 0.1, 0.05, 0.05]))
        N = int(rng.choice([5, 8, 12, 20, 40, 60], p=[0.05, 0.1, 0.15, 0.4, 0.2, 0.1]))
        problem = VIEWS[view](rng, N)
        on = str(rng.choice(["A", "B", "both"]))
        noise = PairNoise(np.radians(rng.choice([0.03, 0.1, 0.3])), rng.choice([2e-4, 1e-3]), on)
        A, B = add_noise(rng, problem.A[0], problem.B[0], noise)
        A, B = SPOILT[what](rng, A, B)
        yield Hostile(f"{what}; {view}, {N} pairs", A, B, problem.X[0], problem.Z[0])


def is_silently_wrong(hostile: Hostile, method: str = "ml") -> bool:
    """Whether an answer is off by 5 deviations, and by 5 mm or 0.5 deg, and nothing is said.

    Against X and Z that the set was made from: where the target moved, those of the beginning.
    """
    try:
        result = solve(hostile.A, hostile.B, method)
    except CalibError:
        return False
    if result.status != "ok" or result.warnings or not result.used.all():
        return False
    for found, true, sigma in (
        (result.X, hostile.X, result.sigma_X),
        (result.Z, hostile.Z, result.sigma_Z),
    ):
        error = np.abs(difference(found, true))
        large = error > np.repeat([np.radians(0.5), 5e-3], 3)
        if (large & (error > 5.0 * sigma)).any():
            return True
    return False
