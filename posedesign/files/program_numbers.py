"""Ranges of the numbers of a program, first and last: as a cell has them, and as dialects do.

A controller may take less, and its dialect then refuses the rest.
"""

FRAME = (0, 99)
"""Of a user or tool frame."""

SPEED_PERCENT = (1, 100)

OUTPUT = (1, 4096)
"""Of a digital output."""

REGISTER = (1, 32767)

ARGUMENT = (-32767, 32767)
"""Whole numbers that every controller takes as an argument."""

SECONDS = (0.0, 1e6)
"""To wait, or of a pulse."""
