"""An arm of two: new, plan, program, simulate and identify of one branch."""

from tests.two_arms import two_arms


def test_one_of_two_arms_from_new_to_identify(cli, done, refuse, tmp_path):
    urdf = tmp_path / "duo.urdf"
    urdf.write_text(two_arms())
    (tmp_path / "duo.srdf").write_text('<robot name="duo"/>')
    refuse("new", "--robot", urdf).says(
        "leaves little of the range of left_finger_1", "hold it where it is"
    )
    new = cli("new", "--robot", urdf, "--tip", "right_tool0", "--base", "right_base")
    assert "duo.srdf lies beside the URDF" in " ".join(new.err.split())
    held = "held_deg = { waist = 30.0, left_joint_2 = -40.0 }\nheld_mm = { lift = 250.0 }\ntip = "
    text = new.out.replace("\ntip = ", f"\n{held}", 1)
    cell = tmp_path / "cell.toml"
    cell.write_text(text)
    plan = done("plan", cell, "--out", tmp_path / "plan", "--verbose")
    assert "waist at 30 deg" in " ".join((plan.out + plan.err).split())
    poses = tmp_path / "plan" / "poses.csv"
    cli("program", poses, "--cell", cell, "--format", "ros-trajectory", "--out", tmp_path / "ros")
    (written,) = (tmp_path / "ros").glob("*.yaml")
    names = written.read_text()
    order = [names.index(f"right_joint_{k}") for k in range(1, 7)]
    assert order == sorted(order)
    assert "left_joint" not in names
    cli("simulate", cell, poses, "--out", tmp_path / "sim")
    cli("identify", cell, tmp_path / "sim" / "touchups.csv", "--out", tmp_path / "sim")
    assert "zero_offset.right_joint_2" in (tmp_path / "sim" / "identification.json").read_text()
