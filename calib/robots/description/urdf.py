"""Reading a URDF that may come from anywhere: checked before Pinocchio sees it.

Pinocchio's own reader prints to the terminal from C++ and names no joint when something is
missing. The file is therefore read here first with XML entities and external references refused,
its structure is checked joint by joint, and Pinocchio is handed the kinematics and masses alone,
written anew: transmissions, plug-ins, soft limits, visuals and whatever else stands in such files
never reach it. Files with xacro macros are expanded first.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple
from xml.etree.ElementTree import ParseError, tostring

import defusedxml
import pinocchio as pin
from defusedxml.ElementTree import fromstring

from calib.errors import RobotModelError, model_error
from calib.limited import read_bounded, run_limited
from calib.robots.description.packages import Packages, folders_to_search
from calib.robots.description.urdf_geometry import read_collision_shapes
from calib.robots.description.urdf_kinematics import (
    Kinematics,
    printable,
    read_kinematics,
    shown,
    without_quaternions,
)
from calib.robots.model_chain import RobotDescription

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

LARGEST_URDF_BYTES = 20_000_000
"""Kinematics of the largest cells are well below a megabyte; more is not a robot description."""


@dataclass(frozen=True, eq=False)
class Description:
    """A URDF as text and as a tree, nothing in it checked but that it is one."""

    text: bytes  # as it stands in the file; of a xacro, what it expands to
    root: Element
    """The outermost element, name spaces of its elements removed, rotations in roll, pitch, yaw."""
    folders: tuple[Path, ...]  # where the files lie that it may name
    packages: Packages  # those that it may name
    notices: tuple[str, ...]


def load_urdf(
    path: Path, packages: Iterable[Path] = (), xacro_args: Iterable[str] = ()
) -> RobotDescription:
    """Read a URDF file, or a xacro file that expands to one; see :func:`read_description`.

    Raises
    ------
    RobotModelError
        The file is missing, is no URDF, or something in it cannot be used.
    """
    file = read_description(path, packages, xacro_args)
    kinematics = read_kinematics(file.root, path)
    shapes, lost, missing = read_collision_shapes(file.root, path, file.folders, file.packages)
    return RobotDescription(
        model=_build(kinematics, path),
        shapes=shapes,
        lost_shapes=lost,
        notices=(*file.notices, *missing),
        joint_notices=kinematics.notices,
        flaws=kinematics.flaws,
        led=kinematics.led,
        packages=_package_names(file),
    )


def _package_names(file: Description) -> tuple[str, ...]:
    """Return names of the package of a description, and of the folders that its meshes lie in."""
    meshes = (mesh.get("filename", "") for mesh in file.root.iter("mesh"))
    folders = (f for name in meshes for f in name.split("/")[:-1] if f and not f.endswith(":"))
    return tuple(dict.fromkeys(map(printable, (file.packages.tree.name, *folders))))


class JointLinks(NamedTuple):
    """The links that a joint connects, and whether it can move."""

    parent: str
    child: str
    moves: bool


def joint_links(
    path: Path, packages: Iterable[Path] = (), xacro_args: Iterable[str] = ()
) -> dict[str, JointLinks]:
    """Return the joints of a URDF file, or of a xacro file, by name; see :func:`load_urdf`."""
    root = read_kinematics(read_description(path, packages, xacro_args).root, path).root
    found = {}
    for joint in root.iterfind("joint"):
        parent, child = (joint.find(end) for end in ("parent", "child"))
        if parent is not None and child is not None:  # as has been checked
            moves = joint.get("type") != "fixed"
            links = JointLinks(parent.get("link", ""), child.get("link", ""), moves)
            found[joint.get("name", "")] = links
    return found


_WHAT_TO_GIVE = "give the path of a URDF file, or the name of a preset (posedesign robots)"


def read_description(
    path: Path,
    packages: Iterable[Path] = (),
    xacro_args: Iterable[str] = (),
    hint: str = _WHAT_TO_GIVE,
) -> Description:
    """Read a URDF file, or a xacro file that expands to one, without looking at what it says.

    Parameters
    ----------
    packages : iterable of Path
        Folders to search for the packages that it names, before those of the environment (see
        :mod:`calib.robots.description.packages`).
    xacro_args : iterable of str
        Arguments of a xacro file, each ``NAME:=VALUE``; those not given have their defaults.
    hint : str
        What to give in place of a file that is not there.

    Raises
    ------
    RobotModelError
        The file is missing, too large, no well-formed XML, or no URDF; there is no such folder, or
        there are arguments for a file that is no xacro.
    """
    search, arguments = _folders(path, packages), _arguments(path, xacro_args)
    text = _read(path, hint)
    known = Packages(path, search)
    root = _parse(text, path)
    notices: tuple[str, ...] = ()
    folders = [known.tree]
    if path.suffix == ".xacro" or any("xacro" in str(element.tag) for element in root.iter()):
        expanded = expand_xacro(path, LARGEST_URDF_BYTES, search, arguments)
        text = expanded.text.encode()
        root = _parse(text, path)
        folders += expanded.folders
        given = [f"{name}:={value}" for name, value in arguments.items()]
        default = f"every {'other ' if given else ''}argument at its default"
        notices = (", ".join(["expanded from xacro", *given, default]),)
    elif arguments:
        raise model_error(
            path, "is no xacro file, and has no arguments", "leave them out", next(iter(arguments))
        )
    if root.tag != "robot":
        raise model_error(
            path,
            f"the outermost element is <{root.tag}>, not <robot>",
            "is it an SDF or a MuJoCo model? convert it to a URDF first",
        )
    without_quaternions(root, path)
    return Description(text, root, tuple(folders), known, notices)


def _arguments(path: Path, words: Iterable[str]) -> dict[str, str]:
    """Arguments by their names."""
    given: dict[str, str] = {}
    for word in words:
        name, separator, value = word.partition(":=")
        if not (name and separator) or name in given:
            why = "is given twice" if name in given else "is not NAME:=VALUE"
            raise model_error(
                path,
                f"the xacro argument {shown(word)} {why}",
                'write each as xacro takes it: "prefix:=left_"',
                name,
            )
        given[name] = value
    return given


def _folders(path: Path, packages: Iterable[Path]) -> tuple[Path, ...]:
    given = tuple(packages)
    for folder in given:
        if not folder.is_dir():
            raise model_error(
                path,
                f"{folder}, where packages are to be searched, is no folder",
                "give the folder that the packages lie in, such as the src of a workspace",
                str(folder),
            )
    return folders_to_search(given)


def _read(path: Path, hint: str) -> bytes:
    try:
        text = read_bounded(path, LARGEST_URDF_BYTES)
    except (OSError, ValueError) as error:  # ValueError: a path with a zero byte
        raise model_error(
            path, f"cannot be read: {getattr(error, 'strerror', error)}", hint
        ) from error
    if len(text) > LARGEST_URDF_BYTES:
        raise model_error(
            path,
            f"more than {LARGEST_URDF_BYTES} bytes is too large for a description",
            "give the kinematics only",
        )
    return text


def _parse(text: bytes, path: Path) -> Element:
    try:
        root: Element = fromstring(text, forbid_dtd=True)
    except defusedxml.DefusedXmlException as error:
        raise model_error(
            path,
            "document types and entities are not accepted in a description",
            "remove the <!DOCTYPE> part",
        ) from error
    except (ParseError, LookupError, ValueError) as error:  # the last two: unknown encodings
        raise model_error(path, f"is not well-formed XML: {error}", "mend the file") from error
    if root.tag.endswith("}robot"):  # a name space for all elements, as some tools write it
        space = root.tag.removesuffix("robot")
        for element in root.iter():
            element.tag = element.tag.removeprefix(space)
    return root


def _build(kinematics: Kinematics, path: Path) -> pin.Model:
    try:
        return pin.buildModelFromXML(tostring(kinematics.root, encoding="unicode"))
    except (ValueError, RuntimeError) as error:
        raise model_error(
            path,
            f"Pinocchio cannot build a model of it: {str(error).splitlines()[0]}",
            "check the file with check_urdf",
        ) from error


MEMORY_BYTES = 2_000_000_000
"""A large cell takes a tenth of it, Python itself included."""

SECONDS = 20.0
"""A large cell is expanded in about one second; a macro that doubles itself never ends."""


@dataclass(frozen=True)
class Expanded:
    """What became of a xacro file: the URDF, and the packages whose files it may name."""

    text: str
    folders: tuple[Path, ...]


def expand_xacro(
    path: Path,
    most_bytes: int,
    search: Sequence[Path] = (),
    arguments: Mapping[str, str] = MappingProxyType({}),
) -> Expanded:
    """Expand a xacro file in a process of its own (:mod:`calib.robots.description.xacro_process`).

    ``$(find package)`` follows the rule of :mod:`calib.robots.description.packages`.

    Raises
    ------
    RobotModelError
        The xacro package is not installed, or the file cannot be expanded, or not within bounds.
    """
    if find_spec("xacro") is None:
        raise model_error(
            path,
            "contains xacro macros, and the package xacro is not installed",
            'pip install "posedesign[xacro]", or expand it first: xacro file.xacro > file.urdf',
        )
    job = {
        "file": str(path.resolve()),
        "search": [str(folder) for folder in search],
        "arguments": dict(arguments),
        "most_bytes": most_bytes,
    }
    try:
        outcome = json.loads(
            run_limited(
                "calib.robots.description.xacro_process",
                json.dumps(job).encode(),
                memory_bytes=MEMORY_BYTES,
                seconds=SECONDS,
            )
        )
    except TimeoutError as error:
        raise _failed(path, str(error)) from error
    except (OSError, ValueError) as error:
        raise _failed(path, "the process that expands it broke off") from error
    if "error" in outcome:
        raise _failed(path, outcome["error"])
    return Expanded(outcome["urdf"], tuple(Path(f) for f in outcome["folders"]))


def _failed(path: Path, why: str) -> RobotModelError:
    return model_error(
        path,
        f"xacro cannot be expanded: {why}",
        "correct it, or expand it yourself, where you trust it: xacro file.xacro > file.urdf",
    )
