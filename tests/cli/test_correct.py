"""correct and predict as a person types them."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib import CalibrationModel, Robot, se3
from calib.model import Setup
from calib.se3 import FloatArray
from posedesign.cell import Cell
from posedesign.cell.models import payloads_of
from posedesign.files.origin import checksum
from posedesign.identification.models import model_of
from posedesign.planning.poses_file import read_poses
from posedesign.pose_programs.from_plan import arm_of
from posedesign.programs import postures_of, read
from posedesign.simulation import SimulatedRobot
from tests.cli.conftest import rows_of

WAYS = ["corrected poses", "description", "mastering", "as it is"]
TEXTS = ("meaning", "joint", "pendant_joint", "name", "status", "reason", "configuration")


@pytest.fixture
def identified(work, identified_once) -> Path:
    """The file that identify makes, in the working folder."""
    content = dict(identified_once.content)
    content.pop("reference", None)  # what is recommended is corrected by, unless a test says else
    path = work / "identification.json"
    path.write_text(json.dumps(content))
    return path


@pytest.fixture
def changed(identified) -> Callable[[Callable[[dict[str, Any]], object]], Path]:
    """Change the content of the file in the working folder."""

    def change(how: Callable[[dict[str, Any]], object]) -> Path:
        content = json.loads(identified.read_text())
        how(content)
        identified.write_text(json.dumps(content))
        return identified

    return change


def table(path: Path) -> list[dict[str, Any]]:
    return [
        {k: v if k in TEXTS else (float(v) if v else None) for k, v in row.items()}
        for row in rows_of(path)
    ]


def best(content: dict[str, Any]) -> dict[str, Any]:
    name = content["recommended"]
    found: dict[str, Any] = next(m for m in content["models"] if m["name"] == name)
    return found


def as_identified(cell: Cell, content: dict[str, Any]) -> tuple[CalibrationModel, FloatArray]:
    """Model and values out of the file, put together by hand."""
    factors = {"deg": np.pi / 180, "mm": 1e-3, "urad/Nm": 1e-6, "mrad/rad": 1e-3}
    values = {p["name"]: p["value"] * factors[p["unit"]] for p in best(content)["parameters"]}
    model = model_of(cell, list(values))
    return model, np.array([values[name] for name in model.names])


def test_correct_writes_description_mastering_and_poses(cli, work, identified):
    out = work / "out"
    said = cli("correct", work / "cell.toml", identified, work / "poses.csv", "--out", out)
    assert said.code == 0, said
    assert sorted(p.name for p in out.iterdir()) == [
        "corrected.urdf",
        "corrected_poses.csv",
        "mastering.csv",
    ]
    assert "28 of 28 postures corrected" in said.out
    assert "two together correct twice" in said.err
    cell = Cell.load(work / "cell.toml")
    model, x = as_identified(cell, json.loads(identified.read_text()))
    # the real tool point stands where the plan has it
    planned = read_poses(work / "poses.csv", 6).postures
    commands = read_poses(out / "corrected_poses.csv", 6).postures
    wanted = cell.robot.state(planned).point(cell.tool_m)
    np.testing.assert_allclose(model.view(commands, x).tool_points, wanted, atol=1e-9)
    # and so it does on the robot that was simulated, whose errors nobody told
    truth = SimulatedRobot.of(cell)
    off = truth.model.view(commands, truth.values).tool_points - wanted
    before = truth.model.view(planned, truth.values).tool_points - wanted
    spread = np.linalg.norm(off - off.mean(axis=0), axis=1)
    assert np.linalg.norm(before - before.mean(axis=0), axis=1).max() > 1e-3
    assert spread.max() < 1e-4
    # what to type in as a Cartesian point is what the nominal arm makes of the command
    for row, q in zip(table(out / "corrected_poses.csv"), commands, strict=True):
        T = cell.robot.fk(q)
        p = 1e3 * (T[:3, :3] @ cell.tool_m + T[:3, 3])
        assert [row["x_mm"], row["y_mm"], row["z_mm"]] == pytest.approx(p.tolist(), abs=1e-6)
        wpr = np.deg2rad([row["w_deg"], row["p_deg"], row["r_deg"]])
        np.testing.assert_allclose(se3.rotation_from_wpr(wpr), T[:3, :3], atol=1e-9)


def test_corrected_urdf_is_the_identified_arm(cli, work, identified):
    name = json.loads(identified.read_text())["recommended"]
    typed = ("correct", work / "cell.toml", identified, "--model", name, "--out", work / "out")
    assert cli(*typed).code == 0
    assert not (work / "out" / "corrected_poses.csv").exists()
    cell = Cell.load(work / "cell.toml")
    content = json.loads(identified.read_text())
    offsets = {
        p["name"].removeprefix("zero_offset."): np.deg2rad(p["value"])
        for p in best(content)["parameters"]
        if p["name"].startswith("zero_offset.")
    }
    again = Robot.from_urdf(work / "out" / "corrected.urdf", tip=cell.robot.tip_frame)
    q = np.random.default_rng(0).uniform(cell.robot.lower, cell.robot.upper, (50, 6))
    moved = q + [offsets.get(joint, 0.0) for joint in cell.robot.joint_names]
    np.testing.assert_allclose(again.fk(q), cell.robot.fk(moved), atol=1e-9)


def test_mastering_is_in_the_signs_of_the_pendant(cli, work, identified):
    name = json.loads(identified.read_text())["recommended"]
    typed = ("correct", work / "cell.toml", identified, "--model", name, "--out", work / "out")
    assert cli(*typed).code == 0
    rows = table(work / "out" / "mastering.csv")
    values = {p["name"]: p["value"] for p in best(json.loads(identified.read_text()))["parameters"]}
    q2, q3 = (values[f"zero_offset.joint_{j}"] for j in (2, 3))
    assert rows[1]["correction_deg"] == pytest.approx(q2, abs=1e-8)
    assert rows[2]["correction_deg"] == pytest.approx(q3 - q2, abs=1e-8)
    assert rows[0]["sigma_deg"] is None
    assert rows[2]["sigma_deg"] > 0


def test_the_ways_are_compared_first_and_the_best_is_named(cli, work, identified):
    out = work / "out"
    said = cli("correct", work / "cell.toml", identified, work / "poses.csv", "--out", out)
    lines = said.out.splitlines()
    at = [next(i for i, line in enumerate(lines) if f"│ {way} " in line) for way in WAYS]
    assert at == sorted(at)
    assert at[-1] < next(i for i, line in enumerate(lines) if line.startswith("best: "))
    (verdict,) = (line for line in lines if line.startswith("best: "))
    assert re.fullmatch(r"best: corrected poses, [\d.]+ times less error than description", verdict)
    assert "over: all that was measured and 280 mm around it" in " ".join(said.out.split())
    answer = json.loads(
        cli("correct", work / "cell.toml", identified, "--out", work / "b", "--json").out
    )
    rms = {row["route"]: row["rms_mm"] for row in answer["routes"]}
    assert list(rms) == WAYS
    assert list(rms.values()) == sorted(rms.values())
    times = rms["description"] / rms["corrected poses"]
    assert answer["verdict"] == (
        f"best: corrected poses (give poses.csv to have them), {times:.3g} times less error than "
        "description"
    )
    # every file says for which box, how good it is, and which tool goes with it
    for name, way in (("mastering.csv", "mastering"), ("corrected.urdf", "description")):
        head = (out / name).read_text()[:2000]
        assert "for all that was measured and 280 mm around it" in head
        assert f"{rms[way]:.3g} mm rms" in head
        assert "the base placed anew" in head
        place = next(row["tool_mm"] for row in answer["routes"] if row["route"] == way)
        assert f"{place[0]:.3f}" in head
    assert f"{rms['corrected poses']:.3g} mm rms" in (out / "corrected_poses.csv").read_text()[:900]


def test_values_are_those_of_their_way_and_a_named_model_stays_as_it_is(cli, work, identified):
    """Compliance cannot be mastered, and zero offsets take up a part of it over the box."""
    name = json.loads(identified.read_text())["recommended"]
    typed = ("correct", work / "cell.toml", identified, "--json", "--out")
    best = json.loads(cli(*typed, work / "best").out)
    plain = json.loads(cli(*typed, work / "plain", "--model", name).out)
    left, before = ({r["route"]: r["rms_mm"] for r in a["routes"]} for a in (best, plain))
    assert left["mastering"] < 0.9 * before["mastering"]
    assert left["description"] < 0.5 * before["description"]
    assert left["as it is"] == pytest.approx(before["as it is"])
    files = [(work / where / "mastering.csv").read_text() for where in ("best", "plain")]
    assert files[0] != files[1]


def test_the_reference_of_the_file_is_what_is_corrected_by(cli, work, changed):
    path = changed(lambda c: c.update(reference=c["models"][-1]["name"]))
    largest = json.loads(path.read_text())["reference"]
    assert "geometry" in largest or "everything" in largest
    typed = ("correct", work / "cell.toml", path, "--json", "--out", work / "out")
    answer = json.loads(cli(*typed).out)
    assert answer["model"] == largest
    offsets = json.loads(cli(*typed, "--model", "offsets").out)
    assert offsets["model"] == "offsets"
    # of a reference that knows links and reducers, offsets alone leave what they do not have
    rows = {row["route"]: row for row in offsets["routes"]}
    assert rows["corrected poses"]["not_carried_mm"] > 0.05


def test_a_zero_that_only_a_prior_holds_is_not_mastered(cli, work, changed):
    def held(content: dict[str, Any]) -> None:
        best(content)["held_by_prior"] = ["zero_offset.joint_4"]
        for p in best(content)["parameters"]:
            if p["name"] == "zero_offset.joint_4":
                p["value"] = 1e-5

    typed = ("correct", work / "cell.toml", changed(held), "--out", work / "out")
    name = best(json.loads((work / "identification.json").read_text()))["name"]
    assert cli(*typed, "--model", name).code == 0
    rows = table(work / "out" / "mastering.csv")
    assert rows[3]["meaning"] == "J4 was not identified: its zero is taken as it is"
    assert rows[3]["sigma_deg"] is None
    assert rows[4]["sigma_deg"] > 0


def test_the_box_is_that_of_the_cell_or_the_one_given(cli, refuse, work, identified):
    typed = ("correct", work / "cell.toml", identified, "--out", work / "out")
    said = cli(*typed, "--box=1500,-200,400,1900,200,800")
    assert said.code == 0
    assert "over: the box given, " in said.out
    (work / "out" / "mastering.csv").unlink()
    (work / "out" / "corrected.urdf").unlink()
    refuse(*typed, "--box=1,2,3").says("'1,2,3' is not six numbers")
    refuse(*typed, "--box=9000,0,0,9900,1,1").says("no point of the task box", "--box")


def test_the_error_is_expected_where_identify_expects_it(cli, work):
    """One meaning, one label and the same place in both answers."""
    out = work / "same"
    words = ("identify", work / "cell.toml", work / "touchups.csv", "--out", out)
    identified = cli(*words, "--verbose")
    (out / "touchups.csv").write_bytes((work / "touchups.csv").read_bytes())
    said = cli("correct", work / "cell.toml", out / "identification.json", "--out", out, "-v")
    assert identified.code == said.code == 0
    told, answer = (" ".join(text.split()) for text in (identified.out, said.out))
    where = re.search(r"expected over: (.*?), the base placed anew", told)
    assert f"over: {where[1]}, " in answer
    assert "the base placed anew" in said.out
    assert "expected error: " in said.out
    content = json.loads((out / "identification.json").read_text())
    frames_mm = next(m for m in content["models"] if m["name"] == "frames only")["expected_box_mm"]
    left = re.search(r"as it is ([\d.]+) mm", answer)
    assert float(left[1]) == pytest.approx(frames_mm, rel=0.15)


def test_a_tool_of_another_name_is_corrected_as_the_cells(cli, refuse, work, changed):
    """A reflector that sits where the tool is, say."""

    def renamed(content: dict[str, Any]) -> None:
        for model in content["models"]:
            for p in model["parameters"]:
                p["name"] = p["name"].replace("tool.", "tool.p1.")

    path, poses = changed(renamed), work / "poses.csv"
    typed = ("correct", work / "cell.toml", path, poses, "--out", work / "out")
    said = cli(*typed)
    assert said.code == 0
    assert "the tool point 'p1' is taken for the cell's tool" in said.err.splitlines()[0]
    cell = Cell.load(work / "cell.toml")
    model, x = as_identified(cell, json.loads(path.read_text()))
    wanted = cell.robot.state(read_poses(poses, 6).postures).point(cell.tool_m)
    commands = read_poses(work / "out" / "corrected_poses.csv", 6).postures
    np.testing.assert_allclose(model.view(commands, x).tool_points, wanted, atol=1e-9)
    for name in ("corrected_poses.csv", "mastering.csv", "corrected.urdf"):
        (work / "out" / name).unlink()
    refuse(*typed, "--tool", "p2").says("no tool point 'p2'", "p1")


def test_several_tool_points_are_to_be_told_apart(cli, work, changed):
    def two(content: dict[str, Any]) -> None:
        for model in content["models"]:
            model.pop("covariance_si", None)
            for p in list(model["parameters"]):
                if p["name"].startswith("tool."):
                    axis = p["name"][-1]
                    p["name"] = f"tool.p1.{axis}"
                    model["parameters"].append({**p, "name": f"tool.p2.{axis}"})

    path = changed(two)
    typed = ("correct", work / "cell.toml", path, work / "poses.csv", "--out", work / "out")
    said = cli(*typed)
    assert said.code == 0
    assert "name it with --tool" in said.err.splitlines()[0]
    assert "no correlations" in said.err
    named = cli(*typed, "--tool", "p2")
    assert named.code == 0
    assert "--tool" not in named.err


def test_corrected_poses_become_a_program(cli, work, identified):
    out, cell = work / "out", work / "cell.toml"
    assert cli("correct", cell, identified, work / "poses.csv", "--out", out).code == 0
    corrected = out / "corrected_poses.csv"
    said = cli("program", corrected, "--cell", cell, "--out", out)
    assert said.code == 0, said
    by = checksum(identified)
    assert f"27 poses, CORRECTED BY {by}, not those of the plan" in said.out
    (written,) = out.glob("*.LS")
    assert f"!* CORRECTED BY {by}" in written.read_text()
    assert f"corrected by the identification {by}" in cli("check", cell, corrected).err


def test_corrected_poses_are_no_touch_ups_and_no_plan(cli, refuse, work, identified):
    """All of them differ from the plan: as touch-ups they would be a perfect robot."""
    out, cell, plan = work / "out", work / "cell.toml", work / "poses.csv"
    typed = ("correct", cell, identified)
    assert cli(*typed, plan, "--out", out).code == 0
    corrected = out / "corrected_poses.csv"
    by = f"corrected by the identification {checksum(identified)}"
    refuse(*typed, corrected, "--out", work / "twice").says(by, "not those of the plan", "--again")
    assert cli(*typed, corrected, "--again", "--out", work / "twice").code == 0
    into = ("--out", work / "in")
    cli("program", corrected, "--cell", cell, "--out", out)
    (program,) = out.glob("*.LS")
    for file in (corrected, program):
        for given in ((), ("--poses", plan)):
            refuse("import", cell, file, *given, *into).says(by, "touched up", "--keep-untouched")
        said = cli("import", cell, file, "--poses", corrected, *into)
        assert (said.code, "no position differs from the plan" in said.err) == (2, True)
    cli("program", plan, "--cell", cell, "--form", "cartesian", "--name", "WELD", "--out", work)
    assert cli(*typed, work / "WELD.LS", "--out", out).code == 0
    typed = ("import", cell, out / "WELD.LS", "--poses", plan, *into)
    refuse(*typed).says(by, "touched up")
    assert by in cli(*typed, "--keep-untouched").err
    # a list that a plan was written to is none, either
    plan.write_text(f"# fingerprint: 0a1b2c3d\n{plan.read_text()}")
    refuse("import", cell, plan, "--out", work / "list").says("was written from", "--poses")


def test_a_model_can_be_named(cli, work, identified):
    said = cli(
        "correct", work / "cell.toml", identified, "--model", "offsets", "--out", work, "--json"
    )
    assert said.code == 0
    answer = json.loads(said.out)
    assert answer["model"] == "offsets"
    assert answer["left_out"] == []
    assert answer["poses"] == []
    assert len(answer["mastering"]) == 6


def test_what_a_description_cannot_hold_is_told(cli, work, identified):
    said = cli("correct", work / "cell.toml", identified, "--out", work / "out")
    assert "compliance" in json.loads(identified.read_text())["recommended"]
    assert "neither mastering nor a description can hold: compliance of joints" in said.err
    assert b"compliance of joints" in (work / "out" / "corrected.urdf").read_bytes()


def test_a_pose_beyond_a_limit_is_dropped_with_its_reason(cli, work, changed, change_csv):
    def more(content: dict[str, Any]) -> None:
        for p in best(content)["parameters"]:
            if p["name"] == "zero_offset.joint_5":
                p["value"] = 1.0

    path, poses = changed(more), change_csv("poses.csv", 1, "j5_deg", "-124.9")
    said = cli("correct", work / "cell.toml", path, poses, "--out", work / "out")
    assert said.code == 1
    assert "27 of 28 postures corrected" in said.out
    assert "joint_5 -126." in said.out
    last = table(work / "out" / "corrected_poses.csv")[-1]
    assert last["status"] == "dropped"
    assert last["reason"].startswith("not corrected: outside limits: joint_5 -126.")
    assert last["j1_deg"] is None


def test_ways_between_poses_are_corrected_too(cli, work, identified, change_csv):
    poses = change_csv("poses.csv", 2, "status", "via")
    assert cli("correct", work / "cell.toml", identified, poses, "--out", work / "out").code == 0
    rows = table(work / "out" / "corrected_poses.csv")
    assert [row["status"] for row in rows[:2]] == [table(poses)[0]["status"], "via"]


def test_another_tool_than_the_cells_is_not_brought_to_the_poses(cli, work, changed):
    def farther(content: dict[str, Any]) -> None:
        next(p for p in best(content)["parameters"] if p["name"] == "tool.x")["value"] += 50.0

    path = changed(farther)
    said = cli("correct", work / "cell.toml", path, work / "poses.csv", "--out", work / "out")
    assert said.code == 0
    assert "the tool as identified is not the cell's" in said.err
    said = [row["reason"] for row in table(work / "out" / "corrected_poses.csv")]
    moved = [words for words in said if words.startswith("corrected by up to")]
    assert len(moved) == 27
    assert all(float(words.split("up to ")[1].split(" ")[0]) < 1.0 for words in moved)


def test_a_urdf_keeps_its_own_text(cli, work, make_urdf):
    source = make_urdf()
    before = source.read_text()
    cell = work / "small.toml"
    cell.write_text(
        '[robot]\nurdf = "small.urdf"\n[tool]\npoint_mm = [50.0, 0.0, 80.0]\n'
        "[base_pose]\nposture_deg = [0.0, 30.0, 40.0, 10.0, 50.0, 0.0]\n"
    )
    content = {
        "robot": "small",
        "recommended": "offsets",
        "models": [
            {
                "name": "offsets",
                "parameters": [
                    {"name": "zero_offset.a3", "value": 0.5, "unit": "deg", "sigma": 0.01}
                ],
            }
        ],
    }
    (work / "small.json").write_text(json.dumps(content))
    said = cli("correct", cell, work / "small.json", "--out", work / "out")
    assert said.code == 0, said
    old, new = before.splitlines(), (work / "out" / "corrected.urdf").read_text().splitlines()
    assert new[0].startswith("<!-- origin: computed corrected description by correct from small")
    assert new[1].startswith("<!-- Joint origins as identified")
    assert sum(a != b for a, b in zip(old, new[2:], strict=True)) == 1
    assert source.read_text() == before
    q = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    again = Robot.from_urdf(work / "out" / "corrected.urdf")
    moved = q + np.deg2rad([0.0, 0.0, 0.5, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(again.fk(q), Robot.from_urdf(source).fk(moved), atol=1e-12)


# Bad input --------------------------------------------------------------------------------------


def first(content: dict[str, Any]) -> dict[str, Any]:
    parameter: dict[str, Any] = best(content)["parameters"][0]
    return parameter


BAD_CHANGES = {
    "another robot": (lambda c: c.update(robot="m20ia"), ["'m20ia'", "r2000ic165f"]),
    "other joints": (lambda c: c.update(joints=["a", "b"]), ["other joints"]),
    "no joints": (lambda c: c.update(joints=[]), ["other joints"]),
    "an arm that is none": (lambda c: c.update(arm=3), ["arm", "no table"]),
    "another model damaged": (
        lambda c: c["models"][0].update(name=3),
        ["models.0.name", "no text"],
    ),
    "no robot": (lambda c: c.pop("robot"), ["robot", "no text"]),
    "no models": (lambda c: c.pop("models"), ["models", "is missing"]),
    "empty models": (lambda c: c.update(models=[]), ["no list of models"]),
    "models of numbers": (lambda c: c.update(models=[1, 2]), ["models.0", "is no table of keys"]),
    "unknown recommended": (lambda c: c.update(recommended="offset"), ["no model 'offset'"]),
    "none recommended": (lambda c: c.update(recommended=None), ["--model", "frames only"]),
    "no parameters": (lambda c: best(c).update(parameters=[]), ["has no parameters"]),
    "parameters missing": (lambda c: best(c).pop("parameters"), ["has no parameters"]),
    "parameters no table": (
        lambda c: best(c).update(parameters=["x"]),
        ["parameters.0", "no table"],
    ),
    "a name twice": (lambda c: best(c)["parameters"].append(dict(first(c))), ["appears twice"]),
    "an unknown name": (lambda c: first(c).update(name="zero_offset.joint_9"), ["joint_9"]),
    "a hostile name": (lambda c: first(c).update(name="\x1b[2J\n" * 500), ["no parameter"]),
    "value as text": (
        lambda c: first(c).update(value="1"),
        ["0.value", "not a finite"],
    ),
    "value true": (lambda c: first(c).update(value=True), ["not a finite number"]),
    "value missing": (lambda c: first(c).pop("value"), ["value", "is missing"]),
    "value null": (lambda c: first(c).update(value=None), ["not a finite number"]),
    "a payload of 400 digits": (
        lambda c: c["arm"]["payloads"][0].__setitem__(1, 10**400),
        ["is no valid JSON", "1000", "not a finite number"],
    ),
    "value huge": (lambda c: first(c).update(value=10**400), ["not a finite number"]),
    "sigma below zero": (lambda c: first(c).update(sigma=-1.0), ["below zero"]),
    "another unit": (lambda c: first(c).update(unit="rad"), ["'rad'", "not in deg"]),
    "held by no names": (lambda c: best(c).update(held_by_prior=3), ["held_by_prior", "no list"]),
    "a reference that is not there": (lambda c: c.update(reference="all"), ["no model 'all'"]),
    "a reference that is a number": (lambda c: c.update(reference=3), ["reference", "no text"]),
    "covariance of another size": (
        lambda c: best(c).update(covariance_si=[[1.0]]),
        ["covariance_si", "table of"],
    ),
    "no covariance": (
        lambda c: best(c).update(covariance_si=(-np.eye(len(best(c)["parameters"]))).tolist()),
        ["is no covariance"],
    ),
}


@pytest.mark.parametrize("how", BAD_CHANGES)
def test_identifications_that_cannot_be_used_are_refused(refuse, work, changed, how):
    change, words = BAD_CHANGES[how]
    path = changed(change)
    refuse("correct", work / "cell.toml", path, "--out", work / "out").says(*words)


BAD_TEXTS = {
    "empty": ("", ["no valid JSON"]),
    "no JSON": ("robot: r2000ic165f", ["no valid JSON"]),
    "a list": ("[1, 2]", ["is no table of keys"]),
    "NaN": ('{"robot": NaN}', ["NaN is not a finite number"]),
    "Infinity": ('{"robot": -Infinity}', ["-Infinity is not a finite number"]),
    "too deep": ("[" * 200_000, ["no valid JSON"]),
    "a number of many digits": ("1" * 10_000, ["no valid JSON"]),
}


@pytest.mark.parametrize("what", BAD_TEXTS)
def test_files_that_are_no_identification_are_refused(refuse, work, identified, what):
    text, words = BAD_TEXTS[what]
    identified.write_text(text)
    refuse("correct", work / "cell.toml", identified, "--out", work / "out").says(*words)


def test_bytes_and_folders_are_refused(refuse, work, identified):
    identified.write_bytes(b"\xff\xfe\x00{")
    refuse("correct", work / "cell.toml", identified, "--out", work / "out").says("not UTF-8")
    refuse("correct", work / "cell.toml", work, "--out", work / "out").says("cannot be read")
    refuse("correct", work / "cell.toml", work / "none.json").says("No such file")


def test_a_file_too_large_is_refused(refuse, work, identified, monkeypatch):
    monkeypatch.setattr("posedesign.files.json_files.LARGEST_JSON_BYTES", 1000)
    refuse("correct", work / "cell.toml", identified, "--out", work / "out").says("larger than")


def test_an_unknown_model_lists_near_ones(refuse, work, identified):
    said = refuse("correct", work / "cell.toml", identified, "--model", "ofsets", "--out", work)
    said.says("no model 'ofsets'", "did you mean offsets")


def test_a_model_of_the_set_up_alone_is_refused(refuse, work, identified):
    said = refuse(
        "correct", work / "cell.toml", identified, "--model", "frames only", "--out", work / "out"
    )
    said.says("nothing of the arm to correct")


def test_poses_of_another_robot_are_refused(refuse, work, identified):
    poses = work / "five.csv"
    poses.write_text("j1_deg,j2_deg,j3_deg,j4_deg,j5_deg\n10,20,30,40,50\n")
    refuse("correct", work / "cell.toml", identified, poses, "--out", work / "o").says("j6_deg")


def test_an_output_folder_that_is_a_file_is_refused(refuse, work, identified):
    refuse("correct", work / "cell.toml", identified, "--out", identified).says("output folder")


def test_nothing_outside_the_output_folder_is_written(cli, work, identified):
    before = {path: path.read_bytes() for path in work.rglob("*")}
    out = work / "out"
    assert (
        cli("correct", work / "cell.toml", identified, work / "poses.csv", "--out", out).code == 0
    )
    assert {path: path.read_bytes() for path in work.iterdir() if path != out} == before


# predict ----------------------------------------------------------------------------------------


def test_predict_prints_and_writes_a_table(cli, work):
    said = cli(
        "predict",
        work / "cell.toml",
        work / "poses.csv",
        "--box=1400,-300,500,2000,300,1100",
        "--steps=2,1,2",
        "--out",
        work / "out",
    )
    assert said.code == 0, said
    rows = table(work / "out" / "predicted_accuracy.csv")
    assert [(r["x_mm"], r["y_mm"], r["z_mm"]) for r in rows] == [
        (1400, 0, 500),
        (1400, 0, 1100),
        (2000, 0, 500),
        (2000, 0, 1100),
    ]
    for row in rows:
        assert row["rms_to_target_mm"] > 0.0
        sigma = [row[f"sigma_{axis}_mm"] for axis in "xyz"]
        assert row["rms_mm"] == pytest.approx(sum(value**2 for value in sigma) ** 0.5, rel=1e-3)
        assert 0.0 < row["worst_sigma_mm"] <= row["rms_mm"] < 1.0
    assert "4 of 4 points reached" in said.out
    assert "the base is placed anew" in " ".join(said.out.split())


def test_of_ten_parameters_the_tool_point_is_known_to_the_target(cli, work):
    path = work / "cell.toml"
    path.write_text(path.read_text().replace("# planned =", "planned ="))
    box = ("--box=1400,-300,500,2000,300,1100", "--steps=2,1,2")
    cli("predict", path, work / "poses.csv", *box, "--out", work / "out")
    rows = table(work / "out" / "predicted_accuracy.csv")
    assert all(0 < r["rms_to_target_mm"] < 1.0 for r in rows)


def test_a_box_may_begin_with_a_minus(cli, work):
    said = cli(
        *("predict", work / "cell.toml", work / "poses.csv"),
        *("--box", "-300,1300,500,300,1900,1100", "--out", work / "out", "--json"),
    )
    assert said.code == 0, said
    answer = json.loads(said.out)
    assert len(answer["points"]) == 27
    assert "joint 1" in answer["reference"]


MORE = "offsets + compliance"


def test_a_model_of_the_cell_can_be_predicted(cli, refuse, work):
    typed = ["predict", work / "cell.toml", work / "poses.csv", "--box", "1400,0,500,2000,1,1100"]

    def points(*options):
        found = json.loads(cli(*typed, *options, "--out", work / "out", "--json").out)
        return found["points"]

    every, few, more = points(), points("--model", "offsets"), points("--model", MORE)
    path = work / "cell.toml"
    path.write_text(path.read_text().replace("# planned =", "planned ="))
    for a, b, c, d in zip(every, few, points(), more, strict=True):
        assert c["rms_mm"] == pytest.approx(b["rms_mm"], rel=1e-6)
        assert a["rms_mm"] > d["rms_mm"] > b["rms_mm"]  # more is to be told by the same touch-ups
    (work / "out" / "predicted_accuracy.csv").unlink()
    refuse(*typed, "--model", "offset", "--out", work / "o").says("no model 'offset'", "offsets")


def test_the_box_of_the_cell(cli, work):
    path = work / "cell.toml"
    section = "[task_box]\nlowest_mm = [1500.0, 0.0, 800.0]\nhighest_mm = [6000.0, 0.0, 800.0]\n"
    path.write_text(path.read_text() + section + "steps = [2, 1, 1]\n")
    said = cli("predict", path, work / "poses.csv", "--out", work / "out", "--json")
    assert said.code == 0, said
    points = json.loads(said.out)["points"]
    assert [p["x_mm"] for p in points] == [1500.0, 6000.0]
    assert points[1]["reason"].startswith("out of reach")
    assert points[1]["rms_mm"] is None


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], ["there is no task box", "--box"]),
        (["--box", "1,2,3"], ["not six numbers"]),
        (["--box", "2000,0,500,1000,0,600"], ["upside down along x"]),
        (["--box", "1000,0,500,nan,0,600"], ["not six numbers"]),
        (["--box", "9000,0,0,9100,1,1"], ["no point of the task box can be reached"]),
        (["--box", "1000,0,500,1100,1,600", "--steps", "3,3"], ["three whole numbers"]),
        (["--box", "1000,0,500,1100,1,600", "--steps", "3,3,0"], ["at least one"]),
        (["--box", "1000,0,500,1100,1,600", "--steps", "9999999,9,9"], ["in all"]),
    ],
)
def test_boxes_that_cannot_be_used_are_refused(refuse, work, options, words):
    said = refuse("predict", work / "cell.toml", work / "poses.csv", *options, "--out", work / "o")
    said.says(*words)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("lowest_mm = [1.0, 0.0, 9.0]\nhighest_mm = [2.0, 1.0, 5.0]", ["upside down along z"]),
        ("lowest_mm = [1.0, 0.0, 0.0]", ["highest_mm", "missing"]),
        ("lowest_mm = [1.0, 0.0, 0.0]\nhighest_mm = [2.0, 1.0, 5.0]\nsteps = [0, 1, 1]", ["steps"]),
        (
            "lowest_mm = [1.0, 0.0, 0.0]\nhighest_mm = [2.0, 1.0, 5.0]\nstep = [1, 1, 1]",
            ["step", "did you mean steps"],
        ),
    ],
)
def test_sections_that_are_no_box_are_refused(refuse, work, text, words):
    path = work / "cell.toml"
    path.write_text(path.read_text() + f"[task_box]\n{text}\n")
    refuse("predict", path, work / "poses.csv", "--out", work / "o").says("task_box", *words)


def test_poses_that_identify_nothing_are_refused(refuse, work):
    lines = (work / "poses.csv").read_text().splitlines()
    for count, words in ((1, "1 measurements give 3 equations"), (2, "cannot identify target.T1")):
        (work / "poses.csv").write_text("\n".join(lines[: 1 + count]) + "\n")
        said = refuse(
            "predict", work / "cell.toml", work / "poses.csv", "--box", "1400,0,500,2000,1,1100"
        )
        said.says(words)


def test_ways_that_leave_the_same_are_named_beside_the_plainest(cli, work, identified):
    """Zero offsets are carried whole by each: the controller's own way is put first."""
    typed = ("correct", work / "cell.toml", identified, "--model", "offsets", "--json")
    answer = json.loads(cli(*typed, "--out", work / "out").out)
    assert answer["verdict"] == (
        "best: mastering, the plainest of those that leave the same within 2 %: so do description "
        "and corrected poses (give poses.csv to have them)"
    )


