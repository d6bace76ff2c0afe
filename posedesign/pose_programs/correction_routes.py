"""The ways to make a robot use what was identified, side by side: what error each leaves.

A controller takes zero offsets (mastering), a simulation or an offline programming system a
description (URDF), a program the commands of corrected poses. Each carries another part of the
errors. The values of each are those that are best for it over the task box, see
:mod:`calib.identification.prediction`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.errors import CalibError, InputError, RobotModelError, UnreachableError, near_names
from calib.identification import Carried, part_of
from calib.identification.prediction import ErrorToExpect, Expectation
from calib.model import CalibrationModel, Setup
from calib.model.parameters import AXES, ToolPoints
from calib.se3 import BoolArray, FloatArray
from posedesign.candidates.workplaces import HALF_WAY, drawn_workplace_of, workplace
from posedesign.cell import Cell, TaskBox
from posedesign.cell.cell import moved_as_base
from posedesign.cell.schema import TaskBoxSection
from posedesign.files.measurements import TOOL, read_measurements
from posedesign.identification.file import IdentifiedModel, read_file, read_identification
from posedesign.identification.models import model_of

OTHER_TOOL_M = 0.02
"""Distance of the identified tool point from the cell's beyond which it is another point: of a
reflector, say. No tool is known as badly as that."""

FRAME_ANEW = "the base placed anew, as by teaching the user frame again"

AS_IT_IS = "as it is"
MASTERING = "mastering"
DESCRIPTION = "description"
POSES = "corrected poses"

FILES = {
    POSES: "corrected_poses.csv",
    DESCRIPTION: "corrected.urdf",
    MASTERING: "mastering.csv",
    AS_IT_IS: "",
}
"""What carries each; two at once correct twice."""

NEAR = 1.02
"""Expected error over the least up to which a plainer way is put before another."""

_DIGITS = 9
"""Of a millimetre: what rounding leaves of a way that carries everything is nothing."""

DRAWN = 300
"""Postures by which the values of a route are chosen: more numbers than an error is told by."""

_DESCRIBED = "tool as described"


@dataclass(frozen=True, eq=False)
class CorrectedTool:
    """The point of the tool that is to stand where it should."""

    index: int  # of the tool in the model
    parameters: tuple[str, ...]  # names of those that place it; none where it is taken as described
    said: str
    """What is to be known of the choice; empty where it is the cell's own tool, as identified."""


@dataclass(frozen=True, eq=False)
class Route:
    """One way to use what was identified."""

    name: str
    values: Carried  # model, parameters and their covariance [SI]
    expected: ErrorToExpect  # over the task box
    tool_m: FloatArray  # (3,): the tool point that goes with it, in tip axes [m]


@dataclass(frozen=True, eq=False)
class Routes:
    """All ways, the best one first, and the arm as it is."""

    routes: tuple[Route, ...]
    where: str  # which box, in words
    tool: CorrectedTool

    def __getitem__(self, name: str) -> Route:
        return next(route for route in self.routes if route.name == name)

    @property
    def alike(self) -> tuple[str, ...]:
        """Names of the ways that leave as little as the best one, but for `NEAR`."""
        best, *others = (route.expected.rms_m for route in self.routes)
        most = NEAR * min(best, *others)
        return tuple(route.name for route in self.routes[1:] if route.expected.rms_m <= most)

    def rows(self) -> list[dict[str, object]]:
        """One row a route, in mm."""
        return [
            {
                "route": route.name,
                "file": FILES[route.name],
                "rms_mm": 1e3 * route.expected.rms_m,
                "worst_mm": 1e3 * route.expected.worst_m,
                "not_carried_mm": round(1e3 * route.expected.lost_rms_m, _DIGITS),
            }
            for route in self.routes
        ]

    def words(self, name: str) -> list[str]:
        """For the file of a route: which box its values are for, how good, and with which tool."""
        way, before = self[name].expected, self[AS_IT_IS].expected
        said = [
            f"for {self.where}: expected error of the tool point {1e3 * way.rms_m:.3g} mm rms, "
            f"{1e3 * way.worst_m:.3g} mm at the worst pose, as it is {1e3 * before.rms_m:.3g} mm "
            "rms"
        ]
        if name != POSES:
            said.append(FRAME_ANEW)
            if self.tool.parameters:
                said.append(f"it goes with the tool point {self.tool_words(name)}")
        return said

    def remarks(self) -> list[str]:
        """What is to be known of the table, in sentences."""
        said = [f"over {self.where}; {FRAME_ANEW}"]
        if self.tool.parameters:
            said.append("as it is: the arm as described, with the tool point that is best for it")
            said += [
                f"the tool point that goes with {way}: {self.tool_words(way)}"
                for way in (DESCRIPTION, MASTERING)
            ]
        return said

    def tool_words(self, name: str) -> str:
        """Where the tool point of a route is, in words."""
        place = ", ".join(f"{1e3 * v:.3f}" for v in self[name].tool_m)
        return f"({place}) mm in the axes of the tip"


