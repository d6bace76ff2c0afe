"""``cell.toml``: what may stand in it, and that nothing else gets past."""

import copy
import tomllib
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calib.errors import CalibError, FileFormatError
from calib.model.parameters.gravity import gravity_torque
from posedesign.cell import Cell, CellConfig, cell_template
from posedesign.cell import file as config
from posedesign.cell.file import _section_in, parse_config, parse_text, read_config
from posedesign.cell.models import payloads_of

WHERE = Path("some/cell.toml")
EXAMPLE = tomllib.loads(cell_template())
KEYS = [
    (section, key) for section, keys in EXAMPLE.items() if section != "obstacle" for key in keys
]


def test_defaults_are_those_of_the_example():
    """What the example says of a key is what happens without it."""
    least = {
        "robot": {"preset": "r2000ic165f"},
        "tool": {"point_mm": EXAMPLE["tool"]["point_mm"]},
        "base_pose": EXAMPLE["base_pose"],
    }
    short, full = parse_config(least, WHERE), parse_config(EXAMPLE, WHERE)
    for section in ("variations", "plan", "measurement", "constraints", "touch_up"):
        assert getattr(short, section) == getattr(full, section), section
    cell = Cell.from_config(short, WHERE)
    written = Cell.from_config(full, WHERE)
    assert cell.offset_joints == written.offset_joints
    assert cell.tool_axes == written.tool_axes
    assert cell.robot.tip_frame == written.robot.tip_frame
    np.testing.assert_allclose(cell.target_m, written.target_m)
    np.testing.assert_allclose(cell.truth()[1][:6], written.truth()[1][:6], atol=1e-12)


def test_example_names_every_key():
    """A key that the example does not show is a key that nobody finds."""
    text = cell_template()
    # this stands in the example of a URDF
    elsewhere = {("robot", "urdf"), ("robot", "controller")}
    # one kind of solid is shown for all; the guide to the file has the others
    elsewhere |= {
        ("obstacle", key) for key in ("wpr_deg", "radius_mm", "height_mm", "mesh", "scale", "scene")
    }
    for name, field in CellConfig.model_fields.items():
        if name == "other_targets":  # further tables of the target's
            continue
        section: Any = _section_in(field.annotation)
        for key, entry in section.model_fields.items():
            if (name, key) not in elsewhere:
                shown = f"{entry.alias or key} = ", f"[[{name}.{key}]]", f"[{name}.{key}]"
                written = any(words in text for words in shown)
                assert written, f"{name}.{key}"


def test_units_are_millimetres_and_degrees(make_cell):
    cell = make_cell(
        tool={"point_mm": [100.0, 0.0, 250.0]},
        plan={"limit_margin_deg": 3.0},
        target={"position_mm": [1500.0, 0.0, 500.0]},
    )
    np.testing.assert_allclose(cell.tool_m, [0.1, 0.0, 0.25])
    np.testing.assert_allclose(cell.target_m, [1.5, 0.0, 0.5])
    assert cell.margin == pytest.approx(np.deg2rad(3.0))
    np.testing.assert_allclose(np.rad2deg(cell.base_posture), EXAMPLE["base_pose"]["posture_deg"])


def test_target_is_where_the_base_pose_puts_the_tool(reference_cell):
    T = reference_cell.robot.fk(reference_cell.base_posture)
    expected = T[:3, :3] @ reference_cell.tool_m + T[:3, 3]
    np.testing.assert_allclose(reference_cell.target_m, expected, atol=1e-12)


@pytest.mark.parametrize(("section", "key"), KEYS, ids=lambda word: word)
def test_mistyped_key_is_named_with_the_right_one(section, key):
    raw = copy.deepcopy(EXAMPLE)
    wrong = key[:-1] + "xx"
    raw[section][wrong] = raw[section].pop(key)
    with pytest.raises(FileFormatError) as caught:
        parse_config(raw, WHERE)
    assert f"{section}.{wrong}: there is no such key" in str(caught.value)
    assert key in caught.value.hint
    assert str(caught.value).startswith(str(WHERE))


@pytest.mark.parametrize("section", EXAMPLE)
def test_mistyped_section_is_named_with_the_right_one(section):
    raw = copy.deepcopy(EXAMPLE)
    raw[section + "s"] = raw.pop(section)
    with pytest.raises(FileFormatError) as caught:
        parse_config(raw, WHERE)
    assert f"{section}s: there is no such key" in str(caught.value)
    assert section in caught.value.hint


