"""What lists of joint values share: the texts beside them, and what they cannot do."""

from __future__ import annotations

from calib.errors import InputError
from posedesign.programs.program import PoseProgram

WARNING_LENGTH = 90
"""Characters of a line of what the head of a list warns of."""


def comment_text(what: str, text: str) -> str:
    """A text that can stand in a comment, and comes back as it is.

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


def check_options(program: PoseProgram) -> None:
    """Refuse what a list of joint values cannot do; calls are left to who runs it.

    Raises InputError: a digital output is to be pulsed, or positions kept in registers.
    """
    options = program.options
    if options.measure_output is not None:
        raise InputError(
            "a list of joint values switches no output",
            hint="leave out measure_output, or write a program for the controller",
            name="measure_output",
            value=options.measure_output,
        )
    if options.keep != "position":
        raise InputError(
            "a list of joint values has no registers",
            hint='keep positions with keep = "position"',
            name="keep",
            value=options.keep,
        )
