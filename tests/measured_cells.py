"""Cells of several arms that measure by whatever there is: text of each, by kind.

Poses are planned for zero offsets, tool and target alone: few enough for many identifications.
"""

from functools import cache
from pathlib import Path

import numpy as np

from calib.identification import covariance_of, identify_batch
from posedesign.cell import Cell
from posedesign.planning.optimal import OptimalPlan, Request, plan_optimal
from posedesign.simulation import SimulatedRobot

POSES = 24
TRIALS = 200

ARMS = {
    "kr6r900sixx": (0.0, -70.0, 100.0, 0.0, 60.0, 0.0),
    "irb120": (0.0, 10.0, 20.0, 0.0, 50.0, 0.0),
    "ur10e": (0.0, -90.0, 100.0, -100.0, -90.0, 0.0),
    "r2000ic165f": (0.0, 15.0, -25.0, 0.0, -50.0, 0.0),
}
"""Base postures [deg] of presets."""

URDFS = {
    "m20ia.urdf": (0.0, 20.0, -10.0, 0.0, -60.0, 0.0),
    "panda.urdf": (0.0, 10.0, 0.0, -110.0, 0.0, 120.0, 45.0),
}
"""Of descriptions that come with the data."""

MARKS = """
[[tool.mark]]
name = "R1"
point_mm = [60.0, 0.0, 80.0]
axis = [1.0, 0.0, 0.0]
largest_angle_deg = 60.0
[[tool.mark]]
name = "R2"
point_mm = [-30.0, 52.0, 80.0]
axis = [-0.5, 0.866, 0.0]
largest_angle_deg = 60.0
[[tool.mark]]
name = "R3"
point_mm = [-30.0, -52.0, 80.0]
"""
PINS = """
[[tool.mark]]
name = "long"
point_mm = [0.0, 0.0, 160.0]
[[tool.mark]]
name = "side"
point_mm = [60.0, 0.0, 100.0]
"""
TRACKER = """
[[noise]]
kind = "point"
three_sigma_mm = 0.03
along_three_sigma_mm_per_m = 0.02
across_three_sigma_mm_per_m = 0.1
"""
_AROUND = {
    "low": (-0.1, 0.15, -0.15),
    "high": (0.0, -0.1, 0.15),
    "tracker": (2.5, 1.0, 0.3),
    "A": (0.1, 0.1, -0.2),
    "B": (0.1, -0.25, -0.1),
    "C": (-0.2, 0.2, -0.1),
    "table": (0.0, 0.0, 0.0),
    "wall": (0.1, 0.0, 0.1),
    "side": (0.0, 0.15, 0.1),
    "T1": (0.0, 0.0, 0.0),
}
"""Where targets are, from the tool point of the base pose, in reaches of the arm."""

KINDS = (
    "touch-up",
    "view-line",
    "two targets",
    "two pins",
    "planes",
    "reflectors",
    "one reflector",
    "point",
    "pose",
    "distances",
    "mixed",
    "payloads",
)


