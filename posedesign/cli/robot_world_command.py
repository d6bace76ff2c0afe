"""The command for pose pairs: robot-world."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from posedesign.cli.output import DONE, NOT_REACHED, note, print_json, print_table
from posedesign.cli.plan_commands import AsJson, OutFolder

if TYPE_CHECKING:
    from calib.robot_world.noise import Noise
    from posedesign.pairs_file import Pairs
    from posedesign.pairs_frames import Camera
    from posedesign.pairs_results import NoiseOn, SolverOutcome

DEFAULT_METHODS = "ml,papers"


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command("robot-world")(robot_world)


def robot_world(
    pairs: Annotated[
        Path | None,
        typer.Argument(
            help="Pairs A, B of A X = Z B. A table, each pose as x_mm y_mm z_mm or x_m y_m z_m "
            "with w_deg p_deg r_deg, qw qx qy qz, rx_rad ry_rad rz_rad (a rotation vector) or r11 "
            ".. r33, and a_ or b_ before each name; or a MATLAB file (.mat) with arrays 4x4xN."
        ),
    ] = None,
    a: Annotated[Path | None, typer.Option("--a", help="Or A in a file of its own,")] = None,
    b: Annotated[Path | None, typer.Option("--b", help="and B in another.")] = None,
    columns: Annotated[
        str,
        typer.Option(
            help="Names of the columns where a table has no header line, say "
            "qw,qx,qy,qz,x_m,y_m,z_m; matrix16_mm: a matrix row by row, matrix12_mm: without its "
            "last row; -: to be passed over."
        ),
    ] = "",
    variables: Annotated[
        str, typer.Option(help="Names of A and B in a MATLAB file, say T_hand,T_cam.")
    ] = "",
    unit: Annotated[
        Literal["mm", "m"] | None, typer.Option(help="Unit of length in a MATLAB file.")
    ] = None,
    camera: Annotated[
        Literal["on-flange", "fixed"],
        typer.Option(
            help="Where it is. on-flange: A = T_base_flange, B = T_target_camera. fixed, with the "
            "target on the flange: A = T_base_flange, B = T_camera_target."
        ),
    ] = "on-flange",
    invert: Annotated[
        Literal["none", "a", "b", "both"],
        typer.Option(
            help="What the files have the other way round. OpenCV's gripper2base and target2cam "
            "with the camera on the flange: b."
        ),
    ] = "none",
    convention: Annotated[
        Literal["axzb", "opencv"],
        typer.Option(
            help="opencv: A is world2cam and B is base2gripper, as calibrateRobotWorldHandEye "
            "takes them."
        ),
    ] = "axzb",
    method: Annotated[
        str,
        typer.Option(help="Methods, with commas between them; papers: those of the papers; all."),
    ] = DEFAULT_METHODS,
    noise_deg: Annotated[
        float | None,
        typer.Option(help="Standard deviation of rotations; default: from the residuals."),
    ] = None,
    noise_mm: Annotated[
        float | None, typer.Option(help="Standard deviation of translations, likewise.")
    ] = None,
    noise_on: Annotated[
        Literal["a", "b", "both", "seen"] | None,
        typer.Option(
            help="Which side has it; default: b. seen: the target as the camera sees it, as a "
            "camera's data sheet has it: with the camera on the flange, the inverse of B."
        ),
    ] = None,
    certify: Annotated[
        bool, typer.Option("--certify", help="Prove that no other X and Z are likelier.")
    ] = False,
    out: OutFolder = Path(),
    as_json: AsJson = False,
    trust_units: Annotated[
        bool, typer.Option("--trust-units", help="Accept values that look like another unit.")
    ] = False,
) -> int:
    """Solve A X = Z B: camera on flange and target in base, or the other way.

    By one method or by many, with standard deviations, what is left over pair by pair, and what
    each pair has left over when it is left out.
    """
    from posedesign.pairs_frames import FRAMES
    from posedesign.pairs_results import certified, methods_of, warnings_of
    from posedesign.pairs_source import PairSource
    from posedesign.pairs_tables import opencv_rows, outcome_as_dict
    from posedesign.workflow import solve_and_write

    refuse_fixed_opencv(camera, convention)
    source = PairSource(
        pairs, a, b, listed(columns), listed(variables), unit, invert, convention, trust_units
    )
    methods = methods_of(method)
    refuse_half_a_noise(noise_deg, noise_mm, noise_on)
    found = source.read()
    for text in found.notes:  # before solving, which may be refused for what they say
        note(f"warning: {text}")
    noise = given_noise(found, camera, noise_deg, noise_mm, noise_on)
    outcomes = solve_and_write(found, out, methods, noise)
    if certify:
        outcomes = certified(found, outcomes)
    opencv = convention == "opencv"
    if as_json:
        print_json([outcome_as_dict(found, one, camera, opencv=opencv) for one in outcomes])
    else:
        print_solvers(outcomes, camera)
        if not opencv and invert in ("none", "a"):
            print(FRAMES[camera].other_way)
        if opencv:
            print_table("In OpenCV's names", opencv_rows(outcomes))
        print(f"wrote {out / 'robot_world.csv'} and {out / 'robot_world_pairs.csv'}")
    for text in warnings_of(outcomes):
        note(f"warning: {text}")
    # a comparison of all shows methods at work on what they are not made for
    reached = any if method == "all" else all
    return DONE if reached(outcome.ok for outcome in outcomes) else NOT_REACHED


def print_solvers(outcomes: Sequence[SolverOutcome], camera: Camera = "on-flange") -> None:
    """Print X and Z of every solver, with what is left over, and what the letters mean."""
    from posedesign.pairs_frames import FRAMES
    from posedesign.pairs_results import remarks_of
    from posedesign.pairs_tables import largest_sigma, solver_row
    from posedesign.tables import POSE_AXES

    rows = [solver_row(outcome) for outcome in outcomes]
    frames = FRAMES[camera]
    for letter, what in (("x", f"X = {frames.X}"), ("z", f"Z = {frames.Z}")):
        shown = []
        for row, outcome in zip(rows, outcomes, strict=True):
            place, turn = largest_sigma(outcome, letter)
            line = {key: row[key] for key in ("method", "status")}
            line |= {axis: row[f"{letter}_{axis}"] for axis in POSE_AXES}
            shown.append(line | {"sigma_mm": place, "sigma_deg": turn})
        print_table(what, shown)
    keep = {
        "method": "method",
        "status": "status",
        "iterations": "iterations",
        "residual_rotation_deg": "residual_deg",
        "residual_translation_mm": "residual_mm",
        "left_out_rotation_deg": "left_out_deg",
        "left_out_translation_mm": "left_out_mm",
        "used": "used",
        "pairs": "of pairs",
    }
    print_table("Left over (rms)", [{name: row[key] for key, name in keep.items()} for row in rows])
    print(f"A = {frames.A}; B = {frames.B}")
    sources = {row["noise"] for row in rows}
    noise = (
        "the noise given" if "given" in sources else "the noise that the residuals show, as of B"
    )
    print(f"sigma: the largest of the three axes, by {noise}; left_out: of pairs not seen.")
    for text in remarks_of(outcomes):
        print(text)


def refuse_half_a_noise(
    noise_deg: float | None, noise_mm: float | None, noise_on: str | None
) -> None:
    """Both sizes of the noise, or nothing of it."""
    from calib.errors import InputError

    if (noise_deg is None) != (noise_mm is None):
        raise InputError("give both --noise-deg and --noise-mm, or neither", name="noise")
    if noise_deg is None and noise_on is not None:
        raise InputError("--noise-on says nothing without --noise-deg and --noise-mm", name="noise")


def given_noise(
    pairs: Pairs,
    camera: Camera,
    noise_deg: float | None,
    noise_mm: float | None,
    noise_on: Literal["a", "b", "both", "seen"] | None,
) -> Noise | None:
    """The noise of the options, if they say one."""
    import math

    from posedesign.pairs_results import noise_of

    if noise_deg is None or noise_mm is None:
        return None
    sides: dict[str, NoiseOn] = {"a": "A", "b": "B", "both": "both", "seen": "seen"}
    side = sides[noise_on or "b"]
    return noise_of(pairs, camera, math.radians(noise_deg), noise_mm / 1e3, side)


def refuse_fixed_opencv(camera: str, convention: str) -> None:
    """OpenCV's function has no fixed camera: its world would be the flange."""
    from calib.errors import InputError

    if camera == "fixed" and convention == "opencv":
        raise InputError(
            "--convention opencv is for a camera on the flange",
            hint="for a fixed one give gripper2base as A and target2cam as B, without it",
            name="convention",
        )


def listed(text: str) -> list[str]:
    """Names with commas between them."""
    return [name.strip() for name in text.split(",")] if text.strip() else []
