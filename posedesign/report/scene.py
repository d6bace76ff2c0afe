"""A cell in three dimensions: live in a browser, or as one HTML file that needs no server.

The only importer of viser. What is to be seen is in :mod:`posedesign.report.tour`.
"""

from __future__ import annotations

import html
import json
import time
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.errors import InputError
from calib.geometry import Capsule, HalfSpace, Sphere
from calib.se3 import FloatArray, apply, quaternion_from_rotation
from posedesign.cell import Cell
from posedesign.cell.observations import place_of
from posedesign.files import StrPath, write_text_atomic
from posedesign.report.tour import (
    PERIOD_S,
    SHADES,
    TARGET,
    Shade,
    Tour,
    legend,
    lines,
    link_frames,
    surface,
    words,
)

if TYPE_CHECKING:
    import viser

HOST = "127.0.0.1"
"""A cell is shown to the machine that it lies on, and to no other."""

_STYLE = "font-size:0.8em;line-height:1.5;padding:0 0.8em"


class Stage:
    """A cell drawn in a viser server, at one posture of its tour at a time."""

    def __init__(self, server: viser.ViserServer, cell: Cell, tour: Tour) -> None:
        self.server, self.cell, self.tour = server, cell, tour
        scene, robot = server.scene, cell.robot
        self._frames = link_frames(cell, tour.frames)
        self.links = [scene.add_frame(f"/link_{j}", show_axes=False) for j in range(robot.n + 1)]
        far_m = 1.5 * robot.chain.reach_m + float(np.linalg.norm(cell.target_m))
        self.bodies, self.labels = [], []
        for b, body in enumerate(cell.scene.bodies):
            vertices, triangles = surface(body.solid, far_m)
            flat = isinstance(body.solid, HalfSpace)
            node = scene.add_mesh_simple(
                f"/link_{body.link}/body_{b}",
                vertices,
                triangles,
                flat_shading=not isinstance(body.solid, (Capsule, Sphere)),
                opacity=0.35 if flat else None,
                side="double" if flat else "front",
                cast_shadow=not flat,
                **_placed(body.T_link_body),
            )
            self.bodies.append(node)
            self.labels.append(scene.add_label(f"{node.name}/name", body.name, visible=False))
        for line in lines(cell, tour):
            scene.add_line_segments(
                f"/link_{line.link}/{line.name}",
                line.points.astype(np.float32),
                line.colour,
                thickness=3.0,
                thickness_units="screen",
            )
        self._add_marks()
        self.show(0)

    def _add_marks(self) -> None:
        """Tip, tool point, target, the tips of all stops; and from where it is looked at first."""
        cell, scene = self.cell, self.server.scene
        chain, reach_m = cell.robot.chain, cell.robot.chain.reach_m
        size, tip = 0.02 * reach_m, f"/link_{cell.robot.n}/tip"
        axes = {"axes_length": 1.5 * size, "axes_radius": 0.08 * size}
        scene.add_frame(tip, **axes, origin_radius=0.2 * size, **_placed(chain.T_link_tip))
        tool_rgb = SHADES[Shade.TOOL][1]
        scene.add_icosphere(f"{tip}/tool_point", 0.3 * size, tool_rgb, position=cell.tool_m)
        for k, target in enumerate(cell.config.targets):
            radius, node = max(target.radius_mm / 1e3, 0.3 * size), f"/link_0/target_{k}"
            scene.add_icosphere(node, radius, TARGET[1], position=place_of(cell, target))
            scene.add_label(f"{node}/name", target.name)
        tips = cell.robot.fk(self.tour.frames[self.tour.stops])
        for group, T in (("poses", tips), ("pairs", self.tour.seen.reshape(-1, 4, 4))):
            if len(T):
                wxyz = quaternion_from_rotation(T[:, :3, :3])
                scene.add_batched_axes(f"/link_0/{group}", wxyz, T[:, :3, 3], **axes)
        target_m = apply(self._frames[0, 0], cell.target_m)
        middle = (target_m + self._frames[0, :, :3, 3].mean(axis=0)) / 2.0
        along = target_m * [1.0, 1.0, 0.0]
        along /= np.linalg.norm(along) or 1.0
        across = np.array([along[1], -along[0], 0.0]) if along.any() else np.array([1.0, 0, 0])
        apart = max(reach_m, float(np.linalg.norm(target_m)))
        camera = self.server.initial_camera
        camera.look_at = middle
        camera.position = middle + apart * (
            1.3 * across + 0.5 * along + 0.7 * np.array([0, 0, 1.0])
        )
        camera.up, camera.fov = np.array([0.0, 0.0, 1.0]), float(np.deg2rad(45.0))

    def show(self, frame: int) -> None:
        """Bring the arm to a posture of the tour, its bodies in their colours."""
        for node, T in zip(self.links, self._frames[frame], strict=True):
            placed = _placed(T)
            node.wxyz, node.position = placed["wxyz"], placed["position"]
        for body, shade in zip(self.bodies, self.tour.shades[frame].tolist(), strict=True):
            if tuple(body.color) != (rgb := SHADES[Shade(shade)][1]):
                body.color = rgb


