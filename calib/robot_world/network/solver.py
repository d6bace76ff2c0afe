"""Solve a network."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, NotIdentifiableError
from calib.robot_world.identifiability import examine
from calib.robot_world.methods import robust
from calib.robot_world.network.fit import adjusted
from calib.robot_world.network.graph import REMEDY, Network
from calib.robot_world.network.prior import FramePrior
from calib.robot_world.network.result import NetworkResult
from calib.robot_world.network.start import start
from calib.robot_world.noise import Noise, PairCovariances, check_noise
from calib.robot_world.pairs import PairSets
from calib.se3 import BoolArray

_FEWEST_TO_CHOOSE = 5
"""Pairs of an edge from which on those that contradict the others are looked for in it alone."""

_ROUNDS = 20
"""Times that pairs are chosen anew at most."""


def solve_network(
    A: ArrayLike,
    B: ArrayLike,
    on_flange: Sequence[str],
    around: Sequence[str],
    arms: Sequence[str] | None = None,
    *,
    noise: Noise | None = None,
    priors: Sequence[FramePrior] = (),
    leave_out: bool = True,
    in_part: bool = False,
) -> NetworkResult:
    """Solve ``A_i X_k = Z_l B_i`` for all frames of a network at once.

    Parameters
    ----------
    A, B : array_like (N, 4, 4)
        Measured transforms [m], as of :func:`calib.robot_world.solve`: ``T_base_flange`` of the arm
        of the pair, and from what is on its flange to what stands around.
    on_flange, around : sequence of str (N)
        What is on the flange in each pair, and what stands around.
    arms : sequence of str (N), optional
        The arm of each pair; one arm by default.
    noise : PairNoise or PairCovariances, optional
        Noise of the transforms. It is estimated by default: of B, the same in all directions, and
        for an edge of its own where its pairs show it.
    priors : sequence of FramePrior
        What is known of frames on flanges and around the arms.
    leave_out : bool
        Whether pairs that contradict the others take no part.
    in_part : bool
        Whether to answer, too, where something is not told: it is named in the result.

    Returns
    -------
    NetworkResult
        Frames and their joint covariance.

    Raises
    ------
    InputError
        Shapes or names that do not fit.
    NotIdentifiableError
        Neither pairs nor priors tell something: it is named.
    ConvergenceError
        The search has not arrived.
    """
    net = Network.of(A, B, on_flange, around, arms)
    check_noise(noise, net.N)
    for prior in priors:
        if prior.frame not in (*net.on_flange, *net.around):
            raise InputError(
                f"there is no frame {prior.frame} to have a prior",
                hint=", ".join((*net.on_flange, *net.around)),
                name=prior.frame,
            )
    used = _agreeing(net, noise) if leave_out else np.ones(net.N, dtype=bool)
    classes = np.zeros(net.N, dtype=np.intp)
    fit = adjusted(net, noise, priors, used, start(net, used, priors), classes)
    for _ in range(_ROUNDS):
        again = fit.explained() if leave_out else used
        others = fit.other_classes()
        if (again == used).all() and (others == classes).all():
            break
        used, classes = again, others
        fit = adjusted(net, noise, priors, used, fit.T, classes)
    result = fit.result()
    if len(result.untold) and not in_part:
        raise NotIdentifiableError(
            result.not_told,
            ["the flange turns about one axis while it is seen, or there are too few pairs"],
            hint=f"{REMEDY}, or say what is known of it from elsewhere",
        )
    return result


def _agreeing(net: Network, noise: Noise | None) -> BoolArray:
    """Pairs ``(N,)`` that agree with the others of their edge."""
    used = np.ones(net.N, dtype=bool)
    known = None if isinstance(noise, PairCovariances) else noise
    for edge in range(net.edges.max() + 1):
        own = np.flatnonzero(net.edges == edge)
        pairs = PairSets(net.A[own][None], net.B[own][None])
        if len(own) >= _FEWEST_TO_CHOOSE and not examine(pairs).degenerate[0]:
            found = robust.estimate(pairs, known)
            if found.weights is not None:
                used[own] = found.weights[0] > 0
    return used
