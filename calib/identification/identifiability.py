"""What a set of measurements can tell about each parameter, before a number is returned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.errors import CalibError, InputError, NotIdentifiableError
from calib.identification.least_squares import first_guess
from calib.identification.result import SIZES
from calib.identification.robust import fit_robustly
from calib.model import CalibrationModel, Linearisation, Setup, touch
from calib.model.measurements import Measurements
from calib.model.parameters import LinkGeometry, Part
from calib.se3 import BoolArray, FloatArray

RANK_TOLERANCE = 1e-9
"""Smallest singular value, relative to the largest, of columns of unit length that still counts.
Analytic Jacobians leave about 1e-15 where a direction is invisible, and the worst measuring sets
met in practice stay above 1e-6."""

_SHARE = 0.02
"""Parameters whose weight in an invisible combination is below this are not named in it."""


def is_identifiable(jacobian: FloatArray) -> bool:
    """Whether the stacked Jacobian ``(M, p)`` can tell all its parameters apart."""
    length = np.linalg.norm(jacobian, axis=0)
    if not (length > RANK_TOLERANCE * length.max(initial=0.0)).all():
        return False
    if jacobian.shape[0] < jacobian.shape[1]:
        return False
    values = np.linalg.svd(jacobian / length, compute_uv=False)
    return bool(values.size == 0 or values[-1] > RANK_TOLERANCE * values[0])


@dataclass(frozen=True)
class Sorting:
    """Parameters sorted into those that a Jacobian can tell apart and the rest."""

    kept: tuple[int, ...]  # columns, in order
    left_out: tuple[int, ...]
    why: tuple[str, ...]  # of each column left out, in words


def sort_out(
    jacobian: FloatArray,
    names: Sequence[str],
    *,
    first: BoolArray | None = None,
    least: FloatArray | None = None,
) -> Sorting:
    """Sort out the columns that lie in the span of those before them.

    Columns are brought to unit length, so that units do not matter, and taken in one by one.
    Gram-Schmidt, each column twice: what rounding leaves of the first pass goes in the second.

    Parameters
    ----------
    jacobian : array (M, p)
        All rows of all measurements; whitened where ``least`` is given.
    first : array (p,) of bool, optional
        Columns that are taken in before the others, whatever their place.
    least : array (p,), optional
        Length that a column must have left, besides being independent: the inverse of the largest
        standard deviation that is worth having.
    """
    length = np.linalg.norm(jacobian, axis=0)
    seen = length > RANK_TOLERANCE * length.max(initial=0.0)
    before = np.zeros(len(names), dtype=bool) if first is None else first
    needed = np.zeros(len(names)) if least is None else least
    order = sorted(range(len(names)), key=lambda k: (not before[k], k))
    kept: list[int] = []
    left_out: list[int] = [int(k) for k in np.flatnonzero(~seen)]
    why = [f"nothing measured depends on {names[k]}" for k in left_out]
    basis = np.zeros((jacobian.shape[0], 0))
    for k in (k for k in order if seen[k]):
        unit = jacobian[:, k] / length[k]
        rest = unit - basis @ (basis.T @ unit)
        rest -= basis @ (basis.T @ rest)
        left = float(np.linalg.norm(rest))
        if len(kept) < len(jacobian) and left > RANK_TOLERANCE and left * length[k] > needed[k]:
            kept.append(k)
            basis = np.column_stack([basis, rest / left])
        else:
            left_out.append(k)
            why.append(_absorbed_by(jacobian / np.where(seen, length, 1.0), k, kept, names))
    return Sorting(tuple(sorted(kept)), tuple(left_out), tuple(why))


def check_identifiable(
    jacobian: FloatArray, names: Sequence[str], nuisance: BoolArray | None = None
) -> None:
    """Refuse parameters that the stacked Jacobian cannot tell apart, or cannot see.

    Parameters
    ----------
    jacobian : array (M, p)
        Whitened or not; all rows of all measurements.
    nuisance : array (p,) of bool, optional
        Parameters of the set-up: they have to be free, so they are blamed last.

    Raises
    ------
    NotIdentifiableError
        Naming the parameters to leave out and the invisible combinations.
    """
    if is_identifiable(jacobian):
        return
    found = sort_out(jacobian, names, first=nuisance)
    if found.left_out:
        raise NotIdentifiableError([names[k] for k in found.left_out], found.why)


def check_believable(model: CalibrationModel, sigma: FloatArray) -> None:
    """Refuse parameters of standard deviations ``(p,)`` [SI] that are in practice unknown.

    What is known beforehand is known whatever was measured.
    """
    hopeless = [
        (name, f"{name} stays uncertain by {s * SIZES[unit].factor:.3g} {SIZES[unit].shown}")
        for name, unit, s, prior in zip(model.names, model.units, sigma, model.prior, strict=True)
        if not (s <= SIZES[unit].largest_sigma or np.isfinite(prior))
    ]
    if hopeless:
        raise NotIdentifiableError(
            [name for name, _ in hopeless],
            [f"in the noise, {why}" for _, why in hopeless],
            hint="measure poses that turn the tool farther, or free fewer parameters",
        )


_IN_WORDS = {"tool": "the tool point", "target": "the targets"}
_MOST_NAMED = 6


def _absorbed_by(unit: FloatArray, k: int, kept: list[int], names: Sequence[str]) -> str:
    if not kept:
        return f"{names[k]} stands alone and is not seen"
    weights = np.abs(np.linalg.lstsq(unit[:, kept], unit[:, k], rcond=None)[0])
    partners = sorted(kept[i] for i in np.flatnonzero(weights > _SHARE * weights.max()))
    listed = [names[i] for i in partners]
    shown = ", ".join(listed[:_MOST_NAMED])
    if len(listed) > _MOST_NAMED:
        shown += f" and {len(listed) - _MOST_NAMED} more"
    kinds = {name.partition(".")[0] for name in listed}
    if len(kinds) == 1 and kinds <= set(_IN_WORDS):
        shown = f"{_IN_WORDS[kinds.pop()]} ({shown})"
    return f"{names[k]} is absorbed by {shown}"


def covariance_of(
    model: CalibrationModel,
    q: FloatArray,
    x: FloatArray | None = None,
    setup: Setup | None = None,
    *,
    weighted: bool = True,
) -> FloatArray:
    """Covariance ``(p, p)`` [SI] that the noise of the measurement gives, before measuring.

    Weighted: ``(JᵀJ)⁻¹`` of the whitened Jacobian with what is known besides: the Cramér-Rao
    bound. Unweighted: the scatter of the paper's estimate (Eq. 8), ``G⁺ Σ G⁺ᵀ``, under the same
    noise. Infinite throughout where the postures do not identify all parameters.

    Raises
    ------
    InputError
        Priors or known distances in an unweighted estimate: there is nothing to weigh them by.
    """
    values = model.nominal if x is None else x
    linear = model.linearise(q, values, setup)
    return covariance_at(linear, weighted=weighted)


def covariance_at(
    linear: Linearisation, *, weighted: bool = True, noise: FloatArray | None = None
) -> FloatArray:
    """The same from a linearisation of one set that is there already.

    ``noise`` ``(K,)`` is what that of each kind really is, over the one that rows are weighed by.
    """
    model = linear.model
    white = triangle(linear.stacked()[1])
    if not is_identifiable(white):
        return np.full((model.p, model.p), np.inf)
    each = np.ones(linear.view.setup.count)
    if noise is not None:
        each = noise[linear.view.setup.kind]
    if weighted:
        root = np.linalg.inv(white)
        best = root @ root.T
        if noise is None:
            return np.asarray(best)
        rows = linear.stacked()[1]
        measured = np.repeat(each, len(linear.rows_last))
        rows[: measured.size] *= measured[:, None]
        spread = best @ rows.T
        return np.asarray(spread @ spread.T)
    check_unweighted(model)
    J = linear.jacobian
    gain = np.linalg.pinv(J.reshape(linear.rows_last.size, model.p))
    gain = gain.reshape(model.p, *linear.rows.shape)
    root = linear.noise_root * each[:, None, None]
    spread = np.einsum("pim,imk->pik", gain, root).reshape(model.p, gain.shape[1] * gain.shape[2])
    return np.asarray(spread @ spread.T)


def check_unweighted(model: CalibrationModel) -> None:
    """Refuse what an estimate that takes all rows alike cannot use."""
    if model.knows_besides:
        raise InputError(
            "priors and known distances need rows that are weighted by their noise",
            hint="weight them, or leave these out",
            name="weighted",
        )


def triangle(rows: FloatArray) -> FloatArray:
    """Rows ``(p, p)`` that say the same as ``(M, p)``: fewer where there are more than columns."""
    return np.asarray(np.linalg.qr(rows, mode="r")) if len(rows) > rows.shape[1] else rows


def check_enough(model: CalibrationModel, measurements: Measurements) -> None:
    """Check that measurements and model speak of the same things, with enough equations."""
    for found, known, what in (
        (measurements.targets, model.targets, "target"),
        (measurements.tools, model.tools, "tool"),
    ):
        if found != known:
            raise InputError(
                f"the measurements name the {what}s {', '.join(found)}, "
                f"the model {', '.join(known)}",
                name=what,
            )
    model.check_setup(measurements.setup, measurements.count)
    kinds = [model.measurements[k] for k in sorted(set(measurements.setup.kind.tolist()))]
    read = [kind.name for kind in kinds if kind.reads]
    if read and measurements.observed is None:
        raise InputError(f"there are no readings of the kind {read[0]}", name="observed")
    if measurements.observed is not None and measurements.observed.shape[-1] != model.rows:
        raise InputError(
            f"readings have {measurements.observed.shape[-1]} columns, the model {model.rows} rows",
            name="observed",
        )
    met = np.array([not kind.reads for kind in model.measurements])[measurements.setup.kind]
    if measurements.observed is not None and measurements.observed[..., met, :].any():
        raise InputError(
            "a touch-up has a reading: what the arm is moved for is met, not read",
            hint="leave the readings of touch-ups, view lines and planes zero",
            name="observed",
        )
    equations = model.equations(measurements.setup)
    known_besides = int(np.isfinite(model.prior).sum()) + len(model.distances)
    if equations + known_besides < model.p:
        rows = equations / max(measurements.count, 1)
        need = int(-(-(model.p - known_besides) // max(rows, 1.0)))
        open_ = model.p - known_besides
        raise InputError(
            f"{measurements.count} measurements give {equations} equations for {open_} parameters"
            + " that nothing else tells" * bool(known_besides),
            hint=f"measure at least {need} poses, better twice as many",
            name="measurements",
            value=equations,
            bound=model.p,
        )


def check_identifiable_at(
    model: CalibrationModel, measurements: Measurements, x: FloatArray
) -> None:
    """Check what measurements can tell, at parameters ``(p,)``.

    Raises NotIdentifiableError: parameters that they cannot tell apart, or whose standard deviation
    says nothing.
    """
    white = triangle(clean_root(model, measurements, x))
    check_identifiable(white, model.names, model.nuisance)
    if any(kind.estimated for kind in model.measurements):
        return  # nobody knows the noise yet: the result is judged by what it turns out to be
    # what the noise alone leaves unknown would wander off before it could be refused
    sigma = np.linalg.norm(np.linalg.inv(white), axis=1)
    check_believable(model, sigma)


def clean_root(model: CalibrationModel, measurements: Measurements, x: FloatArray) -> FloatArray:
    """Rows ``(M, p)`` over their noise of all that is known, with the residuals taken out.

    A residual lends a hidden parameter a false hold: turning the whole arm about its base turns
    every residual with it, so that the Jacobian is not quite singular, though nothing has been
    seen. Postures of a touch-up are therefore first moved, by as little as the residuals, onto
    the target; readings do not enter the Jacobian to begin with.
    """
    setup, q = measurements.setup, measurements.postures
    if not all(kind.reads for kind in model.measurements):
        q, _ = touch(model, q, x, setup, hold_orientation=False)
    return model.linearise(q, x, setup).stacked()[1]


@dataclass(frozen=True, eq=False)
class Reduction:
    """A model without the parameters that measurements cannot tell."""

    model: CalibrationModel
    left_out: tuple[str, ...]
    merged: tuple[str, ...]  # for each left out, in words, what it shows up in


def reduce(model: CalibrationModel, data: Measurements, x: FloatArray | None = None) -> Reduction:
    """Leave out robot parameters that these measurements cannot tell from those before them.

    At the nominal arm, where axes that are meant to be parallel are: the set does not hang on
    noise. The set-up comes first, then the blocks as the model lists them, so that a shift along
    parallel axes stays with the first of them, and a turn about a joint axis with the zero offset
    where that is free. Looked for at parameters ``(p,)``, the first guess by default.
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
    least = np.array([1.0 / SIZES[unit].worth_having for unit in model.units])
    least[model.nuisance] = 0.0  # the set-up has to be free
    found = sort_out(root, model.names, first=model.nuisance, least=least)
    pairs = zip(found.left_out, found.why, strict=True)
    out = {model.names[k]: why for k, why in pairs if not model.nuisance[k]}
    if not out:
        return Reduction(model, (), ())
    blocks = []
    for block in model.parameters:
        kept = [name for name in block.names if name not in out]
        if len(kept) < block.size:
            block = block.only(kept) if isinstance(block, LinkGeometry) else Part(block, kept)
        if block.size or block.tools or block.targets:
            blocks.append(block)
    reduced = model.with_parameters(blocks)
    return Reduction(reduced, tuple(out), tuple(out.values()))


