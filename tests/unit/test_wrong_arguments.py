"""The public names that others build on, called wrongly, say so in one line."""

import numpy as np
import pytest

import posedesign
from calib import CalibrationModel, Robot, identify
from calib.errors import CalibError
from calib.model.measurements import TouchUp
from calib.model.parameters import TargetPoints, ToolPoint, ZeroOffsets
from posedesign import programs
from posedesign.selection import indices

ROBOT = Robot.preset("r2000ic165f")
BLOCKS = [ZeroOffsets(ROBOT, ["joint_2"]), ToolPoint([0.2, 0.0, 0.3]), TargetPoints([[2.0, 0, 1]])]
MODEL = CalibrationModel(ROBOT, BLOCKS, TouchUp(4e-5))
Q = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 6))
ROWS = np.random.default_rng(1).normal(size=(20, 3, 5))

WRONG = {
    "None": None,
    "text": "x",
    "bytes": b"x",
    "a number": -3.5,
    "infinity": float("inf"),
    "arrays of two shapes": (np.eye(2), np.eye(3)[:, :1]),
    "texts": ["a", "b"],
    "rows of unequal length": [[1.0], [1.0, 2.0]],
    "nothing": [],
    "a number too large": [10**400],
    "NaN": Q * np.nan,
    "complex": Q * 1j,
    "objects": np.array([object()]),
    "mapping": {"a": 1},
    "function": len,
    "generator": (row for row in Q),
    "four axes": np.zeros((2, 3, 4, 5)),
}
CALLS = {
    "from_urdf": (Robot.from_urdf, {"path": "none.urdf"}),
    "preset": (Robot.preset, {"name": "r2000ic165f"}),
    "fk": (ROBOT.fk, {"q": Q}),
    "jacobian": (ROBOT.jacobian, {"q": Q}),
    "CalibrationModel": (
        CalibrationModel,
        {"robot": ROBOT, "parameters": BLOCKS, "measurement": TouchUp(4e-5)},
    ),
    "predict": (MODEL.predict, {"q": Q}),
    "predict at values": (MODEL.predict, {"q": Q, "x": MODEL.nominal}),
    "model jacobian": (MODEL.jacobian, {"q": Q, "x": MODEL.nominal}),
    "whiten": (MODEL.whiten, {"q": Q, "rows": MODEL.jacobian(Q)}),
    "identify": (identify, {"model": MODEL, "measurements": None}),
    "plan": (posedesign.plan, {"cell": None}),
    "select": (posedesign.select, {"blocks": ROWS, "n": 6, "criterion": "D", "method": "exchange"}),
    "write": (programs.write, {"program": None, "dialect": "no", "folder": "nowhere"}),
    "read": (programs.read, {"path": "none.ls"}),
    "validate": (programs.validate, {"path": "none.ls"}),
    **{
        name: (getattr(indices, name), {"G": ROWS})
        for name in ("condition_inf", "condition_2", "o1", "o2", "o3", "o4", "o5")
    },
}
HARMLESS = {("predict at values", "x", "None"), ("model jacobian", "x", "None")}


@pytest.mark.parametrize(
    ("name", "argument"),
    [(name, argument) for name, (_, given) in CALLS.items() for argument in given],
)
def test_a_wrong_argument_is_refused_in_one_line(name, argument):
    function, given = CALLS[name]
    for what, wrong in WRONG.items():
        if (name, argument, what) in HARMLESS:
            continue
        with pytest.raises(CalibError) as caught:
            function(**{**given, argument: wrong})
        text = str(caught.value)
        assert "\n" not in text, what
        assert 0 < len(text) < 600, what
