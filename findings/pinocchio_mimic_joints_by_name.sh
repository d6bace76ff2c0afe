#!/usr/bin/env bash
# Pinocchio 4.1.0: whether a URDF with a mimic joint can be read hangs on the names of its joints.
#
# Expected: names of joints mean nothing. Two fingers of one palm, the second of which follows the
#   first, make the same model whatever they are called.
# Happens: with mimic=True, "left" and its follower "right" make a model of one degree of freedom.
#   Let them change names, and the same file is refused: "The parent joint of the mimic joint is not
#   in the kinematic tree", which it is. Joints of one link come in alphabetical order, and who
#   follows must come behind who leads.
# Matters: grippers have such fingers, their names are the maker's, and who reads the message looks
#   for a joint that is there. A prefix does not help: it moves all names alike.
# Here: calib/robots/description/urdf_kinematics.py reads <mimic> itself (Kinematics.led), by name
#   and in any order. Test: tests/unit/robots/test_branches.py, the arms with grippers.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check \
    pin==4.1.0 libpinocchio==4.1.0 cmeel-urdfdom==6.0.0 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import pinocchio as pin


def finger(name, y, more=""):
    return (
        f'<joint name="{name}" type="prismatic"><parent link="palm"/><child link="{name}_finger"/>'
        f'<axis xyz="0 {y} 0"/><limit lower="0" upper="0.04" effort="9" velocity="1"/>{more}'
        f'</joint><link name="{name}_finger"/>'
    )


def read(leader, follower):
    """Return the number of degrees of freedom, or the message where the file is refused."""
    text = (
        '<robot name="gripper"><link name="palm"/>'
        + finger(leader, 1)
        + finger(follower, -1, f'<mimic joint="{leader}"/>')
        + "</robot>"
    )
    try:
        outcome = pin.buildModelFromXML(text, True).nv
    except ValueError as error:
        outcome = str(error)
    print(f"{follower!r} follows {leader!r}: {outcome}")
    return outcome


print("pin", version("pin"), "with cmeel-urdfdom", version("cmeel-urdfdom"))
one, other = read("left", "right"), read("right", "left")
if one != 1 or "not in the kinematic tree" not in str(other):
    sys.exit("The behaviour has changed.")
print("A joint that follows one of the same link must have a name that sorts behind its leader's.")
PY
