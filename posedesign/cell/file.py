"""A cell as the text of a ``cell.toml``: for cells that a command has found out something of."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from posedesign.cell.schema import CellConfig


def cell_text(config: CellConfig, folder: Path, comment: str = "") -> str:
    """Text of a cell; what stands at its default is left out.

    Parameters
    ----------
    config : CellConfig
    folder : Path
        That the paths in the cell are relative to; the text has them in full.
    comment : str
        Lines that stand at the top.
    """
    content = config.model_dump(exclude_defaults=True, exclude_none=True, by_alias=True)
    _in_full(content, folder)
    head = [f"# {line}".rstrip() for line in comment.splitlines()]
    return "\n".join([*head, *_table("", content)]) + "\n"


def _in_full(content: dict[str, Any], folder: Path) -> None:
    """Put the full paths of robot and meshes in place of those relative to the folder."""
    robot = content.get("robot", {})
    if "urdf" in robot:
        robot["urdf"] = str((folder / robot["urdf"]).resolve())
    if "packages" in robot:
        robot["packages"] = [str((folder / name).resolve()) for name in robot["packages"]]
    for solid in (*content.get("tool", {}).get("body", ()), *content.get("obstacle", ())):
        if "mesh" in solid:
            solid["mesh"] = str((folder / solid["mesh"]).resolve())


def _table(name: str, content: Mapping[str, Any]) -> list[str]:
    """Lines of a table: its own keys first, then the tables in it."""
    lines, inner = [], []
    for key, value in content.items():
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
