"""Where the measurements of real robots are, which the project does not contain."""

from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest

from posedesign.study.library import find_study
from studies import real_data
from tests.cli.conftest import empty_pictures


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

    return lambda folder: find_study(folder.name).load()


@pytest.fixture(scope="module", autouse=True)
def _pictures() -> Iterator[None]:
    """Nobody looks at the pictures."""
    with empty_pictures():
        yield
