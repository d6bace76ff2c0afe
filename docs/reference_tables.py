"""Hooks of mkdocs that fill the reference pages from the code: cell, files, commands.

A page has a comment where something is to stand: ``<!-- cell -->``, ``<!-- template -->``,
``<!-- commands -->``, or ``<!-- table of MODULE -->`` for the first table in its docstring.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import griffe
import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import Files
from mkdocs.structure.pages import Page
from plain_docstrings import plain_names

from posedesign.cell import cell_template
from posedesign.cell.schema import CellConfig
from posedesign.cli.main import app

ROOT = Path(__file__).parents[1]

_MARK = re.compile(r"^<!-- (cell|commands|template|table of ([\w.]+)) -->$", re.MULTILINE)
_TABLE = re.compile(r"^(=+ [= ]*=)\n(.*?)^\1\n?(?:(.*?)^\1\n?)?", re.MULTILINE | re.DOTALL)

_NO_BOUND = 1e6
"""Size from which on a bound only keeps nonsense out."""

_UNITS = {
    "urad_nm": "µrad/(N m)",
    "nm_per_rad": "N m/rad",
    "pulses_per_deg": "pulses/deg",
    "pulses_per_mm": "pulses/mm",
    "mm": "mm",
    "deg": "deg",
    "px": "px",
    "s": "s",
    "kg": "kg",
    "percent": "%",
    "nm": "N m",
    "grey": "grey levels",
}
"""By the end of a key."""


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Put the tables in place of the comments that ask for them."""

    def made(mark: re.Match[str]) -> str:
        if mark[2]:
            return table_of(importlib.import_module(mark[2]).__doc__ or "")
        if mark[1] == "template":
            return f"```toml\n{cell_template()}```"
        return "\n".join(cell_keys() if mark[1] == "cell" else commands())

    return _MARK.sub(made, markdown)


def table_of(docstring: str) -> str:
    """The first table of a docstring as Markdown."""
    table = _TABLE.search(docstring)
    if table is None:
        raise ValueError("there is no table in the docstring")
    return plain_names(_as_markdown(table))


def _as_markdown(table: re.Match[str]) -> str:
    spans = [m.span() for m in re.finditer(r"=+", table[1])]
    ends = [start for start, _ in spans[1:]] + [None]

    def cells(line: str) -> list[str]:
        return [line[a:b].strip() for (a, _), b in zip(spans, ends, strict=True)]

    head = cells(table[2].rstrip("\n")) if table[3] else ["column", "meaning"]
    rows: list[list[str]] = []
    for line in (table[3] or table[2]).splitlines():
        if line[:1] not in ("", " "):
            rows.append(cells(line))
        else:
            more = cells(line)
            rows[-1] = [f"{a} {b}".strip() for a, b in zip(rows[-1], more, strict=True)]
    return "\n".join(_table(head, rows))


def _table(head: list[str], rows: list[list[str]]) -> Iterator[str]:
    yield f"| {' | '.join(head)} |"
    yield "|---" * len(head) + "|"
    for row in rows:
        yield f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |"


def commands() -> Iterator[str]:
    """Each command with what its ``--help`` says."""
    group = typer.main.get_command(app)
    yield from _of_group(group, "posedesign")


def _of_group(group: Any, path: str) -> Iterator[str]:
    context = group.make_context(path, [], resilient_parsing=True)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if hasattr(command, "list_commands"):
            yield from (f"## {path} {name}", "", command.help or "", "")
            yield from _of_group(command, f"{path} {name}")
        else:
            yield from _of_command(command, f"{path} {name}")


def _of_command(command: Any, path: str) -> Iterator[str]:
    context = command.make_context(path, [], resilient_parsing=True)
    usage = " ".join(command.get_usage(context).split()).removeprefix("Usage: ")
    yield from (f"## {path}", "", "```text", usage, "```", "", command.help or "", "")
    rows = []
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record is not None and "--help" not in parameter.opts:
            rows.append([f"`{record[0].strip()}`", _escaped(record[1])])
    yield from _table(["argument or option", "meaning"], rows)
    yield ""


def _escaped(text: str) -> str:
    """Text with its signs as they are: < > * _ mean something in Markdown."""
    return re.sub(r"([\\`*_<>])", r"\\\1", " ".join(text.split()))


