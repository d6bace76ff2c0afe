"""Expanding a xacro file with the xacro package, where that is installed."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType

from calib.errors import RobotModelError
from calib.limited import run_limited

MEMORY_BYTES = 2_000_000_000
"""A large cell takes a tenth of it, Python itself included."""

SECONDS = 20.0
"""A large cell is expanded in about one second; a macro that doubles itself never ends."""


@dataclass(frozen=True)
class Expanded:
    """What became of a xacro file.

    Attributes
    ----------
    text : str
        The URDF.
    folders : tuple of Path
        The packages whose files it may name.
    """

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

    Parameters
    ----------
    most_bytes : int
        Largest size of each file read and of the outcome.
    search : sequence of Path
        Folders to search for packages.
    arguments : mapping of str to str
        Of the file; those not given have their defaults.

    Raises
    ------
    RobotModelError
        The xacro package is not installed, or the file cannot be expanded, or not within bounds.
    """
    if find_spec("xacro") is None:
        raise RobotModelError(
            f"{path}: contains xacro macros, and the package xacro is not installed",
            hint='pip install "posedesign[xacro]", or expand it first: xacro file.xacro > '
            "file.urdf",
            name=str(path),
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
    return RobotModelError(
        f"{path}: xacro cannot be expanded: {why}",
        hint="correct it, or expand it yourself, where you trust it: xacro file.xacro > file.urdf",
        name=str(path),
    )
