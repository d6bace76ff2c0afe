"""Distances between straight segments and rounded boxes, over arrays.

Signed: below zero is how far the two would have to be moved apart.
"""

from __future__ import annotations

import numpy as np

from calib.se3 import FloatArray

_TINY = 1e-300
"""Keeps a division by the squared length of a point finite; the result is then clipped."""


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("...k,...k->...", a, b))


def _share(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    """Quotient clipped to -1 to 1, the two ends of a segment."""
    return np.clip(numerator / np.maximum(denominator, _TINY), -1.0, 1.0)


def segment_segment(apart: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distance between the segments ``-a..a`` and ``apart - b..apart + b``.

    The square of the distance is convex in the places s, t on the two segments. The best s for
    the unclipped t is clipped, then the best t for that s, then the best s for that t: this ends
    at the minimum [Ericson2005]_, also for points and for parallel segments.

    Parameters
    ----------
    apart : array (..., 3)
        From the middle of the first to the middle of the second [m].
    a, b : array (..., 3)
        From the middle of each to its end [m].

    Returns
    -------
    array (...)
        [m]

    References
    ----------
    .. [Ericson2005] C. Ericson, Real-Time Collision Detection, Morgan Kaufmann 2005, section
       5.1.9.
    """
    aa, bb, ab = _dot(a, a), _dot(b, b), _dot(a, b)
    ca, cb = _dot(apart, a), _dot(apart, b)
    s = _share(ca * bb - ab * cb, aa * bb - ab * ab)
    t = _share(ab * s - cb, bb)
    s = _share(ca + ab * t, aa)
    gap = apart + t[..., None] * b - s[..., None] * a
    return np.sqrt(_dot(gap, gap))


def point_segment(apart: FloatArray, b: FloatArray) -> FloatArray:
    """Distance of the origin from the segment ``apart - b..apart + b``, arrays (..., 3) [m]."""
    gap = apart + _share(-_dot(apart, b), _dot(b, b))[..., None] * b
    return np.sqrt(_dot(gap, gap))


def box_box_bound(
    R_a_b: FloatArray, p_a_b: FloatArray, half_a: FloatArray, half_b: FloatArray
) -> FloatArray:
    """Lower bound of the signed distance of two boxes, better than that of their capsules.

    Each box is enclosed by one along the axes of the other, and the distance of those two boxes
    is exact: the gaps along the axes add up as a vector, or the widest of them separates.

    Parameters
    ----------
    R_a_b : array (M, 3, 3)
    p_a_b : array (M, 3)
        Centre of box b, in axes of box a, from its centre [m].
    half_a, half_b : array (M, 3)
        Half of the edges [m].

    Returns
    -------
    array (M,)
        [m]
    """
    turned = np.abs(R_a_b)
    p_b_a = (np.swapaxes(R_a_b, -1, -2) @ p_a_b[..., None])[..., 0]
    gaps_a = np.abs(p_a_b) - half_a - (turned @ half_b[..., None])[..., 0]
    gaps_b = np.abs(p_b_a) - half_b - (np.swapaxes(turned, -1, -2) @ half_a[..., None])[..., 0]
    return np.maximum(_apart(gaps_a), _apart(gaps_b))


def _apart(gaps: FloatArray) -> FloatArray:
    """Signed distance of two boxes with the same axes and these gaps along them (..., 3)."""
    outside = np.maximum(gaps, 0.0)
    widest = gaps.max(axis=-1)
    return np.where(widest > 0.0, np.sqrt(_dot(outside, outside)), widest)
