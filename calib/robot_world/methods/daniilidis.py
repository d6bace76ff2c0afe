"""Hand-eye calibration by dual quaternions (Daniilidis 1999).

With the dual quaternions ``p + ε p'`` and ``q + ε q'`` of the motions of flange and camera, whose
scalar parts are equal (the angle and the pitch of the screw), the vector parts of one motion give
six rows in the eight numbers of ``x + ε x'``::

    [ P - Q    [P + Q]ₓ      0       0     ]
    [ P' - Q'  [P' + Q']ₓ  P - Q  [P + Q]ₓ ]  (x, x') = 0               Eq. 31

The matrix of all motions has a null space of two dimensions, since (0, x) solves it as well; of
the plane of the last two singular vectors the answer is the point with ``x·x' = 0`` (Eq. 35).
Rows with and without a length are added unweighted, so the answer depends on the unit of length,
and on the axes of flange and camera, since the scalar parts are left out.
"""

from __future__ import annotations

import numpy as np

from calib.robot_world.algebra import dual_part, transform_in_plane, transforms, triangle
from calib.robot_world.estimate import Estimate
from calib.robot_world.methods.relative_motions import (
    complete,
    few_motions,
    relative,
    vector_rows,
)
from calib.robot_world.pairs import PairSets


def estimate(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once, rotation and translation of X together."""
    T = pairs.T
    a, b = pairs.quaternions
    a_dual, b_dual = dual_part(pairs.A[..., :3, 3], a), dual_part(pairs.B[..., :3, 3], b)
    i, j = few_motions(np.concatenate([a, a_dual, b, b_dual], axis=-1))
    p, q = relative(i[:4], j[:4]), relative(i[8:12], j[8:12])
    p_dual = relative(i[4:8], j[:4]) + relative(i[:4], j[4:8])
    q_dual = relative(i[12:], j[8:12]) + relative(i[8:12], j[12:])
    rows = np.zeros((T, i.shape[-1], 6, 8))
    rows[..., :3, :4] = rows[..., 3:, 4:] = vector_rows(p, q)
    rows[..., 3:, :4] = vector_rows(p_dual, q_dual)
    plane = np.asarray(np.linalg.svd(triangle(rows.reshape(T, -1, 8)))[2])[:, 6:]
    weights = transform_in_plane(plane[..., :4], plane[..., 4:])
    solution = (weights[:, None] @ plane)[:, 0]
    X = transforms(solution[:, :4], solution[:, 4:])
    return complete(pairs, X[:, :3, :3], X[:, :3, 3])
