"""Costs of the swarm's network: latencies, CPU, late joiners, memory in an hour, signatures.

Times are of this machine at this moment, and are printed with its load; nothing is asserted. A latency is
the time from an observation until its last recipient has merged it into its belief. In one process, time is
the CPU time of the process and the time in which it waits: latencies as on a core of its own.
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
from network_agents import (
    CELLS_PER_OBSERVATION,
    COLS,
    DRAIN_S,
    IMPERFECT,
    ROWS,
    SWARM,
    Agent,
    DeliveryLog,
    make_clock,
    run_on_idle_core,
)
from rich.console import Console
from rich.table import Table
from tables import describe_load, make_table

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


def titled(title: str, *columns: str) -> Table:
    """Return an empty table; its title ends with the machine's load at the start."""
    return make_table(f"{title}\n{describe_load()}", *columns)


# --- in one process


def in_one_process(
    n: int, k: int | None, rate_per_s: float, duration_s: float, codec: FrameCodec | None = None
) -> list[str]:
    """Return the cells of `IN_PROCESS` for `n` agents with communication range `k`."""

    async def run() -> list[str]:
        options = NodeOptions(ROWS, COLS, k=k)
        network = Network(MemoryBus(), SWARM, range(1, n + 1), options, clock=make_clock(), codec=codec)
        log = DeliveryLog()
        agents = [Agent(network, uav, log) for uav in range(1, n + 1)]
        begin_s = asyncio.get_running_loop().time() + 1.5
        flights = asyncio.gather(*(agent.fly(rate_per_s, begin_s, duration_s) for agent in agents))
        await asyncio.sleep(1.4)
        # The commands `fly` and `agent` tune the collector too.
        tune_collector()
        await asyncio.sleep(begin_s - asyncio.get_running_loop().time())
        loop = asyncio.get_running_loop()
        cpu_s, began_s = time.process_time(), loop.time()
        await flights
        cpu_s, elapsed_s = time.process_time() - cpu_s, loop.time() - began_s
        await asyncio.sleep(DRAIN_S)
        network.close()
        p50, p99, share = log.statistics()
        remark = "saturated" if elapsed_s > duration_s + 0.1 or cpu_s > 0.95 * elapsed_s else ""
        return [
            f"{p50:.1f}",
            f"{p99:.1f}",
            f"{100 * share:.1f} %",
            f"{100 * cpu_s / elapsed_s:.0f} %",
            remark,
        ]

    return run_on_idle_core(run())


IN_PROCESS = ("p50 [ms]", "p99 [ms]", "delivered", "CPU [% of a core]", "")


def in_process(quick: bool) -> Iterator[Table]:
    table = titled(
        f"Agents in one process, {ROWS} × {COLS} cells, {CELLS_PER_OBSERVATION} cells an observation",
        *("agents", "range k", "observations/s each", *IN_PROCESS),
    )
    for n in (10, 100):
        for k in (None, 10, 5) if n > 10 else (None, 5):
            for rate in (1.0, 5.0, 20.0):
                row = in_one_process(n, k, rate, 2.0 if quick else 8.0)
                table.add_row(str(n), "all" if k is None else str(k), f"{rate:g}", *row)
    table.caption = "saturated: the load exceeds one core, so latencies grow with the duration"
    yield table


# --- one process for each agent, over loopback


async def run_member(router_url: str, uav: int, n: int, rate_per_s: float, duration_s: float) -> None:
    """Run one of `n` agents: print `ready`, read the start time, write the CPU time and delivery log."""
    with ZenohBus(zenoh_config.client(parse_endpoint(router_url))) as bus:
        transport: Transport = bus
        network = Network(transport, SWARM, range(1, n + 1), NodeOptions(ROWS, COLS), clock=make_clock())
        log = DeliveryLog()
        agent = Agent(network, uav, log)
        tune_collector()
        while not bus.connected:  # noqa: ASYNC110 - no event, and not measured
            await asyncio.sleep(0.05)
        print("ready", flush=True)
        begin_s = float(await asyncio.to_thread(sys.stdin.readline))
        await asyncio.sleep(begin_s - time.monotonic())
        cpu_s = time.process_time()
        await agent.fly(rate_per_s, begin_s, duration_s)
        cpu_s = time.process_time() - cpu_s
        await asyncio.sleep(DRAIN_S)
        network.close()
        sys.stdout.buffer.write(msgspec.msgpack.encode((cpu_s, log)))
        sys.stdout.buffer.flush()
        os._exit(0)


