"""Programs for UFactory arms (xArm, Lite6, 850) in Python, by the maker's library ``xarm``.

A file ``NAME.py``, run on a computer with the address of the controller: ``set_servo_angle``
to each position, which stands in it, in degrees. The call returns once the arm stands, and the
program ends where it returns an error: the library raises none. The measuring call is defined in
the program: as written it asks the operator, and prints the joint values then shown. Touched-up
positions are typed into the moves. Speeds are percents of the slowest joint's. Nothing was run on a
controller; joints are those of the description, which the maker's own are in the same signs.

Read are the joint values that ``set_servo_angle`` goes to, all of them: a list, there or in a
variable, in radians where the call or the connection says so. Moves of one joint, relative moves,
and moves of several arms in one program are unread. Poses (``set_position``) say no posture: left
out.

Rules: ``syntax``, ``indent``: Python, as its own parser has it; numbers with an underscore are odd.
``name``: variables are known, and names behind a dot are none that are nearly known. To measure,
``answer``: what moves and settings return is looked at.
``arguments``: calls have those that they take. ``position``, ``range``: five to seven numbers
within +-720 deg, outputs from 0 to 15. To measure, ``standstill``, ``wait-to-measure``: a move with
``wait=True``, and a sleep, before an output is set or a function of the program called.

Sources: xArm-Python-SDK, xarm_api.py (functions and parameters), example/wrapper/xarm6.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Iterator
from dataclasses import replace

from posedesign.programs import joint_programs as joints
from posedesign.programs import python_programs as python
from posedesign.programs import signatures
from posedesign.programs.arm import Arm
from posedesign.programs.program import PoseProgram
from posedesign.programs.straight_line import Values
from posedesign.programs.writing import NameRule, Phrases

SIGNATURES = signatures.table("""
set_servo_angle servo_id? angle? speed?:number(0,] mvacc?:number(0,] mvtime?:number relative?:flag \
is_radian?:flag wait?:flag timeout?:number radius?:number
set_cgpio_digital ionum:whole[0,15] value:whole[0,1] delay_sec?:number sync?:flag
set_tgpio_digital ionum:whole[0,4] value:whole[0,1] delay_sec?:number sync?:flag
XArmAPI port?:text is_radian?:flag do_not_open?:flag
motion_enable enable?:flag servo_id?
set_mode mode?:whole[0,8] detection_param?
set_state state?:whole[0,4]
get_servo_angle servo_id? is_radian? is_real?
sleep seconds:number[0,]
disconnect
""")
_ATTRIBUTES = """argv exit wrapper set_position get_position move_gohome clean_error clean_warn
set_pause_time set_servo_angle_j set_gripper_position connect"""
_PURE = {*SIGNATURES, *_ATTRIBUTES.split(), "check"}
_MOVE = "set_servo_angle"


def _flag(node: ast.expr | None) -> bool | None:
    """The flag that is given; None where the text does not tell."""
    return node.value if isinstance(node, ast.Constant) and type(node.value) is bool else None


def _named(tree: ast.Module, name: str) -> list[tuple[str, ast.Call]]:
    found = python.calls(n for _, nodes, _ in python.steps_of(tree) for n in nodes)
    return [(of, call) for own, of, call in found if own == name]


def _in_radians(call: ast.Call, tree: ast.Module | None) -> bool | None:
    """Whether joint values of a move are radians; None where the text does not tell."""
    own = python.argument(call, SIGNATURES[_MOVE], "is_radian")
    if own is not None and not (isinstance(own, ast.Constant) and own.value is None):
        return _flag(own)
    said = {
        _flag(given)
        for _, made in (_named(tree, "XArmAPI") if tree else ())
        if (given := python.argument(made, SIGNATURES["XArmAPI"], "is_radian")) is not None
    }
    return next(iter(said), False) if len(said) < 2 else None


def _moves(call: ast.Call, name: str, tree: ast.Module) -> Iterator[Values | str]:
    if name != _MOVE:
        return
    said, signature = f"!{ast.unparse(call)[:60]!a}", SIGNATURES[_MOVE]
    joint, target = (python.argument(call, signature, n) for n in ("servo_id", "angle"))
    relative = python.argument(call, signature, "relative")
    in_radians = _in_radians(call, tree)
    whole = joint is None or (isinstance(joint, ast.Constant) and joint.value in (None, 8))
    if relative is not None and _flag(relative) is not False:
        yield f"{said}: is relative to where the arm stands"
    elif not whole or target is None or in_radians is None:
        yield f"{said}: where all joints go cannot be told"
    elif len({of for of, _ in _named(tree, _MOVE)}) > 1:
        yield f"{said}: is one of several arms"
    elif isinstance(target, ast.Name):
        yield f"!{target.id} is in radians" if in_radians else target.id
    else:
        yield python.values_of(target, in_radians=in_radians) or f"{said}: no list of numbers"


def _stops(call: ast.Call, name: str) -> bool | None:
    if name == _MOVE:
        return _flag(python.argument(call, SIGNATURES[_MOVE], "wait")) is True
    waited = next((k.value for k in call.keywords if k.arg == "wait"), None)
    return _flag(waited) is True if name in ("set_position", "move_gohome") else None


def _values(call: ast.Call, name: str) -> Iterator[tuple[ast.AST, float]]:
    target = python.argument(call, SIGNATURES[_MOVE], "angle") if name == _MOVE else None
    joint = python.argument(call, SIGNATURES[_MOVE], "servo_id") if name == _MOVE else None
    if target is not None and joint is None:
        yield target, 4 * math.pi + 1e-9 if _in_radians(call, None) else 720.0


def _measures(call: ast.Call, name: str) -> bool:
    return name.endswith("gpio_digital") and python.number_of([*call.args, None][1]) != 0


CHECKS = python.Checks(
    signatures=SIGNATURES,
    attributes=_ATTRIBUTES,
    modules="sys time math xarm xarm.wrapper",
    stops=_stops,
    measures=_measures,
    values=_values,
    counts=(5, 6, 7),
    answers="set_servo_angle motion_enable set_mode set_state set_cgpio_digital set_tgpio_digital",
)


class XarmPython(joints.DescribedDialect):
    """Python programs of UFactory arms; joints are those of the description."""

    name = "xarm-python"
    title = "UFactory xArm program in Python"
    maker = None
    counts = (5, 6, 7)
    suffixes = (".py",)
    begins = re.compile(rb"\bXArmAPI\b|\bset_servo_angle\b")
    remark = (r"", "# {words}")
    names = NameRule("a Python name", 32, small=True, reserved=python.RESERVED)
    limits = replace(joints.LIMITS, outputs=(0, 15))
    phrases = Phrases(
        note="# {}",
        move=(
            "check(arm.set_servo_angle(angle=[{target}], speed={speed}, is_radian=False, "
            "wait=True))",
        ),
        wait="time.sleep({time:.3f})",
        pulse=(
            "check(arm.set_cgpio_digital({output}, 1))",
            "time.sleep({time:.3f})",
            "check(arm.set_cgpio_digital({output}, 0))",
        ),
        call=("{call}({argument})",),
    )
    head = (
        "arm = XArmAPI(sys.argv[1])",
        "check(arm.motion_enable(enable=True))",
        "check(arm.set_mode(0))",
        "check(arm.set_state(state=0))",
    )
    reader = joints.in_moves(
        python.events(_moves, lambda e, _: python.values_of(e, in_radians=False), _PURE),
        *(python.remarks, None, 5, 7),
    )
    rules = CHECKS.rules()

    def lines(self, program: PoseProgram, arm: Arm, steps: list[str]) -> list[str]:
        """The program; its functions stand in front of the steps."""
        check = ("def check(code):", "    if code:  # the library raises no error")
        failed = '        sys.exit(f"the controller answers with code {code}")'
        shown = "arm.get_servo_angle(is_radian=False)"
        asked = python.measured(program, f"q={{{shown}}}")
        head = [*python.imports([*steps, *asked]), "from xarm.wrapper import XArmAPI", "", *asked]
        return [*head, *check, failed, "", *steps, "arm.disconnect()"]
