"""Vehicles of many processes return in turns, though nobody tells them any: each goes by what others say.

Who returns is in everybody's state, about once a second. A vehicle goes when its way meets nobody's who
is on the way home; of several that could, the one with the lowest system id is first, as all of them know.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from swarmctl.agent import Phase
from swarmctl.core.frames import StateShared
from swarmctl.core.geo import LatLon
from swarmctl.core.messages import Place
from swarmctl.core.returns import turns_of

SLOT_S = 5.0
"""So long it lets each go first that waits too and has a lower system id: more than a state takes to come."""
SILENT_S = 10.0
"""Who is not heard for so long waits no more, and is taken to be on its way if it was."""


@dataclass(slots=True)
class _Heard:
    state: StateShared
    at_s: float
    """by the clock of `may_go`"""


@dataclass(slots=True)
class Turns:
    """Of the vehicle `uav`. `states` are what others have told last, `homes` where they took off."""

    uav: int
    states: Callable[[], Mapping[int, StateShared]]
    homes: Mapping[int, LatLon]
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

    def _listen(self, now_s: float) -> None:
        for uav, state in self.states().items():
            known = self._heard.get(uav)
            if known is None or known.state.time_s != state.time_s:
                self._heard[uav] = _Heard(state, now_s)

    def _returning(self, own: Place, now_s: float) -> dict[int, Place]:
        """Who is on the way home, or was when it was last heard and cannot be trusted to be down."""
        places = {}
        for uav, heard in self._heard.items():
            if heard.state.phase != Phase.LEAVING or uav not in self.homes:
                continue
            place = _place(heard.state, self.homes[uav], own)
            if now_s - heard.at_s <= max(SILENT_S, turns_of({uav: place}).down_s):
                places[uav] = place
        return places


def _may_wait(heard: _Heard, now_s: float) -> bool:
    """It waits as well, or that it does is not told yet."""
    return heard.state.phase in (Phase.FLYING, Phase.HOLDING) and now_s - heard.at_s <= SILENT_S


def _place(state: StateShared, home: LatLon, own: Place) -> Place:
    """As fast as this vehicle is, and keeping as much; from its ground, if it tells no height."""
    if state.alt_amsl_m is None:
        alt_amsl_m, ground_amsl_m = own.home_alt_amsl_m + state.alt_rel_m, own.home_alt_amsl_m
    else:
        alt_amsl_m, ground_amsl_m = state.alt_amsl_m, state.alt_amsl_m - state.alt_rel_m
    return Place(
        state.lat_deg,
        state.lon_deg,
        alt_amsl_m,
        *home,
        ground_amsl_m,
        own.speed_m_s,
        own.keeps_m,
        is_returning=True,
    )
