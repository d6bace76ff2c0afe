"""Cells written as text: read back they are the same, whatever stands in them."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.robots import preset_names
from posedesign.cell import Cell, CellConfig, cell_template
from posedesign.cell.file import cell_text, parse_config, parse_text

WHERE = Path("cell.toml")


@pytest.mark.parametrize("name", preset_names())
def test_templates_come_back(name):
    config = Cell.from_text(cell_template(name)).config
    text = cell_text(config, Path("/cells"), "two\nlines")
    assert text.startswith("# two\n# lines\n")
    assert parse_text(text, WHERE) == config


@given(
    name=st.text(
        st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]), min_size=1, max_size=40
    ),
    numbers=st.tuples(*[st.floats(-1e6, 1e6)] * 3),
)
def test_names_and_numbers_come_back(name, numbers):
    config = CellConfig.model_validate(
        {
            "robot": {"preset": "irb120"},
            "tool": {"point_mm": numbers},
            "base_pose": {"posture_deg": (0.0,) * 6},
            "target": {"name": name},
        }
    )
    assert parse_text(cell_text(config, Path()), WHERE) == config


def test_paths_are_in_full(tmp_path):
    """The text may be put anywhere; what is in the folder of the cell is found from there."""
    raw = tomllib.loads(cell_template("irb120"))
    raw["robot"] = {"urdf": "arms/a.urdf"}
    raw["obstacle"] = [{"name": "jig", "kind": "mesh", "mesh": "jig.stl"}]
    back = parse_text(cell_text(parse_config(raw, WHERE), tmp_path), WHERE)
    assert back.robot.urdf == str(tmp_path.resolve() / "arms/a.urdf")
    assert back.obstacle[0].mesh == str(tmp_path.resolve() / "jig.stl")
    np.testing.assert_equal(back.tool.point_mm, raw["tool"]["point_mm"])
