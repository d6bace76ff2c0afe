"""Written lists of poses against an independent reading of the same URDF: no contact is missed.

Arms get collision geometry of all kinds, a tool and obstacles; the command line plans; and what
stands in ``poses.csv`` is driven through by Pinocchio's own reading of the URDF, with python-fcl on
the triangles and primitives of the files. What the list names as not checked is left out.
"""

import csv
import re
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from xml.etree import ElementTree as ET

import fcl
import numpy as np
import pinocchio as pin
import pytest
import trimesh

from calib.geometry import Box as OwnBox
from calib.geometry import Capsule
from calib.robots import Robot
from calib.se3 import FloatArray, inverse, rotation_from_wpr, transform, wpr_from_rotation
from posedesign.cell import Cell
from posedesign.cli.main import run
from studies.real_data import data_folder
from tests.cli.conftest import empty_pictures

SAMPLES_A_MOTION = 150
ON_THE_SURFACE_M = 1e-5
KINDS = ("meshes", "primitives", "hulls", "both", "capsules", "shapes")
ARMS = (
    "irb120_3_58.urdf",
    "irb6640_185_280.urdf",
    "irb6700_200_260.urdf",
    "kr6r900sixx.urdf",
    "lrmate200id.urdf",
    "m20ia.urdf",
    "mh5.urdf",
    "panda.urdf",
    "r2000ic165f.urdf",
    "tx2_60.urdf",
    "ur10e.urdf",
    "ur5e.urdf",
    "gp7",
    "hp3",
    "irb120",
    "tx2_90",
    "r2000ib210f",
    "r2000ia165f_fig7",
    "panda",
    "ur10e",
)
WILD = {
    "safety_distance_mm": "0.0",
    "start_deg": "[45.0, 45.0, 45.0]",
    "largest_deg": "[65.0, 65.0, 65.0]",
    "configurations": '"all"',
    "tilt_deg": "80.0",
}
PLANS = (("wpr",), ("exchange", "--poses", "15"))
UNITS = ((1.0, 1.0, 1.0), (1e-3, 1e-3, 1e-3), (1e-3, -1e-3, 1e-3), (1e-3, 2e-3, 0.0254))
CONTACT_MM, RETREAT_MM, SAFETY_MM = 5.0, 40.0, 10.0


# --- Making of arms and cells


