"""The fleet on sockets and on the wall clock: the only I/O of the package.

One link carries the whole fleet: over UDP out of one socket, like a multiplexer in front of SITL; a vehicle
that reboots comes back from a socket of its own, because a real one returns from another port. (Over TCP a
real vehicle's connection would close; here the others are on it as well, so it stays.)
"""

import asyncio
import contextlib
import os
import socket
import time
from collections.abc import Callable, Iterable

from sim_vehicle.fleet import Fleet, Frames
from sim_vehicle.url import Url

TICK_WALL_S = 0.02
LAG_REPORTED_S = 1.0
LAG_REPORT_EVERY_S = 10.0
MAX_STEP_WALL_S = 0.2  # between two looks at the sockets when catching up
RECONNECT_S = 0.5
CLIENT_BUFFER_BYTES = 4_000_000
DATAGRAM_BYTES = 1200
Deliver = Callable[[bytes, object, "Link"], None]


class LinkError(OSError):
    """The link cannot be opened; the text says why and what to do."""


class Link:
    """Bytes to and from ground stations. Subclasses open themselves and call `deliver(data, peer, link)`."""

    async def open(self) -> None:
        raise NotImplementedError

    def send(self, sysid: int, data: bytes) -> None:
        """Send to every ground station that is there."""
        raise NotImplementedError

    def rebooted(self, sysid: int) -> None:
        """A vehicle has come back from a reboot."""

    def close(self) -> None:
        raise NotImplementedError


class _Datagrams(asyncio.DatagramProtocol):
    def __init__(self, received: Callable[[bytes, tuple[str, int]], None]) -> None:
        self._received = received

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        self._received(data, addr)

    def error_received(self, exc: Exception) -> None:
        """Nobody listens at the other end (yet); real vehicles go on sending too."""


class UdpLink(Link):
    """UDP, to one address (udpout) or to whoever has spoken to us (udpin)."""

    def __init__(self, url: Url, deliver: Deliver) -> None:
        self._url, self._deliver = url, deliver
        self._peers: list[tuple[str, int]] = []
        self._shared: asyncio.DatagramTransport | None = None
        self._own: dict[int, socket.socket] = {}  # of vehicles that have been rebooted

    async def open(self) -> None:
        loop = asyncio.get_running_loop()
        address = (self._url.host, self._url.port)
        try:
            if self._url.listens:
                self._shared, _ = await loop.create_datagram_endpoint(self._protocol, local_addr=address)
            else:
                self._shared, _ = await loop.create_datagram_endpoint(self._protocol, remote_addr=address)
        except OSError as error:
            raise _open_error(self._url, error) from error

    def _protocol(self) -> _Datagrams:
        return _Datagrams(self._received)

    def _received(self, data: bytes, address: tuple[str, int]) -> None:
        if self._url.listens and address not in self._peers:
            self._peers.append(address)
        self._deliver(data, address, self)

    def send(self, sysid: int, data: bytes) -> None:
        if sysid in self._own:
            with contextlib.suppress(OSError):  # as with the shared socket: nobody there is no error
                self._own[sysid].send(data)
        elif self._shared is not None:
            for address in self._peers if self._url.listens else (None,):
                self._shared.sendto(data, address)

    def rebooted(self, sysid: int) -> None:
        """Give the vehicle a socket, and so a port, of its own; a listening one keeps its port."""
        if self._url.listens or self._shared is None:
            return
        self._drop(sysid)
        remote = self._shared.get_extra_info("peername")
        self._own[sysid] = socket.socket(self._shared.get_extra_info("socket").family, socket.SOCK_DGRAM)
        self._own[sysid].setblocking(False)
        self._own[sysid].connect(remote)
        asyncio.get_running_loop().add_reader(self._own[sysid], self._read, sysid, remote)

    def _read(self, sysid: int, remote: tuple[str, int]) -> None:
        with contextlib.suppress(OSError):
            self._received(self._own[sysid].recv(65_536), remote)

    def _drop(self, sysid: int) -> None:
        own = self._own.pop(sysid, None)
        if own is not None:
            asyncio.get_running_loop().remove_reader(own)
            own.close()

    def close(self) -> None:
        if self._shared is not None:
            self._shared.close()
        for sysid in list(self._own):
            self._drop(sysid)


