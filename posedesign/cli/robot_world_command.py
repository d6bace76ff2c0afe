"""The command for pose pairs: robot-world."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from posedesign.cli.output import (
    DONE,
    NOT_REACHED,
    Advance,
    note,
    progress,
    rehearsed_words,
    results_in,
    tell,
)
from posedesign.cli.plan_commands import AsJson, OutFolder, Overwrite, Verbose

if TYPE_CHECKING:
    from calib.robot_world import Noise, NoiseShown
    from posedesign.files import Results
    from posedesign.hand_eye.pairs import Pairs, SolverOutcome


DEFAULT_METHODS = "ml,ml-robust,papers"

CameraPlace = Literal["on-flange", "fixed"]
Inverted = Literal["none", "a", "b", "both"]
Naming = Literal["axzb", "opencv"]
NoiseSide = Literal["a", "b", "both", "seen", "shown"]

PairsFile = Annotated[
    Path | None,
    typer.Argument(
        help="Pairs A, B of A X = Z B. A table, each pose as x_mm y_mm z_mm or x_m y_m z_m "
        "with w_deg p_deg r_deg, qw qx qy qz, rx_rad ry_rad rz_rad (a rotation vector) or r11 "
        ".. r33, and a_ or b_ before each name, in capitals or not; matrices in MATLAB's .mat, "
        "NumPy's .npz or OpenCV's .xml, .yaml, .json; samples of MoveIt or easy_handeye."
    ),
]
FileA = Annotated[Path | None, typer.Option("--a", help="Or A in a file of its own,")]
FileB = Annotated[Path | None, typer.Option("--b", help="and B in another.")]
Columns = Annotated[
    str,
    typer.Option(
        help="Names of the columns where a table has no header line, say "
        "qw,qx,qy,qz,x_m,y_m,z_m; matrix16_mm: a matrix row by row, matrix12_mm: without its "
        "last row; -: to be passed over."
    ),
]
Variables = Annotated[
    str, typer.Option(help="Names of A and B in a file of matrices, say T_hand,T_cam.")
]
LengthUnit = Annotated[
    Literal["mm", "m"] | None, typer.Option(help="Unit of length in a file of matrices.")
]
CameraOption = Annotated[
    CameraPlace,
    typer.Option(
        help="Where it is. on-flange: A = T_base_flange, B = T_target_camera. fixed, with the "
        "target on the flange: A = T_base_flange, B = T_camera_target."
    ),
]
InvertOption = Annotated[
    Inverted,
    typer.Option(
        help="What the files have the other way round. OpenCV's gripper2base and target2cam "
        "with the camera on the flange: b."
    ),
]
ConventionOption = Annotated[
    Naming,
    typer.Option(
        help="opencv: A is world2cam and B is base2gripper, as calibrateRobotWorldHandEye takes "
        "them, in tables (a_, b_) or files of matrices; its base2world and gripper2cam are printed "
        "too. Where B is gripper2base: with --invert b."
    ),
]
MethodOption = Annotated[
    str,
    typer.Option(help="Methods, with commas between them; papers: those of the papers; all."),
]
NoiseDeg = Annotated[
    float | None,
    typer.Option(help="Standard deviation of rotations [deg]; default: from the residuals."),
]
NoiseMm = Annotated[
    float | None, typer.Option(help="Standard deviation of translations [mm], likewise.")
]
NoiseOnOption = Annotated[
    NoiseSide | None,
    typer.Option(
        help="Which side has it; default: b, and without sizes, for ml and ml-robust, what the "
        "residuals of 20 pairs or more show. b without sizes: that of B, the same in all "
        "directions. seen: the target as the camera sees it, as a camera's data sheet has it: with "
        "the camera on the flange, the inverse of B. shown: as the residuals show it for the "
        "standard deviations of all methods."
    ),
]
EstimateScale = Annotated[
    bool,
    typer.Option(
        "--estimate-scale",
        help="Estimate by what B's translations are to be multiplied, with X and Z, and correct "
        "them: where the size of the target, the unit or the focal length is not sure. Without it "
        "the scale is estimated, too, and said where it is not 1.",
    ),
]
Certify = Annotated[
    bool,
    typer.Option(
        "--certify",
        help="Prove that no other X and Z are likelier: needs the method ml, and noise on one "
        "side, the same in all directions: that of B where no sizes are given.",
    ),
]
Transforms = Annotated[
    bool,
    typer.Option(
        "--transforms",
        help="Write X and Z for other tools, too, where they are to be trusted: "
        "transforms.launch.xml (ROS 2), camera.launch (ROS 1), camera.urdf (a fixed joint), "
        "camera.calib (easy_handeye2), transforms.json (cv2.FileStorage).",
    ),
]
TrustLengths = Annotated[
    bool, typer.Option("--trust-units", help="Accept values that look like another unit.")
]


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command("robot-world")(robot_world)


def robot_world(
    pairs: PairsFile = None,
    a: FileA = None,
    b: FileB = None,
    columns: Columns = "",
    variables: Variables = "",
    unit: LengthUnit = None,
    camera: CameraOption = "on-flange",
    invert: InvertOption = "none",
    convention: ConventionOption = "axzb",
    method: MethodOption = DEFAULT_METHODS,
    noise_deg: NoiseDeg = None,
    noise_mm: NoiseMm = None,
    noise_on: NoiseOnOption = None,
    estimate_scale: EstimateScale = False,
    certify: Certify = False,
    out: OutFolder = Path(),
    transforms: Transforms = False,
    as_json: AsJson = False,
    verbose: Verbose = False,
    trust_units: TrustLengths = False,
    overwrite: Overwrite = False,
) -> int:
    """Solve A X = Z B: camera on flange and target in base, or the other way.

    By one method or by many, with standard deviations, what is left over pair by pair, and what
    each pair has left over when it is left out.
    """
    from posedesign.hand_eye.pairs import PairSource
    from posedesign.hand_eye.pairs.certificate import refuse_uncertifiable
    from posedesign.hand_eye.pairs.results import asked_noise, methods_of, reached
    from posedesign.hand_eye.pairs.tables import outcome_as_dict
    from posedesign.hand_eye.pairs.transforms import TRANSFORMS, claim_transforms, write_transforms
    from posedesign.report.pairs import answer_of_pairs

    source = PairSource(
        pairs,
        a,
        b,
        listed(columns),
        listed(variables),
        unit,
        invert,
        convention,
        trust_units,
        camera,
    )
    methods = methods_of(method)
    refuse_unfit_noise(methods, noise_deg, noise_mm, noise_on)
    if certify:
        # a proof is of one noise that is known beforehand, and of the answer by it
        noise_on = noise_on or "b"
        refuse_uncertifiable(methods, noise_on, camera)
    found = source.read()
    sizes = (
        None if noise_deg is None else math.radians(noise_deg),
        None if noise_mm is None else noise_mm / 1e3,
    )
    noise = asked_noise(found, camera, *sizes, noise_on)
    results = results_in(out, "robot-world", pairs, a, b, overwrite=overwrite)
    claims = claim_transforms(results) if transforms else []
    outcomes = _solved(
        found,
        results,
        methods,
        noise,
        estimate_scale=estimate_scale,
        certify=certify,
        quiet=as_json,
    )
    rehearsed = rehearsed_words(pairs, a, b)
    opencv = convention == "opencv"
    made = ("robot_world.csv", "robot_world_pairs.csv", "robot_world.png")
    files = [str(out / name) for name in made if (out / name).is_file()]
    trusted = outcomes[0].result if reached(outcomes) else None
    if claims and trusted is not None:
        write_transforms(claims, trusted, camera)
        files += [str(claim.path) for claim in claims]
    else:
        results.remove(*TRANSFORMS)
    inverted = invert in ("b", "both")
    answer = answer_of_pairs(outcomes, camera, found, files, opencv=opencv, inverted=inverted)
    content = [outcome_as_dict(found, one, camera, opencv=opencv) for one in outcomes]
    tell(answer, verbose=verbose, first=rehearsed, content=content if as_json else None)
    return DONE if reached(outcomes) else NOT_REACHED


def _solved(
    pairs: Pairs,
    out: Results,
    methods: Sequence[str],
    noise: Noise | NoiseShown | None,
    *,
    estimate_scale: bool,
    certify: bool,
    quiet: bool,
) -> tuple[SolverOutcome, ...]:
    """Outcomes of all methods, with proofs where they are asked for; says what a refusal needs."""
    from calib.errors import CalibError, InputError
    from posedesign.hand_eye.pairs.results import certified
    from posedesign.report.pairs import solve_and_draw

    shown: AbstractContextManager[Advance] = (
        nullcontext(lambda what, part: None) if quiet else progress("A X = Z B")
    )
    try:
        with shown as advance:
            outcomes = solve_and_draw(
                pairs, out, methods, noise, advance, estimate_scale=estimate_scale
            )
            return certified(pairs, outcomes) if certify else outcomes
    except CalibError as error:
        for text in pairs.notes:
            note(f"warning: {text}")
        if pairs.misread and isinstance(error, InputError) and error.name == "pairs":
            # the same finding, but by one who knows how the numbers were read
            raise InputError(pairs.misread, name="pairs") from error
        if pairs.misread:
            note(f"warning: {pairs.misread}")
        raise


def refuse_unfit_noise(
    methods: Sequence[str], noise_deg: float | None, noise_mm: float | None, noise_on: str | None
) -> None:
    """Both sizes of the noise, none below zero, or nothing of it."""
    from calib.errors import InputError
    from calib.robot_world import METHODS
    from posedesign.files import LEAST_POSITIVE, usable

    weighing = [name for name in methods if METHODS[name].likelihood]
    for option, value, unit in (("--noise-deg", noise_deg, "deg"), ("--noise-mm", noise_mm, "mm")):
        if value is None or usable(value) >= LEAST_POSITIVE:
            continue
        if value == 0.0 and not weighing:
            continue
        what = f"and {weighing[0]} weighs by it" if value == 0.0 else "no standard deviation"
        raise InputError(
            f"{option} is {value:g} {unit}, {what}",
            hint=f"give one above 0 {unit}, or leave the noise to the residuals",
            name=option,
            value=value,
            bound=0.0,
        )
    if noise_on == "shown":
        if noise_deg is not None or noise_mm is not None:
            raise InputError(
                "--noise-on shown finds the sizes itself: give no others", name="noise"
            )
        return
    if (noise_deg is None) != (noise_mm is None):
        raise InputError("give both --noise-deg and --noise-mm, or neither", name="noise")
    if noise_deg is None and noise_on not in (None, "b"):
        raise InputError(
            f"--noise-on {noise_on} needs --noise-deg and --noise-mm",
            hint="b and shown alone have their sizes from the residuals",
            name="noise",
        )


def listed(text: str) -> list[str]:
    """Names with commas between them."""
    return [name.strip() for name in text.split(",")] if text.strip() else []
