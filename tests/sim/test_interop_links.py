"""All transports with plain sockets: ports, several stations, reboots, slow and noisy peers, a bug."""

import asyncio
import contextlib
import socket
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simulator_process import (
    LIMIT_S,
    Ground,
    free_tcp_port,
    free_udp_port,
    line,
    simulator,
    udp_socket,
    udp_sockets,
)

from sim_vehicle.fleet import Fleet
from sim_vehicle.links import LinkCallbacks, make_link
from sim_vehicle.links.stream import Stream
from sim_vehicle.links.udp import MAX_PEERS
from sim_vehicle.links.url import parse_url
from sim_vehicle.scenarios import default_scenario
from sim_vehicle.serving.pace import RealTime
from sim_vehicle.serving.server import Server
from sim_vehicle.station.messages import heartbeat
from sim_vehicle.wire.outbox import Frames

pytestmark = pytest.mark.interop


def client(port: int) -> Ground:
    return Ground(socket.create_connection(("127.0.0.1", port), LIMIT_S))


# -- UDP ---------------------------------------------------------------------------------------------------


def test_vehicles_on_separate_ports_receive_their_own_messages() -> None:
    opened = udp_sockets(3)
    url = f"udpout:127.0.0.1:{opened[0].getsockname()[1]}"
    with simulator("--count", "3", "--per-port", "1", "--speedup", "5", "--url", url) as process:
        assert f"{url.replace(':', ' ', 1)} to {opened[2].getsockname()[1]}" in line(process)
        grounds = [Ground(udp) for udp in opened]
        for sysid, ground in enumerate(grounds, 1):
            ground.systems(sysid)
        # A broadcast command on one port reaches the vehicle of this port only.
        grounds[1].answered(5, 2)
        grounds[2].answered(6, 3)
        assert [m for m in grounds[2].received if m.get_type() == "TIMESYNC" and m.ts1 == 5] == []
        assert [ground.received_systems for ground in grounds] == [{1}, {2}, {3}]
    for udp in opened:
        udp.close()


@pytest.mark.autopilots("1.18")
def test_a_rebooted_vehicle_returns_from_another_port() -> None:
    udp, port = udp_socket()
    with udp, simulator("--count", "2", "--speedup", "5", "--url", f"udpout:127.0.0.1:{port}"):
        ground = Ground(udp)
        ground.systems(1, 2)
        shared = ground.address
        ground.reboot(2)
        ground.until(
            lambda m: m.get_type() == "HEARTBEAT" and m.get_srcSystem() == 2 and ground.address != shared
        )
        moved = ground.address
        assert b"Init ArduCopter" in ground.raw
        ground.answered(99, 2, moved)
        ground.answered(100, 1, shared)
        # MAVSDK sends each message to every known address; each vehicle still receives it once.
        for address in (moved, shared):
            ground.send(mavlink.MAVLink_timesync_message(0, 101), address)
        ground.answered(102, 2, moved)
        ground.answered(103, 1, shared)
        answers = [m.get_srcSystem() for m in ground.received if m.get_type() == "TIMESYNC" and m.ts1 == 101]
        assert sorted(answers) == [1, 2]


@pytest.mark.full
@pytest.mark.autopilots("1.18")
def test_messages_from_another_port_are_ignored() -> None:
    udp, port = udp_socket()
    stranger, _ = udp_socket()
    with udp, stranger, simulator("--speedup", "5", "--url", f"udpout:127.0.0.1:{port}"):
        ground = Ground(udp)
        ground.systems(1)
        Ground(stranger, ground.address).send(mavlink.MAVLink_timesync_message(0, 7))
        ground.answered(8, 1)
        assert [m.ts1 for m in ground.received if m.get_type() == "TIMESYNC" and m.tc1] == [8]


def test_a_listening_udp_fleet_answers_every_sender() -> None:
    port = free_udp_port()
    with simulator("--speedup", "5", "--url", f"udpin:127.0.0.1:{port}") as process:
        assert line(process)
        one, _ = udp_socket()
        other, _ = udp_socket()
        with one, other:
            grounds = [Ground(udp, ("127.0.0.1", port), sysid=i) for i, udp in enumerate((one, other), 254)]
            for ground in grounds:
                ground.send(heartbeat())
            for ground in grounds:
                ground.systems(1)
            grounds[0].answered(3, 1)
            grounds[1].until(
                lambda m: m.get_type() == "TIMESYNC" and m.ts1 == 3
            )  # both receive everything, as on a radio


def test_a_listening_port_keeps_a_bounded_number_of_peers() -> None:
    async def crowd() -> tuple[int, list[object]]:
        gone: list[object] = []
        enough = asyncio.Event()

        def forgotten(peer: object) -> None:
            gone.append(peer)
            if len(gone) == 8:
                enough.set()

        port = free_udp_port()
        link = make_link(
            parse_url(f"udpin:127.0.0.1:{port}"),
            LinkCallbacks(lambda data, peer, reach: None, forgotten, lambda text: None),
            vehicles=[0],
        )
        link.open()
        with contextlib.ExitStack() as peers:
            for _ in range(MAX_PEERS + 8):
                peers.enter_context(udp_socket()[0]).sendto(b"here", ("127.0.0.1", port))
            async with asyncio.timeout(LIMIT_S):
                await enough.wait()
        stations = link.stations()
        link.close()
        return stations, gone

    stations, gone = asyncio.run(crowd())
    assert stations == MAX_PEERS
    assert len(set(gone)) == 8


