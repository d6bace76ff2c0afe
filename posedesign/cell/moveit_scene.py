"""The objects of a MoveIt scene: what RViz exports as ``.scene``, in either of its two formats.

Words and numbers in a row (moveit_core, ``PlanningScene::saveGeometryToStream``): the name of the
scene on a line; of each object ``*``, its name on the same line, in the newer format its place and
quaternion (x, y, z, w), then the number of its shapes; of each shape its kind, its sizes [m], its
place and quaternion, and a colour; in the newer format the number of subframes, and of each its
name and pose; a dot at the end. In the newer format shapes are placed in the frame of the object.
Kinds that are no solid here (cones, planes, whose solid side is not said, octrees) are refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError, near_names
from calib.geometry import Box, Cylinder, Solid, Sphere
from calib.robots.description.mesh_file import LARGEST_COORDINATE_M, LARGEST_TRIANGLES, checked_mesh
from calib.se3 import FloatArray, rotation_from_quaternion, transform
from posedesign.files import read_bytes_bounded

LARGEST_SCENE_BYTES = 10_000_000
"""Meshes for collisions have some thousand triangles; as text, some hundred kilobytes."""

MOST_SHAPES = 1000
"""Each of them is compared with each link of the arm."""

_SIZES = {"box": 3, "sphere": 1, "cylinder": 2}
_OTHERS = ("mesh", "cone", "plane", "octree")


def read_scene(path: Path) -> list[tuple[str, FloatArray, Solid]]:
    """Solids of a scene: name, pose ``(4, 4)`` in the frame of the scene [m], and shape.

    An object of several shapes has them numbered: ``table/1``, ``table/2``.

    Raises
    ------
    FileFormatError
        The file cannot be read, or something in it is not understood.
    """
    try:
        text = read_bytes_bounded(path, most_bytes=LARGEST_SCENE_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError("is not UTF-8 text", path=path, hint="export it again") from error
    words = _Words(text, path)
    found: list[tuple[str, FloatArray, Solid]] = []
    names: set[str] = set()
    while (marker := words.word("an object or the end")) != ".":
        if marker != "*":
            raise words.fail(f"has {marker[:40]!r} where an object (*) or the end (.) should be")
        name = words.rest_of_line()
        if not name or not name.isprintable() or name in names:
            raise words.fail(f"has an object named {name[:40]!r}: no name, or one that is taken")
        names.add(name)
        T_scene_object = words.pose() if words.is_newer else np.eye(4)
        count = words.count("shapes", MOST_SHAPES - len(found))
        for k in range(1, count + 1):
            solid = _shape(words, name)
            label = name if count == 1 else f"{name}/{k}"
            found.append((label, T_scene_object @ words.pose(), solid))
            words.numbers(4, "a colour")
        for _ in range(words.count("subframes", MOST_SHAPES) if words.is_newer else 0):
            words.word("the name of a subframe")
            words.pose()
    if not found:
        raise words.fail("has no objects")
    return found


def _shape(words: _Words, name: str) -> Solid:
    kind = words.word("a shape")
    if kind == "mesh":
        vertices = words.count("vertices", LARGEST_TRIANGLES)
        triangles = words.count("triangles", LARGEST_TRIANGLES)
        corners = words.numbers(3 * vertices, "vertices").reshape(-1, 3)
        rows = words.numbers(3 * triangles, "triangles").reshape(-1, 3)
        if (rows != np.round(rows)).any() or (np.abs(rows) > LARGEST_TRIANGLES).any():
            raise words.fail(f"has triangles of {name!r} that are no whole numbers")
        return checked_mesh(corners, rows.astype(np.intp), words.path)
    if kind not in _SIZES:
        what = "no solid" if kind in _OTHERS else "not known"
        hint = (
            "make it a box, a cylinder, a sphere or a mesh"
            if kind in _OTHERS
            else near_names(kind, (*_SIZES, *_OTHERS))
        )
        raise words.fail(f"has {kind[:40]!r} as a shape of {name!r}, which is {what}", hint)
    sizes = words.numbers(_SIZES[kind], "sizes").tolist()
    if not 0.0 < min(sizes) <= max(sizes) <= LARGEST_COORDINATE_M:
        raise words.fail(f"has a {kind} of {name!r} with sizes {sizes} m")
    if kind == "box":
        return Box((sizes[0], sizes[1], sizes[2]))
    return Sphere(*sizes) if kind == "sphere" else Cylinder(*sizes)


class _Words:
    """The words of a scene, one after another, and what is wrong with them by their line."""

    def __init__(self, text: str, path: Path) -> None:
        self.path = path
        self._lines = text.splitlines()
        self._line = 0  # the name of the scene stands on the first
        self._left: list[str] = []
        starts = (k for k, line in enumerate(self._lines) if k and line.startswith("*"))
        first = next(starts, len(self._lines)) + 1
        # a place has spaces in it, a number of shapes has none: as MoveIt tells them apart
        self.is_newer = first < len(self._lines) and " " in self._lines[first].strip()

    def word(self, what: str) -> str:
        """The next word."""
        while not self._left:
            self._line += 1
            if self._line >= len(self._lines):
                raise self.fail(f"ends where {what} should be")
            self._left = self._lines[self._line].split()[::-1]
        return self._left.pop()

    def rest_of_line(self) -> str:
        """What else stands on the line, as a name."""
        rest, self._left = " ".join(self._left[::-1]), []
        return rest

    def numbers(self, count: int, what: str) -> FloatArray:
        """The next finite numbers, ``(count,)``."""
        try:
            values = np.array([float(word) for word in self._some(count, what)])
        except ValueError as error:
            raise self.fail(f"has no number where {what} should be") from error
        if not np.isfinite(values).all():
            raise self.fail(f"has {what} that are not finite")
        return values

    def count(self, what: str, most: int) -> int:
        """The next word as a number of things."""
        word = self.word(f"a number of {what}")
        if not (word.isascii() and word.isdigit()) or len(word) > 9 or int(word) > most:
            raise self.fail(f"has {word[:40]!r} as its number of {what} (at most {most})")
        return int(word)

    def pose(self) -> FloatArray:
        """The next place and quaternion, as a transform ``(4, 4)``."""
        place, (x, y, z, w) = self.numbers(3, "a place"), self.numbers(4, "a quaternion")
        if abs(x * x + y * y + z * z + w * w - 1.0) > 0.01:
            raise self.fail("has a quaternion that is not of length 1")
        if np.abs(place).max() > LARGEST_COORDINATE_M:
            raise self.fail(f"places something beyond {LARGEST_COORDINATE_M:g} m")
        return transform(rotation_from_quaternion([w, x, y, z]), place)

    def fail(self, what: str, hint: str = "export it again from MoveIt") -> FileFormatError:
        """An error that names the line."""
        line = min(self._line, len(self._lines) - 1) + 1
        return FileFormatError(f"{what} (line {line})", path=self.path, hint=hint)

    def _some(self, count: int, what: str) -> Iterator[str]:
        for _ in range(count):
            yield self.word(what)
