"""Yaskawa INFORM jobs (``.JBI``): the writer.

Joint positions are encoder pulses (``///PULSE``), which need the six pulses/deg of the arm; they
are written into comments of the job, because the format has no place for them. Poses of the tool
(``///RECTAN``) stand in the base frame or in user frame n, in a relative job (``///ATTR SC,RW,RJ``
and ``////FRAME``).

Joint positions are for controllers from NX100 on: nothing in such a job is younger, and names have
the 8 characters of NX100, which are legal on all later ones (32 from DX100 on). Poses are for DX100
and later (FS100, DX200, YRC1000): ``///RCONF`` has 24 values and angles four decimals, as in the
manual of DX100 (HW0482494, 4.1) and in what those controllers save. NX100's manual (HW0481924, 4.1)
has six values, jobs of its time eight and two decimals: poses are not written for it.

The layout is that of these manuals and of exports. Nothing was loaded on a controller.

* A base axis that carries the arm stands in positions of its own beside the arm's: ``BC00007=..``
  with ``C00007``, one value an axis, in pulses; moves have both (``MOVJ C00007 BC00007``), and the
  job is of the group ``RB1,BS1``. So in the manuals (``<BC>: <BCxxxxx>``), on the maker's page on
  INFORM headers, and in public writers of jobs that run on tracks.
* Before each move stands ``'POSE n name``: a controller numbers C variables anew when steps are
  inserted or deleted, so their numbers alone would not say which pose is which.
* The measuring job is called with its argument in I000 (``SET I000 n``): not every controller knows
  arguments of CALL. With no argument I000 is left alone.
* A touched-up position is kept where it was planned (MODIFY at its MOVJ step); or, with ``keep =
  "register"``, ``GETS PX007 $PX000`` stores the current pulses in position variable P007 after the
  call. ``$PX000`` is the current position in pulses in the maker's INFORM manuals and in jobs of
  others; controllers have P000 to P127 as delivered.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from calib.errors import InputError
from posedesign.programs import writing
from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.notation import Notation, texts_of
from posedesign.programs.program import PoseProgram, ProgramOptions, ProgramPose, in_range
from posedesign.programs.recorded import RecordedProgram
from posedesign.programs.writing import Limits, Phrases, shown_deg
from posedesign.programs.yaskawa_jbi import reader
from posedesign.programs.yaskawa_jbi.reader import AXES, EXTERNAL, MOST_COMMENT, MOST_FRAME, checked
from posedesign.programs.yaskawa_jbi.rules import check_yaskawa_jbi

MOST_LINES = 2000  # instructions of one job: where public post-processors split
MOST_INTEGER = 32767  # largest value of an I variable
LIMITS = Limits(
    text=MOST_COMMENT,
    remark=MOST_COMMENT,
    begins=("POSE ", "PLAN ", "PULSES "),
    settle_s=655.35,  # hundredths of a second in 16 bits
    pulse_s=(0.01, 655.35),
    frames=(MOST_FRAME, MOST_FRAME),
    registers=(127, "variable P{}"),
)

_PHRASES = Phrases(
    note="'{}",
    # PL=0: the step is over when the arm has arrived, not when it is near
    move=("MOVJ {at} VJ={percent:.2f} PL=0",),
    wait="TIMER T={time:.2f}",
    pulse=("PULSE OT#({output}) T={time:.2f}",),
    call=("SET I000 {argument}", "CALL JOB:{call}"),
    bare=("CALL JOB:{call}",),
    keep="GETS PX{register:03d} $PX000",
    least_s=0.01,
)


def render_yaskawa_jbi(
    program: PoseProgram,
    arm: Arm,
    pulses_per_deg: Sequence[float],
    pulses_per_mm: Sequence[float] = (),
) -> str:
    """Text of the job: joints to half a pulse, poses to 0.0005 mm and 0.00005 deg.

    ``pulses_per_deg`` (S, L, U, R, B, T, signed) are not used for poses of the tool;
    ``pulses_per_mm`` are of the base axes that carry the arm.
    """
    options = program.options
    if options.measure_call is not None:
        argument = options.argument(program.measured_count)
        in_range("measure_argument", argument or 0, -MOST_INTEGER - 1, MOST_INTEGER)
    pulses = checked(pulses_per_deg) if options.form == "joint" else ()
    carrying = EXTERNAL[: arm.n_external]
    base = checked(pulses_per_mm, "pulses_per_mm", carrying) if carrying else ()
    pulses += base
    positions = _pulses(program, arm, pulses) if pulses else _rectangular(program, arm)
    frame = f"USER {options.user_frame}" if options.user_frame else "BASE"
    relative = ["///ATTR SC,RW,RJ", f"////FRAME {frame}"]
    return "\n".join(
        [
            "/JOB",
            f"//NAME {program.name}",
            "//POS",
            f"///NPOS {len(program.poses)},{len(program.poses) * bool(base)},0,0,0,0",
            *positions,
            "//INST",
            f"///DATE {options.written:%Y/%m/%d %H:%M}",
            *([f"///COMM {options.comment}"] if options.comment else []),
            *(["///ATTR SC,RW"] if pulses else relative),
            "///GROUP1 RB1,BS1" if base else "///GROUP1 RB1",
            *_head(program, pulses),
            *chain.from_iterable(
                _at_pose(options, pose, f"C{k:05d}" + f" BC{k:05d}" * bool(base), number)
                for k, (number, pose) in enumerate(zip(program.numbers, program.poses, strict=True))
            ),
            "END",
            "",
        ]
    )


def lines_besides(program: PoseProgram) -> tuple[int, int]:
    """Instructions besides those of the poses, and most of one pose, remarks included."""
    pose = ProgramPose("", program.poses[0].posture_rad, comment="-")
    pulses = (1.0,) * (len(AXES) + (program.arm.n_external if program.arm else 0))
    return len(_head(program, pulses)) + 1, len([*_at_pose(program.options, pose, "", 1)])


def _pulses(program: PoseProgram, arm: Arm, pulses: tuple[float, ...]) -> Iterator[str]:
    counts = np.rint(shown_deg(arm, program.poses) * pulses).astype(np.int64)
    if np.abs(counts).max() >= 2**31:
        raise InputError(
            "a base axis stands at more pulses than 32 bits have",
            hint="is pulses_per_mm that of a millimetre?",
            name="pulses_per_mm",
            value=pulses[len(AXES) :],
        )
    yield from (f"///TOOL {program.options.tool_frame}", "///POSTYPE PULSE", "///PULSE")
    for kind, rows in (("C", counts[:, : len(AXES)]), ("BC", counts[:, len(AXES) :])):
        for k, row in enumerate(rows.tolist() if rows.size else ()):
            yield f"{kind}{k:05d}=" + ",".join(map(str, row))


def _rectangular(program: PoseProgram, arm: Arm) -> Iterator[str]:
    user = program.options.user_frame
    if user == 0 and not np.array_equal(arm.T_world_user, np.eye(4)):
        raise InputError(
            "poses in a user frame need its number: frame 0 is the controller's base frame",
            hint="set user_frame to the number that the frame has on the controller, 1 to 63",
            name="user_frame",
            value=user,
        )
    yield from [f"///USER {user}"] if user else []
    yield f"///TOOL {program.options.tool_frame}"
    yield from ("///POSTYPE USER" if user else "///POSTYPE BASE", "///RECTAN")
    last = ""
    for k, texts in enumerate(texts_of(program, arm, Notation(place=3, turned=4), 0)):
        if texts.words != last:
            yield f"///RCONF {texts.words}"
            last = texts.words
        yield f"C{k:05d}={','.join(texts.placed)}"


def _head(program: PoseProgram, pulses: tuple[float, ...]) -> list[str]:
    notes = [program.mark] * bool(program.mark) + reader.comments(pulses)
    notes += writing.warning_lines(program, MOST_COMMENT)
    return ["NOP", *(f"'{note}" for note in notes)]


def _at_pose(options: ProgramOptions, pose: ProgramPose, at: str, number: int) -> Iterator[str]:
    """Instructions of one pose, with its positions as a move names them."""
    name = pose.name if LIMITS.fits(f"POSE {number} {pose.name}".rstrip()) else ""
    given = {"at": at, "percent": options.speed_percent}
    return _PHRASES.at_pose(options, pose, number, name, **given)


class YaskawaJbi(Dialect):
    """Yaskawa INFORM jobs.

    Parameters
    ----------
    pulses_per_deg : sequence of float, optional
        Encoder pulses in one degree of S, L, U, R, B, T, signed. They are needed to read jobs that
        do not carry them in comments, and to write joint positions where the options of the
        program have none. InputError where they are not six numbers of a size that arms have.
    pulses_per_mm : sequence of float, optional
        The same in one millimetre of each base axis that carries the arm, signed.
    """

    name = "yaskawa-jbi"
    title = "Yaskawa INFORM job"
    maker = "yaskawa"
    suffixes = (".jbi",)
    remark = (r"^NOP[^\n]*\n", "'{words}")
    names = reader.NAMES
    limits = LIMITS
    newline = "\r\n"
    numbered_frames = True
    joint_step_deg = 1e-3  # about a pulse: arms have some hundreds to thousands in a degree
    rules = check_yaskawa_jbi

    external_axes = len(EXTERNAL)

    def __init__(
        self, pulses_per_deg: Sequence[float] = (), pulses_per_mm: Sequence[float] = ()
    ) -> None:
        self.pulses_per_deg = checked(pulses_per_deg) if len(pulses_per_deg) else ()
        axes = EXTERNAL[: max(len(pulses_per_mm), 1)]
        self.pulses_per_mm = (
            checked(pulses_per_mm, "pulses_per_mm", axes) if len(pulses_per_mm) else ()
        )

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        options = program.options
        text = render_yaskawa_jbi(
            program,
            arm,
            options.pulses_per_deg or self.pulses_per_deg,
            options.pulses_per_mm or self.pulses_per_mm,
        )
        return {f"{program.name}.JBI": text}

    def most_poses(self, program: PoseProgram) -> int | None:
        besides, each = lines_besides(program)
        return (MOST_LINES - besides) // each

    def reading(
        self, pulses_per_deg: Sequence[float], pulses_per_mm: Sequence[float] = ()
    ) -> YaskawaJbi:
        known = len(pulses_per_deg) or len(pulses_per_mm)
        return YaskawaJbi(pulses_per_deg, pulses_per_mm) if known else self

    def notation_of(self, text: str) -> Notation:
        """In the pulses of a degree that the job says, or that are known."""
        said = dict(
            filter(None, (reader.found_in(line.strip(" \t\r'")) for line in text.split("\n")))
        )
        pulses = [said[axis] for axis in AXES if axis in said] or self.pulses_per_deg
        return Notation(0, 3, 4, np.array(pulses) if len(pulses) == len(AXES) else 1.0)

    def read_data(self, data: bytes, path: Path) -> RecordedProgram:
        return reader.parse_yaskawa_jbi(data, path, self.pulses_per_deg, self.pulses_per_mm)
