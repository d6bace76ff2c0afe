"""Pose pairs in every form: what is written is read back, and what is no pose is refused."""

import csv
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.spatial.transform import Rotation

from calib.errors import CalibError, FileFormatError, InputError
from calib.se3 import FloatArray, inverse, rotation_exp, rotation_log, transform
from posedesign.hand_eye.pairs import Pairs, PairSource, read_pairs, write_pairs
from posedesign.hand_eye.pairs.file import expanded, pair_columns, read_side
from posedesign.hand_eye.pairs.forms import METRES, TURNS, PoseForm

FILES_BETWEEN_EXAMPLES = settings(
    max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
FORMS = [PoseForm(unit, turn) for unit in METRES for turn in TURNS]
ROUNDED = {"mm": 1e-12, "m": 1e-9}
"""[m] that nine decimals of a translation leave, doubled."""

TURN_ROUNDED = 1e-8
"""[rad] that nine decimals of any form of an orientation leave."""


def some_pairs(count: int = 8, seed: int = 1) -> Pairs:
    """Pairs of a known X and Z, far from any that could be taken for another unit."""
    rng = np.random.default_rng(seed)
    A, X, Z = (
        transform(Rotation.random(n, rng=rng).as_matrix(), rng.uniform(0.1, 0.9, (n, 3)))
        for n in (count, 1, 1)
    )
    return Pairs(tuple(f"P{i + 1:02d}" for i in range(count)), A, inverse(Z) @ A @ X)


def assert_same(found: FloatArray, expected: FloatArray, form: PoseForm) -> None:
    np.testing.assert_allclose(found[:, :3, 3], expected[:, :3, 3], rtol=0, atol=ROUNDED[form.unit])
    turn = np.swapaxes(found[:, :3, :3], -1, -2) @ expected[:, :3, :3]
    assert np.linalg.norm(rotation_log(turn), axis=-1).max() < TURN_ROUNDED


@FILES_BETWEEN_EXAMPLES
@given(
    vectors=arrays.arrays(float, (4, 2, 3), elements=st.floats(-3.1, 3.1)),
    places=arrays.arrays(float, (4, 2, 3), elements=st.floats(-10.0, 10.0)),
    a=st.sampled_from(FORMS),
    b=st.sampled_from(FORMS),
)
def test_every_form_round_trips(tmp_path, vectors, places, a, b):
    T = transform(rotation_exp(vectors), places)
    path = write_pairs(tmp_path / "p.csv", Pairs(("1", "2", "3", "4"), T[:, 0], T[:, 1]), a, b)
    found = read_pairs(path, trust_units=True)
    assert_same(found.A, T[:, 0], a)
    assert_same(found.B, T[:, 1], b)
    assert found.places == ("line 2", "line 3", "line 4", "line 5")


@pytest.mark.parametrize("form", FORMS, ids=lambda form: f"{form.turn}, {form.unit}")
def test_every_form_against_scipy(tmp_path, form):
    """Each orientation written down from scipy's own definition of it."""
    pairs = some_pairs()
    rotations = Rotation.from_matrix(pairs.A[:, :3, :3])
    turn = {
        "wpr-deg": lambda: rotations.as_euler("xyz", degrees=True),
        "wpr-rad": lambda: rotations.as_euler("xyz"),
        "quaternion": lambda: np.roll(rotations.as_quat(), 1, axis=1),
        "vector-deg": lambda: rotations.as_rotvec(degrees=True),
        "vector-rad": rotations.as_rotvec,
        "matrix": lambda: rotations.as_matrix().reshape(-1, 9),
    }[form.turn]()
    numbers = np.hstack([pairs.A[:, :3, 3] / METRES[form.unit], turn])
    path = table(tmp_path, pair_columns("a", form), numbers)
    assert_same(read_side(path, "a").T, pairs.A, form)
    assert_same(
        read_side(table(tmp_path, [n[2:] for n in pair_columns("a", form)], numbers), "b").T,
        pairs.A,
        form,
    )


def table(folder: Path, columns: Sequence[str], numbers: FloatArray, name: str = "one.csv") -> Path:
    """A table as a person would write it."""
    with (folder / name).open("w", newline="") as stream:
        writer = csv.writer(stream)
        if columns:
            writer.writerow(columns)
        writer.writerows([[repr(float(v)) for v in row] for row in numbers])
    return folder / name


def test_order_and_further_columns_do_not_matter(tmp_path):
    pairs = some_pairs()
    path = write_pairs(tmp_path / "p.csv", pairs, PoseForm("m", "quaternion"))
    rows = [line.split(",") for line in path.read_text().splitlines()]
    turned = [",".join(reversed([*row, "seen"])) for row in rows]
    path.write_text("\n".join(turned) + "\n")
    assert_same(read_pairs(path).A, pairs.A, PoseForm("m"))


@pytest.mark.parametrize(("columns", "last"), [("matrix16_mm", True), ("matrix12_mm", False)])
def test_matrices_row_by_row_without_a_header(tmp_path, columns, last):
    pairs = some_pairs()
    scaled = [T * np.where(np.arange(4) == 3, 1e3, 1.0) for T in (pairs.A, pairs.B)]
    for T in scaled:
        T[:, 3, 3] = 1.0
    numbers = np.hstack([T[:, : 4 if last else 3].reshape(len(T), -1) for T in scaled])
    path = table(tmp_path, [], numbers)
    found = read_pairs(path, [f"a_{columns}", f"b_{columns}"])
    np.testing.assert_allclose(found.A, pairs.A, atol=1e-12)
    np.testing.assert_allclose(found.B, pairs.B, atol=1e-12)


def test_two_files_of_different_forms_without_headers(tmp_path):
    pairs = some_pairs()
    a, b = PoseForm("m", "quaternion"), PoseForm("mm", "wpr-deg")
    paths = [
        table(tmp_path, [], form.numbers(T), name)
        for form, T, name in ((a, pairs.A, "A.csv"), (b, pairs.B, "B.csv"))
    ]
    columns = [*pair_columns("a", a), *pair_columns("b", b)]
    found = PairSource(a=paths[0], b=paths[1], columns=columns).read()
    assert_same(found.A, pairs.A, a)
    assert_same(found.B, pairs.B, b)
    assert found.names == pairs.names


def test_a_line_of_comment_and_a_column_to_pass_over(tmp_path):
    pairs = some_pairs()
    numbers = np.hstack([np.arange(8.0)[:, None], PoseForm("m", "vector-rad").numbers(pairs.A)])
    path = table(tmp_path, [], np.hstack([numbers, numbers[:, :1]]))
    path.write_text("# index, tvec, rvec, index\n" + path.read_text())
    found = read_side(path, "a", ["-", "x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad", "-"])
    assert_same(found.T, pairs.A, PoseForm("m"))
    assert found.place.lines[0] == 2


def test_names_that_are_expanded():
    assert expanded(["a_matrix12_m"])[:5] == ["a_r11", "a_r12", "a_r13", "a_x_m", "a_r21"]
    assert expanded(["b_matrix16_mm"])[-4:] == ["b_r41", "b_r42", "b_r43", "b_r44"]
    assert expanded(["qw", "pose"]) == ["qw", "pose"]
    assert len(set(expanded(["-", "-", "a_-"]))) == 3


def changed(path: Path, row: int, column: str, value: Callable[[str], str] | str) -> Path:
    """A table with one cell changed; row 1 is the first below the header."""
    lines = [line.split(",") for line in path.read_text().splitlines()]
    k = lines[0].index(column)
    lines[row][k] = value if isinstance(value, str) else value(lines[row][k])
    path.write_text("\n".join(",".join(line) for line in lines) + "\n")
    return path


def refused(path: Path, *words: str, **keys: object) -> FileFormatError:
    with pytest.raises(FileFormatError) as caught:
        read_pairs(path, **keys)  # type: ignore[arg-type]
    assert all(word in str(caught.value) for word in words), caught.value
    assert caught.value.path == path
    return caught.value


QUATERNION, MATRIX = PoseForm("m", "quaternion"), PoseForm("mm", "matrix")


def test_quaternion_of_another_norm(tmp_path):
    path = write_pairs(tmp_path / "p.csv", some_pairs(), QUATERNION)
    changed(path, 3, "a_qx", lambda text: str(float(text) + 0.5))
    error = refused(path, "line 4, column a_qw to a_qz: the quaternion has the norm", "not 1")
    assert error.row == 4
    for name in ("a_qw", "a_qx", "a_qy", "a_qz"):
        changed(path, 3, name, "0")
    refused(path, "line 4", "norm 0, not 1")
    changed(path, 3, "a_qx", "1e10")
    refused(path, "line 4", "norm 1e+10, not 1")


def test_quaternions_of_three_decimals_are_taken_with_a_note(tmp_path):
    pairs = some_pairs(50)
    path = write_pairs(tmp_path / "p.csv", pairs, QUATERNION)
    lines = [line.split(",") for line in path.read_text().splitlines()]
    cells = slice(lines[0].index("a_qw"), lines[0].index("a_qz") + 1)
    for line in lines[1:]:
        line[cells] = [f"{float(text):.3f}" for text in line[cells]]
    path.write_text("\n".join(",".join(line) for line in lines) + "\n")
    found = read_pairs(path)
    turn = np.swapaxes(found.A[:, :3, :3], -1, -2) @ pairs.A[:, :3, :3]
    assert np.linalg.norm(rotation_log(turn), axis=-1).max() < 2e-3  # 2 |dq|, |dq| <= 1e-3
    np.testing.assert_allclose(
        found.A[:, :3, :3] @ np.swapaxes(found.A[:, :3, :3], -1, -2),
        np.tile(np.eye(3), (50, 1, 1)),
        atol=1e-12,
    )
    (note,) = found.notes
    assert "rotations are rounded" in note
    assert "a_qw" in note


@pytest.mark.parametrize(("decimals", "taken"), [(6, True), (4, True), (3, False)])
def test_matrices_of_few_decimals(tmp_path, decimals, taken):
    pairs = some_pairs(50)
    path = write_pairs(tmp_path / "p.csv", pairs, MATRIX)
    lines = [line.split(",") for line in path.read_text().splitlines()]
    cells = slice(lines[0].index("a_r11"), lines[0].index("a_r33") + 1)
    for line in lines[1:]:
        line[cells] = [f"{float(text):.{decimals}f}" for text in line[cells]]
    path.write_text("\n".join(",".join(line) for line in lines) + "\n")
    if not taken:
        refused(path, "column a_r11 to a_r33: the rotation is not orthonormal", "six decimals")
        return
    found = read_pairs(path)
    assert len(found.notes) == (decimals < 6)
    turn = np.swapaxes(found.A[:, :3, :3], -1, -2) @ pairs.A[:, :3, :3]
    assert np.linalg.norm(rotation_log(turn), axis=-1).max() < 10.0**-decimals


def test_left_handed_matrix(tmp_path):
    path = write_pairs(tmp_path / "p.csv", some_pairs(), PoseForm(), MATRIX)
    for name in ("b_r13", "b_r23", "b_r33"):
        for row in (5, 7):
            changed(path, row, name, lambda text: str(-float(text)))
    refused(path, "line 6, column b_r11 to b_r33", "left-handed (determinant -1), and so on in 1")


def test_scaled_matrix(tmp_path):
    path = write_pairs(tmp_path / "p.csv", some_pairs(), MATRIX)
    for name in pair_columns("a", MATRIX)[3:]:
        changed(path, 2, name, lambda text: str(1000.0 * float(text)))
    refused(path, "line 3", "the rotation is scaled by 1000", "divide it")


def test_transposed_matrix(tmp_path):
    pairs = some_pairs()
    numbers = np.swapaxes(pairs.A, -1, -2).reshape(-1, 16)
    path = table(tmp_path, [], numbers)
    with pytest.raises(FileFormatError, match=r"line 1.*not 0 0 0 1.*transposed: give it row by"):
        read_side(path, "a", ["matrix16_m"])
    numbers[:, 15] = 2.0
    with pytest.raises(FileFormatError, match=r"line 1.*not 0 0 0 1.*is this a 4x4 matrix"):
        read_side(table(tmp_path, [], numbers), "a", ["matrix16_m"])


@pytest.mark.parametrize("turn", ["wpr", "vector"])
def test_degrees_that_are_radians_and_the_other_way_round(tmp_path, turn):
    pairs = some_pairs()
    first = {"wpr": "a_w", "vector": "a_rx"}[turn]
    for unit, looks in (("deg", "radians"), ("rad", "degrees")):
        other = "rad" if unit == "deg" else "deg"
        path = write_pairs(tmp_path / "p.csv", pairs, PoseForm("mm", f"{turn}-{other}"))
        path.write_text(
            path.read_text()
            .replace(f"_{other}", f"_{unit}")
            .replace("b_w_rad", "b_w_deg")
            .replace("b_p_rad", "b_p_deg")
            .replace("b_r_rad", "b_r_deg")
        )
        refused(
            path,
            f"column {first}_{unit} to",
            f"look like {looks}",
            f"{first}_{other}",
            "`trust_units`",
        )
        assert read_pairs(path, trust_units=True).names == pairs.names


def test_metres_that_are_millimetres_and_the_other_way_round(tmp_path):
    for unit, words in (
        ("mm", ("is longer than", "if these are m, call the columns a_x_m, a_y_m, a_z_m")),
        ("m", ("m long", "if these are mm, call the columns a_x_mm, a_y_mm, a_z_mm")),
    ):
        other = "m" if unit == "mm" else "mm"
        path = write_pairs(tmp_path / "p.csv", some_pairs(), PoseForm(other))
        text = path.read_text()
        for axis in "xyz":
            text = text.replace(f"a_{axis}_{other},", f"a_{axis}_{unit},")
        path.write_text(text)
        refused(path, f"column a_x_{unit} to a_z_{unit}", *words, "`trust_units`")
        read_pairs(path, trust_units=True)


HEADERS = {
    "no unit": ("a_x,a_y,a_z,a_k1,a_k2,a_k3,a_k4", "say the unit: a_x_mm"),
    "no orientation": ("a_x_m,a_y_m,a_z_m,qw,qx,qy,qz", "there is no orientation", "a_qw"),
    "no scalar": ("a_x_m,a_y_m,a_z_m,a_qx,a_qy,a_qz,q", "there is no column a_qw"),
    "one of another unit": ("a_x_m,a_y_mm,a_z_m,a_qw,a_qx,a_qy,a_qz", "column a_y_mm: is in anoth"),
    "two positions": (
        "a_x_m,a_y_m,a_z_m,a_qw,a_qx,a_qy,a_qz,a_x_mm,a_y_mm,a_z_mm",
        "gives the position a second time, after a_x_mm",
    ),
    "two orientations": (
        "a_x_m,a_y_m,a_z_m,a_qw,a_qx,a_qy,a_qz,a_w_deg,a_p_deg,a_r_deg",
        "gives the orientation a second time",
    ),
    "half a last row": (
        "a_x_m,a_y_m,a_z_m,a_r11,a_r12,a_r13,a_r21,a_r22,a_r23,a_r31,a_r32,a_r33,a_r41",
        "there is no column a_r42",
    ),
    "numbers": ("1,2,3,1.5,1e3,-1,7", "numbers in place of the names", "`columns`"),
}


@pytest.mark.parametrize("case", HEADERS.values(), ids=HEADERS)
def test_headers(tmp_path, case):
    header, *words = case
    count = len(header.split(","))
    path = tmp_path / "p.csv"
    path.write_text("\n".join([header, *[",".join(["1"] * count)] * 3]) + "\n")
    assert refused(path, *words).row == 1


@pytest.mark.parametrize("form", FORMS, ids=lambda form: f"{form.turn}, {form.unit}")
@pytest.mark.parametrize("spell", [str.upper, str.title])
def test_capitals_in_the_header_do_not_matter(tmp_path, form, spell):
    pairs = some_pairs()
    path = write_pairs(tmp_path / "p.csv", pairs, form, form)
    header, *lines = path.read_text().splitlines()
    path.write_text("\n".join([f"{spell(header)},note,Note", *[f"{x},1,2" for x in lines]]) + "\n")
    found = read_pairs(path)
    assert_same(found.A, pairs.A, form)
    assert_same(found.B, pairs.B, form)
    assert found.names == pairs.names
    path.write_text("\n".join([f"{header},A_{form.turn_columns[0].upper()}", *lines]) + "\n")
    path.write_text(path.read_text().replace("\nP", "\n1,P"))
    refused(path, f"column a_{form.turn_columns[0]}: appears twice, capitals apart")


def test_capitals_in_names_given_beside_a_file(tmp_path):
    pairs = some_pairs()
    numbers = pairs.A.reshape(-1, 16)
    np.testing.assert_allclose(
        read_side(table(tmp_path, [], numbers), "a", ["A_Matrix16_M"]).T, pairs.A, atol=1e-12
    )
    form = PoseForm("m", "quaternion")
    names = [name.upper() for name in (*form.place_columns, *form.turn_columns)]
    path = table(tmp_path, names, form.numbers(pairs.A))
    with pytest.raises(FileFormatError, match=r"header line of its own"):
        read_side(path, "a", names)


ENDLESS = {
    "metres": (QUATERNION, "b_y_m", "1e11", "column b_x_m to b_z_m: a translation of 1e+11 m"),
    "millimetres": (
        MATRIX,
        "a_z_mm",
        "-1.1e9",
        "column a_x_mm to a_z_mm: a translation of 1.1e+06",
    ),
    "degrees": (PoseForm(), "a_w_deg", "1e11", "column a_w_deg to a_r_deg: an angle of 1e+11 deg"),
    "vector": (PoseForm("m", "vector-rad"), "b_ry_rad", "-1e11", "an angle of 1e+11 rad is none"),
    "quaternion": (QUATERNION, "a_qw", "1e11", "the quaternion has the norm 1e+11"),
    "matrix": (MATRIX, "b_r33", "1e11", "the rotation is not orthonormal"),
    "any": (MATRIX, "b_r33", "1e308", "'1e308' is not a finite number within 1e+12"),
}


@pytest.mark.parametrize("trust", [False, True])
@pytest.mark.parametrize("case", ENDLESS.values(), ids=ENDLESS)
def test_numbers_beyond_any_robot(tmp_path, case, trust):
    form, column, value, words = case
    path = changed(write_pairs(tmp_path / "p.csv", some_pairs(), form, form), 3, column, value)
    refused(path, "line 4, ", words, trust_units=trust)


def test_file_of_endless_numbers_only(tmp_path):
    for form in FORMS:
        path = write_pairs(tmp_path / "p.csv", some_pairs(), form, form)
        header, *lines = path.read_text().splitlines()
        for value in ("1e11", "-1e9"):
            rows = [",".join(["P", *[value] * (len(header.split(",")) - 1)])] * len(lines)
            path.write_text("\n".join([header, *rows]) + "\n")
            refused(path, "line 2, ", "and so on in 7 more", trust_units=True)


def test_what_is_far_but_no_mistake_is_trusted(tmp_path):
    pairs = some_pairs()
    A = pairs.A.copy()
    A[:, :3, 3] += 5e5
    path = write_pairs(tmp_path / "p.csv", Pairs(pairs.names, A, pairs.B), PoseForm("m"))
    refused(path, "m long")
    np.testing.assert_allclose(read_pairs(path, trust_units=True).A, A, rtol=1e-9)


def test_columns_that_do_not_fit(tmp_path):
    form = PoseForm("m", "quaternion")
    path = table(tmp_path, [], form.numbers(some_pairs().A))
    names = ["x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"]
    cases: tuple[tuple[list[str], str], ...] = (
        (names[:-1], "line 1: has 7 cells, 6 are named"),
        ([*names[:-1], "qx"], "column qx: appears twice"),
        ([*names[:-1], "q3"], "there is no column qz"),
    )
    for columns, words in cases:
        with pytest.raises(FileFormatError, match=words):
            read_side(path, "a", columns)
    with_header = table(tmp_path, names, form.numbers(some_pairs().A), "h.csv")
    with pytest.raises(FileFormatError, match=r"line 1: .*header line of its own.*`columns` out"):
        read_side(with_header, "a", names)
    with pytest.raises(InputError, match="`columns` names none of B"):
        read_side(path, "b", [f"a_{name}" for name in names])


def test_sides_that_do_not_match(tmp_path):
    pairs = some_pairs()
    form = PoseForm("m", "quaternion")
    paths = []
    for name, T, count in (("A.csv", pairs.A, 8), ("B.csv", pairs.B, 7)):
        rows = [["pose", *(c[2:] for c in pair_columns("a", form))]]
        rows += [[n, *map(str, v)] for n, v in zip(pairs.names, form.numbers(T), strict=True)]
        paths.append(tmp_path / name)
        paths[-1].write_text("\n".join(",".join(row) for row in rows[: count + 1]) + "\n")
    with pytest.raises(FileFormatError, match=r"B\.csv: has 7 poses, .*A\.csv has 8"):
        PairSource(a=paths[0], b=paths[1]).read()
    paths[0].write_text("\n".join(paths[0].read_text().splitlines()[:8]) + "\n")
    assert PairSource(a=paths[0], b=paths[1]).read().names == pairs.names[:7]
    paths[1].write_text(paths[1].read_text().replace("P03", "P04x"))
    with pytest.raises(FileFormatError, match=r"B\.csv, line 4, column pose: .*'P04x'.*'P03'"):
        PairSource(a=paths[0], b=paths[1]).read()


def test_pairs_that_are_there_twice_count_once(tmp_path):
    pairs = some_pairs()
    path = write_pairs(tmp_path / "p.csv", pairs)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines, lines[3], lines[3]]) + "\n")
    found = PairSource(path).read()
    assert found.names == pairs.names
    (note,) = found.notes
    assert "line 10 as line 4, line 11 as line 4" in note
    assert len(found.places) == len(found.A) == len(found.B) == 8
    # but not where too few are left for the solver to say what is wrong
    path.write_text("\n".join([lines[0], *[lines[1]] * 9]) + "\n")
    assert len(PairSource(path).read().names) == 9


