"""Doors of packages: what is behind one is loaded when it is first asked for.

A small command, and whoever imports one name, need not wait for all that a package holds.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module


def load_when_asked(package: str) -> Callable[[str], object]:
    """``__getattr__`` of a package whose names are the imports that its type checker is shown.

    They stand once, below ``if TYPE_CHECKING:``; its ``else:`` calls this, and ``__all__`` follows
    from them. No name may be that of a module of the package, which takes its place as soon as it
    is loaded.
    """

    def load(name: str) -> object:
        if name == "__all__":
            return list(_origins(package))
        origin = _origins(package).get(name)
        if origin is None:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        if origin == package:
            return import_module(f"{package}.{name}")
        found = getattr(import_module(origin), name)
        setattr(sys.modules[package], name, found)
        return found

    return load


@cache
def _origins(package: str) -> dict[str, str]:
    """The module that each name behind a door is imported from."""
    import ast
    from pkgutil import get_data

    source = ast.parse(get_data(package, "__init__.py") or b"")
    conditions = [node for node in source.body if isinstance(node, ast.If)]
    return {
        alias.name: str(line.module)
        for condition in conditions
        for line in condition.body
        if isinstance(line, ast.ImportFrom)
        for alias in line.names
    }
