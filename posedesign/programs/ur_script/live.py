"""Poses of a running URScript program, as it tells of them: by RTDE, through the library ur_rtde.

The program writes the number of a pose into an output integer register while the arm stands there
touched up, and 0 before it moves on; the scripts written here do, and any other
program can with these two lines. Integer registers say which pose it is, so that none is counted
wrong after a break; of their 48 ur_rtde reads 12 to 19, which the guide to RTDE keeps for field
buses, and 36 to 43 of those that it leaves to others (PolyScope 3.9 and 5.3 on). Nothing is written
to the controller.

ur_rtde runs in a process of its own (:mod:`.rtde_process`), and what that says is checked here.

Facts: Universal Robots' guide to RTDE, the sources of ur_rtde. Nothing was run on a controller.
"""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field

import numpy as np

from calib.errors import InputError
from calib.se3 import FloatArray
from posedesign.programs.program import in_range
from posedesign.programs.ur_script import rtde_process
from posedesign.programs.ur_script.reader import JOINTS, MOST_JOINT_RAD

PORT = 30004  # of RTDE; ur_rtde knows no other
REGISTERS = (*range(12, 20), *range(36, 44))

SAMPLES = 12  # of one pose, a tenth of a second: their mean is taken
STILL_RAD_S = 0.01
"""Joint speed up to which an arm stands: what the encoders make of standing is far below, and the
slowest hand that guides an arm above."""

STILL_RAD = 1e-4  # by which no joint may move meanwhile: a tenth of a millimetre at a metre
AGAIN_S = 1.0  # wait before a connection that was lost is made anew
LONGEST_S = 7 * 24 * 3600.0
PLAYING, ENDED = 2, (0, 1)  # of ``runtime_state``: a paused program has not ended


@dataclass(frozen=True)
class Sample:
    """One package: what the program does, the register, joints (6,) [rad] and their speeds."""

    state: int
    number: int
    q: Sequence[float]
    qd: Sequence[float]


@dataclass(frozen=True, eq=False)
class Told:
    """A pose that the program told of: joints ``(6,)`` [rad], or why they are not taken."""

    number: int
    q: FloatArray | None = None
    problem: str = ""


@dataclass
class Watch:
    """Finds in a stream of samples the poses that the program tells of.

    A number counts when it is seen to appear: one that stood there from the first may be of another
    run, or the arm may have moved on. One that appears as the program is paused counts when it goes
    on: until then the arm may not be where it stood.
    """

    number: int | None = None
    waits: bool = False
    window: list[Sample] = field(default_factory=list)

    def see(self, sample: Sample) -> Told | None:
        """A pose that this sample completes, or ends too early."""
        told = None
        if sample.number != self.number:
            before, self.number = self.number, sample.number
            if before is not None and (self.window or self.waits):
                told = Told(before, problem="was told for less than 0.1 s")
            self.window, self.waits = [], before is not None and sample.number != 0
            if before is None and sample.number != 0 and sample.state not in ENDED:
                told = Told(sample.number, problem="was told before the connection")
        elif self.window:
            self.window.append(sample)
            if len(self.window) == SAMPLES:
                told, self.window = _judged(self.window), []
        if self.waits and sample.state == PLAYING:
            self.window, self.waits = [sample], False
        self.waits = self.waits and sample.state not in ENDED
        return told


def _judged(window: list[Sample]) -> Told:
    number = window[0].number
    if any(len(joints) != JOINTS for s in window for joints in (s.q, s.qd)):
        return Told(number, problem=f"has not {JOINTS} joint values")
    q, qd = np.array([s.q for s in window], float), np.array([s.qd for s in window], float)
    if not (np.abs(q) <= MOST_JOINT_RAD).all():  # nor NaN
        return Told(number, problem="has joint values that no arm has")
    moved, speed = np.ptp(q, axis=0), np.abs(qd).max(axis=0)
    if not (speed <= STILL_RAD_S).all() or (moved > STILL_RAD).any():
        worst = int(np.argmax(np.maximum(speed / STILL_RAD_S, moved / STILL_RAD)))
        return Told(
            number,
            problem=f"was told while J{worst + 1} moved, at {np.degrees(speed[worst]):.3g} deg/s",
        )
    return Told(number, q.mean(axis=0))


def told_poses(
    host: str, register: int, timeout_s: float, tell: Callable[[str], None]
) -> Iterator[Told]:
    """Poses as a controller's program tells of them, until it has ended.

    A connection that is lost is made anew, which is ``tell``-ed; what was told meanwhile is not
    known. ``register``: the output integer register that the program writes into. ``timeout_s``:
    longest time without a pose [s].

    Raises InputError: ur_rtde is missing, a value is out of its range, nothing answers there, or no
    pose is told in time.
    """
    in_range("timeout_s", timeout_s, 1.0, LONGEST_S)
    if register not in REGISTERS:
        raise InputError(
            f"ur_rtde does not read output integer register {register}",
            hint="write into one of 36 to 43, or 12 to 19",
            name="register",
            value=register,
        )
    if importlib.util.find_spec("rtde_receive") is None:
        raise InputError(
            "recording needs ur_rtde, which is not installed",
            hint="pip install posedesign[ur], or save the log and posedesign import it",
        )
    return _told(host, register, timeout_s, tell)


def _told(
    host: str, register: int, timeout_s: float, tell: Callable[[str], None]
) -> Iterator[Told]:
    last, ran, connected, lines = time.monotonic(), False, False, 0
    while True:
        watch = Watch()
        try:
            with closing(_samples(host, register)) as samples:
                for sample in samples:
                    if not connected:  # how long a process takes to start is no time without a pose
                        last = time.monotonic()
                    connected, lines = True, 0
                    told = watch.see(sample)
                    if told is not None:
                        yield told
                        last = last if told.q is None else time.monotonic()
                    ran |= sample.state == PLAYING
                    if ran and sample.state in ENDED:
                        return
                    if time.monotonic() - last > timeout_s:
                        raise InputError(
                            f"{host}:{PORT}: no pose was told in output integer register "
                            f"{register} for {timeout_s:g} s",
                            hint="does the program run, and write there? What is recorded is kept",
                            name="host",
                        )
        except _Lost as lost:
            if not connected or time.monotonic() - last > timeout_s:
                raise InputError(
                    f"{host}:{PORT}: {lost}",
                    hint="is it the controller's address, and is RTDE on in its security settings?",
                    name="host",
                ) from lost
            lines += 1
            if lines == 1:  # of each time that it is lost
                tell(f"{host}:{PORT}: {lost}; trying again")
            time.sleep(AGAIN_S)


class _Lost(Exception):
    """There is no connection, or none any more."""


def _samples(host: str, register: int) -> Generator[Sample, None, None]:
    """What the controller sends, without end."""
    command = [sys.executable, "-P", rtde_process.__file__, host, str(register)]
    with subprocess.Popen(  # noqa: S603 - no shell, and a file of this package
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        try:
            for line in process.stdout or ():
                said = json.loads(line)
                if isinstance(said, str) and process.wait() == rtde_process.UNLOADED:
                    raise InputError(
                        f"ur_rtde does not load: {said}",
                        hint="install it anew: pip install --force-reinstall ur_rtde",
                    )
                if isinstance(said, str):
                    raise _Lost(said)
                yield Sample(*said)
            silent = process.wait() == rtde_process.SILENT
            raise _Lost("nothing comes" if silent else "it sends what ur_rtde cannot read")
        finally:
            process.kill()
