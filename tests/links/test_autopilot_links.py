"""Links to simulated autopilots that reboot, send unknown messages and print text, on a virtual clock."""

from __future__ import annotations

import asyncio

import pytest
from flying_bench import north_of_home
from link_world import WIRE, World, connected, play, until

from sim_vehicle.faults.spec import parse_fault
from swarmctl.core.events import Rebooted
from swarmctl.links.base import AddressChanged, SystemIdConflict


@pytest.mark.autopilots("1.1", "1.2", "1.18")
def test_a_rebooted_vehicle_is_followed_to_its_new_port():
    async def story():
        async with World("ardupilot") as world:
            link = await connected(world)
            await link.prepare(60, lambda _: None)
            old = world.port(0)
            world.from_vehicles.clear()
            world.fleet.inject(parse_fault("reboot:silence_s=1.5"), asyncio.get_running_loop().time())
            await until(lambda: Rebooted() in world.events)
            new = world.port(0)
            assert new != old
            assert AddressChanged(f"{new[0]}:{new[1]}") in world.events
            assert any(not data.startswith(b"\xfd") for data in world.from_vehicles), (
                "no text printed by the boot"
            )
            await until(lambda: link.state().has_position)
            world.to_vehicles.clear()
            await link.prepare(60, lambda _: None)
            await link.upload(north_of_home(2))
            assert {address for _, address in world.to_vehicles} == {new}
            assert not any(isinstance(event, SystemIdConflict) for event in world.events)

    play(story())


@pytest.mark.autopilots("1.19", of="px4")
def test_unknown_messages_create_no_vehicle_with_system_id_0():
    async def story():
        async with World("px4") as world:
            link = await connected(world)
            await asyncio.sleep(30)
            assert world.front.systems_on(WIRE) == {1}
            assert link.state().mode == "AUTO.LOITER"

    play(story())


@pytest.mark.autopilots("1.15", "1.18")
def test_system_ids_distinguish_a_mixed_fleet_on_one_endpoint():
    async def story():
        async with World("ardupilot", "px4", "ardupilot") as world:
            links = [world.link(sysid) for sysid in (1, 2, 3)]
            await asyncio.gather(*(link.connect(10) for link in links))
            await asyncio.gather(*(link.prepare(60, lambda _: None) for link in links))
            await asyncio.gather(*(link.upload(north_of_home(2 + i)) for i, link in enumerate(links)))
            assert [link.state().mode for link in links] == ["GUIDED", "AUTO.LOITER", "GUIDED"]
            counts = [vehicle.mission.count for vehicle in world.fleet.vehicles]
            assert counts == [len(link.items()) for link in links] == [5, 5, 7]
            await links[1].launch()
            assert [vehicle.armed for vehicle in world.fleet.vehicles] == [False, True, False]
            assert {address for _, address in world.to_vehicles} == {world.port(i) for i in range(3)}

    play(story())