@dataclass
class Arm:
    """A URDF in a folder, with the chain from its root to its tip."""

    folder: Path
    tree: ET.Element
    rng: np.random.Generator
    joints: list[ET.Element] = field(default_factory=list)

    def __post_init__(self) -> None:
        parents = {j.find("child").get("link"): j for j in self.tree.findall("joint")}
        chains = []
        for link in [one.get("name") for one in self.tree.findall("link")]:
            chain = []
            while link in parents:
                chain.insert(0, parents[link])
                link = parents[link].find("parent").get("link")
            chains.append(chain)
        moved = [[j for j in c if j.get("type") != "fixed"] for c in chains]
        self.joints = max(zip(moved, chains, strict=True), key=lambda m: (len(m[0]), len(m[1])))[1]

    @property
    def tip(self) -> str:
        return str(self.joints[-1].find("child").get("link"))

    def write(self) -> Path:
        path = self.folder / "arm.urdf"
        ET.ElementTree(self.tree).write(path)
        return path

    def clothe(self, kind: str) -> None:
        """Give every link of the chain collision geometry, along the line to the next joint."""
        offsets = [np.array(_numbers(j.find("origin"), "xyz")) for j in self.joints]
        reach = sum(float(np.linalg.norm(offset)) for offset in offsets)
        links = [str(self.joints[0].find("parent").get("link"))]
        links += [str(j.find("child").get("link")) for j in self.joints]
        ends = [*offsets, np.zeros(3)]
        fixed = [False, *(j.get("type") == "fixed" for j in self.joints)]
        thickness = reach * np.linspace(0.05, 0.022, len(links))
        for k, (name, end) in enumerate(zip(links, ends, strict=True)):
            length = float(np.linalg.norm(end))
            if (fixed[k] and length < 1e-3) or name == self.tip:
                continue
            link = next(one for one in self.tree.findall("link") if one.get("name") == name)
            parts = 2 if self.rng.random() < 0.3 else 1
            for part in range(parts):
                of = kind
                if kind == "both":
                    of = ("meshes", "primitives", "hulls")[int(self.rng.integers(3))]
                T, size = _along(end, thickness[k])
                if part:  # a motor that sticks out
                    aside = self.rng.normal(size=3)
                    aside *= 1.2 * thickness[k] / np.linalg.norm(aside)
                    T, size = transform(T[:3, :3], aside), 0.7 * thickness[k] * np.ones(3)
                self._add(link, f"part{part}", of, T, size)

    def _add(self, link: ET.Element, name: str, kind: str, T: FloatArray, size: FloatArray) -> None:
        """A collision element: ``size`` is half of a box at ``T``."""
        element = ET.SubElement(link, "collision", name=name)
        W, P, R = wpr_from_rotation(T[:3, :3])
        ET.SubElement(
            element,
            "origin",
            xyz=" ".join(f"{v:.17g}" for v in T[:3, 3]),
            rpy=f"{W:.17g} {P:.17g} {R:.17g}",
        )
        geometry = ET.SubElement(element, "geometry")
        if kind != "primitives":
            unit = UNITS[int(self.rng.integers(len(UNITS)))]
            file = f"{link.get('name')}_{name}.{self.rng.choice(['stl', 'obj', 'ply'])}"
            made = lump(self.rng, size, kind == "hulls")
            if self.rng.random() < 0.3:  # in two pieces
                other = lump(self.rng, 0.6 * size, kind == "hulls")
                other.vertices += [0.9 * size[0], 0.0, 0.0]
                made = trimesh.util.concatenate([made, other])
            made.vertices /= unit
            made.export(self.folder / file)
            scale = " ".join(f"{v}" for v in unit)
            ET.SubElement(geometry, "mesh", filename=file, scale=scale)
            return
        which = self.rng.integers(3) if np.ptp(size) < 0.3 * size.max() else self.rng.integers(2)
        if which == 0:
            edges = " ".join(f"{2 * v:.17g}" for v in 0.85 * size)
            ET.SubElement(geometry, "box", size=edges)
        elif which == 1:
            ET.SubElement(geometry, "cylinder", radius=f"{size[0]}", length=f"{2 * size[2]}")
        else:
            ET.SubElement(geometry, "sphere", radius=f"{size.max()}")


def _numbers(element: ET.Element | None, key: str) -> list[float]:
    text = None if element is None else element.get(key)
    return [float(v) for v in text.split()] if text else [0.0, 0.0, 0.0]


def _along(end: FloatArray, radius: float) -> tuple[FloatArray, FloatArray]:
    """Placement and half sizes of something along the line from zero to ``end``."""
    length = float(np.linalg.norm(end))
    if length < 1e-6:
        return np.eye(4), np.array([radius, radius, radius])
    z = end / length
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    R = np.column_stack([x, np.cross(z, x), z])
    half = max(radius, length / 2.0)
    return transform(R, end / 2.0), np.array([radius, radius, half])


def lump(rng: np.random.Generator, size: FloatArray, convex: bool) -> trimesh.Trimesh:
    """A closed surface with dents and bumps, or its hull, of these half sizes at most."""
    made = trimesh.creation.icosphere(1, 1.0)
    made.vertices *= rng.uniform(0.55, 1.0, (len(made.vertices), 1)) * size
    return made.convex_hull if convex else made


def urdf_of_preset(name: str) -> ET.Element:
    """The kinematics of a preset as a URDF."""
    robot = Robot.preset(name)
    chain, tree = robot.chain, ET.Element("robot", name=name)
    links = (*robot.link_names, "tip")
    for link in links:
        ET.SubElement(tree, "link", name=link)
    places = [*chain.placements, chain.T_link_tip]
    for k, T in enumerate(places):
        moved = k < robot.n
        joint = ET.SubElement(
            tree,
            "joint",
            name=robot.joint_names[k] if moved else "to_tip",
            type="revolute" if moved else "fixed",
        )
        xyz, rpy = (
            " ".join(f"{v:.17g}" for v in values)
            for values in (T[:3, 3], wpr_from_rotation(T[:3, :3]))
        )
        ET.SubElement(joint, "origin", xyz=xyz, rpy=rpy)
        ET.SubElement(joint, "parent", link=links[k])
        ET.SubElement(joint, "child", link=links[k + 1])
        if moved:
            ET.SubElement(joint, "axis", xyz=" ".join(f"{v:.17g}" for v in chain.axes[k]))
            ET.SubElement(
                joint,
                "limit",
                lower=f"{robot.lower[k]}",
                upper=f"{robot.upper[k]}",
                velocity=f"{robot.speed[k]}",
                effort="100",
            )
    return tree


