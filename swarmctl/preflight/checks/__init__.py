"""What has to be so of a vehicle that is armed: one module a check, with a line in `CHECKS`.

A check has `NAME`, `WAIVABLE` and `check(facts) -> Finding`. What is not known is not so.
"""

from __future__ import annotations

from swarmctl.preflight.checks import (
    battery,
    clock,
    fence,
    gps,
    heading,
    home,
    identity,
    parameters,
    position,
    rally,
    route,
    separation,
    telemetry,
    unique,
)
from swarmctl.preflight.facts import Check

CHECKS: tuple[Check, ...] = (
    identity,
    unique,
    position,
    gps,
    home,
    telemetry,
    clock,
    battery,
    parameters,
    fence,
    rally,
    route,
    heading,
    separation,
)
