"""UDP, to one address or to every known sender; one datagram has whole frames of one vehicle.

Sockets are used directly, which costs less than a transport of the event loop. A datagram that does not fit
into the kernel's buffer is dropped and counted.
"""

import asyncio
import contextlib
import socket
from collections.abc import Collection

from sim_vehicle.links.base import (
    AGAIN_S,
    BYTES_PER_WAKE,
    DATAGRAMS_PER_WAKE,
    HEARD_S,
    RECEIVE_BYTES,
    Address,
    Batch,
    Ends,
    cannot_open,
    resolve,
)
from sim_vehicle.links.url import Url

SEND_BUFFER_BYTES = 4_000_000
RECEIVE_BUFFER_BYTES = 500_000  # small, so that a flood is not processed long after its end
MAX_PEERS = 32
SILENT_S = 60.0  # then a listening port forgets a peer; ground stations send a heartbeat each second


class UdpOut:
    """A socket to one address, as on SITL, which receives only from that address.

    A rebooted vehicle gets a socket, and so a port, of its own.
    """

    def __init__(self, url: Url, ends: Ends, vehicles: Collection[int]) -> None:
        self.dropped = 0
        self._url, self._ends = url, ends
        self._vehicles = frozenset(vehicles)
        self._address: Address = ()
        self._family = socket.AF_INET
        self._shared: socket.socket | None = None
        self._sharing: frozenset[int] | None = None  # vehicles; None: all
        # Sockets of rebooted vehicles; None: no socket was available, and the vehicle is silent.
        self._own: dict[int, socket.socket | None] = {}
        self._timer: asyncio.TimerHandle | None = None
        self._heard_s: float | None = None

    def open(self) -> None:
        self._family, self._address = resolve(self._url, socket.SOCK_DGRAM)
        try:
            self._shared = self._connected(None)
        except OSError as error:
            raise cannot_open(self._url, error) from error

    def _connected(self, index: int | None) -> socket.socket:
        opened = socket.socket(self._family, socket.SOCK_DGRAM)
        try:
            _make_ready(opened)
            opened.connect(self._address)
        except OSError:
            opened.close()
            raise
        asyncio.get_running_loop().add_reader(opened, self._read, opened, index)
        return opened

    def _read(self, opened: socket.socket, index: int | None) -> None:
        left = BYTES_PER_WAKE
        for _ in range(DATAGRAMS_PER_WAKE):
            try:
                data = opened.recv(RECEIVE_BYTES)
            except BlockingIOError:
                return
            except OSError:  # no listener at the other end yet
                continue
            self._heard_s = asyncio.get_running_loop().time()
            # A message sent to all known addresses reaches each vehicle once.
            self._ends.received(data, (self._url, index), self._sharing if index is None else (index,))
            left -= len(data)
            if opened.fileno() < 0 or left <= 0:  # closed by the message, or a flood
                return

    def send(self, batch: Batch) -> None:
        for index, data in batch:
            to = self._own.get(index, self._shared)
            if to is None:
                continue
            try:
                to.send(data)
            except BlockingIOError:
                self.dropped += 1
            except OSError:  # the error of an earlier datagram
                self._again(to, data)

    def _again(self, to: socket.socket, data: bytes) -> None:
        try:
            to.send(data)
        except BlockingIOError:
            self.dropped += 1
        except OSError:  # unreachable: lost, as on a real vehicle
            pass

    def rebooted(self, index: int) -> None:
        _drop(self._own.get(index))
        self._own[index] = None
        self._sharing = self._vehicles - self._own.keys()
        if not self._sharing:
            _drop(self._shared)
            self._shared = None
        if self._timer is None:
            self._come_back()

    def _come_back(self) -> None:
        """Open the missing sockets; without a network, try again later."""
        tried_before, self._timer = self._timer is not None, None
        try:
            for index in [index for index, opened in self._own.items() if opened is None]:
                self._own[index] = self._connected(index)
        except OSError as error:
            self._timer = asyncio.get_running_loop().call_later(AGAIN_S, self._come_back)
            if not tried_before:
                why = error.strerror or error
                again = f"trying again every {AGAIN_S:g} s"
                self._ends.warn(f"{self._url}: no socket for a rebooted vehicle ({why}); {again} [no-socket]")

    def stations(self) -> int:
        if self._heard_s is None:
            return 0
        return int(asyncio.get_running_loop().time() - self._heard_s < HEARD_S)

    def close(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        for opened in (self._shared, *self._own.values()):
            _drop(opened)
        self._shared = None
        self._own.clear()


class UdpIn:
    """A listening port, which sends to every recent sender."""

    def __init__(self, url: Url, ends: Ends) -> None:
        self.dropped = 0
        self._url, self._ends = url, ends
        self._socket: socket.socket | None = None
        self._heard_s: dict[Address, float] = {}  # by peer, the longest silent first

    def open(self) -> None:
        family, address = resolve(self._url, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            _make_ready(self._socket)
            self._socket.bind(address)
        except OSError as error:
            self.close()
            raise cannot_open(self._url, error) from error
        asyncio.get_running_loop().add_reader(self._socket, self._read, self._socket)

    def _read(self, opened: socket.socket) -> None:
        left = BYTES_PER_WAKE
        for _ in range(DATAGRAMS_PER_WAKE):
            try:
                data, address = opened.recvfrom(RECEIVE_BYTES)
            except BlockingIOError:
                return
            except OSError:
                continue
            self._keep(address)
            self._ends.received(data, (self._url, address), None)
            left -= len(data)
            if left <= 0:
                return

    def _keep(self, address: Address) -> None:
        now = asyncio.get_running_loop().time()
        self._heard_s.pop(address, None)
        if len(self._heard_s) >= MAX_PEERS:
            self._forget(next(iter(self._heard_s)))
        self._heard_s[address] = now

    def _forget(self, address: Address) -> None:
        del self._heard_s[address]
        self._ends.gone((self._url, address))

    def send(self, batch: Batch) -> None:
        if self._socket is None:
            return
        now = asyncio.get_running_loop().time()
        for address in [peer for peer, heard_s in self._heard_s.items() if now - heard_s > SILENT_S]:
            self._forget(address)
        for address in self._heard_s:
            for _, data in batch:
                try:
                    self._socket.sendto(data, address)
                except BlockingIOError:
                    self.dropped += 1
                except OSError:  # unreachable
                    continue

    def rebooted(self, index: int) -> None:
        """Do nothing: a listening port stays."""

    def stations(self) -> int:
        if not self._heard_s:
            return 0
        now = asyncio.get_running_loop().time()
        return sum(now - heard_s < HEARD_S for heard_s in self._heard_s.values())

    def close(self) -> None:
        _drop(self._socket)
        self._socket = None


def _make_ready(opened: socket.socket) -> None:
    opened.setblocking(False)
    sizes = ((socket.SO_SNDBUF, SEND_BUFFER_BYTES), (socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES))
    for option, size in sizes:
        with contextlib.suppress(OSError):
            opened.setsockopt(socket.SOL_SOCKET, option, size)


def _drop(opened: socket.socket | None) -> None:
    if opened is not None:
        asyncio.get_running_loop().remove_reader(opened)
        opened.close()
