"""Types of the values of a ``cell.toml``, and its sections about identification and touch-up."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StrictBool, model_validator

from calib.identification.result import Loss
from posedesign.files import LARGEST_NUMBER, LEAST_POSITIVE


def _is_not_tiny(value: float) -> float:
    if value < LEAST_POSITIVE:
        raise ValueError(f"should be at least {LEAST_POSITIVE:g}")
    return value


_NOT_TINY = AfterValidator(_is_not_tiny)

Finite = Annotated[
    float, Field(strict=True, ge=-LARGEST_NUMBER, le=LARGEST_NUMBER, allow_inf_nan=False)
]
Positive = Annotated[
    float,
    Field(strict=True, gt=0, le=LARGEST_NUMBER, allow_inf_nan=False),
    _NOT_TINY,
]
Seed = Annotated[int, Field(strict=True, ge=0, lt=2**63)]
NotNegative = Annotated[float, Field(strict=True, ge=0, le=1e6, allow_inf_nan=False)]
Length = Annotated[float, Field(strict=True, ge=-1e6, le=1e6, allow_inf_nan=False)]
"""[mm]; a kilometre is no robot cell."""
Vector = tuple[Length, Length, Length]
Variation = Annotated[float, Field(strict=True, ge=0, lt=180, allow_inf_nan=False)]
"""[deg]; zero holds an angle."""
Step = Annotated[float, Field(strict=True, ge=0.1, lt=180, allow_inf_nan=False)]
"""[deg]; finer steps would be rounds without end."""
VariationVector = tuple[Variation, Variation, Variation]
Noise = Annotated[float, Field(strict=True, gt=0, le=1e3, allow_inf_nan=False), _NOT_TINY]
"""[mm, deg]"""
NoiseVector = tuple[Noise, Noise, Noise]
PerJoint = NotNegative | tuple[NotNegative, ...]
"""One number for all joints, or one for each."""
Line = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f-\x9f\u2028\u2029]*$")]
"""Text that stays on one line and does not steer a terminal."""

Name = Annotated[Line, Field(min_length=1, max_length=40)]
Size = Annotated[float, Field(strict=True, gt=0, le=1e6, allow_inf_nan=False), _NOT_TINY]
"""[mm]"""
Pixels = Annotated[int, Field(strict=True, gt=0, le=100_000)]

BoxSteps = Annotated[int, Field(strict=True, ge=1, le=25)]
"""Points along an axis of a box: 25 along each are fifteen thousand postures to find."""


class Section(BaseModel):
    """A table of the file; unknown keys are refused."""

    # built when first used: with the cell, not a second time by itself before
    model_config = ConfigDict(extra="forbid", frozen=True, strict=False, defer_build=True)


Word = Literal[
    "zero_offsets",
    "geometry",
    "compliance",
    "bearings",
    "lost_motion",
    "scale",
    "harmonics",
    "priors",
]
"""What a model may free of the arm; ``priors`` holds all of it to what is known beforehand."""


class ParameterSection(Section):
    """What is identified besides the set-up, and how: each list of ``models`` is one to try."""

    zero_offsets: tuple[str, ...] | None = None
    """Joints of the word ``zero_offsets``; all but the first and the last by default, which target
    and tool point absorb."""
    tool_axes: Annotated[str, Field(pattern=r"^x?y?z?$")] | None = None
    """Axes of the tip along which the tool point is identified; ``xyz`` by default, ``xy`` for a
    view line."""
    models: Annotated[tuple[tuple[Word, ...], ...], Field(min_length=1, max_length=20)] = (
        ("zero_offsets",),
        ("zero_offsets", "compliance"),
        ("geometry",),
        ("geometry", "compliance"),
        ("geometry", "priors"),
        ("geometry", "compliance", "priors"),
    )
    """Models to try, each a list of what it frees."""
    tune_priors: bool = True
    """Find the sizes of the priors from the measurements, from a twentieth of the usual ones to
    twice as much."""
    harmonics: Annotated[tuple[Positive, ...], Field(min_length=1)] = (1.0, 2.0)
    """Waves in a turn of a joint, for ``harmonics``."""
    lost_motion_nm: Positive = 10.0
    """Torque that takes up the lost motion of a joint."""
    prior_offset_deg: Positive = 1.0
    """Usual standard deviation of zero offsets: how well joints are mastered."""
    prior_length_mm: Positive = 0.5
    """Usual standard deviation of displacements of links."""
    prior_angle_deg: Positive = 0.1
    """Usual standard deviation of rotations of links."""
    prior_harmonic_deg: Positive = 0.02
    """Usual standard deviation of errors of transmissions."""
    prior_compliance_urad_nm: Positive = 50.0
    """Usual standard deviation of the compliance of reducers."""
    planned: Annotated[tuple[Word, ...], Field(min_length=1)] | None = None
    """Errors that poses are planned for, in the words of ``models``, where these are not those of
    the arm that is fitted: everything that may be off, held by priors of usual sizes."""
    method: Literal["gauss-newton", "newton-raphson"] = "gauss-newton"
    """``newton-raphson``: as in the paper, with derivatives by finite differences."""
    loss: Literal["auto", "least-squares", "huber", "cauchy", "student-t", "graduated"] = "auto"
    """``auto``: least squares, or Student's loss where residuals have heavy tails. ``graduated``
    leaves gross errors out."""

    @property
    def loss_given(self) -> Loss | None:
        """The loss; None where it is to be found which suits the residuals."""
        return None if self.loss == "auto" else self.loss

    @model_validator(mode="after")
    def _models_differ(self) -> ParameterSection:
        sets = [frozenset(model) for model in self.models]
        for model in self.models:
            if not set(model) - {"priors"} or len(set(model)) != len(model):
                raise ValueError("each of models lists what it frees, once")
        if len(set(sets)) != len(sets):
            raise ValueError("two of models free the same")
        return self


Kind = Literal["touch-up", "view-line", "plane", "point", "pose", "camera-pose", "distance"]
"""Of a measurement."""

KindOrBoard = Literal[
    "touch-up", "view-line", "plane", "point", "pose", "distance", "camera-pose", "board"
]
"""The same, and pictures of a board."""


class NoiseSection(Section):
    """Noise of a kind of measurement, in the axes of its instrument."""

    kind: Kind
    """Kind of measurement that has this noise."""
    three_sigma_mm: Noise | NoiseVector
    """Three standard deviations of lengths: one number, or one for each axis."""
    three_sigma_deg: Noise | NoiseVector | None = None
    """Three standard deviations of angles, for poses."""
    along_three_sigma_mm_per_m: NotNegative = 0.0
    """What each metre of distance adds along the line of sight, in quadrature, for points of a
    tracker."""
    across_three_sigma_mm_per_m: NotNegative = 0.0
    """The same across the line of sight: the noise of the tracker's angles, in mrad."""

    @property
    def grows(self) -> bool:
        """Whether the noise grows with the distance."""
        return bool(self.along_three_sigma_mm_per_m or self.across_three_sigma_mm_per_m)

    @model_validator(mode="after")
    def _grows_of_points(self) -> NoiseSection:
        if self.grows and (self.kind != "point" or not isinstance(self.three_sigma_mm, float)):
            raise ValueError(
                "noise that grows with the distance is of a point, with one number as "
                "three_sigma_mm"
            )
        return self

    @model_validator(mode="after")
    def _has_angles(self) -> NoiseSection:
        if (self.three_sigma_deg is not None) != self.kind.endswith("pose"):
            verb = "needs" if self.kind.endswith("pose") else "has no"
            raise ValueError(f"a {self.kind} {verb} three_sigma_deg")
        return self


