"""The command of networks: several cameras, targets and arms at once."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import typer

from posedesign.cli import output
from posedesign.cli.hand_eye_commands import POSES_ARE, listed, refuse_unfit_noise


def network(
    pairs: Annotated[
        Path | None,
        typer.Argument(
            help="A table of pairs as for robot-world, with the columns on_flange and around: what "
            "is on the flange in each pair, and what stands around the arm; of several arms with "
            "the column arm."
        ),
    ] = None,
    edge: Annotated[
        list[str] | None,
        typer.Option(
            "--edge",
            help="Or files of one camera and one target each: camera_1,tag_7=pairs.csv or "
            "camera_1,tag_7=A.csv,B.csv, first what is on the flange; of several arms "
            "camera_1,tag_7,arm_2=... Once for each.",
        ),
    ] = None,
    columns: Annotated[
        str, typer.Option(help="Names of the columns of tables without a header line.")
    ] = "",
    unit: Annotated[
        Literal["mm", "m"] | None, typer.Option(help="Unit of length in files of matrices.")
    ] = None,
    invert: Annotated[
        Literal["none", "a", "b", "both"],
        typer.Option(help="What the files have the other way round."),
    ] = "none",
    poses_are: Annotated[
        str,
        typer.Option("--poses-are", help=POSES_ARE + " Of A, or with a slash of A and of B."),
    ] = "",
    noise_deg: Annotated[
        float | None,
        typer.Option(help="Standard deviation of rotations of B [deg]; from the residuals."),
    ] = None,
    noise_mm: Annotated[
        float | None, typer.Option(help="Standard deviation of its translations [mm], likewise.")
    ] = None,
    prior: Annotated[
        Path | None,
        typer.Option(
            "--prior",
            help="What is known of cameras and targets from elsewhere (prior.toml): a section "
            "[NAME] each with position_mm, wpr_deg, z_axis and their sigma_mm, sigma_deg; inf "
            "where it is not known.",
        ),
    ] = None,
    out: output.OutFolder = Path(),
    as_json: output.AsJson = False,
    verbose: output.Verbose = False,
    trust_units: Annotated[
        bool, typer.Option("--trust-units", help="Accept values that look like another unit.")
    ] = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Solve A X = Z B for several cameras, targets and arms at once.

    Every frame with its standard deviations. Pairs that contradict the others take no part, what
    was moved between two cameras is named, and so is what the motion does not tell.
    """
    from calib.errors import InputError
    from calib.robot_world import PairNoise
    from posedesign.hand_eye.pairs import PairSource
    from posedesign.hand_eye.pairs.networks import (
        EdgeFile,
        network_as_dict,
        read_edges,
        read_table_of_network,
    )
    from posedesign.hand_eye.pairs.priors import read_priors
    from posedesign.report.network import FILES, answer_of_network, solve_and_draw_network

    if (pairs is None) == (not edge):  # one of the two
        raise InputError(
            "give one table with the columns on_flange and around, or files with --edge",
            name="pairs",
        )
    refuse_unfit_noise(("ml",), noise_deg, noise_mm, None)
    source = PairSource(
        pairs or Path("pairs.csv"),
        columns=listed(columns),
        unit=unit,
        invert=invert,
        trust_units=trust_units,
        poses_are=poses_are,
    )
    found = read_edges(edge, source) if edge else read_table_of_network(pairs or Path(), source)
    noise = (
        None
        if noise_deg is None or noise_mm is None
        else PairNoise(math.radians(noise_deg), noise_mm / 1e3)
    )
    priors = () if prior is None else read_priors(prior)
    read = [pairs, *(path for text in edge or () for path in EdgeFile.of(text).files)]
    results = output.results_in(out, "network", *read, prior, overwrite=overwrite)
    result = solve_and_draw_network(found, results, noise, priors)
    files = [str(out / name) for name, _ in FILES if (out / name).is_file()]
    return output.tell(
        answer_of_network(found, result, files),
        result.is_ok,
        verbose=verbose,
        first=output.rehearsed_words(*read),
        content=network_as_dict(result),
        as_json=as_json,
    )
