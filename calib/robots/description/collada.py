"""COLLADA (.dae) files from anywhere, cut down to their shapes before a reader sees them.

Materials, images, lights, cameras, animations and the description of the author are what refers to
other files and what readers stumble over. None of it is a shape.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree.ElementTree import ParseError, tostring

import defusedxml
from defusedxml.ElementTree import fromstring

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_LIBRARIES = ("library_geometries", "library_nodes", "library_visual_scenes", "scene")
_LOOKS = ("bind_material", "instance_camera", "instance_light", "instance_controller", "extra")

_INSTANCE_COST = 1000
"""Characters that one more use of a shape or node is counted as: it takes memory, too."""


@dataclass(frozen=True)
class Shapes:
    """The shapes of a COLLADA file.

    Attributes
    ----------
    text : bytes
        A COLLADA file with nothing else in it.
    unit_m : float
        How long its unit of length is.
    """

    text: bytes
    unit_m: float


def read_shapes(data: bytes, largest: int) -> Shapes:
    """Cut a COLLADA file down to its shapes.

    Parameters
    ----------
    data : bytes
    largest : int
        How many characters of numbers the shapes may have, counted once for each use of them.

    Raises
    ------
    ValueError
        It is no COLLADA file, refers to other files, or shapes use each other without end.
    """
    try:
        root = fromstring(data, forbid_dtd=True)
    except defusedxml.DefusedXmlException as error:
        raise ValueError("it defines or fetches XML entities") from error
    except ParseError as error:
        raise ValueError(f"it is no XML ({error})") from error
    if _name(root) != "COLLADA":
        raise ValueError("it is no COLLADA")
    unit_m = _unit(root)
    for library in list(root):
        if _name(library) not in _LIBRARIES:
            root.remove(library)
    _drop_looks(root)
    for element in root.iter():
        for key in ("url", "source"):
            if not element.get(key, "#").startswith("#"):
                raise ValueError(f"a <{_name(element)}> refers to another file")
    size = _Sizes(root).of_all()
    if size > largest:
        raise ValueError(f"its shapes, with all uses of them, have {size:.3g} characters")
    return Shapes(tostring(root, encoding="utf-8"), unit_m)


def _name(element: Element) -> str:
    """Tag without its namespace."""
    return str(element.tag).rsplit("}", 1)[-1]


def _unit(root: Element) -> float:
    for asset in root:
        if _name(asset) == "asset":
            for element in asset:
                if _name(element) == "unit":
                    unit_m = float(element.get("meter", "1"))
                    if not (math.isfinite(unit_m) and unit_m > 0.0):
                        raise ValueError(f"its unit is {unit_m} m")
                    return unit_m
    return 1.0


def _drop_looks(root: Element) -> None:
    for parent in list(root.iter()):
        for child in list(parent):
            if _name(child) in _LOOKS:
                parent.remove(child)


class _Sizes:
    """How many characters of numbers elements stand for, with all that they use."""

    def __init__(self, root: Element) -> None:
        self._root = root
        self._by_id = {e.get("id"): e for e in root.iter() if e.get("id") is not None}
        self._known: dict[Element, int] = {}
        self._open: set[Element] = set()

    def of_all(self) -> int:
        """Size of all scenes, each geometry counted at least once."""
        totals: dict[str, int] = defaultdict(int)
        for library in self._root:
            for child in library:
                totals[_name(library)] += self._of(child)
        return max(totals.values(), default=0)

    def _of(self, element: Element) -> int:
        if _name(element) == "geometry":
            return _INSTANCE_COST + sum(len(e.text or "") for e in element.iter())
        if element in self._known:
            return self._known[element]
        if element in self._open:
            raise ValueError("its nodes use each other in a circle")
        self._open.add(element)
        size = _INSTANCE_COST + sum(self._of(child) for child in element)
        if _name(element) in ("instance_node", "instance_geometry", "instance_visual_scene"):
            used = self._by_id.get(element.get("url", "#")[1:])
            if used is not None:
                size += self._of(used)
        self._open.discard(element)
        self._known[element] = size
        return size
