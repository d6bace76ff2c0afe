"""Expanding a xacro file with the xacro package, where that is installed."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType

from calib.errors import RobotModelError

MEMORY_BYTES = 2_000_000_000
"""A large cell takes a tenth of it, Python itself included."""

SECONDS = 20.0
"""A large cell is expanded in about one second; a macro that doubles itself never ends."""

_START = (
    "import json, sys; job = json.load(sys.stdin); sys.path[:] = job['path'];"
    "from calib.robots.description.xacro_process import run; run(job)"
)


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
    path : Path
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
        "path": [entry for entry in sys.path if entry],  # "" is the folder one happens to be in
        "file": str(path.resolve()),
        "search": [str(folder) for folder in search],
        "arguments": dict(arguments),
        "most_bytes": most_bytes,
        "memory_bytes": MEMORY_BYTES,
        "seconds": SECONDS,
    }
    try:
        done = subprocess.run(  # noqa: S603 - no shell, and no word of it is from the file
            [sys.executable, "-I", "-B", "-X", "utf8", "-c", _START],
            input=json.dumps(job).encode(),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=SECONDS,
            check=False,
        )
        outcome = json.loads(done.stdout)
    except (OSError, ValueError) as error:
        raise _failed(path, "the process that expands it broke off") from error
    except subprocess.TimeoutExpired as error:
        raise _failed(path, f"not done in {SECONDS:g} s") from error
    if "error" in outcome:
        raise _failed(path, outcome["error"])
    return Expanded(outcome["urdf"], tuple(Path(f) for f in outcome["folders"]))


def _failed(path: Path, why: str) -> RobotModelError:
    return RobotModelError(
        f"{path}: xacro cannot be expanded: {why}",
        hint="correct it, or expand it yourself, where you trust it: xacro file.xacro > file.urdf",
        name=str(path),
    )
