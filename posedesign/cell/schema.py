"""What may stand in a ``cell.toml``: every key, its unit, its default and its bounds.

Millimetres and degrees, because people write this file. :mod:`posedesign.cell` turns it into the
objects that the planner works on.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, StrictBool, model_validator

from posedesign.cell.schema_sections import (
    BoardSection,
    BoxSteps,
    Finite,
    ImagingSection,
    InstrumentSection,
    KindOrBoard,
    KnownDistanceSection,
    LimitSection,
    Line,
    MarkSection,
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
from posedesign.files.program_numbers import (
    ARGUMENT,
    FRAME,
    OUTPUT,
    REGISTER,
    SECONDS,
    SPEED_PERCENT,
)

_SHAPE_KEYS: dict[str, tuple[str, ...]] = {
    "box": ("size_mm",),
    "cylinder": ("radius_mm", "height_mm"),
    "sphere": ("radius_mm",),
    "half-space": (),
    "mesh": ("mesh",),
    "scene": ("scene",),
}
"""What each kind of solid is described by."""

_PLAN_OF_KIND = {
    "camera-pose": {"condition_threshold": 50.0, "dwell_s": 2.0},
    "board": {"condition_threshold": 100.0, "dwell_s": 2.0},
    **{kind: {"dwell_s": 5.0} for kind in ("point", "pose", "distance")},
}
"""Defaults where a camera sees a target: C_G of X and Z is below a thousand with any poses, and a
picture takes the time in which the arm comes to rest. A tracker takes the mean of some seconds."""


class CoupledLimitSection(Section):
    """A bound on a sum of joint values, each times its coefficient."""

    name: Name
    """What the limit is called in answers."""
    coefficients: tuple[Finite, ...]
    """One for each joint, from the base; the sum of coefficient times joint value is bounded."""
    lower_deg: Finite
    """Least value of the sum."""
    upper_deg: Finite
    """Largest value of the sum."""

    @model_validator(mode="after")
    def _has_a_range(self) -> CoupledLimitSection:
        if not self.lower_deg < self.upper_deg:
            raise ValueError(
                f"lower_deg {self.lower_deg:g} is not below upper_deg {self.upper_deg:g}"
            )
        if not any(self.coefficients):
            raise ValueError("coefficients are all zero")
        return self


class CouplingSection(Section):
    """A joint that the controller shows with a part of another: of arms with a parallel linkage."""

    joint: Line
    """Its name in the description."""
    of: Line
    """The other joint: joint 2 for joint 3."""
    ratio: Annotated[float, Field(strict=True, ge=-100, le=100)]
    """Part of the other that is added, both in the signs of the controller: 1 for an IRB 4400, -1
    is what every FANUC has, 0 is none."""


class RobotSection(Section):
    """Which arm: a preset or a URDF file, and the shapes of its links where the URDF has none."""

    preset: Line | None = None
    """Name of an arm that comes with the tool (``posedesign robots``); or ``urdf``."""
    urdf: Line | None = None
    """Path of a URDF or xacro file, from the folder of the cell; or ``preset``."""
    base: Line | None = None
    """Link that positions are given in; the root by default. On another branch than the tip it is
    carried by a positioner, whose joints come first."""
    tip: Line | None = None
    """Link at the end of the chain, which carries the tool; the last one by default."""
    srdf: Line | None = None
    """Path of an SRDF file, as MoveIt has it: links that may touch, and what the next two name."""
    group: Line | None = None
    """Group of the SRDF that is a chain, for ``base`` and ``tip`` where they are not given."""
    held_states: tuple[Line, ...] = ()
    """Named states of the SRDF in which joints beside the arm are held."""
    controller: Line | None = None
    """Maker of the controller: what the pendant shows, and the language of programs."""
    lock: tuple[Line, ...] = ()
    """Joints of a URDF that are held at zero."""
    held_deg: dict[Line, Finite] = Field(default_factory=dict)
    """Joints of a URDF that are held at other angles, by their names."""
    held_mm: dict[Line, Finite] = Field(default_factory=dict)
    """The same of joints that slide: a lift, a finger."""
    packages: tuple[Line, ...] = ()
    """Folders to search for packages that a URDF names."""
    xacro_args: tuple[Line, ...] = ()
    """Arguments of a xacro file, each NAME:=VALUE."""
    shapes: Line | None = None
    """Preset of the same kinematics whose shapes a URDF without shapes takes."""
    capsule_radius_mm: Size | tuple[Size, ...] | None = None
    """Radius of capsules from joint to joint, for links without a shape; one number, or one for
    each link."""
    keep_coupled_limits: StrictBool = True
    """Keep the limits that joints of the preset have together, as FANUC's J2 and J3."""
    coupled_limit: tuple[CoupledLimitSection, ...] = ()
    coupling: tuple[CouplingSection, ...] = ()

    @model_validator(mode="after")
    def _one_source(self) -> RobotSection:
        if (self.preset is None) == (self.urdf is None):
            raise ValueError("give either preset or urdf")
        if (self.group is not None or self.held_states) and self.srdf is None:
            raise ValueError("group and held_states are of an SRDF: give srdf, too")
        if self.preset is not None and (
            self.lock or self.held_deg or self.held_mm or self.held_states
        ):
            raise ValueError("joints can be locked in a urdf only, not in a preset")
        if self.preset is not None and (self.packages or self.xacro_args):
            raise ValueError("packages and xacro_args are of a urdf, not of a preset")
        if self.preset is not None and (self.shapes or self.capsule_radius_mm):
            raise ValueError("a preset has its shapes: shapes and capsule_radius_mm are for a urdf")
        return self


