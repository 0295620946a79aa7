"""Costs of the links `direct` and `mavsdk`: uploads and swaps over bad radio, and CPU.

Run: `pip install -e .`, then `python benchmarks/links.py [--quick]`. Options choose the rows:
`--only uploads,swaps,cpu`, `--links direct,mavsdk`, `--vehicles 1,50`, `--items 10,50,200`, `--losses 0,0.3`,
`--delays 0,1`. Nothing is asserted; the load of the machine is printed.

- `direct` flies on the virtual clock: its times are vehicle seconds, beside wall seconds.
- `mavsdk` needs the machine's clock: all of its rows take hours.
- Datagrams are lost and delayed one by one in both directions and include streams; messages are those of
  missions.
- A mission is wrong if the link reports it as verified and the vehicle, read without loss afterwards, has
  another one. Roundings of its autopilot do not count.
- A swap's plan leaves the old one ahead of the vehicle, as in flight, by default as far as an agent's longest
  splice (`--ahead-s`). A vehicle that has passed this point before the swap is late. 0: a plan from anywhere.
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
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rich import box
from rich.console import Console
from rich.table import Table

from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import default_scenario
from swarmctl.agent.replan import swap_times
from swarmctl.core.mission import FlightPlan, MissionItem, Waypoint
from swarmctl.core.vehicle import VehicleState
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.links import LINKS
from swarmctl.links.base import Link, LinkError, SwapFailed, UploadFailed
from swarmctl.links.frontend import FrontEnd
from swarmctl.links.transports.memory import MemoryWire
from swarmctl.links.url import Endpoint, parse_url
from swarmctl.mavlink.dialects import dialect_for
from swarmctl.mavlink.protocol.codec import Decoder, Encoder, FrameSplitter, Message
from swarmctl.mavlink.protocol.mission_download import item_of

HOME = (46.0490, 14.5060, 300.0)
M_PER_DEG = 111_195.0
"""of latitude"""
STEP_S = 0.05
RATES_HZ = {33: 5, 30: 5, 74: 4, 1: 2, 24: 1, 147: 1, 42: 1}
"""message id -> rate: 19 a second beside the heartbeat"""
VEHICLES, ITEMS, LOSSES, DELAYS_S = (1, 50), (10, 50, 200), (0.0, 0.05, 0.2, 0.3), (0.0, 1.0)
LIMIT_S = {"direct": 3600.0, "mavsdk": 240.0}
AHEAD_S = swap_times.MAX_EXPECTED_S
SETTLE_S, MEASURE_S = 8.0, 15.0
MISSION_MESSAGES = frozenset({37, 38, 39, 40, 41, 43, 44, 45, 47, 51, 73})
"""ids of transfer messages, and of MISSION_SET_CURRENT"""
DIALECTS = {
    "ardupilot": dialect_for(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_TYPE_QUADROTOR),
    "px4": dialect_for(mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_TYPE_QUADROTOR),
}
BEFORE_TRIES = 4
"""number of items on a vehicle before a swap, uploaded without loss"""
MOST_SAID = 6
"""reasons of refusals"""


class Radio:
    """A fleet behind a wire that loses and delays each datagram independently."""

    def __init__(self, personality: str, count: int, seed: int = 1) -> None:
        self.fleet = Fleet(default_scenario(count, home=HOME, personality=personality), ready_s=0)
        self.wire = MemoryWire()
        self.wire.to_vehicles = self._up
        self.loss, self.delay_s, self.datagrams, self.messages = 0.0, 0.0, 0, 0
        self._rng = random.Random(seed)
        self._loop = asyncio.get_running_loop()
        self._began_s = self._arrives_s = self._loop.time()

    def now_s(self) -> float:
        return self._loop.time() - self._began_s

    def _carry(self, call: object, data: bytes, *args: object) -> None:
        assert callable(call)
        self.datagrams += 1
        self.messages += sum(msgid in MISSION_MESSAGES for msgid in msgids_in(data))
        if self._rng.random() >= self.loss:
            # One after the other: timers of one moment are called in any order.
            after = math.nextafter(self._arrives_s, math.inf)
            self._arrives_s = max(self._loop.time() + self.delay_s, after)
            self._loop.call_at(self._arrives_s, call, data, *args)

    def _up(self, data: bytes, address: object) -> None:
        self._carry(self._hear, data)

    def _hear(self, data: bytes) -> None:
        self._down(self.fleet.receive(data, self.now_s()))

    def _down(self, frames: list[tuple[int, bytes]]) -> None:
        for _, data in frames:
            self._carry(self.wire.from_vehicle, data, "fleet")

    async def fly(self) -> None:
        while True:
            self._down(self.fleet.step(self.now_s()))
            await asyncio.sleep(STEP_S)

    def mission_of(self, sysid: int) -> tuple[MissionItem, ...]:
        """Return the vehicle's mission, read without the lossy wire."""
        encoder = Encoder(254, 190)
        ask = mavlink.MAVLink_mission_request_list_message(sysid, 1)
        (count,) = self._asked(encoder.pack(ask, 0), "MISSION_COUNT")
        found = []
        for seq in range(count.count):
            ask = mavlink.MAVLink_mission_request_int_message(sysid, 1, seq)
            (item,) = self._asked(encoder.pack(ask, 0), "MISSION_ITEM_INT")
            found.append(item_of(item))
        return tuple(found)

    def _asked(self, data: bytes, kind: str) -> list[Message]:
        decoder = Decoder()
        frames = self.fleet.receive(data, self.now_s(), peer="judge")
        messages = [decoder.decode(f) for _, answer in frames for f in FrameSplitter().feed(answer)]
        return [m for m in messages if m is not None and m.get_type() == kind]


