"""What stands around the arm and what it must keep, as the file of the cell describes it."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.errors import CalibError, FileFormatError, InputError, RobotModelError, near_names
from calib.geometry import Body, Box, Cylinder, HalfSpace, Mesh, Scene, Solid, Sphere
from calib.geometry.ways import WAY_TOLERANCE_M
from calib.model.measurements import KINDS
from calib.robots import Robot, preset_info
from calib.robots.arm_shapes import bare_links, presets_like, unshaped_links
from calib.se3 import FloatArray, inverse, rotation_from_wpr, transform
from calib.vision.camera import PinholeCamera
from posedesign.cell.board_set_up import board_set_up
from posedesign.cell.data import CellData
from posedesign.cell.schema import SolidSection
from posedesign.cell.schema_sections import TargetSection
from posedesign.constraints import (
    Checker,
    Collision,
    Constraint,
    MotionChecker,
    Retreat,
    SelfCollision,
)
from posedesign.constraints.checker import Singularity
from posedesign.constraints.mark_sight import MarkSight
from posedesign.constraints.space import POINT_M, BackingOff, Workspace, workspace_scene
from posedesign.constraints.visibility import BoardSight, TargetView, sight_constraints

NOT_TOUCHING_M = 2.0 * WAY_TOLERANCE_M
"""Distance that bodies which meet at the target keep before: moves are checked to half of it."""

NOTEWORTHY_M = 0.01
"""Distance of the target from the tool point at the base posture that is worth a warning."""

FARTHEST_M = 100.0
"""Nothing of a cell is farther away."""

_COUPLED_ABB = "irb_?(2400|4400|5400)"
"""Arms with a parallel linkage for which ROS-Industrial's abb packages have J23_coupled."""

MOST_RAD_PER_S = 50.0
"""Speed above which no joint turns: the fastest wrists reach 25 rad/s, flange axes of SCARA arms
50."""

SMALL_SOLID_M = 0.002
"""Of a body of a cell the largest extent is larger: others were given in metres."""

SMALL_MESH_M, LARGE_MESH_M = 0.01, 50.0
"""Meshes of a cell are larger and smaller than this: others were made in another unit."""


def tool_bodies(sections: Sequence[SolidSection], robot: Robot, folder: Path) -> list[Body]:
    """What the flange carries; places in the file are in the tip frame."""
    T_link_tip = robot.chain.T_link_tip
    return [Body(s.name, robot.n, T_link_tip @ _placement(s), _solid(s, folder)) for s in sections]


def obstacles(sections: Sequence[SolidSection], robot: Robot, folder: Path) -> list[Body]:
    """What stands around; places in the file are in the base frame, those of scenes in the root.

    Where a positioner carries the base: in the root, or in the base what turns with it.

    Raises
    ------
    FileFormatError
        A file cannot be read, or two solids have one name.
    InputError
        It is not said what something stands on, or it cannot stand there.
    """
    around: list[Body] = []
    for section in sections:
        _check_foot(section, robot)
        floor = robot.floor if section.stands_on == "floor" else 0
        T_link_frame = robot.T_floor_world if floor else np.eye(4)
        if section.scene is None:
            place = T_link_frame @ _placement(section)
            around.append(Body(section.name, floor, place, _solid(section, folder)))
            continue
        T_link_scene = (T_link_frame if floor else robot.T_base_root) @ _placement(section)
        from posedesign.cell.moveit_scene import read_scene  # not loaded for cells without

        for name, T_scene_solid, solid in read_scene(folder / section.scene):
            place = T_link_scene @ T_scene_solid
            around.append(Body(f"{section.name}/{name}", floor, place, solid))
    return around


