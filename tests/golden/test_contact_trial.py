"""No contact that is called clear: arms of solids and of meshes against python-fcl.

fcl sees triangles alone, all pairs, with Pinocchio's kinematics: solids as meshes that lie inside
them, so that what it calls a contact is one.
"""

from itertools import combinations

import fcl
import numpy as np
import pinocchio as pin
import pytest
import trimesh

from calib.geometry import Body, Box, Capsule, Cylinder, HalfSpace, Mesh, Scene, Solid, Sphere
from calib.geometry.ways import TOUCH_M
from calib.robots import Robot, preset_names
from calib.se3 import rotation_exp, transform

KINDS = ("both", "meshes", "solids")
QUICK = {("lrmate200id", "both"), ("ur5e", "meshes"), ("panda", "both")}
FEW, MANY = 20, 100
SAMPLES_A_MOTION = 150


def as_mesh(solid: Solid) -> Mesh:
    """Triangles with their corners on the surface of a convex solid."""
    match solid:
        case Sphere(radius_m=radius):
            made = trimesh.creation.icosphere(2, radius)
        case Capsule(radius_m=radius, length_m=length):
            made = trimesh.creation.capsule(length, radius, count=[12, 12])
            made.vertices -= made.bounds.mean(axis=0)
        case Cylinder(radius_m=radius, length_m=length):
            made = trimesh.creation.cylinder(radius, length, sections=24)
        case Box(size_m=size):
            made = trimesh.creation.box(size)
        case HalfSpace():
            made = trimesh.creation.box((20.0, 20.0, 2.0))
            made.vertices -= [0.0, 0.0, 1.0]
        case Mesh():
            return solid
    return Mesh(np.asarray(made.vertices, dtype=float), np.asarray(made.faces, dtype=np.intp))


def lump(rng: np.random.Generator, size_m: float) -> Mesh:
    """A closed surface with dents and bumps, not convex, stretched along one axis."""
    made = trimesh.creation.icosphere(int(rng.integers(1, 4)), size_m)
    made.vertices *= rng.uniform(0.6, 1.3, (len(made.vertices), 1)) * rng.uniform(0.5, 1.5, 3)
    return Mesh(np.asarray(made.vertices, dtype=float), np.asarray(made.faces, dtype=np.intp))


def cell_of(name: str, kind: str, rng: np.random.Generator) -> tuple[Robot, Scene]:
    """An arm with a camera and a lump on its flange, among parts of all kinds on a floor."""
    robot = Robot.preset(name)
    reach = float(
        np.abs(robot.fk(np.clip(np.zeros(robot.n), robot.lower, robot.upper))[:3, 3]).sum()
    )

    def of_kind(solid: Solid) -> Solid:
        meshed = kind == "meshes" or (kind == "both" and rng.random() < 0.5)
        return as_mesh(solid) if meshed and not isinstance(solid, HalfSpace) else solid

    arm = [Body(b.name, b.link, b.T_link_body, of_kind(b.solid)) for b in robot.bodies]
    T_tip, small = robot.chain.T_link_tip, 0.04 * reach
    aside = transform(np.eye(3), [0.06 + 0.5 * small, 0.0, 0.0])
    tool = [
        Body("camera", robot.n, T_tip @ aside, of_kind(Box((0.05, 0.06, 0.12)))),
        Body("gun", robot.n, T_tip @ transform(np.eye(3), [0, 0, 2 * small]), lump(rng, small)),
    ]
    obstacles = [Body("floor", 0, transform(np.eye(3), [0, 0, -0.05 * reach]), HalfSpace())]
    for k in range(5):
        a, b, c = (float(v) for v in reach * rng.uniform(0.05, 0.25, 3))
        solids = (Box((a, b, c)), Cylinder(a, b), Sphere(a), Capsule(a / 2, c), lump(rng, a))
        turn = rng.uniform(-np.pi, np.pi)
        at = rng.uniform(0.5, 1.0) * np.array([np.cos(turn), np.sin(turn), rng.uniform(0.0, 1.5)])
        T = transform(rotation_exp(rng.uniform(-2.0, 2.0, 3)), reach * at)
        obstacles.append(Body(f"part{k}", 0, T, of_kind(solids[k])))
    scene = Scene(
        robot.chain,
        arm,
        tool=tool,
        obstacles=obstacles,
        zero=np.clip(np.zeros(robot.n), robot.lower, robot.upper),
        last_range=(float(robot.lower[-1]), float(robot.upper[-1])),
    )
    return robot, scene


