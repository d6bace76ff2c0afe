"""T sets of N pose pairs A, B, and what the methods derive from them, each thing once."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from calib import se3
from calib.batch_last import columns_of, quaternions_of, turn_back
from calib.errors import InputError
from calib.robot_world import algebra, closed_form
from calib.se3 import BoolArray, FloatArray, IntArray

FEWEST_PAIRS = 3
"""Two rotations between poses are the fewest that can have two different axes."""


class PairSets:
    """Pairs of T problems ``A_i X = Z B_i``, all with N pairs.

    Parameters
    ----------
    A, B : ndarray (T, N, 4, 4)
        Rigid transforms with rotations orthonormal to rounding, in any unit of length.
    tentative : bool
        Whether a solution is one of many to be tried: no trouble is then taken where the closed
        form has none that is worth it.
    columns : (ndarray or None, ndarray or None)
        Columns ``(4, 4, S)`` of A and of B where they are there already.

    Notes
    -----
    What is done for each pair stands with the pair as the last index, S = T N of them, set after
    set: see :mod:`calib.batch_last`.
    """

    def __init__(
        self,
        A: FloatArray,
        B: FloatArray,
        *,
        tentative: bool = False,
        columns: tuple[FloatArray | None, FloatArray | None] = (None, None),
    ) -> None:
        for T, name in ((A, "A"), (B, "B")):
            if not isinstance(T, np.ndarray) or T.ndim != 4 or T.shape[-2:] != (4, 4):
                shape = f"has shape {np.shape(T)}" if isinstance(T, np.ndarray) else "is no array"
                raise InputError(f"{name} {shape}, not (T, N, 4, 4)", name=name)
        if A.shape != B.shape:
            raise InputError(f"A has shape {A.shape} and B has {B.shape}", name="B")
        self.A, self.B, self.tentative = A, B, tentative
        self.T, self.N = A.shape[:2]
        self._given = columns

    @cached_property
    def R_A(self) -> FloatArray:
        """Columns ``(3, 3, S)`` of the rotations of A."""
        return _rotations(self.A, self._given[0])

    @cached_property
    def R_B(self) -> FloatArray:
        """Columns ``(3, 3, S)`` of the rotations of B."""
        return _rotations(self.B, self._given[1])

    @cached_property
    def p_A(self) -> FloatArray:
        """Translations ``(3, S)`` of A."""
        return _translations(self.A, self._given[0])

    @cached_property
    def p_B(self) -> FloatArray:
        """Translations ``(3, S)`` of B."""
        return _translations(self.B, self._given[1])

    @cached_property
    def mean_R_A(self) -> FloatArray:
        """Means ``(3, 3, T)`` of the rotations of A, as columns."""
        return self.mean(self.R_A)

    def spread(self, values: FloatArray) -> FloatArray:
        """Values of the sets ``(..., T)`` for each of their pairs, ``(..., S)``.

        Of a single set ``(..., 1)``, which all pairs share.
        """
        return values if self.T == 1 else np.repeat(values, self.N, axis=-1)

    def mean(self, values: FloatArray) -> FloatArray:
        """Means over the pairs of each set ``(..., T)`` of values ``(..., S)``."""
        sums = values.reshape(*values.shape[:-1], self.T, self.N).sum(axis=-1)
        return np.asarray(sums / self.N)

    def mean_turned_back(self, vector: FloatArray) -> FloatArray:
        """Means ``(3, T)`` of vectors ``(3, S)``, seen in the axes that A maps from."""
        if self.T == 1:
            return np.asarray(self.R_A.reshape(3, -1) @ vector.reshape(-1, 1) / self.N)
        return self.mean(turn_back(self.R_A, vector))

    @cached_property
    def size(self) -> FloatArray:
        """How far the origins of A and B are from their means, rms ``(T,)``; 1 if they all stand.

        Not from the origins of base and target, which may be anywhere.
        """
        return np.where(self.moves, np.sqrt(self._square_moved), 1.0)

    @property
    def moves(self) -> BoolArray:
        """Whether any origin moves from pair to pair ``(T,)``."""
        return self._square_moved > 0.0

    @cached_property
    def _square_moved(self) -> FloatArray:
        each = (p.reshape(3, self.T, self.N) for p in (self.p_A, self.p_B))
        moved = (p - p.sum(axis=-1, keepdims=True) / self.N for p in each)
        return sum(((d * d).sum(axis=(0, 2)) / self.N for d in moved), np.zeros(self.T))

    @cached_property
    def kronecker_mean(self) -> FloatArray:
        """See :func:`calib.robot_world.algebra.kronecker_mean`."""
        if self.T == 1:
            return algebra.kronecker_mean_of_columns(self.R_A, self.R_B)[None]
        return algebra.kronecker_mean(self.A, self.B)

    @cached_property
    def leading(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See :func:`calib.robot_world.closed_form.leading`."""
        return closed_form.leading(self)

    @cached_property
    def rotations(self) -> tuple[FloatArray, FloatArray]:
        """Rotations of X and Z ``(T, 3, 3)`` from those of the pairs alone, in closed form.

        See :func:`calib.robot_world.closed_form.rotations`. No sign and no half turn troubles
        them, which is why signs and frames are chosen by them.
        """
        return closed_form.rotations(self)

    @property
    def rotations_first(self) -> tuple[FloatArray, FloatArray]:
        """X and Z ``(T, 4, 4)`` with these rotations, translations by least squares."""
        return self._rotations_first[:2]

    @cached_property
    def left_by_rotations_first(self) -> tuple[FloatArray, FloatArray]:
        """Root mean square residual angle [rad] and distance ``(T,)`` of these."""
        return closed_form.rest_of_rotations(self), self._rotations_first[2]

    @cached_property
    def _rotations_first(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return closed_form.assemble_with_rest(self, *self.rotations)

    @cached_property
    def quaternions(self) -> tuple[FloatArray, FloatArray]:
        """Quaternions a and b ``(T, N, 4)``, with signs for which all ``a x = z b`` agree.

        q and -q are the same rotation, so every pair has a free sign, and equations linear in the
        quaternions hold only if it is the same one over the whole set (both papers leave this
        out). The usual remedy takes the leading eigenvector of the matrix of
        ``<a_i, a_j> <b_i, b_j>``, which says nothing of a pose half a turn away from all others:
        Rz(180°) beside rotations about x and y. The signs of ``<a_i x, z b_i>`` at the sign-free
        solution are the same where that matrix decides, and defined wherever the rotations
        identify X and Z.
        """
        a, b = (self._quaternions(T, R) for T, R in ((self.A, self.R_A), (self.B, self.R_B)))
        x, z = self.quaternions_of_rotations
        left = a @ np.swapaxes(algebra.right_matrix(x), -1, -2)
        right = b @ np.swapaxes(algebra.left_matrix(z), -1, -2)
        agreement = (left * right).sum(axis=-1)
        return a, np.where(agreement < 0.0, -1.0, 1.0)[..., None] * b

    def _quaternions(self, T: FloatArray, R: FloatArray) -> FloatArray:
        """Quaternions ``(T, N, 4)`` of transforms whose rotations are R."""
        own = R[..., : self.N] if shared(T) else R
        q = np.ascontiguousarray(quaternions_of(own).T).reshape(-1, self.N, 4)
        return np.broadcast_to(q, (self.T, self.N, 4))

    @cached_property
    def quaternions_of_rotations(self) -> tuple[FloatArray, FloatArray]:
        """Quaternions x and z ``(T, 4)`` of :attr:`rotations`."""
        R_X, R_Z = self.rotations
        return se3.quaternion_from_rotation(R_X), se3.quaternion_from_rotation(R_Z)


def _rotations(T: FloatArray, columns: FloatArray | None) -> FloatArray:
    """Columns ``(3, 3, S)`` of the rotations of transforms."""
    if columns is not None:
        return columns[:3, :3]
    if shared(T):
        return np.tile(columns_of(T[0, :, :3, :3]), len(T))
    return columns_of(T.reshape(-1, 4, 4)[:, :3, :3])


def shared(T: FloatArray) -> bool:
    """Whether all sets have the same transforms ``(T, N, 4, 4)``, one array for all."""
    return len(T) > 1 and T.strides[0] == 0


def _translations(T: FloatArray, columns: FloatArray | None) -> FloatArray:
    """Translations ``(3, S)`` of transforms."""
    p = T[..., :3, 3].reshape(-1, 3).T if columns is None else columns[3, :3]
    return np.ascontiguousarray(p)


def own_order(A: FloatArray) -> IntArray:
    """Order ``(..., N)`` of transforms ``(..., N, 4, 4)`` that does not depend on how they come.

    Nor on the axes of the frames or the unit of length: by how far each is turned from the mean,
    then by how far it is from there. Where something is drawn at random, the same pairs are drawn.
    """
    R, p = A[..., :3, :3], A[..., :3, 3]
    turned = (R * R.mean(axis=-3, keepdims=True)).sum(axis=(-2, -1))
    moved = ((p - p.mean(axis=-2, keepdims=True)) ** 2).sum(axis=-1)
    return np.asarray(np.lexsort(np.stack([moved, turned]), axis=-1))


def checked_pairs(A: ArrayLike, B: ArrayLike, *, dimensions: int) -> tuple[FloatArray, FloatArray]:
    """Both sides as rigid transforms, orthonormal to rounding, of one shape, with enough pairs.

    ``(N, 4, 4)`` or ``(T, N, 4, 4)``: of 3 or 4 dimensions.
    """
    # copies: what is asked of a result later must not depend on what becomes of the arguments
    return _of_one_shape(_rigid_copy(A, "A")[0], _rigid_copy(B, "B")[0], dimensions)


def checked_problem(A: ArrayLike, B: ArrayLike) -> PairSets:
    """One problem of pairs ``(N, 4, 4)``, checked as :func:`checked_pairs` does."""
    (own_A, columns_A), (own_B, columns_B) = _rigid_copy(A, "A"), _rigid_copy(B, "B")
    _of_one_shape(own_A, own_B, 3)
    return PairSets(own_A[None], own_B[None], columns=(columns_A, columns_B))


def _rigid_copy(T: ArrayLike, name: str) -> tuple[FloatArray, FloatArray | None]:
    """Rigid transforms ``(..., 4, 4)``, orthonormal to rounding, in an array of their own.

    And their columns ``(4, 4, S)`` where the check has them.
    """
    copy = np.array(se3.numbers(T, name))
    columns = se3.columns_if_exactly_rigid(copy)
    return (se3.rigid(copy, name), None) if columns is None else (copy, columns)


def _of_one_shape(A: FloatArray, B: FloatArray, dimensions: int) -> tuple[FloatArray, FloatArray]:
    """Refuse another number of dimensions, shapes that differ, and too few pairs."""
    shape = "(N, 4, 4)" if dimensions == 3 else "(T, N, 4, 4)"
    for name, array in (("A", A), ("B", B)):
        if array.ndim != dimensions:
            raise InputError(
                f"{name} has shape {array.shape}, not {shape}",
                hint="solve takes one problem of N pairs, solve_batch takes T of them",
                name=name,
                value=array.shape,
            )
    if A.shape != B.shape:
        raise InputError(
            f"A has shape {A.shape} and B has {B.shape}",
            hint="give one B for each A",
            name="B",
            value=B.shape,
            bound=A.shape,
        )
    if dimensions == 4 and not len(A):
        raise InputError("A and B have no trial", hint="give at least one", name="A", value=0)
    if A.shape[-3] < FEWEST_PAIRS:
        raise InputError(
            f"{A.shape[-3]} pose pairs cannot identify X and Z",
            hint=f"measure at least {FEWEST_PAIRS}, with rotations about different axes",
            name="A",
            value=A.shape[-3],
            bound=FEWEST_PAIRS,
        )
    return A, B
