"""What the tests of all dialects share: for each one an arm, and how exactly it says what.

A new controller is one entry of `HOW`; every test that is parametrised with it then asks the new
dialect for what all others do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.errors import FileFormatError
from calib.robots import Controller, ExternalAxes, Robot
from calib.se3 import transform
from posedesign.programs import (
    DIALECTS,
    Arm,
    Dialect,
    PoseProgram,
    Problem,
    ProgramOptions,
    ProgramPose,
    RecordedProgram,
)
from tests import arms
from tests.arms import PULSES

TOOL = transform([[0, 0, 1], [0, 1, 0], [-1, 0, 0]], [0.01, -0.02, 0.15])
USER = transform([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.5, 0.1, -0.05])


@dataclass(frozen=True)
class How:
    """How a dialect says what all dialects say."""

    joint_deg: float  # most that a joint value is rounded by [deg]
    pose: tuple[float, float] = (0.0, 0.0)
    """Most that a place [m] and an element of a rotation matrix are rounded by."""
    name: int = 64
    text: int = 0
    remark: int = 0
    """name, text, remark: most characters of a program's name, its title, a remark; 0: any."""
    wait_s: float = 0.0  # longest time to settle [s]; 0: any
    most_deg: float = 720.0  # farthest joint value
    told: bool = False  # the stored arm position says which posture takes a pose, turns and all
    by_number: bool = False  # positions stand in the order of their numbers, not of the visit
    passes: bool = True  # poses that are only passed through are in the file
    registers: bool = False  # touched-up positions can be kept apart from the planned ones
    asks: bool = True  # programs call another one, and pulse an output
    own_frames: bool = False  # a file of poses gives their frames by value
    title: bool = True  # the title is read back
    capitals: bool = True  # and the name of the program in capitals
    ascii: bool = True  # texts are ASCII
    line: str = ""  # pattern of a line where a position begins
    ends: bool = True  # a file that is cut off lacks its end, which the reader notices
    fit: tuple[str, ...] = ("T1",)
    unfit: tuple[str, ...] = ("é", "a\nb")
    """fit, unfit: names of poses that come back, and that are left out."""

    def fits(self, name: str) -> bool:
        """Whether the name of a pose comes back."""
        return name not in self.unfit and (name.isascii() or not self.ascii)


LIST = How(1e-10, asks=False, ascii=False, fit=("T1", "é: # {x}", "x" * 99), unfit=())

