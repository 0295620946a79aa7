"""It is the vehicle that was asked for: system id, a firmware and type that can be flown."""

from __future__ import annotations

from swarmctl.mavlink.firmware import airframe_of, firmware_of
from swarmctl.preflight.facts import Finding, PreflightFacts

NAME = "identity"
WAIVABLE = False


def check(facts: PreflightFacts) -> Finding:
    wanted = f"system {facts.sysid}, ArduPilot or PX4, a {facts.airframe}"
    who = facts.identity
    if who is None:
        return Finding(False, "it has not said who it is", wanted, "see why AUTOPILOT_VERSION does not come")
    airframe = airframe_of(who)
    found = f"system {who.sysid}, {who.firmware}, a {airframe}"
    if airframe != facts.airframe:
        return Finding(False, found, wanted, f"say `airframe: {airframe}` of it: it is planned for otherwise")
    known = who.sysid == facts.sysid and bool(firmware_of(who).name)
    return Finding(known, found, wanted, "" if known else "correct url or sysid, or take the vehicle out")
