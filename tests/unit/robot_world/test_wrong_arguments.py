"""Every public function of the package, called wrongly, says so in one line."""

import inspect

import numpy as np
import pytest

import calib.robot_world as robot_world
from calib.errors import CalibError
from calib.robot_world import PairCovariances, PairNoise, design

PROBLEM = robot_world.random_problems(np.random.default_rng(0), 1, 6)
A, B, X, Z = PROBLEM.A[0], PROBLEM.B[0], PROBLEM.X[0], PROBLEM.Z[0]
NOISE = PairNoise(1e-3, 1e-3)
LEFT_HANDED = A * np.array([-1.0, 1.0, 1.0, 1.0])
NOT_FINITE = np.where(np.arange(4) == 1, np.nan, A)

WRONG = {
    "None": None,
    "text": "A",
    "bytes": b"A",
    "a number": -3.5,
    "infinity": float("inf"),
    "rotations and translations": (A[:, :3, :3], A[:, :3, 3]),
    "texts": ["a", "b"],
    "rows of unequal length": [[1.0], [1.0, 2.0]],
    "nothing": [],
    "no pairs": np.zeros((0, 4, 4)),
    "a number too large": [10**400],
    "NaN": NOT_FINITE,
    "left-handed": LEFT_HANDED,
    "zeros": np.zeros((6, 4, 4)),
    "without the last row": A[:, :3],
    "MATLAB's order": np.moveaxis(A, 0, -1),
    "rotations": A[:, :3, :3],
    "complex": A * 1j,
    "objects": np.array([object()]),
    "mapping": {"A": A},
    "function": len,
    "generator": (T for T in A),
}
CALLS = {
    "solve": (robot_world.solve, {"A": A, "B": B, "method": "ml", "noise": NOISE}),
    "solve_batch": (robot_world.solve_batch, {"A": A[None], "B": B[None], "method": "shah"}),
    "solve_batch_by_each": (
        robot_world.solve_batch_by_each,
        {"A": A[None], "B": B[None], "methods": ("shah", "ml")},
    ),
    "shown_noise": (robot_world.shown_noise, {"A": A, "B": B}),
    "certify": (robot_world.certify, {"A": A, "B": B, "X": X, "Z": Z, "noise": NOISE}),
    "add_noise": (
        robot_world.add_noise,
        {"rng": np.random.default_rng(0), "A": A, "B": B, "noise": NOISE},
    ),
    "random_problems": (
        robot_world.random_problems,
        {"rng": np.random.default_rng(0), "trials": 1, "pairs": 4, "cone_deg": 20.0},
    ),
    "pairs_from_opencv": (robot_world.pairs_from_opencv, {"world2cam": A, "base2gripper": B}),
    "result_to_opencv": (robot_world.result_to_opencv, {"result": robot_world.solve(A, B)}),
    "PairNoise": (PairNoise, {"rotation_rad": 1e-3, "translation_m": 1e-3, "on": "B"}),
    "PairCovariances": (PairCovariances, {"A": np.eye(6), "B": np.eye(6), "axes": "to"}),
    "of_seen_target": (PairCovariances.of_seen_target, {"B": B, "covariance": np.eye(6)}),
    "PairSets": (robot_world.PairSets, {"A": A[None], "B": B[None]}),
    "planned_B": (design.planned_B, {"A": A, "X": X, "Z": Z}),
    "blocks": (design.blocks, {"A": A, "X": X, "Z": Z, "noise": NOISE}),
    "information": (design.information, {"blocks": design.blocks(A, X, Z, NOISE)}),
    "covariance": (design.covariance, {"blocks": design.blocks(A, X, Z, NOISE)}),
}
HARMLESS = {
    ("PairNoise", "on", "text"),
    ("solve", "noise", "None"),
    ("random_problems", "cone_deg", "None"),
    ("PairCovariances", "A", "None"),
    ("PairCovariances", "B", "None"),
    ("pairs_from_opencv", "world2cam", "no pairs"),
    ("pairs_from_opencv", "base2gripper", "no pairs"),
    ("planned_B", "X", "no pairs"),
    ("planned_B", "Z", "no pairs"),
    ("PairSets", "A", "NaN"),
    ("solve_batch_by_each", "methods", "nothing"),
}


@pytest.mark.parametrize(
    ("name", "argument"),
    [(name, argument) for name, (_, given) in CALLS.items() for argument in given],
)
def test_a_wrong_argument_is_refused_in_one_line(name, argument):
    function, given = CALLS[name]
    function(**given)
    for what, wrong in WRONG.items():
        if (name, argument, what) in HARMLESS:
            continue
        with pytest.raises(CalibError) as caught:
            function(**{**given, argument: wrong})
        text = str(caught.value)
        assert "\n" not in text, what
        assert 0 < len(text) < 400, what


def test_every_public_function_is_called_wrongly():
    """But for results, which nobody makes by hand, and what is given checked arrays."""
    results = {"Certificate", "Method", "Problems", "RobotWorldBatch", "RobotWorldResult", "Scale"}
    results |= {"Network", "NetworkResult", "StreamResult"}
    elsewhere = {"FramePrior", "PoseStream", "solve_network", "solve_streams"}  # tests of their own
    of_checked = {"NoiseShown", "difference", "residuals"}
    public = {
        name
        for module in (robot_world, design)
        for name in (getattr(module, "__all__", None) or vars(module))
        if not name.startswith("_")
        and callable(getattr(module, name))
        and (module is robot_world or inspect.getmodule(getattr(module, name)) is design)
    }
    assert public - results - of_checked - elsewhere == set(CALLS) - {"of_seen_target"}
