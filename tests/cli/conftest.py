"""The command line as a person types it, in this process, with small files to type it on."""

import csv
import io
import json
import pickle
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from calib.identification import Workplace
from posedesign import identification, workflow
from posedesign.candidates import workplaces
from posedesign.cell import Cell, cell_template
from posedesign.cli.main import run
from posedesign.files import Claim, Results, write_bytes_atomic
from posedesign.files.measurements import MeasurementTable
from posedesign.planning.optimal import outlook
from posedesign.report.answer import WIDTH

WORK_FILES = ("cell.toml", "poses.csv", "touchups.csv", "pairs.csv")


@dataclass(frozen=True)
class Said:
    """What a command answered."""

    code: int
    out: str
    err: str


class Refusal(str):
    """The one line that a refused command says."""

    def says(self, *words: str) -> None:
        """Check that all the words are in it."""
        missing = [word for word in words if word not in self]
        assert not missing, f"{missing} not in: {self}"


Cli = Callable[..., Said]
Refuse = Callable[..., Refusal]


ANSWERING = frozenset(
    ("plan", "next", "check", "score", "program", "import", "identify", "calibrate", "correct")
) | {"predict", "robot-world", "demo", "robots", "prove", "recheck"}
"""Commands that say at a glance what they found, and all of it where that is asked for."""


