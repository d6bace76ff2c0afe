"""The cell in 3-D: where bodies stand and in which colour, what is sent, and what a browser shows.

Link frames are those of Pinocchio's own forward kinematics.
"""

import base64
import dataclasses
import re
import shutil
import tempfile
import threading
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from calib.errors import InputError
from calib.geometry import Box, Capsule, Cylinder, HalfSpace, Mesh, Sphere
from calib.se3 import FloatArray, inverse, rotation_from_quaternion, transform
from posedesign.cell import Cell, cell_template
from posedesign.cell.file import parse_config
from posedesign.hand_eye.pairs import Pairs
from posedesign.planning import PoseList
from posedesign.report import scene as drawing
from posedesign.report.tour import (
    MOST_FRAMES,
    MOST_TRIANGLES,
    SHADES,
    STEP_RAD,
    Shade,
    Tour,
    interpolate,
    legend,
    lines,
    link_frames,
    surface,
    words,
)
from tests.rails import on_slides

HOSTILE = "<b>P4</b></script><script>document.title = 'run'</script>"
NAMES = ("P1", "low", "V1", HOSTILE)
POSTURES = np.deg2rad(
    [
        [-3.7, 18.9, -20.0, 0.0, -51.1, 43.7],
        [0.0, 40.0, -40.0, 0.0, -50.0, 0.0],  # into the floor
        [20.0, 10.0, -25.0, 0.0, -50.0, 0.0],
        [0.0, 19.0, -25.0, 0.0, -50.0, 0.0],  # 20.0 mm from the fixture, a little too near
    ]
)
POSES = PoseList(NAMES, POSTURES, np.array([False, False, True, False]))
BOX = {"lowest_mm": [1000.0, -500.0, 300.0], "highest_mm": [2000.0, 500.0, 1300.0]}
TO_M = 1e-6

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = (
    *("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
)


def make_cell(**sections: Any) -> Cell:
    raw = tomllib.loads(cell_template(None)) | {"task_box": BOX}
    for name, changes in sections.items():
        raw[name] = raw.get(name, {}) | changes
    return Cell.from_config(parse_config(raw, Path("cell.toml")), Path("cell.toml"))


@pytest.fixture(scope="module")
def cell() -> Cell:
    return make_cell()


@pytest.fixture(scope="module")
def tour(cell) -> Tour:
    return Tour.of(cell, POSES)


def by_pinocchio(cell: Cell, q: FloatArray) -> list[FloatArray]:
    """``T_base_link`` of the links that move, at one posture ``(n,)`` [rad]."""
    model = cell.robot.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    base = data.oMf[model.getFrameId(cell.robot.base_frame)]
    return [
        (base.inverse() * data.oMi[model.getJointId(name)]).homogeneous
        for name in cell.robot.joint_names
    ]


def shown(tour: Tour, cell: Cell, frame: int) -> dict[str, Shade]:
    bodies = (body.name for body in cell.scene.bodies)
    return dict(zip(bodies, map(Shade, tour.shades[frame]), strict=True))


def test_the_tour_stops_at_every_pose_and_goes_straight(tour, cell):
    assert [v.name for v in tour.verdicts] == ["base posture", *NAMES]
    assert np.array_equal(tour.frames[tour.stops], [cell.base_posture, *POSTURES])
    assert len(set(tour.names)) == len(NAMES) + 1
    moves = np.diff(tour.frames, axis=0)
    assert np.abs(moves).max() <= STEP_RAD + 1e-12
    for first, last in zip(tour.stops, tour.stops[1:], strict=False):
        assert np.allclose(moves[first:last], moves[first], rtol=0, atol=1e-12)
    assert np.allclose(np.diff(tour.times_s), tour.stands_s[:-1])
    assert tour.stands_s[tour.stops].tolist() == [1.0, 1.0, 1.0, 0.05, 1.0]
    assert tour.shades.shape == (len(tour.frames), len(cell.scene.bodies))


def test_long_tours_have_no_more_pictures_than_that():
    there = np.tile([[0.0, 0.0], [3.0, -6.0]], (400, 1))
    frames, stops = interpolate(there)
    assert MOST_FRAMES / 2 < len(frames) <= MOST_FRAMES + len(there)
    assert np.array_equal(frames[stops], there)
    alone, only = interpolate(there[:1])
    assert (alone.tolist(), only.tolist()) == ([[0.0, 0.0]], [0])


def test_colours_say_what_touches_and_what_is_too_near(tour, cell):
    base, low, near = (shown(tour, cell, int(tour.stops[k])) for k in (0, 2, 4))
    usual = {Shade.ARM, Shade.TOOL, Shade.OBSTACLE}
    assert set(base.values()) == usual
    assert (base["gun"], base["fixture"]) == (Shade.TOOL, Shade.OBSTACLE)
    assert low["gun"] == low["floor"] == Shade.CONTACT
    assert {k for k, s in near.items() if s not in usual} == {"gun", "fixture"}
    assert near["gun"] == near["fixture"] == Shade.NEAR
    for k, verdict in enumerate(tour.verdicts):
        now = set(shown(tour, cell, int(tour.stops[k])).values())
        if verdict.distance_mm is not None and verdict.distance_mm < 20.0 - 1e-3:
            assert now & {Shade.NEAR, Shade.CONTACT}
        elif verdict.feasible:
            assert now == usual


def test_what_is_not_checked_has_a_colour_of_its_own():
    unchecked = make_cell(
        constraints={
            "collisions": False,
            "workspace_lowest_mm": [-500.0, -500.0, 0.0],
            "workspace_highest_mm": [3000.0, 500.0, 3000.0],
        }
    )
    tour = Tour.of(unchecked, POSES)
    assert set(shown(tour, unchecked, 0).values()) == {Shade.UNCHECKED}
    assert words(tour.verdicts[0])[0] == "clearance: not checked"
    # the workspace is kept all the same: what leaves it has the colour of contact
    assert Shade.CONTACT in shown(tour, unchecked, int(tour.stops[3])).values()
    said = [name for name, _ in legend(unchecked, tour)]
    assert "not checked for collisions" in said
    assert not {"arm", "tool", "obstacle"} & set(said)
    assert "workspace" in said


def test_pins_may_touch_their_target_and_nothing_before():
    pin_cell = tomllib.loads(cell_template(None))
    pin_cell |= {"plan": pin_cell["plan"] | {"retreat_mm": 50.0}}
    del pin_cell["camera"]
    point = pin_cell["tool"]["point_mm"]
    pin_cell["tool"]["body"] = [
        {"name": "pin", "kind": "cylinder", "radius_mm": 4.0, "height_mm": 100.0}
        | {"at_mm": [point[0], point[1], point[2] - 50.0]}
    ]
    block = {"name": "block", "size_mm": [100.0, 100.0, 100.0], "at_mm": [1915.4, 50.0, 442.9]}
    pin_cell["obstacle"] = [block]
    pin_cell["constraints"] |= {"ignore": [["pin", "block"]], "safety_distance_mm": 10.0}
    touching = Cell.from_config(parse_config(pin_cell, Path("cell.toml")), Path("cell.toml"))
    q = touching.base_posture
    back, reasons = touching.retreat.back_off(q[None])
    assert reasons == ("",)
    poses = PoseList(("V1", "P1"), np.vstack([back, q]), np.array([True, False]))
    tour = Tour.of(touching, poses)
    far = touching.robot.state(tour.frames).point(touching.tool_m) - touching.target_m
    far_mm = 1e3 * np.linalg.norm(far, axis=1)
    pin_row = [body.name for body in touching.scene.bodies].index("pin")
    usual = tour.shades[:, pin_row] == Shade.UNCHECKED
    usual |= tour.shades[:, pin_row] == Shade.TOOL
    assert usual[far_mm <= 5.0].all()
    assert usual[far_mm > 15.0].all()
    assert (far_mm > 15.0).any()


def test_the_words_of_a_stop(tour):
    assert words(tour.verdicts[0])[0] == "clearance: gun 90.5 mm from fixture, 20 mm asked for"
    low = words(tour.verdicts[2])
    assert low[0].startswith("clearance: gun and floor run 191 mm into each other")
    assert low[1].startswith("CANNOT BE TAKEN: ")


@pytest.mark.parametrize(
    ("solid", "lowest", "highest"),
    [
        (Box((0.2, 0.4, 0.6)), [-0.1, -0.2, -0.3], [0.1, 0.2, 0.3]),
        (Capsule(0.1, 0.4), [-0.1, -0.1, -0.3], [0.1, 0.1, 0.3]),
        (Cylinder(0.1, 0.4), [-0.1, -0.1, -0.2], [0.1, 0.1, 0.2]),
        (Sphere(0.3), [-0.3] * 3, [0.3] * 3),
        (HalfSpace(), [-2.0, -2.0, 0.0], [2.0, 2.0, 0.0]),
    ],
)
def test_surfaces_are_those_of_the_solids(solid, lowest, highest):
    vertices, triangles = surface(solid, 2.0)
    assert np.allclose([vertices.min(axis=0), vertices.max(axis=0)], [lowest, highest], atol=2e-3)
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    outwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c)
    assert (outwards > 0).all() or isinstance(solid, HalfSpace)


