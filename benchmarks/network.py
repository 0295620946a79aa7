"""Costs of the swarm's network: latencies, CPU, late joiners, an hour's memory, signatures.

Run: `python benchmarks/network.py [--quick]`; `--only in_process,processes,joiners,hour,signatures` chooses
parts. Times are of this machine at this moment and printed with its load; nothing is asserted. A latency is
the time from an observation until its last recipient has merged it into its belief.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from network_agents import CELLS_SEEN, COLS, DRAIN_S, ERRING, ROWS, SWARM, Agent, Heard, clock, table
from rich.console import Console
from rich.table import Table

from swarmctl.bus.endpoint import parse_endpoint
from swarmctl.bus.network import Network, RunClock
from swarmctl.bus.node.exchange import NodeOptions
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.transports.base import Transport
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.core.frames import Frame, FrameCodec
from swarmctl.core.observation import Observation
from swarmctl.flight.gc_tuning import tune_collector
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.station import router

# --- in one process


def in_one_process(
    n: int, k: int | None, rate_per_s: float, seconds: float, seal: FrameCodec | None = None
) -> list[str]:
    async def run() -> list[str]:
        options = NodeOptions(ROWS, COLS, k=k)
        network = Network(MemoryBus(), SWARM, range(1, n + 1), options, clock=clock(), codec=seal)
        heard = Heard()
        agents = [Agent(network, uav, heard) for uav in range(1, n + 1)]
        begin_s = asyncio.get_running_loop().time() + 1.5
        flights = asyncio.gather(*(agent.fly(rate_per_s, begin_s, seconds) for agent in agents))
        await asyncio.sleep(1.4)
        # As `fly` and `agent` do before they fly.
        tune_collector()
        await asyncio.sleep(begin_s - asyncio.get_running_loop().time())
        cpu_s, wall_s = time.process_time(), time.monotonic()
        await flights
        late_s = time.monotonic() - wall_s - seconds
        cpu_s, wall_s = time.process_time() - cpu_s, time.monotonic() - wall_s
        await asyncio.sleep(DRAIN_S)
        network.close()
        p50, p99, share = heard.figures()
        said = "saturated" if late_s > 0.1 or cpu_s > 0.95 * wall_s else ""
        return [f"{p50:.1f}", f"{p99:.1f}", f"{100 * share:.1f} %", f"{100 * cpu_s / wall_s:.0f} %", said]

    return asyncio.run(run())


IN_PROCESS = ("p50 [ms]", "p99 [ms]", "delivered", "CPU of a core", "")


def in_process(quick: bool) -> Iterator[Table]:
    made = table(
        f"in one process, {ROWS} × {COLS} cells, observations of {CELLS_SEEN}",
        *("agents", "range k", "observations/s each", *IN_PROCESS),
    )
    for n in (10, 100):
        for k in (None, 10, 5) if n > 10 else (None, 5):
            for rate in (1.0, 5.0, 20.0):
                row = in_one_process(n, k, rate, 2.0 if quick else 8.0)
                made.add_row(str(n), "all" if k is None else str(k), f"{rate:g}", *row)
    made.caption = "saturated: it asks for more than one core has, so latencies grow with the time it lasts"
    yield made


# --- a process each, over loopback


async def member(there: str, uav: int, n: int, rate_per_s: float, seconds: float) -> None:
    """Run one agent of many: print that it is ready, read its start time, write its received observations."""
    with ZenohBus(zenoh_config.client(parse_endpoint(there))) as bus:
        transport: Transport = bus
        network = Network(transport, SWARM, range(1, n + 1), NodeOptions(ROWS, COLS), clock=clock())
        heard = Heard()
        agent = Agent(network, uav, heard)
        tune_collector()
        while not bus.connected:  # noqa: ASYNC110 - nobody tells, and it is not measured
            await asyncio.sleep(0.05)
        print("ready", flush=True)
        begin_s = float(await asyncio.to_thread(sys.stdin.readline))
        await asyncio.sleep(begin_s - time.monotonic())
        cpu_s = time.process_time()
        await agent.fly(rate_per_s, begin_s, seconds)
        cpu_s = time.process_time() - cpu_s
        await asyncio.sleep(DRAIN_S)
        network.close()
        sys.stdout.buffer.write(msgspec.msgpack.encode((cpu_s, heard)))
        sys.stdout.buffer.flush()
        os._exit(0)


def own(*arguments: object) -> subprocess.Popen[bytes]:
    """Start this file as another process."""
    command = [sys.executable, __file__, *map(str, arguments)]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)


def cpu_of(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def apart(n: int, rate_per_s: float, seconds: float) -> list[str]:
    station = own("--router", n)
    assert station.stdout is not None
    there = station.stdout.readline().decode().split()[-1]
    members = [own("--member", there, uav, n, rate_per_s, seconds) for uav in range(1, n + 1)]
    try:
        for process in members:
            assert process.stdout is not None
            assert process.stdout.readline() == b"ready\n"
        begin_s = time.monotonic() + 2.0
        for process in members:
            assert process.stdin is not None
            process.stdin.write(f"{begin_s}\n".encode())
            process.stdin.flush()
        time.sleep(max(0.0, begin_s - time.monotonic()))
        router_s = cpu_of(station.pid)
        time.sleep(seconds)
        router_s = cpu_of(station.pid) - router_s
        together, cpu_s = Heard(), 0.0
        for process in members:
            assert process.stdout is not None
            one_s, heard = msgspec.msgpack.decode(process.stdout.read(), type=tuple[float, Heard])
            cpu_s += one_s
            together.said_s |= heard.said_s
            together.recipients |= heard.recipients
            together.merged += heard.merged
    finally:
        for process in (*members, station):
            process.kill()
            process.wait()
    p50, p99, share = together.figures()
    cores = (100 * router_s / seconds, 100 * (router_s + cpu_s) / seconds)
    said = "saturated" if cores[1] > 95.0 * (os.cpu_count() or 1) else ""
    return [
        f"{p50:.1f}",
        f"{p99:.1f}",
        f"{100 * share:.1f} %",
        f"{cores[0]:.0f} %",
        f"{cores[1]:.0f} %",
        said,
    ]


def processes(quick: bool) -> Iterator[Table]:
    made = table(
        f"a process each, over loopback through a router, {os.cpu_count()} cores",
        *(
            "processes",
            "observations/s each",
            "p50 [ms]",
            "p99 [ms]",
            "delivered",
            "CPU of the router",
            "of all",
            "",
        ),
    )
    for n in (10, 20) if quick else (10, 20, 50):
        for rate in (1.0, 20.0):
            made.add_row(str(n), f"{rate:g}", *apart(n, rate, 3.0 if quick else 10.0))
    made.caption = "each tells its state to each once a second as well"
    yield made


# --- who comes late


def joiners(_quick: bool) -> Iterator[Table]:
    side, observers, late = 200, 20, 100
    made = table(
        f"late joiners in one process, {side} × {side} cells all known",
        *("joiners", "until all have it [s]", "CPU of it [s]"),
    )

    async def run() -> tuple[float, float]:
        n = observers + late
        network = Network(MemoryBus(), SWARM, range(1, n + 1), NodeOptions(side, side), clock=clock())
        first = [Agent(network, uav, Heard(), side) for uav in range(1, observers + 1)]
        middles = [(r, c) for r in range(1, side + 1, 3) for c in range(1, side + 1, 3)]
        for i, middle in enumerate(middles):
            first[i % observers].look(middle)
            if i % 200 == 0:
                await asyncio.sleep(0.0)
        for _ in range(5):
            for agent in first:
                agent.tell_state()
            await asyncio.sleep(1.0)
        assert all(agent.belief.n_observed == side * side for agent in first)
        began_s, cpu_s = time.monotonic(), time.process_time()
        joined = [Agent(network, uav, Heard(), side) for uav in range(observers + 1, n + 1)]
        for agent in first:
            agent.tell_state()
        for agent in joined:
            agent.tell_state()
        while any(a.belief.n_observed < side * side for a in joined):  # noqa: ASYNC110 - nobody tells
            await asyncio.sleep(0.0)
        took_s = time.monotonic() - began_s, time.process_time() - cpu_s
        network.close()
        return took_s

    made.add_row(str(late), *(f"{took_s:.2f}" for took_s in asyncio.run(run())))
    made.caption = f"seen by {observers}, who tell their state at the moment of the joining"
    yield made


# --- an hour


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


async def fly_an_hour(n: int, minutes: Sequence[int]) -> None:
    options = NodeOptions(ROWS, COLS, perfect_sensors=False)
    network = Network(MemoryBus(), SWARM, range(1, n + 1), options, clock=RunClock(1.8e9))
    agents = [Agent(network, uav, Heard(), ROWS, ERRING) for uav in range(1, n + 1)]
    tune_collector()
    for second in range(60 * minutes[-1]):
        for agent in agents:
            agent.look()
            agent.tell_state()
            agent.heard = Heard()
        await asyncio.sleep(1.0)
        if (second + 1) % 60 == 0 and (second + 1) // 60 in minutes:
            held = max(sum(1 for _ in agent.belief.items()) for agent in agents)
            looks = int(agents[0].belief.looks.sum())
            print((second + 1) // 60, looks, held, f"{resident_mb():.1f}", flush=True)
    network.close()


def hour(quick: bool) -> Iterator[Table]:
    minutes = (2, 5, 10) if quick else (10, 30, 60)
    made = table(
        f"10 agents, an observation a second each, sensors that err, {ROWS} × {COLS} cells, virtual clock",
        *("minutes", "looks at cells", "most items one holds", "resident [MB]"),
    )
    process = own("--hour", *minutes)
    for line in process.communicate()[0].decode().splitlines():
        made.add_row(*line.split())
    yield made


# --- signatures


def signatures(quick: bool) -> Iterator[Table]:
    keys = {uav: Ed25519PrivateKey.generate() for uav in range(1, 11)}
    public = {uav: key.public_key() for uav, key in keys.items()}

    def verify(sender: int, signature: bytes, data: bytes) -> bool:
        try:
            public[sender].verify(signature, data)
        except InvalidSignature:
            return False
        return True

    signed, plain = FrameCodec(SWARM, lambda sender, data: keys[sender].sign(data), verify), FrameCodec(SWARM)
    cells = tuple((50 + i, 50 + j, False) for i in range(3) for j in range(3))
    frame = Frame(1, 1, 1, 1.8e9, Observation(1, 1, 0.0, cells, 1), 46.0, 14.0)
    made = table("a frame of one observation, one core", "", "bytes", "close [µs]", "open [µs]")
    for name, seal in (("without signature", plain), ("Ed25519", signed)):
        data = seal.encode(frame)
        costs = (
            per_call_us(lambda seal=seal: seal.encode(frame)),
            per_call_us(lambda seal=seal, data=data: seal.decode(data)),
        )
        made.add_row(name, str(len(data)), *(f"{cost:.0f}" for cost in costs))
    yield made
    made = table("10 agents in one process that sign and verify", "observations/s each", *IN_PROCESS)
    for rate in (1.0, 5.0, 20.0):
        made.add_row(f"{rate:g}", *in_one_process(10, None, rate, 2.0 if quick else 8.0, signed))
    made.caption = "a frame is verified once in a process, however many agents of it hear it"
    yield made


def per_call_us(call: object) -> float:
    """Return the CPU time of a call, the least of five averages over a hundred calls."""
    assert callable(call)
    taken_s = []
    for _ in range(5):
        began_s = time.process_time()
        for _ in range(100):
            call()
        taken_s.append(time.process_time() - began_s)
    return min(taken_s) * 1e4


PARTS = {part.__name__: part for part in (in_process, processes, joiners, hour, signatures)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer and shorter cases")
    parser.add_argument("--only", default=",".join(PARTS), help="which parts, with commas")
    for hidden, n in (("--router", 1), ("--member", 5), ("--hour", 3)):
        parser.add_argument(hidden, nargs=n, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.router:
        uavs = range(1, int(chosen.router[0]) + 1)
        configuration = zenoh_config.router(parse_endpoint("tcp/127.0.0.1:0"), SWARM, uavs)
        asyncio.run(router.run(configuration, lambda text: print(text, flush=True)))
    elif chosen.member:
        there, uav, n, rate, seconds = chosen.member
        asyncio.run(member(there, int(uav), int(n), float(rate), float(seconds)))
    elif chosen.hour:
        run_virtual(fly_an_hour(10, [int(minute) for minute in chosen.hour]))
    else:
        console = Console()
        for name in chosen.only.split(","):
            for made in PARTS[name](chosen.quick):
                console.print(made)


if __name__ == "__main__":
    main()
