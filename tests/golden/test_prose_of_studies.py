"""The prose of studies 12 and 13: its numbers are those of the key figures, to their last digit.

Sentences are put together from the key figures and looked for in the README. What is left of its
numbers has to be given: in ``study.toml``, by the paper, or by the cell.
"""

import json
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

STUDIES = Path(__file__).parents[2] / "studies"
VISUAL, CALIBRATION = "12_visual_touch_up", "13_calibration_by_touch_up"
NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:e\d+)?")
WORDS = [
    *("none", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"),
    *("eleven", "twelve"),
]
GIVEN = {
    # the camera, Tables 1 to 3, names of arms, joints and standards, what the paper has
    VISUAL: "640 480 12 1600 45 15 95 100 1 2 3 4 6 2006 9283 3.3 165 .16 .02 .1 .2 1.5",
    # the camera, the plate, D, percentages, stiffness, names of arms and studies, figures
    CALIBRATION: "640 480 1600 27 100 400 5 25 45 60 80 95 30 2000 2006 165 1 2 9 11 12 "
    ".17 .5 .3 .02 .12",
}
"""Numbers that no run has found."""


def folder_text(name: str) -> str:
    return (STUDIES / name / "README.md").read_text(encoding="utf-8")


def written(name: str) -> Any:
    return json.loads((STUDIES / name / "expected.json").read_text(encoding="utf-8"))


def settings(name: str) -> dict[str, Any]:
    return tomllib.loads((STUDIES / name / "study.toml").read_text(encoding="utf-8"))


def short(value: float, digits: int = 3) -> str:
    """Without the zero before the point."""
    return re.sub(r"^(-?)0\.", r"\1.", f"{value:.{digits}f}")


def power(value: float, digits: int = 0) -> str:
    return f"{value:.{digits}e}".replace("e+0", "e")


def visual_sentences() -> Iterable[str]:
    """Study 12."""
    said, own = written(VISUAL), settings(VISUAL)
    paper, largest = own["paper"], said["pin"]["largest"]
    rows = {row["key"]: row for row in said["rows"]}
    mm = {
        f"{key} {axis}": short(row[f"{axis}_mm"]) for key, row in rows.items() for axis in "VHDXYZ"
    }
    *across, gain = said["derived"]["stereo_gain"]
    noise = said["derived"]["noise_vhs_px"]
    depth = own["stand_off_mm"] ** 2 / (1600.0 * own["target_mm"])  # mm a pixel of size
    pin = {(np.argmax(r["turn_deg"]), r["variant"]): r for r in said["pin"]["rows"]}
    plain = [pin[axis, "as in the paper"]["predicted_mm"] for axis in range(3)]
    best = max(max(map(abs, r["mean_mm"])) for (_, v), r in pin.items() if v == "tilt taken off")
    moves = {key: row["moves"] for key, row in rows.items()}
    ratio = {key: row["depth_ratio"] for key, row in rows.items()}
    tenth, images = "any side, tenth", rows["images"]
    worse = rows["any side"]["V_mm"] / rows["fast"]["V_mm"]
    times = WORDS[round(rows["nominal"]["V_mm"] / paper["touch_up_mm"][0])]

    yield f"({', '.join(f'{1e3 * v:.1f}' for v in noise)} thousandths of a pixel in V, H and s)"
    yield f"({np.hypot(*own['base']['target_turn_deg'][:2]):.1f} deg off square)"
    yield f"noise of {own['noise_pictures']} such pictures"
    ends = f"({short(images['Z_low_mm'])} to {short(images['Z_high_mm'])})"
    yield f"in depth than touch-up: {mm['images Z']} {ends} against {mm['images D']}"
    ends = f"({largest['low_mm']:.2f} to {largest['high_mm']:.2f})"
    yield f"largest {largest['without_pin_mm']:.2f} mm, nearly all of it the ellipse's"
    yield f"the nine figures is {largest['median_mm']:.2f} mm {ends}"
    yield f"With the tilt taken off {best:.3f} mm is left"
    yield f"On an arm that stops exactly {mm['still V']} is left"
    yield f"which would give {mm['catalogue V']}, outside the factor of 1.5"
    yield f"would give {mm['nominal V']}, {times} times its Table 2"
    yield f"The noise of s alone is {3 * noise[2] * depth:.2f} mm"
    yield f"the threshold of .05 px accepts {short(own['base']['size_px'] * depth, 2)} mm"
    yield f"({mm['images D']}; {mm['far D']} from 20 mm away)"
    more = moves["tight"] - moves["fast"]
    yield f"With .02 px it is {mm['tight D']} for {more:.1f} moves more"
    yield f"with four pictures as well {mm['tight looks D']}."
    yield f"at the wide threshold gain little ({mm['looks D']})"
    yield f"V is {mm['any side V']}, {worse:.0f} times as much, and H {mm['any side H']}"
    yield f"A tenth of it still shows ({mm[f'{tenth} V']})"
    yield f"(2 deg) the errors of the arm show as scatter: {mm['turned V']}"
    yield f"is better in D ({mm['square D']})"
    yield f"({mm['printed V']}, {mm['printed H']}, {mm['printed D']})"
    lost = rows["elsewhere"]
    yield f"{lost['stereo_failed']} of {lost['trials']} stereo measurements do not end"
    single = [short(images[f"D_{end}_mm"]) for end in ("least", "most")]
    yield f"a single set-up has from {single[0]} to {single[1]}"
    taken = f"takes {moves['elsewhere']:.1f} moves in place of {moves['fast']:.1f}"
    yield f"{taken} and V and H are {mm['elsewhere V']} and {mm['elsewhere H']}"
    sideways = " and ".join(f"{a:.2f}" for a in across)
    yield f"{gain:.2f} times the scatter of one of them in depth ({sideways} times across)"
    line, papers = rows["fast"]["D_mm"] / gain, paper["touch_up_mm"][2] / gain
    yield f"D / {gain:.2f} = {line:.3f} mm ({short(papers)} mm for the paper's .12)"
    for key, words in (("catalogue", "times as bad)"), ("double", "; D suffers, too)")):
        row = rows[key]
        ends = f"({row['depth_ratio_low']:.2f} to {row['depth_ratio_high']:.2f})"
        yield f"({ratio[key]:.2f} {ends}{' ' * (words[0] != ';')}{words}"
    yield f"one of .3 mm is {ratio['nominal']:.1f} times as bad"
    yield f"a tenth is left {ratio[tenth]:.1f} times, with all of it {ratio['any side']:.1f}"
    yield f"The paper has {paper['stereo_mm'][2] / paper['touch_up_mm'][2]:.1f}."
    asked = paper["stereo_mm"][2] / gain
    times = WORDS[round(asked / paper["touch_up_mm"][0])]
    yield f"asks for {asked:.3f} mm a line, {times} times its own V and H"
    yield f"would show in V of a touch-up ({mm[f'{tenth} V']})"
    yield f"shifts X and Y ({mm['afresh X']}, {mm['afresh Y']})"
    yield f"{short(max(np.abs(plain)[:, :2].max(axis=1)), 2)} mm at 45 deg"
    yield f"{short(plain[0][2])} and {short(plain[1][2])} mm in depth"
    yield f"{best:.3f} mm at most is left, in depth"


def calibration_sentences() -> Iterable[str]:
    """Study 13."""
    said, own = written(CALIBRATION), settings(CALIBRATION)
    arm, rigid = said["arms"]["deflecting"], said["arms"]["rigid"]
    claims = arm["claims"]
    c_g = {row["d_deg"]: row["c_g"] for row in arm["variation"]}
    small = sorted(c_g.values())[:2]

    def of(rows: list[dict[str, Any]], name: str, key: str, least_deg: float = 0.0) -> Any:
        found = [r[key] for r in rows if r["estimator"] == name and r["d_deg"] >= least_deg]
        return np.array(found)

    worst = dict(zip(c_g, of(arm["plate"]["rows"], "touch-up", "worst_mm"), strict=True))
    assert worst[10.0] < min(worst[50.0], worst[55.0], worst[60.0])
    yield f"as good at C_G = {power(c_g[10.0])} as at {power(small[0])} or better"
    best = said["robots"]["touch-up"]["smallest_c_g_is_best"]["share"]
    count = WORDS[len(own["robots"]["thresholds"])]
    yield (
        f"the best of {count} on {WORDS[round(best * said['robots']['count'])]} of "
        f"{said['robots']['count']} arms"
    )
    unweighted, weighted = (
        [row["c_g"] for row in claims[f"view line over touch-up{how}"] if row["low"] > 1.0]
        for how in ("", ", weighted")
    )
    next_one = max(c for c in c_g.values() if c < min(unweighted))
    yield f"above C_G = {power(next_one)} as the paper identifies it"
    yield f"from {power(min(weighted), 1)} up with weights"
    yield f"of the {said['many'] // own['data_sets']} groups of ten"
    noise = of(arm["variation"], "touch-up", "noise_3s_mm")
    rest = noise[:, 2] / noise[:, :2].mean(axis=1)
    yield f"{WORDS[round(rest.min())]} to {WORDS[round(rest.max())]} times as noisy as the rest"
    less = {round(1 / r["ratio"]) for r in claims["view line over touch-up"] if r["c_g"] < 2e5}
    yield f"varies {' or '.join(WORDS[k] for k in less)} times less below C_G = 2e5"
    size = {row["d_deg"]: row for row in claims["size left out over touch-up, weighted"]}
    yield f"by {size[5.0]['ratio']:.1f} at D = 5 deg and {size[20.0]['ratio']:.1f} at 20 deg"
    yield f"no more from {min(d for d, row in size.items() if row['low'] < 1.0):.0f} deg on"
    moves = [of(arm["variation"], name, "moves", 45.0) for name in ("view line", "touch-up")]
    line, touch = (f"{m.min():.2f} to {m.max():.2f}" for m in moves)
    yield f"({line} against {touch} moves from 45 deg on)"
    gain = 1.0 / of(rigid["plate"]["rows"], "touch-up", "ratio", 15.0)
    yield f"a factor of {gain.min():.1f} to {gain.max():.1f} on the rigid arm from D = 15 deg on"
    poor = said["robots"]["touch-up"]["rows"][0]["worse_than_before"]["share"]
    yield f"Poor sets (D = 5 deg) leave {100 * poor:.0f} % of the arms worse than before"
    apart = [
        abs(row["driven_worst_mm"] - row["worst_mm"])
        for part in (arm, rigid)
        for row in part["plate"]["rows"]
        if row["d_deg"] >= 20.0
    ]
    yield f"within {short(max(apart), 2)} mm from D = 20 deg on"
    off = of(arm["variation"], "touch-up", "error_deg")
    yield f"stays off by {short(off.min(), 1)} to {short(off.max(), 1)} deg by touch-up"
    with_it, without = (
        next(r for r in said["causes"] if (r["d_deg"], r["away"]) == (10.0, away))
        for away in ("nothing", "backlash")
    )
    adds = [
        short(with_it[key] - without[key], 2)
        for key in ("view line error_deg", "touch-up, weighted error_deg")
    ]
    backlash = short(own["arms"]["deflecting"]["backlash_deg"])
    yield f"backlash ({backlash} deg) and friction"
    yield f"at C_G = {power(c_g[10.0])} a backlash of {backlash} deg"
    yield f"adds {adds[0]} deg for the view line and {adds[1]} deg for weighted touch-up"
    bias = max(abs(v) for row in written(VISUAL)["pin"]["rows"] for v in row["predicted_mm"])
    yield f"moves by up to {short(bias, 2)} mm"
    error = max(abs(of(rigid["variation"], "touch-up", "error_deg")))
    yield f"the rigid arm is right to {short(error)} deg"
    low, high = (end(noise, axis=0) for end in (np.min, np.max))
    v, h, d = (f"{short(a)} to {short(b)}" for a, b in zip(low, high, strict=True))
    yield f"3 sigma of {v}, {h} and {d} mm along V, H, D"
    seen = said["pictures"]
    ends = f"({seen['image_low_deg']:.3f} to {seen['image_high_deg']:.3f})"
    yield (
        f"{seen['image_data_sets']} data sets at D = {seen['d_deg']:.0f} deg vary by "
        f"{seen['image_std_deg']:.3f} {ends} deg, by the fast camera {seen['fast_std_deg']:.3f}"
    )
    yield f"the depth {100 * (seen['image_d_3s_mm'] / seen['fast_d_3s_mm'] - 1):.0f} % noisier"
    last = [r for r in arm["plate"]["rows"] if r["estimator"] == "touch-up"][-1]
    assert last["c_g"] == small[0]
    near, far = 0.17 / last["d100_mm"], 0.5 / last["d400_mm"]
    yield f"are {near:.1f} and {far:.1f} times those found here at the smallest C_G"


SENTENCES = {VISUAL: visual_sentences, CALIBRATION: calibration_sentences}


@pytest.mark.parametrize("name", list(SENTENCES))
def test_sentences_have_the_key_figures(name):
    text = folder_text(name)
    missing = [sentence for sentence in SENTENCES[name]() if sentence not in text]
    assert not missing


@pytest.mark.parametrize("name", list(SENTENCES))
def test_all_other_numbers_are_given(name):
    text = re.sub(r"```.*?```", "", folder_text(name), flags=re.S)
    text = re.sub(r"\]\(.*?\)", "]", text)  # addresses of links
    prose = "\n".join(line for line in text.splitlines() if not line.startswith("| "))
    for sentence in SENTENCES[name]():
        prose = prose.replace(sentence, "")
    toml = (STUDIES / name / "study.toml").read_text(encoding="utf-8")
    given = {abs(float(n)) for n in [*NUMBER.findall(toml), *GIVEN[name].split()]}
    found = [n for n in NUMBER.findall(prose) if abs(float(n)) not in given]
    assert not found
