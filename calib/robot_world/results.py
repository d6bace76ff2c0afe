"""Solutions of A X = Z B: what they say of themselves, and whether they are to be trusted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

from calib import se3
from calib.chance import student_quantile
from calib.errors import InputError, one_line
from calib.robot_world import accuracy, diagnosis
from calib.robot_world.components import explain
from calib.robot_world.estimate import Estimate
from calib.robot_world.identifiability import direction
from calib.robot_world.noise import Noise
from calib.robot_world.pairs import PairSets
from calib.robot_world.scale import (
    WRONG,
    Scale,
    by_rotations_first,
    likeliest,
    likeliest_of_all,
    moved,
    scaled,
)
from calib.robot_world.sequence import LEVEL
from calib.robot_world.solution import Solution
from calib.se3 import BoolArray, FloatArray
from calib.shown import Shown

LARGEST_SIGMA_RAD = float(np.radians(3.0))
"""Standard deviation of a rotation of X or Z from which on nobody would call it calibrated: by hand
a camera is mounted as well."""

LARGEST_SIGMA = diagnosis.POOR
"""The same for their translations, in parts of how far the poses move."""

LEFT_OUT = 3.0
"""Left-out residuals over residuals, from which on some pairs decide alone what is found: of more
than six good pairs they reach 2.2."""

_FEW = 6
"""Pairs up to which one that is left out is missed more than that, for want of others: there it is
a warning, of what is a good part of the motion."""

_FEWEST_LEFT = 3
"""Pairs of which none can be left out."""

_ROUNDING = 1e-8
"""Residual, in parts of the motion, that is none."""

HARDLY = "but the pairs hardly belong together, as the warnings say"

_FEWEST_FOR_SIGMA = 6
"""Pairs up to which the noise that they show is a rough guess."""

_MANY_LEFT_OUT, _MOST_LEFT_OUT = 0.2, 0.3
"""Part of the pairs left out from which on a warning says so, and from which on X and Z are
doubtful. In simulations with outliers that are independent of each other the standard deviations
hold up to one half; where the outliers agree with each other, they fail from 0.35 on."""

_SURE_LEVEL = LEVEL / 10.0
"""Level at which a scale is named by its standard deviation alone."""

_FAR_SCALE = 0.3
"""Logarithm of the scale of B from which on X and Z without it say nothing of it."""

_SURELY = 3.0
"""Standard deviations of the scale within which it may be."""

_UNITS = {"delay": ("of a step between neighbours", 1.0), "scale": ("%", 1e2), "depth": ("%", 1e2)}
"""Units of changes that are no lengths."""

_AXES = ("x_mm", "y_mm", "z_mm", "w_deg", "p_deg", "r_deg")
_SIGMA_AXES = (
    *("sigma_x_mm", "sigma_y_mm", "sigma_z_mm"),
    *("sigma_about_x_deg", "sigma_about_y_deg", "sigma_about_z_deg"),
)


@dataclass(frozen=True, eq=False, repr=False)
class RobotWorldResult(Shown):
    """Solution of one problem A X = Z B.

    Attributes
    ----------
    X, Z : ndarray (4, 4)
        The transforms [m]; eye in hand, ``T_flange_camera`` and ``T_base_target``.
    method : str
        Name of the method.
    scale_estimated : bool
        Whether the scale of B's translations was estimated with X and Z; residuals are then those
        of B corrected.
    iterations : int or None
        Cycles of an iterative method.
    used : ndarray of bool (N,)
        False for the pairs that a robust method left out.
    noise_estimated : bool
        Whether the noise was not given.
    noise_made : str
        How the noise is made, in words, where it was estimated and the residuals show one that is
        not of B, alike in all directions; else empty.
    chi2, freedom, chi2_probability : float, int, float or None
        Sum of the squares of the residuals in units of the noise given, at the likeliest X and Z
        whatever the method, its degrees of freedom, and the probability of one as large. None
        where no noise was given, or 0 of rotation or of translation.
    ambiguities : tuple of str
        In words, the other X that fit as well.
    alternatives : tuple of (X, Z)
        These, ``(4, 4)`` each.

    Notes
    -----
    The covariance, and what each pair's residual is when it is left out, take many solutions by
    most methods. They are worked out when they are first asked for, as all that X and Z do not
    depend on: the status asks for both.
    """

    X: FloatArray
    Z: FloatArray
    method: str
    scale_estimated: bool
    iterations: int | None
    used: BoolArray
    noise_estimated: bool
    noise_made: str
    chi2: float | None
    freedom: int
    chi2_probability: float | None
    ambiguities: tuple[str, ...]
    alternatives: tuple[tuple[FloatArray, FloatArray], ...]
    _solution: Solution
    _excess: float
    _first: tuple[str, str]

    @classmethod
    def of(cls, solution: Solution, *, noise_estimated: bool, noise_made: str) -> RobotWorldResult:
        """All that is said of one solution."""
        found, used, others = solution.found, solution.used, solution.others
        status, message = solution.verdict
        chi2, probability, excess = None, None, 1.0
        freedom = 6 * int(used.sum()) - 12
        if status == "ok" and solution.noise is not None and not noise_estimated:
            chi2 = accuracy.least_chi2(solution.pairs, found, used, solution.noise)
        if chi2 is not None:
            probability, excess = (
                float(part[0]) for part in accuracy.judged(np.array([chi2]), freedom)
            )
        if excess > 1.0:
            message += (
                f"; the least residuals are {excess:.1f} times the noise given: standard "
                "deviations are scaled up to them, which does not cover a bias of A or B"
            )
        if noise_made:
            message += f"; noise as the residuals show it: {noise_made}"
        wrong = ~used if solution.copies is None else ~used & ~solution.copies
        if wrong.any():
            rows = ", ".join(str(i + 1) for i in np.flatnonzero(wrong))
            message += f"; left out as contradicting the others: {rows} (counted from 1)"
        if status == "ok":
            if others:
                status = "ambiguous"
                message += (
                    "; all rotations between the poses are about one axis or half turns, which "
                    "leave a choice: add a pose that turns otherwise, or pick X by where the "
                    "camera looks"
                )
            elif solution.motion.degenerate[0]:
                message += "; rotations leave a choice of half turns, which the translations decide"
        if solution.doubts and status == "ok":
            status, message = "doubtful", f"{message}; {HARDLY}"
        return cls(
            X=found.X[0],
            Z=found.Z[0],
            method=solution.method.name,
            scale_estimated=solution.factor is not None,
            iterations=None if found.iterations is None else int(found.iterations[0]),
            used=used,
            noise_estimated=noise_estimated,
            noise_made=noise_made,
            chi2=chi2,
            freedom=freedom,
            chi2_probability=probability,
            ambiguities=tuple(text for text, _, _ in others),
            alternatives=tuple((X, Z) for _, X, Z in others),
            _solution=solution,
            _excess=excess,
            _first=(status, message),
        )

    @property
    def status(self) -> str:
        """``"ok"`` where X and Z may be used as they are; else what is the matter.

        ``"not converged"`` where an iteration did not arrive; ``"misfit"`` where the residuals are
        several times those of the closed form; ``"ambiguous"`` where other X and Z fit as well;
        ``"doubtful"`` where the message says that the pairs do not belong together, that the
        standard deviations are too large for a calibration, that X and Z of the other pairs do not
        predict those left out, or that the translations of B have another scale than those of A.
        """
        return self._verdict[0]

    @property
    def message(self) -> str:
        """The status in a sentence."""
        return self._verdict[1]

    @cached_property
    def _verdict(self) -> tuple[str, str]:
        """Status and message with all that covariance, scale and pairs left out say."""
        status, message = self._first
        if status != "ok":
            return status, message
        one = self._solution
        reasons = self._uncertain()
        if int(self.used.sum()) > _FEW:
            reasons += self._not_predicted()
        if self.scale_estimated and (scale := self.scale) is not None:
            message += (
                f"; translations of B are multiplied by {scale.value:.6g} ± {scale.sigma:.2g}, "
                "estimated with X and Z"
            )
        if self._left_out > _MOST_LEFT_OUT:
            reasons += (self._left_out_words,)
        if self._is_scale_named and (one.is_grave or not one.causes) and self.scale is not None:
            depth = [change.finding.text for change in one.causes if change.kind == "depth"]
            reasons += (self.scale.in_words if self.scale.is_named or not depth else depth[0],)
        elif one.is_grave:
            return "doubtful", f"{message}; {HARDLY}"
        return (
            ("doubtful", f"{message}; but {'; '.join(reasons)}") if reasons else (status, message)
        )

    @cached_property
    def residuals(self) -> FloatArray:
        """Rotation vector [rad] and translation [m] ``(N, 6)`` by which A X differs from Z B.

        In the axes of the base.
        """
        return self._solution.residuals

    @cached_property
    def noise(self) -> Noise | None:
        """Noise of the pairs: that given, or else as the residuals show it.

        On B where they show no other, which :attr:`noise_made` tells.

        None where the status is ``"misfit"`` or ``"not converged"``.
        """
        one = self._solution
        if self._first[0] in ("misfit", "not converged"):
            return None
        if one.noise is not None:
            return one.noise
        return accuracy.noise_shown(one.found, self.residuals, self.used)

    @property
    def drift(self) -> tuple[str, ...]:
        """What changes along the sequence of pairs, in sentences."""
        said = [one.finding.text for one in self._solution.causes if not one.is_of_scale]
        if len(said) > 1 or (said and self._is_scale_named):
            said[0] += " (these pairs do not tell this apart from the next)"
        return tuple(said)

    @property
    def _left_out(self) -> float:
        """Part of the pairs that contradict the others, copies not counted."""
        one = self._solution
        counted = np.ones_like(one.used) if one.copies is None else ~one.copies
        return 1.0 - float(one.used[counted].mean())

    @property
    def _left_out_words(self) -> str:
        wrong = round(self._left_out * len(self.used))
        return (
            f"{wrong} of {len(self.used)} pairs ({100.0 * self._left_out:.0f} %) are left out as "
            "contradicting the others: so many may agree on another X and Z, and standard "
            "deviations do not cover that"
        )

    @cached_property
    def _is_scale_named(self) -> bool:
        one = self._solution
        if self.scale_estimated or one.doubts or one.others:
            return False
        if any(change.is_of_scale for change in one.causes):
            return True
        # X and Z by a scale that is far from the true one say nothing of it
        far = abs(float(np.log(by_rotations_first(one.motion.pairs)[0]))) > _FAR_SCALE
        if not far and any(change.probability < LEVEL for change in one.scale_changes):
            # of few pairs a single sign decides whether the signs agree
            scale = self.scale
            return scale is not None and scale.is_told and scale.probability < _SURE_LEVEL
        return far and self.scale is not None and self.scale.is_named

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What seems to be wrong with the pairs, each in a sentence."""
        one, N = self._solution, int(self.used.sum())
        doubts = one.doubts or self.drift
        if not doubts or (self._is_scale_named and not one.doubts):
            doubts += self._scale_doubts() + self._alone()
            if self._left_out > _MANY_LEFT_OUT:
                doubts += (self._left_out_words,)
            if not one.method.robust:
                doubts += diagnosis.outstanding(one.sizes(one.noise), one.used)
        if one.copies is not None:
            doubts += diagnosis.copies(one.copies)
        if self.noise_estimated and N < _FEWEST_FOR_SIGMA:
            part = 100.0 / np.sqrt(2.0 * (6 * N - 12))
            doubts += (
                f"{N} pairs show the noise to {part:.0f} %: 95 % intervals are up to "
                f"{self._quantiles.max():.2g} standard deviations to either side; measure more, or "
                "give the noise",
            )
        if self.noise_estimated and one.method.likelihood and not self.noise_made:
            other = explain(one.pairs.A[0], one.pairs.B[0], self.X, self.Z, one.used)
            if other is not None:
                doubts += (
                    "residuals show other noise than the one of B that is the same in all "
                    f"directions, which was taken: {other.name}",
                )
        return doubts + diagnosis.few_for_the_noise(one.motion)

    @cached_property
    def scale(self) -> Scale | None:
        """By what the translations of B have to be multiplied to fit those of A, and how sure.

        Estimated with X and Z by maximum likelihood whatever the method, from the pairs used; by
        the method itself where :attr:`scale_estimated`. None where the method has failed.
        """
        one = self._solution
        if self._first[0] not in ("ok", "doubtful") or self.noise is None:
            return None
        if one.factor is None or one.method.likelihood:
            if one.noise is None and one.motion.pairs is one.pairs:
                scale = likeliest_of_all(one.pairs)
            else:
                scale = likeliest(one.pairs, one.motion.pairs, self.used, one.noise)
        else:
            A, B = one.pairs.A[0, self.used], one.pairs.B[0, self.used]
            estimate = partial(_with_scale, one)
            covariance = accuracy.propagate(estimate, A, B, self.noise, self._excess)
            sigma = float(np.sqrt(covariance[12, 12]))
            scale = Scale(1.0, sigma, self.X, self.Z, covariance, self.freedom - 1)
        return scale if one.factor is None else scale.times(one.factor)

    @cached_property
    def rank(self) -> int:
        """Directions of X and Z, of 12, that the pairs see."""
        found = self._solution.found
        return accuracy.rank_of(self._solution.pairs, found.X, found.Z, self.used)

    @cached_property
    def covariance(self) -> FloatArray | None:
        """Covariance ``(12, 12)`` of X and Z [rad, m]; None where :attr:`noise` is.

        Of the errors of X (rotation, translation) and Z (rotation, translation). An error (w, v)
        is meant as ``R_estimated = exp([w]) R_true`` and ``p_estimated = p_true + v``: rotation
        and translation in the axes of the frame that the transform maps to, the flange for X and
        the base for Z. Scaled up where the residuals are larger than the noise given explains. A
        bias of the method, to second order, is in it by its square, and where the scale of B was
        estimated, what that adds.
        """
        if self.scale_estimated and self.scale is not None:
            joint = self.scale.covariance
            return None if joint is None else joint[:12, :12]
        one = self._solution
        if self.noise is None:
            return None
        known = not self.noise_estimated
        return accuracy.covariance_of(
            one.method,
            one.pairs,
            one.found,
            one.used,
            self._excess,
            self.noise,
            one.likeliest,
            given=known,
        )

    @cached_property
    def left_out_residuals(self) -> FloatArray:
        """Residuals ``(N, 6)`` of each pair with X and Z from all others: how well they predict."""
        one = self._solution
        poses = one.likeliest.poses if one.found.fit is not None else None
        return accuracy.left_out_residuals(
            one.method, one.pairs, one.found, one.used, one.noise, poses
        )

    @property
    def residual_rotation_rad(self) -> FloatArray:
        """Rotation angle ``(N,)`` [rad] between A X and Z B, pair by pair."""
        return np.asarray(np.linalg.norm(self.residuals[:, :3], axis=-1))

    @property
    def residual_translation_m(self) -> FloatArray:
        """Distance ``(N,)`` [m] between the origins of A X and Z B, pair by pair."""
        return np.asarray(np.linalg.norm(self.residuals[:, 3:], axis=-1))

    @property
    def rotation_rms_rad(self) -> float:
        """Root mean square of the residual rotation angles [rad] of the pairs used."""
        return _rms(self.residuals[self.used, :3])

    @property
    def translation_rms_m(self) -> float:
        """Root mean square of the residual distances [m] of the pairs used."""
        return _rms(self.residuals[self.used, 3:])

    @property
    def left_out_rotation_rms_rad(self) -> float:
        """Root mean square of the rotation angles [rad] that are left with a pair left out."""
        return _rms(self.left_out_residuals[self.used, :3])

    @property
    def left_out_translation_rms_m(self) -> float:
        """Root mean square of the distances [m] that are left with a pair left out."""
        return _rms(self.left_out_residuals[self.used, 3:])

    @property
    def sigma_X(self) -> FloatArray | None:
        """Standard deviations ``(6,)`` of X: rotation [rad], translation [m]; as covariance."""
        return None if self.covariance is None else np.sqrt(np.diag(self.covariance)[:6])

    @property
    def sigma_Z(self) -> FloatArray | None:
        """Standard deviations ``(6,)`` of Z: rotation [rad], translation [m]; as covariance."""
        return None if self.covariance is None else np.sqrt(np.diag(self.covariance)[6:])

    @property
    def half_width_X(self) -> FloatArray | None:
        """Half widths ``(6,)`` of the 95 % intervals of X, in the order of :attr:`sigma_X`.

        By Student's distribution where the noise is estimated: sigma alone is too small for few
        pairs, since the noise that they show is uncertain, too.
        """
        return None if self.sigma_X is None else self.sigma_X * self._quantiles[:6]

    @property
    def half_width_Z(self) -> FloatArray | None:
        """Half widths ``(6,)`` of the 95 % intervals of Z; as :attr:`half_width_X`."""
        return None if self.sigma_Z is None else self.sigma_Z * self._quantiles[6:]

    @cached_property
    def _quantiles(self) -> FloatArray:
        """Half widths of 95 % intervals ``(12,)`` in standard deviations."""
        if not (self.noise_estimated or self._excess > 1.0):
            return np.full(12, student_quantile(0.975, np.inf))
        freedom = self._solution.likeliest.freedom(self._solution.used)
        return np.array([student_quantile(0.975, value) for value in freedom])

    @cached_property
    def smallest_found(self) -> Mapping[str, float]:
        """Smallest changes that nine of ten such sets show, by the words for them.

        Drifts and steps [m], the delay in steps between neighbours, the scale of B in parts of it.
        What is smaller may be there, unseen. Empty for fewer than eight pairs, and for methods that
        have failed.
        """
        one = self._solution
        if self.noise is None or one.doubts or one.sequence.is_rounding:
            return {}
        every = [*one.sequence.changes, *one.scale_changes]
        return {change.label: change.smallest for change in every}

    @property
    def unseen(self) -> str:
        """Return in one sentence the smallest effects seen; empty where nothing was looked for."""
        largest: dict[str, float] = {}
        for label, size in self.smallest_found.items():
            kind = label.split(" of ")[0]
            largest[kind] = max(size, largest.get(kind, 0.0))
        said = [
            f"{kind} from {scale * size:.2g} {unit} on"
            for kind, size in largest.items()
            for unit, scale in (_UNITS.get(kind, ("mm", 1e3)),)
        ]
        return f"9 of 10 such sets show a {', a '.join(said)}" if said else ""

    @cached_property
    def other_noises(self) -> tuple[tuple[str, FloatArray], ...]:
        """Noises that the residuals allow as well, in words, and how far X and Z move by each.

        Each with the errors ``(12,)`` of X and Z [rad, m] by which the likeliest ones differ from
        these. None for methods that do not weigh by the noise.
        """
        one = self._solution
        if not one.method.likelihood or self.noise is None or one.doubts or one.others:
            return ()
        return one.by_other_noises

    @property
    def noise_words(self) -> str:
        """Return in one sentence the change of X and Z by the noise that is assumed."""
        if not self.other_noises:
            return ""
        moved = np.abs([off.reshape(4, 3) for _, off in self.other_noises])
        turned, shifted = (np.linalg.norm(moved[:, k::2], axis=2).max(axis=0) for k in (0, 1))
        return (
            f"X moves by up to {1e3 * shifted[0]:.2g} mm and {np.degrees(turned[0]):.2g} deg, Z by "
            f"{1e3 * shifted[1]:.2g} mm and {np.degrees(turned[1]):.2g} deg, by the "
            f"{len(self.other_noises)} noises that the residuals allow"
        )

    @property
    def weak_directions(self) -> tuple[str, ...]:
        """What the poses tell least about: the shift and the turn with the largest deviation."""
        return () if self.covariance is None else weakest(self.covariance)

    @property
    def headline(self) -> str:
        cycles = "" if self.iterations is None else f", {self.iterations} cycles"
        return f"A X = Z B by {self.method}: {self.status}{cycles}"

    def rows(self) -> list[dict[str, object]]:
        """X and Z in mm and deg, with their standard deviations where those are known."""
        found: list[dict[str, object]] = []
        for name, T, sigma in (("X", self.X, self.sigma_X), ("Z", self.Z, self.sigma_Z)):
            turn = np.degrees(se3.wpr_from_rotation(T[:3, :3]))
            numbers = [*(1e3 * T[:3, 3]), *turn]
            row = dict(zip(_AXES, map(float, numbers), strict=True))
            if sigma is not None:
                spread = [*(1e3 * sigma[3:]), *np.degrees(sigma[:3])]
                row |= dict(zip(_SIGMA_AXES, map(float, spread), strict=True))
            found.append({"transform": name, **row})
        return found

    def summary(self) -> str:
        """Text for people: X and Z in mm and W, P, R in degrees, residuals, deviations."""
        lines = [self.headline, self.message]
        for name, T, sigma in (("X", self.X, self.sigma_X), ("Z", self.Z, self.sigma_Z)):
            lines.append(f"{name}  x y z {_three(T[:3, 3] * 1e3)} mm")
            lines.append(f"   W P R {_three(np.degrees(se3.wpr_from_rotation(T[:3, :3])))} deg")
            if sigma is not None:
                lines.append(f"   sigma {_three(sigma[3:] * 1e3)} mm")
                lines.append(f"   sigma {_three(np.degrees(sigma[:3]))} deg about x y z")
            half = self.half_width_X if name == "X" else self.half_width_Z
            if half is not None:
                lines.append(f"   95 % ± {_three(half[3:] * 1e3)} mm")
                lines.append(f"   95 % ± {_three(np.degrees(half[:3]))} deg about x y z")
        lines.append(
            f"residuals of {int(self.used.sum())} pairs, rms: "
            f"{np.degrees(self.rotation_rms_rad):.4f} deg, {self.translation_rms_m * 1e3:.4f} mm"
        )
        lines.append(
            "each pair left out, rms: "
            f"{np.degrees(self.left_out_rotation_rms_rad):.4f} deg, "
            f"{self.left_out_translation_rms_m * 1e3:.4f} mm"
        )
        if self.chi2 is not None:
            lines.append(
                f"chi² {self.chi2:.1f} of {self.freedom} degrees of freedom: probability "
                f"{self.chi2_probability:.2g} with the noise given"
            )
        if self.scale is not None:
            lines.append(
                f"scale of B's translations {self.scale.value:.6g}, sigma {self.scale.sigma:.2g}"
            )
        lines += [text for text in (self.unseen, self.noise_words) if text]
        lines += [f"known least: {text}" for text in self.weak_directions]
        lines += [f"ambiguous: {text}" for text in self.ambiguities]
        lines += [f"warning: {text}" for text in self.warnings]
        return "\n".join(lines)

    def _alone(self) -> tuple[str, ...]:
        """Pairs that X and Z hang on: no residual shows it if they are wrong."""
        one = np.isnan(self.left_out_residuals).any(axis=-1) & self.used
        N = int(self.used.sum())
        if N <= _FEWEST_LEFT or not one.any():
            return self._not_predicted() if N <= _FEW else ()
        return (
            f"without {diagnosis.named(one)} the others identify nothing: X and Z hang on it alone",
        )

    def _scale_doubts(self) -> tuple[str, ...]:
        """What the scale of B's translations says of the pairs, in sentences."""
        if self.noise is None or self._solution.sequence.is_rounding:
            return ()
        if not self._is_scale_named:
            return () if self.scale_estimated else self._scale_unknown()
        scale = self.scale
        causes = [one for one in self._solution.causes if one.is_of_scale]
        if scale is None or (causes and causes[0].kind == "depth" and not scale.is_named):
            return tuple(one.finding.text for one in causes[:1])
        turned_rad, moved_m = moved(scale, self.X, self.Z)
        return (
            f"{scale.in_words}: that turns X and Z by up to {np.degrees(turned_rad):.2g} deg and "
            f"moves them by up to {1e3 * moved_m:.3g} mm; check the size of the target (tag, "
            "squares of a board), the unit of length and the focal length, or the unit of A, since "
            "the pairs tell the ratio of both alone; estimate_scale corrects B",
        )

    def _scale_unknown(self) -> tuple[str, ...]:
        """Say how well the pairs tell the scale where a wrong one would go unnoticed."""
        without = "measure from other distances and sides"
        said = "a wrong size of the target, unit or focal length would go unnoticed"
        changes = self._solution.scale_changes
        if not any(change.kind == "scale" for change in changes):
            return (f"the pairs tell the scale of B's translations not at all: {said}; {without}",)
        worst = max(changes, key=lambda one: one.sigma)
        sigmas = worst.effect(WRONG)
        if abs(float(worst.estimate[0])) + _SURELY * worst.sigma < WRONG or sigmas < 1.0:
            return ()
        whose = "scale of B's translations" if worst.kind == "scale" else "scale of B's depth"
        return (
            f"the pairs tell the {whose} to {100.0 * worst.sigma:.2g} %: {said} "
            f"and move X and Z by up to {sigmas:.2g} of their standard deviations for each "
            f"{100.0 * WRONG:.0f} %; {without}",
        )

    def _uncertain(self) -> tuple[str, ...]:
        """Directions of X and Z that are not identified well enough."""
        covariance = self.covariance
        size = float(self._solution.motion.pairs.size[0])
        said: tuple[str, ...] = ()
        if covariance is not None and too_uncertain(covariance[None], np.array([size]))[0]:
            said += (
                "the pairs do not identify X and Z by this method: known least are "
                f"{' and '.join(weakest(covariance))}, where "
                f"{np.degrees(LARGEST_SIGMA_RAD):.0f} deg and a tenth of how far the poses move "
                f"({1e3 * LARGEST_SIGMA * size:.3g} mm) are the most for a calibration",
            )
        if self.scale_estimated and (scale := self.scale) is not None and not scale.is_told:
            said += (
                f"the pairs tell the scale of B to {100.0 * scale.sigma / scale.value:.2g} % only",
            )
        return said

    def _not_predicted(self) -> tuple[str, ...]:
        """Pairs that X and Z from the others do not predict as well as they fit."""
        motion = self._solution.motion
        turned_rad, size = float(motion.turned_rad[0]), float(motion.pairs.size[0])
        N = int(self.used.sum())
        left = self.left_out_residuals[self.used]
        left = left[~np.isnan(left).any(axis=-1)]
        if not len(left):
            return ()
        predicted = np.sqrt((left**2).reshape(-1, 2, 3).sum(axis=-1).mean(axis=0))
        said = []
        for unit, scale, fits, predicts, whole in (
            ("deg", 180.0 / np.pi, self.rotation_rms_rad, predicted[0], turned_rad),
            ("mm", 1e3, self.translation_rms_m, predicted[1], size),
        ):
            bound = LEFT_OUT * fits if N > _FEW else max(LEFT_OUT * fits, diagnosis.POOR * whole)
            if predicts > max(bound, _ROUNDING * whole):
                said.append(f"{scale * predicts:.3g} {unit} in place of {scale * fits:.3g} {unit}")
        if not said:
            return ()
        return (
            f"pairs that are left out are off by {', '.join(said)}: X and Z hang on single pairs",
        )


