"""Costs of a fleet of `sim_vehicle`: in real time over UDP, and on the virtual clock.

First `pip install -e '.[bench]'`. Loads are of one core of this machine at this moment. In real time, the
fleet and the ground station are separate processes. The station requests 19 messages a second from each
vehicle, besides its heartbeats. The delay of a heartbeat is relative to the least delayed heartbeat of the
same vehicle.
"""

from __future__ import annotations

import argparse
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
from rich.console import Console
from tables import make_table

from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import default_scenario
from sim_vehicle.station.frames import Sender
from sim_vehicle.station.messages import command_long

HOME = (46.0490, 14.5060, 300.0)
VEHICLES_PER_PORT = 250
SETTLE_S, MEASURE_S, QUICK_MEASURE_S = 6.0, 15.0, 5.0
RATES_HZ = {
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 5,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 4,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 2,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 1,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 1,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 1,
}
"""message id -> messages a second: 19 in all, besides the heartbeat"""


@dataclass
class ReceivedTraffic:
    """The traffic that the ground station received."""

    n_frames: int = 0
    heartbeats_s: dict[tuple[int, int], list[float]] = field(default_factory=dict)
    """(index of the port, system id) -> times of heartbeats"""

    def add(self, port: int, data: bytes, now_s: float) -> None:
        """Count the frames of a datagram by their headers."""
        at = 0
        while at + 12 <= len(data) and data[at] == 0xFD:
            if data[at + 7 : at + 10] == b"\0\0\0":
                self.heartbeats_s.setdefault((port, data[at + 5]), []).append(now_s)
            at += 12 + data[at + 1]
            self.n_frames += 1

    def heartbeat_delays_ms(self) -> tuple[float, float]:
        """Return p50 and p99."""
        delays_s = []
        for times_s in self.heartbeats_s.values():
            offsets_s = np.array(times_s) - np.arange(len(times_s))
            delays_s.append(offsets_s - offsets_s.min())
        if not delays_s:
            return float("nan"), float("nan")
        p50, p99 = np.percentile(np.concatenate(delays_s), [50, 99]) * 1000
        return float(p50), float(p99)


@contextmanager
def open_ports(count: int) -> Iterator[tuple[int, list[socket.socket]]]:
    """Yield the first of `count` consecutive ports on loopback, and their sockets."""
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


def receive(
    sockets: list[socket.socket], traffic: ReceivedTraffic | None, duration_s: float
) -> dict[int, tuple[str, int]]:
    """Receive datagrams for this time; return the address of the sender to each port, by the port's index."""
    selector = selectors.DefaultSelector()
    for index, udp in enumerate(sockets):
        selector.register(udp, selectors.EVENT_READ, index)
    sources: dict[int, tuple[str, int]] = {}
    end_s = time.monotonic() + duration_s
    while (remaining_s := end_s - time.monotonic()) > 0:
        for key, _ in selector.select(remaining_s):
            now_s = time.monotonic()
            try:
                while True:
                    data, sources[key.data] = key.fileobj.recvfrom(4096)  # type: ignore[union-attr]
                    if traffic is not None:
                        traffic.add(key.data, data, now_s)
            except BlockingIOError:
                pass
    return sources


def start_commands(sysid: int, personality: str = "ardupilot") -> Iterator[bytes]:
    """Yield the frames of the commands for take-off and for the messages of RATES_HZ."""
    sender = Sender()
    commands: list[tuple[float, ...]] = [(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)]
    if personality == "ardupilot":
        commands.insert(0, (mavlink.MAV_CMD_DO_SET_MODE, 1, 4))
        commands.append((mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 20))
        commands += [(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, m, 1e6 / hz) for m, hz in RATES_HZ.items()]
    else:
        commands.append((mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, HOME[2] + 20))
    for command, *parameters in commands:
        yield sender.pack(command_long((sysid, 1), int(command), *parameters))


