"""Hooks of mkdocs that make one site of pages that stand in different places of the repository.

README.md is the home page; the studies with their figures and CHANGELOG.md are pages, too. No page
is copied: each is written for the repository, where its links lead from file to file, and the same
links are turned here into those of the site.
"""

from __future__ import annotations

import posixpath
import re
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import get_plugin_logger
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
DOCS = "docs/"
OUTSIDE = ("README.md", "CHANGELOG.md", "studies/README.md", "studies/*/README.md")

_LOG = get_plugin_logger("site")
_LINK = re.compile(r"(?P<image>!?)\[(?P<text>(?:[^\[\]]|\[[^\]]*\])*)\]\((?P<to>[^()\s:]+)\)")
_FETCHED = re.compile(r"<(?!a\b)[^>]*?(?:src|href)=[\"']?((?:https?:)?//[^\"'\s>]+)")
_STUDY = re.compile(r"studies/(\d+)_")
_FENCE = re.compile(r"^\s*(```|~~~)")
_BLOCK = re.compile(r"(- |\* |\d+\. |\|)")


def on_config(config: MkDocsConfig) -> None:
    """Put the pages that there are in place of each pattern of the navigation."""
    pages = [path.removeprefix(DOCS) for path in _found(f"{DOCS}**/*.md")]
    config.nav = _filled(config.nav, [*pages, *_outside()])


def on_files(files: Files, config: MkDocsConfig) -> None:
    """Add pages that stand outside the folder of the documentation, and the figures in them."""
    figures = {
        posixpath.join(posixpath.dirname(page), link["to"])
        for page in _outside()
        for link in _LINK.finditer((ROOT / page).read_text(encoding="utf-8"))
        if link["image"] and not link["to"].startswith(DOCS)
    }
    for path in (*_outside(), *sorted(figures)):
        files.append(File.generated(config, path, abs_src_path=str(ROOT / path)))


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn links between files of the repository into links between pages of the site."""
    number = _STUDY.match(page.file.src_uri)
    if number:
        markdown = markdown.replace("# ", f"# {number[1]}. ", 1)
    return spaced(relinked(markdown, page.file.src_uri, files))


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> None:
    """Say where a page would load something from the network."""
    for found in _FETCHED.finditer(output):
        _LOG.warning("%s loads %s", page.file.src_uri, found[1])


def relinked(markdown: str, page: str, files: Files) -> str:
    """The text of a page with its links as they are in the site.

    A link to a file that is no part of the site, source code say, becomes its text.
    """
    here = page if page in _outside() else DOCS + page

    def in_site(link: re.Match[str]) -> str:
        path, mark, anchor = link["to"].partition("#")
        if not path:
            return link[0]
        target = posixpath.normpath(posixpath.join(posixpath.dirname(here), path))
        uri = target.removeprefix(DOCS)
        if files.get_file_from_path(uri) is None:
            is_source = not link["image"] and (ROOT / target).exists()
            return link["text"] if is_source else link[0]
        to = posixpath.relpath(uri, posixpath.dirname(page) or ".")
        return f"{link['image']}[{link['text']}]({to}{mark}{anchor})"

    return _LINK.sub(in_site, markdown)


def spaced(markdown: str) -> str:
    """The same with an empty line before each list and table: Python-Markdown wants one."""
    out: list[str] = []
    fenced, last = False, ""
    for line in markdown.split("\n"):
        if _FENCE.match(line):
            fenced = not fenced
        elif not fenced and _BLOCK.match(line) and last.strip() and not _BLOCK.match(last.lstrip()):
            out.append("")
        out.append(line)
        last = line
    return "\n".join(out)


def _outside() -> list[str]:
    return [path for pattern in OUTSIDE for path in _found(pattern)]


def _found(pattern: str) -> list[str]:
    return sorted(path.relative_to(ROOT).as_posix() for path in ROOT.glob(pattern))


def _filled(nav: Any, pages: list[str]) -> Any:
    if isinstance(nav, dict):
        filled = {title: _filled(item, pages) for title, item in nav.items()}
        return {title: item for title, item in filled.items() if item}
    if isinstance(nav, list):
        items = []
        for item in nav:
            if isinstance(item, str) and "*" in item:
                items += [page for page in pages if fnmatch(page, item) and page not in items]
            else:
                items.append(_filled(item, pages))
        return [item for item in items if item]
    return nav
