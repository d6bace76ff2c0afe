"""The first step: camera and target from nothing, and the reason of every refusal."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calib.se3 import FloatArray, rotation_exp, transform
from calib.vision.camera import Views
from calib.vision.touch_up import Drive, Loop, NoSetUp, SetUp, Station, find_set_up
from calib.vision.touch_up.arms import LostMotion

APPROACH = np.deg2rad(0.2)


class Watched(Station):
    """Notes what it is asked for, and does something at a name."""

    def __init__(self, drive: Drive, then: dict[str, Callable[[], None]] | None = None) -> None:
        super().__init__(drive)
        self.names: list[str] = []
        self._then = then or {}

    def _note(self, name: str) -> None:
        self.names.append(name)
        self._then.get(name, lambda: None)()

    def look(self, name, q):
        self._note(name)
        return super().look(name, q)

    def jacobian(self, name, q, relation, step_m, *, both_ways):
        self._note(name)
        return super().jacobian(name, q, relation, step_m, both_ways=both_ways)

    def touch_up(self, name, q, jacobian, loop, bias=None):
        self._note(name)
        return super().touch_up(name, q, jacobian, loop, bias)


def first_step(bench, arms=None, q: FloatArray | None = None, loop: Loop | None = None):
    """What the first step finds, with an approach."""
    drive = bench.drive(arms, APPROACH)
    return find_set_up(Station(drive), bench.q if q is None else q, loop or Loop())


def refused(found: object) -> str:
    """The reason of a refusal, which has a hint."""
    assert isinstance(found, NoSetUp)
    assert found.hint
    return found.reason


def moving(bench, shift_m: FloatArray):
    """Arms, and what moves their target by a shift in the base."""
    arms = bench.arms()

    def move() -> None:
        T = transform(np.eye(3), shift_m) @ bench.true.T_base_target
        arms._cell = replace(bench.true, T_base_target=T)

    return arms, move


def test_ideal_cell_is_found(make_bench):
    """To what the tilt of the circle does to its ellipse."""
    bench = make_bench(tilt_deg=15.0, at_m=(0.01, -0.02, 0.33))
    found = first_step(bench)
    assert isinstance(found, SetUp)
    assert found.notes == ()
    assert np.abs(found.T_tip_camera - bench.true.T_tip_camera).max() < 1e-3
    assert np.abs(found.target_m - bench.true.T_base_target[:3, 3]).max() < 3e-4
    assert found.facing.normal @ bench.true.T_base_target[:3, 2] > np.cos(np.deg2rad(0.1))
    assert len(found.postures) == 14


def test_designated_size_is_kept(make_bench):
    bench = make_bench()
    found = find_set_up(Station(bench.drive()), bench.q, Loop(), size_px=110.0)
    assert found.jacobian.relation.size_px == 110.0
    expected = bench.camera.focal_px * bench.target.diameter_m / 110.0
    assert found.jacobian.distance_m == pytest.approx(expected, rel=2e-3)


def test_every_measurement_has_a_name_of_its_own(make_bench):
    """Names are what a journal finds its answers by; progress only grows."""
    bench, said = make_bench(), []
    station = Watched(bench.drive(approach_rad=APPROACH))
    find_set_up(station, bench.q, Loop(), progress=lambda what, part: said.append(part))
    assert len(set(station.names)) == len(station.names)
    assert said == sorted(said)
    assert said[0] >= 0.0
    assert said[-1] < 1.0


@pytest.mark.parametrize(
    ("at_m", "reason"),
    [
        ((0.0, 0.0, 2.0), "too small to tell its distance"),
        ((0.0, 0.0, 0.085), "the middle of its picture is not its own"),
        ((0.0, 0.0, 0.065), "touches the edge"),
        ((0.09, 0.0, 0.35), "touches the edge|outside the image"),
    ],
)
def test_target_that_is_too_small_or_large_or_outside(make_bench, at_m, reason):
    said = refused(first_step(make_bench(at_m=at_m)))
    assert any(part in said for part in reason.split("|")), said


def test_singular_posture_is_refused(make_bench):
    bench = make_bench()
    q = bench.q.copy()
    q[4] = np.deg2rad(2.0)
    there = bench.robot.fk(q) @ bench.true.T_tip_camera
    T = there @ transform(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 0.35])
    moved = replace(bench, q=q, true=replace(bench.true, T_base_target=T))
    assert "singularity" in refused(first_step(moved))


def test_play_larger_than_the_approach_is_refused(make_bench):
    """Half of that is taken up, and nothing is said."""
    much = make_bench(lost_motion=LostMotion.of(6, backlash_rad=1.5 * APPROACH))
    assert "from one side and from the other" in refused(first_step(much))
    some = make_bench(lost_motion=LostMotion.of(6, backlash_rad=0.5 * APPROACH))
    assert isinstance(first_step(some), SetUp)


@pytest.mark.parametrize("when", ["S05a", "S10a", "S14a"])
@pytest.mark.parametrize("way_mm", [(4, 0, 0), (0, 0, 6)])
def test_target_that_moves_is_told(make_bench, when, way_mm):
    bench = make_bench()
    arms, move = moving(bench, np.array(way_mm) / 1e3)
    station = Watched(bench.drive(arms, APPROACH), {when: move})
    said = refused(find_set_up(station, bench.q, Loop()))
    assert "made again" in said or "miss each other" in said or "right angles" in said


def test_camera_that_is_turned_is_told(make_bench):
    """About the pin tip, so that the loop finds the target where it was; before the first turn."""
    bench = make_bench()
    arms = bench.arms()

    def turn() -> None:
        R = rotation_exp(np.deg2rad([0.0, 0.0, 2.0]))
        T = bench.true.T_tip_camera @ transform(R, np.zeros(3))
        arms._cell = replace(bench.true, T_tip_camera=T)

    station = Watched(bench.drive(arms, APPROACH), {"S02a": turn})
    assert "turned by 2.0 deg" in refused(find_set_up(station, bench.q, Loop()))


def test_drift_within_the_noise_is_let_pass(make_bench):
    bench = make_bench()
    arms, move = moving(bench, np.array([0.0, 2e-4, 0.0]))
    station = Watched(bench.drive(arms, APPROACH), {"S10a": move})
    assert isinstance(find_set_up(station, bench.q, Loop()), SetUp)


def test_size_that_does_not_follow_the_distance_is_told(make_bench):
    """As where something hides a part of the target when it is seen larger."""
    bench = make_bench()
    arms = bench.arms()
    look, size = arms.look, bench.relation.size_px

    def look_bent(which, near_px=None) -> Views:
        views = look(which, near_px)
        ellipses = views.ellipses.copy()
        ellipses[:, 2:] *= 1.0 - 0.4 * np.clip(views.vhs_px[:, 2:] / size - 1.06, 0.0, 1.0)
        return Views(ellipses, views.reasons)

    arms.look = look_bent
    assert "does not follow its distance" in refused(first_step(bench, arms))


def test_picture_that_does_not_follow_the_arm_is_told(make_bench):
    bench = make_bench()
    arms = bench.arms()
    still = arms.look(np.array([0]))
    arms.look = lambda which, near_px=None: still
    assert "does not follow the arm" in refused(first_step(bench, arms))


def test_way_to_the_target_may_be_too_far(make_bench):
    bench = make_bench(at_m=(0.055, 0.0, 0.35))
    assert "would move the tip" in refused(first_step(bench, loop=Loop(farthest_m=0.03)))


def test_turns_that_are_refused_are_noted(make_bench):
    """Where the arm may hardly turn, there are too few touch-ups, and it is said why."""
    bench = make_bench()

    def fence(start: FloatArray, q: FloatArray) -> list[str]:
        R = bench.robot.fk(q)[:, :3, :3] @ bench.robot.fk(bench.q)[:3, :3].T
        angle = np.arccos(np.clip((np.trace(R, axis1=1, axis2=2) - 1) / 2, -1, 1))
        return ["the fence is in the way" * bool(a > np.deg2rad(1.2)) for a in angle]

    drive = Drive(bench.robot, bench.arms(), APPROACH, fence)
    said = refused(find_set_up(Station(drive), bench.q, Loop()))
    assert "touch-ups around the target succeeded" in said or "could not turn enough" in said
    everywhere = Drive(bench.robot, bench.arms(), APPROACH, lambda start, end: ["no"] * len(end))
    said = refused(find_set_up(Station(everywhere), bench.q, Loop()))
    assert said == "the target is not seen from the taught posture: no"
