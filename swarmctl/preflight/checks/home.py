"""Check `home`: the home position is set, and near the vehicle."""

from __future__ import annotations

from swarmctl.core.geo import distance_m
from swarmctl.preflight.facts import Finding, PreflightFacts

NAME = "home"
WAIVABLE = True
MAX_DISTANCE_M = 50.0
"""greatest distance between home and vehicle; a home set at another airfield is farther"""


def check(facts: PreflightFacts) -> Finding:
    wanted = f"a home within {MAX_DISTANCE_M:g} m of the vehicle"
    state = facts.state
    if state.home_lat_deg is None or state.home_lon_deg is None:
        return Finding(False, "no HOME_POSITION", wanted, "wait for the first position")
    if state.lat_deg is None or state.lon_deg is None:
        return Finding(False, "no position of the vehicle", wanted, "wait for the first position")
    away_m = distance_m((state.home_lat_deg, state.home_lon_deg), (state.lat_deg, state.lon_deg))
    is_near = away_m <= MAX_DISTANCE_M
    return Finding(is_near, f"home {away_m:.0f} m away", wanted, "" if is_near else "set home at the vehicle")