@pytest.fixture
def program(cli, work) -> Callable[..., Path]:
    """A program of the poses in a folder of its own."""

    def written(form: str) -> Path:
        folder = work / "programs"
        typed = ("program", work / "poses.csv", "--cell", work / "cell.toml", "--name", "WELD")
        said = cli(*typed, "--format", "fanuc-ls", "--form", form, "--out", folder)
        assert said.code == 0, said
        return folder / "WELD.LS"

    return written


def test_a_program_is_corrected_into_another_folder(cli, work, identified, program):
    path = program("cartesian")
    before = path.read_bytes()
    typed = ("correct", work / "cell.toml", identified, path, "--out", work / "out")
    said = cli(*typed)
    assert said.code == 0, said
    assert "28 positions keep their place on the real arm" in said.out
    assert "taught on the arm are right already" in said.err
    assert [p.name for p in (work / "out").iterdir()] == ["WELD.LS"]
    assert path.read_bytes() == before
    texts = [p.read_text().split("\n") for p in (path, work / "out" / "WELD.LS")]
    (comment,) = (line for line in texts[1] if "CORRECTED BY" in line)
    assert comment == f"{int(comment[:4]):4d}:  !CORRECTED BY {checksum(identified)} ;"
    texts[1].remove(comment)
    changed = [a for a, b in zip(*texts, strict=True) if a != b]
    assert len(changed) == 2 * 28 + 1
    assert all(re.match(r"\t[XW] =|LINE_COUNT", line) for line in changed)
    # the simulated arm, with the errors that it has, stands where it should, all else being equal
    cell = Cell.load(work / "cell.toml")
    truth = SimulatedRobot.of(cell)
    arm = arm_of(cell)
    meant, now = (postures_of(read(p).positions, arm) for p in (path, work / "out" / "WELD.LS"))
    wanted = cell.robot.state(meant).point(cell.tool_m)
    off = truth.model.view(now, truth.values).tool_points - wanted
    assert np.linalg.norm(off - off.mean(axis=0), axis=1).max() < 1e-4
    # the same again is no other file
    assert cli(*typed, "--json").code == 0
    valid = cli("validate", work / "out" / "WELD.LS")
    assert (valid.code, "of the arm corrected by the identification" in valid.err) == (0, True)


