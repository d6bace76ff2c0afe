"""Identification: exact without noise, both methods alike, and silent about nothing."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib import CalibrationModel, identify
from calib.errors import ConvergenceError, InputError, NotIdentifiableError
from calib.identification import check_identifiable, covariance_of, identify_batch
from calib.identification.identifiability import check_believable
from calib.model import Setup, simulate
from calib.model.measurements import Measurements, TouchUp, ViewLine, touch_ups
from calib.model.parameters import JointCompliance, Payload, TargetPoints, ToolPoint, ZeroOffsets

OFFSETS = np.deg2rad([0.2, -0.3, 0.15, -0.25])
SIGMA = np.array([0.02, 0.02, 0.12]) / 3e3


def truth(model, seed: int = 0) -> np.ndarray:
    """Offsets of some tenths of a degree, a set-up misplaced by millimetres."""
    x = model.nominal.copy()
    x[: len(OFFSETS)] = OFFSETS
    places = model.nuisance
    x[places] += np.random.default_rng(seed).uniform(-3e-3, 3e-3, places.sum())
    return x


def simulated(model, q, *, seed: int | None = 1, target=0, x=None) -> Measurements:
    rng = None if seed is None else np.random.default_rng(seed)
    setup = Setup.of(len(q), target=target)
    return simulate(model, truth(model) if x is None else x, q, rng, setup=setup)


@pytest.mark.parametrize("method", ["gauss-newton", "newton-raphson"])
@pytest.mark.parametrize("weighted", [True, False])
@pytest.mark.parametrize("kind", ["touch-up", "view line", "two targets"])
def test_exact_without_noise(make_model, touching, method, weighted, kind):
    q, target = touching(14), 0
    if kind == "two targets":
        model, target = make_model(targets=2), np.arange(14) % 2
        q[target == 1] = touching(7, shift=(0, 0.3, 0.4))
    elif kind == "view line":
        model = make_model(measurement=ViewLine(SIGMA[:2]), free="xy")
    else:
        model = make_model()
    data = simulated(model, q, seed=None, target=target)
    result = identify(model, data, method=method, weighted=weighted)
    np.testing.assert_allclose(result.values, truth(model), atol=1e-9)
    assert result.rms_m < 1e-11
    assert result.status == "converged"
    assert result.iterations <= 8


def test_a_set_up_far_from_its_place_is_still_found(make_model, touching):
    model, q = make_model(), touching(14)
    x = truth(model)
    data = simulate(model, x, q)
    lost = CalibrationModel(
        model.robot,
        [model.parameters[0], ToolPoint([0, 0, 0]), TargetPoints([0, 0, 0])],
        model.measurement,
    )
    np.testing.assert_allclose(identify(lost, data).values, x, atol=1e-9)


@pytest.mark.parametrize("weighted", [True, False])
def test_both_methods_reach_the_same_minimum(make_model, touching, weighted):
    model = make_model()
    data = simulated(model, touching(20))
    gauss = identify(model, data, weighted=weighted)
    paper = identify(model, data, weighted=weighted, method="newton-raphson")
    np.testing.assert_array_less(np.abs(paper.values - gauss.values), 1e-4 * gauss.sigma)
    np.testing.assert_allclose(paper.residuals, gauss.residuals, atol=1e-9)
    # a minimum: no small step makes the sum of squares less

    def cost(x):
        linear = model.linearise(data.postures, x, data.setup)
        if weighted:
            return np.sum(linear.white_rows**2)
        return np.sum(linear.rows**2)

    least = cost(gauss.values)
    for step in np.random.default_rng(2).standard_normal((30, model.p)) * gauss.sigma:
        assert cost(gauss.values + step) > least
        assert cost(gauss.values - step) > least


def test_weighting_matters(make_model, touching):
    model = make_model()
    data = simulated(model, touching(20))
    weighted, plain = identify(model, data), identify(model, data, weighted=False)
    assert (np.abs(weighted.values - plain.values) > 0.05 * weighted.sigma).any()
    assert (plain.sigma > weighted.sigma).all()


@pytest.mark.parametrize("weighted", [True, False])
def test_batch_is_the_same_as_one_by_one(make_model, touching, weighted):
    model = make_model()
    data = simulate(model, truth(model), touching(12), np.random.default_rng(3), trials=6)
    together = identify_batch(model, data, weighted=weighted)
    assert together.shape == (6, model.p)
    for values, postures in zip(together, data.postures, strict=True):
        alone = identify(model, touch_ups(postures, data.target), weighted=weighted)
        np.testing.assert_array_less(np.abs(values - alone.values), 1e-4 * alone.sigma)


def test_the_order_of_the_touch_ups_does_not_matter(make_model, touching):
    model = make_model()
    data = simulated(model, touching(15))
    order = np.random.default_rng(4).permutation(15)
    result = identify(model, data)
    other = identify(model, touch_ups(data.postures[order], data.target[order]))
    np.testing.assert_allclose(other.values, result.values, atol=1e-10)
    np.testing.assert_allclose(other.leave_one_out, result.leave_one_out[order], atol=1e-10)


@pytest.mark.parametrize(
    ("joints", "named", "partner"),
    [
        ((1, 2, 3, 4, 5), ["zero_offset.joint_1"], "the targets (target.T1.x, target.T1.y)"),
        ((2, 3, 4, 5, 6), ["zero_offset.joint_6"], "the tool point (tool.x, tool.y)"),
        (
            (6, 1, 2, 3),
            ["zero_offset.joint_6", "zero_offset.joint_1"],
            "the tool point (tool.x, tool.y)",
        ),
    ],
)
def test_joints_that_the_set_up_absorbs_are_named(make_model, touching, joints, named, partner):
    model = make_model(joints)
    data = simulated(make_model(), touching(20))
    with pytest.raises(NotIdentifiableError) as caught:
        identify(model, data)
    assert list(caught.value.parameters) == named
    assert caught.value.combinations[0] == f"{named[0]} is absorbed by {partner}"
    with pytest.raises(NotIdentifiableError, match=named[0]):
        identify_batch(model, touch_ups(data.postures[None], data.target))


def test_joint_1_hides_behind_several_targets_too(make_model, touching):
    model, target = make_model((1, 2, 3, 4, 5), targets=2), np.arange(20) % 2
    q = np.where(target[:, None] == 0, touching(20), touching(20, shift=(0, 0.3, 0.4)))
    with pytest.raises(NotIdentifiableError) as caught:
        identify(model, simulated(make_model(targets=2), q, target=target))
    assert caught.value.parameters == ("zero_offset.joint_1",)
    assert "target.T2.x" in caught.value.combinations[0]


def test_a_view_line_does_not_tell_where_on_it_the_tool_point_is(make_model, touching):
    line = ViewLine(SIGMA[:2])
    data = simulated(make_model(measurement=line, free="xy"), touching(20))
    with pytest.raises(NotIdentifiableError) as caught:
        identify(make_model(measurement=line), data)
    assert caught.value.parameters == ("tool.z",)
    assert caught.value.combinations == ("nothing measured depends on tool.z",)


def test_postures_that_differ_in_one_joint_only_are_not_enough(make_model, touching):
    """All equations are there, their rank is not."""
    q = np.repeat(touching(1), 20, axis=0)
    q[:, 5] += np.linspace(-1, 1, 20)
    with pytest.raises(NotIdentifiableError) as caught:
        identify(make_model(), touch_ups(q))
    assert any(name.startswith("zero_offset") for name in caught.value.parameters)


def test_too_few_touch_ups_say_how_many_are_needed(make_model, touching):
    model = make_model()
    q = touching(3)
    for use, postures in ((identify, q), (identify_batch, q[None])):
        with pytest.raises(
            InputError, match="3 measurements give 9 equations for 10 parameters"
        ) as e:
            use(model, touch_ups(postures))
        assert "at least 4 poses" in e.value.hint
        assert (e.value.value, e.value.bound) == (9, 10)


def test_labels_must_be_those_of_the_model(make_model, touching):
    q = touching(8)
    for use, postures in ((identify, q), (identify_batch, q[None])):
        with pytest.raises(InputError, match="name the targets left, the model T1"):
            use(make_model(), touch_ups(postures, np.zeros(8, dtype=int), ("left",)))


def test_what_belongs_to_another_robot_is_not_fitted(make_model, reference_robot):
    """Random postures touch nothing: no number comes back with a small residual."""
    rng = np.random.default_rng(5)
    q = rng.uniform(reference_robot.lower, reference_robot.upper, (20, 6))
    try:
        result = identify(make_model(), touch_ups(q))
    except (ConvergenceError, NotIdentifiableError):
        return
    assert not result.explains_data
    assert result.rms_m > 0.1


def test_believable_goes_by_unit_and_refuses_what_is_not_a_number():
    model = SimpleNamespace(
        names=["a", "b", "c"], units=["rad", "m", "rad/Nm"], prior=np.full(3, np.inf)
    )
    check_believable(model, np.array([0.19, 0.19, 0.9e-3]))
    with pytest.raises(NotIdentifiableError) as caught:
        check_believable(model, np.array([0.21, 0.0, 1.1e-3]))
    assert caught.value.parameters == ("a", "c")
    with pytest.raises(NotIdentifiableError, match="cannot identify b"):
        check_believable(model, np.array([0.0, np.nan, 0.0]))
    model.prior = np.array([np.inf, 1.0, np.inf])  # known beforehand, whatever was measured
    check_believable(model, np.array([0.0, np.nan, 0.0]))


@pytest.mark.parametrize("scale", [1.0, 1e3, 1e-3])
def test_identifiability_does_not_depend_on_units(scale):
    """A column in mm or in m is the same direction."""
    rng = np.random.default_rng(6)
    J = rng.standard_normal((30, 3))
    J = np.column_stack([J, J @ [1.0, 2.0, 0.0]]) * np.array([1, scale, 1 / scale, scale])
    with pytest.raises(NotIdentifiableError) as caught:
        check_identifiable(J, ["a", "b", "c", "d"])
    assert caught.value.parameters == ("d",)
    assert caught.value.combinations == ("d is absorbed by a, b",)
    # what has to be free is kept, and something else takes the blame
    with pytest.raises(NotIdentifiableError) as caught:
        check_identifiable(J, ["a", "b", "c", "d"], np.array([False, True, False, True]))
    assert caught.value.parameters == ("a",)
    check_identifiable(J[:, :3], ["a", "b", "c"])


def test_what_the_model_leaves_out_is_said(make_model, touching, reference_robot):
    load = Payload(165.0, np.array([0.1, 0.0, 0.2]))
    soft = JointCompliance(reference_robot, ["joint_2", "joint_3"], load)
    real = make_model(extra=(soft,))
    x = real.nominal.copy()
    x[4:6] = 1 / reference_robot.stiffness[1:3]
    data = simulated(real, touching(25), x=x)
    poor = identify(make_model(), data, name="offsets")
    assert not poor.explains_data
    assert poor.noise_scale > 2
    assert f"the residuals are {poor.noise_scale:.1f} times the noise given" in poor.message
    assert "the model leaves something out" in poor.summary()
    good = identify(real, data, name="offsets and compliance")
    assert good.explains_data
    assert good.message == f"the noise given explains the residuals (ratio {good.noise_scale:.2f})"
    np.testing.assert_array_less(np.abs(good.values - x), 5 * good.sigma)
    paper = identify(real, data, method="newton-raphson")
    np.testing.assert_array_less(np.abs(paper.values - good.values), 0.01 * good.sigma)
    # deviations are scaled up to the residuals: by noise alone they would be smaller
    alone = covariance_of(make_model(), data.postures, poor.values)
    np.testing.assert_allclose(poor.covariance, poor.noise_scale**2 * alone, rtol=1e-9)


def test_the_result_reads_well(make_model, touching):
    model = make_model()
    result = identify(model, simulated(model, touching(20)))
    assert result.value("zero_offset.joint_3") == result.values[1]
    rows = {row[0]: row for row in result.displayed()}
    unit, value, change, sigma = rows["zero_offset.joint_2"][1:5]
    assert (unit, value, change) == (
        "deg",
        np.rad2deg(result.values[0]),
        np.rad2deg(result.values[0]),
    )
    assert sigma == pytest.approx(np.rad2deg(result.sigma[0]))
    unit, value, change = rows["tool.x"][1:4]
    assert unit == "mm"
    assert change == pytest.approx(value - 200.0)
    lines = result.summary().splitlines()
    assert lines[0].startswith(
        f"offsets: {result.rms_m * 1e3:.4f} mm rms, {result.max_m * 1e3:.4f} mm"
    )
    assert len(lines) == 2 + model.p
    assert lines[-1].strip() == result.message
    assert result.degrees_of_freedom == 60 - 10
    assert result.max_m == np.linalg.norm(result.residuals, axis=1).max()
    postures = simulated(model, touching(20)).postures
    white = model.linearise(postures, result.values).white_rows
    assert result.chi2 == pytest.approx(np.sum(white**2))


def test_as_many_equations_as_parameters_leave_nothing_to_judge_by(make_model, touching):
    model = make_model((2, 3, 4), TouchUp(SIGMA))
    result = identify(model, simulate(model, model.nominal, touching(3)))
    assert result.degrees_of_freedom == 0
    assert np.isnan(result.noise_scale)
    assert "nothing is left to test the model by" in result.message
    assert np.isnan(result.leave_one_out).all()
    assert result.indispensable == 3
    assert np.isnan(result.leave_one_out_rms_m)


def test_surveyed_targets_make_the_first_joint_identifiable(reference_robot, target_m, touching):
    surveyed = TargetPoints([target_m], free=False)
    model = CalibrationModel(
        reference_robot,
        [
            ZeroOffsets(reference_robot, [f"joint_{j}" for j in range(1, 6)]),
            ToolPoint([0.2, -0.05, 0.35]),
            surveyed,
        ],
        TouchUp(1e-5),
    )
    assert model.targets == ("T1",)
    assert model.p == 8
    true = model.nominal + np.concatenate([np.full(5, 1e-3), [1e-3, -2e-3, 3e-3]])
    found = identify(model, simulate(model, true, touching(20)))
    np.testing.assert_allclose(found.values, true, atol=1e-9)


def test_what_the_noise_leaves_unknown_is_refused_before_it_wanders_off(make_model, touching):
    model = make_model(measurement=TouchUp(1e-4))
    with pytest.raises(NotIdentifiableError, match="stays uncertain by") as caught:
        identify(model, simulate(model, model.nominal, touching(20, tilt=0.03)))
    # the offset of joint 2 and the height of the target are all but the same thing there
    assert set(caught.value.parameters) & {"zero_offset.joint_2", "target.T1.z"}
    assert "turn the tool farther" in caught.value.hint
