"""What is done with an identification: corrected description, mastering, corrected poses.

=======================  ========================================================================
``corrected.urdf``       the robot with the joint frames that are best for a description
``mastering.csv``        ``pendant_joint, joint, correction_deg, sigma_deg, meaning,
                         shown_at_zero_deg``: the zero offsets that are best where nothing else is
                         corrected, and what the pendant shows where a joint really is at zero
``corrected_poses.csv``  as ``poses.csv``: the commands that bring the real tool point to where
                         the poses have it; x, y, z, W, P, R are the Cartesian points to command.
                         A pose that cannot be reached so is dropped, with the reason. The comment
                         ``corrected by`` says by which identification.
=======================  ========================================================================

Each says for which task box its values are the best, and what error to expect with it: see
:mod:`posedesign.pose_programs.correction_routes`.

Zero offsets as a controller wants them: in its own signs, with its own coupling of joints.

An offset is added to what the pendant shows to get where the joint is. It goes through the same
matrix as joint values do: FANUC's J3 is the angle of the forearm to the horizontal, ``J3 = q3 -
q2``, so that its offset is that of joint 3 less that of joint 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.correction import (
    Compensated,
    CorrectedRobot,
    compensate,
    corrected_robot,
    corrected_urdf,
)
from calib.errors import FileFormatError, InputError, near_names
from calib.identification import Carried, check_enough, part_of
from calib.identification.identifiability import check_identifiable_at
from calib.identification.prior_arms import PriorArms
from calib.model import CalibrationModel, Setup
from calib.model.measurements import Measurements
from calib.robots import Robot
from calib.se3 import BoolArray, FloatArray
from posedesign.cell import Cell, TaskBox
from posedesign.cell.cell import moved_as_base
from posedesign.cell.task_box import COLUMNS, BoxAccuracy, predict_box
from posedesign.files import Results, rehearsed, write_bytes_atomic, write_text_atomic
from posedesign.files.csv_tables import LONGEST_SHOWN, write_table
from posedesign.files.measurements import OWN_PAYLOAD, MeasurementTable
from posedesign.files.origin import checksum
from posedesign.identification.file import IdentifiedModel, read_identification
from posedesign.identification.models import Models, model_of
from posedesign.planning import check_not_hand_eye, check_plain, to_be_measured
from posedesign.planning.loop import arms_told_by
from posedesign.planning.poses_file import (
    CORRECTED_BY,
    STOPS_SHORT,
    DroppedPose,
    PoseList,
    read_poses,
    write_pose_list,
)
from posedesign.pose_programs.correction_routes import (
    AS_IT_IS,
    DESCRIPTION,
    FILES,
    MASTERING,
    NEAR,
    POSES,
    Routes,
    measured_postures,
    read_correcting,
    routes_of,
)
from posedesign.pose_programs.exports import EXPORTS, find_exports, zeroing_words

CORRECTION = tuple(
    (FILES[route], what)
    for route, what in (
        (DESCRIPTION, "corrected description"),
        (MASTERING, "mastering"),
        (POSES, "corrected poses"),
    )
)
PREDICTION = ("predicted_accuracy.csv", "predicted accuracy")

ONLY_ONE = (
    "use one of them: master the arm, or take the corrected poses, or plan with the corrected "
    "description; two together correct twice"
)

IDLE_RAD = 2e-5
"""Zero offset below which a joint of which the measurements say nothing is left as it is: about
what pendants show."""

WORTH = 0.9
"""Expected error of the best way over that of the arm as it is above which it is said that there is
next to nothing to gain."""


@dataclass(frozen=True, eq=False)
class Correction:
    """What was made of an identification."""

    identified: IdentifiedModel  # what is corrected by
    routes: Routes  # what error each way leaves
    robot: CorrectedRobot
    mastering: Mastering
    poses: PoseList | None
    compensated: Compensated | None  # commands for the poses
    notes: tuple[str, ...]
    files: tuple[Path, ...]
    rehearsed: str = ""
    """What is to be said first of what comes of a simulated robot; empty for a real one."""

    @property
    def ok(self) -> bool:
        """Whether every pose can be corrected."""
        return self.compensated is None or bool(self.compensated.ok.all())

    def verdict(self) -> str:
        """Which way is best and by how much, in a sentence."""
        best, before = self.routes.routes[0], self.routes[AS_IT_IS].expected.rms_m
        if best.name == AS_IT_IS:
            return "best: leave the arm as it is"
        if best.expected.rms_m > WORTH * before:
            return (
                "there is next to nothing to gain over the box: the best way leaves "
                f"{1e3 * best.expected.rms_m:.3g} mm, the arm as it is {1e3 * before:.3g} mm"
            )
        given = {POSES: f"{POSES} (give poses.csv to have them)"} if self.poses is None else {}
        named = f"best: {given.get(best.name, best.name)}"
        if alike := [given.get(name, name) for name in self.routes.alike]:
            return (
                f"{named}, the plainest of those that leave the same within {100 * (NEAR - 1):.0f} "
                f"%: so {'does' if len(alike) == 1 else 'do'} {' and '.join(alike)}"
            )
        second = self.routes.routes[1]
        times = second.expected.rms_m / best.expected.rms_m
        other = "the arm as it is" if second.name == AS_IT_IS else second.name
        return f"{named}, {times:.3g} times less error than {other}"


def correct(
    cell: Cell,
    cell_file: Path,
    identification: Path,
    out: Path | Results,
    *,
    poses: Path | None = None,
    name: str | None = None,
    tool: str | None = None,
    box: TaskBox | None = None,
    exports: Sequence[str] = (),
    again: bool = False,
    trust_units: bool = False,
) -> Correction:
    """Write corrected description, mastering and, of a pose list, corrected poses into a folder.

    ``cell_file``: where it was read from: its robot's URDF is named relative to it.
    ``identification``: an ``identification.json``. ``poses``: a ``poses.csv``. ``name``: of a model
    whose values are used as they are. By default they are the best ones for each way, by the
    reference of the identification. ``tool``: which tool point of the identification is that of the
    cell. ``box``: where the arm works; that of the cell by default. ``exports``: other forms of the
    corrected description that are wanted, keys of
    :data:`posedesign.pose_programs.exports.EXPORTS`. ``again``: correct poses that are corrected
    already. ``trust_units``: see
    :func:`posedesign.planning.poses_file.read_poses`. Raises FileFormatError: a file that cannot be
    used. InputError: a model that says nothing of the arm, a tool that the identification does not
    have. UnreachableError: no point of the box can be reached.
    """
    forms = find_exports(exports)
    wanted = CORRECTION if poses is not None else CORRECTION[:2]
    wanted += tuple((form.file, form.purpose) for form in forms)
    results = Results.of(out, "correct")
    claims = results.claim("computed", *wanted, inputs=[identification])
    by, identified = checksum(identification), read_correcting(identification, cell, name)
    known = identified if name is None else _judge(identification, cell, identified)
    routes = routes_of(
        cell,
        known,
        box=box,
        tool=tool,
        used=None if name is None else identified,
        measured=measured_postures(identification),
    )
    description, zeros, whole = (routes[r].values for r in (DESCRIPTION, MASTERING, POSES))
    zeros = _without_idle(cell, identified, zeros)
    robot = corrected_robot(description.model, description.x)
    robot = replace(robot, left_out=corrected_robot(whole.model, whole.x).left_out)
    table = mastering(
        zeros.model,
        zeros.x,
        None if identified.covariance is None else zeros.covariance,
        np.sqrt(np.diag(zeros.covariance)),
    )
    notes = _notes(identified, known, robot, table)
    if cell.config.payload and any(name.startswith(_GIVES_WAY) for name in known.model.names):
        notes.insert(0, "the expected error is with the tool alone: no [[payload]] is in it")
    listed, compensated = None, None
    if poses is not None:
        listed = read_poses(
            poses,
            cell.robot.n,
            external=cell.robot.external,
            controller=cell.robot.controller,
            trust_units=trust_units,
        )
        if listed.corrected and not again:
            raise InputError(
                f"{poses}: {listed.corrected}",
                hint="give the poses as planned; or say that they are to be corrected `again`",
                name="again",
            )
        notes += [f"{poses}: {listed.misfit}"] if listed.misfit else []
        loads = _payloads(cell, poses, listed)
        compensated = compensate(
            whole.model,
            whole.x,
            postures=listed.postures,
            setup=Setup.of(len(listed.names), tool=routes.tool.index, payload=loads),
        )
    warned = rehearsed([identification])
    section, folder = cell.config.robot, cell_file.parent
    text = corrected_urdf(
        robot,
        None if section.urdf is None else folder / section.urdf,
        [folder / name for name in section.packages],
        section.xacro_args,
        said=routes.words(DESCRIPTION),
    )
    heads = {way: [*([warned] if warned else []), *routes.words(way)] for way in FILES}
    texts = [form.text(robot.robot, heads[DESCRIPTION]) for form in forms]
    files = [write_bytes_atomic(claims[0], text)]
    heads[MASTERING].append(zeroing_words(cell.robot))
    rows = table.rows()
    files.append(write_table(claims[1], list(rows[0]), rows, heads[MASTERING]))
    if poses is not None and listed is not None and compensated is not None:
        corrected = _corrected_list(cell, listed, compensated, by, heads[POSES])
        files.append(write_pose_list(claims[2], corrected, cell.robot, cell.tool_m))
    for claim, content in zip(claims[len(claims) - len(forms) :], texts, strict=True):
        files.append(write_text_atomic(claim, content))
    known_files = (*CORRECTION, *((form.file, form.purpose) for form in EXPORTS.values()))
    results.remove(*(entry for entry in known_files if entry not in wanted))
    return Correction(
        identified, routes, robot, table, listed, compensated, tuple(notes), tuple(files), warned
    )


def _judge(path: Path, cell: Cell, named: IdentifiedModel) -> IdentifiedModel:
    """The model that says what errors to expect with one that was named; else this itself."""
    try:
        found = read_identification(path, cell, reference=True)
    except FileFormatError:
        return named
    fit = found.model.tools == named.model.tools and not found.model.nuisance.all()
    return found if fit else named


def _without_idle(cell: Cell, identified: IdentifiedModel, zeros: Carried) -> Carried:
    """Zero offsets without those of joints that were not identified and have nothing to take up.

    Those of what slides move the base, and that of the first joint may turn it.
    """
    model, base = zeros.model, [f"zero_offset.{name}" for name in moved_as_base(cell.robot)]
    told = {*identified.model.names} - {*identified.held}
    kept = [
        name
        for name, value in zip(model.names, zeros.x, strict=True)
        if name in told or (name not in base and abs(value) > IDLE_RAD)
    ]
    return part_of(model, zeros.x, zeros.covariance, model_of(cell, kept))


def _notes(
    identified: IdentifiedModel, known: IdentifiedModel, robot: CorrectedRobot, table: Mastering
) -> list[str]:
    fixed = known is not identified
    took = "" if fixed else ", but for what other values take up of it over the box"
    notes = []
    if robot.left_out:
        kinds = ", ".join(said.partition(" (")[0] for said in robot.left_out)
        notes.append(f"neither mastering nor a description can hold: {kinds}{took}")
    if any(name.startswith("link.") for name in identified.model.names):
        notes.append(
            f"links were identified, too: mastering corrects the zeros of joints alone{took}"
        )
    if robot.robot.n_external and table.identified[0]:
        notes.append(
            f"an arm that stands turned {'on' if robot.robot.external.slides else 'beside'} "
            f"{robot.robot.joint_names[robot.robot.n_external - 1]} looks like a zero of "
            f"{robot.robot.arm_joints[0]} that is off: its correction has both"
        )
    carrying = [
        name
        for name in identified.model.names
        if name.removeprefix(_STEM) in robot.robot.joint_names[: robot.robot.floor]
    ]
    if carrying:
        joints = ", ".join(name.removeprefix(_STEM) for name in carrying)
        notes.append(
            f"mastering is of the arm: the zero of {joints} is in the corrected URDF and poses, "
            "and in the identification's file"
        )
    if known.covariance is None:
        notes.append("the file has no correlations: expected errors take all as independent")
    if table.bounded and table.identified.any():
        notes.append("the file has no correlations: sigmas of coupled joints are upper bounds")
    if any(block.targets and block.size for block in identified.model.parameters):
        notes.append("positions are in the base frame as the targets were found in it")
    return [*notes, ONLY_ONE]


def _payloads(cell: Cell, path: Path, listed: PoseList) -> list[int]:
    """Which of the cell's payloads the arm carries at each stop; the tool alone is the first."""
    known = [OWN_PAYLOAD, *(load.name for load in cell.config.payload)]
    carried = [said.get("payload", OWN_PAYLOAD) for said in listed.labels]
    strange = next((name for name in carried if name not in known), None)
    if strange is not None:
        raise InputError(
            f"{path}: the cell has no payload {strange[:LONGEST_SHOWN]!r}",
            hint=near_names(strange, known[1:]) if known[1:] else "list it as [[payload]]",
            name="payload",
        )
    return [known.index(name) for name in carried]


