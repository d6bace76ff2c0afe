"""The studies of Li 2010 and Hirsh 2001: a short form of each against what its folder says."""

import json
import re
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from calib import se3
from calib.robot_world import METHODS, PairSets, residuals
from calib.robot_world.methods import hirsh
from posedesign.study.library import find_study

STUDIES = Path(__file__).parents[2] / "studies"
LI = STUDIES / "05_li_noise_cases"
HIRSH = STUDIES / "06_hirsh_iterations"
SHORT, FULL = 100, 1000
DEVIATIONS = 4.0
"""How far two samples may be apart, in standard deviations of their difference."""


def load(folder: Path) -> ModuleType:
    return find_study(folder.name).load()


def module(folder: Path, name: str) -> ModuleType:
    """A module beside a study's own."""
    return import_module(f"{load(folder).__name__}.{name}")


def written(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "expected.json").read_text(encoding="utf-8"))


def rows_of_table(folder: Path, heading: str) -> list[list[str]]:
    """Cells of the first table after a heading of the README."""
    text = (folder / "README.md").read_text(encoding="utf-8").split(heading, 1)[1]
    lines = text.splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("|"))
    last = next(i for i in range(first, len(lines)) if not lines[i].startswith("|"))
    return [line.strip("| ").split(" | ") for line in lines[first + 2 : last]]


def same(cell: str, value: float) -> bool:
    """Whether a figure that people read is the value to its last digit."""
    digits = len(cell.partition(".")[2])
    return abs(float(cell) - value) <= 0.5001 * 10.0**-digits


def assert_same_share(short: dict[str, float], full: dict[str, float], trials: int) -> None:
    p = np.clip(full["share"], 1 / FULL, 1 - 1 / FULL)
    sigma = np.sqrt(p * (1 - p) * (1 / trials + 1 / FULL))
    assert abs(short["share"] - full["share"]) < DEVIATIONS * sigma


@pytest.fixture(scope="module")
def li() -> ModuleType:
    return load(LI)


@pytest.fixture(scope="module")
def hirsh_study() -> ModuleType:
    return load(HIRSH)


@pytest.fixture(scope="module")
def li_short(li) -> dict[Any, Any]:
    return li.run(SHORT, poses=[5, 10])


