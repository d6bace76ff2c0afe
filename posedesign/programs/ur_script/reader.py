"""Universal Robots URScript programs (``.script``), and logs of what they report: the readers.

Positions are the targets of ``movej``, ``movel`` and ``movep`` in their order: lists of joints and
poses ``p[...]``, there or in variables (``q1=[...]``, ``global Waypoint_1_q=[...]``), also inside
``get_inverse_kin`` and ``pose_trans``; a target that is moved to again is one position. Without any
move the lists of joints in variables are taken: all of a file that is nothing but lists, those that
PolyScope names (``Waypoint_1_q``) of a program, whose other lists are speeds and forces. Numbers
are those of comments ``# POSE n name`` above the moves, where there are any: other targets then
stand behind all.

A pose whose joints stand beside it has both: PolyScope stores ``Waypoint_1_p`` and ``Waypoint_1_q``
together, and below ``# POSE n`` the joints are those planned. Any other ``qnear`` only says which
arm position is near, and a pose with it is a pose alone. What cannot be known from the text, like
``movej(pose_add(...))``, a list that an element of was assigned to, or one that a branch, a loop, a
function or a thread gives other values, is refused, but for moves that are none of the numbered
poses.

Poses are in the base frame, or in the frames of ``pose_trans``, and of the TCP that ``set_tcp`` has
set above the move, or that ``get_inverse_kin`` names. A TCP that cannot be known from the text, or
is set in a branch, a loop or a function in another way, leaves the tool frame open. A pose that is
moved to with two TCPs is refused.

What the robot did is in the log of a run. A line holds ``POSE 3 q=[0.1, -1.57, 1.57, 0, 1.57, 0]``
[rad] behind anything (the time, the source), as ``textmsg`` of the written scripts makes it; other
lines are ignored. A line with ``PROGRAM NAME PLAN 1a2b3c4d 27`` starts a run: what stands before
the last one is of earlier runs and is left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
from lark import Token, Tree

from calib.se3 import FloatArray, rotation_exp, transform
from posedesign.programs import language, signatures
from posedesign.programs.language import Block, Language, Line, Node, Statement, subtrees, words
from posedesign.programs.numbering import Announced
from posedesign.programs.reading import (
    MOST_JOINT_DEG,
    MOST_POSITION_MM,
    no_positions,
    number,
    refuse,
)
from posedesign.programs.reading import text_of as text_of_file
from posedesign.programs.recorded import PlanMark, RecordedPosition, RecordedProgram
from posedesign.programs.signatures import Argument
from posedesign.programs.writing import NameRule

JOINTS = 6

MOST_LIMIT_DEG = 363.0  # joint limits of the arms are no wider
MOST_OUTPUT = 7  # of the standard digital ones, which begin with 0
_NAMES = """
abs acos add_frame asin assert atan atan2 attach_frame binary_list_to_integer ceil convert_pose
conveyor_pulse_decode cos d2r direct_torque eip_reader_factory eip_writer_factory
enable_external_ft_sensor encoder_enable_pulse_decode encoder_enable_set_tick_count
encoder_get_tick_count encoder_set_tick_count encoder_unwind_delta_tick_count end_force_mode
end_freedrive_mode end_screw_driving end_teach_mode floor force force_mode force_mode_set_damping
force_mode_set_gain_scaling frame_exists freedrive_mode freedrive_mode_no_incorrect_payload_check
ft_rtde_input_enable get_actual_joint_positions get_actual_joint_positions_history
get_actual_joint_speeds get_actual_tcp_pose get_actual_tcp_speed get_actual_tool_flange_pose
get_analog_in get_analog_out get_configurable_digital_in get_configurable_digital_out
get_controller_temp get_conveyor_tick_count get_coriolis_and_centrifugal_torques get_digital_in
get_digital_out get_euromap_input get_euromap_output get_flag get_forward_kin get_frame_parent
get_freedrive_status get_gravity get_inverse_kin get_inverse_kin_has_solution get_jacobian
get_jacobian_time_derivative get_joint_positions get_joint_temp get_joint_torques get_list_length
get_mass_matrix get_pose get_robot_current get_rtde_value get_standard_analog_in
get_standard_analog_out get_standard_digital_in get_standard_digital_out get_steptime
get_target_joint_accelerations get_target_joint_positions get_target_joint_positions_along_path
get_target_joint_speeds get_target_payload get_target_payload_cog get_target_payload_inertia
get_target_tcp_pose get_target_tcp_pose_along_path get_target_tcp_speed
get_target_tcp_speed_along_path get_target_waypoint get_tcp_force get_tcp_offset
get_tool_accelerometer_reading get_tool_analog_in get_tool_current get_tool_digital_in
get_tool_digital_out halt high_holding_torque_disable high_holding_torque_enable
integer_to_binary_list interpolate_pose inv is_steady is_within_safety_limits join kill length log
make_list modbus_add_rw_signal modbus_add_signal modbus_delete_signal modbus_get_error
modbus_get_signal_status modbus_get_time_since_signal_invalid modbus_reset_connection
modbus_send_custom_command modbus_set_digital_input_action modbus_set_output_register
modbus_set_output_signal modbus_set_runstate_dependent_choice modbus_set_signal_update_frequency
modbus_set_signal_watchdog motion_version_set move_frame movec movej movel movep norm normalize
optimovej optimovel path_offset_disable path_offset_enable path_offset_get path_offset_set
path_offset_set_alpha_filter path_offset_set_max_offset pause_on_error_code point_dist popup
pose_add pose_dist pose_inv pose_sub pose_trans position_deviation_warning pow powerdown
protective_stop r2d random read_input_boolean_register read_input_float_register
read_input_integer_register read_output_boolean_register read_output_float_register
read_output_integer_register read_port_bit read_port_register remove_frame
request_boolean_from_primary_client request_float_from_primary_client
request_integer_from_primary_client request_string_from_primary_client reset_revolution_counter
reset_world_model rotvec2rpy rpc_factory rpy2rotvec rtde_set_watchdog run screw_driving servoc
servoj set_analog_inputrange set_analog_out set_analog_outputdomain set_base_acceleration
set_configurable_digital_input_action set_configurable_digital_out set_conveyor_tick_count
set_digital_out set_euromap_output set_euromap_runstate_dependent_choice set_flag
set_gp_boolean_input_action set_gravity set_input_actions_to_default set_payload set_payload_cog
set_payload_mass set_pos set_runstate_configurable_digital_output_to_value
set_runstate_gp_boolean_output_to_value set_runstate_standard_analog_output_to_value
set_runstate_standard_digital_output_to_value set_runstate_standard_digital_outputs
set_runstate_tool_digital_output_to_value set_safety_mode_transition_hardness
set_standard_analog_input_domain set_standard_analog_out set_standard_digital_input_action
set_standard_digital_out set_target_payload set_tcp set_tool_analog_input_domain
set_tool_communication set_tool_digital_input_action set_tool_digital_out
set_tool_digital_output_mode set_tool_output_mode set_tool_voltage sin size sleep socket_close
socket_get_var socket_open socket_read_ascii_float socket_read_binary_integer socket_read_byte_list
socket_read_line socket_read_string socket_send_byte socket_send_int socket_send_line
socket_send_string socket_set_var speedj speedl sqrt stop_conveyor_tracking stopj stopl str_at
str_cat str_empty str_find str_len str_sub struct sync tan teach_mode textmsg time to_num to_str
tool_contact tool_contact_examples tool_wrench_limit_disable tool_wrench_limit_set torque_command
track_conveyor_circular track_conveyor_linear transpose wrench_trans write_output_boolean_register
write_output_float_register write_output_integer_register write_port_bit write_port_register
zero_ftsensor
"""

FUNCTIONS = frozenset(_NAMES.split())
"""Of the manuals for CB3, e-Series and PolyScope X, and of Universal Robots' own examples; those of
URCaps are not among them."""

MOVES = ("movej", "movel", "movep")  # that take joints or a pose
SIGNATURES = signatures.table("""
movej q/pose a?:number v?:number t?:number[0,] r?:number[0,]
movel pose/q a?:number v?:number t?:number[0,] r?:number[0,]
movep pose/q a?:number v?:number r?:number[0,]
movec pose_via pose_to a?:number v?:number r?:number[0,] mode?:whole[0,1]
get_inverse_kin x qnear? maxPositionError? maxOrientationError? tcp?
pose_trans p_from p_from_to
set_tcp pose tcp_name?
set_payload m:number[0,] cog? inertia_matrix?
sleep t:number[0,]
stopj,stopl a:number(0,] aRot?
popup s title? warning? error? blocking?
request_boolean_from_primary_client message
textmsg s1 s2?
sync
set_standard_digital_out n:number b:flag
set_configurable_digital_out n:whole[0,7] b:flag
set_tool_digital_out n:whole[0,1] b:flag
set_digital_out n:number[0,] b:flag
get_standard_digital_in,get_configurable_digital_in n:whole[0,7]
get_actual_joint_positions
freedrive_mode freeAxes? feature?
end_freedrive_mode
write_output_integer_register,write_output_float_register address:whole[0,47] value:number
write_output_boolean_register address:whole[0,127] value:flag
read_input_integer_register,read_input_float_register address:whole[0,47]
read_output_integer_register,read_output_float_register address:whole[0,47]
read_input_boolean_register,read_output_boolean_register address:whole[0,127]
""")
"""Arguments of functions, by the URScript manual of software 5.25: times [s] are not negative, and
registers those that there are."""

POSES = {
    ("get_inverse_kin", "x"),
    ("pose_trans", "p_from"),
    ("pose_trans", "p_from_to"),
    ("set_tcp", "pose"),
}
"""Parameters that are poses, never joints."""

BLOCKS = {
    "define": Block("end"),
    "thread": Block("end"),
    "secondary": Block("end"),
    "if_": Block("end", ("elif_", "else_")),
    "while_": Block("end"),
}

_WORDS = """and break continue def elif else end enter_critical exit_critical false for global halt
    if join kill local mod not or p pass pause return run sec switch thread true while xor"""
RESERVED = frozenset(word.upper() for word in (*_WORDS.split(), *FUNCTIONS))

NAMES = NameRule("a URScript name", 32, small=True, reserved=RESERVED)
"""Letters, digits and underscores; the length is that of other makers, no limit is known."""


MOST_JOINT_RAD = float(np.radians(MOST_JOINT_DEG))

_SAID = re.compile(r'"[^"\n]*"|#([ \t]*(?:POSE\s+\d|PLAN|Title:).*)|#.*')
_OPENS = re.compile(r"\s*(?:def|thread|if|while|for|sec|switch)\b.*:\s*")
_MATTERS = re.compile(r"\b(?:move[jlpc]|set_tcp)\b|[\[=]")
"""A statement that may hold a position or change a frame, where it cannot be read."""
_LONG = 100  # characters of a statement that may hold anything
_DEGREES = re.compile(r"d2r\(([-+.\deE]{1,40})\)", re.ASCII)
_TITLE = re.compile(r"\s*Title:\s*(.*)")

_REPORT = re.compile(
    r"\bPOSE\s{1,9}(\d{1,6})\s{0,9}q\s{0,9}=\s{0,9}(?:\[([^\[\]]{0,999})(\]?))?", re.ASCII
)
_START = re.compile(
    r"\bPROGRAM\s{1,9}([A-Za-z]\w{0,63})(?!\w)(?:\s{1,9}(PLAN [0-9a-f]{4,16} \d{1,7})(?!\w))?",
    re.ASCII,
)
_IS_LOG = re.compile(rb"\bPOSE\s{1,9}\d{1,6}\s{0,9}q\s{0,9}=\s{0,9}\[")
_IS_SCRIPT = re.compile(rb"^[ \t]*def[ \t]+\w", re.MULTILINE)


_OPEN_LINES = language.open_lines(
    "#", begins=r"(?:def|thread|sec|if|elif|else|while|end|global|local|return)\b"
)
_NEXT = re.compile(
    r"(?<=[)\]\d]) +(?=(?!(?:and|or|xor|not)\b)[A-Za-z_]\w* *(?:\(|=(?!=)))", re.ASCII
)
"""Between two statements on one line: ``open_gripper() w = -w turn(w)``."""


def _one_by_one(lines: Iterator[Line]) -> Iterator[Line]:
    for line in _OPEN_LINES(lines):
        start = 0
        for found in _NEXT.finditer(line.text) if line.text[0] != "$" else ():
            before = line.text[start : found.start()]
            if before.count("(") == before.count(")") and before.count('"') % 2 == 0:
                yield Line(line.row, before)
                start = found.end()
        yield Line(line.row, line.text[start:])


LANGUAGE = Language(__package__, joined=_one_by_one, signed=True)


def arguments(call: Tree[Token]) -> list[tuple[str, Node]]:
    """Keywords, empty for none, and expressions of the arguments of a call."""
    listed = [part.children for part in subtrees(call) if part.data == "argument"]
    return [(str(keyword[0]) if keyword else "", value) for *keyword, value in listed]


def by_name(name: str, given: Sequence[tuple[str, Node]]) -> dict[str, Node]:
    """Arguments of a function by the names of its parameters; a move has its target as ``q``."""
    pairs = SIGNATURES[name].named(
        [Argument(str(k), keyword) for k, (keyword, _) in enumerate(given)]
    )
    out = {parameter.name: given[int(own.shown)][1] for parameter, own in pairs}
    if name in MOVES and "pose" in out:
        out["q"] = out.pop("pose")
    return out


def shown(node: Node | None) -> str:
    """An expression as it stands, for messages."""
    return language.text_of(node) if node else ""


def elements(node: Tree[Token]) -> list[Node]:
    """What stands between the brackets and commas of a list or a pose."""
    return node.children[1:-1:2]


def _six(parts: Sequence[str], what: str, most: float, path: Path | str, row: int) -> list[float]:
    """Six numbers within ``+-most`` of the elements of a list or a pose [rad, m]."""
    if len(parts) != JOINTS:
        refuse(f"{what} has {len(parts)} values, not six", path, row, "is this another robot's?")
    values = []
    for j, part in enumerate(parts, start=1):
        degrees = _DEGREES.fullmatch(part) if part.startswith("d2r") else None
        value = number(degrees[1] if degrees else part, f"{what}: value {j}", path, row, 1e9)
        values.append(float(np.radians(value)) if degrees else value)
        if abs(values[-1]) > most:
            reason = f"{what}: value {j} is {part[:30]}, beyond +-{most:.4g}"
            refuse(reason, path, row, "joints are in radians, coordinates in metres")
    return values


def is_log(data: bytes) -> bool:
    """Whether a file is the log of a run, and no script."""
    return _IS_LOG.search(data) is not None and _IS_SCRIPT.search(data) is None


def parse_ur_script(data: bytes, path: Path | str) -> RecordedProgram:
    """Program, or log of its run, in the content of a file; see the module."""
    text = text_of_file(data, path, "name a text file", strict=True)
    if is_log(data):
        return _logged(text.split("\n"), path)
    statements = LANGUAGE.statements(text)
    reader = _Reader(path, _Changes(statements))
    if sum(1 for statement in statements if statement.fault) >= language.MOST_FAULTS:
        refuse("is no script: hardly a line of it can be read", path, statements[0].row)
    said: list[Line | Statement] = [*_remarks(text), *statements]
    for line in sorted(said, key=lambda line: line.row):
        if isinstance(line, Line):
            reader.remark(line)
        else:
            reader.take(line)
    if reader.depth > 0:
        row = text.count("\n") + 1
        refuse("is cut off: a def, if, while, ... has no end", path, row, "copy it again")
    positions = reader.positions()
    if not positions:
        no_positions(path, "name a script with movej, or the log of its run")
    name = reader.name or Path(path).stem
    return RecordedProgram(name, reader.title, reader.announced.mark, positions, "ur")


def _logged(lines: list[str], path: Path | str) -> RecordedProgram:
    """Positions that the last run in a log reported."""
    starts = [(row, m) for row, line in enumerate(lines, start=1) if (m := _START.search(line))]
    first, start = starts[-1] if starts else (0, None)
    found: dict[int, tuple[int, list[float]]] = {}
    for row, line in enumerate(lines[first:], start=first + 1):
        report = _REPORT.search(line)
        if report is None:
            continue
        n = int(report[1])
        if report[2] is None or not report[3]:
            refuse(f"POSE {n} has no whole list of joints", path, row, "save the log again")
        parts = [part.strip() for part in report[2].split(",")]
        values = _six(parts, f"POSE {n}", MOST_JOINT_RAD, path, row)
        if n < 1:
            refuse("poses are counted from 1", path, row)
        earlier, there = found.setdefault(n, (row, values))
        if there != values:
            reason = f"POSE {n} is reported twice in one run, with other joints"
            refuse(reason, path, row, f"which is right? the other is on line {earlier}")
    if not found:
        refuse("the last run in it reports no POSE", path, first or None, "save the log of a run")
    mark = PlanMark.found_in((start and start[2]) or "") or PlanMark()
    positions = [RecordedPosition(n, "", row, np.degrees(q)) for n, (row, q) in found.items()]
    name = start[1] if start else Path(path).stem
    return RecordedProgram(name, "", mark, tuple(positions), "ur")


def _remarks(text: str) -> Iterator[Line]:
    for line in language.lines_of(text) if "#" in text else ():
        for found in _SAID.finditer(line.text) if "#" in line.text else ():
            if found[1]:
                yield Line(line.row, found[1])


@dataclass(frozen=True)
class _Target:
    """A list of joints, or a pose, or both: in a variable, where that has a name.

    ``frames`` are those that the pose is in, from the base frame on; ``tcp`` is the TCP that is
    brought there, where the script says which.
    """

    row: int
    variable: str
    joints: Tree[Token] | None = None
    pose: Tree[Token] | None = None
    frames: tuple[Tree[Token], ...] = ()
    tcp: Tree[Token] | None = None

    @property
    def name(self) -> str:
        """The variable's name without PolyScope's _q and _p."""
        return re.sub(r"(?<=.)_[qp]\Z", "", self.variable)

    @property
    def key(self) -> tuple[str, int]:
        """Tells it from all others."""
        return self.variable, self.row


_FUNCTIONS = ("define", "thread", "secondary")
_MOTIONS = (*MOVES, "movec", "set_tcp")


def _motions(tree: Tree[Token]) -> list[Tree[Token]]:
    return [call for call in language.nodes(tree, "call") if call.children[0] in _MOTIONS]


_CALLED = re.compile(r"\b[A-Za-z_]\w*(?= ?\()", re.ASCII)
_DEEPEST = 20  # functions in functions


def _opens(s: Statement) -> bool:
    return s.kind in BLOCKS or bool(s.fault and _OPENS.fullmatch(s.text))


def _place(s: Statement) -> str:
    place = s.tree.children[0]
    return str(place) if isinstance(place, Token) else words(place, "NAME", "POSE")[0].rstrip(" [")


def _various(statements: Sequence[Statement]) -> set[str]:
    """Variables that are given different values, or values of a part."""
    given: dict[str, set[str]] = {}
    for s in statements:
        if s.kind == "assign":
            texts = given.setdefault(_place(s), set())
            texts.add(s.text.split("=", 1)[1].strip())
            texts |= set() if isinstance(s.tree.children[0], Token) else {""}
    return {name for name, texts in given.items() if len(texts) > 1}


class _Changes:
    """Variables that are given different values, and where.

    ``inside``: by the line that a block or a function begins on, also those of functions that are
    called there; ``functions``: lines of functions by name.
    """

    def __init__(self, statements: Sequence[Statement]) -> None:
        self.inside: dict[int, set[str]] = {}
        self.functions: dict[str, int] = {}
        self.various = _various(statements)
        called: set[tuple[int, str]] = set()
        opened: list[list[int]] = [[]]  # blocks up to the function that they are in
        for s in statements:
            if _opens(s):
                self.inside[s.row] = set()
                if s.kind in _FUNCTIONS:
                    self.functions[s.word("NAME")] = s.row
                opened.append([s.row, *(() if s.kind in _FUNCTIONS else opened[-1])])
            elif s.kind == "end":
                del opened[max(len(opened) - 1, 1) :]
            elif s.kind == "assign":
                for row in opened[-1]:
                    self.inside[row].add(_place(s))
            if self.various:
                called |= {(row, name) for name in _CALLED.findall(s.text) for row in opened[-1]}
        for names in self.inside.values():
            names &= self.various
        own = {(row, self.functions[name]) for row, name in called if name in self.functions}
        for _ in range(_DEEPEST if self.various else 0):
            for row, function in own:
                self.inside[row] |= self.inside[function]

    def of(self, s: Statement, *kinds: str) -> set[str]:
        """What functions change that a statement calls."""
        if not self.various:
            return set()
        rows = [self.functions.get(name) for t in s.all(*kinds) for name in words(t, "FUNCTION")]
        return {name for row in rows if row for name in self.inside[row]}


class _Reader:
    """Goes through the statements."""

    def __init__(self, path: Path | str, changes: _Changes) -> None:
        self.path = path
        self._changes = changes
        self._blocks: list[tuple[int, dict[str, _Target] | None]] = []
        self._by_threads: set[str] = set()
        self.name = self.title = ""
        self.announced = Announced(path)
        self.depth = 0
        self._is_program = False
        self._lists: dict[str, _Target] = {}
        self._changed: tuple[str, int] | None = None
        self._tcp: Tree[Token] | None = None
        self._found: dict[tuple[str, int], _Target] = {}
        self._unknown: tuple[str, int] | None = None

    def remark(self, remark: Line) -> None:
        title = _TITLE.fullmatch(remark.text)
        if title:
            self.title = self.title or title[1].strip()
        else:
            self.announced.take(remark.text, remark.row)

    def take(self, statement: Statement) -> None:
        row, text = statement.row, statement.text
        if statement.fault and (len(text) >= _LONG or _MATTERS.search(text)):
            refuse(statement.fault, self.path, row)
        self._by_threads |= self._changes.of(statement, "run")
        self._forget(self._changes.of(statement, "call", "run"))
        if _opens(statement):
            self.depth += 1
            self._is_program = True
            self._open(statement)
        elif statement.kind == "end":
            self.depth -= 1
            row_of_block, before = self._blocks.pop() if self._blocks else (0, None)
            if before is None:
                self._forget(self._changes.inside.get(row_of_block, set()))
            else:
                kept = self._lists.items()
                self._lists = before | {k: v for k, v in kept if k not in self._changes.various}
        elif statement.kind in ("elif_", "else_") and self._blocks:
            self._forget(self._changes.inside[self._blocks[-1][0]])
        elif statement.kind == "assign":
            self._assign(statement)
        if statement.kind == "define" and not self.name:
            self.name = statement.word("NAME")
        for call in statement.nodes(_motions):
            if call.children[0] == "set_tcp":
                self._set_tcp(call, row)
            else:
                self._move(call, row)

    def _open(self, statement: Statement) -> None:
        """A function knows nothing but what never changes, and not even that of its parameters."""
        if statement.kind in _FUNCTIONS:
            self._blocks.append((statement.row, self._lists))
            own = {str(p.children[0]) for p in subtrees(statement.tree)} | self._changes.various
            self._lists = {k: v for k, v in self._lists.items() if k not in own}
        else:
            self._blocks.append((statement.row, None))
            if statement.kind == "while_":
                self._forget(self._changes.inside[statement.row])

    def _forget(self, names: set[str]) -> None:
        for name in names:
            self._lists.pop(name, None)

    def _assign(self, statement: Statement) -> None:
        """Keep a list; one that an element of is assigned to is not known any more."""
        place, value = statement.tree.children
        if isinstance(place, Token):
            kept = self._target(value, statement.row)
            if (
                isinstance(value, Tree)
                and value.data in ("list", "pose")
                and kept is not None
                and (place not in self._by_threads)
            ):
                self._lists[place] = replace(kept, variable=str(place))
            else:
                self._lists.pop(place, None)
            return
        if self._lists.pop(name := _place(statement), None):
            self._changed = self._changed or (name, statement.row)

    def _target(self, node: Node | None, row: int, *, planned: bool = False) -> _Target | None:
        """What an expression is; None where its text does not tell.

        ``planned``: joints beside a pose in the move itself are those of the pose.
        """
        if not isinstance(node, Tree):
            return self._lists.get(str(node))
        if node.data == "list":
            return _Target(row, "", joints=node)
        if node.data == "pose":
            return _Target(row, "", pose=node)
        if node.data != "call" or node.children[0] not in ("pose_trans", "get_inverse_kin"):
            return None
        given = by_name(str(node.children[0]), arguments(node))
        if node.children[0] == "get_inverse_kin":
            return self._inverse(given, row, planned=planned)
        frame = self._target(given.get("p_from"), row)
        inner = self._target(given.get("p_from_to"), row)
        if inner is None or inner.pose is None or frame is None or frame.pose is None:
            return None
        return replace(inner, frames=(*frame.frames, frame.pose, *inner.frames))

    def _inverse(self, given: dict[str, Node], row: int, *, planned: bool) -> _Target | None:
        pose = self._target(given.get("x"), row)
        if pose is None or pose.pose is None:
            return None
        if shown(given.get("tcp")) not in ("", "active_tcp", '""', '"active_tcp"'):
            named = self._target(given["tcp"], row)
            if named is None or named.pose is None or named.frames:
                return None
            pose = replace(pose, tcp=named.pose)
        near = self._target(given.get("qnear"), row)
        if near is None or near.joints is None:
            return pose
        in_pair = (pose.variable, near.variable) == (f"{pose.name}_p", f"{pose.name}_q")
        in_move = planned and not pose.variable and not near.variable
        return replace(pose, joints=near.joints) if in_pair or in_move else pose

    def _set_tcp(self, call: Tree[Token], row: int) -> None:
        target = self._target(by_name("set_tcp", arguments(call)).get("pose"), row)
        tcp = target.pose if target is not None and not target.frames else None
        # inside a branch, a loop or a function nobody knows when it is set
        self._tcp = tcp if self.depth <= 1 or tcp == self._tcp else None

    def _move(self, call: Tree[Token], row: int) -> None:
        kind = str(call.children[0])
        place = by_name(kind, arguments(call)).get("q") if kind in MOVES else None
        target = self._target(place, row, planned=self.announced.waiting is not None)
        if target is None:
            self.announced.end()
            self._unknown = self._unknown or (shown(place or call), row)
            return
        if target.pose is not None and target.tcp is None:
            target = replace(target, tcp=self._tcp)
        if self._found.setdefault(target.key, target).tcp != target.tcp:
            reason = f"moves to {target.variable[:30]} with another TCP than before"
            refuse(reason, self.path, row, "give it one TCP, or move to joints")
        self.announced.move(target.key, target.variable or "the target")

    def positions(self) -> tuple[RecordedPosition, ...]:
        self.announced.end()
        if self._unknown is not None and not self.announced.found:
            text, row = self._unknown
            reason = f"the target {text[:40]!a} cannot be known from the text"
            refuse(reason, self.path, row, "move to a list of joints, or read the log of a run")
        found = self._found or self._listed()
        numbers = self.announced.numbered([(key, t.name) for key, t in found.items()], {})
        targets = [(f"position {n}", t) for (n, _), t in zip(numbers, found.values(), strict=True)]
        posed = [(t.pose, label, t.row) for label, t in targets if t.pose is not None]
        rows = {t.tcp: t.row for _, t in reversed(targets) if t.pose is not None and t.tcp}
        tools = {tcp: self._transforms([(tcp, "the TCP", row)])[0] for tcp, row in rows.items()}
        poses = iter(self._transforms(posed))
        out = []
        for (n, name), (label, t) in zip(numbers, targets, strict=True):
            joints = self._values(t.joints, label, MOST_JOINT_RAD, t.row) if t.joints else None
            placed: dict[str, Any] = {}
            if t.pose is not None:
                frames = self._transforms([(f, "the frame", t.row) for f in t.frames])
                placed = {"T_user_tool": next(poses)}
                placed["T_world_user"] = reduce(np.matmul, frames, np.eye(4))
                placed["T_tip_tool"] = tools[t.tcp] if t.tcp else None
            shown = None if joints is None else np.degrees(joints)
            out.append(RecordedPosition(n, name, t.row, shown, **placed))
        return tuple(out)

    def _listed(self) -> dict[tuple[str, int], _Target]:
        """Lists of joints of a file without moves, each with the pose that PolyScope stores."""
        if self._changed is not None:
            name, row = self._changed
            reason = f"an element of {name[:30]} is changed: what it is then is not known"
            refuse(reason, self.path, row, "give whole lists")
        out = {}
        for name, target in self._lists.items():
            named = name.endswith("_q")
            if target.joints is None or (self._is_program and not named):
                continue
            if len(elements(target.joints)) == JOINTS:
                beside = self._lists.get(f"{target.name}_p") if named else None
                out[target.key] = replace(target, pose=beside.pose if beside else None)
        return out

    def _values(self, tree: Tree[Token], what: str, most: float, row: int) -> list[float]:
        return _six([shown(node) for node in elements(tree)], what, most, self.path, row)

    def _transforms(self, poses: Sequence[tuple[Tree[Token], str, int]]) -> FloatArray:
        """Poses ``(N, 4, 4)`` [m], with what they are and their lines."""
        most = MOST_POSITION_MM / 1e3
        values = [self._values(pose, what, most, row) for pose, what, row in poses]
        rows = np.reshape(values, (-1, 6))
        return transform(rotation_exp(rows[:, 3:]), rows[:, :3])
