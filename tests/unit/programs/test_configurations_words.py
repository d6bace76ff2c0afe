"""Words of makers for arm positions: what controllers say, where flags change, malformed texts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.errors import InputError
from calib.robots import Robot
from posedesign.programs.configurations import (
    CONFIGURATIONS,
    AbbConfiguration,
    FanucConfiguration,
    KukaConfiguration,
    StaubliConfiguration,
    YaskawaConfiguration,
)

FANUC_MEASURED = """
0 0 0 0 -90 0        N U T, 0, 0, 0     965.000 0.000 965.000
0 0 0 0 90 0         F U T, 0, 0, 0     965.000 0.000 1145.000
0 0 0 0 -30 0        N U T, 0, 0, 0     1042.942 0.000 1010.000
0 0 0 0 30 0         F U T, 0, 0, 0     1042.942 0.000 1100.000
0 0 0 185 -90 0      N U T, 0, 1, 0     965.000 7.844 1144.657
0 0 0 -185 -90 0     N U T, 0, -1, 0    965.000 -7.844 1144.657
0 0 0 0 -90 190      N U T, 0, 0, 1     965.000 0.000 965.000
0 0 0 0 -90 -190     N U T, 0, 0, -1    965.000 0.000 965.000
0 0 0 0 -90 350      N U T, 0, 0, 1     965.000 0.000 965.000
0 40 60 0 -90 0      N D T, 0, 0, 0     951.688 0.000 1476.740
0 40 -60 0 -90 0     N U T, 0, 0, 0     1168.195 0.000 -64.785
0 -60 -80 0 -90 0    N D B, 0, 0, 0     -374.813 0.000 -434.773
0 -60 80 0 -90 0     N U B, 0, 0, 0     -621.015 0.000 1318.185
0 60 80 0 -90 0      N D T, 0, 0, 0     833.907 0.000 1318.185
90 0 0 0 -90 0       N U T, 0, 0, 0     0.000 965.000 965.000
-150 0 0 0 -90 0     N U T, 0, 0, 0     -835.714 -482.500 965.000
"""
"""Joint values on the pendant [deg], CONFIG and position of the faceplate [mm] that ROBOGUIDE gave
for an M-20iD/25 (LeroyDu56/CrossArm, tests/fixtures/probes/results/CFGPROBE_roboguide.LS)."""

ABB_MEASURED = """
0 0 0 0 -90 0        [0,0,0,1]     1712.500 0.000 2455.000
0 0 0 0 90 0         [0,0,0,0]     1712.500 0.000 1755.000
0 0 0 0 -30 0        [0,0,0,1]     2015.609 0.000 2280.000
0 0 0 0 30 0         [0,0,0,0]     2015.609 0.000 1930.000
0 0 0 185 -90 0      [0,2,0,1]     1712.500 30.505 1756.332
0 0 0 -185 -90 0     [0,-3,0,1]    1712.500 -30.505 1756.332
0 0 0 0 -90 190      [0,0,2,1]     1712.500 0.000 2455.000
0 0 0 0 -90 -190     [0,0,-3,1]    1712.500 0.000 2455.000
0 0 0 0 -90 350      [0,0,3,1]     1712.500 0.000 2455.000
0 40 60 0 -90 0      [0,0,0,1]     1342.975 0.000 174.949
0 40 -60 0 -90 0     [0,0,0,1]     2163.547 0.000 2634.894
0 -60 -80 0 -90 0    [0,0,0,5]     -2074.529 0.000 1816.257
0 -60 80 0 -90 0     [0,0,0,1]     842.354 0.000 1383.068
0 60 80 0 -90 0      [0,0,0,1]     581.095 0.000 26.094
90 0 0 0 -90 0       [1,0,0,1]     0.000 1712.500 2455.000
-150 0 0 0 -90 0     [-2,0,0,1]    -1483.068 -856.250 2455.000
0 0 60 0 90 0        [0,0,0,0]     886.346 0.000 624.060
0 0 -60 0 90 0       [0,0,0,0]     1146.154 0.000 3035.940
0 0 -75 0 90 0       [0,0,0,0]     825.294 0.000 3211.229
0 0 -80 0 90 0       [0,0,0,0]     709.526 0.000 3250.298
0 0 -81.5 0 90 0     [0,0,0,0]     674.177 0.000 3260.033
0 0 -82.2 0 90 0     [0,0,0,2]     657.596 0.000 3264.259
0 0 -85 0 90 0       [0,0,0,2]     590.794 0.000 3279.128
0 0 -90 0 90 0       [0,0,0,2]     470.000 0.000 3297.500
0 0 -120 0 90 0      [0,0,0,6]     -246.346 0.000 3185.940
0 0 -150 0 90 0      [0,0,0,6]     -810.940 0.000 2731.154
0 40 -100 0 90 0     [0,0,0,2]     1869.290 0.000 2772.740
0 -60 -100 0 90 0    [0,0,0,6]     -1911.498 0.000 1959.717
"""
"""Joint values [deg], confdata and position of tool0 [mm] that RobotStudio gave for an IRB
6700-140/2.85 (LeroyDu56/robconv, tests/fixtures/probes/results, two files)."""


def arm(folder: Path, maker: str, axes: list[str], places_mm: list[list[float]]) -> Robot:
    """An arm of six joints and a tip, each placed in the axes of the base from the one before."""
    text = '<robot name="arm"><link name="base_link"/>'
    parent = "base_link"
    for j, (axis, place) in enumerate(zip([*axes, ""], places_mm, strict=True), start=1):
        child = f"link_{j}" if axis else "tool0"
        xyz = " ".join(str(v / 1000.0) for v in place)
        turns = f'<axis xyz="{axis}"/><limit lower="-7" upper="7" velocity="1" effort="1"/>'
        text += (
            f'<link name="{child}"/><joint name="joint_{j}" '
            f'type="{"revolute" if axis else "fixed"}"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="{xyz}"/>{turns if axis else ""}</joint>'
        )
        parent = child
    path = folder / "arm.urdf"
    path.write_text(text + "</robot>")
    return Robot.from_urdf(path, tip="tool0").controlled_by(maker)


def measured(table: str) -> tuple[np.ndarray, list[str], np.ndarray]:
    rows = [line.split() for line in table.strip().splitlines()]
    words = [" ".join(row[6:-3]) for row in rows]
    return (
        np.array([row[:6] for row in rows], dtype=float),
        words,
        np.array([row[-3:] for row in rows], dtype=float),
    )


def check_measured(robot: Robot, table: str) -> None:
    pendant, words, position_mm = measured(table)
    q = robot.controller.posture(pendant)
    T = robot.controller.in_world(robot.fk(q))
    np.testing.assert_allclose(1e3 * T[:, :3, 3], position_mm, atol=6e-4)  # it is the same arm
    kind = CONFIGURATIONS[robot.controller.maker]
    assert [found.words for found in kind.of(robot, q)] == words
    assert [kind.parse(text) for text in words] == kind.of(robot, q)


@pytest.mark.parametrize("description", ["as FANUC counts", "joints counted the other way"])
def test_config_is_what_a_fanuc_controller_says(tmp_path: Path, description: str) -> None:
    axes = ["0 0 1", "0 1 0", "0 -1 0", "-1 0 0", "0 -1 0", "-1 0 0"]
    if description != "as FANUC counts":
        axes = ["0 0 -1", "0 -1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0"]
    places = [[0, 0, 425], [75, 0, 0], [0, 0, 840], [0, 0, 215], [890, 0, 0], [0, 0, 0], [90, 0, 0]]
    check_measured(arm(tmp_path, "fanuc", axes, places), FANUC_MEASURED)


def test_confdata_is_what_an_abb_controller_says(tmp_path: Path) -> None:
    axes = ["0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0"]
    places = [
        *([0, 0, 780], [320, 0, 0], [0, 0, 1125], [0, 0, 200]),
        *([1392.5, 0, 0], [0, 0, 0], [350, 0, 0]),
    ]
    check_measured(arm(tmp_path, "abb", axes, places), ABB_MEASURED)


def words_of(name: str, *pendant_deg: list[float]) -> list[str]:
    robot = Robot.preset(name)
    kind = CONFIGURATIONS[robot.controller.maker]
    return [c.words for c in kind.of(robot, robot.controller.posture(pendant_deg))]


def test_fanuc_turns_are_open_intervals() -> None:
    """+180 is turn 1, with the controller's tolerance, measured between 0.0004 and 0.0007 deg."""
    angles = [0, 179.9993, 179.9996, 180, 190, 359, 530, 540]
    turns = [0, 0, 1, 1, 1, 1, 1, 2]
    for sign in (1, -1):
        found = words_of("r2000ic165f", *([0, 0, 0, sign * angle, -90, 0] for angle in angles))
        assert found == [f"N U T, 0, {sign * turn}, 0" for turn in turns]
    assert words_of("r2000ic165f", [-190, 0, 0, 0, -90, 200]) == ["N U T, -1, 0, 1"]


