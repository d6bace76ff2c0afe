"""Which bodies of a cell may come together, and how fast they can do so."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.errors import InputError, near_names
from calib.geometry.enclosure import check_body, outer_points
from calib.robots import SerialChain
from calib.robots.shapes import Body, HalfSpace
from calib.se3 import FloatArray, IntArray


def check_groups(
    n: int, arm: Sequence[Body], tool: Sequence[Body], obstacles: Sequence[Body]
) -> None:
    """Raise :class:`InputError` for a body that is not where its group is, or not usable."""
    for body in (*arm, *tool, *obstacles):
        check_body(body)
    for body in (*arm, *tool):
        if isinstance(body.solid, HalfSpace):
            raise InputError(
                f"{body.name} is a half-space and belongs to the robot",
                hint="only obstacles can be half-spaces",
                name=body.name,
            )
    for body in arm:
        if not 0 <= body.link <= n:
            raise InputError(
                f"{body.name} is on link {body.link} of an arm of {n} joints",
                hint=f"links are counted from 0 (the base) to {n}",
                name=body.name,
                value=body.link,
                bound=n,
            )
    for group, link, bodies in (("tool", n, tool), ("obstacle", 0, obstacles)):
        for body in bodies:
            if body.link != link:
                raise InputError(
                    f"{group} {body.name} is on link {body.link}",
                    hint=f"a body of this group is on link {link}",
                    name=body.name,
                    value=body.link,
                    bound=link,
                )


def candidate_pairs(
    n: int, arm: Sequence[Body], tool: Sequence[Body], obstacles: Sequence[Body]
) -> IntArray:
    """Pairs ``(P, 2)`` of rows of arm, tool and obstacles in a row that can come together.

    Neighbouring links touch at their joint and are left out, so is the tool against the last link,
    which carries it, and the base, which stands on the floor, against obstacles.
    """
    arms = list(enumerate(arm))
    tools = [len(arm) + i for i in range(len(tool))]
    fixed = [len(arm) + len(tool) + i for i in range(len(obstacles))]
    pairs = [(i, k) for i, a in arms for k, b in arms[i + 1 :] if abs(a.link - b.link) >= 2]
    pairs += [(i, t) for t in tools for i, a in arms if a.link < n]
    pairs += [(i, o) for o in fixed for i, a in arms if a.link >= 1]
    pairs += [(t, o) for o in fixed for t in tools]
    return np.array(pairs, dtype=np.intp).reshape(-1, 2)


def without_ignored(
    pairs: IntArray, names: Sequence[str], ignore: Sequence[tuple[str, str]]
) -> IntArray:
    """Leave out the pairs whose names are ignored, in either order.

    Raises
    ------
    InputError
        A name is not that of a body.
    """
    for pair in ignore:
        for name in pair:
            if name not in names:
                raise InputError(
                    f"there is no body {name!r} to ignore",
                    hint=near_names(name, dict.fromkeys(names)),
                    name=name,
                )
    gone = {frozenset(pair) for pair in ignore}
    kept = [frozenset((names[a], names[b])) not in gone for a, b in pairs]
    return np.asarray(pairs[np.array(kept, dtype=bool)])


def motion_radii(chain: SerialChain, bodies: Sequence[Body], pairs: IntArray) -> FloatArray:
    """How fast a joint can change the distance of a pair at most, whatever the posture.

    A joint between the two links changes the distance no faster than it moves the one body seen
    from the other: by the largest distance of that body from the joint's axis. Either of the two
    may be taken to be the moving one, because the closest points of both lie on the line along
    which the distance changes. Largest distances are added up link by link.

    Parameters
    ----------
    chain : SerialChain
    bodies : sequence of Body
    pairs : array (P, 2) of int

    Returns
    -------
    array (P, n)
        [m/rad]
    """
    outward, inward = _radii(chain, bodies)
    links = np.array([body.link for body in bodies], dtype=np.intp)
    lower = np.where(links[pairs[:, 0]] <= links[pairs[:, 1]], pairs[:, 0], pairs[:, 1])
    upper = np.where(lower == pairs[:, 0], pairs[:, 1], pairs[:, 0])
    joint = np.arange(1, chain.n + 1)
    between = (joint > links[lower, None]) & (joint <= links[upper, None])
    return np.where(between, np.minimum(outward[upper], inward[lower]), 0.0)


def _radii(chain: SerialChain, bodies: Sequence[Body]) -> tuple[FloatArray, FloatArray]:
    """Largest distance of bodies (B, n) from every axis inside, and outside, of their link [m]."""
    n = chain.n
    step = chain.placements[:, :3, 3]  # from each joint to the next, in axes of the link between
    length = np.linalg.norm(step, axis=-1)
    axis_inside = (chain.placements[:, :3, :3] @ chain.axes[:, :, None])[..., 0]
    outward = np.zeros((len(bodies), n))
    inward = np.zeros((len(bodies), n))
    for b, body in enumerate(bodies):
        if isinstance(body.solid, HalfSpace):
            inward[b] = np.inf
            continue
        points, radius = outer_points(body.solid)
        points = points @ body.T_link_body[:3, :3].T + body.T_link_body[:3, 3]
        own = body.link - 1  # row of the joint that moves the body
        for k in range(own + 1):
            if k == own:
                outward[b, k] = _off_axis(points, chain.axes[k]) + radius
            else:
                first = _off_axis(step[k + 1 : k + 2], chain.axes[k])
                far = np.linalg.norm(points, axis=-1).max() + radius
                outward[b, k] = first + length[k + 2 : own + 1].sum() + far
        for k in range(own + 1, n):
            seen = points - step[own + 1]  # from the next joint outside
            if k == own + 1:
                inward[b, k] = _off_axis(seen, axis_inside[k]) + radius
            else:
                first = _off_axis(step[k : k + 1], axis_inside[k])
                far = np.linalg.norm(seen, axis=-1).max() + radius
                inward[b, k] = first + length[own + 2 : k].sum() + far
    return outward, inward


def _off_axis(points: FloatArray, axis: FloatArray) -> float:
    """Largest distance of points (K, 3) from a line through the origin along a unit vector."""
    return float(np.linalg.norm(np.cross(points, axis), axis=-1).max())
