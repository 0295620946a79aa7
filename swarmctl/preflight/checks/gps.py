"""Check `gps`: the satellite receiver has a good fix."""

from __future__ import annotations

from swarmctl.preflight.facts import Finding, PreflightFacts

NAME = "gps"
WAIVABLE = True
FIX_3D = 3
"""GPS_FIX_TYPE_3D_FIX"""
MIN_SATELLITES = 6
MAX_HDOP = 2.0


def check(facts: PreflightFacts) -> Finding:
    wanted = f"fix type {FIX_3D} (3D) or more, {MIN_SATELLITES} satellites or more, HDOP {MAX_HDOP:g} or less"
    gps = facts.answers.instruments.gps
    if gps is None:
        return Finding(
            False, "no answer to the request for GPS_RAW_INT", wanted, "check the satellite receiver"
        )
    satellites = "unknown" if gps.satellites is None else str(gps.satellites)
    hdop = "unknown" if gps.hdop is None else f"{gps.hdop:.2f}"
    found = f"fix type {gps.fix_type}, {satellites} satellites, HDOP {hdop}"
    is_good = (
        gps.fix_type >= FIX_3D
        and gps.satellites is not None
        and gps.satellites >= MIN_SATELLITES
        and gps.hdop is not None
        and gps.hdop <= MAX_HDOP
    )
    return Finding(is_good, found, wanted, "" if is_good else "wait under open sky, then repeat the command")