def start_self(*arguments: object) -> subprocess.Popen[bytes]:
    """Start this script as another process."""
    command = [sys.executable, __file__, *map(str, arguments)]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)


def cpu_time_s(pid: int) -> float:
    """Return the CPU time that a process has used, user and system [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def in_processes(n: int, rate_per_s: float, duration_s: float) -> list[str]:
    """Return the results of `n` agents in a process each: latencies, delivered share, CPU, remark."""
    router_process = start_self("--router", n)
    assert router_process.stdout is not None
    router_url = router_process.stdout.readline().decode().split()[-1]
    members = [start_self("--member", router_url, uav, n, rate_per_s, duration_s) for uav in range(1, n + 1)]
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
        router_s = cpu_time_s(router_process.pid)
        time.sleep(duration_s)
        router_s = cpu_time_s(router_process.pid) - router_s
        all_logs, cpu_s = DeliveryLog(), 0.0
        for process in members:
            assert process.stdout is not None
            member_s, log = msgspec.msgpack.decode(process.stdout.read(), type=tuple[float, DeliveryLog])
            cpu_s += member_s
            all_logs.published_s |= log.published_s
            all_logs.n_recipients |= log.n_recipients
            all_logs.merged += log.merged
    finally:
        for process in (*members, router_process):
            process.kill()
            process.wait()
    p50, p99, share = all_logs.statistics()
    router_percent, all_percent = 100 * router_s / duration_s, 100 * (router_s + cpu_s) / duration_s
    remark = "saturated" if all_percent > 95.0 * (os.cpu_count() or 1) else ""
    return [
        f"{p50:.1f}",
        f"{p99:.1f}",
        f"{100 * share:.1f} %",
        f"{router_percent:.0f} %",
        f"{all_percent:.0f} %",
        remark,
    ]


def processes(quick: bool) -> Iterator[Table]:
    table = titled(
        "One process for each agent, over loopback through a router",
        *("agents", "observations/s each", "p50 [ms]", "p99 [ms]", "delivered"),
        *("CPU of the router [% of a core]", "CPU of all [% of a core]", ""),
    )
    for n in (10, 20) if quick else (10, 20, 50):
        for rate in (1.0, 20.0):
            table.add_row(str(n), f"{rate:g}", *in_processes(n, rate, 3.0 if quick else 10.0))
    table.caption = "Each agent also sends its state to every other once a second."
    yield table


# --- late joiners


def joiners(_quick: bool) -> Iterator[Table]:
    side, n_observers, n_joiners = 200, 20, 100
    table = titled(
        f"Late joiners in one process, all of {side} × {side} cells observed",
        *("joiners", "until all have the snapshot [s]", "CPU time [s]"),
    )

    async def run() -> tuple[float, float]:
        n = n_observers + n_joiners
        network = Network(MemoryBus(), SWARM, range(1, n + 1), NodeOptions(side, side), clock=make_clock())
        observers = [Agent(network, uav, DeliveryLog(), side) for uav in range(1, n_observers + 1)]
        middles = [(r, c) for r in range(1, side + 1, 3) for c in range(1, side + 1, 3)]
        for i, middle in enumerate(middles):
            observers[i % n_observers].observe(middle)
            if i % 200 == 0:
                await asyncio.sleep(0.0)
        while any(agent.belief.n_observed < side * side for agent in observers):
            for agent in observers:
                agent.publish_state()
            await asyncio.sleep(1.0)
        loop = asyncio.get_running_loop()
        began_s, cpu_s = loop.time(), time.process_time()
        joiners = [Agent(network, uav, DeliveryLog(), side) for uav in range(n_observers + 1, n + 1)]
        for agent in (*observers, *joiners):
            agent.publish_state()
        while any(a.belief.n_observed < side * side for a in joiners):  # noqa: ASYNC110 - no event
            await asyncio.sleep(0.0)
        times_s = loop.time() - began_s, time.process_time() - cpu_s
        network.close()
        return times_s

    table.add_row(str(n_joiners), *(f"{time_s:.2f}" for time_s in run_on_idle_core(run())))
    table.caption = f"{n_observers} agents observed the cells, and send their state when the others join."
    yield table


# --- memory in an hour


def resident_mb() -> float:
    """Return the resident memory of this process [MB of 2^20 bytes]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


