"""The conformance suite as a process, over UDP and TCP, against the simulator as a process."""

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

pytestmark = pytest.mark.interop
LIMIT_S = 60.0
SPEEDUP = "5"
# Nothing among them measures a rate: a busy machine must not fail them.
QUICK = ("version", "parameters.set", "commands.target", "mission.download", "arming.arms_and_disarms")


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def simulator(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "sim_vehicle", "--speedup", SPEEDUP, "--ready-s", "1", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    process.stdout.readline()
    try:
        yield process
    finally:
        process.terminate()
        process.communicate(timeout=LIMIT_S)


def conformance(url: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "sim_vehicle", "conformance", url, "--speedup", SPEEDUP, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)


def only(*patterns: str) -> list[str]:
    return [argument for pattern in patterns for argument in ("--only", pattern)]


def test_it_runs_over_udp_and_writes_json(tmp_path: Path) -> None:
    port, path = free_port(socket.SOCK_DGRAM), tmp_path / "results.json"
    with simulator("--url", f"udpout:127.0.0.1:{port}"):
        done = conformance(f"udpin:127.0.0.1:{port}", "--json", str(path), *only(*QUICK))
    assert done.returncode == 0, done.stdout + done.stderr
    results = json.loads(path.read_text())
    assert results["counts"]["failed"] == 0
    assert results["counts"]["passed"] >= 25
    assert results["vehicle"]["simulator"] is True
    assert "arms_and_disarms" in done.stdout


def test_it_follows_a_vehicle_that_reboots_over_udp() -> None:
    port = free_port(socket.SOCK_DGRAM)
    with simulator("--count", "3", "--url", f"udpout:127.0.0.1:{port}"):
        done = conformance(
            f"udpin:127.0.0.1:{port}", "--sysid", "2", *only("reboot.comes_back", "reboot.parameters_stay")
        )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "system 2" in done.stdout
    assert "2 passed" in done.stdout


def test_it_connects_to_a_tcp_server() -> None:
    port = free_port(socket.SOCK_STREAM)
    with simulator("--url", f"tcpin:127.0.0.1:{port}"):
        done = conformance(f"tcpout:127.0.0.1:{port}", *only("commands.target", "mission.download"))
    assert done.returncode == 0, done.stdout + done.stderr


def test_it_says_so_where_nobody_is_heard() -> None:
    port = free_port(socket.SOCK_DGRAM)
    done = conformance(f"udpin:127.0.0.1:{port}", "--speedup", "100")
    assert done.returncode == 2
    assert "no heartbeat" in done.stderr
