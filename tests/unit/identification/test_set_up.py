"""From a table to an identified arm: every kind, several tools and targets, exact without noise."""

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calib.identification import identify
from calib.model.measurements import KINDS
from calib.model.parameters import TargetFrame, TargetPlane, TargetPoints, ToolFrame, ToolPoints
from calib.se3 import (
    inverse,
    rotation_angle,
    rotation_exp,
    rotation_from_wpr,
    rotation_log,
    transform,
    wpr_from_rotation,
)
from posedesign.cell import Cell
from posedesign.identification import Identified, identify_models
from posedesign.identification.checks import far_rows, seen_once
from posedesign.identification.comparison import (
    hardly_counted,
    instruments_elsewhere,
    tools_elsewhere,
)
from posedesign.identification.models import Models, frames_of

pytestmark = pytest.mark.usefixtures("one_alternative")

MakeCell = Callable[..., Cell]

EXACT = 2e-9
"""[rad, m]: rounding of the file, 2e-11 rad, times what the measurements are worth."""

MIXTURES = {
    "touch-up": ["touch-up"],
    "view-line": ["view-line"],
    "point": ["point"],
    "pose": ["pose"],
    "camera-pose": ["camera-pose"],
    "distance": ["distance"],
    "three planes": ["plane"],
    "touch-up and plane": ["touch-up", "plane"],
    "tracker and touch-up": ["point", "touch-up"],
    "pose and wire": ["pose", "distance"],
    "all": list(KINDS),
}
TARGETS = {"three planes": 3, "distance": 3}


def identified(
    tabled: Any, lab: Any, make_cell: MakeCell, kinds: list[str], **more: Any
) -> tuple[Any, Identified]:
    """Measured, written, read, and identified by the model with zero offsets."""
    measured = lab.measure(kinds, **more)
    cell = make_cell(
        parameters={"models": [["zero_offsets"]], "tool_axes": None},
        measurement={"kind": "view-line" if kinds == ["view-line"] else "touch-up"},
        noise=[
            {"kind": kind, "three_sigma_mm": 0.03}
            | ({"three_sigma_deg": 0.01} if KINDS[kind].turns else {})
            for kind in kinds
        ],
    )
    return measured, identify_models(cell, tabled(measured))


@pytest.mark.slow
@pytest.mark.parametrize("name", MIXTURES)
def test_exact_without_noise(tabled, lab, make_cell, name):
    each = TARGETS.get(name, 1)
    measured, found = identified(
        tabled, lab, make_cell, MIXTURES[name], count=60, targets_each=each
    )
    result = next(r for r in found.comparison.results if r.model == "offsets")
    for joint in lab.joints:
        parameter = f"zero_offset.{joint}"
        assert result.value(parameter) == pytest.approx(measured.value(parameter), abs=EXACT)
    assert result.rms_m < 1e-9
    before = found.comparison.results[0]
    assert before.model == "frames only"
    assert before.rms_m > 1e-5


def test_places_of_tools_and_targets(tabled, lab, make_cell):
    """Two tools and two trackers: each is found where it is."""
    measured, found = identified(
        tabled, lab, make_cell, ["pose"], tools=("near", "far"), targets_each=2, count=32
    )
    trial = found.comparison.trials[1]
    assert trial.result is not None
    blocks = list(trial.candidate.model.parameters)
    frames = frames_of(blocks, trial.result.values, trial.result.names)
    assert set(frames["tools"]) == {"near", "far"}
    assert set(frames["targets"]) == {"A0", "A1"}
    for block, part in zip(measured.truth.parameters, measured.truth.slices, strict=True):
        for side, labels in (("tools", block.tools), ("targets", block.targets)):
            for label, T in zip(
                labels, block.poses(measured.x[part]) if labels else (), strict=True
            ):
                off = np.linalg.inv(T) @ frames[side][label]
                assert np.linalg.norm(off[:3, 3]) < 10 * EXACT
                assert rotation_angle(off[:3, :3]) < 10 * EXACT


def test_what_there_must_be(tabled, lab, make_cell):
    measured = lab.measure(list(KINDS), 8)
    blocks = Models(make_cell(), tabled(measured)).set_up
    kinds = {label: type(block) for block in blocks for label in (*block.tools, *block.targets)}
    assert kinds["tool"] is ToolFrame  # poses are among them
    for k, kind in enumerate(KINDS):
        expected = {"plane": TargetPlane, "point": TargetFrame}.get(kind, TargetPoints)
        if kind.endswith("pose"):
            expected = TargetFrame
        assert kinds[f"{'ABCDEFG'[k]}0"] is expected, kind


def test_axes_of_the_tool(tabled, lab, make_cell):
    """A view line does not show the tool point along itself; the cell may hold more axes."""

    def axes(cell: Cell, *kinds: str) -> list[tuple[str, ...]]:
        measured = lab.measure(kinds, 4, tools=("tool", "ball"))
        blocks = Models(cell, tabled(measured)).set_up
        return [block.names for block in blocks if isinstance(block, ToolPoints)]

    every, across = ("tool.x", "tool.y", "tool.z"), ("tool.x", "tool.y")
    free = make_cell(parameters={"tool_axes": None})
    assert axes(free, "touch-up")[0] == every
    assert axes(free, "view-line") == [across, ("tool.ball.x", "tool.ball.y")]
    assert axes(free, "view-line", "touch-up")[0] == every
    held = make_cell(parameters={"tool_axes": "x"})
    assert axes(held, "touch-up") == [("tool.x",), ("tool.ball.x", "tool.ball.y", "tool.ball.z")]


