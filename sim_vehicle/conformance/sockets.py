"""Links to a vehicle over UDP, TCP or a serial port, with the suite's only clock of wall time."""

import contextlib
import select
import socket
import time
from collections.abc import Callable
from typing import Any

import serial

from sim_vehicle.conformance.traffic import Wire, WireError
from sim_vehicle.links.url import Url

DATAGRAM_BYTES = 65_536
CONNECT_S, SEND_S = 5.0, 5.0  # longest time of the first connection, and of sending one piece
RECONNECT_S = 0.5  # between attempts to reconnect, for example while a vehicle reboots
V1, V2 = 0xFE, 0xFD  # first byte of a frame of MAVLink 1 and 2
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

    @property
    def addresses(self) -> list[Any]:
        """Return the addresses of all system ids, without duplicates."""
        return list(dict.fromkeys(self._addresses.values()))

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


class _TimedWire:
    """A wire with the vehicle time: wall time since the start, multiplied by `speedup`."""

    def __init__(self, speedup: float) -> None:
        self._speedup = speedup
        self._started_s = time.monotonic()

    def now_s(self) -> float:
        return (time.monotonic() - self._started_s) * self._speedup

    def _wall_s(self, vehicle_s: float) -> float:
        return max(0.0, vehicle_s / self._speedup)

    def follow(self, sysid: int) -> None:
        """Do nothing, unless the link has several peers."""


