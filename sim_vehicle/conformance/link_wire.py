"""A `Wire` on a link of the simulator, with the suite's only clock of wall time."""

import asyncio
import time
from collections import deque
from collections.abc import Callable, Hashable
from typing import Any

from sim_vehicle.conformance.traffic import WireError
from sim_vehicle.definitions import MAVLINK1, MAVLINK2
from sim_vehicle.links import LinkCallbacks, LinkError, make_link
from sim_vehicle.links.udp import UdpIn
from sim_vehicle.links.url import Url

SEND_S, RESEND_S = 5.0, 0.01  # longest time of sending one piece, and between two attempts
ADDRESS_SILENCE_S = 1.0  # [s of vehicle time]; after a longer silence a system id may change its address


class SenderAddresses:
    """The address of each system id on a UDP port.

    A vehicle may change its address when the earlier one has fallen silent, for example after a reboot.
    Two senders with one id that send by turns are two vehicles; the id then keeps the address of the first.
    """

    def __init__(self) -> None:
        self._addresses: dict[int, Any] = {}
        self._latest_s: dict[int, float] = {}
        self._rivals: set[int] = set()  # ids used by another address since the last frame from their own
        self._ambiguous: set[int] = set()

    def address(self, sysid: int) -> Any | None:
        return self._addresses.get(sysid)

    def is_ambiguous(self, sysid: int) -> bool:
        """Return True if two senders used this id by turns."""
        return sysid in self._ambiguous

    def received(self, sysid: int, address: Any, now_s: float) -> bool:
        """Record a sender; return False while the id belongs to another address."""
        recorded = self._addresses.get(sysid)
        if recorded is not None and recorded != address:
            self._rivals.add(sysid)
            if sysid in self._ambiguous or now_s - self._latest_s[sysid] <= ADDRESS_SILENCE_S:
                return False
        elif sysid in self._rivals:
            self._ambiguous.add(sysid)
        self._rivals.discard(sysid)
        self._addresses[sysid], self._latest_s[sysid] = address, now_s
        return True


class LinkWire:
    """A link to vehicles. The vehicle time is the wall time since the start, multiplied by `speedup`.

    The event loop of the link runs only during the calls. Raises WireError if the link cannot be opened.
    """

    def __init__(self, url: Url, speedup: float, warn: Callable[[str], None] = lambda _line: None) -> None:
        self._speedup = speedup
        self._started_s = time.monotonic()
        self._loop = asyncio.new_event_loop()
        self._queue: deque[tuple[bytes, Any]] = deque()
        self._senders, self._sysid = SenderAddresses(), 0  # 0: no vehicle is followed
        self._is_udp = url.is_udp
        callbacks = LinkCallbacks(self._received, lambda _peer: None, warn)
        self._link = make_link(url, callbacks, vehicles=(0,))  # the suite is the one sender
        try:
            self._run(self._link.open)
        except LinkError as error:
            self._loop.close()
            raise WireError(str(error)) from error

    def _run(self, function: Callable[[], None]) -> None:
        """Call a function of the link within its event loop."""

        async def call() -> None:
            function()

        self._loop.run_until_complete(call())

    def _wait(self, wall_s: float) -> None:
        """Run the event loop until data arrives, or for a time."""
        timer = self._loop.call_later(wall_s, self._loop.stop)
        try:
            self._loop.run_forever()
        finally:
            timer.cancel()

    def _received(self, data: bytes, peer: Hashable, _vehicles: object) -> None:
        self._queue.append((data, peer))
        self._loop.stop()

    def now_s(self) -> float:
        return (time.monotonic() - self._started_s) * self._speedup

    def send(self, data: bytes) -> None:
        """Send to the peer; on a listening UDP port, to the followed vehicle or, before, to all senders."""
        end_s = time.monotonic() + SEND_S
        while True:
            n_dropped = self._link.dropped
            self._run(lambda: self._send(data))
            if self._link.dropped == n_dropped or time.monotonic() > end_s:
                return
            self._wait(RESEND_S)  # until the line has taken earlier data

    def _send(self, data: bytes) -> None:
        address = self._senders.address(self._sysid) if self._sysid else None
        if isinstance(self._link, UdpIn) and address is not None:
            self._link.send_to(address, data)
        else:
            self._link.send([(0, data)])

    def receive(self, timeout_s: float) -> bytes | None:
        if not self._queue:
            self._wait(max(0.0, timeout_s / self._speedup))
        if not self._queue:
            return None
        data, peer = self._queue.popleft()
        sysid = _source(data) if self._is_udp else None
        if sysid is None:
            return data
        _, address = peer
        if self._senders.received(sysid, address, self.now_s()):
            return data
        if not self._sysid and self._senders.is_ambiguous(sysid):
            first = self._senders.address(sysid)
            raise WireError(
                f"two vehicles use system id {sysid}: one at {first}, one at {address}; "
                "give each vehicle another id"
            )
        return None

    def follow(self, sysid: int) -> None:
        self._sysid = sysid

    def close(self) -> None:
        self._run(self._link.close)
        self._loop.close()


def _source(data: bytes) -> int | None:
    """Return the system id of the frame at the start of a datagram; None if no frame starts there."""
    if len(data) >= 8 and data[0] == MAVLINK1:
        return data[3]
    if len(data) >= 12 and data[0] == MAVLINK2:
        return data[5]
    return None
