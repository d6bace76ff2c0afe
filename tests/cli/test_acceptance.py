"""prove and recheck as a person types them."""

import json
import re
import shlex
import shutil
from pathlib import Path
from typing import Any

import pytest

from posedesign.acceptance.file import read_result
from posedesign.cli.main import run
from posedesign.files.csv_tables import read_table
from posedesign.report.acceptance import answer_of_verdict, figure_of_acceptance
from tests.cli.conftest import empty_pictures, found_once, rendering, strict_json
from tests.unit.acceptance.conftest import TRACKER_CELL

CELL = TRACKER_CELL.replace("three_sigma_deg_if_pose", "").replace("= 120", "= 60")


@pytest.fixture(scope="session")
def _tracked(tmp_path_factory) -> Path:
    """A cell with a tracker, an identification, and a test of 14 places that was measured."""
    folder = tmp_path_factory.mktemp("tracked")
    (folder / "cell.toml").write_text(CELL)

    def typed(line: str) -> None:
        words = line.split()
        assert not run([str(folder / w) if w in NAMES or w.endswith(ENDINGS) else w for w in words])

    with empty_pictures(), found_once():
        typed("plan cell.toml --method greedy --poses 20 --no-refine --out run")
        typed("simulate cell.toml run/poses.csv --out run")
        typed("identify cell.toml run/measurements.csv --out run")
        typed(f"prove cell.toml {' '.join(USED)} --content 0.8 --out proof")
        typed("simulate cell.toml proof/poses.csv --seed 7 --out proof")
        typed(f"recheck cell.toml {' '.join(USED)} --out again")
        typed("simulate cell.toml again/poses.csv --seed 8 --out again")
    return folder


NAMES, ENDINGS = ("run", "proof", "again"), (".toml", ".csv", ".json")
USED = ("--identification", "run/identification.json")