def test_fine_meshes_are_drawn_coarser_and_plain_ones_as_they_are():
    fine, triangles = surface(Sphere(0.3), 1.0)
    plain = Mesh(fine, triangles)
    assert surface(plain, 1.0) == (plain.vertices, plain.triangles)
    turns = np.linspace(0.0, 2 * np.pi, 300)
    grid = np.stack(np.meshgrid(np.cos(turns), np.sin(turns), indexing="ij"), axis=-1)
    points = np.concatenate([grid, grid[..., :1] * 0.5], axis=-1).reshape(-1, 3)
    at = (np.arange(299)[:, None] * 300 + np.arange(299)).reshape(-1)
    many = Mesh(points, np.vstack([[at, at + 1, at + 300], [at + 1, at + 301, at + 300]][0]).T)
    assert len(many.triangles) > MOST_TRIANGLES
    vertices, kept = surface(many, 1.0)
    assert len(kept) < len(many.triangles) / 4
    assert np.allclose(np.ptp(vertices, axis=0), np.ptp(points, axis=0), atol=0.04)


def test_links_without_shape_are_lines(cell, tour):
    robot = cell.robot
    kept = tuple(body for body in robot.bodies if body.link not in (2, 3))
    bare = dataclasses.replace(cell, robot=dataclasses.replace(robot, bodies=kept))
    (second, third) = (line for line in lines(bare, tour) if line.name.endswith("without_shape"))
    assert (second.link, third.link) == (2, 3)
    state = robot.state(cell.base_posture)
    ends = state.rotations[1] @ second.points[0].T + state.origins[1][:, None]
    assert np.allclose(ends.T, state.origins[1:3])
    assert second.colour == SHADES[Shade.UNCHECKED][1]


