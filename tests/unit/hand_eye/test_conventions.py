"""Conventions of poses: each against scipy, the words that say them, and the makers' own."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.errors import InputError
from posedesign.hand_eye.conventions import (
    MAKERS,
    READERS,
    Convention,
    check_labels,
    convention_of,
    named,
    same_count,
)
from posedesign.programs import notation

ORDERS = ["".join(o) for o in itertools.product("xyz", repeat=3) if o[0] != o[1] != o[2]]
ANGLES = np.random.default_rng(0).uniform(-3.0, 3.0, (5, 3))


@pytest.mark.parametrize("order", ORDERS)
def test_euler_angles_of_all_orders(order):
    moving = Rotation.from_euler(order.upper(), ANGLES).as_matrix()
    np.testing.assert_allclose(READERS[f"{order}-moving"](ANGLES), moving, atol=1e-12)
    fixed = Rotation.from_euler(order, ANGLES).as_matrix()
    np.testing.assert_allclose(READERS[f"{order}-fixed"](ANGLES), fixed, atol=1e-12)


@pytest.mark.parametrize("order", ["xzy", "yxz", "yzx", "zxy"])
def test_angles_in_the_order_of_their_axes(order):
    """The numbers are rx, ry, rz, whichever of them turns first."""
    in_order = ANGLES[:, ["xyz".index(axis) for axis in order]]
    expected = Rotation.from_euler(order.upper(), in_order).as_matrix()
    found = READERS[f"{order}-moving-of-rxryrz"](ANGLES)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_others_against_scipy():
    R = Rotation.from_rotvec(ANGLES)
    others = {
        "rotation-vector": R.as_rotvec(),
        "quaternion-wxyz": R.as_quat(scalar_first=True),
        "quaternion-xyzw": R.as_quat(),
        "matrix": R.as_matrix().reshape(-1, 9),
        "matrix-by-columns": np.swapaxes(R.as_matrix(), 1, 2).reshape(-1, 9),
    }
    for name, numbers in others.items():
        np.testing.assert_allclose(READERS[name](numbers), R.as_matrix(), atol=1e-12)


def test_no_two_are_one():
    """Else a person is told of two conventions that are the same."""
    for count in (3, 4, 9):
        numbers = np.eye(9)[:1].repeat(5, 0) if count == 9 else ANGLES
        if count == 4:
            numbers = Rotation.from_rotvec(ANGLES).as_quat()
        if count == 9:
            numbers = Rotation.from_rotvec(ANGLES).as_matrix().reshape(-1, 9)
        found = [READERS[name](numbers) for name in same_count(count)]
        for one, other in itertools.combinations(found, 2):
            assert np.abs(one - other).max() > 1e-3


@pytest.mark.parametrize(
    ("word", "turn"),
    [
        ("fanuc-wpr", notation.WPR),
        ("kuka-abc", notation.ABC),
        ("staubli-rxryrz", notation.MOVING_XYZ),
        ("abb-quaternion", notation.QUATERNION),
        ("ur-rotation-vector", notation.VECTOR),
    ],
)
def test_makers_are_those_of_their_programs(word, turn):
    numbers = np.array([turn.numbers(R) for R in Rotation.from_rotvec(ANGLES).as_matrix()])
    said = MAKERS[word]
    assert (said.angle == "deg") == turn.in_deg
    radians = np.deg2rad(numbers) if turn.in_deg else numbers
    found = READERS[said.turn](radians)
    np.testing.assert_allclose(found, Rotation.from_rotvec(ANGLES).as_matrix(), atol=1e-9)


def test_words():
    assert convention_of("kuka-abc") == Convention("zyx-moving", "deg", "mm")
    assert convention_of("KUKA-ABC, m , rad") == Convention("zyx-moving", "rad", "m")
    assert convention_of("quaternion-xyzw,inverse").inverse
    assert convention_of(convention_of("zxz-fixed,deg,cm,inverse").words).words == (
        "zxz-fixed,deg,cm,inverse"
    )
    assert "kuka-abc" in named("zyx-moving")
    assert named("zxz-moving") == "zxz-moving"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("kuka-acb", "did you mean kuka-abc"),
        ("kuka-abc,fanuc-wpr", "says the orientation twice"),
        ("zyx-moving,feet", "'feet' is not known"),
        ("wxyz", "did you mean quaternion-wxyz?"),
        ("zyx", "did you mean zyx-moving or zyx-fixed?"),
        ("Axis Angle", "did you mean rotation-vector?"),
        ("kuka-abc,millimeters", "did you mean mm?"),
    ],
)
def test_words_that_are_not_known(words, said):
    with pytest.raises(InputError) as caught:
        convention_of(words)
    assert said in f"{caught.value} ({caught.value.hint})"


def test_numbers_that_are_named_after_axes():
    """The first angle of zyx-moving is about z: a column rx is not that."""
    check_labels("xyz-fixed", ("rx", "ry", "rz"))
    check_labels("zyx-moving", ("rz", "ry", "rx"))
    check_labels("zyx-moving", ("a", "b", "c"))
    check_labels("zyz-moving", ("rx", "ry", "rz"))
    with pytest.raises(InputError, match="about z, and it is called rx") as caught:
        check_labels("zyx-moving", ("rx", "ry", "rz"))
    assert "say xyz-fixed" in caught.value.hint
    with pytest.raises(InputError) as caught:
        check_labels("yzx-moving", ("rx", "ry", "rz"))
    assert "say yzx-moving-of-rxryrz" in caught.value.hint
