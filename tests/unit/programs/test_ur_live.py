"""Poses found in what a controller sends; over a socket in ``tests/cli/test_record.py``."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calib.errors import InputError
from posedesign.programs.ur_script import live
from posedesign.programs.ur_script.live import PLAYING, SAMPLES, STILL_RAD, Sample, Told, Watch

Q, REST = [0.1, -1.2, 1.3, -1.4, 1.5, 0.6], [0.0] * 6


def seen(samples: list[Sample]) -> list[Told]:
    watch = Watch()
    return [told for sample in samples if (told := watch.see(sample)) is not None]


def at_pose(number: int, count: int = SAMPLES, **how: object) -> list[Sample]:
    values = {"state": PLAYING, "number": number, "q": Q, "qd": REST, **how}
    return [Sample(**values)] * count  # type: ignore[arg-type]


def test_the_mean_of_a_tenth_of_a_second_is_taken_once() -> None:
    off = STILL_RAD * np.arange(SAMPLES)[:, None] / SAMPLES
    standing = [Sample(PLAYING, 4, row.tolist(), REST) for row in Q + off]
    (told,) = seen([*at_pose(0), *standing, *at_pose(4, 50), *at_pose(0)])
    assert (told.number, told.problem) == (4, "")
    np.testing.assert_allclose(told.q, Q + off.mean(), atol=1e-12)


@pytest.mark.parametrize(
    ("samples", "problem"),
    [
        (at_pose(4, qd=[0, 0, 0.011, 0, 0, 0]), "was told while J3 moved, at 0.63 deg/s"),
        ([*at_pose(4, 11), *at_pose(4, 1, q=[*Q[:5], 0.6002])], "was told while J6 moved"),
        (at_pose(4, q=Q[:5]), "has not 6 joint values"),
        (at_pose(4, q=[*Q, 0.0]), "has not 6 joint values"),
        (at_pose(4, q=[*Q[:5], np.nan]), "has joint values that no arm has"),
        (at_pose(4, qd=[np.nan] * 6), "was told while J1 moved"),
        (at_pose(4, SAMPLES - 1), "was told for less than 0.1 s"),
    ],
)
def test_what_is_not_taken_says_why(samples: list[Sample], problem: str) -> None:
    (told,) = seen([*at_pose(0), *samples, *at_pose(0)])
    assert (told.number, told.q) == (4, None)
    assert told.problem.startswith(problem)


def test_a_number_counts_where_it_is_seen_to_appear_while_the_program_runs() -> None:
    (told,) = seen(at_pose(4, 50))
    assert (told.q, told.problem) == (None, "was told before the connection")
    assert seen([*at_pose(0), *at_pose(4, 50, state=1)]) == []
    assert [told.number for told in seen([*at_pose(0), *at_pose(4), *at_pose(2)])] == [4, 2]


STOPPED, PAUSING, PAUSED = 1, 3, 4


def test_a_number_that_appears_as_the_program_is_paused_counts_when_it_goes_on() -> None:
    paused = [*at_pose(0), *at_pose(5, 1, state=PAUSING)]
    away = at_pose(5, 30, state=PAUSED, q=[0.0] * 6)
    (told,) = seen([*paused, *away, *at_pose(5, 40)])
    assert (told.number, told.problem) == (5, "")
    np.testing.assert_allclose(told.q, Q, atol=1e-12)
    (told,) = seen([*paused, *away, *at_pose(0)])
    assert (told.number, told.problem) == (5, "was told for less than 0.1 s")
    # the next run begins with what the last one left in the register
    assert seen([*paused, *at_pose(5, 1, state=STOPPED), *at_pose(5, 40)]) == []


def test_a_number_of_a_paused_program_may_be_of_before_the_connection() -> None:
    (told,) = seen([*at_pose(5, 9, state=PAUSED), *at_pose(5, 40)])
    assert (told.number, told.problem) == (5, "was told before the connection")


@pytest.fixture
def broken(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[str], str]:
    """What is said of an ur_rtde with this code in it."""

    def message_of(code: str) -> str:
        (tmp_path / "rtde_receive.py").write_text(code)
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))
        monkeypatch.setattr(live.importlib.util, "find_spec", lambda name: name)
        with pytest.raises(InputError) as caught:
            next(live.told_poses("127.0.54.1", 36, 60.0, print))
        return caught.value.message

    return message_of


@pytest.mark.parametrize(
    ("code", "message"),
    [
        (
            "raise ImportError('libboost.so: cannot open\\nit')",
            "does not load: libboost.so: cannot",
        ),
        ("raise ImportError", "ur_rtde does not load: ImportError"),
        ("", "ur_rtde does not load: cannot import name"),
        ("def RTDEReceiveInterface(*a): raise RuntimeError", "30004: RuntimeError"),
        ("def RTDEReceiveInterface(): 1", "30004: it sends what ur_rtde cannot read"),
    ],
)
def test_a_library_that_does_not_work_says_so(code, message, broken):
    said = broken(code)
    assert message in said
    assert "\n" not in said
