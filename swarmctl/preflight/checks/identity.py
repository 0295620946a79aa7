"""Check `identity`: the configured system id, a supported firmware, and the configured airframe."""

from __future__ import annotations

from swarmctl.mavlink.firmware import airframe_of, firmware_of
from swarmctl.preflight.facts import Finding, PreflightFacts

NAME = "identity"
WAIVABLE = False


def check(facts: PreflightFacts) -> Finding:
    wanted = f"system {facts.spec.sysid}, ArduPilot or PX4, a {facts.spec.airframe}"
    identity = facts.identity
    if identity is None:
        return Finding(False, "no AUTOPILOT_VERSION", wanted, "check the vehicle's link")
    airframe = airframe_of(identity)
    found = f"system {identity.sysid}, {identity.firmware}, a {airframe}"
    if airframe != facts.spec.airframe:
        remedy = (
            f"configure the vehicle with `airframe: {airframe}`; its plans are for a {facts.spec.airframe}"
        )
        return Finding(False, found, wanted, remedy)
    matches = identity.sysid == facts.spec.sysid and bool(firmware_of(identity).name)
    return Finding(matches, found, wanted, "" if matches else "correct url or sysid, or remove the vehicle")
