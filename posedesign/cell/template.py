"""A commented ``cell.toml`` to start from."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from calib.errors import InputError, RobotModelError, UnreachableError
from calib.robots import Robot, find_preset, preset_info
from calib.robots.arm_shapes import makers_like, presets_like, unshaped_links
from calib.robots.inverse.few_axes import AXES_OF_A_POSE
from calib.se3 import FloatArray
from posedesign.cell.cell import usual_offset_joints
from posedesign.cell.models import usual_offsets
from posedesign.cell.orientations import suggest_base_posture, suggest_tool, trial_poses
from posedesign.cell.schema import Mount

REFERENCE = "r2000ic165f"
"""Preset of the reference cell: the arm and tool of Watanabe et al. 2006 in public numbers."""

REFERENCE_REACH_M = 2.6
"""Reach of its arm, rounded; tool, camera and fixture of smaller arms are scaled by theirs."""

PAYLOAD_USED = 0.6424
"""Part of the payload that the tool weighs: 106 kg of 165 kg in the paper."""

_TEMPLATE = """\
# A calibration cell for posedesign. Lengths in mm, angles in degrees, joints in URDF signs.
# Plan with:  posedesign plan cell.toml --out DIR
{decide}
[robot]
{robot}
{shapes}{notices}\
# base = "base_link"              # positions are given in this link; default: the root
tip = {tip}
# lock = ["joint_7"]              # joints of a URDF that are held at zero
# held_deg = {{ torso = 30.0 }}     # or at other values: a torso, a head, another arm
# held_mm = {{ lift = 250.0 }}      # of what slides
# srdf = {srdf}
# group = "arm"                   # of the SRDF: its base and tip
# held_states = ["tucked"]        # of the SRDF: other joints are held as these states have them
# packages = ["../ws/src"]        # folders to search for packages that a URDF names
# xacro_args = ["prefix:=a_"]     # arguments of a xacro file
# keep_coupled_limits = false     # leave out those of the preset: limits that joints have together
# [[robot.coupling]]              # parallel linkages: the controller shows a joint with another in
# joint = "joint_3"               # it, as an IRB 4400 has J3 = q3 + q2; FANUC's J3 - J2 is known
# of = "joint_2"
# ratio = 1.0                     # in the signs of the controller
# [[robot.coupled_limit]]         # one of your own: coefficients times joint values stay inside
# name = "J2 plus J3"
# coefficients = [0.0, 1.0, 1.0, 0.0, 0.0, 0.0]
# lower_deg = -120.0
# upper_deg = 120.0

[tool]
# The point that is brought to the target: a pin, a ball, or the camera's virtual pin tip.
# {tool_note}
point_mm = {point_mm}             # in the axes of the tip
mass_kg = {mass_kg}               # what the flange carries, for deflection in the simulation
com_mm = {com_mm}
# axis = [0.0, 0.0, 1.0]          # along which it comes to the target, with plan.retreat_mm
camera_stand_off_mm = {stand_off} # the lens is this far behind the tool point, along the tip's z
# [[tool.mark]]                   # points that are measured in its place: the reflectors that an
# name = "R1"                     # instrument sees, all at once; other pins, one by one
# point_mm = [60.0, 0.0, 80.0]    # in the axes of the tip
# axis = [1.0, 0.0, 0.0]          # that a reflector faces; default: seen from all around
# largest_angle_deg = 30.0        # between it and the line of sight
{tool_bodies}
[base_pose]
# The posture with the tool point on the target that all poses are varied around.
{pendant}{positioner_deg}{slides_mm}{posture_deg}
# state = "home"                  # in its place: a group state of robot.srdf

[target]                          # of several, each begins with [[target]]
name = "T1"
# kind = "plane"                  # how it is measured; default: measurement.kind
# In the base frame; default: where the base pose puts the tool point, which is
{position_mm}
{world}# normal = [0.0, 0.0, 1.0]        # out of its face; default: to the camera at the base pose
# roll_deg = 0.0                  # of a board about it, from upright in the camera's picture
# plate_mm = [40.0, 40.0]         # of a round target: its plate, and its cross: length and width
# cross_mm = [12.0, 2.0]          # of the bars
# dark = true                     # the circle is darker than the plate
# stands_on = "positioner"        # of an instrument, where a positioner carries the base
# wpr_deg = [0.0, 0.0, 0.0]       # of an instrument: the axes that it reads in,
# nearest_mm = 500.0              # and its range; of a ball bar or a wire its lengths
# farthest_mm = 10000.0
# size_mm = [200.0, 200.0]        # of a plane: the part of it that may be touched
# dwell_s = 20.0                  # at each pose of it; default: plan.dwell_s
{surroundings}
{board}[board]                         # a calibration board that a camera sees: posedesign board
{board}kind = "charuco"                # or aruco-grid, apriltag-grid, chessboard, circles,
{board}columns = 8                     # asymmetric-circles, round-target; squares (not inner
{board}rows = 6                        # corners), markers or circles, across and down
# inner_corners = [9, 6]          # in place of columns and rows of squares
{board}square_mm = {square}                # of charuco and chessboard;
# spacing_mm = 35.0               # of the others: from marker to marker, from circle to circle
{board}marker_mm = {marker}                # side of the black square of a marker
# diameter_mm = 15.0              # of circles, default: half of spacing_mm; of a round-target
# large_dot_mm = 20.0             # of a grid that marks its left upper circle by a larger dot
{board}dictionary = "DICT_5X5_100"     # of the markers
# first_id = 0                    # of the left upper marker
# legacy = false                  # true: a charuco of OpenCV before 4.6