def _check_foot(section: SolidSection, robot: Robot) -> None:
    """Refuse an obstacle of which it is not known whether it turns with a positioner."""
    if not robot.floor and section.stands_on is not None:
        raise InputError(
            f"{section.name} stands on the {section.stands_on}, and no positioner carries "
            f"{robot.base_frame}",
            hint="leave stands_on out: places are in the base frame",
            name=section.name,
        )
    if robot.floor and section.stands_on is None:
        raise InputError(
            f"{section.name}: a positioner carries {robot.base_frame}, and it is not said whether "
            "this turns with it",
            hint='set stands_on = "floor" (at_mm in the root link) or "positioner" (in the base)',
            name=section.name,
        )
    if section.stands_on == "positioner" and section.kind in ("half-space", "scene"):
        raise InputError(
            f"{section.name}: a {section.kind} cannot stand on a positioner",
            hint='set stands_on = "floor"',
            name=section.name,
        )


def in_base(robot: Robot, bodies: Sequence[Body], q: FloatArray) -> list[Body]:
    """Obstacles as they stand in the base at a posture ``(n,)``."""
    T_base_floor = robot.T_base_floor(q)
    return [
        replace(body, link=0, T_link_body=T_base_floor @ body.T_link_body) if body.link else body
        for body in bodies
    ]


def meeting_pairs(cell: CellData) -> tuple[tuple[str, str], ...]:
    """Names of tool bodies and obstacles that may come together where the tool touches its target.

    Those of ``constraints.ignore``: nothing that the arm carries is ever unchecked on the motions.
    """
    section = cell.config.constraints
    carried, around = (
        {body.name for body in group} for group in (cell.tool_bodies, cell.obstacles)
    )
    return tuple(
        (one, other)
        for one, other in section.ignore * section.collisions
        if (one in carried and other in around) or (other in carried and one in around)
    )


def build_scene(cell: CellData, ignore: Sequence[tuple[str, str]]) -> Scene:
    """Arm, tool and obstacles of a cell."""
    robot = cell.robot
    return Scene(
        robot.chain,
        arm=robot.bodies,
        tool=cell.tool_bodies,
        obstacles=cell.obstacles,
        ignore=[*ignore, *cell.robot.allowed_contacts],
        zero=np.clip(np.zeros(robot.n), robot.lower, robot.upper),
        last_range=(float(robot.lower[-1]), float(robot.upper[-1])),
    )


def build_checker(
    cell: CellData,
    scene: Scene,
    solid: Sequence[Collision],
    retreat: Retreat | None,
    sight: MarkSight | None,
) -> Checker:
    """All constraints that a measuring posture of a cell must keep, the costly ones last."""
    found: list[Constraint] = []
    camera = cell.config.camera
    smallest = cell.config.constraints.smallest_singular_value
    if smallest:
        found.append(Singularity(smallest, cell.singularity_setting))
    if cell.sees_board:
        there = board_set_up(cell)
        found += sight_constraints(
            BoardSight(
                lens=there.lens,
                points=there.board.extent,
                outline=there.board.outline,
                T_tip_own=there.X,
                T_base_other=there.Z,
                carried=there.carried,
                share=there.share,
            ),
            scene,
            nearest_m=there.nearest_m,
            farthest_m=there.farthest_m,
            largest_tilt=there.largest_tilt,
            border_px=there.border_px,
        )
    elif camera is not None:
        view = TargetView(
            camera=PinholeCamera(*camera.image_px, camera.focal_px),
            T_tip_camera=cell.T_tip_camera,
            target_m=cell.target_m,
            normal=cell.target_normal,
            radius_m=cell.config.target.radius_mm / 1e3,
        )
        found += sight_constraints(
            view,
            scene,
            nearest_m=camera.nearest_mm / 1e3,
            farthest_m=camera.farthest_mm / 1e3,
            largest_tilt=float(np.deg2rad(camera.largest_tilt_deg)),
            border_px=camera.border_px,
        )
    backing_off = [] if retreat is None else [BackingOff(retreat)]
    seen = [] if sight is None else [sight]
    return Checker(cell.robot, [*found, *solid, *seen, *backing_off], cell.margin)