class SolidSection(Section):
    """Something solid: its shape, and where its centre is."""

    name: Name
    """What it is called in answers, and in ``constraints.ignore``."""
    kind: Literal["box", "cylinder", "sphere", "half-space", "mesh", "scene"] = "box"
    """Its shape. A half-space is everything below ``at_mm``, and a scene all objects of a MoveIt
    scene: both for obstacles only."""
    at_mm: Vector = (0.0, 0.0, 0.0)
    """Its centre: in the axes of the tip for the tool, in the base frame for an obstacle; behind a
    positioner as ``stands_on`` says."""
    wpr_deg: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)
    """Its orientation: W, P, R about fixed x, y and z."""
    size_mm: tuple[Size, Size, Size] | None = None
    """Lengths of a box along its x, y and z."""
    radius_mm: Size | None = None
    """Radius of a cylinder or a sphere."""
    height_mm: Size | None = None
    """Height of a cylinder, along its z."""
    mesh: Line | None = None
    """File of a mesh: .stl, .obj, .ply or .dae."""
    scene: Line | None = None
    """File of a MoveIt scene: .scene. ``at_mm`` and ``wpr_deg`` put it in the frame of the root
    link of the description."""
    scale: Size = 1.0
    """Factor that turns the unit of the mesh into mm."""
    stands_on: Literal["floor", "positioner"] | None = None
    """For obstacles where a positioner carries the base: ``floor``, and its place is in the root
    link of the description; ``positioner``, and it turns with the base, in the frame of which its
    place is."""

    @model_validator(mode="after")
    def _has_what_it_needs(self) -> SolidSection:
        needed = _SHAPE_KEYS[self.kind]
        for key in ("size_mm", "radius_mm", "height_mm", "mesh", "scene"):
            if (getattr(self, key) is None) == (key in needed):
                verb = "needs" if key in needed else "has no"
                raise ValueError(f"a {self.kind} {verb} {key}")
        return self


