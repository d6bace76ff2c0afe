#!/usr/bin/env bash
# Pinocchio 4.1.0 with urdfdom 6.0.0: <origin quat_xyzw="..."> in a URDF file without a version.
#
# Expected: a reader that knows the attribute uses it, or says that it does not.
# Happens: the same file gives two arms. With <robot version="1.1"> the origin is turned; without
#   the attribute version, which almost no file has, or with "1.0", it is not, and nothing is said.
#   An rpy beside it is an error in 1.1, and is what counts in 1.0.
# Matters: a description whose origins were changed to quaternions loses these rotations where its
#   first line was not changed with them. It loads without a warning, and its arm is another.
# Here: calib/robots/description/urdf_kinematics.py (without_quaternions) reads the attribute itself
#   in versions 1.1 and 1.2, and refuses it in others in one line that says what to write. Test:
#   tests/unit/robots/test_urdf.py, the cases with quat_xyzw.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check \
    pin==4.1.0 libpinocchio==4.1.0 cmeel-urdfdom==6.0.0 numpy==2.4.6

# what urdfdom says on its own goes to the standard error of the process
"$work/venv/bin/python" - 2>"$work/said" <<'PY' || { cat "$work/said" && exit 1; }
import sys
from importlib.metadata import version

import numpy as np
import pinocchio as pin

QUARTER = 'quat_xyzw="0.7071067811865476 0 0 0.7071067811865476"'


def turned_deg(robot, origin):
    """Return the turn of a joint's origin, or None where the file is refused."""
    text = (
        f'<robot name="arm"{robot}><link name="base"/><link name="arm"/>'
        '<joint name="j1" type="revolute"><parent link="base"/><child link="arm"/>'
        f'<origin xyz="0 0 1" {origin}/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    )
    try:
        placed = pin.buildModelFromXML(text).jointPlacements[1].rotation
    except ValueError:
        turn = None
    else:
        turn = round(float(np.degrees(np.linalg.norm(pin.log3(placed)))), 6)
    told = "refused" if turn is None else f"turned by {turn:g} deg"
    print(f"<robot{robot}> <origin {origin}>: {told}")
    return turn


print("pin", version("pin"), "with cmeel-urdfdom", version("cmeel-urdfdom"))
alone = [turned_deg(v, QUARTER) for v in ("", ' version="1.0"', ' version="1.1"', ' version="1.2"')]
if alone != [0.0, 0.0, 90.0, 90.0]:
    sys.exit("The behaviour has changed.")
print("A quaternion of a file without a version is left out without a word.")
PY
if [ -s "$work/said" ]; then
    cat "$work/said"
    echo "The behaviour has changed: there is a warning."
    exit 1
fi