HOW = {
    "fanuc-ls": How(
        *(5.001e-4, (5.001e-7, 2.7e-5), 8, 16, 32, 327.67),
        told=True,
        by_number=True,
        registers=True,
        line=r"P\[\d+",
        fit=("T1", "sixteen letters.", "a"),
        unfit=("seventeen letters", "ends in space ", " starts", 'quote"s', "a]b", "é", "a\nb"),
    ),
    "kuka-krl": How(
        *(5.001e-6, (5.001e-8, 2.7e-7), 24, 80, 80, 3600.0),
        told=True,
        by_number=True,
        registers=True,
        line=r"DECL E6(AXIS|POS) XP\d+=",
        fit=("T1", "FOLD; a", "x" * 80),
        unfit=("Ö", "a\nb", "x" * 81),
    ),
    "abb-rapid": How(
        *(5.001e-6, (5.001e-8, 4e-9), 32, 80, 80, 3600.0),
        told=True,
        by_number=True,
        registers=True,
        own_frames=True,
        line=r"LOCAL CONST (joint|rob)target j?p\d+",
        fit=("T1", 'a "b"; !', "x" * 80),
        unfit=("Ö", "a\nb", "x" * 81),
    ),
    "ur-script": How(
        *(3e-6, (5.2e-8, 3e-7), 32, 80, 80, 1e4, 363.0),
        own_frames=True,
        line=r"movej\(",
        fit=("T 1", "x" * 80),
        unfit=('a "name"', "é", "a\nb", "x" * 81),
    ),
    "ur-urp": How(
        *(3e-6, (5.2e-8, 3e-7), 32, 80, 80, 1e4, 363.0),
        own_frames=True,
        line=r"movej\(",
        fit=("T 1", "a <b> & c", "x" * 80),
        unfit=('a "name"', "é", "a\nb", "x" * 81),
    ),
    "yaskawa-jbi": How(
        *(0.51 / 682.0, (5.001e-7, 2.7e-6), 8, 32, 32, 655.35),
        registers=True,
        line=r"C\d{5}=",
        fit=("T 1",),
        unfit=("a name that is far too long", "é", "a\nb"),
    ),
    "staubli-val3": How(
        *(5.001e-6, (5.001e-8, 2.7e-7), 15, 60, 60, 1e4),
        by_number=True,
        registers=True,
        own_frames=True,
        line=r'<Value key="\d" ',
        fit=("T 1", 'a "q" <&>', "x" * 60),
        unfit=("]]>", "é", "a\nb", "x" * 61),
    ),
    "mitsubishi-melfa": How(
        *(5.001e-6, (0.0, 0.0), 12, 100, 100, 1e4),
        by_number=True,
        title=False,
        ends=False,
        line=r"J\d+=\(",
        fit=("T -1", "x" * 100),
        unfit=("é", "a\nb", "x" * 101),
    ),
    "kawasaki-as": How(
        *(5.001e-7, (0.0, 0.0), 13, 100, 100, 1e4),
        title=False,
        capitals=False,
        ends=False,
        registers=True,
        line=r"#CALPOSE.p\[\d\] ",
        fit=("T -1", "x" * 99),
        unfit=("é", "a\nb", "x" * 101),
    ),
    "doosan-drl": How(
        *(5.001e-7, (0.0, 0.0), 32, 100, 100, 1e4),
        by_number=True,
        title=False,
        ends=False,
        line=r"movej\(",
        fit=("T -1", "x" * 99),
        unfit=("é", "a\nb", "x" * 101),
    ),
    "denso-pac": How(
        *(5.001e-7, (0.0, 0.0), 32, 100, 100, 1e4),
        by_number=True,
        title=False,
        ends=False,
        line="  Move P, @E ",
        fit=("T -1", "x" * 99),
        unfit=("é", "a\nb", "x" * 101),
    ),
    "epson-spel": How(
        *(5.001e-7, (0.0, 0.0), 32, 100, 100, 1e4),
        by_number=True,
        title=False,
        ends=False,
        line=r"  Go AglToPls\(",
        fit=("T -1", "x" * 99),
        unfit=("é", "a\nb", "x" * 101),
    ),
    "hyundai-job": How(
        *(5.001e-7, (0.0, 0.0), 32, 100, 100, 60.0),
        by_number=True,
        title=False,
        ends=False,
        line=r"     move P,tg=Pose\(",
        fit=("T -1", "x" * 99),
        unfit=("é", "a\nb", "x" * 101),
    ),
    "comau-pdl": How(
        *(5.001e-7, (0.0, 0.0), 30, 100, 100, 1e4),
        by_number=True,
        title=False,
        ends=False,
        line=r"  MOVE JOINT TO \{",
        fit=("T -1", "x" * 99),
        unfit=("é", "a\nb", "x" * 101),
    ),
    "xarm-python": How(
        *(5.001e-7, (0.0, 0.0), 32, 100, 100, 1e4),
        by_number=True,
        title=False,
        ends=False,
        line=r"check\(arm.set_servo_angle\(",
        fit=("T -1", "x" * 99),
        unfit=("é", "a\nb", "x" * 101),
    ),
    "franky-python": How(
        *(3e-6, (0.0, 0.0), 32, 100, 100, 1e4),
        by_number=True,
        title=False,
        ends=False,
        asks=False,
        line=r"robot.move\(JointMotion\(",
        fit=("T -1", "x" * 99),
        unfit=("é", "a\nb", "x" * 101),
    ),
    "ros-trajectory": replace(LIST, line=r'- \{"positions"'),
    "moveit-joints": replace(LIST, passes=False, line=r"- - -?\d"),
    "robot-calibration": replace(LIST, passes=False, line="- joints:"),
    "robodk-csv": replace(LIST, joint_deg=5.01e-7, ends=False, line=r"-?[\d.]+,"),
}

SIX = ("mitsubishi-melfa", "epson-spel", "hyundai-job", "comau-pdl", "xarm-python")
"""For any robot, but with texts for arms of six joints."""

CASES = [(name, form) for name, dialect in DIALECTS.items() for form in dialect.forms]
POSED = [name for name, form in CASES if form == "cartesian"]
CARRIED = [name for name, dialect in DIALECTS.items() if dialect.external_axes]
each_case = pytest.mark.parametrize(("name", "form"), CASES)
each_dialect = pytest.mark.parametrize("name", DIALECTS)


@cache
def robot_of(name: str) -> Robot:
    """An arm of its maker; of six joints for any robot's programs of such arms."""
    return Robot.preset("lrmate200id") if name in SIX else arms.robot_of(DIALECTS[name].maker)


def arm_of(name: str, *, frames: bool = True) -> Arm:
    """Its arm; where poses can be in them, with frames of a user and a tool."""
    return Arm.of(robot_of(name), USER, TOOL) if frames else Arm.of(robot_of(name))