def test_a_corrected_program_is_not_corrected_again(cli, work, identified, program):
    typed = ("correct", work / "cell.toml", identified)
    assert cli(*typed, program("cartesian"), "--out", work / "out").code == 0
    again = (*typed, work / "out" / "WELD.LS", "--out", work / "twice")
    said = cli(*again)
    assert said.code == 2
    assert "are corrected by the identification" in said.err
    assert "--again" in said.err
    assert not (work / "twice").exists()
    assert cli(*again, "--again").code == 0
    assert (work / "twice" / "WELD.LS").read_text().count("CORRECTED BY") == 2


def test_positions_of_a_program_in_numbers(cli, work, identified, program):
    path = program("joint")
    typed = ("correct", work / "cell.toml", identified, path, "--out", work / "out", "--json")
    said = cli(*typed, "--joints", "--leave", "1, 2")
    assert said.code == 0, said
    content = json.loads(said.out)
    assert [p["number"] for p in content["positions"]] == list(range(3, 29))
    assert max(p["error_mm"] for p in content["positions"]) < 1e-9
    assert max(p["written_mm"] for p in content["positions"]) < 0.04
    assert max(p["without_mm"] for p in content["positions"]) > 1.0
    assert any("2 of 28 positions are as they were" in said for said in content["notes"])
    assert content["files"] == [str(work / "out" / "WELD.LS")]


