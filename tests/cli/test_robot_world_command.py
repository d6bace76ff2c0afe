"""``posedesign robot-world`` as a person types it, on pairs in every form."""

import json
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.io import savemat

from calib.robot_world import (
    METHODS,
    PAPER_METHODS,
    PairCovariances,
    PairNoise,
    add_noise,
    random_problems,
    solve,
)
from calib.robot_world.methods import Method
from calib.robot_world.pairs import PairSets
from calib.robot_world.solver import solve_problem
from calib.se3 import FloatArray, inverse
from posedesign.hand_eye.pairs import Pairs, solve_pairs, write_pairs
from posedesign.hand_eye.pairs import results as pairs_results
from posedesign.hand_eye.pairs.forms import PoseForm
from posedesign.hand_eye.pairs.results import methods_of
from tests.cli.conftest import refusals, rows_of, unfolded

NOISE = PairNoise(rotation_rad=5e-4, translation_m=2e-4, on="B")
TYPED = ("--noise-deg", "0.02", "--noise-mm", "0.2")
QUATERNION = PoseForm("m", "quaternion")
COUNT = 12


@pytest.fixture(scope="module")
def measured() -> tuple[Pairs, FloatArray, FloatArray]:
    """Noisy pairs of a camera on the flange, with X and Z."""
    rng = np.random.default_rng(11)
    problem = random_problems(rng, 1, COUNT)
    A, B = add_noise(rng, problem.A[0], problem.B[0], NOISE)
    names = tuple(f"P{i + 1:02d}" for i in range(COUNT))
    return Pairs(names, A, B), problem.X[0], problem.Z[0]


@pytest.fixture
def pairs(measured) -> Pairs:
    return measured[0]


@pytest.fixture
def path(pairs, tmp_path) -> Path:
    """The pairs in a table."""
    return write_pairs(tmp_path / "pairs.csv", pairs)


def matlab(path: Path, **sides: FloatArray) -> Path:
    """A MATLAB file with 4x4xN arrays in mm."""
    stacked = {name: np.moveaxis(T, 0, -1).copy() for name, T in sides.items()}
    for T in stacked.values():
        T[:3, 3] *= 1e3
    savemat(path, stacked)
    return path


def headerless(path: Path, T: FloatArray, form: PoseForm) -> Path:
    lines = [",".join(repr(float(v)) for v in row) for row in form.numbers(T)]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_every_way_in_gives_the_same_answer(done, in_this_process, tmp_path, pairs):
    target2cam = inverse(pairs.B)
    quaternions = "qw,qx,qy,qz,x_m,y_m,z_m"
    table = write_pairs(tmp_path / "t.csv", pairs, QUATERNION, PoseForm("mm", "matrix"))
    other = write_pairs(tmp_path / "o.csv", Pairs(pairs.names, target2cam, inverse(pairs.A)))
    form = PoseForm("m", "vector-rad")
    sides = [
        headerless(tmp_path / f"{k}.csv", T, form) for k, T in (("a", pairs.A), ("b", pairs.B))
    ]
    swapped = [tmp_path / name for name in ("qa.csv", "qb.csv")]
    for path, T in zip(swapped, (pairs.A, target2cam), strict=True):
        q = QUATERNION.numbers(T)
        text = "\n".join(",".join(map(repr, row)) for row in np.roll(q, 4, axis=1).tolist())
        path.write_text(text + "\n")
    mat = matlab(tmp_path / "m.mat", T_hand=pairs.A, T_cam=target2cam)
    np.savez(tmp_path / "n.npz", A=pairs.A, B=pairs.B)
    samples = [
        {"effector_wrt_world": a.ravel().tolist(), "object_wrt_sensor": b.ravel().tolist()}
        for a, b in zip(pairs.A, target2cam, strict=True)
    ]
    (tmp_path / "moveit.yaml").write_text(json.dumps(samples))
    ways: list[tuple[object, ...]] = [
        (table,),
        (tmp_path / "n.npz", "--unit", "m"),
        (tmp_path / "moveit.yaml",),
        (other, "--convention", "opencv"),
        ("--a", sides[0], "--b", sides[1], "--columns", "x_m,y_m,z_m,rx_rad,ry_rad,rz_rad"),
        ("--a", swapped[0], "--b", swapped[1], "--columns", quaternions, "--invert", "b"),
        (mat, "--variables", "T_hand,T_cam", "--unit", "mm", "--invert", "b"),
    ]
    expected = solve(pairs.A, pairs.B, "shah")
    for k, way in enumerate(ways):
        out = tmp_path / f"out{k}"
        said = done("robot-world", *way, "--method", "shah", "--out", out, "--json")
        (answer,) = json.loads(said.out)
        np.testing.assert_allclose(answer["X"], expected.X, atol=1e-7)
        np.testing.assert_allclose(answer["Z"], expected.Z, atol=1e-7)
        assert ("opencv" in answer) == ("opencv" in way)


