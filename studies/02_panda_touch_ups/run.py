"""Run the study: ``posedesign study run panda_touch_ups``.

It needs measurements that the project does not contain, see :mod:`studies.real_data`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib import CalibrationModel, IdentificationResult, Robot, identify
from calib.identification import PriorGroup, tune_priors
from calib.model.measurements import TouchUp, touch_ups
from calib.model.parameters import (
    BearingCompliance,
    JointCompliance,
    JointHarmonics,
    LinkGeometry,
    LostMotion,
    ParameterBlock,
    TargetPoints,
    ToolPoint,
    ZeroOffsets,
)
from calib.se3 import FloatArray, IntArray, apply
from posedesign.study import Advance, Options
from studies import drawing, writing
from studies.real_data import data_with

SETTINGS = writing.settings_of(__file__)
SITES: list[str] = SETTINGS["sites"]
LABELS = [f"{site}_{socket}" for site in SITES for socket in SETTINGS["sockets"]]
TOLERANCE_MM = 0.005
"""Of the figures on another machine: fits end within a thousandth of what they are worth."""

RECORDINGS = "identification/panda_ball_in_socket"
TABLE, FIGURE = "panda_touch_ups.csv", "panda_touch_ups"
DIGITS = 6
"""Significant digits in the table."""


def study(options: Options) -> dict[str, Any]:
    """Which errors of a real arm do touch-ups tell of?

    The touch-ups are what they are and nothing is drawn at random: a number of trials is ignored.
    """
    rows = run(data_with(RECORDINGS) / RECORDINGS, advance=options.advance)
    flat = [{name: value for name, value in row.items() if name != "sizes"} for row in rows]
    writing.write_rows(options.out, TABLE, flat, DIGITS)
    found = {"tolerance_mm": TOLERANCE_MM, "models": rows}
    writing.write_figures(options.out, found)
    return found


def plot(folder: Path) -> list[Path]:
    """Held-out rms of each model, a mark for each site."""
    rows = writing.read_rows(folder, TABLE)
    off = {site: [row[f"held_out_{site}_mm"] for row in rows] for site in SITES}
    names = [row["model"] for row in rows]
    at_sites = dict(zip(names, zip(*off.values(), strict=True), strict=True))
    best, offsets = min(names, key=lambda name: sum(at_sites[name])), names[1]
    told = [f"{min(at_sites[k]):.2g} to {max(at_sites[k]):.2g} mm" for k in (best, offsets)]
    figure = drawing.figure_of_marks(
        names,
        off,
        [0.3, 0.5, 1.0, 2.0, 5.0, 10.0],
        "rms distance at the site that took no part in the fit",
        f"A site that took no part is predicted to {told[0]} by all of it ({best}), to {told[1]} "
        f"by {offsets}",
        legend="site",
    )
    return writing.save(figure, folder, FIGURE)


@dataclass(frozen=True)
class Recorded:
    """Postures (N, 7) [rad], the socket that the ball sat in (N,), and its site (N,)."""

    q: FloatArray
    socket: IntArray
    site: IntArray


@dataclass(frozen=True)
class Fitted:
    """A model as fitted to some sites."""

    model: CalibrationModel
    result: IdentificationResult
    sizes: dict[str, float]


def load(folder: Path) -> Recorded:
    q, socket = [], []
    for k, label in enumerate(LABELS):
        site, _, hole = label.rpartition("_")
        q.append(np.loadtxt(folder / site / f"hole_{hole}.csv", delimiter=","))
        socket += [k] * len(q[-1])
    index = np.array(socket)
    return Recorded(np.vstack(q), index, index // len(SETTINGS["sockets"]))


def plain_blocks(robot: Robot, row: dict[str, Any]) -> list[ParameterBlock]:
    """Offsets and links that a row frees, with the priors that it gives."""
    blocks: list[ParameterBlock] = []
    if "offsets" in row:
        blocks.append(ZeroOffsets(robot, [robot.joint_names[j - 1] for j in row["offsets"]]))
    if "prior_m" in row:
        blocks.append(LinkGeometry(robot, prior_m=row["prior_m"], prior_rad=row["prior_rad"]))
    return blocks


def blocks_of(robot: Robot, row: dict[str, Any]) -> tuple[list[ParameterBlock], list[PriorGroup]]:
    """What a row of the table frees besides ball and sockets, and what of it is tuned."""
    joints = list(robot.joint_names)
    loaded = [joints[j - 1] for j in SETTINGS["loaded_joints"]]
    make: dict[str, Callable[[], ParameterBlock]] = {
        "harmonics": lambda: JointHarmonics(robot, joints, SETTINGS["harmonics"]),
        "compliance": lambda: JointCompliance(robot, loaded),
        "bearings": lambda: BearingCompliance(robot, joints),
        "lost_motion": lambda: LostMotion(robot, loaded, SETTINGS["lost_motion_nm"]),
    }
    blocks = plain_blocks(robot, row)
    groups: list[PriorGroup] = []

    def tune(kind: str, names: tuple[str, ...], unit: str) -> None:
        groups.append(PriorGroup(kind.replace("_", " "), names, *SETTINGS["bounds"][kind + unit]))

    for kind in row.get("tuned", ()):
        if kind == "geometry":  # a turn about the joint's axis is its offset, of another size
            offsets = ZeroOffsets(robot, joints)
            across = [f"link.{j}.{a}" for j in joints for a in ("x", "y", "z", "rx", "ry")]
            geometry = LinkGeometry(robot, across)
            blocks += [geometry, offsets]
            tune("lengths", tuple(n for n in across if ".r" not in n), "_m")
            tune("angles", tuple(n for n in across if ".r" in n), "_rad")
            tune("offsets", offsets.names, "_rad")
        else:
            block = make[kind]()
            blocks.append(block)
            tune(kind, block.names, "_rad_per_nm" if block.units[0] == "rad/Nm" else "_rad")
    return blocks, groups


def fit(robot: Robot, recorded: Recorded, row: dict[str, Any], sites: list[int]) -> Fitted:
    """Fit a row's model to the touch-ups of some sites, its priors included."""
    own = np.isin(recorded.site, sites)
    q = recorded.q[own]
    present, target = np.unique(recorded.socket[own], return_inverse=True)
    ball = np.array(SETTINGS["ball_mm"]) / 1e3
    points = apply(robot.fk(q), ball)
    places = [points[target == k].mean(axis=0) for k in range(len(present))]
    blocks, groups = blocks_of(robot, row)
    frames = [ToolPoint(ball), TargetPoints(places, [LABELS[k] for k in present])]
    model = CalibrationModel(robot, [*blocks, *frames], TouchUp(row.get("noise_m")))
    data = touch_ups(q, target, model.targets)
    loss = row.get("loss", "least-squares")
    sizes: dict[str, float] = {}
    if groups:
        tuned = tune_priors(model, data, groups, loss=loss)
        model = tuned.model
        sizes = {group.name: float(s) for group, s in zip(groups, tuned.sigma, strict=True)}
    return Fitted(model, identify(model, data, loss=loss, name=row["name"]), sizes)