class UdpWire(_TimedWire):
    """A UDP socket that sends to the URL's address (udpout) or to the senders' latest addresses (udpin)."""

    def __init__(self, url: Url, speedup: float) -> None:
        super().__init__(speedup)
        self._senders = SenderAddresses()
        self._sysid: int | None = None
        self._server: Any = None
        try:
            family, _, _, _, address = socket.getaddrinfo(url.host, url.port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
            if url.listens:
                self._socket.bind(address)
            else:
                self._server = address
        except OSError as error:
            remedy = "check the host and that the port is free" if url.listens else "check the host name"
            raise WireError(f"cannot open {url}: {error.strerror or error}; {remedy}") from error
        self._socket.setblocking(False)

    def send(self, data: bytes) -> None:
        if self._server is not None:
            targets = [self._server]
        elif self._sysid is not None:
            address = self._senders.address(self._sysid)
            targets = [] if address is None else [address]
        else:
            targets = self._senders.addresses
        for address in targets:
            # An absent vehicle can cause an error; the checks report the missing answers.
            with contextlib.suppress(OSError):
                self._socket.sendto(data, address)

    def receive(self, timeout_s: float) -> bytes | None:
        ready, _, _ = select.select([self._socket], [], [], self._wall_s(timeout_s))
        if not ready:
            return None
        try:
            data, address = self._socket.recvfrom(DATAGRAM_BYTES)
        except OSError:
            return None
        sysid = _source(data)
        if sysid is None or self._senders.received(sysid, address, self.now_s()):
            return data
        if self._sysid is None and self._senders.is_ambiguous(sysid):
            first = self._senders.address(sysid)
            raise WireError(
                f"two vehicles use system id {sysid}: one at {first}, one at {address}; "
                "give each vehicle another id"
            )
        return None

    def follow(self, sysid: int) -> None:
        self._sysid = sysid

    def close(self) -> None:
        self._socket.close()


def _connected(url: Url, within_s: float) -> socket.socket:
    """Return a connection made within this time, with `SEND_S` as its later time-out."""
    connection = socket.create_connection((url.host, url.port), timeout=within_s)
    connection.settimeout(SEND_S)
    return connection


class TcpWire(_TimedWire):
    """A TCP connection that is opened again after a disconnection, for example by a reboot."""

    def __init__(self, url: Url, speedup: float) -> None:
        super().__init__(speedup)
        self._url = url
        self._connection: socket.socket | None = None
        self._listener: socket.socket | None = None
        try:
            if url.listens:
                family = socket.AF_INET6 if ":" in url.host else socket.AF_INET
                self._listener = socket.create_server((url.host, url.port), family=family)
            else:
                self._connection = _connected(url, CONNECT_S)
        except OSError as error:
            remedy = "the port is free" if url.listens else "a vehicle listens at this address"
            raise WireError(f"cannot open {url}: {error.strerror or error}; check that {remedy}") from error

    def send(self, data: bytes) -> None:
        if self._connection is not None:
            try:
                self._connection.sendall(data)
            except OSError:
                self._drop()

    def receive(self, timeout_s: float) -> bytes | None:
        end_s = time.monotonic() + self._wall_s(timeout_s)
        while True:
            remaining_s = max(0.0, end_s - time.monotonic())
            if self._connection is None and not self._connect(remaining_s):
                return None
            assert self._connection is not None
            ready, _, _ = select.select([self._connection], [], [], max(0.0, end_s - time.monotonic()))
            if not ready:
                return None
            with contextlib.suppress(OSError):
                if data := self._connection.recv(DATAGRAM_BYTES):
                    return data
            self._drop()

    def _connect(self, remaining_s: float) -> bool:
        """Try once to connect, for at most about `remaining_s` [s of wall time]; return True on success."""
        if self._listener is not None:
            ready, _, _ = select.select([self._listener], [], [], remaining_s)
            if ready:
                self._connection, _ = self._listener.accept()
                self._connection.settimeout(SEND_S)
            return bool(ready)
        try:
            self._connection = _connected(self._url, max(remaining_s, 0.01))
        except OSError:
            time.sleep(min(remaining_s, RECONNECT_S))
            return False
        return True

    def _drop(self) -> None:
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def close(self) -> None:
        self._drop()
        if self._listener is not None:
            self._listener.close()


class SerialWire(_TimedWire):
    """A serial port that is opened again after a disconnection, for example of an autopilot on USB."""

    def __init__(self, device: str, baud: int, speedup: float) -> None:
        super().__init__(speedup)
        self._device, self._baud = device, baud
        self._port: serial.Serial | None = None
        try:
            self._open()
        except (OSError, ValueError) as error:
            raise WireError(f"cannot open {device} at {baud} baud: {error}; check the device") from error

    def _open(self) -> None:
        self._port = serial.Serial(self._device, self._baud, timeout=0)

    def send(self, data: bytes) -> None:
        if self._port is not None:
            try:
                self._port.write(data)
            except OSError:
                self._drop()

    def receive(self, timeout_s: float) -> bytes | None:
        end_s = time.monotonic() + self._wall_s(timeout_s)
        while self._port is None:
            remaining_s = max(0.0, end_s - time.monotonic())
            if not self._reopen(remaining_s) and remaining_s == 0.0:
                return None
        try:
            self._port.timeout = max(0.0, end_s - time.monotonic())
            first = self._port.read(1)
            return first + self._port.read(self._port.in_waiting) if first else None
        except OSError:
            self._drop()
            return None

    def _reopen(self, remaining_s: float) -> bool:
        """Try once to open the port; wait at most `remaining_s` [s of wall time] after a failure."""
        try:
            self._open()
        except (OSError, ValueError):
            time.sleep(min(remaining_s, RECONNECT_S))
            return False
        return True

    def _drop(self) -> None:
        if self._port is not None:
            self._port.close()
            self._port = None

    def close(self) -> None:
        self._drop()


def _source(data: bytes) -> int | None:
    """Return the system id of the frame at the start of a datagram; None if no frame starts there."""
    if len(data) >= 8 and data[0] == V1:
        return data[3]
    if len(data) >= 12 and data[0] == V2:
        return data[5]
    return None


def open_wire(url: Url, *, speedup: float = 1.0) -> Wire:
    """Open the wire for a URL; raise WireError if the URL cannot be opened."""
    wires: dict[str, Callable[[], Wire]] = {
        "udpin": lambda: UdpWire(url, speedup),
        "udpout": lambda: UdpWire(url, speedup),
        "tcpin": lambda: TcpWire(url, speedup),
        "tcpout": lambda: TcpWire(url, speedup),
        "serial": lambda: SerialWire(url.host, url.port, speedup),
    }
    if url.kind not in wires:
        raise WireError(f"{url}: {url.kind} is an unknown kind of link; use one of {', '.join(wires)}")
    return wires[url.kind]()
