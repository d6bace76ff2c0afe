"""The methods by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from calib.errors import InputError, near_names
from calib.robot_world.methods import hirsh, li_dual_quaternion, li_kronecker, zhuang
from calib.robot_world.pairs import PairSets
from calib.robot_world.results import Estimate


@dataclass(frozen=True)
class Method:
    """One way to solve A X = Z B.

    Attributes
    ----------
    name : str
        What :func:`calib.robot_world.solve` is asked for.
    description : str
        One line: what it minimises, and what is to be known before using it.
    source : str
        The publication.
    estimate : callable
        Takes :class:`~calib.robot_world.pairs.PairSets` and returns an
        :class:`~calib.robot_world.results.Estimate` of the T problems.
    iterative : bool
        Whether the estimate has iterations.
    """

    name: str
    description: str
    source: str
    estimate: Callable[[PairSets], Estimate]
    iterative: bool = False


_ALL = (
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
    ),
    Method(
        "li-dual-quaternion",
        "rotations and translations together by dual quaternions: depends on the unit of length, "
        "and can fail under noise",
        "Li 2010, Eq. 12-14, corrected",
        li_dual_quaternion.estimate,
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
        iterative=True,
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
    if name not in METHODS:
        raise InputError(
            f"there is no method {name!r} for A X = Z B",
            hint=near_names(name, METHODS),
            name="method",
            value=name,
        )
    return METHODS[name]