def build_retreat(
    cell: CellData, passing: Checker, solid: tuple[Collision, ...], largest_travel: float
) -> Retreat | None:
    """The moves along the tool to the poses of a cell; None where it asks for none."""
    plan, ways = cell.config.plan, cell.config.constraints.ways
    if not plan.retreat_mm:
        return None
    met = {name for pair in meeting_pairs(cell) for name in pair}
    tool = [body for body in cell.tool_bodies if body.name in met]
    around = [body for body in cell.obstacles if body.name in met]
    meeting = Collision(Scene(cell.robot.chain, tool=tool, obstacles=around), NOT_TOUCHING_M)
    axis = np.array(cell.config.tool.axis)
    return Retreat(
        robot=cell.robot,
        tool_m=cell.tool_m,
        axis=axis / np.linalg.norm(axis),
        length_m=plan.retreat_mm / 1e3,
        contact_m=plan.contact_mm / 1e3,
        short_m=plan.stop_short_mm / 1e3,
        passing=passing,
        others=MotionChecker(solid if ways else (), largest_travel, cell.robot.external),
        meeting=MotionChecker((meeting,) if ways and met else (), np.inf),
    )


def build_collisions(cell: CellData, scene: Scene) -> tuple[Collision, ...]:
    """Constraints of a cell on what arm and tool come near to, as the pairs of a scene have it."""
    section = cell.config.constraints
    low, high = section.workspace_lowest_mm, section.workspace_highest_mm
    found: list[Collision] = []
    if low is not None and high is not None:
        bodies = [*cell.robot.bodies, *cell.tool_bodies]
        box = np.array([low, high]) / 1e3
        found.append(Workspace(workspace_scene(cell.robot, bodies, cell.tool_m, *box)))
    if section.collisions:
        refuse_unshaped(cell)
        own, others = scene.own, scene.others
        if len(own.pairs):
            found.append(SelfCollision(own))
        if len(others.pairs):
            found.append(Collision(others, section.safety_distance_mm / 1e3))
    return tuple(found)


def nearest_body(
    robot: Robot, bodies: Sequence[Body], point_m: FloatArray
) -> tuple[float, str] | None:
    """Distance [m] of a point from the nearest of some bodies, and its name; None without any.

    Parameters
    ----------
    bodies : sequence of Body
        All of them on the base (see :func:`in_base`), or all on the last link.
    point_m : array (3,)
        In the frame that their placements are given in [m].
    """
    if not bodies:
        return None
    rest = np.clip(np.zeros(robot.n), robot.lower, robot.upper)
    state = robot.state(rest)
    T_base_link = transform(state.rotations[-1], state.origins[-1])
    place = inverse(T_base_link) @ transform(np.eye(3), point_m)
    around = [replace(body, link=0) for body in bodies]
    point = Body("point", robot.n, place, Sphere(POINT_M))
    scene = Scene(robot.chain, tool=[point], obstacles=around)
    found = scene.clearance(rest[None], cap_m=FARTHEST_M)
    return float(found.distance_m[0]) + POINT_M, scene.names(int(found.pair[0]))[1]


def _place_words(place_m: FloatArray) -> str:
    return ", ".join(f"{1e3 * value + 0.0:.1f}" for value in place_m.round(6))


