"""A flight in real time with a forwarded ground station, and the audit of its evidence."""

from __future__ import annotations

import signal
import subprocess
import time
from pathlib import Path

import pytest
from pymavlink import mavutil
from swarmctl_process import read_until, run, started

pytestmark = [pytest.mark.interop, pytest.mark.full]

SMALL = """\
name: watched
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50}
threats: {count: 5}
simulate: {count: 2, speedup: 15}
"""
LIMIT_S = 90.0


def test_a_forwarded_station_sees_the_whole_flight_and_the_evidence_is_whole(tmp_path: Path) -> None:
    (tmp_path / "watched.yaml").write_text(SMALL)
    station = mavutil.mavlink_connection("udpin:127.0.0.1:0", source_system=250)
    port = station.port.getsockname()[1]
    forward = ["--forward", f"udpout:127.0.0.1:{port}", "--forward", "tcpout:127.0.0.1:9"]  # a closed port
    seen: set[tuple[int, str]] = set()
    armed: set[int] = set()
    ends = time.monotonic() + LIMIT_S
    with started("fly", "--config", "watched.yaml", *forward, cwd=tmp_path) as flight:
        try:
            while flight.poll() is None and time.monotonic() < ends:
                message = station.recv_match(blocking=True, timeout=0.5)
                if message is not None:
                    seen.add((message.get_srcSystem(), message.get_type()))
                    if message.get_type() == "HEARTBEAT" and message.base_mode & 128:
                        armed.add(message.get_srcSystem())
            output = flight.stdout.read() if flight.stdout is not None else ""
        finally:
            station.close()
    assert flight.returncode == 0, output
    assert armed == {1, 2}
    for system in (1, 2):
        assert {(system, "HEARTBEAT"), (system, "GLOBAL_POSITION_INT"), (system, "COMMAND_ACK")} <= seen
    assert {(255, "HEARTBEAT"), (255, "COMMAND_LONG"), (255, "MISSION_ITEM_INT")} <= seen
    audited = audit(tmp_path)
    assert audited.returncode == 0, audited.stderr
    assert "armed True" in audited.stdout


def audit(cwd: Path) -> subprocess.CompletedProcess[str]:
    (folder,) = (cwd / "runs").iterdir()
    return run("audit", folder, cwd=cwd)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_evidence_names_the_end_by_signal_and_is_not_closed_after_a_kill(
    tmp_path: Path, how: signal.Signals
) -> None:
    (tmp_path / "watched.yaml").write_text(f"{SMALL}flight: {{on_exit: land}}\n")
    with started("fly", "--config", "watched.yaml", "-v", cwd=tmp_path) as flight:
        read_until(flight, "uav1: launching → flying")
        flight.send_signal(how)
        flight.communicate(timeout=LIMIT_S)
    audited = audit(tmp_path)
    if how is signal.SIGINT:
        assert audited.returncode == 0, audited.stderr
        assert ", by signal" in audited.stdout
    else:
        assert audited.returncode == 1
        assert "[not-closed]" in audited.stderr
