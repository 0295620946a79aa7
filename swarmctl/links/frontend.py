"""The front end owns every transport of the ground station.

One transport per distinct URL, however many vehicles are behind it. It learns at which address a system id
is, sends to that address only, decodes only what somebody wants, writes the tlogs and sends the heartbeats.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

from swarmctl.links.base import AddressChanged, Conflict, LinkError, TransportError
from swarmctl.links.memory import Memory, MemoryWire
from swarmctl.links.routing import Route, Verdict
from swarmctl.links.serial import SerialPort
from swarmctl.links.tcp import TcpClient, TcpServer
from swarmctl.links.tlog import TlogWriter
from swarmctl.links.transport import Address, Transport
from swarmctl.links.udp import Udp
from swarmctl.links.url import Endpoint
from swarmctl.mavlink.codec import (
    GCS_COMPID,
    GCS_SYSID,
    Decoder,
    Encoder,
    Frame,
    FrameSplitter,
    Message,
)
from swarmctl.mavlink.presence import AUTOPILOT_COMPID, HEARTBEAT_PERIOD_S, own_heartbeat
from swarmctl.mavlink.session import WANTED

_STREAMS_LIMIT = 1024
"""addresses on one endpoint whose half frames are remembered"""


class Channel:
    """One vehicle's place at the front end, from `attach` to `detach`."""

    def __init__(
        self,
        line: _Line,
        sysid: int,
        on_message: Callable[[Message], None],
        on_event: Callable[[AddressChanged | Conflict], None],
        tlog: TlogWriter | None,
    ) -> None:
        self.route = Route()
        self.sysid = sysid
        self.on_message = on_message
        self.on_event = on_event
        self._line = line
        self._tlog = tlog

    def send(self, messages: list[Message]) -> None:
        """To the vehicle's address only; dropped while none is known."""
        if self.route.address is not None:
            for message in messages:
                self.log(self._line.send(message, self.route.address))

    def log(self, data: bytes) -> None:
        if self._tlog is not None:
            self._tlog.write(data)

    def flush_log(self) -> None:
        if self._tlog is not None:
            self._tlog.flush()

    def detach(self) -> None:
        """Idempotent."""
        if self._line.channels.get(self.sysid) is self:
            del self._line.channels[self.sysid]
        if self._tlog is not None:
            self._tlog.close()
            self._tlog = None


class _Line:
    """One endpoint: its transport and the vehicles on it."""

    def __init__(self, endpoint: Endpoint, transport: Transport, encoder: Encoder, decoder: Decoder) -> None:
        self.transport = transport
        self.channels: dict[int, Channel] = {}
        self.heard: set[int] = set()
        self._endpoint = endpoint
        self._encoder = encoder
        self._decoder = decoder
        self._splitters: dict[Address, FrameSplitter] = {}

    def send(self, message: Message, address: Address) -> bytes:
        data = self._encoder.pack(message, (self._endpoint, address))
        self.transport.send(data, address)
        return data

    def heartbeat(self) -> None:
        """Once per address, whether one vehicle or a whole fleet is behind it."""
        behind: dict[Address, list[Channel]] = {address: [] for address in self.transport.peers()}
        for channel in self.channels.values():
            if channel.route.address is not None:
                behind.setdefault(channel.route.address, []).append(channel)
        for address, channels in behind.items():
            data = self.send(own_heartbeat(), address)
            for channel in channels:
                channel.log(data)

    def flush_logs(self) -> None:
        for channel in self.channels.values():
            channel.flush_log()

    def receive(self, data: bytes, address: Address) -> None:
        splitter = self._splitters.get(address)
        if splitter is None:
            if len(self._splitters) >= _STREAMS_LIMIT:
                del self._splitters[next(iter(self._splitters))]
            splitter = self._splitters[address] = FrameSplitter()
        now = asyncio.get_running_loop().time()
        for frame in splitter.feed(data):
            self._dispatch(frame, address, now)

    def _dispatch(self, frame: Frame, address: Address, now: float) -> None:
        from_autopilot = frame.known and frame.compid == AUTOPILOT_COMPID
        if from_autopilot:
            self.heard.add(frame.sysid)
        channel = self.channels.get(frame.sysid)
        if channel is None:
            return
        if not from_autopilot:
            # Cameras and companions, and what cannot be verified: logged, but it moves no vehicle.
            if address == channel.route.address:
                channel.log(frame.data)
            return
        verdict = channel.route.hear(address, now)
        if verdict is Verdict.DROPPED:
            return
        if verdict is Verdict.MOVED:
            channel.on_event(AddressChanged(_text(address)))
        elif verdict is Verdict.CONFLICT:
            channel.on_event(Conflict(_text(channel.route.rival)))
        channel.log(frame.data)
        if frame.msgid in WANTED:
            message = self._decoder.decode(frame)
            if message is not None:
                channel.on_message(message)


