"""The methods by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from calib.errors import InputError, near_names, one_line
from calib.robot_world.estimate import Estimate
from calib.robot_world.methods import (
    andreff,
    daniilidis,
    dornaika_horaud,
    hirsh,
    li_dual_quaternion,
    li_kronecker,
    maximum_likelihood,
    park_martin,
    robust,
    shah,
    tsai_lenz,
    zhuang,
)
from calib.robot_world.noise import Noise
from calib.robot_world.pairs import PairSets

CHANGES = (
    "unit",
    "base axes",
    "base origin",
    "flange axes",
    "flange origin",
    "target axes",
    "target origin",
    "camera axes",
    "camera origin",
)
"""Ways to write the same measurements: in another unit of length, or seen from a frame that is
turned (axes) or shifted (origin). The truth does not change by any of them, and without noise no
answer does; with noise, the answers of many methods do."""

_TURNS = frozenset({"base axes", "flange axes", "target axes", "camera axes"})

_SHIFTS = frozenset({"base origin", "flange origin", "target origin"})
"""The origin of the camera is no choice: residual translations are those of this very point. What
a method minimises changes with it, whatever the method."""

_ROTATIONS_FIRST = frozenset({"unit"}) | _TURNS | _SHIFTS
"""Of a method whose rotations know no axes, and no translations either."""


@dataclass(frozen=True)
class Method:
    """One way to solve A X = Z B."""

    name: str  # what :func:`calib.robot_world.solve` is asked for
    description: str  # one line: what it minimises, and what is to be known before using it
    source: str  # the publication
    estimate: Callable[..., Estimate]
    """Makes an :class:`~calib.robot_world.estimate.Estimate` of
    :class:`~calib.robot_world.pairs.PairSets` and, where it weighs by it, their noise."""
    equation: Literal["AX=ZB", "AX=XB"] = "AX=ZB"
    """What it solves: the pairs as they are, for X and Z, or the motions between them, for X alone,
    Z being the mean of what the pairs then say."""
    invariant_to: frozenset[str] = _ROTATIONS_FIRST
    """The :data:`CHANGES` that leave its answer the same when the data are noisy. Of maximum
    likelihood, with noise on B or not given: noise of A turns it about the origin of the flange,
    which is then no choice either."""
    iterative: bool = False  # whether the estimate has iterations
    likelihood: bool = False
    """Whether it weighs the pairs by their noise: the estimate then takes that, too."""
    robust: bool = False  # whether it leaves out pairs that contradict the others

    def run(self, pairs: PairSets, noise: Noise | None) -> Estimate:
        """Estimate X and Z of T problems, by their noise where the method weighs by it."""
        return self.estimate(pairs, noise) if self.likelihood else self.estimate(pairs)


_ALL = (
    Method(
        "ml",
        "the likeliest X and Z with errors on A, on B or on both, which are estimated if unknown",
        "Maximum likelihood on SE(3), by Gauss-Helmert adjustment",
        maximum_likelihood.estimate,
        iterative=True,
        likelihood=True,
    ),
    Method(
        "ml-robust",
        "the same from the pairs that agree: leaves out, and names, those that contradict them",
        "Maximum likelihood, after least median of squares (Rousseeuw 1984)",
        robust.estimate,
        iterative=True,
        likelihood=True,
        robust=True,
    ),
    Method(
        "li-kronecker",
        "rotations and translations together by the Kronecker product, lengths scaled by the data",
        "Li 2010, Eq. 19, scaled",
        li_kronecker.estimate,
    ),
    Method(
        "li-kronecker-literal",
        "the same as printed: the answer depends on the unit of length",
        "Li 2010, Eq. 19",
        li_kronecker.estimate_literal,
        invariant_to=_TURNS | {"base origin", "flange origin"},
    ),
    Method(
        "li-dual-quaternion",
        "rotations and translations together by dual quaternions: depends on the unit of length, "
        "and can fail under noise",
        "Li 2010, Eq. 12-14, corrected",
        li_dual_quaternion.estimate,
        invariant_to=_TURNS,
    ),
    Method(
        "zhuang",
        "linear in the quaternions, rotations first; safe at half turns",
        "Zhuang 1994, in safe frames",
        zhuang.estimate,
    ),
    Method(
        "zhuang-literal",
        "the same in the frames as given: fails near half turns of A or Z",
        "Zhuang 1994",
        zhuang.estimate_literal,
        invariant_to=_SHIFTS | {"unit"},
    ),
    Method(
        "hirsh",
        "alternating averages of quaternions with consistent signs, rotations first",
        "Hirsh 2001, corrected",
        hirsh.estimate,
        iterative=True,
    ),
    Method(
        "hirsh-literal",
        "the same as printed: often settles far from the answer",
        "Hirsh 2001",
        hirsh.estimate_literal,
        invariant_to=_SHIFTS | {"unit"},
        iterative=True,
    ),
    Method(
        "dornaika-horaud",
        "closed form by quaternions, rotations first: where hirsh ends",
        "Dornaika and Horaud 1998, closed form",
        dornaika_horaud.estimate,
    ),
    Method(
        "dornaika-horaud-nonlinear",
        "rotations and translations together by iteration, both weighted by 1: depends on the "
        "unit of length",
        "Dornaika and Horaud 1998, non-linear",
        dornaika_horaud.estimate_nonlinear,
        invariant_to=_TURNS | _SHIFTS,
        iterative=True,
    ),
    Method(
        "shah",
        "closed form by the Kronecker product, rotations first",
        "Shah 2013",
        shah.estimate,
    ),
    Method(
        "tsai-lenz",
        "motions, by modified Rodrigues vectors, rotation first: fails where X is near half a turn",
        "Tsai and Lenz 1989",
        tsai_lenz.estimate,
        equation="AX=XB",
        invariant_to=_SHIFTS | {"unit", "base axes", "target axes"},
    ),
    Method(
        "park-martin",
        "motions, by rotation vectors, rotation first: time grows with the square of N",
        "Park and Martin 1994",
        park_martin.estimate,
        equation="AX=XB",
    ),
    Method(
        "horaud-dornaika",
        "motions, by their quaternions, rotation first: X turned as by dornaika-horaud",
        "Horaud and Dornaika 1995, by quaternions of the motions",
        dornaika_horaud.estimate_motions,
        equation="AX=XB",
    ),
    Method(
        "horaud-dornaika-literal",
        "motions, by unit axes as printed: small motions weigh as much as large ones",
        "Horaud and Dornaika 1995",
        dornaika_horaud.estimate_motions_literal,
        equation="AX=XB",
    ),
    Method(
        "andreff",
        "motions, by the Kronecker product, all at once: depends on the unit of length, and fails "
        "where the target stays in one place of the view",
        "Andreff, Horaud and Espiau 1999",
        andreff.estimate,
        equation="AX=XB",
        invariant_to=_TURNS | _SHIFTS,
    ),
    Method(
        "daniilidis",
        "motions, by dual quaternions, all at once: depends on the unit of length and on the "
        "frames of flange and camera",
        "Daniilidis 1999, Eq. 31-35",
        daniilidis.estimate,
        equation="AX=XB",
        invariant_to=frozenset({"base axes", "base origin", "target axes", "target origin"}),
    ),
)

METHODS: Mapping[str, Method] = MappingProxyType({method.name: method for method in _ALL})
"""All methods, in the order in which they are listed to people."""


PAPER_METHODS = ("li-kronecker", "li-dual-quaternion", "zhuang", "hirsh")
"""The methods of the papers, each in the form that is fit for use."""


def find_method(name: str) -> Method:
    """Return the method of a name.

    Raises
    ------
    InputError
        No method has this name; the hint lists the nearest ones.
    """
    if not isinstance(name, str) or name not in METHODS:
        raise InputError(
            f"there is no method {one_line(name)} for A X = Z B",
            hint=near_names(one_line(name), METHODS),
            name="method",
            value=name,
        )
    return METHODS[name]