@pytest.fixture
def tracked(_tracked, tmp_path, monkeypatch) -> Path:
    """The same in a folder of the test's own, where the commands are typed."""
    shutil.copytree(_tracked, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def judged(cli, *words: str):
    return cli("prove", "cell.toml", "proof/measurements.csv", *USED, "--out", "proof", *words)


def test_a_test_is_planned_with_its_statement_and_its_chance(tracked, done):
    said = done(
        "prove", "cell.toml", *USED, "--content", "0.8", "--limit", "150um", "--out", "other"
    )
    assert "at least 80 % of the places are within 0.15 mm, with confidence 95 %" in said.out
    assert "poses: 14 places, at most 0 of them beyond the limit" in said.out
    assert re.search(r"chance to pass: \d+ %, with 0\.\d+ mm rms to expect", said.out)
    rule = strict_json((tracked / "other/acceptance_test.json").read_text())
    assert rule["limit_mm"] == pytest.approx(0.15)
    assert len(rule["poses"]) == 14
    assert rule["origin"]["purpose"] == "acceptance test"
    # the list is one that the other commands take
    done("check", "cell.toml", "other/poses.csv")
    done("program", "other/poses.csv", "--cell", "cell.toml", "--out", "other")


def test_a_test_is_passed_after_and_says_what_is_proven(tracked, cli):
    said = judged(cli)
    assert said.code == 0
    assert "passed: 14 of 14 places within 0.2 mm by the arm as identified" in said.out
    assert "at least 80.7 % of all are, with confidence 95 %" in said.out  # .05 ** (1 / 14)
    assert "frame: fitted to this test" in said.out
    found = strict_json((tracked / "proof/acceptance.json").read_text())
    before, after = found["arms"]
    assert found["passed"]
    assert (before["arm"], after["arm"]) == ("as described", "as identified")
    assert after["rms_mm"][0] < before["rms_mm"][0]
    assert len(found["places_mm"]) == 14
    as_json = judged(cli, "--json")
    assert strict_json(as_json.out)["passed"]
    assert (tracked / "proof/acceptance.png").is_file()


def test_the_verdict_is_a_part_of_the_page(tracked, cli, done):
    judged(cli)
    Path("proof/poses.csv").unlink()
    with rendering():
        done("report", "proof")
    page = (tracked / "proof/report.html").read_text()
    assert "Acceptance test" in page
    assert "passed: 14 of 14 places within 0.2 mm" in page
    assert "planned: at least 80 % of the places are within 0.2 mm" in page
    assert "limit 0.2 mm" in page


def test_cycles_of_the_standard_are_rehearsed_and_judged(tracked, cli, done):
    done("prove", "cell.toml", "--test", "iso", "--out", "iso")
    done("simulate", "cell.toml", "iso/poses.csv", "--cycles", "30", "--out", "iso")
    said = done("prove", "cell.toml", "iso/measurements.csv", *USED, "--out", "iso")
    assert "AP of ISO 9283 of the arm as identified" in said.out
    assert re.search(r"RP: 0\.\d+ \(0\.\d+ to 0\.\d+\) mm at P0\d", said.out)
    assert re.search(r"AD: .* between P0[24] and P0[24], 415\.\d mm apart", said.out)
    assert "takes 6 of the 15 coordinates" in said.err
    rows = strict_json((tracked / "iso/acceptance.json").read_text())["arms"][1]["poses"]
    assert {row["cycles"] for row in rows} == {30}
    done("simulate", "cell.toml", "iso/poses.csv", "--cycles", "3", "--out", "few")
    shutil.copy("iso/acceptance_test.json", "few")
    said = cli("prove", "cell.toml", "few/measurements.csv", *USED, "--out", "few")
    assert "3 cycles were measured where the test has 30" in said.err


def as_exported(rows: list[dict[str, str]], file: str) -> None:
    """What a tracker exports: names of poses and places, one reading a row, without joints."""
    lines = [",".join(row[c] for c in ("pose", "x_mm", "y_mm", "z_mm")) for row in rows]
    Path(file).write_text("\n".join(["name,x_mm,y_mm,z_mm", *lines, ""]))


EXPORT = """[instrument]
kind = "point"
unit = "mm"
match = "pose"
[instrument.columns]
pose = "name"
place = ["x_mm", "y_mm", "z_mm"]
"""


def test_the_next_poses_are_those_after_the_own_table(tracked, cli):
    """After the export of an instrument and the list of its poses."""
    Path("export.toml").write_text(CELL + EXPORT)
    as_exported([row.cells for row in read_table(Path("run/measurements.csv")).rows], "export.csv")
    own = cli("next", "cell.toml", "run/measurements.csv", "--out", "a", "--json")
    joined = ("--joints", "run/poses.csv")
    said = cli("next", "export.toml", "export.csv", *joined, "--out", "b", "--json")
    assert said.code == own.code == 0, said.err
    errors = [strict_json(each.out)["tcp_rms_mm"] for each in (said, own)]
    assert errors[0] == pytest.approx(errors[1], rel=1e-4)


def test_repeatability_is_of_visits_in_the_export_of_an_instrument(tracked, cli):
    """Readings of each visit by themselves give RP as the own table does; of one visit none."""
    cli("prove", "cell.toml", "--test", "iso", "--cycles", "5", "--out", "iso")
    cli("simulate", "cell.toml", "iso/poses.csv", "--cycles", "5", "--out", "iso")
    table = read_table(Path("iso/measurements.csv"))
    rows = [row.cells for row in table.rows]
    Path("export.toml").write_text(CELL + EXPORT)

    def answer(file: str, *more: str) -> dict[str, Any]:
        cell = "export.toml" if more else "cell.toml"
        said = cli("prove", cell, file, *USED, *more, "--out", "iso", "--json")
        assert said.out, said.err
        return strict_json(said.out)

    own = answer("iso/measurements.csv")["arms"][1]["poses"]
    as_exported(rows, "iso/export.csv")
    joined = ("--joints", "iso/poses.csv")
    exported = answer("iso/export.csv", *joined)
    for row, as_own in zip(exported["arms"][1]["poses"], own, strict=True):
        assert row["rp_mm"] == pytest.approx(as_own["rp_mm"], rel=1e-6)
    assert not exported["notes"]
    as_exported(sorted(rows, key=lambda row: row["pose"]), "iso/export.csv")
    one = answer("iso/export.csv", *joined)
    assert {row["rp_mm"][0] for row in one["arms"][1]["poses"]} == {None}
    assert "its 5 readings scatter as the instrument does" in one["notes"][-1]


def test_a_test_that_is_not_passed_says_so_by_its_exit_code(tracked, cli):
    rule = json.loads((tracked / "proof/acceptance_test.json").read_text())
    rule["limit_mm"] = 0.001
    (tracked / "strict.json").write_text(json.dumps(rule))
    said = judged(cli, "--rule", "strict.json")
    assert said.code == 1
    assert "NOT passed: 0 of 14 places within 0.001 mm" in said.out


def test_what_was_identified_from_proves_nothing(tracked, refuse):
    own = ("--rule", "proof/acceptance_test.json", "--out", "other")
    refuse("prove", "cell.toml", "run/measurements.csv", *USED, *own).says(
        "is what identification.json was identified from", "it proves nothing"
    )
    # nor do rows of it under another name
    lines = Path("run/measurements.csv").read_text().splitlines(keepends=True)
    header = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    Path("some.csv").write_text("".join(lines[header : header + 6]))
    refuse("prove", "cell.toml", "some.csv", *USED, *own).says("5 of 5 rows", "identified from")
    refuse("recheck", "cell.toml", "run/measurements.csv", *USED).says("it proves nothing")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--test", "izo"), ("there is no test 'izo'", "iso")),
        (("--limit", "0"), ("'0' is no accuracy",)),
        (("--content", "95"), ("a content of 95", "between 0 and 1")),
        (("--plane", "up", "--test", "iso"), ("there is no plane 'up'", "x=z")),
        (("--frame", "free"), ("--frame", "fit", "given")),
        (("--frame", "given"), ("--frame is of measurements",)),
        (("--identification", "none.json"), ("none.json: cannot be read",)),
        (("--out", "run"), ("run/poses.csv holds", "another output folder")),
    ],
)
def test_plans_that_cannot_be_are_refused_in_a_line(tracked, refuse, words, said):
    refuse("prove", "cell.toml", "--out", "none", *words).says(*said)


