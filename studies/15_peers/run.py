"""Run the study: ``posedesign study run peers``, or this file as a script."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import sys
import tomllib
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # the modules of this folder, however it is loaded

import peer_drawing as drawing  # noqa: E402
import peer_fits as fits  # noqa: E402
import peer_pairs as pairs  # noqa: E402
import peer_selection as selection  # noqa: E402
import peer_words as words  # noqa: E402

from posedesign.study.library import Options  # noqa: E402
from studies import writing  # noqa: E402

SETTINGS: dict[str, Any] = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
DIGITS = 5
"""Significant digits of what is written: more than the sampling leaves."""

TIMES, PAIRS, TOUCH_UPS = "peer_times.csv", "peer_pairs.csv", "peer_touch_ups.csv"
SELECTION, REFUSALS = "peer_selection.csv", "peer_refusals.csv"

ALWAYS = {"opencv": "opencv-python-headless", "scipy": "scipy"}
EXTRA = {
    "figaroh": 'pip install -c constraints.txt -e ".[peers]"',
    "pybotics": 'pip install -c constraints.txt -e ".[peers]", then '
    "pip install --no-deps pybotics==3.1.2",
}
"""Peers that may not be there, and what installs them."""


def study(options: Options) -> dict[str, Any]:
    """What do others make of the same work, how fast, and what do they not do?

    A trial is a random set of pairs, or a set of touch-ups. A short form takes its times by fewer
    rounds and leaves out what takes minutes: the peers' own slow residuals, a thousand pairs by
    methods whose cost is square.
    """
    short = options.trials is not None
    peers = installed()
    left_out = {name: _sentence(name) for name in EXTRA if name not in peers}
    for sentence in left_out.values():
        print(sentence, file=sys.stderr)
    own = SETTINGS["touch_ups"]
    kinked = 0 if short else own["kinked_trials"]
    trials = {
        name: writing.trials_of(options, SETTINGS[name]["trials"])
        for name in ("pairs", "touch_ups")
    }
    settings = SETTINGS | {"clock": SETTINGS["short"]} if short else SETTINGS
    options.advance("times of A X = Z B", 0.0)
    times = pairs.times(settings, short)
    options.advance("times of ten parameters", 0.35)
    times += fits.times(settings, settings["clock"], kinked, peers)
    times += selection.times(settings, settings["clock"], with_figaroh="figaroh" in peers)
    options.advance("A X = Z B", 0.5)
    said: dict[str, Any] = {
        "versions": versions(peers),
        "left_out": left_out,
        "trials": trials,
        "times": times,
        "pairs": pairs.errors(SETTINGS, trials["pairs"]),
        "optimum": pairs.optimum(SETTINGS, trials["pairs"]),
        "refusals": pairs.refusals(SETTINGS),
    }
    options.advance("ten parameters", 0.75)
    said["touch_ups"] = fits.errors(SETTINGS, trials["touch_ups"], kinked, peers)
    said["facts"] = fits.facts(SETTINGS, peers)
    options.advance("choice of poses", 0.9)
    said["selection"] = selection.compared(SETTINGS, with_figaroh="figaroh" in peers)
    figures: dict[str, Any] = writing.rounded(said, DIGITS)
    for name, table in (
        (TIMES, "times"),
        (PAIRS, "pairs"),
        (TOUCH_UPS, "touch_ups"),
        (SELECTION, "selection"),
        (REFUSALS, "refusals"),
    ):
        writing.write_rows(options.out, name, figures[table], DIGITS)
    writing.write_figures(options.out, figures)
    return figures


def plot(folder: Path) -> list[Path]:
    """Ratios of times, and what the answers are worth."""
    times, errors, touch_ups, chosen = (
        writing.read_rows(folder, name) for name in (TIMES, PAIRS, TOUCH_UPS, SELECTION)
    )
    drawn = writing.save(drawing.draw_times(times), folder, "peer_times")
    return drawn + writing.save(
        drawing.draw_accuracy(errors, touch_ups, chosen), folder, "peer_accuracy"
    )


def installed() -> tuple[str, ...]:
    """Peers of the extra that are there."""
    return tuple(name for name in EXTRA if importlib.util.find_spec(name) is not None)


def versions(peers: tuple[str, ...]) -> dict[str, str]:
    """Of everybody who takes part."""
    names = ALWAYS | {name: name for name in peers}
    return {name: importlib.metadata.version(package) for name, package in names.items()}


def _sentence(name: str) -> str:
    return f"{name} is not installed and left out; to have it: {EXTRA[name]}"


def main() -> None:
    """Run, draw and print."""
    writing.script(study, plot, HERE, words.markdown)


if __name__ == "__main__":
    main()