def write_cell(arm: Arm, kind: str, *, pinned: bool, said: str, changed: Mapping[str, str]) -> Path:
    """What ``new`` said, with a tool, what stands around, and sometimes a pin."""
    rng, path = arm.rng, arm.folder / "cell.toml"
    raw = tomllib.loads(said)
    model = pin.buildModelFromUrdf(str(arm.folder / "arm.urdf"))
    data, q = model.createData(), pin.neutral(model)
    moved = [j for j in arm.joints if j.get("type") != "fixed"]
    for joint, value in zip(moved, raw["base_pose"]["posture_deg"], strict=True):
        q[model.joints[model.getJointId(joint.get("name"))].idx_q] = np.deg2rad(value)
    pin.framesForwardKinematics(model, data, q)
    T = data.oMf[model.getFrameId(raw["robot"].get("tip", arm.tip))].homogeneous
    px, _, pz = (float(v) for v in raw["tool"]["point_mm"])
    x, y, z = (float(v) for v in 1e3 * (T[:3, :3] @ np.array([px, 0, pz]) / 1e3 + T[:3, 3]))
    size = 3.0 * pz
    lump(rng, np.array([0.3 * pz, 0.3 * pz, 0.3 * pz]), False).export(arm.folder / "gun.stl")
    lump(rng, np.array([0.4, 0.3, 0.4]) * size, bool(rng.integers(2))).export(
        arm.folder / "block.stl"
    )
    gun = (
        'kind = "mesh"\nmesh = "gun.stl"'
        if rng.random() < 0.6
        else f"size_mm = [{0.5 * pz}, {0.4 * pz}, {0.6 * pz}]"
    )
    below = 0.5 if pinned else 20.0
    side = float(rng.choice([-1.0, 1.0]))
    text = said
    for section, line in (
        ("robot", "capsule_radius_mm = 35.0" if kind == "capsules" else ""),
        ("constraints", 'ignore = [["pin", "fixture"]]' if pinned else ""),
        ("plan", f"retreat_mm = {RETREAT_MM}\ncontact_mm = {CONTACT_MM}" if pinned else ""),
    ):
        text = re.sub(rf"^\[{section}\]$", f"[{section}]\n{line}", text, flags=re.MULTILINE)
    if kind == "capsules":
        text = re.sub(r"^shapes = .*$", "", text, flags=re.MULTILINE)
    values = {
        "candidates": "300",
        "safety_distance_mm": f"{SAFETY_MM}",
        "start_deg": "[15.0, 15.0, 15.0]",
        "step_deg": "[10.0, 10.0, 10.0]",
        "largest_deg": "[35.0, 35.0, 35.0]",
    }
    for key, value in {**values, **changed}.items():
        text = re.sub(rf"^{key} = [^#\n]*", f"{key} = {value} ", text, flags=re.MULTILINE)
    text = re.sub(r"^models = \[\n.*?^\]$", 'models = [["zero_offsets"]]', text, flags=re.M | re.S)
    text += f"""
[[tool.body]]
name = "gun"
{gun}
at_mm = [0.0, 0.0, {0.32 * pz}]
[[tool.body]]
name = "camera"
kind = "cylinder"
radius_mm = {0.15 * pz}
height_mm = {0.6 * pz}
at_mm = [{0.6 * pz}, {0.3 * pz}, {0.3 * pz}]
wpr_deg = [20.0, 10.0, 0.0]
[[obstacle]]
name = "floor"
kind = "half-space"
at_mm = [0.0, 0.0, {min(-5.0, z - 1.5 * pz)}]
[[obstacle]]
name = "fixture"
size_mm = [{0.6 * pz}, {0.6 * pz}, {pz}]
at_mm = [{x}, {y}, {z - below - 0.5 * pz}]
[[obstacle]]
name = "block"
kind = "mesh"
mesh = "block.stl"
at_mm = [{x + 0.1 * size}, {y + side * 0.75 * size}, {z - 0.1 * size}]
[[obstacle]]
name = "post"
kind = "cylinder"
radius_mm = {0.15 * size}
height_mm = {1.5 * size}
at_mm = [{x - 0.3 * size}, {y - side * 0.9 * size}, {z}]
"""
    if pinned:
        text += f"""
[[tool.body]]
name = "pin"
kind = "cylinder"
radius_mm = 2.0
height_mm = {0.6 * pz}
at_mm = [{px}, 0.0, {0.7 * pz - 1.0}]
"""
    path.write_text(text)
    return path


