"""All transports on an event loop with a test's clock: lost links, silent peers, shortage of files."""

import asyncio
import contextlib
import errno
import os
import resource
import selectors
import socket
import struct
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any, TypeVar

import pytest
from simulator_process import LIMIT_S, SerialDevice, free_tcp_port, free_udp_port, udp_socket

from sim_vehicle.links import Link, LinkCallbacks, LinkError, make_link
from sim_vehicle.links.stream import Stream
from sim_vehicle.links.url import parse_url

pytestmark = pytest.mark.interop
Result = TypeVar("Result")


class Loop(asyncio.SelectorEventLoop):
    """An event loop whose clock a test can advance."""

    def __init__(self) -> None:
        self.selector = selectors.DefaultSelector()
        self.ahead_s = 0.0
        self.bugs: list[dict[str, Any]] = []
        super().__init__(self.selector)
        self.set_exception_handler(lambda _, context: self.bugs.append(context))

    def time(self) -> float:
        return super().time() + self.ahead_s

    async def forward(self, seconds: float) -> None:
        """Advance the clock and run everything that becomes due."""
        self.ahead_s += seconds
        for _ in range(3):
            await asyncio.sleep(0)

    async def until(self, condition: Callable[[], object]) -> None:
        async with asyncio.timeout(LIMIT_S):
            while not condition():  # noqa: ASYNC110 - no event to wait for
                await asyncio.sleep(0)


def in_loop(test: Callable[[Loop], Coroutine[Any, Any, Result]]) -> Result:
    loop = Loop()
    with asyncio.Runner(loop_factory=lambda: loop) as runner:
        result = runner.run(test(loop))
    assert loop.bugs == []
    return result


class LinkEvents:
    """The input, ended peers and warnings of a link."""

    def __init__(self) -> None:
        self.data: list[bytes] = []
        self.gone: list[object] = []
        self.warnings: list[str] = []

    def link(self, url: str, vehicles: int = 1) -> Link:
        ends = LinkCallbacks(
            lambda data, peer, reach: self.data.append(data), self.gone.append, self.warnings.append
        )
        return make_link(parse_url(url), ends, vehicles=range(vehicles))


@contextlib.contextmanager
def no_more_files() -> Iterator[None]:
    """Prevent the opening of files."""
    # The first look-up of a name reads files of the C library.
    socket.getaddrinfo("127.0.0.1", 14550)
    allowed, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (3, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (allowed, most))


def test_a_peer_silent_for_a_minute_is_forgotten() -> None:
    events = LinkEvents()

    async def silent(loop: Loop) -> None:
        port = free_udp_port()
        link = events.link(f"udpin:127.0.0.1:{port}")
        link.open()
        udp, _ = udp_socket()
        with udp:
            udp.sendto(b"here", ("127.0.0.1", port))
            await loop.until(link.stations)
            await loop.forward(59)
            assert link.stations() == 0  # not counted, but still served
            link.send([(0, b"first")])
            assert udp.recv(100) == b"first"
            assert events.gone == []
            await loop.forward(2)
            link.send([(0, b"second")])
            assert len(events.gone) == 1
            udp.setblocking(False)
            with pytest.raises(BlockingIOError):
                udp.recv(100)
        link.close()

    in_loop(silent)


def test_a_vehicle_rebooted_without_free_sockets_keeps_its_port() -> None:
    events = LinkEvents()

    async def reboots(loop: Loop) -> None:
        udp, port = udp_socket()
        link = events.link(f"udpout:127.0.0.1:{port}", vehicles=3)
        link.open()
        with udp:
            link.send([(0, b"before")])
            _, shared = udp.recvfrom(100)
            with no_more_files():
                link.rebooted(0)
                link.send([(0, b"still there")])
            assert udp.recvfrom(100) == (b"still there", shared)
            link.rebooted(0)
            link.rebooted(1)
            link.send([(0, b"0"), (1, b"1"), (2, b"2")])
            sources = dict(udp.recvfrom(100) for _ in range(3))
            assert sources[b"2"] == shared
            assert len(set(sources.values())) == 3
            assert events.gone == []
            link.rebooted(2)  # the last vehicle of the first port
            assert len(events.gone) == 1
        link.close()

    in_loop(reboots)
    (warning,) = events.warnings
    assert "[no-socket]" in warning


def test_a_port_without_free_files_is_an_error() -> None:
    async def opened(loop: Loop) -> None:
        with no_more_files(), pytest.raises(LinkError, match="too-many-files"):
            LinkEvents().link("udpout:127.0.0.1:14550").open()

    in_loop(opened)


def reset(server: socket.socket) -> None:
    """Accept the next connection and reset it."""
    connection, _ = server.accept()
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    connection.close()


