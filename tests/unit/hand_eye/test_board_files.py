"""Boards that are described beside a cell: files of keys, and lengths in another unit."""

import json

import pytest

from calib.errors import CalibError
from posedesign.hand_eye.board_files import board_said

KEYS = {"kind": "chessboard", "inner_corners": [9, 6], "square_mm": 18}
YAML = "kind: chessboard\ninner_corners: [9, 6]\nsquare_mm: 18\n"
TOML = 'kind = "chessboard"\ninner_corners = [9, 6]\nsquare_mm = 18\n'


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("target.yaml", YAML),
        ("target.yml", "board:\n  " + YAML.replace("\n", "\n  ").rstrip(" ")),
        ("target.yaml", YAML.partition("\n")[2]),  # a board that only has corners is a chessboard
        ("target.json", json.dumps({"board": KEYS})),
        ("target.toml", TOML),
        ("cell.toml", f'[robot]\npreset = "ur5e"\n[board]\n{TOML}'),
        ("", "kind=chessboard,inner_corners=9x6,square_mm=18"),
        ("", "kind=chessboard,columns=10,rows=7,square_mm=18"),
    ],
)
def test_a_board_is_described_by_the_keys_of_a_cell(tmp_path, name, text):
    if name:
        (tmp_path / name).write_text(text)
    board = board_said(str(tmp_path / name) if name else text)
    assert board.words == "chessboard of 10 x 7 squares of 18 mm (9 x 6 inner corners)"
    assert len(board.points) == 54


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("", "kind=chessboard,columns=10,rows=7,square_mm=0.018", "metres: are 18 mm meant?"),
        ("t.yaml", YAML.replace("18", "0.018"), "metres: are 18 mm meant?"),
        ("t.yaml", YAML.replace("18", "18000"), "square_mm of the board is 18000 mm"),
        ("t.yaml", YAML.replace("9, 6", "9"), "t.yaml, key board.inner_corners.1: is missing"),
        ("t.toml", TOML.replace("]", ""), "t.toml: is no TOML: "),
        (
            "t.yaml",
            "target_type: checkerboard\ntargetCols: 9\ntargetRows: 6\n"
            "rowSpacingMeters: 18\ncolSpacingMeters: 18\n",
            "it looks like millimetres: are 18 mm meant?",
        ),
    ],
)
def test_what_is_wrong_with_a_description_is_said(tmp_path, name, text, said):
    if name:
        (tmp_path / name).write_text(text)
    with pytest.raises(CalibError) as raised:
        board_said(str(tmp_path / name) if name else text)
    assert said in str(raised.value)