# --- The independent check


@dataclass(frozen=True)
class Piece:
    """A solid of fcl on a joint of Pinocchio's model."""

    name: str
    group: str
    number: int
    joint: int
    T: FloatArray
    thing: fcl.CollisionObject
    radius_m: float
    triangles: FloatArray | None

    @property
    def is_solid(self) -> bool:
        return self.triangles is None


def _meshed(mesh: trimesh.Trimesh) -> tuple[fcl.CollisionGeometry, float, FloatArray]:
    tree = fcl.BVHModel()
    tree.beginModel(len(mesh.vertices), len(mesh.faces))
    tree.addSubModel(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    tree.endModel()
    radius = float(np.linalg.norm(mesh.vertices, axis=1).max())
    return tree, radius, np.asarray(mesh.triangles)


def _box(x: float, y: float, z: float) -> tuple[fcl.CollisionGeometry, float, None]:
    return fcl.Box(x, y, z), float(np.linalg.norm([x, y, z])) / 2.0, None


def _cylinder(radius: float, length: float) -> tuple[fcl.CollisionGeometry, float, None]:
    return fcl.Cylinder(radius, length), float(np.hypot(radius, length / 2.0)), None


class Reference:
    """The arm, its tool and its surroundings as the files describe them."""

    def __init__(self, arm: Arm, cell_path: Path) -> None:
        self.folder = arm.folder
        self.model = pin.buildModelFromUrdf(str(arm.folder / "arm.urdf"))
        self.data = self.model.createData()
        raw = tomllib.loads(cell_path.read_text())
        self.raw = raw
        moved = [j.get("name") for j in arm.joints if j.get("type") != "fixed"]
        self.ids = [self.model.getJointId(name) for name in moved]
        self.at = [self.model.joints[k].idx_q for k in self.ids]
        self.n = len(self.ids)
        self.pieces: list[Piece] = []
        for link in ET.parse(arm.folder / "arm.urdf").getroot().findall("link"):  # noqa: S314
            if link.find("collision") is not None:
                self._read_link(link)
        if not self.pieces:
            self._take_estimates(cell_path)
        tip = self.model.frames[self.model.getFrameId(raw["robot"].get("tip", arm.tip))]
        self.tip = tip.placement.homogeneous
        self.point = self.tip[:3, :3] @ np.array(raw["tool"]["point_mm"]) / 1e3 + self.tip[:3, 3]
        for body in raw["tool"].get("body", []):
            self._read_body(body, "tool", self.n, self.ids[-1], self.tip)
        for body in raw.get("obstacle", []):
            self._read_body(body, "around", 0, 0, np.eye(4))
        self.base = np.deg2rad(raw["base_pose"]["posture_deg"])

    def _add(
        self,
        name: str,
        group: str,
        number: int,
        joint: int,
        T: FloatArray,
        shape: tuple[fcl.CollisionGeometry, float, FloatArray | None],
    ) -> None:
        thing = fcl.CollisionObject(shape[0])
        self.pieces.append(Piece(name, group, number, joint, T, thing, shape[1], shape[2]))

    def _read_link(self, link: ET.Element) -> None:
        frame = self.model.frames[self.model.getFrameId(str(link.get("name")))]
        joint = int(frame.parentJoint)
        number = self.ids.index(joint) + 1 if joint else 0
        for element in link.findall("collision"):
            origin = element.find("origin")
            T = frame.placement.homogeneous @ transform(
                pin.rpy.rpyToMatrix(*_numbers(origin, "rpy")), np.array(_numbers(origin, "xyz"))
            )
            made = element.find("geometry")[0]
            if made.tag == "mesh":
                mesh = trimesh.load(self.folder / made.get("filename"))
                mesh.vertices = mesh.vertices * _numbers(made, "scale")
                shape = _meshed(mesh)
            elif made.tag == "box":
                shape = _box(*_numbers(made, "size"))
            elif made.tag == "cylinder":
                shape = _cylinder(float(made.get("radius")), float(made.get("length")))
            else:
                radius = float(made.get("radius"))
                shape = fcl.Sphere(radius), radius, None
            self._add(f"{link.get('name')}/{element.get('name')}", "arm", number, joint, T, shape)

    def _take_estimates(self, cell_path: Path) -> None:
        """Capsules and boxes that the cell stands in with, of a URDF without any shape."""
        for body in Cell.load(cell_path).robot.bodies:
            solid = body.solid
            if isinstance(solid, Capsule):
                radius = solid.radius_m + solid.length_m / 2.0
                shape = fcl.Capsule(solid.radius_m, solid.length_m), radius, None
            else:
                assert isinstance(solid, OwnBox)
                shape = _box(*solid.size_m)
            joint = self.ids[body.link - 1] if body.link else 0
            self._add(body.name, "arm", body.link, joint, body.T_link_body, shape)

    def _read_body(
        self, body: dict, group: str, number: int, joint: int, T_joint: FloatArray
    ) -> None:
        place = np.array(body.get("at_mm", [0.0, 0.0, 0.0])) / 1e3
        R = rotation_from_wpr(np.deg2rad(body.get("wpr_deg", [0.0, 0.0, 0.0])))
        T = T_joint @ transform(R, place)
        kind = body.get("kind", "box")
        if kind == "mesh":
            mesh = trimesh.load(self.folder / body["mesh"])
            mesh.apply_scale(1e-3)
            shape = _meshed(mesh)
        elif kind == "box":
            shape = _box(*(v / 1e3 for v in body["size_mm"]))
        elif kind == "cylinder":
            shape = _cylinder(body["radius_mm"] / 1e3, body["height_mm"] / 1e3)
        else:
            shape, T = _box(20.0, 20.0, 2.0), T @ transform(np.eye(3), [0.0, 0.0, -1.0])
        self._add(body["name"], group, number, joint, T, shape)

    def pairs(self, named: frozenset[frozenset[str]]) -> list[tuple[int, int]]:
        """Pairs that the tool says it checks."""
        found = []
        for a, one in enumerate(self.pieces):
            for b, other in list(enumerate(self.pieces))[a + 1 :]:
                groups = {one.group, other.group}
                if frozenset((one.name, other.name)) in named:
                    continue
                apart = abs(one.number - other.number)
                if (
                    (groups == {"arm"} and apart >= 2)
                    or (groups == {"arm", "tool"} and apart >= 1)
                    or (groups == {"tool", "around"})
                    or (groups == {"arm", "around"} and max(one.number, other.number) >= 1)
                ):
                    found.append((a, b))
        return found

    def places(self, q: FloatArray) -> FloatArray:
        """Placements ``(S, B, 4, 4)`` of all pieces, and of the tool point, at postures."""
        found = np.empty((len(q), len(self.pieces) + 1, 4, 4))
        whole = pin.neutral(self.model)
        for s, posture in enumerate(q):
            whole[self.at] = posture
            pin.forwardKinematics(self.model, self.data, whole)
            T = {k: self.data.oMi[k].homogeneous for k in {p.joint for p in self.pieces}}
            for b, piece in enumerate(self.pieces):
                found[s, b] = T[piece.joint] @ piece.T
            found[s, -1] = T[self.ids[-1]] @ transform(np.eye(3), self.point)
        return found

    def contacts(
        self, places: FloatArray, pairs: Sequence[tuple[int, int]]
    ) -> list[tuple[int, int, int, float]]:
        """Sample, pair and depth [m] of all that touch."""
        found, rows = [], np.array(pairs)
        radii = np.array([piece.radius_m for piece in self.pieces])
        origins = places[:, :, :3, 3]
        gaps = np.linalg.norm(origins[:, rows[:, 0]] - origins[:, rows[:, 1]], axis=-1)
        near = gaps < radii[rows].sum(axis=1)
        request = fcl.CollisionRequest(num_max_contacts=50, enable_contact=True)
        for s, p in np.argwhere(near):
            a, b = rows[p]
            self._put(a, places[s, a])
            self._put(b, places[s, b])
            result = fcl.CollisionResult()
            one, other = self.pieces[a], self.pieces[b]
            if fcl.collide(one.thing, other.thing, request, result):
                depth = max(c.penetration_depth for c in result.contacts)
                if depth > ON_THE_SURFACE_M or not (one.is_solid and other.is_solid):
                    found.append((int(s), int(a), int(b), float(depth)))
            elif s in (0, len(places) - 1) and self._is_inside(a, b, places[s]):
                found.append((int(s), int(a), int(b), np.inf))
        return found

    def _put(self, piece: int, T: FloatArray) -> None:
        self.pieces[piece].thing.setTransform(fcl.Transform(T[:3, :3], T[:3, 3]))

    def _is_inside(self, a: int, b: int, T: FloatArray) -> bool:
        """A point of one lies within the triangles of the other: fcl sees surfaces of meshes."""
        for inner, outer in ((a, b), (b, a)):
            triangles = self.pieces[outer].triangles
            if triangles is None:
                continue
            of = self.pieces[inner].triangles
            point = np.zeros(3) if of is None else of[0, 0]
            p = (inverse(T[outer]) @ T[inner] @ np.append(point, 1.0))[:3]
            if np.linalg.norm(p) < self.pieces[outer].radius_m and _encloses(triangles, p):
                return True
        return False

    def distance_m(self, places: FloatArray, pair: tuple[int, int]) -> float:
        a, b = pair
        self._put(a, places[a])
        self._put(b, places[b])
        return float(fcl.distance(self.pieces[a].thing, self.pieces[b].thing))


def _encloses(triangles: FloatArray, point: FloatArray) -> bool:
    """A ray from the point crosses the triangles (K, 3, 3) an odd number of times."""
    ray = np.array([0.3412, 0.5123, 0.7881])
    e1, e2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    h, s = np.cross(ray, e2), point - triangles[:, 0]
    det = np.einsum("ij,ij->i", e1, h)
    ok = np.abs(det) > 1e-18
    det = np.where(ok, det, 1.0)
    u = np.einsum("ij,ij->i", s, h) / det
    c = np.cross(s, e1)
    v, t = c @ ray / det, np.einsum("ij,ij->i", e2, c) / det
    return bool((ok & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)).sum() % 2)


