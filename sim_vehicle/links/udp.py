"""UDP to one address or to every recent sender; each sent datagram has whole frames of one vehicle.

Sockets are used directly, because a transport of the event loop costs more time. A datagram that does not fit
into the kernel's send buffer is dropped and counted.
"""

import asyncio
import contextlib
import socket
from collections.abc import Collection

from sim_vehicle.links.base import (
    ACTIVE_S,
    BYTES_PER_WAKE,
    DATAGRAMS_PER_WAKE,
    RECEIVE_BYTES,
    Address,
    Batch,
    LinkCallbacks,
    cannot_open,
    resolve,
)
from sim_vehicle.links.url import Url

SEND_BUFFER_BYTES = 4_000_000
RECEIVE_BUFFER_BYTES = 500_000  # small, which limits the processing time after a flood
MAX_PEERS = 32
SILENT_S = 60.0  # silence after which a listening port removes a peer


class UdpOut:
    """A socket to one address, as on SITL; only datagrams from this address are received.

    A rebooted vehicle gets its own socket and therefore another source port.
    """

    def __init__(self, url: Url, callbacks: LinkCallbacks, vehicles: Collection[int]) -> None:
        self.dropped = 0
        self._url, self._callbacks, self._vehicles = url, callbacks, vehicles
        self._address: Address = ()
        self._family = socket.AF_INET
        self._sockets: dict[int, socket.socket] = {}  # by vehicle; all begin with the same socket
        self._reach: dict[socket.socket, frozenset[int]] = {}  # the vehicles of each socket
        self._received_s: float | None = None

    def open(self) -> None:
        self._family, self._address = resolve(self._url, socket.SOCK_DGRAM)
        try:
            opened = self._open_socket()
        except OSError as error:
            raise cannot_open(self._url, error) from error
        self._sockets = dict.fromkeys(self._vehicles, opened)
        self._reach = {opened: frozenset(self._vehicles)}

    def _open_socket(self) -> socket.socket:
        opened = socket.socket(self._family, socket.SOCK_DGRAM)
        try:
            _configure(opened)
            opened.connect(self._address)
        except OSError:
            opened.close()
            raise
        asyncio.get_running_loop().add_reader(opened, self._read, opened)
        return opened

    def _read(self, opened: socket.socket) -> None:
        remaining_bytes = BYTES_PER_WAKE
        for _ in range(DATAGRAMS_PER_WAKE):
            try:
                data = opened.recv(RECEIVE_BYTES)
            except BlockingIOError:
                return
            except OSError:  # the other end has no listener yet
                continue
            self._received_s = asyncio.get_running_loop().time()
            self._callbacks.received(data, (self._url, opened), self._reach[opened])
            remaining_bytes -= len(data)
            if opened.fileno() < 0 or remaining_bytes <= 0:  # closed by the callback, or a flood
                return

    def send(self, batch: Batch) -> None:
        for index, data in batch:
            opened = self._sockets[index]
            try:
                opened.send(data)
            except BlockingIOError:
                self.dropped += 1
            except OSError:  # the error of an earlier datagram
                self._send_again(opened, data)

    def _send_again(self, opened: socket.socket, data: bytes) -> None:
        try:
            opened.send(data)
        except BlockingIOError:
            self.dropped += 1
        except OSError:  # unreachable: lost, as on a real vehicle
            pass

    def rebooted(self, index: int) -> None:
        try:
            opened = self._open_socket()
        except OSError as error:
            self._callbacks.warn(
                f"{self._url}: no socket for a rebooted vehicle ({error.strerror or error}); "
                "the vehicle keeps its port [no-socket]"
            )
            return
        before, self._sockets[index] = self._sockets[index], opened
        self._reach |= {opened: frozenset({index}), before: self._reach[before] - {index}}
        if not self._reach[before]:
            del self._reach[before]
            _close_socket(before)
            self._callbacks.ended((self._url, before))

    def stations(self) -> int:
        if self._received_s is None:
            return 0
        return int(asyncio.get_running_loop().time() - self._received_s < ACTIVE_S)

    def close(self) -> None:
        for opened in self._reach:
            _close_socket(opened)
        self._sockets.clear()
        self._reach.clear()


class UdpIn:
    """A listening port that sends to every recent sender."""

    def __init__(self, url: Url, callbacks: LinkCallbacks) -> None:
        self.dropped = 0
        self._url, self._callbacks = url, callbacks
        self._socket: socket.socket | None = None
        self._received_s: dict[Address, float] = {}  # by peer, longest silence first

    def open(self) -> None:
        family, address = resolve(self._url, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            _configure(self._socket)
            self._socket.bind(address)
        except OSError as error:
            self.close()
            raise cannot_open(self._url, error) from error
        asyncio.get_running_loop().add_reader(self._socket, self._read, self._socket)

    def _read(self, opened: socket.socket) -> None:
        remaining_bytes = BYTES_PER_WAKE
        for _ in range(DATAGRAMS_PER_WAKE):
            try:
                data, address = opened.recvfrom(RECEIVE_BYTES)
            except BlockingIOError:
                return
            except OSError:
                continue
            self._note_peer(address)
            self._callbacks.received(data, (self._url, address), None)
            remaining_bytes -= len(data)
            if remaining_bytes <= 0:
                return

    def _note_peer(self, address: Address) -> None:
        now = asyncio.get_running_loop().time()
        self._received_s.pop(address, None)
        if len(self._received_s) >= MAX_PEERS:
            self._remove_peer(next(iter(self._received_s)))
        self._received_s[address] = now

    def _remove_peer(self, address: Address) -> None:
        del self._received_s[address]
        self._callbacks.ended((self._url, address))

    def send(self, batch: Batch) -> None:
        if self._socket is None:
            return
        now = asyncio.get_running_loop().time()
        for address in [peer for peer, received_s in self._received_s.items() if now - received_s > SILENT_S]:
            self._remove_peer(address)
        for address in self._received_s:
            for _, data in batch:
                self.send_to(address, data)

    def send_to(self, address: Address, data: bytes) -> None:
        """Send to one address, without blocking."""
        if self._socket is None:
            return
        try:
            self._socket.sendto(data, address)
        except BlockingIOError:
            self.dropped += 1
        except OSError:  # unreachable
            pass

    def rebooted(self, index: int) -> None:
        """Do nothing: a listening port stays open."""

    def stations(self) -> int:
        if not self._received_s:
            return 0
        now = asyncio.get_running_loop().time()
        return sum(now - received_s < ACTIVE_S for received_s in self._received_s.values())

    def close(self) -> None:
        _close_socket(self._socket)
        self._socket = None


def _configure(opened: socket.socket) -> None:
    opened.setblocking(False)
    sizes = ((socket.SO_SNDBUF, SEND_BUFFER_BYTES), (socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES))
    for option, size in sizes:
        with contextlib.suppress(OSError):
            opened.setsockopt(socket.SOL_SOCKET, option, size)


def _close_socket(opened: socket.socket | None) -> None:
    if opened is not None:
        asyncio.get_running_loop().remove_reader(opened)
        opened.close()