def read_correcting(path: Path, cell: Cell, name: str | None) -> IdentifiedModel:
    """The model of an ``identification.json`` that says most of the arm, or the one that is named.

    Raises InputError: it says nothing of the arm.
    """
    identified = read_identification(path, cell, name, reference=True)
    if identified.model.nuisance.all():
        raise InputError(
            f"the model {identified.name!r:.60} places the set-up only: there is nothing of the "
            "arm to correct",
            hint="choose another one with `model`",
            name="model",
        )
    return identified


def corrected_tool(
    cell: Cell, identified: IdentifiedModel, name: str | None = None
) -> CorrectedTool:
    """The identified tool point that is the cell's tool, or the one that is named.

    Where there is none the point is the cell's as described, the last tool of the models that
    :func:`with_described_tool` returns.

    Raises InputError: a name that is none of the identification, or is of another point than the
    cell's tool.
    """
    model = identified.model
    places = {
        label: tool_place(model, identified.x, Setup.of(1, tool=k))
        for k, label in enumerate(model.tools)
    }
    if name is not None and name not in places:
        raise InputError(
            f"the identification has no tool point {name[:60]!r}",
            hint=near_names(name, places),
            name="tool",
        )
    listed = [name] if name is not None else [TOOL] if TOOL in places else list(places)
    fit = {label: _unfit(cell, model, label, places[label]) for label in listed}
    good = [label for label, why in fit.items() if not why]
    if len(good) == 1 and len(listed) == 1:
        chosen = good[0]
        stem = "tool." if chosen == TOOL else f"tool.{chosen}."
        own = tuple(n for n in model.names if n in {stem + axis for axis in "xyz"})
        said = "" if chosen == TOOL else f"the tool point {chosen!r} is taken for the cell's tool"
        return CorrectedTool(model.tools.index(chosen), own, said)
    if name is not None:
        raise InputError(f"{name!r} is not the cell's tool point: {fit[name]}", name="tool")
    if len(listed) == 1:
        shown = "" if listed == [TOOL] else f" {listed[0]!r}"
        why = f"the tool{shown} as identified is not the cell's: {fit[listed[0]]}"
    else:
        shown = ", ".join(map(repr, listed[:5])) + (", ..." if len(listed) > 5 else "")
        why = f"tool points were identified as {shown}: if the cell's is one, name it with `tool`"
    return CorrectedTool(
        len(model.tools),
        (),
        f"the tool point is taken as described, where only the arm errs: {why}",
    )


def tool_place(model: CalibrationModel, x: FloatArray, setup: Setup) -> FloatArray:
    """Position of the tool point of a set-up in the tip frame ``(3,)`` [m]."""
    view = model.view(np.zeros((1, model.robot.n)), x, setup)
    T = view.T_base_tip[0]
    return np.asarray(T[:3, :3].T @ (view.tool_points[0] - T[:3, 3]))