@dataclass(frozen=True, eq=False)
class Whereabouts:
    """Where the target of a cell is, and where its tool points to."""

    frame: str
    target: str  # frame, target: the base frame, and the name of the target
    target_m: FloatArray
    tool_m: FloatArray
    """target_m, tool_m (3,): the target, and the tool point at the base posture, in the base frame
    [m]."""
    nearest: tuple[float, str] | None  # distance [m] and name of the obstacle nearest to the target
    others: tuple[tuple[str, FloatArray], ...] = ()  # names and places [m] of further targets

    @property
    def apart_m(self) -> float:
        """Distance of the tool point at the base posture from the target [m]."""
        return float(np.linalg.norm(self.target_m - self.tool_m))

    @property
    def words(self) -> str:
        """All of it in one line."""
        place = _place_words(self.target_m)
        near = "no obstacle is described"
        if self.nearest is not None:
            near = f"nearest obstacle: {self.nearest[1]}, {1e3 * self.nearest[0]:.1f} mm"
        return (
            f"{self.target} at ({place}) mm in {self.frame}, {1e3 * self.apart_m:.1f} mm from the "
            f"tool point at the base posture; {near}"
        ) + "".join(f"; {name} at ({_place_words(at)}) mm" for name, at in self.others)

    def as_dict(self) -> dict[str, object]:
        """The same for programs, in mm."""
        far, name = self.nearest or (None, None)
        return {
            "name": self.target,
            "frame": self.frame,
            "position_mm": 1e3 * self.target_m,
            "tool_point_mm": 1e3 * self.tool_m,
            "apart_mm": 1e3 * self.apart_m,
            "nearest_obstacle": name,
            "nearest_mm": None if far is None else 1e3 * far,
        }


def refuse_unshaped(cell: CellData) -> None:
    """Refuse to look for collisions of an arm with links that nothing is known of.

    Raises
    ------
    RobotModelError
        Naming the links, and what can be done.
    """
    robot = cell.robot
    names = ", ".join(unshaped_links(robot))
    if not names:
        return
    same = presets_like(robot)
    raise RobotModelError(
        f"{robot.name} has no collision geometry for {names}: what they run into is not seen",
        hint=(f'set robot.shapes = "{same[0]}", a preset of the same kinematics; ' if same else "")
        + "set robot.capsule_radius_mm to take these links for capsules of this radius, give their "
        "collision geometry in the URDF with its meshes, or say constraints.collisions = false",
        name=names,
    )


def what_may_be_wrong(cell: CellData) -> list[str]:
    """What looks like a mistake in a cell, in words."""
    said = []
    if not cell.config.other_targets and cell.target_offset_m > NOTEWORTHY_M:
        said.append(
            f"the target is {1e3 * cell.target_offset_m:.0f} mm from where the base posture puts "
            "the tool point"
        )
    said += [*_overload(cell), *_speeds_in_degrees(cell.robot)]
    section, controller = cell.config.robot, cell.robot.controller
    name = re.search(_COUPLED_ABB, cell.robot.name.lower())
    if name and controller and controller.maker == "abb" and not section.coupling:
        said.append(
            f"the controller of an IRB {name[1]} shows J3 with J2 in it, and [[robot.coupling]] "
            "does not say so (ratio = 1.0, or 0.0 if yours does not)"
        )
    for body in (*cell.tool_bodies, *cell.obstacles):
        size = _largest_m(body.solid)
        if isinstance(body.solid, Mesh):
            if not SMALL_MESH_M < size < LARGE_MESH_M:
                said.append(
                    f"the mesh of {body.name} is {1e3 * size:.3g} mm large: is its file in mm? "
                    "(scale = 1000 for metres)"
                )
        elif size < SMALL_SOLID_M:
            said.append(f"{body.name} is {1e3 * size:.3g} mm large: is its size in mm?")
    return said


def _overload(cell: CellData) -> list[str]:
    """What weighs more than the robot carries, where its preset knows that."""
    config = cell.config
    if config.robot.preset is None:
        return []
    most = float(preset_info(config.robot.preset)["payload_kg"])
    masses = [("the tool", config.tool.mass_kg), *((p.name, p.mass_kg) for p in config.payload)]
    return [
        f"{name} weighs {mass:g} kg, and the robot carries {most:g} kg at most"
        for name, mass in masses
        if mass > most
    ]


