"""Every kind of parameter seen by every kind of measurement, against central differences."""

import numpy as np
import pytest

from calib import CalibrationModel, Robot
from calib.model import Setup
from calib.model.measurements import KINDS
from calib.model.parameters import (
    BearingCompliance,
    JointCompliance,
    JointHarmonics,
    JointScale,
    LengthOffsets,
    LinkGeometry,
    LostMotion,
    Payload,
    TargetFrame,
    TargetPlane,
    TargetPoints,
    ToolBody,
    ToolFrame,
    ToolPoint,
    ToolPoints,
    ZeroOffsets,
)
from calib.se3 import rotation_exp, transform
from tests.positioners import beside_positioner

STEP = {"rad": 1e-5, "m": 1e-5, "rad/Nm": 1e-8, "rad/rad": 1e-5, "m/m": 1e-5}
"""Of the central differences: each moves the arm by some 10 µm."""

RELATIVE = 1e-7
"""Of the largest element of a column; truncation and rounding leave about 1e-8."""

POSES, TRIALS = 7, 2
NOISE = {1: [1e-5], 2: [1e-5, 3e-5], 3: [1e-5, 2e-5, 8e-5], 6: [1e-5, 2e-5, 3e-5, 1e-4, 2e-4, 3e-4]}
LOADS = (Payload(100.0, np.array([0.1, 0, 0.2])), Payload(20.0, np.array([0.3, 0, 0.2])))
SIX = ("x", "y", "z", "rx", "ry", "rz")


def turning(robot: Robot) -> tuple[str, ...]:
    """Names of the joints that turn."""
    return robot.joint_names[robot.n_external :]


OF_THE_ARM = {
    "zero offsets": lambda r: ZeroOffsets(r, r.joint_names[::-1]),
    "scale": lambda r: JointScale(r, r.joint_names),
    "harmonics": lambda r: JointHarmonics(r, turning(r)[1:3], [1, 2, 100]),
    "compliance": lambda r: JointCompliance(r, turning(r)[::2], LOADS),
    "bearings": lambda r: BearingCompliance(r, turning(r)[1:], LOADS),
    "lost motion": lambda r: LostMotion(
        r, turning(r)[1:], np.arange(2.0, len(turning(r)) + 1.0), LOADS
    ),
    "links": lambda r: LinkGeometry(r),
    "some links": lambda r: LinkGeometry(
        r, [f"link.{r.joint_names[1]}.ry", f"link.{r.joint_names[3]}.x"]
    ),
}
ALL = ("all", "tool", "target", *OF_THE_ARM)
GIVING_WAY = ("all", "compliance", "bearings", "lost motion")


def blocks(robot: Robot, freed: str, setting: str, rng: np.random.Generator) -> list:
    """The blocks of one model: points on the tool and around the arm, or frames."""
    chosen = OF_THE_ARM if freed == "all" else [freed] if freed in OF_THE_ARM else []
    arm = [OF_THE_ARM[name](robot) for name in chosen if name != "some links" or freed == name]
    tool, target = freed in ("tool", "all"), freed in ("target", "all")
    if setting == "points":
        places = [[1.9, 0.1, 0.5], [1.5, 0.6, 1]]
        return [
            TargetPoints(places, "ab", free=target),
            *arm,
            ToolPoint([0.2, -0.05, 0.35], "zxy" if tool else ""),
        ]

    def pose() -> np.ndarray:
        return transform(rotation_exp(rng.normal(size=3)), rng.normal(size=3))

    body = [ToolBody([[0.1, 0, 0], [0, 0.12, 0.02]], "PQ", pose())] if tool else []
    return [
        *arm,
        *body,
        ToolFrame(pose(), free=SIX if tool else ()),
        ToolPoints([[0.1, 0.2, 0.3]], ["reflector"], free="xyz" if tool else ""),
        TargetFrame(pose(), "tracker", free=SIX if target else ()),
        TargetPlane([1, 0, 0.3], [0.1, 0.2, 1], free=target),
        LengthOffsets(["tracker"]),
    ]


def kinds(measurement: str) -> list:
    names = list(KINDS) if measurement == "mixed" else [measurement]
    return [KINDS[name](NOISE[KINDS[name].rows]) for name in names]


SETTINGS = ("points", "frames")
CASES = [("oblique", freed, "mixed", setting) for freed in ALL for setting in SETTINGS]
CASES += [
    (arm, "all", measurement, SETTINGS[(i + k) % 2])
    for i, arm in enumerate(("oblique", "reference", "on slides", "beside a table"))
    for k, measurement in enumerate(KINDS)
]
"""Each block with all kinds of measurement at once, which see it by its twist alone; and all blocks
with each kind."""


def rows_at(model: CalibrationModel, q, x, setup: Setup, read) -> tuple[np.ndarray, np.ndarray]:
    """Residuals, and these over their noise, without their derivative."""
    view = model.view(q, x, setup)
    rows = model._differences(view, read)
    return view.posture_first(rows), view.posture_first(model.whiten_last(rows, view))


