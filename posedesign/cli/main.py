"""``posedesign``: the entry point, and the one place that turns errors into one line."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Sequence

import typer

from posedesign.cli import (
    calibrate_commands,
    calibration_command,
    correct_commands,
    plan_commands,
    program_commands,
    robot_world_command,
    study_commands,
    table_commands,
)
from posedesign.cli.output import BAD_INPUT, STOPPED

app = typer.Typer(
    name="posedesign",
    help="Plan the measuring poses of a robot calibration, write the robot's program, and "
    "identify the robot from what comes back.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
plan_commands.register(app)
program_commands.register(app)
calibrate_commands.register(app)
calibration_command.register(app)
correct_commands.register(app)
robot_world_command.register(app)
study_commands.register(app)
table_commands.register(app)


def run(arguments: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit code: 0 done, 1 not reached, 2 bad input."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        code = app(args=given or ["--help"], prog_name="posedesign", standalone_mode=False)
        sys.stdout.flush()
    except typer.TyperException as error:
        context = getattr(error, "ctx", None)
        command = context.command_path if context else "posedesign"
        print(f"error: {_one_line(error.format_message())} (see {command} --help)", file=sys.stderr)
        return BAD_INPUT
    except (typer.Abort, KeyboardInterrupt):
        return _stopped()
    except (BrokenPipeError, SystemExit):
        # the reader of our output has gone (typer turns that into SystemExit); keep Python from
        # complaining when it flushes
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        # imported late: --help must not wait for it
        from calib.errors import CalibError

        if isinstance(error, OSError) and error.errno == errno.ENOSPC:
            error = CalibError("the disk is full", hint="make room, or choose another --out")
        if not isinstance(error, CalibError):
            raise
        print(f"error: {_one_line(str(error))}", file=sys.stderr)
        return BAD_INPUT
    if code == STOPPED:  # typer turns Ctrl-C into this code
        return _stopped()
    return int(code or 0) if given else BAD_INPUT


def _stopped() -> int:
    print("stopped", file=sys.stderr)
    return STOPPED


def _one_line(text: str) -> str:
    """The same text without line ends, and without what would steer a terminal."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in " ".join(text.split()))


def main() -> None:
    """Entry point of the console script."""
    # matrices are small: threads that share them mostly wait, and a plan took four times as long
    # where other programs were running; read when numpy is imported, which has not been yet
    if "OMP_NUM_THREADS" not in os.environ:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(run())