class TcpLink(Link):
    """TCP: a server for any number of clients (tcpin), or a client that connects again and again (tcpout)."""

    def __init__(self, url: Url, deliver: Deliver, gone: Callable[[object], None]) -> None:
        self._url, self._deliver, self._gone = url, deliver, gone
        self._writers: list[asyncio.StreamWriter] = []
        self._server: asyncio.Server | None = None
        self._dialling: asyncio.Task[None] | None = None

    async def open(self) -> None:
        if not self._url.listens:
            self._dialling = asyncio.create_task(self._dial())
            return
        try:
            self._server = await asyncio.start_server(self._serve, self._url.host, self._url.port)
        except OSError as error:
            raise _open_error(self._url, error) from error

    async def _dial(self) -> None:
        while True:
            with contextlib.suppress(OSError):
                reader, writer = await asyncio.open_connection(self._url.host, self._url.port)
                await self._serve(reader, writer)
            await asyncio.sleep(RECONNECT_S)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.append(writer)
        try:
            with contextlib.suppress(OSError):
                while data := await reader.read(65_536):
                    self._deliver(data, writer, self)
        finally:
            self._writers.remove(writer)
            self._gone(writer)
            writer.close()

    def send(self, sysid: int, data: bytes) -> None:
        for writer in self._writers:
            if writer.transport.get_write_buffer_size() > CLIENT_BUFFER_BYTES:
                writer.transport.abort()  # a client that does not read must not fill the memory
            elif not writer.is_closing():
                writer.write(data)

    def close(self) -> None:
        if self._dialling is not None:
            self._dialling.cancel()
        if self._server is not None:
            self._server.close()
        for writer in self._writers:
            writer.close()


def _open_error(url: Url, error: OSError) -> LinkError:
    return LinkError(
        f"cannot open {url}: {error.strerror or error}. Is another program using it? "
        "Choose another port with --url."
    )


class Server:
    """Runs a fleet at `speedup` times real time on one link until it is stopped."""

    def __init__(
        self,
        fleet: Fleet,
        url: Url,
        *,
        speedup: float,
        parent_pid: int | None,
        warn: Callable[[str], None],
    ) -> None:
        """`parent_pid`: stop when that process is gone; `warn` takes a text for the operator."""
        self.fleet, self.speedup, self._warn = fleet, speedup, warn
        self._parent_pid = parent_pid
        self._link: Link
        if url.udp:
            self._link = UdpLink(url, self._deliver)
        else:
            self._link = TcpLink(url, self._deliver, fleet.forget_peer)
        self._started_s = 0.0
        self._lost_s = 0.0  # wall time by which the simulation was too slow and that was given up
        self._lag_reported_s = -LAG_REPORT_EVERY_S
        self._simulated_s = 0.0
        self._boots = fleet.boots()

    @property
    def simulated_s(self) -> float:
        """How far the simulation has come [s]."""
        return self._simulated_s

    def _now(self) -> float:
        """Simulated time by the wall clock, never further than one step ahead of what has been simulated."""
        due_s = (time.monotonic() - self._started_s - self._lost_s) * self.speedup
        return max(self._simulated_s, min(due_s, self._simulated_s + MAX_STEP_WALL_S * self.speedup))

    async def run(self, *, on_open: Callable[[], None] = lambda: None) -> None:
        """Open the link and run until cancelled, or until the parent process is gone."""
        await self._link.open()
        try:
            self._started_s = time.monotonic()
            on_open()
            self._send(self.fleet.step(0.0))
            while not self._orphaned():
                await self._tick()
        finally:
            self._link.close()

    def _orphaned(self) -> bool:
        if self._parent_pid is None:
            return False
        try:
            os.kill(self._parent_pid, 0)
        except ProcessLookupError:
            return True
        except PermissionError:
            return False
        return False

    async def _tick(self) -> None:
        began_s = time.monotonic()
        self._simulated_s = self._now()
        self._send(self.fleet.step(self._simulated_s))
        self._report_lag()
        await asyncio.sleep(max(0.0, TICK_WALL_S - (time.monotonic() - began_s)))

    def _report_lag(self) -> None:
        wall_s = time.monotonic() - self._started_s
        behind_s = wall_s - self._lost_s - self._simulated_s / self.speedup
        if behind_s < LAG_REPORTED_S:
            return
        self._lost_s += behind_s
        if wall_s - self._lag_reported_s >= LAG_REPORT_EVERY_S:
            self._lag_reported_s = wall_s
            self._warn(f"cannot keep up with {self.speedup:g}x real time, {self._lost_s:.1f} s lost so far")

    def _deliver(self, data: bytes, peer: object, link: Link) -> None:
        self._simulated_s = self._now()
        self._send(self.fleet.receive(data, self._simulated_s, peer=peer))

    def _send(self, frames: Frames) -> None:
        for sysid, boots in self.fleet.boots().items():
            if boots != self._boots[sysid]:
                if self._boots[sysid] > 0:
                    self._link.rebooted(sysid)
                self._boots[sysid] = boots
        for sysid, data in _joined(frames):
            self._link.send(sysid, data)


def _joined(frames: Frames) -> Iterable[tuple[int, bytes]]:
    """Neighbouring frames of one vehicle in one datagram, as an autopilot's link buffer does."""
    current, parts, size = 0, list[bytes](), 0
    for sysid, frame in frames:
        if parts and (sysid != current or size + len(frame) > DATAGRAM_BYTES):
            yield current, b"".join(parts)
            parts, size = [], 0
        current = sysid
        parts.append(frame)
        size += len(frame)
    if parts:
        yield current, b"".join(parts)
