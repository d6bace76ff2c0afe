"""What poses are worth beside chosen ones, and what else would be worth more than any choice.

On arms that are touched up, two targets a metre apart in height and postures over the back of the
arm told more than any variation of W, P and R: see the studies of what buys accuracy. Whether that
is so in a cell, a choice out of a small pool of each says in a tenth of a second.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.errors import CalibError
from calib.identification import ExpectedError, Workplace, tool_motion
from calib.identification.prior_arms import PriorArms
from calib.one_thread import one_numpy_thread
from calib.se3 import FloatArray, IntArray
from posedesign.candidates import functions_over_work, workplace_of
from posedesign.candidates.workplaces import small_pool_of
from posedesign.cell import Cell
from posedesign.planning.loop import arms_told_by
from posedesign.planning.optimal.request import IN_MM, Request, accuracy_of, objective_of
from posedesign.selection import select

NOTICEABLE = 0.9
"""Part of the predicted error below which a choice is worth a word."""

WORTH_MORE = 0.8
"""The same for a change of the cell, which takes more than another option of a command."""

PASSES = 2
"""Passes of the exchange that looks for the best choice out of a small pool. On five presets what
they came to was 0 to 1.4 % above what as many passes as help came to, in two fifths of the time;
the small pool itself is off by more."""

NEARLY = 1.05
"""What a choice after one pass may be above what is worth a word, to be looked at again: on
seven presets a second pass took off 1.3 % at most."""

BAR_SIGMA_M = 2e-5
"""Standard deviation of the length of a bar by touch-ups of its ends."""

APART_M = 1.0
"""Height of a second target over the first, or below it; of small arms less."""

APART_OF_REACH = 0.3
"""The most of it, as a part of the arm's reach."""


@dataclass(frozen=True)
class Outlook:
    """Error to expect of the tool point where the arm will work."""

    tcp_m: float
    tcp_worst_m: float
    """tcp_m, tcp_worst_m: root mean square error of the poses, in the mean over the places and
    where it is largest [m]; infinite where they do not identify everything."""
    chosen_tcp_m: float | None
    """In the mean, of the best choice of as many poses out of a small pool that keeps all
    constraints but those on the motions between poses; None where there is no such choice."""
    box_words: str  # where the arm will work, in words
    advice: str = ""
    """What would lower the error of the best choice, with the error of as many poses chosen
    then."""
    scale: str = ""  # what a known length would buy, in words; empty where it is little
    expected: ExpectedError | None = None  # the error in the mean with its range over arms

    @property
    def chosen_is_better(self) -> bool:
        """Return True if chosen poses promise noticeably less error: by a tenth or more."""
        return self.chosen_tcp_m is not None and self.chosen_tcp_m < NOTICEABLE * self.tcp_m


@one_numpy_thread
def outlook_of(cell: Cell, postures: FloatArray) -> Outlook:
    """Predict what postures ``(N, n)`` [rad] are worth, and what chosen ones would be.

    All are of the first observation of the cell, as those of the loop.
    """
    cell = cell if cell.is_hand_eye else cell.parts[0]
    arms = arms_told_by(cell, postures, np.zeros(len(postures), dtype=np.intp))
    functions, words = functions_over_work(cell, arms.model)
    count = len(postures)
    objective = objective_of(Request(count=count), arms, functions)
    own = accuracy_of(objective, arms, functions, cell.linearise(arms.model, postures))
    scale = length_advice(cell, arms, functions, postures, np.zeros(count, dtype=np.intp))
    found = Outlook(own.tcp_m, own.tcp_worst_m, None, words, expected=own.expected, scale=scale)
    if not cell.config.measurement.weighted:  # such an estimate cannot be chosen for pose by pose
        return found
    chosen = _chosen_tcp_m(cell, count)
    return replace(found, chosen_tcp_m=chosen, advice=advice_for(cell, count, chosen))