class Fcl:
    """Contacts of all bodies that could meet, triangle by triangle."""

    def __init__(self, robot: Robot, scene: Scene) -> None:
        self._model, self._data = robot.model, robot.model.createData()
        pin.framesForwardKinematics(self._model, self._data, pin.neutral(self._model))
        self._base = self._data.oMf[self._model.getFrameId(robot.base_frame)].homogeneous
        self._bodies = scene.bodies
        self._joints = [
            self._model.getJointId(robot.joint_names[b.link - 1]) if b.link else 0
            for b in scene.bodies
        ]
        self._objects = []
        for body in scene.bodies:
            mesh, tree = as_mesh(body.solid), fcl.BVHModel()
            tree.beginModel(len(mesh.vertices), len(mesh.triangles))
            tree.addSubModel(mesh.vertices, mesh.triangles)
            tree.endModel()
            self._objects.append(fcl.CollisionObject(tree))
        excluded = {frozenset(pair) for pair in scene.excluded}
        tools = {"camera", "gun"}
        fixed = {"floor", *(f"part{k}" for k in range(5))}
        self._pairs = []
        for a, b in combinations(range(len(self._bodies)), 2):
            one, other = self._bodies[a], self._bodies[b]
            names = {one.name, other.name}
            if frozenset(names) in excluded or names <= fixed or names <= tools:
                continue
            if names & fixed:  # the base stands on them
                near = 0 in (
                    one.link + 9 * (one.name in fixed),
                    other.link + 9 * (other.name in fixed),
                )
            elif names & tools:
                near = min(one.link, other.link) == robot.n
            else:
                near = abs(one.link - other.link) < 2
            if not near:
                self._pairs.append((a, b))

    def contacts(self, q: np.ndarray) -> list[tuple[str, str]]:
        """Names of the bodies that touch at a posture (n,)."""
        pin.forwardKinematics(self._model, self._data, q)
        for body, joint, thing in zip(self._bodies, self._joints, self._objects, strict=True):
            T = (self._data.oMi[joint].homogeneous if joint else self._base) @ body.T_link_body
            thing.setTransform(fcl.Transform(T[:3, :3], T[:3, 3]))
        request = fcl.CollisionRequest()
        return [
            (self._bodies[a].name, self._bodies[b].name)
            for a, b in self._pairs
            if fcl.collide(self._objects[a], self._objects[b], request, fcl.CollisionResult())
        ]


def trial(name: str, kind: str, seed: int, count: int) -> dict[str, int]:
    """Postures and motions that were compared; asserts that no contact is called clear."""
    rng = np.random.default_rng(seed)
    robot, scene = cell_of(name, kind, rng)
    reference = Fcl(robot, scene)
    q = rng.uniform(robot.lower, robot.upper, (count, robot.n))
    clear = scene.clearance(q).distance_m >= TOUCH_M
    touching = np.array([bool(reference.contacts(posture)) for posture in q])
    assert not (clear & touching).any(), [reference.contacts(p) for p in q[clear & touching]]
    free = q[clear]
    near = free + rng.uniform(-0.5, 0.5, free.shape)
    near = np.clip(near, robot.lower, robot.upper)
    passed = scene.ways(free, near, TOUCH_M).clear
    part = np.linspace(0.0, 1.0, SAMPLES_A_MOTION)[:, None]
    for start, end in zip(free[passed], near[passed], strict=True):
        for posture in start + part * (end - start):
            assert not reference.contacts(posture), (start, end)
    deep = scene.clearance(q[~clear & ~touching], depths=True).distance_m
    return {
        "postures": count,
        "contacts": int(touching.sum()),
        "refused": int((~clear).sum()),
        "refused, not seen by fcl": len(deep),
        "of them deeper than 5 mm": int((deep < -5e-3).sum()),
        "motions": len(free),
        "clear motions": int(passed.sum()),
    }


def marks_of(arm: int, name: str, of: int, kind: str) -> tuple[pytest.MarkDecorator, ...]:
    """Each arm in one of the kinds in turn among the slow ones; all of them with all there is."""
    if (name, kind) in QUICK:
        return ()
    return (pytest.mark.slow, pytest.mark.full)[: 1 if (arm + of) % len(KINDS) == 0 else 2]


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        pytest.param(name, kind, marks=marks_of(arm, name, of, kind))
        for arm, name in enumerate(preset_names())
        for of, kind in enumerate(KINDS)
    ],
)
def test_no_contact_is_called_clear(name, kind):
    quick = (name, kind) in QUICK
    found = trial(name, kind, 1, FEW if quick else MANY)
    assert found["contacts"] > 0
    assert found["clear motions"] > 0
