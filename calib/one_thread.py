"""One thread of BLAS inside our own loops.

Their matrices are of some tens of rows. OpenBLAS shares such products among its threads, which wait
for each other by spinning: beside other work a loop then takes ten times the processor time, and
many times that of the clock.
"""

from __future__ import annotations

import sys
from contextlib import ContextDecorator
from functools import cache
from threading import Lock
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController, threadpool_limits

_SCIPY = "scipy.linalg"


class _Threads:
    """The threads of BLAS, which belong to the whole process.

    Of several callers at once the first one in takes them, and the last one out gives them back.
    """

    def __init__(self) -> None:
        self._lock, self._inside = Lock(), 0
        self._taken: list[threadpool_limits] = []
        self._of_scipy = False  # whether those of scipy's own BLAS are among the taken

    def take(self) -> None:
        with self._lock:
            of_scipy = _SCIPY in sys.modules
            if not self._inside or of_scipy > self._of_scipy:
                self._taken.append(_controller(of_scipy).limit(limits=1, user_api="blas"))
                self._of_scipy = of_scipy
            self._inside += 1

    def give_back(self) -> None:
        with self._lock:
            self._inside -= 1
            while not self._inside and self._taken:
                self._taken.pop().restore_original_limits()


class _OneBlasThread(ContextDecorator):
    """See :data:`one_blas_thread` and :data:`one_numpy_thread`."""

    def __init__(self, threads: _Threads, *, of_scipy: bool) -> None:
        self._threads, self._of_scipy = threads, of_scipy

    def __enter__(self) -> None:
        if self._of_scipy:
            import scipy.linalg  # noqa: F401  loaded late, with a BLAS of its own
        self._threads.take()

    def __exit__(self, *_: object) -> None:
        self._threads.give_back()


@cache
def _controller(of_scipy: bool) -> ThreadpoolController:
    """What knows the libraries of this process; found once, as that takes a millisecond.

    ``of_scipy``: whether scipy's BLAS is loaded, too.
    """
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


_THREADS = _Threads()

one_blas_thread = _OneBlasThread(_THREADS, of_scipy=True)
"""Decorates a function, or makes a block, that BLAS runs in one thread in."""

one_numpy_thread = _OneBlasThread(_THREADS, of_scipy=False)
"""The same for what uses numpy alone: scipy takes a third of a second to be loaded."""