def test_samples_of_a_fixed_camera(cli, tmp_path, pairs):
    """What was B of a camera on the flange is here the target as a fixed camera sees it."""
    samples = [[a.tolist(), b.tolist()] for a, b in zip(pairs.A, pairs.B, strict=True)]
    path = tmp_path / "moveit.json"
    path.write_text(json.dumps(samples))
    said = cli(
        "robot-world", path, "--camera", "fixed", "--method", "shah", "--out", tmp_path, "--json"
    )
    (answer,) = json.loads(said.out)
    np.testing.assert_allclose(answer["X"], solve(pairs.A, pairs.B, "shah").X, atol=1e-9)
    said = cli("robot-world", path, "--method", "shah", "--out", tmp_path)
    assert "no X and Z fit A and B as they were read" in said.err
    assert "does not say where the camera is: taken as on the flange" in unfolded(said.err)


def test_what_is_printed_and_written(done, tmp_path, measured):
    pairs, X, Z = measured
    path = write_pairs(tmp_path / "pairs.csv", pairs)
    said = done("robot-world", path, "--method", "all", "--out", tmp_path)
    rows = rows_of(tmp_path / "robot_world.csv")
    assert [row["method"] for row in rows] == list(METHODS)
    assert all(said.out.count(f" {method} ") >= 3 for method in METHODS)
    for words in (
        "X = T_flange_camera: the camera in the flange frame",
        "Z = T_base_target: the target in the base frame",
        "A = T_base_flange: the flange in the base frame",
        "B = T_target_camera: the camera in the frame of the target",
        "T_camera_target, the target as the camera sees it (solvePnP",
        "pass --invert b",
        f"wrote: {tmp_path / 'robot_world.csv'}, {tmp_path / 'robot_world_pairs.csv'}",
    ):
        assert words in said.out
    best = next(row for row in rows if row["method"] == "ml")
    for letter, T in (("x", X), ("z", Z)):
        for axis, true in zip("xyz", 1e3 * T[:3, 3], strict=True):
            sigma = float(best[f"sigma_{letter}_{axis}_mm"])
            assert abs(float(best[f"{letter}_{axis}_mm"]) - true) < 5.0 * sigma
            assert 0.01 < sigma < 1.0
    assert best["noise"] == "estimated"
    # 60 degrees of freedom say the noise to a tenth of it
    assert 0.6 < float(best["noise_rotation_deg"]) / np.degrees(NOISE.rotation_rad) < 1.4


