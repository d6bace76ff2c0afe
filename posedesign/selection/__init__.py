"""Choosing poses out of a pool, from their blocks alone: arrays ``(N, m, p)``, no robot."""

from posedesign.selection.candidates import Candidates as Candidates
from posedesign.selection.candidates import shortened as shortened
from posedesign.selection.criteria import CRITERIA as CRITERIA
from posedesign.selection.criteria import criterion_by_name as criterion_by_name
from posedesign.selection.criteria import largest_deviation as largest_deviation
from posedesign.selection.criteria import mean_deviation as mean_deviation
from posedesign.selection.criteria import wanted_deviations as wanted_deviations
from posedesign.selection.criterion import Criterion as Criterion
from posedesign.selection.indices import PER_MRAD_AND_MM as PER_MRAD_AND_MM
from posedesign.selection.indices import Indices as Indices
from posedesign.selection.indices import condition_inf as condition_inf
from posedesign.selection.indices import evaluate as evaluate
from posedesign.selection.search import METHODS as METHODS
from posedesign.selection.select import Fewest as Fewest
from posedesign.selection.select import Selection as Selection
from posedesign.selection.select import select as select
from posedesign.selection.select import select_fewest as select_fewest
