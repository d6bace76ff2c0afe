"""How good a set of measuring poses is, as numbers: pure functions of the regressor.

Every function takes the regressor ``G`` either stacked ``(M, p)`` or as blocks ``(N, m, p)``. None
of them sees a robot. A regressor that cannot identify all its parameters gives infinity (condition
numbers, A) or zero (O1 to O5, D, E), never a warning.

Which number is meant, and on which scaling
-------------------------------------------
* ``condition_inf`` is C_G of Watanabe et al. 2006 (Eq. 9 to 12): columns divided by their largest
  absolute entry, row-sum norms of GᵀG and of its inverse.
* ``condition_2`` is the ratio of extreme singular values of G, columns of unit length by default.
  That of GᵀG is its square. C_G is never below cond_2 of the same scaled GᵀG.
* O1 to O5, D, A and E depend on the units of rows and columns. :func:`evaluate` takes rows divided
  by the noise and columns per mrad and per mm.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.se3 import FloatArray, numbers

NOTHING = 1e-13
"""Part of the largest entry of G below which a column is rounding of zero. Scaled up, it would
pass for a column of random numbers, and for a parameter that can be seen."""

PER_MRAD_AND_MM = 1e-3
"""Column scale from SI: at a metre or two of reach, 1 mrad and 1 mm move the tool about alike."""

SCALING = {
    "c_g": "rows in m, columns over their largest entry (Eq. 12)",
    "cond_2_g": "rows in m, columns of unit length",
    "cond_2_gtg": "rows in m, columns of unit length",
    **dict.fromkeys(
        ("o1", "o2", "o3", "o4", "o5", "d", "a", "e"), "rows over noise, columns per mrad and mm"
    ),
}
"""In words, the scaling of each index of :class:`Indices`."""

SCALING_OF_POSES = SCALING | {
    "c_g": "rows over noise, columns over their largest entry",
    "cond_2_g": "rows over noise, columns of unit length",
    "cond_2_gtg": "rows over noise, columns of unit length",
}
"""The same where rows are lengths and angles, which have only the noise to be compared by."""


SCALING_WITH_LENS = SCALING_OF_POSES | {
    key: f"{SCALING_OF_POSES[key]}, the lens marginalised"
    for key in ("c_g", "cond_2_g", "cond_2_gtg")
}
"""The same where the values of a lens are estimated with them."""


def stack(G: ArrayLike) -> FloatArray:
    """The regressor as ``(M, p)``, from blocks ``(N, m, p)`` or as it is.

    Raises InputError: neither shape, or numbers that are not finite.
    """
    matrix = numbers(G, "G")
    if matrix.ndim == 3:
        matrix = matrix.reshape(-1, matrix.shape[-1])
    if matrix.ndim != 2 or matrix.shape[1] == 0:
        raise InputError(f"a regressor has shape (M, p) or (N, m, p), not {np.shape(G)}", name="G")
    if not np.isfinite(matrix).all():
        raise InputError("the regressor contains numbers that are not finite", name="G")
    return matrix


def scale_by_largest(G: ArrayLike) -> FloatArray:
    """G' of Eq. 12: each column divided by its largest absolute entry; columns of zeros stay."""
    matrix = stack(G)
    return _divide(matrix, np.abs(matrix).max(axis=0, initial=0.0))


def scale_to_unit_length(G: ArrayLike) -> FloatArray:
    """G with each column divided by its Euclidean length; columns of zeros stay."""
    matrix = stack(G)
    return _divide(matrix, np.linalg.norm(matrix, axis=0))


def _divide(matrix: FloatArray, size: FloatArray) -> FloatArray:
    seen = size > NOTHING * size.max(initial=0.0)
    return np.where(seen, matrix / np.where(seen, size, 1.0), 0.0)


def condition_inf(G: ArrayLike) -> float:
    """C_G of Watanabe et al. 2006: ``||H|| ||H⁻¹||``, ``H = G'ᵀG'``.

    Eq. 9 to 12 as printed: G' has its columns divided by their largest absolute entry, and the
    norm is the largest absolute row sum.
    """
    scaled = scale_by_largest(G)
    values = singular_values(scaled)
    if values[-1] == 0.0:
        return float("inf")
    H = scaled.T @ scaled
    # from the singular values: inverting H itself would square the condition a second time
    Vt = np.linalg.svd(scaled, full_matrices=False)[2]
    H_inverse = (Vt.T / values**2) @ Vt
    return float(np.abs(H).sum(axis=1).max() * np.abs(H_inverse).sum(axis=1).max())


