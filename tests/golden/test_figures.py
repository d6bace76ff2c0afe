"""Every figure of the studies, drawn from the committed tables: it can be read at a glance."""

import re
import shutil
import sys
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from calib.robot_world import PAPER_METHODS
from posedesign.report.accuracy import accuracy_figure
from posedesign.report.drawing import CONDITION, STYLES, apart
from posedesign.simulation import IDENTIFIED_ARM, Finding
from posedesign.study.library import find_study, list_studies

NAMES = tuple(study.name for study in list_studies())
DIRECT = (
    "accuracy_vs_condition",
    "li_noise_cases",
    "choosing_irb120_poses",
    "choosing_panda_touch_ups",
    "calibration_by_touch_up",
    "one_cell_in_depth",
)
"""Studies whose series have their names beside them, in place of a legend."""

MOST_SERIES = 5
LARGEST_PNG = 200_000


@cache
def figures_of(name: str) -> dict[str, Figure]:
    """Figures of a study by their names, from its tables and nothing else.

    Laid out where names stand beside lines: that is most of the time.
    """
    found: dict[str, Figure] = {}

    def keep(figure: Figure, out: Path, stem: str) -> list[Path]:
        engine = figure.get_layout_engine()
        if name in DIRECT and engine is not None:
            engine.execute(figure)
        found[stem] = figure
        return []

    study = find_study(name)
    module = study.load()
    with pytest.MonkeyPatch.context() as patch, TemporaryDirectory() as folder:
        patch.setattr(sys.modules["studies.writing"], "save", keep)
        patch.setattr(module, "save", keep, raising=False)
        for path in (*study.folder.glob("*.csv"), study.folder / "expected.json"):
            shutil.copy(path, folder)
        study.plot(Path(folder))
    return found


def panels_of(name: str) -> list[Axes]:
    return [panel for figure in figures_of(name).values() for panel in figure.axes]


def label_of_x(panel: Axes) -> str:
    """Its own, or the one that all panels have together."""
    together = str(panel.figure.get_supxlabel())
    return panel.get_xlabel() or (together if CONDITION in together else "")


def series_of(panel: Axes) -> dict[str, list[str]]:
    """Colours by the names of the series of a panel: one each."""
    found: dict[str, list[str]] = {}
    for line in panel.lines:
        if not str(line.get_label()).startswith("_"):
            found.setdefault(str(line.get_label()), []).append(to_hex(line.get_color()))
    return found


@pytest.mark.parametrize("name", NAMES)
class TestEveryFigure:
    def test_it_is_the_one_that_is_committed_and_not_large(self, name):
        folder = find_study(name).folder
        for kind in ("png", "svg"):
            assert {path.stem for path in folder.glob(f"*.{kind}")} == set(figures_of(name))
        for path in folder.glob("*.png"):
            assert path.stat().st_size < LARGEST_PNG, path

    def test_its_answer_stands_above_it_and_has_numbers(self, name):
        for stem, figure in figures_of(name).items():
            assert re.search(r"\d", figure.get_suptitle()), stem
            width = figure.bbox.width
            for text in (figure._suptitle, figure._supxlabel):
                if text is not None:
                    box = text.get_window_extent()
                    assert box.x0 >= 0.0, stem
                    assert box.x1 <= width, stem

    def test_logarithmic_axes_say_so(self, name):
        for panel in panels_of(name):
            for label, scale in (
                (label_of_x(panel), panel.get_xscale()),
                (panel.get_ylabel(), panel.get_yscale()),
            ):
                assert scale in ("linear", "log")
                if label:
                    assert ("log scale" in label) == (scale == "log"), label

    def test_better_poses_are_to_the_right(self, name):
        for panel in panels_of(name):
            if "condition number" in label_of_x(panel):
                assert CONDITION in label_of_x(panel)
                left, right = panel.get_xlim()
                assert left > right

    def test_a_name_has_the_same_colour_everywhere(self, name):
        for panel in panels_of(name):
            for label, colours in series_of(panel).items():
                known = label.removeprefix("by ").partition(",")[0]
                if known in STYLES:
                    assert set(colours) == {to_hex(STYLES[known].colour)}, label


