"""Studies: a question, one command, and an answer that survives a kill and any number of workers.

What is studied is in ``studies/``, outside this package; here is what all of it runs on. A study
that repeats one simulation over a grid of conditions gives :mod:`.runner` its conditions, which
runs them on one machine or a cluster; its results are kept by :mod:`.store`.
"""

from posedesign.study.library import Advance as Advance
from posedesign.study.library import Options as Options
from posedesign.study.library import call as call
from posedesign.study.library import own_folder as own_folder
from posedesign.study.runner import Grid as Grid
from posedesign.study.runner import Task as Task
from posedesign.study.runner import Workers as Workers
from posedesign.study.runner import each as each
from posedesign.study.runner import run_grid as run_grid
from posedesign.study.store import Store as Store
from posedesign.study.store import read_table as read_table
