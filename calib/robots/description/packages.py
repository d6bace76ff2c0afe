"""Which files a robot description may name: those of its own package and of packages around it.

Descriptions come from anywhere and name other files: meshes, included xacros, tables. The rule:

* The *tree* of a description is the nearest folder above it with a ``package.xml``; without one,
  its own folder, or the folder above where its own is called ``urdf``, ``robots`` or the like.
* The *package* NAME is the nearest folder of that name among the folders above the description and
  the folders in these, if it holds a ``package.xml`` or lies in the tree; else the nearest of them
  whose ``package.xml`` says that name, however the folder is called; else one below the folders to
  search: those that were given, then those of ``ROS_PACKAGE_PATH`` and ``AMENT_PREFIX_PATH``.
* A file is read only where it lies in the tree, in a package named, or, named by its whole path
  (``file://``), below a folder to search, once every link and ``..`` is resolved.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from pathlib import Path

SEARCH_VARIABLES = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")
"""Lists of folders as ROS 1 and ROS 2 set them for an installed workspace."""

_SUBFOLDERS = frozenset(
    {"description", "model", "models", "robot", "robots", "urdf", "urdfs", "xacro"}
)
_PACKAGE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.\- ]*")
_DECLARED = re.compile(rb"<name>\s*([A-Za-z0-9_.\-]+)\s*</name>")

_DEEPEST = 4
"""Folders below one to search: ``workspace/src/repository/package``."""

_MOST_FOLDERS = 20_000
"""Looked into below one folder to search: a workspace with all of ROS has a few thousand."""

_MOST_BYTES = 100_000
"""Of a ``package.xml`` that are read for its name."""


class Packages:
    """The packages that a description may name.

    Attributes
    ----------
    tree : Path
        The folder whose files it may read without naming a package.
    search : tuple of Path
        Folders whose files it may name by their whole path (``file://``).
    """

    def __init__(self, path: Path, search: Sequence[Path] = ()) -> None:
        self._file = path.resolve()
        self.search = tuple(folder.resolve() for folder in search)
        self.tree = _tree_of(self._file)

    def find(self, name: str) -> Path | None:
        """The folder of a package; None where there is none to be read."""
        return self.find_near(name, self._file) or self.declared.get(name)

    def find_near(self, name: str, file: Path) -> Path | None:
        """The folder of that name above a file, or in a folder above it."""
        if not _PACKAGE_NAME.fullmatch(name):
            return None
        for folder in file.parents:
            if folder.name == name and self._may_be_read(folder):
                return folder
            inner = (folder / name).resolve()  # a link may lead out of the tree
            if os.path.isdir(inner) and self._may_be_read(inner):
                return inner
        return None

    def find_above(self, name: str) -> Path | None:
        """The folder of that name above the description, with or without ``package.xml``.

        For meshes only: these are read as meshes, and no text of them gets anywhere. A folder at
        the top of the file system is none.
        """
        above = (f for f in self._file.parents if f.name == name and len(f.parts) > 2)
        return next(above, None)

    @cached_property
    def declared(self) -> dict[str, Path]:
        """Folders of packages by the name that their ``package.xml`` says, the nearest of each."""
        found: dict[str, Path] = {}
        near = (f for above in self._file.parents for f in (above, *_folders_in(above)))
        for folder in (*near, *(f for start in self.search for f in _below(start))):
            name = _declared_name(folder)
            if name:
                found.setdefault(name, folder.resolve())
        return found

    def _may_be_read(self, folder: Path) -> bool:
        return _is_package(folder) or folder.is_relative_to(self.tree)


def folders_to_search(given: Iterable[Path]) -> tuple[Path, ...]:
    """The folders given, then those of the environment variables of ROS."""
    listed = [
        Path(entry)
        for variable in SEARCH_VARIABLES
        for entry in os.environ.get(variable, "").split(os.pathsep)
        if entry
    ]
    # an installed workspace has its packages in the folder share, among thousands of others
    shares = [f / "share" if os.path.isdir(f / "share") else f for f in listed]
    return tuple(dict.fromkeys(path.absolute() for path in (*given, *shares)))


def is_inside(path: Path, folders: Iterable[Path]) -> bool:
    """Whether a file lies in one of the folders, once links and ``..`` are resolved."""
    try:
        file = path.resolve()
    except (OSError, RuntimeError, ValueError):  # links in a ring, a zero byte in the name
        return False
    return any(file.is_relative_to(folder) for folder in folders)


def _tree_of(file: Path) -> Path:
    for folder in file.parents:
        if _is_package(folder):
            return folder
    above = file.parent.parent
    if file.parent.name.lower() in _SUBFOLDERS and above != above.parent:
        return above
    return file.parent


def _is_package(folder: Path) -> bool:
    return os.path.isfile(folder / "package.xml")


def _declared_name(folder: Path) -> str:
    """The name that the ``package.xml`` of a folder says; empty without one."""
    if not _is_package(folder):
        return ""
    try:
        with open(folder / "package.xml", "rb") as stream:
            found = _DECLARED.search(stream.read(_MOST_BYTES))
    except OSError:
        return ""
    return found[1].decode() if found else ""


def _folders_in(folder: Path) -> list[Path]:
    """Folders in a folder in the order of their names, but for hidden ones; links are followed."""
    try:
        with os.scandir(folder) as entries:
            names = [e.name for e in entries if e.name[:1] != "." and e.is_dir()]
    except OSError:
        return []
    return [folder / name for name in sorted(names)]


def _below(start: Path) -> Iterator[Path]:
    """A folder and those below it, level by level; not those in packages, nor through links."""
    level, seen = [start], 0
    for _ in range(_DEEPEST + 1):
        deeper: list[Path] = []
        for folder in level:
            seen += 1
            if seen > _MOST_FOLDERS:
                return
            yield folder
            if not _is_package(folder):
                deeper += [f for f in _folders_in(folder) if not f.is_symlink()]
        level = deeper
