"""Collision geometry of a URDF: primitives and the meshes that it names.

Visual geometry is never read. A mesh that is missing or cannot be read leaves its link without
that body, which is said; a size that makes no sense is an error.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote

from calib.errors import CalibError, RobotModelError, model_error
from calib.robots.description.packages import Packages, is_inside
from calib.robots.description.urdf_kinematics import (
    FARTHEST_M,
    LARGEST_LENGTH_M,
    numbers,
    printable,
    shown,
)
from calib.robots.shapes import Box, Capsule, Cylinder, LinkShape, Mesh, Solid, Sphere
from calib.se3 import FloatArray, rotation_from_wpr, transform

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

MOST_BODIES = 1000
"""Arms have ten, hands and cells some two hundred."""

_LARGEST_SCALE = 1e4
"""Of a mesh; 0.001 (mm) and 0.0254 (inch) are the usual ones."""

_SHOWN = 3
"""File names told in a notice."""

_LONGEST_NAME = 200


class _NoMesh(Exception):
    """A mesh that cannot be had: what is the matter with it, and its name."""


def read_collision_shapes(
    root: Element, path: Path, folders: Sequence[Path], packages: Packages | None = None
) -> tuple[tuple[LinkShape, ...], tuple[str, ...], list[str]]:
    """Read the ``<collision>`` elements of a URDF, in which file names are relative to its path.

    Meshes may lie in the folders, and in the packages that it names: those around it by default
    (see :mod:`calib.robots.description.packages`).

    Returns shapes, named after their links (``link/collision`` where a link has several, or names
    them), links that have lost one, and notices: a line for each kind of reason.

    Raises RobotModelError: a size or a pose is not of this world; the link is named.
    """
    found = [(link, c) for link in root.iterfind("link") for c in link.iterfind("collision")]
    if len(found) > MOST_BODIES:
        raise model_error(
            path,
            f"has {len(found)} collision bodies, more than {MOST_BODIES}",
            "simplify the collision geometry",
            value=len(found),
            bound=MOST_BODIES,
        )
    meshes = _Meshes(path, folders, packages or Packages(path))
    shapes: list[LinkShape] = []
    missing: dict[str, list[tuple[str, str]]] = {}
    taken: set[str] = set()
    for link, collision in found:
        name = link.get("name", "")
        reader = _Reader(name, path, meshes)
        T_link_shape = reader.pose(collision.find("origin"))
        try:
            solid = reader.solid(collision.find("geometry"))
        except _NoMesh as error:
            reason, what = error.args
            missing.setdefault(reason, []).append((name, what))
            continue
        body = _body_name(name, collision, len(link.findall("collision")), taken)
        shapes.append(LinkShape(name, body, T_link_shape, solid))
    lost = dict.fromkeys(link for of in missing.values() for link, _ in of)
    return tuple(shapes), tuple(lost), [_told(reason, of) for reason, of in missing.items()]


def _body_name(link: str, collision: Element, count: int, taken: set[str]) -> str:
    """A name that no other body has."""
    own = collision.get("name", "")
    stem = f"{link}/{own}" if own not in ("", link) else link
    name = stem if count == 1 or stem != link else f"{link}/1"
    number = 1
    while name in taken:
        number += 1
        name = f"{stem}/{number}"
    taken.add(name)
    return name


def _told(reason: str, of: list[tuple[str, str]]) -> str:
    links = ", ".join(dict.fromkeys(link for link, _ in of))
    names = list(dict.fromkeys(printable(what)[:_LONGEST_NAME] for _, what in of))
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return f"no collision geometry for {links}: {reason}: {', '.join(names[:_SHOWN])}{more}"


class _Reader:
    """Reads the geometry of one link."""

    def __init__(self, link: str, path: Path, meshes: _Meshes) -> None:
        self._link, self._path, self._meshes = link, path, meshes

    def pose(self, origin: Element | None) -> FloatArray:
        """Pose of the shape in the frame of its link, ``(4, 4)``."""
        xyz, rpy = (
            [0.0, 0.0, 0.0] if origin is None else self._numbers(origin, key, 3, "0 0 0")
            for key in ("xyz", "rpy")
        )
        if max(map(abs, xyz)) > FARTHEST_M:
            raise self._fail(f"origin xyz beyond {FARTHEST_M:g} m")
        return transform(rotation_from_wpr(rpy), xyz)  # roll, pitch, yaw are W, P, R

    def solid(self, geometry: Element | None) -> Solid:
        """The solid of a <geometry> element; :class:`_NoMesh` where it is none that can be had."""
        element = None if geometry is None else next(iter(geometry), None)
        readers: dict[str, Callable[[Element], Solid]] = {
            "box": self._box,
            "cylinder": lambda e: Cylinder(self._size(e, "radius"), self._size(e, "length")),
            "capsule": lambda e: Capsule(self._size(e, "radius"), self._size(e, "length")),
            "sphere": lambda e: Sphere(self._size(e, "radius")),
            "mesh": self._mesh,
        }
        if element is None:
            raise _NoMesh("no shape in it", "<geometry>")
        if element.tag not in readers:
            raise _NoMesh("not a shape known here", f"<{element.tag}>")
        return readers[element.tag](element)

    def _box(self, element: Element) -> Box:
        x, y, z = self._numbers(element, "size", 3)
        if not all(0.0 < v <= LARGEST_LENGTH_M for v in (x, y, z)):
            raise self._fail(f"<box size={shown(element.get('size'))}>")
        return Box((x, y, z))

    def _mesh(self, element: Element) -> Mesh:
        scale = self._numbers(element, "scale", 3, "1 1 1")
        if not all(0.0 < abs(v) <= _LARGEST_SCALE for v in scale):
            raise self._fail(f"<mesh scale={shown(element.get('scale'))}>")
        return self._meshes.get(element.get("filename", ""), (scale[0], scale[1], scale[2]))

    def _size(self, element: Element, key: str) -> float:
        value = self._numbers(element, key, 1)[0]
        if not 0.0 < value <= LARGEST_LENGTH_M:
            raise self._fail(f"<{element.tag} {key}={shown(element.get(key))}>")
        return value

    def _numbers(
        self, element: Element, key: str, count: int, default: str | None = None
    ) -> list[float]:
        text = element.get(key, default)
        values = numbers(text or "")
        if len(values) != count:
            raise self._fail(f"<{element.tag} {key}={shown(text)}>")
        return values

    def _fail(self, what: str) -> RobotModelError:
        return model_error(
            self._path,
            f"link {shown(self._link)} has collision geometry of {what}",
            "sizes are in metres and above zero; correct it, or leave <collision> out",
            self._link,
        )


class _Meshes:
    """The meshes that a description names, each read once."""

    def __init__(self, path: Path, folders: Sequence[Path], packages: Packages) -> None:
        self._path, self._folders, self._packages = path, list(folders), packages
        self._read: dict[tuple[Path, tuple[float, float, float]], Mesh] = {}

    def get(self, name: str, scale: tuple[float, float, float]) -> Mesh:
        """Read a mesh by the name that the description gives it.

        :class:`_NoMesh`: there is no such file, it may not be read, or it is no mesh.
        """
        file, folders = self._locate(name)
        if not is_inside(file, folders):
            raise _NoMesh("mesh outside of its package", name)
        file = file.resolve()
        if not os.path.isfile(file):
            raise _NoMesh("mesh not found", name)
        if (file, scale) not in self._read:
            from calib.robots.description.mesh_file import (
                read_mesh,  # most descriptions name no mesh
            )

            try:
                self._read[file, scale] = read_mesh(file, scale)
            except (CalibError, OSError) as error:
                why = getattr(error, "message", str(error)).removeprefix(f"{file}: ")
                raise _NoMesh("mesh cannot be read", f"{name} ({why})") from error
        return self._read[file, scale]

    def _locate(self, name: str) -> tuple[Path, list[Path]]:
        """The file that a name means, and the folders that it may lie in."""
        scheme, separator, rest = name.partition("://")
        if not separator:
            return self._path.resolve().parent / name, self._folders
        if scheme in ("package", "model"):
            package, _, inner = rest.partition("/")
            folder = self._packages.find(package) or self._packages.find_above(package)
            if folder is None:
                reason = "mesh not found, package not among the folders above or to search"
                raise _NoMesh(reason, name)
            return folder / inner.lstrip("/"), [folder]
        if scheme == "file":
            host, slash, inner = rest.partition("/")
            if host in ("", "localhost"):
                return Path(slash + unquote(inner)), [*self._folders, *self._packages.search]
        raise _NoMesh("mesh not a file", name)
