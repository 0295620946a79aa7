"""Behaviour of `link: mavsdk` alone."""

from __future__ import annotations

import asyncio

import pytest
from link_world import World, flying, play, until
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_copter import MODES, Copter, Script
from wire_bench import north_of_home

from swarmctl.core.events import FlightOrder
from swarmctl.links.base import CommandFailed, LinkError
from swarmctl.links.url import Endpoint

pytestmark = pytest.mark.interop
LOITER = next(number for number, name in MODES.items() if name == "LOITER")


def world_of(*copters: Copter) -> World:
    return World(*copters, kind="mavsdk")


def sent_of(world: World, kind: str) -> list:
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    messages = [m for data, _ in world.to_vehicles for m in parser.parse_buffer(data) or []]
    return [m for m in messages if m.get_type() == kind]


def test_a_command_repeated_by_mavsdk_is_dropped_after_a_pilot_takeover():
    async def story():
        async with world_of(Copter(1)) as world:
            link = await flying(world)
            world.to_vehicles.clear()
            copter = world.copters[1]

            on_command_long = copter.on_command_long

            def taken_over(m) -> None:
                if m.command == mavlink.MAV_CMD_DO_SET_MODE:
                    copter.mode = LOITER  # the command is lost
                else:
                    on_command_long(m)

            copter.on_command_long = taken_over
            with pytest.raises(CommandFailed, match="LOITER"):
                await link.order(FlightOrder.HOLD)
            modes = [m for m in sent_of(world, "COMMAND_LONG") if m.command == mavlink.MAV_CMD_DO_SET_MODE]
            assert len(modes) == 1

    play(story(), real=True)


@pytest.mark.full
def test_an_upload_without_its_last_acknowledgement_is_read_back():
    async def story():
        copter = Copter(1, Script(ready_at_s=1.0))
        async with world_of(copter) as world:
            link = world.link()
            await link.connect(5)
            await link.prepare(10, lambda _: None)
            send, lost = copter.send, []

            def lossy(message) -> None:
                if message.get_type() == "MISSION_ACK" and message.type == 0 and not lost:
                    lost.append(message)
                else:
                    send(message)

            copter.send = lossy
            await link.upload(north_of_home(4))
            assert lost
            assert len(link.items()) == len(copter.mission) == 7
            assert len(sent_of(world, "MISSION_COUNT")) == 1, "the mission was sent again"

    play(story(), real=True)


def test_a_vehicle_without_the_messages_that_mavsdk_needs_is_refused_by_name():
    async def story():
        copter = Copter(1, Script(ready_at_s=1.0))
        copter.capabilities = 0
        async with world_of(copter) as world:
            link = world.link()
            await link.connect(5)
            await link.prepare(10, lambda _: None)
            with pytest.raises(LinkError, match=r"alpha .*INT_MESSAGES_NOT_SUPPORTED"):
                await link.upload(north_of_home(4))

    play(story(), real=True)


@pytest.mark.full
def test_fifty_vehicles_share_one_mavsdk_without_mixing_messages():
    async def story():
        world = world_of(*(Copter(i, Script(ready_at_s=1.0)) for i in range(1, 51)))
        world.pace = 1.0
        async with world:
            links = [world.link(i, f"v{i}") for i in range(1, 51)]
            await asyncio.gather(*(link.connect(10) for link in links))
            await asyncio.gather(*(link.prepare(20, lambda _: None) for link in links))
            await asyncio.gather(*(link.upload(north_of_home(i % 7 + 1)) for i, link in enumerate(links)))
            assert [len(link.items()) for link in links] == [i % 7 + 4 for i in range(50)]
            assert [len(c.mission) for c in world.copters.values()] == [i % 7 + 4 for i in range(50)]

    play(story(), real=True)


def test_mavsdk_needs_the_real_clock():
    async def story():
        async with world_of(Copter(1)) as world:
            with pytest.raises(LinkError, match=r"alpha: .*`link: direct` \[virtual-clock\]"):
                await world.link().connect(5)

    play(story())


def test_two_mavsdk_vehicles_with_one_system_id_are_refused():
    async def story():
        async with world_of(Copter(1)) as world:
            await world.link().connect(5)
            other = world.link(1, "beta")
            other.endpoint = Endpoint("memory", "elsewhere")
            with pytest.raises(LinkError, match=r"\b1\b.*\[system-id-twice\]"):
                await other.connect(5)

    play(story(), real=True)


@pytest.mark.full
def test_closing_the_front_end_ends_mavsdk_with_calls_in_flight():
    async def story():
        async with world_of(Copter(1)) as world:
            link = await flying(world)
            world.silent = True
            holding = asyncio.create_task(link.order(FlightOrder.HOLD))
            await until(lambda: sent_of(world, "COMMAND_LONG"))
        holding.cancel()
        await asyncio.wait([holding])

    play(story(), real=True)
