"""Priors from the measurements themselves: empirical Bayes.

How large errors of a kind are on this arm, its lengths, its bearings, its reducers, shows in how
many parameters of the kind together explain. Parameters of a group share one standard deviation
about their nominal values; it is that for which the measurements are likeliest, whatever the
parameters are: their marginal likelihood. Noise that nobody has given is found in the same way. The
problem is linearised, solved and weighted again until nothing moves.

The marginal likelihood of a linearised problem is Gaussian throughout, so in closed form, and its
gradient too. Parameters that nothing is known of are integrated out as well (restricted maximum
likelihood: Patterson and Thompson, Biometrika 58, 1971; Harville, J. Am. Stat. Assoc. 72, 1977): a
parameter that fits noise makes it no smaller.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.errors import ConvergenceError, InputError, near_names
from calib.identification.identifiability import check_enough, check_identifiable_at
from calib.identification.least_squares import column_lengths, first_guess
from calib.identification.result import Loss
from calib.identification.robust import (
    WEIGHTS,
    costs_of,
    distances2,
    judged_together,
    log_weights,
    rows_judged,
)
from calib.model import CalibrationModel, Linearisation, Setup
from calib.model.measurements import Measurements
from calib.one_thread import one_blas_thread
from calib.se3 import BoolArray, FloatArray, IntArray

LOSSES: tuple[Loss, ...] = ("least-squares", "student-t")
"""Losses under which a marginal likelihood is what it says: Student's noise is Gaussian with a
variance of its own for each measurement."""

NOISE_BOUNDS = (1e-2, 1e3)
"""Of noise that is to be found, over the noise that its kind starts with: 1 um to 0.1 m."""

USUAL_WITHIN = np.log(3.0)
"""Standard deviation of the logarithm of a size about the usual one."""

_PASSES = 100
SETTLED = 1e-3
"""Change of weights and of the logarithms of standard deviations below which they have settled:
a hundredth of how well the best of them can be known."""

_CURVATURE_STEP = 0.05
"""Of logarithms, for second derivatives by differences of the gradient: sizes are known to some
.2 and worse."""

_AT_BOUND = 1e-3
"""Distance of a logarithm from that of a bound within which it stands there."""


@dataclass(frozen=True)
class PriorGroup:
    """Parameters taken to be of one size, or of sizes in the proportions of their priors."""

    name: str  # in words, for reports
    parameters: tuple[str, ...]  # names, as the model has them; of one unit
    lower: float
    upper: float
    """lower, upper: bounds of the standard deviation [SI], the root mean square where sizes differ.
    They say what is possible for the arm, and have to be given: touch-ups do not see the scale of
    all lengths, and without bounds the likeliest arm may be one that shrinks until its residuals
    are small."""
    usual: float | None = None
    """What the standard deviation is for such arms, within a factor of three [SI]: a few parameters
    do not tell it well. Without it every size within the bounds is as likely."""

    def __post_init__(self) -> None:
        if not self.parameters:
            raise InputError(f"the group {self.name!r} has no parameters", name=self.name)
        if not 0.0 < self.lower <= self.upper < np.inf:
            raise InputError(
                f"the bounds {self.lower:g} and {self.upper:g} of the group {self.name!r} are not "
                "two numbers above zero in order",
                name=self.name,
            )


_KINDS = {
    ("zero_offset", "rad"): "offsets",
    ("link", "m"): "lengths",
    ("link", "rad"): "angles",
    ("lost_motion", "rad"): "lost motion",
}
"""What parameters of one size are called in reports, where not by the first word of their name."""


def groups_of(
    model: CalibrationModel, lower: float, upper: float, *, usual: bool = False
) -> tuple[PriorGroup, ...]:
    """Parameters with a prior that are of one kind, to be found how large they are.

    Those of the robot: what is known of tool and targets is of this set-up, and stays as given.

    ``lower``, ``upper``: bounds of a standard deviation over the one of the prior. ``usual``: take
    that for what it is for such arms.
    """
    members: dict[tuple[str, str], list[int]] = {}
    for k in np.flatnonzero(np.isfinite(model.prior) & ~model.nuisance).tolist():
        members.setdefault((model.names[k].partition(".")[0], model.units[k]), []).append(k)
    groups = []
    for kind, own in members.items():
        size = float(np.sqrt(np.mean(model.prior[own] ** 2)))
        names = tuple(model.names[k] for k in own)
        bounds = lower * size, upper * size
        groups.append(
            PriorGroup(_KINDS.get(kind, kind[0]), names, *bounds, size if usual else None)
        )
    return tuple(groups)


@dataclass(frozen=True, eq=False)
class TunedPriors:
    """Priors and noise for which the measurements are likeliest."""

    model: CalibrationModel
    """With these priors and this noise: for :func:`calib.identify` with the same loss."""
    groups: tuple[PriorGroup, ...]
    sigma: FloatArray  # (G,): standard deviation of each group [SI]
    log_evidence: float
    """Logarithm of the marginal likelihood of the linearised problem at these sizes and this noise,
    weights as they are."""
    log_marginal: float
    """The same over all sizes and noises, too (Laplace's approximation), and for Student's loss
    over the weights: it compares models of the same measurements, loss and parameters without a
    prior."""
    x: FloatArray
    """(p,): parameters [SI]; :func:`calib.identify` finds the same, and what they are worth."""
    weights: FloatArray  # (N,): of the squares of each measurement
    covariance: FloatArray
    """(p, p): what parameters are uncertain by because the sizes are [SI], to be added to the
    covariance of a fit with the priors: the law of total variance, by the curvature of the
    likelihood."""
    passes: int  # linearisations
    notes: tuple[str, ...]  # groups whose standard deviation stands at a bound


@dataclass(frozen=True, eq=False)
class Similar:
    """Values found of a model, from which a similar model starts."""

    names: tuple[str, ...]  # of its parameters
    x: FloatArray  # (p,) [SI]
    weights: FloatArray | None  # (N,): of the squares of the measurements, where they are known
    sizes: Mapping[str, float]  # standard deviations of groups, by their names [SI]

    def start_of(self, model: CalibrationModel) -> FloatArray:
        """Return parameters ``(p,)`` of another model: those in common as found."""
        values = dict(zip(self.names, self.x.tolist(), strict=True))
        pairs = zip(model.names, model.nominal.tolist(), strict=True)
        return np.array([values.get(name, nominal) for name, nominal in pairs])


@one_blas_thread
def tune_priors(
    model: CalibrationModel,
    data: Measurements,
    groups: Sequence[PriorGroup],
    *,
    loss: Loss = "least-squares",
    noise_bounds: tuple[float, float] = NOISE_BOUNDS,
    like: Similar | None = None,
    identifiable: bool = False,
    settled: float = SETTLED,
) -> TunedPriors:
    """Find the standard deviations of groups of parameters, and noise that is not known.

    Parameters
    ----------
    model : CalibrationModel
        Its priors of parameters that are in no group stay as they are.
    data : Measurements
        One set.
    loss : {"least-squares", "student-t"}
        As in the identification that is to follow.
    noise_bounds : tuple of float
        Of noise that is to be estimated, over what it starts with.
    like : Similar, optional
        What was found of a similar model with the same measurements, to start from.
    identifiable : bool
        That a model was checked which has these parameters, and more: this one needs no check.
    settled : float
        Change of weights and of logarithms of sizes below which they have settled.

    Raises
    ------
    InputError
        Groups that do not fit the model or each other, another loss, too few measurements.
    NotIdentifiableError
        Parameters that measurements and priors leave open.
    ConvergenceError
        Priors and weights that do not come to rest.
    """
    groups = tuple(groups)
    members = members_of(model, groups)
    if loss not in LOSSES:
        raise InputError(
            f"priors cannot be found under the loss {loss!r}",
            hint="one of " + ", ".join(LOSSES),
            name="loss",
        )
    known = _Known.of(groups, len(noise_classes(model, data.setup)), noise_bounds)
    theta = known.bounds.mean(axis=0)  # the middle of what is possible
    theta[len(groups) :] = np.clip(0.0, *known.bounds[:, len(groups) :])  # what noise starts with
    if like is not None:
        sizes = [np.log(like.sizes.get(group.name, np.exp(theta[g]))) for g, group in
                 enumerate(groups)]  # fmt: skip
        theta[: len(groups)] = np.clip(sizes, *known.bounds[:, : len(groups)])
    tuned = _applied(model, data, members, theta)
    check_enough(tuned, data)
    x = first_guess(tuned, data) if like is None else like.start_of(model)
    if not identifiable:
        check_identifiable_at(tuned, data, x)
    rows = rows_judged(model, data.setup)
    w = np.ones(data.count) if like is None or like.weights is None else like.weights

    def linearised() -> LinearEvidence:
        linear = model.linearise_at(data, x)
        shares = w / costs_of(linear.by(tuned), w, loss)[0]  # as the fit has them
        return linear_evidence(linear, members, shares)

    for passes in range(_PASSES):  # linearise, maximise, solve and weigh
        problem, before = linearised(), theta
        if (
            passes or like is not None
        ):  # at first the arm is linearised as described, too far off to tell sizes by
            theta = known.likeliest(problem, theta)
        x = problem.parameters(theta)
        tuned = _applied(model, data, members, theta)
        lighter, w = w, WEIGHTS[loss](distances2(tuned, data, x), rows)
        moved = max(np.abs(theta - before).max(initial=0.0), np.abs(w - lighter).max())
        if moved < settled and passes > 1:
            break
    else:
        raise ConvergenceError(
            f"the priors have not come to rest after {_PASSES} passes (the last one still moved "
            f"them by {moved:.2g} of their size)",
            hint="free fewer groups, or give narrower bounds",
        )
    problem = linearised()
    curvature = known.information(problem, theta)
    log_evidence = problem.log_evidence(theta)[0]
    log_marginal = log_evidence + known.log_volume(curvature, theta)
    if loss == "student-t":
        alike = judged_together(model, data.setup, np.ones(data.count))
        log_marginal += log_weights(w, 1.0 / alike)
    moves = problem.sensitivity(theta)
    return TunedPriors(
        model=tuned,
        groups=groups,
        sigma=np.exp(theta[: len(groups)]),
        log_evidence=log_evidence,
        log_marginal=log_marginal,
        x=x,
        weights=w,
        covariance=moves @ np.linalg.solve(curvature, moves.T),
        passes=passes + 1,
        notes=tuple(_notes(groups, theta, known.bounds)),
    )


def _applied(
    model: CalibrationModel, data: Measurements, members: Sequence[IntArray], theta: FloatArray
) -> CalibrationModel:
    """The model with the priors and the noise that the logarithms ``(G + C,)`` say."""
    prior = model.prior.copy()
    for columns, log_sigma in zip(members, theta, strict=False):
        prior[columns] = np.exp(log_sigma) * proportions(model.prior[columns])
    scales = np.ones((data.count, model.rows))
    for own, log_scale in zip(noise_classes(model, data.setup), theta[len(members) :], strict=True):
        scales[own] = np.exp(log_scale)
    kinds = []
    for k, kind in enumerate(model.measurements):
        of = np.flatnonzero(data.setup.kind == k)
        kinds.append(kind.with_noise(scales[of[0], : kind.rows]) if of.size else kind)
    return model.with_prior(prior).with_measurements(kinds)


@dataclass(frozen=True, eq=False)
class _Known:
    """What is known of the logarithms of sizes and noise before the measurements."""

    bounds: FloatArray  # (2, G + C)
    usual: FloatArray
    """(G + C,): NaN where none is known, as of noise: then as if uniform between the bounds."""

    @classmethod
    def of(cls, groups: Sequence[PriorGroup], noises: int, noise: tuple[float, float]) -> _Known:
        low, high = noise
        if not 0.0 < low <= high < np.inf:
            raise InputError(
                f"the bounds {low:g} and {high:g} of the noise are not two numbers above zero in "
                "order",
                name="noise_bounds",
            )
        every = [(group.lower, group.upper) for group in groups] + [noise] * noises
        usual = [np.nan if group.usual is None else np.log(group.usual) for group in groups]
        bounds = np.log(np.array(every, dtype=float).reshape(-1, 2)).T
        return cls(bounds, np.array(usual + [np.nan] * noises))

    def slope(self, problem: LinearEvidence, theta: FloatArray) -> tuple[float, FloatArray]:
        """Logarithm of how likely they are after the measurements, and its gradient."""
        value, gradient = problem.log_evidence(theta)
        off = np.nan_to_num((theta - self.usual) / USUAL_WITHIN)
        return value - 0.5 * float(off @ off), gradient - off / USUAL_WITHIN

    def likeliest(self, problem: LinearEvidence, theta: FloatArray) -> FloatArray:
        """Those for which the linearised problem is likeliest, from those of the pass before."""
        if not theta.size:
            return theta

        from scipy.optimize import minimize

        # in units of what each is known by at best: no direction is much steeper than others
        unit = 1.0 / np.sqrt(2.0 * problem.counts)

        def worse(t: FloatArray) -> tuple[float, FloatArray]:
            value, gradient = self.slope(problem, t * unit)
            return -value, -gradient * unit

        found = minimize(
            worse,
            np.clip(theta, *self.bounds) / unit,
            jac=True,
            method="L-BFGS-B",
            bounds=list(zip(*(self.bounds / unit), strict=True)),
            options={"maxiter": 300, "ftol": 1e-13, "gtol": 1e-5},
        )
        return np.clip(found.x * unit, *self.bounds)

    def information(self, problem: LinearEvidence, theta: FloatArray) -> FloatArray:
        """Information ``(G + C, G + C)``: the curvature, but no less than the bounds give."""
        step = _CURVATURE_STEP * np.eye(len(theta))
        curvature = [
            (self.slope(problem, theta + s)[1] - self.slope(problem, theta - s)[1])
            / (2.0 * _CURVATURE_STEP)
            for s in step
        ]
        least = 12.0 / np.maximum(np.ptp(self.bounds, axis=0), _CURVATURE_STEP) ** 2
        information = -np.asarray(curvature).reshape(len(theta), len(theta)) + np.diag(least)
        values, vectors = np.linalg.eigh((information + information.T) / 2.0)
        return np.asarray((vectors * np.maximum(values, least.min(initial=np.inf))) @ vectors.T)

    def log_volume(self, information: FloatArray, theta: FloatArray) -> float:
        """Logarithm of the share of all that they may be which the measurements leave.

        Laplace's approximation: the prior at the likeliest sizes (MacKay 1992, "Bayesian
        interpolation"), log-normal about the usual one or uniform between the bounds, times the
        volume of what is as likely.
        """
        known = np.isfinite(self.usual)
        off = (theta - self.usual)[known] / USUAL_WITHIN
        prior = -0.5 * off @ off - known.sum() * np.log(USUAL_WITHIN * np.sqrt(2.0 * np.pi))
        prior -= np.log(np.maximum(np.ptp(self.bounds[:, ~known], axis=0), _CURVATURE_STEP)).sum()
        return float(prior - 0.5 * np.linalg.slogdet(information / (2.0 * np.pi))[1])


def members_of(model: CalibrationModel, groups: Sequence[PriorGroup]) -> tuple[IntArray, ...]:
    """Columns of the parameters of each group."""
    taken: dict[str, str] = {}
    members = []
    for group in groups:
        for name in group.parameters:
            if name not in model.names:
                raise InputError(
                    f"the group {group.name!r} names {name!r}, which is no parameter of the model",
                    hint=near_names(name, model.names),
                    name=name,
                )
            if name in taken:
                raise InputError(
                    f"{name} is in two groups, {taken[name]!r} and {group.name!r}",
                    hint="put it in one",
                    name=name,
                )
            taken[name] = group.name
        columns = np.array([model.names.index(name) for name in group.parameters], dtype=np.intp)
        units = {model.units[k] for k in columns}
        if len(units) > 1:
            raise InputError(
                f"the group {group.name!r} mixes units: {', '.join(sorted(units))}",
                hint="one standard deviation has one unit: make two groups",
                name=group.name,
            )
        members.append(columns)
    return tuple(members)


def _notes(groups: Sequence[PriorGroup], theta: FloatArray, bounds: FloatArray) -> list[str]:
    notes = []
    for g, group in enumerate(groups):
        for bound, side in zip(bounds[:, g], ("lower", "upper"), strict=True):
            if group.lower < group.upper and abs(theta[g] - bound) < _AT_BOUND:
                notes.append(f"the prior of the group {group.name!r} stands at its {side} bound")
    return notes


@dataclass(frozen=True, eq=False)
class LinearEvidence:
    """Marginal likelihood of a linearised problem, as a function of its standard deviations.

    Parameters are ``x = nominal + unit z``; rows ``B_c z - y_c`` of the class c have the variance
    ``exp(2 t_c)``: of each group those of its prior, then of each noise what is measured with it,
    over what it starts with. Those of the last class have the variance 1: what is measured with
    noise that is given, and what is known besides.
    """

    nominal: FloatArray
    unit: FloatArray  # nominal, unit (p,)
    grams: FloatArray  # (C + 1, p + 1, p + 1): ``[B y]ᵀ[B y]`` of each class
    counts: FloatArray  # (C,): rows of each class but the last
    constant: float  # what of the logarithm no standard deviation changes

    def _solve(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, float, FloatArray]:
        """Best ``[z -1]`` (p + 1,), covariance ``(p, p)`` of z, half log of its inverse, weights.

        The weights ``(C + 1,)`` are the precisions of the classes.
        """
        from scipy.linalg.lapack import dpotrf, dpotri

        precisions = np.append(np.exp(-2.0 * theta), 1.0)
        gram = np.tensordot(precisions, self.grams, axes=1)
        factor, failed = dpotrf(gram[:-1, :-1])
        if failed:
            raise ConvergenceError(
                "sizes of priors cannot be found: at some of them rounding hides what the "
                "measurements tell",
                hint="give the noise of the measurements, or free fewer parameters",
            )
        upper = np.triu(dpotri(factor)[0])
        covariance = upper + np.triu(upper, 1).T
        half_log = float(np.log(np.diag(factor)).sum())
        return np.append(covariance @ gram[:-1, -1], -1.0), covariance, half_log, precisions

    def parameters(self, theta: FloatArray) -> FloatArray:
        """Likeliest parameters ``(p,)`` [SI]."""
        return np.asarray(self.nominal + self.unit * self._solve(theta)[0][:-1])

    def sensitivity(self, theta: FloatArray) -> FloatArray:
        """Derivatives ``(p, C)`` of the likeliest parameters [SI], see :meth:`log_evidence`.

        Of ``H z = b``, in closed form: differences would amplify the rounding of the solution.
        """
        ends, covariance, _, precisions = self._solve(theta)
        pulls = 2.0 * precisions[:-1, None] * (self.grams[:-1, :-1] @ ends)
        return np.asarray(self.unit[:, None] * (covariance @ pulls.T))

    def log_evidence(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """Logarithm of the marginal likelihood, and its gradient ``(C,)``.

        Parameters
        ----------
        theta : array (C,)
            Logarithms of the standard deviations of the groups [SI], then of the noise of the
            others over what it starts with.
        """
        ends, covariance, half_log, precisions = self._solve(theta)
        squares = self.grams @ ends @ ends  # of the residuals of each class
        value = self.constant - 0.5 * squares @ precisions - half_log - self.counts @ theta
        taken = np.tensordot(self.grams[:-1, :-1, :-1], covariance)
        return float(value), precisions[:-1] * (squares[:-1] + taken) - self.counts


def linear_evidence(
    linear: Linearisation, members: Sequence[IntArray], weights: FloatArray
) -> LinearEvidence:
    """The evidence of one set linearised, with weights ``(N,)`` of the squares of measurements.

    Priors of the members of a group are in the proportions that the model has them in.
    """
    model, setup, x = linear.model, linear.view.setup, linear.values[:, 0]
    tied, shares = np.zeros(model.p, dtype=bool), np.ones(model.p)
    for columns in members:
        tied[columns] = True
        shares[columns] = proportions(model.prior[columns])
    fixed = model.with_prior(np.where(tied, np.inf, model.prior))
    weighed = linear.weighed(weights)
    rows, J = weighed.white_rows, weighed.white_jacobian
    known, K = (each[0] for each in fixed.known(x[None]))
    unit = 1.0 / column_lengths(np.concatenate([J.reshape(-1, model.p), K]))

    def gram(rows: FloatArray, J: FloatArray) -> FloatArray:
        both = np.column_stack([J * unit, J @ (x - model.nominal) - rows])
        return np.asarray(both.T @ both)

    there = setup.seen  # rows that measurements have; others fill the block
    if there is None:
        there = np.arange(model.rows) < model.rows_read(setup)[:, None]
    classes = noise_classes(model, setup)
    rest = there & ~np.any(classes, axis=0) if classes else there
    priors = np.zeros((len(members), model.p + 1, model.p + 1))
    for own, columns in zip(priors, members, strict=True):
        own[columns, columns] = (unit / shares)[columns] ** 2
    found = [*priors, *(gram(rows[own], J[own]) for own in classes)]
    counts = [len(columns) for columns in members] + [own.sum() for own in classes]
    # densities of the rows as they were, before noise and weights divided them, and of what is
    # known besides
    sigma = np.ones(there.shape)
    for k, kind in enumerate(model.measurements):
        sigma[setup.kind == k, : kind.rows] = kind.sigma
    given = [fixed.prior[np.isfinite(fixed.prior)], [known.sigma_m for known in model.distances]]
    constant = np.log(np.sqrt(weights)[:, None] / sigma)[there].sum() + np.log(unit / shares).sum()
    constant -= np.log(np.concatenate(given)).sum()
    shared = model.shared_deviation(linear.view)
    if shared is not None:
        constant -= 0.5 * shared.log_det
    left = int(there.sum()) + len(known) + int(tied.sum()) - model.p
    return LinearEvidence(
        model.nominal,
        unit,
        np.array([*found, gram(rows[rest], J[rest]) + gram(known, K)]),
        np.array(counts, dtype=float),
        float(constant - 0.5 * left * np.log(2.0 * np.pi)),
    )


def proportions(prior: FloatArray) -> FloatArray:
    """Standard deviations of a group over their root mean square; equal where it has none."""
    if not np.isfinite(prior).all():
        return np.ones_like(prior)
    return np.asarray(prior / np.sqrt(np.mean(prior**2)))


def noise_classes(model: CalibrationModel, setup: Setup) -> list[BoolArray]:
    """Rows ``(N, m)`` of each noise to be found: of a kind, those that start with the same.

    Its lengths and its angles apart, and axes apart that were given different noise.
    """
    found = []
    for k, kind in enumerate(model.measurements):
        measured = setup.kind == k
        if not (kind.estimated and measured.any()):
            continue
        is_angle = np.arange(kind.rows) >= kind.rows - kind.turns
        alike = np.unique(np.column_stack([is_angle, kind.sigma]), axis=0, return_inverse=True)[1]
        for part in range(alike.max() + 1):
            own = np.zeros((setup.count, model.rows), dtype=bool)
            own[np.ix_(measured, np.flatnonzero(alike.ravel() == part))] = True
            found.append(own)
    return found
