"""Priors from the measurements: the marginal likelihood, and the sizes that it finds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal
from scipy.stats import t as student

from calib import CalibrationModel, Robot, identify
from calib.errors import ConvergenceError, InputError, NotIdentifiableError
from calib.identification import PriorGroup, TunedPriors, tune_priors
from calib.identification.evidence import groups_of, linear_evidence
from calib.identification.robust import STUDENT_FREEDOM, WEIGHTS, distances2, log_weights
from calib.model import KnownDistance, Setup, simulate
from calib.model.measurements import Measurement, Measurements, Point, Pose
from calib.model.parameters import (
    LinkGeometry,
    ParameterBlock,
    TargetFrame,
    TargetPoints,
    ToolPoint,
    ZeroOffsets,
)

ROBOT = Robot.preset("ur5e")
LENGTHS = tuple(f"link.{joint}.{axis}" for joint in ROBOT.joint_names for axis in "xyz")
ANGLES = tuple(f"link.{joint}.{axis}" for joint in ROBOT.joint_names for axis in ("rx", "ry", "rz"))
GROUPS = (PriorGroup("lengths", LENGTHS, 1e-5, 1e-2), PriorGroup("angles", ANGLES, 1e-5, 1e-2))
TRUE_SIZES = np.array([6e-4, 1e-3])
NOISE_M = 8e-5


def model_of(
    kinds: Measurement | list[Measurement], *more: ParameterBlock, free: bool = True
) -> CalibrationModel:
    tool = ToolPoint([0.1, -0.05, 0.2], "xyz" if free else "")
    frame = TargetFrame(np.eye(4), free=("x", "y", "z", "rx", "ry", "rz") if free else ())
    return CalibrationModel(ROBOT, [LinkGeometry(ROBOT), *more, tool, frame], kinds)


def draw(seed: int, count: int = 40, kind: Measurement | None = None) -> Measurements:
    """Points or poses of an arm whose errors are of the true sizes."""
    rng = np.random.default_rng(seed)
    truth = model_of(Point(NOISE_M) if kind is None else kind)
    x = truth.nominal.copy()
    for group, size in zip(GROUPS, TRUE_SIZES, strict=True):
        for name in group.parameters:
            x[truth.names.index(name)] = rng.normal(0.0, size)
    q = rng.uniform(-2.5, 2.5, (count, ROBOT.n))
    return simulate(truth, x, q, rng)


def problem_of(model: CalibrationModel, data: Measurements, groups=GROUPS, weights=None, x=None):
    members = [np.array([model.names.index(n) for n in g.parameters]) for g in groups]
    w = np.ones(data.count) if weights is None else weights
    return linear_evidence(model.linearise_at(data, model.nominal if x is None else x), members, w)


def solved(model: CalibrationModel, data: Measurements, found: TunedPriors, groups=GROUPS):
    """The problem linearised where it was solved, and the logarithms found."""
    scale = found.model.measurement.sigma[0] / model.measurement.sigma[0]
    problem = problem_of(model, data, groups, found.weights, found.x)
    return problem, np.log([*found.sigma, scale])


@pytest.mark.parametrize("weighted", [False, True])
def test_evidence_is_the_density_of_the_measurements(weighted):
    """With a prior on every parameter: that of a Gaussian vector, by another package."""
    kinds: list[Measurement] = [Point([1e-4, 2e-4, 3e-4]), Pose(None)]
    model = model_of(kinds, ZeroOffsets(ROBOT, ROBOT.joint_names[:2], 2e-3), free=False)
    rng = np.random.default_rng(0)
    setup = Setup.of(8, kind=[0, 1] * 4)
    q = rng.uniform(-2.0, 2.0, (8, ROBOT.n))
    data = simulate(model, model.nominal + 1e-3, q, rng, setup=setup)
    weights = rng.uniform(0.2, 2.0, 8) if weighted else np.ones(8)
    theta = np.log([6e-4, 1e-3, 1.7, 0.6])  # of the groups; of the lengths and angles of poses
    found = problem_of(model, data, weights=weights).log_evidence(theta)[0]

    linear = model.linearise(q, model.nominal, setup, data.observed)
    there = np.arange(6) < np.where(setup.kind == 0, 3, 6)[:, None]
    noise = np.where(setup.kind == 0, 0.0, 1.0)[:, None] * (1e-4 * np.repeat([1.7, 0.6], 3))
    noise[setup.kind == 0, :3] = [1e-4, 2e-4, 3e-4]
    noise = noise / np.sqrt(weights)[:, None]
    sizes = np.concatenate([np.tile(np.repeat([6e-4, 1e-3], 3), ROBOT.n), [2e-3, 2e-3]])
    J = linear.jacobian[there] * sizes
    covariance = J @ J.T + np.diag(noise[there] ** 2)
    mean = np.zeros(len(J))
    expected = multivariate_normal(mean, covariance).logpdf(linear.rows[there])
    assert found == pytest.approx(expected, abs=1e-6)


def test_what_is_free_is_integrated_out():
    """A flat prior is the limit of a wide one, but for the density that the wide one has."""
    model, data = model_of(Point(None)), draw(1)
    theta = np.append(np.log(TRUE_SIZES), 0.1)
    free = model.nuisance
    wide = 1e3
    flat = problem_of(model, data).log_evidence(theta)[0]
    held = problem_of(model.with_prior(np.where(free, wide, np.inf)), data).log_evidence(theta)[0]
    added = free.sum() * (np.log(wide) + 0.5 * np.log(2.0 * np.pi))
    assert flat == pytest.approx(held + added, abs=1e-3)


def test_a_known_distance_is_a_measurement():
    places = [[0.4, 0.2, 0.3], [0.4, -0.2, 0.3]]
    blocks: list[ParameterBlock] = [
        ZeroOffsets(ROBOT, ROBOT.joint_names[1:4], 1e-3),
        ToolPoint([0.0, 0.0, 0.2], ""),
        TargetPoints(places, ["a", "b"], prior_m=1e-3),
    ]
    known = KnownDistance("a", "b", 0.401, 2e-4)
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.0, 1.0, (6, ROBOT.n))
    setup = Setup.of(6, target=[0, 1] * 3)
    without = CalibrationModel(ROBOT, blocks, Point(1e-3))
    data = simulate(without, without.nominal, q, rng, setup=setup)
    linear = without.linearise(q, without.nominal, setup, data.observed)
    way = np.array([0.0, 1.0, 0.0, 0.0, -1.0, 0.0])
    J = np.vstack([linear.jacobian.reshape(18, -1), np.append(np.zeros(3), way)]) * 1e-3
    rows = np.append(linear.rows.ravel(), 0.4 - 0.401)
    covariance = J @ J.T + np.diag(np.append(np.full(18, 1e-6), 4e-8))
    expected = multivariate_normal(np.zeros(19), covariance).logpdf(rows)
    model = CalibrationModel(ROBOT, blocks, Point(1e-3), [known])
    found = problem_of(model, data, groups=()).log_evidence(np.zeros(0))[0]
    assert found == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_gradient_against_central_differences(seed):
    rng = np.random.default_rng(seed)
    apart = [1e-4, 1e-4, 3e-4, 1e-4, 1e-4, 1e-4]  # an axis that starts otherwise has its own
    kind = Pose(apart).of_unknown_noise() if seed else Pose(None)
    model, data = model_of(kind), draw(seed, 30, Pose(NOISE_M))
    problem = problem_of(model, data, weights=rng.uniform(0.2, 2.0, data.count))
    noises = 3 if seed else 2
    theta = np.append(np.log(TRUE_SIZES), np.zeros(noises))
    theta += rng.normal(0.0, 0.7, len(theta))
    _, gradient = problem.log_evidence(theta)
    for k in range(len(theta)):
        step = np.zeros(len(theta))
        step[k] = 1e-4
        ends = [problem.log_evidence(theta + s * step)[0] for s in (1, -1)]
        expected = (ends[0] - ends[1]) / 2e-4
        assert gradient[k] == pytest.approx(expected, rel=1e-5, abs=1e-4)


def test_sensitivity_against_central_differences():
    model, data = model_of(Pose(None)), draw(2, 20, Pose(NOISE_M))
    problem = problem_of(model, data)
    theta = np.append(np.log(TRUE_SIZES), [0.1, -0.2])
    found = problem.sensitivity(theta)
    for k in range(4):
        step = 1e-4 * np.eye(4)[k]
        expected = (problem.parameters(theta + step) - problem.parameters(theta - step)) / 2e-4
        np.testing.assert_allclose(found[:, k], expected, rtol=1e-4, atol=1e-7)


def curvature(problem, theta: np.ndarray) -> np.ndarray:
    """Information of the logarithms, by differences of the gradient."""
    rows = []
    for k in range(len(theta)):
        step = np.zeros(len(theta))
        step[k] = 1e-3
        ends = [problem.log_evidence(theta + s * step)[1] for s in (1, -1)]
        rows.append(-(ends[0] - ends[1]) / 2e-3)
    return (np.array(rows) + np.array(rows).T) / 2


def test_sizes_of_simulated_errors_are_found_within_what_chance_allows():
    """Ten arms: squared errors of the logarithms, by their own information, are chi²."""
    model, total, freedom = model_of(Point(None)), 0.0, 0
    worst = []
    for seed in range(10):
        data = draw(seed)
        found = tune_priors(model, data, GROUPS)
        noise = found.model.measurement.sigma[0]
        information = curvature(*solved(model, data, found))
        off = np.append(np.log(found.sigma / TRUE_SIZES), np.log(noise / NOISE_M))
        total += off @ information @ off
        freedom += len(off)
        worst.append(np.abs(off).max())
        assert found.notes == ()
    assert chi2.ppf(1e-4, freedom) < total < chi2.ppf(1 - 1e-4, freedom)
    assert max(worst) < 0.8


def test_the_maximum_is_one():
    """No small change of a size or of the noise makes the measurements likelier."""
    model, data = model_of(Point(None)), draw(3)
    found = tune_priors(model, data, GROUPS)
    problem, theta = solved(model, data, found)
    best, gradient = problem.log_evidence(theta)
    np.testing.assert_allclose(gradient, 0.0, atol=0.05)
    assert best == pytest.approx(found.log_evidence, abs=1e-3)
    for k in range(len(theta)):
        for side in (-0.2, 0.2):
            moved = theta.copy()
            moved[k] += side
            assert problem.log_evidence(moved)[0] < best


@pytest.mark.parametrize("loss", ["least-squares", "student-t"])
def test_the_identification_that_follows_finds_the_same(loss):
    data = draw(4, 50)
    found = tune_priors(model_of(Point(None)), data, GROUPS, loss=loss)
    result = identify(found.model, data, loss=loss)
    np.testing.assert_allclose((result.values - found.x) / result.sigma, 0.0, atol=0.02)
    np.testing.assert_allclose(result.noise[0].sigma, found.model.measurement.sigma, rtol=5e-3)
    np.testing.assert_allclose(result.weights, found.weights, atol=5e-3)
    for group, size in zip(GROUPS, found.sigma, strict=True):
        columns = [found.model.names.index(name) for name in group.parameters]
        np.testing.assert_array_equal(result.prior[columns], size)
    assert np.isinf(result.prior[found.model.nuisance]).all()


def test_student_weights_are_those_of_the_robust_fit():
    data = draw(5)
    observed = data.observed.copy()
    observed[[3, 17]] += 3e-3  # two gross errors, 40 times the noise
    spoilt = replace(data, observed=observed)
    model = model_of(Point(None))
    robust = tune_priors(model, spoilt, GROUPS, loss="student-t")
    plain = tune_priors(model, spoilt, GROUPS)
    good = tune_priors(model, data, GROUPS)
    np.testing.assert_array_equal(plain.weights, 1.0)
    s2 = distances2(robust.model, spoilt, robust.x)
    expected = WEIGHTS["student-t"](s2, np.full(data.count, 3))
    np.testing.assert_allclose(robust.weights, expected, atol=3e-3)
    assert robust.weights[[3, 17]].max() < 0.02

    def off(tuned: TunedPriors) -> float:
        return float(np.abs(np.log(tuned.sigma / good.sigma)).max())

    assert off(robust) < 0.5 * off(plain)
    assert plain.model.measurement.sigma[0] > 3 * robust.model.measurement.sigma[0]


@pytest.mark.parametrize("factor", [0.1, 30.0])
def test_where_the_noise_starts_does_not_matter(factor):
    data, model = draw(6), model_of(Point(None))
    one = tune_priors(model, data, GROUPS)
    other = tune_priors(
        model.with_measurements([model.measurement.with_noise(factor)]), data, GROUPS
    )
    np.testing.assert_allclose(other.sigma, one.sigma, rtol=1e-3)
    np.testing.assert_allclose(
        other.model.measurement.sigma, one.model.measurement.sigma, rtol=1e-3
    )
    assert other.log_evidence == pytest.approx(one.log_evidence, abs=1e-3)


def test_noise_that_is_given_stays():
    found = tune_priors(model_of(Point(NOISE_M)), draw(7), GROUPS)
    np.testing.assert_array_equal(found.model.measurement.sigma, NOISE_M)
    assert not found.model.measurement.estimated


def test_priors_outside_the_groups_stay():
    offsets = ZeroOffsets(ROBOT, ROBOT.joint_names[:1], 1e-5)
    angles = tuple(n for n in ANGLES if not n.startswith(f"link.{ROBOT.joint_names[0]}"))
    groups = (GROUPS[0], PriorGroup("angles", angles, 1e-5, 1e-2))
    blocks = [LinkGeometry(ROBOT, [*LENGTHS, *angles]), offsets]
    model = CalibrationModel(
        ROBOT, [*blocks, ToolPoint([0.1, -0.05, 0.2]), TargetFrame(np.eye(4))], Point(None)
    )
    found = tune_priors(model, draw(8), groups)
    assert found.model.prior[model.names.index(offsets.names[0])] == 1e-5


def test_what_is_known_of_the_set_up_has_no_size_to_be_found():
    offsets = ZeroOffsets(ROBOT, ROBOT.joint_names[1:4], 1e-3)
    tool, target = ToolPoint([0.0, 0.0, 0.2], "xyz", 1e-4), TargetPoints([[0.4, 0.2, 0.3]], ["a"])
    model = CalibrationModel(ROBOT, [offsets, tool, target], Point(1e-4))
    (group,) = groups_of(model, 0.1, 2.0)
    assert group == PriorGroup("offsets", tuple(offsets.names), 1e-4, 2e-3)


def test_a_size_that_is_not_there_stands_at_its_bound():
    """Bounds hold, and what stands at one is said."""
    data = draw(9)
    model = model_of(Point(None), ZeroOffsets(ROBOT, ROBOT.joint_names[:1], 1e-4))
    groups = (
        PriorGroup("lengths", LENGTHS, 1e-5, 1e-2),
        PriorGroup("angles", ANGLES, 5e-3, 1e-2),  # larger than they are
    )
    found = tune_priors(model, data, groups)
    assert found.sigma[1] == pytest.approx(5e-3, rel=1e-9)
    assert found.notes == ("the prior of the group 'angles' stands at its lower bound",)
    held = PriorGroup("angles", ANGLES, 2e-3, 2e-3)
    found = tune_priors(model, data, (GROUPS[0], held))
    assert found.sigma[1] == pytest.approx(2e-3, rel=1e-12)
    assert found.notes == ()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PriorGroup("empty", (), 1e-5, 1e-3), "the group 'empty' has no parameters"),
        (lambda: PriorGroup("g", ("a",), 0.0, 1e-3), "not two numbers above zero in order"),
        (lambda: PriorGroup("g", ("a",), 2e-3, 1e-3), "not two numbers above zero in order"),
        (lambda: PriorGroup("g", ("a",), 1e-3, np.inf), "not two numbers above zero in order"),
        (lambda: PriorGroup("g", ("a",), np.nan, 1.0), "not two numbers above zero in order"),
    ],
)
def test_groups_that_are_none(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"groups": [PriorGroup("g", ("link.elbow.x",), 1e-5, 1e-3)]}, "is no parameter of the"),
        ({"groups": [GROUPS[0], replace(GROUPS[0], name="g")]}, "is in two groups, 'lengths' and"),
        (
            {"groups": [PriorGroup("g", (LENGTHS[0], ANGLES[0]), 1e-5, 1e-3)]},
            "the group 'g' mixes units: m, rad",
        ),
        ({"loss": "huber"}, "priors cannot be found under the loss 'huber'"),
        ({"noise_bounds": (1.0, 0.5)}, "the bounds 1 and 0.5 of the noise"),
        ({"data": draw(0, 4)[:2]}, "2 measurements give 6 equations"),
    ],
)
def test_refusals(arguments, message):
    given = {"data": draw(0), "groups": GROUPS} | arguments
    with pytest.raises(InputError, match=message):
        tune_priors(model_of(Point(None)), **given)


def test_what_no_prior_holds_must_be_seen():
    """Angles in no group, about axes that no measurement tells apart."""
    with pytest.raises(NotIdentifiableError):
        tune_priors(model_of(Point(None)), draw(0), GROUPS[:1])


def test_uncertain_sizes_widen_what_rests_on_them():
    """The law of total variance, against draws of sizes and noise from their likelihood."""
    usual = [replace(group, usual=8e-4) for group in GROUPS]
    model, data = model_of(Point(None)), draw(6, 12)
    found = tune_priors(model, data, usual)
    problem, best = solved(model, data, found)
    grid = np.stack(np.meshgrid(*[np.linspace(-1.6, 1.6, 9)] * 3), axis=-1).reshape(-1, 3) + best

    def log_density(theta: np.ndarray) -> float:
        off = (theta[:2] - np.log(8e-4)) / np.log(3.0)
        return problem.log_evidence(theta)[0] - 0.5 * float(off @ off)

    weights = np.exp([log_density(theta) - log_density(best) for theta in grid])
    means = np.array([problem.parameters(theta) for theta in grid])
    off = means - weights @ means / weights.sum()
    expected = np.einsum("k,ki,kj->ij", weights / weights.sum(), off, off)
    # of what moves most with the sizes: the curvature at the maximum is not all of a long tail
    arm = ~model.nuisance
    assert np.trace(found.covariance[arm][:, arm]) == pytest.approx(
        np.trace(expected[arm][:, arm]), rel=0.5
    )
    assert (np.diag(found.covariance) >= 0.0).all()


@pytest.mark.slow
def test_the_likelihood_over_all_sizes_is_its_integral() -> None:
    """Laplace's approximation against the sum over a grid: sizes usual and not, and noise."""
    groups = [replace(GROUPS[0], usual=8e-4), GROUPS[1]]
    model, data = model_of(Point(None)), draw(8)
    found = tune_priors(model, data, groups)
    problem, best = solved(model, data, found, groups)
    step = 0.2
    grid = [m + step * np.arange(-8, 9) for m in best[:2]]
    grid.append(best[2] + 0.5 * step * np.arange(-6, 7))
    points = np.stack(np.meshgrid(*grid, indexing="ij"), axis=-1).reshape(-1, 3)
    logs = np.array([problem.log_evidence(theta)[0] for theta in points])
    off = (points[:, 0] - np.log(8e-4)) / np.log(3.0)
    logs -= 0.5 * off**2 + np.log(np.log(3.0) * np.sqrt(2.0 * np.pi))
    logs -= np.log(np.log(1e-2 / 1e-5)) + np.log(np.log(1e3 / 1e-2))  # uniform between bounds
    integral = np.log(np.exp(logs - logs.max()).sum() * step**2 * 0.5 * step) + logs.max()
    assert found.log_marginal == pytest.approx(integral, abs=0.3)