def held_out_mm(fitted: Fitted, recorded: Recorded, site: int) -> float:
    """Rms distance at a site that arm, ball and priors know nothing of; its sockets are fitted."""
    own = recorded.site == site
    points = fitted.model.view(recorded.q[own], fitted.result.values).tool_points
    socket = recorded.socket[own]
    off = np.concatenate([points[socket == k] - points[socket == k].mean(0) for k in set(socket)])
    return float(1e3 * np.sqrt(np.mean(np.sum(off**2, axis=1))))


def socket_distance_mm(result: IdentificationResult, site: str) -> float:
    """Distance of the two sockets of a plate, as fitted."""
    first, second = (
        np.array([result.value(f"target.{site}_{k}.{axis}") for axis in "xyz"])
        for k in SETTINGS["sockets"]
    )
    return float(1e3 * np.linalg.norm(second - first))


def run(
    folder: Path, names: list[str] | None = None, advance: Advance = lambda what, part: None
) -> list[dict[str, Any]]:
    """A row of figures for each model of the study, or for those that are named."""
    robot, recorded = Robot.preset(SETTINGS["robot"]), load(folder)
    every = list(range(len(SITES)))
    rows: list[dict[str, Any]] = []
    for row in writing.named(SETTINGS["model"], names, advance):
        full = fit(robot, recorded, row, every)
        found: dict[str, Any] = {
            "model": row["name"],
            "parameters": full.model.p,
            # of all touch-ups alike, whatever the loss thinks of them
            "rms_mm": float(1e3 * np.sqrt(np.mean(np.square(full.result.distances_m)))),
        }
        for site, name in enumerate(SITES):
            others = fit(robot, recorded, row, [k for k in every if k != site])
            found[f"held_out_{name}_mm"] = held_out_mm(others, recorded, site)
        for name in SITES:
            found[f"sockets_{name}_mm"] = socket_distance_mm(full.result, name)
        found["noise_mm"] = float(full.result.noise[0].sigma[0] * 1e3)
        found["scale_is_seen"] = not any("the scale of" in note for note in full.result.notes)
        found["sizes"] = full.sizes
        rows.append(found)
    return rows


def markdown(found: Mapping[str, Any]) -> str:
    """The table of the README."""
    cells = ["{model}", "{parameters}", "{rms_mm:.3f}"]
    cells += [f"{{held_out_{site}_mm:.3f}}" for site in SITES]
    cells += [f"{{sockets_{site}_mm:.2f}}" for site in SITES]
    first, *others = SITES
    heads = ["model", "p", "rms [mm]", f"held out [mm]: {first}", *others]
    heads += [f"sockets [mm]: {first}", *others]
    return writing.table(found["models"], cells, heads)
