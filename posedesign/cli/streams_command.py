"""The command of two streams: poses of an arm and of a camera with clocks of their own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from posedesign.cli import output
from posedesign.cli.hand_eye_commands import POSES_ARE, listed


def streams(
    robot: Annotated[
        Path,
        typer.Argument(
            help="Poses of the flange with their times: a table with time_s (or time_ns) and a "
            "pose as in robot-world, or a trajectory of TUM."
        ),
    ],
    seen: Annotated[
        Path, typer.Argument(help="Poses by the camera with its times, likewise: B of A X = Z B.")
    ],
    largest_offset_s: Annotated[
        float,
        typer.Option(
            "--largest-offset-s",
            help="How far the clocks may be apart [s], from 0 and from where angular speeds agree.",
        ),
    ] = 1.0,
    columns: Annotated[
        str, typer.Option(help="Names of the columns of tables without a header line.")
    ] = "",
    camera: Annotated[
        output.CameraPlace, typer.Option(help="Where it is, as for robot-world.")
    ] = "on-flange",
    invert: Annotated[
        Literal["none", "a", "b", "both"],
        typer.Option(help="What the files have the other way round: the arm's a, the camera's b."),
    ] = "none",
    poses_are: Annotated[
        str,
        typer.Option("--poses-are", help=POSES_ARE + " Of A, or with a slash of A and of B."),
    ] = "",
    estimate_scale: Annotated[
        bool,
        typer.Option("--estimate-scale", help="Estimate the scale of B's translations, too."),
    ] = False,
    out: output.OutFolder = Path(),
    as_json: output.AsJson = False,
    verbose: output.Verbose = False,
    trust_units: Annotated[
        bool, typer.Option("--trust-units", help="Accept values that look like another unit.")
    ] = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Solve A X = Z B of an arm and a camera that move, each by its own clock.

    With the offset of the clocks, its rate and the jitter of the camera's stamps where they show,
    all with standard deviations.
    """
    from calib.errors import InputError
    from posedesign.files import usable
    from posedesign.hand_eye.pairs.source import PairSource
    from posedesign.hand_eye.pairs.timed import read_stream
    from posedesign.report.streams import (
        FILES,
        answer_of_streams,
        answer_row,
        solve_and_draw_streams,
    )

    if not usable(largest_offset_s) > 0.0:
        raise InputError(
            f"--largest-offset-s is {largest_offset_s:g}",
            hint="give seconds above 0",
            name="--largest-offset-s",
        )
    said = PairSource(a=robot, b=seen, poses_are=poses_are).said
    sides = {"a": (robot, said[0]), "b": (seen, said[1])}
    a, b = (
        read_stream(
            path,
            "a" if side == "a" else "b",
            listed(columns),
            inverted=invert in (side, "both"),
            trust_units=trust_units,
            said=own,
        )
        for side, (path, own) in sides.items()
    )
    results = output.results_in(out, "streams", robot, seen, overwrite=overwrite)
    with output.progress("streams", quiet=as_json) as advance:
        advance("clocks", 0.1)
        result = solve_and_draw_streams(
            a, b, results, largest_offset_s=largest_offset_s, estimate_scale=estimate_scale
        )
    files = [str(out / name) for name, _ in FILES if (out / name).is_file()]
    return output.tell(
        answer_of_streams(result, camera, files),
        result.is_ok,
        verbose=verbose,
        content=answer_row(result) | {"covariance": result.covariance.tolist()},
        as_json=as_json,
    )
