"""How many of the poses that have any feasible posture at all are repaired.

Cells of five arms with bounds drawn at random push grid poses out of limits, into obstacles or out
of view. Whether anything is feasible is settled by dense sampling of the touch-up manifold: all
orientations, all arm configurations.
"""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.errors import CalibError
from posedesign.cell import Cell, cell_template, touching_poses
from posedesign.cell.file import parse_config
from posedesign.cell.orientations import cone_rotations
from posedesign.planning.loop import Replacements, grid_poses, repair
from posedesign.planning.pose_plan import PoseStatus
from tests.marks import rest_in_full

PRESETS = ("r2000ic165f", "lrmate200id", "irb120", "kr6r900sixx", "ur5e")
DENSE_ORIENTATIONS, CHUNK = 20_000, 1_000
ASKED_FOR = 0.95


def random_cell(name: str, rng: np.random.Generator) -> Cell:
    """A cell with tight bounds of one or several kinds; some leave nothing at all."""
    raw: dict[str, Any] = tomllib.loads(cell_template(name))
    cell = Cell.from_config(parse_config(raw, Path("cell.toml")), Path("cell.toml"))
    kinds = rng.random(3) < 0.6
    if kinds[0]:
        tighten_limits(raw, cell, rng)
    if kinds[1]:
        put_up_a_wall(raw, cell, rng)
    if kinds[2]:
        narrow_the_view(raw, rng)
    return Cell.from_config(parse_config(raw, Path("cell.toml")), Path("cell.toml"))


def tighten_limits(raw: dict[str, Any], cell: Cell, rng: np.random.Generator) -> None:
    room = cell.robot.joint_range.min() / 2.0
    raw["plan"]["limit_margin_deg"] = float(np.rad2deg(room) * rng.uniform(0.2, 0.95))
    q = cell.base_posture + rng.uniform(-0.5, 0.5, cell.robot.n)
    q = np.clip(q, cell.robot.lower + 0.02, cell.robot.upper - 0.02)
    raw["base_pose"]["posture_deg"] = np.rad2deg(q).tolist()


def put_up_a_wall(raw: dict[str, Any], cell: Cell, rng: np.random.Generator) -> None:
    size = np.linalg.norm(cell.tool_m)  # of the tool [m]
    heading = rng.uniform(-np.pi, np.pi)
    away = 1e3 * size * rng.uniform(0.2, 1.2)
    x, y, z = 1e3 * cell.target_m
    raw["obstacle"].append(
        {
            "name": "wall",
            "size_mm": [70.0 * size, 4000.0 * size, 3000.0 * size],
            "at_mm": [x + away * np.cos(heading), y + away * np.sin(heading), z],
            "wpr_deg": [0.0, 0.0, float(np.rad2deg(heading))],
        }
    )
    raw["constraints"]["safety_distance_mm"] = float(rng.uniform(0.0, 150.0) * size)


def narrow_the_view(raw: dict[str, Any], rng: np.random.Generator) -> None:
    raw["camera"]["largest_tilt_deg"] = float(rng.uniform(3.0, 35.0))
    slant, heading = np.deg2rad(rng.uniform(0.0, 80.0)), rng.uniform(-np.pi, np.pi)
    normal = [np.sin(slant) * np.cos(heading), np.sin(slant) * np.sin(heading), np.cos(slant)]
    raw["target"]["normal"] = [float(v) for v in normal]


def any_feasible(cell: Cell, rng: np.random.Generator) -> bool:
    """Whether dense sampling finds a posture that keeps every constraint."""
    base = cell.robot.fk(cell.base_posture)[:3, :3]
    for _ in range(DENSE_ORIENTATIONS // CHUNK):
        rotations = cone_rotations(base, np.pi, CHUNK, rng)
        poses = touching_poses(rotations, cell.tool_m, cell.target_m)
        solutions = cell.robot.inverse(poses, near=cell.base_posture, margin=cell.margin)
        q = solutions.postures[solutions.inside]
        if len(q) and cell.checker.check(q, every=False).feasible.any():
            return True
    return False


@pytest.mark.slow
@pytest.mark.parametrize("least", rest_in_full((300, 1000), (300,)))
def test_repair_finds_what_there_is(least):
    rng = np.random.default_rng(11)
    repaired = feasible = hopeless = 0
    while feasible + hopeless < least:
        for name in PRESETS:
            try:
                cell = random_cell(name, rng)
            except CalibError:  # a target inside the wall, a margin that leaves nothing
                continue
            poses = grid_poses(cell, np.full(3, rng.uniform(15.0, 60.0)))
            dropped = [i for i, s in enumerate(poses.status) if s is PoseStatus.DROPPED]
            if not dropped:
                continue
            after = repair(cell, poses, Replacements(cell))
            done = [i for i in dropped if after.status[i] is PoseStatus.REPAIRED]
            assert cell.checker.check(after.kept).feasible.all()
            point = cell.robot.state(after.kept).point(cell.tool_m)
            assert np.abs(point - cell.target_m).max(initial=0.0) < 1e-8
            for i in dropped:
                assert after.reasons[i], "every pose that was dropped says why"
                assert ("turned by" in after.reasons[i]) == (i in done)
            if done or any_feasible(cell, rng):
                feasible += len(dropped)
                repaired += len(done)
            else:
                hopeless += len(dropped)
    print(f"{repaired} of {feasible} repaired, {hopeless} with nothing feasible")
    assert repaired >= ASKED_FOR * feasible
    assert hopeless > 0, "some cells must leave nothing, or the test tests little"
