"""Errors that say what is wrong, where it is, and what to do about it.

One family: everything that a user can put right derives from :class:`CalibError`. Its message is
one line, the remedy stands in ``hint``, and the offending ``name``, ``value`` and ``bound`` are
kept as attributes so that a program can act on them without parsing text.

Arguments that cannot be used raise :class:`InputError` wherever they are given; docstrings name
errors only where there is more to say of them.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from pathlib import Path


class CalibError(Exception):
    """Base of all errors that a user of the library can put right.

    Parameters
    ----------
    message : str
        What is wrong and where, in one line.
    hint : str
        What to do about it, in one line.
    name : str, optional
        The offending thing: a joint, a column, a key, a file.
    value, bound : object, optional
        The value found, and the bound it breaks.
    """

    def __init__(
        self,
        message: str,
        *,
        hint: str = "",
        name: str | None = None,
        value: object = None,
        bound: object = None,
    ) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.name = name
        self.value = value
        self.bound = bound

    def __reduce__(self) -> tuple[object, ...]:
        # the default calls the class with its message alone, which most subclasses do not take:
        # an error raised in a worker process would then be lost on its way back
        return _restore, (type(self), self.message, self.__dict__)

    def __str__(self) -> str:
        return f"{self.message} ({self.hint})" if self.hint else self.message


def _restore(kind: type[CalibError], message: str, attributes: dict[str, object]) -> CalibError:
    error = kind.__new__(kind, message)
    error.__dict__.update(attributes)
    return error


class InputError(CalibError):
    """A number, a shape or an option that cannot be used."""


class RobotModelError(CalibError):
    """A robot description that is missing, malformed or not a serial arm."""


def model_error(
    where: object, what: str, hint: str, name: str | None = None, **found: object
) -> RobotModelError:
    """Say what cannot be used in a description: a file, or a model by its name."""
    named = str(where) if name is None else name
    return RobotModelError(f"{where}: {what}", hint=hint, name=named, **found)


class UnreachableError(CalibError):
    """A pose that no posture inside the joint limits takes."""


class JointLimitError(CalibError):
    """A joint value outside its limits, all in the unit: mm for a joint that slides."""

    def __init__(
        self,
        joint: str,
        value: float,
        lower: float,
        upper: float,
        *,
        hint: str = "",
        unit: str = "deg",
    ) -> None:
        super().__init__(
            limit_reason(joint, value, lower, upper, unit),
            hint=hint,
            name=joint,
            value=value,
            bound=(lower, upper),
        )


class FileFormatError(CalibError):
    """A file whose content cannot be read as what it should be.

    Parameters
    ----------
    message : str
        What is wrong.
    path : Path or str
        The file.
    row : int, optional
        Line number in the file, counted from 1 as an editor shows it.
    column, key : str, optional
        Name of the column of a table, or of the key of a configuration.
    hint : str
        What to do about it.
    """

    def __init__(
        self,
        message: str,
        *,
        path: Path | str,
        row: int | None = None,
        column: str | None = None,
        key: str | None = None,
        hint: str = "",
        value: object = None,
        bound: object = None,
    ) -> None:
        place = str(path)
        if row is not None:
            place += f", line {row}"
        if column is not None:
            place += f", column {column}"
        if key is not None:
            place += f", key {key}"
        super().__init__(
            f"{place}: {message}",
            hint=hint,
            name=column or key or str(path),
            value=value,
            bound=bound,
        )
        self.path = Path(path)
        self.row = row
        self.column = column
        self.key = key


class OutputError(CalibError):
    """A file or folder that cannot be written."""


class NotIdentifiableError(CalibError):
    """Parameters that the measurements cannot tell apart, or cannot see at all.

    Parameters
    ----------
    parameters : sequence of str
        The parameters that would have to be left out.
    combinations : sequence of str
        In words, what each of them is mixed up with.
    hint : str, optional
        What to do about it, where that is not to leave the parameters out.
    """

    def __init__(
        self, parameters: Sequence[str], combinations: Sequence[str], *, hint: str = ""
    ) -> None:
        them = "it" if len(parameters) == 1 else "them"
        super().__init__(
            "these measurements cannot identify "
            + ", ".join(parameters)
            + ": "
            + "; ".join(combinations),
            hint=hint
            or f"leave {them} out of the parameters, or measure poses that move what hides {them}",
            name=parameters[0] if parameters else None,
        )
        self.parameters = tuple(parameters)
        self.combinations = tuple(combinations)


class ConvergenceError(CalibError):
    """An iteration that did not reach its tolerance."""


def limit_reason(joint: str, value: float, lower: float, upper: float, unit: str = "deg") -> str:
    """Say in words which limit a joint value breaks, e.g. ``J5 131.2 deg is above 125.0 deg``."""
    side, bound = ("above", upper) if value > upper else ("below", lower)
    # as many decimals as it takes to tell the two apart
    digits = next((d for d in range(1, 9) if round(value, d) != round(bound, d)), 9)
    return f"{joint} {value:.{digits}f} {unit} is {side} {bound:.{digits}f} {unit}"


def one_line(value: object) -> str:
    """A value for a message: its representation in one line, cut where it is long."""
    text = " ".join(repr(value).split())
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]} ... ({type(value).__name__})"


_SHOWN = 60
"""Characters of a value in a message."""


def check_type(value: object, kind: type | tuple[type, ...], name: str) -> None:
    """Refuse an argument that is of another kind."""
    if isinstance(value, kind):
        return
    kinds = kind if isinstance(kind, tuple) else (kind,)
    wanted = " or ".join(one.__name__ for one in kinds if one is not type(None))
    raise InputError(f"{name} is {one_line(value)}, not of type {wanted}", name=name)


def near_names(name: str, known: Iterable[str], *, most: int = 5) -> str:
    """Hint for a mistyped name: the nearest known ones, or all of them where none is near."""
    choices = list(known)
    near = difflib.get_close_matches(name.lower(), [c.lower() for c in choices], n=most, cutoff=0.5)
    picked = [c for n in near for c in choices if c.lower() == n]
    begun = [c for c in choices if len(name) > 1 and c.lower().startswith(name.lower())]
    picked = [*picked, *begun][:most]
    if picked:
        return "did you mean " + " or ".join(dict.fromkeys(picked)) + "?"
    return "known: " + ", ".join(choices[:30]) if choices else "there are none"