@cache
def _rendering() -> tuple[tuple[Any, str, Callable[..., Any]], ...]:
    """What draws figures of results, lays out those of pages and renders them, as they are."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    from posedesign import workflow
    from posedesign.report import figures, page

    named = (
        (workflow, "draw"),
        (figures, "draw"),
        (page, "figure_of_plan"),
        (figures, "as_svg"),
        (ConstrainedLayoutEngine, "execute"),
        (Figure, "savefig"),
        (FigureCanvasAgg, "print_png"),
        (FigureCanvasSVG, "print_svg"),
    )
    return tuple((owner, name, getattr(owner, name)) for owner, name in named)


@cache
def empty_picture(kind: str) -> bytes:
    """A small figure with nothing in it, as PNG, SVG or PDF."""
    from matplotlib.figure import Figure

    data = io.BytesIO()
    with rendering():
        Figure(figsize=(0.5, 0.5)).savefig(data, format=kind)
    return data.getvalue()


@contextmanager
def empty_pictures() -> Iterator[None]:
    """Empty figures are written, and those beside results are not made: a fifth of the time."""

    def write(to: Any, kind: str) -> None:
        empty = empty_picture(kind)
        if not hasattr(to, "write"):
            to.write_bytes(empty)
        else:
            to.write(empty.decode() if isinstance(to, io.StringIO) else empty)

    def save_empty(figure: object, to: Any, **kwargs: Any) -> None:
        write(to, kwargs.get("format", "png" if hasattr(to, "write") else to.suffix[1:]))

    def draw_empty(out: Results, files: Sequence[Claim], figure: object) -> None:
        for file, kind in zip(files, ("png", "svg"), strict=True):
            write_bytes_atomic(file, empty_picture(kind))

    instead: tuple[Callable[..., None], ...] = (
        draw_empty,
        draw_empty,
        lambda *args: None,
        lambda figure: empty_picture("svg").decode(),
        lambda engine, figure: None,
        save_empty,
        lambda canvas, to, **kwargs: write(to, "png"),
        lambda canvas, to, **kwargs: write(to, "svg"),
    )
    with pytest.MonkeyPatch.context() as patch:
        for (owner, name, _), function in zip(_rendering(), instead, strict=True):
            patch.setattr(owner, name, function)
        yield


@pytest.fixture(scope="module", autouse=True)
def _pictures() -> Iterator[None]:
    """Tests and fixtures have their pictures empty where they do not ask for ``rendered``."""
    with empty_pictures():
        yield


_FOUND: dict[object, Any] = {}
"""What was planned and identified for a cell that is described once."""

_FILE = re.compile(r"(urdf|mesh|srdf)='")


def _once(owner: Any, name: str, key: Callable[..., object]) -> Callable[..., Any]:
    """A function of a cell whose results are found once, by its description and a key.

    The files of others that a cell names may change between two commands: those are not kept.
    """
    find = getattr(owner, name)

    def found(cell: Cell, *args: Any, **kwargs: Any) -> Any:
        described = repr(cell.config)
        if _FILE.search(described):
            return find(cell, *args, **kwargs)
        of = name, described, key(*args, **kwargs)
        if of not in _FOUND:
            _FOUND[of] = find(cell, *args, **kwargs)
        return _FOUND[of]

    return found


def _rows(table: MeasurementTable, *_: object) -> bytes:
    """The content of a table, wherever it lies."""
    return pickle.dumps(replace(table, path=Path()))


def _of_choice(
    count: int, at: Workplace | None = None, passes: int = outlook.PASSES
) -> tuple[int, bytes, int]:
    return count, b"" if at is None else at.postures.tobytes(), passes


_WHOLE = (
    (workplaces, "FEW_CANDIDATES", workplaces.FEW_CANDIDATES),
    (outlook, "_chosen_tcp_m", outlook._chosen_tcp_m),
)
_plan = _once(workflow, "plan", lambda progress=None: "")
_identify = _once(identification, "identify_models", _rows)
_KEPT: tuple[tuple[Any, str, Any], ...] = (
    (workplaces, "FEW_CANDIDATES", 60),
    (outlook, "_chosen_tcp_m", _once(outlook, "_chosen_tcp_m", _of_choice)),
    (workflow, "plan", _plan),
    (
        identification,
        "identify_models",
        lambda cell, table: replace(_identify(cell, table), table=table),
    ),
)


@contextmanager
def found_once() -> Iterator[None]:
    """Plans and identifications of the same cell and rows are made once.

    What other poses would be worth, half of most plans, is found in small pools.
    """
    with pytest.MonkeyPatch.context() as patch:
        for owner, name, instead in _KEPT:
            patch.setattr(owner, name, instead)
        yield


@pytest.fixture(scope="module", autouse=True)
def _found_once() -> Iterator[None]:
    """Tests have it so, and whole pools where they ask for ``whole_outlook``.

    By module: a folder without ``__init__.py`` is no package to pytest, so that a fixture of
    that scope would stay on for the tests of other folders.
    """
    with found_once():
        yield


@pytest.fixture
def whole_outlook() -> Iterator[None]:
    """What other poses would be worth, found in the pools that users have."""
    with pytest.MonkeyPatch.context() as patch:
        for owner, name, whole in _WHOLE:
            patch.setattr(owner, name, whole)
        yield


@contextmanager
def rendering() -> Iterator[None]:
    """What is in figures is rendered all the same."""
    with pytest.MonkeyPatch.context() as patch:
        for owner, name, function in _rendering():
            patch.setattr(owner, name, function)
        yield


@pytest.fixture
def rendered() -> Iterator[None]:
    """What is in figures is rendered."""
    with rendering():
        yield


@pytest.fixture
def cli(glance) -> Cli:
    """Run a command line in this process, and have it say all that it has to say."""

    def typed(*words: object) -> Said:
        at = 2 if words[:2] == ("study", "accuracy") else 1
        verbose = at == 2 or (words and words[0] in ANSWERING)
        return glance(*words[:at], *(("--verbose",) if verbose else ()), *words[at:])

    return typed


@pytest.fixture
def done(cli) -> Cli:
    """Run a command line that has to do what it is asked for, and return what it says."""

    def typed(*words: object) -> Said:
        said = cli(*words)
        assert said.code == 0, said
        return said

    return typed


@pytest.fixture
def glance(capsys) -> Cli:
    """Run a command line in this process as it is typed; lines that were folded are joined."""

    def typed(*words: object) -> Said:
        capsys.readouterr()
        code = run([str(word) for word in words])
        captured = capsys.readouterr()
        return Said(code, unfolded(captured.out), unfolded(captured.err))

    return typed


def unfolded(text: str) -> str:
    """What was printed, with the lines joined that were folded to fit a terminal."""
    lines: list[str] = []
    last = 0
    for line in text.split("\n"):
        first = line.split()[0] if line.strip() else ""
        if lines and line.startswith("  ") and last + 1 + len(first) > WIDTH:
            lines[-1] += line[1:]
        else:
            lines.append(line)
        last = len(line)
    return "\n".join(lines)


@pytest.fixture
def refuse(cli, tmp_path) -> Refuse:
    """Run a command line that has to be refused, and return the one line that says why.

    Before it stands at most where the target is, and what is noted and not checked of the cell.
    """

    def refused(*words: object) -> Refusal:
        before = contents(tmp_path)
        said = cli(*words)
        assert said.code == 2, said
        assert said.out == ""
        *before_it, line = said.err.splitlines(keepends=True)
        assert re.fullmatch(r"error: [^\n]+\n", line), said.err
        assert "Traceback" not in said.err
        assert len(line) < 1000
        known = ("target: ", "warning: the target is ", "note: ", "not checked: ")
        assert all(text.startswith(known) for text in before_it), said.err
        assert contents(tmp_path) == before
        return Refusal(line)

    return refused


def refusals(text: str) -> list[Any]:
    """Parameters out of lines ``name | what is given | ... => what is said | ...``.

    Where nothing stands after the name, it is what is given. Indented lines go on. What is typed
    is quoted as in a shell.
    """
    lines = re.sub(r"\n +", " ", text.strip()).splitlines()
    cases = [[part.split(" | ") for part in line.split(" => ")] for line in lines]
    return [pytest.param(given[1:] or given, said, id=given[0]) for given, said in cases]


def keys_of(given: Sequence[str]) -> dict[str, str]:
    """Keys of a cell and their values out of ``section.key = value``."""
    return dict(part.split(" = ", 1) for part in given)  # type: ignore[misc]


def rows_of(path: Path) -> list[dict[str, str]]:
    """Rows of a table below its comments."""
    with path.open(newline="") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


def strict_json(text: str) -> Any:
    """JSON as other programs read it: without NaN and Infinity."""

    def refused(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refused)


def contents(folder: Path) -> dict[str, bytes | None]:
    """Everything below a folder, hidden files too."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


