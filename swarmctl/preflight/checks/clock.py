"""Check `clock`: the vehicle's clock agrees with the reference, as records and signed messages require."""

from __future__ import annotations

from swarmctl.preflight.facts import Finding, PreflightFacts

NAME = "clock"
WAIVABLE = True


def check(facts: PreflightFacts) -> Finding:
    wanted = f"a clock within {facts.clock_tolerance_s:g} s of the reference clock"
    offset_s = facts.clock_offset_s
    if offset_s is None:
        return Finding(False, "no time of day in SYSTEM_TIME", wanted, "wait for the first satellites")
    agrees = abs(offset_s) <= facts.clock_tolerance_s
    remedy = (
        "set this machine's clock by NTP, or raise preflight.clock_tolerance_s; a vehicle's clock follows "
        "satellites, a simulated vehicle has its own clock"
    )
    return Finding(agrees, f"a difference of {offset_s:+.1f} s", wanted, "" if agrees else remedy)
