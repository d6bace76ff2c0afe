"""Studies: a question, one command, and an answer that survives a kill and any number of workers.

What is studied is in ``studies/``, outside this package; here is what all of it runs on. A study
that repeats one simulation over a grid of conditions gives :mod:`.grid` its conditions, and
:mod:`.runner` runs them on one machine or a cluster; its results are kept by :mod:`.store`.
"""

from posedesign.study.library import Advance, Options, call, own_folder
from posedesign.study.runner import Grid, Task, Workers, run_grid
from posedesign.study.store import Store, read_table

__all__ = [
    "Advance",
    "Grid",
    "Options",
    "Store",
    "Task",
    "Workers",
    "call",
    "own_folder",
    "read_table",
    "run_grid",
]
