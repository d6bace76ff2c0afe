"""The pairs of real robots, in metres, as those who measured them wrote them down."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from calib.se3 import FloatArray, transform
from posedesign.pairs_source import PairSource

HERE = Path(__file__).parent
MM = 1e-3
QUATERNION_COLUMNS = ("qw", "qx", "qy", "qz", "x_m", "y_m", "z_m")

Sides = tuple[FloatArray, FloatArray]


def data_folder() -> Path:
    """Where real measurements are looked for."""
    named = os.environ.get("POSEDESIGN_DATA")
    return Path(named) if named else HERE.parents[1].parent / "shared" / "data"


def real_pairs(data: Path) -> dict[str, Sides]:
    """A and B ``(N, 4, 4)`` [m] of every data set, by name.

    UR3e: A = T_camera_target, B = T_base_flange (the file has its inverse), X = T_target_base,
    Z = T_camera_flange. Tags: A X_tag = Z_camera B, B = T_camera_tag. Tabb: A = T_camera_target,
    B = T_flange_base, X = T_target_base, Z = T_camera_flange.
    """
    root = data / "robot_world"
    mat = root / "ur3e_hand_camera" / "T_handcam_UR3e210506.mat"
    sources = {"UR3e": PairSource(mat, variables=("T_cam", "T_hand"), unit="mm", invert="b")}
    for name, stem in (("tag 22, camera 2", "tag_22_cam_2"), ("tag 15, camera 1", "tag_15_cam_1")):
        a, b = (root / "multi_tag" / f"{stem}_{side}.csv" for side in "AB")
        sources[name] = PairSource(a=a, b=b, columns=QUATERNION_COLUMNS)
    read = {name: source.read() for name, source in sources.items()}
    found = {name: (pairs.A, pairs.B) for name, pairs in read.items()}
    return found | {"Tabb": _tabb(root / "tabb_ds1")}


def _tabb(folder: Path) -> Sides:
    """Rows of an index, a matrix and a translation [mm]; 4x4 blocks [mm] that the index counts."""
    rows = np.loadtxt(folder / "cali_subset24.txt")
    A = transform(rows[:, 1:10].reshape(-1, 3, 3), rows[:, 10:] * MM)
    numbers = (folder / "robot_cali.txt").read_text(encoding="utf-8").split()
    B = np.array(numbers[1:], dtype=float).reshape(-1, 4, 4)[rows[:, 0].astype(int)]
    return A, transform(B[:, :3, :3], B[:, :3, 3] * MM)


def from_the_images(data: Path) -> tuple[FloatArray, FloatArray]:
    """X and Z ``(4, 4)`` [m] that Tabb's publisher found from the images, not from poses."""
    path = data / "robot_world" / "tabb_ds1" / "transformations.txt"
    words = path.read_text(encoding="utf-8").split()
    found = []
    for first in (words.index("X") + 1, words.index("Z") + 2):  # "Z 0": of the first camera
        T = np.array(words[first : first + 16], dtype=float).reshape(4, 4)
        found.append(transform(T[:3, :3], T[:3, 3] * MM))
    return found[0], found[1]
