"""The text of a ``cell.toml``: read, checked against its schema, and written."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

from pydantic import ValidationError

from calib.errors import FileFormatError, near_names
from posedesign.cell.schema import CellConfig
from posedesign.cell.schema_sections import Section
from posedesign.files import read_bytes_bounded

LARGEST_CELL_BYTES = 1_000_000

_BARE_KEY = re.compile("[A-Za-z0-9_-]+")

_IN_WORDS = {
    "tuple_type": "should be a list in [ ]",
    "too_long": "has too many values",
    "model_type": "should be a table of keys",
    "string_pattern_mismatch": "has characters that are not allowed here, or in another order",
}
"""Pydantic's words for programmers, in words for people who write the file."""


def read_config(path: Path) -> CellConfig:
    """Read and check a ``cell.toml``.

    Raises
    ------
    FileFormatError
        The file is missing, no TOML, or a key in it is unknown, missing or out of bounds.
    """
    try:
        data = read_bytes_bounded(path, most_bytes=LARGEST_CELL_BYTES)
    except FileFormatError as error:
        error.hint = "make one with: posedesign new > cell.toml"
        raise
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError("is not UTF-8 text", path=path, hint="save it as UTF-8") from error
    return parse_text(text, path)


def parse_text(text: str, path: Path) -> CellConfig:
    """Check the text of a ``cell.toml``; ``path`` is named in errors."""
    try:
        raw = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # numbers too long, brackets nested too deep
        raise FileFormatError(
            f"is no valid TOML: {error}",
            path=path,
            hint="the cell, a .toml, comes first" if path.suffix != ".toml" else "mend the line",
        ) from error
    return parse_config(raw, path)


def parse_config(raw: dict[str, Any], path: Path) -> CellConfig:
    """Check the content of a ``cell.toml``; ``path`` is named in errors."""
    try:
        return CellConfig.model_validate(raw)
    except ValidationError as error:
        found = error.errors()
        # a mistyped name often makes another one missing: say the mistyped one
        first = next((e for e in found if e["type"] == "extra_forbidden"), found[0])
        key = ".".join(str(part) for part in first["loc"]).replace("other_targets.", "target.")
        raise FileFormatError(
            _reason(first),
            path=path,
            key=key or None,
            hint=_hint(first),
            value=first.get("input"),
        ) from error


def _reason(error: Any) -> str:
    kind, given = error["type"], error.get("input")
    if kind == "extra_forbidden":
        return "there is no such key"
    if kind == "missing":
        return "is missing"
    text = _IN_WORDS.get(kind) or error["msg"].removeprefix("Value error, ")
    shown = f", not {given!r:.60}" if isinstance(given, (int, float, str, bool)) else ""
    return f"{text[0].lower()}{text[1:]}{shown}"


def _hint(error: Any) -> str:
    where = [part for part in error["loc"] if isinstance(part, str)]
    if error["type"] == "extra_forbidden":
        section: Any = CellConfig
        for part in where[:-1]:
            section = _section_in(section.model_fields[part].annotation)
        known = [field.alias or name for name, field in section.model_fields.items()]
        return near_names(where[-1], known)
    return "posedesign new prints a commented example"


def _section_in(annotation: Any) -> Any:
    """The section that an annotation names, by itself, optional, or in a list."""
    options = [annotation, *get_args(annotation)]
    return next(o for o in options if isinstance(o, type) and issubclass(o, Section))


def cell_text(config: CellConfig, folder: Path, comment: str = "") -> str:
    """Text of a cell; what stands at its default is left out.

    Parameters
    ----------
    folder : Path
        That the paths in the cell are relative to; the text has them in full.
    comment : str
        Lines that stand at the top.
    """
    content = config.model_dump(exclude_defaults=True, exclude_none=True, by_alias=True)
    if "other_targets" in content:
        content["target"] = [content.get("target", {}), *content.pop("other_targets")]
    _in_full(content, folder)
    head = [f"# {line}".rstrip() for line in comment.splitlines()]
    return "\n".join([*head, *_table("", content)]) + "\n"


def _in_full(content: dict[str, Any], folder: Path) -> None:
    """Put the full paths of robot and meshes in place of those relative to the folder."""
    robot = content.get("robot", {})
    if "urdf" in robot:
        robot["urdf"] = str((folder / robot["urdf"]).resolve())
    if "srdf" in robot:
        robot["srdf"] = str((folder / robot["srdf"]).resolve())
    if "packages" in robot:
        robot["packages"] = [str((folder / name).resolve()) for name in robot["packages"]]
    for solid in (*content.get("tool", {}).get("body", ()), *content.get("obstacle", ())):
        for key in ("mesh", "scene"):
            if key in solid:
                solid[key] = str((folder / solid[key]).resolve())


def _table(name: str, content: Mapping[str, Any]) -> list[str]:
    """Lines of a table: its own keys first, then the tables in it."""
    lines, inner = [], []
    for key, value in content.items():
        key = key if _BARE_KEY.fullmatch(key) else _value(key)  # joints have names of their own
        path = f"{name}.{key}" if name else key
        if isinstance(value, Mapping):
            inner += ["", f"[{path}]", *_table(path, value)]
        elif _is_tables(value):
            for item in value:
                inner += ["", f"[[{path}]]", *_table(path, item)]
        else:
            lines.append(f"{key} = {_value(value)}")
    return lines + inner


def _is_tables(value: object) -> bool:
    return (
        isinstance(value, Sequence) and bool(value) and all(isinstance(v, Mapping) for v in value)
    )


def _value(value: object) -> str:
    """A value as TOML has it; a JSON string is a TOML string, but for DEL, which TOML escapes."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, float):
        return repr(value)  # the shortest that reads back as the same number
    if isinstance(value, Sequence):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    return str(value)
