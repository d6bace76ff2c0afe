"""The predicted deviation of the tool point held against the error, model right and wrong."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from calib.identification import Against, tool_motion
from calib.model import CalibrationModel
from calib.model.measurements import TouchUp
from calib.model.parameters import AXES, JointCompliance, ParameterBlock, ToolPoint, ZeroOffsets
from calib.se3 import FloatArray, IntArray
from posedesign.candidates import CandidatePoses, cone_candidates
from posedesign.cell import Cell
from posedesign.selection import PER_MRAD_AND_MM, largest_deviation, mean_deviation, select
from studies.tool_errors import (
    Experiment,
    ToolErrors,
    box_postures,
    grid_pool,
    interval,
    simulate_errors,
    simulated_arm,
    study_cell,
)

CRITERIA = ("I", "G", "A", "D", "E", "C_G", "cond_2", "O1", "O2", "O3", "O4", "O5")
OF_THE_REGRESSOR = ("C_G", "cond_2")
"""As the paper has them, rows in metres; the others take rows over their noise."""


class Chooser:
    """A pool of one arm that is chosen from.

    Parameters
    ----------
    settings : dict
        The study's TOML.
    """

    def __init__(self, problem: str, settings: dict[str, Any]) -> None:
        own = settings["chosen"]
        arm, configurations = (settings["problems"][problem][k] for k in ("arm", "configurations"))
        self._settings, self._seed = own, settings["seed"]
        self.cell = study_cell(arm, settings["smallest_singular_value"])
        self.box = box_postures(self.cell, settings["arms"][arm])
        tilt, rng = float(np.deg2rad(own["tilt_deg"])), np.random.default_rng(settings["seed"])
        self.pool = cone_candidates(self.cell, tilt, own["candidates"], rng, configurations)
        self.model = self.cell.model()
        self.motion = tool_motion(self.model, self.box)
        self._linear = self.pool.linearise(self.model)

    def choose(self, name: str, poses: int) -> IntArray:
        """Rows of the pool."""
        white = PER_MRAD_AND_MM * self._linear.white_jacobian
        blocks = self._linear.jacobian if name in OF_THE_REGRESSOR else white
        criterion = {"I": mean_deviation(self.motion), "G": largest_deviation(self.motion)}
        return select(
            blocks, poses, criterion.get(name, name), starts=self._settings["starts"]
        ).indices

    def random(self, poses: int) -> float:
        """Predicted error of a random set [m]: the median of a few."""
        rng = np.random.default_rng([self._seed, 3, poses])
        found = []
        for _ in range(self._settings["random_sets"]):
            rows = rng.choice(len(self.pool), poses, replace=False)
            C = Experiment.of(self.model, self.pool.take(rows)).covariance
            variance = np.trace(
                self.motion @ C @ np.swapaxes(self.motion, -1, -2), axis1=1, axis2=2
            )
            found.append(np.sqrt(variance.mean()))
        return float(np.median(found))

    def errors(self, rows: IntArray, trials: int, stream: int) -> ToolErrors:
        """Simulated."""
        pool = self.pool.take(rows)
        arm = simulated_arm(self.cell, pool, self.cell.measurement)
        rng = np.random.default_rng([self._seed, 4, stream])
        return simulate_errors(arm, Experiment.of(self.model, pool), self.box, trials, rng)


def chosen(
    problem: str,
    settings: dict[str, Any],
    *,
    trials: int | None = None,
    criteria: tuple[str, ...] = CRITERIA,
    counts: tuple[int, ...] | None = None,
) -> list[dict[str, Any]]:
    """A row for each criterion and number of poses; the errors against those of I."""
    chooser, rows = Chooser(problem, settings), []
    for poses in counts or settings["chosen"]["poses"]:
        best: ToolErrors | None = None
        random_m = chooser.random(poses)
        for name in criteria:
            stream = 100 * poses + CRITERIA.index(name)
            taken = chooser.choose(name, poses)
            errors = chooser.errors(taken, trials or settings["chosen"]["trials"], stream)
            best = best or errors
            rows.append({"problem": problem} | _row(name, poses, errors, best, random_m))
    return rows


def _row(
    name: str, poses: int, errors: ToolErrors, best: ToolErrors, random_m: float
) -> dict[str, Any]:
    times_low, times_high = interval(_times(errors, best))
    names = ("predicted_rms", "rms", "rms_low", "rms_high", "median_of_trials", "worst")
    in_mm = errors.figures_mm
    return {
        "criterion": name,
        "poses": poses,
        **{f"{key}_mm": in_mm[f"{key}_mm"] for key in (*names, "predicted_worst")},
        "times_I": errors.rms_m / best.rms_m,
        "times_I_low": times_low,
        "times_I_high": times_high,
        "predicted_times_I": errors.predicted_rms_m / best.predicted_rms_m,
        "random_predicted_rms_mm": 1e3 * random_m,
    }


def _times(errors: ToolErrors, best: ToolErrors) -> FloatArray:
    """Bootstrap samples ``(B,)`` of the ratio; the trials of the two sets are independent."""
    if errors is best:
        return np.ones(2)
    own, other = (np.sqrt(e.resampled.mean(axis=1)) for e in (errors, best))
    return np.asarray(own / np.roll(other, 1))  # both were resampled by the same draws


class Case(NamedTuple):
    """How the arm differs from what is identified."""

    says: str
    noise: FloatArray | None = None
    deflects: bool = False
    compliance: slice | None = None
    links: bool = False
    held: tuple[str, ...] = ()
    own_zero: bool = False


def cases(cell: Cell, settings: dict[str, Any]) -> dict[str, Case]:
    """By key: the model right first, then what it does not know."""
    sigma = np.array(cell.config.measurement.three_sigma_mm) / 3e3
    joint_3, joint_4 = cell.robot.joint_names[2:4]
    found = {
        "right": Case("nothing: noise as modelled, all parameters freed"),
        "base": Case("the zero of joint 1, where the base is the arm's own", own_zero=True),
        "joint 4": Case("the zero offset of joint 4 (.05 deg), held", held=(joint_4,)),
        "joint 3": Case("the zero offset of joint 3 (-.06 deg), held", held=(joint_3,)),
        "links": Case("links: .2 mm and .02 deg (one sigma) at joints 3 to 6", links=True),
        "noise": Case("noise twice as large", noise=settings["held"]["noise_factor"] * sigma),
        "axis": Case("noise largest along the tool's x, not its z", noise=sigma[[2, 1, 0]]),
        "equal": Case("noise equal along all axes, of the same sum", noise=_equal(sigma)),
    }
    if cell.deflects:
        found["deflection"] = Case("reducers that give way", deflects=True)
        found["compliance"] = Case(
            "the same, compliance of joints 2 and 3 freed", deflects=True, compliance=slice(1, 3)
        )
        found["all compliances"] = Case(
            "the same, compliance of joints 2 to 6 freed", deflects=True, compliance=slice(1, 6)
        )
    return found


def _equal(sigma: FloatArray) -> FloatArray:
    return np.full(3, np.sqrt(np.mean(sigma**2)))


class Holder:
    """Sets of poses of one arm, and what is found of them under each case."""

    def __init__(self, arm: str, settings: dict[str, Any]) -> None:
        self._own, self._seed = settings["held"], settings["seed"]
        self.cell = study_cell(arm, settings["smallest_singular_value"])
        self.box = box_postures(self.cell, settings["arms"][arm])
        self.cases = cases(self.cell, settings)

    def sets(self) -> dict[str, CandidatePoses]:
        """The paper's grid, and two choices by I."""
        tilt = float(np.deg2rad(self._own["tilt_deg"]))
        model, found = (
            self.cell.model(),
            {"W P R grid": grid_pool(self.cell, self._own["grid_deg"])},
        )
        criterion = mean_deviation(tool_motion(model, self.box))
        for name, configurations in (("chosen by I", "nearest"), ("over the back, by I", "all")):
            rng = np.random.default_rng(self._seed)
            pool = cone_candidates(self.cell, tilt, self._own["candidates"], rng, configurations)
            found[name] = pool.take(select(pool.white(model), 27, criterion).indices)
        return found

    def model(self, case: Case, pool: CandidatePoses) -> CalibrationModel:
        """What is identified in a case."""
        cell, robot = self.cell, self.cell.robot
        freed = [joint for joint in cell.offset_joints if joint not in case.held]
        blocks: list[ParameterBlock] = [ZeroOffsets(robot, freed)]
        if case.compliance is not None:
            loaded = robot.joint_names[case.compliance]
            blocks.append(JointCompliance(robot, loaded, cell.payload))
        blocks += [ToolPoint(cell.tool_m), pool.target_points()]
        return CalibrationModel(robot, blocks, cell.measurement)

    def errors(
        self,
        case: Case,
        pool: CandidatePoses,
        trials: int,
        stream: list[int],
        against: Against = "base",
    ) -> ToolErrors:
        """Simulated, of one arm or of several whose links are drawn."""
        rng = np.random.default_rng([self._seed, 5, *stream])
        cell = self.cell
        noise = cell.measurement if case.noise is None else TouchUp(case.noise)
        experiment = Experiment.of(self.model(case, pool), pool)
        groups = min(self._own["arms_drawn"], trials) if case.links else 1
        parts = []
        for _ in range(groups):
            geometry = self._links(rng) if case.links else None
            arm = simulated_arm(cell, pool, noise, deflects=case.deflects, geometry=geometry)
            parts.append(
                simulate_errors(
                    arm,
                    experiment,
                    self.box,
                    trials // groups,
                    rng,
                    against,
                    own_zero=case.own_zero,
                )
            )
        return parts[0] if groups == 1 else ToolErrors.joined(parts)

    def _links(self, rng: np.random.Generator) -> dict[str, float]:
        """Errors of the links of joints 3 to 6: what comes before them places the base."""
        sizes = np.repeat([self._own["link_mm"] / 1e3, np.deg2rad(self._own["link_deg"])], 3)
        return {
            f"link.{joint}.{axis}": float(size * rng.standard_normal())
            for joint in self.cell.robot.joint_names[2:]
            for axis, size in zip(AXES, sizes, strict=True)
        }


def held(
    arm: str,
    settings: dict[str, Any],
    *,
    trials: int | None = None,
    keys: tuple[str, ...] | None = None,
) -> list[dict[str, Any]]:
    """A row for each set and case: predicted, found, and the ratio of the two."""
    holder, rows = Holder(arm, settings), []
    count = trials or settings["held"]["trials"]
    for s, (name, pool) in enumerate(holder.sets().items()):
        for k, (key, case) in enumerate(holder.cases.items()):
            if keys is not None and key not in keys:
                continue
            errors = holder.errors(case, pool, count, [s, k])
            seen = holder.errors(case, pool, count, [s, k], "target")
            low, high = interval(np.sqrt(errors.resampled.mean(axis=1)) / errors.predicted_rms_m)
            in_mm = errors.figures_mm
            row: dict[str, Any] = {"set": name, "case": key, "says": case.says}
            row |= {
                f"{k}_mm": in_mm[f"{k}_mm"] for k in ("predicted_rms", "rms", "median_of_trials")
            }
            row |= {"ratio": errors.ratio, "ratio_low": low, "ratio_high": high}
            rows.append(row | {"to_target_ratio": seen.ratio, "failed": errors.failed})
    return rows