def test_likeliest_weights_make_squares_students() -> None:
    """But for a constant, whatever the residual."""
    nu = STUDENT_FREEDOM
    r = np.array([0.0, 0.5, 2.0, 7.0])
    w = WEIGHTS["student-t"](r**2, np.ones(4, dtype=int))
    parts = [
        -0.5 * wi * ri**2 + 0.5 * np.log(wi) + log_weights(np.array([wi]))
        for wi, ri in zip(w, r, strict=True)
    ]
    np.testing.assert_allclose(np.diff(parts), np.diff(student(nu).logpdf(r)), atol=1e-12)


def test_sizes_in_proportion_are_those_of_scaled_parameters() -> None:
    """A group whose priors differ is one of equal priors in other units: the density the same."""
    model, data = model_of(Point(None)), draw(9)
    columns = [model.names.index(name) for name in LENGTHS]
    rng = np.random.default_rng(9)
    shares = rng.uniform(0.2, 3.0, len(columns))
    prior = model.prior.copy()
    prior[columns] = 1e-3 * shares
    found = tune_priors(model.with_prior(prior), data, GROUPS)
    proportions = found.model.prior[columns] / shares
    np.testing.assert_allclose(proportions, proportions[0], rtol=1e-12)
    assert np.sqrt(np.mean(found.model.prior[columns] ** 2)) == pytest.approx(found.sigma[0])
    # what identification finds with these priors is what was found with them
    result = identify(found.model, data)
    np.testing.assert_allclose((result.values - found.x) / result.sigma, 0.0, atol=0.02)
    # density of the rows, by a Gaussian of the whole covariance
    held = model_of(Point(NOISE_M), free=False)
    p = held.prior.copy()
    own = [held.names.index(name) for name in LENGTHS]
    p[own] = 1e-3 * shares
    theta = np.log([5e-4, 1e-3])
    value = problem_of(held.with_prior(p), data).log_evidence(theta)[0]
    linear = held.linearise(data.postures, held.nominal, data.setup, data.observed)
    sizes = np.empty(held.p)
    sizes[own] = 5e-4 * shares / np.sqrt(np.mean(shares**2))
    sizes[[held.names.index(name) for name in ANGLES]] = 1e-3
    J = linear.jacobian.reshape(-1, held.p) * sizes
    covariance = J @ J.T + NOISE_M**2 * np.eye(len(J))
    density = multivariate_normal(np.zeros(len(J)), covariance).logpdf(linear.rows.ravel())
    assert value == pytest.approx(density, abs=1e-5)


def test_what_rounding_hides_is_refused() -> None:
    """Two columns that are one, held by nothing: no error of linear algebra comes through."""
    model, data = model_of(Point(None)), draw(3)
    problem = problem_of(model, data)
    grams = problem.grams.copy()
    grams[:, 1], grams[:, :, 1] = -grams[:, 0], -grams[:, :, 0]
    hidden = replace(problem, grams=grams[2:], counts=problem.counts[2:])  # without priors
    with pytest.raises(ConvergenceError, match="rounding hides"):
        hidden.log_evidence(np.zeros(1))
