"""Its first route is apart from those of the others: in height, or at every time over ground."""

from __future__ import annotations

from swarmctl.agent.traffic.separation.approach import closest, intervals
from swarmctl.preflight.facts import Finding, OtherVehicle, PreflightFacts

NAME = "separation"
WAIVABLE = True


def check(facts: PreflightFacts) -> Finding:
    limits = facts.limits
    wanted = f"{limits.vertical_m:g} m of height or {limits.horizontal_m:g} m over ground from all others"
    near = [text for other in facts.others if (text := _too_near(facts, other))]
    if near:
        cure = "give them other altitudes (flight.altitude_step_m, vehicles[].altitude_m), or delays"
        return Finding(False, "; ".join(near), wanted, cure)
    return Finding(True, f"apart from {len(facts.others)} others", wanted)


def _too_near(facts: PreflightFacts, other: OtherVehicle) -> str:
    # What hovers goes up and down on the spot; a fixed wing does so on its way.
    hover = facts.airframe == other.airframe == "copter"
    if hover and abs(other.altitude_m - facts.altitude_m) >= facts.limits.vertical_m - 1e-9:
        return ""
    if facts.flight is None or other.flight is None:
        what = f"{other.name} flies at {other.altitude_m:g} m too" if hover else f"{other.name} flies too"
        return f"{what}, and where is not known here"
    at = closest(facts.flight, other.flight, facts.limits)
    if at is None or not intervals(facts.flight, other.flight, facts.limits):
        return ""
    return f"{at.horizontal_m:.0f} m over ground from {other.name} after {at.t_s:.0f} s"
