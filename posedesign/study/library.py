"""The studies there are: folders with a question, numbers, and a module that answers it."""

from __future__ import annotations

import importlib.util
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

from calib.errors import CalibError, FileFormatError, InputError, near_names
from posedesign.study.folder import ENDINGS, own_folder, strange_table
from posedesign.study.runner import Workers

Advance = Callable[[str, float], None]

NAMED_BY = "POSEDESIGN_STUDIES"
"""Variable of the environment that names the folder of the studies."""

_PACKAGE = "studies"
_FOLDERS = "[0-9]*_*/run.py"
_NUMBER = "0123456789_"

_OF_DAMAGED_TABLES = (
    ArithmeticError,
    AttributeError,
    LookupError,
    OSError,
    TypeError,
    ValueError,
)
"""What pandas, pyarrow and matplotlib raise on them."""


@dataclass(frozen=True)
class Options:
    """How a study is to be run.

    Attributes
    ----------
    out : Path
        Folder for tables and key figures.
    trials : int, optional
        In place of the study's own number: a short form.
    workers : Workers
    restart : bool
        Begin anew, whatever results there are.
    advance : callable
        Called with what is being done and the part of all work that is done.
    """

    out: Path
    trials: int | None = None
    workers: Workers = field(default_factory=Workers)
    restart: bool = False
    advance: Advance = lambda what, part: None


@dataclass(frozen=True)
class Study:
    """A folder ``NN_name`` with ``README.md``, ``study.toml``, ``run.py`` and ``expected.json``.

    ``run.py`` has ``study(options) -> key figures``, which writes the tables and ``figures.json``,
    ``plot(folder) -> paths``, which draws what the tables of a folder say, and it may have
    ``markdown(key figures) -> text``, the tables as its README has them. With the modules beside it
    it is a package of ``studies``: they are imported with a dot before their names.
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

        Raises
        ------
        InputError
            Workers for a study that runs in one process: only one whose ``run.py`` says
            ``WORKERS = True`` shares its tasks. Or a short form that would replace the study's own
            results.
        """
        function = self._function("study")
        if options.trials is not None and self._owns(options.out):
            raise InputError(
                f"{options.out} has the results of the study's own number of trials",
                hint="name another folder with --out",
                name="trials",
                value=options.trials,
            )
        if options.workers != Workers() and not getattr(self.load(), "WORKERS", False):
            raise InputError(
                f"{self.name} runs in one process",
                hint="leave --jobs and --scheduler out",
                name="jobs",
                value=options.workers.jobs,
            )
        return function(options)

    def plot(self, folder: Path) -> list[Path]:
        """Draw the figures of the tables in a folder.

        Raises
        ------
        InputError
            A table is not there.
        FileFormatError
            A table is damaged, or another than the study left there.
        """
        try:
            return list(self._function("plot")(folder))
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

    Raises
    ------
    InputError
        There is none: studies are no part of the installed package.
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

    Raises
    ------
    InputError
        There is none of that name; the hint has near ones.
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