def test_residuals_pair_by_pair(cli, tmp_path, pairs, path):
    methods = ("ml", "shah")
    assert cli("robot-world", path, "--method", "ml, shah", "--out", tmp_path).code == 0
    rows = rows_of(tmp_path / "robot_world_pairs.csv")
    assert [(r["method"], r["pose"]) for r in rows] == [
        (method, name) for method in methods for name in pairs.names
    ]
    assert [row["place"] for row in rows[:2]] == ["line 2", "line 3"]
    for method, row in zip(methods, rows_of(tmp_path / "robot_world.csv"), strict=True):
        mine = [r for r in rows if r["method"] == method]
        assert {r["used"] for r in mine} == {"yes"}
        for each, rms in (
            ("residual_deg", "residual_rotation_deg"),
            ("residual_mm", "residual_translation_mm"),
            ("left_out_deg", "left_out_rotation_deg"),
            ("left_out_mm", "left_out_translation_mm"),
        ):
            found = np.sqrt(np.mean([float(r[each]) ** 2 for r in mine]))
            assert float(row[rms]) == pytest.approx(found, rel=1e-5)
        assert float(row["left_out_translation_mm"]) > float(row["residual_translation_mm"])
    # leaving out pair 5, done by hand
    keep = np.arange(COUNT) != 4
    by_hand = solve(pairs.A[keep], pairs.B[keep], "shah")
    miss = pairs.A[4] @ by_hand.X - by_hand.Z @ pairs.B[4]
    row = next(r for r in rows if (r["method"], r["pose"]) == ("shah", "P05"))
    assert float(row["left_out_mm"]) == pytest.approx(1e3 * np.linalg.norm(miss[:3, 3]), rel=1e-5)


def test_pairs_that_are_left_out_are_named(done, tmp_path, pairs):
    B = pairs.B.copy()
    B[[2, 7]] = B[[7, 2]]
    path = write_pairs(tmp_path / "pairs.csv", Pairs(pairs.names, pairs.A, B))
    said = done("robot-world", path, "--method", "ml-robust", "--out", tmp_path)
    assert "ml-robust: did not use line 4, line 9" in said.out
    rows = rows_of(tmp_path / "robot_world_pairs.csv")
    assert [row["pose"] for row in rows if row["used"] == "no"] == ["P03", "P08"]
    assert float(rows[2]["residual_mm"]) > 10.0
    (row,) = rows_of(tmp_path / "robot_world.csv")
    assert (row["pairs"], row["used"]) == ("12", "10")


def test_json_carries_everything(cli, tmp_path, pairs, path):
    noise = ("--noise-deg", np.degrees(NOISE.rotation_rad), "--noise-mm", 0.2, "--noise-on", "b")
    said = cli("robot-world", path, "--method", "ml", *noise, "--out", tmp_path, "--json")
    assert (said.code, said.err) == (0, "")
    (answer,) = json.loads(said.out)
    direct = solve(pairs.A, pairs.B, "ml", NOISE)
    np.testing.assert_allclose(answer["covariance"], direct.covariance, rtol=1e-4, atol=1e-14)
    assert np.shape(answer["covariance"]) == (12, 12)
    np.testing.assert_allclose(answer["residuals"], direct.residuals, atol=1e-8)
    assert answer["chi2"] == pytest.approx(direct.chi2, rel=1e-5)
    assert answer["freedom"] == direct.freedom
    assert answer["rank"] == 12
    assert (answer["noise"], answer["noise_on"]) == ("given", "B")
    assert answer["frames"]["X"].startswith("T_flange_camera")
    assert len(answer["each_pair"]) == COUNT
    assert set(answer) >= {"warnings", "weak_directions", "ambiguities", "alternatives", "message"}
    # rms of three axes against the deviations of the table
    sigma = np.sqrt(np.diag(answer["covariance"]))
    assert answer["sigma_x_x_mm"] == pytest.approx(1e3 * sigma[3])
    assert answer["sigma_z_rz_deg"] == pytest.approx(np.degrees(sigma[8]))


def test_fixed_camera(done, tmp_path, path):
    """The same numbers, other names: B is T_camera_target."""
    said = done("robot-world", path, "--camera", "fixed", "--method", "ml", "--out", tmp_path)
    for words in (
        "X = T_flange_target: the target in the flange frame",
        "Z = T_base_camera: the camera in the base frame",
        "B = T_camera_target: the target in the frame of the camera",
        "if B is T_target_camera",
    ):
        assert words in said.out
    assert "T_flange_camera" not in said.out


