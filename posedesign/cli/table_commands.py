"""Commands on tables: convert."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from posedesign.cli.output import (
    DONE,
    note,
    note_misfit,
    print_json,
    results_in,
    say,
)
from posedesign.cli.plan_commands import AsJson, Overwrite, TrustUnits


class Form(StrEnum):
    """The names of :class:`posedesign.files.postures.JointForm`: importing it delays --help."""

    USUAL = "usual"
    ROS = "ros"
    ROBODK = "robodk"


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command()(convert)


def convert(
    poses: Annotated[
        Path,
        typer.Argument(help="A table of poses: joints as j1_deg .., <joint name>_rad .. or J1 .."),
    ],
    cell: Annotated[Path, typer.Option(help="The cell: its robot has the names of the joints.")],
    out: Annotated[Path, typer.Option("--out", help="The table to write.")],
    to: Annotated[
        Form,
        typer.Option(
            help="usual: j1_deg ..; ros: <joint name>_rad ..; robodk: J1 .. as the pendant shows "
            "them, first in each row."
        ),
    ] = Form.USUAL,
    as_json: AsJson = False,
    trust_units: TrustUnits = False,
    overwrite: Overwrite = False,
) -> int:
    """Write a table of poses with its joints named in another way.

    Configuration and margins are written anew; columns that are not known are kept.
    """
    from posedesign.cell import Cell
    from posedesign.files.postures import JointForm
    from posedesign.planning import Margins, outside_limits
    from posedesign.planning.poses_file import read_robot_poses, write_pose_list

    loaded = Cell.load(cell)
    (file,) = results_in(out.parent, "convert", poses, overwrite=overwrite).claim(
        "planned", (out.name, "converted poses"), bare=to is Form.ROBODK
    )
    listed = read_robot_poses(poses, loaded.robot, trust_units=trust_units)
    for said in outside_limits(loaded, listed.names, listed.postures):
        note(f"warning: {poses}: {said}")
    note_misfit(poses, listed)
    write_pose_list(
        file,
        listed,
        loaded.robot,
        loaded.tool_m,
        margins=Margins.of(loaded, listed.postures, listed.via),
        form=JointForm(to.value),
    )
    if as_json:
        print_json(
            {
                "path": str(out),
                "poses": len(listed.measured.names),
                "fingerprint": listed.fingerprint,
                "fingerprint_written": listed.fingerprint_written,
                "kept_columns": list(listed.extra),
            }
        )
    else:
        say(f"wrote {out}: {len(listed.measured.names)} poses")
    return DONE
