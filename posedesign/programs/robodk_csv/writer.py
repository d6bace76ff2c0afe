"""Joint lists of RoboDK: the writer.

RoboDK's own macros (MonitorJoints.py writes such files, JointsPlayback.py and ProgramSplitJoints.py
of RoboDK/RoboDK-API read them) take J1 to Jn in degrees in the first columns, one row a stop, with
commas and without a header: to LoadList of ``robodk.robofileio`` a comment or a header is a row of
texts that no robot can be moved to. So title, mark of the plan and names stand in a text file
beside the CSV. RoboDK's documentation of its own import dialogs was not at hand.
"""

from __future__ import annotations

from posedesign.programs.arm import Arm
from posedesign.programs.lists import WARNING_LENGTH, check_options, comment_text
from posedesign.programs.program import PoseProgram
from posedesign.programs.writing import plain_all, shown_deg, warning_lines

DECIMALS = 6
"""Of degrees, as RoboDK saves them: joint values are rounded by at most 5e-7 deg."""


def render_robodk_csv(program: PoseProgram, arm: Arm) -> dict[str, str]:
    r"""Text of the list, and of the file with the names of its rows, lines ended by ``\n``.

    Poses that are only passed through are rows as well. The format has no speed, no time to settle
    and no call: the macro that moves the robot sets them.

    Raises
    ------
    InputError
        A text that cannot stand in a line, a joint beyond +-720 deg, an output to be pulsed, or
        registers to be kept.
    """
    check_options(program)
    options = program.options
    rows = [",".join(plain_all(row, DECIMALS)) for row in shown_deg(arm, program.poses)]
    beside = [f"posedesign rows of {program.name}.csv", f"program: {program.name}"]
    if options.comment:
        beside.append(f"title: {comment_text('comment', options.comment)}")
    if program.mark:
        beside.append(program.mark)
    beside += [f"note: {line}" for line in warning_lines(program, WARNING_LENGTH)]
    beside.append(f"controller: {arm.maker or 'as described'}")
    beside.append(f"rows: {len(rows)}")
    stops = zip(program.numbers, program.poses, strict=True)
    for row, (number, pose) in enumerate(stops, start=1):
        if pose.comment:
            remark = comment_text(f"comment of pose {pose.name!r}", pose.comment)
            beside.append(f"remark: {remark}")
        words = f"row {row}: {'via' if pose.via else 'pose'} {number}"
        name = comment_text("name of a pose", pose.name)
        beside.append(f"{words}: {name}" if name else words)
    return {
        f"{program.name}.csv": "\n".join(rows) + "\n",
        f"{program.name}.txt": "\n".join(beside) + "\n",
    }
