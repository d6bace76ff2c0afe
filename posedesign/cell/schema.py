"""What may stand in a ``cell.toml``: every key, its unit, its default and its bounds.

Millimetres and degrees, because people write this file. :mod:`posedesign.cell` turns it into the
objects that the planner works on.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import BeforeValidator, Field, StrictBool, ValidationError, model_validator

from calib.errors import FileFormatError, near_names
from posedesign.cell.schema_sections import (
    BoxSteps,
    Finite,
    ImagingSection,
    KnownDistanceSection,
    Line,
    Name,
    Noise,
    NoiseSection,
    NoiseVector,
    NotNegative,
    ParameterSection,
    PayloadSection,
    PerJoint,
    Pixels,
    Positive,
    Section,
    Seed,
    Size,
    Step,
    TargetSection,
    TouchUpSection,
    VariationVector,
    Vector,
)
from posedesign.files import read_bytes_bounded

LARGEST_CELL_BYTES = 1_000_000

_SHAPE_KEYS: dict[str, tuple[str, ...]] = {
    "box": ("size_mm",),
    "cylinder": ("radius_mm", "height_mm"),
    "sphere": ("radius_mm",),
    "half-space": (),
    "mesh": ("mesh",),
}
"""What each kind of solid is described by."""

_IN_WORDS = {
    "tuple_type": "should be a list in [ ]",
    "too_long": "has too many values",
    "model_type": "should be a table of keys",
    "string_pattern_mismatch": "has characters that are not allowed here, or in another order",
}
"""Pydantic's words for programmers, in words for people who write the file."""


_PLAN_OF_CAMERA_POSES = {"condition_threshold": 50.0, "dwell_s": 2.0}
"""Defaults where a camera sees a target: C_G of X and Z is below a thousand with any poses, and a
picture takes the time in which the arm comes to rest."""


class CoupledLimitSection(Section):
    """A bound on a sum of joint values, each times its coefficient."""

    name: Name
    coefficients: tuple[Finite, ...]
    lower_deg: Finite
    upper_deg: Finite

    @model_validator(mode="after")
    def _has_a_range(self) -> CoupledLimitSection:
        if not self.lower_deg < self.upper_deg:
            raise ValueError(
                f"lower_deg {self.lower_deg:g} is not below upper_deg {self.upper_deg:g}"
            )
        if not any(self.coefficients):
            raise ValueError("coefficients are all zero")
        return self


class RobotSection(Section):
    """Which arm: a preset or a URDF file, and what its links are like where the URDF says nothing.

    ``packages``: folders to search for packages that a URDF names; ``xacro_args``: arguments of a
    xacro file, each NAME:=VALUE. ``shapes`` names a preset of the same kinematics;
    ``capsule_radius_mm``, one radius or one a link, makes capsules along the chain
    (:mod:`calib.robots.arm_shapes`).
    """

    preset: Line | None = None
    urdf: Line | None = None
    base: Line | None = None
    tip: Line | None = None
    controller: Line | None = None
    lock: tuple[Line, ...] = ()
    packages: tuple[Line, ...] = ()
    xacro_args: tuple[Line, ...] = ()
    shapes: Line | None = None
    capsule_radius_mm: Size | tuple[Size, ...] | None = None
    keep_coupled_limits: StrictBool = True
    coupled_limit: tuple[CoupledLimitSection, ...] = ()

    @model_validator(mode="after")
    def _one_source(self) -> RobotSection:
        if (self.preset is None) == (self.urdf is None):
            raise ValueError("give either preset or urdf")
        if self.preset is not None and self.lock:
            raise ValueError("joints can be locked in a urdf only, not in a preset")
        if self.preset is not None and (self.packages or self.xacro_args):
            raise ValueError("packages and xacro_args are of a urdf, not of a preset")
        if self.preset is not None and (self.shapes or self.capsule_radius_mm):
            raise ValueError("a preset has its shapes: shapes and capsule_radius_mm are for a urdf")
        return self