[constraints]
collisions = {collisions}                 # of arm, tool and obstacles
ways = true                       # check the straight joint moves from pose to pose, too
safety_distance_mm = {safety}     # kept between them
# ignore = [["pin", "fixture"]]   # pairs that may touch; tool and obstacle only at the measured
                                  # poses: plan.retreat_mm has the tool back off between them
# smallest_singular_value = 0.02  # of the tip's Jacobian, lengths divided by the arm's reach
# largest_travel_deg = 180.0      # of any joint from one pose to the next
# workspace_lowest_mm = [-1000.0, -2000.0, 0.0]      # a box that arm and tool stay in
# workspace_highest_mm = [3000.0, 2000.0, 3000.0]

[variations]
# W, P and R are varied by -D, 0, +D: 27 poses. D starts here and is raised step by step.
start_deg = [5.0, 5.0, 5.0]
step_deg = [5.0, 5.0, 5.0]
largest_deg = [60.0, 60.0, 60.0]
raise = "together"                # or "best": only the angle that lowers the condition most

[plan]
# condition_threshold = 1.0e5     # C_G = cond(G'G); the loop stops below it; 50 for camera-pose,
                                  # 100 for board
limit_margin_deg = {margin}            # kept from every joint limit: no zero is exact yet
# slide_margin_mm = 10.0          # the same of a rail, a gantry or a lift
repair = true                     # replace poses that cannot be taken
repair_margin_deg = 2.0           # kept by the replacements
repair_tilt_deg = 60.0            # largest tilt of a replacement against the base pose
repair_base_joint_deg = 90.0      # how far joint 1 may turn in a replacement
return_to_base = true             # the round ends at the base posture, by a way that is checked
approach = "none"                 # or "same-side": all joints arrive at all poses from one side,
approach_deg = 1.0                # by a last movement of this angle, for arms with backlash
# retreat_mm = 50.0               # a pin backs off so far along its axis, turns, and comes in again
# contact_mm = 5.0                # within this of the target pairs of constraints.ignore may touch
# stop_short_mm = 0.0             # programs stop so far before the target: jog in, touch up
# dwell_s = 20.0                  # at each pose, for the cycle time: a touch-up; 2 for pictures

[pool]
# What poses are chosen from: plan --method exchange, --target-accuracy, next.
kind = "auto"                     # cone (touch-ups), wpr: all grids above (camera-pose), joints, or
                                  # views: a board anywhere in the picture
tilt_deg = 45.0                   # of a cone: how far the tool is tilted; it rolls freely
candidates = 1500                 # poses that are looked at
configurations = "front"          # nearest: one posture a pose; all: over the back of the arm, too
smallest_singular_value = 0.03    # distance from singularities, where a touch-up moves joints far
seed = 0
# repeats = 3                     # times that a pose may be measured, where that tells more
# [[pool.limit]]                  # of the poses chosen: at least, at most so many, counted by
# target = "T1"                   # target, tool (mark), payload, side of the arm, zone of the tool
# tool = "R1"
# payload = "weight"
# side = "behind"                 # the first joint beyond 90 deg from the base pose; or "front"
# lowest_mm = [1000.0, -500.0, 0.0]    # corners of a zone, in the base frame
# highest_mm = [2000.0, 500.0, 800.0]
# least = 3
# most = 8

[parameters]
# Identified besides the target. Target and tool take up the first joint (not on a rail) and the
# last.
{few_axes}zero_offsets = {offsets}
tool_axes = "{tool_axes}"                 # "xy" for a view line
# Each list is a model to try; they are judged by the error to expect where the arm will work.
# Words: zero_offsets, geometry, compliance, bearings, lost_motion, scale, harmonics. A model is
# reduced to what the measurements can tell apart, or held by what is known beforehand: priors
models = [
    ["zero_offsets"], ["zero_offsets", "compliance"], ["geometry"], ["geometry", "compliance"],
    ["geometry", "priors"], ["geometry", "compliance", "priors"],{pitch}
]
# planned = ["zero_offsets"]      # what poses are planned for, where that is not the arm that is
                                  # fitted: all that may be off, held by priors
prior_offset_deg = 1.0            # usual standard deviations: how well the joints are mastered,
prior_length_mm = 0.5             # links and axes are built,
prior_angle_deg = 0.1
prior_harmonic_deg = 0.02         # transmissions run,
prior_compliance_urad_nm = 50.0   # and reducers are stiff
tune_priors = true                # find the sizes from a twentieth of these to twice as much
method = "gauss-newton"           # or "newton-raphson": as in the paper, by finite differences
loss = "auto"                     # least-squares, student-t where residuals have heavy tails;
                                  # graduated (leaves gross errors out), huber, cauchy
# harmonics = [1.0, 2.0]          # waves in a turn of a joint
# lost_motion_nm = 10.0           # torque that takes up what a joint has lost

[measurement]
kind = "{kind}"                 # or "view-line": only across the line of sight; "plane";
                                  # "point", "pose": read by a tracker or a measuring arm;
                                  # "distance": by a ball bar or a wire; "camera-pose": hand-eye
                                  # calibration, a camera sees the target's pose; "board": the same
                                  # from pictures of the [board]