def test_a_joint_that_is_not_rounded_but_turned_is_another() -> None:
    """A hundredth of a degree beyond the boundary may be rounding, half a degree is not."""
    robot = Robot.preset("r2000ic165f")
    pendant = [[0, 0, 0, angle, -90, 0] for angle in (179.5, 180.01, 180.5)]
    found = FanucConfiguration.of(robot, robot.controller.posture(pendant))
    assert [c.turns[1] for c in found] == [0, 1, 1]
    assert [found[0].allows(other) for other in found] == [True, True, False]
    assert [found[1].allows(other) for other in found] == [True, True, True]


def test_abb_joints_at_zero_are_in_quadrant_zero() -> None:
    """Radians and back leave -1e-15 deg."""
    quadrants = words_of("irb120", [-1e-12, 0, 0, 90 - 1e-12, 30, -90 - 1e-12])
    assert quadrants == ["[0,1,-1,0]"]


def test_abb_bits_are_each_compared() -> None:
    for bit in (1, 2, 4):
        assert not AbbConfiguration(0, 0, 0, 0).allows(AbbConfiguration(0, 0, 0, bit))


def test_kuka_elbow_changes_where_the_arm_is_stretched() -> None:
    """KR 6 R900: the wrist is 420 mm from axis 3 along the forearm and 35 mm above it."""
    stretched = np.degrees(np.arctan2(35.0, 420.0))
    found = words_of(
        "kr6r900sixx",
        *([0, -60, stretched + off, 0, 30, 0] for off in (-0.01, 0.01)),
        *([0, -90, 90, 0, angle, 0] for angle in (0, -30, 30)),
        [0, -150, 60, 0, 0, 0],
    )
    assert found == ["S 0,T 2", "S 2,T 2", "S 2,T 2", "S 6,T 18", "S 2,T 2", "S 3,T 2"]


