"""Arguments and options that several commands have, with their help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

LARGEST_SEED = 2**63 - 1
"""As in a cell."""

CellFile = Annotated[Path, typer.Argument(help="The cell, made with: posedesign new > cell.toml")]
PlannedPoses = Annotated[Path, typer.Argument(help="The poses, from: posedesign plan")]
ListedPoses = Annotated[
    Path, typer.Argument(help="A list of poses with columns j1_deg, j2_deg, ...")
]
OutFolder = Annotated[Path, typer.Option("--out", help="Folder for the results.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON in place of the answer.")]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="Print the tables and all notes, too.")
]
Overwrite = Annotated[
    bool,
    typer.Option(
        "--overwrite",
        help="Replace files that this command did not write, too; they are kept beside it as "
        "NAME.1, NAME.2, ...",
    ),
]
TrustUnits = Annotated[
    bool, typer.Option("--trust-units", help="Accept joint values that look like radians.")
]
FileFormat = Annotated[
    str | None, typer.Option("--format", help="Of the files; default: what they look like.")
]
CameraPlace = Literal["on-flange", "fixed"]