class SolidSection(Section):
    """Something solid: its shape, and where its centre is."""

    name: Name
    kind: Literal["box", "cylinder", "sphere", "half-space", "mesh"] = "box"
    at_mm: Vector = (0.0, 0.0, 0.0)
    wpr_deg: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)
    size_mm: tuple[Size, Size, Size] | None = None
    radius_mm: Size | None = None
    height_mm: Size | None = None
    mesh: Line | None = None
    scale: Size = 1.0

    @model_validator(mode="after")
    def _has_what_it_needs(self) -> SolidSection:
        needed = _SHAPE_KEYS[self.kind]
        for key in ("size_mm", "radius_mm", "height_mm", "mesh"):
            if (getattr(self, key) is None) == (key in needed):
                verb = "needs" if key in needed else "has no"
                raise ValueError(f"a {self.kind} {verb} {key}")
        return self


class ToolSection(Section):
    """The tool point (virtual pin tip) in the tip frame, and what the flange carries."""

    point_mm: Vector
    mass_kg: NotNegative = 0.0
    com_mm: Vector = (0.0, 0.0, 0.0)
    axis: Vector = (0.0, 0.0, 1.0)
    camera_stand_off_mm: NotNegative = 350.0
    body: tuple[SolidSection, ...] = ()

    @model_validator(mode="after")
    def _is_finite(self) -> ToolSection:
        if not any(self.axis):
            raise ValueError("axis has no length: the tool comes to the target along it")
        for body in self.body:
            if body.kind == "half-space":
                raise ValueError(f"{body.name}: a tool cannot be a half-space")
        return self


class CameraSection(Section):
    """What the camera on the tool sees; without this section no pose is refused for its view."""

    position_mm: Vector | None = None
    wpr_deg: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)
    image_px: tuple[Pixels, Pixels] = (1280, 1024)
    focal_px: Annotated[float, Field(strict=True, gt=0, le=1e6)] = 1800.0
    border_px: NotNegative = 30.0
    largest_tilt_deg: Annotated[float, Field(strict=True, gt=0, lt=90)] = 70.0
    nearest_mm: NotNegative = 100.0
    farthest_mm: NotNegative = 1000.0

    @model_validator(mode="after")
    def _has_room(self) -> CameraSection:
        if not self.nearest_mm < self.farthest_mm:
            raise ValueError(
                f"nearest_mm {self.nearest_mm:g} is not below farthest_mm {self.farthest_mm:g}"
            )
        if 2 * self.border_px >= min(self.image_px):
            raise ValueError(f"border_px {self.border_px:g} leaves nothing of the image")
        return self


class BasePoseSection(Section):
    """The posture with the tool point on the target that poses are varied around."""

    posture_deg: tuple[Finite, ...]


class VariationSection(Section):
    """D_W, D_P, D_R of Eq. 13: where they start, how they grow, how far they may go."""

    start_deg: VariationVector = (5.0, 5.0, 5.0)
    step_deg: tuple[Step, Step, Step] = (5.0, 5.0, 5.0)
    largest_deg: VariationVector = (60.0, 60.0, 60.0)
    raise_: Annotated[Literal["together", "best"], Field(alias="raise")] = "together"

    @model_validator(mode="after")
    def _starts_inside(self) -> VariationSection:
        for start, largest in zip(self.start_deg, self.largest_deg, strict=True):
            if start > largest:
                raise ValueError(f"start_deg {start:g} is above largest_deg {largest:g}")
        if not any(self.largest_deg):
            raise ValueError("at least one angle of largest_deg must be above zero")
        return self


