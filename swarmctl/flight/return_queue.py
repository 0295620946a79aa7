"""Vehicles of many processes return and land in turns, though nobody tells them any: each goes by what
others say.

Who returns is in everybody's state, about once a second. A vehicle goes when its way meets nobody's who
is on the way home; of several that could, the one with the lowest system id is first, as all of them know.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from swarmctl.agent.state import Phase
from swarmctl.agent.traffic.collision_avoidance import AIRBORNE_M
from swarmctl.agent.traffic.return_turns import (
    LEAST_APART_M,
    SILENT_S,
    SINK_M_S,
    is_on_its_way,
    place_told,
    turns_of,
)
from swarmctl.core.frames import StateShared
from swarmctl.core.geo import distance_m
from swarmctl.core.messages import Place

SLOT_S = 5.0
"""So long it lets each go first that waits too and has a lower system id: more than a state takes to come."""


@dataclass(slots=True)
class _Heard:
    state: StateShared
    at_s: float
    """by the clock of `may_go`"""


@dataclass(slots=True)
class Turns:
    """Of the vehicle `uav`. `states` are what others have told last."""

    uav: int
    states: Callable[[], Mapping[int, StateShared]]
    _heard: dict[int, _Heard] = field(default_factory=dict)
    _free: tuple[object, float] | None = None
    """who is before it, and since when its way is free with these [s]"""

    def may_go(self, place: Place, now_s: float) -> bool:
        """Whether it may begin its return from `place`; asked several times a second [s of one clock]."""
        self._listen(now_s)
        returning = self._returning(place, now_s)
        if turns_of({**returning, self.uav: place}).begins_s[self.uav] > 0.0:
            self._free = None
            return False
        before = frozenset(u for u, h in self._heard.items() if u < self.uav and _may_wait(h, now_s))
        key = (before, frozenset(returning))
        if self._free is None or self._free[0] != key:
            self._free = (key, now_s)
        return now_s - self._free[1] >= SLOT_S * len(before)

    def may_land(self, place: Place, now_s: float) -> bool:
        """Whether nobody in the air is where it would come down; of two at one height the one with the lower
        system id is under the other."""
        self._listen(now_s)
        here, apart_m = (place.lat_deg, place.lon_deg), max(LEAST_APART_M, place.keeps_m[0])
        for uav, heard in self._heard.items():
            state, age_s = heard.state, now_s - heard.at_s + heard.state.age_s
            if state.alt_rel_m < AIRBORNE_M or age_s > max(SILENT_S, state.alt_rel_m / SINK_M_S):
                continue
            home_amsl_m = place.home_alt_amsl_m
            up_m = home_amsl_m + state.alt_rel_m if state.alt_amsl_m is None else state.alt_amsl_m
            lower = (up_m, uav) < (place.alt_amsl_m, self.uav)
            if lower and distance_m(here, (state.lat_deg, state.lon_deg)) < apart_m:
                return False
        return True

    def _listen(self, now_s: float) -> None:
        for uav, state in self.states().items():
            known = self._heard.get(uav)
            if known is None or known.state.time_s != state.time_s:
                self._heard[uav] = _Heard(state, now_s)

    def _returning(self, own: Place, now_s: float) -> dict[int, Place]:
        """Who is on the way home, or was when it was last heard and cannot be trusted to be down."""
        places = {}
        for uav, heard in self._heard.items():
            place = None if heard.state.phase == Phase.HOLDING else place_told(heard.state, own)
            if place is not None and is_on_its_way(place, now_s - heard.at_s):
                places[uav] = place
        return places


def _may_wait(heard: _Heard, now_s: float) -> bool:
    """It waits as well, or that it does is not told yet."""
    return heard.state.phase in (Phase.FLYING, Phase.HOLDING) and now_s - heard.at_s <= SILENT_S