def judge(reference: Reference, listed: Path, tally: Counter[str]) -> list[str]:
    """Drive through a written list; what touches although it is called clear, in words."""
    lines = listed.read_text().splitlines()
    notes = [line for line in lines if line.startswith("# not checked:")]
    named = _named(notes, {piece.name for piece in reference.pieces})
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    rows = [row for row in rows if row["order"]]
    assert [int(row["order"]) for row in rows] == list(range(1, len(rows) + 1))
    columns = [f"j{k + 1}_deg" for k in range(reference.n)]
    q = np.deg2rad([[float(row[column]) for column in columns] for row in rows])
    via = [row["status"] == "via" for row in rows]
    path = np.vstack([reference.base, q])
    pairs = reference.pairs(named)
    tally["pairs checked"] += len(pairs)
    tally["pairs named as not checked"] += len(reference.pairs(frozenset())) - len(pairs)
    tally["poses"] += len(q) - sum(via)
    tally["passed postures"] += sum(via)
    tally["motions"] += len(q)
    target = reference.places(path[:1])[0, -1, :3, 3]
    meets = [frozenset(pair) for pair in reference.raw["constraints"].get("ignore", [])]
    keep_mm = reference.raw["constraints"]["safety_distance_mm"]
    found = []
    part = np.linspace(0.0, 1.0, SAMPLES_A_MOTION)[:, None]
    for k, (start, end) in enumerate(pairwise(path)):
        places = reference.places(start + part * (end - start))
        off_mm = 1e3 * np.linalg.norm(places[:, -1, :3, 3] - target, axis=1)
        for s, a, b, depth in reference.contacts(places, pairs):
            names = reference.pieces[a].name, reference.pieces[b].name
            if frozenset(names) in meets and off_mm[s] <= CONTACT_MM + 0.1:
                tally["samples of a pin at its target"] += 1
                continue
            found.append(
                f"{listed}: to {rows[k]['name']} sample {s}: {names} {1e3 * depth:.3f} mm deep"
            )
    for k, places in enumerate(reference.places(q)):
        for a, b in pairs:
            one, other = reference.pieces[a], reference.pieces[b]
            asked = not via[k] and "around" in (one.group, other.group)
            if asked and frozenset((one.name, other.name)) not in meets:
                gap = 1e3 * reference.distance_m(places, (a, b))
                if gap < keep_mm - 0.01:
                    found.append(f"{listed}: {rows[k]['name']}: {one.name} {other.name} {gap} mm")
    return found


