"""Where the target is, where the tool points to, and what is described to meet there."""

import numpy as np
import pytest

from calib.errors import FileFormatError
from posedesign.cell import Cell

PIN = """[robot]
preset = "ur10e"
[tool]
point_mm = [0, 0, {point}]
[[tool.body]]
name = "pin"
kind = "cylinder"
radius_mm = 3
height_mm = 100
at_mm = [0, 0, 148]
[base_pose]
posture_deg = [0, -70, 90, -110, -90, 0]
{target}
[[obstacle]]
name = "table"
kind = "half-space"
at_mm = [0, 0, {table}]
[[obstacle]]
name = "reference pin"
kind = "cylinder"
radius_mm = 3
height_mm = 100
at_mm = {at_mm}
[constraints]
ignore = {ignore}
[plan]
retreat_mm = 50
{camera}
"""


def text(
    below_mm: float = 2.0,
    point: float = 200.0,
    target: str = "",
    camera: str = "",
    ignore: str = '[["pin", "reference pin"]]',
) -> str:
    """A cell of a pin that touches another, whose tip is so far below the target."""
    bare = '[robot]\npreset = "ur10e"\n[tool]\npoint_mm = [0, 0, 200]\n[base_pose]\n'
    found = Cell.from_text(bare + "posture_deg = [0, -70, 90, -110, -90, 0]\n")
    x, y, z = (1e3 * found.target_m).tolist()
    at_mm = [x, y, z - 50.0 - below_mm]
    return PIN.format(
        point=point, target=target, camera=camera, ignore=ignore, at_mm=at_mm, table=z - 300.0
    )


def test_target_tool_and_what_is_nearest_are_told():
    cell = Cell.from_text(text())
    seen = cell.whereabouts
    np.testing.assert_allclose(seen.target_m, seen.tool_m)
    assert seen.nearest is not None
    assert seen.nearest == (pytest.approx(2e-3, abs=1e-5), "reference pin")
    x, y, z = 1e3 * cell.target_m
    place = f"({x:.1f}, {y:.1f}, {z:.1f}) mm"
    assert seen.words == (
        f"T1 at {place} in base_link, 0.0 mm from the tool point at the base posture; "
        "nearest obstacle: reference pin, 2.0 mm"
    )


def at_mm_of(moved_mm: float) -> list[float]:
    """The target where it is usually, moved sideways."""
    return (1e3 * Cell.from_text(text()).target_m + [0.0, moved_mm, 0.0]).tolist()


def test_a_reference_pin_that_is_not_at_the_target_is_refused():
    said = "key obstacle: reference pin is 48 mm from the target"
    with pytest.raises(FileFormatError, match=said):
        Cell.from_text(text(below_mm=48.0))


def test_a_pin_that_does_not_end_at_the_tool_point_is_refused():
    target = f"[target]\nposition_mm = {at_mm_of(0.0)}"
    with pytest.raises(FileFormatError, match=r"key tool.body: pin is 48 mm from the tool point"):
        Cell.from_text(text(point=246.0, target=target))


def test_a_base_posture_that_does_not_touch_the_target_is_refused():
    """Both bodies end where they are to meet, but the taught posture is not there."""
    target = f"[target]\nposition_mm = {at_mm_of(30.0)}"
    x, y, z = at_mm_of(30.0)
    moved = text(target=target).replace(text().split("\nat_mm = ")[-1].split("\n")[0], "HERE")
    with pytest.raises(FileFormatError, match=r"key base_pose: .* is 30 mm from the target"):
        Cell.from_text(moved.replace("HERE", str([x, y, z - 52.0])))


@pytest.mark.parametrize(
    "changed",
    [
        {"below_mm": 10.0},  # described short, as by hand
        {"below_mm": 48.0, "camera": "[camera]"},  # a camera looks from afar
        {"below_mm": 48.0, "ignore": "[]"},  # nothing is said to touch
    ],
)
def test_what_need_not_touch_may_be_elsewhere(changed):
    Cell.from_text(text(**changed))  # type: ignore[arg-type]


@pytest.mark.parametrize("mesh", [False, True])
def test_an_obstacle_around_the_target_is_refused(mesh, tmp_path):
    cell = Cell.from_text(text())
    x, y, z = 1e3 * cell.target_m
    kind = "size_mm = [80, 80, 80]"
    if mesh:
        corners = 40.0 * np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
        faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        lines = [f"v {a} {b} {c}" for a, b, c in corners]
        lines += ["f " + " ".join(str(k + 1) for k in face) for face in faces]
        (tmp_path / "box.obj").write_text("\n".join(lines) + "\n")
        kind = 'kind = "mesh"\nmesh = "box.obj"'
    box = f'[[obstacle]]\nname = "case"\n{kind}\nat_mm = [{x}, {y}, {z}]\n'
    with pytest.raises(FileFormatError, match="the target lies inside the obstacle 'case'"):
        Cell.from_text(text() + box, tmp_path / "cell.toml")
