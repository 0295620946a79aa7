"""Costs of a fleet of `sim_vehicle`: in real time over UDP, and on the virtual clock.

Run: `pip install -e '.[bench]'`, then `python benchmarks/simulator.py`. A core is one of this machine's at
this moment; every row is measured in the same run. In real time the fleet is a process of its own, and
the ground station another one, which requests 19 messages a second from every vehicle beside its heartbeat.
The delay of a heartbeat is measured against the schedule of its vehicle's earliest one.
"""

from __future__ import annotations

import gc
import itertools
import selectors
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

import numpy as np
import psutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import default_scenario

HOME = (46.0490, 14.5060, 300.0)
PER_PORT = 250
SETTLE_S, MEASURE_S = 6.0, 15.0
# Message id -> messages a second: 19 beside the heartbeat.
RATES_HZ = {
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 5,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 4,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 2,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 1,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 1,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 1,
}


@dataclass
class Heard:
    """The traffic that a ground station received: frames, bytes, and times of each vehicle's heartbeats."""

    frames: int = 0
    size: int = 0
    heartbeats_s: dict[tuple[int, int], list[float]] = field(default_factory=dict)

    def take(self, port: int, data: bytes, now: float) -> None:
        """Walk over the frames of a datagram by their headers."""
        at = 0
        while at + 12 <= len(data) and data[at] == 0xFD:
            if data[at + 7 : at + 10] == b"\0\0\0":
                self.heartbeats_s.setdefault((port, data[at + 5]), []).append(now)
            at += 12 + data[at + 1]
            self.frames += 1
        self.size += len(data)

    def lateness_ms(self) -> tuple[float, float]:
        """Return the median and the 99th percentile."""
        late = []
        for times_s in self.heartbeats_s.values():
            offsets_s = np.array(times_s) - np.arange(len(times_s))
            late.append(offsets_s - offsets_s.min())
        if not late:
            return float("nan"), float("nan")
        p50, p99 = np.percentile(np.concatenate(late), [50, 99]) * 1000
        return float(p50), float(p99)


@contextmanager
def ports(count: int) -> Iterator[tuple[int, list[socket.socket]]]:
    """Open sockets on `count` consecutive free ports of the loopback."""
    for first in itertools.count(20_000, 50):
        with ExitStack() as stack:
            sockets = []
            try:
                for offset in range(count):
                    udp = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                    udp.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8_000_000)
                    udp.bind(("127.0.0.1", first + offset))
                    udp.setblocking(False)
                    sockets.append(udp)
            except OSError:
                continue
            yield first, sockets
            return


def listen(sockets: list[socket.socket], heard: Heard | None, seconds: float) -> dict[int, tuple[str, int]]:
    """Receive for this time and return the sender address at each port."""
    selector = selectors.DefaultSelector()
    for index, udp in enumerate(sockets):
        selector.register(udp, selectors.EVENT_READ, index)
    sources: dict[int, tuple[str, int]] = {}
    end_s = time.monotonic() + seconds
    while (left_s := end_s - time.monotonic()) > 0:
        for key, _ in selector.select(left_s):
            now = time.monotonic()
            try:
                while True:
                    data, sources[key.data] = key.fileobj.recvfrom(4096)  # type: ignore[union-attr]
                    if heard is not None:
                        heard.take(key.data, data, now)
            except BlockingIOError:
                pass
    return sources


def orders(sysid: int, personality: str = "ardupilot") -> Iterator[bytes]:
    """Return the orders for take-off and for all messages of RATES_HZ."""
    codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    commands: list[tuple[float, ...]] = [(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)]
    if personality == "ardupilot":
        commands.insert(0, (mavlink.MAV_CMD_DO_SET_MODE, 1, 4))
        commands.append((mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 20))
        commands += [(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, m, 1e6 / hz) for m, hz in RATES_HZ.items()]
    else:
        commands.append((mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, HOME[2] + 20))
    for command, *parameters in commands:
        padded = [*parameters, *[0.0] * (7 - len(parameters))]
        yield mavlink.MAVLink_command_long_message(sysid, 1, int(command), 0, *padded).pack(codec)


