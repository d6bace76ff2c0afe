"""A list of poses as it stands in a file, with all that belongs to each of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from calib.se3 import BoolArray, FloatArray
from posedesign.motion.route import Route
from posedesign.planning.pose_plan import PoseSet, PoseStatus, fingerprint, named_stops

NOT_CHECKED = "not checked"
"""Begins the comments of a list that say what planning did not look at, one a comment."""

STOPS_SHORT = "stop short [mm]"
"""Begins the comment of a list that says how far before its poses programs are to stop."""

ALL_CHECKED = "nothing that the cell asks for"
"""Said in their place where there are none, so that a list without any is one that nobody knows."""


@dataclass(frozen=True)
class DroppedPose:
    """A pose without numbers: one that cannot be taken.

    ``extra``: what stands in columns that posedesign does not know.
    """

    name: str
    reason: str
    extra: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class PoseList:
    """Poses in the order in which they are visited.

    ``postures`` (N, n): [rad], URDF signs. ``via`` (N,): postures that the arm passes through
    without measuring. ``status``, ``reasons``: as in ``poses.csv``, one each; none at all for a
    list that was not read from a file. ``extra``: by name of the column, the N cells of columns
    that posedesign does not know. ``dropped``: poses that the list names, and that are not visited.
    ``comments``: lines before the header of the table, without #.
    """

    names: tuple[str, ...]
    postures: FloatArray
    via: BoolArray
    status: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()
    extra: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    dropped: tuple[DroppedPose, ...] = ()
    comments: tuple[str, ...] = ()

    @classmethod
    def of_route(cls, poses: PoseSet, route: Route) -> PoseList:
        """The stops of a route through the kept poses; the others of the set are dropped."""
        reasons = dict(zip(poses.names, poses.reasons, strict=True))
        states = dict(zip(poses.names, poses.status, strict=True))
        stops = named_stops(poses, route)
        passing = [str(stop.passing) for stop in route.stops]
        visited = {name for name, _, via in stops if not via}
        return cls(
            names=tuple(name for name, _, _ in stops),
            postures=np.reshape(
                [posture for _, posture, _ in stops], (-1, poses.postures.shape[1])
            ),
            via=np.array([via for _, _, via in stops], dtype=bool),
            status=tuple(str(PoseStatus.VIA if via else states[name]) for name, _, via in stops),
            reasons=tuple(
                why if via else reasons[name]
                for (name, _, via), why in zip(stops, passing, strict=True)
            ),
            dropped=tuple(
                DroppedPose(name, reasons[name]) for name in poses.names if name not in visited
            ),
        )

    @property
    def measured(self) -> PoseList:
        """The poses that are measured."""
        kept = np.flatnonzero(~self.via).tolist()
        return replace(
            self,
            names=tuple(self.names[i] for i in kept),
            postures=self.postures[kept],
            via=self.via[kept],
            status=tuple(self.status[i] for i in kept) if self.status else (),
            reasons=tuple(self.reasons[i] for i in kept) if self.reasons else (),
            extra={c: tuple(cells[i] for i in kept) for c, cells in self.extra.items()},
        )

    @property
    def header(self) -> dict[str, str]:
        """What the comments say by name: ``fingerprint``, ``c_g``, ..."""
        found: dict[str, str] = {}
        for comment in self.comments:
            name, colon, value = comment.partition(":")
            if colon:
                found.setdefault(name.strip(), value.strip())
        return found

    @property
    def not_checked(self) -> tuple[str, ...]:
        """What planning did not look at, as the comments say; nothing that they say is nothing."""
        pairs = (comment.partition(":") for comment in self.comments)
        said = tuple(value.strip() for key, _, value in pairs if key.strip() == NOT_CHECKED)
        if not said:
            return ("anything: the list of poses does not say what was",)
        if self.fingerprint_written not in ("", self.fingerprint):
            return ("anything: the list was changed after planning",)
        return said

    @property
    def fingerprint(self) -> str:
        """Short digest of the measured postures as they are, see :func:`.pose_plan.fingerprint`."""
        return fingerprint(self.postures[~self.via])

    @property
    def fingerprint_written(self) -> str:
        """The fingerprint that the file gives; empty where it gives none.

        Where it is another than :attr:`fingerprint`, the postures were changed after planning, and
        the indices beside it are not theirs.
        """
        return self.header.get("fingerprint", "")

    @property
    def misfit(self) -> str:
        """That the fingerprint is not that of the postures, in words; empty where it is."""
        if self.fingerprint_written in ("", self.fingerprint):
            return ""
        return (
            f"the postures are others than those that were planned ({self.fingerprint}, not "
            f"{self.fingerprint_written}): what stands before the header is not of them"
        )
