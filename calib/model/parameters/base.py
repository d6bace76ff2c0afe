"""What a block of parameters must tell the calibration model: what it displaces, and how.

Every error of arm and set-up is seen as a motion of the tool against what it is measured from (its
target). A small change of a parameter gives a twist of the tool relative to the target; how a
measurement sees it is the measurement's business. So any block goes with any measurement.

Arrays here have the posture last, see :mod:`calib.model.context`. Parameters are ``(size, S)``, or
``(size, 1)`` where all postures share them.

Where blocks are made, ``prior``, ``prior_m``, ``prior_rad`` and ``prior_s`` are standard deviations
about the nominal values that are known before measuring [SI], of all parameters or, where an array
is taken, of each; None where nothing is known. ``payload`` is what the flange carries: several
where measurements were taken with several (``Setup.payload``).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any, Literal

import numpy as np

from calib.errors import InputError, near_names
from calib.model.context import ArmErrors, MeasurementContext, Setup
from calib.robots import Robot
from calib.se3 import FloatArray

Unit = Literal["rad", "m", "rad/Nm", "rad/rad", "m/m", "px", "1", "s"]

_KEPT, _LARGEST = 8, 10_000
"""Sets of postures whose values are kept, of so many numbers at most."""

OfPostures = Callable[[Any, FloatArray, Setup], FloatArray]
"""A method of postures ``(n, S)`` and their set-up."""


def kept(method: OfPostures) -> OfPostures:
    """Keep the last values of a method that no parameter changes, but postures and payloads alone.

    A fit asks for them at every step, and at the same postures.
    """
    own = f"_{method.__name__}_kept"

    @wraps(method)
    def found(block: Any, q: FloatArray, setup: Setup) -> FloatArray:
        if q.size > _LARGEST:
            return method(block, q, setup)
        known = block.__dict__.setdefault(own, {})
        key = q.shape, q.tobytes(), setup.payload.tobytes()
        values: FloatArray | None = known.get(key)
        if values is None:
            values = method(block, q, setup)
            values.setflags(write=False)
            if len(known) >= _KEPT:
                known.clear()
            known[key] = values
        return values

    return found


class ParameterBlock(ABC):
    """A group of parameters that enter the model in the same way.

    Attributes
    ----------
    names : tuple of str
        One a parameter, unique over the model, e.g. ``zero_offset.joint_2``.
    units : tuple of str
        SI unit of each.
    nuisance : bool
        Whether they place the measuring set-up (tool, target) rather than the robot.
    tools, targets : tuple of str
        Labels of what this block puts on the tool, and around the arm.
    measured_from : tuple of str
        Labels of targets that another block has to put up.
    prior : array (size,)
        Standard deviation, about the nominal value, that is known before measuring [SI]; infinite
        where nothing is.
    reading : str
        Label of what an instrument reads by that these are values of: a lens, say. Empty for
        parameters that move the tool against its target.
    beyond_chain : str
        What no kinematic chain can hold of it, in words. Empty for blocks that displace the arm
        alike in every posture, or not at all: see
        :func:`calib.correction.corrected_robot.corrected_robot`.
    """

    names: tuple[str, ...]
    units: tuple[Unit, ...]
    nuisance: bool = False
    tools: tuple[str, ...] = ()
    targets: tuple[str, ...] = ()
    measured_from: tuple[str, ...] = ()
    prior: FloatArray
    reading: str = ""
    beyond_chain: str = "errors that change from posture to posture"

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.names)

    @property
    def nominal(self) -> FloatArray:
        """Values ``(size,)`` of robot and set-up as described: zero for errors."""
        return np.zeros(self.size)

    @abstractmethod
    def displace(self, values: FloatArray, errors: ArmErrors, q: FloatArray, setup: Setup) -> None:
        """Apply values ``(size, S)`` to arm and set-up; ``q`` (n, S) are the joints as shown."""

    @abstractmethod
    def move(self, values: FloatArray, view: MeasurementContext, out: FloatArray) -> None:
        """Write the twist of the tool against the target for each parameter.

        ``out`` is ``(size, 6, S)`` and zero. Rows 0 to 2: velocity of the tool point less that of
        the target's frame there [m per unit]; rows 3 to 5: angular velocity; in base axes. There
        are only rows 0 to 2 where no measurement looks at the tool's orientation.
        """

    def picked(self, rows: FloatArray) -> FloatArray:
        """Rows ``(size, ...)`` of the parameters, of those ``(k, ...)`` of all of a reading."""
        return rows

    def scaling(self, values: FloatArray) -> FloatArray:
        """Change ``(size,)`` of the parameters when all lengths of the arm grow by their own size.

        Zero for what is no length of the arm. The set-up is not asked: it follows.
        """
        return np.zeros(self.size)


def joint_indices(
    robot: Robot, joints: Sequence[str], *, turning: bool = False, of_arm: bool = False
) -> list[int]:
    """Indices of joints by name.

    With ``turning`` a joint that slides is refused, with ``of_arm`` one of a positioner: what it
    carries weighs, and is not described.
    """
    for joint in joints:
        if joint not in robot.joint_names:
            raise InputError(
                f"{robot.name} has no joint {joint!r}",
                hint=near_names(joint, robot.joint_names),
                name=joint,
            )
    carriers = [j for j in robot.joint_names[: robot.floor] if of_arm and j in joints]
    if carriers:
        raise InputError(
            f"joint {carriers[0]!r} is a positioner's, and what it carries is not described",
            hint="leave it out: only joints of the arm give way under a torque that is known",
            name=carriers[0],
        )
    slides = [j for j, it_does in zip(robot.joint_names, robot.sliding, strict=True) if it_does]
    sliding = [j for j in slides if turning and j in joints]
    if sliding:
        raise InputError(
            f"joint {sliding[0]!r} slides, and has no such error",
            hint="leave it out: a slide has an offset, a scale, and the place of its frame",
            name=sliding[0],
        )
    doubles = [j for j in joints if list(joints).count(j) > 1]
    if doubles:
        raise InputError(f"joint {doubles[0]!r} is listed twice", hint="list it once")
    return [robot.joint_names.index(joint) for joint in joints]


def prior_of(sigma: float | FloatArray | None, size: int) -> FloatArray:
    """Standard deviations ``(size,)`` of a prior, of all or of each; infinite without one."""
    if sigma is None:
        return np.full(size, np.inf)
    each = np.full(size, sigma, dtype=float)
    if not (each > 0).all():
        raise InputError(
            f"a prior of {each.min():g} cannot be used: it must be above zero",
            hint="leave the parameter out to hold it",
            name="prior",
            value=float(each.min()),
            bound=0.0,
        )
    return each


def priors_of_units(
    units: Sequence[Unit], prior_m: float | None, prior_rad: float | None
) -> FloatArray:
    """Standard deviations ``(size,)`` of a prior of lengths and of one of angles."""
    lengths = np.array([unit == "m" for unit in units], dtype=bool)
    return np.where(lengths, prior_of(prior_m, len(units)), prior_of(prior_rad, len(units)))


class Part(ParameterBlock):
    """Some of the parameters of another block; the others stay at their nominal values.

    Parameters
    ----------
    names : sequence of str
        Those that stay free, in the order of the block.
    """

    def __init__(self, whole: ParameterBlock, names: Sequence[str]) -> None:
        strange = [name for name in names if name not in whole.names]
        if strange:
            raise InputError(
                f"there is no parameter {strange[0]!r}",
                hint=near_names(strange[0], whole.names),
                name=strange[0],
            )
        self.whole = whole
        wanted = set(names)
        self._kept = [k for k, name in enumerate(whole.names) if name in wanted]
        self.names = tuple(whole.names[k] for k in self._kept)
        self.units = tuple(whole.units[k] for k in self._kept)
        self.prior = whole.prior[self._kept]
        self.nuisance = whole.nuisance
        self.beyond_chain, self.reading = whole.beyond_chain, whole.reading
        self.tools, self.targets = whole.tools, whole.targets

    @property
    def nominal(self) -> FloatArray:
        return self.whole.nominal[self._kept]

    def _all(self, values: FloatArray) -> FloatArray:
        """Values ``(size of the whole, S)``."""
        nominal = self.whole.nominal[:, None]
        every = np.broadcast_to(nominal, (len(nominal), values.shape[1])).copy()
        every[self._kept] = values
        return every

    def displace(self, values: FloatArray, errors: ArmErrors, q: FloatArray, setup: Setup) -> None:
        self.whole.displace(self._all(values), errors, q, setup)

    def move(self, values: FloatArray, view: MeasurementContext, out: FloatArray) -> None:
        every = np.zeros((self.whole.size, *out.shape[1:]))
        self.whole.move(self._all(values), view, every)
        out[...] = every[self._kept]

    def picked(self, rows: FloatArray) -> FloatArray:
        return self.whole.picked(rows)[self._kept]

    def scaling(self, values: FloatArray) -> FloatArray:
        return self.whole.scaling(self._all(values[:, None])[:, 0])[self._kept]