# -- TCP ---------------------------------------------------------------------------------------------------


def test_several_tcp_clients_are_served_and_may_disconnect() -> None:
    port = free_tcp_port()
    with simulator("--count", "2", "--speedup", "5", "--url", f"tcpin:127.0.0.1:{port}") as process:
        assert line(process)
        for _ in range(2):
            with client(port) as one, client(port) as other:
                one.systems(1, 2)
                other.systems(1, 2)


@pytest.mark.full
@pytest.mark.autopilots("1.18")
def test_a_reboot_closes_the_connection_of_a_vehicle_with_its_own_port() -> None:
    port = free_tcp_port(2, step=10)
    more = ("--count", "2", "--per-port", "1", "--port-step", "10", "--url", f"tcpin:127.0.0.1:{port}")
    with simulator(*more, "--speedup", "5") as process:
        assert line(process)
        with client(port) as first:
            with client(port + 10) as second:
                first.systems(1)
                second.systems(2)
                second.reboot(2)
                with pytest.raises(ConnectionError):
                    second.until(lambda m: False)
            with client(port + 10) as again:
                again.systems(2)
            first.answered(4, 1)
            assert first.received_systems == {1}


@pytest.mark.full
def test_the_limit_of_open_files_is_raised_for_clients() -> None:
    port = free_tcp_port(3)
    more = ("--count", "3", "--per-port", "1", "--speedup", "5", "--url", f"tcpin:127.0.0.1:{port}")
    with simulator(*more, before="ulimit -Sn 64") as process, contextlib.ExitStack() as clients:
        assert line(process)
        for index in range(90):
            ground = clients.enter_context(client(port + index % 3))
            ground.systems(1 + index % 3)


def test_a_stalled_client_costs_bounded_memory_and_gets_whole_frames() -> None:
    async def flood() -> tuple[bytes, int]:
        writer, reader = socket.socketpair()
        writer.setblocking(False)
        received = bytearray()
        stream = Stream(
            writer.fileno(), writer.recv, writer.send,
            backlog_bytes=10_000, received=lambda data: None, ended=lambda why: None,
        )  # fmt: skip
        for number in range(5000):
            stream.send([(0, number.to_bytes(4, "big") * 100)])
        reader.setblocking(False)
        loop = asyncio.get_running_loop()
        sent = (5000 - stream.dropped) * 400
        async with asyncio.timeout(LIMIT_S):
            while len(received) < sent:
                received += await loop.sock_recv(reader, 65_536)
        stream.detach()
        writer.close()
        reader.close()
        return bytes(received), stream.dropped

    received, dropped = asyncio.run(flood())
    assert dropped > 1000
    chunks = [received[i : i + 400] for i in range(0, len(received), 400)]
    assert all(chunk == chunk[:4] * 100 for chunk in chunks)
    numbers = [int.from_bytes(chunk[:4], "big") for chunk in chunks]
    assert numbers == sorted(set(numbers))


# -- several at once, and nonsense -------------------------------------------------------------------------


@pytest.mark.full
def test_one_fleet_is_served_at_several_urls() -> None:
    udp, udp_port = udp_socket()
    port = free_tcp_port()
    urls = ("--url", f"127.0.0.1:{udp_port}", "--url", f"tcpin:127.0.0.1:{port}")
    with udp, simulator("--speedup", "5", *urls) as process:
        assert f"udpout 127.0.0.1:{udp_port} and tcpin 127.0.0.1:{port}" in line(process)
        over_udp = Ground(udp)
        with client(port) as over_tcp:
            over_udp.systems(1)
            over_tcp.systems(1)
            over_tcp.answered(21, 1)
            over_udp.until(lambda m: m.get_type() == "TIMESYNC" and m.ts1 == 21)
            over_udp.answered(22, 1)


def test_a_bug_on_the_receive_path_stops_the_server() -> None:
    class BuggyFleet(Fleet):
        def receive(self, *_data: Any, **_how: Any) -> Frames:
            raise ZeroDivisionError("a bug")

    async def serve_and_speak() -> None:
        async with asyncio.timeout(LIMIT_S):
            serving = asyncio.create_task(server.run())
            _, address = await asyncio.to_thread(udp.recvfrom, 4096)
            udp.sendto(b"\xfd", address)
            await serving

    udp, port = udp_socket()
    fleet = BuggyFleet(default_scenario(1, home=(46.0, 14.5, 300.0)))
    url = parse_url(f"udpout:127.0.0.1:{port}")
    server = Server(fleet, [url], RealTime(1.0, print), warn=print)
    with udp, pytest.raises(ZeroDivisionError):
        asyncio.run(serve_and_speak())