three_sigma_mm = {three_sigma}    # of one touch-up, along x, y, z
noise_axes = "tip"                # of the tip, or of the "camera" as it is mounted on it
weighted = true                   # by this noise
estimate_noise = false            # true: the noise is taken from the residuals
# payloads = ["weight"]           # that poses are planned with, besides the tool's own
# least_marks = 1                 # of the tool that an instrument sees at each pose
camera_three_sigma_deg = 0.06     # of the camera's pose, for AX = ZB and camera-pose
camera_three_sigma_mm = 0.3
board_three_sigma_px = 0.6        # of a coordinate of a board's point in a picture
arm_three_sigma_mm = 0.9          # where the arm stops from where it says, along each axis, and
arm_three_sigma_deg = 0.18        # about each; of pictures of a board
estimate_lens = true              # from these pictures; false: it was calibrated before
{noise}\
# [[noise]]                       # of what is measured by instruments, and of further kinds that
# kind = "pose"                   # were measured: plane, point, pose, camera-pose, distance; of
# three_sigma_mm = 0.1            # these without it, it is taken from the residuals
# three_sigma_deg = 0.05          # poses only
# along_three_sigma_mm_per_m = 0.002   # points only: what each metre from a tracker adds along the
# across_three_sigma_mm_per_m = 0.01   # line of sight, and across it
# [[payload]]                     # carried besides the tool, in measurements that name it
# name = "weight"
# mass_kg = 50.0
# com_mm = [0.0, 0.0, 150.0]
# [[known_distance]]              # between two targets, known from elsewhere
# targets = ["T1", "T2"]
# length_mm = 500.0
# three_sigma_mm = 0.03

# [instrument]                    # files of trackers, measuring arms, motion capture, with joints
# kind = "point"                  # or "pose"
# frame = "tracker"               # its name among the targets
# unit = "mm"                     # where the file does not say it
# turn = "quaternion-wxyz"        # of poses: also -xyzw, vector-deg, wpr-deg, -rad, matrix
# header = ["name", "x", "y", "z"]        # of a file without names of columns
# reflectors = ["SMR1", "SMR2"]   # names on the tool, if there are several
# references = ["REF1"]           # names that stand still: drift is tested by them
# joint_header = ["q1", "q2", "q3", "q4", "q5", "q6"]  # of a file of joints without
# joint_unit = "deg"
# pendant = false                 # true: joints as the controller shows them
# match = "auto"                  # by "pose" (names), "time" or "order"
# time_unit = "s"
# clock_offset_s = 0.0            # added to times of the instrument
# tolerance_s = 1.0               # between a reading and a row of joints
# still_s = 0.5                   # an arm of a record stands so long within
# still_deg = 0.05
# still_mm = 2.0
# noise = "stated"                # or "repeats": the noise is that of repeated readings
# [instrument.columns]            # where the layout of the file is not known
# place = ["X", "Y", "Z"]
# turn = ["Q0", "Qx", "Qy", "Qz"]
# reflector = "Target"
# pose = "Point"
# time = "Time"
# temperature = "Temp"
# joints = ["q1", "q2", "q3", "q4", "q5", "q6"]

[touch_up]
# The loop of visual touch-up: posedesign calibrate.
center_px = 0.1                   # it ends when the target is as near to the middle of the picture
size_px = 0.05                    # and its size as near to the one designated
iterations = 10
farthest_mm = 100.0               # a loop that moves the tip farther has run away
looks = 1                         # pictures whose mean is taken
approach_deg = 0.2                # last movement of all joints, always to the same side; 0: none
shown_within_deg = 0.1            # joints that the controller shows farther off end the calibration
correct_tilt = true               # take off what a tilt does to the ellipse of a circle
repeats = 10                      # touch-ups of the base pose that the noise is measured by
inch_deg = 15.0                   # how far the arm turns about the target to find it

[truth]
# The robot that is simulated; planning and identification never look here.
seed = 1
zero_offsets_deg = {truth}
# positioner_offsets_deg = [0.07, 0.0]  # of a table that carries the target
tool_error_mm = [2.0, -1.0, 3.0]
target_error_mm = [5.0, -4.0, 2.0]
deflection = {deflection}         # reducers give way under gravity
# stiffness_nm_per_rad = [4e6, ...]  # of each joint; default: the preset's
# What follows is for posedesign calibrate.
link_error_mm = 0.0               # standard deviations of what each link is off
link_error_deg = 0.0
camera_error_deg = [0.0, 0.0, 0.0]   # the camera is turned so on its mount
target_turn_deg = [0.0, 0.0, 0.0]
backlash_deg = 0.005              # of each joint, or a list
# friction_nm = [200.0, ...]      # default: winds each reducer up by 0.003 deg
scatter_deg = 1.2e-4              # standard deviation of where a joint stops

[truth.imaging]
noise_grey = 2.0                  # grey levels of 255
blur_px = 1.0
gradient = [0.0, 0.0]             # of the light, across and down
vignetting = 0.0
distortion = [0.0, 0.0, 0.0, 0.0, 0.0]  # k1, k2, p1, p2, k3
vibration_mm = 0.002              # of the lens, standard deviation

[program]
name = "CALIB01"
user_frame = 0
tool_frame = 1
speed_percent = 10
settle_s = 1.0
measure_call = "MEASURE"          # called at each pose; "" for none
measure_argument = "number"       # with the pose's number; or always with a number of yours, "none"
# measure_output = 1              # a digital output that is pulsed, too
# measure_pulse_s = 0.5
keep = "position"                 # where a touched-up position is kept; or "register"
# first_register = 1
# form = "cartesian"              # poses of the tool in place of joints; then also its frame:
# tool = {{ at_mm = [0.0, 0.0, 100.0], wpr_deg = [0.0, 0.0, 0.0] }}  # in the axes of the tip
# user = {{ at_mm = [0.0, 0.0, 0.0], wpr_deg = [0.0, 0.0, 0.0] }}    # in the controller's world
# world = {{ at_mm = [0.0, 0.0, 0.0], wpr_deg = [0.0, 0.0, 0.0] }}   # this in the base, on a rail
# pulses_per_deg = [..]           # six, for Yaskawa's pulse jobs
# pulses_per_mm = [..]            # the same of the slides that carry the arm, its base axes

