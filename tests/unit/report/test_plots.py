"""Figures of plans and results, by what they are made of."""

from itertools import combinations

import numpy as np
import pytest
from defusedxml import ElementTree
from matplotlib.figure import Figure

import posedesign
from calib.errors import InputError
from calib.identification.prior_arms import PriorArms
from calib.robot_world import solve
from calib.se3 import rotation_exp, transform
from posedesign.cell.reference import reference_of
from posedesign.cell.task_box import BoxAccuracy, TaskBox, predict_box
from posedesign.identification.file import IdentificationFile
from posedesign.report import figures
from posedesign.report.pairs import figure_of_pairs
from posedesign.report.plots import (
    errors_of_fewer,
    figure_of_identification,
    figure_of_plan,
    figure_of_sigmas,
    plot,
)


def lines_of(figure, label: str) -> np.ndarray:
    """Values of the line with a label, all panels looked at."""
    (line,) = (
        line for panel in figure.get_axes() for line in panel.lines if line.get_label() == label
    )
    return np.asarray(line.get_xydata())


def panels(figure) -> list:
    return list(figure.get_axes())


def test_errors_of_fewer_are_those_of_all_subsets():
    rng = np.random.default_rng(4)
    white, functions = rng.normal(size=(7, 2, 3)), rng.normal(size=(4, 3, 3))

    def error(rows) -> float:
        J = white[list(rows)].reshape(-1, 3)
        C = np.linalg.inv(J.T @ J)
        return float(np.sqrt(np.mean([np.trace(f @ C @ f.T) for f in functions])))

    first, best = errors_of_fewer(white, functions)
    assert np.isnan(first[0])
    assert first[1:] == pytest.approx([error(range(k)) for k in range(2, 8)])
    least = [min(map(error, combinations(range(7), k))) for k in range(2, 8)]
    assert best[-2:] == pytest.approx(least[-2:])
    assert (best[1:] >= np.array(least) * (1.0 - 1e-12)).all()
    assert (best[1:] <= first[1:] * (1.0 + 1e-12)).all()


def test_a_plan_shows_its_error_by_poses_and_over_the_box(demo_cell):
    plan, arms = posedesign.plan(demo_cell), reference_of(demo_cell)
    figure = figure_of_plan(demo_cell, arms, plan.postures)
    first = lines_of(figure, "the first poses of the tour")
    best = lines_of(figure, "the best of these poses")
    assert first[:, 0].tolist() == list(range(1, 28))
    assert best[-1] == pytest.approx(first[-1])
    numbers = [text.get_text() for panel in panels(figure)[1:3] for text in panel.texts]
    assert len(numbers) == 18
    assert len(panels(plot(plan))) == 2


def test_a_plan_of_which_nothing_is_known_has_no_empty_panel(demo_cell):
    """Poses that tell too little have no error, by their number nor over the box."""
    arms = PriorArms(demo_cell.model())  # nothing is known beforehand
    q = demo_cell.base_posture + np.random.default_rng(0).normal(size=(12, 6)) * 0.2
    assert len(panels(figure_of_plan(demo_cell, arms, q))) == 4
    assert figure_of_plan(demo_cell, arms, q[:2]) is None
    assert figure_of_sigmas(arms.model, q[:2]) is None


def test_a_map_shows_the_largest_of_points_behind_each_other_and_those_out_of_reach():
    box = TaskBox([0.0, 0.0, 0.0], [1.0, 1.0, 1.0], (2, 1, 2))
    figure = figures.new_figure()
    error = np.array([1e-3, np.nan, 3e-3, 2e-3])
    figures.error_over_box(figure, box.points_m, error)
    above, side = (sorted(t.get_text() for t in panel.texts) for panel in panels(figure)[:2])
    assert above == ["1", "3"]
    assert side == ["1", "2", "3", "out of\nreach"]


