"""The command of networks: from tables and from files of one camera and one target each."""

import json

import numpy as np
import pytest

from posedesign.files import origin_of
from posedesign.files.csv_tables import read_table, write_table
from posedesign.hand_eye.pairs import Pairs, write_pairs
from tests.cli.conftest import rows_of
from tests.unit.robot_world.test_in_part import problem
from tests.unit.robot_world.test_network import scene_of


@pytest.fixture(scope="module")
def scene():
    return scene_of(31)


def written(scene, path, order=None):
    """A table of the pairs with the names of their frames."""
    order = np.arange(len(scene.A)) if order is None else order
    names = tuple(f"P{i + 1:03d}" for i in order)
    table = read_table(write_pairs(path, Pairs(names, scene.A[order], scene.B[order])))
    named = {"on_flange": scene.on_flange, "around": scene.around, "arm": scene.arms}
    rows = [
        {**row.cells, **{column: given[i] for column, given in named.items()}}
        for i, row in zip(order, table.rows, strict=True)
    ]
    return write_table(path, [*table.columns, *named], rows)


def test_a_table_of_pairs_gives_every_frame(cli, scene, tmp_path):
    rng = np.random.default_rng(1)
    path = written(scene, tmp_path / "seen.csv", rng.permutation(len(scene.A)))
    said = cli("network", path, "--out", tmp_path)
    assert said.code == 0, said.err
    assert said.out.startswith("solved: 3 on flanges, 3 around, 2 arms, from ")
    rows = {row["frame"]: row for row in rows_of(tmp_path / "network.csv")}
    assert set(rows) == set(scene.truth)
    for name, T in scene.truth.items():
        place = np.array([float(rows[name][axis]) for axis in ("x_mm", "y_mm", "z_mm")])
        off = np.linalg.norm(place - 1e3 * T[:3, 3])
        assert off < 4 * float(rows[name]["sigma_mm"])
    parents = {name: row["parent"] for name, row in rows.items()}
    assert parents["camera 1"] == "flange"
    assert parents["tag 0"] == parents["arm 1"] == "base of arm 0"
    assert len(rows_of(tmp_path / "network_pairs.csv")) == len(scene.A)
    assert (tmp_path / "network.png").is_file()


def test_files_of_one_edge_each_give_the_same(cli, scene, tmp_path):
    whole = written(scene, tmp_path / "seen.csv")
    words = []
    for edge in sorted(set(zip(scene.on_flange, scene.around, scene.arms, strict=True))):
        own = [
            i
            for i, names in enumerate(zip(scene.on_flange, scene.around, scene.arms, strict=True))
            if names == edge
        ]
        path = tmp_path / f"{'_'.join(edge).replace(' ', '')}.csv"
        write_pairs(path, Pairs(tuple(f"P{i}" for i in own), scene.A[own], scene.B[own]))
        words += ["--edge", f"{','.join(edge)}={path}"]
    answers = [
        json.loads(cli("network", *some, "--out", tmp_path / str(k), "--json").out)
        for k, some in enumerate(([whole], words))
    ]
    for name, T in answers[0]["T"].items():
        np.testing.assert_allclose(answers[1]["T"][name], T, atol=1e-6)
    count = 6 * len(answers[0]["T"])
    assert np.shape(answers[0]["covariance"]) == (count, count)
    assert len(answers[0]["covariance_of"]) == count


