"""What pictures of a board said of camera, board, lens and robot, and how far to believe it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib.identification import IdentificationResult
from calib.judgement import Finding
from calib.lens import Lens
from calib.model.context import reading_label
from calib.model.measurements.board_view import Carried
from calib.robot_world import RobotWorldResult
from calib.se3 import BoolArray, FloatArray, rotation_log
from calib.shown import Shown

PictureStatus = Literal["used", "contradicts the others", "copy", "no board", "no posture"]


@dataclass(frozen=True, eq=False)
class PlacedFrame:
    """Where a camera or a board is."""

    name: str  # with the frames by word: ``T_flange_camera``
    label: str  # of the camera or board
    T: FloatArray  # (4, 4) [m]
    covariance: FloatArray
    """(6, 6): of the place [m] in the axes of its parent, then of the rotation [rad] in its own.
    Mean squares about the truth: what errors of the arm shift the pose by counts, too."""

    @property
    def parent(self) -> str:
        """``flange`` or ``base``."""
        return self.name.split("_")[1]

    @property
    def sigma_m(self) -> FloatArray:
        """Standard deviations of the place ``(3,)`` [m]."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def sigma_rad(self) -> FloatArray:
        """Standard deviations of the rotation ``(3,)`` [rad]."""
        return np.sqrt(np.diag(self.covariance)[3:])


@dataclass(frozen=True)
class ArmError:
    """Errors of one kind that an arm was found to have."""

    kind: str  # by the names of :func:`calib.identification.evidence.groups_of`
    rms_m: float  # shift of a point at other views, camera and board placed anew


