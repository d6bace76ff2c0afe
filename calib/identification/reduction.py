"""From all parameters of an arm to a set that measurements can tell apart."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.errors import CalibError
from calib.identification.checks import clean_root
from calib.identification.identifiability import sort_out
from calib.identification.robust import fit_robustly
from calib.identification.start import first_guess
from calib.model import CalibrationModel
from calib.model.measurements import Measurements
from calib.model.parameters import LinkGeometry, ParameterBlock, Part, Unit
from calib.se3 import FloatArray

WORTH_HAVING: dict[Unit, float] = {"m": 5e-3, "rad": 1e-2, "rad/Nm": 1e-4, "rad/rad": 1e-2}
"""Standard deviation, all parameters taken in before being free as well, beyond which a parameter
is left out: what an arm is built to is well inside, so nothing would be learnt. It is also what
makes axes parallel that are so but for the rounding of a description: a column that differs by
1e-5 only shows a parameter with an uncertainty of metres."""


@dataclass(frozen=True, eq=False)
class Reduction:
    """A model without the parameters that measurements cannot tell.

    Attributes
    ----------
    model : CalibrationModel
    kept : tuple of str
        Names of all parameters of the model.
    left_out : tuple of str
    merged : tuple of str
        For each left out, in words, what it shows up in.
    """

    model: CalibrationModel
    kept: tuple[str, ...]
    left_out: tuple[str, ...]
    merged: tuple[str, ...]


def reduce(model: CalibrationModel, data: Measurements, x: FloatArray | None = None) -> Reduction:
    """Leave out robot parameters that these measurements cannot tell from those before them.

    At the nominal arm, where axes that are meant to be parallel are: the set does not hang on
    noise. The set-up comes first, then the blocks as the model lists them, so that a shift along
    parallel axes stays with the first of them, and a turn about a joint axis with the zero offset
    where that is free.

    Parameters
    ----------
    model : CalibrationModel
    data : Measurements
        One set, postures ``(N, n)``.
    x : array (p,), optional
        Where to look; the first guess by default.
    """
    guess = first_guess(model, data) if x is None else x
    found = _reduced(model, data, guess)
    if not any(kind.estimated for kind in model.measurements):
        return found
    # what is worth having hangs on the noise, and a first fit says how large that is
    try:
        solved = fit_robustly(found.model, data, first_guess(found.model, data))
    except CalibError:
        return found
    again = _reduced(model.with_measurements(solved.model.measurements), data, guess)
    return replace(again, model=again.model.with_measurements(model.measurements))


def _reduced(model: CalibrationModel, data: Measurements, guess: FloatArray) -> Reduction:
    root = clean_root(model, data, guess)
    least = np.array([1.0 / WORTH_HAVING[unit] for unit in model.units])
    least[model.nuisance] = 0.0  # the set-up has to be free
    found = sort_out(root, model.names, first=model.nuisance, least=least)
    out = {model.names[k]: why for k, why in zip(found.left_out, found.why, strict=True)}
    out = {name: why for name, why in out.items() if not _places_setup(model, name)}
    if not out:
        return Reduction(model, model.names, (), ())
    blocks = [_without(block, set(out)) for block in model.parameters]
    reduced = model.with_parameters([b for b in blocks if b.size or b.tools or b.targets])
    return Reduction(reduced, reduced.names, tuple(out), tuple(out.values()))


def _places_setup(model: CalibrationModel, name: str) -> bool:
    return bool(model.nuisance[model.names.index(name)])


def _without(block: ParameterBlock, names: set[str]) -> ParameterBlock:
    kept = [name for name in block.names if name not in names]
    if len(kept) == block.size:
        return block
    if isinstance(block, LinkGeometry):
        return block.only(kept)
    return Part(block, kept)
