"""The files of a program as one set: each says of which, and a set is replaced as a whole.

Behind the mark of the plan stand the number of files and a digest of all of them, as in
``PLAN 1a2b3c4d 27 2 9f8e7d6c``. Files that name different sets were not written together: the
positions of one plan then meet the moves of another. A set whose digest is not that of its files
any more was touched up, edited or mixed by a person, and is not replaced.
"""

from __future__ import annotations

import hashlib
import re
import secrets
import shutil
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from calib.errors import OutputError
from posedesign.files import Results, head_of, kept_aside, make_folder, write_bytes_atomic
from posedesign.programs.reading import MOST_BYTES, unpacked

_MARK = re.compile(
    rb"""^[ \t\d:]{0,40}(?:[;!'#]|//|--|<Value\ key="0"\ value=")?[ \t]{0,40}
    PLAN\ ([0-9a-f]{4,16})\ (\d{1,7})(?:\ (\d{1,3})\ ([0-9a-f]{8}))?["/> \t;]{0,40}\r?$""",
    re.MULTILINE | re.VERBOSE,
)
_DIGITS = 8
_LONGEST = 32
"""Characters of a remark on the controller that takes the fewest; a longer mark names no set."""

MOST_PARTS = 99  # of a program that is looked for where a shorter one takes its place


@dataclass(frozen=True)
class SetMark:
    """What a file of a program says of its plan and of its set."""

    plan: str  # fingerprint of the plan
    files: int | None = None  # number of files of the set; None where the file names none
    digest: str = ""  # of the set; empty where the file names none

    def __str__(self) -> str:
        return f"plan {self.plan}" + f", set {self.digest}" * bool(self.digest)


def set_mark(data: bytes) -> SetMark | None:
    """The mark in the content of a file; None without one."""
    found = _MARK.search(data)
    if found is None:
        return None
    files = int(found[3]) if found[3] else None
    return SetMark(found[1].decode(), files, (found[4] or b"").decode())


def content_of(path: Path) -> bytes:
    """Content of a file of a program, unpacked; none of one that cannot be read."""
    return unpacked(head_of(path, MOST_BYTES)) or b""


def marked_as_set(files: Mapping[Path, bytes]) -> dict[Path, bytes]:
    """The same files with number and digest of the set behind the mark of the plan."""
    texts = {
        path: _with_set(data, b" %d %s" % (len(files), b"0" * _DIGITS))
        for path, data in files.items()
    }
    digest = _digest(texts).encode()
    return {path: _with_digest(data, digest) for path, data in texts.items()}


def _with_set(data: bytes, words: bytes) -> bytes:
    found = _MARK.search(data)
    if found is None or found.end(2) - found.start(1) + len("PLAN ") + len(words) > _LONGEST:
        return data
    return data[: found.end(2)] + words + data[found.end(2) :]


def _with_digest(data: bytes, digest: bytes) -> bytes:
    found = _MARK.search(data)
    if found is None or not found[4]:
        return data
    return data[: found.start(4)] + digest + data[found.end(4) :]


def _digest(files: Mapping[Path, bytes]) -> str:
    total = hashlib.sha256()
    for path in sorted(files, key=lambda path: path.name):
        total.update(path.name.encode() + b"\0")
        total.update(_with_digest(files[path], b"0" * _DIGITS))
    return total.hexdigest()[:_DIGITS]


def beside(path: Path, endings: Collection[str], *, in_folder: bool) -> list[Path]:
    """The other files that a program has beside one of its files."""
    return sorted(
        other
        for other in path.parent.glob("*")
        if other != path
        and other.is_file()
        and other.suffix.lower() in endings
        and (in_folder or other.stem == path.stem)
    )


def strangers(path: Path, endings: Collection[str], *, in_folder: bool) -> list[str]:
    """Files beside one of a program that are of another plan, or were written at another time."""
    own = set_mark(content_of(path))
    if own is None:
        return []
    marks = {
        other: set_mark(content_of(other)) for other in beside(path, endings, in_folder=in_folder)
    }
    return [
        f"{path.name} is of {own}, {other.name} of {mark}: they do not belong together"
        for other, mark in marks.items()
        if mark is not None and mark != own
    ]