def test_programs_that_cannot_be_corrected_are_refused(refuse, cli, work, identified, program):
    joint = program("joint")
    typed = ("correct", work / "cell.toml", identified)
    there = ("--out", work / "out")
    refuse(*typed, joint, *there).says("has joint targets only", "--joints")
    refuse(*typed, joint, "--joints", "--leave", "x", *there).says("no number of a position")
    refuse(*typed, joint, "--joints", "--leave", "77", *there).says("no position 77")
    refuse(*typed, joint, "--joints", "--out", joint.parent).says("would be replaced", "--out")
    whole = joint.read_text()
    joint.write_text(whole.replace("/END", ""))
    refuse(*typed, joint, "--joints", *there).says("is cut off", "WELD.LS")
    refuse(*typed, work / "NONE.LS", *there).says("cannot be read")
    refuse(*typed, joint, "--format", "fanuc", *there).says("unknown dialect", "fanuc-ls")
    (work / "out").mkdir()
    (work / "out" / "WELD.LS").write_text("mine")
    joint.write_text(whole)
    refuse(*typed, joint, "--joints", *there).says("WELD.LS", "is not replaced")


def test_options_that_would_do_nothing_are_refused(refuse, work, identified, program):
    path, there = program("joint"), ("--out", work / "out")
    typed = ("correct", work / "cell.toml", identified)
    box = ("--box", "1000,0,500,1100,1,600")
    refuse(*typed, path, "--joints", *box, *there).says("--box does nothing for a program")
    refuse(*typed, path, "--export", "dh", *there).says("--export does nothing for a program")
    refuse(*typed, work / "poses.csv", "--joints", *there).says("--joints does nothing for")
    refuse(*typed, "--leave", "3", *there).says("--leave does nothing for anything but a program")


