"""The one interface that every controller's file format is written behind."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import ClassVar

from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram


class Dialect(ABC):
    """A controller's program format: one subclass, in one file, a controller.

    Attributes
    ----------
    name : str
        What a user calls it, e.g. ``fanuc-ls``.
    maker : str
        Whose controllers read it, a key of ``calib.robots.POSITIVE_AXES``.
    suffixes : tuple of str
        Endings of its files in lower case, the usual one first, e.g. ``.ls``.
    """

    name: ClassVar[str]
    maker: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]]

    @abstractmethod
    def write(self, program: PoseProgram, path: Path) -> None:
        """Write the program for this controller.

        Raises
        ------
        InputError
            The program cannot be said in this dialect.
        OutputError
            The file cannot be written.
        """

    @abstractmethod
    def read(self, path: Path) -> RecordedProgram:
        """Read a program of this controller, tolerant of what controllers export.

        Raises
        ------
        FileFormatError
            The file is not such a program, or holds no joint positions.
        """

    @abstractmethod
    def validate(self, path: Path) -> list[Problem]:
        """Check a file strictly against the controller's rules; an empty list is a good file.

        Raises
        ------
        FileFormatError
            The file cannot be opened or is far too large.
        """
