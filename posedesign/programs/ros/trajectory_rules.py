"""``trajectory_msgs/msg/JointTrajectory`` in YAML: the strict validator.

Beside the rules of :mod:`posedesign.programs.ros.yaml_rules`, those of the messages and of the
joint trajectory controller of ros2_control, which refuses or never ends what breaks them.

==================  =============================================================================
rule                what it asks
==================  =============================================================================
``stamp``           a zero stamp: a fixed one would lie in the past when the message is sent
``frame-id``        frame_id is a text
``time``            sec from 0 to 2147483647 and nanosec from 0 to 999999999, whole numbers
``increasing``      each point later than the one before, the first later than 0
``standstill``      zero velocities at the last point
==================  =============================================================================
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from posedesign.programs.recorded import Problem
from posedesign.programs.ros.yaml_rules import (
    Element,
    at,
    decimal,
    fields,
    first_problems,
    items,
    joint_names,
    joint_values,
    whole,
)

_MESSAGE = ("header", "joint_names", "points")
_HEADER = ("stamp", "frame_id")
_TIME = ("sec", "nanosec")
_POINT = ("positions", "velocities", "accelerations", "effort", "time_from_start")
_LARGEST_SEC = 2_147_483_647
_BILLION = 1_000_000_000


def check_trajectory(data: bytes) -> list[Problem]:
    """Problems in the content of a file; none for a good one."""
    return first_problems(data, _trajectory)


def _trajectory(root: Element) -> Iterator[Problem]:
    yield from fields(root, _MESSAGE, "the trajectory")
    header = at(root, "header")
    if header is not None:
        yield from _header(header)
    yield from joint_names(at(root, "joint_names"), "joint_names")
    joints = len(items(at(root, "joint_names"), "joint_names"))
    points = at(root, "points")
    listed = items(points, "points")
    if points is not None and not listed:
        yield Problem(points.line, "entries", "there are no points")
    before = 0
    for count, point in enumerate(listed, start=1):
        what = f"point {count}"
        yield from fields(point, _POINT, what)
        yield from joint_values(at(point, "positions"), joints, f"{what}: positions")
        for key in _POINT[1:4]:
            values = at(point, key)
            if items(values, f"{what}: {key}"):
                yield from joint_values(values, joints, f"{what}: {key}", math.inf)
        time = at(point, "time_from_start")
        if time is not None:
            yield from _time(time, f"{what}: time_from_start")
            now = _nanoseconds(time)
            if now is not None and now <= before:
                yield Problem(time.line, "increasing", f"{what} is not later than what is before")
            before = before if now is None else now
    if listed:
        yield from _at_rest(listed[-1])


def _header(header: Element) -> Iterator[Problem]:
    yield from fields(header, _HEADER, "header")
    stamp, frame = at(header, "stamp"), at(header, "frame_id")
    if stamp is not None:
        yield from _time(stamp, "stamp")
        if _nanoseconds(stamp):
            yield Problem(stamp.line, "stamp", "the stamp is not zero")
    if frame is not None and (frame.text is None or (frame.bare and not frame.text)):
        yield Problem(frame.line, "frame-id", "frame_id is not a text")


def _time(time: Element, what: str) -> Iterator[Problem]:
    yield from fields(time, _TIME, what)
    for key, most in zip(_TIME, (_LARGEST_SEC, _BILLION - 1), strict=True):
        part = at(time, key)
        value = whole(part)
        if part is not None and (value is None or value > most):
            yield Problem(part.line, "time", f"{what}: {key} is not a whole number of 0 to {most}")


def _nanoseconds(time: Element) -> int | None:
    sec, nanosec = (whole(at(time, key)) for key in _TIME)
    return None if sec is None or nanosec is None else sec * _BILLION + nanosec


def _at_rest(point: Element) -> Iterator[Problem]:
    velocities = at(point, "velocities")
    for item in items(velocities, "velocities"):
        if decimal(item):
            yield Problem(item.line, "standstill", "the arm still moves at the last point")