def test_kuka_turn_has_a_bit_for_each_negative_axis() -> None:
    poses = [[30, 20, 90, 40, 50, 60]] * 6 * np.where(np.eye(6), -1, 1)
    turns = [int(words.split("T ")[1]) for words in words_of("kr6r900sixx", *poses)]
    assert turns == [1, 2, 4, 8, 16, 32]


def test_kuka_wrist_bit_beyond_half_a_turn() -> None:
    """S bit 2: A5 in [-180, 0), or from 180 on."""
    poses = [[0, -90, 90, 0, a5, 0] for a5 in (-200, -180, -1, 0, 179, 180, 200)]
    bits = [int(words[2]) >> 2 for words in words_of("kr6r900sixx", *poses)]
    assert bits == [0, 1, 1, 0, 0, 1, 1]


def test_kuka_bits_that_are_not_of_the_arm_are_left_aside() -> None:
    """S 18 is S 2, taught with an absolutely accurate arm."""
    assert KukaConfiguration.parse("S 18,T 2").allows(KukaConfiguration(2, 2))
    assert not KukaConfiguration.parse("S 18,T 2").allows(KukaConfiguration(6, 2))
    assert KukaConfiguration.parse("S 18,T 2") != KukaConfiguration(2, 2)


def test_kuka_signs_of_axes_at_zero_are_left_open() -> None:
    wanted = KukaConfiguration.parse("S 2,T 10")
    assert wanted.allows(KukaConfiguration(2, 2, loose=0b1000))
    assert not wanted.allows(KukaConfiguration(2, 2, loose=0b0100))
    assert not wanted.allows(KukaConfiguration(2, 2))


def test_kuka_numbers_are_decimal_binary_or_hexadecimal() -> None:
    binary = KukaConfiguration.parse("S 'B010',T 'B100011'")
    assert binary == KukaConfiguration.parse("s2, t 35") == KukaConfiguration(2, 35)
    assert binary == KukaConfiguration.parse("S 'B 10',T 'H23'")
    assert binary.words == "S 2,T 35"


def test_yaskawa_flip_is_an_angle_of_r() -> None:
    """The intervals of the NX100 manual, p. 3-76."""
    angles = [0, 90, 90.1, 180, 270, 270.1, 359, -89.9, -90, -180, -269.9, -270, -359]
    flips = [1 - int(w[0]) for w in words_of("gp7", *([0, 0, 0, r, 30, 0] for r in angles))]
    assert flips == [1, 1, 0, 0, 0, 1, 1, 1, 0, 0, 0, 1, 1]


