"""Check `route`: the first route is on the vehicle, inside the fence and no higher than the ceiling."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from swarmctl.agent.replan.landing_pattern import pattern_from
from swarmctl.core.mission import FlightPlan
from swarmctl.core.planar import PlanarPoint, stays_inside
from swarmctl.preflight.facts import Finding, PreflightFacts, without_route

NAME = "route"
WAIVABLE = True


def check(facts: PreflightFacts) -> Finding:
    wanted = f"a route inside the fence, up to {facts.ceiling_m:g} m above home"
    state, plan = facts.state, facts.plan
    if plan is None:
        return Finding(False, *without_route(facts, wanted))
    if state.lat_deg is None or state.lon_deg is None:
        return Finding(False, "no position of the vehicle", wanted, "wait for the first position")
    local = facts.frame.to_local
    corners = [local(*place) for place in facts.fence]
    points = [(p.lat_deg, p.lon_deg) for p in (*plan.track, plan.landing)]
    track = [local(state.lat_deg, state.lon_deg), *(local(*point) for point in points)]
    legs_outside = [i for i, (a, b) in enumerate(pairwise(track), 1) if not stays_inside(corners, a, b)]
    where = _landing_outside(facts, plan, corners)
    if where:
        remedy = "widen preflight.fence, or move the start, the goal or the area"
        return Finding(False, f"the landing pattern {where} leaves the fence", wanted, remedy)
    if legs_outside:
        found = f"leg {legs_outside[0]} of {len(track) - 1} leaves the fence"
        remedy = "widen preflight.fence, or move the start, the goal or the area"
        return Finding(False, found, wanted, remedy)
    highest_m = max(plan.takeoff_alt_m, *(p.alt_rel_m for p in (*plan.track, plan.landing)))
    if highest_m > facts.ceiling_m:
        remedy = "raise preflight.fence.max_altitude_m, or fly lower"
        return Finding(False, f"the route climbs to {highest_m:g} m above home", wanted, remedy)
    return Finding(True, f"{len(track) - 1} legs inside, up to {highest_m:g} m", wanted)


def _landing_outside(facts: PreflightFacts, plan: FlightPlan, corners: Sequence[PlanarPoint]) -> str:
    """Return "at the goal" or "at home" if a landing pattern there leaves the fence, else an empty text."""
    for where, approach in (("at the goal", plan.approach), ("at home", plan.home_approach)):
        if approach is None:
            continue
        legs = pairwise(pattern_from(approach, facts.frame).outline())
        if not all(stays_inside(corners, a, b) for a, b in legs if a != b):
            return where
    return ""
