"""Check `telemetry`: positions arrive often enough, so that the radio has room for the other messages."""

from __future__ import annotations

from swarmctl.preflight.facts import Finding, PreflightFacts

NAME = "telemetry"
WAIVABLE = True
MAX_PERIOD_S = 2.5
"""longest mean time between positions; after 3 s a position counts as unknown (`mavlink.telemetry`)"""


def check(facts: PreflightFacts) -> Finding:
    wanted = f"a position every {MAX_PERIOD_S:g} s or sooner"
    every_s = facts.answers.instruments.position_every_s
    if every_s is None:
        return Finding(False, "too few positions", wanted, "check the vehicle's link")
    found = f"a position every {every_s:.1f} s"
    if every_s > MAX_PERIOD_S:
        remedy = "the radio or its data rate (PX4: MAV_0_RATE) is used up: set links.stop_other_streams or "
        return Finding(False, found, wanted, f"{remedy}links.position_hz, or use fewer vehicles on one radio")
    return Finding(True, found, wanted)