@pytest.fixture(scope="session")
def _work(tmp_path_factory) -> Path:
    return worked_on(tmp_path_factory.mktemp("work"), cell_template(surroundings=False))


@pytest.fixture(scope="session")
def _demo_work(tmp_path_factory) -> Path:
    return worked_on(tmp_path_factory.mktemp("demo"), cell_template())


def worked_on(folder: Path, text: str) -> Path:
    """A folder with a cell and what plan and simulate make of it."""
    (folder / "cell.toml").write_text(text)
    cell, poses = str(folder / "cell.toml"), str(folder / "poses.csv")
    with empty_pictures(), found_once():
        assert run(["plan", cell, "--out", str(folder)]) == 0
    assert (
        run(["simulate", str(with_camera(folder / "cell.toml")), poses, "--out", str(folder)]) == 0
    )
    return folder


def with_camera(cell: Path) -> Path:
    """The same cell with a camera, where it has none: pairs are not simulated without."""
    text = cell.read_text()
    if "\n[camera]" in text:
        return cell
    path = cell.with_name(f"camera_{cell.name}")
    path.write_text(f"{text}\n[camera]\n")
    return path


@pytest.fixture
def work(_work, tmp_path) -> Path:
    """A folder with the reference cell and the files that plan and simulate make of it."""
    return copied(_work, tmp_path)


@pytest.fixture
def demo_work(_demo_work, tmp_path) -> Path:
    """The same with gun, camera, fixture and floor."""
    return copied(_demo_work, tmp_path)


@dataclass(frozen=True)
class Identified:
    """An identification that was made once: what was said, and what stands in the file."""

    said: Said
    content: dict[str, Any]


@pytest.fixture(scope="session")
def identified_once(_work, tmp_path_factory) -> Identified:
    """What ``identify`` makes of the touch-ups of the reference cell, with all its models."""
    work = copied(_work, tmp_path_factory.mktemp("identified"))
    files = [str(work / name) for name in ("cell.toml", "touchups.csv")]
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err), empty_pictures():
        code = run(["identify", *files, "--out", str(work), "--verbose"])
    content = strict_json((work / "identification.json").read_text())
    said = Said(code, unfolded(out.getvalue()), unfolded(err.getvalue()))
    return Identified(said, content)


def below_comments(text: str) -> str:
    """A table from its header on."""
    return "".join(line for line in text.splitlines(True) if not line.startswith("#"))


def copied(source: Path, folder: Path) -> Path:
    """The files of a worked-on folder in a folder of their own."""
    for name in WORK_FILES:
        # without what stands before the header: tests change the lines below it
        text = (source / name).read_text()
        (folder / name).write_text(below_comments(text) if name.endswith(".csv") else text)
    # as tests change joint values one by one, what the pendant shows would contradict them, and so
    # would the fingerprint in the comments
    path = folder / "poses.csv"
    rows = list(csv.reader(path.read_text().splitlines()))
    kept = [i for i, column in enumerate(rows[0]) if not column.startswith("pendant_")]
    with path.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([[row[i] for i in kept] for row in rows])
    return folder


