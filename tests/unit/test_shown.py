"""Results in a notebook: short where printed, tables with units, no markup from files."""

from __future__ import annotations

import numpy as np
import pytest

from calib.robot_world import solve
from calib.se3 import rotation_exp, transform
from calib.shown import Shown


class Sample(Shown):
    @property
    def headline(self) -> str:
        return "a <b>bold</b> name"

    def rows(self) -> list[dict[str, object]]:
        return [{"value [mm]": k / 7} for k in range(1000)]


def test_what_a_notebook_shows_is_short_and_escaped():
    assert repr(Sample()) == "<Sample: a <b>bold</b> name>"
    shown = Sample()._repr_html_()
    assert "&lt;b&gt;" in shown
    assert "<b>" not in shown
    assert len(shown) < 10_000
    assert list(Sample().to_frame().columns) == ["value [mm]"]
    assert len(Sample().to_frame()) == 1000


def test_an_answer_of_axzb_as_a_table():
    rng = np.random.default_rng(3)
    A = transform(rotation_exp(rng.normal(size=(12, 3))), 0.5 * rng.normal(size=(12, 3)))
    X, Z = transform(rotation_exp(rng.normal(size=(2, 3))), 0.3 * rng.normal(size=(2, 3)))
    B = np.linalg.inv(Z) @ A @ X
    result = solve(A, B, "shah")
    frame = result.to_frame().set_index("transform")
    assert frame.loc["X", ["x_mm", "y_mm", "z_mm"]].to_numpy(float) == pytest.approx(
        1e3 * X[:3, 3], abs=1e-6
    )
    assert len(repr(result)) < 100
