"""Variables of a MATLAB file of version 5 to 7, read in a process of its own.

``scipy.io.loadmat`` crashes the interpreter on some damaged files (one mutation in three hundred of
a file of ``savemat``), and a few compressed bytes can unfold to gigabytes. The process imports this
module, which is why it imports little.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calib.limited import run_limited
from calib.se3 import FloatArray

LARGEST_MAT_BYTES = 50_000_000
"""As stored, and again its 4x4xN arrays as unfolded: 390,000 transforms."""

NUMBERS = ("double", "single")
"""Kinds of arrays that transforms can be."""

_MEMORY_BYTES = 2_000_000_000
_SECONDS = 20.0


@dataclass(frozen=True)
class Variable:
    """An array in a MATLAB file."""

    kind: str  # its class: double, cell and so on
    shape: tuple[int, ...]
    array: FloatArray | None = None  # its numbers, where it is 4x4xN of a kind of :data:`NUMBERS`

    @property
    def is_stacked(self) -> bool:
        """Whether it is 4x4xN, of whatever kind."""
        return len(self.shape) == 3 and self.shape[:2] == (4, 4) and self.shape[2] > 0

    @property
    def may_be_transforms(self) -> bool:
        """Whether it is 4x4xN numbers, which may still be complex."""
        return self.is_stacked and self.kind in NUMBERS

    @property
    def is_complex(self) -> bool:
        """Whether its numbers are complex, as far as they were read."""
        return self.array is not None and np.iscomplexobj(self.array)

    @property
    def described(self) -> str:
        """In words, say ``4x4x88 double``."""
        sizes = "x".join(str(n) for n in self.shape)
        return f"{sizes} {'complex ' if self.is_complex else ''}{self.kind}".strip()


def read_variables(data: bytes) -> dict[str, Variable]:
    """The variables of a MATLAB file by name.

    Raises
    ------
    OSError
        It is damaged, or takes too long.
    OverflowError
        Its arrays unfold to more than :data:`LARGEST_MAT_BYTES`.
    """
    read = io.BytesIO(run_limited(__name__, data, memory_bytes=_MEMORY_BYTES, seconds=_SECONDS))
    variables = {
        name: Variable(kind, tuple(shape)) for name, shape, kind in json.loads(read.readline())
    }
    if _bytes_of(variables) > LARGEST_MAT_BYTES:
        raise OverflowError
    return {
        name: replace(v, array=np.load(read)) if v.may_be_transforms else v
        for name, v in variables.items()
    }


def _bytes_of(variables: Mapping[str, Variable]) -> int:
    return sum(8 * math.prod(v.shape) for v in variables.values() if v.may_be_transforms)


def run(data: bytes) -> bytes:
    """List the variables of a MATLAB file; behind them, in their order, what may be transforms.

    For :func:`calib.limited.run_limited`.
    """
    from scipy.io import loadmat, whosmat

    file: Any = io.BytesIO(data)  # the stubs of scipy know names of files only
    listed = [
        (str(name), [int(size) for size in shape], str(kind))
        for name, shape, kind in whosmat(file, chars_as_strings=False)
        if name != "__function_workspace__"  # what objects of MATLAB refer to
    ]
    variables = {name: Variable(kind, tuple(shape)) for name, shape, kind in listed}
    if len(variables) < len(listed):
        raise ValueError("two variables of one name")
    out = io.BytesIO()
    out.write(json.dumps(listed).encode() + b"\n")
    if _bytes_of(variables) <= LARGEST_MAT_BYTES:
        wanted = [name for name, variable in variables.items() if variable.may_be_transforms]
        arrays = loadmat(file, variable_names=wanted) if wanted else {}
        for name in wanted:
            if arrays[name].shape != variables[name].shape:
                raise ValueError("an array that is not as announced")
            # what MATLAB packed as small integers is double, too
            kind = complex if np.iscomplexobj(arrays[name]) else float
            np.save(out, arrays[name].astype(kind), allow_pickle=False)
    return out.getvalue()
