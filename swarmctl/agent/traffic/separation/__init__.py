"""How far vehicles are from each other in space and time: planned, flown and about to be. Pure.

A conflict is two vehicles closer than `Limits.horizontal_m` and closer than `Limits.vertical_m` at one time:
a cylinder about each, as air traffic control draws it. Points are (east, north, up) in metres, times seconds
of one clock.

trajectory: where a vehicle is at what time; approach: how near two come to each other, exactly; conflicts:
who comes too near to whom, of many; clash: whether planned flights may meet that are not flown to the second;
flown: the least distance of a flight as its telemetry comes in; watch:
who is warned and who gives way in flight; meet: one arrival for many. Imports core.
"""

from swarmctl.agent.traffic.separation.approach import Approach, Limits, closest, intervals
from swarmctl.agent.traffic.separation.conflicts import Conflict, Crossings, conflicts, crossings
from swarmctl.agent.traffic.separation.trajectory import (
    Point,
    Trajectory,
    lands_from_s,
    onward,
    to_its_landing,
)

__all__ = [
    "Approach",
    "Conflict",
    "Crossings",
    "Limits",
    "Point",
    "Trajectory",
    "closest",
    "conflicts",
    "crossings",
    "intervals",
    "lands_from_s",
    "onward",
    "to_its_landing",
]
