"""Where the measurements of real robots are, which the project does not contain."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from calib.errors import InputError

NAMED_BY = "POSEDESIGN_DATA"
"""Variable of the environment that names their folder."""


def data_folder() -> Path:
    """Where they are looked for: a folder that is named, or ``../shared/data`` by the checkout."""
    named = os.environ.get(NAMED_BY)
    return Path(named) if named else Path(__file__).parents[1].parent / "shared" / "data"


def data_with(*parts: str) -> Path:
    """The folder of real measurements, for a study that needs some parts of them.

    Parameters
    ----------
    *parts : str
        Folders in it, such as ``identification/ur10``.

    Raises
    ------
    InputError
        One of them is not there.
    """
    folder = data_folder()
    for part in parts:
        if not (folder / part).is_dir():
            raise InputError(
                f"this study needs measurements: there is no {folder / part}",
                hint=f"{NAMED_BY} names the folder of all measurements; without it, it is "
                "../shared/data beside the checkout",
                name=NAMED_BY,
                value=str(folder),
            )
    return folder


@contextmanager
def folder_for_recordings(out: Path, own: Path) -> Iterator[Path]:
    """A folder for what ``posedesign identify`` takes: that of the results, or one that is lost.

    It is lost where the results go to the study's own folder: measurements of others are no part of
    the project.
    """
    if out.resolve() != own.resolve():
        yield out
        return
    with TemporaryDirectory() as scratch:
        yield Path(scratch)
