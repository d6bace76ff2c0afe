"""The same touch-ups, and the same pool of poses, by figaroh.

It is driven as its documentation has it: a URDF, which this project writes, a file of settings, a
table of measurements, and a class with a cost function. Its selection of parameters for a world of
which only one point is known is overruled by the ten of the study; all else is its own.
"""

from __future__ import annotations

import importlib
import logging
import warnings
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import yaml

from calib import Robot
from calib.robots.urdf_anew import urdf_of
from calib.se3 import FloatArray

from .peer_touch_ups import TouchUps

BASE = ("base_px", "base_py", "base_pz")
TIP = ("pEEx_1", "pEEy_1", "pEEz_1")


@cache
def module(name: str) -> ModuleType:
    """A module of figaroh, imported once; what it imports warns of its own age."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = importlib.import_module(f"figaroh.{name}")
    logging.getLogger("figaroh").setLevel(logging.ERROR)
    return found


@cache
def _class() -> type:
    tools = module("calibration.calibration_tools")

    class TouchUpCalibration(module("calibration.base_calibration").BaseCalibration):  # type: ignore[misc]
        """Positions weighed alike, as the only weight that figaroh has for them."""

        def cost_function(self, var: FloatArray) -> FloatArray:
            seen = tools.calc_updated_fkm(
                self.model, self.data, var, self.q_measured, self.calib_config
            )
            return self.apply_measurement_weighting(
                self._compute_logmap_residuals(self.PEE_measured, seen)
            )

    return TouchUpCalibration


class Figaroh:
    """An arm of figaroh with touch-ups of one trial.

    Parameters
    ----------
    folder : Path
        For the files that it reads.
    """

    def __init__(self, problem: TouchUps, trial: int, folder: Path) -> None:
        robot = problem.model.robot
        self._problem = problem
        loaded = loaded_arm(robot, folder)
        q = problem.postures(trial)
        header = ",".join(["x1", "y1", "z1", *robot.joint_names])
        table = np.hstack([np.zeros((len(q), 3)), q])
        np.savetxt(folder / "touch_ups.csv", table, "%.17g", ",", header=header, comments="")
        (folder / "figaroh.yaml").write_text(yaml.safe_dump(_settings(robot, folder, len(q))))
        self.calibration = _class()(loaded, str(folder / "figaroh.yaml"))
        self.calibration.calib_config |= {"known_baseframe": False, "known_tipframe": False}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self.calibration.initialize()
        self.own_parameters = tuple(self.calibration.calib_config["param_name"])
        freed = [f"offsetRZ_{name}" for name in robot.joint_names[1:5]]
        self.calibration.calib_config["param_name"] = [*BASE, *freed, *TIP]

    def start(self) -> FloatArray:
        """The parameters as supposed ``(10,)``, in figaroh's order."""
        nominal = self._problem.model.nominal
        return np.concatenate([-nominal[7:], np.zeros(4), nominal[4:7]])

    def points(self, q: FloatArray) -> FloatArray:
        """Tool points ``(N, 3)`` seen from the target, in base axes [m], by its kinematics."""
        tools, own = module("calibration.calibration_tools"), self.calibration
        config = own.calib_config | {"NbSample": len(q)}
        flat = tools.calc_updated_fkm(own.model, own.data, self.start(), q, config)
        return np.asarray(flat).reshape(3, -1).T

    def fit(self) -> FloatArray:
        """The ten parameters ``(10,)`` as the model of this project has them."""
        found = self.calibration.solve_optimisation(var_init=self.start())[0].x
        return np.concatenate([found[3:7], found[7:], -found[:3]])

    def absorbed(self, joint: str) -> bool:
        """Whether its own selection drops the offset of a joint, added to the ten."""
        tools, own = module("calibration.calibration_tools"), self.calibration
        names = [*own.calib_config["param_name"], f"offsetRZ_{joint}"]
        config = own.calib_config | {"param_name": names}
        J = tools.measurement_jacobian(
            own.model, own.data, np.append(self.start(), 0.0), own.q_measured, config
        )
        frames = (*BASE, *TIP)
        return names[-1] in tools.select_identifiable_parameters(J, names, frames)[1]


def loaded_arm(robot: Robot, folder: Path) -> Any:
    """The arm as figaroh loads it from a URDF of this project."""
    path = folder / "arm.urdf"
    path.write_bytes(urdf_of(robot, "for figaroh"))
    return module("tools.load_robot").load_robot(str(path), package_dirs=str(folder))


def _settings(robot: Robot, folder: Path, poses: int) -> dict[str, Any]:
    task = {
        "enabled": True,
        "type": "kinematic_calibration",
        "parameters": {"calibration_level": "joint_offset"},
        "kinematics": {"base_frame": "universe", "tool_frame": robot.tip_frame},
        "measurements": {"markers": [{"measurable_dof": [True] * 3 + [False] * 3}]},
        "data": {"source_file": str(folder / "touch_ups.csv"), "number_of_samples": poses},
    }
    return {"robot": {"name": "arm"}, "tasks": {"calibration": task}}


def weights(information: FloatArray) -> FloatArray:
    """D-optimal weights ``(N,)`` of information matrices ``(N, p, p)``, by its cone programme."""
    pool = dict(enumerate(information))
    optimizer = module("optimal.base_optimal_calibration").SOCPOptimizer
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.array(optimizer(pool, {"NbSample": len(pool)}).solve()[0])


def detmax(information: FloatArray, n: int) -> tuple[list[int], int]:
    """The poses that its DetMax ends with, and how many its result ``cur_set`` has.

    The class leaves the set in a local name; the last one that it judges is the one it ends with.
    """

    class Watched(module("optimal.base_optimal_calibration").Detmax):  # type: ignore[misc]
        def get_critD(self, set: list[int]) -> float:
            self.judged = list(set)
            return float(super().get_critD(set))

    search = Watched(dict(enumerate(information)), n)
    search.main_algo()
    return search.judged, len(search.cur_set)
