"""The front end over real sockets and a pseudo terminal."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import tty

import pytest
from link_world import HURRY, fleet_of, play, until
from zenoh_nodes import free_port

from swarmctl.core.events import FlightOrder
from swarmctl.links import line
from swarmctl.links.base import AddressChanged, NoAnswer, TransportError
from swarmctl.links.direct import DirectLink
from swarmctl.links.frontend import FrontEnd
from swarmctl.links.url import Endpoint

pytestmark = pytest.mark.interop
HOST = "127.0.0.1"


class FastCopter:
    """A simulated copter whose time runs faster than the machine's clock."""

    def __init__(self) -> None:
        self.fleet = fleet_of("ardupilot")
        self._began_s = asyncio.get_running_loop().time()

    def now_s(self) -> float:
        return HURRY * (asyncio.get_running_loop().time() - self._began_s)

    def receive(self, data: bytes) -> list[bytes]:
        return [frame for _, frame in self.fleet.receive(data, self.now_s(), peer="station")]

    @contextlib.asynccontextmanager
    async def playing(self, send):
        """Pass the copter's bytes to `send` during the block."""
        task = asyncio.create_task(self._pump(send))
        try:
            yield
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    async def _pump(self, send) -> None:
        while True:
            for _, frame in self.fleet.step(self.now_s()):
                send(frame)
            await asyncio.sleep(0.02)


def front_end() -> FrontEnd:
    return FrontEnd(wall_time_us=lambda: 0)


class CopterSocket(asyncio.DatagramProtocol):
    """A copter behind its own UDP socket."""

    def __init__(self, copter: FastCopter, to=None) -> None:
        self.copter, self.to = copter, to

    def connection_made(self, transport) -> None:
        self.transport = transport

    def datagram_received(self, data, addr) -> None:
        self.to = self.to or addr
        for frame in self.copter.receive(data):
            self.send(frame)

    def send(self, frame: bytes) -> None:
        if self.to is not None:
            self.transport.sendto(frame, self.to)


async def udp_peer(copter: FastCopter, to=None, port: int = 0) -> CopterSocket:
    loop = asyncio.get_running_loop()
    _, peer = await loop.create_datagram_endpoint(lambda: CopterSocket(copter, to), local_addr=(HOST, port))
    return peer


def link(front: FrontEnd, endpoint: Endpoint, events: list | None = None) -> DirectLink:
    return DirectLink(
        front, endpoint, 1, name="alpha", on_event=[].append if events is None else events.append
    )


@pytest.mark.autopilots("1.18")
def test_udp_follows_a_reboot_to_another_port(monkeypatch):
    monkeypatch.setattr(line, "SILENT_S", 0.2)

    async def story():
        here = Endpoint("udpin", HOST, free_port())
        async with front_end() as front:
            events: list = []
            alpha = link(front, here, events)
            copter = FastCopter()
            await front.open(here)
            first = await udp_peer(copter, (HOST, here.port))
            async with copter.playing(first.send):
                assert (await alpha.connect(10)).simulated
            first.transport.close()
            second = await udp_peer(copter, (HOST, here.port))
            async with copter.playing(second.send):
                await until(lambda: any(isinstance(e, AddressChanged) for e in events))
                await alpha.order(FlightOrder.HOLD)
            port = second.transport.get_extra_info("sockname")[1]
            assert AddressChanged(f"{HOST}:{port}") in events
            second.transport.close()

    play(story(), real=True)


def test_udpout_sends_the_first_packet():
    async def story():
        copter, port = FastCopter(), free_port()
        peer = await udp_peer(copter, port=port)
        async with front_end() as front, copter.playing(peer.send):
            await link(front, Endpoint("udpout", HOST, port)).connect(10)
        peer.transport.close()

    play(story(), real=True)


@pytest.mark.parametrize(
    ("kind", "sock"), [("udpin", socket.SOCK_DGRAM), ("tcpin", socket.SOCK_STREAM)], ids=["udp", "tcp"]
)
def test_an_occupied_port_is_a_clear_error(kind, sock):
    async def story():
        with socket.socket(socket.AF_INET, sock) as other:
            other.bind((HOST, 0))
            if sock == socket.SOCK_STREAM:
                other.listen()
            here = Endpoint(kind, HOST, other.getsockname()[1])
            async with front_end() as front:
                with pytest.raises(TransportError, match=r"\[port-taken\]"):
                    await front.open(here)

    play(story(), real=True)


