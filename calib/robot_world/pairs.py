"""T sets of N pose pairs A, B, and what the methods derive from them, each thing once."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from calib import se3
from calib.batch_last import quaternions_of
from calib.errors import InputError
from calib.robot_world import algebra, closed_form
from calib.robot_world.pair_arrays import PairArrays, shared
from calib.se3 import FloatArray, IntArray

FEWEST_PAIRS = 3
"""Two rotations between poses are the fewest that can have two different axes."""


class PairSets(PairArrays):
    """Pairs of T problems, and what they tell in closed form, worked out once."""

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
        return closed_form.rotations(self, *self.leading[:2])

    @property
    def rotations_first(self) -> tuple[FloatArray, FloatArray]:
        """X and Z ``(T, 4, 4)`` with these rotations, translations by least squares."""
        return self._rotations_first[:2]

    @cached_property
    def left_by_rotations_first(self) -> tuple[FloatArray, FloatArray]:
        """Root mean square residual angle [rad] and distance ``(T,)`` of these."""
        return closed_form.rest_of_rotations(self, *self.rotations), self._rotations_first[2]

    @cached_property
    def _rotations_first(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return closed_form.assemble_with_rest(self, *self.rotations)

    def residual_rms(self, X: FloatArray, Z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See :func:`calib.robot_world.closed_form.residual_rms`."""
        if X is self.rotations_first[0]:
            return self.left_by_rotations_first
        return closed_form.residual_rms(self, X, Z)

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