UNSEEN_SCALE = 2e-3
"""Standard deviation of the scale of all lengths, as a share, that says it is not seen: 2 mm in a
metre is more than any arm is built off."""


def unseen_scale(linear: Linearisation) -> float:
    """Standard deviation, as a share, that measurements leave to the scale of all lengths.

    Zero where the model does not free all of them: the links that are held carry the scale. Touch-
    ups leave it open altogether: an arm, a tool and targets twice as large touch alike.
    """
    model = linear.model
    way = np.concatenate(
        [
            b.scaling(linear.values[part, 0])
            for b, part in zip(model.parameters, model.slices, strict=True)
        ]
    )
    if not way.any():
        return 0.0
    held = int(np.isfinite(model.prior).sum())
    J = linear.stacked()[1]
    J = np.delete(J, slice(linear.rows_last.size, linear.rows_last.size + held), axis=0)
    seen = J @ way
    # what is left over grows, too, but has seen nothing
    seen[: linear.white_rows.size] -= linear.white_rows.ravel()
    # the set-up follows as it can: the tool also for the flange, which is no link and stays
    around = J[:, model.nuisance]
    seen -= around @ np.linalg.lstsq(around, seen, rcond=None)[0]
    size = float(np.linalg.norm(seen))
    return 1.0 / size if size > 0 else np.inf
