"""Files say where they come from, and are replaced by their own command only."""

import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from calib.errors import OutputError
from posedesign.files import (
    Claim,
    Results,
    origin_of,
    rehearsed,
    write_bytes_atomic,
    write_json_atomic,
)
from posedesign.files.csv_tables import read_table, write_table
from posedesign.files.origin import Origin, is_simulated, read_whole
from posedesign.report.pdf import Page, as_pdf

POSES = ("poses.csv", "poses")


def png() -> bytes:
    data = io.BytesIO()
    Image.fromarray(np.zeros((2, 3), np.uint8)).save(data, format="png")
    return data.getvalue()


CONTENTS = {
    "a.csv": b"a,b\n1,2\n",
    "a.toml": b"[a]\nb = 1\n",
    "a.json": b'{\n  "a": 1\n}\n',
    "a.urdf": b'<?xml version="1.0"?>\n<robot name="a"><link name="b"/></robot>\n',
    "a.png": png(),
    "a.pdf": as_pdf([Page(100.0, 100.0)], "a"),
}


def claim(path: Path, kind: str = "computed", **more: object) -> Claim:
    origin = Origin(kind, "trials", "try", (("in.csv", "0123abcd"),), "2026-05-31")  # type: ignore[arg-type]
    return Claim(path, origin, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", CONTENTS)
def test_what_is_written_is_read_back(tmp_path, name):
    path = tmp_path / name
    own = claim(path)
    write_bytes_atomic(own, CONTENTS[name])
    assert read_whole(path) == (own.origin, True)
    assert str(own.origin) in path.read_bytes().decode("latin-1")
    data = path.read_bytes()
    for place in {len(data) - 2, data.index(b"try"), data.index(b"digest") + 9}:
        other = data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]
        path.write_bytes(other)
        assert read_whole(path)[1] is False


def test_other_programs_read_the_files(tmp_path):
    for name, data in CONTENTS.items():
        write_bytes_atomic(claim(tmp_path / name), data)
    assert read_table(tmp_path / "a.csv").columns == ["a", "b"]
    said = json.loads((tmp_path / "a.json").read_text())
    assert said["a"] == 1
    assert said["origin"]["kind"] == "computed"
    assert said["origin"]["inputs"] == {"in.csv": "0123abcd"}
    picture = Image.open(tmp_path / "a.png")
    picture.verify()
    assert "trials by try" in picture.info["Comment"]
    data = (tmp_path / "a.pdf").read_bytes()
    objects = re.findall(rb"(\d{10}) 00000 n ", data)
    assert all(data[int(at) :].startswith(b"%d 0 obj" % k) for k, at in enumerate(objects, 1))
    assert data[int(re.search(rb"startxref\n(\d+)", data)[1]) :].startswith(b"xref\n")
    assert (tmp_path / "a.urdf").read_text().splitlines()[1].startswith("<!-- origin: ")


def test_the_day_is_that_of_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    assert Origin.of("planned", "poses", "plan").day == "1970-01-02"


def test_what_comes_from_simulated_is_simulated(tmp_path):
    source = tmp_path / "in put,1.csv"
    write_table(claim(source, "simulated"), ["a"], [{"a": 1}])
    assert is_simulated(source)
    made = Origin.of("computed", "answer", "solve", [source])
    assert made.kind == "simulated"
    assert made.inputs[0][0] == "in_put_1.csv"
    assert Origin.of("measured", "touch-ups", "import", [source]).kind == "measured"
    assert rehearsed([None, source]).startswith("SIMULATED, not for a robot: from ")
    # a spreadsheet that saves it fills the line up with commas; the data stay simulated
    text = source.read_text().replace("\n", ",,\n", 1).replace("1", "2")
    source.write_bytes(("\ufeff" + text).encode())
    assert is_simulated(source)
    assert read_whole(source)[1] is False