def cell_keys() -> Iterator[str]:
    """Each section of a cell, with the keys that it may have."""
    schema = CellConfig.model_json_schema(by_alias=True)
    for name, field in schema["properties"].items():
        yield from _of_section(schema, name, field, name in schema["required"])


def _of_section(
    schema: Mapping[str, Any], path: str, field: Mapping[str, Any], needed: bool = False
) -> Iterator[str]:
    section, many = _section_of(schema, field)
    sign = f"[[{path}]]" if many else f"[{path}]"
    yield from (f"## `{sign}` {{ #{path.replace('.', '-')} }}", "")
    notes = ["May be repeated."] * many + ["Every cell has it."] * needed
    yield from (plain_names(section["description"]), "", *notes, "")
    rows, below = [], []
    for key, value in section["properties"].items():
        inner, _ = _section_of(schema, value)
        if inner and inner["title"] != "FrameSection":
            below.append((f"{path}.{key}", value))
            continue
        required = key in section.get("required", ())
        default = "required" if required else _shown(value.get("default"))
        rows.append(
            [
                f"`{key}`",
                f"{_kind(schema, value)} {_unit(key)}".strip(),
                default,
                meanings()[section["title"], key],
            ]
        )
    yield from _table(["key", "value", "default", "meaning"], rows)
    yield ""
    for inner_path, value in below:
        yield from _of_section(schema, inner_path, value)


def _section_of(
    schema: Mapping[str, Any], field: Mapping[str, Any]
) -> tuple[Mapping[str, Any], bool]:
    """The section that a field is, or lists; empty where it is a value."""
    for option in (field, *field.get("anyOf", ())):
        for given, many in ((option, False), (option.get("items", {}), True)):
            if "$ref" in given:
                return schema["$defs"][given["$ref"].rpartition("/")[2]], many
    return {}, False


def _unit(key: str) -> str:
    units = (unit for end, unit in _UNITS.items() if f"_{key}".endswith(f"_{end}"))
    return next((f"[{unit}]" for unit in units), "")


def _shown(value: object) -> str:
    if value is None or value == []:
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, str):
        return f'`"{value}"`'
    if isinstance(value, float):
        return f"`{value:g}`"
    if isinstance(value, list):
        return "`[" + ", ".join(_shown(item).strip("`") for item in value) + "]`"
    return f"`{value}`"


def _kind(schema: Mapping[str, Any], field: Mapping[str, Any]) -> str:
    """What a value may be, in words."""
    if "anyOf" in field:
        kinds = [_kind(schema, o) for o in field["anyOf"] if o.get("type") != "null"]
        return " or ".join(dict.fromkeys(kinds))
    if "$ref" in field or "allOf" in field:
        keys = _section_of(schema, field)[0]["properties"]
        return "{ " + ", ".join(f"`{key}`" for key in keys) + " }"
    if "enum" in field:
        return ", ".join(f'`"{value}"`' for value in field["enum"])
    if "const" in field:
        return f'`"{field["const"]}"`'
    kind = field.get("type")
    if kind == "array":
        items = field.get("prefixItems")
        if items:
            return f"{len(items)} × {_kind(schema, items[0])}"
        return f"list of {_kind(schema, field['items'])}" if "items" in field else "list"
    words = {"number": "number", "integer": "whole number", "boolean": "true or false"}
    return f"{words.get(str(kind), 'text')}{_bounds(field)}"


def _bounds(field: Mapping[str, Any]) -> str:
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    bounds = [
        f"{sign} {field[key]:g}"
        for key, sign in signs.items()
        if key in field and abs(field[key]) < _NO_BOUND
    ]
    return f" {', '.join(bounds)}" if bounds else ""


@cache
def meanings() -> dict[tuple[str, str], str]:
    """The text below each key in the schema, by class and key."""
    found = {}
    for module in ("schema", "schema_sections"):
        loaded = griffe.load(f"posedesign.cell.{module}", search_paths=[ROOT])
        for name, section in loaded.classes.items():
            for key, attribute in section.attributes.items():
                if attribute.docstring is not None:
                    said = " ".join(attribute.docstring.value.split())
                    found[name, key.rstrip("_")] = plain_names(said)
    return found
