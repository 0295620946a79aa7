"""The simulator inside the ground station's own loop, for runs on the virtual clock.

Only this module imports both `swarmctl` and `sim_vehicle`. In flight the two exchange only MAVLink bytes.
"""

from __future__ import annotations

import asyncio

from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import Scenario as FleetScenario
from swarmctl.config.scenario import Scenario
from swarmctl.flight.simulator import AddressOf, scenario_json
from swarmctl.links.transports.base import Address
from swarmctl.links.transports.memory import MemoryWire

STEP_S = 0.05
"""time between two steps of the simulation [s]"""


async def run_fleet(wire: MemoryWire, scenario: Scenario, address_of: AddressOf) -> None:
    """Simulate a fleet behind `wire`, on the running loop's clock, until cancelled."""
    simulate = scenario.config.simulate
    assert simulate is not None
    fleet_scenario = FleetScenario.model_validate(scenario_json(scenario))
    fleet = Fleet(fleet_scenario, ready_s=simulate.ready_s, keeps_logs=False)
    loop = asyncio.get_running_loop()

    index_at: dict[Address, int] = {}

    def send(frames: list[tuple[int, bytes]]) -> None:
        for index, data in frames:
            sysid = fleet.sysids[index]
            address = address_of(sysid, loop.time())
            if address is not None:
                index_at[address] = index
                wire.from_vehicle(data, address)

    def receive(data: bytes, address: Address) -> None:
        index = index_at[address]
        if address_of(fleet.sysids[index], loop.time()) == address:
            # Also a heartbeat, which has no target, reaches only the vehicle of this address.
            send(fleet.receive(data, loop.time(), peer=address, reach=(index,)))

    wire.connect_vehicles(receive)
    try:
        while True:
            send(fleet.step(loop.time()))
            await asyncio.sleep(STEP_S)
    finally:
        wire.connect_vehicles(None)