def test_a_server_that_disconnects_at_once_causes_one_warning() -> None:
    events = LinkEvents()

    async def dials(loop: Loop) -> None:
        port = free_tcp_port()
        link = events.link(f"tcpout:127.0.0.1:{port}")
        link.open()
        for _ in range(3):
            await loop.until(lambda: events.warnings)
            with socket.create_server(("127.0.0.1", port)) as server:
                server.settimeout(LIMIT_S)
                await loop.forward(0.6)
                await loop.until(link.stations)
                reset(server)
                await loop.until(lambda: not link.stations())
            await loop.forward(0.6)
        assert len(events.warnings) == 1
        with socket.create_server(("127.0.0.1", port)) as server:
            server.settimeout(LIMIT_S)
            await loop.forward(0.6)
            connection, _ = server.accept()
            with connection:
                connection.sendall(b"hello")
                await loop.until(lambda: events.data)
        await loop.until(lambda: not link.stations())
        await loop.forward(0.6)
        await loop.until(lambda: len(events.warnings) == 2)  # the server has gone again
        link.close()

    in_loop(dials)


def test_a_connection_lost_during_its_setup_is_retried(monkeypatch: pytest.MonkeyPatch) -> None:
    class DisconnectedSocket(socket.socket):
        def getpeername(self) -> Any:
            raise OSError(errno.ENOTCONN, "Transport endpoint is not connected")

    events = LinkEvents()

    async def dials(loop: Loop) -> None:
        with socket.create_server(("127.0.0.1", 0)) as server:
            link = events.link(f"tcpout:127.0.0.1:{server.getsockname()[1]}")
            with monkeypatch.context() as patched:
                patched.setattr(socket, "socket", DisconnectedSocket)
                link.open()
                await loop.until(lambda: events.warnings)
            await loop.forward(0.6)
            await loop.until(link.stations)
        link.close()

    in_loop(dials)


def test_a_client_retries_after_a_shortage_of_files() -> None:
    events = LinkEvents()

    async def dials(loop: Loop) -> None:
        with socket.create_server(("127.0.0.1", 0)) as server:
            link = events.link(f"tcpout:127.0.0.1:{server.getsockname()[1]}")
            with no_more_files():
                link.open()
                await loop.forward(0.6)
            await loop.forward(0.6)
            await loop.until(link.stations)
        link.close()

    in_loop(dials)
    assert len(events.warnings) == 1


def test_a_listener_pauses_during_a_shortage_of_files() -> None:
    events = LinkEvents()

    async def crowded(loop: Loop) -> None:
        port = free_tcp_port()
        link = events.link(f"tcpin:127.0.0.1:{port}")
        link.open()
        with socket.socket() as one:
            with no_more_files():
                one.connect(("127.0.0.1", port))
                await loop.until(lambda: events.warnings)
                assert loop.selector.select(0) == []  # the loop does not spin
                await loop.forward(1.1)
                assert loop.selector.select(0) == []
            assert link.stations() == 0
            await loop.forward(1.1)
            await loop.until(link.stations)
        link.close()

    in_loop(crowded)
    (warning,) = events.warnings
    assert "[no-connections]" in warning


def test_a_stalled_reader_is_disconnected() -> None:
    async def stalls(loop: Loop) -> list[str]:
        ended: list[str] = []
        writer, reader = socket.socketpair()
        writer.setblocking(False)
        stream = Stream(
            writer.fileno(), writer.recv, writer.send,
            backlog_bytes=1_000_000, received=lambda data: None, ended=ended.append,
        )  # fmt: skip
        with writer, reader:
            stream.send([(0, b"x" * 1_000_000)])
            await loop.forward(29)
            stream.send([(0, b"y")])
            taken = 0
            while taken < 500_000:  # slow, but reading
                taken += len(reader.recv(65_536))
                await asyncio.sleep(0)
            await loop.forward(29)
            stream.send([(0, b"y")])
            assert ended == []
            await loop.forward(2)
            stream.send([(0, b"y")])
        return ended

    assert len(in_loop(stalls)) == 1


def test_a_returning_serial_device_is_reopened(tmp_path: Path) -> None:
    device = SerialDevice(tmp_path / "tty")
    events = LinkEvents()

    async def comes_and_goes(loop: Loop) -> None:
        device.plug_in()
        link = events.link(f"serial:{device.name}:57600")
        link.open()
        for times in (1, 2):
            device.pull()
            await loop.until(lambda: not link.stations())
            assert len(events.gone) == times
            for _ in range(2):
                await loop.forward(1.1)  # not there yet
            assert link.stations() == 0
            link.send([(0, b"lost")])
            end = device.plug_in()
            await loop.forward(1.1)
            assert link.stations() == 1
            link.send([(0, b"found")])
            assert os.read(end, 100) == b"found"
            os.write(end, b"answer")
            await loop.until(lambda: len(events.data) == len(events.gone))
        link.close()
        device.pull()

    in_loop(comes_and_goes)
    codes = [warning[warning.rindex("[") :] for warning in events.warnings]
    assert codes == ["[device-lost]", "[device-returned]"] * 2
