#!/usr/bin/env bash
# EAIK 1.2.2: inverse kinematics behind three parallel axes, where axes 5 and 6 almost meet.
#
# Expected: an arm that differs by 10 nm from another has next to the same postures, and an
#   answer that reaches the pose is not marked as a least squares answer.
# Happens: where the axes miss each other by less than 1 nm all is well. By 10 nm, EAIK still says
#   that it knows the arm, and finds next to no posture: its best answers have the tool turned by
#   degrees and millimetres off. By 1 um it finds two postures in five. By 0.26 mm almost all
#   answers reach the pose to 1e-6, and nine in ten of these are marked as least squares.
# Matters: right angles written as 1.5708 can make axes miss by 0.4 um; the published description
#   of a JAKA S5 has 0.26 mm. Who leaves out marked answers, as the mark suggests, is left with few
#   postures, and who trusts them all has some that are elsewhere.
# Here: calib/robots/inverse/closed_form.py measures every answer by its pose and believes no mark,
#   tries a solver before it is used, and takes the nearest arm whose axes meet (ideal.py beside
#   it). Test: tests/unit/robots/test_every_branch.py, the arms "jaka_s5" and "rounded".
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

AXES = np.array([[0, 0, 1], [0, -1, 0], [0, -1, 0], [0, -1, 0], [0, 0, -1], [0, -1, 0]], float)
COUNT = 200


def turn(axis, angle):
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def pose(steps, q):
    T = np.eye(4)
    T[:3, 3] = steps[0]
    for axis, angle, step in zip(AXES, q, steps[1:]):
        T[:3, :3] = T[:3, :3] @ turn(axis, angle)
        T[:3, 3] += T[:3, :3] @ step
    return T


def tried(miss_m):
    """Share of postures found; of right answers those marked; known or not; best miss [deg]."""
    steps = np.array(
        [[0, 0, 0.089], [0, 0, 0], [-0.425, 0, 0], [-0.392, -0.109, 0], [0, 0, -0.095]]
        + [[miss_m, -0.082, 0], [0, 0, 0]]
    )
    arm = HPRobot(AXES, steps)
    found, best, marked = 0, [], []
    for q in np.random.default_rng(1).uniform(-2.5, 2.5, (COUNT, 6)):
        wanted = pose(steps, q)
        answers = arm.IK(wanted)
        off = np.array([np.abs(pose(steps, other) - wanted).max() for other in answers.Q])
        apart = (np.array(answers.Q) - q + np.pi) % (2 * np.pi) - np.pi
        found += np.abs(apart).max(axis=1).min() < 1e-5
        miss = pose(steps, answers.Q[off.argmin()]) - wanted
        chord = np.linalg.norm(miss[:3, :3]) / np.sqrt(8)  # sine of half the angle
        best.append((np.linalg.norm(miss[:3, 3]), 2 * np.degrees(np.arcsin(chord))))
        marked += list(np.array(answers.is_LS)[off < 1e-6])
    share = np.mean(marked) if marked else np.nan
    best_m, best_deg = np.median(best, axis=0)
    print(
        f"{miss_m:7.2g} m: known to EAIK {arm.hasKnownDecomposition()}; {found} of {COUNT} "
        f"postures found; best answers off by {best_m:.1e} m, {best_deg:.1e} deg (median); of "
        f"{len(marked)} answers that reach the pose {100 * share:.0f} % marked as least squares"
    )
    return found / COUNT, share, arm.hasKnownDecomposition(), best_deg


print("EAIK", version("EAIK"))
print("Axes 5 and 6 miss each other by")
exact, below, tiny, small, large = (tried(miss) for miss in (0.0, 1e-10, 1e-8, 1e-6, 0.26e-3))
as_seen = (
    exact[:2] == below[:2] == (1.0, 0.0)
    and all(known for _, _, known, _ in (exact, below, tiny, small, large))
    and tiny[0] < 0.1
    and tiny[3] > 1.0
    and small[0] < 0.5
    and large[0] > 0.9
    and large[1] > 0.8
)
if not as_seen:
    sys.exit("The behaviour has changed.")
print(
    "Axes that miss by 10 nm to 1 um cost most postures; those that miss by a quarter of a "
    "millimetre have right answers marked as least squares."
)
PY
