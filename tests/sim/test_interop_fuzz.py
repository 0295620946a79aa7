"""Floods and abusive clients on real sockets: other stations are served, and memory stays bounded."""

import random
import socket
import struct
import time
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simulator_process import Ground, free_tcp_port, free_udp_port, heartbeat, line, simulator, udp_socket

pytestmark = [pytest.mark.interop, pytest.mark.full]

FLOOD_S = 1.5
MOST_GROWTH_BYTES = 80_000_000
CODEC = mavlink.MAVLink(None, srcSystem=77)


def resident_bytes(process: Any) -> int:
    text = Path(f"/proc/{process.pid}/status").read_text()
    return int(text.partition("VmRSS:")[2].split()[0]) * 1024


def packed(message: Any, **kwargs: bool) -> bytes:
    return bytes(message.pack(CODEC, **kwargs))


def floods() -> list[bytes]:
    """Return datagrams of noise, truncated frames, and requests with long answers."""
    source = random.Random(3)
    stream = mavlink.MAVLink_request_data_stream_message(0, 0, 0, 50, 1)
    requests = (
        mavlink.MAVLink_param_request_list_message(0, 0),
        mavlink.MAVLink_log_request_list_message(0, 0, 0, 65_535),
    )
    return [
        source.randbytes(60_000),
        b"\xfe\0\0" * 20_000,
        packed(heartbeat())[:9] * 5000,
        packed(stream),
        *(packed(request, force_mavlink1=True) * 3000 for request in requests),
        packed(mavlink.MAVLink_command_long_message(0, 0, 512, 0, 435, 0, 0, 0, 0, 0, 0)) * 500,
        b"",
        b"\xfd",
    ]


def only_flood_warnings(text: str) -> bool:
    """Return True if all warnings are normal under a flood."""
    return all("[too-slow]" in line or "[refused]" in line for line in text.splitlines())


def wait_for_answer(ground: Ground, ts1: int, target: int) -> None:
    """Repeat a request with each heartbeat until its answer, because a flood may lose it."""
    begin = len(ground.received)
    while not any(
        m.get_type() == "TIMESYNC" and m.ts1 == ts1 and m.get_srcSystem() == target
        for m in ground.received[begin:]
    ):
        ground.send(heartbeat())
        ground.send(mavlink.MAVLink_timesync_message(0, ts1))
        ground.until(lambda m: m.get_type() in ("TIMESYNC", "HEARTBEAT"))


def test_a_station_is_served_during_udp_floods() -> None:
    port = free_udp_port()
    with simulator(
        "--personality", "mixed", "--count", "4", "--speedup", "4", "--url", f"udpin:127.0.0.1:{port}",
        errors=only_flood_warnings,
    ) as process:  # fmt: skip
        assert line(process)
        good, _ = udp_socket()
        with Ground(good) as ground:
            ground.address = ("127.0.0.1", port)
            ground.send(heartbeat())
            ground.systems(1, 2, 3, 4)
            before = resident_bytes(process)
            abusive = [udp_socket()[0] for _ in range(40)]  # more than the port keeps
            end_s = time.monotonic() + FLOOD_S
            kinds = floods()
            sent = 0
            while time.monotonic() < end_s:
                abusive[sent % len(abusive)].sendto(kinds[sent % len(kinds)], ("127.0.0.1", port))
                sent += 1
                if sent % 20 == 0:
                    ground.send(heartbeat())
            for other in abusive:
                other.close()
            for sysid in (1, 2, 3, 4):
                wait_for_answer(ground, 1000 + sysid, sysid)
            ground.systems(1, 2, 3, 4)
            assert resident_bytes(process) - before < MOST_GROWTH_BYTES


def test_a_station_is_served_beside_abusive_tcp_clients() -> None:
    port = free_tcp_port()
    reset = struct.pack("ii", 1, 0)  # SO_LINGER: closed with a reset
    with simulator(
        "--count", "3", "--speedup", "5", "--url", f"tcpin:127.0.0.1:{port}", errors=only_flood_warnings
    ) as process:
        assert line(process)
        with Ground(socket.create_connection(("127.0.0.1", port), timeout=10)) as ground:
            ground.systems(*range(1, 4))
            before = resident_bytes(process)
            abusive = [socket.create_connection(("127.0.0.1", port), timeout=10) for _ in range(40)]
            stream = packed(mavlink.MAVLink_request_data_stream_message(0, 0, 0, 50, 1))
            for i, client in enumerate(abusive):
                client.setblocking(False)
                try:
                    client.send((stream + packed(heartbeat())[:7], floods()[i % 9][:3000] or b"\0")[i % 2])
                    if i % 5 == 1:
                        client.shutdown(socket.SHUT_WR)
                    if i % 5 == 2:
                        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, reset)
                        client.close()
                except OSError:  # it was refused
                    client.close()
            for ts1 in range(1, 4):  # the abusive clients never read
                ground.answered(ts1, ts1)
                ground.systems(*range(1, 4))
            assert resident_bytes(process) - before < MOST_GROWTH_BYTES
            for client in abusive:
                client.close()
        with Ground(socket.create_connection(("127.0.0.1", port), timeout=10)) as late:
            late.systems(*range(1, 4))
            late.answered(99, 3)
