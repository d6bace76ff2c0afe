"""One thread of BLAS inside our own loops.

Their matrices are of some tens of rows. OpenBLAS shares such products among its threads, which wait
for each other by spinning: beside other work a loop then takes ten times the processor time, and
many times that of the clock.
"""

from __future__ import annotations

from contextlib import ContextDecorator
from functools import cache
from threading import Lock
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController


class _OneBlasThread(ContextDecorator):
    """See :data:`one_blas_thread`.

    Threads of BLAS belong to the whole process: of several callers at once the first one in takes
    them, and the last one out gives them back.
    """

    def __init__(self) -> None:
        self._lock, self._inside = Lock(), 0

    def __enter__(self) -> None:
        with self._lock:
            if not self._inside:
                self._taken = _controller().limit(limits=1, user_api="blas")
            self._inside += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if not self._inside:
                self._taken.restore_original_limits()


@cache
def _controller() -> ThreadpoolController:
    """What knows the libraries of this process; found once, as that takes a millisecond."""
    import scipy.linalg  # noqa: F401  loaded late, with a BLAS of its own
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


one_blas_thread = _OneBlasThread()
"""Decorates a function, or makes a block, that BLAS runs in one thread in."""