def _corrected_list(
    cell: Cell, listed: PoseList, found: Compensated, by: str, said: Sequence[str]
) -> PoseList:
    """The list with the commands in place of the postures; what cannot be corrected is dropped.

    ``by``: the identification that it is corrected by. ``said``: comments before all others.
    """
    turned = np.abs(np.rad2deg(found.change[:, cell.robot.n_external :])).max(axis=1)
    kept, lost = np.flatnonzero(found.ok), np.flatnonzero(~found.ok)
    words = [f"corrected by up to {most:.4f} deg in a joint" for most in turned]
    reasons = [
        was if via and was else now
        for was, now, via in zip(listed.reasons, words, listed.via, strict=True)
    ]
    title = f"posedesign: corrected poses of {cell.robot.name}"
    comments = [*said, title, f"{CORRECTED_BY}: {by}"]
    comments += [c for c in listed.comments if c.startswith((STOPS_SHORT, "controller:"))]
    dropped = [
        DroppedPose(
            listed.names[i],
            f"not corrected: {found.status[i]}: {found.reasons[i]}",
            {column: cells[i] for column, cells in listed.extra.items()},
        )
        for i in lost
    ]
    whole = replace(listed, postures=found.postures, reasons=tuple(reasons))
    return replace(
        whole.some(kept.tolist()),
        dropped=(*dropped, *listed.dropped),
        comments=tuple(comments),
    )


