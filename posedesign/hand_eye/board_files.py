"""Boards that are described beside a cell: files of other tools, or keys on the command line.

robot_cal_tools describes a target by ``target_finder`` with ``type``, ``rows``, ``cols`` and
lengths in m (its ``charuco_target_7x5.yaml`` and the data sheets of its target finders);
``dictionary`` is OpenCV's number of it.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from calib.errors import FileFormatError, InputError
from calib.vision.boards import Board, make_board
from posedesign.cell import Cell, cell_template
from posedesign.cell.file import parse_config
from posedesign.files.safe import read_bytes_bounded
from posedesign.files.trees import LARGEST_TREE_BYTES, number, read_tree
from posedesign.hand_eye.lens_files import kalibr_board

_RCT: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "CharucoGridTargetFinderPlugin": (
        "charuco",
        {"chessboard_dim": "square_m", "aruco_marker_dim": "marker_m"},
    ),
    "ArucoGridTargetFinderPlugin": ("aruco-grid", {"aruco_marker_dim": "marker_m"}),
}
"""Kinds of target of robot_cal_tools, and what its lengths are here."""


def cell_of(target: str) -> Cell:
    """Return a cell that has nothing but a board, for pictures with poses of a flange.

    Raises InputError: no board is described.
    """
    if not target:
        raise InputError(
            "no cell is given, and no board is described",
            hint="describe it with `target`, say kind=chessboard,columns=10,rows=7,square_mm=18; "
            "or give the cell, then the folder of pictures",
            name="target",
        )
    raw = tomllib.loads(cell_template(surroundings=False))
    path = Path("cell.toml")
    return Cell.from_config(parse_config(raw, path), path)


def board_said(target: str) -> Board:
    """Return the board of a file of Kalibr or robot_cal_tools, or of keys as in ``[board]``.

    The keys stand in the text, or in a file of YAML, JSON or TOML, with ``board`` above them or
    without. Raises FileFormatError, InputError: it describes none that can be found here.
    """
    path = Path(target)
    if "=" not in target or path.exists():
        tree = _read_toml(path) if path.suffix.casefold() == ".toml" else read_tree(path)
        top = tree if isinstance(tree, dict) else {}
        finder, keys = top.get("target_finder"), top.get("board", top)
        if isinstance(finder, dict):
            return _rct_board(path, finder)
        if isinstance(keys, dict) and ({"kind", "inner_corners"} & {*keys} or keys is not top):
            return _board_of_keys({key: _value(key, keys[key]) for key in keys}, path)
        return kalibr_board(path)
    found: dict[str, Any] = {}
    for part in target.split(","):
        key, mark, value = (word.strip() for word in part.partition("="))
        if not mark or not value:
            raise InputError(
                f"`target` {part!r} is no key with a value",
                hint="write kind=chessboard,columns=10,rows=7,square_mm=18, say",
                name="target",
            )
        found[key] = _value(key, value.split("x") if key == _CORNERS else value)
    return _board_of_keys(found, Path("--target"))


_CORNERS = "inner_corners"


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(read_bytes_bounded(path, most_bytes=LARGEST_TREE_BYTES).decode())
    except ValueError as error:  # of its words, or of its bytes
        raise FileFormatError(f"is no TOML: {error}", path=path, hint="correct it") from error


def _value(key: str, value: Any) -> Any:
    """Return a number, a truth or a word of a text, each item of a list alone."""
    if isinstance(value, list):
        return [_value(key, item) for item in value]
    if not isinstance(value, str):
        return value
    if key == "legacy":
        return value.casefold() in ("true", "yes")
    found = number(value)
    if found != found:  # no number
        return value
    return int(found) if found % 1 == 0 and not key.endswith("_mm") else found


def _board_of_keys(keys: dict[str, Any], file: Path) -> Board:
    """Return the board that keys as in ``[board]`` describe; ``file``: where they stand."""
    if _CORNERS in keys and "kind" not in keys:
        keys = {"kind": "charuco" if "marker_mm" in keys else "chessboard", **keys}
    raw = tomllib.loads(cell_template(surroundings=False)) | {"board": keys}
    board = Cell.from_config(parse_config(raw, file), file).board
    if board is None:
        raise InputError("`target` describes no board", name="target")
    return board


def _rct_board(path: Path, finder: Mapping[str, Any]) -> Board:
    """Return the board of robot_cal_tools."""
    word = str(finder.get("type", "")).rpartition("::")[2]
    if word not in _RCT:
        raise FileFormatError(
            f"has the target_finder {word[:60]!r}",
            path=path,
            key="target_finder",
            hint=f"known are {', '.join(_RCT)}",
        )
    kind, lengths = _RCT[word]
    names = ("rows", "cols", "dictionary", *lengths)
    if word.startswith("Aruco"):
        names = (*names, "marker_gap")
    found = {name: number(str(finder.get(name))) for name in names}
    bad = [
        k for k, v in found.items() if not v >= (0.0 if k in ("dictionary", "marker_gap") else 1e-6)
    ]
    if bad:
        raise FileFormatError(
            f"{str(finder.get(bad[0]))[:40]!r} is no number above zero", path=path, key=bad[0]
        )
    given: dict[str, Any] = {here: found[there] for there, here in lengths.items()}
    if "marker_gap" in found:
        given["spacing_m"] = found["aruco_marker_dim"] + found["marker_gap"]
    try:
        return make_board(
            kind,
            columns=int(found["cols"]),
            rows=int(found["rows"]),
            dictionary=_dictionary(path, int(found["dictionary"])),
            **given,
        )
    except InputError as error:
        raise FileFormatError(error.message, path=path, hint=error.hint) from error


def _dictionary(path: Path, value: int) -> str:
    """Return OpenCV's name of a dictionary by its number."""
    from cv2 import aruco

    names = [n for n in dir(aruco) if n.startswith("DICT_") and getattr(aruco, n) == value]
    if not names:
        raise FileFormatError(
            f"OpenCV has no dictionary {value}", path=path, key="dictionary", hint="10 is 6x6_250"
        )
    return names[0]
