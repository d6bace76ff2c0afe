"""Measurements that contradict the others, and noise that nobody has given.

Losses: ``huber``, ``cauchy`` and ``student-t`` weigh a measurement down by how far it is off;
``graduated`` decides which measurements to leave out. It goes from a convex problem to that of
truncated least squares in steps (graduated non-convexity: Yang et al., IEEE RA-L 5(2), 2020), from
the best of many fits to a few measurements each, so that no gross error has a say in where it
starts (Rousseeuw and Van Driessen, Data Min. Knowl. Discov. 12, 2006).

Noise of a kind that has none is estimated by the variance its residuals have over their redundancy
(variance components: Förstner, 1979), lengths and angles apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.stats import chi2

from calib.errors import ConvergenceError, InputError
from calib.identification.covariance import information_root
from calib.identification.least_squares import ITERATIONS, minimise
from calib.measurement.data import Measurements
from calib.model import CalibrationModel
from calib.se3 import BoolArray, FloatArray

Loss = Literal["least-squares", "huber", "cauchy", "student-t", "graduated"]