def test_inversion_and_opencv_lead_to_the_same_pairs(tmp_path):
    """From gripper2base and target2cam, as OpenCV users have them, in three ways."""
    pairs = some_pairs()
    gripper2base, target2cam = pairs.A, inverse(pairs.B)
    for a, b, keys in (
        (gripper2base, target2cam, {"invert": "b"}),
        (inverse(gripper2base), target2cam, {"invert": "both"}),
        (target2cam, gripper2base, {"invert": "b", "convention": "opencv"}),
        (target2cam, inverse(gripper2base), {"convention": "opencv"}),
        (inverse(target2cam), inverse(gripper2base), {"invert": "a", "convention": "opencv"}),
    ):
        path = write_pairs(tmp_path / "p.csv", Pairs(pairs.names, a, b))
        found = PairSource(path, **keys).read()  # type: ignore[arg-type]
        np.testing.assert_allclose(found.A, pairs.A, atol=1e-10)
        np.testing.assert_allclose(found.B, pairs.B, atol=1e-10)


MISREAD = {
    "x y z w called w x y z": (
        lambda q: np.roll(q, -1, axis=1),
        ("qw", "qx", "qy", "qz"),
        "are x y z w",
    ),
    "w x y z called x y z w": (lambda q: q, ("qx", "qy", "qz", "qw"), "are w x y z"),
    "moving axes": (
        lambda q: rotation(q).as_euler("XYZ", degrees=True),
        ("w_deg", "p_deg", "r_deg"),
        "xyz-moving (staubli-rxryrz",
    ),
    "a rotation vector called angles": (
        lambda q: rotation(q).as_rotvec(degrees=True),
        ("w_deg", "p_deg", "r_deg"),
        "rotation-vector (ur-rotation-vector",
    ),
    "angles called a rotation vector": (
        lambda q: rotation(q).as_euler("xyz"),
        ("rx_rad", "ry_rad", "rz_rad"),
        "xyz-fixed (fanuc-wpr",
    ),
}