class ToolSection(Section):
    """The tool point (virtual pin tip) in the tip frame, and what the flange carries."""

    point_mm: Vector
    """The point that is brought to the target, in the axes of the tip: a pin, a ball, or the
    camera's virtual pin tip. It is identified, too."""
    mass_kg: NotNegative = 0.0
    """Mass that the flange carries, for the deflection under gravity."""
    com_mm: Vector = (0.0, 0.0, 0.0)
    """Its centre of mass, in the axes of the tip."""
    axis: Vector = (0.0, 0.0, 1.0)
    """Direction in which the tool comes to the target, in the axes of the tip; for
    ``plan.retreat_mm``."""
    camera_stand_off_mm: NotNegative = 350.0
    """Distance of the lens behind the tool point, along z of the tip, where ``camera.position_mm``
    is not given."""
    body: tuple[SolidSection, ...] = ()
    mark: tuple[MarkSection, ...] = ()
    """Points that are measured in place of the tool point: all at once by an instrument, one or the
    other by touch."""

    @model_validator(mode="after")
    def _is_finite(self) -> ToolSection:
        if not any(self.axis):
            raise ValueError("axis has no length: the tool comes to the target along it")
        for body in self.body:
            if body.stands_on is not None:
                raise ValueError(f"{body.name}: stands_on is for obstacles")
            if body.kind in ("half-space", "scene"):
                raise ValueError(f"{body.name}: a tool cannot be a {body.kind}")
        return self


Mount = Literal["flange", "fixed"]
"""What a camera is on."""


class CameraSection(Section):
    """What the camera sees; without this section no pose is refused for its view."""

    mount: Mount = "flange"
    """``fixed``: the camera stands around the arm, and the board of a ``board`` is on the flange,
    its middle at the tool point; ``position_mm`` and ``wpr_deg`` are in the base frame."""
    position_mm: Vector | None = None
    """The lens in the axes of the tip; by default behind the tool point by the stand-off. Of a
    fixed camera by default in front of the board by the stand-off, at the base pose."""
    wpr_deg: tuple[Finite, Finite, Finite] | None = None
    """Orientation of the camera in the axes of the tip, its z along the line of sight; by default
    that of the tip. Of a fixed camera by default towards the board at the base pose, which it sees
    upright."""
    image_px: tuple[Pixels, Pixels] = (1280, 1024)
    """Width and height of the image."""
    focal_px: Annotated[float, Field(strict=True, gt=0, le=1e6)] = 1800.0
    """Focal length."""
    lens: Literal["pinhole", "rational", "fisheye"] = "pinhole"
    """Distortion of the lens, for a ``board``: OpenCV's five terms, its eight, or its fisheye."""
    distortion: tuple[Finite, ...] = ()
    """These terms, as far as they are known; the others are zero."""
    border_px: NotNegative = 30.0
    """Margin kept between the target and the edge of the image."""
    share_in_view: Annotated[float, Field(strict=True, gt=0, le=1)] = 0.6
    """Least share of the points of a board that is in the image; of chessboards, grids of
    circles and round targets, which are found whole or not at all, it is 1."""
    largest_tilt_deg: Annotated[float, Field(strict=True, gt=0, lt=90)] = 70.0
    """Largest angle between the target's normal and the line of sight."""
    nearest_mm: NotNegative = 100.0
    """Least distance of the target from the lens."""
    farthest_mm: NotNegative = 1000.0
    """Largest distance of the target from the lens."""

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

    posture_deg: tuple[Finite, ...] = ()
    """Values of the arm's joints that turn at the base pose, from the base on, in the signs of the
    description."""
    slides_mm: tuple[Finite, ...] = ()
    """The same of what slides: what carries the arm, then joints of the arm itself."""
    positioner_deg: tuple[Finite, ...] = ()
    """The same of a positioner that carries the base, from its foot on: tilt, turn."""
    state: Line | None = None
    """In its place the name of a group state in ``robot.srdf``."""

    @model_validator(mode="after")
    def _is_one_posture(self) -> BasePoseSection:
        if bool(self.posture_deg or self.slides_mm) == (self.state is not None):
            raise ValueError("give either posture_deg or state")
        return self


