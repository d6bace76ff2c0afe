"""``trajectory_msgs/msg/JointTrajectory`` in YAML: the reader.

Takes what people write and what ``ros2 topic echo`` prints: fields in any order, any style of YAML,
the goal of an action around it, points without velocities. Only joint names and positions are
interpreted; times are for the validator.
"""

from __future__ import annotations

from pathlib import Path

from posedesign.programs.reading import refuse
from posedesign.programs.recorded import RecordedProgram
from posedesign.programs.ros.numbering import numbered
from posedesign.programs.ros.yaml_reading import (
    Node,
    YamlMap,
    line_of,
    list_at,
    map_at,
    names_at,
    read_document,
    values_at,
)

_AROUND = ("goal", "trajectory", "joint_trajectory")
"""Keys that a trajectory is found under in messages that hold one."""


def parse_trajectory(data: bytes, path: Path) -> RecordedProgram:
    """The points of a trajectory; where the arm stands at one, it counts once.

    Raises
    ------
    FileFormatError
        The content is no such trajectory, or a point has not one finite joint value for each
        joint, within +-720 deg.
    """
    document = read_document(data, path)
    root = _trajectory(document.root)
    fields = map_at(root, "the trajectory", path)
    names = names_at(fields.get("joint_names"), "joint_names", path, line_of(root))
    points = list_at(fields.get("points"), "points", path, line_of(root))
    if not points:
        refuse("holds no points", path, line_of(root), "is it the right file?")
    entries = []
    for count, point in enumerate(points, start=1):
        what, line = f"point {count}", line_of(point)
        positions = map_at(point, what, path).get("positions")
        values = values_at(positions, names, f"{what}: positions", path, line)
        entries.append((line, names, values))
    return numbered(document, entries, timed=True)


def _trajectory(node: Node) -> Node:
    """The trajectory in the message that holds it."""
    for _ in _AROUND:
        if isinstance(node, YamlMap) and "points" not in node.items:
            node = next((node.items[key] for key in _AROUND if key in node.items), node)
    return node