# [task_box]                      # where the arm works: posedesign predict tells its accuracy there
# lowest_mm = [1000.0, -500.0, 300.0]   # corners, in the base frame
# highest_mm = [2000.0, 500.0, 1300.0]
# steps = [3, 3, 3]               # points along x, y and z
"""

_SHAPES = """\
# shapes = "ur10e"                # of links without, in a URDF: a preset's of the same kinematics,
# capsule_radius_mm = 80.0        # or capsules from joint to joint: one radius, or one a link
"""

_BODIES = """
# Gun, camera, fixture and floor are stand-ins of the size of the arm: put in your own.
[[tool.body]]                     # what is solid, in the axes of the tip: boxes, cylinders, meshes
name = "gun"
size_mm = {gun_size}
at_mm = {gun_at}                  # its centre

[[tool.body]]
name = "camera"
size_mm = {camera_size}
at_mm = {camera_at}
"""

_SURROUNDINGS = """radius_mm = {target_radius}

[camera]                          # leave this out, and no pose is refused for what it sees
image_px = [1280, 1024]
focal_px = 1800.0
border_px = 30.0                  # kept between target and edge of the image
largest_tilt_deg = 70.0           # of the target's face against the line of sight
nearest_mm = {nearest}
farthest_mm = {farthest}
# position_mm = {lens_mm}         # the lens, in the axes of the tip: as the stand-off has it
# wpr_deg = [0.0, 0.0, 0.0]       # z looks along
# mount = "flange"                # or "fixed": in the base frame, a board is on the flange, its
                                  # middle at the tool point (measurement.kind = "board")
# lens = "pinhole"                # its distortion, of a board: or "rational", "fisheye"
# distortion = [0.0, 0.0]         # OpenCV's terms, as far as they are known
# share_in_view = 0.6             # of a board's points

[[obstacle]]                      # what stands around, in the base frame
name = "floor"
kind = "half-space"               # everything below this point
at_mm = {floor_at}

[[obstacle]]
name = "fixture"
size_mm = {fixture_size}
at_mm = {fixture_at}              # its centre; the target sits a little above its top
"""

_CAMERA_BODY = """
# Camera, board and what carries them are stand-ins of the size of the arm: put in your own.
[[tool.body]]                     # what is solid, in the axes of the tip: boxes, cylinders, meshes
name = "camera"
size_mm = {camera_size}
at_mm = {camera_at}  # its centre; the lens is its front
"""

_BOARD_BODY = """
# Camera, board and what carries them are stand-ins of the size of the arm: put in your own.
[[tool.body]]                     # what is solid, in the axes of the tip: boxes, cylinders, meshes
name = "board"
size_mm = {board_size}
at_mm = {board_at}  # its centre; the pattern is its front
"""

_SEES_BOARD = """
[camera]
mount = "{mount}"                 # on the "flange", or "fixed" around the arm
image_px = [1280, 1024]
focal_px = {focal}                # put in your own, roughly: it is estimated
border_px = 30.0                  # kept between points and the edge of the image
largest_tilt_deg = 60.0           # of the board's face against the line of sight
nearest_mm = {nearest}            # where it is sharp
farthest_mm = {farthest}
# position_mm = {lens_mm}         # the lens: {lens_note}
# wpr_deg = [0.0, 0.0, 0.0]       # z looks along; default: towards the board at the base pose
# lens = "pinhole"                # its distortion: or "rational", "fisheye"
# distortion = [0.0, 0.0]         # OpenCV's terms, as far as they are known
# share_in_view = 0.6             # of a board's points

[[obstacle]]                      # what stands around, in the base frame
name = "floor"
kind = "half-space"               # everything below this point
at_mm = {floor_at}
{on_floor}
[[obstacle]]
name = "{stand}"
{stand_shape}
at_mm = {stand_at}                # its centre
{on_plate}"""

_NO_BODIES = """
# Gun, camera, fixture and floor are stand-ins of the size of the arm: put in your own.
# [[tool.body]]                   # what is solid, in the axes of the tip: boxes, cylinders, meshes
# name = "gripper"
# size_mm = [100.0, 100.0, 150.0]
# at_mm = [0.0, 0.0, 75.0]        # its centre
"""

_NO_SURROUNDINGS = """
# [camera]                        # without this no pose is refused for what the camera sees
# image_px = [1280, 1024]
# focal_px = 1800.0