def with_keys(text: str, changes: Mapping[str, str]) -> str:
    """The text of a cell with ``section.key`` set to a value as TOML writes it."""
    lines = text.splitlines()
    for dotted, value in changes.items():
        section, key = dotted.split(".")
        start = next(i for i, line in enumerate(lines) if line.split(" ")[0] == f"[{section}]") + 1
        end = next((i for i in range(start, len(lines)) if lines[i].startswith("[")), len(lines))
        for i in range(start, end):
            if lines[i].startswith(f"{key} ="):
                lines[i] = f"{key} = {value}"
                break
        else:
            lines.insert(start, f"{key} = {value}")
    return "\n".join(lines) + "\n"


def offsets_only(cell: Path, *, judged: bool = False) -> Path:
    """The same cell with offsets alone to identify, which is quick.

    Unless it is to be judged: then an arm with everything that may be off is fitted as well.
    """
    start, _, rest = cell.read_text().partition("models = [\n")
    rest = rest.partition(",\n]\n")[2]
    text = f'{start}models = [["zero_offsets"]]\n{rest}'
    cell.write_text(text if judged else with_keys(text, {"measurement.weighted": "false"}))
    return cell


def with_compliance(cell: Path) -> Path:
    """The same cell with offsets, and with compliance besides, to identify: what is recommended."""
    text = offsets_only(cell, judged=True).read_text()
    two = '[["zero_offsets"], ["zero_offsets", "compliance"]]'
    cell.write_text(with_keys(text, {"parameters.models": two}))
    return cell


@pytest.fixture
def change_cell(work) -> Callable[[Mapping[str, str]], Path]:
    """Change keys of the cell in the working folder."""

    def change(changes: Mapping[str, str]) -> Path:
        path = work / "cell.toml"
        path.write_text(with_keys(path.read_text(), changes))
        return path

    return change


@pytest.fixture
def change_csv(work) -> Callable[[str, int, str, str], Path]:
    """Change a cell of a CSV in the working folder; row 1 is the first below the header."""

    def change(name: str, row: int, column: str, value: str) -> Path:
        lines = (work / name).read_text().splitlines()
        cells = lines[row].split(",")
        cells[lines[0].split(",").index(column)] = value
        lines[row] = ",".join(cells)
        (work / name).write_text("\n".join(lines) + "\n")
        return work / name

    return change


@pytest.fixture
def make_urdf(tmp_path) -> Callable[..., Path]:
    """Write the small arm as a URDF; ``joints`` changes what stands at a joint."""

    def make(joints: Mapping[str, Mapping[str, Any]] | None = None) -> Path:
        path = tmp_path / "small.urdf"
        path.write_text(arm_urdf(joints))
        return path

    return make


_JOINT = """  <joint name="{name}" type="{kind}">
    <parent link="{parent}"/><child link="{child}"/>
    <origin xyz="{xyz}"/><axis xyz="{axis}"/>
    <limit lower="{lower}" upper="{upper}" velocity="3" effort="0"/>
  </joint>
"""

_ARM = (
    ("a1", "0 0 0.3", "0 0 1"),
    ("a2", "0 0 0", "0 1 0"),
    ("a3", "0 0 0.3", "0 1 0"),
    ("a4", "0.1 0 0.07", "1 0 0"),
    ("a5", "0.2 0 0", "0 1 0"),
    ("a6", "0.07 0 0", "1 0 0"),
)


def arm_urdf(joints: Mapping[str, Mapping[str, Any]] | None = None) -> str:
    """A small six-axis arm; ``joints`` changes what stands at a joint."""
    text = '<robot name="small">\n' + "".join(f'  <link name="l{i}"/>\n' for i in range(7))
    for i, (name, xyz, axis) in enumerate(_ARM):
        values = {
            "name": name,
            "kind": "revolute",
            "parent": f"l{i}",
            "child": f"l{i + 1}",
            "xyz": xyz,
            "axis": axis,
            "lower": -2.8,
            "upper": 2.8,
        }
        text += _JOINT.format(**(values | dict((joints or {}).get(name, {}))))
    return text + "</robot>\n"
