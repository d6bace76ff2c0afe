"""The studies there are: folders with a question, numbers, and a module that answers it."""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import json
import os
import sys
import tomllib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any

from calib.errors import CalibError, FileFormatError, InputError, OutputError, near_names
from posedesign.files import check_writable, head_of, write_json_atomic
from posedesign.files.origin import MOST_BYTES
from posedesign.study.runner import Workers

WRITTEN = "written.json"
"""What a run has written, by name, with the first 16 digits of the SHA-256: it says whose a folder
is, since every study has tables and figures of its own."""

ABOUT = "about.json"
"""The note of a run that can be stopped, see :mod:`.store`; without it nothing is gone on with."""

PICTURES = (".png", ".svg")
TABLES = (".csv", ".parquet", ".json")
ENDINGS = (*TABLES, *PICTURES)

Advance = Callable[[str, float], None]

NAMED_BY = "POSEDESIGN_STUDIES"
"""Variable of the environment that names the folder of the studies."""

_PACKAGE = "studies"
_FOLDERS = "[0-9]*_*/run.py"
_NUMBER = "0123456789_"

_OF_DAMAGED_TABLES = (ArithmeticError, AttributeError, LookupError, OSError, TypeError, ValueError)
"""What pandas, pyarrow and matplotlib raise on them."""


@dataclass(frozen=True)
class Options:
    """How a study is to be run."""

    out: Path  # folder for tables and key figures
    trials: int | None = None  # in place of the study's own number: a short form
    workers: Workers = field(default_factory=Workers)
    restart: bool = False  # begin anew, whatever results there are
    advance: Advance = lambda what, part: None
    """Called with what is being done and the part of all work that is done."""


@dataclass(frozen=True)
class Study:
    """A folder ``NN_name`` with ``README.md``, ``study.toml``, ``run.py`` and ``expected.json``.

    ``run.py`` has ``study(options) -> key figures``, which writes the tables and ``figures.json``,
    ``plot(folder) -> paths``, which draws what the tables of a folder say and may take ``workers``
    beside it, and it may have ``markdown(key figures) -> text``, the tables as its README has them.
    With the modules beside it it is a package of ``studies``: they are imported with a dot before
    their names.
    """

    folder: Path

    @property
    def name(self) -> str:
        """Without its number."""
        return self.folder.name.lstrip(_NUMBER)

    @property
    def number(self) -> str:
        """Its place in the list, two digits."""
        return self.folder.name.partition("_")[0]

    @cached_property
    def needs(self) -> str:
        """What it needs that the project does not contain: ``needs`` of its ``study.toml``."""
        path = self.folder / "study.toml"
        if not path.exists():
            return ""
        return str(tomllib.loads(path.read_text(encoding="utf-8")).get("needs", ""))

    @cached_property
    def question(self) -> str:
        """The first line of its README."""
        path = self.folder / "README.md"
        if not path.exists():
            return ""
        with path.open(encoding="utf-8") as stream:
            return stream.readline().lstrip("# ").strip()

    def run(self, options: Options) -> Any:
        """Run it, and return its key figures.

        Raises InputError: workers for a study that runs in one process: only one whose ``run.py``
        says ``WORKERS = True`` shares its tasks. Or a short form that would replace the study's own
        results.
        """
        function = self._function("study")
        if options.trials is not None and self._owns(options.out):
            raise InputError(
                f"{options.out} has the results of the study's own number of trials",
                hint="name another folder with `out`",
                name="trials",
                value=options.trials,
            )
        if options.workers != Workers() and not getattr(self.load(), "WORKERS", False):
            raise InputError(
                f"{self.name} runs in one process",
                hint="leave `jobs` and `scheduler` out",
                name="jobs",
                value=options.workers.jobs,
            )
        return function(options)

    def plot(self, folder: Path, workers: Workers | None = None) -> list[Path]:
        """Draw the figures of the tables in a folder.

        Raises InputError: a table is not there. FileFormatError: a table is damaged, or another
        than the study left there.
        """
        try:
            function = self._function("plot")
            shares = "workers" in inspect.signature(function).parameters
            return list(function(folder, workers) if shares else function(folder))
        except FileNotFoundError as error:
            if not Path(str(error.filename)).is_relative_to(folder):
                raise
            raise self._not_run(folder, error) from error
        except FileFormatError as error:
            if isinstance(error.__cause__, FileNotFoundError):
                raise self._not_run(folder, error.__cause__) from error
            raise
        # a column that is missing or is of text, a file that is cut off, a number that cannot be
        # drawn; where all tables are as the study left them, the fault is the study's
        except _OF_DAMAGED_TABLES as error:
            strange = strange_table(folder, self.name)
            if not strange:
                raise
            raise FileFormatError(
                f"cannot be drawn: {strange} ({type(error).__name__}: {error!s:.200})",
                path=folder,
                hint=f"run it again: posedesign study run {self.name} --restart",
            ) from error

    def markdown(self, figures: Any) -> str:
        """The tables of key figures as the README has them; empty where it has none of them."""
        function = getattr(self.load(), "markdown", None)
        return str(function(figures)) if function else ""

    @contextmanager
    def writing_to(self, out: Path, endings: Sequence[str] = ENDINGS) -> Iterator[None]:
        """Run it, or draw it, in a folder that has no other results; see :func:`own_folder`.

        In the study's own folder key figures are what the tests hold it to.
        """
        if not self._owns(out):
            with own_folder(out, self.name, endings):
                yield
            return
        yield
        figures = self.folder / "figures.json"
        if figures.exists():
            figures.replace(self.folder / "expected.json")

    def _owns(self, out: Path) -> bool:
        return out.resolve() == self.folder.resolve()

    def _not_run(self, folder: Path, error: FileNotFoundError) -> InputError:
        return InputError(
            f"{folder} has no results of this study: {error.filename} is not there",
            hint=f"run it first: posedesign study run {self.name}",
            name=str(folder),
        )

    def _function(self, name: str) -> Callable[..., Any]:
        found = getattr(self.load(), name, None)
        if not callable(found):
            raise CalibError(f"{self.folder / 'run.py'} has no {name}()")
        function: Callable[..., Any] = found
        return function

    def load(self) -> ModuleType:
        """The module of its ``run.py``, loaded once: a package of ``studies`` with the modules
        beside it in it.
        """
        name = f"{_PACKAGE}.{self.folder.name}"
        if _PACKAGE not in sys.modules:
            _load(_PACKAGE, self.folder.parent / "__init__.py")
        return sys.modules.get(name) or _load(name, self.folder / "run.py")