def _speeds_in_degrees(robot: Robot) -> list[str]:
    """Speeds of joints that can only be degrees a second."""
    fast = [j for j in range(robot.n) if not robot.sliding[j] and robot.speed[j] > MOST_RAD_PER_S]
    if not fast:
        return []
    named, speed = ", ".join(robot.joint_names[j] for j in fast), float(robot.speed[fast[0]])
    return [
        f"the robot's description has {named} turn at up to {speed:g} rad/s: were the speeds typed "
        f"in degrees? a URDF has radians a second ({np.deg2rad(speed):.3g}); times are too short"
    ]


def _largest_m(solid: Solid) -> float:
    """Largest extent of a body [m]; infinite for what has none."""
    if isinstance(solid, Mesh):
        return float(np.ptp(solid.vertices, axis=0).max())
    if isinstance(solid, Box):
        return max(solid.size_m)
    if isinstance(solid, HalfSpace):
        return np.inf
    return max(2.0 * solid.radius_m, getattr(solid, "length_m", 0.0))


def what_is_odd(cell: CellData) -> list[str]:
    """What a person should know of a cell, in words."""
    said = []
    if touches(cell) and cell.config.camera is None and not cell.config.plan.retreat_mm:
        said.append(
            "plan.retreat_mm is 0: a tool that touches the target does not back off between "
            "the poses"
        )
    planned = cell.config.parameters.planned
    if planned is not None and not cell.is_hand_eye:
        said.append(
            f"parameters.planned: plans take {', '.join(planned)} for all that may be off, and "
            "expect no other error; without the key they are for the arm that identify fits"
        )
    if cell.is_hand_eye:
        said.append(
            "camera and target are calibrated, and the robot is taken to be exact: [parameters] "
            "plays no part, and the robot's errors come on top of what is predicted"
            if not cell.sees_board
            else "camera and board are calibrated, [parameters] and [task_box] play no part; plans "
            "take the arm to stop off by measurement.arm_three_sigma_mm and _deg"
        )
    return said