@pytest.mark.parametrize(("arm", "freed", "measurement", "setting"), CASES)
def test_jacobian_is_the_derivative_of_the_rows(
    reference_robot, random_urdf, arm, setting, measurement, freed, tmp_path
):
    """Of the residuals, and of these over their noise, whose axes may turn with the arm."""
    rng = np.random.default_rng(0)
    slides = 2 if arm == "on slides" else 0
    robot = reference_robot
    if arm == "beside a table":
        path = tmp_path / "robot.urdf"
        path.write_text(beside_positioner("r2000ic165f"))
        robot = Robot.from_urdf(path, tip="tool0", base="plate")
    elif arm != "reference":
        robot = Robot.from_urdf(random_urdf(rng, 5 + slides, slides))
    assert robot.n_external == (2 if arm == "beside a table" else slides)
    model = CalibrationModel(robot, blocks(robot, freed, setting, rng), kinds(measurement))
    assert model.p
    setup = Setup.of(
        POSES,
        kind=np.arange(POSES) % len(model.measurements) if measurement == "mixed" else 0,
        tool=rng.integers(0, len(model.tools), POSES),
        target=rng.integers(0, 2, POSES),
        payload=np.arange(POSES) % 2 if freed in GIVING_WAY else 0,
    )
    step = np.array([STEP[unit] for unit in model.units])
    is_read = np.array([kind.reads for kind in model.measurements])[setup.kind]
    finest = min(kind.sigma.min() for kind in model.measurements)
    for batch in ((), (TRIALS,)) if freed == "all" else ((TRIALS,),):
        q = rng.uniform(-1, 1, (*batch, POSES, robot.n))
        x = model.nominal + 1e3 * step * rng.uniform(-1, 1, (*batch, model.p))  # 10 mrad, 10 mm
        # readings as far off as a bad start: residual rotations of half a radian
        read = model.predict(q, x, setup) + rng.uniform(-0.3, 0.3, (*batch, POSES, model.rows))
        read[..., ~is_read, :] = 0.0
        linear = model.linearise(q, x, setup, read)
        assert linear.jacobian.shape == (*batch, POSES, model.rows, model.p)
        shift = np.diag(step).reshape(model.p, *np.ones(len(batch), dtype=int), model.p)
        ahead, behind = (rows_at(model, q, x + s, setup, read) for s in (shift, -shift))
        blocks_of = linear.jacobian, linear.white_jacobian
        for a, b, J, least in zip(ahead, behind, blocks_of, (1.0, 1.0 / finest), strict=True):
            numeric = np.moveaxis(a - b, 0, -1) / (2 * step)
            size = np.abs(numeric).reshape(-1, model.p).max(axis=0).clip(min=least)
            np.testing.assert_allclose(J / size, numeric / size, atol=RELATIVE)


@pytest.mark.parametrize("kind", [name for name, kind in KINDS.items() if kind.turns])
def test_without_readings_it_is_the_jacobian_where_nothing_is_left(reference_robot, kind):
    """Planning and covariance linearise before anything is read."""
    rng = np.random.default_rng(1)
    blocks_ = blocks(reference_robot, "all", "frames", rng)
    model = CalibrationModel(reference_robot, blocks_, kinds(kind))
    q = rng.uniform(-1, 1, (4, 6))
    read = model.predict(q)
    np.testing.assert_allclose(
        model.jacobian(q), model.linearise(q, observed=read).jacobian, atol=1e-12, rtol=1e-12
    )


def test_each_posture_has_its_own_arm(reference_robot):
    """Trials of postures, of parameters, and of both give what each gives alone."""
    rng = np.random.default_rng(2)
    model = CalibrationModel(
        reference_robot, blocks(reference_robot, "all", "frames", rng), kinds("mixed")
    )
    setup = Setup.of(7, kind=np.arange(7), tool=np.arange(7) % 2, payload=np.arange(7) % 2)
    step = np.array([STEP[unit] for unit in model.units])
    q = rng.uniform(-1, 1, (3, 7, 6))
    x = model.nominal + 1e3 * step * rng.uniform(-1, 1, (3, model.p))
    for qs, xs in ((q, x), (q, x[0]), (q[0], x)):
        many = model.linearise(qs, xs, setup)
        for t in range(3):
            one = model.linearise(
                qs if qs.ndim == 2 else qs[t], xs if xs.ndim == 1 else xs[t], setup
            )
            np.testing.assert_allclose(many.rows[t], one.rows, atol=1e-13)
            np.testing.assert_allclose(
                many.white_jacobian[t], one.white_jacobian, rtol=1e-12, atol=1e-6
            )
            np.testing.assert_allclose(many.noise_root[t], one.noise_root, atol=1e-18)