class ColumnSection(Section):
    """Columns of an instrument's file by their names, where its layout is not known."""

    place: tuple[Line, Line, Line] | None = None
    """x, y and z; by default columns that are called so."""
    turn: Annotated[tuple[Line, ...], Field(max_length=9)] = ()
    """The orientation, in the order of ``instrument.turn``."""
    reflector: Line | None = None
    """Name of the reflector that was read; by default ``tool``."""
    pose: Line | None = None
    """Name of the pose; by default ``pose``."""
    time: Line | None = None
    """When it was read, as a number or a date; by default ``time_s``."""
    temperature: Line | None = None
    """Temperature in deg C; by default ``temperature_c``."""
    joints: tuple[Line, ...] = ()
    """Joint values from the base on, in the same file or in that of the joints."""


class InstrumentSection(Section):
    """Files of trackers, measuring arms and motion capture, and of the joints that go with them.

    ``still_deg`` is far above what encoders flicker by, and far below a motion between poses;
    ``still_mm`` allows for the noise of motion capture.
    """

    kind: Literal["point", "pose"] = "point"
    """What is taken of each reading: a place, or a place and an orientation."""
    frame: Name = "tracker"
    """Name of the instrument among the targets."""
    unit: Literal["um", "mm", "cm", "m", "in"] | None = None
    """Unit of lengths, where the file does not say it."""
    turn: (
        Literal[
            "quaternion-wxyz",
            "quaternion-xyzw",
            "vector-deg",
            "vector-rad",
            "wpr-deg",
            "wpr-rad",
            "matrix",
        ]
        | None
    ) = None
    """Form of the orientation: rotation vector, W P R about fixed x, y, z, or a matrix by rows."""
    header: tuple[Line, ...] = ()
    """Names of the columns, of a file without a line of them."""
    columns: ColumnSection = ColumnSection()
    reflectors: tuple[Name, ...] = ()
    """Names of those on the tool; without them there is one, and names of points are of poses."""
    references: tuple[Name, ...] = ()
    """Names of reflectors that stand still around the arm: drift is tested by them."""
    joint_header: tuple[Line, ...] = ()
    """Names of the columns of the file of joints, where it has no line of them."""
    joint_unit: Literal["deg", "rad"] | None = None
    """Unit of ``columns.joints``."""
    pendant: StrictBool = False
    """``columns.joints`` are as the controller shows them, not in the signs of the description."""
    match: Literal["auto", "pose", "time", "order"] = "auto"
    """How joints are found to readings: by names of poses, by time, or in order."""
    time_unit: Literal["s", "ms", "us", "ns"] = "s"
    """Unit of ``columns.time``."""
    clock_offset_s: Finite = 0.0
    """What is added to times of the instrument to have those of the joints."""
    tolerance_s: Annotated[float, Field(strict=True, ge=0, le=3600)] = 1.0
    """Largest time between a reading and a row of joints that is no record."""
    still_s: Annotated[float, Field(strict=True, ge=1e-3, le=3600)] = 0.5
    """Least time that an arm stands still at a pose."""
    still_deg: Annotated[float, Field(strict=True, ge=1e-4, le=5)] = 0.05
    """Range within which joints of a record stand still in this time."""
    still_mm: Annotated[float, Field(strict=True, ge=1e-3, le=50)] = 2.0
    """The same of places that are read without end."""
    noise: Literal["stated", "repeats"] = "stated"
    """``repeats``: repeated readings give the noise of ``kind``, in place of ``[[noise]]``."""

    @model_validator(mode="after")
    def _fits_together(self) -> InstrumentSection:
        both = set(self.reflectors) & set(self.references)
        if both:
            raise ValueError(f"{min(both)!r} is in reflectors and in references")
        numbers = {"quaternion": (4,), "matrix": (9,)}.get((self.turn or "").split("-")[0], (3,))
        if self.columns.turn and (self.turn is None or len(self.columns.turn) not in numbers):
            raise ValueError(
                f"columns.turn has {len(self.columns.turn)} names"
                + (f", a {self.turn} {numbers[0]}" if self.turn else ": say their form by turn")
            )
        if self.columns.joints and self.joint_unit is None:
            raise ValueError("joint_unit is missing: columns.joints in deg or rad")
        return self