@pytest.mark.parametrize("name", DIRECT)
class TestLabelsAtLines:
    def test_a_panel_has_few_series(self, name):
        for panel in panels_of(name):
            assert 1 <= len(series_of(panel)) <= MOST_SERIES

    def test_each_series_is_named_once_a_panel_and_in_its_colour(self, name):
        for figure in figures_of(name).values():
            written: dict[str, str] = {}
            for panel in figure.axes:
                assert panel.get_legend() is None
                own = [text for text in panel.texts if text.get_text() in series_of(panel)]
                for text in own:
                    (colour,) = series_of(panel)[text.get_text()]
                    assert to_hex(text.get_color()) == colour
                    written[text.get_text()] = colour
                assert len(own) in (0, len(series_of(panel)))
            for panel in figure.axes:  # a column without names has those of the one beside it
                for label, (colour,) in series_of(panel).items():
                    assert written[label] == colour

    def test_names_do_not_cover_each_other(self, name):
        for panel in panels_of(name):
            own = [text for text in panel.texts if text.get_text() in series_of(panel)]
            ends = sorted((box.y0, box.y1) for box in (text.get_window_extent() for text in own))
            for (_, below), (above, _) in pairwise(ends):
                assert above >= below - 2.0  # pixels, of a box that is higher than its letters


def findings() -> list[Finding]:
    study = find_study("one_cell_in_depth")
    rows = pd.read_csv(study.folder / "one_cell_in_depth.csv").to_dict("records")
    return [Finding(**{str(key): value for key, value in row.items()}) for row in rows]


def test_a_solver_that_is_refused_everywhere_is_named_where_its_line_is_missing():
    solver = PAPER_METHODS[0]
    every = [replace(f, failed=f.draws) if f.estimator == solver else f for f in findings()]
    figure = accuracy_figure(every, "arm")
    controller, identified = figure.axes[2:]
    sets = len({f.c_g for f in every})
    assert solver not in series_of(controller)
    assert f"refused as misfits: {solver} in {sets} of {sets} sets" in controller.get_title()
    assert solver in series_of(identified)
    assert "refused" not in identified.get_title()


@pytest.mark.parametrize("without", [(), (1,), (1, 2), (1, 2, 3)])
def test_an_empty_panel_is_not_drawn(without):
    """No plate, no answer of any solver: what there is nothing of has no panel."""
    of_panel = (
        lambda f: False,  # there is a scatter wherever there is a study
        lambda f: f.quantity.startswith("plate"),
        lambda f: f.estimator in PAPER_METHODS,
        lambda f: (
            f.estimator.removesuffix(IDENTIFIED_ARM) in PAPER_METHODS
            and f.estimator not in PAPER_METHODS
        ),
    )
    every = findings()
    few = [f for f in every if not any(of_panel[k](f) for k in without)]
    figure = accuracy_figure(few, "arm")
    assert len(figure.axes) == 4 - len(without)
    assert all(panel.lines for panel in figure.axes)


def test_the_answer_is_of_the_data():
    worse = [
        replace(f, error_median=1.5 * f.error_median, error_p95=1.5 * f.error_p95)
        if f.quantity.startswith("plate")
        else f
        for f in findings()
    ]
    first, second = (accuracy_figure(given, "arm").get_suptitle() for given in (findings(), worse))
    assert first != second
    assert re.sub(r"[\d.e+-]+", "#", first).split() == re.sub(r"[\d.e+-]+", "#", second).split()


def test_an_arm_that_is_rigid_and_has_one_pose_set_is_drawn():
    """As a cell has it whose loop ends early."""
    worst = max(f.c_g for f in findings())
    few = [f for f in findings() if f.truth == "rigid" and f.c_g == worst]
    figure = accuracy_figure(few, "arm")
    assert list(series_of(figure.axes[1])) == ["calibrated, rigid arm", "uncalibrated, rigid arm"]


@given(st.lists(st.floats(0.0, 1.0), max_size=8), st.floats(0.01, 0.3))
def test_labels_are_moved_apart_and_no_further(places, gap):
    moved = apart(places, gap)
    order = np.argsort(places, kind="stable")
    steps = np.diff(np.array(moved)[order]) if places else np.array([])
    assert (steps >= gap - 1e-9).all()
    assert sum(moved) == pytest.approx(sum(places))
    assert apart(moved, gap) == pytest.approx(moved)
    if len(places) > 1 and np.diff(np.sort(places)).min() > gap:
        assert moved == pytest.approx(places)