def test_figures_of_results(demo_cell):
    model = demo_cell.model()
    box = TaskBox([1.7, -0.1, 0.4], [2.0, 0.1, 0.6])
    found = predict_box(demo_cell, PriorArms(model), 1e4 * np.eye(model.p)[None], box)
    assert isinstance(found, BoxAccuracy)
    assert len(panels(plot(found))) == 3
    rng = np.random.default_rng(3)
    A = transform(rotation_exp(rng.normal(size=(12, 3))), 0.5 * rng.normal(size=(12, 3)))
    X, Z = transform(rotation_exp(rng.normal(size=(2, 3))), 0.3 * rng.normal(size=(2, 3)))
    B = np.linalg.inv(Z) @ A @ X @ transform(rotation_exp(1e-3 * rng.normal(size=(12, 3))), 0)
    result = solve(A, B, "shah")
    drawn = [panel.lines[0].get_ydata() for panel in panels(plot(result))]
    np.testing.assert_allclose(drawn[0], 1e3 * result.residual_translation_m)
    np.testing.assert_allclose(drawn[1], np.rad2deg(result.residual_rotation_rad))
    with pytest.raises(InputError, match="no figure of a dict"):
        plot({})


def test_residuals_before_and_after_with_outliers_named():
    def fitted(name: str, mm: list[float]) -> dict:
        rows = [{"pose": f"P{k}", "mm": v, "outlier": v > 5.0} for k, v in enumerate(mm)]
        return {"name": name, "residuals": rows}

    content = IdentificationFile.model_validate(
        {
            "models": [fitted("frames only", [1.0, 2.0, 3.0]), fitted("all", [0.1, 0.2, 9.0])],
            "joints": ["a", "b"],
            "recommended": "all",
        }
    )
    figure = figure_of_identification(content, np.zeros((3, 2)))
    assert figure is not None
    top, *joints = panels(figure)
    assert lines_of(figure, "frames only: median 2")[:, 1].tolist() == [1.0, 2.0, 3.0]
    assert lines_of(figure, "all: median 0.2")[:, 1].tolist() == [0.1, 0.2, 9.0]
    assert [text.get_text() for text in top.texts] == ["P2"]
    assert [panel.get_xlabel() for panel in joints] == ["a [deg]", "b [deg]"]
    without = figure_of_identification(content, None)
    assert without is not None
    assert len(panels(without)) == 1


def test_methods_beside_the_first_refused_ones_are_named():
    def answer(method: str, status: str = "ok", x_mm: float = 0.0) -> dict:
        place = {f"x_{axis}": 0.0 for axis in ("y_mm", "z_mm", "w_deg", "p_deg", "r_deg")}
        sigma = {f"sigma_x_{a}_mm": 0.1 for a in "xyz"}
        sigma |= {f"sigma_x_r{a}_deg": "0.02" for a in "xyz"}
        return {"method": method, "status": status, "x_x_mm": str(x_mm), **place, **sigma}

    each = [
        {"method": "ml", "pose": "P1", "used": "yes", "residual_mm": 0.2, "residual_deg": 0.1},
        {"method": "ml", "pose": "P2", "used": "no", "residual_mm": 7.0, "residual_deg": 0.3},
        {"method": "shah", "pose": "P1", "used": "yes", "residual_mm": 0.2, "residual_deg": 0.1},
    ]
    answers = [answer("ml"), answer("shah", x_mm=2.0), answer("li", "misfit")]
    figure = figure_of_pairs(answers, each)
    assert figure is not None
    *_, place, turn = panels(figure)
    assert [bar.get_width() for bar in place.patches[:1]] == [pytest.approx(2.0)]
    assert [label.get_text() for label in place.get_yticklabels()] == ["shah", "li"]
    assert [text.get_text().strip() for text in turn.texts] == ["no answer to be trusted"]
    assert figure_of_pairs([answer("ml", "misfit")], each) is None
    alone = figure_of_pairs(answers[:1], each)
    assert alone is not None
    assert len(panels(alone)) == 2


def test_a_name_with_an_escape_leaves_a_drawing_that_can_be_read():
    """XML has no such characters, and a browser shows nothing of a drawing with one."""
    figure = Figure()
    figure.suptitle("img\x1b[31m7.png")
    root = ElementTree.fromstring(figures.as_svg(figure))
    assert "img\ufffd[31m7.png" in "".join(root.itertext())
