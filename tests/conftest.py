"""Cells that tests plan for, and a hypothesis profile that gives the same run every time."""

import os

# Each worker of pytest-xdist has a core of its own: threads of linear algebra would fight for it.
# Numpy reads this when it is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import atexit
import gc
import json
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from hypothesis import settings

from calib import Robot, mat_file
from posedesign.cell import Cell, cell_template
from posedesign.cell.file import parse_config
from posedesign.identification import models
from posedesign.study.library import find_study

# Containers often forbid byte code, and each process of a test would compile all libraries then:
# half of the time of most. It is kept where one said, or for as long as the tests run.
if os.environ.pop("PYTHONDONTWRITEBYTECODE", ""):
    sys.dont_write_bytecode = False
    if sys.pycache_prefix is None:
        sys.pycache_prefix = tempfile.mkdtemp(prefix="posedesign-")
        os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix
        atexit.register(shutil.rmtree, sys.pycache_prefix, ignore_errors=True)

settings.register_profile(
    "repeatable", database=None, deadline=None, derandomize=True, max_examples=25
)
settings.load_profile("repeatable")


def pytest_collection_finish() -> None:
    """What was collected stays to the end: to look for garbage in it is a seventh of the time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 50)


@pytest.fixture(scope="session", autouse=True)
def _not_to_the_disk() -> Iterator[None]:
    """Files of tests go when the tests end: nothing waits until the disk has them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda _: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def _each_preset_once() -> Iterator[None]:
    """Presets, of which thousands of cells are made, are built once: no test changes one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Robot, "preset", staticmethod(cache(Robot.preset)))
        yield


def cell_of(raw: dict[str, Any], sections: dict[str, dict[str, Any]]) -> Cell:
    """The cell with keys of its sections replaced; a section of None is left out."""
    for name, keys in sections.items():
        raw[name] = {**raw.get(name, {}), **keys} if isinstance(keys, dict) else keys
        if keys is None:
            del raw[name]
    return Cell.from_config(parse_config(raw, Path("cell.toml")), Path("cell.toml"))


@pytest.fixture
def one_alternative(monkeypatch) -> None:
    """One arm without some of what may be off, for tests that are not about which is probable."""
    monkeypatch.setattr(models, "_ABSENT", models._ABSENT[-1:])


@pytest.fixture(scope="session")
def reference_cell() -> Cell:
    """The reference cell with joint limits as its only constraints."""
    return cell_of(tomllib.loads(cell_template(surroundings=False)), {})


@pytest.fixture(scope="session")
def demo_cell() -> Cell:
    """The reference cell as ``posedesign new`` prints it: gun, camera, fixture and floor."""
    return Cell.from_text(cell_template())


@pytest.fixture(scope="session")
def make_cell() -> Callable[..., Cell]:
    """The reference cell with keys of its sections replaced: ``make_cell(plan={...})``."""
    return lambda **sections: cell_of(tomllib.loads(cell_template(surroundings=False)), sections)


@pytest.fixture(scope="session")
def make_demo_cell() -> Callable[..., Cell]:
    """The same from the cell with gun, camera, fixture and floor."""
    return lambda **sections: cell_of(tomllib.loads(cell_template()), sections)


@pytest.fixture
def in_this_process(monkeypatch) -> None:
    """MATLAB files known to do no harm need no process of their own to be read in."""

    def run_here(module: str, data: bytes, **limits: float) -> bytes:
        try:
            read: bytes = import_module(module).run(data)
        except Exception as error:
            raise OSError("the process broke off") from error
        return read

    monkeypatch.setattr(mat_file, "run_limited", run_here)


@pytest.fixture(scope="module")
def study(request) -> ModuleType:
    """The ``run.py`` of the study whose folder a module of tests names."""
    return find_study(request.module.FOLDER.name).load()


@pytest.fixture(scope="module")
def written(request) -> Any:
    """The key figures that stand in that folder."""
    return json.loads((request.module.FOLDER / "expected.json").read_text(encoding="utf-8"))