class FrontEnd:
    """`async with FrontEnd(...) as front_end:` closes every transport and tlog at the end.

    `wall_time_us` gives the times of the tlogs; `memory` the wires of `memory:NAME` endpoints.
    """

    def __init__(
        self,
        *,
        wall_time_us: Callable[[], int],
        memory: Mapping[str, MemoryWire] | None = None,
        sysid: int = GCS_SYSID,
        compid: int = GCS_COMPID,
    ) -> None:
        self.sysid = sysid
        self.compid = compid
        self._wall_time_us = wall_time_us
        self._memory = memory or {}
        self._encoder = Encoder(sysid, compid)
        self._decoder = Decoder()
        self._lines: dict[Endpoint, _Line] = {}
        self._opening = asyncio.Lock()
        self._timer: asyncio.TimerHandle | None = None

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def open(self, endpoint: Endpoint) -> None:
        """Open the endpoint's transport unless it is open. Raises TransportError."""
        async with self._opening:
            if endpoint in self._lines:
                return
            line = _Line(endpoint, self._transport(endpoint), self._encoder, self._decoder)
            await line.transport.open(line.receive)
            self._lines[endpoint] = line
            if self._timer is None:
                self._heartbeat()

    def attach(
        self,
        endpoint: Endpoint,
        sysid: int,
        *,
        on_message: Callable[[Message], None],
        on_event: Callable[[AddressChanged | Conflict], None],
        tlog: Path | None = None,
    ) -> Channel:
        """Take part in the traffic of one system id on an open endpoint.

        Raises LinkError where another link already has it.
        """
        line = self._lines[endpoint]
        if sysid in line.channels:
            raise LinkError(
                f"system id {sysid} is used by two vehicles on {endpoint}; give one of them another "
                "(ArduPilot: parameter SYSID_THISMAV) or a link of its own"
            )
        if sysid == self.sysid:
            raise LinkError(
                f"system id {sysid} on {endpoint} is the ground station's own; vehicles use 1 to 254"
            )
        writer = None if tlog is None else TlogWriter(tlog, self._wall_time_us)
        channel = line.channels[sysid] = Channel(line, sysid, on_message, on_event, writer)
        return channel

    def heard_on(self, endpoint: Endpoint) -> frozenset[int]:
        """The system ids of all autopilots that were heard there."""
        return frozenset(self._lines[endpoint].heard) if endpoint in self._lines else frozenset()

    def trouble_on(self, endpoint: Endpoint) -> str:
        """What its transport knows to be wrong at the moment."""
        return self._lines[endpoint].transport.trouble if endpoint in self._lines else ""

    async def close(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        for line in self._lines.values():
            for channel in list(line.channels.values()):
                channel.detach()
            await line.transport.close()
        self._lines.clear()

    def _heartbeat(self) -> None:
        self._timer = asyncio.get_running_loop().call_later(HEARTBEAT_PERIOD_S, self._heartbeat)
        for line in self._lines.values():
            line.heartbeat()
            # A log is wanted most of all after the process died.
            line.flush_logs()

    def _transport(self, endpoint: Endpoint) -> Transport:
        match endpoint.kind:
            case "udpin" | "udpout":
                return Udp(endpoint)
            case "tcpin":
                return TcpServer(endpoint)
            case "tcpout":
                return TcpClient(endpoint)
            case "serial":
                return SerialPort(endpoint)
            case "memory":
                wire = self._memory.get(endpoint.host)
                if wire is None:
                    known = ", ".join(sorted(self._memory)) or "none"
                    raise TransportError(f"{endpoint}: there is no memory wire of that name; known: {known}")
                return Memory(wire)


def _text(address: Address) -> str:
    return f"{address[0]}:{address[1]}" if isinstance(address, tuple) else str(address)