def rotation(q: FloatArray) -> Rotation:
    return Rotation.from_quat(q, scalar_first=True)


@pytest.mark.parametrize("case", MISREAD.values(), ids=MISREAD)
@pytest.mark.parametrize("side", ["a", "b"])
def test_orientations_of_another_convention_are_noticed(tmp_path, case, side):
    turn, columns, words = case
    pairs = some_pairs(20)
    form = PoseForm("mm", "matrix")
    paths = {}
    for letter, T in (("a", pairs.A), ("b", pairs.B)):
        numbers, names = form.numbers(T), [*form.place_columns, *form.turn_columns]
        if letter == side:
            q = Rotation.from_matrix(T[:, :3, :3]).as_quat(scalar_first=True)
            numbers, names = np.hstack([numbers[:, :3], turn(q)]), [*form.place_columns, *columns]
        paths[letter] = table(tmp_path, names, numbers, f"{letter}.csv")
    note = PairSource(a=paths["a"], b=paths["b"]).read().misread
    assert "no X and Z fit A and B as they were read" in note
    assert f"if in {side.upper()} " in note
    assert words in note


def test_rows_out_of_step_are_noticed(tmp_path):
    pairs = some_pairs(20)
    shifted = Pairs(pairs.names, pairs.A, np.roll(pairs.B, 1, axis=0))
    (note,) = PairSource(write_pairs(tmp_path / "p.csv", shifted)).read().notes
    assert "A turns otherwise than B" in note
    few_wrong = pairs.B.copy()
    few_wrong[[0, 10, 19]] = pairs.B[[10, 19, 0]]  # outliers are the solver's business
    assert (
        PairSource(write_pairs(tmp_path / "p.csv", Pairs(pairs.names, pairs.A, few_wrong)))
        .read()
        .notes
        == ()
    )


