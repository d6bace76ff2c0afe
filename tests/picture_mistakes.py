"""Mistakes that people make with pictures of a board: each in one set of pictures, at random."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from calib.errors import CalibError
from calib.hand_eye import HandEyeResult, Pictures, calibrate
from calib.robots import Robot
from calib.robots.flange_poses import posture_of_pose
from calib.se3 import FloatArray, rotation_exp, transform
from studies.board_scenes import (
    EXACT,
    OTHER_LENS,
    SIZE,
    STOPS_OFF,
    Scene,
    draw_scene,
    pose_error,
    reached,
)

FAR_OFF = 5.0
"""Error over its stated standard deviation from which a result is wrong."""


@dataclass(frozen=True, eq=False)
class Case:
    """Pictures with one mistake, and what was true before it."""

    scene: Scene
    pictures: Pictures
    options: dict[str, Any]
    judged: tuple[Literal["X", "Z"], ...] = ("X", "Z")
    """What there is one true value of."""


Mistake = Callable[[Scene, FloatArray, np.random.Generator], Case]


def _rows(scene: Scene, pixels: FloatArray, order: FloatArray) -> Case:
    """Postures in another order than the pictures."""
    return Case(scene, scene.shown(pixels, postures=posture_of_pose(scene.flange[order])), {})


def none(scene: Scene, pixels: FloatArray, rng: np.random.Generator) -> Case:
    """No mistake."""
    return Case(scene, scene.shown(pixels), {})


def wrong_rows(scene: Scene, pixels: FloatArray, rng: np.random.Generator) -> Case:
    """40 % of the pictures have the posture of another one."""
    order = np.arange(len(pixels))
    some = rng.permutation(len(order))[: int(0.4 * len(order))]
    order[some] = np.roll(some, 1)
    return _rows(scene, pixels, order)


def swapped_files(scene: Scene, pixels: FloatArray, rng: np.random.Generator) -> Case:
    """Two files in the place of each other, all of them shifted by one, or in reverse."""
    order, how = np.arange(len(pixels)), rng.integers(3)
    if how == 0:
        one, other = rng.permutation(len(order))[:2]
        order[[one, other]] = other, one
    return _rows(scene, pixels, (order, np.roll(order, 1), order[::-1])[how])


def moved_board(scene: Scene, pixels: FloatArray, rng: np.random.Generator) -> Case:
    """What stands around the arm was moved about half-way, by 2 to 200 mm, and turned."""
    far = 2e-3 * 100.0 ** rng.random()
    way = rng.standard_normal(3)
    place = far * way / np.linalg.norm(way)
    turned = rotation_exp(np.array([0.0, 0.0, rng.uniform(-5, 5) * far]))
    split = rng.integers(int(0.3 * len(pixels)), int(0.7 * len(pixels)) + 1)
    moved = replace(scene, Z=scene.Z @ transform(turned, place))
    later = moved.seen(rng)
    mixed = np.concatenate([pixels[:split], later[split:]])
    return Case(scene, scene.shown(mixed), {}, ("X",))


def _of_size(factor: float) -> Mistake:
    def given(scene: Scene, pixels: FloatArray, rng: np.random.Generator) -> Case:
        share = factor if rng.random() < 0.5 else 1.0 / factor
        return Case(scene, scene.shown(pixels, board=share * scene.points), {})

    given.__doc__ = f"Squares are {factor:g} times as large as they are, or as small."
    return given


def mirrored(scene: Scene, pixels: FloatArray, rng: np.random.Generator) -> Case:
    """The driver flips the pictures; markers are read no more, but points were told by hand."""
    flipped = pixels * [-1.0, 1.0] + [SIZE[0], 0.0]
    return Case(scene, scene.shown(flipped), {})


def mirrored_chessboard(scene: Scene, pixels: FloatArray, rng: np.random.Generator) -> Case:
    """The same with a board whose corners a detector tells by where they lie."""
    columns = len(np.unique(scene.points[:, 0].round(9)))
    order = np.arange(len(scene.points)).reshape(-1, columns)[:, ::-1].ravel()
    flipped = pixels[:, order] * [-1.0, 1.0] + [SIZE[0], 0.0]
    return Case(scene, scene.shown(flipped), {})


def other_lens(scene: Scene, pixels: FloatArray, rng: np.random.Generator) -> Case:
    """The lens that is given is that of another camera."""
    return Case(scene, scene.shown(pixels), {"lens": OTHER_LENS})


def bent_board(scene: Scene, pixels: FloatArray, rng: np.random.Generator) -> Case:
    """The board is bent, by .5 to 3 mm."""
    bend = 5e-4 * 6.0 ** rng.random() * rng.choice([-1.0, 1.0])
    k = rng.integers(2)
    along = scene.points[:, k]
    half = np.ptp(along) / 2.0
    points = scene.points.copy()
    points[:, 2] += bend * ((along - along.min() - half) / half) ** 2
    return Case(scene, scene.shown(replace(scene, points=points).seen(rng)), {})


def other_unit(scene: Scene, pixels: FloatArray, rng: np.random.Generator) -> Case:
    """Places in mm, rotation vectors or joints in degrees."""
    how = rng.integers(4)
    if how < 2:
        factors = np.repeat([(1e3, 1.0), (1.0, np.degrees(1.0))][how], 3)
        return Case(
            scene, scene.shown(pixels, postures=factors * posture_of_pose(scene.flange)), {}
        )
    robot = Robot.preset("ur10e")
    some, q = reached(robot, scene, max(8, len(pixels) // 2))
    q = np.degrees(q) if how == 2 else np.radians(q)
    return Case(some, some.shown(some.seen(rng), robot=robot, postures=q), {})


def frozen_camera(scene: Scene, pixels: FloatArray, rng: np.random.Generator) -> Case:
    """The camera gives one picture again while the arm goes on: 3 times, or to the end."""
    first = rng.integers(1, len(pixels) - 4)
    last = len(pixels) if rng.random() < 0.3 else first + 4
    again = pixels.copy()
    again[first:last] = pixels[first]
    return Case(scene, scene.shown(again), {})


MISTAKES: dict[str, Mistake] = {
    "40 % of the rows wrong": wrong_rows,
    "swapped files": swapped_files,
    "board moved half-way": moved_board,
    "squares off by 1 %": _of_size(1.01),
    "squares off by 3 %": _of_size(1.03),
    "squares in another unit": _of_size(10.0),
    "mirrored": mirrored,
    "mirrored chessboard": mirrored_chessboard,
    "lens of another camera": other_lens,
    "bent board": bent_board,
    "joints in another unit": other_unit,
    "one picture again": frozen_camera,
}


@dataclass(frozen=True)
class Verdict:
    """What became of a mistake: refused, named, right in silence, or wrong in silence."""

    kind: str
    text: str
    far: float


def judge(case: Case) -> Verdict:
    """Calibrate, and compare with the truth."""
    try:
        result = calibrate(case.pictures, **case.options)
    except CalibError as error:
        return Verdict("refused", str(error), np.nan)
    far = distance_in_sigma(case.scene, result, case.judged)
    if result.warnings:
        return Verdict("named", " | ".join(result.warnings), far)
    return Verdict("silent wrong" if not far <= FAR_OFF else "silent right", "", far)


def distance_in_sigma(
    scene: Scene, result: HandEyeResult, judged: Iterable[Literal["X", "Z"]] = ("X", "Z")
) -> float:
    """Error of X or Z over the norm of its stated standard deviations, the largest."""
    found = []
    for name in judged:
        error = pose_error(getattr(result, name), getattr(scene, name))
        for part, sigma in zip(np.split(error, 2), result.sigma_of(name), strict=True):
            found.append(np.linalg.norm(part) / np.linalg.norm(sigma))
    return float(max(found))


def case_of(name: str, seed: int) -> Case:
    """One set of pictures with a mistake: 12 to 20 of them, either set-up, either arm."""
    rng = np.random.default_rng([seed, [*MISTAKES, "none"].index(name)])
    carried = ("camera", "board")[seed % 2]
    scene = draw_scene(rng, int(rng.integers(12, 21)), carried)  # type: ignore[arg-type]
    pixels = scene.seen(rng, arm=(EXACT, STOPS_OFF)[seed // 2 % 2])
    return MISTAKES.get(name, none)(scene, pixels, rng)
