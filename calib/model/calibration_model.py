"""The calibration model: from postures and parameters to what is measured, and its derivative.

Everything else stands on the blocks that it gives: indices, planning, identification, covariance
and Monte Carlo all take ``(N, m, p)`` and see no robot.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from calib.batch_last import cross, product, turn
from calib.errors import InputError, check_type, near_names
from calib.model.context import NO_TURN, ArmErrors, Feature, MeasurementContext, Setup
from calib.model.deviation import SharedDeviation
from calib.model.measurements import Measurement, Measurements
from calib.model.parameters import Frames, ParameterBlock, Unit
from calib.robots import Robot
from calib.se3 import FloatArray, IntArray, numbers, transform


class CalibrationModel:
    """A robot, the parameters to identify, and how it is measured.

    Parameters
    ----------
    parameters : sequence of ParameterBlock
        At least one puts something on the tool, and one a target around the arm.
    measurement : Measurement or sequence of them
        The kinds of measurement that may be mixed in one set of data.
    distances : sequence of KnownDistance
        What is known besides the measurements.

    Attributes
    ----------
    names : tuple of str
        Of the p parameters, in the order of the columns.
    units : tuple of str
        SI unit of each.
    nuisance : array (p,) of bool
        Which of them place the set-up rather than the robot.
    nominal : array (p,)
        Values of the robot and set-up as described.
    prior : array (p,)
        Standard deviations about the nominal values known before measuring [SI], or infinite.
    tools, targets : tuple of str
        Labels of what can be measured, and from where.
    """

    def __init__(
        self,
        robot: Robot,
        parameters: Sequence[ParameterBlock],
        measurement: Measurement | Sequence[Measurement],
        distances: Sequence[KnownDistance] = (),
    ) -> None:
        check_type(robot, Robot, "robot")
        self.robot = robot
        check_type(parameters, (tuple, list), "parameters")
        for block in parameters:
            check_type(block, ParameterBlock, "parameters")
        self.parameters = tuple(parameters)
        check_type(measurement, (Measurement, tuple, list), "measurement")
        self.measurements = (
            (measurement,) if isinstance(measurement, Measurement) else tuple(measurement)
        )
        if not self.measurements:
            raise InputError("a calibration model needs a measurement", name="measurement")
        for kind in self.measurements:
            check_type(kind, Measurement, "measurement")
        self.tools = tuple(label for block in parameters for label in block.tools)
        self.targets = tuple(label for block in parameters for label in block.targets)
        for labels, what, example in (
            (self.tools, "tool", "ToolPoint (with free='' where it is known)"),
            (self.targets, "target", "TargetPoints"),
        ):
            if not labels:
                raise InputError(
                    f"a calibration model needs a {what}", hint=f"add {example} to the parameters"
                )
            if len(set(labels)) != len(labels):
                raise InputError(f"two {what}s have the same name", name=what, hint="rename one")
        self.names = tuple(name for block in parameters for name in block.names)
        doubles = [name for name in self.names if self.names.count(name) > 1]
        if doubles:
            raise InputError(
                f"the parameter {doubles[0]} is there twice", hint="free it once", name=doubles[0]
            )
        self.units: tuple[Unit, ...] = tuple(unit for block in parameters for unit in block.units)
        self.nuisance = np.array([block.nuisance for block in parameters for _ in block.names])
        self.nuisance = self.nuisance.astype(bool)
        self.nominal = np.concatenate([np.zeros(0), *(block.nominal for block in parameters)])
        self.prior = np.concatenate([np.zeros(0), *(block.prior for block in parameters)])
        ends = np.cumsum([block.size for block in parameters])
        self.slices = [slice(e - b.size, e) for e, b in zip(ends, parameters, strict=True)]
        self.distances = tuple(distances)
        needed = [label for known in distances for label in (known.first, known.second)]
        needed += [label for block in parameters for label in block.measured_from]
        for label in needed:
            if label not in self.targets:
                raise InputError(
                    f"there is no target {label!r} that a distance could be known to",
                    hint=near_names(label, self.targets),
                    name=label,
                )

    @property
    def p(self) -> int:
        """Number of parameters."""
        return len(self.names)

    @property
    def measurement(self) -> Measurement:
        """The first kind of measurement: the only one of most models."""
        return self.measurements[0]

    @property
    def rows(self) -> int:
        """Rows m of a block: those of the kind that has most."""
        return max(kind.rows for kind in self.measurements)

    @property
    def equal_sigma(self) -> float:
        """The one number that all rows are divided by where they are not weighted [m]."""
        return float(np.sqrt(np.mean([kind.mean_sigma_m**2 for kind in self.measurements])))

    def equations(self, setup: Setup) -> int:
        """Equations that measurements give: rows that are not there to fill a block."""
        return int(self.rows_read(setup).sum())

    def rows_read(self, setup: Setup) -> IntArray:
        """Rows that were read of each measurement, ``(N,)``."""
        if setup.seen is not None:
            return np.asarray(setup.seen.sum(axis=1))
        return np.array([kind.rows for kind in self.measurements])[setup.kind]

    @property
    def knows_besides(self) -> bool:
        """Whether anything is known besides measurements: priors, or distances."""
        return bool(self.distances) or bool(np.isfinite(self.prior).any())

    def with_parameters(self, parameters: Sequence[ParameterBlock]) -> CalibrationModel:
        """The same robot, measured alike, with other parameters.

        Priors set by :meth:`with_prior` go with the names of the parameters.
        """
        other = CalibrationModel(self.robot, parameters, self.measurements, self.distances)
        own = np.concatenate([np.zeros(0), *(block.prior for block in self.parameters)])
        changed = {
            name: sigma
            for name, sigma, was in zip(self.names, self.prior, own, strict=True)
            if sigma != was
        }
        other.prior = np.array(
            [changed.get(n, s) for n, s in zip(other.names, other.prior, strict=True)]
        )
        return other

    def with_prior(self, prior: ArrayLike) -> CalibrationModel:
        """The same model with other standard deviations ``(p,)`` known before measuring [SI]."""
        sigma = np.asarray(prior, dtype=float)
        if sigma.shape != (self.p,) or not (sigma > 0).all():
            raise InputError(
                f"a prior needs {self.p} standard deviations above zero, or infinite", name="prior"
            )
        other = copy(self)
        other.prior = sigma
        return other

    def with_measurements(self, measurements: Sequence[Measurement]) -> CalibrationModel:
        """The same robot and parameters with other kinds, or another noise, of measurement."""
        if not measurements:
            raise InputError("a model needs a kind of measurement", name="measurement")
        other = copy(self)
        other.measurements = tuple(measurements)
        return other

    def with_deviation(self, arm_sigma: tuple[float, float] | None) -> CalibrationModel:
        """Return the same model of an arm that stops elsewhere than it says [m, rad]."""
        return self.with_measurements([k.with_deviation(arm_sigma) for k in self.measurements])

    @property
    def arm_sigma(self) -> tuple[float, float] | None:
        """Standard deviations [m, rad] of where the arm stops; None where no kind has any."""
        return next((k.arm_sigma for k in self.measurements if k.arm_sigma is not None), None)

    def view(
        self, q: ArrayLike, x: ArrayLike | None = None, setup: Setup | None = None
    ) -> MeasurementContext:
        """Arm and set-up at postures ``(..., N, n)`` [rad] with parameters ``(..., p)``."""
        return self._view(q, x, setup)[0]

    def tip_poses(self, q: FloatArray, values: FloatArray) -> FloatArray:
        """Poses ``T_base_tip (N, 4, 4)`` at postures ``(N, n)`` [rad] with parameters ``(p,)``.

        As :meth:`view` has them, without tools, targets and checks.
        """
        last, setup = np.ascontiguousarray(q.T), Setup.of(len(q))
        errors = ArmErrors(np.zeros((len(last), 1)))
        for block, part in zip(self.parameters, self.slices, strict=True):
            if not block.nuisance:
                block.displace(values[part, None], errors, last, setup)
        walk = self.robot.chain.walk(last + errors.joints, errors.displacements())
        return transform(walk.tip.transpose(2, 1, 0), walk.p_base_tip.T)

    def _view(
        self, q: ArrayLike, x: ArrayLike | None, setup: Setup | None
    ) -> tuple[MeasurementContext, FloatArray]:
        """The view, and the parameters as ``(p, S)`` or ``(p, 1)``."""
        posture = self.robot.check_posture(q)
        if posture.ndim < 2:
            raise InputError("a model takes a list of postures, (N, n)", name="posture")
        values = self.nominal if x is None else np.atleast_1d(numbers(x, "x"))
        if values.shape[-1] != self.p:
            raise InputError(f"the model has {self.p} parameters, {values.shape[-1]} were given")
        how = Setup.of(posture.shape[-2]) if setup is None else setup
        if how.together > 1:
            posture = np.repeat(posture, how.together, axis=-2)
        count, n = posture.shape[-2:]
        self.check_setup(how, count)
        batch = np.broadcast_shapes(posture.shape[:-2], values.shape[:-1])
        last = np.ascontiguousarray(np.broadcast_to(posture, (*batch, count, n)).reshape(-1, n).T)
        if values.ndim == 1:
            values = values[:, None]
        else:
            spread = np.broadcast_to(values, (*batch, self.p)).reshape(math.prod(batch), self.p)
            values = np.repeat(spread.T, count, axis=1)
        errors = ArmErrors(np.zeros((n, 1)))
        for block, part in zip(self.parameters, self.slices, strict=True):
            block.displace(values[part], errors, last, how)
        displacements = errors.displacements()
        walk = self.robot.chain.walk(last + errors.joints, displacements)
        width = last.shape[1]
        on_tip = _picked(errors.tools, how.tool, width)
        around = _picked(errors.targets, how.target, width)
        view = MeasurementContext(
            robot=self.robot,
            q=last,
            batch=batch,
            setup=how,
            tools=self.tools,
            targets=self.targets,
            is_distance=np.array([kind.is_distance for kind in self.measurements])[how.kind],
            errors=errors,
            displacements=displacements,
            walk=walk,
            point=walk.p_base_tip + turn(walk.tip, on_tip.position),
            tool=walk.tip if on_tip.columns is None else product(walk.tip, on_tip.columns),
            origin=around.position,
            target=NO_TURN if around.columns is None else around.columns,
        )
        return view, values

    def check_setup(self, setup: Setup, count: int) -> None:
        """Check that a set-up is one of ``count`` measurements, with what the model has."""
        if setup.count != count:
            raise InputError(
                f"{count} postures need {count} targets, {setup.count} were given", name="target"
            )
        for index, labels, what in (
            (setup.target, self.targets, "target"),
            (setup.tool, self.tools, "tool"),
            (setup.kind, self.measurements, "kind of measurement"),
        ):
            if index.max(initial=0) >= len(labels):
                raise InputError(
                    f"{what} {index.max() + 1} of a measurement is not in the model, "
                    f"which has {len(labels)}",
                    name=what,
                )

    def predict(
        self, q: ArrayLike, x: ArrayLike | None = None, setup: Setup | None = None
    ) -> FloatArray:
        """What the measurements show: rows ``(..., N, m)`` [m, rad].

        Where kinds of different rows are mixed, those that a kind lacks are zero.

        Parameters
        ----------
        q : array_like (..., N, n)
            Postures [rad].
        x : array_like (..., p), optional
            Parameters; the nominal ones by default. A leading dimension holds trials.
        setup : Setup, optional
            Kind, tool, target and payload of each; the first of all by default.
        """
        view = self.view(q, x, setup)
        rows = self._gathered(view, (), lambda kind, columns, part: kind.predict(part))
        return view.posture_first(rows)

    def _gathered(
        self, view: MeasurementContext, leading: tuple[int, ...], ask: _Ask
    ) -> FloatArray:
        """Blocks ``(*leading, m, S)`` of all kinds, each asked for its rows of its columns."""
        if len(self.measurements) == 1:
            return ask(self.measurement, slice(None), view)
        out = np.zeros((*leading, self.rows, view.q.shape[1]))
        for kind, columns, part in self.by_kind(view):
            out[..., : kind.rows, columns] = ask(kind, columns, part)
        return out

    def by_kind(
        self, view: MeasurementContext
    ) -> list[tuple[Measurement, Columns, MeasurementContext]]:
        """Each kind with its columns among the S, and the view of these alone."""
        if len(self.measurements) == 1:
            return [(self.measurements[0], slice(None), view)]
        if "by kind" not in view.found:
            count, trials = view.setup.count, view.q.shape[1] // max(view.setup.count, 1)
            found = []
            for k in range(len(self.measurements)):
                own = np.flatnonzero(view.setup.kind == k)
                if own.size:
                    columns = (own + count * np.arange(trials)[:, None]).ravel()
                    found.append((k, columns, view.part(columns, own)))
            view.found["by kind"] = found
        return [(self.measurements[k], *of) for k, *of in view.found["by kind"]]

    def jacobian(
        self, q: ArrayLike, x: ArrayLike | None = None, setup: Setup | None = None
    ) -> FloatArray:
        """Derivative of :meth:`predict` by the parameters, ``(..., N, m, p)``; not whitened.

        The blocks g_ij of Eq. 5 of [Watanabe2006]_, analytic; columns per rad and per m. Rows of
        rotations are those of the turn that a change makes, in the axes of the instrument.
        """
        return self.linearise(q, x, setup).jacobian

    def linearise(
        self,
        q: ArrayLike,
        x: ArrayLike | None = None,
        setup: Setup | None = None,
        observed: FloatArray | None = None,
    ) -> Linearisation:
        """Residuals and their derivative at parameters; for these see :meth:`predict`.

        Without readings ``(..., N, m)`` residuals are predictions, and rows of rotations zero.
        """
        view, values = self._view(q, x, setup)
        twist_rows = 6 if any(kind.sees_rotation for kind in self.measurements) else 3
        motion = np.zeros((self.p, twist_rows, view.q.shape[1]))
        for block, part in zip(self.parameters, self.slices, strict=True):
            if block.size:
                block.move(values[part], view, motion[part])
        rows = self._differences(view, observed)

        def moved(kind: Measurement, columns: Columns, part: MeasurementContext) -> FloatArray:
            J = kind.differentiate(motion[:, :, columns], part, rows[: kind.rows, columns])
            for block, own in zip(self.parameters, self.slices, strict=True):
                if block.reading:
                    by_reading = kind.differentiate_reading(block.reading, part)
                    if by_reading is not None:
                        J[own] += block.picked(by_reading)
            return J

        J = self._gathered(view, (self.p,), moved)
        if view.setup.together > 1 and view.seen_last is not None:
            J = np.where(view.seen_last, J, 0.0)
        return Linearisation(self, view, rows, J, motion, values)

    def linearise_at(self, data: Measurements, x: FloatArray) -> Linearisation:
        """:meth:`linearise` measurements at parameters ``(..., p)``."""
        return self.linearise(data.postures, x, data.setup, data.observed)

    def white_residuals(self, data: Measurements, x: FloatArray) -> FloatArray:
        """Rows ``(..., N, m)`` of :attr:`Linearisation.white_rows`, without their derivative."""
        view = self.view(data.postures, x, data.setup)
        return view.posture_first(self.whiten_last(self._differences(view, data.observed), view))

    def _differences(self, view: MeasurementContext, observed: FloatArray | None) -> FloatArray:
        """Residuals ``(m, S)``; predictions without readings, of rotations nothing."""
        readings = None if observed is None else _last(observed, view)

        def off(kind: Measurement, columns: Columns, part: MeasurementContext) -> FloatArray:
            predicted = kind.predict(part)
            if readings is None:
                rows = predicted.copy()
                rows[kind.rows - kind.turns :] = 0.0
                return rows
            rows = kind.difference(predicted, readings[: kind.rows, columns])
            seen = part.seen_last
            return rows if seen is None else np.where(seen[: kind.rows], rows, 0.0)

        return self._gathered(view, (), off)

    def whiten(
        self, q: ArrayLike, rows: FloatArray, x: ArrayLike | None = None, setup: Setup | None = None
    ) -> FloatArray:
        """Blocks ``(..., N, m, k)`` divided by the noise of their kinds of measurement.

        Rows ``(..., N, m)`` are blocks of one column: ``rows[..., None]``.
        """
        rows = numbers(rows, "rows")
        if rows.ndim < 3 or rows.shape[-2] != self.rows:
            raise InputError(
                f"blocks to whiten have shape (N, {self.rows}, k), not {rows.shape}", name="rows"
            )
        view = self.view(q, x, setup)
        last = np.ascontiguousarray(rows.reshape(-1, *rows.shape[-2:]).T)
        return view.posture_first(self.whiten_last(last, view))

    def whiten_last(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        """Rows ``(..., m, S)`` divided by the noise of their kinds, posture last."""
        white = self._gathered(
            view,
            rows.shape[:-2],
            lambda kind, columns, part: kind.whiten(rows[..., : kind.rows, columns], part),
        )
        shared = self.shared_deviation(view)
        return white if shared is None else shared.whiten(white)

    def colour_last(self, white: FloatArray, view: MeasurementContext) -> FloatArray:
        """The inverse of :meth:`whiten_last`."""
        shared = self.shared_deviation(view)
        own = white if shared is None else shared.colour(white)
        return self._gathered(
            view,
            own.shape[:-2],
            lambda kind, columns, part: kind.colour(own[..., : kind.rows, columns], part),
        )

    def shared_deviation(self, view: MeasurementContext) -> SharedDeviation | None:
        """Return the effect of the deviation of the arm on the rows; None where it has none."""
        if all(kind.arm_sigma is None for kind in self.measurements):
            return None
        key = ("deviation", self)
        if key not in view.found:
            A = np.zeros((self.rows, 6, view.q.shape[1]))
            D = self.by_deviation(view)
            for kind, columns, _ in self.by_kind(view):
                if kind.arm_sigma is not None:
                    A[..., columns] = D[..., columns] * np.repeat(kind.arm_sigma, 3)[:, None]
            view.found[key] = SharedDeviation.of(A, view)
        found: SharedDeviation = view.found[key]
        return found

    def by_deviation(self, view: MeasurementContext) -> FloatArray:
        """Derivative ``(m, 6, S)`` of the rows over their own noise by the deviation of the arm.

        By a shift [m] of the tip and a turn [rad] about its origin, in base axes.
        """
        width = view.q.shape[1]
        lever = view.point - view.walk.p_base_tip
        motion = np.zeros((6, 6, width))
        for k, axis in enumerate(np.eye(3)):
            motion[k, k] = 1.0
            motion[3 + k, :3], motion[3 + k, 3 + k] = cross(axis[:, None], lever), 1.0

        def moved(kind: Measurement, columns: Columns, part: MeasurementContext) -> FloatArray:
            twists = motion[..., columns] if kind.sees_rotation else motion[:, :3, columns]
            at = np.zeros((kind.rows, twists.shape[-1]))  # the truth, about which it deviates
            return kind.whiten(kind.differentiate(twists, part, at), part)

        return self._gathered(view, (6,), moved).swapaxes(0, 1)

    def gap(self, vector: FloatArray, view: MeasurementContext) -> FloatArray:
        """What of vectors ``(..., 3, S)`` the arm has to close: see :meth:`Measurement.gap`."""
        out = np.zeros_like(vector)
        for kind, columns, part in self.by_kind(view):
            out[..., columns] = kind.gap(vector[..., columns], part)
        return out

    @property
    def known_rows(self) -> FloatArray:
        """What is known before any measurement: rows ``(K, p)`` of unit variance, at nominal."""
        return np.asarray(self.known(self.nominal[None])[1][0])

    def known(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What is known besides measurements, whitened: priors, then distances.

        At parameters ``(T, p)``: rows ``(T, K)`` and their derivative ``(T, K, p)``.
        """
        held = np.flatnonzero(np.isfinite(self.prior))
        total = len(held) + len(self.distances)
        rows, J = np.zeros((len(x), total)), np.zeros((len(x), total, self.p))
        rows[:, : len(held)] = (x[:, held] - self.nominal[held]) / self.prior[held]
        J[:, np.arange(len(held)), held] = 1.0 / self.prior[held]
        for k, known in enumerate(self.distances, start=len(held)):
            labels = known.first, known.second
            apart = self._place(labels[1], x) - self._place(labels[0], x)
            length = np.linalg.norm(apart, axis=-1, keepdims=True)
            way = apart / np.maximum(length, np.finfo(float).tiny)
            rows[:, k] = (length[:, 0] - known.length_m) / known.sigma_m
            for sign, label in zip((-1.0, 1.0), labels, strict=True):
                if label in self.free_points:
                    J[:, k, self.free_points[label]] += sign * way / known.sigma_m
        return rows, J

    @property
    def free_points(self) -> dict[str, slice]:
        """Columns of x, y and z of the targets that are free points, by label."""
        return {
            label: slice(part.start + 3 * k, part.start + 3 * k + 3)
            for block, part in zip(self.parameters, self.slices, strict=True)
            if isinstance(block, Frames) and set(block.units) == {"m"}
            for k, label in enumerate(block.targets)
            if block.size == 3 * len(block.labels)
        }

    def _place(self, label: str, x: FloatArray) -> FloatArray:
        """Place ``(T, 3)`` or ``(3,)`` [m] of a target that is a point."""
        if label in self.free_points:
            return x[:, self.free_points[label]]
        for block in self.parameters:
            if isinstance(block, Frames) and label in block.targets and not block.size:
                return np.asarray(block.positions_m[block.labels.index(label)])
        raise InputError(f"the distance to target {label!r} cannot be known: it is no point")


