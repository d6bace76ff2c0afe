"""What all studies share: tables and key figures on disk, and figures in two forms."""

from __future__ import annotations

import io
import json
import math
import re
import string
import tomllib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from calib.errors import InputError
from posedesign.files import json_text, make_folder, write_text_atomic
from posedesign.files.csv_tables import AsItIs, write_table
from posedesign.files.csv_tables import read_rows as read_cells
from posedesign.study import Advance, Grid, Options, Store, call, read_table, run_grid

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Row = TypeVar("Row")

FIGURES = "figures.json"
"""Key figures of a run, beside its tables: what ``expected.json`` has of the full one."""


def settings_of(module: str) -> dict[str, Any]:
    """Numbers of the study that a file is of: ``study.toml`` beside it."""
    return tomllib.loads(Path(module).with_name("study.toml").read_text(encoding="utf-8"))


def write_figures(out: Path, figures: Mapping[str, Any] | Sequence[Any]) -> Path:
    """Write the key figures of a run, as JSON with a line for each row of a table."""
    make_folder(out)
    return write_text_atomic(out / FIGURES, _lines(json.loads(json_text(figures))) + "\n")


def write_rounded(
    out: Path, said: Any, digits: int, tables: Mapping[str, Sequence[Mapping[str, Any]]]
) -> dict[str, Any]:
    """Write tables by their names, and key figures, with so many digits; return the latter."""
    for name, rows in tables.items():
        write_rows(out, name, rows, digits)
    figures: dict[str, Any] = rounded(said, digits)
    write_figures(out, figures)
    return figures


def _lines(value: Any, indent: str = "\n") -> str:
    """JSON in which only what holds rows is broken into lines."""
    items = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    if not any(_has_rows(item) for item in items):
        return json.dumps(value)
    inner = indent + " "
    parts = [_lines(item, inner) for item in items]
    if isinstance(value, dict):
        parts = [f"{json.dumps(key)}: {part}" for key, part in zip(value, parts, strict=True)]
    first, last = "{}" if isinstance(value, dict) else "[]"
    return f"{first}{inner}{f',{inner}'.join(parts)}{indent}{last}"


def _has_rows(value: Any) -> bool:
    """A row with a name of its own, or a list of rows."""
    if isinstance(value, dict):
        return bool(value)
    return isinstance(value, list) and any(isinstance(item, dict | list) for item in value)


def read_figures(out: Path) -> Any:
    """Key figures of a run; those of the full one where the folder is the study's own."""
    path = out / FIGURES
    if not path.exists():
        path = out / "expected.json"
    return json.loads(path.read_text(encoding="utf-8"))


def write_rows(
    out: Path, name: str, rows: Sequence[Mapping[str, Any]], digits: int | None = None
) -> Path:
    """Write a table: columns as in its first row, then those that only later rows have.

    Numbers have nine decimals, or so many significant digits, however small they are.
    """
    make_folder(out)
    columns = list(dict.fromkeys(column for row in rows for column in row))
    if digits is not None:
        rows = [{k: _exact(v) for k, v in rounded(row, digits).items()} for row in rows]
    return write_table(out / name, columns, rows)


def _exact(value: Any) -> Any:
    return AsItIs(value) if isinstance(value, float) else value


def read_rows(out: Path, name: str) -> list[dict[str, Any]]:
    """A table that :func:`write_rows` wrote: numbers as such, all else as text."""
    return [{k: _number(v) for k, v in row.cells.items()} for row in read_cells(out / name)[1]]


def _number(cell: str) -> float | str:
    try:
        return float(cell)
    except ValueError:
        return cell


def rounded(value: Any, digits: int) -> Any:
    """Numbers with so many significant digits, in whatever holds them; None where there is none.

    Nothing has no sign: a zero that was rounded or negated is written as any other.
    """
    if isinstance(value, Mapping):
        return {key: rounded(item, digits) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(item, digits) for item in value]
    if isinstance(value, float):
        return float(f"{value:.{digits}g}") + 0.0 if math.isfinite(value) else None
    return value


class _Cells(string.Formatter):
    """Format strings of cells, with more specifications of numbers than Python has.

    ``p``: a percentage, without its sign; ``s`` before another one: no zero before the point;
    ``n``: three digits, whole numbers from a hundred on; ``d``: two digits, three where the first
    is a one, and no zero before the point. Powers of ten are short,
    ``1.2e5``. What is in square brackets is a key: ``{below[share]:p}``.
    """

    def get_value(self, key: int | str, args: Sequence[Any], kwargs: Mapping[str, Any]) -> Any:
        return kwargs[str(key)]

    def format_field(self, value: Any, spec: str) -> str:
        if value is None:
            raise _NothingThereError
        if spec == "n":
            return f"{value:.3g}" if abs(value) < 100 else f"{value:,.0f}"
        if spec == "d" and isinstance(value, float):
            spec = "s.3g" if f"{abs(value):.1e}"[0] == "1" else "s.2g"
        if spec.endswith("p"):
            value, spec = 100.0 * value, f"{spec[:-1] or '.0'}f"
        shown = format(value, spec.removeprefix("s"))
        if spec.endswith("e"):
            shown = shown.replace("e+0", "e")
        return re.sub(r"^([+-]?)0\.", r"\1.", shown) if spec.startswith("s") else shown


