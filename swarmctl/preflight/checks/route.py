"""Its first route is on it and stays inside the fence, leg by leg."""

from __future__ import annotations

from itertools import pairwise

from swarmctl.core.plane import stays_inside
from swarmctl.preflight.facts import Facts, Finding

NAME = "route"
WAIVABLE = True


def check(facts: Facts) -> Finding:
    wanted = f"a route inside the fence and below {facts.ceiling_m:g} m"
    state, plan = facts.state, facts.plan
    if plan is None:
        return Finding(False, "no verified route is on it", wanted, "upload its mission")
    if state.lat_deg is None or state.lon_deg is None:
        return Finding(False, "where it stands is not known", wanted, "wait for its first position")
    local = facts.frame.to_local
    corners = [local(*place) for place in facts.fence]
    points = [(p.lat_deg, p.lon_deg) for p in (*plan.track, plan.landing)]
    way = [local(state.lat_deg, state.lon_deg), *(local(*point) for point in points)]
    outside = [i for i, (a, b) in enumerate(pairwise(way), 1) if not stays_inside(corners, a, b)]
    if outside:
        found = f"leg {outside[0]} of {len(way) - 1} leaves the fence"
        cure = "widen preflight.fence, or move its start, its goal or the area"
        return Finding(False, found, wanted, cure)
    highest_m = max(plan.takeoff_alt_m, *(p.alt_rel_m for p in (*plan.track, plan.landing)))
    if highest_m > facts.ceiling_m:
        cure = "raise preflight.fence.max_altitude_m, or fly lower"
        return Finding(False, f"it climbs to {highest_m:g} m", wanted, cure)
    return Finding(True, f"{len(way) - 1} legs inside, up to {highest_m:g} m", wanted)