def test_the_rule_is_not_changed_once_something_is_measured(tracked, refuse):
    for words in (("--limit", "1mm"), ("--allowed", "3"), ("--test", "iso")):
        refuse("prove", "cell.toml", "proof/measurements.csv", *words).says(
            f"{words[0]} was fixed when the test was planned"
        )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", ("is no valid JSON",)),
        ("[]", ("acceptance_test.json",)),
        ("{}", ("key test: is missing", "plan the test first")),
        (None, ("acceptance_test.json: there is no such file", "with --rule")),
    ],
)
def test_a_rule_that_is_none_is_refused_in_a_line(tracked, refuse, text, said):
    path = tracked / "proof/acceptance_test.json"
    path.unlink()
    if text is not None:
        path.write_text(text)
    refuse("prove", "cell.toml", "proof/measurements.csv", *USED).says(*said)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("P01", "Q99"), ("Q99 is no pose of the test",)),
        (lambda text: text.replace(",point,", ",plane,"), ("a plane does not tell where",)),
        (lambda text: text.replace("x_mm", "x"), ("x_mm",)),
    ],
)
def test_measurements_that_are_no_test_are_refused_in_a_line(tracked, refuse, change, said):
    path = tracked / "proof/measurements.csv"
    path.write_text(change(path.read_text()))
    refuse("prove", "cell.toml", "proof/measurements.csv", *USED).says(*said)


