"""The fewest poses of a cell: the pool, and what becomes of poses that no way leads to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.errors import InputError
from calib.se3 import rotation_angle
from posedesign.motion.route import Router
from posedesign.planning.checks import off_target
from posedesign.planning.optimal import choose as planning
from posedesign.planning.optimal import plan_fewest

WANTED_M = 2e-4


@pytest.fixture(scope="module")
def camera_cell(make_cell):
    return make_cell(
        measurement={"kind": "camera-pose"}, variations={"largest_deg": (45.0, 45.0, 45.0)}
    )


def test_the_pool_is_all_grids_that_can_be_taken(camera_cell):
    found = plan_fewest(camera_cell, WANTED_M)
    assert found.tried == 16 * 26 + 1  # the base pose is in every grid
    assert found.pool_size == found.tried
    base = camera_cell.robot.fk(camera_cell.base_posture)[:3, :3]
    turned = np.rad2deg(rotation_angle(base.T @ found.poses.orientations))
    assert turned.max() > 45.0
    kept = found.poses.kept
    assert off_target(camera_cell, found.poses.names, kept, 1e-9) == []
    assert camera_cell.checker.check(kept).feasible.all()
    assert sorted(found.route.order) == list(range(len(kept)))


def test_an_angle_that_is_held_is_in_the_pool_once(make_cell):
    cell = make_cell(
        measurement={"kind": "camera-pose"},
        variations={"start_deg": (5.0, 5.0, 0.0), "largest_deg": (45.0, 45.0, 0.0)},
    )
    assert plan_fewest(cell, 1e-3).tried == 16 * 8 + 1


def test_others_take_the_place_of_poses_that_no_way_leads_to(camera_cell, monkeypatch):
    first = plan_fewest(camera_cell, WANTED_M)
    cut_off = first.poses.kept[0]
    route = Router.route

    def losing(self, postures):
        found = route(self, postures)
        lost = np.flatnonzero((postures == cut_off).all(axis=1)).tolist()
        return replace(found, lost=dict.fromkeys(lost, "no clear way to it: a wall"))

    monkeypatch.setattr(Router, "route", losing)
    second = plan_fewest(camera_cell, WANTED_M)
    assert second.reached
    assert second.pool_size == first.pool_size - 1
    assert not (second.poses.kept == cut_off).all(axis=1).any()


def test_the_rest_is_kept_where_no_way_leads_to_a_pose(camera_cell, monkeypatch):
    """Whatever is chosen, its first is cut off: it is dropped, and what is left is planned."""
    route, tries = Router.route, []

    def losing(self, postures):
        tries.append(postures)
        lost = {0: "no clear way to it: a wall"} if len(tries) <= 3 else {}
        kept = route(self, np.delete(postures, list(lost), axis=0))
        return replace(kept, lost=lost)

    monkeypatch.setattr(Router, "route", losing)
    monkeypatch.setattr(planning, "ATTEMPTS", 3)
    found = plan_fewest(camera_cell, WANTED_M)
    assert len(tries) == 4
    assert not found.reached
    assert found.dropped == ("no clear way to it: a wall",)
    count = found.selection.count - 1
    assert len(found.postures) == len(found.poses.kept_names) == found.accuracy.poses == count
    assert len(found.poses.names) == count + 1
    assert "1 pose(s) dropped: no clear way to it: a wall" in found.message


def test_without_any_way_it_says_what_is_in_it(camera_cell, monkeypatch):
    route = Router.route

    def losing(self, postures):
        nothing = route(self, postures[:0])
        return replace(nothing, lost=dict.fromkeys(range(len(postures)), "a wall"))

    monkeypatch.setattr(Router, "route", losing)
    with pytest.raises(InputError, match="a wall"):
        plan_fewest(camera_cell, 1e-3)


def test_something_has_to_be_wanted(camera_cell):
    with pytest.raises(InputError, match="no accuracy is wanted"):
        plan_fewest(camera_cell)