def _named(notes: Sequence[str], names: set[str]) -> frozenset[frozenset[str]]:
    """Pairs that a list names as not checked for good: those of ``ignore`` are judged apart."""
    name = "|".join(re.escape(name) for name in sorted(names, key=len, reverse=True))
    found = set()
    for note in notes:
        if "at the poses and right before" not in note:
            pairs = re.findall(rf"({name}) against ({name})", note)
            assert len(pairs) == note.count(" against "), note
            found |= {frozenset(pair) for pair in pairs}
    return frozenset(found)


def trial(
    folder: Path,
    tree: ET.Element,
    kind: str,
    seed: int,
    capsys: pytest.CaptureFixture[str],
    plans: Sequence[tuple[str, ...]] = PLANS,
    *,
    pinned: bool = False,
    changed: Mapping[str, str] = MappingProxyType({}),
) -> tuple[Counter[str], list[str]]:
    """Make an arm and its cell, plan, and judge what was written."""
    arm = Arm(folder, tree, np.random.default_rng(seed))
    if kind not in ("capsules", "shapes"):
        arm.clothe(kind)
    arm.write()
    capsys.readouterr()
    assert run(["new", "--robot", str(folder / "arm.urdf")]) == 0
    cell = write_cell(arm, kind, pinned=pinned, said=capsys.readouterr().out, changed=changed)
    tally: Counter[str] = Counter(arms=1)
    wrong: list[str] = []
    for method in plans:
        out = folder / method[0]
        words = ["plan", str(cell), "--out", str(out), "--method", *method]
        with empty_pictures():
            code = run(words)
        said = capsys.readouterr()
        listed = out / "poses.csv"
        tally[f"exit {code}"] += 1
        if listed.exists():
            tally["lists"] += 1
            wrong += judge(Reference(arm, cell), listed, tally)
        else:
            last = said.err.strip().splitlines()
            assert code == 2, said
            tally["refused by name"] += 1
            tally["refused: " + " | ".join(last[-2:])] += 1
    return tally, wrong