class PlanSection(Section):
    """When the loop has done enough, how poses are replaced that cannot be reached, and the round.

    ``approach_deg``: the lost motion of a reducer is about one arc minute, and a touch-up moves the
    joints by up to half a degree from where they were sent (5 mm at 0.6 m): one degree is beyond
    both, so that the side stays the same. ``dwell_s``: one visual touch-up took Watanabe et al.
    2006 about 20 s (section 4, Table 2), the arm's settling included; of it and of
    ``condition_threshold`` a camera-pose has defaults of its own. ``contact_mm``: an arm that is
    not calibrated misses a planned pose by some millimetres. ``stop_short_mm``: programs go to
    touch-ups from no farther off than positions are imported.
    """

    condition_threshold: Positive = 1.0e5
    limit_margin_deg: NotNegative = 1.0
    repair: StrictBool = True
    repair_margin_deg: NotNegative = 2.0
    repair_tilt_deg: Annotated[float, Field(strict=True, gt=0, le=180)] = 60.0
    repair_base_joint_deg: Annotated[float, Field(strict=True, gt=0, le=360)] = 90.0
    return_to_base: StrictBool = True
    approach: Literal["none", "same-side"] = "none"
    approach_deg: Annotated[float, Field(strict=True, ge=0.01, le=30)] = 1.0
    dwell_s: NotNegative = 20.0
    retreat_mm: NotNegative = 0.0
    contact_mm: Positive = 5.0
    stop_short_mm: Annotated[float, Field(strict=True, ge=0, le=40)] = 0.0

    @model_validator(mode="after")
    def _backs_off_far_enough(self) -> PlanSection:
        if self.retreat_mm and self.retreat_mm <= self.contact_mm:
            raise ValueError(
                f"retreat_mm {self.retreat_mm:g} is not above contact_mm {self.contact_mm:g}"
            )
        if self.stop_short_mm and self.retreat_mm <= self.stop_short_mm:
            raise ValueError(
                f"stop_short_mm {self.stop_short_mm:g} is not below retreat_mm "
                f"{self.retreat_mm:g}: a program stops short on the way in from there"
            )
        if self.retreat_mm and self.approach == "same-side":
            raise ValueError(
                "retreat_mm brings the tool to the target along its own axis, and then not all "
                'joints come from one side: set approach = "none", or retreat_mm = 0'
            )
        return self


class ConstraintSection(Section):
    """What a pose must keep besides the joint limits of ``[plan]``."""

    collisions: StrictBool = True
    safety_distance_mm: NotNegative = 20.0
    ways: StrictBool = True
    ignore: tuple[tuple[Line, Line], ...] = ()
    smallest_singular_value: Annotated[float, Field(strict=True, ge=0, lt=1)] = 0.0
    largest_travel_deg: Annotated[float, Field(strict=True, ge=1, le=1e4)] | None = None
    workspace_lowest_mm: Vector | None = None
    workspace_highest_mm: Vector | None = None

    @model_validator(mode="after")
    def _whole_box(self) -> ConstraintSection:
        low, high = self.workspace_lowest_mm, self.workspace_highest_mm
        if (low is None) != (high is None):
            raise ValueError("give both workspace_lowest_mm and workspace_highest_mm")
        if low is not None and high is not None:
            for axis, a, b in zip("xyz", low, high, strict=True):
                if a >= b:
                    raise ValueError(f"the workspace is empty along {axis}: {a:g} to {b:g}")
        return self


class MeasurementSection(Section):
    """How it is measured, and how well: touch-ups, or poses of a target that a camera sees.

    The noise of touch-ups is along x, y, z of the tip, or of the camera as it is mounted there.
    """

    kind: Literal["touch-up", "view-line", "camera-pose"] = "touch-up"
    three_sigma_mm: NoiseVector = (0.02, 0.02, 0.12)
    noise_axes: Literal["tip", "camera"] = "tip"
    weighted: StrictBool = True
    estimate_noise: StrictBool = False
    camera_three_sigma_deg: Noise = 0.06
    camera_three_sigma_mm: Noise = 0.3

    @model_validator(mode="after")
    def _has_a_common_unit(self) -> MeasurementSection:
        if self.kind == "camera-pose" and not self.weighted:
            raise ValueError(
                "a camera-pose is weighted by its noise: mm and deg have no common unit"
            )
        return self