# [[obstacle]]                    # what stands around, in the base frame: box (size_mm), cylinder
# name = "table"                  # (radius_mm, height_mm), sphere, mesh, scene
# kind = "half-space"             # a half-space is everything below at_mm
# at_mm = [0.0, 0.0, 0.0]
# stands_on = "floor"             # or "positioner", where one carries the base: what it turns with
"""


@dataclass(frozen=True)
class _Setup:
    """What the arm carries and looks at, all scaled with the arm."""

    tool_note: str
    point_mm: Sequence[float]
    mass_kg: float
    com_mm: Sequence[float]
    stand_off_mm: float
    safety_mm: float = 10.0
    tool_bodies: str = _NO_BODIES
    surroundings: str = _NO_SURROUNDINGS
    margin_deg: float = 1.0
    collisions: bool = True
    board_square_mm: float | None = None


@dataclass(frozen=True)
class _Told:
    """What is measured, and what of the arm that tells."""

    offsets: Sequence[str]
    tool_axes: str = "xyz"
    kind: str = "touch-up"
    notes: Sequence[str] = ()


class _ReadWith(NamedTuple):
    """What a description is read with, by the names that :meth:`Robot.from_urdf` has for it."""

    packages: tuple[Path, ...]
    xacro_args: tuple[str, ...]
    tip: str | None
    base: str | None
    lock: tuple[str, ...]

    def lines(self) -> str:
        """Lines of the cell, so that it reads the same; the tip has its own."""
        listed = {
            "packages": [str(f.resolve()) for f in self.packages],
            "xacro_args": self.xacro_args,
            "lock": self.lock,
        }
        base = "" if self.base is None else f"base = {_quoted(self.base)}\n"
        return base + "".join(
            f"{key} = [{', '.join(map(_quoted, values))}]\n"
            for key, values in listed.items()
            if values
        )


def cell_template(
    robot: str | None = None,
    *,
    surroundings: bool = True,
    camera: Mount | None = None,
    packages: Sequence[Path] = (),
    xacro_args: Sequence[str] = (),
    tip: str | None = None,
    base: str | None = None,
    lock: Sequence[str] = (),
) -> str:
    """Text of a ``cell.toml``, commented, for a preset or a URDF file.

    Parameters
    ----------
    robot : str, optional
        Name of a preset or path of a URDF; the reference cell by default.
    surroundings : bool
        False: without gun, camera, fixture and floor, and with the joint limits as they are, so
        that they alone bound the poses, as in the papers.
    camera : {"flange", "fixed"}, optional
        A cell for pictures of a board: by a camera on the flange, or by one that stands around the
        arm, with the board on the flange.
    packages : sequence of Path
        Folders to search for packages that a URDF names.
    xacro_args : sequence of str
        Arguments of a xacro file, each ``NAME:=VALUE``.
    tip, base : str, optional
        Links of a URDF that the arm ends and begins at, where it is a branch of a bigger tree.
    lock : sequence of str
        Joints of a URDF between them that are held.

    Raises
    ------
    RobotModelError
        Neither a preset nor a file that can be read.
    UnreachableError
        No base posture was found for the arm of a URDF.
    """
    name = robot or REFERENCE
    path = Path(name)
    if path.is_file() or path.suffix.lower() in (".urdf", ".xml", ".xacro"):
        read_with = _ReadWith(tuple(packages), tuple(xacro_args), tip, base, tuple(lock))
        return _for_urdf(path, read_with, camera)
    if packages or xacro_args or tip or base or lock:
        raise InputError(
            f"packages, arguments, tip, base and joints to lock are of a URDF; {name!r} is none",
            hint="leave them out",
        )
    try:
        preset = find_preset(name)
    except RobotModelError as error:
        raise RobotModelError(
            f"{name!r} is neither a preset nor a URDF file",
            hint=error.hint,
            name=name,
        ) from error
    return _for_preset(preset, surroundings, camera)


def _for_preset(name: str, surroundings: bool, camera: Mount | None) -> str:
    info = preset_info(name)
    robot = Robot.preset(name)
    if camera is not None:
        return _camera_cell(robot, camera, source=f'preset = "{name}"')
    posture = info["base_posture_deg"]
    pendant = ""
    if robot.controller is not None and robot.controller.maker == "fanuc":
        shown = robot.controller.pendant(np.deg2rad(posture))[2]
        pendant = f"# A FANUC pendant shows J3 = {shown:g} here: J3 less J2.\n"
    known = bool(robot.link_mass.any() and np.isfinite(robot.stiffness).any())
    return _fill(
        robot,
        source=f'preset = "{name}"',
        setup=_gun_and_camera(robot, np.deg2rad(posture), float(info["payload_kg"]), surroundings),
        pendant=pendant,
        posture=posture,
        three_sigma=[0.02, 0.02, 0.12],
        deflection=known,
    )


def _for_urdf(path: Path, read_with: _ReadWith, camera: Mount | None) -> str:
    robot = Robot.from_urdf(path, **read_with._asdict())
    source = f"urdf = {_quoted(str(path.resolve()))}\n"
    source += read_with.lines() + _controller_line(robot)
    decide, shapes = _shape_lines(robot)
    if camera is not None:
        return _camera_cell(robot, camera, source=source, decide=decide, shapes=shapes)
    tool = suggest_tool(robot)
    posture = robot.shown(suggest_base_posture(robot, tool))
    setup = _Setup(
        tool_note="A SUGGESTION only: put in your own, as good as you know it; it is identified.",
        point_mm=(1e3 * tool).tolist(),
        mass_kg=0.0,
        com_mm=[0.0, 0.0, 0.0],
        stand_off_mm=100.0,
    )

    def text(told: _Told | None = None) -> str:
        return _fill(
            robot,
            source=source,
            setup=setup,
            pendant=_SUGGESTED.format("tool pointing down"),
            posture=(np.round(posture, 6) + 0.0).tolist(),
            three_sigma=[0.1, 0.1, 0.1],
            deflection=False,
            srdf=srdf_beside(path),
            decide=decide,
            shapes=shapes,
            told=told,
        )

    return text(_told_by_few_axes(robot, text) if robot.n < AXES_OF_A_POSE else None)


_NOISE_OF_POINTS = """\
[[noise]]
kind = "point"
three_sigma_mm = 0.1
"""

_STANDS_ASIDE = 2.0
"""Distance of an instrument from the tool point, in reaches of the arm."""

_TOUCHES_TOO_LITTLE = (
    "Touch-ups of one point tell no zero of an arm of so few axes: an instrument that",
    'reads points of the tool tells more. kind = "touch-up" needs several pins and targets.',
)
_NOT_TOLD = "Not told by any pose, and left out: {}."


def _told_by_few_axes(robot: Robot, text: Callable[[_Told], str]) -> _Told:
    """Return what poses of an arm of fewer than six axes tell, by touch-ups or else by points."""
    from posedesign.cell.cell import Cell
    from posedesign.cell.few_axes import told_of

    usual = usual_offset_joints(robot)
    kind, notes = "touch-up", []
    offsets, axes = told_of(Cell.from_text(text(_Told(usual))))
    if not offsets:
        kind, notes = "point", list(_TOUCHES_TOO_LITTLE)
        offsets, axes = told_of(Cell.from_text(text(_Told(usual, kind=kind))))
    missing = ", ".join(_printed(joint) for joint in usual if joint not in offsets)
    return _Told(offsets, axes, kind, [*notes, *([_NOT_TOLD.format(missing)] if missing else [])])


def _scale(robot: Robot) -> float:
    """Size of an arm against that of the reference cell."""
    return min(1.0, robot.chain.reach_m / REFERENCE_REACH_M)


def _gun_and_camera(
    robot: Robot, posture: FloatArray, payload_kg: float, surroundings: bool
) -> _Setup:
    """The gun, the camera, the fixture and the floor of the reference cell, scaled to an arm."""
    k = _scale(robot)

    def scaled(*lengths_mm: float) -> list[float]:
        return [_round(k * length, 1) for length in lengths_mm]

    point = scaled(200.0, -50.0, 350.0)
    bare = _Setup(
        tool_note="As good as you know it; it is identified too.",
        point_mm=point,
        mass_kg=_round(PAYLOAD_USED * payload_kg, 1),
        com_mm=scaled(50.0, 0.0, 200.0),
        stand_off_mm=point[2],
        margin_deg=0.0,
        collisions=False,
    )
    if not surroundings:
        return bare
    stand_off = scaled(250.0)[0]
    x, y, z = (1e3 * robot.state(posture).point(np.array(point) / 1e3)).tolist()
    floor = min(0.0, z - 250.0 * k)  # a small arm stands on a table
    top = z - 20.0 * k
    bodies = _BODIES.format(
        gun_size=scaled(280.0, 220.0, 270.0),
        gun_at=scaled(-10.0, 0.0, 145.0),
        camera_size=scaled(80.0, 80.0, 120.0),
        camera_at=scaled(200.0, -50.0, 40.0),  # the lens is its front
    )
    around = _SURROUNDINGS.format(
        target_radius=scaled(10.0)[0],
        nearest=scaled(100.0)[0],
        farthest=scaled(700.0)[0],
        lens_mm=[point[0], point[1], _round(point[2] - stand_off, 1)],
        floor_at=[0.0, 0.0, _round(floor, 1)],
        fixture_size=[*scaled(120.0, 120.0), _round(top - floor, 1)],
        fixture_at=[_round(v, 1) for v in (x, y, (top + floor) / 2.0)],
    )
    return replace(
        bare,
        margin_deg=1.0,
        collisions=True,
        stand_off_mm=stand_off,
        safety_mm=scaled(20.0)[0],
        tool_bodies=bodies,
        surroundings=around,
    )


_SUGGESTED = "# Suggested: {}, room to turn it. Take your own taught posture.\n"

_BOARD_OF_SCALE, _SQUARES_OF_SMALL_MM = 40.0, (22.0, 15.0, 10.0)
"""Squares of the board of an arm of the size of the reference cell's, and the smallest ones [mm]:
30 cm from the camera, where usual lenses are sharp, or nearer where an arm has no room there."""

_ENOUGH_TRIALS = 24
"""Poses of the trial grid that make a place good enough."""

_AWAY = 13.5
"""Distance of camera and board at the base pose, in squares: eight of them fill two thirds of the
picture."""

_FOCAL_PX, _CLEAR_OF_WRIST_MM = 1400.0, 80.0


def _camera_cell(robot: Robot, mount: Mount, **lines: Any) -> str:
    """A cell with a camera and a board of the size of an arm, its base pose clear of all."""
    fixed = mount == "fixed"
    if fixed and robot.floor:
        raise InputError(
            f"a camera that stands around the arm does not turn with {robot.base_frame}, which a "
            "positioner carries",
            hint="name a link on the floor as base, or put the camera on the flange",
            name="camera",
        )
    scaled = _round(_scale(robot) * _BOARD_OF_SCALE, 0)
    squares = sorted({max(scaled, least) for least in _SQUARES_OF_SMALL_MM}, reverse=True)
    best, most = "", -1
    for square in squares:
        try:
            text, count = _camera_cell_of(robot, fixed, square, **lines)
        except UnreachableError:
            if square == squares[-1] and not best:
                raise
            continue
        if count > most:
            best, most = text, count
        if most >= _ENOUGH_TRIALS:
            break
    return best


def _camera_cell_of(robot: Robot, fixed: bool, square: float, **lines: Any) -> tuple[str, int]:
    """The same with a board of these squares [mm], and how many trial poses can be taken there."""
    away, carried = _AWAY * square, max(4.0 * square, _CLEAR_OF_WRIST_MM)
    point = [0.0, 0.0, carried] if fixed else [square, 0.0, carried + away]

    from posedesign.cell.cell import Cell

    def text(q: FloatArray) -> str:
        sizes = square, away, carried
        return _fill(robot, **lines, **_camera_and_board(robot, fixed, q, point, sizes))

    def is_clear(q: FloatArray) -> bool:
        cell = Cell.from_text(text(q))
        try:
            return bool(cell.checker.check(q[None]).feasible[0])
        except RobotModelError:  # links without a shape: to be decided on before
            return True

    tool = np.array(point) / 1e3
    q = suggest_base_posture(robot, tool, ahead=fixed, suits=is_clear)
    return text(q), trial_poses(robot, tool, q)


def _camera_and_board(
    robot: Robot,
    fixed: bool,
    q: FloatArray,
    point: Sequence[float],
    sizes_mm: tuple[float, float, float],
) -> dict[str, Any]:
    """What :func:`_fill` is told of camera and board at a base posture ``(n,)`` [rad].

    Parameters
    ----------
    point : sequence of three floats
        Middle of the board in the axes of the tip [mm].
    sizes_mm : tuple of three floats
        Of a square, the distance of camera and board, and how far from the tip the one is that it
        carries.
    """
    square, away, carried = sizes_mm
    width, height = 9.0 * square, 7.0 * square
    state = robot.state(q)
    x, y, z = (1e3 * state.point(np.array(point) / 1e3)).tolist()
    lens = 1e3 * state.point(
        np.array([*point[:2], point[2] + away * (1.0 if fixed else -1.0)]) / 1e3
    )
    floor = min(0.0, z - 10.0 * square)
    if fixed:
        body = _BOARD_BODY.format(
            board_size=[width, height, square / 4.0],
            board_at=[*point[:2], _round(point[2] - square / 8.0 - 1.0, 2)],
        )
        stand, shape = "camera", f'kind = "sphere"\nradius_mm = {1.5 * square}'
        out = state.R_base_tip[:, 2] * (1.5 * square + 1.0)
        stand_at = (lens + out).tolist()
    else:
        body = _CAMERA_BODY.format(
            camera_size=[2.0 * square, 2.0 * square, carried],
            camera_at=[square, 0.0, carried / 2.0],
        )
        top = z - 1.0
        if robot.floor:  # on the plate, and below all of a board that need not be level with it
            top -= 0.75 * width * float(np.hypot(*state.R_base_tip[:2, 2]))
            floor = min(0.0, top - 1.0)
        stand, shape = "stand", f"size_mm = {[width, width, _round(top - floor, 1)]}"
        stand_at = [x, y, (top + floor) / 2.0]
    return {
        "setup": _Setup(
            tool_note="The middle of the board"
            + (", out of whose face the tip's z runs." if fixed else " at the base pose."),
            point_mm=point,
            mass_kg=0.0,
            com_mm=[0.0, 0.0, 0.0],
            stand_off_mm=away,
            tool_bodies=body,
            surroundings=_SEES_BOARD.format(
                mount="fixed" if fixed else "flange",
                focal=_FOCAL_PX,
                nearest=_round(0.6 * away, 1),
                farthest=2.0 * away,
                lens_mm=[_round(v, 1) for v in (lens.tolist() if fixed else [*point[:2], carried])],
                lens_note="in the base frame" if fixed else "in the axes of the tip",
                floor_at=[0.0, 0.0, 0.0 if robot.floor else _round(floor, 1)],
                on_floor='stands_on = "floor"               # in the root\n' * bool(robot.floor),
                on_plate='stands_on = "positioner"\n' * bool(robot.floor),
                stand=stand,
                stand_shape=shape,
                stand_at=[_round(v, 1) for v in stand_at],
            ),
            board_square_mm=square,
        ),
        "pendant": _SUGGESTED.format("tool pointing ahead" if fixed else "tool pointing down"),
        "posture": (np.round(robot.shown(q), 6) + 0.0).tolist(),
        "three_sigma": [0.1, 0.1, 0.1],
        "deflection": False,
    }


def srdf_beside(urdf: Path) -> Path | None:
    """A semantic description that lies in the folder of a URDF; not taken unasked."""
    return next(iter(sorted(urdf.resolve().parent.glob("*.srdf"))), None)


def _controller_line(robot: Robot) -> str:
    """The controller, of a URDF that says by its name that it is ROS-Industrial's of a FANUC.

    Its axes have to be as that maker counts them: a description with another zero posture is read
    in its own view only. Where nothing tells the maker, none is guessed.
    """
    fitting = makers_like(robot)
    if robot.name.lower().startswith("fanuc") and "fanuc" in fitting:
        return (
            'controller = "fanuc"              # what the pendant shows; programs are in its view'
        )
    if not fitting:
        return (
            "# controller: the description names no maker known here that counts joints so;\n"
            "# programs for any robot: ros-trajectory, moveit-joints, robot-calibration, robodk-csv"
        )
    return (
        f'# controller = "{fitting[0]}"'.ljust(34)
        + "# whose it is: needed for its programs"
        + (f"; or {', '.join(fitting[1:])}" if fitting[1:] else "")
    )


def _shape_lines(robot: Robot) -> tuple[str, str]:
    """What to decide about links without a shape, for the top of the file; and the keys for it.

    The shapes of a preset with the same kinematics are taken. Capsules are not: against the shapes
    of the presets, those from joint to joint would need a radius of 0.04 to 0.32 of the arm's reach
    to hold a link, so that no radius is both safe and of use for an arm that nobody has looked at.
    """
    bare = [_printed(link) for link in unshaped_links(robot)]
    if not bare:
        return "", _SHAPES
    names, same = ", ".join(bare), presets_like(robot)
    if same:
        return "", (
            f"# The URDF has no collision geometry for {names}.\n"
            + f'shapes = "{same[0]}"'.ljust(34)
            + "# shapes of a preset with the same kinematics\n"
        )
    decide = (
        f"#\n# DECIDE FIRST: the URDF has no collision geometry for {names}:\n"
        "# plan refuses until you give it in the URDF, set robot.capsule_radius_mm below, or say\n"
        "# constraints.collisions = false.\n"
    )
    radius = _round(1e2 * robot.chain.reach_m, 0)
    return decide, (
        f"# capsule_radius_mm = {radius:g}".ljust(34)
        + "# or a list, one a link: MEASURE your arm. Capsules run from\n"
        "# joint to joint: a motor, a counterweight or a shoulder beside it needs a larger one\n"
    )


def _printed(text: str) -> str:
    """A name on one line: those in a URDF may hold line ends."""
    return " ".join(text.split())


def _world_line(robot: Robot) -> str:
    """Where the controller counts positions from, if that is not the base frame."""
    if robot.controller is None or robot.floor:  # it turns with a positioner
        return ""
    if np.allclose(robot.controller.T_base_world, np.eye(4)):
        return ""
    x, y, z = [_round(v, 1) for v in 1e3 * robot.controller.T_base_world[:3, 3]]
    turned = " and turned" * (not np.allclose(robot.controller.T_base_world[:3, :3], np.eye(3)))
    return (
        f"# The controller counts positions from ({x:g}, {y:g}, {z:g}) mm in {robot.base_frame}"
        f"{turned}, not from {robot.base_frame} itself.\n"
    )


def _quoted(text: str) -> str:
    """A TOML string: names in a URDF and paths may hold quotation marks and backslashes."""
    return json.dumps(text, ensure_ascii=False)


def _round(value: float, decimals: int) -> float:
    return round(float(value), decimals) + 0.0


def _fill(
    robot: Robot,
    *,
    source: str,
    setup: _Setup,
    pendant: str,
    posture: Sequence[float],
    three_sigma: Sequence[float],
    deflection: bool,
    srdf: Path | None = None,
    decide: str = "",
    shapes: str = _SHAPES,
    told: _Told | None = None,
) -> str:
    told = _Told(usual_offset_joints(robot)) if told is None else told
    point = robot.state(robot.of_shown(posture)).point(np.array(setup.point_mm) / 1e3)
    place = f"# position_mm = {[_round(v, 3) for v in 1e3 * point]}"
    if told.kind == "point":
        aside = point + np.array([_STANDS_ASIDE * robot.chain.reach_m, 0.0, 0.0])
        place = (
            "# the tool point; of an instrument: ROUGHLY where it stands\n"
            f"position_mm = {[_round(v, 0) for v in 1e3 * aside]}"
        )
    offsets = ", ".join(map(_quoted, told.offsets))
    shown = np.array(posture)
    scales = '["zero_offsets", "scale"], '
    turned = shown[: robot.floor][::-1].tolist()
    along, arm = shown[robot.sliding].tolist(), shown[robot.arm_turns].tolist()
    slide = ", ".join(n for n, s in zip(robot.joint_names, robot.sliding, strict=True) if s)
    return _TEMPLATE.format(
        decide=decide,
        shapes=shapes,
        robot=source,
        tool_note=setup.tool_note,
        position_mm=place,
        world=_world_line(robot),
        notices="".join(f"# {_printed(said)}\n" for said in robot.notices),
        tip=_quoted(robot.tip_frame),
        srdf=_quoted(str(srdf or "arm.srdf")).ljust(22) + " # what MoveIt knows of the URDF",
        point_mm=list(setup.point_mm),
        mass_kg=setup.mass_kg,
        com_mm=list(setup.com_mm),
        stand_off=setup.stand_off_mm,
        tool_bodies=setup.tool_bodies,
        surroundings=setup.surroundings,
        safety=setup.safety_mm,
        margin=setup.margin_deg,
        collisions=str(setup.collisions).lower(),
        board="# " if setup.board_square_mm is None else "",
        square=setup.board_square_mm or 25.0,
        marker=18.0 if setup.board_square_mm is None else _round(0.7 * setup.board_square_mm, 1),
        kind=told.kind if setup.board_square_mm is None else "board",
        tool_axes=told.tool_axes,
        few_axes="".join(f"# {line}\n" for line in told.notes),
        noise=_NOISE_OF_POINTS * (told.kind == "point"),
        pendant=pendant,
        positioner_deg=f"positioner_deg = {turned}  # of "
        f"{', '.join(robot.joint_names[: robot.floor][::-1])}\n"
        if turned
        else "# positioner_deg = [0.0, 0.0]    # of a table that carries the target, E1 first\n",
        slides_mm=f"slides_mm = {along}  # of {slide}\n"
        if along
        else "# slides_mm = [500.0]           # of a rail, a gantry, a lift that carries the arm\n",
        posture_deg=f"posture_deg = {arm}" if arm else "# posture_deg = [0.0]  # of what turns",
        offsets=f"[{offsets}]",
        pitch=f'\n    {scales}["geometry", "scale", "priors"],' if along else "",
        three_sigma=list(three_sigma),
        truth=np.round(np.rad2deg(usual_offsets(len(robot.turning_joints))), 6).tolist(),
        deflection=str(deflection).lower(),
    )
