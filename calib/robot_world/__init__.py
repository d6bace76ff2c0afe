"""Robot-world and hand-eye calibration: solve A_i X = Z B_i for X and Z.

One file for each method, one result type for all; :data:`METHODS` lists them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from calib.robot_world import design as design
    from calib.robot_world.certificate.certify import Certificate as Certificate
    from calib.robot_world.certificate.certify import certify as certify
    from calib.robot_world.components import shown_noise as shown_noise
    from calib.robot_world.estimate import residuals as residuals  # of checked arrays
    from calib.robot_world.methods import METHODS as METHODS
    from calib.robot_world.methods import PAPER_METHODS as PAPER_METHODS
    from calib.robot_world.methods import Method as Method
    from calib.robot_world.network import FramePrior as FramePrior
    from calib.robot_world.network import Network as Network
    from calib.robot_world.network import NetworkResult as NetworkResult
    from calib.robot_world.network import solve_network as solve_network
    from calib.robot_world.noise import Noise as Noise
    from calib.robot_world.noise import NoiseShown as NoiseShown
    from calib.robot_world.noise import PairCovariances as PairCovariances
    from calib.robot_world.noise import PairNoise as PairNoise
    from calib.robot_world.noise import difference as difference  # of checked arrays
    from calib.robot_world.pairs import PairSets as PairSets
    from calib.robot_world.results import RobotWorldResult as RobotWorldResult
    from calib.robot_world.results import pairs_from_opencv as pairs_from_opencv
    from calib.robot_world.results import result_to_opencv as result_to_opencv
    from calib.robot_world.scale import Scale as Scale
    from calib.robot_world.simulation import Problems as Problems
    from calib.robot_world.simulation import add_noise as add_noise
    from calib.robot_world.simulation import random_problems as random_problems
    from calib.robot_world.solver import RobotWorldBatch as RobotWorldBatch
    from calib.robot_world.solver import solve as solve
    from calib.robot_world.solver import solve_batch as solve_batch
    from calib.robot_world.solver import solve_batch_by_each as solve_batch_by_each
    from calib.robot_world.streams import PoseStream as PoseStream
    from calib.robot_world.streams import StreamResult as StreamResult
    from calib.robot_world.streams import solve_streams as solve_streams
else:
    __getattr__ = load_when_asked(__name__)
