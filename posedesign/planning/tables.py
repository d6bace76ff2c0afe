"""CSV files in and out: the one definition of every column.

Every name of a column ends with its unit; what has no unit has none. Tables are UTF-8 with commas
and points, as spreadsheets and ``pandas.read_csv(path, comment="#")`` read them.

``poses.csv``
-------------
One row a stop, in the order in which they are visited, then the poses that were dropped: these
have a name, a status, a reason and no numbers. J1 .. Jn are the joints from the base to the tip.

==============================  ====  ========================================================
column                          unit  meaning
==============================  ====  ========================================================
``name``                              of the pose: P01 ..; of what is passed through: V01 ..
``order``                             place in the visit, from 1; the rows stand in that order,
                                      and it is the rows that are followed
``status``                            ``grid``, ``repaired``, ``chosen`` out of a pool,
                                      ``dropped``; ``via``: passed through and not measured
``reason``                            why the pose is not that of the grid, or is passed through
``j1_deg ..``                   deg   joint values, zero and signs of the robot's description
``x_mm, y_mm, z_mm``            mm    tool point in the base frame
``w_deg, p_deg, r_deg``         deg   tip frame in the base frame: turned about fixed x by W,
                                      then y by P, then z by R
``configuration``                     arm position in the words of the controller; empty where
                                      its maker has none
``pendant_j1_deg ..``           deg   joint values as the pendant shows them; only where it
                                      shows others
``clearance_mm``                mm    smallest distance between tool, obstacles and arm; from
                                      half a metre on, distances are not told apart
``self_clearance_mm``           mm    the same between links of the arm
``limit_margin_deg``            deg   from the nearest joint limit, or limit that joints have
                                      together
``view_margin_px``              px    of the target from the edge of the camera's image
``tilt_margin_deg``             deg   left until the target is turned away too far
``camera_distance_margin_mm``   mm    left until the target is too near to the lens, or too far
==============================  ====  ========================================================

The last six are there as far as the cell describes what they are about, negative where a bound is
broken, and empty where a pose has none: what is passed through sees no target.

The first line of every file that a command writes says where it is from, see
:mod:`posedesign.files.origin`: ``# origin: simulated touch-ups by simulate from cell.toml
(699b0640) poses.csv (b8b363e3) on 2026-05-31 digest 266059b4d3459982``.

Columns of other names are kept: :attr:`.PoseList.extra`, :func:`write_pose_list`. Before the header
stand lines with ``# name: value``: ``fingerprint`` of the measured postures, ``poses measured``,
the indices of the plan by the names of :class:`posedesign.selection.indices.Indices` (``c_g`` is
C_G), and ``units``. Joints may be named as ROS does, or RoboDK: :class:`.JointForm`.

``touchups.csv``
----------------
One row a touch-up.

==============================  ====  ========================================================
column                          unit  meaning
==============================  ====  ========================================================
``target``                            name of the point that was touched
``j1_deg ..``                   deg   joint values as the controller had them, zero and signs of
                                      the robot's description; or ``pendant_j1_deg ..``, as read
                                      off the pendant
``pose``                              name of the pose; may be left out
==============================  ====  ========================================================

Other kinds of measurement: :mod:`posedesign.files.measurements`.

``pairs.csv``
-------------
``pose, a_x_mm .. a_r_deg, b_x_mm .. b_r_deg``: A = T_base_tip as the controller shows it,
B = T_target_camera, as x y z [mm] and W P R [deg]. Other forms: :mod:`posedesign.pairs.file`.

Files are hostile until read: size, encoding, header, every number, and degrees that are radians.
Texts that a spreadsheet would run as a formula are written with an apostrophe before them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from calib.errors import FileFormatError
from calib.model.measurements import Measurements
from calib.robots import Controller
from posedesign.files import StrPath
from posedesign.files.measurements import read_measurements, write_measurements
from posedesign.files.postures import JointForm
from posedesign.pairs import Pairs, read_pairs, write_pairs
from posedesign.pairs.file import pair_columns
from posedesign.planning.pose_list import DroppedPose, PoseList
from posedesign.planning.poses_file import (
    POSE_AXES,
    read_poses,
    read_robot_poses,
    write_pose_list,
    write_poses,
)

__all__ = [
    "POSE_AXES",
    "DroppedPose",
    "JointForm",
    "Pairs",
    "PoseList",
    "pair_columns",
    "read_pairs",
    "read_poses",
    "read_robot_poses",
    "read_touch_ups",
    "write_pairs",
    "write_pose_list",
    "write_poses",
    "write_touch_ups",
]


def write_touch_ups(path: StrPath, data: Measurements, names: Sequence[str] | None = None) -> Path:
    """Write ``touchups.csv``: all of the kind of the cell that they are read for."""
    return write_measurements(path, data if names is None else replace(data, names=tuple(names)))


def read_touch_ups(
    path: Path, n: int, *, controller: Controller | None = None, trust_units: bool = False
) -> Measurements:
    """Read a ``touchups.csv`` of a robot with n joints; targets in the order of appearance.

    ``controller``: turns ``pendant_j1_deg ..`` into joint values; without it such columns alone are
    refused. ``trust_units``: do not refuse values that look like radians.
    """
    table = read_measurements(path, n, controller=controller, trust_units=trust_units)
    if table.kinds != ("touch-up",):
        raise FileFormatError(
            f"holds measurements of the kinds {', '.join(table.kinds)}",
            path=path,
            column="kind",
            hint="read it with posedesign.files.measurements.read_measurements",
        )
    return table.data
