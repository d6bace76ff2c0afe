"""Conventions that pairs tell: mistakes are named, and nothing where the pairs do not tell it."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.errors import InputError
from calib.se3 import FloatArray, inverse, rotation_exp, transform
from posedesign.hand_eye.pairs import PairSource
from posedesign.hand_eye.pairs.readings import FAIR

Numbers = Callable[[Rotation], FloatArray]

X = transform(rotation_exp(np.array([0.3, 0.2, -0.4])), np.array([0.03, 0.05, 0.1]))
Z = transform(rotation_exp(np.array([0.1, 0.2, 1.0])), np.array([0.7, 0.1, 0.02]))
WPR = ("w_deg", "p_deg", "r_deg")


def euler(order: str) -> Numbers:
    return lambda R: np.asarray(R.as_euler(order, degrees=True))


MISTAKES: dict[str, tuple[Numbers, tuple[str, ...], str]] = {
    "KUKA": (euler("ZYX"), WPR, "zyx-moving (kuka-abc"),
    "Staubli": (euler("XYZ"), WPR, "xyz-moving (staubli-rxryrz"),
    "Kawasaki": (euler("ZYZ"), WPR, "zyz-moving (kawasaki-oat"),
    **{f"{o} moving": (euler(o), WPR, f"{o.lower()}-moving") for o in ("YXZ", "YZX", "ZXZ", "XYX")},
    **{f"{o} fixed": (euler(o), WPR, f"{o}-fixed") for o in ("xzy", "zyx", "zyz", "yxy")},
    "vector": (lambda R: R.as_rotvec(degrees=True), WPR, "rotation-vector (ur-rotation-vector"),
    "angles for a vector": (lambda R: R.as_euler("ZYX"), ("rx_rad", "ry_rad", "rz_rad"), "zyx-mov"),
    "quaternion": (lambda R: R.as_quat(), ("qw", "qx", "qy", "qz"), "quaternion-xyzw"),
    "columns": (
        lambda R: np.swapaxes(R.as_matrix(), 1, 2).reshape(-1, 9),
        tuple(f"r{i}{j}" for i in "123" for j in "123"),
        "matrix-by-columns",
    ),
}


def noisy_pairs(count: int, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    down = Rotation.from_euler("xyz", [170.0, 10.0, 30.0], degrees=True).as_matrix()
    place = np.array([0.6, 0.1, 0.5]) + rng.uniform(-0.2, 0.2, (count, 3))
    A = transform(rotation_exp(rng.uniform(-0.6, 0.6, (count, 3))) @ down, place)
    off = rotation_exp(rng.normal(0.0, 2e-3, (count, 3))), rng.normal(0.0, 5e-4, (count, 3))
    return A, inverse(Z) @ A @ X @ transform(*off)


def written(path: Path, T: FloatArray, case: str = "", scale: float = 1e3) -> Path:
    numbers, columns, _ = MISTAKES[case] if case else (euler("xyz"), WPR, "")
    rows = np.hstack([scale * T[:, :3, 3], numbers(Rotation.from_matrix(T[:, :3, :3]))])
    head = ",".join(["x_mm", "y_mm", "z_mm", *columns])
    lines = [",".join(f"{value:.8f}" for value in row) for row in rows]
    path.write_text("\n".join([head, *lines]) + "\n")
    return path


def misread(folder: Path, a: FloatArray, b: FloatArray, of_a: str = "", of_b: str = "") -> str:
    paths = written(folder / "a.csv", a, of_a), written(folder / "b.csv", b, of_b)
    return PairSource(a=paths[0], b=paths[1]).read().misread


@pytest.mark.parametrize("case", MISTAKES)
@pytest.mark.parametrize("side", ["A", "B"])
def test_a_mistake_in_one_side_is_named(tmp_path, case, side):
    A, B = noisy_pairs(20)
    said = misread(tmp_path, A, B, *((case, "") if side == "A" else ("", case)))
    assert f"if in {side} the " in said
    assert MISTAKES[case][2] in said
    assert "as well" not in said  # one alone
    word = said.rpartition("`poses_are` ")[2]
    paths = written(tmp_path / "a.csv", A), written(tmp_path / "b.csv", B)
    path = paths[0] if side == "A" else paths[1]
    written(path, A if side == "A" else B, case)
    poses_are = f"{word}/" if side == "A" else f"/{word}"
    found = PairSource(a=paths[0], b=paths[1], poses_are=poses_are).read()
    assert found.misread == ""
    np.testing.assert_allclose(found.A, A, atol=1e-7)
    np.testing.assert_allclose(found.B, B, atol=1e-7)


@pytest.mark.parametrize("seed", range(8))
def test_mistakes_in_both_sides_are_named(tmp_path, seed):
    rng = np.random.default_rng(seed)
    cases = rng.choice([*MISTAKES], 2).tolist()
    said = misread(tmp_path, *noisy_pairs(15, seed), *cases)
    assert all(MISTAKES[case][2] in said for case in cases)


def test_inverted_in_another_convention(tmp_path):
    A, B = noisy_pairs(20)
    said = misread(tmp_path, inverse(A), B, "Kawasaki")
    assert "zyz-moving" in said
    assert "with one side the other way round" in said


def test_units_in_between(tmp_path):
    A, B = noisy_pairs(20)
    paths = written(tmp_path / "a.csv", A, scale=100.0), written(tmp_path / "b.csv", B)
    said = PairSource(a=paths[0], b=paths[1]).read().misread
    assert "if lengths of A are cm, not mm" in said


@pytest.mark.parametrize("count", [5, 20])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_nothing_is_named_without_a_mistake(tmp_path, count, noise):
    """Nor where there is one that is no convention: rows in another order."""
    for seed in range(10):
        A, B = noisy_pairs(count, seed)
        rng = np.random.default_rng(seed)
        off = rotation_exp(rng.normal(0.0, noise, (count, 3))), rng.normal(0.0, noise, (count, 3))
        assert misread(tmp_path, A, B @ transform(*off)) == ""
        if count > 5:
            assert misread(tmp_path, A, B[rng.permutation(count)]) == ""


def raw(path: Path, T: FloatArray, numbers: FloatArray, names: str) -> Path:
    rows = np.hstack([1e3 * T[:, :3, 3], numbers])
    lines = [",".join(f"{value:.8f}" for value in row) for row in rows]
    path.write_text("\n".join([f"x,y,z,{names}", *lines]) + "\n")
    return path


@pytest.mark.parametrize("order", ["ZYX", "ZYZ", "xyz"])
def test_what_nobody_says_is_told_by_the_pairs(tmp_path, order):
    A, B = noisy_pairs(20)
    a = raw(tmp_path / "a.csv", A, euler(order)(Rotation.from_matrix(A[:, :3, :3])), "a,b,c")
    found = PairSource(a=a, b=written(tmp_path / "b.csv", B)).read()
    np.testing.assert_allclose(found.A, A, atol=1e-7)
    word = f"{order.lower()}-{'moving' if order.isupper() else 'fixed'}"
    assert any(f"does not say what its orientations are: {word}" in note for note in found.notes)
    assert any("mm, by their size" in note for note in found.notes)


def test_what_the_pairs_do_not_tell_is_asked(tmp_path):
    """Without a third angle the second and the first make the same rotation in some conventions."""
    rng = np.random.default_rng(0)
    angles = np.append(rng.uniform(-40.0, 40.0, (20, 2)), np.zeros((20, 1)), axis=1)
    R = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    A = transform(R, rng.uniform(0.2, 0.8, (20, 3)))
    a = raw(tmp_path / "a.csv", A, angles, "rx,ry,rz")
    b = written(tmp_path / "b.csv", inverse(Z) @ A @ X)
    with pytest.raises(InputError) as caught:
        PairSource(a=a, b=b).read()
    assert "xyz-fixed (fanuc-wpr" in caught.value.message
    assert "yxz-moving-of-rxryrz" in caught.value.message
    found = PairSource(a=a, b=b, poses_are="fanuc-wpr/").read()
    np.testing.assert_allclose(found.A, A, atol=1e-7)


def test_few_pairs_and_pairs_of_no_convention(tmp_path):
    A, B = noisy_pairs(20)
    numbers = euler("ZYX")(Rotation.from_matrix(A[:, :3, :3]))
    few = raw(tmp_path / "a.csv", A[:6], numbers[:6], "a,b,c")
    with pytest.raises(InputError, match="6 poses are too few to tell"):
        PairSource(a=few, b=written(tmp_path / "b.csv", B[:6])).read()
    whole = raw(tmp_path / "a.csv", A, numbers[::-1], "a,b,c")
    with pytest.raises(InputError, match="no convention fits"):
        PairSource(a=whole, b=written(tmp_path / "b.csv", B)).read()
    assert FAIR < 0.5  # what wrong rows leave over


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("kuka-abc/kuka-abc/m", "has 3 parts"),
        ("quaternion-wxyz/", "has 3 numbers of the orientation, quaternion-wxyz has 4"),
    ],
)
def test_words_that_do_not_fit(tmp_path, words, said):
    A, B = noisy_pairs(10)
    paths = written(tmp_path / "a.csv", A), written(tmp_path / "b.csv", B)
    with pytest.raises(InputError, match=said):
        PairSource(a=paths[0], b=paths[1], poses_are=words).read()
