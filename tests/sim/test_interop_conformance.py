"""The conformance suite as a process, over UDP and TCP, against the simulator as a process."""

import json
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from simulator_process import Ground, free_tcp_port, free_udp_port, line, simulator

pytestmark = [pytest.mark.interop, pytest.mark.full]
LIMIT_S = 60.0
SPEEDUP = "5"
# None of them measures a rate, because a busy machine must not fail them.
QUICK = ("version", "parameters.set", "commands.target", "mission.download", "arming.arms_and_disarms")


def conformance(url: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "sim_vehicle", "conformance", url, "--speedup", SPEEDUP, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)


def only(*patterns: str) -> list[str]:
    return [argument for pattern in patterns for argument in ("--only", pattern)]


def test_the_suite_runs_over_udp_and_writes_json(tmp_path: Path) -> None:
    port, path = free_udp_port(), tmp_path / "results.json"
    with simulator("--speedup", SPEEDUP, "--url", f"udpout:127.0.0.1:{port}"):
        done = conformance(f"udpin:127.0.0.1:{port}", "--json", str(path), *only(*QUICK))
    assert done.returncode == 0, done.stdout + done.stderr
    results = json.loads(path.read_text())
    assert results["counts"]["failed"] == 0
    assert results["counts"]["passed"] >= 25
    assert results["vehicle"]["simulator"] is True
    assert "arms_and_disarms" in done.stdout


def test_the_suite_follows_a_rebooting_vehicle_over_udp() -> None:
    port = free_udp_port()
    with simulator("--count", "3", "--speedup", SPEEDUP, "--url", f"udpout:127.0.0.1:{port}"):
        done = conformance(
            f"udpin:127.0.0.1:{port}", "--sysid", "2", *only("reboot.answers_again", "reboot.parameters_stay")
        )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "system 2" in done.stdout
    assert "2 passed" in done.stdout


def test_a_silent_link_is_a_usage_error() -> None:
    port = free_udp_port()
    done = conformance(f"udpin:127.0.0.1:{port}", "--speedup", "100")
    assert done.returncode == 2
    assert "[no-heartbeat]" in done.stderr


# -- ended from outside ------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_suite_lands_the_vehicle(number: signal.Signals) -> None:
    port = free_tcp_port()
    command = [sys.executable, "-m", "sim_vehicle", "conformance", f"tcpout:127.0.0.1:{port}"]
    with simulator("--speedup", SPEEDUP, "--url", f"tcpin:127.0.0.1:{port}") as fleet:
        assert line(fleet)
        with Ground(socket.create_connection(("127.0.0.1", port), LIMIT_S)) as observer:
            process = subprocess.Popen(
                [*command, "--speedup", SPEEDUP, *only("flight.hold*")],
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            )  # fmt: skip
            try:
                observer.until(lambda m: m.get_type() == "GLOBAL_POSITION_INT" and m.relative_alt > 8000)
                process.send_signal(number)
                out, errors = process.communicate(timeout=LIMIT_S)
            finally:
                process.kill()
            # Without a landing the vehicle would stay armed for longer than this wait.
            observer.until(
                lambda m: m.get_type() == "HEARTBEAT" and m.autopilot == 3 and not m.base_mode & 128
            )
    assert process.returncode == 130, out + errors
    assert "[restoring]" in errors
    assert "checks" in out  # the matrix of the finished checks


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_scenario_writes_no_verdict(number: signal.Signals, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sim_vehicle", "run", "clean_mission", "--speedup", "1"]
    process = subprocess.Popen(
        [*command, "--out", str(tmp_path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        end_s = time.monotonic() + LIMIT_S
        while not any(path.stat().st_size for path in tmp_path.glob("*/*.tlog")):
            assert process.poll() is None
            assert time.monotonic() < end_s
            time.sleep(0.05)
        process.send_signal(number)
        out, errors = process.communicate(timeout=LIMIT_S)
    finally:
        process.kill()
    assert process.returncode == 130, out + errors
    assert errors.count("\n") == 1
    assert not list(tmp_path.glob("*/verdict.json"))