def predict(
    cell: Cell, poses: PoseList, box: TaskBox, out: Path | Results, name: str | None = None
) -> BoxAccuracy:
    """Predict the error of the tool point over a box that a pose list will leave.

    Of the arm that is fitted to its poses, or of one of the cell's ``parameters.models`` by name:
    what the poses do not tell of it is left out, as in the identification.

    Writes ``predicted_accuracy.csv``: ``x_mm, y_mm, z_mm, sigma_x_mm, sigma_y_mm, sigma_z_mm,
    worst_sigma_mm, rms_mm, rms_to_target_mm, reason``.

    Raises InputError, NotIdentifiableError: the poses do not identify the parameters, or the cell
    asks for no such model. UnreachableError: no point of the box can be reached.
    """
    (file,) = Results.of(out, "predict").claim("computed", PREDICTION)
    check_not_hand_eye(cell, "a prediction over a box")
    q, which = poses.measured.postures, cell.which(poses.measured.labels)
    arms = arms_told_by(cell, q, which)
    data = to_be_measured(cell, arms.model, q, which)
    if name is not None:
        check_plain(cell, "a prediction of a model by its name")
        arms = PriorArms(_listed_model(cell, data, name))
    check_enough(arms.model, data)
    check_identifiable_at(arms.model, data, arms.model.nominal)
    setup = cell.setup(arms.model, q, which)
    found = predict_box(cell, arms, arms.blocks(arms.model.linearise(q, setup=setup)), box)
    write_table(file, [*COLUMNS, "reason"], found.rows())
    return found