cells = st.sampled_from(
    [
        "",
        "1",
        "-3.5",
        "nan",
        "90",
        "1e3",
        "1e308",
        "0x1",
        "T1",
        '"',
        "'",
        "#",
        "=1",
        "٣",
        "0",
        "-1e-320",
    ]
)


@FILES_BETWEEN_EXAMPLES
@given(
    form=st.sampled_from(FORMS),
    rows=st.lists(st.lists(cells, min_size=12, max_size=24), min_size=1, max_size=5),
)
def test_random_cells_raise_nothing_but_known_errors(tmp_path, form, rows):
    columns = [*pair_columns("a", form), *pair_columns("b", form)]
    path = tmp_path / "random.csv"
    body = [",".join((row * 2)[: len(columns)]) for row in rows]
    path.write_text("\n".join([",".join(columns), *body]) + "\n", encoding="utf-8")
    for trust_units in (False, True):
        try:
            found = PairSource(path, trust_units=trust_units).read()
        except CalibError:
            continue
        assert np.isfinite(found.A).all()
        assert math.isclose(np.linalg.det(found.A[0, :3, :3]), 1.0, abs_tol=1e-9)


QUATERNIONS = {
    "names": (("quat_x", "quat_y", "quat_z", "quat_w"), False),
    "letters": (("rx", "ry", "rz", "rw"), False),
    "numbers": (("q0", "q1", "q2", "q3"), True),
    "numbers, w last": (("a", "b", "c", "d"), False),
}
"""Names that people have for the numbers of a quaternion, and whether w stands first."""


