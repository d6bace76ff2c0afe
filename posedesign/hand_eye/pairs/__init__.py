"""Files of pose pairs, and of the answers to AX = ZB."""

from posedesign.hand_eye.pairs.certificate import FRAMES as FRAMES
from posedesign.hand_eye.pairs.file import Pairs as Pairs
from posedesign.hand_eye.pairs.file import read_pairs as read_pairs
from posedesign.hand_eye.pairs.file import write_pairs as write_pairs
from posedesign.hand_eye.pairs.results import SolverOutcome as SolverOutcome
from posedesign.hand_eye.pairs.results import solve_pairs as solve_pairs
from posedesign.hand_eye.pairs.source import PairSource as PairSource
