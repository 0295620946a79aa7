"""The columns of the arrays that the kernels of the abstract mission share.

The rows of `ints` and `floats` are vehicles. Cells are flat padded indices, as in `planners.kernels`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Int32s = NDArray[np.int32]

UAV, ENTRY, INDEX, N_ROUTE, N_FLOWN, HAS_NEWS, PHASE, SEARCHES, REPLANS, SENT, RECEIVED, KNOWN, FOUND = range(
    13
)
"""columns of `ints`: system id, entry cell, index in the route, cells of the route, cells flown, ..."""
N_INTS = 13
EDGE_S, CENTRE_S, FROM_S, FROM_X, FROM_Y, TO_S, TO_X, TO_Y, SPEED, ARRIVED_S = range(10)
"""columns of `floats`: times of the next edge and centre, the present leg, speed, and arrival"""
N_FLOATS = 10
SEE, RECEIVE, DECIDE, ENDED = range(4)
"""what a vehicle does next (`PHASE`), and the order in one moment"""
TO, FROM, OBSERVATION = range(3)
ARRIVES_S, SENT_X, SENT_Y = range(3)
"""columns of the messages under way"""
HEAD, TAIL, N_OBSERVATIONS, OVERFLOW = range(4)
"""the `counts`: first message under way, the one after the last, observations, 1 if an array is too short"""
WIDTH, RANGE, RELAYS, N_HOSTILES, MAX_ENTRIES, IS_RANDOM = range(6)
"""the `rules`, whole numbers"""
W, STEP, MAX_EXPOSURE, CELL_M, DELAY_S, JITTER_S, MIN_M, MAX_M, LOSS, P_ENTER, P_STAY = range(11)
"""the `settings`"""
