"""Products of the blocks of candidates, for whole pools at once."""

from __future__ import annotations

import numpy as np

from calib.se3 import FloatArray
from posedesign.selection.candidates import Candidates


def products_by_pairs(
    candidates: Candidates, P: FloatArray, Q: FloatArray | None = None
) -> FloatArray:
    """``trace(J_i P J_jᵀ J_j Q J_iᵀ)`` of all pairs of candidates ``(n, n)``; Q is P by default.

    ``P``, ``Q`` (p, p): positive semidefinite.
    """
    by_row = np.moveaxis(candidates.J, 1, 0)  # (m, n, p)
    first = by_row @ root_of(P)
    second = first if Q is None else by_row @ root_of(Q)
    total = np.zeros((candidates.N, candidates.N))
    for a in range(candidates.m):
        for b in range(a, candidates.m):
            products = first[a] @ first[b].T
            products *= products if Q is None else second[a] @ second[b].T
            total += products
            if b > a:  # rows a of i with b of j, and the other way round
                total += products.T
    return total


def root_of(P: FloatArray) -> FloatArray:
    """A root ``(p, p)`` of a positive semidefinite matrix, what is below zero cut off."""
    values, vectors = np.linalg.eigh(P)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
