"""``posedesign``: the entry point, and the one place that turns errors into a sentence."""

from __future__ import annotations

import errno
import io
import os
import re
import sys
import traceback
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Annotated

import typer

from posedesign import __version__
from posedesign.cli import (
    acceptance_commands,
    hand_eye_commands,
    identify_commands,
    network_command,
    plan_commands,
    program_commands,
    show_commands,
    streams_command,
    study_commands,
)
from posedesign.cli.output import BAD_INPUT, FAULT, STOPPED, note, plain

if TYPE_CHECKING:
    from typing_extensions import Buffer

LONGEST_LINE = 1500
"""Characters of an error; a path or a name in it may be as long as it likes."""

app = typer.Typer(
    name="posedesign",
    help="Plan the measuring poses of a robot calibration, write the robot's program, and "
    "identify the robot from what comes back.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
COMMANDS: dict[str, Callable[..., int]] = {
    "robots": plan_commands.robots,
    "new": plan_commands.new,
    "plan": plan_commands.plan,
    "next": plan_commands.next_poses,
    "check": plan_commands.check,
    "score": plan_commands.score,
    "program": program_commands.program,
    "validate": program_commands.validate,
    "import": program_commands.import_positions,
    "record": program_commands.record,
    "convert": program_commands.convert,
    "simulate": identify_commands.simulate,
    "identify": identify_commands.identify,
    "calibrate": identify_commands.calibrate,
    "correct": identify_commands.correct,
    "predict": identify_commands.predict,
    "prove": acceptance_commands.prove,
    "recheck": acceptance_commands.recheck,
    "robot-world": hand_eye_commands.robot_world,
    "network": network_command.network,
    "streams": streams_command.streams,
    "demo": study_commands.demo,
    "report": show_commands.report,
    "view": show_commands.view,
    "camera": hand_eye_commands.camera,
    "board": show_commands.board,
}
"""In the order in which they are listed; then those of ``study``."""

studies = typer.Typer(help="Studies by simulation.")
studies.command("accuracy")(study_commands.accuracy)
studies.command("list")(study_commands.list_all)
studies.command("run")(study_commands.run)
studies.command("plot")(study_commands.plot)
for name, command in COMMANDS.items():
    app.command(name)(command)
app.add_typer(studies, name="study")


def _say_version(asked: bool) -> None:
    if asked:
        print(f"posedesign {__version__}")
        raise typer.Exit


@app.callback()
def posedesign(
    version: Annotated[
        bool, typer.Option("--version", callback=_say_version, is_eager=True, help="Say which.")
    ] = False,
) -> None:
    """Plan the measuring poses of a robot calibration, write the program, identify the robot."""


_command_of = cache(typer.main.get_command)
"""Commands with their options: who runs several in a process has them built once."""


def run(arguments: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit code: 0 done, 1 not reached, 2 bad input.

    What is none of these, a fault of this program, is raised.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        words = given or ["--help"]
        code = _command_of(app)(args=words, prog_name="posedesign", standalone_mode=False)
        sys.stdout.flush()
    except typer.TyperException as error:
        context = getattr(error, "ctx", None)
        command = context.command_path if context else "posedesign"
        note(f"error: {_cut(_of_the_words(error))} (see {command} --help)")
        return BAD_INPUT
    except (typer.Abort, KeyboardInterrupt):
        return _stopped()
    except Exception as error:
        # imported late: --help must not wait for it
        from calib.errors import CalibError

        told = str(error) if isinstance(error, CalibError) else _of_the_machine(error)
        if not told:
            raise
        note(f"error: {_cut(told)}")
        return BAD_INPUT
    if code == STOPPED:  # typer turns Ctrl-C into this code
        return _stopped()
    return int(code or 0) if given else BAD_INPUT


def _of_the_words(error: typer.TyperException) -> str:
    """What is wrong with the words of a command, with the word that was probably meant."""
    text = error.format_message().replace(": Value error, ", ": ")
    choice = re.search(r"'([^']*)' is not one of ('[^']*'(?:, '[^']*')*)\.$", text)
    if choice is None:
        return text
    from calib.errors import near_names

    meant = near_names(choice[1].replace("_", "-"), re.findall("'([^']*)'", choice[2]))
    return f"{text[:-1]}; {meant}" if meant.startswith("did") else text


def _stopped() -> int:
    print("stopped", file=sys.stderr)
    return STOPPED


def _of_the_machine(error: Exception) -> str:
    """What the machine lacks or refuses, in a line; empty for any other error."""
    if isinstance(error, MemoryError):
        return "the memory is not enough (ask for less at once, or use a larger machine)"
    if isinstance(error, OSError):
        if error.errno == errno.ENOSPC:
            return "the disk is full (make room, or choose another --out)"
        if error.filename is not None:
            return f"{os.fsdecode(error.filename)}: {error.strerror}"
    return ""


def _cut(text: str) -> str:
    line = plain(" ".join(text.split()))
    return line if len(line) <= LONGEST_LINE else f"{line[: LONGEST_LINE - 4]} ..."


class _Output(io.FileIO):
    """A file descriptor whose reader may go: what nobody reads is dropped, and work goes on."""

    def write(self, data: Buffer, /) -> int:
        """Write; after any error the next writes go nowhere, so that Python can end in peace."""
        try:
            return super().write(data) or 0
        except OSError as error:
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
            if not isinstance(error, BrokenPipeError):
                raise
            return memoryview(data).nbytes


def _open_streams() -> None:
    """Have standard streams that can be written, closed ones too, whatever is in a text."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free: this one
    for name, descriptor in (("stdout", 1), ("stderr", 2)):
        given = getattr(sys, name)
        stream = io.TextIOWrapper(
            io.BufferedWriter(_Output(descriptor, "w", closefd=False)),
            encoding=given.encoding if given else "utf-8",
            errors="backslashreplace",
            line_buffering=name == "stderr" or os.isatty(descriptor),
        )
        setattr(sys, name, stream)


def main() -> None:
    """Entry point of the console script."""
    _open_streams()
    # matrices are small: threads that share them mostly wait, and a plan took four times as long
    # where other programs were running; read when numpy is imported, which has not been yet
    if "OMP_NUM_THREADS" not in os.environ:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        code = run()
    except Exception:
        traceback.print_exc()
        code = FAULT
    sys.exit(code)