def test_frames_that_nobody_says_are_refused(refuse, work, identified):
    """A job of another maker, and a target in a frame that has only a number."""
    path = work / "WELD.LS"
    path.write_text(
        "/PROG  WELD\n/ATTR\n/MN\n   1:J P[1] 10% FINE ;\n/POS\nP[1]{\n   GP1:\n"
        "\tUF : F, UT : F,\t\tCONFIG : 'N U T, 0, 0, 0',\n"
        "\tX =  1800.000  mm,\tY =     0.000  mm,\tZ =   900.000  mm,\n"
        "\tW =   180.000 deg,\tP =   -30.000 deg,\tR =     0.000 deg\n};\n/END\n"
    )
    typed = ("correct", work / "cell.toml", identified)
    refuse(*typed, path, "--out", work / "out").says("nothing says in which tool frame", "WELD.LS")
    path.write_text(path.read_text().replace("UF : F, UT : F", "UF : 3, UT : 1"))
    refuse(*typed, path, "--out", work / "out").says("user frame 3", "program.user")
    other = work / "weld.script"
    other.write_text("def weld():\n  movej([0, -1, 1, 0, 1, 0])\nend\n")
    refuse(*typed, other, "--joints", "--out", work / "out").says("controller of fanuc")


def test_other_forms_are_exported_beside_the_description(cli, refuse, work, identified):
    typed = ("correct", work / "cell.toml", identified, "--out", work / "out")
    refuse(*typed, "--export", "ur-kinematics").says("no arm of Universal Robots")
    refuse(*typed, "--export", "denavit").says("unknown form 'denavit'", "dh")
    said = cli(*typed, "--export", "dh-modified", "--export", "dh-hayati")
    assert said.code == 0, said
    written = ["corrected.urdf", "corrected_dh_hayati.csv", "corrected_dh_modified.csv"]
    assert sorted(p.name for p in (work / "out").iterdir()) == [*written, "mastering.csv"]
    text = (work / "out" / "corrected_dh_hayati.csv").read_text()
    assert text.startswith("# origin: computed DH table with Hayati's rows by correct")
    assert "the base placed anew" in text
    assert "ZERO POSITION MASTER" in (work / "out" / "mastering.csv").read_text()
    assert cli(*typed).code == 0  # what was asked for the last time only is removed
    assert sorted(p.name for p in (work / "out").iterdir()) == ["corrected.urdf", "mastering.csv"]