def test_answer_in_the_names_of_opencv(cli, tmp_path, pairs):
    """Against OpenCV itself, on its own input."""
    world2cam, base2gripper = inverse(pairs.B), inverse(pairs.A)
    path = write_pairs(tmp_path / "pairs.csv", Pairs(pairs.names, world2cam, base2gripper))
    way = ("robot-world", path, "--convention", "opencv", "--method", "shah", "--out", tmp_path)
    (answer,) = json.loads(cli(*way, "--json").out)
    R_X, p_X, R_Z, p_Z = cv2.calibrateRobotWorldHandEye(
        [T[:3, :3] for T in world2cam],
        [T[:3, 3:] for T in world2cam],
        [T[:3, :3] for T in base2gripper],
        [T[:3, 3:] for T in base2gripper],
        method=cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH,
    )
    for name, R, p in (("base2world", R_X, p_X), ("gripper2cam", R_Z, p_Z)):
        found = np.array(answer["opencv"][name])
        np.testing.assert_allclose(found[:3, :3], R, atol=2e-3)  # noise in other frames
        np.testing.assert_allclose(found[:3, 3:], p, atol=2e-3)
    table = cli(*way).out
    assert "In OpenCV's names" in table
    assert "base2world" in table
    assert "gripper2cam" in table
    assert "--invert b" not in table


def test_wrong_way_round_is_said(cli, tmp_path, pairs):
    path = write_pairs(tmp_path / "pairs.csv", Pairs(pairs.names, pairs.A, inverse(pairs.B)))
    said = cli("robot-world", path, "--method", "ml", "--out", tmp_path)
    assert said.code == 2
    (error,) = said.err.splitlines()  # once, though both the reader and the solver find it
    assert error.startswith("error: no X and Z fit A and B as they were read")
    assert error.endswith("with one side the other way round: see --invert")
    turned = cli("robot-world", path, "--method", "ml", "--invert", "b", "--out", tmp_path)
    assert (turned.code, turned.err) == (0, "")


def test_rows_out_of_step_are_said_by_the_solver_too(cli, tmp_path, pairs):
    """The reader sees that no form explains it, the solver which rows do."""
    late = Pairs(pairs.names, pairs.A, np.roll(pairs.B, 1, axis=0))
    path = write_pairs(tmp_path / "pairs.csv", late)
    said = cli("robot-world", path, "--method", "ml", "--out", tmp_path)
    warning, error = said.err.splitlines()
    assert warning.startswith("warning: between its poses A turns otherwise than B")
    assert "one row earlier" in error


def test_wrong_way_round_is_said_once_of_answers_too(cli, tmp_path, pairs):
    """A robust method may find pairs that agree in a wrong reading."""
    path = write_pairs(tmp_path / "pairs.csv", Pairs(pairs.names, pairs.A, inverse(pairs.B)))
    said = cli("robot-world", path, "--method", "ml-robust", "--out", tmp_path)
    assert said.code in (1, 2)
    assert len(said.err.splitlines()) == 1
    assert "with one side the other way round: see --invert" in said.err


def test_notes_on_the_file_are_warnings(cli, tmp_path, pairs):
    path = write_pairs(tmp_path / "pairs.csv", pairs, QUATERNION, QUATERNION)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines, lines[5]]) + "\n")
    said = cli("robot-world", path, "--method", "ml", "--out", tmp_path)
    assert (
        "warning: pairs that repeat another number by number are left out: line 14 as" in said.err
    )
    swapped = lines[0].replace("b_qw,b_qx,b_qy,b_qz", "b_qx,b_qy,b_qz,b_qw")
    path.write_text("\n".join([swapped, *lines[1:]]) + "\n")
    said = cli("robot-world", path, "--method", "ml", "--out", tmp_path)
    assert said.err.count("no X and Z fit A and B as they were read") == 1
    assert "if in B the four numbers called qx qy qz qw are w x y z" in said.err


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("papers", [*PAPER_METHODS]),
        ("shah,papers,zhuang", ["shah", *PAPER_METHODS]),
        ("shah, all", ["shah", *(name for name in METHODS if name != "shah")]),
    ],
)
def test_papers_and_all_stand_for_their_methods_each_once(typed, expected):
    assert [*methods_of(typed)] == expected