def _listed_model(cell: Cell, data: Measurements, name: str) -> CalibrationModel:
    """A model of ``parameters.models``, less what touch-ups do not tell."""
    table = MeasurementTable(data, (cell.config.measurement.kind,), tuple(range(data.count)))
    tried = Models(cell, table).candidates(before_measuring=True)
    known = {candidate.name: candidate.model for candidate in tried}
    if name not in known:
        raise InputError(
            f"the cell asks for no model {name[:60]!r}", hint=near_names(name, known), name="model"
        )
    return known[name]


def box_of(cell: Cell, text: str | None, steps: str | None) -> TaskBox:
    """The box of a command line, or that of the cell.

    Raises InputError: there is none, or it is no box.
    """
    section = cell.config.task_box
    if text is None and section is None:
        raise InputError(
            "there is no task box",
            hint='give `box` "x1,y1,z1,x2,y2,z2" in mm, or a section [task_box] in the cell',
            name="box",
        )
    counts = (3, 3, 3) if section is None else section.steps
    if steps is not None:
        words = steps.split(",")
        if len(words) != 3 or not all(w.strip().isascii() and w.strip().isdigit() for w in words):
            raise InputError(
                f"the steps {steps[:60]!r} are not three whole numbers",
                hint='give points along x, y and z: "3,3,3"',
                name="steps",
            )
        counts = (int(words[0][:9]), int(words[1][:9]), int(words[2][:9]))
    if text is not None or section is None:
        return TaskBox.of_text(text or "", counts)
    lowest, highest = np.array(section.lowest_mm) / 1e3, np.array(section.highest_mm) / 1e3
    return TaskBox(lowest, highest, counts)


_STEM = "zero_offset."
_GIVES_WAY = ("compliance.", "bearing.")


