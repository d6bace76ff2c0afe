"""Hand-eye calibration by modified Rodrigues vectors (Tsai and Lenz 1989).

With the vectors ``P = 2 sin(θ/2) n`` of the motions of flange and camera, one motion gives::

    [P_A + P_B]ₓ x = P_B - P_A,   x = tan(θ_X/2) n_X                    Eq. 12, 13

three linear equations in three unknowns, and the translation is linear after that (Eq. 15). All
motions weigh as the square of sin(θ/2): small ones hardly count.

x grows without bound as X approaches half a turn, so the method fails there, and next to it noise
is amplified; the answer depends on the axes of flange and camera. It is kept as published because
results are compared with it. The one repair is in the signs: near half a turn *between* poses,
noise can make the shorter way round opposite in A and B, so the signs are those that agree over
the whole set.
"""

from __future__ import annotations

import numpy as np

from calib import se3
from calib.robot_world.algebra import least_squares
from calib.robot_world.estimate import Estimate
from calib.robot_world.methods import relative_motions
from calib.robot_world.pairs import PairSets


def estimate(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once, the rotations first, from the motions of all pairs."""
    i, j = relative_motions.few_motions(np.concatenate(pairs.quaternions, axis=-1))
    rows = relative_motions.vector_rows(
        relative_motions.relative(i[:4], j[:4]), relative_motions.relative(i[4:], j[4:])
    ).reshape(pairs.T, -1, 4)
    ratio = least_squares(rows[..., 1:], -rows[..., 0])
    x = np.concatenate([np.ones((pairs.T, 1)), ratio], axis=-1)
    R_X = se3.rotation_from_quaternion(x)
    return relative_motions.complete(pairs, R_X)
