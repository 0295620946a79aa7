"""Its radio has room for what it tells: positions come often enough."""

from __future__ import annotations

from swarmctl.preflight.facts import Finding, PreflightFacts

NAME = "telemetry"
WAIVABLE = True
AT_LEAST_EVERY_S = 2.5
"""a position is forgotten 3 s after it came (`mavlink.telemetry`)"""


def check(facts: PreflightFacts) -> Finding:
    wanted = f"a position every {AT_LEAST_EVERY_S:g} s or sooner"
    every_s = facts.instruments.position_every_s if facts.instruments is not None else None
    if every_s is None:
        return Finding(False, "hardly a position came", wanted, "look at its link")
    found = f"one every {every_s:.1f} s"
    if every_s > AT_LEAST_EVERY_S:
        cure = "its radio, or the rate that it keeps to (PX4: MAV_0_RATE), is full: links.stop_other_streams"
        return Finding(False, found, wanted, f"{cure}, links.position_hz, or fewer vehicles on one radio")
    return Finding(True, found, wanted)
