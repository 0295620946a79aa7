"""The front end owns every transport of the ground station.

One transport per distinct URL, however many vehicles are behind it. It learns at which address a system id
is, sends to that address only, decodes only what somebody wants, writes the tlogs and sends the heartbeats.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from swarmctl.links.base import (
    AddressChanged,
    ChannelEvent,
    FramesRefused,
    LinkError,
    SystemIdConflict,
    TransportError,
)
from swarmctl.links.forwarding import Forwarder, ForwardTarget, open_to_strangers, refuse_loops
from swarmctl.links.refusals import Refusals
from swarmctl.links.routing import AddressTracker, AddressVerdict
from swarmctl.links.signing import LATE, Signing, SigningGuard
from swarmctl.links.tlog import TlogWriter
from swarmctl.links.transports.base import Address, Transport
from swarmctl.links.transports.memory import Memory, MemoryWire
from swarmctl.links.transports.serial import SerialPort
from swarmctl.links.transports.tcp import TcpClient, TcpServer
from swarmctl.links.transports.udp import Udp
from swarmctl.links.url import Endpoint
from swarmctl.mavlink.protocol.codec import (
    GCS_COMPID,
    GCS_SYSID,
    Decoder,
    Encoder,
    Frame,
    FrameSplitter,
    Message,
)
from swarmctl.mavlink.protocol.command import forces
from swarmctl.mavlink.session import WANTED
from swarmctl.mavlink.telemetry.presence import AUTOPILOT_COMPID, HEARTBEAT_PERIOD_S, own_heartbeat

_LATE_LIMIT = 64
_STREAMS_LIMIT = 1024
"""addresses on one endpoint whose half frames are remembered"""


class EvidenceRecorder(Protocol):
    """Whoever keeps the evidence: sees every message that is for a vehicle or from one.

    Here, because nothing reaches a vehicle but through `_Line.send`.
    """

    def to_vehicle(self, sysid: int, message: Message, by: str = "") -> bool:
        """Before it leaves; False forbids it. 0: it is for all; `by`: which other station says it."""

    def from_vehicle(self, sysid: int, message: Message) -> None:
        """What somebody here looks at."""

    async def settled(self) -> str:
        """Wait until all of it would outlive a loss of power; why it does not, empty if it does."""


class Channel:
    """One vehicle's place at the front end, from `attach` to `detach`."""

    def __init__(
        self,
        line: _Line,
        sysid: int,
        on_message: Callable[[Message], None],
        on_event: Callable[[ChannelEvent], None],
        tlog: TlogWriter | None,
        wanted: Set[int],
    ) -> None:
        self.route = AddressTracker()
        self.sysid = sysid
        self.wanted = wanted
        self.on_message = on_message
        self.on_event = on_event
        self._line = line
        self._tlog = tlog

    def send(self, messages: list[Message]) -> None:
        """To the vehicle's address only; dropped while none is known, and once it is detached."""
        if self.route.address is not None and self._line.channels.get(self.sysid) is self:
            for message in messages:
                self.log(self._line.send(message, self.route.address, self.sysid))

    def log(self, data: bytes) -> None:
        if self._tlog is not None and data:
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


@dataclass(frozen=True, slots=True)
class _Shared:
    """What all lines of a front end have in common."""

    encoder: Encoder
    decoder: Decoder
    forwarder: Forwarder
    guard: SigningGuard
    witness: EvidenceRecorder | None
    say: Callable[[str], None]


