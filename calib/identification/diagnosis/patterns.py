"""What residuals follow besides time: the scale of an instrument, the reach, turns of a joint."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calib.identification.diagnosis.finding import Cause, Finding
from calib.identification.diagnosis.held import Effect, Held, held_at, score_of
from calib.model.parameters import JointHarmonics
from calib.se3 import FloatArray

SCALE = 0.01
"""Usual error of an instrument's scale, or of a target's size."""

SAG_M = 1e-3
"""Usual size of what grows with the square of the reach, at the farthest."""

WAVE_RAD = 3e-4
"""Usual harmonic of a transmission."""

WAVES = (1.0, 2.0, 3.0, 4.0)

_HELD_RAD = 1e-9
"""Standard deviation of what is as good as nothing."""


def scales(held: Held) -> Iterator[Effect]:
    """Readings of a kind that are all too long by the same part."""
    data, model = held.data, held.model
    if data.observed is None:
        return
    for k, kind in enumerate(model.measurements):
        own = data.setup.kind == k
        lengths = kind.rows - kind.turns
        if not kind.reads or not own.any():
            continue
        read = np.zeros(held.rows.shape)
        read[own, :lengths] = data.observed[own, :lengths] * SCALE
        Z = model.whiten(data.postures, read[..., None], held.x, data.setup)
        yield _effect(held, Z, "scale", "instrument", (kind.name,), SCALE, "", 0.0)


def incomplete(held: Held) -> Iterator[Finding]:
    """What the arm does that its model, harmonics apart, does not."""
    model = held.model
    prior = model.prior.copy()
    for block, part in zip(model.parameters, model.slices, strict=True):
        if isinstance(block, JointHarmonics):
            prior[part] = _HELD_RAD
    bare = held_at(model.with_prior(prior), held.data, held.x)
    view, n = bare.linear.view, model.robot.n
    tried = float(np.log(n * len(WAVES) + 1))
    for joint in range(n):
        turn = np.zeros((6, view.q.shape[1]))
        view.turn_about(view.axis(joint), view.walk.origins[joint], turn)
        for wave in WAVES:
            angle = wave * view.q[joint]
            motion = np.stack([np.sin(angle) * turn, np.cos(angle) * turn]) * WAVE_RAD
            Z = _seen(bare, motion)
            name = (model.robot.joint_names[joint], f"{wave:g}")
            yield _effect(bare, Z, "harmonic", "joint", name, WAVE_RAD, "rad", tried).finding
    out = view.point.copy()
    out[2] = 0.0
    reach = np.linalg.norm(out, axis=0)
    grown = (reach / reach.max(initial=1e-9)) ** 2 * SAG_M
    motion = np.zeros((2, 6, view.q.shape[1]))
    motion[0, 2] = grown
    motion[1, :3] = out / np.maximum(reach, 1e-9) * grown
    yield _effect(bare, _seen(bare, motion), "reach", "", (), SAG_M, "m", tried).finding


def _seen(held: Held, motion: FloatArray) -> FloatArray:
    """Rows over the noise ``(N, m, k)`` that twists ``(k, 6, S)`` of the tool show as."""
    model, view = held.model, held.linear.view
    twists = motion[:, : held.linear.motion.shape[1]]
    out = np.zeros((len(motion), *held.linear.rows_last.shape))
    for kind, columns, part in model.by_kind(view):
        rows = held.linear.rows_last[: kind.rows, columns]
        moved = kind.differentiate(twists[:, :, columns], part, rows)
        out[:, : kind.rows, columns] = kind.whiten_derivative(
            moved, twists[:, :, columns], part, rows
        )
    return view.posture_first(out)


def _effect(
    held: Held,
    Z: FloatArray,
    cause: Cause,
    part: str,
    things: tuple[str, ...],
    usual: float,
    unit: str,
    tried: float,
) -> Effect:
    found = score_of(held, Z)
    size = found.size[0]
    far = float(size[0]) if len(size) == 1 else float(np.linalg.norm(size))
    finding = Finding(
        cause,
        things,
        part,
        (),
        far * usual,
        unit,
        held.rms_m(),
        held.rms_m(held.after(Z, size)),
        float(found.log_odds[0]) - tried,
    )
    return Effect(finding, Z, float(found.usual[0]), tried, 0.0)
