"""What goes wrong in cells: tricks that picture, arm or target play on the touch-up."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from calib.se3 import FloatArray, inverse, rotation_exp, transform
from calib.vision.camera import (
    CircleTarget,
    Glare,
    Imaging,
    Occluder,
    circle_image,
    ellipse_axes,
    render,
)
from calib.vision.camera.rendering import GreyImage
from calib.vision.touch_up import RobotAdapter, SetUp, SimulatedArms
from calib.vision.touch_up.arms import LostMotion
from tests.visual_cells import PRESETS, Sight, preset, random_sight, with_true

SMALL = ((320, 240), (400, 300))
"""Pictures: few pixels, as a thousand cells take forty thousand of them."""

_ONLY = np.zeros(1, dtype=np.intp)

Beside = tuple[CircleTarget, FloatArray]


@dataclass(frozen=True, eq=False)
class OvalTarget(CircleTarget):
    """A hole that is no circle: as wide as the circle, and less high."""

    ratio: float = 0.8

    def pattern(self, xy: FloatArray) -> FloatArray:
        """See :meth:`CircleTarget.pattern`."""
        oval = super().pattern(xy * [1.0, 1.0 / self.ratio])
        oval[np.isnan(oval) & self.on_plate(xy)] = self.face
        oval[~self.on_plate(xy)] = np.nan
        return oval


@dataclass(eq=False)
class Trick:
    """What is done to a cell from some picture on; nothing by default."""

    name: str
    begins: int = 0  # number of the picture with which it begins
    picture: Callable[[GreyImage], GreyImage] = lambda image: image
    """From a picture to the one that the driver gives."""
    imaging: Imaging | None = None  # light and what stands before the lens
    beside: tuple[Beside, ...] = ()  # other targets, with their poses in the frame of the target
    T_target_moved: FloatArray = field(default_factory=lambda: np.eye(4))
    T_camera_moved: FloatArray = field(default_factory=lambda: np.eye(4))
    """T_target_moved, T_camera_moved (4, 4): by which target and camera move, in their own
    frames."""
    true_joints: Callable[[FloatArray], FloatArray] = lambda q: q
    """From joint values of the controller to those of the true arm."""
    frozen: int = 0  # for how many pictures the driver repeats the last one
    late: int = 0  # how many pictures old each picture is


class TrickyRobot(RobotAdapter):
    """A simulated robot behind its adapter, on which a trick is played."""

    def __init__(self, sight: Sight, trick: Trick, rng: np.random.Generator) -> None:
        self.sight, self.trick, self._rng = sight, trick, rng
        self._arms = SimulatedArms(sight.true, sight.observer("image"), 1, rng, sight.q)
        self._shown = sight.q.copy()
        self._kept: list[GreyImage] = []
        self.pictures = 0

    def move(self, q: FloatArray) -> None:
        """See :meth:`RobotAdapter.move`."""
        self._shown = q.copy()
        self._arms.move(_ONLY, self.trick.true_joints(q)[None])

    def joints(self) -> FloatArray:
        """See :meth:`RobotAdapter.joints`."""
        return self._shown.copy()

    @property
    def begun(self) -> bool:
        """Whether the trick is on."""
        return self.pictures > self.trick.begins

    @property
    def T_camera_target(self) -> FloatArray:
        """Where the target really is before the lens now."""
        T = self._arms.T_camera_target(_ONLY)[0]
        if not self.begun:
            return T
        return np.asarray(inverse(self.trick.T_camera_moved) @ T @ self.trick.T_target_moved)

    @property
    def truth(self) -> Sight:
        """The cell as it is now."""
        if not self.begun:
            return self.sight
        true = self.sight.true
        return with_true(
            self.sight,
            T_tip_camera=true.T_tip_camera @ self.trick.T_camera_moved,
            T_base_target=true.T_base_target @ self.trick.T_target_moved,
        )

    def errors(self, found: SetUp, approach_rad: float) -> dict[str, float]:
        """By how much a first step is off now: :meth:`Sight.errors`."""
        shown = self._shown
        for q in (found.postures[0] - approach_rad, found.postures[0]):
            self.move(q)
        seen = inverse(self.T_camera_target)
        truth = self.truth
        T_true_tip = truth.true.T_base_target @ seen @ inverse(truth.true.T_tip_camera)
        self.move(shown)
        return truth.errors(found, T_true_tip)

    def grab(self) -> GreyImage:
        """See :meth:`RobotAdapter.grab`."""
        self.pictures += 1
        sight, trick = self.sight, self.trick
        T = self.T_camera_target
        imaging = trick.imaging if self.begun and trick.imaging else sight.imaging
        beside = [(target, T @ at) for target, at in trick.beside] if self.begun else []
        image = render(sight.camera, [*beside, (sight.target, T)], imaging, self._rng)
        if self.begun:
            image = trick.picture(image)
        since = self.pictures - trick.begins
        if self._kept and 0 < since <= trick.frozen:
            return self._kept[-1]
        self._kept = [*self._kept[-5:], image]
        late = min(trick.late if self.begun else 0, len(self._kept) - 1)
        return self._kept[-1 - late]


def _seen(sight: Sight) -> tuple[FloatArray, float]:
    """Where the target is seen at first ``(2,)``, and how large [px]."""
    ellipse = circle_image(sight.camera, sight.target.diameter_m, sight.T_seen_target)
    return ellipse[:2], float(ellipse_axes(ellipse)[0])


def _moved_in_picture(sight: Sight, at_px: FloatArray, scale: float = 1.0) -> Sight:
    """The cell with the target elsewhere in the first picture, and of another size."""
    T = sight.T_seen_target.copy()
    T[:3, 3] = T[2, 3] * sight.camera.rays(at_px)
    target = sight.target
    bigger = replace(
        target,
        diameter_m=scale * target.diameter_m,
        plate_m=(scale * target.plate_m[0], scale * target.plate_m[1]),
        cross_length_m=scale * target.cross_length_m,
        cross_width_m=scale * target.cross_width_m,
    )
    T_base_camera = sight.T_true_tip(sight.q) @ sight.true.T_tip_camera
    return replace(with_true(sight, T_base_target=T_base_camera @ T), target=bigger)


def _rebuilt(sight: Sight, q_true: FloatArray) -> Sight:
    """The cell with the target before the camera of an arm that really stands elsewhere."""
    T_base_camera = sight.T_true_tip(q_true) @ sight.true.T_tip_camera
    return with_true(sight, T_base_target=T_base_camera @ sight.T_seen_target)


def _bar(center: FloatArray, along: float, length: float, width: float) -> Occluder:
    ahead = np.array([np.cos(along), np.sin(along)])
    aside = np.array([-ahead[1], ahead[0]])
    corners = [
        center + a * length / 2 * ahead + b * width / 2 * aside
        for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    return Occluder(tuple((float(x), float(y)) for x, y in corners), 0.2)


def _late_or_early(rng: np.random.Generator) -> int:
    """Number of a picture: with the first, on the way, or after the first step."""
    return int(rng.choice([0, rng.integers(3, 45), rng.integers(45, 65)]))


def _healthy(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    return sight, Trick("healthy")


def _cut(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    _, size = _seen(sight)
    width, height = sight.camera.width_px, sight.camera.height_px
    inside = size * rng.uniform(-0.3, 0.6)
    at = [inside, rng.uniform(size, height - size)]
    if rng.uniform() < 0.5:
        at = [rng.uniform(size, width - size), height - inside]
    return _moved_in_picture(sight, np.array(at)), Trick("cut by the edge")


def _glare(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    at, size = _seen(sight)
    if rng.uniform() < 0.5:
        at = sight.camera.center_px
    place = at + rng.uniform(-1.0, 1.0, 2) * size
    glare = Glare((place[0], place[1]), size * rng.uniform(0.05, 0.6), rng.uniform(50, 600))
    imaging = replace(sight.imaging, glares=(glare,))
    return sight, Trick("glare", _late_or_early(rng), imaging=imaging)


def _hidden(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    at, size = _seen(sight)
    if rng.uniform() < 0.5:
        at = sight.camera.center_px
    place = at + rng.uniform(-0.8, 0.8, 2) * size
    bar = _bar(place, rng.uniform(0, np.pi), size * rng.uniform(0.3, 3.0), size * 0.4)
    bar = replace(bar, reflectance=float(rng.choice([0.05, 0.2, 0.5, 0.9])))
    imaging = replace(sight.imaging, occluders=(bar,))
    return sight, Trick("partly hidden", _late_or_early(rng), imaging=imaging)


def _gun(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    """A gun tip that reaches into the picture from a side."""
    width, height = sight.camera.width_px, sight.camera.height_px
    deep = rng.uniform(0.2, 0.55) * height
    left, right = np.sort(rng.uniform(0.0, width, 2))
    gun = Occluder(((left, 0.0), (right, 0.0), ((left + right) / 2, deep)), 0.1)
    return sight, Trick("gun tip", imaging=replace(sight.imaging, occluders=(gun,)))


def _several(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    apart = sight.target.diameter_m * rng.uniform(2.0, 4.0)
    angle = rng.uniform(0, 2 * np.pi)
    place = transform(np.eye(3), apart * np.array([np.cos(angle), np.sin(angle), 0.0]))
    return sight, Trick("several", _late_or_early(rng), beside=((sight.target, place),))


def _distractor(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    target, scale = sight.target, rng.uniform(0.3, 2.5)
    other = CircleTarget(
        scale * target.diameter_m,
        (1.5 * scale * target.diameter_m,) * 2,
        0.0,
        0.0,
        target.circle,
        target.face,
    )
    apart = target.diameter_m * (1.1 + 0.8 * scale) * rng.uniform(1.0, 2.0)
    angle = rng.uniform(0, 2 * np.pi)
    place = transform(np.eye(3), apart * np.array([np.cos(angle), np.sin(angle), 0.0]))
    return sight, Trick("other circle", _late_or_early(rng), beside=((other, place),))


def _oval(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    t = sight.target
    oval = OvalTarget(
        t.diameter_m, t.plate_m, 0.0, 0.0, t.circle, t.face, ratio=rng.uniform(0.5, 0.93)
    )
    return replace(sight, target=oval), Trick("no circle")


def _small(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    at, size = _seen(sight)
    return _moved_in_picture(sight, at, rng.uniform(3.0, 16.0) / size), Trick("small")


def _fills(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    _, size = _seen(sight)
    scale = rng.uniform(0.6, 1.2) * sight.camera.height_px / size
    return _moved_in_picture(sight, sight.camera.center_px, scale), Trick("fills the picture")


def _mirrored(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    axis = int(rng.integers(2))
    return sight, Trick("mirrored", picture=lambda i: np.ascontiguousarray(np.flip(i, axis)))


def _wrong_sign(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    sign = np.ones(len(sight.q))
    sign[rng.integers(len(sign))] = -1.0
    if rng.uniform() < 0.3:
        sign[rng.integers(len(sign))] *= -1.0
    name = "healthy" if (sign > 0).all() else "wrong sign"
    return _rebuilt(sight, sign * sight.q), Trick(name, true_joints=lambda q: sign * q)


def _wrong_robot(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    same = [p for p in PRESETS if preset(p).n == len(sight.q) and p != sight.preset]
    if not same:
        return _healthy(sight, rng)
    other = random_sight(rng, (same[rng.integers(len(same))],), SMALL)
    true = other.true
    # the controller moves its own joints; the target stands before the camera of the arm
    T_camera = other.T_true_tip(sight.q) @ true.T_tip_camera
    cell = replace(sight, true=replace(true, T_base_target=T_camera @ sight.T_seen_target))
    return replace(cell, believed=sight.robot), Trick("wrong robot")


def _moves(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    way = rng.standard_normal(3)
    way *= rng.uniform(1e-3, 20e-3) / np.linalg.norm(way)
    turn = rotation_exp(np.deg2rad(rng.uniform(0, 5)) * np.array([1.0, 0.0, 0.0]))
    begins = int(rng.integers(2, 55))
    return sight, Trick("target moves", begins, T_target_moved=transform(turn, way))


def _loose(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    way = 1e-3 * rng.uniform(0.5, 10) * rng.standard_normal(3) / np.sqrt(3)
    turn = rotation_exp(np.deg2rad(rng.uniform(0.1, 3.0)) * rng.standard_normal(3))
    begins = int(rng.integers(2, 55))
    return sight, Trick("camera loose", begins, T_camera_moved=transform(turn, way))


def _blind(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    level = int(rng.choice([0, 255]))
    return sight, Trick(
        "black or white", _late_or_early(rng), picture=lambda i: np.full_like(i, level)
    )


def _frozen(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    many = int(rng.choice([1, 3, 1000]))
    return sight, Trick("frozen", int(rng.integers(1, 60)), frozen=many)


def _late(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    return sight, Trick("late", _late_or_early(rng), late=1)


def _at_limits(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    q, robot = sight.q.copy(), sight.robot
    j = int(rng.integers(robot.n))
    near = np.deg2rad(rng.uniform(0.0, 8.0))
    q[j] = robot.lower[j] + near if rng.uniform() < 0.5 else robot.upper[j] - near
    return replace(_rebuilt(sight, q), q=q), Trick("near a limit")


def _singular(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    q = sight.q.copy()
    wrist = -2 if not sight.preset.startswith("panda") else -4
    q[wrist] = np.deg2rad(rng.uniform(-3.0, 3.0))
    q = np.clip(q, sight.robot.lower, sight.robot.upper)
    return replace(_rebuilt(sight, q), q=q), Trick("near a singularity")


def _play(sight: Sight, rng: np.random.Generator) -> tuple[Sight, Trick]:
    lost = LostMotion.of(sight.robot.n, np.deg2rad(rng.uniform(0.1, 1.0)), scatter_rad=2e-6)
    return with_true(sight, lost_motion=lost), Trick("much play")


MISCHIEF = (
    _healthy,
    _cut,
    _glare,
    _hidden,
    _gun,
    _several,
    _distractor,
    _oval,
    _small,
    _fills,
    _mirrored,
    _wrong_sign,
    _wrong_robot,
    _moves,
    _loose,
    _blind,
    _frozen,
    _late,
    _at_limits,
    _singular,
    _play,
)


def nasty_cell(rng: np.random.Generator) -> TrickyRobot:
    """A cell with one trick played on it, or in a fifth of them none."""
    kind = MISCHIEF[0] if rng.uniform() < 0.2 else MISCHIEF[rng.integers(len(MISCHIEF))]
    sight, trick = kind(random_sight(rng, sizes=SMALL), rng)
    return TrickyRobot(sight, trick, rng)
