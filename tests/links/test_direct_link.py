"""A `DirectLink` over the front end and a memory wire, on a virtual clock."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from flying_bench import north_of_home
from link_world import BEGAN_US, World, connected, flying, play
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.events import FlightOrder
from swarmctl.links.base import (
    AddressChanged,
    LinkError,
    SystemIdConflict,
    TransportError,
)
from swarmctl.links.url import Endpoint


async def lands_for_3_s(world: World, component: int, address: str) -> None:
    """Let a component with the vehicle's system id report LAND from an address of its own."""
    codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=component)
    for _ in range(30):
        await asyncio.sleep(0.1)
        heartbeat = mavlink.MAVLink_heartbeat_message(2, 3, 81, 9, 3, 3)
        world.wire.from_vehicle(bytes(heartbeat.pack(codec)), address)


def test_two_vehicles_with_one_system_id_are_a_conflict_and_the_second_is_ignored():
    async def story():
        async with World() as world:
            link = await connected(world)
            await lands_for_3_s(world, 1, "impostor")
            assert world.events.count(SystemIdConflict("impostor")) == 1
            assert link.state().mode == "STABILIZE"

    play(story())


def test_a_companion_with_the_vehicles_system_id_does_not_change_the_address():
    async def story():
        async with World() as world:
            link = await connected(world)
            world.silent = True
            await asyncio.sleep(3)
            await lands_for_3_s(world, 191, "companion")
            assert link.state().mode == "STABILIZE"
            assert link.age_s() > 5.0
            assert not any(isinstance(e, AddressChanged | SystemIdConflict) for e in world.events)

    play(story())


def test_frames_go_to_the_vehicles_address_only_and_one_heartbeat_to_each():
    async def story():
        world = World(*["ardupilot"] * 3)
        world.address = {1: "fleet", 2: "fleet", 3: "third"}
        async with world:
            links = [world.link(i, f"v{i}") for i in (1, 2, 3)]
            await asyncio.gather(*(link.connect(10) for link in links))
            world.to_vehicles.clear()
            await asyncio.sleep(10)
            beats = [a for data, a in world.to_vehicles if data[7:10] == b"\0\0\0"]
            assert beats.count("fleet") == beats.count("third") == 10
            world.to_vehicles.clear()
            await links[2].order(FlightOrder.HOLD)
            assert {a for data, a in world.to_vehicles if data[7:10] != b"\0\0\0"} == {"third"}

    play(story())


def test_two_vehicles_with_one_system_id_on_one_endpoint_are_refused():
    async def story():
        async with World() as world:
            await world.link().connect(10)
            with pytest.raises(LinkError, match=r"beta: .*\b1\b.*\[system-id-twice\]"):
                await world.link(1, "beta").connect(10)
            with pytest.raises(LinkError, match=r"\b255\b.*\[system-id-own\]"):
                await world.link(255, "gamma").connect(10)
            with pytest.raises(TransportError, match=r"known: test"):
                await world.front.open(Endpoint("memory", "other"))
            with pytest.raises(LinkError, match=r"\[not-connected\]"):
                await world.link(2).order(FlightOrder.HOLD)

    play(story())


def test_equal_runs_send_equal_bytes():
    def run() -> list[tuple[bytes, object]]:
        sent = []

        async def story():
            async with World() as world:
                link = await flying(world)
                await link.swap(north_of_home(5, east=0.001))
                sent.extend(world.to_vehicles)

        play(story())
        return sent

    assert run() == run()


def test_the_tlog_is_read_by_pymavlink_with_both_directions(tmp_path):
    path = tmp_path / "alpha.tlog"

    async def story():
        async with World(tlog=path) as world:
            link = await connected(world)
            await link.upload(north_of_home(2))
            await asyncio.sleep(2)

    play(story())
    log = mavutil.mavlink_connection(str(path))
    messages = []
    while (message := log.recv_match()) is not None:
        messages.append((message.get_srcSystem(), message.get_type(), message._timestamp))
    log.close()
    assert {(1, "HEARTBEAT"), (255, "HEARTBEAT"), (1, "MISSION_ACK"), (255, "MISSION_COUNT")} <= {
        m[:2] for m in messages
    }
    assert "BAD_DATA" not in {m[1] for m in messages}
    stamps = [m[2] for m in messages]
    assert stamps == sorted(stamps)
    assert 0.0 <= stamps[0] - BEGAN_US / 1e6 < 1.0


@pytest.mark.parametrize("path", ["/dev/full", "/no/such/folder/alpha.tlog"])
def test_an_unwritable_tlog_is_reported_once_and_the_link_stays(path):
    async def story():
        async with World(tlog=Path(path)) as world:
            link = await connected(world)
            await link.upload(north_of_home(2))
            await asyncio.sleep(10)
            await link.upload(north_of_home(3))
            link.close()
        (line,) = world.said
        assert line.startswith(path)
        assert line.endswith("[log-ended]")

    play(story())


def test_received_frames_are_on_disk_within_two_seconds(tmp_path):
    path = tmp_path / "alpha.tlog"

    async def story():
        async with World(tlog=path) as world:
            await connected(world)
            await asyncio.sleep(10)
            world.silent = True
            await asyncio.sleep(1.1)
            logged = path.read_bytes()
            world.vehicles[1].send_text(4, "the last words")
            world.silent = False
            await asyncio.sleep(1.1)
            assert b"the last words" not in logged
            assert b"the last words" in path.read_bytes()

    play(story())


def test_a_closed_front_end_sends_nothing_and_leaves_no_timers():
    """A failing run closes the front end during an upload and with open telemetry requests."""

    async def story():
        failures: list[dict] = []
        asyncio.get_running_loop().set_exception_handler(lambda _loop, context: failures.append(context))
        world = World()
        async with world:
            link = await connected(world)
            await link.prepare(30, lambda _: None)
            world.silent = True
            uploading = asyncio.create_task(link.upload(north_of_home(3)))
            await asyncio.sleep(0.5)
            await world.front.close()
            await asyncio.sleep(0.01)
            n_sent = len(world.to_vehicles)
            assert world.to_vehicles[-1][0][7:10] == b"\x2f\0\0", "no MISSION_ACK that cancels the upload"
            await asyncio.sleep(120)
            assert len(world.to_vehicles) == n_sent
            assert failures == []
            with pytest.raises(LinkError, match=r"\[interrupted\]"):
                await uploading

    play(story())
