"""The arrays that the kernels of the abstract mission share, in groups.

The rows of `ints` and `floats` are vehicles. Cells are flat padded indices, as in `planners.kernels`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmctl.planners.kernels.lattice import Bytes, Floats, Ints

Int32s = NDArray[np.int32]

N_INTS = 12
UAV, INDEX, N_ROUTE, N_FLOWN, HAS_NEWS, PHASE, SEARCHES, REPLANS, SENT, RECEIVED, KNOWN, FOUND = range(N_INTS)
"""columns of `ints`: system id, index in the route, cells of the route, cells flown, ..."""
N_FLOATS = 10
EDGE_S, CENTRE_S, FROM_S, FROM_X, FROM_Y, TO_S, TO_X, TO_Y, SPEED, ARRIVED_S = range(N_FLOATS)
"""columns of `floats`: times of the next edge and centre, the present leg, speed, and arrival"""
SEE, DECIDE, ENDED = range(3)
"""what a vehicle does next (`PHASE`), and the order in one moment"""
TO, FROM, OBSERVATION = range(3)
ARRIVES_S, SENT_X, SENT_Y = range(3)
"""columns of the messages under way"""
HEAD, TAIL, N_OBSERVATIONS, OVERFLOW = range(4)
"""the `counts`: first message under way, the one after the last, observations, 1 if an array is too short"""


class Settings(NamedTuple):
    """The numbers of a scenario."""

    w: float
    step: float
    """cost of the length of a straight step (Eq. 5)"""
    max_exposure: float
    n_hostiles: int
    cell_m: float
    max_entries: int
    """entries into cells after which a vehicle does not arrive"""
    range: int
    """communication range [vehicles]"""
    relays: bool
    is_random: bool
    """True with loss or jitter"""
    delay_s: float
    jitter_s: float
    min_m: float
    max_m: float
    p_enter: float
    p_stay: float
    """probability that a message is lost after a received one, and after a lost one"""


class Area(NamedTuple):
    """The cells, (size,) each; 1 for yes."""

    width: int
    inside: Bytes
    walls: Bytes
    occupied: Bytes
    offsets: Ints
    strength: Floats


class Vehicles(NamedTuple):
    """The state of all vehicles; the first axis is the vehicle."""

    ints: Ints
    floats: Floats
    routes: Int32s
    goals: Ints
    """the goals of all vehicles, one vehicle after the other"""
    first_goals: Ints
    """index of each vehicle's first goal; one more at the end"""
    known: Bytes
    visits: Int32s
    flown: Int32s
    strikes: Int32s
    """cells entered, and strikes there"""


class Observations(NamedTuple):
    """All observations of a mission, by number."""

    cells: Int32s
    """(observations, 10): the number of cells, and the cells"""
    observers: Int32s
    has: Bytes
    """(vehicles, observations): 1 if the vehicle has it"""


class Messages(NamedTuple):
    """The messages under way, and what the radio draws."""

    times: Floats
    ends: Ints
    counts: Ints
    draws: Floats
    """(vehicles, vehicles, draws): random numbers of each pair"""
    drawn: Ints
    p_lost: Floats
    """(vehicles, vehicles): draws taken, and probability that the next message is lost"""
    order: Ints
    metres: Floats
    """the vehicles by distance"""


class Search(NamedTuple):
    """The fields of one search, (size,) each, and its heap."""

    p_occupied: Floats
    p_s: Floats
    straight: Floats
    """cost of a straight step into each cell"""
    rest: Floats
    """lower bound on the cost from the vehicle to each cell"""
    label: Floats
    heap: Ints
    keys: Floats
