"""What planning gives: the poses, how they came about, and how good they are."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from hashlib import sha256

import numpy as np

from calib.model import CalibrationModel, Setup
from calib.model.parameters import Unit
from calib.se3 import FloatArray
from calib.shown import Shown
from posedesign.files.csv_tables import DECIMALS
from posedesign.files.postures import joint_columns
from posedesign.motion.route import Route
from posedesign.selection import Indices


class PoseStatus(StrEnum):
    """Where a pose comes from."""

    GRID = "grid"
    CHOSEN = "chosen"
    REPAIRED = "repaired"
    DROPPED = "dropped"
    VIA = "via"


class StopReason(StrEnum):
    """Why the loop ended."""

    THRESHOLD = "threshold reached"
    NO_IMPROVEMENT = "no further improvement"
    VARIATION_LIMIT = "variation limit"
    INFEASIBLE = "infeasible"


@dataclass(frozen=True, eq=False)
class PoseSet:
    """The 27 poses of one round, taken, repaired or dropped."""

    postures: FloatArray  # (27, n) [rad]; NaN where the pose was dropped
    status: tuple[PoseStatus, ...]
    shut_out: tuple[str, ...]
    """What keeps a pose of the grid from being taken as it is; empty where it can be."""
    orientations: FloatArray  # (27, 3, 3): ``R_base_tip`` that the grid asks for
    turned: FloatArray
    """(27,): angle of a replacement against the pose of the grid [rad]; NaN for all others."""
    searched: bool = False  # whether replacements were looked for
    letter: str = "P"  # that names begin with
    first: int = 1  # number of the first pose
    labels: tuple[Mapping[str, str], ...] = ()
    """What each pose is of, by column of a list of poses: target, tool, payload; none where all are
    of one."""

    @classmethod
    def of_grid(
        cls, postures: FloatArray, shut_out: tuple[str, ...], orientations: FloatArray
    ) -> PoseSet:
        """Poses of the grid, dropped where something shuts them out."""
        status = tuple(PoseStatus.DROPPED if why else PoseStatus.GRID for why in shut_out)
        return cls(postures, status, shut_out, orientations, np.full(len(status), np.nan))

    @classmethod
    def of_chosen(
        cls,
        postures: FloatArray,
        orientations: FloatArray,
        labels: Sequence[Mapping[str, str]] = (),
    ) -> PoseSet:
        """Poses that were chosen out of a pool."""
        count = len(postures)
        status, turned = (PoseStatus.CHOSEN,) * count, np.full(count, np.nan)
        return cls(postures, status, ("",) * count, orientations, turned, labels=tuple(labels))

    def and_dropped(self, reasons: Sequence[str]) -> PoseSet:
        """The set with poses behind it that were asked for and cannot be had, each for a reason."""
        count, n = len(reasons), self.postures.shape[1]
        return replace(
            self,
            postures=np.concatenate([self.postures, np.full((count, n), np.nan)]),
            status=(*self.status, *[PoseStatus.DROPPED] * count),
            shut_out=(*self.shut_out, *reasons),
            orientations=np.concatenate([self.orientations, np.full((count, 3, 3), np.nan)]),
            turned=np.append(self.turned, np.full(count, np.nan)),
            labels=(*self.labels, *({},) * count) if self.labels else (),
        )

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why each pose is not that of the grid, in words; empty where it is."""
        lost = "; nothing that keeps all constraints is left to take its place" * self.searched
        endings = [
            {
                PoseStatus.REPAIRED: f"; replaced by a pose turned by {angle:.0f} deg",
                PoseStatus.DROPPED: lost,
            }.get(status, "")
            for status, angle in zip(self.status, np.rad2deg(self.turned), strict=True)
        ]
        return tuple(why + ending for why, ending in zip(self.shut_out, endings, strict=True))

    @property
    def dropped(self) -> tuple[str, ...]:
        """Why poses were dropped, one reason each."""
        pairs = zip(self.reasons, self.status, strict=True)
        return tuple(why for why, status in pairs if status is PoseStatus.DROPPED)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"{self.letter}{self.first + i:02d}" for i in range(len(self.status)))

    @property
    def kept(self) -> FloatArray:
        """Postures ``(N, n)`` [rad] that are measured."""
        return self.postures[np.isfinite(self.postures).all(axis=1)]

    @property
    def kept_names(self) -> tuple[str, ...]:
        """Names of the poses that are measured, in the order of ``kept``."""
        pairs = zip(self.names, self.status, strict=True)
        return tuple(name for name, status in pairs if status is not PoseStatus.DROPPED)

    @property
    def kept_labels(self) -> list[Mapping[str, str]]:
        """What the poses that are measured are of, in the order of ``kept``."""
        labels = self.labels or ({},) * len(self.status)
        pairs = zip(labels, self.status, strict=True)
        return [given for given, status in pairs if status is not PoseStatus.DROPPED]

    def count(self, status: PoseStatus) -> int:
        return self.status.count(status)

    def without(self, lost: Mapping[int, str]) -> PoseSet:
        """The set with some poses dropped, by index, each for a reason."""
        postures, turned = self.postures.copy(), self.turned.copy()
        status, shut_out = list(self.status), list(self.shut_out)
        for i, why in lost.items():
            if status[i] is PoseStatus.REPAIRED:  # why it was needed, and why the last one failed
                why = f"{shut_out[i].split('; its ')[0]}; its replacement: {why}"
            postures[i], turned[i] = np.nan, np.nan
            status[i] = PoseStatus.DROPPED
            shut_out[i] = why
        return replace(
            self, postures=postures, status=tuple(status), shut_out=tuple(shut_out), turned=turned
        )


