"""The last broadcasts of a vehicle, and those of the other vehicles. Pure.

Only `sharing`, `intents`, `neighbours`, `received_intents` and `returning` change these records.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec

from swarmctl.agent.traffic.separation.other_vehicles import KnownFlight, NeighbourReport
from swarmctl.agent.traffic.separation.trajectory import Trajectory
from swarmctl.core.records import replace


class SentBroadcasts(msgspec.Struct, frozen=True):
    """The last broadcasts of this vehicle; times are by the vehicle's clock, −∞: due at once."""

    intent: Trajectory | None = None
    """last intent sent, with heights above the sea"""
    intent_boot_s: float = -math.inf
    intent_new_boot_s: float = -math.inf
    """time from which on the intent is new to others: they may not have received it yet"""
    state_boot_s: float = -math.inf

    def state_due(self) -> SentBroadcasts:
        """Return the broadcasts of a vehicle that has to send its state at once."""
        return replace(self, state_boot_s=-math.inf)

    def intent_due(self, now_s: float) -> SentBroadcasts:
        """Return the broadcasts of a vehicle that flies otherwise from `now_s` on."""
        return replace(self, intent_boot_s=-math.inf, intent_new_boot_s=now_s)


class ReceivedBroadcasts(msgspec.Struct, frozen=True):
    """The last broadcasts of other vehicles, by system id."""

    reports: Mapping[int, NeighbourReport] = msgspec.field(default_factory=dict)
    """states of vehicles nearby, those of silent vehicles, too"""
    intents: Mapping[int, KnownFlight] = msgspec.field(default_factory=dict)
    returning: Mapping[int, NeighbourReport] = msgspec.field(default_factory=dict)
    """states of vehicles that return or wait to return"""