class TruthSection(Section):
    """The robot that is simulated: nothing but the simulation looks at this.

    ``link_error_mm`` and ``link_error_deg`` are standard deviations of what each link is off,
    along and about its axes. ``backlash_deg`` is one arc minute (0.017) at most on reducers in good
    order; ``friction_nm``, where not given, winds a reducer up by a fifth of that; ``scatter_deg``
    is how well a joint stops where it stopped before, from the same side.
    """

    seed: Seed = 1
    zero_offsets_deg: tuple[Finite, ...] | None = None
    tool_error_mm: Vector = (2.0, -1.0, 3.0)
    target_error_mm: Vector = (5.0, -4.0, 2.0)
    deflection: StrictBool | None = None
    stiffness_nm_per_rad: tuple[Positive, ...] | None = None
    link_error_mm: NotNegative = 0.0
    link_error_deg: NotNegative = 0.0
    camera_error_deg: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)
    target_turn_deg: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)
    backlash_deg: PerJoint = 0.005
    friction_nm: PerJoint | None = None
    scatter_deg: PerJoint = 1.2e-4
    imaging: ImagingSection = ImagingSection()


class FrameSection(Section):
    """A frame by its place and its turns W P R about fixed x, y and z."""

    at_mm: Vector = (0.0, 0.0, 0.0)
    wpr_deg: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)


def _argument(value: object) -> object:
    """What a measuring program is called with, in words or as a number."""
    whole = isinstance(value, int) and not isinstance(value, bool)
    if not whole and value not in ("number", "none"):
        raise ValueError('a whole number, "number" or "none"')
    return value


class ProgramSection(Section):
    """The robot program.

    ``tool`` is the controller's tool frame in the tip frame, by default the tool point in the axes
    of the tip; ``user`` the user frame in the controller's world. Only Cartesian positions need
    them.
    """

    name: str = "CALIB01"
    form: Literal["joint", "cartesian"] = "joint"
    user_frame: Annotated[int, Field(strict=True, ge=0, le=99)] = 0
    tool_frame: Annotated[int, Field(strict=True, ge=0, le=99)] = 1
    tool: FrameSection | None = None
    user: FrameSection | None = None
    speed_percent: Annotated[int, Field(strict=True, ge=1, le=100)] = 10
    settle_s: NotNegative = 1.0
    measure_call: str | None = "MEASURE"
    measure_argument: Annotated[int | str, BeforeValidator(_argument)] = "number"
    measure_output: Annotated[int, Field(strict=True, ge=1, le=4096)] | None = None
    measure_pulse_s: NotNegative = 0.5
    keep: Literal["position", "register"] = "position"
    first_register: Annotated[int, Field(strict=True, ge=1, le=32767)] = 1
    pulses_per_deg: tuple[Finite, ...] = ()


class PoolSection(Section):
    """What poses are chosen from, where they are chosen and not varied."""

    kind: Literal["auto", "cone", "wpr", "joints"] = "auto"
    tilt_deg: Annotated[float, Field(strict=True, gt=0, le=180)] = 45.0
    candidates: Annotated[int, Field(strict=True, ge=1, le=100_000)] = 1500
    configurations: Literal["nearest", "front", "all"] = "front"
    smallest_singular_value: Annotated[float, Field(strict=True, ge=0, lt=1)] = 0.03
    seed: Seed = 0


class TaskBoxSection(Section):
    """Where the arm works: a box in base axes, over which its accuracy is predicted."""

    lowest_mm: Vector
    highest_mm: Vector
    steps: tuple[BoxSteps, BoxSteps, BoxSteps] = (3, 3, 3)

    @model_validator(mode="after")
    def _right_way_up(self) -> TaskBoxSection:
        for axis, low, high in zip("xyz", self.lowest_mm, self.highest_mm, strict=True):
            if low > high:
                raise ValueError(f"the box is upside down along {axis}: {low:g} is above {high:g}")
        return self