@dataclass(frozen=True, eq=False)
class Round:
    """One turn of the loop."""

    number: int
    variation_deg: tuple[float, float, float]  # D_W, D_P, D_R
    grid: int
    repaired: int
    dropped: int  # grid, repaired, dropped: poses taken as generated, replaced, and left out
    c_g: float
    cond_2_g: float
    sigma: FloatArray
    """(p,): predicted standard deviation of each parameter [SI], of the estimator that the cell
    asks for (weighted or not); infinite where not identifiable."""


class Planned(Shown):
    """Poses and the route through them; None where there is none.

    ``setup``: what is measured at ``postures``; None where each is of the first of everything.
    """

    poses: PoseSet
    route: Route | None
    setup: Setup | None
    model: CalibrationModel

    @property
    @abstractmethod
    def message(self) -> str:
        """The outcome in a sentence."""

    @property
    def headline(self) -> str:
        return self.message

    def rows(self) -> list[dict[str, object]]:
        """The stops in their order: name, whether passed through only, joints [deg, mm]."""
        robot = self.model.robot
        columns = joint_columns(robot.n, robot.external)
        return [
            {"name": name, "via": via} | dict(zip(columns, robot.shown(q).tolist(), strict=True))
            for name, q, via in self.stops
        ]

    @property
    def postures(self) -> FloatArray:
        """Postures ``(N, n)`` [rad] to measure at, in the order of the route."""
        order = slice(None) if self.route is None else self.route.order
        return np.asarray(self.poses.kept[order])

    @property
    def labels(self) -> list[Mapping[str, str]]:
        """What the poses of ``postures`` are of, by column of a list of poses."""
        kept = self.poses.kept_labels
        return kept if self.route is None else [kept[i] for i in self.route.order]

    @property
    def stops(self) -> list[tuple[str, FloatArray, bool]]:
        """Name, posture ``(n,)`` [rad], and whether it is passed only, of every stop in order."""
        return [] if self.route is None else named_stops(self.poses, self.route)

    @property
    def fingerprint(self) -> str:
        """Short digest of the postures: programs and results carry it, so that none is mixed up."""
        return fingerprint(self.postures)