def what_is_not_checked(cell: CellData, excluded: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    """What planning and checking of a cell do not look at, in words.

    ``excluded`` are the pairs of bodies that its scene leaves out.
    """
    section = cell.config.constraints
    said = _unseen_collisions(cell, excluded) if section.collisions else _without_collisions(cell)
    if not section.ways:
        said.append("the ways between poses: constraints.ways is false")
    if cell.config.camera is None and touches(cell):
        said.append("the view of the target: no [camera] is described")
    if cell.config.measurement.payloads:
        said.append("collisions of what the flange carries besides: payloads have no shape")
    return tuple(said)


def touches(cell: CellData) -> bool:
    """Whether the tool is brought to a target, by a pin or by what a camera sees."""
    kinds = {target.kind or cell.config.measurement.kind for target in cell.config.targets}
    return not cell.is_hand_eye and any(not KINDS[kind].reads for kind in kinds)


def _without_collisions(cell: CellData) -> list[str]:
    said = ["collisions: constraints.collisions is false"]
    unshaped = ", ".join(unshaped_links(cell.robot))
    if unshaped and (cell.config.camera or cell.config.constraints.workspace_lowest_mm):
        said.append(f"view and workspace but for joints and tool point: no shape of {unshaped}")
    return said


def _unseen_collisions(cell: CellData, excluded: Sequence[tuple[str, str]]) -> list[str]:
    robot = cell.robot
    said = []
    if robot.fitted_links:
        fitted = ", ".join(robot.fitted_links)
        said.append(
            f"what sticks out of the capsules along the chain that stand for {fitted}: an estimate"
        )
    for link in bare_links(robot):
        said.append(f"collisions with {link}: it has no shape")
    if not cell.tool_bodies:
        said.append("collisions of the tool: no [[tool.body]] is described")
    if not cell.obstacles:
        said.append("collisions with what stands around: no [[obstacle]] is described")
    meeting = meeting_pairs(cell)
    for pairs, why in (
        (
            excluded,
            "they touch in the zero posture (tool and wrist: at every angle of the last joint)",
        ),
        (meeting, "in constraints.ignore, at the poses and right before them"),
        (
            [pair for pair in cell.config.constraints.ignore if pair not in meeting],
            "in constraints.ignore",
        ),
    ):
        if pairs:
            said.append(f"{', '.join(f'{one} against {other}' for one, other in pairs)}: {why}")
    if robot.allowed_contacts:
        said.append(f"{len(robot.allowed_contacts)} pairs of links: robot.srdf lets them touch")
    return said


def _placement(section: SolidSection) -> FloatArray:
    rotation = rotation_from_wpr(np.deg2rad(section.wpr_deg))
    return transform(rotation, np.array(section.at_mm) / 1e3)


def _solid(section: SolidSection, folder: Path) -> Solid:
    if section.mesh is not None:
        from calib.robots.description.mesh_file import read_mesh

        scale = section.scale / 1e3  # a mesh of a cell is in mm, as everything in its file
        return read_mesh(folder / section.mesh, (scale, scale, scale))
    if section.size_mm is not None:
        x, y, z = np.array(section.size_mm) / 1e3
        return Box((float(x), float(y), float(z)))
    if section.radius_mm is not None:
        radius_m = section.radius_mm / 1e3
        if section.height_mm is None:
            return Sphere(radius_m)
        return Cylinder(radius_m, section.height_mm / 1e3)
    return HalfSpace()


TOUCHING_M = 0.02
"""A tool that is to touch its target ends within this of the tool point, what it touches within
this of the target: bodies are described a few millimetres short, and measured by hand."""

NEAREST_LENS_M = 1e-3
"""A lens nearer to its target than this is a mistake: nothing could be told of what it sees."""


class naming:
    """Name file and key in an error that was raised without knowing them."""

    def __init__(self, path: Path, key: str) -> None:
        self._path, self._key = path, key

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, CalibError):
            raise FileFormatError(
                error.message, path=self._path, key=self._key, hint=error.hint
            ) from error


def check_cell(cell: CellData, scene: Callable[[], Scene], path: Path) -> None:
    """Refuse what does not go together in a cell, among it bodies that its scene cannot be of.

    Raises
    ------
    FileFormatError
        Naming file and key.
    """
    _check_truth(cell, path)
    _check_margins(cell, path)
    _check_surroundings(cell, scene, path)


def check_observations(cell: CellData, path: Path) -> None:
    """Refuse targets, marks and payloads that do not go with how they are measured.

    Raises
    ------
    FileFormatError
        Naming file and key.
    """
    config = cell.config
    by_camera = cell.is_hand_eye or config.camera is not None
    loads = [load.name for load in config.payload]
    for name in config.measurement.payloads:
        if name not in loads:
            raise FileFormatError(
                f"the cell has no payload {name!r}",
                path=path,
                key="measurement.payloads",
                hint=near_names(name, loads) if loads else "list it as [[payload]]",
                value=name,
            )
    if cell.camera_stands and cell.robot.floor:
        raise FileFormatError(
            f"a camera that stands around the arm does not turn with {cell.robot.base_frame}, "
            "which a positioner carries",
            path=path,
            key="camera.mount",
            hint="name a link on the floor as robot.base, or put the camera on the flange",
        )
    for k, target in enumerate(config.targets):
        _check_footing(cell, target, path, "target" + f".{k}" * bool(config.other_targets))
    if config.tool.mark and by_camera:
        raise FileFormatError(
            "marks are seen by an instrument or touch, and this cell looks through a camera",
            path=path,
            key="tool.mark",
            hint="leave them out, or the section [camera]",
        )
    marked = [mark.name for mark in config.tool.mark]
    for k, target in enumerate(config.targets):
        kind = target.kind or config.measurement.kind
        key = "target" + f".{k}" * bool(config.other_targets)
        camera_only = ("camera-pose", "board")
        if (kind in camera_only or config.measurement.kind in camera_only) and (
            config.other_targets or kind != config.measurement.kind
        ):
            raise FileFormatError(
                f"a {config.measurement.kind} is planned by itself: of one target, and nothing "
                "else with it",
                path=path,
                key=key,
                hint="leave the other targets out, or make a cell of their own for them",
            )
        if kind in camera_only:
            continue
        if KINDS[kind].reads and target.position_mm is None:
            raise FileFormatError(
                f"where {target.name} stands is not said, and what it sees goes by that",
                path=path,
                key=f"{key}.position_mm",
                hint="give it in the base frame [mm]: a decimetre is near enough",
            )
        if kind == "distance" and target.farthest_mm is None:
            raise FileFormatError(
                f"how long {target.name} can be is not said",
                path=path,
                key=f"{key}.farthest_mm",
                hint="give nearest_mm and farthest_mm: the lengths of the ball bar or wire",
            )
        if kind == "pose" and marked:
            raise FileFormatError(
                "a pose is of the tool as a whole, and this one has marks",
                path=path,
                key="tool.mark",
                hint="leave the marks out, or measure them as points",
            )


