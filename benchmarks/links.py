"""Costs of the links `direct` and `mavsdk`: uploads and swaps over bad radio, and CPU.

Nothing is asserted; the load of the machine is printed. Options choose the rows; for example
`--only uploads --links direct --vehicles 50 --items 10,50 --losses 0,0.3 --delays 0,1`.

- `direct` runs on the virtual clock. Its times are in simulated seconds, except the wall time.
- `mavsdk` runs in real time. All of its rows take hours.
- Losses and delays of datagrams are independent, in both directions.
- Datagrams include streams. Messages are mission messages only.
- WRONG: the link reports a mission as verified, and the vehicle has another mission. The benchmark reads it
  without loss. Roundings of the autopilot do not count.
- late: the vehicle passed the splice point before the swap. The splice point is on the old mission,
  `--ahead-s` ahead of the vehicle; the default is an agent's greatest.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import math
import os
import random
import re
import resource
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rich.console import Console
from rich.table import Table
from tables import describe_load, make_table

from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import default_scenario
from swarmctl.agent.replan import swap_times
from swarmctl.core.mission import FlightPlan, MissionItem, Waypoint
from swarmctl.core.records import replace
from swarmctl.core.vehicle import VehicleState
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.links import LINKS
from swarmctl.links.base import LinkError, UploadFailed
from swarmctl.links.direct import DirectLink
from swarmctl.links.frontend import FrontEnd
from swarmctl.links.transports.memory import MemoryWire
from swarmctl.links.url import Endpoint, parse_url
from swarmctl.mavlink.dialects import dialect_for
from swarmctl.mavlink.protocol.codec import Encoder, FrameSplitter, Message, decode
from swarmctl.mavlink.protocol.mission_transfer import item_of

HOME = (46.0490, 14.5060, 300.0)
M_PER_DEG = 111_195.0
"""length of a degree of latitude [m]"""
STEP_S = 0.05
RATES_HZ = {33: 5, 30: 5, 74: 4, 1: 2, 24: 1, 147: 1, 42: 1}
"""message id -> messages a second: 19 in all, besides the heartbeat"""
LIMIT_S = {"direct": 3600.0, "mavsdk": 240.0}
"""link -> time after which a transfer is given up"""
SETTLE_S, MEASURE_S = 8.0, 15.0
MISSION_MESSAGES = frozenset({37, 38, 39, 40, 41, 43, 44, 45, 47, 51, 73})
"""ids of the messages of mission transfers, and of MISSION_SET_CURRENT"""
DIALECTS = {
    "ardupilot": dialect_for(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_TYPE_QUADROTOR),
    "px4": dialect_for(mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_TYPE_QUADROTOR),
}


class LossyFleet:
    """A fleet behind a wire that loses and delays each datagram independently."""

    def __init__(self, personality: str, count: int, seed: int = 1) -> None:
        self.fleet = Fleet(default_scenario(count, home=HOME, personality=personality), ready_s=0)
        self.wire = MemoryWire()
        self.wire.connect_vehicles(self._send_to_vehicles)
        self.loss, self.delay_s, self.n_datagrams, self.n_messages = 0.0, 0.0, 0, 0
        self._rng = random.Random(seed)
        self._loop = asyncio.get_running_loop()
        self._began_s = self._arrives_s = self._loop.time()

    def now_s(self) -> float:
        return self._loop.time() - self._began_s

    def _carry(self, deliver: object, data: bytes, *args: object) -> None:
        assert callable(deliver)
        self.n_datagrams += 1
        self.n_messages += sum(msgid in MISSION_MESSAGES for msgid in msgids_in(data))
        if self._rng.random() >= self.loss:
            # Arrival times differ, because timers of equal time fire in any order.
            after = math.nextafter(self._arrives_s, math.inf)
            self._arrives_s = max(self._loop.time() + self.delay_s, after)
            self._loop.call_at(self._arrives_s, deliver, data, *args)

    def _send_to_vehicles(self, data: bytes, address: object) -> None:
        self._carry(lambda data: self._send_to_station(self.fleet.receive(data, self.now_s())), data)

    def _send_to_station(self, frames: list[tuple[int, bytes]]) -> None:
        for _, data in frames:
            self._carry(self.wire.from_vehicle, data, "fleet")

    async def fly(self) -> None:
        """Step the fleet until cancelled."""
        while True:
            self._send_to_station(self.fleet.step(self.now_s()))
            await asyncio.sleep(STEP_S)

    def mission_of(self, sysid: int) -> tuple[MissionItem, ...]:
        """Return the vehicle's mission, read without the lossy wire."""
        encoder = Encoder(254, 190)
        request = mavlink.MAVLink_mission_request_list_message(sysid, 1)
        (count,) = self._request(encoder.pack(request, 0), "MISSION_COUNT")
        items = []
        for seq in range(count.count):
            request = mavlink.MAVLink_mission_request_int_message(sysid, 1, seq)
            (item,) = self._request(encoder.pack(request, 0), "MISSION_ITEM_INT")
            items.append(item_of(item))
        return tuple(items)

    def _request(self, data: bytes, message_type: str) -> list[Message]:
        """Return the answers of this type to a request."""
        frames = self.fleet.receive(data, self.now_s(), peer="benchmark")
        messages = [decode(f) for _, answer in frames for f in FrameSplitter().feed(answer)]
        return [m for m in messages if m is not None and m.get_type() == message_type]


