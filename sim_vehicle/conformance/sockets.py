"""Links to a vehicle over UDP, TCP or a serial port, with the suite's only clock of wall time."""

import contextlib
import os
import select
import socket
import time
from typing import Any

import serial

from sim_vehicle.conformance.traffic import Wire, WireError
from sim_vehicle.definitions import MAVLINK1, MAVLINK2
from sim_vehicle.links.url import Url

DATAGRAM_BYTES = 65_536
CONNECT_S, SEND_S = 5.0, 5.0  # longest time of the first connection, and of sending one piece
RECONNECT_S = 0.5  # between attempts to reconnect, for example while a vehicle reboots
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


class _StreamWire(_TimedWire):
    """A stream that is opened again after a disconnection, for example by a reboot."""

    _stream: Any = None

    def _open(self, within_s: float) -> Any:
        """Open the stream within a time [s of wall time]; raise OSError or ValueError."""
        raise NotImplementedError

    def _write(self, data: bytes) -> None:
        raise NotImplementedError

    def _read(self, within_s: float) -> bytes | None:
        """Return the next bytes within a time [s of wall time], or None; raise OSError if it ended."""
        ready, _, _ = select.select([self._stream], [], [], within_s)
        if not ready:
            return None
        data = os.read(self._stream.fileno(), DATAGRAM_BYTES)
        if not data:
            raise ConnectionResetError
        return data

    def send(self, data: bytes) -> None:
        if self._stream is not None:
            try:
                self._write(data)
            except OSError:
                self._drop()

    def receive(self, timeout_s: float) -> bytes | None:
        end_s = time.monotonic() + self._wall_s(timeout_s)
        while True:
            remaining_s = max(0.0, end_s - time.monotonic())
            was_open = self._stream is not None
            try:
                if not was_open:
                    self._stream = self._open(remaining_s)
                return self._read(max(0.0, end_s - time.monotonic()))
            except (OSError, ValueError):
                self._drop()
                if not was_open:
                    time.sleep(min(max(0.0, end_s - time.monotonic()), RECONNECT_S))
                    return None

    def _drop(self) -> None:
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def close(self) -> None:
        self._drop()


class TcpWire(_StreamWire):
    """A TCP connection to a server, or from a client."""

    def __init__(self, url: Url, speedup: float) -> None:
        super().__init__(speedup)
        self._url = url
        self._listener: socket.socket | None = None
        try:
            if url.listens:
                family = socket.AF_INET6 if ":" in url.host else socket.AF_INET
                self._listener = socket.create_server((url.host, url.port), family=family)
            else:
                self._stream = self._open(CONNECT_S)
        except OSError as error:
            remedy = "the port is free" if url.listens else "a vehicle listens at this address"
            raise WireError(f"cannot open {url}: {error.strerror or error}; check that {remedy}") from error

    def _open(self, within_s: float) -> socket.socket:
        if self._listener is not None:
            self._listener.settimeout(within_s)
            stream, _ = self._listener.accept()
        else:
            stream = socket.create_connection((self._url.host, self._url.port), timeout=max(within_s, 0.01))
        stream.settimeout(SEND_S)
        return stream

    def _write(self, data: bytes) -> None:
        self._stream.sendall(data)

    def close(self) -> None:
        super().close()
        if self._listener is not None:
            self._listener.close()


class SerialWire(_StreamWire):
    """A serial port, also of an autopilot on USB."""

    def __init__(self, device: str, baud: int, speedup: float) -> None:
        super().__init__(speedup)
        self._device, self._baud = device, baud
        try:
            self._stream = self._open(0.0)
        except (OSError, ValueError) as error:
            raise WireError(f"cannot open {device} at {baud} baud: {error}; check the device") from error

    def _open(self, within_s: float) -> serial.Serial:
        return serial.Serial(self._device, self._baud, timeout=0)

    def _write(self, data: bytes) -> None:
        self._stream.write(data)


def _source(data: bytes) -> int | None:
    """Return the system id of the frame at the start of a datagram; None if no frame starts there."""
    if len(data) >= 8 and data[0] == MAVLINK1:
        return data[3]
    if len(data) >= 12 and data[0] == MAVLINK2:
        return data[5]
    return None


def open_wire(url: Url, speedup: float) -> Wire:
    """Open the wire for a URL; raise WireError if the URL cannot be opened."""
    if url.is_serial:
        return SerialWire(url.host, url.port, speedup)
    return UdpWire(url, speedup) if url.is_udp else TcpWire(url, speedup)