async def fly_an_hour(n: int, minutes: Sequence[int]) -> None:
    """Print minutes, looks at cells, most items stored by one agent and memory, after each of `minutes`."""
    options = NodeOptions(ROWS, COLS, perfect_sensors=False)
    network = Network(MemoryBus(), SWARM, range(1, n + 1), options, clock=RunClock(1.8e9))
    agents = [Agent(network, uav, DeliveryLog(), ROWS, IMPERFECT) for uav in range(1, n + 1)]
    tune_collector()
    for second in range(60 * minutes[-1]):
        for agent in agents:
            agent.observe()
            agent.publish_state()
            agent.log = DeliveryLog()
        await asyncio.sleep(1.0)
        if (second + 1) % 60 == 0 and (second + 1) // 60 in minutes:
            n_items = max(sum(1 for _ in agent.belief.items()) for agent in agents)
            looks = int(agents[0].belief.looks.sum())
            print((second + 1) // 60, looks, n_items, f"{resident_mb():.1f}", flush=True)
    network.close()


def hour(quick: bool) -> Iterator[Table]:
    minutes = (2, 5, 10) if quick else (10, 30, 60)
    table = titled(
        f"10 agents with imperfect sensors, one observation/s each, {ROWS} × {COLS} cells, virtual clock",
        *("minutes", "looks at cells", "items stored by one agent, max", "memory [MB]"),
    )
    process = start_self("--hour", *minutes)
    for line in process.communicate()[0].decode().splitlines():
        table.add_row(*line.split())
    yield table


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
    table = titled("A frame of one observation, one core", "", "bytes", "encode [µs]", "decode [µs]")
    for name, codec in (("without signature", plain), ("Ed25519", signed)):
        data = codec.encode(frame)
        costs = (
            per_call_us(lambda codec=codec: codec.encode(frame)),
            per_call_us(lambda codec=codec, data=data: codec.decode(data)),
        )
        table.add_row(name, str(len(data)), *(f"{cost:.0f}" for cost in costs))
    yield table
    table = titled("10 agents in one process, with signatures", "observations/s each", *IN_PROCESS)
    for rate in (1.0, 5.0, 20.0):
        table.add_row(f"{rate:g}", *in_one_process(10, None, rate, 2.0 if quick else 8.0, signed))
    table.caption = "A process verifies each frame once for all its agents."
    yield table


def per_call_us(call: object) -> float:
    """Return the CPU time of a call [µs]: the least of five averages over a hundred calls."""
    assert callable(call)
    times_s = []
    for _ in range(5):
        began_s = time.process_time()
        for _ in range(100):
            call()
        times_s.append(time.process_time() - began_s)
    return min(times_s) * 1e4


PARTS = {part.__name__: part for part in (in_process, processes, joiners, hour, signatures)}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="fewer and shorter cases, some minutes in all")
    parser.add_argument(
        "--only", default=",".join(PARTS), metavar="PARTS", help="parts to run, with commas: %(default)s"
    )
    for hidden, n in (("--router", 1), ("--member", 5), ("--hour", 3)):
        parser.add_argument(hidden, nargs=n, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.router:
        uavs = range(1, int(options.router[0]) + 1)
        configuration = zenoh_config.router(parse_endpoint("tcp/127.0.0.1:0"), SWARM, uavs)
        asyncio.run(router.run(configuration, lambda text: print(text, flush=True)))
    elif options.member:
        router_url, uav, n, rate, duration = options.member
        asyncio.run(run_member(router_url, int(uav), int(n), float(rate), float(duration)))
    elif options.hour:
        run_virtual(fly_an_hour(10, [int(minute) for minute in options.hour]))
    else:
        console = Console(width=130)
        for name in options.only.split(","):
            for table in PARTS[name](options.quick):
                console.print(table)


if __name__ == "__main__":
    main()