Columns = slice | IntArray
_Ask = Callable[[Measurement, Columns, MeasurementContext], FloatArray]


def _picked(features: Sequence[Feature], index: IntArray, width: int) -> Feature:
    """The feature of each of S postures."""
    if len(features) == 1:
        return features[0]
    if (index == index[0]).all() if len(index) else True:
        return features[int(index[0]) if len(index) else 0]
    which = np.tile(index, width // len(index))
    posture = np.arange(width)
    position = np.stack([np.broadcast_to(f.position, (3, width)) for f in features])
    columns = None
    if any(f.columns is not None for f in features):
        every = [NO_TURN if f.columns is None else f.columns for f in features]
        stacked = np.stack([np.broadcast_to(c, (3, 3, width)) for c in every])
        columns = np.moveaxis(stacked[which, :, :, posture], 0, -1)
    return Feature(np.ascontiguousarray(position[which, :, posture].T), columns)


def _last(array: FloatArray, view: MeasurementContext) -> FloatArray:
    """Readings ``(..., N, m)`` as ``(m, S)``."""
    whole = np.broadcast_to(array, (*view.batch, *array.shape[-2:]))
    # a copy even of a single reading: one that is spread over trials cannot be written to, and
    # scipy's rotations take no such array
    return np.array(whole.reshape(-1, array.shape[-1]).T, order="C")


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Residuals of measurements and their derivative, at one or many sets of parameters."""

    model: CalibrationModel
    view: MeasurementContext
    rows_last: FloatArray  # (m, S): prediction less reading [m, rad], posture last
    jacobian_last: FloatArray  # (p, m, S)
    motion: FloatArray
    """(p, 6, S): twists of the tool against its target, see :meth:`ParameterBlock.move`."""
    values: FloatArray  # (p, S) or (p, 1): the parameters
    root: FloatArray | None = None
    """(S,): what whitened rows are multiplied by: square roots of the weights of measurements."""

    @property
    def rows(self) -> FloatArray:
        """Residuals ``(..., N, m)`` [m, rad]."""
        return self.view.posture_first(self.rows_last)

    @property
    def jacobian(self) -> FloatArray:
        """Blocks ``(..., N, m, p)``."""
        return self._blocks(self.jacobian_last)

    def _blocks(self, last: FloatArray) -> FloatArray:
        """Blocks ``(..., N, m, p)`` of each posture: of all that was measured there together."""
        blocks, together = self.view.posture_first(last), self.view.setup.together
        if together == 1:
            return blocks
        *leading, count, m, p = blocks.shape
        return blocks.reshape(*leading, count // together, together * m, p)

    @cached_property
    def white_last(self) -> tuple[FloatArray, FloatArray]:
        """Residuals ``(m, S)`` and blocks ``(p, m, S)`` over the noise, posture last."""
        rows, J = self.model.whiten_last(self.rows_last, self.view), self._white_jacobian()
        if self.root is not None:
            return rows * self.root, J * self.root
        return rows, J

    def _white_jacobian(self) -> FloatArray:
        def whitened(kind: Measurement, columns: Columns, part: MeasurementContext) -> FloatArray:
            J, rows = self.jacobian_last[:, : kind.rows], self.rows_last[: kind.rows, columns]
            motion = self.motion[:, :, columns]
            return kind.whiten_derivative(J[..., columns], motion, part, rows)

        white = self.model._gathered(self.view, (self.model.p,), whitened)
        shared = self.model.shared_deviation(self.view)
        return white if shared is None else shared.whiten(white)

    def over_noise_last(self, weighted: bool) -> tuple[FloatArray, FloatArray]:
        """As :attr:`white_last`, or all rows over the same number."""
        if weighted:
            return self.white_last
        sigma = self.model.equal_sigma
        return self.rows_last / sigma, self.jacobian_last / sigma

    def stacked(self, *, weighted: bool = True) -> tuple[FloatArray, FloatArray]:
        """Rows ``(M,)`` over their noise of all that is known, and their derivative ``(M, p)``.

        Of one set: those of the measurements, one by one, then what is known besides.
        """
        rows, J = map(self.view.posture_first, self.over_noise_last(weighted))
        known, K = self.model.known(self.values[:, :1].T)
        return (
            np.concatenate([rows.ravel(), known[0]]),
            np.concatenate([J.reshape(rows.size, self.model.p), K[0]]),
        )

    def by(self, model: CalibrationModel) -> Linearisation:
        """The same by a model with other noise or priors."""
        # what kinds have worked out for themselves hangs on their noise
        return replace(self, model=model, view=replace(self.view, found={}))

    def weighed(self, weights: FloatArray) -> Linearisation:
        """The same with weights ``(S,)`` of the squares of the whitened rows."""
        return self if (weights == 1.0).all() else replace(self, root=np.sqrt(weights))

    @property
    def white_rows(self) -> FloatArray:
        """Residuals ``(..., N, m)`` over the noise: of unit variance where the model is right."""
        return self.view.posture_first(self.white_last[0])

    @property
    def squares(self) -> FloatArray:
        """Squares of the residuals over their noise, summed over a measurement: ``(..., N)``."""
        return np.asarray(np.sum(self.white_rows**2, axis=-1))

    @property
    def white_jacobian(self) -> FloatArray:
        """Blocks ``(..., N, m, p)`` over the noise."""
        return self._blocks(self.white_last[1])

    def coloured(self, rows: FloatArray, *, weighted: bool = True) -> FloatArray:
        """Rows ``(..., N, m)`` of these over the noise, or over the same number."""
        if not weighted:
            return np.asarray(rows * self.model.equal_sigma)
        return self.view.posture_first(self.model.colour_last(_last(rows, self.view), self.view))

    @property
    def noise_root(self) -> FloatArray:
        """Square roots ``(..., N, m, m)`` of the covariance of each measurement's rows."""
        m, width = self.rows_last.shape
        unit = np.broadcast_to(np.eye(m)[:, :, None], (m, m, width))
        return self.view.posture_first(self.model.colour_last(unit, self.view))


@dataclass(frozen=True)
class KnownDistance:
    """A distance between two targets, by their labels, that is known from elsewhere."""

    first: str
    second: str
    length_m: float
    sigma_m: float = 1e-5

    def __post_init__(self) -> None:
        if self.first == self.second:
            raise InputError(
                f"the target {self.first!r} has no distance from itself", name=self.first
            )
        for number, what in ((self.length_m, "length"), (self.sigma_m, "standard deviation")):
            if not (np.isfinite(number) and number > 0):
                raise InputError(
                    f"a distance of targets with a {what} of {number:g} m cannot be known",
                    hint="give metres above zero",
                    name=what,
                    value=number,
                    bound=0.0,
                )