@dataclass
class Outcome:
    """The results of one case."""

    times_s: list[float] = field(default_factory=list)
    endings: Counter[str] = field(default_factory=Counter)
    why: Counter[str] = field(default_factory=Counter)
    """reasons of refusals, without names and numbers"""
    datagrams: int = 0
    messages: int = 0
    wall_s: float = 0.0


def plan(items: int, east_deg: float, apart_deg: float = 1e-4) -> FlightPlan:
    """Return a mission of about this many items, eleven metres apart."""
    points = tuple(Waypoint(HOME[0] + apart_deg * i, HOME[1] + east_deg, 20.0) for i in range(1, items - 2))
    return FlightPlan(20.0, points, points[-1])


def change(items: int, state: VehicleState, ahead_s: float) -> FlightPlan:
    """Return another mission for a vehicle flying north, which leaves its track `ahead_s` ahead of it."""
    new = plan(items, 0.001)
    if not ahead_s or state.lat_deg is None:
        return new
    leaves = Waypoint(state.lat_deg + state.ground_speed_m_s * ahead_s / M_PER_DEG, HOME[1], 20.0)
    track = tuple(replace(p, lat_deg=p.lat_deg + leaves.lat_deg - HOME[0]) for p in new.track[:-1])
    return replace(new, track=(leaves, *track), landing=(track or (leaves,))[-1], leaves_ahead=True)


async def case(
    name: str,
    personality: str,
    count: int,
    items: int,
    loss: float,
    delay_s: float,
    *,
    swap: bool,
    ahead_s: float,
) -> Outcome:
    radio, outcome = Radio(personality, count), Outcome()
    flying = asyncio.create_task(radio.fly())
    async with FrontEnd(wall_time_us=lambda: 0, memory={"fleet": radio.wire}) as front_end:
        links = {
            i: LINKS[name](
                front_end, Endpoint("memory", "fleet"), i, name=f"v{i}", on_event=lambda _event: None
            )
            for i in range(1, count + 1)
        }
        await asyncio.gather(*(ready(link, swap) for link in links.values()))
        radio.loss, radio.delay_s, radio.datagrams, radio.messages = loss, delay_s, 0, 0
        began_s = time.perf_counter()
        await asyncio.gather(
            *(
                transfer(
                    link,
                    change(items, link.state(), ahead_s if swap else 0.0),
                    outcome,
                    LIMIT_S[name],
                    swap=swap,
                )
                for link in links.values()
            )
        )
        outcome.wall_s = time.perf_counter() - began_s
        outcome.datagrams, outcome.messages = radio.datagrams, radio.messages
        for sysid, link in links.items():
            claimed = link.items()
            if claimed and DIALECTS[personality].differences(claimed, radio.mission_of(sysid)):
                outcome.endings["WRONG"] += 1
    flying.cancel()
    return outcome


