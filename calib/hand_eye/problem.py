"""What is estimated from which pictures: starts of all cameras and boards, and the model of all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from calib import se3
from calib.errors import ConvergenceError, InputError
from calib.hand_eye.arm import ArmErrors, Sizes
from calib.hand_eye.checks import explain_misfit, find_half_turns, unmirrored_poses
from calib.hand_eye.pictures import Pictures
from calib.hand_eye.start import board_poses, start_lens
from calib.lens import Lens, LensName
from calib.model import CalibrationModel
from calib.model.measurements import BoardShape, BoardView, BoardViews, Measurements, board_views
from calib.model.parameters import AXES, BoardErrors, LensParameters, ParameterBlock, TimeOffsets
from calib.model.parameters.frames import AroundArm, OnTool
from calib.robot_world import RobotWorldResult
from calib.robot_world import solve as solve_robot_world
from calib.se3 import BoolArray, FloatArray, IntArray

FEWEST_PICTURES = 4
"""Pictures with the board from which X and Z are estimated: three leave nothing to judge by."""

USUAL_DELAY_S = 0.2
"""Standard deviation of how much later than the joints were read a picture was taken."""

_LETTERS = "A are the poses of the flange, B those of the board in the pictures"


_SETTLED = 0.01
_NOTHING = np.array([1e-6, 1e-6, 1e-3])
"""Change of the noise that is none, relative and absolute [m, rad, px]."""

_SAME_SIZE = 0.1
"""The same of the logarithm of a size of errors: it is known to some .2 and worse."""


@dataclass(frozen=True, eq=False)
class Noise:
    """Scatter of the pixels, deviation of the arm, and sizes of its own errors."""

    pixel: dict[str, float]  # of a coordinate of a point by each camera [px]
    arm: tuple[float, float]  # deviation along each axis [m], about each axis [rad]
    log_shares: FloatArray  # (G,): logarithms of the sizes of errors, as shares of their priors

    def is_near(self, other: Noise) -> bool:
        """Return True if nothing differs by as much as matters."""
        one, two = (np.array([*each.arm, *each.pixel.values()]) for each in (self, other))
        nothing = np.append(_NOTHING[:2], np.full(len(self.pixel), _NOTHING[2]))
        settled = np.abs(two - one) <= _SETTLED * one + nothing
        same = np.abs(self.log_shares - other.log_shares) <= _SAME_SIZE
        return bool(settled.all() and same.all())


@dataclass(frozen=True, eq=False)
class _Placed:
    """Pictures of one board by one camera, with where a lens places the board in them."""

    pictures: Pictures
    lens: Lens
    usable: IntArray
    """(n,): index among the pictures of those that show the board and have a posture."""
    pixels: FloatArray  # (n, K, 2): of these, points in one order
    poses: FloatArray  # (n, 4, 4): ``T_camera_board`` [m]
    found: BoolArray  # (n,): where there is such a pose

    @property
    def postures(self) -> FloatArray:
        """Postures ``(n, joints)`` [rad]."""
        return self.pictures.postures[self.usable]

    @property
    def names(self) -> list[str]:
        """Names of the pictures that are used."""
        return [self.pictures.names[i] for i in self.usable.tolist()]

    def explained(self, error: InputError | ConvergenceError) -> InputError | ConvergenceError:
        """An error of pictures that do not fit together, by what would fit far better."""
        pictures, found = self.pictures, self.found
        A = pictures.robot.fk(self.postures[found])
        names = [self.names[i] for i in np.flatnonzero(found)]
        mirrored = unmirrored_poses(self.lens, pictures.board, self.pixels[found])
        why = explain_misfit(A, self.poses[found], pictures.carried, names, mirrored)
        if why:
            return InputError(f"the pictures do not fit together: {why}", name="pictures")
        error.hint = error.hint or _LETTERS
        return error


def _start(A: FloatArray, B: FloatArray) -> RobotWorldResult:
    """Solve A X = Z B without pairs that contradict the others, or with all of them.

    Poses of boards in pictures scatter by so much more from afar that the noise of most pairs may
    not explain the others. The estimate over pixels knows how far each is known.
    """
    try:
        return solve_robot_world(A, B, "ml-robust")
    except InputError:
        return solve_robot_world(A, B, "shah")


@dataclass(frozen=True, eq=False)
class Prepared(_Placed):
    """The same with what the estimate starts from."""

    free_lens: bool
    start: RobotWorldResult  # of A X = Z B

    @classmethod
    def of(cls, pictures: Pictures, lens: LensName | Lens, free_lens: bool | None) -> Prepared:
        """Find lens, poses, X and Z to start from."""
        usable, board = pictures.each_once(), pictures.board
        if len(usable) < FEWEST_PICTURES:
            raise InputError(
                f"{len(usable)} of {len(pictures.names)} pictures show the board and have a "
                "posture",
                hint=f"{FEWEST_PICTURES} are needed, 15 to 20 are good",
                name="pictures",
                value=len(usable),
                bound=FEWEST_PICTURES,
            )
        given = isinstance(lens, Lens)
        first = (
            lens
            if isinstance(lens, Lens)
            else start_lens(lens, pictures.size_px, board, pictures.pixels[pictures.with_board])
        )
        if (first.width_px, first.height_px) != tuple(pictures.size_px):
            raise InputError(
                f"the lens is of pictures of {first.width_px} x {first.height_px} pixels, these "
                f"have {pictures.size_px[0]} x {pictures.size_px[1]}",
                hint="calibrate it with pictures of this size",
                name="lens",
            )
        pixels = pictures.pixels[usable]
        poses, found = board_poses(first, board, pixels)
        A = pictures.robot.fk(pictures.postures[usable])
        if pictures.half_turn:  # the points of a board that looks alike half turned in one order
            middle = (board.max(axis=0) + board.min(axis=0)) / 2.0
            half = se3.transform(np.diag([-1.0, -1.0, 1.0]), 2.0 * middle * [1.0, 1.0, 0.0])
            flips = np.zeros((len(poses), 1, 1), dtype=bool)
            flips[found, 0, 0] = find_half_turns(A[found], poses[found], half, pictures.carried)
            pixels = np.where(flips, pixels[:, ::-1], pixels)
            poses = np.where(flips, poses @ half, poses)
        placed = pictures, first, usable, pixels, poses, found
        try:
            B = se3.inverse(poses) if pictures.carried == "camera" else poses
            start = _start(A[found], B[found])
        except (InputError, ConvergenceError) as error:
            raise _Placed(*placed).explained(error) from error
        return cls(*placed, not given if free_lens is None else free_lens, start)

    @property
    def good(self) -> BoolArray:
        """Pictures ``(n,)`` whose pose of the board agrees with the others."""
        good = self.found.copy()
        good[self.found] = self.start.used
        return good


@dataclass(frozen=True, eq=False)
class Problem:
    """What is estimated, of which pictures of which cameras and boards."""

    prepared: tuple[Prepared, ...]
    free: tuple[ParameterBlock, ...]
    board_errors: tuple[str, ...]
    arm: ArmErrors | None = None  # what of ``free`` is an error of the arm, its size to be found

    @cached_property
    def starts(self) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """Poses to start from, of what is on the flange, and of what stands around, by name."""
        on_flange: dict[str, FloatArray] = {}
        around: dict[str, FloatArray] = {}
        for one in sorted(self.prepared, key=lambda one: -len(one.usable)):
            tool, target = one.pictures.labels
            on_flange.setdefault(tool, one.start.X)
            around.setdefault(target, one.start.Z)
        both = sorted(on_flange.keys() & around.keys())
        if both:
            raise InputError(
                f"{both[0]} is on the flange in some pictures, and stands around the arm in others",
                hint="give the two names",
                name=both[0],
            )
        return on_flange, around

    @cached_property
    def data(self) -> Measurements:
        """All pictures that are used, those of each camera and board together."""
        tools, targets = (list(frames) for frames in self.starts)
        most = max(one.pixels.shape[1] for one in self.prepared)
        pixels, tool, target, names, motions = [], [], [], [], []
        for one in self.prepared:
            n, K, _ = one.pixels.shape
            wide = np.full((n, most, 2), np.nan)
            wide[:, :K] = one.pixels
            pixels.append(wide)
            on_flange, around = one.pictures.labels
            tool += [tools.index(on_flange)] * n
            target += [targets.index(around)] * n
            names += one.names
            motions.append(np.zeros((n, 2, one.pictures.robot.n)))
            if one.pictures.motion is not None:
                motions[-1] = one.pictures.motion[one.usable]
        data = board_views(
            np.concatenate([one.postures for one in self.prepared]),
            np.concatenate(pixels),
            names,
            tools=tools,
            targets=targets,
            tool=np.array(tool),
            target=np.array(target),
            motion=np.concatenate(motions) if self.moving else None,
        )
        # pictures at one posture share what the arm stops off, whenever they were taken
        return data.at_stops() if len(np.unique(data.groups)) < data.count else data

    @property
    def moving(self) -> dict[str, tuple[Literal["tool", "target"], int]]:
        """Cameras that took pictures of an arm that moved, and which label of those is theirs."""
        found: dict[str, tuple[Literal["tool", "target"], int]] = {}
        for one in self.prepared:
            if one.pictures.is_moving:
                side: Literal["tool", "target"]
                side = "tool" if one.pictures.carried == "camera" else "target"
                labels = list(self.starts[side == "target"])
                found[one.pictures.camera] = side, labels.index(one.pictures.camera)
        return found

    @cached_property
    def cameras(self) -> tuple[str, ...]:
        """Camera of each picture that is used."""
        return tuple(one.pictures.camera for one in self.prepared for _ in one.usable)

    @property
    def largest_px(self) -> float:
        """The longest side of a picture."""
        return float(max(max(one.pictures.size_px) for one in self.prepared))

    @property
    def lenses(self) -> dict[str, tuple[Lens, bool]]:
        """Lens of each camera, and whether it is estimated."""
        return {one.pictures.camera: (one.lens, one.free_lens) for one in self.prepared}

    @property
    def boards(self) -> dict[str, FloatArray]:
        """Points of each board [m]."""
        return {one.pictures.board_name: one.pictures.board for one in self.prepared}

    @cached_property
    def sizes(self) -> Sizes:
        """Components of variance: of the deviation of the arm, and of its errors."""
        return self.sizes_with()

    def sizes_with(
        self, board_errors: Sequence[str] | None = None, free_lens: bool | None = None
    ) -> Sizes:
        """Return :attr:`sizes` of a :meth:`model` with these."""
        usual = Noise(dict.fromkeys(self.lenses, 1.0), (0.0, 0.0), np.zeros(0))
        return Sizes.of(self._model_of(usual, board_errors, free_lens), self.arm)

    def model(
        self,
        noise: Noise,
        *,
        board_errors: Sequence[str] | None = None,
        free_lens: bool | None = None,
    ) -> CalibrationModel:
        """Return the model about the starts, with what is asked for or these in place of it."""
        model = self._model_of(noise, board_errors, free_lens)
        return model.with_prior(Sizes.of(model, self.arm).prior(noise.log_shares))

    def _model_of(
        self,
        noise: Noise,
        board_errors: Sequence[str] | None = None,
        free_lens: bool | None = None,
    ) -> CalibrationModel:
        on_flange, around = self.starts
        blocks: list[ParameterBlock] = [
            OnTool(list(on_flange), np.stack(list(on_flange.values())), AXES),
            AroundArm(list(around), np.stack(list(around.values())), AXES),
            *self.free,
        ]
        if self.moving:
            blocks.append(TimeOffsets(self.moving, USUAL_DELAY_S))
        for camera, (lens, is_free) in self.lenses.items():
            if is_free if free_lens is None else free_lens:
                blocks.append(LensParameters.usual(lens, camera))
        errors = self.board_errors if board_errors is None else board_errors
        blocks += [BoardErrors(board, errors) for board in self.boards if errors]
        arm = noise.arm if any(noise.arm) else None
        looks = {
            one.pictures.labels: BoardView(
                noise.pixel[one.pictures.camera],
                BoardShape(one.pictures.board),
                one.lens,
                one.pictures.carried,
                arm,
                camera_label=one.pictures.camera,
                board_label=one.pictures.board_name,
            )
            for one in self.prepared
        }
        kind = next(iter(looks.values())) if len(looks) == 1 else BoardViews(looks, arm)
        return CalibrationModel(self.prepared[0].pictures.robot, blocks, kind)