def test_poses_that_were_left_out_count_against_the_arm(tracked, cli):
    path = tracked / "proof/measurements.csv"
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-3]))
    said = judged(cli)
    assert said.code == 1
    assert "3 poses of the test were not measured, and count as beyond the limit" in said.err


def test_touch_ups_are_not_repeated_in_cycles(work, refuse):
    refuse(
        "simulate", work / "cell.toml", work / "poses.csv", "--cycles", "2", "--out", work / "new"
    ).says("2 cycles of poses that are touched")


def test_a_recheck_says_which_changes_it_will_find(tracked, cli, done):
    said = done("recheck", "cell.toml", *USED, "--poses", "3", "--out", "three")
    assert re.search(r"3 poses find any zero that has moved by 0\.\d+ deg", said.out)
    assert "with a chance of 90 %, at 5 % of false alarms in all" in said.out
    assert re.search(r"by number: 3 poses .* deg; 4 poses .* deg; 5 poses", said.out)
    moved = cli("recheck", "cell.toml", *USED, "--set-up-anew", "--out", "moved", "--json")
    assert strict_json(moved.out)["blind"] == ["zero of joint_a1"]


def test_a_robot_that_is_the_same_is_told_from_one_that_was_hit(tracked, cli, done):
    same = done("recheck", "cell.toml", "again/measurements.csv", *USED)
    done("report", "recheck")
    assert "Recheck: still the same robot" in Path("recheck/report.html").read_text()
    assert "still the same robot, as far as these poses tell (p = 0." in same.out
    hit = CELL.replace(
        "[truth]", "[truth]\nzero_offsets_deg = [0.03, 0.08, 0.04, 0.05, 0.1, -0.04]"
    )
    (tracked / "hit.toml").write_text(hit)  # joint 3 by a tenth of a degree
    done("simulate", "hit.toml", "again/poses.csv", "--out", "hit", "--seed", "8")
    said = cli("recheck", "cell.toml", "hit/measurements.csv", *USED)
    assert said.code == 1
    assert "NOT the same robot (p < 1e-12)" in said.out
    found = re.search(r"likeliest single cause: zero of joint_a3, by (\S+) \(", said.out)
    assert found is not None
    assert float(found[1]) == pytest.approx(0.1, abs=0.01)
    done("report", "recheck")
    page = Path("recheck/report.html").read_text()
    assert found[0] in page.replace("\n", " ")
    assert "What a single cause would explain" in page
    as_json = cli("recheck", "cell.toml", "hit/measurements.csv", *USED, "--json")
    assert strict_json(as_json.out)["possible"][0] == "zero of joint_a3"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--poses", "0"), ("0 poses",)),
        (("--poses", "1", "--set-up-anew"), ("nothing besides where the set-up stands",)),
    ],
)
def test_rechecks_that_cannot_be_are_refused_in_a_line(tracked, refuse, words, said):
    refuse("recheck", "cell.toml", *USED, *words, "--out", "none").says(*said)


def test_a_recheck_needs_the_identification(tracked, refuse):
    for measured in ((), ("proof/measurements.csv",)):
        line = refuse("recheck", "cell.toml", *measured)
        line.says("identification.json: there is no such file", "with --identification")


def test_postures_that_were_identified_from_are_named(tracked, cli, done):
    """Measured again they are no rows of the identification, and a weaker proof."""
    done("simulate", "cell.toml", "run/poses.csv", "--seed", "9", "--out", "more")
    rule = json.loads(Path("proof/acceptance_test.json").read_text())
    rows = [line.split(",") for line in Path("more/measurements.csv").read_text().splitlines()]
    header = next(row for row in rows if row[0] == "target")
    names = [row[header.index("pose")] for row in rows[rows.index(header) + 1 :]]
    Path("more/acceptance_test.json").write_text(json.dumps(rule | {"poses": names}))
    said = cli("prove", "cell.toml", "more/measurements.csv", *USED, "--out", "more")
    assert "20 measurements are at postures that were identified from" in said.err


