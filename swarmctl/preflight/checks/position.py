"""It knows where it is, would arm, and is heard."""

from __future__ import annotations

from swarmctl.preflight.facts import MAX_AGE_S, Finding, PreflightFacts

NAME = "position"
WAIVABLE = False


def check(facts: PreflightFacts) -> Finding:
    wanted = f"a position estimate, pre-arm checks passed, heard within {MAX_AGE_S:g} s"
    state = facts.state
    if not facts.age_s <= MAX_AGE_S:
        found = f"last heard {facts.age_s:.0f} s ago" if facts.age_s < float("inf") else "never heard"
        return Finding(False, found, wanted, "look at its link")
    if not state.has_position or not facts.position_age_s <= MAX_AGE_S:
        return Finding(False, "it tells no position", wanted, "wait under open sky; look at its estimator")
    if not facts.status_age_s <= MAX_AGE_S:
        found = "whether it would arm was told too long ago, or never"
        return Finding(False, found, wanted, "see why SYS_STATUS does not come any more")
    if not state.ready:
        reasons = "; ".join(state.not_ready) or "it does not say why"
        return Finding(False, f"not ready to arm: {reasons}", wanted, "clear what it says")
    return Finding(True, f"{state.lat_deg:.6f}, {state.lon_deg:.6f}, ready to arm", wanted)