def ask(sockets: list[socket.socket], sources: dict[int, tuple[str, int]], count: int) -> None:
    """Send every vehicle its orders, no faster than a link would."""
    for index, udp in enumerate(sockets):
        for sysid in range(1, min(PER_PORT, count - index * PER_PORT) + 1):
            for order in orders(sysid):
                udp.sendto(order, sources[index])
            time.sleep(0.001)


def in_real_time(count: int) -> list[str]:
    """One row of the table."""
    with ports(-(-count // PER_PORT)) as (first, sockets):
        command = [
            sys.executable, "-m", "sim_vehicle", "--count", str(count), "--ready-s", "0",
            "--url", f"udpout:127.0.0.1:{first}", "--per-port", str(PER_PORT),
        ]  # fmt: skip
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        try:
            sources = listen(sockets, None, SETTLE_S)
            ask(sockets, sources, count)
            listen(sockets, None, 3.0)
            watched = psutil.Process(process.pid)
            cpu, heard = watched.cpu_times(), Heard()
            listen(sockets, heard, MEASURE_S)
            after = watched.cpu_times()
            rss_mb = watched.memory_info().rss / 1e6
        finally:
            process.terminate()
            _, said = process.communicate(timeout=20)
    if said:
        print(said, file=sys.stderr)
    used = (after.user + after.system - cpu.user - cpu.system) / MEASURE_S
    p50, p99 = heard.lateness_ms()
    return [
        str(count),
        f"{heard.frames / MEASURE_S:,.0f}",
        f"{heard.frames / MEASURE_S / count:.1f}",
        f"{100 * used:.1f}",
        f"{1e6 * used / count:.0f}",
        f"{rss_mb:.0f}",
        f"{len(heard.heartbeats_s)}",
        f"{p50:.1f}",
        f"{p99:.1f}",
    ]


def on_the_virtual_clock(personality: str, count: int, simulated_s: float) -> list[str]:
    """Return one row: all vehicles in the air, all streams encoded."""
    fleet = Fleet(default_scenario(count, home=HOME, personality=personality), ready_s=0)
    fleet.step(1.0)
    for link, sysid in zip(fleet.links, fleet.sysids, strict=True):
        for order in orders(sysid, personality):
            fleet.receive(order, 1.0, link=link)
    fleet.step(20.0)
    assert fleet.truth().airborne.all()
    gc.collect()
    frames, now, began_s = 0, 20.0, time.process_time()
    while now < 20.0 + simulated_s:
        now += 0.1
        frames += len(fleet.step(now))
    used_s = time.process_time() - began_s
    return [
        personality,
        str(count),
        f"{frames / simulated_s / count:.1f}",
        f"{simulated_s / used_s:.0f}",
        f"{1e6 * used_s / simulated_s / count:.0f}",
    ]


def main() -> None:
    console = Console()
    real = Table(title="In real time over UDP", box=box.SIMPLE_HEAD)
    for name in (
        "fleet", "msg/s", "each", "CPU [%]", "each [us/s]", "RSS [MB]", "heard", "late p50 [ms]",
        "p99 [ms]",
    ):  # fmt: skip
        real.add_column(escape(name), justify="right")
    for count in (10, 100, 250, 1000):
        real.add_row(*in_real_time(count))
    console.print(real)
    virtual = Table(title="On the virtual clock, one core", box=box.SIMPLE_HEAD)
    for name in ("autopilot", "vehicles", "msg/s each", "times real time", "CPU each [us/s]"):
        virtual.add_column(escape(name), justify="left" if name == "autopilot" else "right")
    for personality in ("ardupilot", "px4"):
        for count, simulated_s in ((10, 200.0), (100, 100.0), (1000, 20.0)):
            virtual.add_row(*on_the_virtual_clock(personality, count, simulated_s))
    console.print(virtual)


if __name__ == "__main__":
    main()
