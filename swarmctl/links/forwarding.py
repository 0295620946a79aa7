"""Copies of the traffic for whoever watches: QGroundControl, Mission Planner, MAVProxy ...

Every frame goes out as it came, one a datagram, so that signatures stay whole. A watcher that is absent or
slow loses frames and holds nobody up. What comes back is handed to `on_frame`, if anybody takes it.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Sequence

from swarmctl.core.texts import is_loopback
from swarmctl.links.base import LinkError
from swarmctl.links.transports.base import Address, Transport
from swarmctl.links.url import Endpoint
from swarmctl.mavlink.protocol.codec import Frame, FrameSplitter

WATCHERS_LIMIT = 16
"""addresses that one listening target sends to: the last ones heard"""

OnFrame = Callable[[Frame, str], None]
"""a frame of another station, and who that is, for people"""


class ForwardTarget:
    """One endpoint that is watched from: everybody there gets everything."""

    def __init__(self, endpoint: Endpoint, transport: Transport, on_frame: OnFrame | None) -> None:
        self.endpoint = endpoint
        self._transport = transport
        self._on_frame = on_frame
        self._heard: dict[Address, FrameSplitter] = {}

    async def open(self) -> None:
        """Raises TransportError."""
        await self._transport.open(self._receive)

    def send(self, frame: bytes) -> None:
        for address in self._transport.peers() or tuple(self._heard):
            self._transport.send(frame, address)

    async def close(self) -> None:
        await self._transport.close()

    def _receive(self, data: bytes, address: Address) -> None:
        peers = self._transport.peers()
        if peers and address not in peers:
            return  # a stranger who found the port that we speak from
        splitter = self._heard.pop(address, None) or FrameSplitter()
        # The newest stays longest.
        self._heard[address] = splitter
        if len(self._heard) > WATCHERS_LIMIT:
            del self._heard[next(iter(self._heard))]
        if self._on_frame is not None:
            for frame in splitter.feed(data):
                self._on_frame(frame, str(self.endpoint))


class Forwarder:
    """All targets of one front end."""

    def __init__(self) -> None:
        self._targets: list[ForwardTarget] = []

    @property
    def endpoints(self) -> tuple[Endpoint, ...]:
        return tuple(target.endpoint for target in self._targets)

    async def add(self, target: ForwardTarget) -> None:
        """Raises TransportError."""
        await target.open()
        self._targets.append(target)

    def send(self, frame: bytes) -> None:
        for target in self._targets:
            target.send(frame)

    async def close(self) -> None:
        for target in self._targets:
            await target.close()
        self._targets.clear()


def open_to_strangers(endpoint: Endpoint, *, signed: bool) -> str:
    """Why no station that may command is listened for, or spoken to, there; empty where it may be."""
    if signed or endpoint.kind in ("serial", "memory") or is_loopback(endpoint.host):
        return ""
    if not endpoint.listens:
        return (
            f"{endpoint}: who is at that address, or speaks as it, is not known, and with "
            "links.forward_commands could order the vehicles; send to 127.0.0.1, or set links.signing_key"
        )
    return (
        f"{endpoint}: others than this machine reach it, and with links.forward_commands every one of them "
        "could order the vehicles; listen at 127.0.0.1, or set links.signing_key"
    )


_LISTENER = {"udpout": "udpin", "tcpout": "tcpin", "udpin": "udpin", "tcpin": "tcpin"}


def refuse_loops(watched: Sequence[Endpoint], vehicles: Sequence[Endpoint]) -> None:
    """Raises LinkError where what is forwarded would come back as a vehicle's, again and again."""
    for target in watched:
        for endpoint in vehicles:
            if target == endpoint or (_reaches(target, endpoint) and _is_here(target.host)):
                raise LinkError(
                    f"forward {target}: vehicles are listened for at {endpoint}, so all that is forwarded "
                    "would come back as theirs; give the program that watches a port of its own"
                )


def _reaches(target: Endpoint, endpoint: Endpoint) -> bool:
    return _LISTENER.get(target.kind) == endpoint.kind and 0 != target.port == endpoint.port


def _is_here(host: str) -> bool:
    """An address of this machine can be bound; a name that is unknown is somebody else's trouble."""
    try:
        family = socket.getaddrinfo(host, None, type=socket.SOCK_DGRAM)[0][0]
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.bind((host, 0))
    except OSError:
        return False
    return True