def cell_text(kind: str, robot: str, posture_deg: tuple[float, ...]) -> str:
    """Text of a cell; ``robot`` is its line in the section."""
    one = MARKS.partition('[[tool.mark]]\nname = "R2"')[0]
    marks = {"reflectors": MARKS, "one reflector": one, "two pins": PINS}.get(kind, "")
    head = (
        f"[robot]\n{robot}\n[tool]\npoint_mm = [40.0, 10.0, 120.0]\n{marks}"
        f"[base_pose]\nposture_deg = {list(posture_deg)}\n"
    )
    rigid = "[truth]\ndeflection = false\n"
    cell = Cell.from_text(head)
    reach_mm = 1e3 * cell.robot.chain.reach_m

    def target(name: str, more: str = "") -> str:
        place = [
            round(1e3 * float(at) + reach_mm * off, 1)
            for at, off in zip(cell.target_m, _AROUND[name], strict=True)
        ]
        return f'[[target]]\nname = "{name}"\nposition_mm = {place}\n{more}'

    def measured(name: str) -> str:
        return f'[measurement]\nkind = "{name}"\n'

    bar = f"nearest_mm = 100.0\nfarthest_mm = {0.6 * reach_mm:.1f}\n"
    plane = 'size_mm = [300.0, 300.0]\n[[noise]]\nkind = "plane"\nthree_sigma_mm = 0.05\n'
    faces = {"table": [0.1, 0.0, 1.0], "wall": [-1.0, 0.0, 0.1], "side": [0.0, -1.0, 0.1]}
    text = {
        "touch-up": "",
        "view-line": measured("view-line"),
        "two targets": target("low") + target("high"),
        "two pins": "",
        "planes": measured("plane")
        + "".join(target(n, f"normal = {v}\nsize_mm = [300.0, 300.0]\n") for n, v in faces.items())
        + plane.partition("\n")[2],
        "reflectors": measured("point") + target("tracker", "wpr_deg = [0, 0, 150]\n") + TRACKER,
        "one reflector": measured("point") + target("tracker") + TRACKER,
        "point": measured("point") + target("tracker") + TRACKER,
        "pose": measured("pose")
        + target("tracker")
        + '[[noise]]\nkind = "pose"\nthree_sigma_mm = 0.3\nthree_sigma_deg = 0.06\n',
        "distances": measured("distance")
        + "".join(target(name, bar) for name in "ABC")
        + '[[noise]]\nkind = "distance"\nthree_sigma_mm = 0.03\n',
        "mixed": target("T1") + target("tracker", 'kind = "point"\n') + TRACKER,
        "payloads": '[measurement]\npayloads = ["weight"]\n[[payload]]\nname = "weight"\n'
        "mass_kg = 4.0\ncom_mm = [0.0, 0.0, 80.0]\n",
    }[kind]
    words = '["zero_offsets"]'
    if kind == "payloads" and cell.robot.link_mass.any() and cell.robot.stiffness is not None:
        rigid, words = "", '["zero_offsets", "compliance"]'
    return head + text + rigid + f"[parameters]\nplanned = {words}\n"


@cache
def measured_cell(kind: str, arm: str, folder: Path | None = None) -> Cell:
    """A cell of a preset, or of a description in a folder."""
    if folder is None:
        text = cell_text(kind, f'preset = "{arm}"', ARMS[arm]) + "[pool]\ncandidates = 100\n"
    else:
        # without shapes of its own
        robot = f'urdf = "{folder / arm}"\ncapsule_radius_mm = 60.0'
        # touch-ups move the tool by millimetres: farther from singularities than usual
        text = cell_text(kind, robot, URDFS[arm]) + "[pool]\nsmallest_singular_value = 0.06\n"
    return Cell.from_text(text)


def planned(cell: Cell, poses: int = POSES) -> OptimalPlan:
    """The best so many poses of a cell, which several tests look at."""
    return _planned(cell, poses)


@cache
def _planned(cell: Cell, poses: int) -> OptimalPlan:
    return plan_optimal(cell, Request(count=poses, beside=0))


def scatter_over_predicted(cell: Cell, poses: int = POSES) -> np.ndarray:
    """Scatter of identified parameters over that predicted, ``(p,)``."""
    chosen = planned(cell, poses)
    robot, which = SimulatedRobot.of(cell), cell.which(chosen.labels)
    names = [str(i) for i in range(len(which))]
    rng = np.random.default_rng(3)
    data = robot.measure(chosen.postures, which, names, rng, trials=TRIALS)
    model = chosen.model
    values = identify_batch(model, data.with_labels(model.targets, model.tools))
    sigma = np.sqrt(np.diag(covariance_of(model, chosen.postures, setup=chosen.setup)))
    np.testing.assert_allclose(sigma, chosen.accuracy.sigma, rtol=1e-9)
    return np.asarray(values.std(axis=0, ddof=1) / sigma)


def check_scatter(found: np.ndarray) -> None:
    """Each parameter's scatter has a standard deviation of 1 / sqrt(2 T); all are correlated."""
    assert 0.9 < np.sqrt(np.mean(found**2)) < 1.1
    assert np.abs(found - 1.0).max() < 5.0 / np.sqrt(2.0 * TRIALS)