def test_three_pairs_are_enough_for_an_answer(done, tmp_path, pairs):
    """With none of them left out, and no noise to be seen in what is left over."""
    path = write_pairs(tmp_path / "p.csv", Pairs(pairs.names[:3], pairs.A[:3], pairs.B[:3]))
    said = done("robot-world", path, "--method", "shah", "--out", tmp_path, "--json")
    (answer,) = json.loads(said.out)
    assert answer["pairs"] == 3


REFUSED = refusals(r"""
nothing |  => give one file of pairs, or one with --a and one with --b
one side | --a p.csv => one with --a and one with --b
both | p.csv --a p.csv --b p.csv => give one file of pairs, or
no method | p.csv --method shah,hirshh => did you mean hirsh
empty method | p.csv --method shah, => --method 'shah,' lacks a name (put one comma
no method at all | p.csv --method '' => --method '' lacks a name
noise below zero | p.csv --noise-deg -1 --noise-mm 1 =>
  --noise-deg is -1 deg, no standard deviation (give one above 0 deg
noise that is none | p.csv --noise-deg 1 --noise-mm nan =>
  --noise-mm is nan mm, no standard deviation
noise that is no number | p.csv --noise-deg text --noise-mm 1 =>
  '--noise-deg': Input should be a valid number
noise of zero | p.csv --noise-deg 0 --noise-mm 1 => --noise-deg is 0 deg, and ml weighs by it
camera | p.csv --camera hand => '--camera'
invert | p.csv --invert c => '--invert'
convention | p.csv --convention cv => '--convention'
unit | p.mat --unit cm => '--unit'
unit of a table | p.csv --unit mm => are for files of matrices
no unit | p.mat => say it with --unit mm or --unit m
fixed, opencv | p.csv --camera fixed --convention opencv =>
  give gripper2base as A and target2cam as B
side without noise | p.csv --noise-on a => --noise-on a needs --noise-deg
shown, and given | p.csv --noise-on shown --noise-deg 1 --noise-mm 1 => finds the sizes itself
side of noise | p.csv --noise-on c => '--noise-on'
half a noise | p.csv --noise-mm 1 => or neither
no such file | no.csv => no.csv: cannot be read: No such file
a folder | folder => folder: has no files with one pose each
columns | p.csv --columns qw,qx => cells, 2 are named
""")


@pytest.mark.parametrize(("given", "said"), REFUSED)
def test_what_is_refused(refuse, tmp_path, measured, given, said):
    write_pairs(tmp_path / "p.csv", measured[0])
    (tmp_path / "folder").mkdir()
    matlab(tmp_path / "p.mat", A=measured[0].A, B=measured[0].B)
    known = {path.name for path in tmp_path.iterdir()} | {"no.csv"}
    typed = [tmp_path / word if word in known else word for word in shlex.split(given[0])]
    refuse("robot-world", *typed, "--out", tmp_path / "out").says(*said)


