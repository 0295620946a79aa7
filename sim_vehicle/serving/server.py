"""The server of a fleet, which connects the fleet to sockets, serial lines and the clock."""

import asyncio
import itertools
import math
import os
from collections.abc import Callable, Collection, Hashable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from sim_vehicle.definitions import MAVLINK2
from sim_vehicle.fleet import TICK_S, Fleet
from sim_vehicle.links import Link, LinkCallbacks, LinkError, make_link
from sim_vehicle.links.url import MAX_PORT, Url
from sim_vehicle.serving.pace import Pace
from sim_vehicle.wire.outbox import Frames

BIN_S = 0.0005  # width of a bin of the histogram
BINS = 4000  # number of bins; the last bin has all delays from 1.9995 s

MAX_DATAGRAM_BYTES = 1200  # longest datagram of several frames
HEARTBEAT_ID = b"\x00\x00\x00"  # message id in a MAVLink 2 frame
ANY_HOST = ("0.0.0.0", "::")


class Lateness:
    """A histogram of lateness in bins of 0.5 ms, with constant memory."""

    def __init__(self) -> None:
        self._counts = [0] * BINS
        self.count = 0
        self.worst_s = 0.0

    def add(self, late_s: float, times: int = 1) -> None:
        """Count `times` messages sent `late_s` [s] late; early messages count as punctual."""
        if times <= 0:
            return
        self._counts[min(int(max(late_s, 0.0) / BIN_S), BINS - 1)] += times
        self.count += times
        self.worst_s = max(self.worst_s, late_s)

    def quantile_s(self, share: float) -> float:
        """Return the quantile of lateness [s], at most 0.5 ms too high below 2 s; NaN without messages."""
        if self.count == 0:
            return math.nan
        remaining = share * self.count
        for i, count in enumerate(self._counts):
            remaining -= count
            if remaining <= 0:
                return min((i + 1) * BIN_S, max(self.worst_s, 0.0)) if i < BINS - 1 else self.worst_s
        return self.worst_s


