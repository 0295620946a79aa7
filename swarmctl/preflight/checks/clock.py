"""Its clock is in step, so that what is recorded and signed can be put in order."""

from __future__ import annotations

from swarmctl.preflight.facts import Finding, PreflightFacts

NAME = "clock"
WAIVABLE = True


def check(facts: PreflightFacts) -> Finding:
    wanted = f"a clock within {facts.clock_tolerance_s:g} s"
    offset_s = facts.clock_offset_s
    if offset_s is None:
        return Finding(False, "it tells no time of day", wanted, "wait for its first satellites")
    in_step = abs(offset_s) <= facts.clock_tolerance_s
    cure = (
        "set this machine's clock by NTP; a vehicle takes its time from satellites, and one in software has "
        "its own (preflight.clock_tolerance_s)"
    )
    return Finding(in_step, f"{offset_s:+.1f} s", wanted, "" if in_step else cure)