@dataclass
class CaseResult:
    """The results of one case, with `count` transfers at once."""

    times_s: list[float] = field(default_factory=list)
    """times of verified transfers"""
    outcomes: Counter[str] = field(default_factory=Counter)
    refusal_reasons: Counter[str] = field(default_factory=Counter)
    """without names and numbers"""
    n_datagrams: int = 0
    n_messages: int = 0
    wall_s: float = 0.0


def make_plan(n_items: int, east_deg: float, spacing_deg: float = 1e-4) -> FlightPlan:
    """Return a plan to the north with about this many mission items, by default 11 m apart."""
    points = tuple(
        Waypoint(HOME[0] + spacing_deg * i, HOME[1] + east_deg, 20.0) for i in range(1, n_items - 2)
    )
    return FlightPlan(20.0, points, points[-1])


def make_changed_plan(n_items: int, state: VehicleState, ahead_s: float) -> FlightPlan:
    """Return another plan for a vehicle flying north, spliced `ahead_s` ahead of it; 0: without a splice."""
    new = make_plan(n_items, 0.001)
    if not ahead_s or state.lat_deg is None:
        return new
    splice = Waypoint(state.lat_deg + state.ground_speed_m_s * ahead_s / M_PER_DEG, HOME[1], 20.0)
    track = tuple(replace(p, lat_deg=p.lat_deg + splice.lat_deg - HOME[0]) for p in new.track[:-1])
    return replace(new, track=(splice, *track), landing=(track or (splice,))[-1], leaves_ahead=True)


class Case(NamedTuple):
    """One row of a table."""

    link: str
    personality: str
    n_vehicles: int
    """vehicles at once"""
    n_items: int
    loss: float
    delay_s: float
    swap: bool
    ahead_s: float


async def run_case(case: Case) -> CaseResult:
    """Upload or swap the missions of all vehicles of a case at once."""
    fleet, result = LossyFleet(case.personality, case.n_vehicles), CaseResult()
    flying = asyncio.create_task(fleet.fly())
    async with FrontEnd(wall_time_us=lambda: 0, memory={"fleet": fleet.wire}) as front_end:
        links = open_links(case.link, front_end, Endpoint("memory", "fleet"), case.n_vehicles)
        await asyncio.gather(*(prepare(link, case.swap) for link in links))
        fleet.loss, fleet.delay_s, fleet.n_datagrams, fleet.n_messages = case.loss, case.delay_s, 0, 0
        began_s = time.perf_counter()
        await asyncio.gather(*(transfer(link, case, result) for link in links))
        result.wall_s = time.perf_counter() - began_s
        result.n_datagrams, result.n_messages = fleet.n_datagrams, fleet.n_messages
        for sysid, link in enumerate(links, 1):
            reported = link.items()
            if reported and DIALECTS[case.personality].differences(reported, fleet.mission_of(sysid)):
                result.outcomes["WRONG"] += 1
    flying.cancel()
    return result


def open_links(name: str, front_end: FrontEnd, endpoint: Endpoint, count: int) -> list[DirectLink]:
    """Return the links of vehicles 1 to `count`."""
    return [
        LINKS[name].open(front_end, endpoint, i, name=f"v{i}", on_event=lambda _event: None)
        for i in range(1, count + 1)
    ]