def test_bad_rows_are_refused_by_line(refuse, tmp_path, measured):
    form = PoseForm("mm", "matrix")
    path = write_pairs(tmp_path / "p.csv", measured[0], form, form)
    header, *lines = path.read_text().splitlines()
    cells = lines[4].split(",")
    columns = header.split(",")
    for column, value, words in (
        ("a_r22", "nan", "line 6, column a_r22: 'nan' is not a finite number"),
        ("a_r22", "5", "line 6, column a_r11 to a_r33: the rotation is not orthonormal"),
        ("b_x_mm", "", "line 6, column b_x_mm: an empty cell"),
    ):
        changed = list(cells)
        changed[columns.index(column)] = value
        text = "\n".join([header, *lines[:4], ",".join(changed), *lines[5:]])
        path.write_text(text + "\n")
        refuse("robot-world", path, "--out", tmp_path / "out").says(words)


def test_certificate_of_the_likeliest(cli, done, tmp_path, path):
    said = done(
        "robot-world", path, "--method", "ml,shah", "--certify", "--out", tmp_path, "--json"
    )
    likeliest, closed_form = json.loads(said.out)
    proof = likeliest["certificate"]
    assert proof["status"] == "proven"
    assert proof["unique"]
    assert proof["relative_gap"] < 1e-6
    for k, letter in enumerate("XZ"):
        apart = np.subtract(proof[letter], likeliest[letter])
        assert proof["away_mm"][k] == pytest.approx(1e3 * np.linalg.norm(apart[:3, 3]), abs=1e-9)
        assert proof["away_deg"][k] < 1e-4
    assert max(proof["away_sigma"]) <= proof["away_sigma_both"] < 0.05
    assert "certificate" not in closed_form
    text = cli("robot-world", path, "--method", "ml", "--certify", "--out", tmp_path)
    assert " pairs, proven to be the likeliest by this noise\n" in text.out
    assert "ml: proven: no X and Z have a chi² below" in text.out
    assert "; this is off that optimum, X by " in text.out


def test_optimum_that_is_proven_away_from_the_answer_is_no_proof_of_it(cli, tmp_path):
    """Residual rotations of a radian: their chords and their angles weigh otherwise."""
    rng = np.random.default_rng(5)
    problem = random_problems(rng, 1, 40)
    A, B = add_noise(rng, problem.A[0], problem.B[0], PairNoise(0.3, 2e-3, on="B"))
    names = tuple(str(i) for i in range(40))
    path = write_pairs(tmp_path / "pairs.csv", Pairs(names, A, B))
    noise = ("--noise-deg", np.degrees(0.3), "--noise-mm", 2)
    options = ("--method", "ml", "--certify", *noise, "--out", tmp_path)
    (row,) = json.loads(cli("robot-world", path, *options, "--json").out)
    proof = row["certificate"]
    assert proof["status"] == "away"
    assert proof["away_sigma_both"] > 0.05
    said = cli("robot-world", path, *options).out
    assert f"ml: the optimum proven is {proof['away_sigma_both']:.2g} sigma away, X by " in said
    assert "ml: proven" not in said


def test_noise_of_the_robot_is_found_where_the_residuals_show_it(cli, done, tmp_path):
    """Taken for noise of B, as where nothing is known, that of A puts the target farther off."""
    rng = np.random.default_rng(5)
    problem = random_problems(rng, 1, 60, 15.0)
    noise = PairNoise(rotation_rad=np.radians(0.5), translation_m=1e-3, on="A")
    A, B = add_noise(rng, problem.A[0], problem.B[0], noise)
    names = tuple(f"P{i + 1:02d}" for i in range(60))
    path = write_pairs(tmp_path / "pairs.csv", Pairs(names, A, B))
    off = []
    for k, words in enumerate((("--noise-on", "b"), ("--noise-on", "shown"), (), ("--certify",))):
        said = done(
            "robot-world", path, "--method", "ml", *words, "--out", tmp_path / f"{k}", "--json"
        )
        of_B = k in (0, 3)
        assert ("residuals show other noise" in said.err) == of_B
        (answer,) = json.loads(said.out)
        assert answer["noise"] == "estimated"
        assert answer["noise_on"] == ("B" if of_B else "A")
        assert ("of the variance of rotations is of A" in answer["message"]) == (not of_B)
        off.append(np.linalg.norm(np.subtract(answer["Z"], problem.Z[0])[:3, 3]))
    assert off[1] == off[2] < off[0] == off[3]
    assert answer["certificate"]["status"] == "proven"
    said = cli("robot-world", path, "--method", "ml", "--certify", "--out", tmp_path / "c")
    assert "proofs are of noise of B, the same in all directions" in said.out


