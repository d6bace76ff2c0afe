"""Hooks of mkdocs that make a notebook of each tutorial, to be downloaded beside it.

The page is the only source. Python is a cell as it stands, commands are lines after ``!``, a file
whose name its first line says is written, and where the page has a figure that a command makes, the
notebook opens the one that it has made. What commands printed stays in the text.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

TUTORIALS = "tutorials/*.md"

_PIECE = re.compile(
    r"^```(?P<language>\w+)\n(?P<code>.*?)^```\n|^!\[[^\]]*\]\((?P<picture>[^)]+)\)\n",
    re.MULTILINE | re.DOTALL,
)
_FILE = re.compile(r"# (\S+\.\w+)\n")
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((?!https?:)[^)]+\)")


def on_files(files: Files, config: MkDocsConfig) -> None:
    """Add the notebooks to the files of the site."""
    from mkdocs.structure.files import File

    for file in list(files.documentation_pages()):
        path = PurePosixPath(file.src_uri)
        if path.match(TUTORIALS):
            text = json.dumps(notebook_of(file.content_string, path.stem), indent=1) + "\n"
            uri = str(path.with_suffix(".ipynb"))
            files.append(File.generated(config, uri, content=text))


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Say below the heading of a tutorial where its notebook is."""
    path = PurePosixPath(page.file.src_uri)
    if not path.match(TUTORIALS):
        return markdown
    heading, _, rest = markdown.partition("\n")
    return f"{heading}\n\n[This page as a notebook]({path.stem}.ipynb)\n\n{rest}"


def notebook_of(page: str, stem: str) -> dict[str, Any]:
    """The notebook (nbformat 4.4) of a tutorial.

    Parameters
    ----------
    page : str
        Text of the tutorial, with the commands and files that it has.
    stem : str
        Name of the page without its ending, and of the folder of its figures: below it they have
        the paths that the commands write them to.
    """
    metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    return {
        "nbformat": 4,
        "nbformat_minor": 4,
        "metadata": metadata | {"language_info": {"name": "python"}},
        "cells": list(_cells(page, stem)),
    }


def _cells(page: str, stem: str) -> Iterator[dict[str, Any]]:
    text, end = "", 0
    for piece in _PIECE.finditer(page):
        text += page[end : piece.start()]
        end = piece.end()
        code = _code(piece, stem)
        if code:
            yield from _text_cell(text)
            yield _cell("code", code) | {"execution_count": None, "outputs": []}
            text = ""
        elif piece["code"] is not None:
            text += piece[0]
    yield from _text_cell(text + page[end:])


def _code(piece: re.Match[str], stem: str) -> str:
    """What a piece of the page does; empty where it is there to be read."""
    if piece["picture"]:
        made = piece["picture"].partition(f"{stem}/")[2]
        return f'from PIL import Image\n\nImage.open("{made}").copy()' if made else ""
    code = piece["code"].rstrip("\n")
    if piece["language"] == "python":
        return code
    if piece["language"] == "bash":
        return "\n".join(
            f"!{line}" if line[:1] not in ("#", "") else line for line in code.split("\n")
        )
    file = _FILE.match(code) if piece["language"] == "toml" else None
    return f"%%writefile {file[1]}\n{code}" if file else ""


def _text_cell(text: str) -> Iterator[dict[str, Any]]:
    """The text, if there is any; links to other pages lead nowhere from a notebook."""
    if text.strip():
        yield _cell("markdown", _LINK.sub(r"\1", text.strip("\n")))


def _cell(kind: str, source: str) -> dict[str, Any]:
    return {"cell_type": kind, "metadata": {}, "source": source.splitlines(keepends=True)}