def _unfit(cell: Cell, model: CalibrationModel, label: str, place: FloatArray) -> str:
    """Why an identified tool is not the cell's; empty where it is."""
    stem = "tool." if label == TOOL else f"tool.{label}."
    if any(stem + "r" + axis in model.names for axis in "xyz"):
        return "a frame was measured in its place"
    far = float(np.linalg.norm(place - cell.tool_m))
    if far <= OTHER_TOOL_M:
        return ""
    numbers = ", ".join(f"{1e3 * v:.2f}" for v in place)
    return (
        f"it is {far * 1e3:.0f} mm off tool.point_mm (if it is the point to correct, set "
        f"tool.point_mm = [{numbers}] in the cell)"
    )


MEASURED = ("touchups.csv", "measurements.csv", "joined.csv")
"""Tables of measurements with their joints, beside an identification."""


def measured_postures(identification: Path) -> FloatArray | None:
    """Postures ``(N, n)`` [rad] that were identified from; None where no table of them is there."""
    content = read_file(identification)
    for name in (Path(content.data.file).name, MEASURED[-1]):
        path = identification.with_name(name) if name in MEASURED else identification
        if path == identification or not path.is_file():
            continue
        try:
            table = read_measurements(path, len(content.joints), external=content.external)
        except CalibError:  # it was changed since
            continue
        return table.data.postures
    return None


def working_postures(
    cell: Cell,
    box: TaskBox | None = None,
    measured: FloatArray | None = None,
    rng: np.random.Generator | None = None,
) -> tuple[FloatArray, str]:
    """Postures ``(K, n)`` [rad] at which the arm will work; in words.

    Those that plans and identifications are judged at, but more of them: values of a route are
    chosen by them. See :func:`~posedesign.candidates.workplaces.workplace`.

    ``box``: where the arm works; that of the cell by default. ``measured`` (N, n): postures [rad]
    that were identified from; any of the cell's pool by default. ``rng``: another source of chance
    than the usual one. Raises UnreachableError: the arm reaches next to nothing of the box.
    """
    words = "the box given"
    if box is not None:
        section = TaskBoxSection(
            lowest_mm=tuple((1e3 * box.lowest_m).tolist()),
            highest_mm=tuple((1e3 * box.highest_m).tolist()),
            steps=box.steps,
        )
        cell = replace(cell, config=cell.config.model_copy(update={"task_box": section}))
    try:
        if measured is not None:
            at = workplace(cell, measured, Setup.of(len(measured)), DRAWN, rng=rng)
        else:
            at = drawn_workplace_of(cell, DRAWN, rng=rng)
    except RobotModelError:  # an arm without solids is corrected all the same
        free = cell.config.constraints.model_copy(update={"collisions": False})
        cell = replace(cell, config=cell.config.model_copy(update={"constraints": free}))
        at = drawn_workplace_of(cell, DRAWN, rng=rng)
    if at.words == HALF_WAY and cell.config.task_box is not None:
        raise UnreachableError(
            "no point of the task box can be reached",
            hint="give a box in mm, in the base frame, in front of the arm: `box`",
            name="task_box",
        )
    return at.postures, (
        f"{at.words if box is None else words}, {len(at.postures)} postures with the tool turned "
        "as where it is measured"
    )


