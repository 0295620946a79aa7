"""A mission that an agent has planned: the items for the vehicle, and the route behind them."""

from __future__ import annotations

import msgspec

from swarmctl.core.any_angle.pull import Track
from swarmctl.core.grid import Cell
from swarmctl.core.mission import FlightPlan
from swarmctl.core.observation import ObservationId
from swarmctl.core.split import SplitPlan


class PlannedMission(msgspec.Struct, frozen=True):
    plan_id: int
    """running number of the agent's missions, from 1 on"""
    plan: FlightPlan
    """content of the mission on the vehicle"""
    cells: tuple[Cell, ...]
    """lattice route of the plan"""
    because: tuple[ObservationId, ...]
    """observations merged since the last decision"""
    cost: float
    exposure_sum: float
    safety_factor: float
    length_m: float
    track: Track | None = None
    """straight track flown in place of the lattice route; None: the route is flown. exposure_sum,
    safety_factor and length_m are those of the flown path; cost is always the route's"""
    split: SplitPlan | None = None
    """the members' own ways of a group whose leader flies this mission; None: the group flies together"""