def test_how_far_off_it_was_before(tabled, lab, make_cell):
    measured = lab.measure(["touch-up", "point"], 12)
    table = tabled(measured)
    cell = make_cell(target={"name": "A0", "position_mm": [1000.0, 0.0, 500.0]})
    points = cell.robot.state(table.data.postures[:12]).point(cell.tool_m)
    off = Models(cell, table).nominal_m()
    known = np.linalg.norm(points - [1.0, 0.0, 0.5], axis=1)
    np.testing.assert_allclose(off[:12], known, atol=1e-12)
    assert np.isnan(off[12:]).all()  # what a tracker reads is nothing that the cell could know
    elsewhere = Models(make_cell(), table).nominal_m()
    around = np.linalg.norm(points - points.mean(axis=0), axis=1)
    np.testing.assert_allclose(elsewhere[:12], around, atol=1e-12)


def test_rows_that_are_something_else(tabled, lab, make_cell):
    measured = lab.measure(["touch-up", "point"], 12, targets_each=2)
    q = measured.data.postures.copy()
    assert far_rows(make_cell(), tabled(measured)) == []
    q[[3, 20]] /= 57.29578  # a touch-up in radians; of what a tracker reads nothing is expected
    spoilt = replace(measured, data=replace(measured.data, postures=q))
    (said,) = far_rows(make_cell(), tabled(spoilt))
    assert said.startswith("line 5: the tool point as described is ")
    assert "the others of A1" in said


def test_targets_seen_once(lab):
    data = lab.measure(["touch-up"], 7, targets_each=2).data
    assert seen_once(data) == []
    assert seen_once(data[np.array([0, 2, 3])]) == ["A1"]


def test_tools_that_came_out_where_the_cell_has_another_are_named(tabled, lab, make_cell):
    table = tabled(lab.measure(["point"], 30, tools=("near", "far")))
    places = {"near": 1e3 * lab.cell.tool_m, "far": 1e3 * lab.cell.tool_m - [0.0, 0.0, 20.0]}

    def cell(**there: str) -> Cell:
        marks = [{"name": n, "point_mm": places[at].tolist()} for n, at in there.items()]
        tool = {"point_mm": places["near"].tolist(), "mark": marks}
        return make_cell(parameters={"models": [["zero_offsets"]]}, tool=tool)

    found = identify_models(cell(near="far", far="near"), table)
    near, far = (words for words in found.warnings if "came out" in words)
    assert re.match(r"tool\.near came out \d\d\.?\d? mm .*, where it has far", near)
    assert re.match(r"tool\.far came out \d\d\.?\d? mm .*, where it has near", far)
    assert tools_elsewhere(cell(near="near", far="far"), table, found.best) == []


def test_an_instrument_that_came_out_elsewhere_is_named(tabled, lab, make_cell):
    table = tabled(lab.measure(["point"], 30))
    there = inverse(
        transform(rotation_from_wpr(np.deg2rad([20.0, -35.0, 110.0])), [1.5, -2.0, 0.4])
    )
    place, wpr = 1e3 * there[:3, 3], np.rad2deg(wpr_from_rotation(there[:3, :3]))

    def cell(by_mm: Any, by_deg: Any) -> Cell:
        target = {"name": "A0", "position_mm": (place + by_mm).tolist(), "kind": "point"}
        return make_cell(
            parameters={"models": [["zero_offsets"]]},
            target=target | {"wpr_deg": (wpr + by_deg).tolist()},
            noise=[{"kind": "point", "three_sigma_mm": [0.03] * 3}],
        )

    elsewhere = cell([0.0, 2500.0, 0.0], 0.0)
    found = identify_models(elsewhere, table)
    (away,) = (words for words in found.warnings if "came out" in words)
    assert away.startswith("target.A0 came out 2.5 m away from where the cell has it")
    values = dict(zip(found.best.names, found.best.values, strict=True))

    def told(other: Cell) -> list[str]:
        """Of the same place, in rotations from where that cell has it."""
        R = transform(rotation_from_wpr(np.deg2rad(other.config.targets[0].wpr_deg)), np.zeros(3))
        own = rotation_exp(np.array([values[f"target.A0.r{axis}"] for axis in "xyz"]))
        was = rotation_from_wpr(np.deg2rad(elsewhere.config.targets[0].wpr_deg))
        turn = rotation_log(R[:3, :3].T @ was @ own)
        now = values | {f"target.A0.r{axis}": v for axis, v in zip("xyz", turn, strict=True)}
        moved = np.array([now[name] for name in found.best.names])
        return instruments_elsewhere(other, replace(found.best, values=moved))

    assert told(elsewhere) == [away]
    assert told(cell(100.0, 3.0)) == []
    (turned,) = told(cell(0.0, [0.0, 0.0, 150.0]))
    assert re.match(r"target\.A0 came out turned by 150 deg from where", turned)


def test_measurements_that_hardly_count_are_named(tabled, lab, make_cell):
    """Gross errors leave the result as it is, and are not passed over in silence."""
    table = tabled(lab.measure(["touch-up"], 40, noise=2e-5))
    cell = make_cell(parameters={"models": [["zero_offsets"]]})
    good = identify(Models(cell, table).candidates()[1].model, table.data)
    assert hardly_counted(table, good) == []
    q = table.data.postures.copy()
    q[[7, 20, 31]] += np.deg2rad([[0.05], [-0.06], [0.04]]) * [0, 1, 1, -1, 1, 0]
    found = identify_models(cell, replace(table, data=replace(table.data, postures=q)))
    (said,) = (words for words in found.warnings if "hardly count" in words)
    assert said.startswith("3 of 40 measurements are so far off the others that they hardly count")
    assert all(f"(line {table.lines[i]}) by" in said for i in (7, 20, 31))