def test_lines_of_box_and_camera(cell, tour):
    drawn = {line.name: line for line in lines(cell, tour)}
    assert not any(name.endswith("without_shape") for name in drawn)
    corners = np.unique(drawn["task_box"].points.reshape(-1, 3), axis=0)
    assert np.allclose(corners[[0, -1]], np.array([BOX["lowest_mm"], BOX["highest_mm"]]) / 1e3)
    assert (drawn["task_box"].points.shape, len(corners)) == ((12, 2, 3), 8)
    view = drawn["view"]
    T = np.linalg.inv(cell.robot.chain.T_link_tip @ cell.T_tip_camera)
    seen = view.points.reshape(-1, 3) @ T[:3, :3].T + T[:3, 3]
    assert np.allclose(np.unique(seen[:, 2].round(9)), [0.1, 0.7])
    # corners of the image: half of 1280 x 1024 px at a focal length of 1800 px
    assert np.allclose(np.abs(seen[:, :2] / seen[:, 2:]), [640 / 1800, 512 / 1800])


def test_a_rail_is_drawn_along_its_whole_way(tmp_path):
    """Without it the arm floats in the air; its carriage goes from one end to the other."""
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(on_slides("ur10e"))
    cell = Cell.from_text(
        f'[robot]\nurdf = "{urdf}"\ncapsule_radius_mm = 50.0\n[base_pose]\nslides_mm = [0.0]\n'
        "posture_deg = [0, -75, 100, -115, -90, 0]\n[tool]\npoint_mm = [0, 0, 100]\n"
    )
    (drawn,) = (line for line in lines(cell, Tour.of(cell)) if line.name.startswith("slide"))
    at_ends = np.tile(cell.base_posture, (2, 1))
    at_ends[:, 0] = cell.robot.lower[0], cell.robot.upper[0]
    carriage = np.array([link_frames(cell, q[None])[0, 1, :3, 3] for q in at_ends])
    assert drawn.link == 0
    np.testing.assert_allclose(drawn.points[0], carriage, atol=1e-12)
    assert ("way of a slide", drawn.colour) in legend(cell, Tour.of(cell))