def routes_of(
    cell: Cell,
    known: IdentifiedModel,
    *,
    box: TaskBox | None = None,
    tool: str | None = None,
    used: IdentifiedModel | None = None,
    measured: FloatArray | None = None,
) -> Routes:
    """Compare the ways to use an identification over a task box.

    ``known``: what is known of the arm: errors are to be expected by it. ``box``: that of the cell
    by default. ``tool``: which identified tool point is the cell's tool. ``used``: a model of the
    same tools whose values are used as they are. By default those that are known are used, and are
    the best ones for each route. ``measured``: see :func:`working_postures`. Raises
    UnreachableError: no point of the box can be reached.
    InputError: a tool that the identification does not have.
    """
    point = corrected_tool(cell, used or known, tool)
    q, where = working_postures(cell, box, measured)
    expectation = Expectation(
        with_described_tool(cell, known.model),
        known.x,
        _covariance(known),
        q,
        Setup.of(len(q), tool=point.index),
        known.deviation,
    )
    own = used or known
    whole = Carried(with_described_tool(cell, own.model), own.x, _covariance(own))
    values = {POSES: whole}
    for name, names in _parameters(cell, own).items():
        model = with_described_tool(cell, model_of(cell, names))
        if used is not None and name != AS_IT_IS:
            values[name] = part_of(whole.model, whole.x, whole.covariance, model)
        else:
            values[name] = expectation.carried(model, _free(cell, model, point))
    setup = Setup.of(1, tool=point.index)
    routes = [
        Route(name, v, expectation.of(v.model, v.x), tool_place(v.model, v.x, setup))
        for name, v in values.items()
    ]
    return Routes(_best_first(routes), where, point)


def _best_first(routes: list[Route]) -> tuple[Route, ...]:
    """By expected error; of those that are about as good as the best, the plainest one first."""
    least = min(route.expected.rms_m for route in routes)
    plain = [AS_IT_IS, MASTERING, DESCRIPTION, POSES]

    def place(route: Route) -> tuple[float, int]:
        rms = route.expected.rms_m
        return (least if rms <= NEAR * least else rms), plain.index(route.name)

    return tuple(sorted(routes, key=place))


def _covariance(identified: IdentifiedModel) -> FloatArray:
    """Covariance ``(p, p)`` [SI]; where the file has none, of independent parameters."""
    if identified.covariance is not None:
        return identified.covariance
    return np.diag(np.nan_to_num(identified.sigma) ** 2)


def with_described_tool(cell: Cell, model: CalibrationModel) -> CalibrationModel:
    """The model with one more tool, the last: the cell's tool point as described, not free."""
    described = ToolPoints([cell.tool_m], [_DESCRIBED], "")
    return model.with_parameters([*model.parameters, described])


def _parameters(cell: Cell, identified: IdentifiedModel) -> dict[str, list[str]]:
    """Names of the parameters that each route has but for the corrected poses, which have all.

    Those of the set-up and those of the arm that were identified, and of every joint that the
    identification speaks of. The frame of the first joint is left as it is: to move it is to move
    the whole arm, as the base is when the user frame is taught again.
    """
    model, joints = identified.model, cell.robot.joint_names
    set_up = [n for n, placed in zip(model.names, model.nuisance, strict=True) if placed]
    arm = [n for n, placed in zip(model.names, model.nuisance, strict=True) if not placed]
    met = [j for j in joints[1:] if any(_is_of(name, j) for name in arm)]
    offsets = [f"zero_offset.{joint}" for joint in met]
    links = [f"link.{joint}.{axis}" for joint in met for axis in AXES]

    def carried(stems: tuple[str, ...], more: list[str]) -> list[str]:
        own = [name for name in arm if name.startswith(stems)]
        return [*dict.fromkeys([*own, *more]), *set_up]

    return {
        DESCRIPTION: carried(("zero_offset.", "link."), [*offsets, *links]),
        MASTERING: carried(("zero_offset.",), offsets),
        AS_IT_IS: set_up,
    }


def _is_of(name: str, joint: str) -> bool:
    """Whether a parameter of the arm is one of a joint: ``compliance.joint_2`` of ``joint_2``."""
    return f"{name.partition('.')[2]}.".startswith(f"{joint}.")


def _free(cell: Cell, model: CalibrationModel, tool: CorrectedTool) -> BoolArray:
    """Which parameters ``(p,)`` of a route can be chosen: of the arm, and the tool point."""
    first = cell.robot.joint_names[0]
    base = [f"zero_offset.{joint}" for joint in moved_as_base(cell.robot)]
    return np.array(
        [
            name in tool.parameters or (not placed and not _is_of(name, first) and name not in base)
            for name, placed in zip(model.names, model.nuisance, strict=True)
        ],
        dtype=bool,
    )
