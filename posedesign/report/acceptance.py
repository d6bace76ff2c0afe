"""What an acceptance test and a recheck answer: passed or not, the same or not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from posedesign.acceptance.drift import FALSE_ALARM, POWER, Explanation, Recheck
from posedesign.acceptance.file import AcceptanceFile, Arm, Interval, Rule
from posedesign.acceptance.judge import ONE_POINT_M
from posedesign.acceptance.places import ISO, sampled_words
from posedesign.report import figures
from posedesign.report.answer import EXPECTED_ERROR, Answer, Table
from posedesign.report.drawing import BLUE, GREY, VERMILION, log_y

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calib.se3 import FloatArray
    from posedesign.acceptance.places import AcceptancePlan
    from posedesign.acceptance.recheck import RecheckPlan
    from posedesign.cell import Cell

ISO_PAIR = {"P02", "P04"}
"""Poses between which ISO 9283 has distances measured (7.3.1)."""

_FITTED = "fitted"

ONE_POINT_MM = 1e3 * ONE_POINT_M


def answer_of_acceptance_plan(
    cell: Cell, plan: AcceptancePlan, files: Sequence[str] = ()
) -> Answer:
    """The answer of a planned test: what passing it will prove, and the chance of that."""
    asked = plan.request
    count = len(plan.poses.kept)
    if asked.test == ISO:
        how = f"{count} poses, {asked.times} cycles"
    else:
        how = f"{count} {plan.sampled}, at most {asked.allowed} of them beyond the limit"
        how += f", {asked.times} cycles" * (asked.times > 1)
    chance = "not known: give the identification"
    if np.isfinite(plan.chance):
        chance = (
            f"{100 * plan.chance:.0f} %, with {1e3 * plan.expected_m:.3g} mm rms to expect at "
            "these poses by the identification and the noise"
        )
    return Answer(
        f"the test, where it is passed, proves: {plan.statement}",
        {
            "poses": how,
            "not proven": _not_proven(
                plan.elsewhere,
                1e3 * plan.expected_elsewhere_m if np.isfinite(plan.expected_elsewhere_m) else None,
            ),
            "chance to pass": chance,
            "where": plan.where,
            "time": f"{plan.route.timing}" + f", times {asked.times} cycles" * (asked.times > 1),
        },
        warnings=cell.doubts,
        not_checked=cell.not_checked,
        notes=plan.notes,
        files=files,
    )


def _not_proven(elsewhere: str, expected_mm: float | None) -> str:
    """The places that a passed test says nothing of, and the error to expect there, in words."""
    if not elsewhere:
        return ""
    said = elsewhere
    if expected_mm is not None:
        said += (
            f"; {EXPECTED_ERROR} where the arm will work, by the identification: "
            f"{expected_mm:.3g} mm rms"
        )
    return said


def _sampled(found: AcceptanceFile) -> str:
    """The poses that were judged, in words."""
    if not found.rule.touched and found.rule.test != ISO and _spread_mm(found).max() < ONE_POINT_MM:
        return "orientations of the tool at one point"  # of a rule that does not name the target
    return sampled_words(found.rule.touched)


def _such(found: AcceptanceFile) -> str:
    """Word before the verb where not places, but poses at some points, were sampled."""
    return "" if _sampled(found) == "places" else "such poses "


def _spread_mm(found: AcceptanceFile) -> FloatArray:
    """Extent of the places along x, y and z ``(3,)`` [mm]."""
    return np.asarray(np.ptp(np.array(found.places_mm), axis=0))


def answer_of_verdict(found: AcceptanceFile, files: Sequence[str] = ()) -> Answer:
    """The answer of a test: passed or not, and the figures of before and after."""
    rule, arm = found.rule, found.final
    said = "passed" if found.passed else "NOT passed"
    worst = f"the largest error is {arm.worst_mm:.3g} mm, the limit {rule.limit_mm:.4g} mm"
    if rule.test == ISO:
        what = "AP" if arm.poses else "AD"
        proof = f"{what} of ISO 9283 of the arm {arm.arm}: {worst}"
    else:
        count = len(found.poses) + len(found.missing)
        proof = (
            f"{count - arm.beyond} of {count} {_sampled(found)} within {rule.limit_mm:.4g} mm by "
            f"the arm {arm.arm}: at least {100 * arm.proven:.1f} % of all {_such(found)}are, with "
            f"confidence {100 * rule.confidence:g} %; {worst}"
        )
    warnings = []
    if found.missing:
        listed = ", ".join(found.missing[:3]) + " ..." * (len(found.missing) > 3)
        warnings.append(
            f"{len(found.missing)} poses of the test were not measured, and count as beyond the "
            f"limit: {listed}"
        )
    few = min((row.cycles for row in arm.poses), default=rule.cycles)
    if few < rule.cycles:
        warnings.append(f"{few} cycles were measured where the test has {rule.cycles}")
    beyond = [r.pose for r in arm.poses if rule.test == ISO and (r.ap_mm[2] or 0) > rule.limit_mm]
    if found.passed and beyond:
        warnings.append(
            f"the interval of AP goes beyond the limit at {', '.join(beyond)}: that is kept, and "
            "not proven"
        )
    notes = list(found.notes)
    if rule.test == ISO and found.frame.startswith(_FITTED):
        # a frame has six numbers, the foot of distances three
        taken, of = (6, 3 * len(found.poses)) if arm.poses else (3, len(found.poses))
        notes.append(
            f"the frame of the instrument takes {taken} of the {of} coordinates of these poses up: "
            "in a frame that is known errors are larger"
        )
    return Answer(
        f"{said}: {proof}",
        {
            "not proven": _not_proven(
                rule.elsewhere or ("other places" if _sampled(found) != "places" else ""),
                rule.expected_elsewhere_mm,
            ),
            "error": "; ".join(
                f"{each.arm} {_interval(each.rms_mm)} mm rms" for each in found.arms
            ),
            **_characteristics(arm, iso=rule.test == ISO),
            "where": rule.where,
            "frame": found.frame,
        },
        warnings=warnings,
        notes=notes,
        tables=[table for each in found.arms for table in _tables(each)],
        files=files,
    )


def _characteristics(arm: Arm, *, iso: bool) -> dict[str, str]:
    """The largest AP, RP, AD and RD."""
    said: dict[str, str] = {}
    repeated = [row for row in arm.poses if row.rp_mm[0] is not None]
    if iso and arm.poses:
        worst = max(arm.poses, key=lambda row: row.ap_mm[0] or 0.0)
        said["AP"] = f"{_interval(worst.ap_mm)} mm at {worst.pose}, the largest"
    if repeated:
        worst = max(repeated, key=lambda row: row.rp_mm[0] or 0.0)
        said["RP"] = f"{_interval(worst.rp_mm)} mm at {worst.pose}, the largest"
    if not arm.distances:
        return said
    pair = next(
        (row for row in arm.distances if iso and {row.first, row.second} == ISO_PAIR),
        max(arm.distances, key=lambda row: abs(row.ad_mm[0] or 0.0)),
    )
    which = f"between {pair.first} and {pair.second}, {pair.commanded_mm:.1f} mm apart"
    said["AD"] = f"{_interval(pair.ad_mm)} mm {which}"
    if pair.rd_mm[0] is not None:
        said["RD"] = f"{_interval(pair.rd_mm)} mm {which}"
    return said


def _interval(figure: Interval) -> str:
    value, low, high = figure
    ends = "" if low is None or high is None else f" ({low:.3g} to {high:.3g})"
    return f"{value or 0.0:.3g}{ends}"


MOST_DISTANCES = 20
"""Rows of a table of distances: those with the largest AD are shown."""


def _tables(arm: Arm) -> list[Table]:
    rows: list[dict[str, object]] = []
    for row in arm.poses:
        shown: dict[str, object] = {"pose": row.pose, "cycles": row.cycles}
        for name, ends in (("AP", row.ap_mm), ("RP", row.rp_mm)):
            shown |= dict(zip((name, f"{name} from", f"{name} to"), ends, strict=True))
        shown |= dict(zip(("AP_x", "AP_y", "AP_z"), row.deviation_mm, strict=True))
        if row.ap_deg is not None:
            shown |= dict(zip(("AP_a [deg]", "AP_b [deg]", "AP_c [deg]"), row.ap_deg, strict=True))
            names = ("RP_a [deg]", "RP_b [deg]", "RP_c [deg]")
            shown |= dict(zip(names, (each[0] for each in row.rp_deg), strict=True))
        rows.append(shown)
    worst = sorted(arm.distances, key=lambda row: -abs(row.ad_mm[0] or 0.0))[:MOST_DISTANCES]
    apart: list[dict[str, object]] = [
        {"from": row.first, "to": row.second, "commanded": row.commanded_mm, "cycles": row.cycles}
        | dict(zip(("AD", "AD from", "AD to"), row.ad_mm, strict=True))
        | dict(zip(("RD", "RD from", "RD to"), row.rd_mm, strict=True))
        for row in worst
    ]
    return [
        Table(f"Poses by ISO 9283 [mm], arm {arm.arm}", rows),
        Table(f"Distances by ISO 9283 [mm], arm {arm.arm}", apart),
    ]


def figure_of_acceptance(found: AcceptanceFile) -> Figure:
    """Error at each pose of a test, before and after, with the limit.

    Over x, y and z, as far as places differ there. Of poses at a single point: the share of them
    that is within an error.
    """
    figure = figures.new_figure(3.6)
    spread = [k for k in range(3) if _spread_mm(found)[k] >= ONE_POINT_MM]
    styles = ((GREY, "x"), (BLUE, "o"))[-len(found.arms) :]
    if found.rule.touched or not spread:
        panels = _shares(figure, found, styles)
    else:
        panels = _over_places(figure, found, styles, spread)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=3, fontsize=8, frameon=False)
    figure.supxlabel(_sampled_in_figure(found), fontsize=8)
    return figure


Styles = Sequence[tuple[str, str]]
"""Colour and mark of each arm."""


def _sampled_in_figure(found: AcceptanceFile) -> str:
    """What was sampled, and that nothing is said of the rest, for a figure."""
    count = len(found.poses)
    of_iso = found.rule.test == ISO
    said = f"{count} poses of ISO 9283" if of_iso else f"{count} {_sampled(found)}"
    return said if said.endswith(" places") else f"{said}; nothing is proven of other places"


def _over_places(
    figure: Figure, found: AcceptanceFile, styles: Styles, axes: Sequence[int]
) -> list[Axes]:
    panels, places = figures.panels_of(figure, len(axes)), np.array(found.places_mm)
    for panel, k in zip(panels, axes, strict=True):
        for arm, (colour, mark) in zip(found.arms, styles, strict=True):
            panel.plot(
                places[:, k], np.maximum(arm.errors_mm, 1e-6), mark, ms=4, color=colour,
                mfc="none", label=_arm_label(arm),
            )  # fmt: skip
        panel.axhline(
            found.rule.limit_mm, color=VERMILION, lw=1.2, ls="--", label=_limit_label(found)
        )
        first = panel is panels[0]
        log_y(panel, "error [mm]" if first else "")
        panel.set_xlabel(f"{'xyz'[k]} [mm]")
        if not first:
            panel.sharey(panels[0])
            panel.tick_params(labelleft=False, which="both")
    return panels


def _shares(figure: Figure, found: AcceptanceFile, styles: Styles) -> list[Axes]:
    panels = figures.panels_of(figure)
    for arm, (colour, mark) in zip(found.arms, styles, strict=True):
        errors = np.sort(np.maximum(arm.errors_mm, 1e-6))
        share = 100.0 * np.arange(1, len(errors) + 1) / len(errors)
        panels[0].plot(errors, share, mark, ms=4, color=colour, mfc="none", label=_arm_label(arm))
    panels[0].axvline(
        found.rule.limit_mm, color=VERMILION, lw=1.2, ls="--", label=_limit_label(found)
    )
    panels[0].set_xscale("log")
    panels[0].set_xlabel("error [mm]")
    panels[0].set_ylabel("share of poses within it [%]")
    return panels


def _arm_label(arm: Arm) -> str:
    return f"{arm.arm}: {arm.rms_mm[0] or 0.0:.3g} mm rms"


def _limit_label(found: AcceptanceFile) -> str:
    return f"limit {found.rule.limit_mm:.4g} mm"


def answer_of_recheck_plan(cell: Cell, plan: RecheckPlan, files: Sequence[str] = ()) -> Answer:
    """The answer of a planned recheck: which changes it will find."""
    smallest = plan.smallest()
    zeros = {c.name: smallest[c.name] for c in plan.watch.causes if c.unit == "rad"}
    told = {name: value for name, value in zeros.items() if name not in plan.blind}
    weakest = max(told, key=lambda name: told[name])
    rows: list[dict[str, object]] = [
        {
            "cause": cause.name,
            "smallest change found": _smallest_shown(cause.unit, smallest[cause.name]),
        }
        for cause in plan.watch.causes
    ]
    others = "; ".join(f"{k} poses {np.rad2deg(v):.3g} deg" for k, v in plan.by_count.items())
    first = next((c for c in plan.watch.causes if c.name == "the tool"), None)
    return Answer(
        f"{len(plan.poses.kept)} poses find any zero that has moved by "
        f"{np.rad2deg(told[weakest]):.3g} deg ({weakest} is the hardest) with a chance of "
        f"{100 * POWER:.0f} %, at {100 * FALSE_ALARM:.0f} % of false alarms in all",
        {
            "zeros": "; ".join(
                [f"{name} {np.rad2deg(v):.2g} deg" for name, v in told.items()]
                + [
                    f"{c.name} {_smallest_shown(c.unit, smallest[c.name])}"
                    for c in plan.watch.causes
                    if c.unit == "m" and c.name.startswith("zero of ")
                ]
            ),
            "tool": "" if first is None else f"a shift of {1e3 * smallest[first.name]:.2g} mm",
            "by number": others,
            "time": plan.route.timing.removeprefix("predicted cycle time "),
        },
        warnings=cell.doubts
        + [f"nothing at these poses tells a change of the {name}" for name in plan.blind],
        not_checked=cell.not_checked,
        tables=[Table("Smallest change found with a chance of 90 %", rows)],
        files=files,
    )


def _smallest_shown(unit: str, value: float) -> str:
    if not np.isfinite(value):
        return "none is found"
    return f"{np.rad2deg(value):.3g} deg" if unit == "rad" else f"{1e3 * value:.3g} mm"


def answer_of_recheck(found: Recheck, files: Sequence[str] = ()) -> Answer:
    """The answer of a recheck: still the same or not, and what has moved."""
    square = f"sum of squares {found.square:.1f} with {found.freedom} degrees of freedom"
    chance = f"p = {found.p_value:.2g}" if found.p_value >= 1e-12 else "p < 1e-12"
    if found.same:
        return Answer(
            f"still the same robot, as far as these poses tell ({chance})",
            {"test": square},
            files=files,
        )
    moved, also = "no single cause explains it: identify again", ""
    if found.possible:
        best, *others = found.possible
        moved = f"{best.cause}, by {_change(best)}"
        also = "; ".join(f"{other.cause} by {_change(other)}" for other in others)
    return Answer(
        f"NOT the same robot ({chance})",
        {"likeliest single cause": moved, "not told apart from it": also, "test": square},
        tables=[Table("What a single cause would explain", [_row(e) for e in found.explanations])],
        files=files,
    )


def _change(found: Explanation) -> str:
    """A change with its 95 % interval, of a shift along each axis."""
    factor, unit = (np.rad2deg(1.0), "deg") if found.unit == "rad" else (1e3, "mm")
    parts = [
        f"{factor * value:.3g} ({factor * (value - 1.96 * sigma):.3g} to "
        f"{factor * (value + 1.96 * sigma):.3g})"
        for value, sigma in zip(found.change[:3], found.sigma[:3], strict=True)
    ]
    turns = found.change[3:]
    turned = f", turned by {np.rad2deg(np.linalg.norm(turns)):.3g} deg" if len(turns) else ""
    return f"{', '.join(parts)} {unit}{turned}"


def _row(found: Explanation) -> dict[str, object]:
    return {
        "cause": found.cause,
        "change": _change(found),
        "sum of squares left": found.left,
        "p of what is left": found.p_left,
    }


def rule_lines(rule: Rule) -> list[str]:
    """A planned test in words, for a page."""
    chance = "" if rule.chance is None else f"; chance to pass {100 * rule.chance:.0f} %"
    return [f"planned: {rule.statement}{chance}", f"{rule.where}; {rule.cycles} cycle(s)"]
