"""Measurements of real robots, which the project does not contain, and their pairs in metres."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from calib import CalibrationModel, IdentificationResult
from calib.errors import InputError
from calib.identification import minimise
from calib.model.measurements import Measurements
from calib.se3 import FloatArray, transform
from posedesign.hand_eye.pairs import PairSource

MM = 1e-3
QUATERNION_COLUMNS = ("qw", "qx", "qy", "qz", "x_m", "y_m", "z_m")
UR3E, TAGS, TABB = (f"robot_world/{name}" for name in ("ur3e_hand_camera", "multi_tag", "tabb_ds1"))
"""Folders in that of the measurements."""

Sides = tuple[FloatArray, FloatArray]


def real_pairs(data: Path) -> dict[str, Sides]:
    """A and B ``(N, 4, 4)`` [m] of every data set whose files are there, by name.

    UR3e: A = T_camera_target, B = T_base_flange (the file has its inverse), X = T_target_base,
    Z = T_camera_flange. Tags: A X_tag = Z_camera B, B = T_camera_tag. Tabb: A = T_camera_target,
    B = T_flange_base, X = T_target_base, Z = T_camera_flange.
    """
    sources: dict[str, PairSource] = {}
    mat = data / UR3E / "T_handcam_UR3e210506.mat"
    if mat.is_file():
        names = ("T_cam", "T_hand")
        sources["UR3e"] = PairSource(mat, variables=names, unit="mm", invert="b")
    for name, stem in (("tag 22, camera 2", "tag_22_cam_2"), ("tag 15, camera 1", "tag_15_cam_1")):
        a, b = (data / TAGS / f"{stem}_{side}.csv" for side in "AB")
        if a.is_file() and b.is_file():
            sources[name] = PairSource(a=a, b=b, columns=QUATERNION_COLUMNS)
    read = {name: source.read() for name, source in sources.items()}
    found = {name: (pairs.A, pairs.B) for name, pairs in read.items()}
    return found | {"Tabb": _tabb(data / TABB)} if (data / TABB).is_dir() else found


def _tabb(folder: Path) -> Sides:
    """Rows of an index, a matrix and a translation [mm]; 4x4 blocks [mm] that the index counts."""
    rows = np.loadtxt(folder / "cali_subset24.txt")
    A = transform(rows[:, 1:10].reshape(-1, 3, 3), rows[:, 10:] * MM)
    numbers = (folder / "robot_cali.txt").read_text(encoding="utf-8").split()
    B = np.array(numbers[1:], dtype=float).reshape(-1, 4, 4)[rows[:, 0].astype(int)]
    return A, transform(B[:, :3, :3], B[:, :3, 3] * MM)


def from_the_images(data: Path) -> tuple[FloatArray, FloatArray]:
    """X and Z ``(4, 4)`` [m] that Tabb's publisher found from the images, not from poses."""
    words = (data / TABB / "transformations.txt").read_text(encoding="utf-8").split()
    found = []
    for first in (words.index("X") + 1, words.index("Z") + 2):  # "Z 0": of the first camera
        T = np.array(words[first : first + 16], dtype=float).reshape(4, 4)
        found.append(transform(T[:3, :3], T[:3, 3] * MM))
    return found[0], found[1]


def refitted(
    model: CalibrationModel, data: Measurements, result: IdentificationResult, weights: FloatArray
) -> FloatArray:
    """Parameters ``(T, p)`` of fits by weights ``(T, N)``, with the noise that was found.

    Raises
    ------
    RuntimeError
        A fit that has not converged.
    """
    kinds = [
        kind.with_noise(noise.sigma / kind.sigma)
        for kind, noise in zip(model.measurements, result.noise, strict=True)
    ]
    start = np.tile(result.values, (len(weights), 1))
    noisy = model.with_measurements(kinds)
    fit = minimise(noisy, data.repeated(len(weights)), start, weights=weights)
    if not fit.converged.all():
        raise RuntimeError("a fit to some of the measurements has not converged")
    return fit.x


NAMED_BY = "POSEDESIGN_DATA"
"""Variable of the environment that names their folder."""


def data_folder() -> Path:
    """Where they are looked for: a folder that is named, or ``../shared/data`` by the checkout."""
    named = os.environ.get(NAMED_BY)
    return Path(named) if named else Path(__file__).parents[1].parent / "shared" / "data"


def data_with(*parts: str) -> Path:
    """The folder of real measurements, for a study that needs some parts of them.

    Parameters
    ----------
    *parts : str
        Folders in it, such as ``identification/ur10``.

    Raises
    ------
    InputError
        One of them is not there.
    """
    folder = data_folder()
    for part in parts:
        if not (folder / part).is_dir():
            raise InputError(
                f"this study needs measurements: there is no {folder / part}",
                hint=f"{NAMED_BY} names the folder of all measurements; without it, it is "
                "../shared/data beside the checkout",
                name=NAMED_BY,
                value=str(folder),
            )
    return folder


@contextmanager
def folder_for_recordings(out: Path, own: Path) -> Iterator[Path]:
    """A folder for what ``posedesign identify`` takes: that of the results, or one that is lost.

    It is lost where the results go to the study's own folder: measurements of others are no part of
    the project.
    """
    if out.resolve() != own.resolve():
        yield out
        return
    with TemporaryDirectory() as scratch:
        yield Path(scratch)