def test_a_verdict_that_is_none_is_refused_in_a_line(tracked, cli, refuse):
    judged(cli)
    path = tracked / "proof/acceptance.json"
    content = strict_json(path.read_text())
    for change, said in (
        ({"places_mm": [[0.0, 0.0, 0.0]]}, "poses, places and errors are not as many"),
        ({"arms": []}, "key arms"),
        ({"arms": content["arms"] * 2}, "key arms"),
        ({"passed": None}, "key passed"),
    ):
        path.write_text(json.dumps(content | change))
        refuse("report", "proof", "--out", "proof").says("acceptance.json", said)


def test_after_a_rehearsal_comes_the_command_that_judges_it(tracked, done):
    for folder, command in (("proof", "prove"), ("again", "recheck")):
        said = done("simulate", "cell.toml", f"{folder}/poses.csv", "--out", folder, "--overwrite")
        assert (
            f"next: posedesign {command} cell.toml {folder}/measurements.csv --identification "
            f"run/identification.json --out {folder}"
        ) in said.out
    said = done("simulate", "cell.toml", "run/poses.csv", "--out", "run")
    assert "next: posedesign identify cell.toml run/measurements.csv --out run" in said.out


def test_a_test_at_one_point_says_that_it_speaks_of_nothing_else(tracked, cli, done):
    """What was touched is one point: the sentence, the rule and the figure say so."""
    pin = Path("cell.toml").read_text().partition("[target]")
    (tracked / "pin.toml").write_text(
        pin[0] + '[parameters]\nmodels = [["zero_offsets"]]\n[constraints]\ncollisions = false\n'
    )
    done("plan", "pin.toml", "--out", "pin")
    done("simulate", "pin.toml", "pin/poses.csv", "--out", "pin")
    done("identify", "pin.toml", "pin/touchups.csv", "--out", "pin")
    used = ("--identification", "pin/identification.json", "--content", "0.8", "--limit", "0.3mm")
    planned = done("prove", "pin.toml", *used, "--out", "one").out
    done("simulate", "pin.toml", "one/poses.csv", "--seed", "5", "--out", "one")
    words = ("prove", "pin.toml", "one/touchups.csv", *used[:2], "--out", "one")
    judged_by = cli(*words, "--verbose").out
    expected = strict_json((tracked / "pin/identification.json").read_text())
    box_mm = next(
        m["expected_box_mm"] for m in expected["models"] if m["name"] == expected["recommended"]
    )
    for said in (" ".join(text.split()) for text in (planned, judged_by)):
        assert "orientations of the tool at the one point T1" in said
        assert "not proven: other places, such as a cube of" in said
        assert (
            f"expected error where the arm will work, by the identification: {box_mm:.3g} mm"
            in said
        )
    found = read_result(Path("one/acceptance.json"))
    figure = figure_of_acceptance(found)
    (panel,) = figure.axes
    assert panel.get_xlabel() == "error [mm]"
    assert "nothing is proven of other places" in figure.get_supxlabel()
    flat = found.model_copy(
        update={
            "rule": found.rule.model_copy(update={"touched": ()}),
            "places_mm": [(10.0 * k, -5.0 * k, 200.0) for k in range(len(found.poses))],
        }
    )
    # z is the same everywhere: it would be a panel that shows nothing
    assert [axes.get_xlabel() for axes in figure_of_acceptance(flat).axes] == ["x [mm]", "y [mm]"]
    old = found.model_copy(update={"rule": flat.rule})  # a rule that does not name what is touched
    assert "at one point" in answer_of_verdict(old).verdict


def test_a_rehearsal_in_its_own_folder_says_how_it_is_judged(tracked, done):
    """The rule stays beside the poses of the test, not beside what was measured."""
    said = done("simulate", "cell.toml", "proof/poses.csv", "--seed", "3")
    words = shlex.split(said.out.split("next: posedesign ")[1])
    assert words[words.index("--rule") + 1] == "proof/acceptance_test.json"
    assert done(*words).out
    assert (tracked / "rehearsal/acceptance.json").is_file()
