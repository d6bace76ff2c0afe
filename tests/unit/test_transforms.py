"""Forms of a transform against scipy, and as ROS and URDF compose them."""

from __future__ import annotations

import json
import shlex

import numpy as np
import pytest
from defusedxml import ElementTree
from scipy.spatial.transform import Rotation

from posedesign.hand_eye.pairs.transforms import forms_of


@pytest.mark.parametrize("seed", range(5))
def test_all_forms_are_the_same_transform(seed):
    rng = np.random.default_rng(seed)
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    T[:3, 3] = rng.normal(size=3)
    forms = forms_of(T, "tool0", "camera")
    np.testing.assert_allclose(json.loads(forms["matrix [m]"]), T, atol=1e-8)
    numbers = [float(text) for text in forms["x y z [m], quaternion x y z w"].split(",")]
    np.testing.assert_allclose(numbers[:3], T[:3, 3], atol=1e-8)
    np.testing.assert_allclose(Rotation.from_quat(numbers[3:]).as_matrix(), T[:3, :3], atol=1e-8)
    words = shlex.split(forms["ROS 2"])[4:]
    given = dict(zip(words[::2], words[1::2], strict=True))
    assert [float(given[f"--{axis}"]) for axis in ("x", "y", "z")] == numbers[:3]
    assert [float(given[f"--q{axis}"]) for axis in "xyzw"] == numbers[3:]
    assert (given["--frame-id"], given["--child-frame-id"]) == ("tool0", "camera")
    origin = ElementTree.fromstring(forms["URDF"])  # rpy: about fixed x, y, z (urdf.org)
    rpy = [float(text) for text in origin.get("rpy", "").split()]
    np.testing.assert_allclose(Rotation.from_euler("xyz", rpy).as_matrix(), T[:3, :3], atol=1e-8)


def test_small_numbers_have_no_exponent():
    T = np.eye(4)
    T[0, 3] = -1e-12
    T[1, 3] = 2.5e-7
    assert forms_of(T, "a", "b")["x y z [m], quaternion x y z w"] == "0, 0.00000025, 0, 0, 0, 0, 1"
