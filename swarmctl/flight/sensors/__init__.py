"""Sensors: what a vehicle sees where it is. Plug-ins that know the truth or a payload; they import core.

`footprint` is the paper's, simulated; `external` is for vehicles whose payload reports over the bus.
`SOURCES` says which of both a vehicle has, by `sensor.source` of the configuration.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Source:
    """Where a vehicle's looks come from."""

    simulated: bool
    """its footprint is simulated"""
    external: bool
    """payloads may report"""


SOURCES = {
    "simulated": Source(simulated=True, external=False),
    "external": Source(simulated=False, external=True),
    "both": Source(simulated=True, external=True),
}
