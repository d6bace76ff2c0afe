"""Frames of a network with their joint covariance, and what the pairs do not tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.judgement import Finding
from calib.robot_world.network.graph import Network
from calib.se3 import BoolArray, FloatArray
from calib.shown import Shown


@dataclass(frozen=True, eq=False, repr=False)
class NetworkResult(Shown):
    """Frames of a network with their joint covariance."""

    network: Network
    T: FloatArray
    """(F, 4, 4): of each of :attr:`names` [m]: ``T_flange_k`` of what is on a flange, ``T_base_l``
    of what is around, in the base of the first arm of its part, and ``T_base_j`` of the base of an
    arm there."""
    covariance: FloatArray
    """(6 F, 6 F): of the errors (w, v) of each frame [rad, m], a rotation from the left and a
    translation, in the axes of its parent."""
    used: BoolArray  # (N,): pairs that the estimate rests on
    residuals: FloatArray  # (N, 6): rotation vector [rad] and translation [m] of A X less Z B
    sigma: FloatArray
    """(E, 2): noise of B of each edge [rad, m]; NaN where a noise was given."""
    chi2: float  # sum of the squares of the white rows of the pairs used
    untold: FloatArray
    """(q, 6 F): directions of the errors of all frames that neither pairs nor priors tell, in
    radians and in :attr:`size_m`. The covariance has nothing of them."""
    size_m: float  # how far the arm moves, root mean square
    findings: tuple[Finding, ...] = ()  # what looks wrong

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the frames."""
        return self.network.frames

    @property
    def headline(self) -> str:
        net = self.network
        return (
            f"{len(net.on_flange)} on flanges, {len(net.around)} around, {len(net.arms)} arms from "
            f"{int(self.used.sum())} of {net.N} pairs"
        )

    def __getitem__(self, name: str) -> FloatArray:
        """Transform ``(4, 4)`` of a frame by its name."""
        return np.asarray(self.T[self._at(name)])

    @property
    def not_told(self) -> tuple[str, ...]:
        """Directions that neither pairs nor priors tell, in words."""
        return tuple(self._words_of(direction) for direction in self.untold)

    def is_told(self, name: str) -> bool:
        """Return True if all six numbers of a frame are told."""
        own = self.untold[:, 6 * self._at(name) : 6 * self._at(name) + 6]
        return bool((np.abs(own) < _SMALL).all())

    def _words_of(self, direction: FloatArray) -> str:
        """Name a direction by the frames that it moves: first how they turn, else how they shift.

        A turn about a far point shifts, too: it is the turn that is named.
        """
        moved = direction.reshape(-1, 6)
        turned = np.linalg.norm(moved[:, :3], axis=1) > _SMALL
        if turned.any():
            parts = [
                f"the turn of {name} about {axis_words(row[:3])} of its {self._parent_word(name)}"
                for name, row, is_turned in zip(self.names, moved, turned, strict=True)
                if is_turned
            ]
        else:
            parts = [
                f"the place of {name} along {axis_words(row[3:])} of its {self._parent_word(name)}"
                for name, row in zip(self.names, moved, strict=True)
                if np.linalg.norm(row[3:]) > _SMALL
            ]
        return parts[0] if len(parts) == 1 else f"{', and as much '.join(parts)}"

    def _parent_word(self, name: str) -> str:
        return self.parent_of(name).split(" ", maxsplit=1)[0]

    def covariance_of(self, name: str) -> FloatArray:
        """Covariance ``(6, 6)`` of the errors (w, v) of a frame."""
        own = 6 * self._at(name)
        return np.asarray(self.covariance[own : own + 6, own : own + 6])

    def sigma_of(self, name: str) -> tuple[float, float]:
        """Standard deviations of a frame, root of the sum over three axes [rad, m]."""
        square = np.diag(self.covariance_of(name))
        return float(np.sqrt(square[:3].sum())), float(np.sqrt(square[3:].sum()))

    @property
    def is_ok(self) -> bool:
        """Return True if all is told, and no finding changes a frame by more than it is known."""
        return not len(self.untold) and all(
            one.grade != "not to be trusted" for one in self.findings
        )

    def rows(self) -> list[dict[str, object]]:
        """One row a frame."""
        net = self.network
        found: list[dict[str, object]] = []
        for name, T in zip(self.names, self.T, strict=True):
            turn, place = self.sigma_of(name)
            found.append(
                {
                    "frame": name,
                    "parent": self.parent_of(name),
                    "pairs": int(self.used[net.pairs_of(name)].sum()),
                    **dict(zip(("x_mm", "y_mm", "z_mm"), (1e3 * T[:3, 3]).tolist(), strict=True)),
                    "told": "yes" if self.is_told(name) else "in part",
                    "sigma_mm": 1e3 * place,
                    "sigma_deg": float(np.degrees(turn)),
                }
            )
        return found

    def parent_of(self, name: str) -> str:
        """``flange``, or the base that the frame ``name`` is given in, by its arm if several."""
        net = self.network
        if name in net.on_flange:
            return "flange"
        first = net.j[net.pairs_of(name)[0]]
        return "base" if len(net.arms) == 1 else f"base of {net.arms[net.reference[first]]}"

    def _at(self, name: str) -> int:
        self.network.pairs_of(name)
        return self.names.index(name)


_SMALL = 0.05
"""Part of a direction, of length one, from which on a frame takes part in it."""


def axis_words(direction: FloatArray) -> str:
    """Return a direction ``(3,)`` in words: an axis where it is along one, else its numbers."""
    unit = direction / np.linalg.norm(direction)
    at = int(np.argmax(np.abs(unit)))
    if abs(unit[at]) > _ALONG:
        return "xyz"[at]
    return "(" + ", ".join(f"{value:.2f}" for value in unit * np.sign(unit[at]) + 0.0) + ")"


_ALONG = np.cos(np.radians(2.0))
"""Cosine of the angle up to which a direction is called that of an axis."""
