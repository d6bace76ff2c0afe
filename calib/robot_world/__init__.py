"""Robot-world and hand-eye calibration: solve A_i X = Z B_i for X and Z.

One file for each method, one result type for all; :data:`METHODS` lists them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from calib.robot_world import design
    from calib.robot_world.certificate.certify import Certificate, certify
    from calib.robot_world.components import shown_noise
    from calib.robot_world.estimate import residuals as residuals
    from calib.robot_world.methods import (
        METHODS,
        PAPER_METHODS,
        Method,
    )
    from calib.robot_world.noise import (
        Noise,
        PairCovariances,
        PairNoise,
    )

    # for the project's own modules, which give them checked arrays: not public, and not in __all__
    from calib.robot_world.noise import NoiseShown as NoiseShown
    from calib.robot_world.noise import difference as difference
    from calib.robot_world.pairs import PairSets
    from calib.robot_world.results import (
        RobotWorldResult,
        pairs_from_opencv,
        result_to_opencv,
    )
    from calib.robot_world.scale import Scale
    from calib.robot_world.simulation import (
        Problems,
        add_noise,
        random_problems,
    )
    from calib.robot_world.solver import RobotWorldBatch, solve, solve_batch
else:
    __getattr__ = load_when_asked(__name__)

__all__ = [
    "METHODS",
    "PAPER_METHODS",
    "Certificate",
    "Method",
    "Noise",
    "PairCovariances",
    "PairNoise",
    "PairSets",
    "Problems",
    "RobotWorldBatch",
    "RobotWorldResult",
    "Scale",
    "add_noise",
    "certify",
    "design",
    "pairs_from_opencv",
    "random_problems",
    "result_to_opencv",
    "shown_noise",
    "solve",
    "solve_batch",
]
