"""Where the measurements of real robots are, which the project does not contain."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Folder of real measurements: POSEDESIGN_DATA, else ``../shared/data`` by the checkout."""
    named = os.environ.get("POSEDESIGN_DATA")
    folder = Path(named) if named else Path(__file__).parents[2].parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no real measurements: set POSEDESIGN_DATA ({folder} does not exist)")
    return folder