@pytest.mark.parametrize(
    ("there", "reason"),
    [
        (b"a\n1\n", "does not say where it is from"),
        (b"", "does not say where it is from"),
        ("edited", "was changed since it was written"),
        ("other kind", "holds measured trials by try"),
        ("other command", "by else"),
    ],
)
def test_what_is_not_ones_own_is_refused(tmp_path, there, reason):
    path = tmp_path / "touch.csv"
    if isinstance(there, bytes):
        path.write_bytes(there)
    elif there == "edited":
        write_table(claim(path), ["a"], [{"a": 1}])
        path.write_bytes(path.read_bytes() + b"2\n")
    elif there == "other kind":
        write_table(claim(path, "measured"), ["a"], [{"a": 1}])
    else:
        else_ = Origin("computed", "trials", "else", (), "2026-05-31")
        write_table(Claim(path, else_), ["a"], [{"a": 1}])
    before = path.read_bytes()
    with pytest.raises(OutputError, match=reason) as caught:
        write_table(claim(path), ["a"], [{"a": 3}])
    assert "\n" not in str(caught.value)
    assert path.read_bytes() == before
    said: list[str] = []
    write_table(claim(path, overwrite=True, say=said.append), ["a"], [{"a": 3}])
    assert (tmp_path / "touch.csv.1").read_bytes() == before
    assert said == [f"{path}: what was there is kept as touch.csv.1"]
    write_table(claim(path), ["a"], [{"a": 4}])  # one's own
    assert sorted(p.name for p in tmp_path.iterdir()) == ["touch.csv", "touch.csv.1"]


def test_names_of_what_is_kept_are_free(tmp_path):
    path = tmp_path / "a.csv"
    for text in ("first", "second"):
        path.write_text(text)
        write_table(claim(path, overwrite=True), ["a"], [{"a": 3}])
    assert (tmp_path / "a.csv.1").read_text() == "first"
    assert (tmp_path / "a.csv.2").read_text() == "second"


@pytest.mark.parametrize("measured", ["by hand", "imported"])
def test_a_rehearsal_never_replaces_measurements(tmp_path, measured):
    path = tmp_path / "touchups.csv"
    path.write_text("target\n")
    if measured == "imported":
        path.unlink()
        write_table(claim(path, "measured"), ["a"], [{"a": 1}])
    with pytest.raises(OutputError):
        write_table(claim(path, "simulated", overwrite=True), ["a"], [{"a": 3}])


def test_other_measurements_are_not_replaced(tmp_path):
    path = tmp_path / "touchups.csv"
    write_table(claim(path, "measured"), ["a"], [{"a": 1}])
    write_table(claim(path, "measured"), ["a"], [{"a": 2}])
    monday = Origin("measured", "trials", "try", (("in.csv", "ffffffff"),), "2026-05-31")
    with pytest.raises(OutputError, match="other measurements"):
        write_table(Claim(path, monday), ["a"], [{"a": 3}])


def test_all_are_claimed_or_none(tmp_path):
    (tmp_path / "two.json").write_text("{}")
    with pytest.raises(OutputError, match=r"two\.json"):
        Results(tmp_path, "try").claim("computed", ("one.csv", "one"), ("two.json", "two"))
    out = tmp_path / "new" / "folder"
    (one,) = Results(out, "try").claim("computed", ("one.json", "one"))
    assert not out.exists()
    write_json_atomic(one, {"a": [1.5]})
    assert json.loads((out / "one.json").read_text())["a"] == [1.5]


def test_what_came_in_the_meantime_is_not_lost(tmp_path):
    (one,) = Results(tmp_path, "try").claim("computed", POSES)
    (tmp_path / "poses.csv").write_text("mine")
    with pytest.raises(OutputError, match="does not say where it is from"):
        write_table(one, ["a"], [{"a": 3}])


def test_a_file_that_names_no_origin(tmp_path):
    path = tmp_path / "a.csv"
    for text in ("# origin: unheard poses by me on 2026-01-01 digest 0123456789abcdef\n", "\0" * 9):
        path.write_text(text)
        assert origin_of(path) is None
    assert origin_of(tmp_path) is None
