"""One endpoint of the front end: its transport, and the vehicles with their addresses."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Set
from enum import Enum
from math import inf
from typing import Protocol

import msgspec

from swarmctl.links.base import AddressChanged, ChannelEvent, FramesRefused, SystemIdConflict
from swarmctl.links.forwarding import Forwarder
from swarmctl.links.signing import LATE, Refusals, SigningGuard
from swarmctl.links.tlog import TlogWriter
from swarmctl.links.transports.base import Address, Transport
from swarmctl.links.url import Endpoint
from swarmctl.mavlink.protocol.codec import Encoder, Frame, FrameSplitter, Message, decode
from swarmctl.mavlink.telemetry.presence import own_heartbeat

_LATE_LIMIT, _SPLITTERS_LIMIT = 64, 1024
"""largest numbers of addresses on one endpoint: of vehicles with a late clock, and of all senders"""
SILENT_S = 2.0
"""silence of a vehicle's address after which `may_move` decides on a new address"""


class AddressVerdict(Enum):
    """Decision about a frame by its address."""

    ACCEPTED = "accepted"
    MOVED = "moved"
    """accepted; this is the vehicle's new address"""
    DROPPED = "dropped"
    """not from the vehicle's address"""
    CONFLICT = "conflict"
    """accepted; another address, `rival`, also uses this system id"""


class AddressTracker:
    """Address of one system id on one endpoint. No I/O.

    A second address appears when a vehicle on UDP reboots, or when two vehicles have the same system id. If
    there are two vehicles, the first address continues to send.

    may_move: called for a frame from a second address; True if the vehicle's loss is reported and no command
        to it is under way
    """

    def __init__(self, may_move: Callable[[], bool]) -> None:
        self._may_move = may_move
        self.address: Address | None = None
        self.rival: Address | None = None
        self._received_s = -inf
        self._rival_received_s = -inf
        self._reported: set[Address] = set()

    def receive(self, address: Address, now: float) -> AddressVerdict:
        """Return the decision about a frame of this system id from `address`."""
        if address == self.address:
            self._received_s = now
            if self._rival_received_s > now - SILENT_S and self.rival not in self._reported:
                self._reported.add(self.rival)
                return AddressVerdict.CONFLICT
            return AddressVerdict.ACCEPTED
        if self.address is None or (now - self._received_s >= SILENT_S and self._may_move()):
            first = self.address is None
            self.address, self.rival = address, None
            self._received_s, self._rival_received_s = now, -inf
            self._reported.clear()
            return AddressVerdict.ACCEPTED if first else AddressVerdict.MOVED
        self.rival, self._rival_received_s = address, now
        return AddressVerdict.DROPPED


class EvidenceRecorder(Protocol):
    """Recorder of messages to and from vehicles."""

    def to_vehicle(self, sysid: int, message: Message, by: str = "") -> bool:
        """Record a message to system `sysid` (0: all); False forbids it. `by`: sender; "": this station."""

    def from_vehicle(self, sysid: int, message: Message) -> None:
        """Record a vehicle's message, of a type that the link reads."""

    async def wait_until_stored(self) -> str:
        """Wait until the record is on disk; return the reason for a failure, or ""."""


class Channel:
    """Channel of one vehicle at the front end, from `attach` to `detach`."""

    def __init__(
        self,
        line: Line,
        sysid: int,
        on_message: Callable[[Message], None],
        on_event: Callable[[ChannelEvent], None],
        tlog: TlogWriter | None,
        read_ids: Set[int],
        may_move: Callable[[], bool],
    ) -> None:
        self.sysid = sysid
        self.on_event = on_event
        self._tracker = AddressTracker(may_move)
        self._read_ids = read_ids
        self._on_message = on_message
        self._line = line
        self._tlog = tlog
        line.add(self)

    @property
    def address(self) -> Address | None:
        """The vehicle's address; None before its first frame."""
        return self._tracker.address

    def receive(self, frame: Frame, address: Address, now: float) -> None:
        """Log a frame with this system id, and pass its message on, unless another address has sent it."""
        if not frame.from_autopilot:
            # Frames of cameras and companions, and unverified frames, change no address.
            if address == self.address:
                self.log(frame.data)
            return
        match self._tracker.receive(address, now):
            case AddressVerdict.DROPPED:
                return
            case AddressVerdict.MOVED:
                self.on_event(AddressChanged(_text(address)))
            case AddressVerdict.CONFLICT:
                self.on_event(SystemIdConflict(_text(self._tracker.rival)))
        self.log(frame.data)
        if frame.msgid in self._read_ids and (message := self._line.decode(frame)) is not None:
            self._on_message(message)

    def send(self, messages: list[Message]) -> None:
        """Send to the vehicle's address; drop messages before an address is known."""
        if self.address is not None:
            for message in messages:
                self.log(self._line.send(message, self.address, self.sysid))

    def log(self, data: bytes) -> None:
        if self._tlog is not None and data:
            self._tlog.write(data)

    def flush_log(self) -> None:
        if self._tlog is not None:
            self._tlog.flush()

    def detach(self) -> None:
        """Leave the line and close the log."""
        self._line.remove(self)
        if self._tlog is not None:
            self._tlog.close()
            self._tlog = None