class VariationSection(Section):
    """D_W, D_P, D_R of Eq. 13: where they start, how they grow, how far they may go."""

    start_deg: VariationVector = (5.0, 5.0, 5.0)
    """D of W, P and R in the first round: the 27 poses have -D, 0 and +D of each."""
    step_deg: tuple[Step, Step, Step] = (5.0, 5.0, 5.0)
    """What D is raised by in a round."""
    largest_deg: VariationVector = (60.0, 60.0, 60.0)
    """Largest D; 0 holds an angle."""
    raise_: Annotated[Literal["together", "best"], Field(alias="raise")] = "together"
    """Raise all angles in each round, or only the one that lowers C_G most."""

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
    ``condition_threshold`` a camera-pose and a board have defaults of their own. ``contact_mm``: an
    arm that is not calibrated misses a planned pose by some millimetres. ``stop_short_mm``:
    programs go to touch-ups from no farther off than positions are imported.
    """

    condition_threshold: Positive = 1.0e5
    """C_G below which the loop stops; 50 for a camera-pose, 100 for a board."""
    limit_margin_deg: NotNegative = 1.0
    """Margin kept from every joint limit."""
    slide_margin_mm: NotNegative = 10.0
    """The same of what slides and carries the arm: its zero on the controller is not known."""
    repair: StrictBool = True
    """Replace poses that cannot be reached, or that break a constraint."""
    repair_margin_deg: NotNegative = 2.0
    """Margin that replacements keep from joint limits."""
    repair_tilt_deg: Annotated[float, Field(strict=True, gt=0, le=180)] = 60.0
    """Largest tilt of a replacement against the base pose."""
    repair_base_joint_deg: Annotated[float, Field(strict=True, gt=0, le=360)] = 90.0
    """Largest turn of joint 1 in a replacement."""
    return_to_base: StrictBool = True
    """End the tour at the base posture."""
    approach: Literal["none", "same-side"] = "none"
    """``same-side``: all joints arrive at all poses from one side, for arms with backlash."""
    approach_deg: Annotated[float, Field(strict=True, ge=0.01, le=30)] = 1.0
    """Last movement of ``same-side``."""
    dwell_s: NotNegative = 20.0
    """Time at each pose, for the cycle time; 2 for a camera-pose or a board."""
    retreat_mm: NotNegative = 0.0
    """Distance by which a pin backs off along its axis between poses; 0 for none."""
    contact_mm: Positive = 5.0
    """Distance from the target within which pairs of ``constraints.ignore`` may touch."""
    stop_short_mm: Annotated[float, Field(strict=True, ge=0, le=40)] = 0.0
    """Distance before the target at which programs stop, to jog the rest by hand."""

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
    """Check tool, obstacles and arm for collisions."""
    safety_distance_mm: NotNegative = 20.0
    """Distance kept between them."""
    ways: StrictBool = True
    """Check the joint moves from pose to pose, too."""
    ignore: tuple[tuple[Line, Line], ...] = ()
    """Pairs of solids that may touch; tool and obstacle at the measured poses only, with
    ``plan.retreat_mm``."""
    smallest_singular_value: Annotated[float, Field(strict=True, ge=0, lt=1)] = 0.0
    """Distance kept from singularities: of the tip's Jacobian, lengths divided by the arm's
    reach."""
    largest_travel_deg: Annotated[float, Field(strict=True, ge=1, le=1e4)] | None = None
    """Largest travel of any joint from one pose to the next."""
    workspace_lowest_mm: Vector | None = None
    """Lowest corner, in the base frame, of a box that arm and tool stay in; behind a positioner it
    stands on the floor, in the frame of the root link."""
    workspace_highest_mm: Vector | None = None
    """Highest corner of this box."""

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
    """How it is measured, and how well: touch-ups, instruments, poses of a target, or pictures.

    The noise of touch-ups is along x, y, z of the tip, or of the camera as it is mounted there.
    ``arm_three_sigma_mm`` and ``arm_three_sigma_deg`` are what zero offsets of up to 0.1 deg look
    like at poses that are chosen far apart: the estimate of simulated pictures found 0.3 mm and
    0.06 deg, one standard deviation, on an R-2000iC and on a UR10e.
    """

    kind: KindOrBoard = "touch-up"
    """``touch-up``: the tool point is on the target. ``view-line``: across the line of sight only.
    ``plane``: the tool point touches a plane. ``point``: a tracker or a measuring arm reads where
    points of the tool are. ``pose``: one reads how the tool is turned, too. ``distance``: a ball
    bar or a wire reads how far the tool point is. ``camera-pose``: a camera sees the target's pose
    (hand-eye calibration). ``board``: pictures of the ``[board]``, by the pixels of its points. How
    well each is measured but by touch or camera stands in ``[[noise]]``."""
    payloads: tuple[Name, ...] = ()
    """Names of ``[[payload]]`` that poses are planned with, besides the tool's own."""
    least_marks: Annotated[int, Field(strict=True, ge=1, le=100)] = 1
    """Marks of the tool that an instrument has to see at each pose."""
    three_sigma_mm: NoiseVector = (0.02, 0.02, 0.12)
    """Three standard deviations of one touch-up along x, y and z."""
    noise_axes: Literal["tip", "camera"] = "tip"
    """Axes of this noise: of the tip, or of the camera as it is mounted there."""
    weighted: StrictBool = True
    """Weight the equations by the noise."""
    estimate_noise: StrictBool = False
    """Take the noise from the residuals."""
    camera_three_sigma_deg: Noise = 0.06
    """Three standard deviations of the rotation of a camera's pose."""
    camera_three_sigma_mm: Noise = 0.3
    """The same of its translation."""
    board_three_sigma_px: Noise = 0.6
    """Three standard deviations of each coordinate of a point of a board in a picture."""
    arm_three_sigma_mm: NotNegative = 0.9
    """Three standard deviations of where the arm stops from where it says, along each axis; for a
    ``board``, 0 for none."""
    arm_three_sigma_deg: NotNegative = 0.18
    """The same about each axis."""
    estimate_lens: StrictBool = True
    """Estimate the lens from the pictures, too; false where it was calibrated before."""

    @model_validator(mode="after")
    def _has_a_common_unit(self) -> MeasurementSection:
        if self.kind in ("camera-pose", "board", "pose") and not self.weighted:
            raise ValueError(
                f"a {self.kind} is weighted by its noise: mm and deg have no common unit"
            )
        return self


