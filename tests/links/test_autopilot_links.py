"""Links to simulated autopilots that reboot, send unknown messages and print text, on a virtual clock."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any

import pytest
from link_world import WIRE, north, play, until

from sim_vehicle.faults.spec import parse_fault
from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import Scenario
from swarmctl.links.base import AddressChanged, SystemIdConflict, VehicleRebooted
from swarmctl.links.direct import DirectLink
from swarmctl.links.frontend import FrontEnd
from swarmctl.links.transports.memory import MemoryWire


class FleetWorld:
    """Simulated vehicles; each boot sends from a new port, as ArduPilot's UDP does."""

    def __init__(self, *personalities: str) -> None:
        vehicles = [
            {"sysid": n, "lat_deg": 46.049 + 0.001 * n, "lon_deg": 14.506, "personality": personality}
            for n, personality in enumerate(personalities, 1)
        ]
        self.fleet = Fleet(Scenario.model_validate({"seed": 1, "vehicles": vehicles}), ready_s=3.0)
        self.wire = MemoryWire()
        self.wire.connect_vehicles(self._to_vehicles)
        self.sent_to: list[Any] = []
        self.raw: list[bytes] = []
        self.events: list[Any] = []
        self.front = FrontEnd(wall_time_us=lambda: 0, memory={"test": self.wire})

    def port(self, index: int) -> tuple[str, int]:
        return f"vehicle {index + 1}", 14_000 + self.fleet.boots()[index]

    def link(self, sysid: int = 1) -> DirectLink:
        return DirectLink(self.front, WIRE, sysid, name=f"uav{sysid}", on_event=self.events.append)

    def _to_vehicles(self, data: bytes, address: Any) -> None:
        self.sent_to.append(address)
        targets = [i for i in range(len(self.fleet.vehicles)) if self.port(i) == address]
        now = asyncio.get_running_loop().time()
        self._from(self.fleet.receive(data, now, peer=address, reach=targets))

    def _from(self, frames: Any) -> None:
        for index, data in frames:
            self.raw.append(data)
            self.wire.from_vehicle(data, self.port(index))

    async def _move(self) -> None:
        while True:
            self._from(self.fleet.step(asyncio.get_running_loop().time()))
            await asyncio.sleep(0.05)

    async def __aenter__(self) -> FleetWorld:
        self._task = asyncio.create_task(self._move())
        return self

    async def __aexit__(self, *_error: object) -> None:
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task
        await self.front.close()


@pytest.mark.autopilots("1.1", "1.2", "1.18")
def test_a_rebooted_vehicle_is_followed_to_its_new_port():
    async def story():
        async with FleetWorld("ardupilot") as world:
            link = world.link()
            await link.connect(10)
            await link.prepare(60, lambda _: None)
            old = world.port(0)
            world.raw.clear()
            world.fleet.inject(parse_fault("reboot:silence_s=1.5"), asyncio.get_running_loop().time())
            await until(lambda: VehicleRebooted() in world.events)
            new = world.port(0)
            assert new != old
            assert AddressChanged(f"{new[0]}:{new[1]}") in world.events
            assert any(not data.startswith(b"\xfd") for data in world.raw), "no text printed by the boot"
            await until(lambda: link.state().has_position)
            world.sent_to.clear()
            await link.prepare(60, lambda _: None)
            await link.upload(north(2))
            assert set(world.sent_to) == {new}
            assert not any(isinstance(event, SystemIdConflict) for event in world.events)

    play(story())


@pytest.mark.autopilots("1.19", of="px4")
def test_unknown_messages_create_no_vehicle_with_system_id_0():
    async def story():
        async with FleetWorld("px4") as world:
            link = world.link()
            await link.connect(10)
            await asyncio.sleep(30)
            assert world.front.systems_on(WIRE) == {1}
            assert link.state().mode == "AUTO.LOITER"

    play(story())


@pytest.mark.autopilots("1.15", "1.18")
def test_system_ids_distinguish_a_mixed_fleet_on_one_endpoint():
    async def story():
        async with FleetWorld("ardupilot", "px4", "ardupilot") as world:
            links = [world.link(sysid) for sysid in (1, 2, 3)]
            await asyncio.gather(*(link.connect(10) for link in links))
            await asyncio.gather(*(link.prepare(60, lambda _: None) for link in links))
            await asyncio.gather(*(link.upload(north(2 + i)) for i, link in enumerate(links)))
            assert [link.state().mode for link in links] == ["GUIDED", "AUTO.LOITER", "GUIDED"]
            counts = [vehicle.mission.count for vehicle in world.fleet.vehicles]
            assert counts == [len(link.items()) for link in links] == [5, 5, 7]
            await links[1].launch()
            assert [vehicle.armed for vehicle in world.fleet.vehicles] == [False, True, False]
            assert set(world.sent_to) == {world.port(i) for i in range(3)}

    play(story())