class CellConfig(Section):
    """A whole ``cell.toml``."""

    robot: RobotSection
    tool: ToolSection
    base_pose: BasePoseSection
    target: TargetSection = TargetSection()
    camera: CameraSection | None = None
    obstacle: tuple[SolidSection, ...] = ()
    constraints: ConstraintSection = ConstraintSection()
    variations: VariationSection = VariationSection()
    plan: PlanSection = PlanSection()
    pool: PoolSection = PoolSection()
    parameters: ParameterSection = ParameterSection()
    measurement: MeasurementSection = MeasurementSection()
    touch_up: TouchUpSection = TouchUpSection()
    noise: tuple[NoiseSection, ...] = ()
    payload: tuple[PayloadSection, ...] = ()
    known_distance: tuple[KnownDistanceSection, ...] = ()
    truth: TruthSection = TruthSection()
    program: ProgramSection = ProgramSection()
    task_box: TaskBoxSection | None = None

    @model_validator(mode="before")
    @classmethod
    def _plan_follows_the_measurement(cls, raw: Any) -> Any:
        if not isinstance(raw, dict):
            return raw
        measurement, plan = raw.get("measurement", {}), raw.get("plan", {})
        if not (isinstance(measurement, dict) and isinstance(plan, dict)):
            return raw
        by_camera = measurement.get("kind") == "camera-pose"
        return {**raw, "plan": {**_PLAN_OF_CAMERA_POSES, **plan}} if by_camera else raw

    @model_validator(mode="after")
    def _names_differ(self) -> CellConfig:
        names = [solid.name for solid in (*self.tool.body, *self.obstacle)]
        double = next((name for name in names if names.count(name) > 1), None)
        if double is not None:
            raise ValueError(f"two solids have the name {double!r}")
        for listed, what in (
            ([p.name for p in self.payload], "payloads have the name"),
            ([str(n.kind) for n in self.noise], "noises are of the kind"),
        ):
            double = next((name for name in listed if listed.count(name) > 1), None)
            if double is not None:
                raise ValueError(f"two {what} {double!r}")
        return self


def read_config(path: Path) -> CellConfig:
    """Read and check a ``cell.toml``.

    Raises
    ------
    FileFormatError
        The file is missing, no TOML, or a key in it is unknown, missing or out of bounds.
    """
    try:
        data = read_bytes_bounded(path, most_bytes=LARGEST_CELL_BYTES)
    except FileFormatError as error:
        error.hint = "make one with: posedesign new > cell.toml"
        raise
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError("is not UTF-8 text", path=path, hint="save it as UTF-8") from error
    return parse_text(text, path)


def parse_text(text: str, path: Path) -> CellConfig:
    """Check the text of a ``cell.toml``; ``path`` is named in errors."""
    try:
        raw = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # numbers too long, brackets nested too deep
        raise FileFormatError(
            f"is no valid TOML: {error}",
            path=path,
            hint="the cell, a .toml, comes first" if path.suffix != ".toml" else "mend the line",
        ) from error
    return parse_config(raw, path)


def parse_config(raw: dict[str, Any], path: Path) -> CellConfig:
    """Check the content of a ``cell.toml``; ``path`` is named in errors."""
    try:
        return CellConfig.model_validate(raw)
    except ValidationError as error:
        found = error.errors()
        # a mistyped name often makes another one missing: say the mistyped one
        first = next((e for e in found if e["type"] == "extra_forbidden"), found[0])
        key = ".".join(str(part) for part in first["loc"])
        raise FileFormatError(
            _reason(first),
            path=path,
            key=key or None,
            hint=_hint(first),
            value=first.get("input"),
        ) from error


def _reason(error: Any) -> str:
    kind, given = error["type"], error.get("input")
    if kind == "extra_forbidden":
        return "there is no such key"
    if kind == "missing":
        return "is missing"
    text = _IN_WORDS.get(kind) or error["msg"].removeprefix("Value error, ")
    shown = f", not {given!r:.60}" if isinstance(given, (int, float, str, bool)) else ""
    return f"{text[0].lower()}{text[1:]}{shown}"


def _hint(error: Any) -> str:
    where = [part for part in error["loc"] if isinstance(part, str)]
    if error["type"] == "extra_forbidden":
        section: Any = CellConfig
        for part in where[:-1]:
            section = _section_in(section.model_fields[part].annotation)
        known = [field.alias or name for name, field in section.model_fields.items()]
        return near_names(where[-1], known)
    return "posedesign new prints a commented example"


def _section_in(annotation: Any) -> Any:
    """The section that an annotation names, by itself, optional, or in a list."""
    options = [annotation, *get_args(annotation)]
    return next(o for o in options if isinstance(o, type) and issubclass(o, Section))
