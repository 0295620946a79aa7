"""Check `heading`: a fixed wing, which takes off straight ahead, points along the first leg."""

from __future__ import annotations

import math

from swarmctl.preflight.facts import Finding, PreflightFacts, without_route

NAME = "heading"
WAIVABLE = True
MAX_ANGLE_DEG = 25.0
"""greatest angle between the heading and the first leg"""


def check(facts: PreflightFacts) -> Finding:
    if facts.spec.airframe != "plane":
        return Finding(True, "a copter, which takes off on the spot", "any heading")
    state, plan, wanted = facts.state, facts.plan, "a heading along the first leg"
    if plan is None:
        return Finding(False, *without_route(facts, wanted))
    if state.lat_deg is None or state.lon_deg is None:
        return Finding(False, "no position of the vehicle", wanted, "wait for the first position")
    e0, n0 = facts.frame.to_local(state.lat_deg, state.lon_deg)
    e1, n1 = facts.frame.to_local(plan.track[0].lat_deg, plan.track[0].lon_deg)
    leg_deg = math.degrees(math.atan2(e1 - e0, n1 - n0)) % 360.0
    wanted = f"{leg_deg:.0f} degrees (the first leg), within {MAX_ANGLE_DEG:g} degrees"
    if state.heading_deg is None:
        return Finding(False, "no heading in the vehicle's messages", wanted, "check the compass")
    angle_deg = abs((state.heading_deg - leg_deg + 180.0) % 360.0 - 180.0)
    remedy = "" if angle_deg <= MAX_ANGLE_DEG else "turn the vehicle toward the first leg"
    return Finding(angle_deg <= MAX_ANGLE_DEG, f"{state.heading_deg:.0f} degrees", wanted, remedy)
