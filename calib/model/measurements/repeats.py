"""Which measurements repeat each other: what is left out together to judge a model."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from calib.se3 import FloatArray, IntArray

SAME_POSTURE_RAD = float(np.deg2rad(0.1))
"""Difference in every joint up to which two postures are one: touching a point again turns joints
by hundredths of a degree, and another posture of a plan by degrees."""


def repeated_together(pose: IntArray, postures: FloatArray) -> IntArray:
    """Groups ``(N,)``, counted from zero, of measurements of one pose or at one posture.

    Parameters
    ----------
    pose : array (N,)
        Index of the pose that each measurement belongs to.
    postures : array (N, n)
        [rad]
    """
    same = same_posture(postures)
    width = int(pose.max(initial=-1)) + 1
    link = coo_array(
        (np.ones(len(pose)), (pose, width + same)),
        shape=(width + int(same.max(initial=-1)) + 1,) * 2,
    )
    label = connected_components(link, directed=False)[1][pose]
    return np.asarray(np.unique(label, return_inverse=True)[1].ravel(), dtype=np.intp)


def same_posture(postures: FloatArray) -> IntArray:
    """Index ``(N,)`` of the posture that each one repeats within ``SAME_POSTURE_RAD``.

    All of a group are that close to one of them. They are not chained: an arm that is measured
    while it moves slowly would otherwise be in one posture all along.
    """
    distinct, back = np.unique(postures, axis=0, return_inverse=True)
    first = np.arange(len(distinct))
    if len(distinct) > 1:
        tree = KDTree(distinct)
        bound = SAME_POSTURE_RAD
        gap = tree.query(distinct, k=[2], p=np.inf, distance_upper_bound=bound)[0]
        free = np.isfinite(np.reshape(gap, -1))
        for i in np.flatnonzero(free).tolist():
            if free[i]:
                near = np.array(tree.query_ball_point(distinct[i], bound, p=np.inf))
                near = near[free[near]]
                first[near], free[near] = i, False
    return np.asarray(first[back.ravel()])
