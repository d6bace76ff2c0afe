r"""Staubli VAL 3 projects: the writer.

A project is a folder of its name: ``NAME.dtx`` holds the positions and all other data, ``NAME.pjx``
lists the files, ``start.pgx`` and ``stop.pgx`` are run when the application is started and stopped,
and the measuring call is a program of the project of its own, because VAL 3 calls no program that
is not there. As written it shows a message and waits until the operator sets ``bGo``; put another
body there to trigger an instrument.

* Positions are ``jPose`` (``jointRx``, deg) or ``pPose`` (``pointRx``: mm, deg, the arm position,
  in the frame ``fUser``), element k - 1 for pose k: those that are measured first. Frame and tool
  are given by value (``fUser``, ``tTool``); their numbers mean nothing here.
* A touched-up position is taught into its element (HERE on the pendant); or, with ``keep =
  "register"``, stored as ``jActual[...]=herej()`` after the call, from element first_register - 1
  on. Before the first run ``jActual`` holds zeros, so that what was never stored is not taken for
  what was touched up. Save the application afterwards.
* ``sPlan``, ``sTitle`` and ``sPose`` carry mark, title and names of poses through the controller,
  which does not keep comments of a data file.
* The output is number n of the first BasicIO board (``BasicIO-1\%Qn``); link it anew where the
  cell has another one.

Facts: RoboDK's post-processors and example project (VAL 3 s7.3), ros-industrial's driver (s7.9).
Nothing was loaded on a controller. The words for arm positions do not tell turns of joints 1, 4
and 6 apart: joint positions leave nothing open.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape

import numpy as np

from calib.errors import InputError
from posedesign.programs import writing
from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.notation import MOVING_XYZ, Notation, texts_of
from posedesign.programs.program import PoseProgram
from posedesign.programs.staubli_val3.project import JOINTS, POINT
from posedesign.programs.staubli_val3.reader import attributes_of, parse_staubli_val3
from posedesign.programs.staubli_val3.rules import check_staubli_val3
from posedesign.programs.writing import Limits, NameRule, Phrases, plain_all

_WORDS = (
    "AND BEGIN BOOL CALL CASE DEFAULT DO ELSE END ENDFOR ENDIF ENDSWITCH ENDWHILE FALSE FOR IF NOT "
    "NUM OR RETURN START STEP STOP STRING SWITCH TASKCREATE THEN TO TRUE UNTIL WAIT WHILE XOR "
    "DELAY FLANGE FRAME HEREJ JOINT MDESC MOVEC MOVEJ MOVEL POINT POPUPMSG RESETMOTION TOOL "
    "WAITENDMOVE WORLD"
)

NAMES = NameRule("a VAL 3 name", 15, small=True, reserved=frozenset(_WORDS.split()))
"""Names of programs and data have at most 15 characters."""

TEXT_LENGTH = 60
"""Characters of a title or of a name of a pose: they fit into a string and a line of the editor."""

LIMITS = Limits(TEXT_LENGTH, TEXT_LENGTH, settle_s=1e4, outputs=(0, 15))
"""Outputs are those of a BasicIO board."""

NOTATION = Notation(joint=5, place=4, turned=5, turn=MOVING_XYZ, literals=attributes_of)
_DATA_NAMES = (
    "jPose pPose jActual nFirst fUser tTool mMeasure nTraj sPlan sTitle sPose bGo doMeasure"
)
_XSI = 'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
_VAL3 = "http://www.staubli.com/robotics/VAL3"
_DECLARED = '<?xml version="1.0" encoding="utf-8" ?>'

_PHRASES = Phrases(
    note="// {}",
    move=("nTraj=movej({element},tTool[0],mMeasure)", "waitEndMove()"),
    wait="delay({time:.3f})",
    pulse=("doMeasure=true", "delay({time:.3f})", "doMeasure=false"),
    call=("call {call}({argument})",),
    keep="jActual[{kept}]=herej()",
)


def render_staubli_val3(program: PoseProgram, arm: Arm) -> dict[str, str]:
    """Text of each file by its path, ``NAME/NAME.dtx`` first: to 5e-6 deg and 5e-5 mm."""
    _check_options(program)
    name, call = program.name, program.options.measure_call
    programs = {"start": _start(program), "stop": ["resetMotion()"]}
    if call is not None:
        programs[call] = _MEASURING
    files = {
        f"{name}/{name}.dtx": _data_file(program, arm),
        f"{name}/{name}.pjx": _project_file(name, list(programs)),
    }
    for called, lines in programs.items():
        argument = called == call and program.options.measure_argument is not None
        files[f"{name}/{called}.pgx"] = _program_file(called, lines, argument=argument)
    return files


_MEASURING = [
    "// put here how a pose is measured",
    "bGo=false",
    'popUpMsg("Measure, then set bGo to true")',
    "wait(bGo)",
]


def _check_options(program: PoseProgram) -> None:
    options = program.options
    LIMITS.check(program)
    for text in (options.comment, *(pose.comment for pose in program.poses)):
        if "]]>" in text:
            raise InputError(
                f"comment {text!a} would end the code of a program",
                hint="leave out ]]>",
                name="comment",
                value=text,
            )
    if options.measure_call is not None:
        NAMES.check(options.measure_call)
        if options.measure_call in _DATA_NAMES.split():
            raise InputError(
                f"{options.measure_call} is the name of data of the project",
                hint="name another program in measure_call",
                name="measure_call",
                value=options.measure_call,
            )


def _fits(text: str) -> bool:
    return LIMITS.fits(text) and "]]>" not in text


def _start(program: PoseProgram) -> list[str]:
    options = program.options
    array = "jPose" if options.form == "joint" else "pPose"
    notes = [f"// {text}" for text in (options.comment, program.mark) if text]
    notes += [f"// {line}" for line in writing.warning_lines(program, TEXT_LENGTH, "[]<>&")]
    lines = [*notes, "resetMotion()"]
    for number, pose in zip(program.numbers, program.poses, strict=True):
        name = pose.name if _fits(pose.name) else ""
        given = {"element": f"{array}[{number - 1}]", "kept": options.first_register + number - 2}
        lines += _PHRASES.at_pose(options, pose, number, name, **given)
    return lines


def _data_file(program: PoseProgram, arm: Arm) -> str:
    lines = [_DECLARED, f'<Database {_XSI} xmlns="{_VAL3}/Data/2">', "  <Datas>"]
    for name, kind, values in _data(program, arm):
        size = len(values)
        said = f'name="{name}" access="public" xsi:type="array" type="{kind}" size="{size}"'
        lines.append(f"    <Data {said}>")
        lines += [f'      <Value key="{k}" {value} />' for k, value in enumerate(values) if value]
        lines.append("    </Data>")
    return "\n".join([*lines, "  </Datas>", "</Database>", ""])


def _data(program: PoseProgram, arm: Arm) -> Iterator[tuple[str, str, Sequence[str]]]:
    """Name, type and values of each array, each as its attributes."""
    options = program.options
    listed = sorted(texts_of(program, arm, NOTATION, 0), key=lambda texts: texts.number)
    poses = [texts.pose for texts in listed]
    frames = NOTATION.pose_texts(np.stack([arm.T_world_user, arm.T_tip_tool]))
    user, tool = (_attributes(POINT, frame) for frame in frames)
    if options.form == "joint":
        yield "jPose", "jointRx", [_attributes(JOINTS, texts.joints) for texts in listed]
    else:
        points = ((_attributes(POINT, texts.placed), texts.words) for texts in listed)
        yield "pPose", "pointRx", [f'{point} {word} fatherId="fUser[0]"' for point, word in points]
    if options.keep == "register":
        measured = sum(not pose.via for pose in poses)
        empty = [_attributes(JOINTS, plain_all(np.zeros(6), 5))] * (
            options.first_register - 1 + measured
        )
        yield "jActual", "jointRx", empty
        yield "nFirst", "num", [f'value="{options.first_register}"']
    yield "fUser", "frame", [f'{user} fatherId="world[0]"']
    yield "tTool", "tool", [f'{tool} fatherId="flange[0]" ioLink="valve1"']
    speeds = f'accel="100" vel="{options.speed_percent}" decel="100" tmax="99999" rmax="99999"'
    yield "mMeasure", "mdesc", [f'{speeds} blend="off" leave="50" reach="50"']
    yield "nTraj", "num", [""]
    yield "sPlan", "string", [_text(program.mark)]
    yield "sTitle", "string", [_text(options.comment)]
    yield "sPose", "string", [_text(pose.name if _fits(pose.name) else "") for pose in poses]
    if options.measure_call is not None:
        yield "bGo", "bool", [""]
    if options.measure_output is not None:
        yield "doMeasure", "dio", [f'link="BasicIO-1\\%Q{options.measure_output}"']


def _text(text: str) -> str:
    return f'value="{escape(text)}"' if text else ""


def _attributes(names: Sequence[str], texts: list[str]) -> str:
    return " ".join(f'{name}="{text}"' for name, text in zip(names, texts, strict=True))


def _project_file(name: str, programs: list[str]) -> str:
    listed = "\n".join(f'    <Program file="{program}.pgx" />' for program in programs)
    return f"""{_DECLARED}
