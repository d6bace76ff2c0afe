"""Programs for Franka arms in Python, by the public library ``franky``.

A file ``NAME.py``, run on the computer with the real-time connection, with the address of the arm:
``robot.move(JointMotion([...]))`` to each position, which stands in it, in radians. The call
returns once the arm stands, and raises an error where it does not get there. The measuring call is
defined in the program: as written it asks the operator, and prints the joint values then shown; no
output is switched. Touched-up positions are typed into the moves. The speed is the share of the
arm's limits of velocity, acceleration and jerk. Nothing was run on an arm.

Read are the joint values that ``move`` goes to: ``JointMotion`` of a list, there or in a variable,
and each ``JointWaypoint`` of a ``JointWaypointMotion`` there. Relative motions and computed lists
are unread. Cartesian motions say no posture: left out.

Rules: those of :mod:`..xarm_python` but for its calls: seven numbers within +-720 deg;
``relative_dynamics_factor`` is above 0 up to 1. To measure, ``standstill``: the last move is not
asynchronous; ``wait-to-measure``: a sleep, before a function of the program is called.

Sources: TimSchneider42/franky, doc/guide (move, relative dynamics factors, joint motions, state of
the robot) and python/bind_motion_joint_pos.cpp (parameters).
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import numpy as np

from posedesign.programs import joint_programs as joints
from posedesign.programs import python_programs as python
from posedesign.programs import signatures
from posedesign.programs.arm import Arm
from posedesign.programs.notation import Notation
from posedesign.programs.program import PoseProgram
from posedesign.programs.straight_line import Values
from posedesign.programs.writing import NameRule, Phrases

JOINTS = 7
SIGNATURES = signatures.table("""
JointMotion target reference_type? relative_dynamics_factor?:number(0,1] return_when_finished?:flag
JointWaypoint target reference_type? relative_dynamics_factor? minimum_time? hold_target_duration? \
max_total_duration?
move motion:pose relative_dynamics_factor?:number(0,1] asynchronous?:flag
Robot fci_hostname:text
sleep seconds:number[0,]
recover_from_errors
""")
_ATTRIBUTES = """argv exit relative_dynamics_factor current_joint_state position JointWaypointMotion
CartesianMotion ReferenceType Absolute Relative join_motion"""
_PURE = {*SIGNATURES, *_ATTRIBUTES.split()}


def _target(node: ast.AST | None, kind: str) -> ast.expr | None:
    """The list that a motion of this kind goes to; None: it is another, relative, or not told."""
    if not isinstance(node, ast.Call) or ast.unparse(node.func).rpartition(".")[2] != kind:
        return None
    reference = python.argument(node, SIGNATURES[kind], "reference_type")
    if reference is not None and not ast.unparse(reference).endswith("ReferenceType.Absolute"):
        return None
    target = python.argument(node, SIGNATURES[kind], "target")
    if isinstance(target, ast.Call) and len(target.args) == 1 and not target.keywords:
        stated = ast.unparse(target.func).rpartition(".")[2] == "JointState"
        return target.args[0] if stated else target
    return target


def _given(node: ast.expr, tree: ast.Module) -> Values | None:
    target = _target(node, "JointMotion")
    return None if target is None else python.values_of(target, in_radians=True)


def _moves(call: ast.Call, name: str, tree: ast.Module) -> Iterator[Values | str]:
    if name != "move" or not isinstance(call.func, ast.Attribute):
        return
    motion = python.argument(call, SIGNATURES["move"], "motion")
    said = f"!{ast.unparse(call)[:60]!a}: no list of numbers"
    kind = ast.unparse(motion.func).rpartition(".")[2] if isinstance(motion, ast.Call) else ""
    if isinstance(motion, ast.Name):
        yield motion.id
    elif kind == "JointMotion":
        yield (_given(motion, tree) if motion else None) or said
    elif kind == "JointWaypointMotion" and isinstance(motion, ast.Call):
        listed = motion.args[0] if motion.args else None
        for point in listed.elts if isinstance(listed, ast.List) else [None]:
            target = _target(point, "JointWaypoint")
            values = None if target is None else python.values_of(target, in_radians=True)
            yield values or said
    elif kind.startswith("Joint") or motion is None:
        yield said


def _values(call: ast.Call, name: str) -> Iterator[tuple[ast.AST, float]]:
    for kind in ("JointMotion", "JointWaypoint"):
        target = _target(call, kind) if name == kind else None
        if target is not None and not isinstance(target, ast.Call):
            yield target, 4 * np.pi + 1e-9


def _stops(call: ast.Call, name: str) -> bool | None:
    if name != "move":
        return None
    later = python.argument(call, SIGNATURES["move"], "asynchronous")
    return later is None or (isinstance(later, ast.Constant) and later.value is False)


CHECKS = python.Checks(
    signatures=SIGNATURES,
    attributes=_ATTRIBUTES,
    modules="sys time math numpy franky",
    stops=_stops,
    measures=lambda call, name: False,
    values=_values,
    counts=(JOINTS,),
    factors="relative_dynamics_factor",
)


class FrankyPython(joints.JointDialect):
    """Python programs of Franka arms."""

    name = "franky-python"
    title = "Franka program in Python with franky"
    maker = "franka"
    switches = False
    suffixes = (".py",)
    begins = re.compile(rb"\bfranky\b")
    remark = (r"", "# {words}")
    names = NameRule("a Python name", 32, small=True, reserved=python.RESERVED)
    notation = Notation(7, joint_units=np.pi / 180)
    phrases = Phrases(
        note="# {}",
        move=("robot.move(JointMotion([{target}]))",),
        wait="time.sleep({time:.3f})",
        pulse=(),
        call=("{call}({argument})",),
    )
    head = ("robot = Robot(sys.argv[1])", "robot.relative_dynamics_factor = {share}")
    reader = joints.in_moves(
        python.events(_moves, _given, _PURE), python.remarks, "franka", JOINTS, JOINTS
    )
    rules = CHECKS.rules()

    def lines(self, program: PoseProgram, arm: Arm, steps: list[str]) -> list[str]:
        """The program; its function stands in front of the steps."""
        asked = python.measured(program, "q={list(robot.current_joint_state.position)}")
        head = [*python.imports([*steps, *asked]), "from franky import JointMotion, Robot", ""]
        return [*head, *asked, *steps]