def test_poses_are_corrected_with_the_load_that_they_are_for(cli, refuse, work, changed):
    """The arm gives way by what it carries: the tool, and a payload besides."""
    cell_file, plan, out = work / "cell.toml", work / "poses.csv", work / "out"
    cell_file.write_text(
        cell_file.read_text()
        + '[[payload]]\nname = "weight"\nmass_kg = 50.0\ncom_mm = [0.0, 0.0, 200.0]\n'
    )
    cell = Cell.load(cell_file)
    loads = [[load.mass_kg, *(1e3 * load.com_m)] for load in payloads_of(cell)]
    path = changed(lambda content: content["arm"].update(payloads=loads))
    rows = [line for line in plan.read_text().splitlines() if not line.startswith("#")]
    carried = ["weight" if k % 2 else "" for k in range(len(rows) - 1)]
    named = [f"{row},{load}" for row, load in zip(rows, ["payload", *carried], strict=True)]
    plan.write_text("\n".join(named))
    assert cli("correct", cell_file, path, plan, "--out", out).code == 0
    found = read_poses(out / "corrected_poses.csv", 6)
    assert list(found.extra["payload"]) == carried
    model, x = as_identified(cell, json.loads(path.read_text()))
    setup = Setup.of(len(carried), payload=[int(load == "weight") for load in carried])
    wanted = cell.robot.state(read_poses(plan, 6).postures).point(cell.tool_m)
    there = model.view(found.postures, x, setup).tool_points
    np.testing.assert_allclose(there, wanted, atol=1e-9)
    assert np.abs(model.view(found.postures, x).tool_points - wanted).max() > 1e-4
    plan.write_text(plan.read_text().replace(",weight", ",wight"))
    refuse("correct", cell_file, path, plan, "--out", out).says("no payload 'wight'", "weight")


def test_an_identification_is_of_the_arm_as_it_was_described(cli, refuse, work, identified):
    """Of the corrected description, too: its errors would be corrected twice."""
    cell, out = work / "cell.toml", work / "out"
    assert cli("correct", cell, identified, "--out", out).code == 0
    text = cell.read_text()
    same = text.replace('preset = "r2000ic165f"', f'urdf = "{out / "corrected.urdf"}"')
    assert same != text
    cell.write_text(same.replace("deflection = true", "deflection = false"))
    refuse("correct", cell, identified, "--out", work / "twice").says(
        "was identified with another kinematics_si", "as it was"
    )