def length_advice(
    cell: Cell, arms: PriorArms, functions: FloatArray, postures: FloatArray, which: IntArray
) -> str:
    """Say what of the expected error a known length would take off; or nothing.

    Touch-ups do not see the scale of an arm: an arm, a tool and targets twice as large touch alike.
    Its lengths then rest on their drawing, by their priors. A bar of known length, both ends of
    which are touched, is one more row: the distance of the tool point between two postures as far
    apart as any where the arm will work.

    ``postures`` (N, n): measuring postures [rad] of observations ``which`` (N,).
    """
    if cell.is_hand_eye or not len(arms.known_rows):
        return ""
    at, model = workplace_of(cell), arms.model
    points = model.view(at.postures, None, at.setup).tool_points
    apart = np.linalg.norm(points[:, None] - points, axis=-1)
    ends = np.array(np.unravel_index(np.argmax(apart), apart.shape))
    length_m = float(apart[tuple(ends)])
    if length_m <= 0.0:
        return ""
    along = (points[ends[0]] - points[ends[1]]) / length_m
    moved = tool_motion(model, at.postures[ends], at.setup[ends])
    setup = cell.setup(model, postures, which)
    blocks = arms.blocks(model.linearise(postures, setup=setup)).reshape(-1, model.p)
    bar = along @ (moved[0] - moved[1]) / BAR_SIGMA_M
    before = arms.expected_error(blocks[None], functions).rms_m
    after = arms.expected_error(np.vstack([blocks, bar])[None], functions).rms_m
    if not after < WORTH_MORE * before:
        return ""
    return (
        f"the length of the arm rests on its drawing, for nothing measured shows it: a bar of "
        f"{1e3 * length_m:.0f} mm, known to {3e3 * BAR_SIGMA_M:.2g} mm and touched at both ends, "
        f"would bring the error from {1e3 * before:.2g} to {1e3 * after:.2g} mm"
    )


def advice_for(cell: Cell, count: int, chosen_m: float | None = None) -> str:
    """What of the cell would have to change for clearly less error, in words; or nothing.

    ``chosen_m``: error [m] of as many poses chosen in the cell as it is, where it is known.
    """
    if not cell.is_plain or not cell.config.measurement.weighted:
        return ""
    before = _chosen_tcp_m(cell, count) if chosen_m is None else chosen_m
    if before is None:
        return ""
    at = workplace_of(cell)  # the arm will work there, whatever it is measured at
    found = [
        (tcp_m, words)
        for words, other in _changes(cell)
        if (roughly_m := _chosen_tcp_m(other, count, at, passes=1))
        and roughly_m < NEARLY * WORTH_MORE * before
        and (tcp_m := _chosen_tcp_m(other, count, at))
    ]
    said = [
        f"{words}: about {1e3 * tcp_m:.2g} mm, {before / tcp_m:.2g} times less"
        for tcp_m, words in sorted(found)
        if tcp_m < WORTH_MORE * before
    ]
    return "; ".join(said)


def _changes(cell: Cell) -> Iterator[tuple[str, Cell]]:
    """Cells that differ in what is worth most, in words."""
    if cell.config.pool.configurations != "all":
        pool = cell.config.pool.model_copy(update={"configurations": "all"})
        yield 'pool.configurations = "all"', _with(cell, pool=pool)
    apart_m = min(APART_M, APART_OF_REACH * cell.robot.chain.reach_m)
    for sign, words in ((1.0, "above"), (-1.0, "below")):
        x, y, z = (1e3 * cell.target_m).tolist()
        place = x, y, z + sign * 1e3 * apart_m
        other = cell.config.target.model_copy(
            update={"name": f"{cell.config.target.name} {words}", "position_mm": place}
        )
        second = f"a second [[target]] {1e3 * apart_m:.0f} mm {words} this one"
        yield second, _with(cell, other_targets=(other,))


def _with(cell: Cell, **sections: object) -> Cell:
    return replace(cell, config=cell.config.model_copy(update=sections))


def _chosen_tcp_m(
    cell: Cell, count: int, at: Workplace | None = None, passes: int = PASSES
) -> float | None:
    """Error of the tool point [m] of the best of a small pool; None where there is no such pool.

    ``at``: where the arm will work, if that is not found from the cell.
    """
    try:
        pool = small_pool_of(cell)
        arms = arms_told_by(cell, pool.postures, pool.of)
        functions, _ = functions_over_work(cell, arms.model, at)
        objective = objective_of(Request(count=count), arms, functions)
        blocks = objective.of_pool(arms.model, pool)
        found = select(
            blocks,
            count,
            objective.criterion,
            known=objective.known,
            starts=1,
            passes=passes,
            bound=False,
        )
    except CalibError:  # no pool, or too small a one: there is nothing to compare with
        return None
    return found.value / IN_MM if np.isfinite(found.value) else None