async def prepare(link: DirectLink, swap: bool) -> None:
    """Connect to the vehicle and, before a swap, bring it into flight."""
    await link.connect(20)
    await link.prepare(60, lambda _reasons: None)
    if swap:
        # The mission lasts longer than the slowest swap.
        await upload_with_retries(link, make_plan(60, 0.0, 1e-3))
        await link.launch()
        while (link.state().mission_seq or 0) < 3:  # noqa: ASYNC110 - no event
            await asyncio.sleep(0.2)


async def upload_with_retries(link: DirectLink, old: FlightPlan, n_attempts: int = 4) -> None:
    """Upload a plan; on a busy machine, some uploads of fifty at once by MAVSDK fail."""
    try:
        await link.upload(old)
    except UploadFailed:
        if n_attempts == 1:
            raise
        await upload_with_retries(link, old, n_attempts - 1)


async def transfer(link: DirectLink, case: Case, result: CaseResult) -> None:
    """Upload or swap, and add the time and outcome to `result`."""
    new = make_changed_plan(case.n_items, link.state(), case.ahead_s if case.swap else 0.0)
    limit_s = LIMIT_S[case.link]
    began_s, failure, is_late = asyncio.get_running_loop().time(), None, False
    try:
        async with asyncio.timeout(limit_s):
            if case.swap:
                done = await link.swap(new)
                failure, is_late = done.failure, done.is_late
            else:
                await link.upload(new)
    except LinkError as refused:
        failure = str(refused).split("): ", 1)[-1]
    except TimeoutError:
        result.outcomes[f"not in {limit_s:.0f} s"] += 1
        return
    if failure is not None:
        result.outcomes["late" if is_late else "refused"] += 1
        result.refusal_reasons[re.sub(r"\d+", "N", failure)] += 1
    else:
        result.outcomes["verified"] += 1
        result.times_s.append(asyncio.get_running_loop().time() - began_s)


def transfer_tables(options: argparse.Namespace, *, swap: bool) -> Iterator[Table]:
    """Measure the uploads, or the swaps, of all options cases."""
    kind = "Verified swap in flight" if swap else "Verified upload"
    for personality in ("ardupilot", "px4"):
        table = make_table(
            f"{kind}, {personality}",
            *("link", "vehicles", "items", "loss [%]", "delay [s]", "p50 [s]", "max [s]", "datagrams each"),
            *("messages each", "wall time [s]", "outcomes"),
            left=["link", "outcomes"],
        )
        cases = itertools.product(options.vehicles, options.items, options.losses, options.delays)
        refusal_reasons = Counter[str]()
        for count, n_items, loss, delay_s in cases:
            for name in options.links:
                is_slow = name == "mavsdk" and (swap or count > 1) and n_items > 10
                if options.quick and (is_slow or n_items == 200 or loss == 0.05):
                    continue
                run = run_virtual if name == "direct" else asyncio.run
                case = Case(name, personality, count, n_items, loss, delay_s, swap, options.ahead_s)
                result = run(run_case(case))
                refusal_reasons += result.refusal_reasons
                p50, maximum = np.quantile(result.times_s, [0.5, 1.0]) if result.times_s else (np.nan, np.nan)
                row = (
                    name, str(count), str(n_items), f"{100 * loss:.0f}", f"{delay_s:g}", f"{p50:.2f}",
                    f"{maximum:.2f}", f"{result.n_datagrams / count:,.0f}",
                    f"{result.n_messages / count:,.0f}", f"{result.wall_s:.1f}",
                    ", ".join(f"{n} {outcome}" for outcome, n in result.outcomes.items()),
                )  # fmt: skip
                table.add_row(*row)
                # An interrupted run keeps the rows so far.
                print(f"{kind}, {personality}:", *row, file=sys.stderr, flush=True)
        refusals = [f"{n} refused: {reason}" for reason, n in refusal_reasons.most_common(6)]
        table.caption = "\n".join((describe_load(), *refusals))
        yield table