def test_what_was_moved_is_named_and_not_trusted(cli, scene, tmp_path):
    own = (np.array(scene.on_flange) == "camera 0") & (np.array(scene.around) == "tag 0")
    B = scene.B.copy()
    B[own, :3, 3] += [0.004, 0, 0]
    moved = written(type(scene)(scene.A, B, *scene.pairs[2:], scene.truth), tmp_path / "m.csv")
    said = cli("network", moved, "--out", tmp_path / "out")
    assert "seems to stand elsewhere in its pairs with camera 0" in said.err.replace("\n  ", " ")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "give one table"),
        (("seen.csv", "--edge", "a,b=c.csv"), "give one table"),
        (("--edge", "a=b.csv"), "camera_1,tag_7=pairs.csv"),
        (("plain.csv",), "has no column on_flange"),
        (("empty.csv",), "the name is missing"),
        (("seen.csv", "--noise-mm", "1"), "give both --noise-deg and --noise-mm"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(refuse, scene, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    written(scene, tmp_path / "seen.csv")
    write_pairs(tmp_path / "plain.csv", Pairs(tuple("abcd"), scene.A[:4], scene.B[:4]))
    table = read_table(tmp_path / "seen.csv")
    rows = [dict(row.cells) for row in table.rows]
    rows[3]["around"] = ""
    write_table(tmp_path / "empty.csv", table.columns, rows)
    refuse("network", *words).says(said)


def test_an_arm_of_four_axes_gets_what_its_motion_tells(cli, tmp_path):
    """And all of it where a height is known from elsewhere."""
    (A, B, *_), _, Z, _ = problem("scara", 4)
    path = write_pairs(tmp_path / "pairs.csv", Pairs(tuple(f"P{i}" for i in range(len(A))), A, B))
    said = cli("robot-world", path, "--out", tmp_path)
    assert said.code == 1
    assert "solved in part: camera and target from " in said.out
    told = " ".join(said.err.split())
    assert "not told: the place of camera along z of its flange, and as much the place of" in told
    assert "--prior" in told
    prior = tmp_path / "prior.toml"
    height = 1e3 * Z[2, 3]
    prior.write_text(f"[target]\nposition_mm = [0.0, 0.0, {height}]\nsigma_mm = [inf, inf, 0.5]\n")
    for command in (("robot-world", path), ("network", "--edge", f"camera,target={path}")):
        said = cli(*command, "--prior", prior, "--out", tmp_path / command[0], "--json")
        assert said.code == 0, said.err
        place = np.array(json.loads(said.out)["T"]["target"])[:3, 3]
        np.testing.assert_allclose(place, Z[:3, 3], atol=3e-3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[target]\nposition_mm = [0.0, 0.0, 1.0]\n", "lacks one of position_mm and sigma_mm"),
        ("[target]\nheight = 3.0\n", "is unknown"),
        ("[target]\nposition_mm = [0.0, 0.0]\nsigma_mm = 1.0\n", "target.position_mm"),
        ("[target]\nposition_mm = [0.0, 0.0, 1.0]\nsigma_mm = 0.0\n", "target.sigma_mm"),
        ("[target]\nz_axis = [0.0, 0.0, 0.0]\nsigma_deg = 1.0\n", "has no length"),
        ("[lens]\nz_axis = [0.0, 0.0, 1.0]\nsigma_deg = 1.0\n", "no frame lens"),
        ("target = 3\n", "stands in no section"),
        ("", "says nothing of any frame"),
        ("[target\n", "is no valid TOML"),
        ("[target]\n", "says nothing"),
    ],
)
def test_priors_that_cannot_be_are_refused_in_one_line(refuse, tmp_path, text, said):
    (A, B, *_), _, _, _ = problem("scara", 4)
    path = write_pairs(tmp_path / "pairs.csv", Pairs(tuple(f"P{i}" for i in range(len(A))), A, B))
    prior = tmp_path / "prior.toml"
    prior.write_text(text)
    refuse("robot-world", path, "--prior", prior, "--out", tmp_path).says(said)


def test_rehearsed_pairs_are_said_before_any_answer(done, glance, demo_work, tmp_path):
    """A table that says that it is simulated is so by every command, and so is what it gives."""
    done("simulate", demo_work / "cell.toml", demo_work / "poses.csv", "--out", tmp_path / "sim")
    pairs = tmp_path / "sim" / "pairs.csv"
    said = glance("network", "--edge", f"camera,target={pairs}", "--out", tmp_path)
    assert said.code == 0, said.err
    assert said.out.startswith("SIMULATED, not for a robot")
    assert origin_of(tmp_path / "network.csv").kind == "simulated"


@pytest.mark.parametrize("column", ["pose", "on_flange", "around", "arm"])
def test_names_that_would_steer_a_terminal_are_refused(refuse, scene, tmp_path, column):
    path = written(scene, tmp_path / "seen.csv")
    table = read_table(path)
    rows = [{**row.cells, column: row.cells[column] + "\x1b[31m"} for row in table.rows]
    write_table(path, table.columns, rows)
    line = refuse("network", path, "--out", tmp_path)
    line.says(f"column {column}: ", "has a character that cannot be shown")


def test_an_edge_is_named_with_what_can_be_shown(refuse, tmp_path):
    line = refuse("network", "--edge", "cam\x1b[31m,tag=pairs.csv", "--out", tmp_path)
    line.says("is not a name on the flange, a name around, and files")
