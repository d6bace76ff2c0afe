"""Small semidefinite problems by Newton's method on a logarithmic barrier."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calib.se3 import FloatArray

_WEIGHT_STEP = 8.0
"""Factor by which the weight of the barrier falls whenever its minimum is near."""

_NEAR = 0.5
"""Newton decrement at which the minimum of the barrier is near: below 1, full steps stay inside."""

_STEP_LIMIT = 300
"""Newton steps; some 20 to 60 are usual."""


def minimise_first(
    constant: FloatArray,
    moves: FloatArray,
    start: FloatArray,
    accuracy: float,
    enough: Callable[[FloatArray], bool] = lambda x: False,
) -> FloatArray:
    """Minimise x_0 while ``constant + Σ x_i move_i`` stays positive definite.

    Follows the minima of ``x_0 / weight - log det`` as the weight falls. At such a minimum, x_0 is
    above the least possible by less than the size of the matrix times the weight.

    Parameters
    ----------
    constant, moves : ndarray (m, m), (n, m, m)
        Symmetric matrices; the first move increases the matrix.
    start : ndarray (n,)
        Where the matrix is positive definite; where it is not, there is nothing to follow and the
        start comes back.
    accuracy : float
        Of x_0.
    enough : callable, optional
        Says of x ``(n,)`` that it will do.

    Returns
    -------
    ndarray (n,)
        The last x.
    """
    size, n = len(constant), len(moves)
    x = start
    if not _is_inside(constant + np.tensordot(x, moves, axes=1)):
        return x
    weight = 0.0
    for _ in range(_STEP_LIMIT):
        matrix = constant + np.tensordot(x, moves, axes=1)
        products = np.linalg.solve(matrix, moves)
        trace = np.trace(products, axis1=1, axis2=2)
        # first the weight for which x_0 is already right
        weight = weight or 1.0 / float(trace[0])
        gradient = -trace
        gradient[0] += 1.0 / weight
        hessian = products.reshape(n, -1) @ np.swapaxes(products, 1, 2).reshape(n, -1).T
        step = -np.linalg.lstsq(hessian, gradient, rcond=None)[0]
        decrement = float(np.sqrt(max(-gradient @ step, 0.0)))
        # the barrier is self-concordant: steps so damped stay inside
        new = x + step / (1.0 + decrement if decrement > _NEAR else 1.0)
        if not _is_inside(constant + np.tensordot(new, moves, axes=1)):
            break  # rounding has taken over
        x = new
        if enough(x) or (decrement <= _NEAR and size * weight < accuracy):
            break
        if decrement <= _NEAR:
            weight /= _WEIGHT_STEP
    return x


def _is_inside(matrix: FloatArray) -> bool:
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True