class PayloadSection(Section):
    """Something that the flange carries besides the tool in some of the measurements."""

    name: Name
    """Its name in the column ``payload`` of the measurements."""
    mass_kg: NotNegative
    """Its mass."""
    com_mm: Vector
    """Its centre of mass, in the axes of the tip."""


class KnownDistanceSection(Section):
    """A distance between two targets that is known from elsewhere."""

    targets: tuple[Name, Name]
    """Names of the two targets."""
    length_mm: Size
    """Distance between them."""
    three_sigma_mm: Noise = 0.03
    """Three standard deviations of this distance."""


Count = Annotated[int, Field(strict=True, ge=1, le=100)]
ShareOfLight = Annotated[float, Field(strict=True, ge=-1, le=1)]


class TouchUpSection(Section):
    """The loop of visual touch-up.

    ``approach_deg`` is more than the lost motion of a reducer (one arc minute is 0.017 deg);
    ``shown_within_deg`` allows for rounding, the width of fine positions, and lost motion where
    encoders see it.
    """

    center_px: Annotated[float, Field(strict=True, ge=1e-3, le=50)] = 0.1
    """The loop ends when the target is as near to the middle of the image."""
    size_px: Annotated[float, Field(strict=True, ge=1e-3, le=50)] = 0.05
    """The loop ends when the target's size is as near to the designated one."""
    iterations: Count = 10
    """Largest number of corrections."""
    farthest_mm: Annotated[float, Field(strict=True, ge=1, le=1000)] = 100.0
    """Movement of the tip from which on a loop has run away."""
    looks: Count = 1
    """Pictures whose mean is taken."""
    approach_deg: Annotated[float, Field(strict=True, ge=0, le=5)] = 0.2
    """Last movement of all joints at each stop, always to the same side; 0 for none."""
    shown_within_deg: Annotated[float, Field(strict=True, ge=1e-3, le=2)] = 0.1
    """Difference of the joints shown from those commanded that ends the calibration."""
    correct_tilt: StrictBool = True
    """Take off what the tilt of the target does to the ellipse of its circle."""
    repeats: Annotated[int, Field(strict=True, ge=0, le=100)] = 10
    """Touch-ups of the base pose that the noise is estimated from; 0 to take that of the cell."""
    inch_deg: Annotated[float, Field(strict=True, ge=2, le=40)] = 15.0
    """Largest rotation of the arm about the target while it finds camera and target."""


