"""Behaviour of `link: mavsdk` alone."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from flying_bench import north_of_home
from link_world import World, flying, play, until
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simulated_answers import answer, identify_as

from sim_vehicle.vehicle.commands import NO_ANSWER
from swarmctl.core.events import FlightOrder
from swarmctl.links.base import CommandFailed, LinkError
from swarmctl.links.url import Endpoint

pytestmark = pytest.mark.interop
LOITER = 5
ACK = b"\x2f\0\0"
"""the type of MISSION_ACK in a frame"""


def mavsdk_world(*personalities: str) -> World:
    return World(*personalities, kind="mavsdk", ready_s=1.0)


def test_a_command_repeated_by_mavsdk_is_dropped_after_a_pilot_takeover():
    async def story():
        async with mavsdk_world() as world:
            link = await flying(world)
            world.to_vehicles.clear()

            def taken_over(vehicle: Any, _command: object, _now: float) -> int:
                vehicle.modes.enter(LOITER)  # the command is lost
                return NO_ANSWER

            answer(world.vehicles[1], mavlink.MAV_CMD_DO_SET_MODE, lambda _usual: taken_over)
            with pytest.raises(CommandFailed, match="LOITER"):
                await link.order(FlightOrder.HOLD)
            assert len(world.sent("COMMAND_LONG", mavlink.MAV_CMD_DO_SET_MODE)) == 1

    play(story(), real=True)


@pytest.mark.full
def test_an_upload_without_its_last_acknowledgement_is_read_back():
    async def story():
        async with mavsdk_world() as world:
            link = world.link()
            await link.connect(5)
            await link.prepare(10, lambda _: None)
            lost = []
            world.loses = lambda frame: frame[7:10] == ACK and not lost and not lost.append(frame)
            await link.upload(north_of_home(4))
            assert lost
            assert len(link.items()) == world.vehicles[1].mission.count == 7
            assert len(world.sent("MISSION_COUNT")) == 1, "the mission was sent again"

    play(story(), real=True)


def test_a_vehicle_without_the_messages_that_mavsdk_needs_is_refused_by_name():
    async def story():
        async with mavsdk_world() as world:
            identify_as(world.vehicles[1], b"sim_vehicle\0", capabilities=0)
            link = world.link()
            await link.connect(5)
            await link.prepare(10, lambda _: None)
            with pytest.raises(LinkError, match=r"alpha .*INT_MESSAGES_NOT_SUPPORTED"):
                await link.upload(north_of_home(4))

    play(story(), real=True)


@pytest.mark.full
def test_fifty_vehicles_share_one_mavsdk_without_mixing_messages():
    async def story():
        world = mavsdk_world(*["ardupilot"] * 50)
        world.pace = 1.0
        async with world:
            links = [world.link(i, f"v{i}") for i in range(1, 51)]
            await asyncio.gather(*(link.connect(10) for link in links))
            await asyncio.gather(*(link.prepare(20, lambda _: None) for link in links))
            await asyncio.gather(*(link.upload(north_of_home(i % 7 + 1)) for i, link in enumerate(links)))
            assert [len(link.items()) for link in links] == [i % 7 + 4 for i in range(50)]
            assert [vehicle.mission.count for vehicle in world.fleet.vehicles] == [
                i % 7 + 4 for i in range(50)
            ]

    play(story(), real=True)


def test_mavsdk_needs_the_real_clock():
    async def story():
        async with mavsdk_world() as world:
            with pytest.raises(LinkError, match=r"alpha: .*`link: direct` \[virtual-clock\]"):
                await world.link().connect(5)

    play(story())


def test_two_mavsdk_vehicles_with_one_system_id_are_refused():
    async def story():
        async with mavsdk_world() as world:
            await world.link().connect(5)
            other = world.link(1, "beta")
            other.endpoint = Endpoint("memory", "elsewhere")
            with pytest.raises(LinkError, match=r"\b1\b.*\[system-id-twice\]"):
                await other.connect(5)

    play(story(), real=True)


@pytest.mark.full
def test_closing_the_front_end_ends_mavsdk_with_calls_in_flight():
    async def story():
        async with mavsdk_world() as world:
            link = await flying(world)
            world.silent = True
            holding = asyncio.create_task(link.order(FlightOrder.HOLD))
            await until(lambda: world.sent("COMMAND_LONG"))
        holding.cancel()
        await asyncio.wait([holding])

    play(story(), real=True)
