"""Files of keys, lists and words: YAML, JSON, and the three forms of OpenCV's persistence.

They become plain dictionaries, lists, texts and numbers. Nothing in them is run, and no number of
the file decides how much memory is taken: YAML without anchors, aliases and deep nesting
(:mod:`posedesign.files.yaml_tree`), JSON, XML without entities. OpenCV's own reader, which is
native code, gets no such file: a matrix in them is its rows, columns, kind and numbers.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError

import numpy as np
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from calib.errors import FileFormatError
from calib.se3 import FloatArray
from posedesign.files.csv_tables import load_json, number_of, usable
from posedesign.files.safe import read_bytes_bounded
from posedesign.files.yaml_tree import MOST_DEPTH, Fault, Node, Pairs, documents, text_of

LARGEST_TREE_BYTES = 20_000_000
"""Of samples of hand-eye calibrations: 20,000 pairs."""

_TAG = "!!opencv-matrix"


def read_tree(path: Path) -> Any:
    """What is in a file, as dictionaries, lists, texts and numbers.

    The first character tells the format: ``<`` for XML, ``{`` and ``[`` for JSON, all else is YAML.
    Numbers of YAML and XML stay texts: see :func:`number`.

    Raises FileFormatError: the file is missing, too large, none of these, or nested too deep.
    """
    data = read_bytes_bounded(path, most_bytes=LARGEST_TREE_BYTES)
    try:
        text = text_of(data).strip()
        if text.startswith("<"):
            return _of_element(fromstring(text.encode()), 0)
        if text.startswith(("{", "[")):
            return load_json(text)
        return _of_yaml(text)
    except Fault as fault:
        raise FileFormatError(fault.message, path=path, row=fault.line, hint=fault.hint) from fault
    except (ValueError, ParseError, DefusedXmlException) as error:
        raise FileFormatError(
            f"cannot be understood: {' '.join(str(error).split())[:200]}",
            path=path,
            hint="is it the right file?",
        ) from error


def _of_yaml(text: str) -> Any:
    if text.startswith("%YAML"):  # OpenCV writes a colon behind it, which is no YAML
        text = "#" + text
    found = [_plain(root) for root in documents(text.replace(_TAG, " " * len(_TAG)))]
    found = [root for root in found if root]  # ros2 topic echo ends with an empty one
    if len(found) != 1:
        raise Fault(f"holds {len(found)} documents", None, hint="keep one of them")
    return found[0]


def _plain(node: Node) -> Any:
    if isinstance(node.value, Pairs):
        return {str(key.value): _plain(value) for key, value in node.pairs("it")}
    if isinstance(node.value, list):
        return [_plain(item) for item in node.items("it")]
    return str(node.value)


def _of_element(element: Element, depth: int) -> Any:
    """The content of an element of OpenCV's XML, where the items of a list are called ``_``."""
    if depth > MOST_DEPTH:
        raise ValueError(f"nested more than {MOST_DEPTH} deep")
    inner = [(child.tag, _of_element(child, depth + 1)) for child in element]
    if not inner:
        return (element.text or "").strip().strip('"')
    if all(tag == "_" for tag, _ in inner):
        return [value for _, value in inner]
    if len({tag for tag, _ in inner}) < len(inner):
        raise ValueError(f"<{element.tag[:40]}> has two parts of one name")
    return dict(inner)


def number(value: object) -> float:
    """A value of a tree as a number; NaN where it is none, or beyond all bounds."""
    if isinstance(value, str):
        return number_of(value) if "," not in value else math.nan
    return usable(value)


def numbers(value: object, *shape: int) -> FloatArray | None:
    """Lists of a tree as an array of this shape; None where they are not that.

    Numbers may stand in one list, row by row; XML has them in one text.
    """
    flat: list[object] = [value]
    for _ in shape:
        flat = [part for item in flat for part in (item if isinstance(item, list) else [item])]
    if len(flat) == 1 and isinstance(flat[0], str):
        flat = list(flat[0].split())
    if len(flat) != math.prod(shape):
        return None
    found = np.array([number(item) for item in flat]).reshape(shape)
    return None if np.isnan(found).any() else found


def matrix(value: object) -> FloatArray | None:
    """A matrix of OpenCV as an array (rows, columns times channels); None where it is none."""
    if not isinstance(value, dict) or not {"rows", "cols", "dt", "data"} <= value.keys():
        return None
    kind = str(value["dt"]).strip('"')
    sizes = [number(size) for size in (value["rows"], value["cols"], kind[:-1] or "1")]
    if kind[-1:] not in ("d", "f") or not all(size >= 1 and size % 1 == 0 for size in sizes):
        return None
    rows, columns, channels = map(int, sizes)
    found = numbers(value["data"], rows * columns * channels)
    return None if found is None else found.reshape(rows, -1)
