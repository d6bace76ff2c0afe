"""The graph of a network: pairs between frames, and the parts that hang together."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from calib.errors import InputError
from calib.robot_world.pairs import checked_pairs
from calib.se3 import FloatArray, IntArray

REMEDY = "turn the flange about two axes while it is seen"
"""Remedy where the pairs do not tell a frame."""

_STILL_M = 1e-6

_Name = TypeVar("_Name", bound=Hashable)


@dataclass(frozen=True, eq=False)
class Network:
    """Pairs of a network, by the numbers of the frames that they are between."""

    A: FloatArray
    B: FloatArray  # A, B (N, 4, 4): measured transforms [m]
    on_flange: tuple[str, ...]  # names of what is on flanges
    around: tuple[str, ...]  # names of what stands around the arms
    arms: tuple[str, ...]
    k: IntArray
    l: IntArray  # noqa: E741
    j: IntArray  # k, l, j (N,): of each pair, what is on the flange, what is around, and the arm

    @classmethod
    def of(
        cls,
        A: ArrayLike,
        B: ArrayLike,
        on_flange: Sequence[str],
        around: Sequence[str],
        arms: Sequence[str] | None,
    ) -> Network:
        """Check pairs ``(N, 4, 4)`` and the names of each."""
        A, B = checked_pairs(A, B, dimensions=3)
        named = []
        for name, given in (
            ("on_flange", on_flange),
            ("around", around),
            ("arms", ["arm"] * len(A) if arms is None else arms),
        ):
            given = list(given)
            if len(given) != len(A):
                raise InputError(
                    f"{len(given)} names in {name} for {len(A)} pairs",
                    hint="give one for each pair",
                    name=name,
                    value=len(given),
                    bound=len(A),
                )
            named.append(_numbered(given))
        both = sorted(set(named[0][0]) & set(named[1][0]))
        if both:
            raise InputError(
                f"{both[0]} is on a flange in some pairs and stands around the arm in others",
                hint="give the two frames names of their own",
                name=both[0],
            )
        (X, k), (Z, l), (arm, j) = named  # noqa: E741
        return cls(A, B, tuple(X), tuple(Z), tuple(arm), k, l, j)

    @property
    def N(self) -> int:
        """Number of pairs."""
        return len(self.A)

    @cached_property
    def edges(self) -> IntArray:
        """Edge of each pair ``(N,)``: of the same things and the same arm."""
        return np.unique(np.stack([self.j, self.k, self.l]), axis=1, return_inverse=True)[1].ravel()

    def pairs_of(self, name: str) -> IntArray:
        """Numbers of the pairs that a frame takes part in."""
        for names, own in ((self.on_flange, self.k), (self.around, self.l), (self.arms, self.j)):
            if name in names:
                return np.flatnonzero(own == names.index(name))
        raise InputError(f"there is no frame {name}", hint=", ".join(self.frames), name=name)

    def name_of_edge(self, edge: int) -> str:
        """Name of an edge in words."""
        i = int(np.flatnonzero(self.edges == edge)[0])
        name = f"{self.on_flange[self.k[i]]} and {self.around[self.l[i]]}"
        return name if len(self.arms) == 1 else f"{name} by {self.arms[self.j[i]]}"

    @cached_property
    def size_m(self) -> float:
        """Motion of the arms [m], root mean square; of what is seen, where they only turn."""
        sizes = [float(np.sqrt((T[:, :3, 3].std(axis=0) ** 2).sum())) for T in (self.A, self.B)]
        return next((size for size in sizes if size > _STILL_M), 1.0)

    @cached_property
    def parts(self) -> IntArray:
        """Part of each arm ``(J,)``: arms that what stands around them joins are of one part."""
        J, L = len(self.arms), len(self.around)
        graph = sparse.coo_array((np.ones(self.N), (self.j, J + self.l)), shape=(J + L, J + L))
        return np.asarray(connected_components(graph, directed=False)[1][:J])

    @cached_property
    def reference(self) -> IntArray:
        """The first arm of the part of each arm ``(J,)``: its base is the frame of the part."""
        return np.array([int(np.argmax(self.parts == part)) for part in self.parts])

    @cached_property
    def placed_arms(self) -> tuple[int, ...]:
        """Arms whose bases are unknown."""
        return tuple(np.flatnonzero(self.reference != np.arange(len(self.arms))).tolist())

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the F unknown transforms: on flanges, around, then bases of arms."""
        return (*self.on_flange, *self.around, *(self.arms[j] for j in self.placed_arms))

    @cached_property
    def base_of(self) -> IntArray:
        """Column of the base of each arm ``(J,)`` among the frames; -1 where it is the frame."""
        first = len(self.on_flange) + len(self.around)
        column = np.full(len(self.arms), -1)
        column[list(self.placed_arms)] = first + np.arange(len(self.placed_arms))
        return column


def _numbered(names: Sequence[_Name]) -> tuple[list[_Name], IntArray]:
    """Different names in the order in which they come first, and the number of each."""
    found = {name: i for i, name in enumerate(dict.fromkeys(names))}
    return list(found), np.array([found[name] for name in names], dtype=np.intp)


def of_pairs(net: Network, T: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """X, Z and base V ``(N, 4, 4)`` of each pair; Z in the base of its arm."""
    K, L = len(net.on_flange), len(net.around)
    V = np.tile(np.eye(4), (net.N, 1, 1))
    base = net.base_of[net.j]
    V[base >= 0] = T[base[base >= 0]]
    return T[net.k], V @ T[K : K + L][net.l], V