class MarkSection(Section):
    """A further point of the tool that is measured: a reflector, a marker, another pin."""

    name: Name
    """Its name in the column ``tool`` of the measurements."""
    point_mm: Vector
    """Where it is, in the axes of the tip; it is identified, too."""
    axis: Vector | None = None
    """Direction that a reflector faces, in the axes of the tip; by default it is seen from all
    around."""
    largest_angle_deg: Annotated[float, Field(strict=True, gt=0, le=180)] = 30.0
    """Largest angle between this direction and the line of sight at which it is measured."""

    @model_validator(mode="after")
    def _has_direction(self) -> MarkSection:
        if self.axis is not None and not any(self.axis):
            raise ValueError("axis has no length: a reflector faces somewhere")
        return self


class TargetSection(Section):
    """What is measured from: the point that is touched, a plane, a ball bar's foot, an instrument.

    Radius, plate and cross are those of the round target that a camera sees. Further ones follow as
    further tables ``[[target]]``.
    """

    name: Name = "T1"
    """Its name in the column ``target`` of the measurements."""
    kind: Kind | None = None
    """How it is measured; ``measurement.kind`` by default."""
    position_mm: Vector | None = None
    """Where it is in the base frame; by default where the base pose puts the tool point. Of an
    instrument it has to be given: a decimetre is near enough."""
    stands_on: Literal["floor", "positioner"] | None = None
    """Of an instrument where a positioner carries the base: ``positioner``, and it turns with the
    base, or reads in the frame of reflectors that do. One on the floor is not measured from."""
    wpr_deg: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)
    """Axes of an instrument, in which it reads points and poses."""
    nearest_mm: NotNegative = 0.0
    """Least distance of the tool from an instrument; shortest length of a ball bar or a wire."""
    farthest_mm: Annotated[float, Field(strict=True, gt=0, le=1e6)] | None = None
    """Largest distance, or length; of a ball bar or a wire it has to be given."""
    dwell_s: NotNegative | None = None
    """Time at each pose of it, what is aimed anew included; ``plan.dwell_s`` by default."""
    size_mm: tuple[Size, Size] = (200.0, 200.0)
    """Lengths of the part of a plane that may be touched, about its position."""
    normal: Vector | None = None
    """Direction out of its face, in base axes; by default to the camera at the base pose. Of a
    board on the flange in the axes of the tip, by default their z."""
    roll_deg: Finite = 0.0
    """Rotation of a board about this direction, clockwise as the camera sees it: from upright in
    the camera's picture, or on the flange from x of the tip."""
    radius_mm: NotNegative = 0.0
    """Radius of its circle."""
    plate_mm: tuple[Size, Size] | None = None
    """Width and height of the plate that the circle is on."""
    cross_mm: tuple[Size, Size] | None = None
    """Length and width of the bars of the cross in the circle."""
    dark: StrictBool = True
    """The circle is darker than the plate."""

    @model_validator(mode="after")
    def _has_direction(self) -> TargetSection:
        if self.normal is not None and max(map(abs, self.normal)) < 1e-6:
            raise ValueError("normal has no direction")
        if self.farthest_mm is not None and not self.nearest_mm < self.farthest_mm:
            raise ValueError(
                f"nearest_mm {self.nearest_mm:g} is not below farthest_mm {self.farthest_mm:g}"
            )
        return self


Side = Literal["front", "behind"]
"""Of the arm: whether the first joint is turned by less than 90 deg from the base pose."""


