"""Models in words: what each frees, with which priors and noise; and models by their names."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest

from calib.errors import InputError
from calib.identification import identify
from calib.model import CalibrationModel
from calib.model.measurements import KINDS
from calib.model.parameters import JointCompliance, gravity_torque
from posedesign.cell import Cell, cell_template
from posedesign.cell.models import WIND_UP, robot_blocks
from posedesign.cell.schema_sections import Word
from posedesign.files.measurements import MeasurementTable
from posedesign.identification import identify_models
from posedesign.identification.models import (
    FRAMES_ONLY,
    Models,
    kinds_of,
    left_out,
    model_of,
    name_of,
)

pytestmark = pytest.mark.usefixtures("one_alternative")

WORDS = [word for word in get_args(Word) if word != "priors"]

STEMS = {
    "zero_offsets": {"zero_offset"},
    "geometry": {"zero_offset", "link"},
    "compliance": {"compliance"},
    "bearings": {"bearing"},
    "lost_motion": {"lost_motion"},
    "scale": {"scale"},
    "harmonics": {"harmonic"},
}
"""First parts of the names of what each word frees."""


@pytest.fixture
def table_of(lab, tabled) -> Callable[..., Any]:
    """What is measured, and the table of it."""

    def measure(kinds: list[str], count: int = 40, **more: Any) -> Any:
        measured = lab.measure(kinds, count, **more)
        return measured, tabled(measured)

    return measure


def stems(names: Any) -> set[str]:
    """First parts of names."""
    return {name.partition(".")[0] for name in names}


@pytest.mark.parametrize("word", WORDS)
def test_each_word_frees_what_it_says(reference_cell, word):
    names = [name for block in robot_blocks(reference_cell, [word]) for name in block.names]
    assert stems(names) == STEMS[word]


def test_names_of_models():
    assert name_of(["zero_offsets"]) == "offsets"
    assert name_of(["zero_offsets", "lost_motion"]) == "offsets + lost motion"
    assert name_of(["geometry", "priors", "compliance"]) == "geometry + compliance with priors"


PRIORS = {
    "prior_offset_deg": 0.7,
    "prior_length_mm": 0.3,
    "prior_angle_deg": 0.2,
    "prior_harmonic_deg": 0.01,
    "prior_compliance_urad_nm": 4.0,
}
HELD = {
    "zero_offset": np.deg2rad(0.7),
    "link m": 0.3e-3,
    "link rad": np.deg2rad(0.2),
    "harmonic": np.deg2rad(0.01),
    "lost_motion": np.deg2rad(0.01),
    "compliance": 4e-6,
    "bearing": 4e-6,
}


@pytest.mark.parametrize("words", [["zero_offsets"], ["geometry"], *[[w] for w in WORDS[2:]]])
def test_priors_of_joints_and_links(make_cell, words):
    cell = make_cell(parameters=PRIORS)
    for block in robot_blocks(cell, words):
        assert np.isinf(block.prior).all()
    if words == ["scale"]:
        return
    for block in robot_blocks(cell, [*words, "priors"]):
        for name, unit, sigma in zip(block.names, block.units, block.prior, strict=True):
            stem = name.partition(".")[0]
            usual = HELD[f"link {unit}" if stem == "link" else stem]
            if stem in ("compliance", "bearing"):  # less where the joint carries much
                assert 0.0 < sigma <= usual * (1 + 1e-12), name
            else:
                assert sigma == pytest.approx(usual), name


def test_models_are_tried_from_small_to_large(table_of, lab, make_cell):
    models = [["geometry", "compliance"], ["zero_offsets"], ["zero_offsets", "bearings", "scale"]]
    cell = make_cell(parameters={"models": models})
    _, table = table_of(["point"])
    found = Models(cell, table).candidates()
    assert found[0].name == FRAMES_ONLY
    assert found[0].model.nuisance.all()
    assert found[1].name == "offsets"
    assert found[1].model.p == found[0].model.p + len(cell.offset_joints)
    assert {c.name for c in found} == {FRAMES_ONLY, *(name_of(words) for words in models)}
    sizes = [candidate.model.p for candidate in found]
    assert sizes == sorted(sizes)
    reduced = next(c for c in found if c.name == "geometry + compliance")
    assert any("zero_offset.joint_1 is absorbed by" in note for note in reduced.notes)
    assert not found[1].notes


def test_what_needs_masses_is_left_out_without_them(table_of, lab, make_cell):
    _, table = table_of(["touch-up"])
    light = make_cell(
        robot={"preset": "r2000ib210f"},
        tool={"mass_kg": 0.0},
        parameters={"models": [["zero_offsets"], ["compliance"], ["lost_motion"]]},
        truth={"deflection": False},
    )
    assert not light.robot.link_mass.any()
    assert [c.name for c in Models(light, table).candidates()] == [FRAMES_ONLY, "offsets"]
    # one cause, one sentence
    assert left_out(light) == ["compliance, lost motion: the masses of the links are not known"]
    heavy = replace(light, config=make_cell(tool={"mass_kg": 50.0}).config)
    assert not any(
        w in Models(heavy, table).reference()[0].model.names for w in ("compliance.joint_2",)
    )


def test_links_are_not_free_where_nothing_sees_the_scale(table_of, lab, make_cell):
    """Neither by touch-ups of one target nor of three; by a known distance, and by readings."""
    models = {"parameters": {"models": [["geometry"], ["geometry", "priors"]]}}
    known = {"targets": ["A0", "A1"], "length_mm": 300.0}
    for kind, each, more, free in (
        ("touch-up", 1, {}, False),
        ("touch-up", 3, {}, False),
        ("touch-up", 3, {"known_distance": [known]}, True),
        ("point", 1, {}, True),
    ):
        cell = make_cell(**models, **more)
        _, table = table_of([kind], 60, targets_each=each)
        held = Models(cell, table).held_only
        assert held == (() if free else ("geometry",)), (kind, each)
        names = [candidate.name for candidate in Models(cell, table).candidates()]
        assert ("geometry" in names) == free, (kind, each)
        assert "geometry with priors" in names


def test_the_reference_holds_everything_by_priors(table_of, lab, make_cell):
    cell = make_cell(parameters={"models": [["zero_offsets"], ["scale"]]})
    _, table = table_of(["touch-up"])
    model = Models(cell, table).reference()[0].model
    assert np.isfinite(model.prior[~model.nuisance]).all()
    stems = {name.partition(".")[0] for name in np.array(model.names)[~model.nuisance]}
    assert stems == {
        *("zero_offset", "link", "compliance", "bearing", "lost_motion", "harmonic", "scale")
    }
    grouped = [
        name for group in Models(cell, table).reference()[0].groups for name in group.parameters
    ]
    assert sorted(grouped) == sorted(np.array(model.names)[~model.nuisance])


def test_noise_given_and_unknown(make_cell):
    cell = make_cell(
        noise=[
            {"kind": "pose", "three_sigma_mm": [0.3, 0.6, 0.9], "three_sigma_deg": 0.03},
            {"kind": "plane", "three_sigma_mm": 0.06},
        ]
    )
    pose, plane, touch, point = kinds_of(cell, ["pose", "plane", "touch-up", "point"])
    np.testing.assert_allclose(pose.sigma, [1e-4, 2e-4, 3e-4, *[np.deg2rad(0.01)] * 3], rtol=1e-12)
    np.testing.assert_allclose(plane.sigma, [2e-5])
    np.testing.assert_allclose(touch.sigma, np.array([0.02, 0.02, 0.12]) / 3e3)
    assert [kind.estimated for kind in (pose, plane, touch, point)] == [False] * 3 + [True]
    unknown = make_cell(measurement={"estimate_noise": True})
    assert all(kind.estimated for kind in kinds_of(unknown, ["touch-up", "pose"]))


@pytest.mark.parametrize(
    "kind", ["touch-up", *(pytest.param(k, marks=pytest.mark.slow) for k in ("point", "distance"))]
)
def test_noise_from_the_residuals(table_of, lab, make_cell, kind):
    """150 measurements: the standard deviation is known to about 1 / sqrt(2 x 150)."""
    noise = 5e-5
    measured, table = table_of(
        [kind], 150, noise=noise, targets_each=3 if kind == "distance" else 1
    )
    cell = make_cell(
        parameters={"models": [["zero_offsets"]]}, measurement={"estimate_noise": True}
    )
    result = identify_models(cell, table).comparison.results[1]
    (found,) = result.noise
    assert found.estimated
    np.testing.assert_allclose(found.sigma, noise, rtol=4.0 / np.sqrt(2.0 * 150.0))
    for joint in lab.joints:
        name = f"zero_offset.{joint}"
        sigma = result.sigma[result.names.index(name)]
        assert abs(result.value(name) - measured.value(name)) < 5.0 * sigma


def test_known_distances_take_part(table_of, lab, make_cell):
    """Of two targets, in any order of their names; a wrong one shows."""
    measured, table = table_of(["touch-up"], 60, targets_each=2)
    ends = [np.array([measured.value(f"target.A{k}.{axis}") for axis in "xyz"]) for k in (0, 1)]
    known = {
        "targets": ["A1", "A0"],
        "length_mm": 1e3 * float(np.linalg.norm(ends[1] - ends[0])),
        "three_sigma_mm": 0.003,
    }
    cell = make_cell(known_distance=[known], parameters={"models": [["zero_offsets"]]})
    offsets = Models(cell, table).candidates()[1]
    assert len(offsets.model.distances) == 1
    result = identify(offsets.model, table.data)
    for joint in lab.joints:
        name = f"zero_offset.{joint}"
        assert result.value(name) == pytest.approx(measured.value(name), abs=1e-8)
    assert result.rms_m < 1e-9
    wrong = make_cell(known_distance=[known | {"length_mm": known["length_mm"] + 0.1}])
    found = identify(Models(wrong, table).candidates()[1].model, table.data)
    assert not found.explains_data
    assert found.rms_m > 1e-6


def test_a_known_distance_to_nowhere(table_of, lab, make_cell):
    _, table = table_of(["touch-up"], 6)
    cell = make_cell(known_distance=[{"targets": ["A0", "A7"], "length_mm": 100.0}])
    with pytest.raises(InputError, match="distance to the target 'A7' is known") as caught:
        Models(cell, table).candidates()
    assert "did you mean A0" in caught.value.hint


def rebuilt(cell: Cell, table: MeasurementTable) -> list[tuple[CalibrationModel, CalibrationModel]]:
    """Every candidate with the model that its names give."""
    return [
        (c.model, model_of(cell, c.model.names))
        for c in Models(cell, table).candidates(before_measuring=True)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("kinds", [["touch-up"], ["pose"], ["point", "touch-up"]], ids="+".join)
def test_models_from_names(table_of, lab, make_cell, kinds):
    """The arm that a file of results speaks of moves as the one that was identified."""
    words = [[word] for word in WORDS] + [["geometry", "compliance", "priors"]]
    cell = make_cell(parameters={"models": words})
    _, table = table_of(kinds, 60, tools=("tool", "ball"), targets_each=2)
    rng = np.random.default_rng(5)
    pairs = rebuilt(cell, table)
    assert len(pairs) == 1 + len(words)
    q = table.data.postures[:7]
    for model, again in pairs:
        assert sorted(again.names) == sorted(model.names)
        x = model.nominal + rng.normal(0.0, 1e-4, model.p) * np.where(
            np.array(model.units) == "rad/Nm", 1e-3, 1.0
        )
        order = [model.names.index(name) for name in again.names]
        assert [model.units[k] for k in order] == list(again.units)
        here, there = (
            m.view(q, values).T_base_tip for m, values in ((model, x), (again, x[order]))
        )
        np.testing.assert_allclose(there, here, rtol=0, atol=1e-12)


def test_names_that_no_arm_has(reference_cell):
    with pytest.raises(InputError, match=r"no parameter 'link\.joint_7\.x'") as caught:
        model_of(reference_cell, ["zero_offset.joint_2", "link.joint_7.x"])
    assert "link.joint_" in caught.value.hint
    with pytest.raises(InputError, match="no parameter 'nonsense'"):
        model_of(reference_cell, ["nonsense"])


def test_every_kind_has_its_place_in_the_table():
    """A kind that is added has to be given its columns, or be one that is met."""
    from posedesign.files.measurements import _READ

    assert {kind for kind in KINDS if KINDS[kind].reads} == set(_READ)
    for kind, columns in _READ.items():
        assert len(columns) == KINDS[kind].rows


def test_joints_that_carry_much_are_taken_to_be_stiff() -> None:
    """Held by a wind-up at their largest torque, a light arm's as the cell says."""
    heavy = Cell.from_text(cell_template("r2000ic165f"))
    block = next(
        b for b in robot_blocks(heavy, ("compliance", "priors")) if isinstance(b, JointCompliance)
    )
    prior = dict(zip(block.names, block.prior, strict=True))
    assert prior["compliance.joint_1"] == pytest.approx(
        50e-6
    )  # it stands upright: no torque, as the cell says
    torque = max(
        abs(gravity_torque(heavy.robot, q, heavy.payload)[1])
        for q in np.random.default_rng(1).uniform(heavy.robot.lower, heavy.robot.upper, (2000, 6))
    )
    assert prior["compliance.joint_2"] == pytest.approx(WIND_UP / torque, rel=0.1)
    light = Cell.from_text(cell_template("ur5e"))
    block = robot_blocks(light, ("compliance", "priors"))[0]
    assert (block.prior <= 50.001e-6).all()
    assert (block.prior > 30e-6).all()


def test_models_by_name_are_turned_as_the_cell_has_the_instrument():
    """Rotations that were identified are from there: 170 deg of a tracker are no parameter."""
    cell = Cell.from_text(
        """
        [robot]
        preset = "kr6r900sixx"
        [tool]
        point_mm = [30.0, 0.0, 120.0]
        [base_pose]
        posture_deg = [0.0, -60.0, 85.0, 0.0, 65.0, 0.0]
        [target]
        name = "tracker"
        position_mm = [3000.0, 500.0, 800.0]
        wpr_deg = [10.0, -20.0, 170.0]
        [measurement]
        kind = "point"
        [[noise]]
        kind = "point"
        three_sigma_mm = 0.06
        """
    )
    planned = cell.model()
    by_name = model_of(cell, planned.names)
    x = planned.nominal + np.random.default_rng(0).normal(0.0, 1e-3, planned.p)
    order = [planned.names.index(name) for name in by_name.names]
    q = cell.base_posture + np.random.default_rng(1).uniform(-0.3, 0.3, (5, 6))
    assert by_name.predict(q, x[order]) == pytest.approx(planned.predict(q, x))
