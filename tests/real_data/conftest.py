"""Where the measurements of real robots are, which the project does not contain."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from studies import real_data


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Folder of real measurements: POSEDESIGN_DATA, else ``../shared/data`` by the checkout."""
    folder = real_data.data_folder()
    if not folder.is_dir():
        pytest.skip(f"no real measurements: set POSEDESIGN_DATA ({folder} does not exist)")
    return folder


@pytest.fixture(scope="session")
def load_study() -> Callable[[Path], ModuleType]:
    """Load the ``run.py`` of a study's folder, whose name is no name of a module."""

    def load(folder: Path) -> ModuleType:
        spec = importlib.util.spec_from_file_location(f"study_{folder.name}", folder / "run.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module  # where dataclasses look up their annotations
        spec.loader.exec_module(module)
        return module

    return load