def test_an_instrument_is_drawn_where_it_is():
    """And not at the tool point of the base posture, under its name."""
    pytest.importorskip("viser", reason="needs viser (posedesign[view])")
    cell = Cell.from_text(
        '[robot]\npreset = "ur10e"\n[base_pose]\nposture_deg = [0, -75, 100, -115, -90, 0]\n'
        '[tool]\npoint_mm = [0, 0, 100]\n[measurement]\nkind = "point"\n'
        '[[target]]\nname = "tracker"\nposition_mm = [2500, 1000, 900]\n'
        '[[target]]\nname = "second"\nposition_mm = [2000, -1000, 900]\n'
    )
    live = drawing.LiveScene(cell, Tour.of(cell), 0)
    try:
        nodes = live.server.scene._handle_from_node_name
        places = [nodes[f"/link_0/target_{k}"].position for k in (0, 1)]
    finally:
        live.server.stop()
    np.testing.assert_allclose(places, [[2.5, 1.0, 0.9], [2.0, -1.0, 0.9]])
    assert not any(line.name == "normal" for line in lines(cell, Tour.of(cell)))


def test_without_viser_one_line_says_what_to_install(cell, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "viser", None)
    with pytest.raises(InputError, match="needs viser") as told:
        drawing.LiveScene(cell, Tour.of(cell), 0)
    assert told.value.hint == "pip install posedesign[view]"


def test_cameras_of_pairs_and_the_targets_that_they_saw(cell, tmp_path):
    flanges = cell.robot.fk(POSTURES)
    B = inverse(cell.T_base_target) @ flanges @ cell.T_tip_camera
    tour = Tour.of(cell, pairs=Pairs(NAMES, flanges, B))
    assert np.allclose(tour.seen[:, 0], flanges @ cell.T_tip_camera, rtol=0, atol=1e-8)
    assert np.allclose(tour.seen[:, 1], cell.T_base_target, rtol=0, atol=1e-8)
    (sights,) = (line for line in lines(cell, tour) if line.name == "sights")
    assert np.array_equal(sights.points, tour.seen[:, :, :3, 3])
    pytest.importorskip("viser", reason="needs viser (posedesign[view])")
    page = drawing.write_scene(cell, tour, tmp_path / "scene.html")
    recorded = Recorded(page.read_text(encoding="utf-8"))
    assert recorded.added("BatchedAxesMessage") == ["/link_0/poses", "/link_0/pairs"]


