"""The checks that a vehicle passes before it is armed: one module each, with a line in `CHECKS`.

A check has `NAME`, `WAIVABLE` and `check(facts) -> Finding`. A check fails if a required fact is unknown.
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
