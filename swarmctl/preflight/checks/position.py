"""Check `position`: a live link, a position estimate, and readiness to arm."""

from __future__ import annotations

import math

from swarmctl.preflight.facts import MAX_AGE_S, Finding, PreflightFacts

NAME = "position"
WAIVABLE = False


def check(facts: PreflightFacts) -> Finding:
    wanted = f"a position estimate, pre-arm checks passed, messages at most {MAX_AGE_S:g} s old"
    state = facts.state
    if not facts.age_s <= MAX_AGE_S:
        found = "no heartbeat"
        found += f" for {facts.age_s:.0f} s" if facts.age_s < math.inf else " since the start"
        return Finding(False, found, wanted, "check the vehicle's link")
    if not state.has_position or not facts.position_age_s <= MAX_AGE_S:
        remedy = "wait under open sky; check the estimator"
        return Finding(False, "no recent position in GLOBAL_POSITION_INT", wanted, remedy)
    if not facts.status_age_s <= MAX_AGE_S:
        found = f"no SYS_STATUS within {MAX_AGE_S:g} s, so the readiness to arm is unknown"
        return Finding(False, found, wanted, "find out why the vehicle no longer sends SYS_STATUS")
    if not state.ready:
        reasons = "; ".join(state.not_ready) or "no reason reported"
        if all(any(name in reason for name in facts.fly_sets) for reason in reasons.split("; ")):
            # Such as RTL_AUTOLAND 0 with a landing in the mission of an ArduPlane.
            return Finding.remedied_by_fly(f"not ready to arm: {reasons}", wanted, facts)
        return Finding(False, f"not ready to arm: {reasons}", wanted, "remove the reported causes")
    return Finding(True, f"{state.lat_deg:.6f}, {state.lon_deg:.6f}, ready to arm", wanted)