async def ready(link: Link, swap: bool) -> None:
    await link.connect(20)
    await link.prepare(60, lambda _reasons: None)
    if swap:
        # So long that it does not end before the slowest swap does.
        await uploaded(link, plan(60, 0.0, 1e-3))
        await link.launch()
        while (link.state().mission_seq or 0) < 3:  # noqa: ASYNC110 - nobody tells of it
            await asyncio.sleep(0.2)


async def uploaded(link: Link, old: FlightPlan) -> None:
    """Upload with retries: on a busy machine fifty vehicles at once are sometimes too many for MAVSDK."""
    for _ in range(BEFORE_TRIES):
        try:
            await link.upload(old)
        except UploadFailed as refused:
            failure = refused
        else:
            return
    raise failure


async def transfer(link: Link, new: FlightPlan, outcome: Outcome, limit_s: float, *, swap: bool) -> None:
    began_s = asyncio.get_running_loop().time()
    try:
        async with asyncio.timeout(limit_s):
            await (link.swap(new) if swap else link.upload(new))
    except LinkError as refused:
        is_late = isinstance(refused, SwapFailed) and refused.is_late
        outcome.endings["late" if is_late else "refused"] += 1
        outcome.why[re.sub(r"\d+", "N", str(refused).split("): ", 1)[-1])] += 1
    except TimeoutError:
        outcome.endings[f"not in {limit_s:.0f} s"] += 1
    else:
        outcome.endings["verified"] += 1
        outcome.times_s.append(asyncio.get_running_loop().time() - began_s)


def transfers(chosen: argparse.Namespace, *, swap: bool) -> Iterator[Table]:
    what = "verified swap in flight" if swap else "verified upload"
    for personality in ("ardupilot", "px4"):
        made = table(f"{what}, {personality}", "link", "vehicles", "items", "loss [%]", "delay [s]",
                     "p50 [s]", "last [s]", "datagrams each", "messages each", "wall [s]",
                     "outcome")  # fmt: skip
        cases = itertools.product(chosen.vehicles, chosen.items, chosen.losses, chosen.delays)
        why = Counter[str]()
        for count, items, loss, delay_s in cases:
            for name in chosen.links:
                seldom = name == "mavsdk" and (swap or count > 1) and items > 10
                if chosen.quick and (seldom or items == 200 or loss == 0.05):
                    continue
                run = run_virtual if name == "direct" else asyncio.run
                story = case(
                    name, personality, count, items, loss, delay_s, swap=swap, ahead_s=chosen.ahead_s
                )
                done = run(story)
                why += done.why
                p50, last = np.quantile(done.times_s, [0.5, 1.0]) if done.times_s else (np.nan, np.nan)
                row = (
                    name, str(count), str(items), f"{100 * loss:.0f}", f"{delay_s:g}", f"{p50:.2f}",
                    f"{last:.2f}", f"{done.datagrams / count:,.0f}", f"{done.messages / count:,.0f}",
                    f"{done.wall_s:.1f}",
                    ", ".join(f"{n} {how}" for how, n in done.endings.items()),
                )  # fmt: skip
                made.add_row(*row)
                # Who has not the hours for all of it keeps what there is.
                print(f"{what}, {personality}:", *row, file=sys.stderr, flush=True)
        said = [f"{n} refused: {text}" for text, n in why.most_common(MOST_SAID)]
        made.caption = "\n".join((load(), *said))
        yield made


def uploads(chosen: argparse.Namespace) -> Iterator[Table]:
    yield from transfers(chosen, swap=False)


def swaps(chosen: argparse.Namespace) -> Iterator[Table]:
    yield from transfers(chosen, swap=True)


def cpu(chosen: argparse.Namespace) -> Iterator[Table]:
    """Measure in real time over UDP: the fleet is a process of its own, the ground station this one."""
    made = table("the ground station's CPU, one core is 100 %", "link", "vehicles", "msg/s", "CPU [%]",
                 "most RSS so far [MB]")  # fmt: skip
    for count, name in itertools.product((1, 50, 250), chosen.links):
        made.add_row(name, str(count), *asyncio.run(ground(name, count, 5.0 if chosen.quick else MEASURE_S)))
    made.caption = load()
    yield made


