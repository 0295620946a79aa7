"""The return queue of a vehicle whose swarm is flown by several processes.

No process assigns the turns. Each vehicle broadcasts its return about once a second. A vehicle begins its
return when its path home meets no path of a returning vehicle. The lowest system id goes first.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from swarmctl.agent.phases import Phase
from swarmctl.agent.traffic.prediction import AIRBORNE_M
from swarmctl.agent.traffic.return_schedule import (
    MIN_HORIZONTAL_M,
    MIN_SILENCE_S,
    SINK_M_S,
    may_be_returning,
    position_from_state,
    schedule_for,
)
from swarmctl.core.frames import StateShared
from swarmctl.core.geo import distance_m
from swarmctl.core.messages import VehiclePosition

SLOT_S = 5.0
"""head start of each waiting vehicle with a lower system id [s], longer than the delay of a state message"""


@dataclass(slots=True)
class _ReceivedState:
    state: StateShared
    at_s: float
    """time of receipt, by the clock of `may_return`"""


@dataclass(slots=True)
class ReturnQueue:
    """The queue from the view of vehicle `uav`; `states` returns the last states of the other vehicles."""

    uav: int
    states: Callable[[], Mapping[int, StateShared]]
    _received: dict[int, _ReceivedState] = field(default_factory=dict)
    _free_since: tuple[object, float] | None = None
    """(vehicles ahead in the queue, returning vehicles), and the time since which the path is free [s]"""

    def may_return(self, place: VehiclePosition, now_s: float) -> bool:
        """Return whether the vehicle may begin its return from `place`. Call several times a second."""
        self._update(now_s)
        returning = self._returning(place, now_s)
        if schedule_for({**returning, self.uav: place}).begins_s[self.uav] > 0.0:
            self._free_since = None
            return False
        ahead = frozenset(
            uav for uav, received in self._received.items() if uav < self.uav and _may_wait(received, now_s)
        )
        key = (ahead, frozenset(returning))
        if self._free_since is None or self._free_since[0] != key:
            self._free_since = (key, now_s)
        return now_s - self._free_since[1] >= SLOT_S * len(ahead)

    def may_land(self, place: VehiclePosition, now_s: float) -> bool:
        """Return whether the descent from this position is free of lower airborne vehicles.

        At equal height the vehicle with the lower system id counts as the lower vehicle.
        """
        self._update(now_s)
        here, apart_m = (place.lat_deg, place.lon_deg), max(MIN_HORIZONTAL_M, place.min_separation_m[0])
        for uav, received in self._received.items():
            state, age_s = received.state, now_s - received.at_s + received.state.age_s
            if state.alt_rel_m < AIRBORNE_M or age_s > max(MIN_SILENCE_S, state.alt_rel_m / SINK_M_S):
                continue
            home_amsl_m = place.home_alt_amsl_m
            alt_amsl_m = home_amsl_m + state.alt_rel_m if state.alt_amsl_m is None else state.alt_amsl_m
            lower = (alt_amsl_m, uav) < (place.alt_amsl_m, self.uav)
            if lower and distance_m(here, (state.lat_deg, state.lon_deg)) < apart_m:
                return False
        return True

    def _update(self, now_s: float) -> None:
        for uav, state in self.states().items():
            known = self._received.get(uav)
            if known is None or known.state.time_s != state.time_s:
                self._received[uav] = _ReceivedState(state, now_s)

    def _returning(self, own: VehiclePosition, now_s: float) -> dict[int, VehiclePosition]:
        """Return the positions of vehicles that return, or may still return after their last state."""
        places = {}
        for uav, received in self._received.items():
            state = received.state
            place = None if state.phase == Phase.HOLDING else position_from_state(state, own)
            if place is not None and may_be_returning(place, now_s - received.at_s):
                places[uav] = place
        return places


def _may_wait(received: _ReceivedState, now_s: float) -> bool:
    """Return whether another vehicle may wait for its turn to return, by a recent state."""
    return received.state.phase in (Phase.FLYING, Phase.HOLDING) and now_s - received.at_s <= MIN_SILENCE_S