class _Line:
    """One endpoint: its transport and the vehicles on it."""

    def __init__(self, endpoint: Endpoint, number: int, transport: Transport, shared: _Shared) -> None:
        """`number` counts the lines of a front end, and tells their signatures apart."""
        self.transport = transport
        self.channels: dict[int, Channel] = {}
        self.heard: set[int] = set()
        self.refused: dict[int, str] = {}
        """why the last frame was, by autopilots' system ids"""
        self._endpoint = endpoint
        self._number = number
        self._shared = shared
        self._refusals = Refusals()
        self._splitters: dict[Address, FrameSplitter] = {}
        self._late: set[Address] = set()
        """who has the key and an old time: without GPS an autopilot learns it from what it is sent"""

    def send(self, message: Message, address: Address, sysid: int = 0) -> bytes:
        """Returns what was sent; empty where the witness forbids it."""
        if self._shared.witness is not None and not self._shared.witness.to_vehicle(sysid, message):
            return b""
        signature = self._shared.guard.sign(self._number)
        data = self._shared.encoder.pack(message, (self._endpoint, address), signature)
        self.transport.send(data, address)
        self._shared.forwarder.send(data)
        return data

    def pass_on(self, frame: Frame, target: int) -> None:
        """Another station's frame to system `target` (0: to all), as it is."""
        channels = [c for c in self.channels.values() if target in (0, c.sysid)]
        for channel in channels:
            channel.log(frame.data)
        for address in {c.route.address for c in channels} - {None}:
            self.transport.send(frame.data, address)

    def heartbeat(self) -> None:
        """Once per address, whether one vehicle or a whole fleet is behind it."""
        behind: dict[Address, list[Channel]] = {
            address: [] for address in (*self.transport.peers(), *self._late)
        }
        self._late.clear()
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
            why_not = self._shared.guard.why_not(frame.data)
            if why_not:
                self._refuse(frame, address, why_not, now)
                continue
            self._shared.forwarder.send(frame.data)
            self._dispatch(frame, address, now)

    def _refuse(self, frame: Frame, address: Address, why: str, now: float) -> None:
        if why == LATE and len(self._late) < _LATE_LIMIT:
            self._late.add(address)
        if not frame.known:
            return  # noise may look like a frame of anybody
        if frame.compid == AUTOPILOT_COMPID:
            self.refused[frame.sysid] = why
        channel = self.channels.get(frame.sysid)
        if channel is None:
            if text := self._refusals.of_stranger(frame.sysid, why, _text(address), now):
                self._shared.say(f"{self._endpoint}: {text}")
        elif text := self._refusals.of_vehicle(frame.sysid, frame.compid, why, _text(address), now):
            channel.on_event(FramesRefused(text))

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
        if verdict is AddressVerdict.DROPPED:
            return
        if verdict is AddressVerdict.MOVED:
            channel.on_event(AddressChanged(_text(address)))
        elif verdict is AddressVerdict.CONFLICT:
            channel.on_event(SystemIdConflict(_text(channel.route.rival)))
        channel.log(frame.data)
        if frame.msgid in channel.wanted:
            message = self._shared.decoder.decode(frame)
            if message is not None:
                if self._shared.witness is not None:
                    self._shared.witness.from_vehicle(frame.sysid, message)
                channel.on_message(message)