async def ground(name: str, count: int, measure_s: float) -> tuple[str, str, str]:
    endpoint = parse_url(f"udpin://127.0.0.1:{20_000 + os.getpid() % 10_000}")
    command = [sys.executable, "-m", "sim_vehicle", "--count", str(count), "--ready-s", "0", "--no-table",
               "--url", f"udpout:127.0.0.1:{endpoint.port}"]  # fmt: skip
    heard = 0

    def count_in(splitter_feed: object) -> object:
        def feed(data: bytes, address: object) -> None:
            nonlocal heard
            heard += sum(1 for _ in msgids_in(data))
            splitter_feed(data, address)  # type: ignore[operator]

        return feed

    async with FrontEnd(wall_time_us=lambda: 0) as front_end:
        await front_end.open(endpoint)
        process = subprocess.Popen(  # noqa: ASYNC220 - before anything is measured
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            links = [
                LINKS[name](front_end, endpoint, i, name=f"v{i}", on_event=lambda _event: None)
                for i in range(1, count + 1)
            ]
            await asyncio.gather(*(link.connect(60) for link in links))
            await asyncio.gather(*(link.prepare(60, lambda _reasons: None) for link in links))
            for link in links:
                ask_for_streams(link)
                await asyncio.sleep(0.002)
            await asyncio.sleep(SETTLE_S)
            line = front_end._lines[endpoint]
            protocol = line.transport
            protocol._receive = count_in(protocol._receive)  # type: ignore[attr-defined]
            began_s, used_s = time.perf_counter(), time.process_time()
            await asyncio.sleep(measure_s)
            used = (time.process_time() - used_s) / (time.perf_counter() - began_s)
            rate = heard / (time.perf_counter() - began_s)
            for link in links:
                link.close()
        finally:
            process.terminate()
            process.wait()
    rss_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return f"{rate:,.0f}", f"{100 * used:.1f}", f"{rss_mb:.0f}"


def msgids_in(data: bytes) -> Iterator[int]:
    """Count unsigned MAVLink 2 frames by their headers; the fleet puts several into a datagram."""
    at = 0
    while at + 12 <= len(data):
        yield int.from_bytes(data[at + 7 : at + 10], "little")
        at += 12 + data[at + 1]


def ask_for_streams(link: Link) -> None:
    """Request more messages than the link needs."""
    channel = link._channel  # type: ignore[attr-defined]
    channel.send(
        [
            mavlink.MAVLink_command_long_message(channel.sysid, 1, 511, 0, msgid, 1e6 / hz, 0, 0, 0, 0, 0)
            for msgid, hz in RATES_HZ.items()
        ]
    )


def table(title: str, *columns: str) -> Table:
    made = Table(title=title, box=box.SIMPLE_HEAD)
    for column in columns:
        made.add_column(
            column.replace("[", "\\["), justify="left" if column in ("link", "outcome") else "right"
        )
    return made


def load() -> str:
    return f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"


PARTS = {part.__name__: part for part in (uploads, swaps, cpu)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer and shorter cases")
    parser.add_argument("--only", type=names, default=[*PARTS], help="which parts, with commas")
    parser.add_argument("--links", type=names, default=["direct", "mavsdk"], help="which links, with commas")
    parser.add_argument("--vehicles", type=numbers, default=VEHICLES, help="of a transfer, with commas")
    parser.add_argument("--items", type=numbers, default=ITEMS, help="of a transfer, with commas")
    parser.add_argument("--losses", type=shares, default=LOSSES, help="of datagrams, with commas")
    parser.add_argument("--delays", type=shares, default=DELAYS_S, help="each way [s], with commas")
    parser.add_argument(
        "--ahead-s",
        type=float,
        default=AHEAD_S,
        help="so far ahead a swap's plan leaves the old one; 0: nowhere",
    )
    chosen = parser.parse_args()
    console = Console(width=130)
    for name in chosen.only:
        for made in PARTS[name](chosen):
            console.print(made)


def names(text: str) -> list[str]:
    return text.split(",")


def shares(text: str) -> list[float]:
    return [float(number) for number in names(text)]


def numbers(text: str) -> list[int]:
    return [int(number) for number in names(text)]


if __name__ == "__main__":
    main()