def pose_difference(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return shift [m] in the axes of the parent and rotation [rad] in its own, ``(6,)``."""
    turn = rotation_log(other[:3, :3].T @ one[:3, :3])
    return np.append(one[:3, 3] - other[:3, 3], turn)


@dataclass(frozen=True, eq=False, repr=False)
class HandEyeResult(Shown):
    """Camera and board, lens and robot, from pictures."""

    carried: Carried  # what is on the flange
    X: FloatArray
    Z: FloatArray
    """X, Z (4, 4): ``T_flange_camera`` and ``T_base_board``, or ``T_flange_board`` and
    ``T_base_camera`` [m]."""
    labels: tuple[str, str]  # what X and Z place
    poses: dict[str, FloatArray]
    """(4, 4): of all cameras and boards by name [m]: on the flange, or in the base. Those for the
    arm as its controller has it, as X and Z are: with them its errors matter least."""
    true_poses: dict[str, FloatArray]
    """The same where errors of the arm were taken into account: for an arm that is corrected. They
    are those of ``estimate``. Equal to ``poses`` where no errors of the arm were found."""
    arm_errors: tuple[ArmError, ...]  # kinds of error of the arm that were found, the largest first
    lens: Lens
    lenses: dict[str, Lens]  # of all cameras by name
    lens_estimated: bool
    estimate: IdentificationResult
    """All parameters with their covariance: ``tool.*`` of X, ``target.*`` of Z, ``lens.*``,
    ``board.*``, and those of the robot. cx and cy count from the corner of the image."""
    sigma_px: float  # noise of a coordinate of a point, of the first camera
    sigmas_px: dict[str, float]  # the same of all cameras by name
    arm_sigma: tuple[float, float]
    """How far the arm stops from where it says: along each axis [m], about each axis [rad]."""
    names: tuple[str, ...]  # of all N pictures
    status: tuple[PictureStatus, ...]  # of each: used, or why not
    rms_px: FloatArray
    """(N,): rms of a coordinate of the points of each picture; NaN without board or posture."""
    scatter_px: FloatArray  # (N,): the same about the best pose of the board in that picture alone
    pixels: FloatArray
    """(N, K, 2): where the points were seen, in the order of the board; NaN where they were not."""
    residuals_px: FloatArray
    """(N, K, 2): of each point, what is shown by the result less what was seen; NaN where it was
    not."""
    within_px: FloatArray
    """(N, K, 2): the same about the best pose of the board at that stop alone: of the lens and of
    the board, without what the arm stopped off."""
    off: FloatArray
    """(N, 6): by how much the flange seems to have been off in each picture [m, rad]: its place
    where the board is, for a shift alone hardly differs from a turn; base axes."""
    left_out_px: FloatArray  # (N,): as ``rms_px``, with the picture left out of the estimate
    distance_m: float  # of the board from the camera, median
    point_sigma_m: float
    """Error to expect, root mean square [m], of the arm as its controller has it where the camera
    sees a point, at other views of the board: see :mod:`calib.hand_eye.views`."""
    corrected_point_sigma_m: float  # the same of the arm with its errors corrected
    seen_sigma_m: float
    """Standard deviation, root of the sum over three axes, of where the camera says that a point in
    the middle of its picture at this distance is, seen from the flange (eye-in-hand) or from the
    base: what X, or Z, and the lens leave unknown."""
    scale: tuple[float, float]
    """By how much larger the board seems to be than described, as a share, and its standard
    deviation."""
    start: RobotWorldResult  # the solution of A X = Z B that it started from
    findings: tuple[Finding, ...]  # what looks wrong, the worst first

    @property
    def used(self) -> BoolArray:
        """Pictures that the estimate rests on, ``(N,)``."""
        return np.array([status == "used" for status in self.status])

    @property
    def time_offsets_s(self) -> dict[str, tuple[float, float]]:
        """By camera, how much later than its joints a picture was taken, and its sigma [s].

        Empty where the arm stood still.
        """
        found = {}
        for camera in self.lenses:
            name = f"{reading_label('time', camera, 'camera')}.offset"
            if name in self.estimate.names:
                sigma = float(self.estimate.sigma[self.estimate.names.index(name)])
                found[camera] = self.estimate.value(name), sigma
        return found

    @property
    def warnings(self) -> tuple[str, ...]:
        """Findings in words, the worst first; notes are said as such."""
        return tuple(
            f"{one.text} (note: it changes the answer by less than its standard deviation)"
            if one.grade == "note"
            else one.text
            for one in self.findings
        )

    @property
    def is_ok(self) -> bool:
        """Return True if no finding changes camera and board by more than they are known."""
        return all(one.grade != "not to be trusted" for one in self.findings)

    @property
    def outliers(self) -> tuple[str, ...]:
        """Names of the pictures that contradict the others."""
        pairs = zip(self.names, self.status, strict=True)
        return tuple(name for name, status in pairs if status == "contradicts the others")

    @property
    def frames(self) -> tuple[PlacedFrame, ...]:
        """Cameras first, then boards, with their covariances, as ``poses`` has them."""
        return self._placed(self.poses)

    @property
    def true_frames(self) -> tuple[PlacedFrame, ...]:
        """The same as ``true_poses`` has them."""
        return self._placed(self.true_poses)

    def _placed(self, poses: dict[str, FloatArray]) -> tuple[PlacedFrame, ...]:
        found = []
        names = self.estimate.names
        for label, T in poses.items():
            on_flange = any(name.startswith(f"tool.{label}.") for name in names)
            stem = f"tool.{label}." if on_flange else f"target.{label}."
            own = [k for k, name in enumerate(names) if name.startswith(stem)]
            parent = "flange" if on_flange else "base"
            off = pose_difference(T, self.true_poses[label])
            covariance = self.estimate.covariance[np.ix_(own, own)] + np.outer(off, off)
            found.append(PlacedFrame(f"T_{parent}_{label}", label, T, covariance))
        return tuple(sorted(found, key=lambda frame: frame.label not in self.lenses))

    def covariance_of(self, name: Literal["X", "Z"]) -> FloatArray:
        """Covariance ``(6, 6)`` of X or Z, as of :class:`PlacedFrame`."""
        label = self.labels[0 if name == "X" else 1]
        return next(frame.covariance for frame in self.frames if frame.label == label)

    def sigma_of(self, name: Literal["X", "Z"]) -> tuple[FloatArray, FloatArray]:
        """Standard deviations ``(3,)`` of the place [m] and the rotation [rad] of X or Z."""
        sigma = np.sqrt(np.diag(self.covariance_of(name)))
        return sigma[:3], sigma[3:]

    @property
    def headline(self) -> str:
        frame = self.frames[0]
        return (
            f"{frame.name} from {int(self.used.sum())} of {len(self.names)} pictures: +- "
            f"{1e3 * float(np.linalg.norm(frame.sigma_m)):.3f} mm, "
            f"{float(np.degrees(np.linalg.norm(frame.sigma_rad))):.4f} deg"
        )

    def rows(self) -> list[dict[str, object]]:
        """One row a picture."""
        return [
            {
                "picture": name,
                "status": status,
                "rms_px": rms,
                "left_out_px": left,
                "scatter_px": scatter,
                "off_mm": 1e3 * far,
                "off_deg": turn,
            }
            for name, status, rms, left, scatter, far, turn in zip(
                self.names,
                self.status,
                self.rms_px.tolist(),
                self.left_out_px.tolist(),
                self.scatter_px.tolist(),
                np.linalg.norm(self.off[:, :3], axis=1).tolist(),
                np.degrees(np.linalg.norm(self.off[:, 3:], axis=1)).tolist(),
                strict=True,
            )
        ]
