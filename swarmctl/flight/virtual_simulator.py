"""The simulator inside the ground station's own loop, for runs on the virtual clock.

Only this module imports both `swarmctl` and `sim_vehicle`. In flight the two exchange only MAVLink bytes.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import Any, Protocol

from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import Scenario as FleetScenario
from swarmctl.config.scenario import Scenario
from swarmctl.flight.simulator import scenario_json
from swarmctl.links.transports.base import Address
from swarmctl.links.transports.memory import MemoryWire

STEP_S = 0.05
"""time between two steps of the simulation [s]"""


Frames = list[tuple[int, bytes]]
"""(index of the vehicle, frame)"""


class Vehicles(Protocol):
    """The part of the simulator's `Fleet` that a wire uses."""

    @property
    def sysids(self) -> Sequence[int]: ...

    def step(self, now: float) -> Frames: ...

    def receive(self, data: bytes, now: float, *, peer: Address, reach: Sequence[int]) -> Frames: ...


def fleet_of(scenario: Scenario, content: dict[str, Any] | None = None) -> Fleet:
    """Return the simulated vehicles of a scenario; `content`: what replaces `scenario_json`."""
    simulate = scenario.config.simulate
    assert simulate is not None
    made = FleetScenario.model_validate(scenario_json(scenario) if content is None else content)
    return Fleet(made, ready_s=simulate.ready_s, keeps_logs=False)


async def simulate(wire: MemoryWire, scenario: Scenario) -> None:
    """Simulate the vehicles of a scenario behind `wire`, on the running loop's clock, until cancelled."""
    await serve(wire, fleet_of(scenario))


async def serve(wire: MemoryWire, vehicles: Vehicles) -> None:
    """Step vehicles behind `wire`, each at an address of its own, until cancelled."""
    loop = asyncio.get_running_loop()
    addresses: list[Address] = [("simulated", sysid) for sysid in vehicles.sysids]

    def send(frames: Frames) -> None:
        for index, data in frames:
            wire.from_vehicle(data, addresses[index])

    def receive(data: bytes, address: Address) -> None:
        # Also a heartbeat, which has no target, reaches only the vehicle of this address.
        reach = (addresses.index(address),)
        send(vehicles.receive(data, loop.time(), peer=address, reach=reach))

    wire.connect_vehicles(receive)
    try:
        while True:
            send(vehicles.step(loop.time()))
            await asyncio.sleep(STEP_S)
    finally:
        wire.connect_vehicles(None)
