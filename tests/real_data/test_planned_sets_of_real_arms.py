"""Poses planned for the arm that is fitted, against poses drawn at random, on arms that were real.

From all poses at which an arm was measured, some are chosen as a plan chooses them: least expected
error of the tool point over the workplace, after measuring them, of the arms of ``reference_of``.
No reading is used. The arm is identified from the readings of the chosen poses, with everything
that may be off held by priors whose sizes are found, as ``posedesign identify`` does. The other
poses are predicted. The rank of a choice is the share of random sets of as many poses that leave a
larger error.

A rank is a matter of chance, too: poses of real arms scatter by more than the instrument, and by
tails heavier than those of a normal distribution. Bounds are below the ranks that were found.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from calib.identification import tool_motion
from calib.identification.candidate import Fitted, Workplace, fit
from calib.identification.prediction import placed_anew
from calib.identification.prior_arms import PriorArms
from calib.identification.result import Loss
from calib.model import Setup
from calib.model.measurements import Measurements
from calib.robots import Robot
from calib.se3 import FloatArray, IntArray, apply, inverse
from posedesign.candidates import workplace
from posedesign.cell import Cell
from posedesign.cell.models import measuring_model
from posedesign.cell.observations import setup_of
from posedesign.cell.reference import reference_of
from posedesign.files.measurements import MeasurementTable
from posedesign.identification import identify_models
from posedesign.identification.models import Models
from posedesign.selection import mean_deviation, select, shortened

pytestmark = pytest.mark.real_data

FOLDER = Path(__file__).parents[2] / "studies" / "03_irb120_measuring_arm"
"""The study that reads the measuring arm."""

DRAWS = 200
BEST_QUARTER, TWO_THIRDS = 0.75, 2.0 / 3.0
SMR_MM = ((0.0, 0.0, 120.0), (80.0, 90.0, 210.0), (150.0, 0.0, 120.0))
"""Reflectors on the tool, to a centimetre."""
BALL_MM = (0.0, 0.0, 100.0)
SITES = ("front", "right", "back-high")
REFLECTOR_POSES = 500
FARTHEST_M = 10.0

IRB120 = """
[robot]
preset = "irb120"
tip = "tool0"
[tool]
point_mm = [0.0, 0.0, 0.0]
{marks}
[base_pose]
posture_deg = [0.0, 0.0, 0.0, 0.0, 30.0, 0.0]
[[target]]
name = "{target}"
kind = "point"
position_mm = [2500.0, 0.0, 500.0]
"""
MARK = '[[tool.mark]]\nname = "{}"\npoint_mm = [{:.1f}, {:.1f}, {:.1f}]\n'
NOISE = '[[noise]]\nkind = "point"\nthree_sigma_mm = 0.1\n'
"""For planning. Identification takes the noise from the residuals, as where a cell gives none."""

PANDA = """
[robot]
preset = "panda"
tip = "panda_link8"
[tool]
point_mm = {ball}
[base_pose]
posture_deg = {posture}
[measurement]
three_sigma_mm = [0.45, 0.45, 0.45]
{targets}
"""
SOCKET = '[[target]]\nname = "{}"\nposition_mm = [{:.1f}, {:.1f}, {:.1f}]\n'


@dataclass(frozen=True, eq=False)
class Pool:
    """Poses at which an arm was measured, a number of rows each."""

    planned: Cell  # says how well the instrument measures
    cell: Cell  # for identification
    data: Measurements
    kind: str
    which: IntArray  # (P,): observation of the cell that each pose is of
    loss: Loss = "least-squares"

    @property
    def rows_each(self) -> int:
        return self.data.count // len(self.which)

    @property
    def postures(self) -> FloatArray:
        return self.data.postures[:: self.rows_each]

    @cached_property
    def groups(self) -> list[IntArray]:
        """Poses of each observation: as many are chosen of each."""
        return [np.flatnonzero(self.which == k) for k in np.unique(self.which)]

    @cached_property
    def work(self) -> Workplace:
        return workplace(self.cell, self.data.postures, self.data.setup)

    def chosen(self, each: int, arms: PriorArms | None = None) -> IntArray:
        """As many poses of each observation, planned for arms: those of the cell by default.

        One observation after the other is chosen for anew, with what is chosen of the others known,
        until nothing changes.
        """
        arms = arms or reference_of(self.planned)
        seen = self.planned.observations
        setup = setup_of(
            self.planned, arms.model, seen, self.which, [None] * len(seen), self.postures
        )
        blocks = shortened(arms.blocks(arms.model.linearise(self.postures, None, setup)))
        moved = tool_motion(arms.model, self.work.postures, self.work.setup)
        points = arms.model.view(self.work.postures, None, self.work.setup).tool_points
        criterion = mean_deviation(placed_anew(moved, points))
        found = [own[np.linspace(0, len(own) - 1, each).astype(int)] for own in self.groups]
        for _ in range(8):
            before = np.concatenate(found)
            for k, own in enumerate(self.groups):
                others = [poses for i, poses in enumerate(found) if i != k]
                rows = [blocks[poses].reshape(-1, arms.model.p) for poses in others]
                known = np.vstack([arms.known_rows, *rows])
                found[k] = own[
                    select(blocks[own], each, criterion, known=known, bound=False).indices
                ]
            if len(found) == 1 or np.array_equal(np.concatenate(found), before):
                break
        return np.sort(np.concatenate(found))

    def drawn(self, each: int, rng: np.random.Generator) -> IntArray:
        return np.sort(np.concatenate([rng.permutation(own)[:each] for own in self.groups]))

    def table(self, poses: IntArray) -> MeasurementTable:
        rows = (poses[:, None] * self.rows_each + np.arange(self.rows_each)).ravel()
        return MeasurementTable(self.data[rows], (self.kind,), tuple(range(2, 2 + len(rows))))

    def fitted(self, poses: IntArray) -> Fitted:
        """Everything with priors, whose sizes and noise are found."""
        table = self.table(poses)
        reference = Models(self.cell, table).reference()[0]
        kinds = [kind.of_unknown_noise() for kind in reference.model.measurements]
        free = replace(reference, model=reference.model.with_measurements(kinds))
        return fit(free, table.data, loss=self.loss)

    def left_mm(self, found: Fitted, poses: IntArray) -> float:
        """Error at the poses that were not chosen, rms: frames as they were fitted."""
        data, x = self.data, found.result.values
        rows = found.model.linearise(data.postures, x, data.setup, data.observed).rows
        squares = np.sum(np.asarray(rows).reshape(len(self.which), -1) ** 2, axis=1)
        rest = np.delete(squares, poses) / self.rows_each
        return float(1e3 * np.sqrt(rest.mean()))


@dataclass(frozen=True, eq=False, kw_only=True)
class TwoSites(Pool):
    """Touch-ups at the sockets of two sites; a third site is held out."""

    held_out: FloatArray  # (M, 7): its postures [rad]
    socket: IntArray  # (M,): that each is of

    def left_mm(self, found: Fitted, poses: IntArray) -> float:
        """Error at the site held out, rms: its sockets are fitted, nothing else."""
        setup = Setup.of(len(self.held_out))
        points = found.model.view(self.held_out, found.result.values, setup).tool_points
        own = [points[self.socket == k] for k in (0, 1)]
        off = np.concatenate([at - at.mean(axis=0) for at in own])
        return float(1e3 * np.sqrt(np.mean(np.sum(off**2, axis=1))))


@dataclass(frozen=True)
class Judged:
    """Sets of all pools together: errors at the poses that are predicted, rms [mm]."""

    planned_mm: float
    for_offsets_mm: float  # of sets that are planned for zero offsets only, as by Watanabe et al.
    drawn_mm: FloatArray
    planned_over_all: float
    drawn_over_all: FloatArray
    """planned_over_all, drawn_over_all: over what the fit to all poses leaves at the same ones. The
    poses of a plan lie far out, where arms scatter more: those that are left are easier."""

    @property
    def rank_over_all(self) -> float:
        return float(np.mean(self.drawn_over_all > self.planned_over_all))

    @property
    def rank(self) -> float:
        """Share of the random sets that leave more than the planned ones."""
        return float(np.mean(self.drawn_mm > self.planned_mm))

    @property
    def over_median(self) -> float:
        return float(self.planned_mm / np.median(self.drawn_mm))


def judged(pools: Sequence[Pool], each: int, draws: int) -> Judged:
    """As many poses of each observation: planned, and drawn at random so many times."""
    left, best = [], []
    for k, pool in enumerate(pools):
        rng = np.random.default_rng([8, each, k])
        sets = [pool.chosen(each), pool.chosen(each, of_the_offsets(pool.planned))]
        sets += [pool.drawn(each, rng) for _ in range(draws)]
        left.append([pool.left_mm(pool.fitted(poses), poses) for poses in sets])
        whole = pool.fitted(np.arange(len(pool.which)))
        best.append([pool.left_mm(whole, poses) for poses in sets])
    error, least = (np.sqrt(np.mean(np.square(of), axis=0)) for of in (left, best))
    ratio = error / least
    return Judged(float(error[0]), float(error[1]), error[2:], float(ratio[0]), ratio[2:])


def of_the_offsets(cell: Cell) -> PriorArms:
    """Arms that only have zero offsets, of which nothing is known before."""
    return PriorArms(measuring_model(cell, cell.observations, ("zero_offsets",)))


def irb120_cells(
    names: Sequence[str], at_mm: Sequence[Sequence[float]], target: str
) -> tuple[Cell, Cell]:
    marks = "".join(MARK.format(name, *at) for name, at in zip(names, at_mm, strict=True))
    text = IRB120.format(marks=marks, target=target)
    return Cell.from_text(text + NOISE), Cell.from_text(text)


@pytest.fixture(scope="module")
def arm_pool(study: ModuleType, data_folder: Path) -> Pool:
    """36 poses of an IRB 120, three points of the tool each, by a measuring arm."""
    folder = data_folder / "identification" / "abb_irb120"
    if not folder.is_dir():
        pytest.skip(f"{folder} does not exist")
    recorded = study.load(data_folder)
    at_zero = inverse(Robot.preset("irb120").fk(np.zeros(6))) @ recorded.T_base_arm
    names, count = ("P1", "P2", "P3"), len(recorded.q)
    cells = irb120_cells(names, 1e3 * apply(at_zero, recorded.zero), "arm")
    data = Measurements(
        np.repeat(recorded.q, 3, axis=0),
        Setup.of(3 * count, tool=np.tile(range(3), count)),
        ("arm",),
        names,
        recorded.points.reshape(-1, 3),
        tuple(f"C{i:02d}" for i in range(count) for _ in names),
    )
    return Pool(*cells, data, "point", np.zeros(count, dtype=int))


@pytest.fixture(scope="module")
def tracker_pool(data_folder: Path) -> Pool:
    """500 poses of another IRB 120, three reflectors each, by a laser tracker.

    Lines of reference nests on the base are left out, and so are poses with lines that cannot be.
    """
    folder = data_folder / "identification" / "irb120_tracker"
    if not folder.is_dir():
        pytest.skip(f"{folder} does not exist")
    with (folder / "joints.csv").open(encoding="utf-8") as file:
        joints = {
            r["pose"]: [float(r[f"j{k}_deg"]) for k in range(1, 7)] for r in csv.DictReader(file)
        }
    read: dict[str, dict[str, list[float]]] = {}
    for line in (folder / "tracker.txt").read_text(encoding="utf-8").splitlines():
        pose, name, *xyz = line.split()
        if name.startswith("SMR"):
            read.setdefault(pose, {})[name] = [float(v) / 1e3 for v in xyz]
    names = ("SMR1", "SMR2", "SMR3")
    poses = [pose for pose in list(joints)[:REFLECTOR_POSES] if set(read[pose]) == set(names)]
    observed = np.array([[read[pose][name] for name in names] for pose in poses])
    far = np.linalg.norm(observed, axis=2)
    good = np.all((far > 1e-3) & (far < FARTHEST_M), axis=1)
    poses, observed = [p for p, own in zip(poses, good, strict=True) if own], observed[good]
    data = Measurements(
        np.repeat(np.deg2rad([joints[pose] for pose in poses]), 3, axis=0),
        Setup.of(3 * len(poses), tool=np.tile(range(3), len(poses))),
        ("tracker",),
        names,
        observed.reshape(-1, 3),
        tuple(pose for pose in poses for _ in names),
    )
    cells = irb120_cells(names, SMR_MM, "tracker")
    return Pool(*cells, data, "point", np.zeros(len(poses), dtype=int), "student-t")


@pytest.fixture(scope="module")
def panda_pools(data_folder: Path) -> list[Pool]:
    """Touch-ups of a Panda at two of its sites, one pool for each site held out."""
    folder = data_folder / "identification" / "panda_ball_in_socket"
    if not folder.is_dir():
        pytest.skip(f"{folder} does not exist")
    return [without_site(folder, site) for site in SITES]


def without_site(folder: Path, out: str) -> Pool:
    def at(site: str) -> list[FloatArray]:
        own = folder / site
        return [np.loadtxt(own / f"hole_{k}.csv", delimiter=",", ndmin=2) for k in (0, 1)]

    sites = [site for site in SITES if site != out]
    holes = [hole for site in sites for hole in at(site)]
    names = [f"{site.replace('-', '_')}_{k}" for site in sites for k in (0, 1)]
    state = [apply(Robot.preset("panda").fk(q), 1e-3 * np.array(BALL_MM)) for q in holes]
    sockets = [
        SOCKET.format(name, *(1e3 * points.mean(axis=0)))
        for name, points in zip(names, state, strict=True)
    ]
    posture = np.round(np.rad2deg(holes[0][0]), 2).tolist()
    text = PANDA.format(ball=list(BALL_MM), posture=posture, targets="".join(sockets))
    cell = Cell.from_text(text)
    which = np.repeat(np.arange(len(holes)), [len(q) for q in holes])
    data = Measurements(
        np.vstack(holes), Setup.of(len(which), target=which), tuple(names), ("tool",)
    )
    left = at(out)
    socket = np.repeat([0, 1], [len(q) for q in left])
    return TwoSites(cell, cell, data, "touch-up", which, held_out=np.vstack(left), socket=socket)


@pytest.mark.xfail(
    strict=True,
    reason="with the workplace filled evenly .725 of the random sets leave more, not .75",
)
@pytest.mark.slow
def test_twelve_poses_under_a_measuring_arm_are_in_the_best_quarter(arm_pool):
    found = judged([arm_pool], 12, DRAWS)
    assert found.rank >= BEST_QUARTER
    assert found.rank_over_all >= TWO_THIRDS
    assert found.planned_mm < 0.85 * found.for_offsets_mm


@pytest.mark.slow
def test_nine_poses_under_a_measuring_arm_are_better_than_two_random_sets_of_three(arm_pool):
    found = judged([arm_pool], 9, DRAWS)
    assert found.rank >= TWO_THIRDS
    assert found.planned_mm < found.for_offsets_mm


@pytest.mark.slow
def test_sixty_poses_under_a_tracker_are_in_the_best_quarter(tracker_pool):
    found = judged([tracker_pool], 60, DRAWS)
    assert found.rank >= BEST_QUARTER
    assert found.rank_over_all >= TWO_THIRDS
    assert found.planned_mm < 0.95 * found.for_offsets_mm


@pytest.mark.slow
def test_touch_ups_of_two_sites_are_worth_as_much_as_those_drawn_at_the_third(panda_pools):
    """No gain is measured here, and hardly any expected.

    Of the error to expect at the third site the planned sets take five per cent. What random sets
    leave there scatters by twenty, and hardly goes with the error to expect of them.
    """
    found = judged(panda_pools, 10, DRAWS)
    assert found.over_median < 1.1


def test_no_reading_is_seen_by_a_plan(arm_pool):
    noise = np.random.default_rng(1).normal(size=(arm_pool.data.count, 3))
    other = replace(arm_pool, data=replace(arm_pool.data, observed=noise))
    np.testing.assert_array_equal(arm_pool.chosen(9), other.chosen(9))


def test_as_many_touch_ups_are_chosen_at_each_socket(panda_pools):
    pool = panda_pools[1]
    np.testing.assert_array_equal(np.bincount(pool.which[pool.chosen(10)]), [10] * 4)


@pytest.mark.slow
def test_fits_are_those_of_identify(arm_pool, tracker_pool, panda_pools):
    """Of the model that all others are judged by: everything with priors."""
    for pool, each in ((arm_pool, 12), (tracker_pool, 60), (panda_pools[2], 10)):
        poses = pool.drawn(each, np.random.default_rng(5))
        judge = identify_models(pool.cell, pool.table(poses)).judge
        assert judge is not None
        # which loss it is goes by the tails of the residuals of each set
        own = replace(pool, loss=judge.loss)
        left = own.left_mm(own.fitted(poses), poses)
        assert left == pytest.approx(own.left_mm(judge.fitted, poses), rel=0.05)