class TruthSection(Section):
    """The robot that is simulated: nothing but the simulation looks at this.

    ``backlash_deg`` is one arc minute (0.017) at most on reducers in good order; ``friction_nm``,
    where not given, winds a reducer up by a fifth of that.
    """

    seed: Seed = 1
    """Seed of all that is drawn at random."""
    zero_offsets_deg: tuple[Finite, ...] | None = None
    """Zero offsets, one for each joint of the arm; up to 0.1 deg by default."""
    positioner_offsets_deg: tuple[Finite, ...] | None = None
    """The same of a positioner, from its foot on; 0.07 deg each by default, and none of the joint
    that moves the base."""
    tool_error_mm: Vector = (2.0, -1.0, 3.0)
    """True tool point less that of ``tool.point_mm``."""
    target_error_mm: Vector = (5.0, -4.0, 2.0)
    """True target less that of the cell."""
    deflection: StrictBool | None = None
    """Let the reducers deflect under gravity; by default where masses and stiffness are known."""
    stiffness_nm_per_rad: tuple[Positive, ...] | None = None
    """Stiffness of the reducers, one for each joint; that of the preset by default."""
    link_error_mm: NotNegative = 0.0
    """Standard deviation of the links' displacements, along each axis."""
    link_error_deg: NotNegative = 0.0
    """Standard deviation of the links' rotations, about each axis."""
    camera_error_deg: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)
    """Rotation of the camera on its mount against the cell, for ``calibrate``."""
    target_turn_deg: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)
    """Rotation of the target against the cell, for ``calibrate``."""
    backlash_deg: PerJoint = 0.005
    """Backlash, one number or one for each joint."""
    friction_nm: PerJoint | None = None
    """Friction, likewise."""
    scatter_deg: PerJoint = 1.2e-4
    """Standard deviation of where a joint stops, likewise."""
    imaging: ImagingSection = ImagingSection()


