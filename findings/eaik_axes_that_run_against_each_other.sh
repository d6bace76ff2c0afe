#!/usr/bin/env bash
# EAIK 1.2.2: inverse kinematics of three parallel axes, one of which runs the other way.
#
# Expected: axes and joints that count the other way are the same arm. A joint's axis is turned
#   round, the joint changes its sign, and every answer does so, too.
# Happens: where one of axes 2, 3 and 4 runs against the others, no answer reaches the pose: they
#   miss by decimetres. EAIK says that it knows the arm, and calls nine answers in ten exact; the
#   others it marks as least squares. With all three turned round, or any other axis, all that it
#   calls exact is right.
# Matters: some arms count one of these joints the other way; their DH parameters have alpha = 180
#   deg between parallel axes. A program of such postures drives the arm elsewhere.
# Here: calib/robots/inverse/eaik_arm.py turns axes to run the same way before EAIK gets them, and
#   closed_form.py beside it tries every solver first. Test: tests/unit/robots/test_every_branch.py,
#   the arm "against".
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check EAIK==1.2.2 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from eaik.IK_HP import HPRobot

# axes and steps from each to the next [m], all joints at zero: an arm in the shape of a UR5
AXES = np.array([[0, 0, 1], [0, -1, 0], [0, -1, 0], [0, -1, 0], [0, 0, -1], [0, -1, 0]], float)
STEPS = np.array(
    [[0, 0, 0.089], [0, 0, 0], [-0.425, 0, 0], [-0.392, -0.109, 0], [0, 0, -0.095], [0, -0.082, 0]]
    + [[0, 0, 0]]
)


def turn(axis, angle):
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def pose(axes, q):
    T = np.eye(4)
    T[:3, 3] = STEPS[0]
    for axis, angle, step in zip(axes, q, STEPS[1:]):
        T[:3, :3] = T[:3, :3] @ turn(axis, angle)
        T[:3, 3] += T[:3, :3] @ step
    return T


def tried(signs):
    """Whether EAIK knows the arm, and the share of answers called exact that are wrong."""
    axes = AXES * np.array(signs)[:, None]
    arm = HPRobot(axes, STEPS)
    misses, all_told = [], 0
    for q in np.random.default_rng(1).uniform(-2.5, 2.5, (100, 6)):
        wanted = pose(axes, q)
        answers = arm.IK(wanted)
        all_told += len(answers.Q)
        misses += [
            np.linalg.norm(pose(axes, found)[:3, 3] - wanted[:3, 3])
            for found, least_squares in zip(answers.Q, answers.is_LS)
            if not least_squares
        ]
    wrong = [miss for miss in misses if miss > 1e-6]
    print(
        f"axes turned round {[j + 1 for j in range(6) if signs[j] < 0]}: known to EAIK "
        f"{arm.hasKnownDecomposition()}, {len(misses)} of {all_told} answers called exact, "
        f"{len(wrong)} of these wrong"
        + (f", half of these by more than {np.median(wrong):.2f} m" if wrong else "")
    )
    return arm.hasKnownDecomposition(), len(wrong) / len(misses)


print("EAIK", version("EAIK"))
right = [tried(s) for s in ([1] * 6, [1, -1, -1, -1, 1, 1], [-1, 1, 1, 1, -1, -1])]
against = [tried(s) for s in ([1, -1, 1, 1, 1, 1], [1, 1, -1, 1, 1, 1], [1, 1, 1, -1, 1, 1])]
if any(share > 0 for _, share in right) or not all(k and share > 0.99 for k, share in against):
    sys.exit("The behaviour has changed.")
print("Where one of three parallel axes runs against the others, EAIK calls wrong answers exact.")
PY