@pytest.mark.parametrize(
    ("options", "reasons"),
    [
        (("--method", "shah"), ("proven to be one", "add the method ml")),
        ((*TYPED, "--noise-on", "both"), ("noise on A and B at once", "--noise-on a or b")),
        (("--noise-on", "shown"), ("--noise-on shown may find noise on both sides",)),
        (
            (*TYPED, "--noise-on", "seen"),
            ("--noise-on seen has another size in each direction", "certify with --noise-on b"),
        ),
    ],
)
def test_what_cannot_be_certified_is_refused_before_solving(refuse, tmp_path, options, reasons):
    """Even before reading: there is no such file."""
    path = tmp_path / "no.csv"
    refuse("robot-world", path, "--certify", *options, "--out", tmp_path / "out").says(*reasons)


def test_fixed_camera_sees_the_target_at_b_and_is_certified(cli, tmp_path, path):
    options = ("--method", "ml", *TYPED, "--noise-on", "seen", "--certify", "--out", tmp_path)
    said = cli("robot-world", path, "--camera", "fixed", *options)
    assert "ml: proven: no X and Z have a chi² below" in said.out


def test_noise_of_the_target_as_seen_weighs_as_the_camera_does(cli, tmp_path, pairs, path):
    options = ("--method", "ml", *TYPED, "--out", tmp_path, "--json")
    on_flange = cli("robot-world", path, "--noise-on", "seen", *options)
    (row,) = json.loads(on_flange.out)
    sigma = PairNoise(np.radians(0.02), 2e-4).sigma
    noise = PairCovariances.of_seen_target(pairs.B, np.diag(sigma**2))
    expected = solve(pairs.A, pairs.B, "ml", noise)
    np.testing.assert_allclose(row["X"], expected.X, atol=1e-9)
    assert not np.allclose(solve(pairs.A, pairs.B, "ml").X, expected.X, atol=1e-7)
    # a fixed camera sees the target at B itself
    fixed = cli("robot-world", path, "--camera", "fixed", "--noise-on", "seen", *options)
    as_b = cli("robot-world", path, "--camera", "fixed", "--noise-on", "b", *options)
    assert json.loads(fixed.out)[0]["X"] == json.loads(as_b.out)[0]["X"]


@pytest.mark.parametrize(
    ("times", "words"),
    [
        (1.0, "the noise given explains what is left over"),
        (0.3, "the noise given does not explain what is left over"),
        (5.0, "the noise given is larger than what is left over shows"),
    ],
)
def test_whether_the_noise_explains_the_data_is_said(cli, tmp_path, pairs, path, times, words):
    noise = PairNoise(times * NOISE.rotation_rad, times * NOISE.translation_m)
    typed = ("--noise-deg", np.degrees(noise.rotation_rad), "--noise-mm", 1e3 * noise.translation_m)
    said = cli("robot-world", path, "--method", "ml,shah", *typed, "--out", tmp_path)
    result = solve(pairs.A, pairs.B, "ml", noise)
    assert result.chi2 is not None
    (line,) = (line for line in said.out.splitlines() if "chi²" in line)
    assert line.startswith(f"ml, shah: chi² {result.chi2:.5g} of {6 * COUNT - 12} degrees of")
    assert f"probability {result.chi2_probability:.2g}" in line
    assert line.endswith(words) or f"{words}: " in line
    for row in rows_of(tmp_path / "robot_world.csv"):
        assert row["freedom"] == "60"
        assert float(row["chi2_per_freedom"]) == pytest.approx(result.chi2 / 60, rel=1e-4)
    unsaid = cli("robot-world", path, "--method", "ml", "--out", tmp_path)
    assert "chi²" not in unsaid.out
    assert rows_of(tmp_path / "robot_world.csv")[0]["chi2_per_freedom"] == ""


