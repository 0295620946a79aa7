"""Front end: owner of every MAVLink transport of the ground station.

All vehicles of one URL share one transport. The front end learns the address of each system id, and sends a
vehicle's messages to that address only. The front end also writes the tlogs and sends the heartbeats.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Set
from pathlib import Path
from types import TracebackType
from typing import Self

from swarmctl.links.base import (
    ChannelEvent,
    LinkError,
    TransportError,
)
from swarmctl.links.forwarding import Forwarder, ForwardTarget, refuse_loops, stranger_warning
from swarmctl.links.line import Channel, EvidenceRecorder, Line, LineShared
from swarmctl.links.signing import Refusals, Signing, SigningGuard
from swarmctl.links.tlog import TlogWriter
from swarmctl.links.transports import TRANSPORTS
from swarmctl.links.transports.base import Transport
from swarmctl.links.transports.memory import MemoryTransport, MemoryWire
from swarmctl.links.url import Endpoint
from swarmctl.mavlink.protocol.codec import (
    GCS_SYSID,
    Encoder,
    Frame,
    Message,
    decode,
)
from swarmctl.mavlink.protocol.command import is_forced_arming
from swarmctl.mavlink.telemetry.presence import HEARTBEAT_PERIOD_S


class FrontEnd:
    """Front end of a ground station; as a context manager it closes every transport and tlog at the end.

    wall_time_us: clock for tlogs and signatures [µs since 1970]
    signing: signature of outgoing frames, and check of incoming frames
    memory: wires of `memory:NAME` endpoints, by NAME
    evidence: recorder of messages; the recorder may forbid messages to vehicles
    say: output of messages to the operator
    """

    def __init__(
        self,
        *,
        wall_time_us: Callable[[], int],
        memory: Mapping[str, MemoryWire] | None = None,
        evidence: EvidenceRecorder | None = None,
        signing: Signing | None = None,
        say: Callable[[str], None] = lambda _text: None,
    ) -> None:
        self._wall_time_us = wall_time_us
        self._memory = memory or {}
        guard = SigningGuard(signing, wall_time_us)
        self._shared = LineShared(Encoder(), Forwarder(), guard, evidence, say)
        self._lines: dict[Endpoint, Line] = {}
        self._open_lock = asyncio.Lock()
        self._timer: asyncio.TimerHandle | None = None
        self._at_close: list[Callable[[], None]] = []
        self._say = say
        self._n_forced = 0
        """number of dropped commands of other stations to arm or disarm by force"""
        self._refusals = Refusals()
        """refused frames of other stations"""
        self._reported_trouble = ""

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def open(self, endpoint: Endpoint) -> None:
        """Open the endpoint's transport unless it is open. Raises TransportError, or LinkError for a loop."""
        async with self._open_lock:
            if endpoint in self._lines:
                return
            refuse_loops(self._shared.forwarder.endpoints, [endpoint])
            line = Line(endpoint, len(self._lines), self._transport(endpoint), self._shared)
            await line.transport.open(line.receive)
            self._lines[endpoint] = line
            if self._timer is None:
                self._heartbeat()

    async def forward(self, endpoint: Endpoint, *, commands: bool = False) -> None:
        """Copy the frames of vehicles and of this program to the stations at an endpoint.

        If `commands`, frames of these stations reach the vehicles. Exceptions: frames refused by signing,
        forced arming and disarming, and commands that the evidence recorder forbids.
        Raises TransportError, and LinkError for a loop or if unknown stations could command.
        """
        refuse_loops([endpoint], list(self._lines))
        signed = self._shared.guard.signing is not None
        if commands and (warning := stranger_warning(endpoint, signed=signed)):
            raise LinkError(f"forward {warning}")
        on_frame = self._from_station if commands else None
        await self._shared.forwarder.add(ForwardTarget(endpoint, self._transport(endpoint), on_frame))

    def _from_station(self, frame: Frame, where: str) -> None:
        if why := self._shared.guard.why_not(frame):
            if text := self._refusals.of_stranger(frame.sysid, why, where, asyncio.get_running_loop().time()):
                self._say(f"other stations: {text}")
            return
        message = decode(frame)
        if message is None:
            return
        target = int(getattr(message, "target_system", 0))
        by = f"station {frame.sysid} at {where}"
        if is_forced_arming(message):
            self._n_forced += 1
            if self._n_forced == 1:
                self._say(f"{by} commands a forced arming or disarming; such commands are dropped [forced]")
            return
        if self._shared.evidence is None or self._shared.evidence.to_vehicle(target, message, by):
            for line in self._lines.values():
                line.pass_on(frame, target)

    def attach(
        self,
        endpoint: Endpoint,
        sysid: int,
        *,
        on_message: Callable[[Message], None],
        on_event: Callable[[ChannelEvent], None],
        may_move: Callable[[], bool],
        tlog: Path | None,
        read_ids: Set[int],
    ) -> Channel:
        """Return the channel of one system id on an open endpoint; `on_message` gets messages of `read_ids`.

        `may_move`: as for `AddressTracker`.
        Raises LinkError if another vehicle on this endpoint, or this station, has the system id.
        """
        line = self._lines[endpoint]
        if sysid in line.sysids:
            raise LinkError(
                f"system id {sysid} is used by two vehicles on {endpoint}; give one vehicle another id "
                "(ArduPilot: parameter SYSID_THISMAV, or MAV_SYSID since version 4.7; PX4: MAV_SYS_ID) or "
                "its own link [system-id-twice]"
            )
        if sysid == GCS_SYSID:
            raise LinkError(
                f"system id {sysid} on {endpoint} is this ground station's id; give the vehicle an id from "
                "1 to 254 [system-id-own]"
            )
        writer = None if tlog is None else TlogWriter(tlog, self._wall_time_us, self._say)
        return Channel(line, sysid, on_message, on_event, writer, read_ids, may_move)

    def systems_on(self, endpoint: Endpoint) -> frozenset[int]:
        """Return the system ids of all autopilots received on an endpoint."""
        return frozenset(self._lines[endpoint].systems) if endpoint in self._lines else frozenset()

    def last_refusal_on(self, endpoint: Endpoint, sysid: int) -> str:
        """Return why the last refused frame of an autopilot was refused; empty if none was."""
        return self._lines[endpoint].last_refusals.get(sysid, "") if endpoint in self._lines else ""

    async def why_not_arm(self) -> str:
        """Wait until the evidence so far is on disk; return the reason that forbids arming, or ""."""
        return "" if self._shared.evidence is None else await self._shared.evidence.wait_until_stored()

    def trouble_on(self, endpoint: Endpoint) -> str:
        """Return the fault of an endpoint's transport, and `refusal_summary`; empty if there is neither."""
        fault = self._lines[endpoint].transport.trouble if endpoint in self._lines else ""
        return "; ".join(text for text in (fault, self.refusal_summary) if text)

    def has_unread(self, endpoint: Endpoint) -> bool:
        """Return whether received bytes wait at an endpoint."""
        return endpoint in self._lines and self._lines[endpoint].transport.has_unread

    @property
    def refusal_summary(self) -> str:
        """Return the numbers of refused frames and dropped commands, and signing faults; empty if none."""
        forced = f"forced armings or disarmings of other stations dropped: {self._n_forced}"
        return "; ".join(
            text for text in (self._shared.guard.trouble, forced if self._n_forced else "") if text
        )

    def at_close(self, release: Callable[[], None]) -> None:
        """Register a function to be called before the transports close."""
        self._at_close.append(release)

    async def close(self) -> None:
        for release in self._at_close:
            release()
        self._at_close.clear()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        for line in self._lines.values():
            await line.transport.close()
        self._lines.clear()
        await self._shared.forwarder.close()

    def _heartbeat(self) -> None:
        self._timer = asyncio.get_running_loop().call_later(HEARTBEAT_PERIOD_S, self._heartbeat)
        signing = self._shared.guard.signing
        if signing is not None and signing.trouble != self._reported_trouble:
            self._reported_trouble = signing.trouble
            self._say(signing.trouble)
        for line in self._lines.values():
            line.heartbeat()
            line.flush_logs()

    def _transport(self, endpoint: Endpoint) -> Transport:
        transport = TRANSPORTS[endpoint.kind].transport
        if transport is not None:
            return transport(endpoint)
        wire = self._memory.get(endpoint.host)
        if wire is None:
            known = ", ".join(sorted(self._memory)) or "none"
            raise TransportError(f"{endpoint}: no memory wire has this name; known: {known}")
        return MemoryTransport(wire)