def weakest(covariance: FloatArray) -> tuple[str, ...]:
    """In words, the turn and the shift of X or Z with the largest standard deviations."""
    said = []
    for what, first, unit, scale in (
        ("rotation", 0, "deg", 180.0 / np.pi),
        ("translation", 3, "mm", 1e3),
    ):
        most: tuple[float, str] = (0.0, "")
        for name, frame, at in (("X", "flange", 0), ("Z", "base", 6)):
            own = slice(at + first, at + first + 3)
            values, vectors = np.linalg.eigh(covariance[own, own])
            sigma = scale * float(np.sqrt(max(values[-1], 0.0)))
            way = "about" if unit == "deg" else "along"
            text = f"{what} of {name} {way} {direction(vectors[:, -1])} of the {frame}"
            most = max(most, (sigma, f"{text}: {sigma:.3g} {unit}"))
        said.append(most[1])
    return tuple(said)


def too_uncertain(covariance: FloatArray, size: FloatArray) -> BoolArray:
    """Whether covariances ``(T, 12, 12)`` leave X or Z unknown, with the poses' motion ``(T,)``."""
    sigma = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1)).reshape(-1, 2, 2, 3)
    # a comparison that a number which is none fails
    known = (sigma[:, :, 0] < LARGEST_SIGMA_RAD).all(axis=(1, 2))
    known &= (sigma[:, :, 1] < LARGEST_SIGMA * size[:, None, None]).all(axis=(1, 2))
    return np.asarray(~known)


