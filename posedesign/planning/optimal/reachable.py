"""What becomes of chosen poses that no clear way leads to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calib.errors import InputError
from calib.se3 import FloatArray, IntArray
from posedesign.candidates import Pool
from posedesign.motion import Router
from posedesign.motion.route import Route

ATTEMPTS = 6
"""How often poses are chosen while no clear way leads to some of them."""

FROM_BASE = 3
"""Attempts after which only such candidates are left as :meth:`.Router.reached` knows a way to:
most straight from the base posture, over which there is a way from each to each."""

TURNED_BACK = 3
"""How often those of the refined poses that no clear way leads to are turned back to what they
were, before all are."""

ALIKE_RAD = (0.0, 0.2, 0.4, 0.6)
"""Postures of which no joint differs by more from one that no clear way leads to are left out with
it: none at first, then more and more of them, for a pool may have hundreds of such."""


def refined_with_way(
    router: Router, chosen: Pool, refine: Callable[[Pool], Pool], *, in_doubt: bool
) -> tuple[Pool, Route]:
    """Poses refined as far as a clear way leads to them then, and the way.

    ``in_doubt``: look for the way through the poses as they are first: refinement takes long.
    Returns Pool: those that were given where no way leads through them either; the route then says
    to which. ``Route``.
    """
    if in_doubt:
        plain = router.route(chosen.postures)
        if plain.lost:
            return chosen, plain
    refined = refine(chosen)
    route = router.route(refined.postures)
    if not route.lost:
        return refined, route
    plain = router.route(chosen.postures)
    if plain.lost:
        return chosen, plain
    q, R = refined.postures.copy(), refined.orientations.copy()
    for _ in range(TURNED_BACK):
        back = list(route.lost)
        q[back], R[back] = chosen.postures[back], chosen.orientations[back]
        route = router.route(q)
        if not route.lost:
            return replace(refined, postures=q, orientations=R), route
    return chosen, plain


def without_unreached(
    router: Router, pool: Pool, lost: IntArray, attempt: int, kept: int = 0
) -> Pool:
    """The pool without postures that no clear way leads to, and those that may share their fate.

    At first those like them, in the end all that no way is known to lead to.

    ``lost``: rows of the pool. ``attempt``: how often others have been left out before. ``kept``:
    how many of the first postures stay in any case, if they are not lost.
    """
    if attempt + 1 < FROM_BASE:
        return without_alike(pool, lost, attempt, kept)
    keep = router.reached(pool.postures)
    keep[:kept] = True
    keep[lost] = False
    return pool.take(keep)


def without_alike(pool: Pool, lost: IntArray, attempt: int, kept: int = 0) -> Pool:
    """The pool without some postures and those like them; see :func:`without_unreached`."""
    apart = np.abs(pool.postures[:, None] - pool.postures[lost]).max(axis=2).min(axis=1)
    keep = apart > ALIKE_RAD[min(attempt, len(ALIKE_RAD) - 1)]
    keep[:kept] = True
    keep[lost] = False
    return pool.take(keep)


def reached_of(router: Router, postures: FloatArray, route: Route) -> tuple[IntArray, Route]:
    """Rows of postures ``(N, n)`` [rad] that a clear way leads to, and the route through them.

    ``postures`` (N, n). ``route``: through all of them, as far as there is one.
    """
    rows = np.arange(len(postures))
    while route.lost:
        rows = np.delete(rows, list(route.lost))
        route = router.route(postures[rows])
    return rows, route


def no_clear_way(why: str) -> InputError:
    """The error where poses are left that no clear way leads to."""
    return InputError(
        f"no clear way leads to some of the poses: {why}",
        hint="move the base posture to the side of the target that has room, or what is in the way",
        name="base_pose",
    )
