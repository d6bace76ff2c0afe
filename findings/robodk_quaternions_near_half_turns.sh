#!/usr/bin/env bash
# robodk 6.0.2 (RoboDK's own library): quaternions of tools that point almost straight down.
#
# Expected: a rotation matrix of doubles gives a quaternion good to some 1e-8 at worst.
# Happens: robomath.pose_2_quaternion, and Pose_2_ABB with it, takes every turn within 0.0256 deg of
#   half a turn for half a turn, and every one below 0.0026 deg for none: w is exactly 0 there, or
#   1. Pose_2_UR of the same pose keeps the angle.
# Matters: a tool that points down is half a turn about X or Y, and a calibration corrects it by
#   some hundredths of a degree. What of it turns about the same axis is dropped from the target of
#   an ABB program: up to 0.45 mm at the end of a metre.
# Here: calib/se3.py (quaternion_from_rotation) keeps all digits at every angle, and
#   posedesign/programs/notation.py writes these. Test: what RoboDK reads of our numbers is compared
#   at half turns, and what it writes away from them, in
#   tests/unit/programs/test_orientation_conventions.py.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check robodk==6.0.2

"$work/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version
from math import atan2, cos, degrees, hypot, radians, sin

from robodk.robomath import Mat, Pose_2_ABB, Pose_2_UR


def about_x(angle_deg):
    c, s = cos(radians(angle_deg)), sin(radians(angle_deg))
    return Mat([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])


def lost(angle_deg):
    """What the ABB target and the UR target of a turn about X are off by [deg]."""
    *_, w, x, y, z = Pose_2_ABB(about_x(angle_deg))
    *_, u, v, r = Pose_2_UR(about_x(angle_deg))
    abb = (2 * degrees(atan2(x, w)) - angle_deg + 180) % 360 - 180
    ur = (degrees(u) - angle_deg + 180) % 360 - 180
    print(
        f"{angle_deg:9.4f} deg about X: Pose_2_ABB has w = {w:.3e} and is off by {abs(abb):.5f} deg"
        f" ({1000 * radians(abs(abb)):.3f} mm at 1 m); Pose_2_UR by {abs(ur):.0e} deg"
    )
    if max(hypot(y, z), hypot(v, r)) > 1e-6:
        sys.exit("The behaviour has changed: the axis is another.")
    return abs(abb), abs(ur)


print("robodk", version("robodk"))
near = {off: lost(180.0 + off) for off in (0.0255, 0.02, 0.005)}
small = {off: lost(off) for off in (0.0025, 0.001)}
beyond = [lost(180.03), lost(0.003)]
as_seen = (
    all(abs(abb - off) < 1e-5 for off, (abb, _) in {**near, **small}.items())
    and all(ur < 1e-5 for _, ur in (*near.values(), *small.values()))
    and all(abb < 1e-5 for abb, _ in beyond)
)
if not as_seen:
    sys.exit("The behaviour has changed.")
print("Pose_2_ABB drops what a turn is short of, or beyond, half a turn by, up to 0.0256 deg.")
PY