class Recorded:
    """What an HTML file of viser plays, message by message."""

    def __init__(self, page: str) -> None:
        msgspec, zstandard = pytest.importorskip("msgspec"), pytest.importorskip("zstandard")
        (data,) = re.findall(r'__VISER_EMBED_DATA__="([^"]*)"', page)
        whole = zstandard.ZstdDecompressor().decompressobj().decompress(base64.b64decode(data)[8:])
        length = int.from_bytes(whole[:8], "little")
        found = msgspec.msgpack.decode(whole[8 : 8 + length], strict=False)
        self.messages, self.duration_s = found["messages"], found["durationSeconds"]

    def added(self, kind: str) -> list[str]:
        return [m["name"] for _, m in self.messages if m["type"] == kind]

    def at(self, time_s: float, node: str) -> FloatArray:
        """Where a node is at a time, as a transform ``(4, 4)``."""
        told = [m for at, m in self.messages if at <= time_s and m.get("name") == node]
        # what stays where nodes begin is not told
        wxyz, place = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
        for message in told:
            wxyz, place = message.get("wxyz", wxyz), message.get("position", place)
        return transform(rotation_from_quaternion(wxyz), np.array(place))


@pytest.fixture(scope="module")
def page(cell, tour, tmp_path_factory) -> Path:
    pytest.importorskip("viser", reason="needs viser (posedesign[view])")
    return drawing.write_scene(cell, tour, tmp_path_factory.mktemp("scene") / "scene.html")


def test_the_file_has_every_body_pose_and_obstacle(page, cell, tour):
    text = page.read_text(encoding="utf-8")
    recorded = Recorded(text)
    links = [body.link for body in cell.scene.bodies]
    meshes = recorded.added("MeshMessage")
    assert sorted(meshes) == sorted(f"/link_{j}/body_{b}" for b, j in enumerate(links))
    fixed = [name for name in meshes if name.startswith("/link_0/")]
    base = sum(body.link == 0 for body in cell.robot.bodies)
    assert len(fixed) == base + len(cell.obstacles)
    (poses,) = (m for _, m in recorded.messages if m["type"] == "BatchedAxesMessage")
    assert poses["name"] == "/link_0/poses"
    over = text[text.index('id="over"') :]
    assert over.count('"at":') == len(tour.stops) == len(POSES.names) + 1
    assert len(text) < 10_000_000
    assert "<b>P4" not in over


def test_the_file_moves_the_arm_through_the_poses(page, cell, tour):
    recorded = Recorded(page.read_text(encoding="utf-8"))
    assert recorded.duration_s == pytest.approx(tour.stands_s.sum())
    for frame in (*tour.stops.tolist(), int(tour.stops[1]) + 3):
        q = tour.frames[frame]
        moved = [recorded.at(tour.times_s[frame] + 0.01, f"/link_{j + 1}") for j in range(6)]
        assert np.allclose(moved, by_pinocchio(cell, q), rtol=0, atol=TO_M)
        tip = recorded.at(tour.times_s[frame] + 0.01, "/link_6/tip")
        assert np.allclose(moved[-1] @ tip, cell.robot.fk(q), rtol=0, atol=TO_M)


def moved_links(live: drawing.LiveScene) -> list[FloatArray]:
    """Links as they were last sent to browsers."""
    return [
        transform(rotation_from_quaternion(node.wxyz), node.position)
        for node in live.stage.links[1:]
    ]