def test_two_front_ends_cannot_share_a_udp_port():
    async def story():
        here = Endpoint("udpin", HOST, free_port())
        async with front_end() as one, front_end() as two:
            await one.open(here)
            await one.open(here)
            with pytest.raises(TransportError, match=r"\[port-taken\]"):
                await two.open(here)

    play(story(), real=True)


@pytest.mark.parametrize(
    "endpoint",
    [Endpoint("udpin", "192.0.2.1", 14550), Endpoint("udpout", "no-such-host.invalid", 1)],
    ids=["address of another machine", "no such host"],
)
def test_an_impossible_address_is_a_clear_error(endpoint):
    async def story():
        async with front_end() as front:
            with pytest.raises(TransportError):
                await front.open(endpoint)

    play(story(), real=True)


async def serve_tcp(copter: FastCopter, port: int):
    writers = []

    async def client(reader, writer):
        writers.append(writer)
        while data := await reader.read(4096):
            for frame in copter.receive(data):
                writer.write(frame)
        writer.close()

    return await asyncio.start_server(client, HOST, port), writers


@pytest.mark.autopilots("1.18")
def test_tcp_out_connects_to_a_late_vehicle_and_again_after_a_cut():
    async def story():
        copter, port = FastCopter(), free_port()
        there = Endpoint("tcpout", HOST, port)
        async with front_end() as front:
            alpha = link(front, there)
            with pytest.raises(NoAnswer, match=r"[Rr]efused|failed"):
                await alpha.connect(0.1)
            server, writers = await serve_tcp(copter, port)
            async with copter.playing(lambda f: [w.write(f) for w in writers[-1:]]):
                await alpha.connect(10)
                writers[-1].close()
                await until(lambda: len(writers) == 2)
                await alpha.order(FlightOrder.HOLD)
            server.close()

    play(story(), real=True)


def test_tcp_in_serves_the_vehicle_that_connects():
    async def story():
        copter, port = FastCopter(), free_port()
        here = Endpoint("tcpin", HOST, port)
        async with front_end() as front:
            alpha = link(front, here)
            await front.open(here)
            reader, writer = await asyncio.open_connection(HOST, port)

            async def read():
                while data := await reader.read(4096):
                    for frame in copter.receive(data):
                        writer.write(frame)

            reading = asyncio.create_task(read())
            async with copter.playing(writer.write):
                await alpha.connect(10)
            writer.close()
            await reading

    play(story(), real=True)


def test_serial_works_through_a_pseudo_terminal_and_survives_its_end():
    async def story():
        own_end, their_end = os.openpty()
        tty.setraw(own_end)
        tty.setraw(their_end)
        copter = FastCopter()
        loop = asyncio.get_running_loop()

        def answer():
            for frame in copter.receive(os.read(own_end, 4096)):
                os.write(own_end, frame)

        loop.add_reader(own_end, answer)
        device = Endpoint("serial", os.ttyname(their_end), baud=57600)
        async with front_end() as front:
            alpha = link(front, device)
            async with copter.playing(lambda f: os.write(own_end, f)):
                await alpha.connect(10)
                await alpha.order(FlightOrder.HOLD)
            loop.remove_reader(own_end)
            os.close(own_end)
            await until(lambda: front.trouble_on(device))
            assert "device" in front.trouble_on(device)
        os.close(their_end)

    play(story(), real=True)


def test_a_missing_serial_device_is_a_clear_error():
    async def story():
        async with front_end() as front:
            with pytest.raises(TransportError, match="/dev/no-such-tty"):
                await front.open(Endpoint("serial", "/dev/no-such-tty", baud=57600))

    play(story(), real=True)


@pytest.mark.parametrize("kind", ["udpin", "tcpin"])
def test_bytes_that_the_loop_has_not_read_count_as_unread(kind: str) -> None:
    socket_kind = socket.SOCK_DGRAM if kind == "udpin" else socket.SOCK_STREAM
    endpoint = Endpoint(kind, HOST, free_port())

    async def story() -> None:
        async with front_end() as ground:
            assert not ground.has_unread(endpoint)
            await ground.open(endpoint)
            with socket.socket(socket.AF_INET, socket_kind) as sender:
                sender.connect((HOST, endpoint.port))
                await until(lambda: kind == "udpin" or ground._lines[endpoint].transport.peers())
                assert not ground.has_unread(endpoint)
                sender.send(bytes(20))
                assert ground.has_unread(endpoint)
                await until(lambda: not ground.has_unread(endpoint))

    play(story(), real=True)