def _load(name: str, path: Path) -> ModuleType:
    """Import a package from its first module, wherever it is."""
    spec = importlib.util.spec_from_file_location(
        name, path, submodule_search_locations=[str(path.parent)]
    )
    if spec is None or spec.loader is None or not path.exists():
        raise InputError(f"{path.parent} has no {path.name}", name=name)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def studies_folder() -> Path:
    """The folder ``studies``: that of the environment's :data:`NAMED_BY`, of the checkout that this
    package is run from, or of the current folder or one above it.

    Raises InputError: there is none: studies are no part of the installed package.
    """
    named = os.environ.get(NAMED_BY)
    here = Path.cwd()
    places = [Path(__file__).parents[2], here, *here.parents]
    for folder in [Path(named)] if named else [place / _PACKAGE for place in places]:
        if any(folder.glob(_FOLDERS)):
            return folder
    raise InputError(
        f"there are no studies in {named}" if named else "studies are no part of the package",
        hint=f"run this in a checkout of the project, or name its folder studies with {NAMED_BY}",
        name=NAMED_BY,
    )


def list_studies() -> list[Study]:
    """All studies, by their numbers."""
    folders = sorted(path.parent for path in studies_folder().glob(_FOLDERS))
    return [Study(folder) for folder in folders]


def find_study(name: str) -> Study:
    """A study by its name, with or without its number, or by the number alone.

    Raises InputError: there is none of that name; the hint has near ones.
    """
    every = list_studies()
    for study in every:
        if name in (study.name, study.folder.name, study.number, study.number.lstrip("0")):
            return study
    raise InputError(
        f"there is no study {name!r}",
        hint=near_names(name, [study.name for study in every]),
        name="name",
        value=name,
    )


def call(folder_name: str, function: str, task: Any) -> Any:
    """Call a function of a study's ``run.py`` with a task: what a worker is sent.

    A worker, on this machine or another, finds the study by its name in its own installation.
    """
    return getattr(find_study(folder_name).load(), function)(task)


@contextmanager
def own_folder(folder: Path, study: str, endings: Sequence[str] = ENDINGS) -> Iterator[None]:
    """Run a study, or draw it, in a folder; what it leaves there is noted, also where it fails.

    ``study``: its name. ``endings``: of the files that are going to be written. Raises OutputError:
    there are files of such endings that the study has not written, or that were changed since; or
    the folder is closed to writing.
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
