"""The wait of a vehicle before its return, and the start of that return. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from swarmctl.agent.traffic.separation.watch import NeighbourReport


@dataclass(frozen=True, slots=True)
class ReturnWait:
    """Times are by the vehicle's clock."""

    latest_boot_s: float | None = None
    """latest start of the return of a holding vehicle; None: the vehicle does not wait to return"""
    when_clear: bool = False
    """True: the return starts as soon as its path is clear; False: at its start time in a recall"""
    checked_boot_s: float = -math.inf
    """time of the last check of the path"""
    started_boot_s: float | None = None
    """start of the return, while the vehicle may still have to hold again; otherwise None"""
    deadline_boot_s: float = -math.inf
    """end of the longest wait before a return; a second wait does not extend it"""
    neighbours: Mapping[int, NeighbourReport] = field(default_factory=dict)
    """last states of other vehicles that return or wait to return"""

    def over(self) -> ReturnWait:
        """Return the record of a vehicle that neither waits nor has just started."""
        return replace(self, latest_boot_s=None, when_clear=False, started_boot_s=None)

    def until_clear(self, latest_boot_s: float) -> ReturnWait:
        """Return the record of a vehicle that waits for a clear path, at most until `latest_boot_s`."""
        return replace(self, latest_boot_s=latest_boot_s, when_clear=True, started_boot_s=None)

    def started(self, now_s: float, deadline_boot_s: float) -> ReturnWait:
        """Return the record of a vehicle that starts its return, and may have to hold again."""
        return replace(self.over(), started_boot_s=now_s, deadline_boot_s=deadline_boot_s)
