"""Lists of poses to capture: the readers for ``moveit_calibration`` and ``robot_calibration``.

Both tools leave out entries of the wrong length without a word, or with one in a log; here they are
refused with their line.
"""

from __future__ import annotations

from pathlib import Path

from posedesign.programs.reading import refuse
from posedesign.programs.recorded import RecordedProgram
from posedesign.programs.ros.numbering import numbered
from posedesign.programs.ros.yaml_reading import (
    Node,
    YamlList,
    line_of,
    list_at,
    map_at,
    names_at,
    read_document,
    values_at,
)


def parse_moveit_joints(data: bytes, path: Path) -> RecordedProgram:
    """Rows of a list of joint states of ``moveit_calibration``.

    Raises
    ------
    FileFormatError
        The content is no such list, or a row has not one finite joint value for each joint, within
        +-720 deg.
    """
    document = read_document(data, path)
    fields, line = map_at(document.root, "the file", path), line_of(document.root)
    names = names_at(fields.get("joint_names"), "joint_names", path, line)
    rows = list_at(fields.get("joint_values"), "joint_values", path, line)
    if not rows:
        refuse("holds no joint values", path, line, "is it the right file?")
    entries = []
    for count, row in enumerate(rows, start=1):
        line = line_of(row)
        entries.append((line, names, values_at(row, names, f"row {count}", path, line)))
    return numbered(document, entries, timed=False)


def parse_robot_calibration(data: bytes, path: Path) -> RecordedProgram:
    """Entries of a list of capture poses of ``robot_calibration``.

    Beside the entries of its files (joints, positions, features), those with joint_states are read:
    the message CaptureConfig, as it is printed.

    Raises
    ------
    FileFormatError
        The content is no such list, an entry has not one finite joint value for each joint, within
        +-720 deg, or other joints than the first.
    """
    document = read_document(data, path)
    root = document.root
    entries: list[tuple[int, tuple[str, ...], list[float]]] = []
    items: list[Node] = [root]
    if isinstance(root, YamlList):
        items = root.items
    for count, item in enumerate(items, start=1):
        what, line = f"entry {count}", line_of(item)
        fields = map_at(item, what, path)
        if "joint_states" in fields:
            state = map_at(fields["joint_states"], f"{what}: joint_states", path)
            joints, positions = state.get("name"), state.get("position")
        else:
            joints, positions = fields.get("joints"), fields.get("positions")
        names = names_at(joints, f"{what}: joints", path, line)
        values = values_at(positions, names, f"{what}: positions", path, line)
        if entries and set(names) != set(entries[0][1]):
            refuse(
                f"{what} has other joints than entry 1", path, line, "keep the joints of one arm"
            )
        entries.append((line, names, values))
    if not entries:
        refuse("holds no poses", path, line_of(root), "is it the right file?")
    return numbered(document, entries, timed=False)
