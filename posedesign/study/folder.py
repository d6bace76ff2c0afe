"""The folder that a study writes into: its own, and as it left it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from calib.errors import OutputError
from posedesign.files import write_json_atomic
from posedesign.origin import MOST_BYTES, head_of

WRITTEN = "written.json"
"""What a run has written, by name, with the first 16 digits of the SHA-256: it says whose a folder
is, since every study has tables and figures of its own."""

ABOUT = "about.json"
"""The note of a run that can be stopped, see :mod:`.store`; without it nothing is gone on with."""

PICTURES = (".png", ".svg")
_ENDINGS = (".csv", ".parquet", ".json", *PICTURES)


@contextmanager
def own_folder(folder: Path, study: str, endings: Sequence[str] = _ENDINGS) -> Iterator[None]:
    """Run a study, or draw it, in a folder; what it leaves there is noted.

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
        There are files of such endings that the study has not written, or that were changed since.
    """
    listed = _listed(folder, study)
    begun = "study" in _parsed(folder / ABOUT)
    for path in _files(folder, endings):
        if path.name not in listed and begun:
            continue  # of a run that was stopped before it could be noted
        if listed.get(path.name) != _digest(path):
            changed = "was changed since the study wrote it"
            foreign = f"is not of the study {study}"
            raise OutputError(
                f"{path} {changed if path.name in listed else foreign}: it is not replaced",
                hint="name another output folder",
                name=str(path),
            )
    before = {path.name: _digest(path) for path in _files(folder, _ENDINGS)}
    yield
    after = {path.name: _digest(path) for path in _files(folder, _ENDINGS)}
    new = {name: digest for name, digest in after.items() if before.get(name) != digest}
    if new:
        write_json_atomic(folder / WRITTEN, {"study": study, "files": listed | new})


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
