"""The folder that a study writes into: its own, and as it left it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from calib.errors import OutputError
from posedesign.files import check_writable, head_of, write_json_atomic
from posedesign.files.origin import MOST_BYTES

WRITTEN = "written.json"
"""What a run has written, by name, with the first 16 digits of the SHA-256: it says whose a folder
is, since every study has tables and figures of its own."""

ABOUT = "about.json"
"""The note of a run that can be stopped, see :mod:`.store`; without it nothing is gone on with."""

PICTURES = (".png", ".svg")
TABLES = (".csv", ".parquet", ".json")
ENDINGS = (*TABLES, *PICTURES)


@contextmanager
def own_folder(folder: Path, study: str, endings: Sequence[str] = ENDINGS) -> Iterator[None]:
    """Run a study, or draw it, in a folder; what it leaves there is noted, also where it fails.

    Parameters
    ----------
    folder : Path
    study : str
        Its name.
    endings : sequence of str
        Of the files that are going to be written.

    Raises
    ------
    OutputError
        There are files of such endings that the study has not written, or that were changed since;
        or the folder is closed to writing.
    """
    check_writable(folder / WRITTEN)
    listed = _listed(folder, study)
    begun = str(_parsed(folder / ABOUT).get("study")).lstrip("0123456789_") == study
    for path, why in _not_as_written(folder, study, endings).items():
        if path.name not in listed and begun:
            continue  # of a run that was stopped before it could be noted
        raise OutputError(
            f"{path} {why}: it is not replaced", hint="name another output folder", name=str(path)
        )
    before = {path.name: _digest(path) for path in _files(folder, ENDINGS)}
    try:
        yield
    finally:
        after = {path.name: _digest(path) for path in _files(folder, ENDINGS)}
        new = {name: digest for name, digest in after.items() if before.get(name) != digest}
        if new:
            write_json_atomic(folder / WRITTEN, {"study": study, "files": listed | new})


def strange_table(folder: Path, study: str) -> str:
    """The first table in a folder that is not as the study left it, in words; empty for none."""
    found = _not_as_written(folder, study, TABLES).items()
    return next((f"{path.name} {why}" for path, why in found), "")


def _not_as_written(folder: Path, study: str, endings: Sequence[str]) -> dict[Path, str]:
    """Files of some endings that are not as the study wrote them, and why, in words."""
    listed = _listed(folder, study)
    return {
        path: "was changed since the study wrote it"
        if path.name in listed
        else f"is not of the study {study}"
        for path in _files(folder, endings)
        if listed.get(path.name) != _digest(path)
    }


def _files(folder: Path, endings: Sequence[str]) -> list[Path]:
    return [
        path
        for path in sorted(folder.glob("*"))
        if path.is_file()
        and path.suffix.lower() in endings
        and not path.name.startswith(".")
        and path.name not in (WRITTEN, ABOUT)
    ]


def _listed(folder: Path, study: str) -> dict[str, str]:
    found = _parsed(folder / WRITTEN)
    files = found.get("files")
    return dict(files) if found.get("study") == study and isinstance(files, dict) else {}


def _parsed(path: Path) -> dict[str, object]:
    try:
        found = json.loads(head_of(path, MOST_BYTES))
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _digest(path: Path) -> str:
    return hashlib.sha256(head_of(path, MOST_BYTES)).hexdigest()[:16]
