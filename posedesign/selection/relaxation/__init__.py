"""What no choice can beat: the best that fractions of candidates can be, and its proof."""

from posedesign.selection.relaxation.certificate import (
    Certificate,
    ConditionCertificate,
    MeanCertificate,
)
from posedesign.selection.relaxation.relaxation import Relaxation

__all__ = ["Certificate", "ConditionCertificate", "MeanCertificate", "Relaxation"]