def cpu(options: argparse.Namespace) -> Iterator[Table]:
    """Measure the load of the ground station in real time over UDP; the fleet is another process."""
    table = make_table(
        "Load of the ground station",
        *("link", "vehicles", "messages/s", "CPU [% of a core]", "memory so far, max [MB]"),
        left=["link"],
    )
    for count, name in itertools.product((1, 50, 250), options.links):
        table.add_row(
            name, str(count), *asyncio.run(station_load(name, count, 5.0 if options.quick else MEASURE_S))
        )
    table.caption = describe_load()
    yield table


async def station_load(name: str, count: int, measure_s: float) -> tuple[str, str, str]:
    """Return messages a second, CPU load [%] and the greatest memory of this process so far [MB]."""
    endpoint = parse_url(f"udpin://127.0.0.1:{20_000 + os.getpid() % 10_000}")
    command = [sys.executable, "-m", "sim_vehicle", "--count", str(count), "--ready-s", "0", "--no-table",
               "--url", f"udpout:127.0.0.1:{endpoint.port}"]  # fmt: skip
    n_received = 0
    async with FrontEnd(wall_time_us=lambda: 0) as front_end:
        await front_end.open(endpoint)
        process = subprocess.Popen(  # noqa: ASYNC220 - before anything is measured
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            links = open_links(name, front_end, endpoint, count)
            await asyncio.gather(*(link.connect(60) for link in links))
            await asyncio.gather(*(link.prepare(60, lambda _reasons: None) for link in links))
            for link in links:
                request_streams(link)
                await asyncio.sleep(0.002)
            await asyncio.sleep(SETTLE_S)
            protocol = front_end._lines[endpoint].transport
            receive = protocol._receive  # type: ignore[attr-defined]

            def count_and_receive(data: bytes, address: object) -> None:
                nonlocal n_received
                n_received += sum(1 for _ in msgids_in(data))
                receive(data, address)

            protocol._receive = count_and_receive  # type: ignore[attr-defined]
            began_s, used_s = time.perf_counter(), time.process_time()
            await asyncio.sleep(measure_s)
            used = (time.process_time() - used_s) / (time.perf_counter() - began_s)
            rate = n_received / (time.perf_counter() - began_s)
            for link in links:
                link.close()
        finally:
            process.terminate()
            process.wait()
    rss_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return f"{rate:,.0f}", f"{100 * used:.1f}", f"{rss_mb:.0f}"


def msgids_in(data: bytes) -> Iterator[int]:
    """Yield the message ids in a datagram of unsigned MAVLink 2 frames, by their headers."""
    at = 0
    while at + 12 <= len(data):
        yield int.from_bytes(data[at + 7 : at + 10], "little")
        at += 12 + data[at + 1]


def request_streams(link: DirectLink) -> None:
    """Request the messages of RATES_HZ, more than the link needs."""
    channel = link._channel
    assert channel is not None
    channel.send(
        [
            mavlink.MAVLink_command_long_message(channel.sysid, 1, 511, 0, msgid, 1e6 / hz, 0, 0, 0, 0, 0)
            for msgid, hz in RATES_HZ.items()
        ]
    )


PARTS: dict[str, Callable[[argparse.Namespace], Iterator[Table]]] = {
    "uploads": partial(transfer_tables, swap=False),
    "swaps": partial(transfer_tables, swap=True),
    "cpu": cpu,
}


def listed(convert: Callable[[str], object], text: str) -> list[object]:
    return [convert(part) for part in text.split(",")]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="fewer cases; `mavsdk` still takes many minutes")
    for name, convert, default, meaning in (
        ("--only", str, [*PARTS], "parts to run"),
        ("--links", str, ["direct", "mavsdk"], "links to measure"),
        ("--vehicles", int, [1, 50], "vehicles at once"),
        ("--items", int, [10, 50, 200], "items of a mission"),
        ("--losses", float, [0.0, 0.05, 0.2, 0.3], "lost share of datagrams"),
        ("--delays", float, [0.0, 1.0], "delays each way [s]"),
    ):
        text = f"{meaning}, with commas: {','.join(map(str, default))}"
        parser.add_argument(name, type=partial(listed, convert), default=default, metavar="LIST", help=text)
    text = "time to the splice point of a swap [s], default %(default)g; 0: none"
    parser.add_argument("--ahead-s", type=float, default=swap_times.MAX_EXPECTED_S, help=text)
    options = parser.parse_args()
    console = Console(width=130)
    for name in options.only:
        for table in PARTS[name](options):
            console.print(table)


if __name__ == "__main__":
    main()
