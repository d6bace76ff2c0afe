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
from posedesign.files.trees import number, read_tree
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

    Raises FileFormatError, InputError: it describes none that can be found here.
    """
    path = Path(target)
    if "=" not in target or path.exists():
        tree = read_tree(path)
        finder = tree.get("target_finder") if isinstance(tree, dict) else None
        return _rct_board(path, finder) if isinstance(finder, dict) else kalibr_board(path)
    keys: dict[str, Any] = {}
    for part in target.split(","):
        key, mark, value = (word.strip() for word in part.partition("="))
        if not mark or not value:
            raise InputError(
                f"`target` {part!r} is no key with a value",
                hint="write kind=chessboard,columns=10,rows=7,square_mm=18, say",
                name="target",
            )
        whole = number(value)
        is_number = whole == whole
        is_count = is_number and whole % 1 == 0 and not key.endswith("_mm")
        keys[key] = value in ("true", "yes") if key == "legacy" else value
        if is_number:
            keys[key] = int(whole) if is_count else whole
    raw = tomllib.loads(cell_template(surroundings=False)) | {"board": keys}
    file = Path("--target")
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
