"""What the writers of all dialects share: numbers as controllers take them, and legal names."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import repeat

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.se3 import FloatArray
from posedesign.programs.arm import Arm
from posedesign.programs.program import PoseProgram, ProgramOptions, ProgramPose, in_range
from posedesign.programs.reading import MOST_JOINT_DEG, MOST_POSITION_MM
from posedesign.programs.recorded import PlanMark

LONGEST_WARNING = 300
"""Characters of one warning in the head of a program: ten lines of a FANUC remark."""


LIST_LENGTH = 90  # characters of a line of what the head of a list of joint values warns of


_PRINTABLE = re.compile(r"[ -~]*")


def plain(value: float, decimals: int) -> str:
    """A number with so many decimals: no exponent, and no sign before a zero."""
    return plain_all(value, decimals)[0]


def plain_all(values: ArrayLike, decimals: int) -> list[str]:
    """Numbers with so many decimals each."""
    form = f"%.{decimals}f"
    texts = [form % value for value in np.ravel(np.asarray(values, dtype=float)).tolist()]
    return [t[1:] if t.startswith("-0") and float(t) == 0 else t for t in texts]


def rounded_deg(angles: ArrayLike, decimals: int) -> FloatArray:
    """Angles [rad] in degrees with so many decimals, in (-180, 180]: half a turn has one name."""
    turned = np.round(np.rad2deg(angles), decimals) + 0.0
    return np.where(turned <= -180.0, 180.0, turned)


@dataclass(frozen=True)
class NameRule:
    """What a controller takes for a name."""

    what: str  # for messages: "a FANUC program name"
    length: int  # most characters
    small: bool = False  # whether small letters are legal
    stand_in: str = "CALPOSE"  # a legal name, where nothing of the one given can be kept
    reserved: frozenset[str] = frozenset()  # words of the language, in capitals, that are no names

    def is_legal(self, name: str) -> bool:
        """Whether a name is a letter and then letters, digits and underscores, not too long."""
        letters = "A-Za-z" if self.small else "A-Z"
        pattern = rf"[{letters}][{letters}0-9_]{{0,{self.length - 1}}}"
        return bool(re.fullmatch(pattern, name)) and name.upper() not in self.reserved

    def check(self, name: str) -> None:
        """Raise InputError, with a name that would do, where a name is not legal."""
        if not self.is_legal(name):
            letters = "letters, digits and _" if self.small else "A-Z 0-9 _"
            raise InputError(
                f"{name!r} is not {self.what}",
                hint=f"for instance {self.legal(name)}: a letter first, then {letters}, "
                f"at most {self.length} characters",
                name=name,
                bound=self.length,
            )

    def legal(self, name: str) -> str:
        """The nearest legal name: other characters as underscores, cut to length."""
        given = name if self.small else name.upper()
        letters = "A-Za-z0-9" if self.small else "A-Z0-9"
        kept = re.sub(rf"[^{letters}]+", "_", given).strip("_")
        if not kept:
            return self.stand_in
        cut = (kept if kept[0].isalpha() else "P" + kept)[: self.length].rstrip("_")
        return self.stand_in if cut.upper() in self.reserved else cut

    def part(self, name: str, k: int) -> str:
        """The name of the k-th part of a program that is split, counted from 1.

        Where it is too long its middle is left out: programs are told apart by their last digits.
        """
        ending = f"_{k}"
        room = self.length - len(ending)
        if len(name) > room:
            kept = min(3, room - 1)
            name = name[: room - kept] + name[len(name) - kept :]
        return name + ending


def check_text(what: str, text: str, length: int, forbidden: str = "") -> None:
    """Raise InputError where a text has other characters than printable ASCII, or too many.

    ``what``: for messages: "comment", "comment of pose 'P01'". ``text``: an empty one is legal.
    ``length``: most characters. ``forbidden``: characters that the language gives a meaning.
    """
    if len(text) <= length and _PRINTABLE.fullmatch(text) and not set(text) & set(forbidden):
        return
    without = f", without {' '.join(forbidden)}" if forbidden else ""
    raise InputError(
        f"{what} {text!a} cannot stand in a comment",
        hint=f"use at most {length} ASCII characters{without}",
        name=what,
        value=text,
        bound=length,
    )


def comment_text(what: str, text: str) -> str:
    """A text in any letters that can stand in a comment of a list, and comes back as it is.

    Raises InputError: it has line ends or other characters that cannot be seen, or spaces around
    it.
    """
    if not text.isprintable() or text != text.strip():
        raise InputError(
            f"{what} {text!a} cannot stand in a comment",
            hint="use one line of printable characters, without spaces around it",
            name=what,
            value=text,
        )
    return text


@dataclass(frozen=True)
class Limits:
    """What a controller takes of the options of a program."""

    text: int
    remark: int  # text, remark: most characters of the title, and of a comment of a pose
    forbidden: str = ""  # characters that neither can have
    begins: tuple[str, ...] = ()
    """What no comment of a pose begins with: it means something when the program is read."""
    settle_s: float = 3600.0
    pulse_s: tuple[float, float] = (0.0, 1e4)
    """settle_s, pulse_s: longest wait, and shortest and longest pulse of an output [s]."""
    frames: tuple[int, int] | None = None
    """Largest number of a user and a tool frame; None: numbers mean nothing."""
    outputs: tuple[int, int] = (1, 4096)  # first and last number of an output
    registers: tuple[int, str] | None = None
    """Last register for a position that controllers have as delivered, and how it is said."""

    def check(self, program: PoseProgram) -> None:
        """Raise InputError where an option of a program is outside of them."""
        options = program.options
        if self.frames:
            in_range("user_frame", options.user_frame, 0, self.frames[0])
            in_range("tool_frame", options.tool_frame, 0, self.frames[1])
        in_range("settle_s", options.settle_s, 0, self.settle_s)
        if options.measure_output is not None:
            in_range("measure_output", options.measure_output, *self.outputs)
            in_range("measure_pulse_s", options.measure_pulse_s, *self.pulse_s)
        check_text("comment", options.comment, self.text, self.forbidden)
        if PlanMark.found_in(options.comment):
            raise InputError(
                f"comment {options.comment!a} would be read as the mark of another plan",
                hint="begin it with another word",
                name="comment",
                value=options.comment,
            )
        for pose in program.poses:
            what = f"comment of pose {pose.name!r}"
            check_text(what, pose.comment, self.remark, self.forbidden)
            if self.begins and pose.comment.lstrip().startswith(self.begins):
                raise InputError(
                    f"{what} {pose.comment!a} would be read as what the program says of its poses",
                    hint="begin it with another word",
                    name=pose.name,
                    value=pose.comment,
                )
        last = options.first_register + program.measured_count - 1
        if self.registers and options.keep == "register" and last > self.registers[0]:
            most, said = self.registers
            raise InputError(
                f"the touched-up positions would need {said.format(last)}, the last that "
                f"controllers have as delivered is {said.format(most)}",
                hint="keep them in the positions of the program",
                name="first_register",
                value=last,
                bound=most,
            )

    def name_of(self, pose: ProgramPose) -> str:
        """Name of a pose where it can stand in a comment; else empty."""
        return pose.name if self.fits(pose.name) else ""

    def fits(self, name: str, length: int | None = None) -> bool:
        """Whether a name of a pose can stand in a comment."""
        legal = _PRINTABLE.fullmatch(name) and not set(name) & set(self.forbidden)
        return bool(legal) and len(name) <= (length or self.remark)


@dataclass(frozen=True, kw_only=True)
class Phrases:
    """How a language says what is done at a pose: formats that are filled in."""

    note: str
    remark: str | None = None
    """note, remark: of what the program says of the pose, and of the pose's own comment; None: the
    same."""
    move: tuple[str, ...]  # steps of ``number``, and of what a writer gives besides
    wait: str
    pulse: tuple[str, ...]  # wait, pulse: steps of ``time`` [s] and ``ms``; of ``output`` as well
    call: tuple[str, ...]
    bare: tuple[str, ...] | None = None
    """call, bare: steps of ``call``, ``argument``; and those of a call without an argument, where
    that does not only leave a gap."""
    keep: str = ""  # A step of ``register``. Empty where a language keeps none.
    least_s: float = 0.001  # shortest time: none that is asked for must round to nothing [s]
    after: tuple[str, ...] = ()  # steps of ``number`` behind all that is done at a pose
    named: str = "POSE "  # what the note of a pose begins with, in front of its number and name
    unnamed: bool = True  # poses without a name have such a note, too
    always: bool = False  # waits where no time to settle is asked for, too
    still: str = ""  # A step where no time is asked for, and the arm has to stand. Empty for none.

    def visit(
        self, program: PoseProgram, limits: Limits, targets: Iterable[str] = (), /, **given: object
    ) -> Iterator[str]:
        """Steps at all poses; where each move has a ``target`` of its own, with that."""
        stops = zip(program.numbers, program.poses, targets or repeat(""), strict=False)
        for number, pose, target in stops:
            own, name = {"target": target, **given}, limits.name_of(pose)
            yield from self.at_pose(program.options, pose, number, name, **own)

    def at_pose(
        self, options: ProgramOptions, pose: ProgramPose, number: int, name: str, /, **given: object
    ) -> Iterator[str]:
        """Steps at a pose; its name is given as it fits, empty for none."""
        yield from self.note_of(number, name)
        yield from self.steps(options, pose, number, **given)

    def note_of(self, number: int, name: str) -> list[str]:
        """What the program says of a pose in front of its steps."""
        said = f"{self.named}{number} {name}".rstrip()
        return [self.note.format(said)] if name or self.unnamed else []

    def steps(
        self, options: ProgramOptions, pose: ProgramPose, number: int, /, **given: object
    ) -> Iterator[str]:
        """The same without its name."""
        if pose.comment.strip():
            yield (self.remark or self.note).format(pose.comment.strip())
        yield from (line.format(number=number, **given) for line in self.move)
        if pose.via:
            return
        if options.settle_s > 0 or self.always:
            yield self.wait.format(**self._times(options.settle_s))
        elif self.still:
            yield self.still
        if options.measure_output is not None:
            pulse = {"output": options.measure_output, **self._times(options.measure_pulse_s)}
            yield from (line.format(**pulse) for line in self.pulse)
        if options.measure_call is not None:
            argument = options.argument(number)
            call = {"call": options.measure_call, "argument": "" if argument is None else argument}
            steps = self.bare if argument is None and self.bare is not None else self.call
            yield from (line.format(**call) for line in steps)
        if options.keep == "register" and self.keep:
            yield self.keep.format(register=options.first_register + number - 1, **given)
        yield from (line.format(number=number) for line in self.after)

    def _times(self, seconds: float) -> dict[str, float]:
        time = max(seconds, self.least_s)
        return {"time": time, "ms": 1e3 * time}


def warning_lines(program: PoseProgram, length: int, forbidden: str = "") -> list[str]:
    """What the head of a program warns of, as comments of at most so many ASCII characters.

    Each begins with a star, which no comment does that readers take something from. Characters
    that a comment cannot hold are left out: a warning never keeps a program from being written.
    """
    lines = []
    for text in program.warnings:
        plain_text = text.encode("ascii", "replace").decode()
        kept = "".join(c if c.isprintable() and c not in forbidden else " " for c in plain_text)
        lines += textwrap.wrap(textwrap.shorten(kept, LONGEST_WARNING), length - 2)
    return [f"* {line}" for line in lines]


def head_lines(program: PoseProgram, length: int, forbidden: str = "") -> list[str]:
    """What the head of a program says: the mark of its plan, and warnings."""
    return [program.mark] * bool(program.mark) + warning_lines(program, length, forbidden)


def title_lines(program: PoseProgram, length: int, forbidden: str = "") -> list[str]:
    """The same behind its title."""
    title = program.options.comment
    return [title] * bool(title) + head_lines(program, length, forbidden)


def check_call(
    names: NameRule,
    options: ProgramOptions,
    program_name: str,
    position: re.Pattern[str] | None = None,
) -> None:
    """Raise InputError where the measuring program has no legal name, or that of the program.

    Letters of either case are the same: most languages make no difference, and a person none.
    Where positions are variables of their own, neither may have a name of theirs (``position``).
    """
    call = options.measure_call
    for what, name in (("name", program_name), ("measure_call", call)):
        if position is not None and name is not None and position.fullmatch(name):
            raise InputError(
                f"{what} {name!r} is the name of a position",
                hint="choose another one",
                name=what,
                value=name,
            )
    if call is None:
        return
    names.check(call)
    if call.upper() == program_name.upper():
        raise InputError(
            f"program {program_name} would call itself",
            hint="name the program that measures in measure_call",
            name="measure_call",
            value=call,
        )


def shown_deg(arm: Arm, poses: Iterable[ProgramPose]) -> FloatArray:
    """Joint values ``(N, n)`` [deg] of poses as the controller shows them, each within +-720.

    Those of external axes [mm, deg] stand behind them.

    Raises InputError: a joint value is beyond, with its pose and joint, or the arm has other
    joints.
    """
    listed = list(poses)
    postures = np.stack([pose.posture_rad for pose in listed])
    # The description's values first: far larger ones would overflow when they become degrees.
    sliding = arm.controller.external.slides_of(postures.shape[1])
    most = np.where(sliding, MOST_POSITION_MM, MOST_JOINT_DEG)
    too_far = np.abs(postures) > np.where(sliding, most / 1e3, np.radians(most))
    if not too_far.any():
        shown = arm.shown(postures)
        too_far = np.abs(shown)[:, np.argsort(arm.order)] > most
        if not too_far.any():
            return shown
    i, j = (int(k) for k in np.argwhere(too_far)[0])
    label = arm.controller.external.labels(postures.shape[1])[j]
    if sliding[j]:
        raise InputError(
            f"pose {listed[i].name!r}: {label} is beyond +-{MOST_POSITION_MM:g} mm",
            hint="postures have slides in metres, and no rail is as long",
            name=listed[i].name,
        )
    raise InputError(
        f"pose {listed[i].name!r}: {label} is beyond +-{MOST_JOINT_DEG:g} deg",
        hint="postures are in radians, and no arm turns so far",
        name=listed[i].name,
        value=float(postures[i, j]),
        bound=float(np.radians(MOST_JOINT_DEG)),
    )
