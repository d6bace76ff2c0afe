"""Yaskawa jobs as the strict validator sees them: lines sorted into sections, little interpreted.

This shares no code with the reader and the writer, so that a mistake in one of them shows.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

_DATA = re.compile(r"(C|BC|EC|P|BP|EX)(\d{5})=(.*)")


@dataclass(frozen=True)
class Data:
    """A position, with the pseudo-instructions in force above it."""

    line: int
    kind: str
    number: int
    values: list[str]
    postype: str
    form: str
    user: str
    tool: str
    rconf: str

    @property
    def label(self) -> str:
        """Its name."""
        return f"{self.kind}{self.number:05d}"


@dataclass
class Listing:
    """A whole job."""

    headings: list[tuple[int, str]] = field(default_factory=list)
    names: list[tuple[int, str]] = field(default_factory=list)
    counts: list[tuple[int, str]] = field(default_factory=list)
    data: list[Data] = field(default_factory=list)
    pseudo: list[tuple[int, str]] = field(default_factory=list)  # of //INST
    steps: list[tuple[int, str]] = field(default_factory=list)
    faults: list[tuple[int, str]] = field(default_factory=list)  # line, what is not understood


def split_job(text: str) -> Listing:
    """Sort the lines of a job; never fails."""
    listing = Listing()
    section, force = "", dict.fromkeys(("POSTYPE", "form", "USER", "TOOL", "RCONF"), "")
    for row, raw in enumerate(text.split("\n"), start=1):
        line = raw.rstrip("\r")
        if line in ("/JOB", "//POS", "//INST"):
            section = line
            listing.headings.append((row, line))
        elif section == "/JOB" and line.startswith("//NAME "):
            listing.names.append((row, line[7:]))
        elif section == "//POS":
            _position_line(listing, force, row, line)
        elif section == "//INST" and line.startswith("///"):
            listing.pseudo.append((row, line))
        elif section == "//INST" and line:
            listing.steps.append((row, line))
        elif line:
            listing.faults.append((row, line))
    return listing


def _position_line(listing: Listing, force: dict[str, str], row: int, line: str) -> None:
    word, _, rest = line.removeprefix("///").partition(" ")
    data = _DATA.fullmatch(line)
    if data:
        values = data[3].split(",")
        listing.data.append(
            Data(
                row,
                data[1],
                int(data[2]),
                values,
                force["POSTYPE"],
                force["form"],
                force["USER"],
                force["TOOL"],
                force["RCONF"],
            )
        )
    elif not line.startswith("///"):
        listing.faults.append((row, line))
    elif word == "NPOS":
        listing.counts.append((row, rest))
    elif word in ("PULSE", "RECTAN"):
        force["form"] = word
    elif word in force:
        force[word] = rest
        if word == "POSTYPE":
            force["form"] = ""
    elif word != "MTOOL":
        listing.faults.append((row, line))
