"""One thread of BLAS inside our own loops, and as many as there were outside of them."""

import subprocess
import sys
import threading

import numpy as np
import pytest
import threadpoolctl

from calib import one_thread
from calib.identification.evidence import tune_priors
from posedesign import select


class Libraries:
    """Stands for the libraries of a process: ``threads`` is what they run in."""

    def __init__(self) -> None:
        self.threads, self.seen = 4, []

    def limit(self, *, limits: int, user_api: str) -> "Libraries":
        assert user_api == "blas"
        self.before, self.threads = self.threads, limits
        return self

    def restore_original_limits(self) -> None:
        self.threads = self.before


@pytest.fixture
def libraries(monkeypatch) -> Libraries:
    found = Libraries()
    monkeypatch.setattr(one_thread, "_controller", lambda of_scipy: found)
    return found


@pytest.mark.parametrize(
    ("module", "first", "run"),
    [
        ("posedesign.selection.select", "Candidates", lambda: select(np.ones((4, 1, 1)), 2)),
        ("calib.identification.evidence", "members_of", lambda: tune_priors(None, None, [])),
    ],
    ids=["selection", "priors"],
)
def test_it_runs_in_one_and_gives_the_others_back(libraries, monkeypatch, module, first, run):
    def seen(*_: object, **__: object) -> None:
        libraries.seen.append(libraries.threads)
        raise RuntimeError

    monkeypatch.setattr(sys.modules[module], first, seen)
    with pytest.raises(RuntimeError):
        run()
    assert (libraries.seen, libraries.threads) == ([1], 4)


def test_the_first_in_takes_them_and_the_last_out_gives_them_back(libraries):
    inside, leave = threading.Event(), threading.Event()

    def other() -> None:
        with one_thread.one_blas_thread:
            inside.set()
            leave.wait(10.0)

    with one_thread.one_blas_thread:
        beside = threading.Thread(target=other)
        beside.start()
        assert inside.wait(10.0)
    assert libraries.threads == 1
    leave.set()
    beside.join()
    assert libraries.threads == 4


def test_the_library_itself():
    def most() -> int:
        found = threadpoolctl.threadpool_info()
        return max(one["num_threads"] for one in found if one["user_api"] == "blas")

    with threadpoolctl.threadpool_limits(2, "blas"):
        with one_thread.one_blas_thread:
            assert most() == 1
        assert most() == 2


def test_a_library_that_is_loaded_inside_is_taken_at_the_next_entry():
    """Of scipy, whose BLAS is its own; numpy's alone needs no scipy."""
    words = """
import sys, threadpoolctl
from calib.one_thread import one_blas_thread, one_numpy_thread
def threads():
    found = threadpoolctl.threadpool_info()
    return [one["num_threads"] for one in found if one["user_api"] == "blas"]
import numpy
with threadpoolctl.threadpool_limits(2, "blas"):
    with one_numpy_thread:
        assert "scipy" not in sys.modules and max(threads()) == 1, threads()
        with one_blas_thread:
            assert "scipy.linalg" in sys.modules and max(threads()) == 1, threads()
    assert 2 in threads(), threads()
"""
    subprocess.run([sys.executable, "-c", words], check=True)