def _with_scale(one: Solution, pairs: PairSets) -> Estimate:
    """What a method without a likelihood finds when the scale is estimated as well."""
    factor = by_rotations_first(pairs)
    return replace(one.method.estimate(scaled(pairs, factor)), scale=factor)


def _rms(vectors: FloatArray) -> float:
    return float(np.sqrt((vectors**2).sum(axis=-1).mean())) if len(vectors) else float("nan")


def _three(values: FloatArray) -> str:
    return " ".join(f"{value:11.4f}" for value in values)


def pairs_from_opencv(
    world2cam: ArrayLike, base2gripper: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """A = T_base_flange and B = T_target_camera from what OpenCV's function takes.

    Parameters
    ----------
    world2cam : array_like (N, 4, 4)
        T_camera_target [m]: its arguments ``R_world2cam`` and ``t_world2cam``.
    base2gripper : array_like (N, 4, 4)
        T_flange_base [m]: its arguments ``R_base2gripper`` and ``t_base2gripper``.

    Returns
    -------
    A, B : ndarray (N, 4, 4)
        What :func:`calib.robot_world.solve` takes.

    Raises
    ------
    InputError
        A matrix is not a rigid transform.
    """
    T_camera_target = se3.check_transforms(world2cam, "world2cam")
    T_flange_base = se3.check_transforms(base2gripper, "base2gripper")
    return se3.inverse(T_flange_base), se3.inverse(T_camera_target)


def result_to_opencv(result: RobotWorldResult) -> tuple[FloatArray, FloatArray]:
    """``base2world`` = T_target_base and ``gripper2cam`` = T_camera_flange ``(4, 4)`` [m].

    Raises
    ------
    InputError
        Something else than a result.
    """
    if not isinstance(result, RobotWorldResult):
        raise InputError(f"{one_line(result)} is no result of solve", name="result")
    return se3.inverse(result.Z), se3.inverse(result.X)
