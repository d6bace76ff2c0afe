"""Touch-ups at two of the Panda's sites as a pool, and what a fit to some is worth at the third."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from calib import CalibrationModel, Robot
from calib.identification import minimise, tool_motion
from calib.model.measurements import TouchUp, touch_ups
from calib.model.parameters import JointHarmonics, ParameterBlock, TargetPoints, ToolPoint
from calib.se3 import BoolArray, FloatArray, IntArray, apply
from posedesign.study.library import find_study
from studies.choices import Pool

touched = find_study("panda_touch_ups").load()
"""Study 02, which reads the recordings."""

SITES: list[str] = touched.SITES
SOCKETS = len(touched.SETTINGS["sockets"])


@dataclass(frozen=True, eq=False)
class Bench(Pool):
    """A model, the touch-ups at two sites, and the postures at the one held out."""

    q_out: FloatArray  # (M, 7): postures at the site held out [rad]
    socket_out: IntArray  # (M,): socket that each belongs to

    @cached_property
    def groups(self) -> list[IntArray]:
        """Touch-ups of each socket."""
        return [np.flatnonzero(self.data.target == k) for k in range(len(self.model.targets))]

    @cached_property
    def blocks(self) -> FloatArray:
        """Nominal blocks ``(N, 3, p)``, in ``sizes``."""
        found = self.model.linearise(self.data.postures, None, self.data.setup).white_jacobian
        return np.asarray(found * self.sizes)

    @cached_property
    def at_the_site(self) -> FloatArray:
        """How the ball moves at the site held out, ``(M, 3, p)`` [m], in ``sizes``.

        Against its mean at each socket, which is fitted there: what is left is what counts.
        """
        motion = tool_motion(self.model, self.q_out)
        return np.asarray(self._off_mean(motion) * self.sizes)

    @cached_property
    def at_the_sockets(self) -> FloatArray:
        """How the ball moves against its socket in all touch-ups of the pool, ``(N, 3, p)`` [m]."""
        q, setup = self.data.postures, self.data.setup
        return np.asarray(tool_motion(self.model, q, setup, against="target") * self.sizes)

    def _off_mean(self, values: FloatArray) -> FloatArray:
        """Values ``(M, ...)`` at the site held out less their means at each socket."""
        out = values.copy()
        for k in np.unique(self.socket_out):
            own = self.socket_out == k
            out[own] -= values[own].mean(axis=0)
        return out

    def held_out_mm(self, chosen: BoolArray) -> FloatArray:
        """Rms distance at the site held out ``(T,)`` after fits to the chosen ``(T, N)``.

        Its two sockets are fitted; arm, ball and priors know nothing of it.

        Raises
        ------
        RuntimeError
            A fit that has not converged.
        """
        trials = len(chosen)
        # from where all touch-ups lead: the fits to some end near by
        near = minimise(self.model, self.data.repeated(1), self.model.nominal[None])
        start = np.tile(near.x, (trials, 1))
        weights = chosen.astype(float)
        fit = minimise(self.model, self.data.repeated(trials), start, weights=weights)
        if not fit.converged.all():
            raise RuntimeError("a fit to some of the touch-ups has not converged")
        points = self.model.view(self.q_out, fit.x).tool_points.reshape(trials, -1, 3)
        off = self._off_mean(points.transpose(1, 0, 2))
        return np.asarray(1e3 * np.sqrt((off**2).sum(-1).mean(0)))


def bench_of(recorded: Any, row: dict[str, Any], site: int, settings: dict[str, Any]) -> Bench:
    """The bench of a row of the study's models, with one site held out."""
    robot = Robot.preset(touched.SETTINGS["robot"])
    own = recorded.site != site
    q, socket = recorded.q[own], recorded.socket[own]
    present, target = np.unique(socket, return_inverse=True)
    ball = np.array(settings["ball_mm"]) / 1e3
    points = apply(robot.fk(q), ball)
    places = [points[target == k].mean(axis=0) for k in range(len(present))]
    frames = [ToolPoint(ball), TargetPoints(places, [touched.LABELS[k] for k in present])]
    blocks = [*arm_blocks(robot, row), *frames]
    model = CalibrationModel(robot, blocks, TouchUp(settings["noise_m"]))
    sizes = np.where(np.isfinite(model.prior), model.prior, settings["set_up_size_m"])
    return Bench(
        model, touch_ups(q, target, model.targets), sizes, recorded.q[~own], recorded.socket[~own]
    )


def arm_blocks(robot: Robot, row: dict[str, Any]) -> list[ParameterBlock]:
    """What a row frees of the arm."""
    blocks: list[ParameterBlock] = touched.plain_blocks(robot, row)
    if "harmonics" in row:
        waves = row["harmonics"], row["harmonics_rad"]
        blocks.append(JointHarmonics(robot, robot.joint_names, *waves))
    return blocks