@dataclass(frozen=True, eq=False)
class Mastering:
    """Corrections of the zero points of the arm's joints, as the robot's pendant shows them."""

    robot: Robot
    correction: FloatArray
    """(n,): to be added to what the pendant shows to get where each joint is [rad, m]."""
    sigma: FloatArray  # (n,): standard deviation of each [rad, m]; NaN where it is not known
    identified: BoolArray
    """(n,): whether a joint's own zero offset was identified. Others count as none: target or tool
    take it up, or it was not asked for."""
    bounded: bool = False
    """Correlations were not known: where several offsets make one correction, its standard
    deviation is the largest that is possible."""

    def rows(self) -> list[dict[str, object]]:
        """One row a joint of the pendant, in degrees; of an arm with slides in mm, too."""
        units = ["deg", "mm"] if "mm" in self._units else ["deg"]
        found = []
        for j, name in enumerate(self.robot.arm_joints):
            row: dict[str, object] = {"pendant_joint": f"J{j + 1}", "joint": name}
            told = self._is_corrected(j) and np.isfinite(self.sigma[j])
            values = {
                "correction": self._shown(j),
                "sigma": float(self._per_unit[j] * self.sigma[j]) if told else None,
                "shown_at_zero": -self._shown(j) + 0.0,
            }
            for key, value in values.items():
                if key == "shown_at_zero":
                    row["meaning"] = self._meaning(j)
                row |= {f"{key}_{u}": value if u == self._units[j] else None for u in units}
            found.append(row)
        return found

    @property
    def _units(self) -> tuple[str, ...]:
        return self.robot.joint_units[self.robot.n_external :]

    @property
    def _per_unit(self) -> FloatArray:
        return self.robot.per_unit[self.robot.n_external :]

    def _shown(self, j: int) -> float:
        """Correction of a joint [deg, mm]."""
        return float(self._per_unit[j] * self.correction[j])

    def _is_corrected(self, j: int) -> bool:
        """Whether any offset that was identified has a part in a joint of the pendant."""
        return bool(self.identified[pendant_from_joints(self.robot)[j] != 0].any())

    def _meaning(self, j: int) -> str:
        """In one sentence."""
        matrix = pendant_from_joints(self.robot)
        others = [k for k in np.flatnonzero(matrix[j]) if k != j]
        shown = f"what the pendant shows as J{j + 1}"
        if self.robot.controller is None:
            shown = f"the value of {self.robot.arm_joints[j]}, in the signs of the description"
        if not self._is_corrected(j):
            return f"J{j + 1} was not identified: its zero is taken as it is"
        text = f"add {self._shown(j):+.4f} {self._units[j]} to {shown} to get where the joint is"
        parts = []
        for k in others:
            share = matrix[j, k] * matrix[k, k]  # both in the signs of the pendant
            times = "" if abs(share) == 1.0 else f"{abs(share):g} of "
            parts.append(f"{'less' if share < 0 else 'plus'} {times}the offset of J{k + 1}")
        if parts:
            text += f": its own offset {' and '.join(parts)}"
        if not self.identified[j]:
            text += " (its own was not identified and counts as none)"
        return text


def pendant_from_joints(robot: Robot) -> FloatArray:
    """Values on the pendant ``(n, n)`` of joints that turn, as described; the same if not known."""
    if robot.controller is None:
        return np.eye(len(robot.arm_joints))
    return robot.controller.pendant_from_joints[robot.n_external :, robot.n_external :]


def mastering(
    model: CalibrationModel,
    x: FloatArray,
    covariance: FloatArray | None = None,
    sigma: FloatArray | None = None,
) -> Mastering:
    """Corrections of the zero points from what was identified.

    ``x`` (p,): identified parameters [SI]. ``covariance`` (p, p): [SI]. ``sigma`` (p,): standard
    deviations [SI], where correlations are not known.
    """
    robot = model.robot
    names = [f"{_STEM}{joint}" for joint in robot.arm_joints]
    places = [model.names.index(name) if name in model.names else -1 for name in names]
    identified = np.array(places) >= 0
    at = np.array(places)[identified]
    matrix = pendant_from_joints(robot)
    through = matrix[:, identified]
    spread = np.full(len(names), np.nan)
    if covariance is not None:
        spread = np.sqrt(np.einsum("ji,ik,jk->j", through, covariance[np.ix_(at, at)], through))
    elif sigma is not None:
        spread = np.abs(through) @ sigma[at]
    return Mastering(robot, through @ x[at], spread, identified, bounded=covariance is None)
