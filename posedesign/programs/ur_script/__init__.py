"""Universal Robots URScript programs (``.script``): the writer.

Joints are in radians, poses in metres with rotation vectors in radians, in the controller's base
frame (turned by half a turn against ``base_link`` of the public descriptions), or in a user frame
that is given by value (``pose_trans``). Numbers of frames mean nothing here. A pose is moved to by
``movej(get_inverse_kin(p[...], qnear=[...]))``: with a bare pose the controller would choose the
arm position. Each arm has its own kinematics from the factory, so that the joint values which take
a pose differ from those of the description by what a calibration is after.

A script cannot be touched up where it stands. It therefore reports: after the measuring call of
pose 3 it writes ``POSE 3 q=[...]`` with the actual joint positions [rad] into the log, and at its
start ``PROGRAM NAME PLAN 1a2b3c4d 27``; the saved log is read back. This is so with either value of
``keep``. How many digits the log shows is the controller's choice. It also holds
the number of the pose in an output integer register for half a second, where :mod:`.live` sees it.

URScript refuses functions that it does not know: the measuring call is defined in the script. As
written it lets the arm be guided by hand (freedrive) until the operator answers that the tool is
where it belongs, or, where a camera looks, asks alone; put another body there to trigger an
instrument instead. ``freedrive_mode()`` is called once: it holds until ``end_freedrive_mode()``,
while the program runs on (the loops around it in public code keep their program from ending). The
question is no blocking popup, which suspends the program by the manual's words, and of which
nothing public says that the arm stays free.

Facts: the URScript manual's functions, public post-processors (RoboDK) and scripts that PolyScope
generates. Nothing was run on a controller.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from calib.errors import InputError
from posedesign.programs import writing
from posedesign.programs.arm import Arm, Load
from posedesign.programs.dialect import Dialect
from posedesign.programs.notation import VECTOR, Notation, texts_of
from posedesign.programs.program import PoseProgram, in_range
from posedesign.programs.ur_script.reader import (
    MOST_LIMIT_DEG,
    MOST_OUTPUT,
    NAMES,
    is_log,
    parse_ur_script,
)
from posedesign.programs.ur_script.rules import check_ur_script
from posedesign.programs.writing import Limits, Phrases, plain, plain_all, shown_deg

USUAL_SPEED_RAD_S = np.pi
"""Joint speed of 100 percent where the robot is not known: that of UR3e and UR5e, 180 deg/s."""

ACCELERATION_RAD_S2 = 1.4  # what ``movej`` has by default
REGISTER = 36  # output integer register that the number of a pose is written into: see :mod:`.live`
HELD_S = 0.5  # time that it stands there: five times what is looked at
TEXT_LENGTH = 80  # characters of a remark: longer ones are cut in the log
LIMITS = Limits(
    text=TEXT_LENGTH,
    remark=TEXT_LENGTH,
    forbidden='"\\',  # quotes and backslashes end or change a text
    begins=("POSE ", "PLAN ", "PROGRAM ", "Title:"),
    settle_s=1e4,
    outputs=(0, MOST_OUTPUT),
)

_PHRASES = Phrases(
    note="# {}",
    remark='textmsg("{}")',
    move=(f"movej({{target}}, a={ACCELERATION_RAD_S2}, v={{speed}})",),
    wait="sleep({time:.3f})",
    pulse=(
        "set_standard_digital_out({output}, True)",
        "sleep({time:.3f})",
        "set_standard_digital_out({output}, False)",
    ),
    call=("{call}({argument})",),
    after=(
        'textmsg("POSE {number} q=", get_actual_joint_positions())',
        f"write_output_integer_register({REGISTER}, {{number}})",
        f"sleep({HELD_S})",
        f"write_output_integer_register({REGISTER}, 0)",
    ),
)

NOTATION = Notation(7, 7, 7, np.pi / 180, 1.0, VECTOR)

MOST_MASS_KG = 1000.0  # no arm carries so much
MOST_CENTRE_M = 5.0  # nor so far from its flange


def render_ur_script(program: PoseProgram, arm: Arm) -> dict[str, str]:
    """Text of the script: joints to 3e-6 deg, poses to 0.05 micrometres.

    The arm's tool frame becomes the TCP; its user frame is written where it is not the base frame.
    Its load becomes the payload; where it is not known, that of the installation stays.
    """
    speed = _speed(arm, program.options.speed_percent)
    steps = _PHRASES.visit(program, LIMITS, _targets(program, arm), speed=speed)
    lines = [*_head(program, arm), *steps]
    body = "\n".join("  " + line for line in lines)
    text = f"def {program.name}():\n{body}\nend\n{program.name}()\n"
    return {f"{program.name}.script": text}


def _targets(program: PoseProgram, arm: Arm) -> Iterator[str]:
    """What is moved to: joints, or poses with the joints that are near."""
    shown = shown_deg(arm, program.poses)
    beyond = np.argwhere(np.abs(shown) > MOST_LIMIT_DEG)
    if len(beyond):
        i, j = (int(k) for k in beyond[0])
        raise InputError(
            f"pose {program.poses[i].name!r}: J{j + 1} is {shown[i, j]:.1f} deg, "
            f"beyond +-{MOST_LIMIT_DEG:g}",
            hint="no joint of these arms turns so far",
            name=program.poses[i].name,
            value=float(shown[i, j]),
            bound=MOST_LIMIT_DEG,
        )
    given = "{}" if _in_base(arm) else "pose_trans(user_frame, {})"
    for texts in texts_of(program, arm, NOTATION, NOTATION.joint):
        joints = _listed(texts.joints)
        pose = given.format(f"p{_listed(texts.placed)}")
        yield f"get_inverse_kin({pose}, qnear={joints})" if texts.placed else joints


def _listed(texts: list[str]) -> str:
    return f"[{', '.join(texts)}]"


def _in_base(arm: Arm) -> bool:
    return np.array_equal(arm.T_world_user, np.eye(4))


def _head(program: PoseProgram, arm: Arm) -> Iterator[str]:
    options = program.options
    for line in writing.title_lines(program, TEXT_LENGTH, LIMITS.forbidden):
        yield f"# Title: {line}" if line == options.comment else f"# {line}"
    if options.measure_call is not None:
        yield from _measuring(program)
    tool, user = map(_listed, NOTATION.pose_texts(np.stack([arm.T_tip_tool, arm.T_world_user])))
    yield f"set_tcp(p{tool})"
    if arm.load is not None:
        yield _payload(arm.load)
    if options.form == "cartesian" and not _in_base(arm):
        yield f"user_frame = p{user}"
    yield f'textmsg("PROGRAM {program.name} {program.mark}")'.replace(' ")', '")')
    yield f"write_output_integer_register({REGISTER}, 0)"


def _payload(load: Load) -> str:
    """Mass and centre of what the flange carries: in freedrive the arm sinks or rises without."""
    in_range("mass of the load", load.mass_kg, 0.0, MOST_MASS_KG)
    for value in load.com_m:
        in_range("centre of the load", float(value), -MOST_CENTRE_M, MOST_CENTRE_M)
    return f"set_payload({plain(load.mass_kg, 4)}, {_listed(plain_all(load.com_m, 6))})"


def _measuring(program: PoseProgram) -> Iterator[str]:
    """The function that is called at each pose."""
    options = program.options
    argument = "" if options.measure_argument is None else "number"
    yield f"def {options.measure_call}({argument}):"
    if argument:
        yield '  textmsg("measuring ", number)'
    if options.guided:
        yield "  freedrive_mode()"
    yield f'  while not request_boolean_from_primary_client("{options.question}"):'
    yield "    sync()"
    yield "  end"
    if options.guided:
        yield "  end_freedrive_mode()"
    if options.settle_s > 0:
        yield f"  sleep({max(options.settle_s, _PHRASES.least_s):.3f})"
    yield "end"


def _speed(arm: Arm, percent: int) -> str:
    """Of the fastest joint of a move [rad/s]: that percentage of what the slowest joint can do."""
    return plain(max(arm.slowest_rad_s(USUAL_SPEED_RAD_S) * percent / 100, 1e-4), 4)


_SCRIPT = re.compile(rb"^[ \t]*(?:def[ \t]+\w{1,64}[ \t]*\(|movej[ \t]*\()", re.MULTILINE)


class UrScript(Dialect):
    """Universal Robots URScript programs, and logs of what they report."""

    name = "ur-script"
    title = "Universal Robots URScript program"
    maker = "ur"
    suffixes = (".script", ".urscript", ".log", ".txt")
    remark = (r"", "# {words}")
    names = NAMES
    limits = LIMITS
    notation = NOTATION
    writer = render_ur_script
    reader = parse_ur_script
    rules = check_ur_script

    def notation_of(self, text: str) -> Notation:
        """The usual one; a log of what was done is refused."""
        if is_log(text.encode("latin-1")):
            raise InputError("the log of a run is no program", hint="name the script", name="path")
        return self.notation

    def recognises(self, data: bytes) -> bool:
        return is_log(data) or _SCRIPT.search(data) is not None