def _check_footing(cell: CellData, target: TargetSection, path: Path, key: str) -> None:
    """Refuse a target that does not turn with the base, and an instrument that may not."""
    robot, kind = cell.robot, target.kind or cell.config.measurement.kind
    key = f"{key}.stands_on"
    if not robot.floor and target.stands_on is not None:
        raise FileFormatError(
            f"no positioner carries {robot.base_frame}: all targets stand still in it",
            hint="leave it out",
            path=path,
            key=key,
        )
    if robot.floor and target.stands_on == "floor":
        raise FileFormatError(
            f"{target.name} does not turn with {robot.base_frame}, which a positioner carries",
            hint="what is measured from the floor tells nothing of the positioner: name a link on "
            "the floor as robot.base",
            path=path,
            key=key,
        )
    reads = kind in KINDS and KINDS[kind].reads
    if robot.floor and target.stands_on is None and reads:
        raise FileFormatError(
            f"it is not said whether {target.name} turns with {robot.base_frame}, which a "
            "positioner carries",
            hint='set it to "positioner" where the instrument is on it, or reads in the frame of '
            "reflectors on it; from the floor, name a link there as robot.base",
            path=path,
            key=key,
        )


def check_board(cell: CellData, path: Path) -> None:
    """Refuse pictures of a board without camera or board, and a camera around the arm without them.

    Raises
    ------
    FileFormatError
        Naming file and key.
    """
    if cell.sees_board:
        try:
            board_set_up(cell)
        except InputError as error:
            with naming(path, error.name or "camera"):
                raise
    elif cell.camera_stands:
        raise FileFormatError(
            f"a {cell.config.measurement.kind} has its camera on the flange",
            path=path,
            key="camera.mount",
            hint='set it to "flange", or measurement.kind = "board"',
            value="fixed",
        )


def _check_truth(cell: CellData, path: Path) -> None:
    truth, n = cell.config.truth, len(cell.robot.turning_joints)
    for key, values, count in (
        ("zero_offsets_deg", truth.zero_offsets_deg, n),
        ("stiffness_nm_per_rad", truth.stiffness_nm_per_rad, n),
        ("positioner_offsets_deg", truth.positioner_offsets_deg, cell.robot.floor),
    ):
        if values is not None and len(values) != count:
            raise FileFormatError(
                f"{len(values)} values for {count} joints of the "
                + ("positioner" if key.startswith("positioner") else "arm"),
                path=path,
                key=f"truth.{key}",
                hint="give one value for each joint",
            )
    if truth.deflection and not cell.deflects:
        raise FileFormatError(
            f"nothing is known that would make {cell.robot.name} deflect",
            path=path,
            key="truth.deflection",
            hint="give truth.stiffness_nm_per_rad and tool.mass_kg, or set it to false",
        )


