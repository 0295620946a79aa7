"""It knows where to return to, and that is here."""

from __future__ import annotations

from swarmctl.core.geo import distance_m
from swarmctl.preflight.facts import Finding, PreflightFacts

NAME = "home"
WAIVABLE = True
NEAR_M = 50.0
"""Home is set anew at arming; one that is far away is of another place or another receiver's."""


def check(facts: PreflightFacts) -> Finding:
    wanted = f"a home within {NEAR_M:g} m of where it stands"
    state = facts.state
    if state.home_lat_deg is None or state.home_lon_deg is None:
        return Finding(False, "it has none, or does not tell", wanted, "wait for its first position")
    if state.lat_deg is None or state.lon_deg is None:
        return Finding(False, "where it stands is not known", wanted, "wait for its first position")
    away_m = distance_m((state.home_lat_deg, state.home_lon_deg), (state.lat_deg, state.lon_deg))
    near = away_m <= NEAR_M
    return Finding(near, f"home {away_m:.0f} m away", wanted, "" if near else "set home where it stands")