def as_written(files: Mapping[Path, bytes], *, in_folder: bool) -> set[Path]:
    """Those of some files that are of sets of which nothing was changed."""
    marks = {path: set_mark(data) for path, data in files.items()}
    found: set[Path] = set()
    for own in {mark for mark in marks.values() if mark is not None and mark.digest}:
        stems = {path.stem for path, mark in marks.items() if mark == own}
        group = {
            path: data
            for path, data in files.items()
            if marks[path] == own or (marks[path] is None and (in_folder or path.stem in stems))
        }
        if len(group) == own.files and _digest(group) == own.digest:
            found |= set(group)
    return found


def claim_set(
    name: str,
    parts: Iterable[str],
    endings: Collection[str],
    results: Results,
    *,
    in_folder: bool,
    new: Mapping[Path, bytes] | None = None,
) -> list[Path]:
    """Files of older programs of the name that have to give way; kept aside where they must be.

    ``name``: of the program. ``parts``: names of its parts, were it longer. ``endings``: of the
    files of its dialect. ``in_folder``: whether the program is a folder of its name. ``new``: what
    is going to be written; nothing is kept aside without it. Raises OutputError: a file is not as
    it was written with the others, and is not to be replaced.
    """
    place = results.folder / name if in_folder else results.folder
    stems = {stem.casefold() for stem in (name, *parts)}
    there = [
        p
        for p in sorted(place.glob("*"))
        if in_folder or (p.stem.casefold() in stems and p.suffix.lower() in endings)
    ]
    texts = {path: content_of(path) for path in there}
    ours, given = as_written(texts, in_folder=in_folder), new or {}
    foreign = [path for path in there if path not in ours and given.get(path) != texts[path]]
    other = next((path for path in foreign if not path.is_file()), None)
    if other is not None:
        raise OutputError(f"{other} is not an ordinary file", hint="move it", name=str(other))
    if foreign and not results.overwrite:
        raise OutputError(
            f"{foreign[0]} is not as a program was written here, or of another one: it is not "
            "replaced",
            hint="name another program or folder, or overwrite: it is then kept under another name",
            name=str(foreign[0]),
        )
    if foreign and new is not None:
        for path in [place] if in_folder else foreign:
            if in_folder:
                aside = _free_name(place)
                shutil.copytree(place, aside)
            else:
                aside = kept_aside(path)
            results.say(f"{path}: what was there is kept as {aside.name}")
    return there


def _free_name(path: Path) -> Path:
    number = 1
    while (aside := path.with_name(f"{path.name}.{number}")).exists():
        number += 1
    return aside


def write_set(files: Mapping[Path, bytes], old: Iterable[Path], *, in_folder: bool) -> None:
    """Write the files of a set, and remove those of an older one that it does not have.

    A folder is swapped as a whole. Files beside each other are not: their marks tell where
    something stopped that in between.
    """
    if in_folder:
        _swapped_folder(files)
        return
    for path, data in files.items():
        make_folder(path.parent)
        write_bytes_atomic(path, data)
    for path in old:
        if path not in files:
            path.unlink(missing_ok=True)


def _swapped_folder(files: Mapping[Path, bytes]) -> None:
    folder = next(iter(files)).parent
    make_folder(folder.parent)
    aside, before = (folder.parent / f".{secrets.token_hex(8)}.{end}" for end in ("tmp", "old"))
    make_folder(aside)
    try:
        for path, data in files.items():
            write_bytes_atomic(aside / path.name, data)
        if folder.exists():
            folder.rename(before)
        aside.rename(folder)
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be written: {error.strerror or error}",
            hint=f"check that the folder {folder.parent} can be written and has free space",
            name=str(folder),
        ) from error
    finally:
        shutil.rmtree(aside, ignore_errors=True)
        if before.exists() and not folder.exists():
            before.rename(folder)
        shutil.rmtree(before, ignore_errors=True)
