"""Files of pose pairs, and of the answers to AX = ZB."""

from posedesign.hand_eye.pairs.certificate import FRAMES
from posedesign.hand_eye.pairs.file import Pairs, read_pairs, write_pairs
from posedesign.hand_eye.pairs.results import SolverOutcome, solve_pairs
from posedesign.hand_eye.pairs.source import PairSource

__all__ = [
    "FRAMES",
    "PairSource",
    "Pairs",
    "SolverOutcome",
    "read_pairs",
    "solve_pairs",
    "write_pairs",
]
