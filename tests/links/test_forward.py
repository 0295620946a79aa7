"""Forwarding: a watching station receives all frames unchanged, and commands only with permission."""

from __future__ import annotations

import asyncio
import socket
from typing import Any

import pytest
from evidence_files import DISARM, HOLD
from link_world import HURRY, WIRE, World, connected, play, until
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.links.base import LinkError
from swarmctl.links.frontend import FrontEnd
from swarmctl.links.transports.memory import MemoryWire
from swarmctl.links.transports.udp import Udp
from swarmctl.links.url import Endpoint, parse_url


class SentRecorder:
    def __init__(self) -> None:
        self.sent: list[tuple[int, str, str]] = []

    def to_vehicle(self, sysid: int, message: Any, by: str = "") -> bool:
        self.sent.append((sysid, message.get_type(), by))
        return True

    def from_vehicle(self, sysid: int, message: Any) -> None:
        pass

    async def wait_until_stored(self) -> str:
        return ""


class WatchedWorld(World):
    """Vehicles, links to them, and a station that receives forwarded frames."""

    def __init__(self, *personalities: str, commands: bool = False) -> None:
        self.recorder = SentRecorder()
        super().__init__(*personalities, evidence=self.recorder)
        self._commands = commands

    async def __aenter__(self) -> WatchedWorld:
        await super().__aenter__()
        await self.forward(commands=self._commands)
        return self


def test_a_watching_station_receives_all_messages_from_and_to_the_vehicles() -> None:
    async def story() -> None:
        async with WatchedWorld("ardupilot", "ardupilot") as world:
            links = [world.link(1), world.link(2, "beta")]
            for link in links:
                await link.connect(10)
                await link.prepare(30, lambda _: None)
            received = world.watching.received()
            beats = {m.get_srcSystem() for m in received if m.get_type() == "HEARTBEAT"}
            assert beats == {1, 2, 255}
            assert {(m.get_type(), m.get_srcSystem()) for m in received} >= {
                ("GLOBAL_POSITION_INT", 1),
                ("GLOBAL_POSITION_INT", 2),
                ("COMMAND_LONG", 255),
                ("COMMAND_ACK", 1),
            }

    play(story())


@pytest.mark.interop
def test_mavutil_receives_all_vehicles_over_udp() -> None:
    station = mavutil.mavlink_connection("udpin:127.0.0.1:0", source_system=250)
    port = station.port.getsockname()[1]
    systems: set[tuple[str, int]] = set()

    def listen() -> bool:
        while (message := station.recv_msg()) is not None:
            systems.add((message.get_type(), message.get_srcSystem()))
        return {("HEARTBEAT", 1), ("HEARTBEAT", 2), ("HEARTBEAT", 255), ("AUTOPILOT_VERSION", 2)} <= systems

    async def story() -> None:
        world = World("ardupilot", "ardupilot")
        world.pace = HURRY
        async with world:
            await world.front.forward(parse_url(f"udpout:127.0.0.1:{port}"))
            await world.link(1).connect(10)
            await world.link(2, "beta").connect(10)
            await until(listen, 10)

    try:
        asyncio.run(story())
    finally:
        station.close()
    assert set(station.sysid_state) >= {1, 2}


def test_frames_are_forwarded_unchanged() -> None:
    async def story() -> None:
        signed = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        signed.signing.secret_key, signed.signing.sign_outgoing = bytes(32), True
        frames = [bytes(mavlink.MAVLink_system_time_message(i, i).pack(signed)) for i in range(3)]
        async with WatchedWorld() as world:
            await world.front.open(WIRE)
            world.wire.from_vehicle(frames[0] + frames[1][:5], "fleet")
            world.wire.from_vehicle(frames[1][5:] + frames[2], "fleet")
            await asyncio.sleep(0.05)
            assert [f for f in world.watching.frames if f in frames] == frames

    play(story())