@pytest.mark.parametrize(("names", "first"), QUATERNIONS.values(), ids=QUATERNIONS)
def test_a_quaternion_under_other_names_is_read_whole(tmp_path, names, first):
    pairs = some_pairs(20)
    paths = []
    for letter, T in (("a", pairs.A), ("b", pairs.B)):
        q = Rotation.from_matrix(T[:, :3, :3]).as_quat(scalar_first=first)
        numbers = np.hstack([1e3 * T[:, :3, 3], q])
        columns = ["x_mm", "y_mm", "z_mm", *names]
        paths.append(table(tmp_path, columns, numbers, f"{letter}.csv"))
    found = PairSource(a=paths[0], b=paths[1]).read()
    np.testing.assert_allclose(found.A, pairs.A, atol=1e-7)
    np.testing.assert_allclose(found.B, pairs.B, atol=1e-7)
    assert not any("unit of angles" in note for note in found.notes)
    assert len(set(found.notes)) == len(found.notes)


def test_w_x_y_z_beside_a_position_are_asked_for_by_name(tmp_path):
    rows = np.tile([100.0, 200.0, 300.0, 1.0, 0.0, 0.0, 0.0], (4, 1))
    path = table(tmp_path, ["x_mm", "y_mm", "z_mm", "w", "x", "y", "z"], rows, "a.csv")
    with pytest.raises(FileFormatError) as caught:
        read_side(path, "a")
    assert "if w x y z are a quaternion, call the columns qw qx qy qz" in caught.value.hint
