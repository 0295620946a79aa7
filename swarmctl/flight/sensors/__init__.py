"""Sensors: the observations that a vehicle makes at its position. Plug-ins; they import core.

`footprint` simulates the paper's sensor and knows the true threats. `external` is for vehicles whose payload
reports over the bus. `SOURCES` maps `sensor.source` of the configuration to the sensors in use.
A sensor has one method, `look(vehicle)`; `swarmctl.flight.wiring` makes the simulated one of each vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Source:
    """The origin of a vehicle's observations."""

    simulated: bool
    """the footprint is simulated"""
    external: bool
    """payloads may report"""


SOURCES = {
    "simulated": Source(simulated=True, external=False),
    "external": Source(simulated=False, external=True),
    "both": Source(simulated=True, external=True),
}
