"""The page of a calibration: what stands on it, and what it refuses."""

from __future__ import annotations

import re
import shutil
from contextlib import redirect_stdout
from html import unescape
from io import StringIO
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from calib.errors import InputError
from posedesign.cli.main import run
from posedesign.files import Results, origin_of
from posedesign.report.figures import draw, new_figure, panels_of
from posedesign.workflow import PLANNED
from tests.cli.conftest import copied, rendering, with_compliance


@pytest.fixture(scope="module")
def reported(_work, tmp_path_factory) -> Path:
    """A folder with an identification and the page of it."""
    work = copied(_work, tmp_path_factory.mktemp("reported"))
    (work / "touchups.csv").unlink()
    (work / "pairs.csv").unlink()
    with_compliance(work / "cell.toml")
    cell, poses, touchups = (str(work / f) for f in ("cell.toml", "poses.csv", "touchups.csv"))
    assert run(["simulate", cell, poses, "--out", str(work)]) == 0
    with redirect_stdout(StringIO()) as out:
        assert run(["identify", cell, touchups, "--out", str(work)]) == 0
        with rendering():
            assert run(["report", str(work)]) == 0
    assert f"\nwrote: {work / 'report.html'}, " in out.getvalue()
    return work


@pytest.fixture
def page(reported, work) -> str:
    """What stands on the page, in a folder that may be changed."""
    (work / "pairs.csv").unlink()
    shutil.copytree(reported, work, dirs_exist_ok=True)
    return (work / "report.html").read_text()


def test_one_file_says_it_all(page, work, done):
    titles = re.findall(r"<h2[^>]*>([^<]*)</h2>", page)
    assert titles == ["At a glance", "Cell", "Poses", "Motions", "Identification", "Files"]
    assert page.count("<svg") == 2
    glance = page[: page.index("Cell</h2>")]
    assert "Motions: 27 poses: 0 cannot be taken; 0 motions between them not clear" in glance
    assert "Identification: recommended: offsets + compliance" in glance
    assert "SIMULATED, not for a robot" in page
    assert "not checked: collisions: constraints.collisions is false" in page
    assert "recommended: offsets + compliance" in page
    for name in ("cell.toml", "poses.csv", "touchups.csv", "identification.json"):
        assert f"<td>{name}</td>" in page
    # nothing of it is fetched
    addresses = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert all(address.startswith(("#", "data:")) for address in addresses)
    assert not re.search(r"url\((?!#)|@import|<link|fetch\(", page)
    assert len(page) < 5_000_000
    found = origin_of(work / "report.html")
    assert found is not None
    assert (found.kind, found.command) == ("simulated", "report")
    done("report", work)  # its own page may be replaced


def test_the_cell_above_is_taken_where_the_files_are_made_from_it(work, cli, done, change_cell):
    run = work / "run"
    done("plan", work / "cell.toml", "--out", run)
    done("report", run)
    assert ">Motions</h2>" in (run / "report.html").read_text()
    change_cell({"plan.limit_margin_deg": "2.0"})
    assert cli("report", run).code == 2  # another cell than the poses are of


def test_the_scene_of_the_cell_stands_on_the_page(work, done):
    pytest.importorskip("viser", reason="needs the extra view")
    poses = work / "poses.csv"
    done("view", work / "cell.toml", poses, "--out", work / "scene.html")
    scene = (work / "scene.html").read_text()
    assert scene.lower().startswith("<!doctype html>")  # else browsers draw it as of 1999
    done("report", work)
    page = (work / "report.html").read_text()
    (shown,) = re.findall(r'srcdoc="([^"]*)"', page)
    assert unescape(shown) == scene
    assert 'sandbox="allow-scripts"' in page  # it cannot write on the page
    for other in (b"<html>another's</html>", scene.encode().replace(b"fixture", b"picture")):
        (work / "scene.html").write_bytes(other + b"\xff")
        done("report", work)
        assert "srcdoc" not in (work / "report.html").read_text()