class _NothingThereError(Exception):
    """A cell has a number that is not there."""


Cell = str | Callable[[Any], str]
"""How a row is written: a format string of the names of its columns, or a function of it."""


def cell(row: Mapping[str, Any], how: Cell, none: str = "-") -> str:
    """A row as it is written; ``none`` where a number of it is None."""
    try:
        return how(row) if callable(how) else _Cells().vformat(how, (), row)
    except _NothingThereError:
        return none


Cells = Mapping[str, Cell] | Sequence[Cell]
"""Those of a table by the heads of its columns; without heads, of its rows alone."""


Cells = Mapping[str, Cell] | Sequence[Cell]
"""Those of a table by the heads of its columns; without heads, of its rows alone."""


def table(rows: Iterable[Any], columns: Cells, heads: Sequence[str] = (), none: str = "-") -> str:
    """A table in Markdown; ``heads``: of columns that have none of their own."""
    own, hows = _apart(columns)
    return lines_of(own or heads, ([cell(row, how, none) for how in hows] for row in rows))


def table_across(rows: Iterable[Any], along: Cells, by: str, columns: Cells) -> str:
    """A table of which rows that are written alike in the first columns are one.

    Beside each other stand the other columns of each of them; ``{}`` in their heads is its name in
    the column ``by``.
    """
    (first, keys), (rest, hows) = _apart(along), _apart(columns)
    found: dict[tuple[str, ...], dict[Any, Any]] = {}
    names: dict[Any, None] = {}
    for row in rows:
        names[row[by]] = None
        found.setdefault(tuple(cell(row, how) for how in keys), {})[row[by]] = row
    heads = [*first, *(head.format(name) for name in names for head in rest)]
    return lines_of(
        heads,
        (
            [*key, *(cell(of[name], how) if name in of else "" for name in names for how in hows)]
            for key, of in found.items()
        ),
    )


def _apart(columns: Cells) -> tuple[list[str], list[Cell]]:
    if isinstance(columns, Mapping):
        return list(columns), list(columns.values())
    return [], list(columns)


def lines_of(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown of cells as they are."""
    lines = [f"| {' | '.join(cells)} |" for cells in ((heads, *rows) if heads else rows)]
    return "\n".join([*lines[:1], "|---" * len(heads) + "|", *lines[1:]] if heads else lines)


def span(spec: str, middle: str, low: str = "", high: str = "") -> str:
    """Format string of a number with its interval, of the names or of ``x_low`` and ``x_high``."""
    stem, unit = middle.removesuffix("_mm"), "_mm" if middle.endswith("_mm") else ""
    low, high = low or f"{stem}_low{unit}", high or f"{stem}_high{unit}"
    return f"{{{middle}:{spec}}} ({{{low}:{spec}}} to {{{high}:{spec}}})"


def trials_of(options: Options, own: int, least: int = 2) -> int:
    """Number of trials: the study's own, or that of a short form.

    Raises
    ------
    InputError
        Fewer than the least that the study can tell anything from.
    """
    count = own if options.trials is None else options.trials
    if count < least:
        hint = f"give {least} or more"
        raise InputError(f"{count} trials", hint=hint, name="trials", value=count, bound=least)
    return count


def parts_of(rows: Iterable[Row], advance: Advance, name: Callable[[Row], str]) -> Iterator[Row]:
    """One after the other, each reported by its name before it is begun."""
    every = list(rows)
    for done, row in enumerate(every):
        advance(name(row), done / len(every))
        yield row


def named(rows: Iterable[Any], names: Collection[str] | None, advance: Advance) -> Iterator[Any]:
    """Models of a study's settings, or those that are named, each reported before it is begun."""
    wanted = [row for row in rows if names is None or row["name"] in names]
    return parts_of(wanted, advance, itemgetter("name"))


def trials_by_grid(
    options: Options, study: str, settings: Mapping[str, Any], conditions: Sequence[dict[str, Any]]
) -> pd.DataFrame:
    """Trials of all conditions, by ``simulate`` of a study's ``run.py``, shared by workers."""
    grid = Grid(conditions, settings["trials"], settings["batch"], settings["seed"])
    about = {"study": study, "tasks": len(grid), **settings}
    table = run_grid(
        partial(call, study, "simulate"),
        grid,
        Store(options.out, "trials", about),
        options.workers,
        restart=options.restart,
        advance=lambda done, total: options.advance(f"{done} of {total} tasks", done / total),
    )
    return read_table(table)


def part_of(advance: Advance, k: int, count: int, name: str) -> Advance:
    """What reports the progress of the k-th of so many parts, which are taken for equal."""
    return lambda what, part: advance(f"{name}: {what}", (k + part) / count)


def save(figure: Figure, out: Path, name: str) -> list[Path]:
    """Save a figure as PNG and SVG, the same bytes for the same figure."""
    from PIL import Image

    from posedesign.report.figures import as_png, as_svg

    make_folder(out)
    paths = [out / f"{name}.png", out / f"{name}.svg"]
    figure.set_dpi(130)
    # lines in few colours: a palette takes a third of the room
    picture = Image.open(io.BytesIO(as_png(figure))).convert("RGB")
    picture.quantize(128, dither=Image.Dither.NONE).save(paths[0], optimize=True)
    paths[1].write_text(as_svg(figure))
    return paths