def _tree_of(name: str) -> ET.Element:
    """Of a preset, or of a file of the real data."""
    if not name.endswith(".urdf"):
        return urdf_of_preset(name)
    path = data_folder() / "urdf" / name
    if not path.exists():
        pytest.skip(f"no {path}: set POSEDESIGN_DATA")
    return ET.parse(path).getroot()  # noqa: S314 - our own


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kind", "seed", "pinned", "method"),
    [("ur5e", "meshes", 3, False, PLANS[1]), ("lrmate200id", "both", 4, True, PLANS[0])],
)
def test_no_contact_in_a_written_list(name, kind, seed, pinned, method, tmp_path, capsys):
    tally, wrong = trial(
        tmp_path, urdf_of_preset(name), kind, seed, capsys, [method], pinned=pinned
    )
    assert not wrong, wrong[:5]
    assert tally["lists"] == 1, tally
    assert tally["poses"] >= 15
    assert bool(tally["samples of a pin at its target"]) == pinned


@pytest.mark.slow
@pytest.mark.full
@pytest.mark.parametrize("changed", [{}, WILD], ids=["usual", "wild"])
@pytest.mark.parametrize(("k", "name"), list(enumerate(ARMS)), ids=ARMS)
def test_no_contact_in_lists_of_many_arms(k, name, changed, tmp_path, capsys):
    """Half of them with a pin."""
    tree, kind = _tree_of(name), KINDS[k % len(KINDS)]
    if kind == "shapes" and not name.endswith(".urdf"):
        kind = "capsules"
    tally, wrong = trial(tmp_path, tree, kind, k, capsys, pinned=k // 3 % 2 == 1, changed=changed)
    assert not wrong, wrong[:5]
    assert tally["lists"] + tally["refused by name"] == 2


def test_the_check_sees_contacts(tmp_path, capsys):
    """The same cell planned without collisions."""
    unseen = {"collisions": "false"}
    tree = urdf_of_preset("ur5e")
    few = ("exchange", "--poses", "5", "--no-refine")
    _, wrong = trial(tmp_path, tree, "meshes", 2, capsys, [few], changed=unseen)
    assert any("deep" in found for found in wrong)