class Server:
    """A fleet with its ports; each link of the fleet has its own port for each URL."""

    def __init__(
        self,
        fleet: Fleet,
        urls: Sequence[Url],
        pace: Pace,
        *,
        warn: Callable[[str], None],
        port_step: int = 1,
        parent_pid: int | None = None,
        record: Callable[[Frames, float], None] | None = None,
    ) -> None:
        """Prepare the links without opening them. Raises LinkError for URLs that cannot carry the fleet.

        Parameters
        ----------
        warn: function that receives a line for the operator.
        port_step: difference between the ports of two consecutive links.
        parent_pid: process whose end also ends the run.
        record: function that receives all frames to send and the simulated time [s].
        """
        self.fleet, self.pace, self.urls, self.port_step = fleet, pace, tuple(urls), port_step
        self._parent_pid, self._record = parent_pid, record
        self.lateness = Lateness()  # of heartbeats, wall time
        self.sent = [0] * len(fleet.sysids)  # messages by vehicle
        self.simulated_s = 0.0
        self._ticks = 0
        self._boots = fleet.boots()
        self._bug: Exception | None = None
        self._links: dict[int, list[Link]] = {}
        for link in sorted(set(fleet.links)):
            vehicles = [index for index, vehicle_link in enumerate(fleet.links) if vehicle_link == link]
            callbacks = LinkCallbacks(self._receiver(link), partial(fleet.forget_peer, link=link), warn)
            self._links[link] = [
                make_link(self._url_of(url, link), callbacks, vehicles=vehicles) for url in urls
            ]
        self._all_links = [link for links in self._links.values() for link in links]
        self._refuse_shared_ports()

    def _url_of(self, url: Url, link: int) -> Url:
        """Return `url` with the port of one link of the fleet."""
        if url.is_serial:
            if link > 0:
                raise LinkError(
                    f"{url}: a serial line carries one link, but this fleet has several links; "
                    "use UDP or TCP, or fewer vehicles without --per-port"
                )
            return url
        port = url.port + link * self.port_step
        if port > MAX_PORT:
            raise LinkError(
                f"{url}: link {link} needs port {port}, but the highest port is {MAX_PORT}; "
                "choose a lower port"
            )
        return replace(url, port=port)

    def _refuse_shared_ports(self) -> None:
        """Raise LinkError if two URLs use the same port, because a port belongs to one link."""
        for one, other in itertools.combinations(self.urls, 2):
            same_host = one.host == other.host or (one.listens and {one.host, other.host} & {*ANY_HOST})
            if one.kind != other.kind or one.is_serial or not same_host:
                continue
            taken = {self._url_of(one, link).port for link in self._links}
            shared = [port for link in self._links if (port := self._url_of(other, link).port) in taken]
            if shared:
                raise LinkError(
                    f"{one} and {other}: with {len(self._links)} ports each, both use port "
                    f"{min(shared)}; choose ports further apart [port-overlap]"
                )

    @property
    def dropped(self) -> int:
        """Number of datagrams and chunks dropped for slow receivers."""
        return sum(link.dropped for link in self._all_links)

    def stations(self) -> int:
        """Return the number of connected ground stations; a station on two links counts twice."""
        return sum(link.stations() for link in self._all_links)

    def describe_ports(self) -> str:
        """Return the ports as text: `udpout 127.0.0.1:14550 to 14553 and tcpin 0.0.0.0:5760 to 5763`."""
        span = max(self.fleet.links) * self.port_step
        steps = f" by {self.port_step}" if self.port_step > 1 else ""
        return " and ".join(f"{url} to {url.port + span}{steps}" if span else str(url) for url in self.urls)

    async def run(self, *, on_open: Callable[[], None] = lambda: None) -> None:
        """Open the links; run until a cancellation, or until the end of the pace or of the parent process."""
        asyncio.get_running_loop().set_exception_handler(self._note_bug)
        try:
            for link in self._all_links:
                link.open()
            self.pace.start()
            on_open()
            while not (self.pace.finished or self._parent_has_ended()):
                due = await self.pace.due(self._ticks * TICK_S)
                if self._bug is not None:
                    raise self._bug
                if due:
                    self._tick()
        finally:
            for link in self._all_links:
                link.close()

    def _tick(self) -> None:
        self.simulated_s = self._ticks * TICK_S
        self._ticks += 1
        frames = self.fleet.step(self.simulated_s)
        self._note_reboots()
        self._send(frames)
        beats = sum(frame[7:10] == HEARTBEAT_ID and frame[0] == MAVLINK2 for _, frame in frames)
        self.lateness.add(self.pace.late_s(self.simulated_s), beats)

    def _note_bug(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Keep the first exception of a callback; `run` raises the exception."""
        error = context.get("exception")
        if isinstance(error, Exception) and self._bug is None:
            self._bug = error
        else:
            loop.default_exception_handler(context)

    def _parent_has_ended(self) -> bool:
        try:
            if self._parent_pid is not None:
                os.kill(self._parent_pid, 0)
        except ProcessLookupError:
            return True
        except PermissionError:
            pass
        return False

    def _receiver(self, link: int) -> Callable[[bytes, Hashable, Collection[int] | None], None]:
        def received(data: bytes, peer: Hashable, reach: Collection[int] | None) -> None:
            self.simulated_s = self.pace.now_s(self.simulated_s, self._ticks * TICK_S)
            self._send(self.fleet.receive(data, self.simulated_s, peer=peer, link=link, reach=reach))

        return received

    def _note_reboots(self) -> None:
        boots = self.fleet.boots()
        if boots == self._boots:
            return
        for index, (before, after) in enumerate(zip(self._boots, boots, strict=True)):
            if 0 < before < after:
                for link in self._links[self.fleet.links[index]]:
                    link.rebooted(index)
        self._boots = boots

    def _send(self, frames: Frames) -> None:
        if not frames:
            return
        if self._record is not None:
            self._record(frames, self.simulated_s)
        batches: dict[int, list[tuple[int, bytes]]] = {}
        for index, _ in frames:
            self.sent[index] += 1
        for index, data in joined(frames):
            batches.setdefault(self.fleet.links[index], []).append((index, data))
        for number, batch in batches.items():
            for link in self._links[number]:
                link.send(batch)


def joined(frames: Frames) -> Iterable[tuple[int, bytes]]:
    """Join the frames of each vehicle, in order, into as few datagrams as possible."""
    parts: dict[int, list[bytes]] = {}
    sizes: dict[int, int] = {}
    out: list[tuple[int, bytes]] = []
    for index, frame in frames:
        waiting = parts.setdefault(index, [])
        size = sizes.get(index, 0) + len(frame)
        if waiting and size > MAX_DATAGRAM_BYTES:
            out.append((index, b"".join(waiting)))
            waiting.clear()
            size = len(frame)
        waiting.append(frame)
        sizes[index] = size
    out.extend((index, b"".join(waiting)) for index, waiting in parts.items())
    return out
