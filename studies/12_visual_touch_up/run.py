"""Run the study: python studies/12_visual_touch_up/run.py [--trials N] [--out DIR]."""

from __future__ import annotations

import argparse
import csv
import json
import re
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # the modules of this folder, however it is loaded

import visual_pin as pin  # noqa: E402
import visual_tables as tables  # noqa: E402
from visual_bench import Bench, cell_of, joint_scatter  # noqa: E402
from visual_figure import draw  # noqa: E402

from calib.se3 import FloatArray  # noqa: E402
from posedesign.cli.output import progress  # noqa: E402

SETTINGS: dict[str, Any] = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
LINE_ONLY = "afresh"
"""Condition that touch-ups know nothing of."""

DIGITS = 5
"""Significant digits of what is written: more than the sampling leaves."""


def run(
    trials: int | None = None, keys: Sequence[str] | None = None
) -> tuple[list[dict[str, Any]], dict[str, dict[str, FloatArray]]]:
    """Tables 1 and 2 under each condition, and the clouds behind them."""
    rows, clouds = [], {}
    wanted = [c for c in SETTINGS["condition"] if keys is None or c["key"] in keys]
    with progress("visual touch-up") as advance:
        for done, condition in enumerate(wanted):
            advance(condition["says"], done / len(wanted))
            row, clouds[condition["key"]] = tables.row(condition, SETTINGS, trials)
            rows.append(row)
    return rows, clouds


def against_pin(trials: int | None = None, seen: str = "image") -> dict[str, Any]:
    """Table 3, and the largest of its figures with a pin that is as good as it is."""
    bench = Bench.of(SETTINGS, {"seen": seen})
    rows = pin.differences(bench, SETTINGS, trials or SETTINGS["pin"]["trials"])
    rng = np.random.default_rng([SETTINGS["seed"], pin.PIN])
    return {"rows": rows, "largest": pin.largest(rows, SETTINGS, rng)}


def derived() -> dict[str, Any]:
    """What the settings come to: scatter of a joint, noise of the fast camera, gain of stereo."""
    cell = cell_of(SETTINGS, SETTINGS["base"])
    scatter = joint_scatter(cell, SETTINGS["base"]["repeatability_mm"] / 1e3)
    noise = Bench.of(SETTINGS, {}).observer.noise  # type: ignore[attr-defined]
    return {
        "joint_scatter_deg": float(np.rad2deg(scatter)),
        "noise_vhs_px": noise.sigma_vhs_px.tolist(),
        "stereo_gain": list(tables.depth_of_stereo(SETTINGS["stereo"]["turns_deg"])),
    }


def rounded(value: Any) -> Any:
    """Numbers with :data:`DIGITS` digits, in whatever holds them."""
    if isinstance(value, dict):
        return {k: rounded(v) for k, v in value.items()}
    if isinstance(value, list):
        return [rounded(v) for v in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def _short(value: float, sign: str = "") -> str:
    """Three decimals without the zero before the point, and no sign of nothing."""
    return re.sub(r"\b0\.", ".", f"{round(value, 3) + 0.0:{sign}.3f}")


def _cells(row: dict[str, Any], axes: Sequence[str], *, interval: bool) -> list[str]:
    cells = []
    for axis in axes:
        text = _short(row[f"{axis}_mm"])
        if interval:
            text += f" ({_short(row[f'{axis}_low_mm'])} to {_short(row[f'{axis}_high_mm'])})"
        cells.append(text)
    return cells


def _table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    rule = ["---"] * len(head)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, rule, *lines))


def markdown_repeated(rows: list[dict[str, Any]], axes: Sequence[str]) -> str:
    """Table 1 (axes X, Y, Z) or Table 2 (V, H, D) as the README has it."""
    is_stereo = tuple(axes) == tables.BASE_AXES
    last = ["Z / D of a touch-up"] if is_stereo else ["moves"]
    lines = []
    for row in rows:
        if row["key"] == LINE_ONLY and not is_stereo:
            continue  # the same touch-ups as in the base
        failed = row["stereo_failed" if is_stereo else "failed"]
        value = f"{row['depth_ratio']:.2f}" if is_stereo else f"{row['moves']:.1f}"
        cells = _cells(row, axes, interval=row["seen"] == "image")
        lines.append([row["says"], str(row["trials"]), *cells, value, str(failed)])
    return _table(["condition", "trials", *axes, *last, "failed"], lines)


def markdown_pin(rows: list[dict[str, Any]]) -> str:
    """Table 3 as the README has it."""
    lines = []
    for row in rows:
        turn = "xyz"[int(np.argmax(row["turn_deg"]))]
        mean = [_short(value, "+") for value in row["mean_mm"]]
        expected = [_short(value, "+") for value in row["predicted_mm"]]
        said = ", ".join(expected) if any(row["predicted_mm"]) else "0"
        sigma = ", ".join(_short(3 * value) for value in row["sigma_mm"])
        lines.append([turn, row["variant"], *mean, said, sigma])
    return _table(["45 deg about", "touch-up", "x", "y", "z", "predicted", "3 sigma"], lines)


def _write(rows: list[dict[str, Any]], path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def _flat(row: dict[str, Any]) -> dict[str, Any]:
    """A row of Table 3 without lists."""
    out = {"about": "xyz"[int(np.argmax(row["turn_deg"]))], "touch_up": row["variant"]}
    for name in ("mean_mm", "sigma_mm", "predicted_mm"):
        stem = name.removesuffix("_mm")
        out |= {f"{stem}_{axis}_mm": v for axis, v in zip("xyz", row[name], strict=True)}
    return out | {"trials": row["trials"], "failed": row["failed"]}


def main() -> None:
    """Run, print, and write tables, figure and key figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, help="repetitions of each condition")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for the results")
    arguments = parser.parse_args()
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    rows, clouds = run(arguments.trials)
    found = rounded({"rows": rows, "pin": against_pin(arguments.trials), "derived": derived()})
    (out / "expected.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    _write(found["rows"], out / "visual_touch_up.csv")
    _write([_flat(row) for row in found["pin"]["rows"]], out / "visual_less_pin.csv")
    draw(clouds, found["pin"]["rows"], SETTINGS, out / "visual_touch_up.png")
    print(markdown_repeated(found["rows"], tables.AXES))
    print(markdown_repeated(found["rows"], tables.BASE_AXES))
    print(markdown_pin(found["pin"]["rows"]))
    print(json.dumps(found["pin"]["largest"]), json.dumps(found["derived"]))


if __name__ == "__main__":
    main()