def test_frames_of_a_watching_station_reach_no_vehicle() -> None:
    async def story() -> None:
        async with WatchedWorld() as world:
            await world.link().connect(10)
            world.watching.say(HOLD)
            await asyncio.sleep(5)
            assert world.sent("COMMAND_LONG", HOLD.command) == []
            assert all(not by for _, _, by in world.recorder.sent)

    play(story())


def test_a_permitted_command_of_another_station_arrives_and_is_recorded_under_its_name() -> None:
    async def story() -> None:
        async with WatchedWorld("ardupilot", "ardupilot", commands=True) as world:
            await world.link(1).connect(10)
            await world.link(2, "beta").connect(10)
            await asyncio.sleep(5)
            world.watching.say(HOLD)
            await until(lambda: world.vehicles[1].mode.name == "GUIDED", 5)
            assert world.vehicles[2].mode.name == "STABILIZE"
            assert (1, "COMMAND_LONG", "station 252 at memory:watcher") in world.recorder.sent
            acks = [m for m in world.watching.received() if m.get_type() == "COMMAND_ACK"]
            assert any(m.command == 176 for m in acks)

    play(story())


@pytest.mark.parametrize("arms", [0, 1])
@pytest.mark.parametrize("code", [21196, 21196.4, 2989, float("nan")])
def test_a_forced_arming_or_disarming_of_another_station_is_never_passed_on(arms: int, code: float) -> None:
    """PX4 rounds the code, and a vehicle disarmed in flight falls."""
    rest = (arms, code, 0, 0, 0, 0, 0)

    async def story() -> None:
        async with WatchedWorld(commands=True) as world:
            await world.link(1).connect(10)
            await asyncio.sleep(5)
            world.watching.say(mavlink.MAVLink_command_long_message(1, 1, 400, 0, *rest))
            world.watching.say(mavlink.MAVLink_command_int_message(0, 0, 0, 400, 0, 0, *rest))
            world.watching.say(HOLD)
            await until(lambda: world.vehicles[1].mode.name == "GUIDED", 5)
            assert world.sent("COMMAND_LONG", 400) == world.sent("COMMAND_INT", 400) == []
            (line,) = world.said
            assert line.startswith("station 252 at memory:watcher ")
            assert line.endswith("[forced]")
            assert world.front.refusal_summary.endswith(": 2")

    play(story())


def test_a_plain_disarming_of_another_station_is_passed_on() -> None:
    async def story() -> None:
        async with WatchedWorld(commands=True) as world:
            await world.link(1).connect(10)
            await asyncio.sleep(5)
            world.watching.say(DISARM)
            await until(lambda: world.sent("COMMAND_LONG", 400), 5)
            assert world.said == []

    play(story())


def test_commands_are_not_accepted_from_an_endpoint_open_to_other_machines() -> None:
    async def story() -> None:
        async with FrontEnd(wall_time_us=lambda: 0) as front:
            for url in ("udpin:0.0.0.0:0", "tcpin:[::]:0", "tcpin:somewhere:0"):
                with pytest.raises(LinkError, match=r"127\.0\.0\.1.*\[open-to-strangers\]"):
                    await front.forward(parse_url(url), commands=True)
            for url in ("udpout:10.0.0.5:14550", "tcpout:somewhere:5760", "udpout:[2001:db8::1]:14550"):
                with pytest.raises(LinkError, match=r"127\.0\.0\.1.*\[open-to-strangers\]"):
                    await front.forward(parse_url(url), commands=True)
            await front.forward(parse_url("udpin:127.0.0.1:0"), commands=True)
            await front.forward(parse_url("udpin:0.0.0.0:0"))

    asyncio.run(story())


