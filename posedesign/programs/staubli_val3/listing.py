"""VAL 3 files as the strict validator sees them: a tree of elements with their lines.

This shares no code with the reader and the writer, so that a mistake in one of them shows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from defusedxml import ElementTree

NAMESPACE = "{http://www.staubli.com/robotics/VAL3"


@dataclass
class Node:
    """An element."""

    line: int
    tag: str
    attributes: dict[str, str]
    text: str = ""
    text_line: int = 0
    children: list[Node] = field(default_factory=list)

    def all(self, name: str) -> Iterator[Node]:
        """Elements of this name in it, at any depth, from the top."""
        waiting = [self]
        while waiting:
            node = waiting.pop()
            if node.tag.rpartition("}")[2] == name:
                yield node
            waiting.extend(reversed(node.children))


class _Tree:
    def __init__(self) -> None:
        self.parser = ElementTree.DefusedXMLParser(target=self, forbid_dtd=True)
        self.root: Node | None = None
        self.open: list[Node] = []

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        node = Node(self.parser.parser.CurrentLineNumber, tag, dict(attributes))
        if self.open:
            self.open[-1].children.append(node)
        self.root = self.root or node
        self.open.append(node)

    def end(self, tag: str) -> None:
        # the parser keeps text back until it ends: its first line is told from its last
        node = self.open.pop()
        node.text_line = self.parser.parser.CurrentLineNumber - node.text.count("\n")

    def data(self, text: str) -> None:
        self.open[-1].text += text

    def close(self) -> None:
        pass


def parsed(data: bytes) -> tuple[Node | None, int, str]:
    """Root of a file, or the line and what is wrong with it as XML. Never fails.

    Whatever is in the file, the parser must not end a check: hence all exceptions.
    """
    tree = _Tree()
    try:
        tree.parser.feed(data)
        tree.parser.close()
    except Exception as error:
        return None, int(tree.parser.parser.CurrentLineNumber), str(error)[:200]
    return tree.root, 0, ""