def test_slider_and_player_move_the_arm(cell, tour):
    pytest.importorskip("viser", reason="needs viser (posedesign[view])")
    live = drawing.LiveScene(cell, tour, 0)
    try:
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+", live.address)
        assert live.server.request_share_url() is None
        assert len(live.stage.bodies) == len(cell.scene.bodies)
        for stop, q in [*enumerate(POSTURES, 1), (0, cell.base_posture)]:
            live.play.value = True
            live._ask(SimpleNamespace(client=object()), stop)
            assert not live.play.value
            live.step()
            assert np.allclose(moved_links(live), by_pinocchio(cell, q), rtol=0, atol=TO_M)
            assert (live.names.value, live.slider.value) == (tour.names[stop], stop)
            assert words(tour.verdicts[stop])[0] in live._words.content
        live.step()
        assert np.allclose(moved_links(live), by_pinocchio(cell, cell.base_posture), atol=TO_M)
        live.play.value, live._due = True, 0.0
        for frame in (1, 2):
            live.step()
            found = by_pinocchio(cell, tour.frames[frame])
            assert np.allclose(moved_links(live), found, rtol=0, atol=TO_M)
        live._ask(SimpleNamespace(client=object()), 4)
        live.step()
        assert "<b>P4" not in live._words.content
        assert "<b>P4" in live.names.value  # a text, and no part of a page
    finally:
        live.server.stop()


@contextmanager
def chromium() -> Iterator[tuple[Any, list[str]]]:
    """A page of a real browser, and what is wrong with it or asked of other hosts."""
    if CHROMIUM is None:
        pytest.skip("needs Chromium")
    play = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    faults: list[str] = []

    def asked(request: Any) -> None:
        if not re.match(r"(file|data|blob):|(http|ws)://127\.0\.0\.1:", request.url):
            faults.append(request.url)

    with play.sync_playwright() as driver, tempfile.TemporaryDirectory() as folder:
        browser = driver.chromium.launch_persistent_context(
            folder, executable_path=CHROMIUM, headless=True, args=list(FLAGS)
        )
        opened = browser.new_page()
        opened.set_default_timeout(60_000)
        opened.on("console", lambda said: said.type == "error" and faults.append(said.text))
        opened.on("pageerror", lambda error: faults.append(str(error)))
        opened.on("request", asked)
        try:
            yield opened, faults
        finally:
            browser.close()


@pytest.mark.slow
def test_the_file_in_a_browser(page, tour):
    with chromium() as (opened, faults):
        opened.goto(page.as_uri())
        opened.wait_for_selector("canvas")
        opened.wait_for_selector("#root input[inputmode='decimal']")
        assert opened.title() == "r2000ic165f"
        assert opened.locator("#over option").all_inner_texts() == tour.names
        for stop, said in ((3, "tightest"), (2, "191 mm")):  # what is passed through, too
            opened.select_option("#over select", index=stop)
            opened.wait_for_function(
                f"document.querySelector('#over').innerText.includes('{said}')"
            )
            opened.wait_for_timeout(500)
            time_s = float(opened.input_value("#root input[type='hidden']"))
            frame = tour.stops[stop]
            assert 0 < time_s - tour.times_s[frame] < tour.stands_s[frame]
            assert opened.locator("#over select").input_value() == tour.names[stop]
        assert faults == []


@pytest.mark.slow
def test_the_slider_in_a_browser_moves_the_arm(cell, tour):
    pytest.importorskip("viser", reason="needs viser (posedesign[view])")
    live = drawing.LiveScene(cell, tour, 0)
    over = threading.Event()

    def run() -> None:
        while not over.wait(0.01):
            live.step()

    worker = threading.Thread(target=run)
    worker.start()
    try:
        with chromium() as (opened, faults):
            opened.goto(live.address)
            opened.wait_for_selector("canvas")
            assert not opened.get_by_text("191 mm").count()
            number = opened.locator("input[inputmode='decimal']")
            number.fill("2")
            number.press("Enter")
            opened.get_by_text("191 mm").first.wait_for()
            assert opened.locator(f"input[value='{tour.names[2]}']").count()
            assert faults == []
        assert np.allclose(moved_links(live), by_pinocchio(cell, POSTURES[1]), rtol=0, atol=TO_M)
        assert tuple(live.stage.bodies[-2].color) == (214, 30, 40)
    finally:
        over.set()
        worker.join()
        live.server.stop()