class FrameSection(Section):
    """A frame by its place and its turns W P R about fixed x, y and z."""

    at_mm: Vector = (0.0, 0.0, 0.0)
    """Its origin."""
    wpr_deg: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)
    """Its orientation."""


def _argument(value: object) -> object:
    """What a measuring program is called with, in words or as a number."""
    whole = isinstance(value, int) and not isinstance(value, bool)
    if isinstance(value, int) and whole:
        whole = ARGUMENT[0] <= value <= ARGUMENT[1]
    if not whole and value not in ("number", "none"):
        raise ValueError(f'a whole number up to {ARGUMENT[1]}, "number" or "none"')
    return value


def _whole(bounds: tuple[int, int]) -> Any:
    """A field of a whole number between these."""
    return Field(strict=True, ge=bounds[0], le=bounds[1])


Seconds = Annotated[float, Field(strict=True, ge=SECONDS[0], le=SECONDS[1], allow_inf_nan=False)]


class ProgramSection(Section):
    """The robot program."""

    name: str = "CALIB01"
    """Name of the program."""
    form: Literal["joint", "cartesian"] = "joint"
    """``joint``: joint positions. ``cartesian``: poses of the tool with the arm configuration."""
    user_frame: Annotated[int, _whole(FRAME)] = 0
    """Number of the user frame on the controller."""
    tool_frame: Annotated[int, _whole(FRAME)] = 1
    """Number of the tool frame on the controller."""
    tool: FrameSection | None = None
    """The controller's tool frame in the axes of the tip, for ``cartesian``; by default the tool
    point in these axes."""
    user: FrameSection | None = None
    """The user frame in the controller's world, for ``cartesian``."""
    world: FrameSection | None = None
    """The controller's world in the base frame, for ``cartesian`` of a KUKA or an ABB that slides
    carry: it stays where it is while they move."""
    speed_percent: Annotated[int, _whole(SPEED_PERCENT)] = 10
    """Speed of joint moves."""
    settle_s: Seconds = 1.0
    """Time to wait at each pose before it is measured."""
    measure_call: str | None = "MEASURE"
    """Program that is called at each pose; empty for none."""
    measure_argument: Annotated[int | str, BeforeValidator(_argument)] = "number"
    """Its argument: ``number`` of the pose, a number of yours, or ``none``."""
    measure_output: Annotated[int, _whole(OUTPUT)] | None = None
    """Digital output that is pulsed at each pose."""
    measure_pulse_s: Seconds = 0.5
    """Length of this pulse."""
    keep: Literal["position", "register"] = "position"
    """Where a touched-up position is kept: in the program's own positions, or in registers."""
    first_register: Annotated[int, _whole(REGISTER)] = 1
    """The first of these registers."""
    pulses_per_deg: tuple[Finite, ...] = ()
    """Encoder pulses, one number for each joint: for Yaskawa's pulse jobs."""
    pulses_per_mm: tuple[Finite, ...] = ()
    """The same for each slide that carries the arm, a base axis of Yaskawa's jobs."""

    @property
    def pulses(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Pulses in a degree and in a millimetre, as :meth:`Dialect.reading` takes them."""
        return self.pulses_per_deg, self.pulses_per_mm


class PoolSection(Section):
    """What poses are chosen from, where they are chosen and not varied."""

    kind: Literal["auto", "cone", "wpr", "joints", "views"] = "auto"
    """``cone``: on the target, tilted at random. ``wpr``: every W P R grid. ``joints``: anywhere in
    joint space. ``views``: the board anywhere in the image, at any distance and tilt. ``auto``: a
    cone for touch-ups, grids for a camera-pose, views for a board."""
    tilt_deg: Annotated[float, Field(strict=True, gt=0, le=180)] = 45.0
    """Largest tilt of the tool in a cone; it rolls freely."""
    candidates: Annotated[int, Field(strict=True, ge=1, le=100_000)] = 1500
    """Number of poses that are drawn."""
    configurations: Literal["nearest", "front", "all"] = "front"
    """``nearest``: one posture for each pose. ``front``: every branch with the arm in front.
    ``all``: those over the arm's back, too."""
    smallest_singular_value: Annotated[float, Field(strict=True, ge=0, lt=1)] = 0.03
    """Distance kept from singularities, where a touch-up moves joints far."""
    seed: Seed = 0
    """Seed of the drawing."""
    repeats: Annotated[int, Field(strict=True, ge=1, le=100)] = 1
    """Times that a pose may be measured, where that tells more than another pose."""
    limit: tuple[LimitSection, ...] = ()
    """What a choice has to keep."""


class TaskBoxSection(Section):
    """Where the arm works: a box in base axes, over which its accuracy is predicted."""

    lowest_mm: Vector
    """Lowest corner, in the base frame."""
    highest_mm: Vector
    """Highest corner."""
    steps: tuple[BoxSteps, BoxSteps, BoxSteps] = (3, 3, 3)
    """Points along x, y and z."""

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
    other_targets: tuple[TargetSection, ...] = ()
    """Those after the first of several tables ``[[target]]``."""
    camera: CameraSection | None = None
    board: BoardSection | None = None
    obstacle: tuple[SolidSection, ...] = ()
    constraints: ConstraintSection = ConstraintSection()
    variations: VariationSection = VariationSection()
    plan: PlanSection = PlanSection()
    pool: PoolSection = PoolSection()
    parameters: ParameterSection = ParameterSection()
    measurement: MeasurementSection = MeasurementSection()
    touch_up: TouchUpSection = TouchUpSection()
    noise: tuple[NoiseSection, ...] = ()
    instrument: InstrumentSection = InstrumentSection()
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
        usual = _PLAN_OF_KIND.get(str(measurement.get("kind")))
        return {**raw, "plan": {**usual, **plan}} if usual else raw

    @model_validator(mode="before")
    @classmethod
    def _first_target(cls, raw: Any) -> Any:
        targets = raw.get("target") if isinstance(raw, dict) else None
        if not isinstance(targets, list) or not targets:
            return raw
        return {**raw, "target": targets[0], "other_targets": targets[1:]}

    @model_validator(mode="after")
    def _names_differ(self) -> CellConfig:
        names = [solid.name for solid in (*self.tool.body, *self.obstacle)]
        double = next((name for name in names if names.count(name) > 1), None)
        if double is not None:
            raise ValueError(f"two solids have the name {double!r}")
        for listed, what in (
            ([p.name for p in self.payload], "payloads have the name"),
            ([str(n.kind) for n in self.noise], "noises are of the kind"),
            ([m.name for m in self.tool.mark], "marks of the tool have the name"),
            ([t.name for t in self.targets], "targets have the name"),
        ):
            double = next((name for name in listed if listed.count(name) > 1), None)
            if double is not None:
                raise ValueError(f"two {what} {double!r}")
        return self

    @property
    def targets(self) -> tuple[TargetSection, ...]:
        """All that is measured from."""
        return (self.target, *self.other_targets)

    def changed(self, **sections: Mapping[str, Any]) -> CellConfig:
        """The same with other values in some of its sections; they are not checked again."""
        new = {name: getattr(self, name).model_copy(update=v) for name, v in sections.items()}
        return self.model_copy(update=new)
