"""Whether a robot is still the one that was identified: which poses tell, and what has moved.

Watched are the zeros of all joints (a hit, a motor changed), also of what slides and carries the
arm, the points of the tool, and the targets or instruments. The model is the one of the
identification that says most of the arm, with its covariance: what the identification left open is
no change. See :mod:`posedesign.acceptance.drift` for the test.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.errors import InputError
from calib.model import CalibrationModel, Setup
from calib.model.measurements import KINDS, Measurement, Measurements
from calib.se3 import FloatArray
from posedesign.acceptance.drift import Cause, Pool, Recheck, Whitened, choose, judge_change, whiten
from posedesign.candidates import CandidatePoses, away_from_singularities, candidates_of
from posedesign.cell import Cell
from posedesign.cell.models import noise_of_kind
from posedesign.files.measurements import TOOL, MeasurementTable
from posedesign.identification.file import IdentifiedModel, Noise
from posedesign.identification.models import model_of
from posedesign.motion import Router
from posedesign.motion.route import Route
from posedesign.planning.optimal.choose import (
    ATTEMPTS,
    as_pose_set,
    no_clear_way,
    without_unreached,
)
from posedesign.planning.pose_plan import PoseSet

COUNTS = (3, 4, 5)
USUAL = 4
MOST = 20

AT_ONCE = 300
"""Candidates that are chosen from: drawn from the pool."""

UNSEEN_RAD = np.deg2rad(2.0)
"""Smallest change of a zero from which on poses do not tell it: nobody needs a test for that."""

_SHIFTS, _TURNS = ("x", "y", "z"), ("rx", "ry", "rz")


@dataclass(frozen=True, eq=False)
class Watch:
    """An identified arm with all that may have moved since."""

    model: CalibrationModel
    """Frees the identified parameters, and every zero, tool and target besides."""
    x: FloatArray  # (P,) [SI]
    covariance: FloatArray  # (P, P) [SI]
    causes: tuple[Cause, ...]
    anew: FloatArray  # (P, f): what of the set-up stands anew

    @classmethod
    def of(
        cls,
        cell: Cell,
        known: IdentifiedModel,
        noise: Mapping[str, Noise],
        kinds: Sequence[str],
        *,
        set_up_anew: bool = False,
    ) -> Watch:
        """The watch of an identification.

        ``known``: the model that says most of the arm. ``noise``: by kind of measurement, as the
        identification found it. ``kinds``: what is measured in the recheck. ``set_up_anew``:
        targets and instruments stand elsewhere than in the identification: where is found with the
        test, and tells nothing then. Raises InputError: an identification without a covariance.
        """
        if known.covariance is None:
            raise InputError(
                "the identification has no covariance: nothing says how well the arm is known",
                hint="identify again",
                name="covariance",
            )
        # of a positioner all but that which moves the base: it moves the targets, too
        robot = cell.robot
        joints = (*robot.joint_names[1 : robot.floor], *robot.joint_names[robot.floor :])
        units = ["m" if unit == "mm" else "rad" for unit in robot.joint_units[-len(joints) :]]
        wanted = [f"zero_offset.{joint}" for joint in joints]
        wanted += [f"{_tool(label)}.{axis}" for label in known.model.tools for axis in _SHIFTS]
        given = known.model.names
        model = model_of(cell, list(dict.fromkeys([*given, *wanted])))
        model = model.with_measurements([_kind(cell, kind, noise) for kind in kinds])
        x = model.nominal.copy()
        own = np.array([model.names.index(name) for name in given])
        x[own] = known.x
        C = np.zeros((model.p, model.p))
        C[np.ix_(own, own)] = known.covariance
        causes = [
            _cause(model, f"zero of {joint}", [[f"zero_offset.{joint}"]], unit)
            for joint, unit in zip(joints, units, strict=True)
        ]
        tools = [[f"{_tool(label)}.{axis}" for label in model.tools] for axis in _SHIFTS]
        causes.append(_cause(model, "the tool", tools, "m"))
        if len(model.tools) > 1:
            causes += [
                _cause(model, f"the mark {label}", [[f"tool.{label}.{a}"] for a in _SHIFTS], "m")
                for label in model.tools
            ]
        frames = [
            [name for axis in (*_SHIFTS, *_TURNS) if (name := f"target.{t}.{axis}") in model.names]
            for t in model.targets
        ]
        placed = [
            _cause(model, t, [[n] for n in own], "m")
            for t, own in zip(model.targets, frames, strict=True)
            if own
        ]
        anew = np.zeros((model.p, 0))
        if set_up_anew:
            anew = np.hstack([anew, *(cause.combined for cause in placed)])
        else:
            causes += placed
        return cls(model, x, C, tuple(causes), anew)

    def told_by(self, q: FloatArray, setup: Setup) -> Whitened:
        """What postures ``(N, n)`` [rad] will tell."""
        J = self.model.linearise(q, self.x, setup).white_jacobian.reshape(-1, self.model.p)
        return whiten(J, self.covariance, self.causes, self.anew)

    def test(self, table: MeasurementTable) -> Recheck:
        """Test what was measured since."""
        data = self._in_own_words(table)
        linear = self.model.linearise_at(data, self.x)
        J = linear.white_jacobian.reshape(-1, self.model.p)
        rows = linear.view.posture_first(linear.white_last[0]).reshape(-1)
        # rows are predictions less readings: a change shows with the other sign
        return judge_change(whiten(J, self.covariance, self.causes, self.anew, -rows), self.causes)

    def _in_own_words(self, table: MeasurementTable) -> Measurements:
        names = [kind.name for kind in self.model.measurements]
        place = np.array([names.index(kind) for kind in table.kinds], dtype=np.intp)
        data = table.data.with_labels(self.model.targets, self.model.tools)
        return replace(data, setup=replace(data.setup, kind=place[data.setup.kind])).at_stops()


def _tool(label: str) -> str:
    return "tool" if label == TOOL else f"tool.{label}"


def _cause(
    model: CalibrationModel, name: str, numbers: Sequence[Sequence[str]], unit: str
) -> Cause:
    """A cause of as many numbers, each of which moves the parameters of its names alike."""
    combined = np.zeros((model.p, len(numbers)))
    for k, names in enumerate(numbers):
        combined[[model.names.index(n) for n in names], k] = 1.0
    return Cause(name, combined, unit)


def _kind(cell: Cell, name: str, noise: Mapping[str, Noise]) -> Measurement:
    """A kind with the noise that the identification was made with, or that it found."""
    if name not in noise:
        return noise_of_kind(cell, name)
    found = noise[name]
    sigma = np.array(found.sigma_si)
    kind = KINDS[name](sigma) if found.estimated else noise_of_kind(cell, name)
    kind = kind.with_deviation(found.arm_sigma_si)
    more = found.residuals_over_noise
    if found.doubted and more is not None:
        return kind.with_noise(more)
    return kind.with_noise(found.tails) if found.tails != 1.0 else kind


@dataclass(frozen=True, eq=False)
class RecheckPlan:
    """Poses of a recheck."""

    poses: PoseSet
    route: Route
    told: Whitened  # what they tell
    watch: Watch
    by_count: Mapping[int, float]
    """By the number of poses, smallest change [rad] that the best of the pool find of the zero that
    they find worst."""
    blind: tuple[str, ...]  # joints whose zero nothing in the pool tells

    def smallest(self) -> dict[str, float]:
        """By cause, the smallest change [rad, m] found with a chance of 90 %."""
        return {cause.name: self.told.smallest(cause.name) for cause in self.watch.causes}


def plan_recheck(cell: Cell, watch: Watch, count: int = USUAL) -> RecheckPlan:
    """Choose the poses that tell a change of the weakest zero best.

    Raises InputError: fewer poses than tell anything, or no clear way to them.
    """
    if not 1 <= count <= MOST:
        raise InputError(f"{count} poses", hint=f"ask for 1 to {MOST}", name="poses")
    pool = _of_identified(cell, watch, candidates_of(away_from_singularities(cell)))
    rng = np.random.default_rng(0)
    if len(pool) > AT_ONCE:
        pool = pool.take(np.sort(rng.choice(len(pool), AT_ONCE, replace=False)))
    router, why = Router.of_cell(cell), ""
    for attempt in range(ATTEMPTS):
        arrays, blind = _arrays(cell, watch, pool)
        rows, _ = choose(arrays, count, np.random.default_rng(0))
        route = router.route(pool.postures[rows], pool.loads[rows])
        if not route.lost:
            break
        why = next(iter(route.lost.values()))
        pool = without_unreached(router, pool, rows[list(route.lost)], attempt)
        if len(pool) < count or attempt == ATTEMPTS - 1:
            raise no_clear_way(why)
    chosen = pool.take(rows)
    told = watch.told_by(chosen.postures, _setup(cell, watch, chosen))
    by_count = {}
    for k in sorted({*COUNTS, count}):
        if k > len(pool):
            continue
        best = rows if k == count else choose(arrays, k, np.random.default_rng(0))[0]
        some = pool.take(best)
        try:
            each = watch.told_by(some.postures, _setup(cell, watch, some))
        except InputError:  # as many poses tell nothing
            continue
        zeros = [c.name for c in watch.causes if c.unit == "rad" and c.name not in blind]
        by_count[k] = max(each.smallest(name) for name in zeros)
    return RecheckPlan(as_pose_set(chosen), route, told, watch, by_count, blind)


def _setup(cell: Cell, watch: Watch, pool: CandidatePoses) -> Setup:
    """What is measured at poses, in the words of the watch."""
    if cell.is_plain:  # the one target may have another name in the identification
        return Setup.of(len(pool))
    return pool.setup(watch.model)


def _of_identified(cell: Cell, watch: Watch, pool: CandidatePoses) -> CandidatePoses:
    """The poses of targets and tools that were identified: others have nothing to be held against.

    Raises InputError: there are none.
    """
    if cell.is_plain:
        return pool
    tools, targets = watch.model.tools, watch.model.targets
    known = np.array(
        [seen.target in targets and set(seen.tools) <= {*tools} for seen in cell.observations]
    )
    if not known[pool.of].any():
        raise InputError(
            f"nothing that the cell measures was identified: that was of {', '.join(targets)} by "
            f"{', '.join(tools)}",
            hint="give the cell that was identified",
            name="target",
        )
    return pool.take(known[pool.of])


def _arrays(cell: Cell, watch: Watch, pool: CandidatePoses) -> tuple[Pool, tuple[str, ...]]:
    """Candidates as arrays, and zeros that none of them tell."""
    setup = _setup(cell, watch, pool)
    blocks = watch.model.linearise(pool.postures, watch.x, setup).white_jacobian
    zeros = [cause for cause in watch.causes if cause.unit == "rad"]
    watched = np.hstack([cause.combined for cause in zeros])
    arrays = Pool(blocks, watch.covariance, watched, watch.anew)
    some = np.linspace(0, len(pool) - 1, min(len(pool), MOST)).astype(np.intp)
    seen = np.sqrt(arrays.information(some[None])[0]) * UNSEEN_RAD > 4.0
    blind = tuple(cause.name for cause, s in zip(zeros, seen, strict=True) if not s)
    if not seen.any():
        raise InputError(
            "no pose of the pool tells a change of any zero",
            hint="leave the set-up where it was, or measure otherwise",
            name="poses",
        )
    return replace(arrays, watched=watched[:, seen]), blind