@dataclass(frozen=True, eq=False, repr=False)
class PosePlan(Planned):
    """A set of measuring poses with its history.

    ``poses``: those of the best round. ``route``: the order of the kept poses, by index into
    ``poses.kept``, and what lies between them. ``best``: index into ``rounds`` of the round that
    the poses are from. ``history``: the poses of every round. ``model``: what the plan was made
    for. ``threshold``: C_G asked for. ``advice``: what to change where the threshold was not
    reached. ``not_checked``: what planning did not look at (:attr:`.Cell.not_checked`).
    """

    poses: PoseSet
    route: Route
    best: int
    rounds: tuple[Round, ...]
    history: tuple[PoseSet, ...]
    indices: Indices
    model: CalibrationModel
    threshold: float
    stop: StopReason
    advice: str
    not_checked: tuple[str, ...] = ()
    setup: Setup | None = None

    @property
    def reached(self) -> bool:
        """Return True if C_G is below the threshold with all poses of the grid, none dropped."""
        return self.stop is StopReason.THRESHOLD and not self.rounds[self.best].dropped

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.poses.kept_names[i] for i in self.route.order)

    @property
    def cycle_time_s(self) -> float:
        """Predicted time of the round [s], from the base posture on; NaN without joint speeds."""
        return self.route.cycle_time_s

    @property
    def verdict(self) -> str:
        """Whether the threshold was reached, by which poses."""
        best = self.rounds[self.best]
        angles = "/".join(f"{d:g}" for d in best.variation_deg)
        return (
            f"{self.stop}: C_G {best.c_g:.4g} (asked for {self.threshold:.4g}) with "
            f"{len(self.postures)} poses at D_W/D_P/D_R {angles} deg"
            + f" ({best.dropped} of {len(self.poses.names)} dropped)" * bool(best.dropped)
            + f", {self.route.detours} posture(s) passed through on the way"
            * bool(self.route.detours)
            + f"; {self.advice}" * bool(self.advice)
        )

    @property
    def message(self) -> str:
        return self.verdict + not_checked_words(self.not_checked)

    def round_rows(self) -> list[dict[str, object]]:
        """The rounds as table rows, with why poses are not those of the grid."""
        rows = []
        for turn, poses in zip(self.rounds, self.history, strict=True):
            row: dict[str, object] = {
                "round": turn.number,
                **dict(zip(("d_w_deg", "d_p_deg", "d_r_deg"), turn.variation_deg, strict=True)),
                "grid": turn.grid,
                "repaired": turn.repaired,
                "dropped": turn.dropped,
                "c_g": turn.c_g,
                "cond_2_g": turn.cond_2_g,
            }
            for name, unit, value in displayed(self.model, turn.sigma):
                row[f"sigma_{name}_{unit}"] = value
            reasons = zip(poses.names, poses.reasons, strict=True)
            row["reasons"] = " | ".join(f"{name}: {why}" for name, why in reasons if why)
            rows.append(row)
        return rows

    def sigma_displayed(self) -> list[tuple[str, str, float]]:
        """Name, unit and predicted standard deviation of each parameter as people read them."""
        return displayed(self.model, self.rounds[self.best].sigma)


def named_stops(poses: PoseSet, route: Route) -> list[tuple[str, FloatArray, bool]]:
    """Name, posture ``(n,)`` [rad], and whether it is passed only, of each stop of a route.

    Stops that are only passed are V01, V02, ...
    """
    names = poses.kept_names
    found: list[tuple[str, FloatArray, bool]] = []
    for stop in route.stops:
        passed = sum(via for _, _, via in found)
        name = f"V{passed + 1:02d}" if stop.pose is None else names[stop.pose]
        found.append((name, stop.posture, stop.pose is None))
    return found


def not_checked_words(not_checked: Sequence[str]) -> str:
    """The end of a verdict that says what was not looked at; empty where all was."""
    return f"; NOT CHECKED: {'; '.join(not_checked)}" if not_checked else ""


def displayed(model: CalibrationModel, values: FloatArray) -> list[tuple[str, str, float]]:
    """Name, unit and value in deg or mm of parameters or deviations ``(p,)`` [SI]."""
    from calib.identification import DISPLAY

    units: tuple[Unit, ...] = model.units
    return [
        (name, DISPLAY[unit][0], float(value * DISPLAY[unit][1]))
        for name, unit, value in zip(model.names, units, values, strict=True)
    ]


def fingerprint(postures: FloatArray) -> str:
    """Eight hex digits of postures ``(N, n)`` [rad], the same after a round trip through a file.

    Slides [m] are rounded as if they were in radians, to 1.7 micrometres: a list does not say how
    many there are.
    """
    # as a file has them first: a value on the edge of a step would fall to the other side of it
    written = np.round(np.rad2deg(postures), DECIMALS)
    degrees = np.round(written, 4) + 0.0
    return sha256(np.ascontiguousarray(degrees).tobytes()).hexdigest()[:8]