def test_only_the_target_of_an_outgoing_endpoint_may_command() -> None:
    def udp() -> socket.socket:
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        made.bind(("127.0.0.1", 0))
        made.setblocking(False)
        return made

    async def story(target_socket: socket.socket, other_socket: socket.socket) -> None:
        world = World()
        async with world:
            target = Endpoint("udpout", "127.0.0.1", target_socket.getsockname()[1])
            await world.front.forward(target, commands=True)
            await connected(world)
            async with asyncio.timeout(10):
                _, ours = await asyncio.get_running_loop().sock_recvfrom(target_socket, 2048)
            station = mavlink.MAVLink(None, srcSystem=252, srcComponent=190)
            for sender, marker in ((other_socket, 3.0), (target_socket, 4.0)):
                params = (marker, 0, 0, 0, 0, 0, 0)
                command = mavlink.MAVLink_command_long_message(1, 1, 520, 0, *params)
                sender.sendto(bytes(command.pack(station)), ("127.0.0.1", ours[1]))
            await until(lambda: world.sent("COMMAND_LONG", 520), 10)
            assert [m.param1 for m in world.sent("COMMAND_LONG", 520)] == [4.0]

    with udp() as target_socket, udp() as other_socket:
        asyncio.run(story(target_socket, other_socket))


@pytest.mark.parametrize(
    ("target", "vehicles"),
    [
        ("udpout:127.0.0.1:14600", "udpin:0.0.0.0:14600"),
        ("tcpout:localhost:14600", "tcpin:127.0.0.1:14600"),
        ("udpin:0.0.0.0:14600", "udpin:0.0.0.0:14600"),
    ],
)
def test_a_forwarding_loop_is_refused_in_either_order(target: str, vehicles: str) -> None:
    async def story() -> None:
        for first_forward in (True, False):
            async with FrontEnd(wall_time_us=lambda: 0) as front:
                steps = [lambda: front.forward(parse_url(target)), lambda: front.open(parse_url(vehicles))]
                first, second = steps if first_forward else steps[::-1]
                await first()
                with pytest.raises(LinkError, match=r"\[forward-loop\]"):
                    await second()

    asyncio.run(story())


def test_a_blocked_udp_socket_drops_frames_instead_of_filling_memory() -> None:
    async def story() -> None:
        here = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        here.bind(("127.0.0.1", 0))
        udp = Udp(Endpoint("udpout", "127.0.0.1", here.getsockname()[1]))
        await udp.open(lambda _data, _address: None)
        (peer,) = udp.peers()

        class BlockedSocket(socket.socket):
            def sendto(self, *_: Any) -> int:
                raise BlockingIOError

        transport: Any = udp._transport
        blocked = BlockedSocket(fileno=socket.dup(transport._sock.fileno()))
        blocked.setblocking(False)
        original, transport._sock = transport._sock, blocked
        for _ in range(100):
            udp.send(bytes(10_000), peer)
        assert transport.get_write_buffer_size() < 100_000
        transport._loop._remove_writer(transport._sock_fd)
        transport._buffer.clear()
        transport._sock = original
        blocked.close()
        await udp.close()
        here.close()

    asyncio.run(story())


def test_a_watching_tcp_station_that_does_not_read_causes_no_delay() -> None:
    async def story() -> None:
        wire = MemoryWire()
        async with FrontEnd(wall_time_us=lambda: 0, memory={"test": wire}) as front:
            await front.forward(Endpoint("tcpin", "127.0.0.1", 0))
            server = front._shared.forwarder._targets[0]._transport._server
            _, writer = await asyncio.open_connection(*server.sockets[0].getsockname())
            await front.open(WIRE)
            vehicle = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
            frame = bytes(mavlink.MAVLink_statustext_message(6, b"x" * 50).pack(vehicle))
            async with asyncio.timeout(20):
                for _ in range(200):
                    wire.from_vehicle(frame * 500, "fleet")
                    await asyncio.sleep(0)
            (connection,) = front._shared.forwarder._targets[0]._transport._connections.values()
            assert connection.transport.get_write_buffer_size() <= (1 << 16) + len(frame)
            writer.transport.abort()

    asyncio.run(story())