def test_yaskawa_numbers_stand_in_the_order_of_the_manual() -> None:
    found = words_of(
        "gp7",
        [0, 0, 0, 0, 30, 0],  # upper arm, in front
        [0, 0, 100, 0, 30, 0],  # forearm straight up and beyond
        [0, -60, 80, 0, 30, 0],
        [0, 0, 0, 181, 30, 0],
        [0, 0, 0, 0, 30, -180],
        [-200, 0, 0, 0, 30, 180],
    )
    assert [w.split(",")[:6] for w in found] == [
        ["0", "0", "0", "0", "0", "0"],
        ["0", "1", "1", "0", "0", "0"],
        ["0", "0", "1", "0", "0", "0"],
        ["1", "0", "0", "1", "0", "0"],
        ["0", "0", "0", "0", "1", "0"],
        ["0", "0", "0", "0", "0", "1"],
    ]
    assert all(w.count(",") == 23 for w in found)


def test_yaskawa_jobs_have_eight_or_more_values() -> None:
    short = YaskawaConfiguration.parse("///RCONF 1,0,0,0,1,0,0,0")
    assert short.words == "1,0,0,0,1,0,0,0"
    long = replace(short, length=24)
    assert YaskawaConfiguration.parse(long.words) == long == short


def test_staubli_words_follow_the_axes() -> None:
    """Axes 3 and 4 of a TX2 meet: the elbow is the sign of joint 3."""
    found = words_of(
        "tx2_60",
        *([0, 30, 30, 0, 30, 0], [0, 30, -1, 0, 30, 0]),
        *([0, 30, 30, 0, -30, 0], [0, -90, 30, 0, 30, 0]),
    )
    assert found == [
        'shoulder="lefty" elbow="epositive" wrist="wpositive"',
        'shoulder="lefty" elbow="enegative" wrist="wpositive"',
        'shoulder="lefty" elbow="epositive" wrist="wnegative"',
        'shoulder="righty" elbow="epositive" wrist="wpositive"',
    ]


def test_staubli_words_may_be_free() -> None:
    lefty = StaubliConfiguration.parse("lefty, epositive, wnegative")
    righty = StaubliConfiguration.parse("righty epositive wnegative")
    free = StaubliConfiguration.parse("sfree epositive wnegative")
    assert free.allows(lefty)
    assert free.allows(righty)
    assert not lefty.allows(righty)
    assert not StaubliConfiguration.parse("sfree enegative wfree").allows(lefty)
    assert StaubliConfiguration.parse(free.words) == free


def test_fanuc_words_may_stand_in_quotes_and_without_blanks() -> None:
    expected = FanucConfiguration(True, False, True, (0, -1, 1))
    assert FanucConfiguration.parse("'F U B, 0, -1, 1'") == expected
    assert FanucConfiguration.parse("FUB,0,-1,1") == expected
    assert AbbConfiguration.parse("[ 0, -1,+2 ,7]") == AbbConfiguration(0, -1, 2, 7)


@pytest.mark.parametrize(
    ("maker", "text"),
    [
        *[
            ("fanuc", t)
            for t in ("", "N U T", "X U T, 0, 0, 0", "N U T, 0, 0", "N U T, 0, 0, 0, 0")
        ],
        *[("fanuc", t) for t in ("U N T, 0, 0, 0", "N U T, 0, 0, 1.5", "N U T 0 0 0")],
        *[("kuka", t) for t in ("", "S 2", "S 2,T 64", "S 32,T 0", "S 'B012',T 0", "T 2,S 2")],
        *[("kuka", t) for t in ("S -1,T 0", "S 2.0,T 0", "S 'B10,T 0")],
        *[("abb", t) for t in ("", "[0,0,0]", "[0,0,0,8]", "[0,0,0,-1]", "0,0,0,0", "[a,0,0,0]")],
        *[("abb", t) for t in ("[0,0,0,0,0]", "[0.5,0,0,0]")],
        *[("yaskawa", t) for t in ("", "0,0,0,0,0", "2,0,0,0,0,0,0,0", "0,0,0,0,0,0,1,0")],
        *[("yaskawa", t) for t in ("1,0,0,0,0,0,0,0,0", "1;0;0;0;0;0;0;0", "RCONF")],
        *[("staubli", t) for t in ("", "lefty", "lefty epositive", "epositive lefty wpositive")],
        *[("staubli", t) for t in ("ssame epositive wpositive", 'shoulder="lefty" elbow="up"')],
    ],
)
def test_a_malformed_text_is_refused_with_the_form(maker: str, text: str) -> None:
    with pytest.raises(InputError, match=r"not (one|those) of a six-axis") as caught:
        CONFIGURATIONS[maker].parse(text)
    assert caught.value.hint.startswith("write ")
    assert caught.value.value == text