class TestLi:
    def test_a_short_run_has_the_medians_that_are_written(self, li, li_short):
        """About half of the errors of one sample lie below the median of another."""
        medians = {
            (row["workspace"], row["noisy"], row["poses"], row["method"]): row
            for row in written(LI)["medians"]
        }
        band = DEVIATIONS * np.sqrt(0.25 / SHORT + 0.25 / FULL)
        for cell, methods in li_short.items():
            for name in li.li.SHOWN:
                for measure, title in enumerate(li.li.MEASURES):
                    below = methods[name][:, measure] < medians[*cell, name][title]
                    assert abs(below.mean() - 0.5) < band, (cell, name, title)

    def test_the_order_of_the_paper_holds_in_mm_from_ten_poses_on(self, li, li_short):
        found = li.li.claims(li_short, 10)["order"]
        rotation = {
            (row["better"], row["worse"]): row
            for row in found
            if row["poses"] == "10 to 10" and row["error"] == "rotation_deg"
        }
        assert rotation["Kronecker, mm", "dual quaternion, mm"]["holds"] == 6
        assert rotation["Kronecker, m", "dual quaternion, m"]["holds"] == 0

    def test_what_the_kronecker_form_minimises_is_the_papers_own_measure(self, li):
        """E of Table 1 is least for it by construction, as long as no matrix is made a rotation."""
        li_cases = module(LI, "li_cases")
        data = li_cases.draw(np.random.default_rng(3), 50, 7, "both", 0.0, li.SETTINGS)
        E = li.table_row(data)
        least = E.pop(li.UNPROJECTED)
        assert all((least < other).all() for other in E.values())
        X, Z = li_cases.linear_minimum(data.millimetres)
        literal = METHODS["li-kronecker-literal"].estimate(data.millimetres)
        for linear, found in ((X, literal.X), (Z, literal.Z)):
            R = se3.project_to_rotation(linear[:, :3, :3])
            np.testing.assert_allclose(R, found[:, :3, :3], atol=1e-9)
            np.testing.assert_allclose(linear[:, :3, 3], found[:, :3, 3], atol=1e-6)
        for row in written(LI)["table_1"]["simulated"].values():
            assert row["not_orthonormal_least"] == 1.0

    def test_the_problems_are_what_the_paper_describes(self, li):
        """Only the noisy side has errors, of .5 deg an Euler angle and 1 mm a coordinate."""
        li_cases = module(LI, "li_cases")
        rng = np.random.default_rng(4)
        for noisy, sides in (("A", (1.0, 0.0)), ("B", (0.0, 1.0)), ("both", (1.0, 1.0))):
            data = li_cases.draw(rng, 400, 4, noisy, 0.0, li.SETTINGS)
            left = residuals(data.metres.A, data.metres.B, data.X, data.Z)
            # left over in rotation: the three angles of each noisy side, whatever their axes
            variance = 3.0 * np.radians(0.5) ** 2 / 3.0 * sum(sides)
            assert (left[..., :3] ** 2).sum(axis=-1).mean() == pytest.approx(variance, rel=0.1)
            largest = 1e3 * np.linalg.norm(left[..., 3:], axis=-1).max()
            lever = 2.0 * np.radians(0.5) * 3e3  # [mm] what the angles move, generously
            assert largest < 2.0 * np.sqrt(3.0) + lever

    def test_the_tables_that_people_read_are_the_result(self):
        order = written(LI)["order"]
        table = rows_of_table(LI, "## Who is nearer to the truth")
        assert len(table) >= 8
        for better, worse, error, few, many in table:
            for poses, cell in (("3 to 7", few), ("10 to 15", many)):
                (row,) = [
                    r
                    for r in order
                    if (r["better"], r["worse"], r["poses"]) == (better, worse, poses)
                    and r["error"].startswith(error)
                ]
                numbers = [int(n) for n in re.findall(r"\d+", cell)]
                assert numbers == [row["holds"], row["reversed"], row["undecided"]]

    def test_the_figures_of_table_1_are_the_result(self):
        found = written(LI)["table_1"]
        rows = found["simulated"] | found["measured"]
        names = ("quaternion", "quaternion, safe frames", "dual quaternion, mm", "Kronecker, mm")
        names += ("Kronecker, mm, not orthonormal", "maximum likelihood")
        table = rows_of_table(LI, "## Table 1")
        assert len(table) == len(rows)
        for what, *cells in table:
            for name, cell in zip(names, cells, strict=True):
                value = rows[what]["median"][name]
                assert float(cell.replace(",", "")) == pytest.approx(value, rel=6e-3), (what, name)

    @pytest.mark.real_data
    def test_real_pairs_are_read_as_the_references_have_them(self, li):
        """Residuals of Shah's closed form as other solvers have them [deg, mm]."""
        pairs = li.real_pairs(li.data_folder())
        references = {
            "UR3e": (0.478, 6.03),
            "tag 22, camera 2": (3.03, 25.9),
            "tag 15, camera 1": (1.44, 49.0),
            "Tabb": (0.357, 12.9),
        }
        if set(pairs) != set(references):
            pytest.skip(f"no real pairs in {li.data_folder()}: set POSEDESIGN_DATA")
        for name, (deg, mm) in references.items():
            A, B = (side[None] for side in pairs[name])
            found = METHODS["shah"].run(PairSets(A, B), None)
            left = residuals(A, B, found.X, found.Z)[0]
            rms = np.sqrt([(left[:, :3] ** 2).sum(1).mean(), (left[:, 3:] ** 2).sum(1).mean()])
            assert np.degrees(rms[0]) == pytest.approx(deg, rel=0.01)
            assert 1e3 * rms[1] == pytest.approx(mm, rel=0.01)


@pytest.fixture(scope="module")
def hirsh_short(hirsh_study) -> dict[str, Any]:
    return hirsh_study.run("all orientations", SHORT)


