"""Check `separation`: the first route keeps a distance, in height or over ground, from all other routes."""

from __future__ import annotations

from swarmctl.agent.traffic.separation.approach import closest, intervals
from swarmctl.preflight.facts import Finding, OtherVehicle, PreflightFacts

NAME = "separation"
WAIVABLE = True


def check(facts: PreflightFacts) -> Finding:
    limits = facts.limits
    wanted = f"{limits.vertical_m:g} m of height or {limits.horizontal_m:g} m over ground from all others"
    conflicts = [text for other in facts.others if (text := _conflict_with(facts, other))]
    if conflicts:
        remedy = "change the altitudes (flight.altitude_step_m, vehicles[].altitude_m), or add launch delays"
        return Finding(False, "; ".join(conflicts), wanted, remedy)
    return Finding(True, f"separated from {len(facts.others)} other vehicles", wanted)


def _conflict_with(facts: PreflightFacts, other: OtherVehicle) -> str:
    if other.was_taken_over:
        return ""  # agents compare its flight with the first route before the launch
    one, two = facts.spec, other.spec
    # A copter climbs and descends on the spot, a fixed wing on its route.
    both_copters = one.airframe == two.airframe == "copter"
    if both_copters and abs(two.altitude_m - one.altitude_m) >= facts.limits.vertical_m - 1e-9:
        return ""
    if facts.trajectory is None or other.trajectory is None:
        heights = f" (altitudes {one.altitude_m:g} m and {two.altitude_m:g} m)" if both_copters else ""
        return f"no known route of {two.name if other.trajectory is None else one.name}{heights}"
    approach = closest(facts.trajectory, other.trajectory, facts.limits)
    if approach is None or not intervals(facts.trajectory, other.trajectory, facts.limits):
        return ""
    return f"{approach.horizontal_m:.0f} m over ground from {two.name} after {approach.t_s:.0f} s"
