"""Lists of poses to capture: the strict validators.

Beside the rules of :mod:`posedesign.programs.ros.yaml_rules`:

==================  =============================================================================
rule                what it asks
==================  =============================================================================
``ending``          a name that ends in ``.yaml``: the dialog of ``moveit_calibration`` opens no
                    other file
``same-joints``     the same joints in each entry of ``robot_calibration``
``features``        features are a list of texts
==================  =============================================================================

Keys that ``robot_calibration`` does not know are passed over there in silence, and entries of the
wrong length left out by both.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from posedesign.programs.recorded import Problem
from posedesign.programs.ros.yaml_rules import (
    Element,
    at,
    fields,
    first_problems,
    items,
    joint_names,
    joint_values,
)


def check_moveit_joints(data: bytes, path: Path) -> list[Problem]:
    """Problems in the content of a list for ``moveit_calibration``; none for a good one."""
    problems = first_problems(data, _moveit)
    if path.suffix != ".yaml":
        problems.append(Problem(1, "ending", f"the name {path.name!a} does not end in .yaml"))
    return problems


def check_robot_calibration(data: bytes) -> list[Problem]:
    """Problems in the content of a list for ``robot_calibration``; none for a good one."""
    return first_problems(data, _captures)


def _moveit(root: Element) -> Iterator[Problem]:
    yield from fields(root, ("joint_names", "joint_values"), "the file")
    names = at(root, "joint_names")
    yield from joint_names(names, "joint_names")
    joints = len(items(names, "joint_names"))
    rows = at(root, "joint_values")
    listed = items(rows, "joint_values")
    if rows is not None and not listed:
        yield Problem(rows.line, "entries", "there are no joint values")
    for count, row in enumerate(listed, start=1):
        yield from joint_values(row, joints, f"row {count}")


def _captures(root: Element) -> Iterator[Problem]:
    listed = items(root, "the file")
    if not listed:
        yield Problem(root.line, "entries", "there are no poses")
    first: set[str | None] | None = None
    for count, entry in enumerate(listed, start=1):
        what = f"entry {count}"
        yield from fields(entry, ("joints", "positions", "features"), what)
        joints = at(entry, "joints")
        yield from joint_names(joints, f"{what}: joints")
        names = items(joints, f"{what}: joints")
        yield from joint_values(at(entry, "positions"), len(names), f"{what}: positions")
        if joints is not None:
            found = {name.text for name in names}
            first = found if first is None else first
            if found != first:
                yield Problem(joints.line, "same-joints", f"{what} has other joints than entry 1")
        for feature in items(at(entry, "features"), f"{what}: features"):
            if not feature.text:
                yield Problem(feature.line, "features", f"{what} has a feature that is no text")