@pytest.mark.parametrize("section", ["robot", "tool", "base_pose"])
def test_missing_section(section):
    raw = {name: keys for name, keys in EXAMPLE.items() if name != section}
    with pytest.raises(FileFormatError, match=f"{section}: is missing"):
        parse_config(raw, WHERE)


def test_errors_carry_their_key_and_value():
    raw = copy.deepcopy(EXAMPLE)
    raw["measurement"]["three_sigma_mm"][1] = -0.5
    with pytest.raises(FileFormatError) as caught:
        parse_config(raw, WHERE)
    error = caught.value
    assert (error.key, error.value) == ("measurement.three_sigma_mm.1", -0.5)
    assert error.path == WHERE


def test_text_and_file_are_read_alike(tmp_path):
    path = tmp_path / "cell.toml"
    path.write_text(cell_template())
    assert read_config(path) == parse_text(cell_template(), path) == parse_config(EXAMPLE, path)
    path.write_bytes(b"\xef\xbb\xbf" + cell_template().replace("\n", "\r\n").encode())
    assert read_config(path) == parse_config(EXAMPLE, path)  # as Windows editors save it


def test_bad_text_is_a_known_error():
    with pytest.raises(FileFormatError, match="no valid TOML") as caught:
        Cell.from_text("[robot\n", "here.toml")
    assert caught.value.path == Path("here.toml")


def test_too_large_a_file(tmp_path, monkeypatch):
    path = tmp_path / "cell.toml"
    path.write_text(cell_template())
    monkeypatch.setattr(config, "LARGEST_CELL_BYTES", path.stat().st_size)
    assert read_config(path)
    monkeypatch.setattr(config, "LARGEST_CELL_BYTES", path.stat().st_size - 1)
    with pytest.raises(FileFormatError, match="is larger than"):
        read_config(path)


@pytest.mark.parametrize("name", ["none.toml", ".", "a\0b"])
def test_a_file_that_cannot_be_opened(tmp_path, name):
    with pytest.raises(FileFormatError, match="cannot be read") as caught:
        read_config(tmp_path / name)
    assert "posedesign new" in caught.value.hint


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    data=st.binary(max_size=200) | st.text(max_size=200).map(lambda t: t.encode("utf-8", "replace"))
)
def test_random_files_raise_nothing_but_known_errors(tmp_path, data):
    path = tmp_path / "cell.toml"
    path.write_bytes(data)
    with pytest.raises(CalibError):
        Cell.load(path)


plain = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
    | st.sampled_from(["x", "xy", "joint_2", "r2000ic165f", "tool0", "together", "view-line"])
)
values = plain | st.lists(plain, max_size=7) | st.lists(st.floats(), min_size=3, max_size=6)


@settings(max_examples=150)
@given(place=st.sampled_from(KEYS), value=values)
def test_any_value_anywhere_is_taken_or_refused(place, value):
    """No key lets a value through that breaks something later with an error of its own."""
    section, key = place
    raw = copy.deepcopy(EXAMPLE)
    raw[section][key] = value
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            cell = Cell.from_config(parse_config(raw, WHERE), WHERE)
            model = cell.model()
            cell.truth()
        except CalibError:
            pass
        else:
            assert np.isfinite(cell.tool_m).all()
            assert np.isfinite(cell.target_m).all()
            assert np.isfinite(model.nominal).all()


def test_a_payload_is_carried_besides_the_tool() -> None:
    cell = Cell.from_text(
        '[robot]\npreset = "ur10e"\n[base_pose]\nposture_deg = [0, -75, 100, -115, -90, 0]\n'
        "[tool]\npoint_mm = [0.0, 0.0, 100.0]\nmass_kg = 2.0\ncom_mm = [10.0, 0.0, 60.0]\n"
        '[[payload]]\nname = "weight"\nmass_kg = 8.0\ncom_mm = [0.0, 20.0, 120.0]\n'
    )
    robot = cell.robot
    model = robot.model.copy()
    tip = model.frames[model.getFrameId(robot.tip_frame)]
    for mass, com in ((2.0, [0.01, 0.0, 0.06]), (8.0, [0.0, 0.02, 0.12])):
        load = pin.Inertia(mass, np.array(com), np.zeros((3, 3)))
        model.appendBodyToJoint(tip.parentJoint, load, tip.placement)
    model.gravity.linear = robot.gravity
    torque = pin.computeGeneralizedGravity(model, model.createData(), cell.base_posture)
    found = gravity_torque(robot, cell.base_posture[None], payloads_of(cell)[1])
    np.testing.assert_allclose(found[0], -torque, atol=1e-9)