def _check_surroundings(cell: CellData, scene: Callable[[], Scene], path: Path) -> None:
    try:
        inside = int(scene().inside(cell.target_m[None])[0])
    except InputError as error:
        ignored = [name for pair in cell.config.constraints.ignore for name in pair]
        key = "constraints.ignore" if error.name in ignored else "tool.body, obstacle"
        with naming(path, key):
            raise
    met = meeting_pairs(cell)
    if met and not cell.config.plan.retreat_mm:
        raise FileFormatError(
            f"{met[0][0]} and {met[0][1]} may touch: without a retreat they would run into each "
            "other on the motions between the poses",
            path=path,
            key="constraints.ignore",
            hint="set plan.retreat_mm: how far the tool backs off along its axis before it turns, "
            "such as 50",
        )
    if inside >= 0:
        obstacle = cell.obstacles[inside].name
        raise FileFormatError(
            f"the target lies inside the obstacle {obstacle!r}",
            path=path,
            key="target.position_mm",
            hint="correct the place of one of them; a target sits on its fixture, not in it",
        )
    _check_contact(cell, path)
    if cell.config.camera and np.linalg.norm(cell.lens_m - cell.target_m) < NEAREST_LENS_M:
        raise FileFormatError(
            "the lens of the camera lies on the target",
            path=path,
            key="camera.position_mm",
            hint="give the place of the lens in the axes of the tip, or tool.camera_stand_off_mm",
        )


def _check_contact(cell: CellData, path: Path) -> None:
    """Refuse a tool that would not touch what it is described to touch.

    Bodies of tool and surroundings that ``constraints.ignore`` lets come together meet at the
    target, and the tool point is where the tool ends, unless a camera looks from afar.
    """
    pairs = {name for pair in meeting_pairs(cell) for name in pair}
    if cell.config.camera is not None or not pairs:
        return
    tool = [body for body in cell.tool_bodies if body.name in pairs]
    around = [body for body in cell.obstacles if body.name in pairs]
    point = cell.robot.chain.T_link_tip @ [*cell.tool_m, 1.0]
    x, y, z = 1e3 * cell.target_m
    target = f"the target at ({x:.1f}, {y:.1f}, {z:.1f}) mm in {cell.robot.base_frame}"
    checks = (
        (
            nearest_body(cell.robot, in_base(cell.robot, around, cell.base_posture), cell.target_m),
            target,
            "obstacle",
        ),
        (nearest_body(cell.robot, tool, point[:3]), "the tool point", "tool.body"),
        ((cell.target_offset_m, "the tool point of the base posture"), target, "base_pose"),
    )
    for found, place, key in checks:
        if found is not None and found[0] > TOUCHING_M:
            raise FileFormatError(
                f"{found[1]} is {1e3 * found[0]:.0f} mm from {place}, and is to touch there "
                "(constraints.ignore)",
                path=path,
                key=key,
                hint="correct the place of one of them: tool.point_mm, target.position_mm, or "
                "at_mm of the body",
                value=found[0],
                bound=TOUCHING_M,
            )


def _check_margins(cell: CellData, path: Path) -> None:
    plan = cell.config.plan
    ranges = np.where(cell.robot.sliding, np.inf, cell.robot.joint_range)
    narrowest = int(np.argmin(ranges))
    room = float(np.rad2deg(cell.robot.joint_range[narrowest])) / 2.0
    for key in ("limit_margin_deg", "repair_margin_deg"):
        if getattr(plan, key) >= room:
            raise FileFormatError(
                f"{getattr(plan, key):g} deg leaves nothing of the range of "
                f"{cell.robot.joint_names[narrowest]}",
                path=path,
                key=f"plan.{key}",
                hint=f"stay well below {room:.0f} deg",
            )