class TestHirsh:
    @pytest.mark.slow
    def test_a_short_run_says_what_is_written(self, hirsh_study, hirsh_short):
        full = written(HIRSH)["workspaces"]["all orientations"]
        for views, row in hirsh_short["views"].items():
            other = full["views"][views]
            for end in ("arrived", "settled elsewhere", "wandering"):
                assert_same_share(row["printed"][end], other["printed"][end], SHORT)
            for line in ("below_line", "below_twice_the_line"):
                assert_same_share(row["floor"][line], other["floor"][line], SHORT)
            assert row["not_converged"]["share"] == other["not_converged"]["share"] == 0.0
        for row, other in zip(hirsh_short["more_views"], full["more_views"], strict=True):
            assert_same_share(row["faster"], other["faster"], SHORT)

    @pytest.mark.parametrize("workspace", ["all orientations", "cone of 40 deg", "cone of 10 deg"])
    def test_medians_of_a_short_sample(self, hirsh_study, workspace):
        band = DEVIATIONS * np.sqrt(0.25 / SHORT + 0.25 / FULL)
        free, noisy = hirsh_study.views_of(workspace, SHORT)
        for views, row in written(HIRSH)["workspaces"][workspace]["views"].items():
            cycles = hirsh.cycles(
                free.first(int(views)).pairs, hirsh_study.SETTINGS["tolerance_rad"]
            )
            middle = row["cycles"]["median"]
            # both sides, since many runs may share the median
            assert (cycles < middle).mean() < 0.5 + band
            assert (cycles <= middle).mean() > 0.5 - band
            few = noisy.first(int(views))
            Z = METHODS["hirsh"].estimate(few.pairs).Z
            end = hirsh_study.error(se3.quaternion_from_rotation(Z[:, :3, :3]), few.z)
            assert abs((end < row["floor"]["median_rad"]).mean() - 0.5) < band

    def test_the_prediction_is_never_below_the_count(self, hirsh_study):
        for workspace in hirsh_study.SETTINGS["workspaces"]:
            free, _ = hirsh_study.views_of(workspace, SHORT)
            for views in hirsh_study.SETTINGS["views"]:
                pairs = free.first(views).pairs
                counted = hirsh.cycles(pairs, 1e-4)
                ratio = np.ceil(hirsh.predicted_cycles(pairs, 1e-4) * (1.0 + 1e-9)) / counted
                assert ratio.min() >= 1.0
                assert 1.0 <= np.median(ratio) < 1.15

    def test_walking_takes_as_many_cycles_as_the_library_counts(self, hirsh_study):
        free, _ = hirsh_study.views_of("all orientations", SHORT)
        tolerance, last = hirsh_study.SETTINGS["tolerance_rad"], 60
        for views in (3, 10):
            few = free.first(views)
            near = hirsh_study.walk(few, np.arange(last + 1), hirsh_study.IDENTITY) <= tolerance
            counted = hirsh.cycles(few.pairs, tolerance)
            within = counted <= last
            np.testing.assert_array_equal(near.any(axis=0), within)
            np.testing.assert_array_equal(near.argmax(axis=0)[within], counted[within])

    def test_doubled_steps_are_the_same_walk(self, hirsh_study):
        free, _ = hirsh_study.views_of("cone of 40 deg", 50)
        one_by_one = hirsh_study.walk(free, 2 ** np.arange(8), hirsh_study.IDENTITY)
        doubled = hirsh_study.walk_by_squaring(free, 8, hirsh_study.IDENTITY)
        np.testing.assert_allclose(doubled, one_by_one, atol=1e-12)

    def test_the_printed_form_is_that_of_the_library(self, hirsh_study):
        """All but the few in which rounding decides the sign of a scalar part next to zero."""
        free, _ = hirsh_study.views_of("all orientations", SHORT)
        few = free.first(5)
        *_, z = hirsh_study.walk_as_printed(few, 50, hirsh_study.IDENTITY)
        _, other, _, _ = hirsh.iterate_literal(few.pairs, 50)
        same_end = np.abs((z * other).sum(axis=-1)) > 1.0 - 1e-9
        assert same_end.mean() > 0.98

    def test_the_tables_that_people_read_are_the_result(self):
        spaces = written(HIRSH)["workspaces"]
        table = rows_of_table(HIRSH, "## Figures")
        assert len(table) == sum(len(every["views"]) for every in spaces.values())
        for place, views, *cells in table:
            row = spaces[place]["views"][views]
            numbers = [
                row["cycles"]["median"],
                row["predicted_median"],
                row["cycles"]["q99"],
                100 * row["printed"]["arrived"]["share"],
                1e3 * row["floor"]["median_rad"],
                1e3 * row["floor"]["mean_rad"],
                100 * row["floor"]["below_line"]["share"],
            ]
            for cell, value in zip(cells, numbers, strict=True):
                assert same(cell.replace(",", ""), value), (place, views, cell, value)
