"""`python -m sim_vehicle` as a process: sockets, several clients, reboots, signals and its parent's end."""

import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

pytestmark = pytest.mark.interop
LIMIT_S = 15.0


@contextmanager
def simulator(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "sim_vehicle", "--ready-s", "1", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.terminate()
        _, errors = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 0, errors
    assert errors == ""


def first_line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline()


def udp_socket() -> tuple[socket.socket, int]:
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    udp.bind(("127.0.0.1", 0))
    udp.settimeout(LIMIT_S)
    return udp, udp.getsockname()[1]


def free_tcp_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def heartbeats_of(data: bytes) -> set[int]:
    decoder = mavlink.MAVLink(None)
    decoder.robust_parsing = True
    heard = decoder.parse_buffer(data) or []
    return {m.get_srcSystem() for m in heard if m.get_type() == "HEARTBEAT"}


def test_it_says_what_it_is_and_ends_cleanly_on_a_signal() -> None:
    udp, port = udp_socket()
    with udp, simulator("--count", "5", "--speedup", "10", "--url", f"udpout:127.0.0.1:{port}") as process:
        line = first_line(process)
    assert line == f"sim_vehicle: 5 copters, sysid 1-5, udpout 127.0.0.1:{port}, 10x real time\n"


def test_the_whole_fleet_comes_out_of_one_udp_socket() -> None:
    udp, port = udp_socket()
    systems: set[int] = set()
    addresses = set()
    with (
        udp,
        simulator("--count", "3", "--sysid", "11", "--speedup", "5", "--url", f"udpout:127.0.0.1:{port}"),
    ):
        while systems != {11, 12, 13}:
            data, address = udp.recvfrom(4096)
            systems |= heartbeats_of(data)
            addresses.add(address)
    assert len(addresses) == 1


def test_a_rebooted_vehicle_comes_back_from_another_port_and_still_answers() -> None:
    # AUTOPILOTS 1.18
    codec = mavlink.MAVLink(None, srcSystem=255)
    udp, port = udp_socket()
    with udp, simulator("--count", "2", "--speedup", "5", "--url", f"udpout:127.0.0.1:{port}"):
        _, shared = udp.recvfrom(4096)
        reboot = mavlink.MAVLink_command_long_message(2, 0, 246, 0, 1, 0, 0, 0, 0, 0, 0)
        udp.sendto(reboot.pack(codec), shared)
        address = shared
        while address == shared:
            data, address = udp.recvfrom(4096)
        assert b"Init ArduCopter" in data
        udp.sendto(mavlink.MAVLink_timesync_message(0, 99).pack(codec), address)
        answered = False
        while not answered:
            data, source = udp.recvfrom(4096)
            decoder = mavlink.MAVLink(None)
            decoder.robust_parsing = True
            for message in decoder.parse_buffer(data) or ():
                if message.get_type() == "TIMESYNC" and message.ts1 == 99 and message.get_srcSystem() == 2:
                    answered = source == address


def test_several_tcp_clients_each_see_the_fleet_and_may_leave() -> None:
    port = free_tcp_port()
    with simulator("--count", "2", "--speedup", "5", "--url", f"tcpin:127.0.0.1:{port}") as process:
        assert first_line(process)
        for _ in range(2):
            with (
                socket.create_connection(("127.0.0.1", port), LIMIT_S) as one,
                socket.create_connection(("127.0.0.1", port), LIMIT_S) as other,
            ):
                for client in (one, other):
                    data = b""
                    while heartbeats_of(data) != {1, 2}:
                        data += client.recv(4096)


def test_it_dials_out_over_tcp_again_and_again() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(LIMIT_S)
        url = f"tcpout:127.0.0.1:{server.getsockname()[1]}"
        with simulator("--speedup", "5", "--url", url):
            for _ in range(2):
                connection, _ = server.accept()
                with connection:
                    connection.settimeout(LIMIT_S)
                    assert connection.recv(4096)


def test_a_listening_udp_fleet_answers_whoever_speaks() -> None:
    udp, port = udp_socket()
    udp.close()
    codec = mavlink.MAVLink(None, srcSystem=255)
    with simulator("--speedup", "5", "--url", f"udpin:127.0.0.1:{port}") as process:
        assert first_line(process)
        client, _ = udp_socket()
        with client:
            client.sendto(
                mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(codec), ("127.0.0.1", port)
            )
            data = b""
            while heartbeats_of(data) != {1}:
                data += client.recvfrom(4096)[0]


@pytest.mark.parametrize("kind", ["udpin", "tcpin"])
def test_a_port_that_is_taken_is_an_error_with_code_2(kind: str) -> None:
    with socket.socket(type=socket.SOCK_DGRAM if kind == "udpin" else socket.SOCK_STREAM) as taken:
        taken.bind(("127.0.0.1", 0))
        if kind == "tcpin":
            taken.listen()
        url = f"{kind}:127.0.0.1:{taken.getsockname()[1]}"
        done = run("--url", url)
    assert done.returncode == 2
    assert re.match(rf"sim_vehicle: cannot open {kind} 127.0.0.1:\d+: .*Choose another port", done.stderr)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--url", "serial:x"), "is not understood; expected udpout:HOST:PORT"),
        (("--home", "here"), "is not LAT,LON,ALT"),
        (("--scenario", "/nowhere.json"), "cannot be read"),
        (("--speedup", "0"), "--speedup"),
    ],
)
def test_bad_arguments_are_errors_with_code_2(arguments: tuple[str, ...], words: str) -> None:
    done = run(*arguments)
    assert done.returncode == 2
    assert words in done.stderr
    assert "Traceback" not in done.stderr


def test_it_ends_when_its_parent_is_gone() -> None:
    udp, port = udp_socket()
    udp.close()
    parent = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    arguments = ("--url", f"udpout:127.0.0.1:{port}", "--parent-pid", str(parent.pid))
    with simulator(*arguments) as process:
        assert first_line(process)
        parent.communicate(b"\n", timeout=LIMIT_S)
        assert process.wait(timeout=LIMIT_S) == 0


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "sim_vehicle", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