def send_start_commands(
    sockets: list[socket.socket], sources: dict[int, tuple[str, int]], count: int
) -> None:
    """Send the start commands to each vehicle, with a pause of 1 ms after each vehicle."""
    for index, udp in enumerate(sockets):
        for sysid in range(1, min(VEHICLES_PER_PORT, count - index * VEHICLES_PER_PORT) + 1):
            for frame in start_commands(sysid):
                udp.sendto(frame, sources[index])
            time.sleep(0.001)


def real_time_row(count: int, measure_s: float) -> list[str]:
    """Return the row of `count` vehicles in the table of the real-time costs."""
    with open_ports(-(-count // VEHICLES_PER_PORT)) as (first, sockets):
        command = [
            sys.executable, "-m", "sim_vehicle", "--count", str(count), "--ready-s", "0",
            "--url", f"udpout:127.0.0.1:{first}", "--per-port", str(VEHICLES_PER_PORT),
        ]  # fmt: skip
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        try:
            sources = receive(sockets, None, SETTLE_S)
            send_start_commands(sockets, sources, count)
            receive(sockets, None, 3.0)
            fleet_process = psutil.Process(process.pid)
            before, traffic = fleet_process.cpu_times(), ReceivedTraffic()
            receive(sockets, traffic, measure_s)
            after = fleet_process.cpu_times()
            rss_mb = fleet_process.memory_info().rss / 1e6
        finally:
            process.terminate()
            _, errors = process.communicate(timeout=20)
    if errors:
        print(errors, file=sys.stderr)
    load = (after.user + after.system - before.user - before.system) / measure_s
    p50, p99 = traffic.heartbeat_delays_ms()
    return [
        str(count),
        f"{traffic.n_frames / measure_s:,.0f}",
        f"{traffic.n_frames / measure_s / count:.1f}",
        f"{100 * load:.1f}",
        f"{1e6 * load / count:.0f}",
        f"{rss_mb:.0f}",
        f"{len(traffic.heartbeats_s)}",
        f"{p50:.1f}",
        f"{p99:.1f}",
    ]


def virtual_clock_row(personality: str, count: int, simulated_s: float) -> list[str]:
    """Return the row of `count` vehicles on the virtual clock, all in the air, with all streams encoded."""
    fleet = Fleet(default_scenario(count, home=HOME, personality=personality), ready_s=0)
    fleet.step(1.0)
    for link, sysid in zip(fleet.links, fleet.sysids, strict=True):
        for frame in start_commands(sysid, personality):
            fleet.receive(frame, 1.0, link=link)
    fleet.step(20.0)
    assert fleet.truth().airborne.all()
    gc.collect()
    n_frames, now_s, began_s = 0, 20.0, time.process_time()
    while now_s < 20.0 + simulated_s:
        now_s += 0.1
        n_frames += len(fleet.step(now_s))
    used_s = time.process_time() - began_s
    return [
        personality,
        str(count),
        f"{n_frames / simulated_s / count:.1f}",
        f"{simulated_s / used_s:.0f}",
        f"{1e6 * used_s / simulated_s / count:.0f}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="at most 100 vehicles, less than a minute")
    options = parser.parse_args()
    console = Console(width=130)
    real_time = make_table(
        "In real time over UDP",
        *("vehicles", "messages/s", "messages/s each", "CPU [% of a core]", "CPU each [µs/s]", "memory [MB]"),
        *("vehicles received", "heartbeat delay p50 [ms]", "p99 [ms]"),
    )
    for count in (10, 100) if options.quick else (10, 100, 250, 1000):
        real_time.add_row(*real_time_row(count, QUICK_MEASURE_S if options.quick else MEASURE_S))
    console.print(real_time)
    virtual = make_table(
        "On the virtual clock, one core",
        *("autopilot", "vehicles", "messages/s each", "times real time", "CPU each [µs/s]"),
        left=["autopilot"],
    )
    cases = ((10, 200.0), (100, 100.0), (1000, 20.0))
    for personality in ("ardupilot", "px4"):
        for count, simulated_s in cases[:2] if options.quick else cases:
            virtual.add_row(*virtual_clock_row(personality, count, simulated_s))
    console.print(virtual)


if __name__ == "__main__":
    main()
