"""Which files a robot description may name: those of its own package and of packages beside it.

Descriptions come from anywhere and name other files: meshes, included xacros, tables. Environment
variables and installed ROS workspaces are not asked. The rule:

* The *tree* of a description is the nearest folder above it with a ``package.xml``; without one,
  its own folder, or the folder above where its own is called ``urdf``, ``robots`` or the like.
* The *package* NAME is the nearest folder of that name among the folders above the description and
  the folders in these. It must hold a ``package.xml``, lie in the tree, or be a folder above the
  description that is not at the top of the file system.
* A file is read only where it lies in the tree or in a package named, once every link and ``..``
  is resolved.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path

_SUBFOLDERS = frozenset(
    {"description", "model", "models", "robot", "robots", "urdf", "urdfs", "xacro"}
)
_PACKAGE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.\- ]*")


def description_tree(path: Path) -> Path:
    """The folder whose files a description may read without naming a package."""
    file = path.resolve()
    for folder in file.parents:
        if os.path.isfile(folder / "package.xml"):
            return folder
    above = file.parent.parent
    if file.parent.name.lower() in _SUBFOLDERS and above != above.parent:
        return above
    return file.parent


def find_package(name: str, path: Path) -> Path | None:
    """The folder of a package that a description names; None where there is none to be read."""
    if not _PACKAGE_NAME.fullmatch(name):
        return None
    file, tree = path.resolve(), description_tree(path)
    for folder in file.parents:
        if folder.name == name and (_is_package(folder, tree) or len(folder.parts) > 2):
            return folder
        inner = (folder / name).resolve()  # a link may lead out of the tree
        if os.path.isdir(inner) and _is_package(inner, tree):
            return inner
    return None


def is_inside(path: Path, folders: Iterable[Path]) -> bool:
    """Whether a file lies in one of the folders, once links and ``..`` are resolved."""
    try:
        file = path.resolve()
    except (OSError, RuntimeError, ValueError):  # links in a ring, a zero byte in the name
        return False
    return any(file.is_relative_to(folder) for folder in folders)


def _is_package(folder: Path, tree: Path) -> bool:
    return os.path.isfile(folder / "package.xml") or folder.is_relative_to(tree)