def _placed(T: FloatArray) -> dict[str, FloatArray]:
    return {"wxyz": quaternion_from_rotation(T[:3, :3]), "position": T[:3, 3]}


def _serve(port: int) -> viser.ViserServer:
    """A server without words of its own: one line of the command says where it is."""
    try:
        import viser
    except ImportError as error:
        raise InputError(
            "the cell in 3-D needs viser, which is not installed",
            hint="pip install posedesign[view]",
            name="view",
        ) from error
    import rich

    rich.get_console().quiet = True  # viser prints there, and nothing of ours does
    server = viser.ViserServer(host=HOST, port=port, label="posedesign", verbose=False)
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    # any page in the browser could ask the server for a tunnel to the outside
    server.request_share_url = lambda *_, **__: None
    return server


class LiveScene:
    """A tour in the browser, with a slider and a list of its stops.

    ``port``: the first to be tried; ``address`` has the one that was free.
    """

    def __init__(self, cell: Cell, tour: Tour, port: int) -> None:
        self.tour, self._frame, self._due = tour, 0, 0.0
        self._asked: int | None = None
        self.server = _serve(port)
        self.stage = Stage(self.server, cell, tour)
        self.address = f"http://{HOST}:{self.server.get_port()}"
        gui, names = self.server.gui, tour.names
        self.names = gui.add_dropdown("pose", names)
        self.slider = gui.add_slider("number", 0, max(1, len(names) - 1), 1, 0)
        self.play = gui.add_checkbox("play the motions", False)
        labels = gui.add_checkbox("names of bodies", False)
        self._words = gui.add_html("")
        shown = "".join(
            f'<div><span style="color:rgb{rgb}">■</span> {html.escape(said)}</div>'
            for said, rgb in legend(cell, tour)
        )
        gui.add_html(f'<div style="{_STYLE}">{shown}</div>')
        self.names.on_update(lambda event: self._ask(event, names.index(self.names.value)))
        self.slider.on_update(lambda event: self._ask(event, int(self.slider.value)))
        labels.on_update(lambda _: self._name_bodies(labels.value))
        self._say(0)

    def run(self) -> None:
        """Show what is asked for, until Ctrl-C."""
        while True:
            self.step()
            time.sleep(PERIOD_S)

    def step(self) -> None:
        """Show the stop that was asked for, or the next picture of the motions.

        The one place where the arm is moved: what browsers do only leaves a wish.
        """
        asked, self._asked = self._asked, None
        if asked is not None:
            self._show(int(self.tour.stops[asked]))
        elif self.play.value and time.monotonic() >= self._due:
            self._show((self._frame + 1) % len(self.tour.frames))

    def _show(self, frame: int) -> None:
        self._frame = frame
        self.stage.show(frame)
        (stop,) = np.nonzero(self.tour.stops == frame)
        self._due = time.monotonic() + float(self.tour.stands_s[frame]) - PERIOD_S
        if len(stop):
            self._say(int(stop[0]))

    def _ask(self, event: viser.GuiEvent[Any], stop: int) -> None:
        if event.client is not None:  # a person, and not this program
            self.play.value = False
            self._asked = min(stop, len(self.tour.stops) - 1)

    def _name_bodies(self, visible: bool) -> None:
        for label in self.stage.labels:
            label.visible = visible

    def _say(self, stop: int) -> None:
        self.names.value, self.slider.value = self.tour.names[stop], stop
        said = "".join(f"<p>{html.escape(text)}</p>" for text in words(self.tour.verdicts[stop]))
        self._words.content = f'<div style="{_STYLE}">{said}</div>'


def write_scene(cell: Cell, tour: Tour, path: StrPath) -> Path:
    """Write the scene as one HTML file that needs neither server nor network.

    The tour is its recorded animation. The names of its stops are a list, to go to one by.
    """
    server = _serve(0)
    try:
        stage = Stage(server, cell, tour)
        recorded = server.get_scene_serializer()
        for frame, stands_s in enumerate(tour.stands_s.tolist()):
            stage.show(frame)
            recorded.insert_sleep(stands_s if len(tour.frames) > 1 else 0.0)
        page = recorded.as_html()
    finally:
        server.stop()
    from_s = tour.times_s[tour.stops]
    until_s = from_s + tour.stands_s[tour.stops]
    said = {
        "title": cell.robot.name,
        "legend": legend(cell, tour),
        "stops": [
            {"at": at, "until": until, "name": name, "words": words(verdict)}
            for at, until, name, verdict in zip(
                from_s.tolist(), until_s.tolist(), tour.names, tour.verdicts, strict=True
            )
        ],
    }
    # names are of others: in a script no text may end it
    data = json.dumps(said).replace("<", "\\u003c")
    over = resources.files(__package__).joinpath("scene.html").read_text(encoding="utf-8")
    head, _, tail = page.rpartition("</body>")
    text = head + over.replace("{{ data }}", data) + "</body>" + tail
    return write_text_atomic(path, text)
