"""One endpoint of the front end: its transport, and the vehicles on it with their addresses."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Set
from dataclasses import dataclass
from enum import Enum
from math import inf
from typing import Protocol

from swarmctl.links.base import AddressChanged, ChannelEvent, FramesRefused, SystemIdConflict
from swarmctl.links.forwarding import Forwarder
from swarmctl.links.signing import LATE, Refusals, SigningGuard
from swarmctl.links.tlog import TlogWriter
from swarmctl.links.transports.base import Address, Transport
from swarmctl.links.url import Endpoint
from swarmctl.mavlink.protocol.codec import Decoder, Encoder, Frame, FrameSplitter, Message
from swarmctl.mavlink.telemetry.presence import AUTOPILOT_COMPID, own_heartbeat

_LATE_LIMIT = 64
_STREAMS_LIMIT = 1024
"""addresses on one endpoint whose half frames are remembered"""
SILENT_S = 2.0
"""after this long without a word from its address, a vehicle may speak from another one"""


class AddressVerdict(Enum):
    ACCEPTED = "accepted"
    MOVED = "moved"
    """accepted, and the vehicle is at this address from now on"""
    DROPPED = "dropped"
    """from another address than the vehicle's"""
    CONFLICT = "conflict"
    """accepted, and it is certain now that `rival` uses the same system id"""


class AddressTracker:
    """The address of one system id on one endpoint.

    Over UDP a rebooted vehicle comes back from another port, and two vehicles may have been given the same
    system id. Both look like a second address; only in the second case does the first one go on speaking.
    """

    def __init__(self) -> None:
        self.address: Address | None = None
        self.rival: Address | None = None
        self._heard = -inf
        self._rival_heard = -inf
        self._reported: set[Address] = set()

    def hear(self, address: Address, now: float) -> AddressVerdict:
        """A frame of this system id came from `address`."""
        if address == self.address:
            self._heard = now
            if self._rival_heard > now - SILENT_S and self.rival not in self._reported:
                self._reported.add(self.rival)
                return AddressVerdict.CONFLICT
            return AddressVerdict.ACCEPTED
        if self.address is None or now - self._heard >= SILENT_S:
            first = self.address is None
            self.address, self.rival = address, None
            self._heard, self._rival_heard = now, -inf
            self._reported.clear()
            return AddressVerdict.ACCEPTED if first else AddressVerdict.MOVED
        self.rival, self._rival_heard = address, now
        return AddressVerdict.DROPPED


class EvidenceRecorder(Protocol):
    """Whoever keeps the evidence: sees every message that is for a vehicle or from one.

    Here, because nothing reaches a vehicle but through `Line.send`.
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
        line: Line,
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
class LineShared:
    """What all lines of a front end have in common."""

    encoder: Encoder
    decoder: Decoder
    forwarder: Forwarder
    guard: SigningGuard
    witness: EvidenceRecorder | None
    say: Callable[[str], None]


class Line:
    """One endpoint: its transport and the vehicles on it."""

    def __init__(self, endpoint: Endpoint, number: int, transport: Transport, shared: LineShared) -> None:
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


def _text(address: Address) -> str:
    return f"{address[0]}:{address[1]}" if isinstance(address, tuple) else str(address)
