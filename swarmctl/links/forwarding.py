"""Forwarding: copies of the traffic for other stations (QGroundControl, Mission Planner, MAVProxy ...).

Each frame is sent unchanged, so signatures stay valid. An absent or slow station loses frames and delays
nothing. `on_frame`, if set, receives the frames of other stations.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Sequence

from swarmctl.core.operator_text import is_loopback
from swarmctl.links.base import LinkError
from swarmctl.links.transports.base import Address, Transport
from swarmctl.links.url import Endpoint
from swarmctl.mavlink.protocol.codec import Frame, FrameSplitter

STATIONS_LIMIT = 16
"""largest number of station addresses of one listening target; the latest senders stay"""

OnFrame = Callable[[Frame, str], None]
"""callback for a frame of another station, with the station's endpoint as text"""


class ForwardTarget:
    """One endpoint for other stations; each known station at the endpoint receives all frames."""

    def __init__(self, endpoint: Endpoint, transport: Transport, on_frame: OnFrame | None) -> None:
        self.endpoint = endpoint
        self._transport = transport
        self._on_frame = on_frame
        self._splitters: dict[Address, FrameSplitter] = {}

    async def open(self) -> None:
        """Open the transport. Raises TransportError."""
        await self._transport.open(self._receive)

    def send(self, frame: bytes) -> None:
        for address in self._transport.peers() or tuple(self._splitters):
            self._transport.send(frame, address)

    async def close(self) -> None:
        await self._transport.close()

    def _receive(self, data: bytes, address: Address) -> None:
        peers = self._transport.peers()
        if peers and address not in peers:
            return  # not from the station of this target
        splitter = self._splitters.pop(address, None) or FrameSplitter()
        self._splitters[address] = splitter
        if len(self._splitters) > STATIONS_LIMIT:
            del self._splitters[next(iter(self._splitters))]
        if self._on_frame is not None:
            for frame in splitter.feed(data):
                self._on_frame(frame, str(self.endpoint))


class Forwarder:
    """All forward targets of one front end."""

    def __init__(self) -> None:
        self._targets: list[ForwardTarget] = []

    @property
    def endpoints(self) -> tuple[Endpoint, ...]:
        return tuple(target.endpoint for target in self._targets)

    async def add(self, target: ForwardTarget) -> None:
        """Open a target and add it. Raises TransportError."""
        await target.open()
        self._targets.append(target)

    def send(self, frame: bytes) -> None:
        for target in self._targets:
            target.send(frame)

    async def close(self) -> None:
        for target in self._targets:
            await target.close()
        self._targets.clear()


def stranger_warning(endpoint: Endpoint, *, signed: bool) -> str:
    """Return a warning if unknown senders at an endpoint could command vehicles; empty otherwise."""
    if signed or endpoint.is_wire or is_loopback(endpoint.host):
        return ""
    if not endpoint.listens:
        return (
            f"{endpoint}: with links.forward_commands any sender at that address could command vehicles; "
            "send to 127.0.0.1, or set links.signing_key [open-to-strangers]"
        )
    return (
        f"{endpoint}: with links.forward_commands other machines that reach this endpoint could command "
        "vehicles; listen at 127.0.0.1, or set links.signing_key [open-to-strangers]"
    )


_LISTENER = {"udpout": "udpin", "tcpout": "tcpin", "udpin": "udpin", "tcpin": "tcpin"}


def refuse_loops(targets: Sequence[Endpoint], vehicle_endpoints: Sequence[Endpoint]) -> None:
    """Raise LinkError if frames forwarded to a target would return at a vehicle's endpoint, without end."""
    for target in targets:
        for endpoint in vehicle_endpoints:
            if target == endpoint or (_reaches(target, endpoint) and _is_this_machine(target.host)):
                raise LinkError(
                    f"forward {target}: vehicles are expected at {endpoint}, so forwarded frames would "
                    "return as frames of vehicles; give the other station its own port [forward-loop]"
                )


def _reaches(target: Endpoint, endpoint: Endpoint) -> bool:
    return _LISTENER.get(target.kind) == endpoint.kind and 0 != target.port == endpoint.port


def _is_this_machine(host: str) -> bool:
    """Return whether this machine can bind the host's address."""
    try:
        family = socket.getaddrinfo(host, None, type=socket.SOCK_DGRAM)[0][0]
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.bind((host, 0))
    except OSError:
        return False
    return True
