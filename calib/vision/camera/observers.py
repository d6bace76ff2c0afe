"""What the camera says of a target at a pose: through an image, or straight from geometry.

Both observers have the same interface, so that a simulation chooses by one switch:
:func:`make_observer`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Protocol, get_args

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import ConvergenceError, InputError, near_names
from calib.se3 import BoolArray, FloatArray
from calib.vision.camera.conic import axis_lengths, ellipse_axes, ellipse_vhs
from calib.vision.camera.lens import Camera
from calib.vision.camera.rendering import GreyImage, Imaging, Plate, render
from calib.vision.camera.target import SMALLEST_PX

Kind = Literal["image", "fast"]

_FEWEST_TRIALS = 10
"""Images below which a covariance of five numbers means nothing."""

_LEAST_MEASURED = 0.9
"""Share of the images that must have been measured: the noise of those left would be too small."""


@dataclass(frozen=True, eq=False)
class Views:
    """What is seen of a target at K poses."""

    ellipses: FloatArray
    """(K, 5) [px], as :mod:`calib.vision.camera.conic` writes them; NaN where it was not
    measured."""
    reasons: tuple[str, ...]  # why not; empty where it was

    @classmethod
    def of(cls, measured: Sequence[tuple[FloatArray, str]]) -> Views:
        """Views of what targets have measured: see :meth:`Target.measure`."""
        ellipses = np.array([ellipse for ellipse, _ in measured]).reshape(-1, 5)
        return cls(ellipses, tuple(reason for _, reason in measured))

    @property
    def vhs_px(self) -> FloatArray:
        """V, H and s ``(K, 3)`` [px]."""
        return ellipse_vhs(self.ellipses)

    @property
    def seen(self) -> BoolArray:
        """Where the target was measured ``(K,)``."""
        return np.array([not reason for reason in self.reasons], dtype=bool)


class Target(Plate, Protocol):
    """What a camera looks at: how it is drawn, and what is measured of it.

    Whatever it is, it is measured as the ellipse of a circle about its middle. Its frame has z out
    of the face.
    """

    @property
    def diameter_m(self) -> float:
        """Diameter of that circle [m]."""

    @property
    def is_known(self) -> bool:
        """Whether this diameter is relied on; or found, with the camera."""

    @property
    def is_biased(self) -> bool:
        """Whether a tilt moves the ellipse off the image of the middle."""

    def measure(
        self, image: GreyImage, near_px: FloatArray | None = None
    ) -> tuple[FloatArray, str]:
        """Ellipse ``(5,)`` [px] in a picture, and in words why it is NaN; empty where it is not.

        ``near_px`` ``(2,)`` is where it is expected, among others that look like it.
        """

    def image(
        self, camera: Camera, T_camera_target: FloatArray, diameter_m: float | None = None
    ) -> FloatArray:
        """Ellipses ``(..., 5)`` [px] that are measured of it at poses ``(..., 4, 4)`` [m].

        NaN where it shows its back. Of a circle of another diameter, if given.
        """

    def pose(self, camera: Camera, image: GreyImage, about: FloatArray) -> FloatArray | None:
        """Pose of its pattern before the camera ``(4, 4)`` [m]; None where none fits.

        The best of the poses ``(K, 4, 4)`` that it may be about.
        """


class Observer(Protocol):
    """A camera that looks at a target."""

    @property
    def camera(self) -> Camera:
        """The camera as it really is."""

    def views(
        self,
        T_camera_target: FloatArray,
        rng: np.random.Generator,
        near_px: FloatArray | None = None,
    ) -> Views:
        """What is seen at poses ``(K, 4, 4)``; ``near_px`` is ``(K, 2)``."""


@dataclass(frozen=True, eq=False)
class MeasurementNoise:
    """Errors of measured ellipses: normal, the same at all poses near those they come from.

    Of the five numbers of an ellipse (:mod:`calib.vision.camera.conic`), not of its axes: where an
    ellipse is nearly a circle its long axis is the larger of two, which is neither normal nor
    without bias, and that follows from the five by itself.
    """

    bias: FloatArray  # (5,): mean error [px]
    covariance: FloatArray  # (5, 5) [px²]
    sigma_vhs_px: FloatArray  # (3,): standard deviations of V, H and s in the images

    @classmethod
    def from_sigma(cls, sigma_vhs_px: ArrayLike) -> MeasurementNoise:
        """Independent noise without bias of given standard deviations of V, H and s [px].

        That of s is met for a target seen at a tilt, where the long axis is one and the same.
        """
        sigma = np.asarray(sigma_vhs_px, dtype=float)
        v, h, s = sigma
        # long axis = 2 uᵀ S u for its direction u; the three of S as of an isotropic matrix
        variances = [h**2, v**2, s**2 / 4, s**2 / 8, s**2 / 4]
        return cls(np.zeros(5), np.diag(variances), sigma)

    @cached_property
    def _root(self) -> FloatArray:
        """Matrix ``(5, 5)`` whose transpose times itself is the covariance, singular or not."""
        values, vectors = np.linalg.eigh(self.covariance)
        return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)

    def draw(self, shape: tuple[int, ...], rng: np.random.Generator) -> FloatArray:
        """Errors ``(*shape, 5)`` [px] of ellipses."""
        return np.asarray(self.bias + rng.standard_normal((*shape, 5)) @ self._root)


@dataclass(frozen=True, eq=False)
class ImageObserver:
    """Renders an image and measures it."""

    camera: Camera
    target: Target
    imaging: Imaging
    beside: tuple[tuple[Plate, FloatArray], ...] = ()
    """Other targets in the picture, each with its pose in the frame of the target."""

    def grab(self, T_camera_target: FloatArray, rng: np.random.Generator) -> GreyImage:
        """Picture ``(height, width)`` of the target at a pose ``(4, 4)`` [m]."""
        others = [(target, T_camera_target @ T) for target, T in self.beside]
        scene = [*others, (self.target, T_camera_target)]
        return render(self.camera, scene, self.imaging, rng)

    def views(
        self,
        T_camera_target: FloatArray,
        rng: np.random.Generator,
        near_px: FloatArray | None = None,
    ) -> Views:
        near = [None] * len(T_camera_target) if near_px is None else list(near_px)
        return Views.of(
            [
                self.target.measure(self.grab(T, rng), px)
                for T, px in zip(T_camera_target, near, strict=True)
            ]
        )


@dataclass(frozen=True, eq=False)
class FastObserver:
    """Projects the circle and adds noise to its ellipse: no image, and many poses at once."""

    camera: Camera
    target: Target
    noise: MeasurementNoise

    def views(
        self,
        T_camera_target: FloatArray,
        rng: np.random.Generator,
        near_px: FloatArray | None = None,
    ) -> Views:
        """See :meth:`Observer.views`; nothing else looks like the target here."""
        true = self.target.image(self.camera, T_camera_target)
        _, short = axis_lengths(true)
        margin = self._margin(true)
        large = short >= SMALLEST_PX
        inside = large & (margin >= 0.0)
        small = f"no target: the circle is not seen, or smaller than {SMALLEST_PX:g} px"
        cut = "touches the edge: the circle is cut by the edge"
        outside = "no target: the circle is outside the image"
        reasons = np.select([inside, ~large, -margin < short], ["", small, cut], outside)
        noisy = self.noise.draw(true.shape[:-1], rng) + true
        return Views(np.where(inside[:, None], noisy, np.nan), tuple(reasons.tolist()))

    def _margin(self, ellipse: FloatArray) -> FloatArray:
        """Distance ``(...)`` [px] of ellipses from the edge of the image, negative outside."""
        size = np.array([self.camera.width_px, self.camera.height_px])
        # half sides of the box about an ellipse: lengths of the rows of S
        half = np.hypot(ellipse[..., [2, 3]], ellipse[..., [3, 4]])
        center = ellipse[..., :2]
        return np.asarray(np.minimum(center - half, size - center - half).min(axis=-1))


def make_observer(
    kind: Kind,
    camera: Camera,
    target: Target,
    imaging: Imaging | None = None,
    noise: MeasurementNoise | None = None,
) -> Observer:
    """Observer of one kind or the other; the fast one needs noise: :func:`noise_from_images`."""
    if kind == "image":
        return ImageObserver(camera, target, imaging or Imaging())
    if kind != "fast":
        raise InputError(
            f"no observer of kind {kind!r}", hint=near_names(kind, get_args(Kind)), name="kind"
        )
    if noise is None:
        raise InputError(
            "the fast observer has no noise", hint="take that of noise_from_images", name="noise"
        )
    return FastObserver(camera, target, noise)


def noise_from_images(
    camera: Camera,
    target: Target,
    T_camera_target: FloatArray,
    imaging: Imaging,
    trials: int,
    rng: np.random.Generator,
) -> MeasurementNoise:
    """Noise of measurements in rendered images.

    Each image shows the target shifted by up to half a pixel in both directions, so that what the
    raster does to an edge averages out and counts as noise.

    Parameters
    ----------
    T_camera_target : ndarray (4, 4)
        Pose that the noise is wanted for.
    trials : int
        Images. The standard deviations are good to ``1 / sqrt(2 trials)`` of themselves.

    Raises
    ------
    InputError
        Fewer than 10 trials.
    ConvergenceError
        More than one image in ten could not be measured.
    """
    if trials < _FEWEST_TRIALS:
        raise InputError(
            f"{trials} images give no noise",
            hint=f"take {_FEWEST_TRIALS} or more",
            name="trials",
            value=trials,
            bound=_FEWEST_TRIALS,
        )
    observer = ImageObserver(camera, target, imaging)
    pixel_m = T_camera_target[2, 3] / camera.focal_xy_px
    poses = np.repeat(np.asarray(T_camera_target, dtype=float)[None], trials, axis=0)
    poses[:, :2, 3] += rng.uniform(-0.5, 0.5, (trials, 2)) * pixel_m
    found = observer.views(poses, rng)
    ok = found.seen
    if ok.mean() < _LEAST_MEASURED:
        reason = next(said for said in found.reasons if said).partition(": ")[2]
        raise ConvergenceError(
            f"{int((~ok).sum())} of {trials} images could not be measured: {reason}",
            hint="choose a pose at which the target is well seen",
            value=float(ok.mean()),
            bound=_LEAST_MEASURED,
        )
    measured = found.ellipses[ok]
    true = target.image(camera, poses[ok])
    error = measured - true
    long = ellipse_axes(measured)[0] - ellipse_axes(true)[0]
    sigma = np.array([error[:, 1].std(ddof=1), error[:, 0].std(ddof=1), long.std(ddof=1)])
    return MeasurementNoise(error.mean(axis=0), np.cov(error.T), sigma)