def test_what_is_out_of_date_stands_at_the_top(page, work, done, change_cell):
    assert "warning: " not in page
    (work / "touchups.csv").write_text((work / "touchups.csv").read_text() + "\n")
    change_cell({"plan.limit_margin_deg": "2.0"})
    done("report", work)
    text = (work / "report.html").read_text()
    glance = text[: text.index("Cell</h2>")]
    assert "warning: touchups.csv was changed since simulate wrote it" in glance
    assert "warning: identification.json was made from another touchups.csv" in glance
    assert "warning: identification.json was made from another cell.toml" in glance


def test_names_from_files_are_no_markup(page, work, done):
    text = (work / "poses.csv").read_text()
    (work / "poses.csv").write_text(text.replace("P14,", "<script>alert(1)</script>,", 1))
    done("report", work)
    changed = (work / "report.html").read_text()
    assert "<script>alert" not in changed
    assert "&lt;script&gt;alert" in changed


def test_pages_of_nothing_and_of_damaged_files_are_refused(refuse, work, tmp_path):
    refuse("report", tmp_path / "none").says("none is no folder", "plan, identify")
    (tmp_path / "empty").mkdir()
    refuse("report", tmp_path / "empty").says("nothing to report of", "cell.toml")
    (work / "identification.json").write_text('{"models": [{"name": "a"}], "recommended": "a"}')
    refuse("report", work).says("identification.json", "does not have what a report needs")
    (work / "identification.json").write_text('{"models": [{"name": "a", "parameters": 3}]}')
    refuse("report", work).says("models.0.parameters", "is no list")
    (work / "identification.json").write_text("{")
    refuse("report", work).says("identification.json")


@pytest.mark.usefixtures("rendered")
def test_a_figure_of_an_earlier_time_goes_where_nothing_can_be_drawn(tmp_path):
    def something() -> Figure:
        panels_of(figure := new_figure())
        return figure

    def unreachable() -> None:
        raise InputError("no place of the box can be reached")

    out = Results(tmp_path, "plan")
    for nothing in (unreachable, lambda: None):
        draw(out, out.claim("planned", *PLANNED), something)
        assert {path.suffix for path in tmp_path.iterdir()} == {".png", ".svg"}
        draw(out, out.claim("planned", *PLANNED), nothing)
        assert not list(tmp_path.iterdir())


def test_answers_of_axzb_stand_on_the_page_with_their_figure(work, done, refuse):
    (work / "poses.csv").unlink()
    words = ("--method", "ml,shah", "--out", work)
    done("robot-world", work / "pairs.csv", *words)
    with rendering():
        done("report", work)
    page = (work / "report.html").read_text()
    place = re.search(r"X by ml: \(([^)]*)\) mm", page)
    assert place is not None
    assert all(len(number.strip("-").replace(".", "")) <= 7 for number in place[1].split(", "))
    assert "Residuals of the pairs, and how far methods differ" in page
    text = (work / "robot_world.csv").read_text()
    (work / "robot_world.csv").write_text(text.replace("x_w_deg", "x_v_deg"))
    refuse("report", work).says("robot_world.csv", "does not have what a report needs: x_w_deg")
    place = text.splitlines()[2].split(",")[20]
    for bad in ("n/a", "nan", "inf", "1e999"):
        (work / "robot_world.csv").write_text(text.replace(f",{place},", f",{bad},", 1))
        refuse("report", work).says(
            "robot_world.csv", "line 3, column x_x_mm", "not a finite number"
        )
    (work / "robot_world.csv").write_text(text.replace("\nshah,", "\n$x_{$,"))
    pairs = work / "robot_world_pairs.csv"
    pairs.write_text(pairs.read_text().replace("\nshah,", "\n$x_{$,"))
    with rendering():
        done("report", work, "--overwrite")
    assert "$x_{$" in (work / "report.html").read_text()  # no formula, though it looks like one


def test_poses_for_a_camera_promise_x_and_z_and_no_tool_point(work, cli, done, change_cell):
    change_cell({"measurement.kind": '"camera-pose"', "plan.condition_threshold": "50.0"})
    out = work / "camera"
    said = cli("plan", work / "cell.toml", "--out", out)
    assert "tool point:" not in said.out
    assert re.search(r"^X: [\d.]+ mm and [\d.]+ deg predicted", said.out, re.MULTILINE)
    done("report", out)
    page = (out / "report.html").read_text()
    assert "tool point, predicted" not in page
    assert "<td>tool.rx</td>" in page
    assert "X = T_flange_camera" in page