def test_progress_is_shown_in_a_terminal_only(cli, tmp_path, path, monkeypatch):
    typed = ("robot-world", path, "--method", "shah,zhuang", "--out", tmp_path)
    assert cli(*typed).err == ""
    monkeypatch.setenv("FORCE_COLOR", "1")  # rich then takes standard error for a terminal
    assert "A X = Z B" in cli(*typed).err
    assert cli(*typed, "--json").err == ""


def test_progress_goes_method_by_method(measured):
    told: list[tuple[str, float]] = []
    solve_pairs(measured[0], ["shah", "ml"], advance=lambda what, part: told.append((what, part)))
    steps = ("solving", "standard deviations", "leaving out pairs")
    names = [f"{method}, {step}" for method in ("shah", "ml") for step in steps]
    assert [what for what, _ in told] == [*names, "writing"]
    assert [part for _, part in told] == pytest.approx([k / 6 for k in range(7)])


@pytest.mark.parametrize(
    ("method", "status"),
    [
        *(("ml", status) for status in ("ambiguous", "doubtful", "misfit", "not converged")),
        *((method, "doubtful") for method in ("ml,shah", "shah,ml")),
    ],
)
def test_answer_that_is_not_ok_is_not_done(cli, tmp_path, path, monkeypatch, method, status):
    """Where it is the one that was asked for first: the others are there to compare."""

    def told(pairs: PairSets, chosen: Method, noise: Any, **options: Any) -> Any:
        result = solve_problem(pairs, chosen, noise, **options)
        return replace(result, _first=(status, "why")) if chosen.name == "ml" else result

    monkeypatch.setattr(pairs_results, "solve_problem", told)
    said = cli("robot-world", path, "--method", method, "--out", tmp_path, "--json")
    assert said.code == (0 if method == "shah,ml" else 1)
    assert f"warning: ml: {status}: why\n" in said.err
    (row,) = [row for row in json.loads(said.out) if row["method"] == "ml"]
    assert row["status"] == status


def test_opencv_order_in_every_kind_of_file(cli, in_this_process, tmp_path, pairs):
    """gripper2base and target2cam as they are, with A and B where OpenCV's function has them."""
    gripper2base, target2cam = pairs.A, inverse(pairs.B)
    form = PoseForm("m", "vector-rad")
    typed = "x_m,y_m,z_m,rx_rad,ry_rad,rz_rad"
    table = write_pairs(tmp_path / "t.csv", Pairs(pairs.names, target2cam, gripper2base), form)
    sides = [
        headerless(tmp_path / f"{name}.csv", T, form)
        for name, T in (("a", target2cam), ("b", gripper2base))
    ]
    mat = matlab(tmp_path / "m.mat", A=target2cam, B=gripper2base)
    expected = solve(pairs.A, pairs.B, "shah")
    ways: tuple[tuple[object, ...], ...] = (
        (table,),
        ("--a", sides[0], "--b", sides[1], "--columns", typed),
        (mat, "--unit", "mm"),
    )
    for way in ways:
        options = ("--convention", "opencv", "--invert", "b", "--method", "shah", "--json")
        said = cli("robot-world", *way, *options, "--out", tmp_path)
        assert (said.code, said.err) == (0, ""), said
        (answer,) = json.loads(said.out)
        np.testing.assert_allclose(answer["X"], expected.X, atol=1e-7)
        np.testing.assert_allclose(answer["opencv"]["gripper2cam"], inverse(expected.X), atol=1e-7)
    shown = " ".join(cli("robot-world", "--help").out.replace("│", " ").split())
    for words in ("A is world2cam and B is base2gripper", "Where B is gripper2base: with --invert"):
        assert words in shown