class LimitSection(Section):
    """How many of the chosen poses are of a target, of a side of the arm, in a zone.

    What is not said does not matter: without anything it counts all poses.
    """

    target: Name | None = None
    """Name of the target."""
    tool: Name | None = None
    """Name of the mark that touches."""
    payload: Annotated[Line, Field(max_length=40)] | None = None
    """Name of the payload; empty for the tool alone."""
    side: Side | None = None
    """``front``: the first joint within 90 deg of the base pose. ``behind``: the others."""
    lowest_mm: Vector | None = None
    """Lowest corner, in the base frame, of the zone that the tool point is in."""
    highest_mm: Vector | None = None
    """Highest corner."""
    least: Annotated[int, Field(strict=True, ge=0, le=1000)] = 0
    """Poses that there are at least."""
    most: Annotated[int, Field(strict=True, ge=0, le=1000)] | None = None
    """Poses that there are at most."""

    @model_validator(mode="after")
    def _limits_something(self) -> LimitSection:
        if self.most is None and not self.least:
            raise ValueError("a limit has least, most, or both")
        if self.most is not None and self.most < self.least:
            raise ValueError(f"least {self.least} is above most {self.most}")
        if (self.lowest_mm is None) != (self.highest_mm is None):
            raise ValueError("give both lowest_mm and highest_mm")
        return self


Across = Annotated[int, Field(strict=True, ge=1, le=100)]


class BoardSection(Section):
    """A calibration board that a camera sees: what is printed on it.

    ``posedesign board`` prints it to scale. Squares, markers or circles are counted and measured;
    the black square of a marker is its side.
    """

    kind: Literal[
        "charuco",
        "aruco-grid",
        "apriltag-grid",
        "kalibr-aprilgrid",
        "chessboard",
        "circles",
        "asymmetric-circles",
        "round-target",
    ]
    """``charuco``: a chessboard with markers in its white squares. ``aruco-grid`` and
    ``apriltag-grid``: rows and columns of markers; ``kalibr-aprilgrid``: as Kalibr prints them,
    with black squares at the corners of tags. ``chessboard``; ``circles``: rows and columns of
    circles; ``asymmetric-circles``: every second row moved by half a step. ``round-target``: a
    circle with a cross, and a square that tells which way is up."""
    columns: Across | None = None
    """Squares, not inner corners, of ``charuco`` and ``chessboard``; markers or circles, across. A
    ``round-target`` has neither columns nor rows."""
    rows: Across | None = None
    """The same, down."""
    inner_corners: tuple[Across, Across] | None = None
    """In place of columns and rows of ``charuco`` and ``chessboard``: corners between squares,
    across and down, one less than squares. A chessboard of 10 x 7 squares has [9, 6]."""
    square_mm: Size | None = None
    """Side of the squares of ``charuco`` and ``chessboard``."""
    spacing_mm: Size | None = None
    """From marker to marker or from circle to circle, the white between them included; of
    ``asymmetric-circles`` from row to row."""
    marker_mm: Size | None = None
    """Side of the black square of a marker."""
    diameter_mm: Size | None = None
    """Of circles, where half the distance of neighbours is the default; of a ``round-target``."""
    large_dot_mm: Size | None = None
    """Diameter of the left upper circle of a grid that marks one corner by a larger dot. Turn the
    board until that dot is left above, then count columns and rows."""
    dictionary: Name | None = None
    """Dictionary of the markers as OpenCV names it, DICT_5X5_100 or 5x5_100; that of
    ``apriltag-grid`` and ``kalibr-aprilgrid`` is 36h11 by default."""
    first_id: Annotated[int, Field(strict=True, ge=0, le=10_000)] | None = None
    """Number of the left upper marker, 0 by default; the others count on, row by row. Of a
    ``kalibr-aprilgrid`` that of the left lower one, and rows count up."""
    legacy: StrictBool = False
    """A ``charuco`` of OpenCV before 4.6: with an even number of rows its left upper square is
    white."""


class ImagingSection(Section):
    """How the simulated camera takes pictures."""

    noise_grey: NotNegative = 2.0
    """Standard deviation of the grey levels, of 255."""
    blur_px: NotNegative = 1.0
    """Standard deviation of the blur."""
    gradient: tuple[ShareOfLight, ShareOfLight] = (0.0, 0.0)
    """Change of the light across and down the picture, as a share of it."""
    vignetting: ShareOfLight = 0.0
    """Loss of light in the corners, as a share of it."""
    distortion: tuple[Finite, Finite, Finite, Finite, Finite] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """OpenCV's k1, k2, p1, p2, k3."""
    vibration_mm: NotNegative = 0.002
    """Standard deviation of the lens's position."""
