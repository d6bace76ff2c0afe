"""JSON that goes in: hostile until a model of what it holds has read it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from calib.errors import FileFormatError
from posedesign.files.csv_tables import LARGEST_NUMBER, load_json
from posedesign.files.safe import read_bytes_bounded

LARGEST_JSON_BYTES = 20_000_000
"""Ten models of a hundred parameters and a thousand measurements are three megabytes."""

Text = Annotated[str, Field(strict=True, min_length=1)]
Number = Annotated[float, Field(strict=True, ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)]


class ReadFromFile(BaseModel):
    """What is read of a file of others; keys that are not known do not matter."""

    model_config = ConfigDict(frozen=True)


M = TypeVar("M", bound=BaseModel)


def read_json(path: Path, what: type[M], hint: str) -> M:
    """Read a JSON file that holds what a pydantic model says; ``hint``: who writes such files."""
    data = read_bytes_bounded(path, most_bytes=LARGEST_JSON_BYTES)
    try:
        return what.model_validate(load_json(data))
    except UnicodeDecodeError as error:
        raise FileFormatError(
            "is not UTF-8 text", path=path, hint="is it the right file?"
        ) from error
    except ValidationError as error:
        first = error.errors()[0]
        negative = first.get("ctx") == {"ge": 0.0}
        raise FileFormatError(
            "is below zero" if negative else _IN_WORDS.get(first["type"], first["msg"]),
            path=path,
            key=".".join(map(str, first["loc"])) or None,
            hint=hint,
        ) from error
    except ValueError as error:
        raise FileFormatError(
            f"is no valid JSON: {str(error).splitlines()[0][:100]}", path=path, hint=hint
        ) from error


_IN_WORDS = {
    "missing": "is missing",
    "string_type": "is no text",
    "string_too_short": "is no text",
    "list_type": "is no list",
    "tuple_type": "is no list",
    "dict_type": "is no table of keys",
    "model_type": "is no table of keys",
    "too_long": "is too long a list",
    **dict.fromkeys(
        ("float_type", "greater_than_equal", "less_than_equal"),
        f"is not a finite number within {LARGEST_NUMBER:g}",
    ),
}
"""What is wrong with a key, by the names that pydantic has for it."""
