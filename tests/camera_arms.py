"""Pictures of a board by arms that are off as real arms are, and what is true of them."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from calib.hand_eye import Pictures
from calib.identification.prior_arms import PriorArms
from calib.model import CalibrationModel
from calib.model.measurements import CameraPose
from calib.model.measurements.board_view import Carried
from calib.model.parameters import TargetFrame, ToolFrame
from calib.se3 import FloatArray, inverse, rotation_exp, transform
from posedesign.cell import Cell, cell_template
from posedesign.cell.board_set_up import BoardSetUp
from posedesign.cell.file import parse_config
from posedesign.cell.models import robot_blocks
from posedesign.cell.reference import USUAL_SIZES

ARMS = ("ur5e", "irb120", "panda", "kr6r900sixx")
"""Presets: light and small arms, with six joints and with seven."""

PIXEL_SIGMA = 0.05
"""Noise of a coordinate of a point [px]: of a good detection."""


@cache
def camera_cell(preset: str, carried: Carried) -> Cell:
    """Return the cell that ``posedesign new --camera`` writes, without obstacles."""
    mount = "flange" if carried == "camera" else "fixed"
    raw = tomllib.loads(cell_template(preset, camera=mount))
    raw["constraints"]["collisions"] = False
    raw.pop("obstacle", None)
    raw["measurement"]["kind"] = "board"
    return Cell.from_config(parse_config(raw, Path("cell.toml")), Path("cell.toml"))


@dataclass(frozen=True, eq=False)
class DrawnArm:
    """An arm that is off, with a camera and a board."""

    cell: Cell
    model: CalibrationModel
    values: FloatArray  # (p,): true parameters [SI]
    deviation_rad: float  # of each joint, new at each stop
    set_up: BoardSetUp  # where camera and board are

    @classmethod
    def of(
        cls,
        cell: Cell,
        rng: np.random.Generator,
        words: tuple[str, ...] = ("geometry", "compliance", "priors"),
        deviation_rad: float = 5e-6,
    ) -> DrawnArm:
        """Draw an arm whose errors have the usual sizes; camera and board are where they are."""
        there = cell.board_set_up
        frames = [ToolFrame(there.X), TargetFrame(there.Z, "target")]
        blocks = robot_blocks(cell, words) if words else []
        model = CalibrationModel(cell.robot, [*blocks, *frames], CameraPose(np.full(6, 1e-4)))
        arms = PriorArms.of(model, USUAL_SIZES, deviation_rad)
        sigma = np.where(np.isfinite(model.prior), model.prior, 0.0)
        for columns, size in arms.kinds:
            sigma[columns] *= size.share * size.factor ** rng.standard_normal()
        values = model.nominal + sigma * rng.standard_normal(model.p)
        stiff = np.array([name.startswith(("compliance", "bearing")) for name in model.names])
        return cls(cell, model, np.where(stiff, np.abs(values), values), deviation_rad, there)

    def stands(self, q: FloatArray, rng: np.random.Generator | None = None) -> FloatArray:
        """Return the true poses ``T_base_tip`` (N, 4, 4) at joints that the controller shows."""
        if rng is not None:
            q = q + self.deviation_rad * rng.standard_normal(q.shape)
        return self.model.tip_poses(q, self.values)

    def views(
        self, count: int, rng: np.random.Generator, tilt: float = 0.6, spread: float = 0.15
    ) -> FloatArray:
        """Return postures (count, n) [rad] from which the board is seen, drawn at random."""
        there = self.set_up
        middle, found = there.board.points.mean(axis=0), list[FloatArray]()
        while len(found) < count:
            R = rotation_exp(rng.uniform(-tilt, tilt, 3) * [1.0, 1.0, 2.0])
            far = rng.uniform(there.nearest_m, there.farthest_m)
            place = far * np.array([*rng.uniform(-spread, spread, 2), 1.0]) - R @ middle
            T = transform(R, place)
            flange = (
                there.Z @ inverse(T) @ inverse(there.X)
                if there.carried == "camera"
                else there.Z @ T @ inverse(there.X)
            )
            q, reached = self.cell.robot.inverse(
                flange[None], near=self.cell.base_posture
            ).nearest()
            if reached[0]:
                found.append(q[0])
        return np.array(found)

    def boards(self, flange: FloatArray) -> FloatArray:
        """Return the true poses ``T_camera_board`` (N, 4, 4) at poses of the flange."""
        there = self.set_up
        if there.carried == "camera":
            return np.asarray(inverse(flange @ there.X) @ there.Z)
        return np.asarray(inverse(there.Z) @ flange @ there.X)

    def pictures(
        self, q: FloatArray, rng: np.random.Generator, sigma_px: float = PIXEL_SIGMA
    ) -> Pictures:
        """Return what is found in pictures that are taken at joints ``(N, n)``."""
        there = self.set_up
        T, points = self.boards(self.stands(q, rng)), there.board.points
        seen = np.einsum("nij,kj->nki", T[:, :3, :3], points) + T[:, None, :3, 3]
        pixels = there.lens.project(seen)
        pixels = pixels + sigma_px * rng.standard_normal(pixels.shape)
        size = np.array([there.lens.width_px, there.lens.height_px])
        pixels[~((pixels > 5) & (pixels < size - 5)).all(axis=-1)] = np.nan
        size_px = there.lens.width_px, there.lens.height_px
        return Pictures(self.cell.robot, q, pixels, points, size_px, there.carried)

    def apart(self, q: FloatArray, X: FloatArray, Z: FloatArray) -> FloatArray:
        """Return how far the arm is (N,) [m] from the board's middle as the camera has it.

        At fresh joints, the arm as its controller has it, with X and Z as they were found.
        """
        there, flange = self.set_up, self.cell.robot.fk(q)
        middle = np.append(there.board.points.mean(axis=0), 1.0)
        seen = self.boards(self.stands(q)) @ middle
        if there.carried == "camera":
            off = X @ seen[..., None] - (inverse(flange) @ Z @ middle)[..., None]
        else:
            off = Z @ seen[..., None] - (flange @ X @ middle)[..., None]
        return np.asarray(np.linalg.norm(off[:, :3, 0], axis=1))
