"""A radio link between vehicles and their ground station: UDP datagrams with loss, delay and outages."""

from __future__ import annotations

import heapq
import random
import select
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

ON_LOOPBACK = "127.0.0.1"
LONGEST_WAIT_S = 0.05


@dataclass
class Radio:
    """The quality of all links of a relay; it may change at any time."""

    loss: float = 0.0
    """share of the datagrams lost, in each direction"""
    delay_s: float = 0.0
    """delay of each datagram, in each direction [s]"""
    is_cut: bool = False
    _random: random.Random = field(default_factory=lambda: random.Random(1))

    def cut_for(self, seconds: float) -> None:
        """Cut all links, and restore them after a time."""
        self.is_cut = True
        time.sleep(seconds)
        self.is_cut = False

    def loses(self) -> bool:
        return self.is_cut or self._random.random() < self.loss


@dataclass
class _Link:
    vehicle_side: socket.socket
    station_side: socket.socket
    station_port: int
    vehicle: tuple[str, int] | None = None
    """address from which the vehicle sent last"""


class Relay:
    """Links to a ground station. A datagram that is on its way when the link is cut still arrives."""

    def __init__(self, radio: Radio) -> None:
        self.radio = radio
        self._links: dict[socket.socket, _Link] = {}
        self._due: list[tuple[float, int, socket.socket, bytes, tuple[str, int]]] = []
        self._sent = 0
        self._is_closed = False
        self._thread = threading.Thread(target=self._run, name="relay", daemon=True)

    def add(self, bind: Callable[[int], socket.socket], station_port: int) -> int:
        """Add the link of a vehicle; return the port to which the vehicle sends."""
        link = _Link(bind(0), bind(0), station_port)
        self._links = {**self._links, link.vehicle_side: link, link.station_side: link}
        return int(link.vehicle_side.getsockname()[1])

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._is_closed = True
        if self._thread.is_alive():
            self._thread.join()
        for one in self._links:
            one.close()

    def _run(self) -> None:
        while not self._is_closed:
            wait_s = min(LONGEST_WAIT_S, self._due[0][0] - time.monotonic()) if self._due else LONGEST_WAIT_S
            readable, _, _ = select.select([*self._links], [], [], max(0.0, wait_s))
            for one in readable:
                self._take(one, *one.recvfrom(65_536))
            while self._due and self._due[0][0] <= time.monotonic():
                _, _, through, data, address = heapq.heappop(self._due)
                through.sendto(data, address)

    def _take(self, one: socket.socket, data: bytes, sender: tuple[str, int]) -> None:
        link = self._links[one]
        if one is link.vehicle_side:
            link.vehicle = sender
            through, address = link.station_side, (ON_LOOPBACK, link.station_port)
        elif link.vehicle is None:
            return
        else:
            through, address = link.vehicle_side, link.vehicle
        if not self.radio.loses():
            self._sent += 1
            heapq.heappush(
                self._due, (time.monotonic() + self.radio.delay_s, self._sent, through, data, address)
            )
