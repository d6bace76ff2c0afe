"""The calibration model: from postures and parameters to what is measured, and its derivative.

Everything else stands on the blocks that it gives: indices, planning, identification, covariance
and Monte Carlo all take ``(N, m, p)`` and see no robot.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.measurement.base import Measurement
from calib.parameters.base import ArmErrors, ArmView, ParameterBlock
from calib.parameters.setup import TargetPoints, ToolPoint
from calib.robots.robot import Robot
from calib.se3 import FloatArray, IntArray


class CalibrationModel:
    """A robot, the parameters to identify, and how it is measured.

    Parameters
    ----------
    robot : Robot
    parameters : sequence of ParameterBlock
        Must hold one :class:`ToolPoint` and one :class:`TargetPoints`.
    measurement : Measurement

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
    """

    def __init__(
        self,
        robot: Robot,
        parameters: Sequence[ParameterBlock],
        measurement: Measurement,
    ) -> None:
        for kind in (ToolPoint, TargetPoints):
            if sum(isinstance(block, kind) for block in parameters) != 1:
                raise InputError(
                    f"a calibration model needs exactly one {kind.__name__}",
                    hint="add it to the parameters"
                    + (", with free='' where it is known" if kind is ToolPoint else ""),
                )
        self.robot = robot
        self.parameters = tuple(parameters)
        self.measurement = measurement
        self.names = tuple(name for block in parameters for name in block.names)
        doubles = [name for name in self.names if self.names.count(name) > 1]
        if doubles:
            raise InputError(
                f"the parameter {doubles[0]} is there twice", hint="free it once", name=doubles[0]
            )
        self.units = tuple(block.unit for block in parameters for _ in block.names)
        self.nuisance = np.array([block.nuisance for block in parameters for _ in block.names])
        self.nominal = np.concatenate([block.nominal for block in parameters])
        ends = np.cumsum([block.size for block in parameters])
        self._slices = [slice(e - b.size, e) for e, b in zip(ends, parameters, strict=True)]

    @property
    def p(self) -> int:
        """Number of parameters."""
        return len(self.names)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the targets."""
        return next(b.labels for b in self.parameters if isinstance(b, TargetPoints))

    def view(
        self, q: ArrayLike, x: ArrayLike | None = None, target: IntArray | None = None
    ) -> tuple[ArmView, FloatArray]:
        """The arm at postures ``(..., N, n)`` with parameters ``(..., p)``.

        Returns
        -------
        view : ArmView
        error : array (..., N, 3)
            Tool point minus target [m], in base axes: Eq. 4 of [Watanabe2006]_.
        """
        posture = self.robot.check_posture(q)
        if posture.ndim < 2:
            raise InputError("a model takes a list of postures, (N, n)", name="posture")
        values = self.nominal if x is None else np.atleast_1d(np.asarray(x, dtype=float))
        if values.shape[-1] != self.p:
            raise InputError(f"the model has {self.p} parameters, {values.shape[-1]} were given")
        values = values[..., None, :]  # the same for all postures of a trial
        touched = np.zeros(posture.shape[-2], dtype=np.intp) if target is None else target
        count, known = posture.shape[-2], len(self.labels)
        if touched.shape != (count,) or not ((touched >= 0) & (touched < known)).all():
            raise InputError(
                f"{count} postures need {count} targets, each an index from 0 to {known - 1}",
                name="target",
            )
        errors = ArmErrors(np.zeros(1), np.zeros(3), np.zeros((1, 1, 3)))
        for block, part in zip(self.parameters, self._slices, strict=True):
            block.displace(values[..., part], errors, posture)
        state = self.robot.chain.forward(posture + errors.joints)
        point = state.point(errors.tool)
        view = ArmView(posture, state, point, touched, errors)
        return view, point - errors.targets[..., 0, touched, :]  # 0: one value for all postures

    def predict(
        self, q: ArrayLike, x: ArrayLike | None = None, target: IntArray | None = None
    ) -> FloatArray:
        """What the measurement shows: rows ``(..., N, m)`` [m].

        Parameters
        ----------
        q : array_like (..., N, n)
            Postures [rad].
        x : array_like (..., p), optional
            Parameters; the nominal ones by default. A leading dimension holds trials.
        target : array (N,), optional
            Index of the target that each posture touches; the first by default.
        """
        view, error = self.view(q, x, target)
        return self.measurement.observe(error, view.state.R_base_tip)

    def jacobian(
        self, q: ArrayLike, x: ArrayLike | None = None, target: IntArray | None = None
    ) -> FloatArray:
        """Derivative of :meth:`predict` by the parameters, ``(..., N, m, p)``; not whitened.

        The blocks g_ij of Eq. 5 of [Watanabe2006]_, analytic; columns per rad and per m.
        """
        return self.linearise(q, x, target)[1]

    def linearise(
        self, q: ArrayLike, x: ArrayLike | None = None, target: IntArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Prediction ``(..., N, m)``, Jacobian ``(..., N, m, p)`` and ``R_base_tip`` in one go."""
        view, error = self.view(q, x, target)
        R = view.state.R_base_tip
        batch = view.point.shape[:-1]
        motions = [block.motion(view) for block in self.parameters]
        motion = np.concatenate(
            [np.broadcast_to(m, (*batch, *m.shape[-2:])) for m in motions], axis=-1
        )
        rows = self.measurement.observe(error, R)
        return rows, self.measurement.differentiate(motion, error, R), R

    def whiten(self, q: ArrayLike, rows: FloatArray, x: ArrayLike | None = None) -> FloatArray:
        """Blocks ``(..., N, m, k)`` divided by the noise of the measurement.

        Rows ``(..., N, m)`` are blocks of one column: ``rows[..., None]``.
        """
        if rows.ndim < 3 or rows.shape[-2] != self.measurement.rows:
            raise InputError(
                f"blocks to whiten have shape (N, {self.measurement.rows}, k), not {rows.shape}",
                name="rows",
            )
        view, _ = self.view(q, x)
        return self.measurement.whiten(rows, view.state.R_base_tip)
