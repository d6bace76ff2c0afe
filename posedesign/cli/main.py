"""``posedesign``: the entry point, and the one place that turns errors into one line."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

import click
import typer

from posedesign.cli import calibrate_commands, plan_commands, study_commands
from posedesign.cli.output import BAD_INPUT

app = typer.Typer(
    name="posedesign",
    help="Plan the measuring poses of a robot calibration, write the robot's program, and "
    "identify the robot from what comes back.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
plan_commands.register(app)
calibrate_commands.register(app)
study_commands.register(app)


def run(arguments: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit code: 0 done, 1 not reached, 2 bad input."""
    try:
        code = app(args=list(arguments) if arguments is not None else None, standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        print(error.format_message())
        return BAD_INPUT
    except click.UsageError as error:
        hint = error.ctx.command_path if error.ctx else "posedesign"
        print(f"error: {error.format_message()} (see {hint} --help)", file=sys.stderr)
        return BAD_INPUT
    except click.exceptions.Abort:
        print("stopped", file=sys.stderr)
        return 130
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # the reader of our output has gone; keep Python from complaining when it flushes
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        # imported late: --help must not wait for it
        from calib.errors import CalibError

        if not isinstance(error, CalibError):
            raise
        print(f"error: {error}", file=sys.stderr)
        return BAD_INPUT
    return int(code or 0)


def main() -> None:
    """Entry point of the console script."""
    sys.exit(run())