def arm_on_slides(name: str, slides: int = 1) -> Arm:
    """Joint values of its maker's arms, which axes carry that slide."""
    n = slides + robot_of(name).n
    shares, maker = np.eye(n), DIALECTS[name].maker
    shares[slides:, slides:] = Arm.usual(maker, n - slides).controller.pendant_from_joints
    return Arm(Controller(maker or "", shares, np.eye(4), ExternalAxes(slides=slides)))


PULSES_PER_MM = (1310.72, -2000.0, 1000.0)


def dialect_of(name: str) -> Dialect:
    return DIALECTS[name].reading(PULSES)


def options_of(name: str, **changes: Any) -> ProgramOptions:
    """Options that everything about a program can be said with, one of the register kept apart."""
    usual: dict[str, Any] = {"fingerprint": "abcdef12", "user_frame": 2}
    usual |= {"pulses_per_deg": PULSES, "pulses_per_mm": PULSES_PER_MM[:1]}
    return ProgramOptions(**{**usual, **changes})


def program_of(name: str, poses: Any = None, call: str = "CALPOSE", **changes: Any) -> PoseProgram:
    """A program of poses, by default of one at half the range of the joints."""
    if poses is None:
        poses = [ProgramPose("T1", middle(name))]
    return PoseProgram(call, tuple(poses), options_of(name, **changes), arm_of(name))


def three_poses(name: str, call: str = "Calib", **options: Any) -> tuple[PoseProgram, str]:
    """A program that passes through the second of three poses, and its text."""
    given = {"fingerprint": "abcdef12", "measure_output": 5, "comment": "cell 7", **options}
    poses = tuple(
        ProgramPose(f"T {i}", np.radians([i, 2, 3, -4, 5.5, 6]), via=i == 0) for i in (-1, 0, 1)
    )
    program = PoseProgram(call, poses, ProgramOptions(**given), arm_of(name, frames=False))
    return program, texts_of(program, name)


def middle(name: str) -> np.ndarray:
    """The posture ``(n,)`` in the middle of all limits, the wrist away from its singularity."""
    robot = robot_of(name)
    return (robot.lower + robot.upper) / 2.0 + 0.1


def random_poses(name: str, rng: np.random.Generator, *, any_name: bool = True) -> list[Any]:
    """One to eight poses over the whole range of the joints, some of them passed through."""
    robot, how = robot_of(name), HOW[name]
    q = rng.uniform(robot.lower, robot.upper, (int(rng.integers(1, 9)), robot.n)) * 0.99
    names = [*how.fit, *how.unfit] if any_name else ["T"]
    letters = [chr(k) for k in range(32, 127) if chr(k) not in "\"';\\"]
    poses = [
        ProgramPose(
            str(rng.choice([f"T{i}", *names])),
            posture,
            "".join(rng.choice(letters, rng.choice([0, 1, how.remark or 40]))).strip(),
            via=bool(rng.random() < 0.25),
        )
        for i, posture in enumerate(q)
    ]
    if not how.passes:  # something has to be captured
        poses[0] = replace(poses[0], via=False)
    return poses


def texts_of(program: PoseProgram, name: str) -> str:
    """The text of all files together."""
    return "\n".join(DIALECTS[name].files(program).values())


EXPORTS = Path(__file__).parent / "exports"
"""Files in the manner of controllers and of people, each with the oddities of its language."""


def encoding(file: str) -> str:
    """How the text of a file stands in bytes."""
    return "utf-8" if file.endswith((".dtx", ".yaml")) else "latin-1"


def export(file: str) -> str:
    """The text of such a file."""
    return (EXPORTS / file).read_bytes().decode(encoding(file))


def shown(program: RecordedProgram) -> dict[int, list[float]]:
    """Joint values of the positions that have them, by number [deg]."""
    given = [(p.number, p.shown_deg) for p in program.positions]
    return {number: [float(v) for v in row] for number, row in given if row is not None}


def changed(text: str, old: str, new: str) -> str:
    """The text with its first ``old`` replaced, which has to be there."""
    assert old in text
    return text.replace(old, new, 1)


def refused(name: str, file: str, text: str, line: int | None, message: str) -> FileFormatError:
    """The error of a reader, with file, line and a hint."""

    def read() -> None:
        found = dialect_of(name).parse(text.encode(encoding(file)), Path(file))
        for position in found.whole().positions:  # an arm that is not known to be carried
            for error in position.carried.values():
                raise error

    with pytest.raises(FileFormatError, match=message) as caught:
        read()
    assert caught.value.row == line
    assert caught.value.hint
    assert file in str(caught.value)
    return caught.value


def breaks(problems: list[Problem], rule: str, message: str, *follow: str) -> None:
    """The rule is broken, and but for what may follow from that no other."""
    found = {problem.rule for problem in problems}
    assert rule in found, problems
    assert found - {rule} <= set(follow), problems
    assert message in " ".join(problem.message for problem in problems)