class FrontEnd:
    """`async with FrontEnd(...) as front_end:` closes every transport and tlog at the end.

    `wall_time_us` gives the times of the tlogs and of signatures; `signing` signs all that is sent and
    refuses what is not signed; `memory` has the wires of `memory:NAME` endpoints; `say` is told what
    people have to know of other stations, strangers' frames and signing itself.
    """

    def __init__(
        self,
        *,
        wall_time_us: Callable[[], int],
        memory: Mapping[str, MemoryWire] | None = None,
        witness: EvidenceRecorder | None = None,
        signing: Signing | None = None,
        say: Callable[[str], None] = lambda _text: None,
        sysid: int = GCS_SYSID,
        compid: int = GCS_COMPID,
    ) -> None:
        self.sysid = sysid
        self.compid = compid
        self._wall_time_us = wall_time_us
        self._memory = memory or {}
        guard = SigningGuard(signing, wall_time_us)
        self._shared = _Shared(Encoder(sysid, compid), Decoder(), Forwarder(), guard, witness, say)
        self._lines: dict[Endpoint, _Line] = {}
        self._opening = asyncio.Lock()
        self._timer: asyncio.TimerHandle | None = None
        self._at_close: list[Callable[[], None]] = []
        self._say = say
        self._forced = 0
        """orders of other stations that were dropped"""
        self._refusals = Refusals()
        """of other stations' frames"""
        self._said_trouble = ""

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
            refuse_loops(self._shared.forwarder.endpoints, [endpoint])
            line = _Line(endpoint, len(self._lines), self._transport(endpoint), self._shared)
            await line.transport.open(line.receive)
            self._lines[endpoint] = line
            if self._timer is None:
                self._heartbeat()

    async def forward(self, endpoint: Endpoint, *, commands: bool = False) -> None:
        """Copy all traffic to who watches there; with `commands` what they send reaches the vehicles.

        Raises TransportError, and LinkError where vehicles are listened for at the same place, or where
        strangers could command.
        """
        refuse_loops([endpoint], list(self._lines))
        signed = self._shared.guard.signing is not None
        if commands and (why := open_to_strangers(endpoint, signed=signed)):
            raise LinkError(f"forward {why}")
        on_frame = self._from_station if commands else None
        await self._shared.forwarder.add(ForwardTarget(endpoint, self._transport(endpoint), on_frame))

    def _from_station(self, frame: Frame, where: str) -> None:
        if why := self._shared.guard.why_not(frame.data):
            if text := self._refusals.of_stranger(frame.sysid, why, where, asyncio.get_running_loop().time()):
                self._say(f"other stations: {text}")
            return
        message = self._shared.decoder.decode(frame)
        if message is None:
            return
        target = int(getattr(message, "target_system", 0))
        by = f"station {frame.sysid} at {where}"
        if forces(message):
            self._forced += 1
            if self._forced == 1:
                self._say(f"{by} asks for a forced arming or disarming: never passed on")
            return
        if self._shared.witness is None or self._shared.witness.to_vehicle(target, message, by):
            for line in self._lines.values():
                line.pass_on(frame, target)

    def attach(
        self,
        endpoint: Endpoint,
        sysid: int,
        *,
        on_message: Callable[[Message], None],
        on_event: Callable[[ChannelEvent], None],
        tlog: Path | None = None,
        wanted: Set[int] = WANTED,
    ) -> Channel:
        """Take part in the traffic of one system id on an open endpoint; `on_message` gets the messages whose
        ids are `wanted`.

        Raises LinkError where another link already has it.
        """
        line = self._lines[endpoint]
        if sysid in line.channels:
            raise LinkError(
                f"system id {sysid} is used by two vehicles on {endpoint}; give one of them another "
                "(ArduPilot: parameter SYSID_THISMAV, from 4.7 on MAV_SYSID; PX4: MAV_SYS_ID) or a link of "
                "its own"
            )
        if sysid == self.sysid:
            raise LinkError(
                f"system id {sysid} on {endpoint} is the ground station's own; vehicles use 1 to 254"
            )
        writer = None if tlog is None else TlogWriter(tlog, self._wall_time_us, self._say)
        channel = line.channels[sysid] = Channel(line, sysid, on_message, on_event, writer, wanted)
        return channel

    def systems_on(self, endpoint: Endpoint) -> frozenset[int]:
        """The system ids of all autopilots that were heard there."""
        return frozenset(self._lines[endpoint].heard) if endpoint in self._lines else frozenset()

    def refused_on(self, endpoint: Endpoint, sysid: int) -> str:
        """Why the last frame of an autopilot there was refused; empty where none was."""
        return self._lines[endpoint].refused.get(sysid, "") if endpoint in self._lines else ""

    async def why_not_arm(self) -> str:
        """What forbids to arm any vehicle now; empty where nothing does. Waits for the evidence so far."""
        return "" if self._shared.witness is None else await self._shared.witness.settled()

    def trouble_on(self, endpoint: Endpoint) -> str:
        """What its transport knows to be wrong at the moment."""
        transport = self._lines[endpoint].transport.trouble if endpoint in self._lines else ""
        return "; ".join(text for text in (transport, self.refused) if text)

    @property
    def refused(self) -> str:
        """What came and was not taken, for people; empty where nothing was."""
        forced = f"forced armings or disarmings of other stations dropped: {self._forced}"
        return "; ".join(
            text for text in (self._shared.guard.trouble, forced if self._forced else "") if text
        )

    def at_close(self, release: Callable[[], None]) -> None:
        """Call `release` before the transports close; for who keeps something as long as this is open."""
        self._at_close.append(release)

    async def close(self) -> None:
        for release in self._at_close:
            release()
        self._at_close.clear()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        for line in self._lines.values():
            for channel in list(line.channels.values()):
                channel.detach()
            await line.transport.close()
        self._lines.clear()
        await self._shared.forwarder.close()

    def _heartbeat(self) -> None:
        self._timer = asyncio.get_running_loop().call_later(HEARTBEAT_PERIOD_S, self._heartbeat)
        signing = self._shared.guard.signing
        if signing is not None and signing.trouble != self._said_trouble:
            self._said_trouble = signing.trouble
            self._say(signing.trouble)
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
