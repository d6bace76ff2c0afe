"""What is solid: plain numbers for links, tools and obstacles, without any engine behind them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.se3 import FloatArray, frame_about, transform


@dataclass(frozen=True)
class Capsule:
    """All points within ``radius_m`` of a segment of ``length_m`` along z about the origin."""

    radius_m: float
    length_m: float


@dataclass(frozen=True)
class Cylinder:
    """A cylinder along z, centred on the origin."""

    radius_m: float
    length_m: float


@dataclass(frozen=True)
class Sphere:
    """A ball about the origin."""

    radius_m: float


@dataclass(frozen=True)
class Box:
    """A box with edges along the axes, centred on the origin."""

    size_m: tuple[float, float, float]


@dataclass(frozen=True)
class HalfSpace:
    """Everything below the plane z = 0."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface of triangles."""

    vertices: FloatArray  # (V, 3) [m]
    triangles: np.ndarray[tuple[int, int], np.dtype[np.intp]]  # (F, 3), rows of vertices


Solid = Capsule | Cylinder | Sphere | Box | HalfSpace | Mesh


@dataclass(frozen=True, eq=False)
class Body:
    """A solid that is fixed to the base or to a link of the arm."""

    name: str  # as reasons and tables say it
    link: int  # 0: fixed to the base; j from 1 to n: moved by joint j
    T_link_body: FloatArray
    """(4, 4): the solid in the base frame (link 0), or in the frame of joint j, as
    :class:`~calib.robots.chain.ChainState` has it."""
    solid: Solid
    of_other_branch: bool = False
    """Stands still with the base, but on no link next to the first joint: another arm, a lift."""
    beside_positioner: bool = False
    """Stands on the floor as a positioner does, but is not what its first joint hangs on."""


@dataclass(frozen=True, eq=False)
class LinkShape:
    """A solid as a robot description has it: by the name of the link that it belongs to."""

    link: str
    name: str
    T_link_shape: FloatArray  # (4, 4) [m], in the frame of the link
    solid: Solid


def capsule_between(
    start: FloatArray, end: FloatArray, radius_m: float
) -> tuple[FloatArray, Capsule]:
    """The capsule around a segment: its placement ``(4, 4)`` in the frame of the points (3,)."""
    length = float(np.linalg.norm(end - start))
    rotation = frame_about((end - start) / length) if length > 0.0 else np.eye(3)
    return transform(rotation, (start + end) / 2.0), Capsule(float(radius_m), length)
