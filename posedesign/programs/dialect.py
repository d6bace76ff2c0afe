"""The one interface that every controller's file format is written behind."""

from __future__ import annotations

import gc
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, get_args

import numpy as np

from calib.errors import CalibError, FileFormatError, InputError
from posedesign.files import Results, encoded, head_of
from posedesign.programs import sets
from posedesign.programs.arm import Arm
from posedesign.programs.language import shared_statements
from posedesign.programs.notation import Notation
from posedesign.programs.program import Form, PoseProgram, ProgramOptions
from posedesign.programs.reading import MOST_BYTES, NoPositionsError, read_program_bytes
from posedesign.programs.recorded import Level, Problem, RecordedProgram, corrected_by
from posedesign.programs.rules import MOST_PROBLEMS
from posedesign.programs.sets import MOST_PARTS, beside, claim_set, marked_as_set, strangers
from posedesign.programs.writing import Limits, NameRule, check_call


class Dialect:
    """A controller's program format: one subclass, in one package, a controller.

    The first of ``suffixes`` is that of the file with the positions.
    """

    name: ClassVar[str]  # what a user calls it, e.g. ``fanuc-ls``
    title: ClassVar[str]  # what it is, in words
    maker: ClassVar[str | None]
    """Whose controllers read it, a key of ``calib.robots.POSITIVE_AXES``; None: any robot."""
    suffixes: ClassVar[tuple[str, ...]]  # endings of its files in lower case, e.g. ``.ls``
    companions: ClassVar[tuple[str, ...]] = ()
    """Endings of its files without positions, where one with the first of ``suffixes`` has them."""
    in_folder: ClassVar[bool] = False  # a program is a folder of files, and not files of one name
    forms: ClassVar[tuple[Form, ...]] = get_args(Form)  # how it can write positions
    keeps: ClassVar[bool] = True  # touched-up positions can be kept apart from the planned ones
    switches: ClassVar[bool] = True  # an output can be pulsed
    external_axes: ClassVar[int] = 0  # how many of them its joint positions can have
    turning_axes: ClassVar[bool] = False  # these may turn, as those of a positioner do
    names: ClassVar[NameRule]  # what it takes for the name of a program
    newline: ClassVar[str] = "\n"
    encoding: ClassVar[str] = "ascii"
    controlled: ClassVar[bool] = True
    """Programs of a controller: what it would refuse is not read. Lists are read as tools print
    them, too, that no other tool loads."""
    numbered_frames: ClassVar[bool] = False
    """Poses are stored in frames of which programs have only the numbers."""
    joint_step_deg: ClassVar[float] = 0.0
    """Step that the controller stores joint values in [deg]; 0 where it does not matter."""
    passes: ClassVar[bool] = True  # it has postures that the arm only passes through
    remark: ClassVar[tuple[str, str]] = ("", "")
    """Pattern of what one more comment is put behind, and its line, of ``words`` and, where lines
    are numbered, of their ``number``. Empty for none."""
    begins: ClassVar[re.Pattern[bytes] | None] = None
    """What stands in all of its programs, where other dialects have the same ending."""
    notation: ClassVar[Notation] = Notation()
    limits: ClassVar[Limits | None] = None  # of what programs say; None: nothing is called in them
    position_name: ClassVar[re.Pattern[str] | None] = None  # of positions that are variables
    writer: ClassVar[Callable[[PoseProgram, Arm], dict[str, str]]]
    reader: ClassVar[Callable[[bytes, Path], RecordedProgram]]
    rules: ClassVar[Callable[[bytes, Path], list[Problem]]]
    """writer, reader, rules: what `render`, `read_data` and `judge_data` do."""

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        r"""Text of each file of a program by its name, lines ended by ``\n``.

        The file that is read back, with the positions, comes first. The program is not too long,
        its name is legal, and the arm is the maker's. Raises InputError for what it cannot say.
        """
        return type(self).writer(program, arm)

    def parse(self, data: bytes, path: Path) -> RecordedProgram:
        """The program in the content of a file, tolerant of what controllers export.

        ``path`` is for messages, and for companions of the file that hold no positions. Raises
        FileFormatError for a file that is no such program, holds no positions, or breaks a rule:
        nothing is read that `check` calls an error.
        """
        with shared_statements():
            program = self.read_data(data, path)
            told = self.errors_in(data, path) if self.controlled else []
            wrong = next((problem for problem in told if problem.level == "error"), None)
        if wrong is not None:
            program.whole()
            reason, hint = f"{wrong.message} [{wrong.rule}]", "the controller would refuse it"
            raise FileFormatError(reason, path=path, row=wrong.line, hint=hint)
        return program

    def check(self, data: bytes, path: Path) -> list[Problem]:
        """What the controller would refuse, or run in another way than meant; notes as well.

        The rules share no code with the writer. What `parse` refuses without a rule being broken is
        told, too: rule ``read``, a note where no plan has marked the program. Never fails, whatever
        the content.
        """
        with shared_statements():
            found = self.judge_data(data, path)
            if all(problem.level == "note" for problem in found):
                found += self._unread(data, path)
        return found

    def _unread(self, data: bytes, path: Path) -> Iterator[Problem]:
        """Why positions of a program cannot be read that breaks no rule."""
        level: Level = "measuring" if sets.set_mark(data) else "note"
        faults: tuple[CalibError, ...] = ()
        try:
            program = self.read_data(data, path)
            faults = (*program.unread, *(p.fault for p in program.positions if p.fault))
        except CalibError as error:
            faults = (error,)
        for fault in faults[:MOST_PROBLEMS]:
            row, noted = getattr(fault, "row", None) or 1, isinstance(fault, NoPositionsError)
            if noted and self._has_positions_beside(path):
                continue
            said = re.sub(r"\A.*?(, line \d+)?: ", "", fault.message, count=1)
            yield Problem(row, "read", f"cannot be read: {said}", "note" if noted else level)

    def _has_positions_beside(self, path: Path) -> bool:
        """Whether a file is a companion of one with positions that stands beside it."""
        is_companion = path.suffix.lower() in self.companions and path.is_file()
        return is_companion and bool(beside(path, self.suffixes[:1], in_folder=self.in_folder))

    def unchecked(self, arm: Arm) -> tuple[str, ...]:
        """What programs of this arm take for granted, and nobody has compared with its controller.

        The program says it, and whoever writes it is told.
        """
        if self.maker is None or not arm.n_external:
            return ()
        return tuple(
            f"zero and direction of E{k}, taken to be those of {name} in the description"
            for k, name in enumerate(arm.joint_names[-arm.n_external :], start=1)
        )

    def read_data(self, data: bytes, path: Path) -> RecordedProgram:
        """The program in the content of a file, whatever rules it breaks; see `parse`."""
        return type(self).reader(data, path)

    def judge_data(self, data: bytes, path: Path) -> list[Problem]:
        """The rules that a file breaks, whether or not it can be read; see `check`."""
        return type(self).rules(data, path)

    def errors_in(self, data: bytes, path: Path) -> list[Problem]:
        """Problems of a file that is read: errors count, and others can be left out."""
        return self.judge_data(data, path)

    def notation_of(self, text: str) -> Notation:
        """How the numbers of positions are written in this file."""
        return self.notation

    def with_remark(self, text: str, words: str) -> str:
        """A program with one more comment; as it is where it can have none."""
        after, line = self.remark
        found = re.search(after, text, re.MULTILINE | re.IGNORECASE)
        if not line or found is None:
            return text
        numbers = re.findall(r"^[ \t]*(\d+)", found[0], re.MULTILINE)
        shown = line.format(words=words, number=int(numbers[-1]) + 1 if numbers else 1)
        end = "\r\n" if "\r\n" in text else "\n"
        return text[: found.end()] + shown + end + text[found.end() :]

    def most_poses(self, program: PoseProgram) -> int | None:
        """Most poses of one file of such a program; None: any number."""
        return None

    def reading(
        self, pulses_per_deg: Sequence[float], pulses_per_mm: Sequence[float] = ()
    ) -> Dialect:
        """The dialect that reads with what is known of the arm; most need nothing."""
        return self

    def recognises(self, data: bytes) -> bool:
        """Whether the content looks like this dialect's, where several have the same ending."""
        return self.begins is None or self.begins.search(data) is not None

    def is_companion(self, data: bytes) -> bool:
        """Whether it is a companion of this dialect's, of an ending that others have, too."""
        return False

    def parts(self, program: PoseProgram) -> Iterator[PoseProgram]:
        """The program, or its parts where it is too long for one file."""
        most = self.most_poses(program)
        if most is None or len(program.poses) <= most:
            yield program
            return
        for k, part in enumerate(program.split(most), start=1):
            yield replace(part, name=self.names.part(program.name, k))

    def files(self, program: PoseProgram) -> dict[str, str]:
        """Text of all files of a program by name, in several parts where it is long.

        Those with the positions come first, in the order of the visit.

        Raises InputError: the program cannot be said in this dialect.
        """
        self._check_options(program.options)
        self.names.check(program.name)
        arm = self._arm_of(program)
        if arm.n_external > self.external_axes:
            raise self._cannot_move(arm, "are not written")
        if arm.n_external and program.options.form != "joint" and not arm.world_stands:
            raise InputError(
                f"{arm.joint_names[-1]} {_does(arm)}: where its controller has the world is not "
                "known",
                hint="write joint positions; of a KUKA or an ABB on a rail set program.world",
                name="form",
            )
        program = replace(program, not_checked=(*self.unchecked(arm), *program.not_checked))
        parts = []
        for part in self.parts(program):
            if self.limits is not None:
                self.limits.check(part)
                check_call(self.names, part.options, part.name, self.position_name)
            parts.append(list(self.render(part, arm).items()))
        return dict([part[0] for part in parts] + [file for part in parts for file in part[1:]])

    def _check_options(self, options: ProgramOptions) -> None:
        """Raise InputError for what no program of the dialect can say."""
        wrong, hint, name = "", "", "form"
        if options.form not in self.forms:
            wrong = f"{self.name} has no {options.form} form"
            hint = f"write the {self.forms[0]} form"
        elif options.keep == "register" and not self.keeps:
            wrong, name = f"programs in {self.name} keep no registers", "keep"
            hint = 'keep positions with keep = "position"'
        elif options.measure_output is not None and not self.switches:
            wrong, name = f"a program in {self.name} switches no output", "measure_output"
            hint = "leave out measure_output, or write a program for the controller"
        if wrong:
            raise InputError(wrong, hint=hint, name=name, value=getattr(options, name))

    def write(self, program: PoseProgram, out: Path | Results) -> tuple[Path, ...]:
        """Write the files of a program into a folder, which is made; see :meth:`files`.

        Files of an older program of the name give way: in a folder whatever they are, in results
        only where they are as they were written. Raises OutputError: a file cannot be written, or
        is there and must not be replaced.
        """
        results = out if isinstance(out, Results) else None
        folder = results.folder if results else Path(out)  # type: ignore[arg-type]
        files = marked_as_set(
            {
                folder / name: encoded(name, text, newline=self.newline, encoding=self.encoding)
                for name, text in self.files(program).items()
            }
        )
        old = self.claim(program.name, results, files) if results else []
        packed = {path: self.packed(data) for path, data in files.items()}
        sets.write_set(packed, old, in_folder=self.in_folder)
        return tuple(files)

    def packed(self, data: bytes) -> bytes:
        """The content of a file as it is written: most are written as they are."""
        return data

    def claim(
        self, name: str, results: Results, files: Mapping[Path, bytes] | None = None
    ) -> list[Path]:
        """Files of older programs of a name; OutputError where they must not be replaced."""
        parts = [self.names.part(name, k) for k in range(1, MOST_PARTS + 1)]
        endings = {path.suffix.lower() for path in files or ()} or {*self.suffixes}
        return claim_set(name, parts, endings, results, in_folder=self.in_folder, new=files)

    def read(self, path: Path) -> RecordedProgram:
        """Read a program of this controller; see `parse`."""
        with _uncollected():
            return self.parse(read_program_bytes(path), path)

    def validate(self, path: Path, levels: Collection[Level] | None = None) -> list[Problem]:
        """Problems of a file, of these levels or those of `levels_of`; none of a good one.

        Raises FileFormatError: the file cannot be opened or is far too large.
        """
        told = self.levels_of(path) if levels is None else levels
        with _uncollected():
            found = self.check(read_program_bytes(path), path)
        found += [Problem(1, "set", said) for said in self.strangers(path)]
        if by := self.corrected_by(path):
            found.append(Problem(1, "corrected", f"positions are of the arm {by}", "note"))
        return sorted(
            (p for p in found if p.level in told), key=lambda p: (p.line, p.rule, p.message)
        )

    def corrected_by(self, path: Path) -> str:
        """By which identification the positions of a program are corrected; see `corrected_by`.

        Its head says so, which another of its files may have.
        """
        endings = (*self.suffixes, *self.companions) if self.companions else ()
        others = beside(path, endings, in_folder=self.in_folder)
        heads = (head_of(other, MOST_BYTES) for other in others)
        return corrected_by(read_program_bytes(path), *heads)

    @staticmethod
    def levels_of(path: Path) -> tuple[Level, ...]:
        """Levels that a file is asked for: one that carries the mark of a plan has to measure."""
        return ("error", "measuring") if sets.set_mark(read_program_bytes(path)) else ("error",)

    def strangers(self, path: Path) -> list[str]:
        """Files beside one of this dialect that it does not belong to, in words."""
        return strangers(path, self.suffixes, in_folder=self.in_folder) if self.companions else []

    def seen(self, arm: Arm) -> Arm:
        """An arm as the programs of this dialect show it.

        Raises InputError: its controller is another maker's, or not known; a positioner where
        external axes of the dialect only slide.
        """
        if arm.controller.external.positioner and self.external_axes and not self.turning_axes:
            raise self._cannot_move(arm, "are not written, nor read, but for those that slide")
        if self.maker is None:
            # the description's joints, whatever a pendant shows
            return replace(
                arm, controller=replace(arm.controller, pendant_from_joints=np.eye(arm.n))
            )
        if arm.maker != self.maker:
            known = f"a controller of {arm.maker}" if arm.maker else "an unknown controller"
            robot = arm.robot.name if arm.robot is not None else "the arm"
            raise InputError(
                f"{robot} has {known}: its joints would be taken in the wrong convention",
                hint=f"if its controller is one of {self.maker}, set robot.controller = "
                f'"{self.maker}"',
                name="format",
                value=self.name,
            )
        return arm

    def _cannot_move(self, arm: Arm, why: str) -> InputError:
        return InputError(
            f"{arm.joint_names[-1]} {_does(arm)}, and the external axes of {self.title} {why}",
            hint=f"hold it where it is: robot.held_{arm.external_units[-1]}",
            name="format",
            value=self.name,
        )

    def _arm_of(self, program: PoseProgram) -> Arm:
        """The program's arm, or the maker's usual one, as this dialect shows it."""
        joints = program.poses[0].posture_rad.size
        arm = program.arm or Arm.usual(self.maker, joints)
        if arm.n != joints:
            raise InputError(
                f"the poses have {joints} joint values, the arm {arm.n}",
                hint="one program moves one arm",
                name="poses",
            )
        return self.seen(arm)


def _does(arm: Arm) -> str:
    """Of its last external axis."""
    return "slides" if arm.external_units[-1] == "mm" else "turns what is measured"


@contextmanager
def _uncollected() -> Iterator[None]:
    """Pause the collector of cycles, of which reading makes none.

    A program of 10,000 poses is a million objects, and the collector would look through all that
    are there again and again while they are made: half of the time.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
