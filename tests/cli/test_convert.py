"""``posedesign convert``, and what the tables of a plan say before their header."""

import numpy as np
import pandas as pd

from posedesign.cell import Cell
from posedesign.planning.poses_file import read_poses


def test_there_and_back(cli, work):
    """Through ROS and RoboDK to the usual table, with columns of other makers."""
    planned = work / "poses.csv"
    table = pd.read_csv(planned)
    table["who"] = ["'=me()"] * len(table)
    table.to_csv(planned, index=False)
    wanted = read_poses(planned, 6)
    cell, last = work / "cell.toml", planned
    for form in ("ros", "robodk", "usual"):
        last, source = work / f"{form}.csv", last
        said = cli("convert", source, "--cell", cell, "--to", form, "--out", last)
        assert (said.code, said.err) == (0, "")
        assert said.out == f"wrote {last}: 27 poses\n"
    found = read_poses(last, 6)
    assert found.names == wanted.names
    assert found.status == wanted.status
    assert found.reasons == wanted.reasons
    assert dict(found.extra) == {"who": ("=me()",) * len(found.names)}
    np.testing.assert_allclose(found.postures, wanted.postures, rtol=0, atol=1e-10)
    assert found.fingerprint == wanted.fingerprint
    robot = Cell.load(cell).robot
    ros = pd.read_csv(work / "ros.csv", comment="#")
    named = [f"{name}_rad" for name in robot.joint_names]
    np.testing.assert_allclose(ros[named], wanted.postures, rtol=0, atol=1e-11)
    assert pd.read_csv(work / "robodk.csv").columns[:6].tolist() == [f"J{i}" for i in range(1, 7)]


def test_what_cannot_be_converted(refuse, work):
    path, cell = work / "ros.csv", work / "cell.toml"
    path.write_text("joint1_rad,joint2_rad,joint3_rad,joint4_rad,joint5_rad,joint6_rad\n" + "1,2,")
    words = ("convert", path, "--cell", cell, "--out", work / "out.csv")
    refuse(*words).says("has 3 cells")
    path.write_text(
        "joint1_rad,joint2_rad,joint3_rad,joint4_rad,joint5_rad,joint6_rad\n1,1,1,1,1,1\n"
    )
    refuse(*words).says("no column joint_1_rad", "did you mean", "joint1_rad")
    refuse("score", cell, path).says("the robot must be known", "posedesign convert")
    refuse(*words, "--to", "xml").says("'xml' is not one of")
    assert not (work / "out.csv").exists()


def test_poses_outside_the_limits_are_told(done, work, change_csv):
    poses = change_csv("poses.csv", 2, "j2_deg", "170")
    said = done("convert", poses, "--cell", work / "cell.toml", "--out", work / "out.csv")
    assert "joint_2 170.0 deg is above" in said.err
    assert pd.read_csv(work / "out.csv", comment="#").loc[1, "limit_margin_deg"] < 0.0
