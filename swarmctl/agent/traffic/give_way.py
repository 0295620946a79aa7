"""The hold of a vehicle that gives way to others. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from swarmctl.agent.traffic.separation.watch import NeighbourReport
from swarmctl.core.events import SwapMission


@dataclass(frozen=True, slots=True)
class GiveWay:
    """Times are by the vehicle's clock."""

    plan: SwapMission | None = None
    """plan that the vehicle interrupted to give way in hold; None: no such hold"""
    to: Mapping[int, NeighbourReport] = field(default_factory=dict)
    """last states of the vehicles to which this vehicle gives way"""
    earliest_end_boot_s: float = -math.inf
    """earliest end of the hold"""
    since_boot_s: float = math.inf
    """start of the hold, or time of the last report about this hold"""
