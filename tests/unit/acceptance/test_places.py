"""Places of acceptance tests: the cube of ISO 9283, places that prove, and constraints kept."""

import numpy as np
import pytest

from calib.errors import InputError, UnreachableError
from posedesign.acceptance import places
from posedesign.acceptance.places import PLANES, AcceptanceRequest, iso_points, plan_acceptance
from posedesign.acceptance.sampling import spread_points
from posedesign.cell import Cell, TaskBox, cell_template
from tests.unit.acceptance.conftest import TRACKER_CELL

BOX = TaskBox(np.array([1.0, -1.0, 0.0]), np.array([2.0, 0.5, 1.2]))
"""Its largest cube has an edge of 1 m about (1.5, -0.25, 0.6)."""


@pytest.mark.parametrize("plane", PLANES)
def test_poses_of_the_standard_are_on_the_diagonals_of_a_plane(plane):
    P = iso_points(BOX, plane)
    middle = np.array([1.5, -0.25, 0.6])
    assert P[0] == pytest.approx(middle)
    # a tenth of the diagonal from the corner: .4 of it from the middle
    assert np.linalg.norm(P[1:] - middle, axis=1) == pytest.approx([0.4 * np.sqrt(3.0)] * 4)
    off = P - middle
    assert np.abs(off[1:]) == pytest.approx(np.full((4, 3), 0.4))
    x, y, z = off.T
    by = {"x=z": x - z, "x=-z": x + z, "y=z": y - z, "y=-z": y + z}
    assert by[plane] == pytest.approx(np.zeros(5))
    assert P[1] + P[3] == pytest.approx(2 * middle)  # P2 and P4 on one diagonal
    assert len(np.unique(np.round(P, 9), axis=0)) == 5


def test_a_flat_box_has_no_cube():
    with pytest.raises(InputError, match="no cube in a flat task box"):
        iso_points(TaskBox(np.zeros(3), np.array([1.0, 1.0, 0.0])), "x=z")


def test_iso_poses_take_their_places_with_the_tool_turned_alike(found):
    plan = plan_acceptance(found.cell, AcceptanceRequest("iso"))
    q = plan.poses.kept
    tool = found.cell.robot.state(q).point(found.cell.tool_m)
    box = TaskBox(np.array([0.45, -0.2, 0.3]), np.array([0.75, 0.2, 0.6]))
    plane = next(plane for plane in PLANES if f"plane {plane} " in plan.where)
    assert tool == pytest.approx(iso_points(box, plane), abs=1e-6)
    R = found.cell.robot.fk(q)[:, :3, :3]
    assert np.ptp(R, axis=0).max() < 1e-6
    assert found.cell.checker.check(q, every=False).feasible.all()
    assert sorted(plan.route.order) == [0, 1, 2, 3, 4]
    assert "AP of ISO 9283 is at most 0.2 mm at each of five poses" in plan.statement
    assert "cube of 300 mm about (600, 0, 450) mm" in plan.where


def test_places_that_prove_are_one_in_each_part_and_can_be_taken(found):
    request = AcceptanceRequest("places", content=0.9, confidence=0.95)
    plan = plan_acceptance(found.cell, request)
    tool = found.cell.robot.state(plan.poses.kept).point(found.cell.tool_m)
    assert len(tool) == 29
    low, high = np.array([0.45, -0.2, 0.3]), np.array([0.75, 0.2, 0.6])
    parts = spread_points(low, high, 29)
    held = [((tool >= a - 1e-6) & (tool <= b + 1e-6)).all(axis=1).sum() for a, b in parts]
    assert held == [1] * 29
    assert found.cell.checker.check(plan.poses.kept, every=False).feasible.all()
    again = plan_acceptance(found.cell, request)
    assert np.array_equal(again.poses.kept, plan.poses.kept)
    other = plan_acceptance(found.cell, AcceptanceRequest("places", content=0.9, seed=2))
    assert not np.allclose(other.poses.kept, plan.poses.kept)


def test_parts_out_of_reach_are_named_and_places_are_as_many_all_the_same(monkeypatch):
    monkeypatch.setattr(places, "TURNS", 3)
    text = TRACKER_CELL.replace("three_sigma_deg_if_pose", "")
    far = text.replace("highest_mm = [750.0", "highest_mm = [1250.0")
    plan = plan_acceptance(Cell.from_text(far), AcceptanceRequest("places", content=0.8))
    assert len(plan.poses.kept) >= 14
    assert any("out of reach and no part of the statement" in note for note in plan.notes)


def test_a_box_nobody_reaches_is_refused(monkeypatch):
    monkeypatch.setattr(places, "TURNS", 3)
    text = TRACKER_CELL.replace("three_sigma_deg_if_pose", "")
    beyond = text.replace("[450.0, -200", "[5450.0, -200").replace("[750.0, 200", "[5750.0, 200")
    cell = Cell.from_text(beyond)
    for test in ("iso", "places"):
        with pytest.raises(UnreachableError, match=r"can(not all)? be taken"):
            plan_acceptance(cell, AcceptanceRequest(test, content=0.5))


def test_targets_that_are_touched_are_tested_by_poses_that_touch_them():
    cell = Cell.from_text(cell_template(surroundings=False))
    plan = plan_acceptance(cell, AcceptanceRequest("places", content=0.8))
    tool = cell.robot.state(plan.poses.kept).point(cell.tool_m)
    assert tool == pytest.approx(np.tile(cell.target_m, (len(tool), 1)), abs=1e-6)
    assert len(tool) == 14
    # all are at one point, and the statement says so, and what it does not speak of
    name = cell.config.target.name
    assert plan.touched == (name,)
    assert f"of the orientations of the tool at the one point {name} are within" in plan.statement
    assert "all at one point" in plan.where
    assert plan.elsewhere.startswith("other places, such as a cube of")
    with pytest.raises(InputError, match="poses of ISO 9283 stand free"):
        plan_acceptance(cell, AcceptanceRequest("iso"))


def test_chance_to_pass_falls_with_the_limit_and_is_that_of_arms_drawn(found):
    known = found.identified
    chances = [
        plan_acceptance(
            found.cell,
            AcceptanceRequest("places", limit_m=limit, content=0.8),
            used=known,
            known=known,
        ).chance
        for limit in (2e-5, 5e-5, 1e-3)
    ]
    assert chances == sorted(chances)
    assert chances[0] < 0.5
    assert chances[-1] == 1.0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"test": "izo"}, "there is no test 'izo'.*iso"),
        ({"limit_m": 0.0}, "a limit of 0 mm"),
        ({"limit_m": float("nan")}, "a limit of nan mm"),
        ({"plane": "x=y"}, "there is no plane 'x=y'"),
        ({"cycles": 0}, "0 cycles"),
        ({"content": 0.3, "confidence": 0.5}, "1 places prove that, and they do not tell where"),
    ],
)
def test_requests_that_cannot_be_are_refused(words, said):
    with pytest.raises(InputError, match=said):
        AcceptanceRequest(**words)
