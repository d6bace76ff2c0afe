"""``poses.csv``: what stands in it, in which forms, and what survives reading and writing it."""

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calib.errors import FileFormatError, InputError
from calib.se3 import rotation_from_wpr
from posedesign.files.csv_tables import read_rows, read_table, write_table
from posedesign.files.measurements import read_measurements, write_measurements
from posedesign.files.postures import JointForm, columns_of
from posedesign.planning import Margins, PosePlan, plan
from posedesign.planning.poses_file import (
    MARGIN_COLUMNS,
    DroppedPose,
    PoseList,
    read_poses,
    read_robot_poses,
    write_pose_list,
    write_poses,
)
from posedesign.programs import configurations

FILES_BETWEEN_EXAMPLES = settings(
    max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
EXACT = 1e-11
"""[rad]: nine decimals of a degree are 1.7e-11 rad, half of which is rounding."""

HOSTILE = ["=cmd()", "+1", "-1", "-x", "@x", "#x", "a # b", "'x", "'#x", 'say "x"', "a,b", "a\nb"]
HOSTILE += ["two\r\nlines", "\N{FULLWIDTH EQUALS SIGN}x", "1.50", "-2e3", "a;b", "nan", "x"]
cells = st.sampled_from(HOSTILE) | st.text(
    st.characters(exclude_categories=["Cs", "Cc", "Zs", "Zl", "Zp"]), max_size=9
)
columns = st.sampled_from([c for c in HOSTILE if "line" not in c]).map(lambda c: f"{c}!")


@pytest.fixture(scope="module")
def demo_plan(demo_cell) -> PosePlan:
    """Of the cell with gun, camera, fixture and floor."""
    return plan(demo_cell)


@pytest.fixture
def written(demo_cell, demo_plan, tmp_path) -> Path:
    """The table of that plan."""
    return write_poses(
        tmp_path / "poses.csv",
        demo_cell.robot,
        demo_plan.poses,
        demo_plan.route,
        demo_cell.tool_m,
        margins=Margins.of_route(demo_cell, demo_plan.poses, demo_plan.route),
        indices=demo_plan.indices,
    )


@pytest.fixture
def some(reference_cell) -> PoseList:
    """Four postures of the reference robot, the third of them passed through."""
    off = np.random.default_rng(3).uniform(-0.3, 0.3, (4, 6))
    via = np.array([False, False, True, False])
    return PoseList(("P1", "P2", "V1", "P3"), reference_cell.base_posture + off, via)


def normal(text: str) -> str:
    """Files have one kind of line end."""
    return text.replace("\r\n", "\n").replace("\r", "\n")


def test_the_header_says_what_the_plan_says(written, demo_plan):
    found = read_poses(written, 6)
    wanted = demo_plan.indices.as_dict()
    assert int(found.header["poses measured"]) == wanted.pop("poses") == len(demo_plan.postures)
    for name, value in wanted.items():
        assert float(found.header[name]) == pytest.approx(value, rel=1e-11), name
    assert found.fingerprint_written == found.fingerprint == demo_plan.fingerprint
    assert found.measured.fingerprint == found.fingerprint
    assert found.header["posedesign"].startswith("measuring poses of ")
    assert "mm and deg" in found.header["units"]


def test_a_changed_posture_is_seen_by_the_fingerprint(written, demo_cell):
    found = read_poses(written, 6)
    turned = found.postures.copy()
    turned[0, 5] += np.deg2rad(0.01)
    write_pose_list(written, replace(found, postures=turned), demo_cell.robot, demo_cell.tool_m)
    again = read_poses(written, 6)
    assert again.fingerprint_written == found.fingerprint != again.fingerprint


@pytest.mark.parametrize("degrees", [10.00005 - 3e-10, 10.00005 + 3e-10, -0.00005, 1e-10, 33.3])
def test_the_fingerprint_survives_on_the_edge_of_its_steps(tmp_path, reference_cell, degrees):
    q = np.full((1, 6), np.deg2rad(degrees))
    poses = PoseList(("P1",), q, np.array([False]))
    path = write_pose_list(tmp_path / "a.csv", poses, reference_cell.robot, reference_cell.tool_m)
    assert read_poses(path, 6).fingerprint == poses.fingerprint


def test_stops_are_numbered_and_dropped_poses_are_not(tmp_path, demo_cell, demo_plan):
    poses = demo_plan.poses.without({3: "=in the way"})
    stops = [s for s in demo_plan.route.stops if s.pose is None or s.pose < len(poses.kept)]
    route = replace(demo_plan.route, stops=tuple(stops))
    path = tmp_path / "p.csv"
    write_poses(path, demo_cell.robot, poses, route, demo_cell.tool_m)
    rows = read_rows(path)[1]
    assert [row.cells["order"] for row in rows] == [*(str(i + 1) for i in range(len(stops))), ""]
    last = rows[-1].cells
    assert (last["status"], last["reason"][:11]) == ("dropped", "=in the way")
    assert last["x_mm"] == last["j1_deg"] == last["configuration"] == ""
    assert read_poses(path, 6).dropped[0].name == last["name"] == "P04"


def test_margins_are_what_a_second_calculation_finds(written, demo_cell):
    found = read_poses(written, 6)
    table = pd.read_csv(written, comment="#")
    robot, q, seen = demo_cell.robot, found.postures, ~found.via
    assert set(MARGIN_COLUMNS) <= set(table.columns)
    room = np.minimum(q - robot.lower, robot.upper - q).min(axis=1)
    for limit in robot.coupled_limits:
        value = q @ limit.coefficients
        room = np.minimum(room, np.minimum(value - limit.lower, limit.upper - value))
    np.testing.assert_allclose(table["limit_margin_deg"], np.rad2deg(room), atol=1e-8)
    for column, scene in (
        ("clearance_mm", demo_cell.scene.others),
        ("self_clearance_mm", demo_cell.scene.own),
    ):
        each = [scene.clearance(posture[None]).distance_m[0] for posture in q]
        np.testing.assert_allclose(table[column], 1e3 * np.array(each), atol=1e-6)
        assert (table[column] == table[column].round(6)).all()
    # the view, from the positions of lens, target and its rim alone
    section, target = demo_cell.config.camera, demo_cell.target_m
    assert section is not None
    T = robot.fk(q) @ demo_cell.T_tip_camera
    way = T[:, :3, 3] - target
    far = 1e3 * np.linalg.norm(way, axis=1)
    span = np.minimum(far - section.nearest_mm, section.farthest_mm - far)
    np.testing.assert_allclose(table["camera_distance_margin_mm"][seen], span[seen], atol=1e-6)
    cosine = way @ demo_cell.target_normal / np.linalg.norm(way, axis=1)
    tilt = section.largest_tilt_deg - np.rad2deg(np.arccos(cosine))
    np.testing.assert_allclose(table["tilt_margin_deg"][seen], tilt[seen], atol=1e-5)
    assert table.loc[~seen, ["view_margin_px", "tilt_margin_deg"]].isna().all().all()
    angle = np.arange(720) * np.pi / 360
    across = np.linalg.svd(demo_cell.target_normal[None])[2][1:]
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ across
    rim = target + demo_cell.config.target.radius_mm / 1e3 * circle
    p = (rim[None] - T[:, None, :3, 3]) @ T[:, :3, :3]
    pixel = section.focal_px * p[..., :2] / p[..., 2:] + np.array(section.image_px) / 2
    edge = np.minimum(pixel, np.array(section.image_px) - pixel).min(axis=(1, 2))
    # an octagon about the round target is checked: up to a twelfth of its radius beyond the rim
    beyond = edge[seen] - table["view_margin_px"][seen]
    radius_px = section.focal_px * demo_cell.config.target.radius_mm / far[seen]
    assert (beyond > -1e-6).all()
    assert (beyond < 0.15 * radius_px + 1e-6).all()


def test_a_cell_that_describes_less_has_fewer_margins(reference_cell, some):
    assert set(Margins.of(reference_cell, some).columns) <= {
        "limit_margin_deg",
        "self_clearance_mm",
        "clearance_mm",
    }


def test_a_margin_is_negative_beyond_the_limit(reference_cell):
    robot = reference_cell.robot
    q = reference_cell.base_posture[None].copy()
    q[0, 0] = robot.upper[0] + np.deg2rad(2.0)
    margins = Margins.of(reference_cell, PoseList(("P01",), q, np.array([False]))).columns
    assert margins["limit_margin_deg"][0] == pytest.approx(-2.0)


def test_pandas_reads_names_with_number_signs(tmp_path, reference_cell, some):
    named = replace(some, names=("#1", "a # b", "'#x", "=x"), extra={"by, #": ("#", "b#", "", "=")})
    path = tmp_path / "p.csv"
    write_pose_list(path, named, reference_cell.robot, reference_cell.tool_m)
    table = pd.read_csv(path, comment="#", keep_default_na=False)
    assert table["name"].tolist() == ["'#1", "a # b", "''#x", "'=x"]
    assert table["by, #"].tolist() == ["'#", "b#", "", "'="]
    assert table["order"].tolist() == [1, 2, 3, 4]
    own = [f"j{i + 1}_deg" for i in range(6)]
    np.testing.assert_allclose(np.deg2rad(table[own]), some.postures, rtol=0, atol=EXACT)
    assert read_poses(path, 6).names == named.names


@FILES_BETWEEN_EXAMPLES
@given(data=st.data())
@pytest.mark.parametrize("form", [JointForm.USUAL, JointForm.ROS])
def test_what_is_not_known_survives(tmp_path, reference_cell, some, form, data):
    four = st.tuples(cells, cells, cells, cells)
    extra = data.draw(st.dictionaries(columns, four, min_size=1, max_size=3))
    lost = DroppedPose("=lost", "#why", {column: data.draw(cells) for column in extra})
    drawn = data.draw(four)
    names = tuple("".join(filter(str.isprintable, name)) or "P" for name in drawn)  # as it is shown
    given_ = replace(some, names=names, extra=extra, dropped=(lost,), comments=("by hand: yes",))
    robot, tool_m = reference_cell.robot, reference_cell.tool_m
    path = write_pose_list(tmp_path / "a.csv", given_, robot, tool_m, form=form)
    found = read_robot_poses(path, robot)
    assert found.names == tuple(map(normal, names))
    assert dict(found.extra) == {c: tuple(map(normal, v)) for c, v in extra.items()}
    assert found.dropped == (replace(lost, extra={c: normal(v) for c, v in lost.extra.items()}),)
    assert found.header["by hand"] == "yes"
    assert found.via.tolist() == some.via.tolist()
    np.testing.assert_allclose(found.postures, some.postures, rtol=0, atol=EXACT)
    assert found.fingerprint_written == found.fingerprint == some.fingerprint
    # with what a file keeps of the postures, it is the same file again
    write_pose_list(path, found, robot, tool_m, form=form)
    before = path.read_bytes()
    write_pose_list(path, read_robot_poses(path, robot), robot, tool_m, form=form)
    assert path.read_bytes() == before
    # whatever a spreadsheet would run is a number
    for row in csv.reader(line for line in before.decode().splitlines(True) if line[0] != "#"):
        for cell in row:
            if cell.strip()[:1] in tuple("=+-@"):
                float(cell)
    assert all(column in pd.read_csv(path, comment="#") for column in ("name", "order", "x_mm"))


def test_comments_cannot_break_out_of_their_lines(tmp_path):
    said = ["a\n=cmd(),2", "x,=cmd()", 'x;"=cmd()"', "x\u2028y\tz\r"]
    path = write_table(tmp_path / "a.csv", ["a"], [{"a": 1.0}], said)
    text = path.read_text()
    assert text == "# a =cmd(),2\n# x =cmd()\n# x =cmd()\n# x y z\na\n1\n"
    assert read_table(path).comments == ["a =cmd(),2", "x =cmd()", "x =cmd()", "x y z"]
    for line in csv.reader(text.splitlines()[:4]):
        assert not any(cell.lstrip().startswith(tuple("=+-@")) for cell in line)


def test_comments_keep_their_commas(tmp_path):
    """A spreadsheet cuts them into cells there, and fills the line up with more commas."""
    said = "not checked: link_1, gun against table; 3 of 27, at most"
    path = write_table(tmp_path / "a.csv", ["a", "b"], [{"a": 1.0, "b": 2.0}], [said])
    kept = said.replace(";", ",")
    assert read_table(path).comments == [kept]
    path.write_text(path.read_text().replace("most\n", "most,,,\n"))
    assert read_table(path).comments == [kept]
    assert list(pd.read_csv(path, comment="#")) == ["a", "b"]


def test_comments_that_a_spreadsheet_saved(written, demo_plan):
    """It fills every line up to the width of the table."""
    text = re.sub(r"(?m)^(#.*)$", r"\1,,,,", written.read_text())
    written.write_text(text)
    assert read_poses(written, 6).fingerprint_written == demo_plan.fingerprint
    assert float(read_poses(written, 6).header["c_g"]) == pytest.approx(demo_plan.indices.c_g)


def test_columns_of_pose_and_axes_agree_with_the_robot(tmp_path, reference_cell, some):
    robot, tool_m = reference_cell.robot, reference_cell.tool_m
    path = write_pose_list(tmp_path / "a.csv", some, robot, tool_m)
    table = pd.read_csv(path, comment="#")
    for i, q in enumerate(some.postures):
        T = robot.fk(q)
        point = 1e3 * (T[:3, :3] @ tool_m + T[:3, 3])
        np.testing.assert_allclose(table.loc[i, ["x_mm", "y_mm", "z_mm"]].astype(float), point)
        wpr = np.deg2rad(table.loc[i, ["w_deg", "p_deg", "r_deg"]].astype(float))
        np.testing.assert_allclose(rotation_from_wpr(wpr), T[:3, :3], atol=1e-10)
    assert table["status"].tolist() == ["grid", "grid", "via", "grid"]


def test_configuration_in_the_words_of_the_controller(tmp_path, reference_cell, some, monkeypatch):
    robot, tool_m, path = reference_cell.robot, reference_cell.tool_m, tmp_path / "a.csv"

    def written_words() -> list[str]:
        write_pose_list(path, some, robot, tool_m)
        return [row.cells["configuration"] for row in read_rows(path)[1]]

    assert written_words() == configurations.words(robot, some.postures)
    monkeypatch.setattr(configurations, "words", lambda robot, q: [f"N U T, {x[0]:.2f}" for x in q])
    assert written_words() == [f"N U T, {q[0]:.2f}" for q in some.postures]
    assert read_poses(path, 6).extra == {}

    def of_no_known_kind(robot: object, q: object) -> list[str]:
        raise InputError("this arm has no elbow")

    monkeypatch.setattr(configurations, "words", of_no_known_kind)
    assert written_words() == [""] * 4


def test_robodk_has_pendant_values_first(tmp_path, reference_cell, some):
    robot = reference_cell.robot
    listed = replace(
        some,
        names=("a,b", "#2", 'c"', "d"),
        extra={"note": ("", "x", "y", "z")},
        dropped=(DroppedPose("P9", "too far"),),
    )
    path = tmp_path / "rdk.csv"
    write_pose_list(path, listed, robot, reference_cell.tool_m, form=JointForm.ROBODK)
    with path.open(newline="") as stream:
        lines = list(csv.reader(stream, quotechar="|"))  # as robodk's LoadList reads
    assert lines[0][:6] == ["J1", "J2", "J3", "J4", "J5", "J6"]
    shown = np.array([line[:6] for line in lines[1:]], dtype=float)
    degrees = np.rad2deg(some.postures)
    degrees[:, 2] -= degrees[:, 1]  # FANUC: the forearm against the horizontal
    np.testing.assert_allclose(shown, degrees, atol=1e-8)
    found = read_robot_poses(path, robot)
    np.testing.assert_allclose(found.postures, some.postures, rtol=0, atol=2 * EXACT)
    assert found.names == listed.names
    assert dict(found.extra) == {"note": ("", "x", "y", "z")}
    assert (found.dropped, found.comments) == ((), ())


def test_joints_as_ros_names_them(tmp_path, reference_cell, some):
    robot, path = reference_cell.robot, tmp_path / "ros.csv"
    write_pose_list(path, some, robot, reference_cell.tool_m, form=JointForm.ROS)
    table = pd.read_csv(path, comment="#")
    named = [f"{name}_rad" for name in robot.joint_names]
    np.testing.assert_allclose(table[named], some.postures, rtol=0, atol=1e-12)
    found = read_robot_poses(path, robot)
    np.testing.assert_allclose(found.postures, some.postures, rtol=0, atol=1e-12)
    assert found.extra == {}
    assert "rad" in found.header["units"]
    in_degrees = [f"{name}_deg" for name in robot.joint_names]
    rows = [dict(zip(in_degrees, np.rad2deg(q), strict=True)) for q in some.postures]
    write_table(path, in_degrees, rows)
    np.testing.assert_allclose(read_robot_poses(path, robot).postures, some.postures, atol=EXACT)


@pytest.mark.parametrize("form", [JointForm.ROS, JointForm.ROBODK])
def test_other_forms_need_the_robot(tmp_path, reference_cell, some, form):
    path = tmp_path / "a.csv"
    write_pose_list(path, some, reference_cell.robot, reference_cell.tool_m, form=form)
    for count in (6, None):
        with pytest.raises(FileFormatError, match="the robot must be known") as caught:
            read_poses(path, count, controller=reference_cell.robot.controller)
        assert "posedesign convert" in caught.value.hint
        assert caught.value.column == columns_of(form, reference_cell.robot)[0]


@pytest.mark.parametrize(
    ("change", "said", "hint"),
    [
        ({"joint_3_rad": "joint3_rad"}, "no column joint_3_rad", "did you mean joint3_rad"),
        ({"joint_3_rad": "joint_3_deg"}, "in another unit than rad", "call the column joint_3_rad"),
        ({f"joint_{i}_rad": f"joint{i}_rad" for i in range(1, 7)}, "joint_1_rad", "joint1_rad"),
        ({f"joint_{i}_rad": f"K{i}" for i in range(1, 7)}, "no column j1_deg", "known: "),
        ({f"joint_{i}_rad": f"J{i}" for i in range(2, 7)}, "no column J1", "did you mean J"),
    ],
)
def test_wrong_names_of_joints(tmp_path, reference_cell, some, change, said, hint):
    robot, path = reference_cell.robot, tmp_path / "a.csv"
    assert robot.joint_names == tuple(f"joint_{i}" for i in range(1, 7))
    named = [change.get(f"{name}_rad", f"{name}_rad") for name in robot.joint_names]
    write_table(path, named, [dict(zip(named, q, strict=True)) for q in some.postures])
    with pytest.raises(FileFormatError, match=said) as caught:
        read_robot_poses(path, robot)
    assert hint in caught.value.hint


def test_degrees_under_the_names_of_radians(tmp_path, reference_cell, some):
    robot, path = reference_cell.robot, tmp_path / "a.csv"
    named = [f"{name}_rad" for name in robot.joint_names]
    rows = [dict(zip(named, 57.3 * q, strict=True)) for q in some.postures]
    write_table(path, named, rows)
    with pytest.raises(FileFormatError, match="look like degrees"):
        read_robot_poses(path, robot)
    found = read_robot_poses(path, robot, trust_units=True)
    np.testing.assert_allclose(found.postures, 57.3 * some.postures, atol=1e-8)


def test_robodk_file_of_a_longer_arm(tmp_path, reference_cell):
    named = [f"J{i + 1}" for i in range(7)]
    path = write_table(tmp_path / "a.csv", named, [dict.fromkeys(named, 10.0)])
    with pytest.raises(FileFormatError, match="the robot has 6 joints only") as caught:
        read_robot_poses(path, reference_cell.robot)
    assert caught.value.column == "J7"


def test_touch_ups_keep_what_is_not_known(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("target,j1_deg,j2_deg,who,\"'=x\"\nT1,10,20,'=cmd(),-1.50\nT1,30,40,#x,\n")
    table = read_measurements(path, 2)
    assert dict(table.extra) == {"who": ("=cmd()", "#x"), "=x": ("-1.50", "")}
    assert table.some(np.array([1])).extra["who"] == ("#x",)
    write_measurements(path, table.data, extra=table.extra)
    assert dict(read_measurements(path, 2).extra) == dict(table.extra)
    assert path.read_text().splitlines()[1].endswith(",'=cmd(),-1.50")
    # without them, the table is what it was before there were any
    write_measurements(path, table.data)
    assert path.read_text() == "target,j1_deg,j2_deg,pose\nT1,10,20,P01\nT1,30,40,P02\n"
