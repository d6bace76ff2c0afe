"""Types of the values of a ``cell.toml``, and its sections about identification and touch-up."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StrictBool, model_validator

from calib.identification.noise import Loss
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


class NoiseSection(Section):
    """Noise of a further kind of measurement, in the axes of its instrument."""

    kind: Literal["touch-up", "view-line", "plane", "point", "pose", "camera-pose", "distance"]
    """Kind of measurement that has this noise."""
    three_sigma_mm: Noise | NoiseVector
    """Three standard deviations of lengths: one number, or one for each axis."""
    three_sigma_deg: Noise | NoiseVector | None = None
    """Three standard deviations of angles, for poses."""

    @model_validator(mode="after")
    def _has_angles(self) -> NoiseSection:
        if (self.three_sigma_deg is not None) != self.kind.endswith("pose"):
            verb = "needs" if self.kind.endswith("pose") else "has no"
            raise ValueError(f"a {self.kind} {verb} three_sigma_deg")
        return self


class PayloadSection(Section):
    """Something else that the flange carries in some of the measurements."""

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


class TargetSection(Section):
    """The point that is touched; where the tool point stands at the base pose by default.

    Radius, plate and cross are those of the round target that a camera sees.
    """

    name: Name = "T1"
    """Its name in the column ``target`` of the measurements."""
    position_mm: Vector | None = None
    """Where it is in the base frame; by default where the base pose puts the tool point."""
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
    square_mm: Size | None = None
    """Side of the squares of ``charuco`` and ``chessboard``."""
    spacing_mm: Size | None = None
    """From marker to marker or from circle to circle, the white between them included; of
    ``asymmetric-circles`` from row to row."""
    marker_mm: Size | None = None
    """Side of the black square of a marker."""
    diameter_mm: Size | None = None
    """Of circles, where half the distance of neighbours is the default; of a ``round-target``."""
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
