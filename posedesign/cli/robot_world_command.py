"""The command for pose pairs: robot-world."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from posedesign.cli.output import (
    DONE,
    NOT_REACHED,
    Advance,
    note,
    print_json,
    print_table,
    progress,
    results_in,
    say,
    say_rehearsed,
)
from posedesign.cli.plan_commands import AsJson, OutFolder, Overwrite
from posedesign.cli.robot_world_options import (
    DEFAULT_METHODS,
    CameraOption,
    CameraPlace,
    Certify,
    Columns,
    ConventionOption,
    EstimateScale,
    FileA,
    FileB,
    InvertOption,
    LengthUnit,
    MethodOption,
    NoiseDeg,
    NoiseMm,
    NoiseOnOption,
    NoiseSide,
    PairsFile,
    TrustLengths,
    Variables,
    listed,
    refuse_fixed_opencv,
    refuse_unfit_noise,
)
from posedesign.cli.robot_world_output import print_solvers

if TYPE_CHECKING:
    from calib.robot_world import Noise, NoiseShown
    from posedesign.files import Results
    from posedesign.pairs import Pairs, SolverOutcome
    from posedesign.pairs.results import NoiseOn


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
    as_json: AsJson = False,
    trust_units: TrustLengths = False,
    overwrite: Overwrite = False,
) -> int:
    """Solve A X = Z B: camera on flange and target in base, or the other way.

    By one method or by many, with standard deviations, what is left over pair by pair, and what
    each pair has left over when it is left out.
    """
    from posedesign.pairs import PairSource
    from posedesign.pairs.certificate import refuse_uncertifiable
    from posedesign.pairs.results import methods_of, reached
    from posedesign.pairs.tables import outcome_as_dict

    refuse_fixed_opencv(camera, convention)
    source = PairSource(
        pairs, a, b, listed(columns), listed(variables), unit, invert, convention, trust_units
    )
    methods = methods_of(method)
    refuse_unfit_noise(methods, noise_deg, noise_mm, noise_on)
    if certify:
        # a proof is of one noise that is known beforehand, and of the answer by it
        noise_on = noise_on or "b"
        refuse_uncertifiable(methods, noise_on, camera)
    found = source.read()
    noise = asked_noise(found, camera, noise_deg, noise_mm, noise_on)
    results = results_in(out, "robot-world", pairs, a, b, overwrite=overwrite)
    outcomes = _solved(
        found,
        results,
        methods,
        noise,
        estimate_scale=estimate_scale,
        certify=certify,
        quiet=as_json,
    )
    say_rehearsed(pairs, a, b, as_json=as_json)
    opencv = convention == "opencv"
    if as_json:
        print_json([outcome_as_dict(found, one, camera, opencv=opencv) for one in outcomes])
    else:
        _print_answers(outcomes, camera, out, opencv=opencv, inverted=invert in ("b", "both"))
    _warn_of(found, outcomes)
    return DONE if reached(outcomes) else NOT_REACHED


def asked_noise(
    pairs: Pairs,
    camera: CameraPlace,
    noise_deg: float | None,
    noise_mm: float | None,
    noise_on: NoiseSide | None,
) -> Noise | NoiseShown | None:
    """The noise of the options, or how it is to be estimated, if they say any."""
    import math

    from posedesign.pairs.results import noise_of

    if noise_on == "shown":
        return "shown"
    if noise_deg is None or noise_mm is None:
        return "B" if noise_on == "b" else None
    sides: dict[str, NoiseOn] = {"a": "A", "b": "B", "both": "both", "seen": "seen"}
    side = sides[noise_on or "b"]
    return noise_of(pairs, camera, math.radians(noise_deg), noise_mm / 1e3, side)


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
    from posedesign.pairs.results import certified
    from posedesign.workflow import solve_and_write

    shown: AbstractContextManager[Advance] = (
        nullcontext(_say_nothing) if quiet else progress("A X = Z B")
    )
    try:
        with shown as advance:
            outcomes = solve_and_write(
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


def _say_nothing(what: str, part: float) -> None:
    """Progress that nobody sees."""


def _print_answers(
    outcomes: Sequence[SolverOutcome],
    camera: CameraPlace,
    out: Path,
    *,
    opencv: bool,
    inverted: bool,
) -> None:
    """Tables, and where the rest was written."""
    from posedesign.pairs import FRAMES
    from posedesign.pairs.tables import opencv_rows

    print_solvers(outcomes, camera)
    if opencv:
        print_table("In OpenCV's names", opencv_rows(outcomes))
    elif not inverted:
        say(FRAMES[camera].other_way)
    say(f"wrote {out / 'robot_world.csv'} and {out / 'robot_world_pairs.csv'}")


def _warn_of(pairs: Pairs, outcomes: Sequence[SolverOutcome]) -> None:
    """What is odd about the pairs and the answers, on standard error."""
    from posedesign.pairs.results import warnings_of

    misread = [pairs.misread] if pairs.misread else []
    for text in (*pairs.notes, *misread, *warnings_of(outcomes, misread=bool(misread))):
        note(f"warning: {text}")