<Project xmlns="{_VAL3}/Project/3">
  <Parameters version="s7.3.1" stackSize="5000" millimeterUnit="true" />
  <Programs>
{listed}
  </Programs>
  <Database>
    <Data file="{name}.dtx" />
  </Database>
  <Libraries>
  </Libraries>
</Project>
"""


_PARAMETERS = f"""
    <Parameters xmlns="{_VAL3}/Param/1">
      <Parameter name="x_nNumber" type="num" use="value" xsi:type="element" dimensions="1" />
    </Parameters>"""


def _program_file(name: str, lines: list[str], *, argument: bool) -> str:
    access = "private" if name == "stop" else "public"
    code = "".join(f"\n  {line}" for line in lines)
    return f"""{_DECLARED}
<Programs {_XSI} xmlns="{_VAL3}/Program/2">
  <Program name="{name}" access="{access}">{_PARAMETERS if argument else ""}
    <Code><![CDATA[begin{code}
end]]></Code>
  </Program>
</Programs>
"""


class StaubliVal3(Dialect):
    """Staubli VAL 3 projects: a folder with data, programs and the project file."""

    name = "staubli-val3"
    title = "Staubli VAL 3 project"
    maker = "staubli"
    suffixes = (".dtx", ".pjx", ".pgx")
    remark = (r"\A(?:<\?xml[^\n]*\n)?", "<!-- {words} -->")
    companions = (".pjx", ".pgx")
    in_folder = True
    names = NAMES
    encoding = "utf-8"
    notation = NOTATION
    writer = render_staubli_val3
    reader = parse_staubli_val3
    rules = check_staubli_val3
