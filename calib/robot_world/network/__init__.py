"""Several cameras, targets and arms in one estimate of A X = Z B, in part where need be.

``A_i X_k = Z_l B_i`` for every pair i of what is on the flange (k) and what stands around (l).
Where several arms share what stands around them, ``A_i X_k = V_j Z_l B_i``: V_j takes the frame of
all to the base of arm j, and is the identity for the first arm of each part that hangs together.

The likelihood is that of one pair of frames (:mod:`calib.robot_world.errors_of_pairs`). The noise
is estimated with the frames (variance components, Förstner 1979). An edge, a thing on the flange
together with one around, has a noise of its own where its pairs show another one than the rest.

What is known from elsewhere, as from the drawing of a mount, enters as a prior. Directions that
neither pairs nor priors tell are named, such as the height of a target that an arm of four axes
looks at.
"""

from calib.robot_world.network.graph import Network as Network
from calib.robot_world.network.prior import FramePrior as FramePrior
from calib.robot_world.network.result import NetworkResult as NetworkResult
from calib.robot_world.network.solver import solve_network as solve_network
