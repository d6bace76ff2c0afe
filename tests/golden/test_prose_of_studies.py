"""The prose of studies: its numbers are those of the key figures, to their last digit.

A claim is a piece of a README with ``#`` for each number, and what the numbers have to be. What is
left of the numbers of two pages has to be given: in ``study.toml``, by the paper, or by the cell.
"""

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

STUDIES = Path(__file__).parents[2] / "studies"
VISUAL, CALIBRATION = "12_visual_touch_up", "13_calibration_by_touch_up"
PEERS = "15_peers"
NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:e\d+)?")
WORDS = ["none", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"]
WORDS += ["eleven", "twelve", "keeps", "drops"]  # the last two: what is done with a parameter
PLACE = rf"([-+]?(?:\d[\d,]*\.?\d*|\.\d+)(?:e-?\d+)?|{'|'.join(WORDS)})"
GIVEN = {
    # the camera, Tables 1 to 3, names of arms, joints and standards, what the paper has
    VISUAL: "640 480 12 1600 45 15 95 100 1 2 3 4 6 2006 9283 3.3 165 .16 .02 .1 .2 1.5",
    # the camera, the plate, D, percentages, stiffness, names of arms and studies, figures
    CALIBRATION: "640 480 1600 27 100 400 5 25 45 60 80 95 30 2000 2006 165 1 2 9 11 12 "
    ".17 .5 .3 .02 .12",
}
"""Numbers that no run has found."""

Claim = tuple[str, list[Any]]


def folder_text(name: str) -> str:
    return (STUDIES / name / "README.md").read_text(encoding="utf-8")


def written(name: str) -> Any:
    return json.loads((STUDIES / name / "expected.json").read_text(encoding="utf-8"))


def settings(name: str) -> dict[str, Any]:
    return tomllib.loads((STUDIES / name / "study.toml").read_text(encoding="utf-8"))


def says(shown: str, value: Any) -> bool:
    """Whether a number as it is written is a value, rounded."""
    if shown in WORDS:
        return shown == value or (not isinstance(value, str) and WORDS.index(shown) == round(value))
    mantissa, _, power = shown.replace(",", "").partition("e")
    last = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
    return abs(float(shown.replace(",", "")) - value) <= 0.502 * last


def found_in(text: str, template: str, values: list[Any]) -> str | None:
    """The piece of a text that makes a claim."""
    assert template.count("#") == len(values), template
    for found in re.finditer(re.escape(template).replace(r"\#", PLACE), text):
        if all(map(says, found.groups(), values)):
            return found[0]
    return None


def visual_claims() -> Iterator[Claim]:
    """Study 12."""
    said, own = written(VISUAL), settings(VISUAL)
    paper, largest = own["paper"], said["pin"]["largest"]
    rows = {row["key"]: row for row in said["rows"]}
    *across, gain = said["derived"]["stereo_gain"]
    noise = said["derived"]["noise_vhs_px"]
    depth = own["stand_off_mm"] ** 2 / (1600.0 * own["target_mm"])  # mm a pixel of size
    pin = {(np.argmax(r["turn_deg"]), r["variant"]): r for r in said["pin"]["rows"]}
    plain = [pin[axis, "as in the paper"]["predicted_mm"] for axis in range(3)]
    best = max(max(map(abs, r["mean_mm"])) for (_, v), r in pin.items() if v == "tilt taken off")
    moves = {key: row["moves"] for key, row in rows.items()}
    ratio = {key: row["depth_ratio"] for key, row in rows.items()}
    tenth, images, lost = "any side, tenth", rows["images"], rows["elsewhere"]

    def mm(key: str, axes: str) -> list[float]:
        return [rows[key][f"{axis}_mm"] for axis in axes]

    def ends(row: dict[str, Any], name: str, unit: str = "") -> list[float]:
        return [row[f"{name}{end}{unit}"] for end in ("_low", "_high")]

    yield "(#, #, # thousandths of a pixel in V, H and s)", [1e3 * v for v in noise]
    yield "(# deg off square)", [np.hypot(*own["base"]["target_turn_deg"][:2])]
    yield "noise of # such pictures", [own["noise_pictures"]]
    yield (
        "in depth than touch-up: # (# to #) against #",
        [*mm("images", "Z"), *ends(images, "Z", "_mm"), *mm("images", "D")],
    )
    yield "largest # mm, nearly all of it the ellipse's", [largest["without_pin_mm"]]
    yield (
        "the nine figures is # mm (# to #)",
        [largest[f"{k}_mm"] for k in ("median", "low", "high")],
    )
    yield "With the tilt taken off # mm is left", [best]
    yield "On an arm that stops exactly # is left", mm("still", "V")
    yield "which would give #, outside the factor of 1.5", mm("catalogue", "V")
    times = rows["nominal"]["V_mm"] / paper["touch_up_mm"][0]
    yield "would give #, # times its Table 2", [*mm("nominal", "V"), times]
    yield "The noise of s alone is # mm", [3 * noise[2] * depth]
    yield "the threshold of .05 px accepts # mm", [own["base"]["size_px"] * depth]
    yield "(#; # from 20 mm away)", [*mm("images", "D"), *mm("far", "D")]
    yield (
        "With .02 px it is # for # moves more",
        [*mm("tight", "D"), moves["tight"] - moves["fast"]],
    )
    yield "with four pictures as well #.", mm("tight looks", "D")
    yield "at the wide threshold gain little (#)", mm("looks", "D")
    worse = rows["any side"]["V_mm"] / rows["fast"]["V_mm"]
    yield "V is #, # times as much, and H #", [*mm("any side", "V"), worse, *mm("any side", "H")]
    yield "A tenth of it still shows (#)", mm(tenth, "V")
    yield "(2 deg) the errors of the arm show as scatter: #", mm("turned", "V")
    yield "is better in D (#)", mm("square", "D")
    yield "(#, #, #)", mm("printed", "VHD")
    yield "# of # stereo measurements do not end", [lost["stereo_failed"], lost["trials"]]
    yield "a single set-up has from # to #", [images["D_least_mm"], images["D_most_mm"]]
    yield "takes # moves in place of #", [moves["elsewhere"], moves["fast"]]
    yield "and V and H are # and #", mm("elsewhere", "VH")
    yield "# times the scatter of one of them in depth (# and # times across)", [gain, *across]
    yield (
        "D / # = # mm (# mm for the paper's .12)",
        [gain, rows["fast"]["D_mm"] / gain, paper["touch_up_mm"][2] / gain],
    )
    for key, words in (("catalogue", " times as bad)"), ("double", "; D suffers, too)")):
        yield f"(# (# to #){words}", [ratio[key], *ends(rows[key], "depth_ratio")]
    yield "one of .3 mm is # times as bad", [ratio["nominal"]]
    yield "a tenth is left # times, with all of it #", [ratio[tenth], ratio["any side"]]
    yield "The paper has #.", [paper["stereo_mm"][2] / paper["touch_up_mm"][2]]
    asked = paper["stereo_mm"][2] / gain
    yield "asks for # mm a line, # times its own V and H", [asked, asked / paper["touch_up_mm"][0]]
    yield "would show in V of a touch-up (#)", mm(tenth, "V")
    yield "shifts X and Y (#, #)", mm("afresh", "XY")
    yield "# mm at 45 deg", [max(np.abs(plain)[:, :2].max(axis=1))]
    yield "# and # mm in depth", [plain[0][2], plain[1][2]]
    yield "# mm at most is left, in depth", [best]
    for table, key, axes in (("| 2: ", "images", "VHD"), ("| 1: ", tenth, "XYZ")):
        line = next(x for x in folder_text(VISUAL).splitlines() if x.startswith(table))
        for axis in axes:
            values = [rows[key][f"{axis}_mm"], *ends(rows[key], axis, "_mm")]
            assert found_in(line, f"{axis} # (# to #)", values), (table, axis)


def calibration_claims() -> Iterator[Claim]:
    """Study 13."""
    said, own = written(CALIBRATION), settings(CALIBRATION)
    arm, rigid, robots = said["arms"]["deflecting"], said["arms"]["rigid"], said["robots"]
    claims = arm["claims"]
    c_g = {row["d_deg"]: row["c_g"] for row in arm["variation"]}
    small = sorted(c_g.values())[:2]

    def of(rows: list[dict[str, Any]], name: str, key: str, least_deg: float = 0.0) -> Any:
        found = [r[key] for r in rows if r["estimator"] == name and r["d_deg"] >= least_deg]
        return np.array(found)

    def ends(values: Any) -> list[float]:
        return [np.min(values), np.max(values)]

    yield from calibration_verdicts(arm, rigid, robots)
    worst = dict(zip(c_g, of(arm["plate"]["rows"], "touch-up", "worst_mm"), strict=True))
    assert worst[10.0] < min(worst[50.0], worst[55.0], worst[60.0])
    yield "as good at C_G = # as at # or better", [c_g[10.0], small[0]]
    best = robots["touch-up"]["smallest_c_g_is_best"]["share"] * robots["count"]
    count = len(own["robots"]["thresholds"])
    yield "the best of # on # of # arms", [count, best, robots["count"]]
    unweighted, weighted = (
        [row["c_g"] for row in claims[f"view line over touch-up{how}"] if row["low"] > 1.0]
        for how in ("", ", weighted")
    )
    next_one = max(c for c in c_g.values() if c < min(unweighted))
    yield "above C_G = # as the paper identifies it", [next_one]
    yield "from # up with weights", [min(weighted)]
    yield "of the # groups of ten", [said["many"] // own["data_sets"]]
    noise = of(arm["variation"], "touch-up", "noise_3s_mm")
    yield "# to # times as noisy as the rest", ends(noise[:, 2] / noise[:, :2].mean(axis=1))
    less = {round(1 / r["ratio"]) for r in claims["view line over touch-up"] if r["c_g"] < 2e5}
    yield f"varies {' or '.join('#' * len(less))} times less below C_G = 2e5", list(less)
    size = {row["d_deg"]: row for row in claims["size left out over touch-up, weighted"]}
    yield "by # at D = 5 deg and # at 20 deg", [size[5.0]["ratio"], size[20.0]["ratio"]]
    yield "no more from # deg on", [min(d for d, row in size.items() if row["low"] < 1.0)]
    moves = [of(arm["variation"], name, "moves", 45.0) for name in ("view line", "touch-up")]
    yield "(# to # against # to # moves from 45 deg on)", [*ends(moves[0]), *ends(moves[1])]
    gain = 1.0 / of(rigid["plate"]["rows"], "touch-up", "ratio", 15.0)
    yield "a factor of # to # on the rigid arm from D = 15 deg on", ends(gain)
    poor = robots["touch-up"]["rows"][0]["worse_than_before"]["share"]
    yield "Poor sets (D = 5 deg) leave # % of the arms worse than before", [100 * poor]
    apart = [
        abs(row["driven_worst_mm"] - row["worst_mm"])
        for part in (arm, rigid)
        for row in part["plate"]["rows"]
        if row["d_deg"] >= 20.0
    ]
    yield "within # mm from D = 20 deg on", [max(apart)]
    yield "stays off by # to # deg by touch-up", ends(of(arm["variation"], "touch-up", "error_deg"))
    with_it, without = (
        next(r for r in said["causes"] if (r["d_deg"], r["away"]) == (10.0, away))
        for away in ("nothing", "backlash")
    )
    names = ("view line error_deg", "touch-up, weighted error_deg")
    backlash = own["arms"]["deflecting"]["backlash_deg"]
    yield "backlash (# deg) and friction", [backlash]
    yield "at C_G = # a backlash of # deg", [c_g[10.0], backlash]
    yield (
        "adds # deg for the view line and # deg for weighted touch-up",
        [with_it[name] - without[name] for name in names],
    )
    bias = max(abs(v) for row in written(VISUAL)["pin"]["rows"] for v in row["predicted_mm"])
    yield "moves by up to # mm", [bias]
    error = max(abs(of(rigid["variation"], "touch-up", "error_deg")))
    yield "the rigid arm is right to # deg", [error]
    yield (
        "3 sigma of # to #, # to # and # to # mm along V, H, D",
        [end for axis in noise.T for end in ends(axis)],
    )
    seen = said["pictures"]
    yield (
        "# data sets at D = # deg vary by # (# to #) deg, by the fast camera #",
        [
            *(seen[key] for key in ("image_data_sets", "d_deg", "image_std_deg")),
            *(seen[key] for key in ("image_low_deg", "image_high_deg", "fast_std_deg")),
        ],
    )
    noisier = 100 * (seen["image_d_3s_mm"] / seen["fast_d_3s_mm"] - 1)
    yield "the depth # % noisier", [noisier]
    last = [r for r in arm["plate"]["rows"] if r["estimator"] == "touch-up"][-1]
    assert last["c_g"] == small[0]
    yield (
        "are # and # times those found here at the smallest C_G",
        [0.17 / last["d100_mm"], 0.5 / last["d400_mm"]],
    )


def calibration_verdicts(arm: Any, rigid: Any, robots: Any) -> Iterator[Claim]:
    """What is said of each claim of the paper, and that it may be said."""
    found, plate = arm["claims"], arm["claims"]["plate"]["touch-up"]
    straight, drawn = rigid["claims"]["plate"]["touch-up"], robots["touch-up"]

    def percent(share: dict[str, float]) -> list[float]:
        return [100 * share[key] for key in ("share", "low", "high")]

    for figure, name in (("9: touch-up", "touch-up"), ("10: view line", "view line")):
        one = found["falls"][name]
        assert one["rho_low"] > 0.8
        yield (
            f"| Figure {figure}: small C_G, stable identification | reproduced | rank correlation "
            "# (# to #); of four sets at random the outer two are in order in # %, all four in # %",
            [
                one["rho_median"],
                one["rho_low"],
                one["rho_high"],
                *(100 * one[key] for key in ("four_ends_in_order", "four_in_order")),
            ],
        )
    for what, how in (("unweighted, as in the paper", ""), ("touch-up weighted", ", weighted")):
        rows = found[f"view line over touch-up{how}"]
        less, more = [r for r in rows if r["low"] > 1.0], [r for r in rows if r["high"] < 1.0]
        yield (
            f"| Figure 10: improved by touch-up, {what} | under conditions | view line over "
            "touch-up # at C_G = #; touch-up varies less from # up; more from # down (# at the "
            "end)",
            [rows[0]["ratio"], rows[0]["c_g"], less[-1]["c_g"], more[0]["c_g"], rows[-1]["ratio"]],
        )
    largest, smallest = (straight[f"ratio_at_{end}_c_g"] for end in ("largest", "smallest"))
    assert drawn["rho_low"] < 0.0
    assert smallest < 0.5 * largest
    yield (
        "| Figure 11: C_G is an adequate index of accuracy | only where the model is right | rank "
        "correlation # on the arm shown, # (# to #) over # arms; smallest C_G better than largest "
        "on # (# to #) %, best of all on # (# to #) %; rigid arm: after over before falls from # "
        "to #",
        [
            plate["rho"],
            drawn["rho_median"],
            drawn["rho_low"],
            drawn["rho_high"],
            robots["count"],
            *percent(drawn["smallest_beats_largest_c_g"]),
            *percent(drawn["smallest_c_g_is_best"]),
            largest,
            smallest,
        ],
    )
    half = drawn["rows"][-1]["below_half"]
    assert half["low"] < 0.5
    yield (
        "| Figure 11: below 1/2 with the smallest C_G | under conditions | arm shown: # there, # "
        "at best (D = # deg), below 1/2 with # of # sets; # (# to #) % of arms at the smallest "
        "C_G; rigid arm: #",
        [
            *(plate[k] for k in ("ratio_at_smallest_c_g", "best_ratio", "best_d_deg")),
            plate["sets_below_half"],
            plate["sets"],
            *percent(half),
            smallest,
        ],
    )


def peers_claims() -> Iterator[Claim]:
    """Study 15."""
    said = written(PEERS)
    assert not said["left_out"]
    closed = [r for r in said["times"] if r["ours"] == "ml" and not r["peer"].startswith("scipy")]
    sizes = min(r["size"] for r in closed), max(r["size"] for r in closed)
    few, many = ([r["ratio"] for r in closed if r["size"] == size] for size in sizes)
    rest = {row["peer"]: row["ratio"] for row in said["times"]}
    deep = {r["by"]: r for r in said["touch_ups"] if r["noise"].startswith("depth")}
    told = [row for row in said["pairs"] if row["setting"].endswith("on B")]
    best = {(r["setting"], r["pairs"]): r["X_mm"] for r in told if r["solver"] == "ours: ml"}
    over = [r["X_mm"] / best[r["setting"], r["pairs"]] for r in told if r["solver"].isupper()]
    yield (
        "**Answer.** At # pairs OpenCV's closed forms need # to # of the time of the likeliest X "
        "and Z, at # pairs # to # times as long; for ten parameters figaroh and pybotics need # "
        "and # times as long, for a choice of poses figaroh's cone programme # times.",
        [
            sizes[0],
            min(few),
            max(few),
            sizes[1],
            min(many),
            max(many),
            rest["figaroh"],
            rest["pybotics' arm, coordinates"],
            rest["figaroh: cone programme"],
        ],
    )
    yield "six times as uncertain they are # times as far off", [deep["figaroh"]["of_ours"]]
    yield "OpenCV's X is # to # times as far off", [min(over), max(over)]
    yield (
        "scipy ends where `ml` does, in all of # trials: X apart by # at most.",
        [said["optimum"]["trials"], said["optimum"]["largest_difference_of_X"]],
    )
    nearer = 100 * deep["figaroh"]["ours_nearer"]
    yield (
        "the weights matter: # mm against #, ours nearer in # % of trials.",
        [deep["ours"]["tool_error_mm"], deep["figaroh"]["tool_error_mm"], nearer],
    )
    kink = next(row for row in said["touch_ups"] if row["by"] == "pybotics, its distances")
    yield (
        "end # times as far off in the # trials with equal noise",
        [kink["of_ours"], kink["trials"]],
    )
    choice = {row["by"]: row for row in said["selection"]}
    every, heavy = (
        choice[f"figaroh: cone programme, {which}"] for which in ("all it keeps", "the heaviest")
    )
    again = [row for row in said["selection"] if row["different"] < row["poses"]]
    yield (
        "Ours has # of the bound with # different poses, and says so. figaroh's cone programme "
        "keeps # poses, of which the heaviest # come to #; its DetMax takes some poses twice (# "
        "and # different ones) and so comes to # and #, above ours.",
        [
            choice["ours: exchange"]["of_the_bound"],
            choice["ours: exchange"]["different"],
            every["poses"],
            heavy["poses"],
            heavy["of_the_bound"],
            *(row[key] for key in ("different", "of_the_bound") for row in again),
        ],
    )
    facts = said["facts"]
    yield (
        "Kinematics agree to # m (figaroh) and # m (pybotics) in 200 postures.",
        [facts["figaroh_apart_m"], facts["pybotics_apart_m"]],
    )
    yield "frees # parameters, the axes of an unknown", [len(facts["figaroh_own_parameters"])]
    kept = [word.split()[0] for word in facts["offset_that_cannot_be_told"]["figaroh"].values()]
    yield "figaroh's selection # the first and # the last; `identify` refuses both", kept


CLAIMS = {VISUAL: visual_claims, CALIBRATION: calibration_claims, PEERS: peers_claims}


@pytest.mark.parametrize("name", list(CLAIMS))
def test_claims_have_the_key_figures(name):
    text = folder_text(name)
    assert not [claim for claim in CLAIMS[name]() if found_in(text, *claim) is None]


@pytest.mark.parametrize("name", list(GIVEN))
def test_all_other_numbers_are_given(name):
    text = re.sub(r"```.*?```", "", folder_text(name), flags=re.S)
    text = re.sub(r"\]\(.*?\)", "]", text)  # addresses of links
    prose = "\n".join(line for line in text.splitlines() if not line.startswith("| "))
    for claim in CLAIMS[name]():
        prose = prose.replace(found_in(text, *claim) or "", "")
    toml = (STUDIES / name / "study.toml").read_text(encoding="utf-8")
    given = {abs(float(n)) for n in [*NUMBER.findall(toml), *GIVEN[name].split()]}
    found = [n for n in NUMBER.findall(prose) if abs(float(n)) not in given]
    assert not found