class LineShared(msgspec.Struct, frozen=True):
    """Objects shared by all lines of a front end."""

    encoder: Encoder
    forwarder: Forwarder
    guard: SigningGuard
    evidence: EvidenceRecorder | None
    say: Callable[[str], None]


class Line:
    """One endpoint: its transport and the vehicles on it."""

    def __init__(self, endpoint: Endpoint, number: int, transport: Transport, shared: LineShared) -> None:
        """Create a line; `number`: index of the line, for the link id of its signatures."""
        self.transport = transport
        self.systems: set[int] = set()
        """system ids of all autopilots received"""
        self.last_refusals: dict[int, str] = {}
        """reason for the last refusal, by the autopilot's system id"""
        self._endpoint = endpoint
        self._number = number
        self._shared = shared
        self._channels: dict[int, Channel] = {}
        """channels by system id"""
        self._refusals = Refusals()
        self._splitters: dict[Address, FrameSplitter] = {}
        self._late: set[Address] = set()
        """Addresses with the right key but an old timestamp. Each address gets one heartbeat, because an
        autopilot without GPS takes the time from signed frames."""

    def add(self, channel: Channel) -> None:
        self._channels[channel.sysid] = channel

    def remove(self, channel: Channel) -> None:
        del self._channels[channel.sysid]

    @property
    def sysids(self) -> Set[int]:
        """The system ids of the channels."""
        return self._channels.keys()

    def send(self, message: Message, address: Address, sysid: int = 0) -> bytes:
        """Send a message; return its frame, or b"" if the evidence recorder forbids it."""
        if self._shared.evidence is not None and not self._shared.evidence.to_vehicle(sysid, message):
            return b""
        signature = self._shared.guard.sign(self._number)
        data = self._shared.encoder.pack(message, (self._endpoint, address), signature)
        self.transport.send(data, address)
        self._shared.forwarder.send(data)
        return data

    def pass_on(self, frame: Frame, target: int) -> None:
        """Send another station's frame unchanged to vehicle `target` of this line; 0: to all its vehicles."""
        channels = [c for c in self._channels.values() if target in (0, c.sysid)]
        for channel in channels:
            channel.log(frame.data)
        for address in {c.address for c in channels} - {None}:
            self.transport.send(frame.data, address)

    def heartbeat(self) -> None:
        """Send one heartbeat to each address, also to an address that several vehicles share."""
        by_address: dict[Address, list[Channel]] = {
            address: [] for address in (*self.transport.peers(), *self._late)
        }
        self._late.clear()
        for channel in self._channels.values():
            if channel.address is not None:
                by_address.setdefault(channel.address, []).append(channel)
        for address, channels in by_address.items():
            data = self.send(own_heartbeat(), address)
            for channel in channels:
                channel.log(data)

    def flush_logs(self) -> None:
        for channel in self._channels.values():
            channel.flush_log()

    def receive(self, data: bytes, address: Address) -> None:
        """Take bytes from the transport: find frames, check signatures, copy to stations, deliver."""
        now = asyncio.get_running_loop().time()
        for frame in self._splitter(address).feed(data):
            if why_not := self._shared.guard.why_not(frame):
                self._refuse(frame, address, why_not, now)
                continue
            self._shared.forwarder.send(frame.data)
            if frame.from_autopilot:
                self.systems.add(frame.sysid)
            if (channel := self._channels.get(frame.sysid)) is not None:
                channel.receive(frame, address, now)

    def decode(self, frame: Frame) -> Message | None:
        """Return the message of a vehicle's frame and record it as evidence; None for an unknown message."""
        message = decode(frame)
        if message is not None and self._shared.evidence is not None:
            self._shared.evidence.from_vehicle(frame.sysid, message)
        return message

    def _splitter(self, address: Address) -> FrameSplitter:
        splitter = self._splitters.get(address)
        if splitter is None:
            if len(self._splitters) >= _SPLITTERS_LIMIT:
                del self._splitters[next(iter(self._splitters))]
            splitter = self._splitters[address] = FrameSplitter()
        return splitter

    def _refuse(self, frame: Frame, address: Address, why: str, now: float) -> None:
        if why == LATE and len(self._late) < _LATE_LIMIT:
            self._late.add(address)
        if not frame.known:
            return  # noise may look like a frame of any system
        if frame.from_autopilot:
            self.last_refusals[frame.sysid] = why
        channel = self._channels.get(frame.sysid)
        if channel is None:
            if text := self._refusals.of_stranger(frame.sysid, why, _text(address), now):
                self._shared.say(f"{self._endpoint}: {text}")
        elif text := self._refusals.of_vehicle(frame.sysid, frame.compid, why, _text(address), now):
            channel.on_event(FramesRefused(text))


def _text(address: Address) -> str:
    return f"{address[0]}:{address[1]}" if isinstance(address, tuple) else str(address)