def condition_2(G: ArrayLike, scaling: str = "unit") -> float:
    """Ratio of the largest to the smallest singular value of G.

    ``G`` (M, p). ``scaling``: columns of unit length, divided by their largest entry (as C_G), or
    as they are.
    """
    values = singular_values(G, scaling)
    return float(values[0] / values[-1]) if values[-1] > 0 else float("inf")


def singular_values(G: ArrayLike, scaling: str = "none") -> FloatArray:
    """Singular values ``(p,)`` of the scaled regressor, the largest first.

    Zero where they are no more than rounding: a parameter that cannot be seen must not look as if
    it were seen poorly.
    """
    scalers = {"unit": scale_to_unit_length, "largest": scale_by_largest, "none": stack}
    if scaling not in scalers:
        raise InputError(f"unknown scaling {scaling!r}", hint="one of " + ", ".join(scalers))
    matrix = scalers[scaling](G)
    values = np.linalg.svd(matrix, compute_uv=False)
    values[values < max(matrix.shape) * np.finfo(float).eps * values.max(initial=0.0)] = 0.0
    return np.pad(values, (0, matrix.shape[1] - len(values)))


def o1(G: ArrayLike, poses: int | None = None) -> float:
    """O1 of Borm and Menq 1991: geometric mean of the p singular values over √(number of poses).

    The root is over the number of parameters, not of poses.

    ``G`` (M, p). ``poses``: number of poses; N where blocks are given, else the number of rows.
    """
    values = singular_values(G)
    shape = np.shape(G)
    count = poses if poses is not None else shape[0]
    if values[-1] <= 0:
        return 0.0
    return float(np.exp(np.mean(np.log(values))) / np.sqrt(count))


def o2(G: ArrayLike) -> float:
    """O2 of Driels and Pathre 1990: smallest over largest singular value."""
    values = singular_values(G)
    return float(values[-1] / values[0]) if values[0] > 0 else 0.0


def o3(G: ArrayLike) -> float:
    """O3 of Nahvi, Hollerbach and Hayward 1994: the smallest singular value."""
    return float(singular_values(G)[-1])


def o4(G: ArrayLike) -> float:
    """O4, the noise amplification index of Nahvi and Hollerbach 1996: ``s_min² / s_max``."""
    values = singular_values(G)
    return float(values[-1] ** 2 / values[0]) if values[0] > 0 else 0.0


def o5(G: ArrayLike) -> float:
    """O5 of Sun and Hollerbach 2008: ``1 / sum(1 / s_i)``."""
    values = singular_values(G)
    return float(1.0 / np.sum(1.0 / values)) if values[-1] > 0 else 0.0


def d_optimality(G: ArrayLike) -> float:
    """``det(GᵀG)^(1/p)``: the larger the smaller the volume of the confidence ellipsoid."""
    values = singular_values(G)
    return float(np.exp(2.0 * np.mean(np.log(values)))) if values[-1] > 0 else 0.0


def a_optimality(G: ArrayLike) -> float:
    """``trace((GᵀG)⁻¹)``: the sum of the variances, the smaller the better."""
    values = singular_values(G)
    return float(np.sum(values**-2.0)) if values[-1] > 0 else float("inf")


def e_optimality(G: ArrayLike) -> float:
    """Smallest eigenvalue of GᵀG: the larger the shorter the longest axis of the ellipsoid."""
    return float(singular_values(G)[-1] ** 2)


@dataclass(frozen=True)
class Indices:
    """All indices of one set of poses.

    ``c_g``: C_G; rows unweighted, columns divided by their largest entry. ``cond_2_g``,
    ``cond_2_gtg``: rows unweighted, columns of unit length. ``o1``, ``o2``, ``o3``, ``o4``, ``o5``,
    ``d``, ``a``, ``e``: rows divided by the noise, columns per mrad and per mm.
    """

    poses: int
    rows: int
    parameters: int
    c_g: float
    cond_2_g: float
    cond_2_gtg: float
    o1: float
    o2: float
    o3: float
    o4: float
    o5: float
    d: float
    a: float
    e: float

    def as_dict(self) -> dict[str, float]:
        return {field.name: getattr(self, field.name) for field in fields(self)}


def evaluate(blocks: FloatArray, white: FloatArray) -> Indices:
    """All indices of a set of poses.

    ``blocks`` (N, m, p): jacobian of the measurements [m per rad, m per m]. ``white`` (N, m, p):
    the same divided by the noise.
    """
    scaled = PER_MRAD_AND_MM * white
    cond = condition_2(blocks)
    counts = len(blocks), len(stack(blocks)), white.shape[-1]
    of_scaled = (o1, o2, o3, o4, o5, d_optimality, a_optimality, e_optimality)
    found = [index(scaled) for index in of_scaled]
    return Indices(*counts, condition_inf(blocks), cond, cond**2, *found)
