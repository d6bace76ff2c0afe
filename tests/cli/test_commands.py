"""Every command as a person types it: what it says, what it writes, its exit code."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from calib.robots import preset_names
from calib.robots.controller import POSITIVE_AXES
from posedesign.cell import Cell, CellConfig
from posedesign.cell.file import cell_text
from posedesign.cli import output
from posedesign.programs import DIALECTS, read, validate
from tests.cli.conftest import rows_of

COMMANDS = (
    "robots",
    "new",
    "plan",
    "score",
    "view",
    "program",
    "simulate",
    "identify",
    "robot-world",
    "calibrate",
    "study",
    "demo",
)


def assert_table_shows(table: str, rows: list[dict[str, Any]], keys: tuple[str, ...]) -> None:
    """Each row of JSON stands on one line of the table, number by number."""
    for row in rows:
        wanted = [_shown(row[key]) for key in keys]
        assert any(all(w in line for w in wanted) for line in table.splitlines()), (wanted, table)


def _shown(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) >= 1e4 or 0 < abs(value) < 1e-4 else f"{value:.5g}"
    return str(value)


def test_bare_command_shows_help_and_counts_as_bad_input(cli, done):
    said = cli()
    assert said.code == 2
    assert said.err == ""
    assert all(f"\n  {command} " in said.out for command in COMMANDS)
    done("--help")
    assert cli("--help").out == said.out


@pytest.mark.parametrize(
    "command", [*COMMANDS, *(f"study {c}" for c in ("accuracy", "list", "run", "plot"))]
)
def test_help_of_each_command(done, command):
    said = done(*command.split(), "--help")
    assert f"posedesign {command}" in said.out
    assert said.err == ""


def test_robots(cli):
    table, said = cli("robots"), cli("robots", "--json")
    assert (table.code, said.code) == (0, 0)
    rows = json.loads(said.out)
    assert [row["preset"] for row in rows] == list(preset_names())
    assert_table_shows(table.out, rows, ("preset", "controller", "payload_kg"))


@pytest.mark.parametrize("preset", [None, *preset_names()])
def test_new_prints_a_cell(done, preset):
    said = done("new", *(["--robot", preset] if preset else []))
    if preset is None:  # nobody is to measure on a cell of a robot that was not asked for
        assert "reference cell, of a FANUC R-2000iC/165F" in said.err
        assert "posedesign new --robot" in said.err
    else:
        assert said.err == ""
    written = tomllib.loads(said.out)
    assert written["robot"]["preset"] == (preset or "r2000ic165f")
    # every section is there to be edited, and every key is said with its unit or its choices
    commented = {"noise", "instrument", "payload", "known_distance", "task_box", "board"}
    assert all(f"[{name}]" in said.out for name in commented)
    left_out = commented | {"other_targets"}  # further tables of the target's
    assert list(written) == [name for name in CellConfig.model_fields if name not in left_out]


@pytest.mark.slow
def test_the_cell_that_new_prints_can_be_planned(cli, done, tmp_path):
    """Of seven joints; all presets are planned in golden tests."""
    (tmp_path / "cell.toml").write_text(cli("new", "--robot", "panda").out)
    planned = done("plan", tmp_path / "cell.toml", "--out", tmp_path, "--json")
    assert json.loads(planned.out)["indices"]["c_g"] < 1e5


def with_capsules(text: str) -> str:
    """A cell of a URDF without shapes, decided as its head asks for."""
    assert "# DECIDE FIRST: the URDF has no collision geometry for l2, l3, l4, l5:" in text
    return text.replace("\n# capsule_radius_mm = ", "\ncapsule_radius_mm = 40 # ", 1)


def test_new_for_a_urdf(done, make_urdf, tmp_path):
    urdf = make_urdf()
    said = done("new", "--robot", urdf)
    assert "# tip taken to be l6, the last link of the longest chain" in said.out
    cell = tomllib.loads(said.out)
    assert Path(cell["robot"]["urdf"]) == urdf
    assert cell["robot"]["tip"] == "l6"
    assert cell["parameters"]["zero_offsets"] == ["a2", "a3", "a4", "a5"]
    assert "decide before planning: small has no collision geometry for l2, l3, l4, l5" in said.err
    (tmp_path / "cell.toml").write_text(with_capsules(said.out))
    done("plan", tmp_path / "cell.toml", "--out", tmp_path)
    assert [row["status"] for row in rows_of(tmp_path / "poses.csv")] == ["grid"] * 27 + ["via"]


def test_urdf_is_found_beside_the_cell(cli, done, make_urdf, tmp_path, monkeypatch):
    urdf = make_urdf()
    text = with_capsules(cli("new", "--robot", urdf).out)
    (tmp_path / "cell.toml").write_text(text.replace(str(urdf), urdf.name))
    monkeypatch.chdir("/")
    done("plan", tmp_path / "cell.toml", "--out", tmp_path)


def test_plan_reaches_the_threshold_at_40_deg(cli, done, work):
    out = work / "new" / "folder"
    said = done("plan", work / "cell.toml", "--out", out)
    assert said.err == (
        "note: plan.retreat_mm is 0: a tool that touches the target does not back off between the "
        "poses\n"
    )
    for line in (
        "target: T1 at (1915.4, 50.0, 493.0) mm in base_link, 0.0 mm from the tool point at the "
        "base posture; no obstacle is described",
        "not checked: collisions: constraints.collisions is false",
        "not checked: the view of the target: no [camera] is described",
    ):
        assert f"\n{line}\n" in said.out
    assert "threshold reached: C_G 9.719e+04 (asked for 1e+05) with 27 poses" in said.out
    assert "40/40/40 deg" in said.out
    assert f"wrote: {out / 'poses.csv'}, {out / 'rounds.csv'}," in said.out
    rounds = rows_of(out / "rounds.csv")
    assert [float(row["d_w_deg"]) for row in rounds] == [5, 10, 15, 20, 25, 30, 35, 40]
    assert float(rounds[-2]["c_g"]) > 1e5 > float(rounds[-1]["c_g"])
    assert [row["status"] for row in rows_of(out / "poses.csv")] == ["grid"] * 27 + ["via"]
    assert rows_of(out / "poses.csv")[-1]["reason"] == "return to base"
    timing = re.search(r"time: (\d+) s: (\d+) s moving, 540 s standing at 27", said.out)
    assert timing is not None
    assert int(timing[1]) == pytest.approx(int(timing[2]) + 540, abs=1)
    told = json.loads(cli("plan", work / "cell.toml", "--out", out, "--json").out)
    assert told["cycle_time_s"] == pytest.approx(int(timing[1]), abs=0.5)


def test_plan_as_json_says_what_the_tables_say(cli, work):
    out = work / "out"
    table = cli("plan", work / "cell.toml", "--out", out).out
    said = cli("plan", work / "cell.toml", "--out", out, "--json")
    plan = json.loads(said.out)
    assert plan["reached"] is True
    assert plan["stop"] == "threshold reached"
    assert plan["message"].partition("; NOT CHECKED")[0] in table
    keys = ("round", "d_w_deg", "grid", "repaired", "dropped", "c_g", "cond_2_g")
    assert_table_shows(table, plan["rounds"], keys)
    assert_table_shows(table, plan["predicted"], ("parameter", "predicted sigma", "unit"))
    assert len(plan["predicted"]) == 10
    # the threshold says nothing of the tool point, and nothing of what better poses would give
    expected = plan["expected_error"]
    assert plan["tcp_rms_mm"] == pytest.approx(expected["rms_mm"])
    assert f"expected error: {expected['rms_mm']:.3g} mm rms over" in table
    assert f"80 % of such arms {expected['low_mm']:.2g} to {expected['high_mm']:.2g} mm" in table
    assert f"better: about {plan['chosen_tcp_rms_mm']:.2g} mm with as many poses chosen" in table
    assert "(--method exchange)" in table
    assert all(Path(file).is_file() for file in plan["files"])
    assert plan["indices"]["c_g"] == pytest.approx(plan["rounds"][-1]["c_g"])


def test_numbers_are_not_cut_in_a_narrow_terminal(cli, work, monkeypatch):
    monkeypatch.setattr(output, "PIPE_WIDTH", 60)
    said = cli("plan", work / "cell.toml", "--out", work / "out").out
    assert "…" not in said
    rows = rows_of(work / "out" / "rounds.csv")
    keys = ("d_w_deg", "c_g", "cond_2_g", "sigma_zero_offset.joint_2_deg")
    numbers = [{key: float(row[key]) for key in keys} for row in rows]
    shown = [{**row, "d_w_deg": int(row["d_w_deg"])} for row in numbers]
    assert_table_shows(said, shown, keys)


@pytest.mark.parametrize(
    ("changes", "advice"),
    [
        (
            {"variations.largest_deg": "[20, 20, 20]"},
            "variation limit: C_G 6.502e+05 (asked for 1e+05) with 27 poses at D_W/D_P/D_R "
            "20/20/20 deg; raise variations.largest_deg or plan.condition_threshold",
        ),
        (
            {"variations.largest_deg": "[120, 120, 120]", "plan.condition_threshold": "1.0"},
            "no further improvement: C_G 2.042e+04 (asked for 1) with 27 poses at D_W/D_P/D_R "
            "70/70/70 deg; wider angles no longer help: raise plan.condition_threshold, or choose "
            "a base pose with more room around it",
        ),
    ],
)
def test_plan_that_falls_short_says_what_to_change(cli, change_cell, work, changes, advice):
    said = cli("plan", change_cell(changes), "--out", work / "out")
    assert said.code == 1
    assert advice in said.out
    assert (work / "out" / "poses.csv").is_file()
    as_json = json.loads(cli("plan", work / "cell.toml", "--out", work / "out", "--json").out)
    assert as_json["reached"] is False
    assert advice in as_json["message"]


def test_poses_that_cannot_be_taken_are_replaced_and_explained(cli, change_cell, work):
    cell = change_cell({"plan.limit_margin_deg": "35.0", "plan.condition_threshold": "5e4"})
    assert cli("plan", cell, "--out", work / "out").code in (0, 1)
    rows = rows_of(work / "out" / "poses.csv")
    repaired = [row for row in rows if row["status"] == "repaired"]
    assert repaired
    assert all(" deg is " in row["reason"] or "out of reach" in row["reason"] for row in repaired)
    point = rows[0]
    for row in rows:  # the tool point stays where it is
        for axis in ("x_mm", "y_mm", "z_mm"):
            assert float(row[axis]) == pytest.approx(float(point[axis]), abs=1e-5)


def test_dropped_poses_have_no_numbers_and_are_passed_over(cli, done, change_cell, work):
    keys = {
        "plan.repair": "false",
        "plan.limit_margin_deg": "35.0",
        "variations.start_deg": "[50.0, 50.0, 50.0]",
    }
    out = work / "out"
    planned = cli("plan", change_cell(keys), "--out", out)
    rows = rows_of(out / "poses.csv")
    dropped = [row for row in rows if row["status"] == "dropped"]
    assert 0 < len(dropped) < 27
    assert planned.code == 1  # fewer poses than there are in the grid
    assert f"({len(dropped)} of 27 dropped)" in planned.out
    program = f"program {out / 'poses.csv'} --cell {work / 'cell.toml'} --out {out}"
    assert planned.out.endswith(f"next: posedesign {program}\n")
    assert all(row["reason"] and not row["j1_deg"] and not row["x_mm"] for row in dropped)
    said = done("simulate", work / "cell.toml", out / "poses.csv", "--out", out)
    assert f"{27 - len(dropped)} touch-ups" in said.out
    next_command = f"identify {work / 'cell.toml'} {out / 'touchups.csv'} --out {out}"
    assert said.out.endswith(f"next: posedesign {next_command}\n")


def test_score_agrees_with_the_plan(cli, work):
    table = cli("score", work / "cell.toml", work / "poses.csv")
    said = cli("score", work / "cell.toml", work / "poses.csv", "--json")
    assert (table.code, said.code) == (0, 0)
    score = json.loads(said.out)
    plan = json.loads(cli("plan", work / "cell.toml", "--out", work / "o", "--json").out)
    assert score["indices"] == pytest.approx(plan["indices"], rel=1e-6)
    assert score["reached"] is True
    assert (score["problem"], score["not_feasible"]) == ("", [])
    assert_table_shows(table.out, score["predicted"], ("parameter", "predicted sigma", "unit"))
    rows = [
        {"index": key, "value": value, "scaling": score["scaling"].get(key, "")}
        for key, value in score["indices"].items()
    ]
    assert {"c_g", "cond_2_g", "cond_2_gtg", "o1", "o2", "o3", "o4", "o5", "d", "a", "e"} <= set(
        score["indices"]
    )
    assert_table_shows(table.out, rows, ("index", "value", "scaling"))
    assert "C_G 9.719e+04 is below 1e+05" in table.out


def test_score_of_poses_above_the_threshold(cli, change_cell, work):
    cell = change_cell({"plan.condition_threshold": "9e4"})
    said = cli("score", cell, work / "poses.csv")
    assert said.code == 1
    assert "C_G 9.719e+04 is not below 9e+04" in said.out


def test_score_of_too_few_poses(cli, work):
    lines = (work / "poses.csv").read_text().splitlines()
    (work / "few.csv").write_text("\n".join(lines[:4]) + "\n")
    said = cli("score", work / "cell.toml", work / "few.csv")
    assert said.code == 1
    assert "3 poses give 9 equations for 10 parameters" in said.out


def test_score_does_not_praise_poses_outside_the_limits(cli, work, change_csv):
    poses = change_csv("poses.csv", 2, "j2_deg", "76.5")
    said = cli("score", work / "cell.toml", poses)
    assert said.code == 1
    second = rows_of(work / "poses.csv")[1]["name"]
    assert f"warning: {second}: J2 76.5 deg is above 76.0 deg\n" in said.err
    score = json.loads(cli("score", work / "cell.toml", poses, "--json").out)
    assert score["reached"] is False
    assert score["not_feasible"] == [f"{second}: J2 76.5 deg is above 76.0 deg"]


def test_simulate_depends_on_the_seed_alone(cli, work):
    cli("simulate", work / "cell.toml", work / "poses.csv", "--out", work / "first")
    first = (work / "first" / "touchups.csv").read_bytes()
    cli("simulate", work / "cell.toml", work / "poses.csv", "--out", work / "same", "--seed", 1)
    cli("simulate", work / "cell.toml", work / "poses.csv", "--out", work / "other", "--seed", 2)
    assert (work / "same" / "touchups.csv").read_bytes() == first
    assert (work / "other" / "touchups.csv").read_bytes() != first
    rows = rows_of(work / "touchups.csv")
    assert {row["target"] for row in rows} == {"T1"}
    planned = [row["name"] for row in rows_of(work / "poses.csv") if row["status"] != "via"]
    assert [row["pose"] for row in rows] == planned
    assert sorted(planned) == [f"P{i:02d}" for i in range(1, 28)]
    assert len(rows_of(work / "pairs.csv")) == 27


def test_identify(identified_once):
    table, found = identified_once.said, identified_once.content
    assert table.code == 0
    models = {model["name"]: model for model in found["models"]}
    assert list(models) == [
        "frames only",
        "offsets",
        "offsets + compliance",
        "geometry with priors",
        "geometry + compliance with priors",
        "everything with priors",
    ]
    assert found["not_tried"] == ["geometry", "geometry + compliance"]
    before, offsets = models["frames only"], models["offsets"]
    assert (len(before["parameters"]), len(offsets["parameters"])) == (6, 10)
    assert found["nominal_rms_mm"] > before["rms_mm"]
    assert offsets["leave_one_out_rms_mm"] < 0.5 * before["leave_one_out_rms_mm"]
    # the simulated arm has offsets and gives way: nothing more is there to be found
    after = models["offsets + compliance"]
    assert found["recommended"] == after["name"]
    assert after["name"] in found["reason"]
    assert after["noise_scale"] < 1.3
    # what is printed of parameters is rounded by their sigma: see test_identify_edges
    assert_table_shows(table.out, after["parameters"], ("name", "unit"))
    keys = ("rms_mm", "max_mm", "leave_one_out_rms_mm")
    rows = [{"name": m["name"]} | {key: f"{m[key]:.4f}" for key in keys} for m in found["models"]]
    assert_table_shows(table.out, rows, ("name", *keys))
    assert after["message"] in table.out


def test_robot_world(cli, work):
    table = cli("robot-world", work / "pairs.csv", "--out", work)
    written = rows_of(work / "robot_world.csv")
    some = ("--method", "ml,zhuang", "--json")
    said = cli("robot-world", work / "pairs.csv", "--out", work, *some)
    assert (table.code, said.code) == (0, 0)
    rows = json.loads(said.out)
    assert [row["method"] for row in written] == [
        "ml",
        "ml-robust",
        "li-kronecker",
        "li-dual-quaternion",
        "zhuang",
        "hirsh",
    ]
    for letter in "xz":
        keys = tuple(f"{letter}_{axis}" for axis in ("x_mm", "y_mm", "z_mm", "w_deg", "r_deg"))
        assert_table_shows(table.out, rows, ("method", "status", *keys))
    for shown in rows:
        row = next(row for row in written if row["method"] == shown["method"])
        assert float(row["x_z_mm"]) == pytest.approx(shown["x_z_mm"], abs=1e-6)
        assert abs(float(row["x_x_mm"]) - 202.0) < 2.0  # the truth is tool_error_mm off nominal
        assert 0.0 < float(row["sigma_x_x_mm"]) < 2.0  # the residuals say how large the noise is


def test_program(cli, done, work):
    said = cli("program", work / "poses.csv", "--format", "fanuc-ls", "--out", work)
    assert (said.code, said.err) == (0, "")
    assert "\nnot checked: anything: the list of poses does not say what was\n" in said.out
    assert "\nnot checked: limits, collisions and target: pass --cell\n" in said.out
    checked = done("program", work / "poses.csv", "--cell", work / "cell.toml", "--out", work)
    assert "not checked: collisions: constraints.collisions is false\n" in checked.out
    assert "warning" not in checked.err
    assert f"wrote: {work / 'CALIB01.LS'}" in said.out
    assert "27 poses, 0 objections" in said.out
    assert validate(work / "CALIB01.LS") == []
    text = (work / "CALIB01.LS").read_text()
    plan = json.loads(cli("plan", work / "cell.toml", "--out", work / "out", "--json").out)
    assert plan["fingerprint"] in text


def test_program_takes_what_the_cell_says(done, change_cell, work):
    keys = {
        "program.name": '"TESTED"',
        "program.speed_percent": "7",
        "program.settle_s": "2.5",
        "program.measure_call": '"TOUCH"',
        "program.tool_frame": "3",
    }
    cell = change_cell(keys)
    said = done("program", work / "poses.csv", "--cell", cell, "--out", work, "--json")
    written = json.loads(said.out)
    assert written["paths"] == [str(work / "TESTED.LS")]
    assert written["c_g_rounded"] == pytest.approx(written["c_g"], rel=0.01)
    assert (written["poses"], written["problems"]) == (27, [])
    assert 0.0 < written["largest_rounding_deg"] < 0.001
    text = (work / "TESTED.LS").read_text()
    for word in ("/PROG  TESTED", " 7% ", "2.50(sec)", "CALL TOUCH(27)", "UTOOL_NUM=3"):
        assert word in text
    done("program", work / "poses.csv", "--cell", cell, "--name", "OTHER", "--out", work)
    assert len(read(work / "OTHER.LS").positions) == 28  # back at the base posture


def test_trust_units_takes_small_degrees(cli, work):
    text = "name,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg\n"
    text += "".join(f"A{i},0.{i},1,-2,0.5,-3,{i}\n" for i in range(1, 6))
    (work / "small.csv").write_text(text)
    assert cli("score", work / "cell.toml", work / "small.csv").code == 2
    assert cli("score", work / "cell.toml", work / "small.csv", "--trust-units").code in (0, 1)
    assert (
        cli(
            "program", work / "small.csv", "--trust-units", "--format", "fanuc-ls", "--out", work
        ).code
        == 0
    )


def test_new_of_a_xacro_file_with_arguments_and_packages(cli, done, tmp_path):
    """The cell reads the same again, wherever it is put, and a corrected description, too."""
    pytest.importorskip("xacro", reason="needs xacro (posedesign[xacro])")
    package = tmp_path / "src" / "two" / "parts-main"
    (package / "meshes").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>parts</name></package>")
    (package / "joint.xacro").write_text(
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<xacro:macro name="turn" params="k axis up"><link name="l${k}"/>'
        '<joint name="$(arg prefix)j${k}" type="revolute"><parent link="l${k - 1}"/>'
        '<child link="l${k}"/><origin xyz="0 0 ${up}"/><axis xyz="${axis}"/>'
        '<limit lower="-2" upper="2" velocity="2"/></joint></xacro:macro></robot>'
    )
    axes = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0")
    turns = "".join(
        f'<xacro:turn k="{k}" axis="{axis}" up="0.3"/>' for k, axis in enumerate(axes, start=1)
    )
    arm = tmp_path / "src" / "one" / "arm.urdf.xacro"
    arm.parent.mkdir()
    arm.write_text(
        '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<xacro:arg name="prefix" default=""/><xacro:include filename="$(find parts)/joint.xacro"/>'
        f'<link name="l0"/>{turns}</robot>'
    )
    words = ("--xacro-arg", "prefix:=left_", "--packages", tmp_path / "src")
    said = done("new", "--robot", arm, *words)
    assert "note: expanded from xacro, prefix:=left_, every other argument" in said.err
    cell = Cell.from_text(said.out)
    assert cell.robot.joint_names[0] == "left_j1"
    assert f'packages = ["{tmp_path / "src"}"]\nxacro_args = ["prefix:=left_"]\n' in said.out
    assert Cell.from_text(cell_text(cell.config, tmp_path)).robot.joint_names[0] == "left_j1"
    for words in (("--xacro-arg", "prefix"), ("--packages", arm)):
        assert cli("new", "--robot", arm, *words).code == 2
    assert cli("new", "--robot", "ur10e", "--xacro-arg", "prefix:=left_").code == 2


def test_each_maker_of_controllers_has_programs():
    """So that the next command after a plan need not look for one."""
    assert {*POSITIVE_AXES} <= {dialect.maker for dialect in DIALECTS.values()}
