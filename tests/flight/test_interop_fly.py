"""`swarmctl fly` as a process of its own, with real sockets and the simulator process beside it."""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import subprocess
from contextlib import suppress
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simulator_process import simulator
from swarmctl_process import ROOT, read_until, run, started
from zenoh_nodes import free_port

pytestmark = pytest.mark.interop

SHIPPED = ROOT / "configs" / "swarm.yaml"
SMALL = """\
name: small
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50}
threats: {count: 5}
"""


@pytest.mark.full
def test_the_shipped_configuration_flies(tmp_path: Path) -> None:
    """The speed-up is hardly higher than shipped, because a busy machine has to keep up."""
    config = tmp_path / "swarm.yaml"
    text = SHIPPED.read_text()
    assert text.count("  speedup: 10\n") == 1
    config.write_text(text.replace("  speedup: 10\n", "  speedup: 12\n"))
    done = run("fly", "--config", config, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "5 of 5 arrived" in done.stdout
    (folder,) = (tmp_path / "runs").iterdir()
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["arrived"] == 5
    assert summary["clock"] == "real"
    names = {p.name for p in folder.iterdir()}
    assert names >= {"run.mcap", "map.png", "summary.json"}
    assert names >= {f"uav{n}.{kind}" for n in range(1, 6) for kind in ("tlog", "plan")}
    again = run("replay", folder, cwd=tmp_path)
    assert again.returncode == 0, again.stderr


def final_phases(folder: Path) -> dict[str, str]:
    """Return the phase of each vehicle at the end, by name, from `summary.json`."""
    (file,) = folder.glob("runs/*/summary.json")
    return {vehicle["name"]: vehicle["phase"] for vehicle in json.loads(file.read_text())["vehicles"]}


def test_ctrl_c_once_lands_the_vehicles(tmp_path: Path) -> None:
    config = tmp_path / "small.yaml"
    config.write_text(SMALL + "simulate: {count: 2, speedup: 20}\nflight: {on_exit: land}\n")
    with started("fly", "--config", config, cwd=tmp_path) as process:
        read_until(process, "uav2: flying")
        process.send_signal(signal.SIGINT)
        lines = read_until(process, "run folder:")
        assert process.wait(timeout=30.0) == 130
    assert any("uav1, uav2" in line and "[stopping]" in line for line in lines)
    assert final_phases(tmp_path) == {"uav1": "done", "uav2": "done"}


@pytest.mark.full
def test_ctrl_c_twice_leaves_at_once_and_reports_it(tmp_path: Path) -> None:
    config = tmp_path / "small.yaml"
    config.write_text(SMALL + "simulate: {count: 2, speedup: 5, ready_s: 0}\n")
    with started("fly", "--config", config, cwd=tmp_path) as process:
        read_until(process, "uav2: flying")
        process.send_signal(signal.SIGINT)
        read_until(process, "[stopping]")
        process.send_signal(signal.SIGINT)
        lines = read_until(process, "run folder:")
        assert process.wait(timeout=30.0) == 130
    assert any("[emergency]" in line for line in lines)
    assert sum(line.endswith("[in-air]") for line in lines if line.startswith("uav")) == 2


@pytest.mark.full
def test_a_port_in_use_is_named(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        config = tmp_path / "small.yaml"
        config.write_text(SMALL + f'simulate: {{count: 1, url: "udpin://127.0.0.1:{port}"}}\n')
        for command in ("fly", "check"):
            done = run(command, "--config", config, cwd=tmp_path)
            assert done.returncode == 1
            assert f"udpin://127.0.0.1:{port}: port {port} " in done.stderr


def vehicles(port: int, *, timeout_s: float) -> str:
    start = "{lat_deg: 46.0, lon_deg: 14.399}"
    return SMALL + (
        f"flight: {{connect_timeout_s: {timeout_s}}}\n"
        "preflight: {set_parameters: true}\n"
        "vehicles:\n"
        f'  - {{name: alpha, url: "udpin://127.0.0.1:{port}", sysid: 7, start: {start}, goal: [1, 7]}}\n'
    )


@pytest.mark.full
def test_a_url_without_a_vehicle_is_named(tmp_path: Path) -> None:
    port = free_port()
    config = tmp_path / "real.yaml"
    config.write_text(vehicles(port, timeout_s=1.0))
    done = run("fly", "--config", config, cwd=tmp_path)
    assert done.returncode == 1
    assert f"alpha (system 7 at udpin://127.0.0.1:{port})" in done.stderr
    assert "[no-heartbeat]" in done.stderr


def test_a_vehicle_of_a_separate_simulator_is_flown_by_its_url(tmp_path: Path) -> None:
    port = free_port()
    config = tmp_path / "by_url.yaml"
    config.write_text(vehicles(port, timeout_s=15.0))
    options = ["--home", "46.0,14.399,300", "--sysid", "7", "--speedup", "20"]
    for value in ("LAND_SPEED=150", "WPNAV_SPEED_DN=300", "DISARM_DELAY=0"):
        options += ["--param", value]
    with simulator(*options, "--url", f"udpout:127.0.0.1:{port}"):
        done = run("fly", "--config", config, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 of 1 arrived" in done.stdout


VERSION_WITHOUT_MARK = mavlink.MAVLink_autopilot_version_message(
    0, 0x04060200, 0, 0, 0, bytes(8), bytes(8), bytes(8), 0, 0, 0, bytes(range(18))
)


class ExternalAutopilot:
    """An autopilot that is not simulated, on UDP, with a heartbeat and a version."""

    def __init__(self, port: int) -> None:
        self.received: list[tuple[str, int]] = []
        self._ground = ("127.0.0.1", port)
        self._mav = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
        self._mav.robust_parsing = True
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(0.2)

    def __enter__(self) -> ExternalAutopilot:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def live_while(self, process: subprocess.Popen[str]) -> None:
        while process.poll() is None:
            self._send(mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3))
            try:
                data = self._socket.recv(2048)
            except TimeoutError:
                continue
            for message in self._mav.parse_buffer(data) or ():
                self.received.append((message.get_type(), getattr(message, "command", 0)))
                if self.received[-1][1] == mavlink.MAV_CMD_REQUEST_MESSAGE:
                    self._send(VERSION_WITHOUT_MARK)

    def _send(self, message: mavlink.MAVLink_message) -> None:
        self._socket.sendto(message.pack(self._mav), self._ground)


def test_an_autopilot_that_is_not_simulated_gets_no_mission_and_no_arming_without_real(
    tmp_path: Path,
) -> None:
    port = free_port()
    config = tmp_path / "real.yaml"
    config.write_text(vehicles(port, timeout_s=15.0))
    with ExternalAutopilot(port) as autopilot, started("fly", "--config", config, cwd=tmp_path) as process:
        autopilot.live_while(process)
        assert process.stdout is not None
        output = process.stdout.read()
        assert process.returncode == 1
    assert "alpha: ArduPilot 4.6.2" in output
    assert "[real-not-confirmed]" in output
    asked = {command for kind, command in autopilot.received if kind == "COMMAND_LONG"}
    assert asked == {mavlink.MAV_CMD_REQUEST_MESSAGE}
    assert {kind for kind, _ in autopilot.received} <= {"COMMAND_LONG", "HEARTBEAT"}


@pytest.mark.full
def test_no_simulator_is_left_behind(tmp_path: Path) -> None:
    config = tmp_path / "small.yaml"
    config.write_text(SMALL + "simulate: {count: 1, speedup: 20}\n")
    with started("fly", "--config", config, cwd=tmp_path) as process:
        read_until(process, "uav1: flying")
        (child,) = simulators_of(process)
        process.kill()
        process.wait(timeout=10.0)
    assert has_ended(child), "the simulator outlived the ground station"


@pytest.mark.full
def test_a_terminal_that_hangs_up_lands_the_vehicles_first(tmp_path: Path) -> None:
    config = tmp_path / "small.yaml"
    config.write_text(SMALL + "simulate: {count: 1, speedup: 20}\nflight: {on_exit: land}\n")
    with started("fly", "--config", config, cwd=tmp_path) as process:
        read_until(process, "uav1: flying")
        process.send_signal(signal.SIGHUP)
        read_until(process, "run folder:")
        assert process.wait(timeout=30.0) == 130
    assert final_phases(tmp_path) == {"uav1": "done"}


@pytest.mark.full
def test_a_simulator_that_dies_is_reported_with_its_vehicles(tmp_path: Path) -> None:
    config = tmp_path / "small.yaml"
    config.write_text(SMALL + "simulate: {count: 1, speedup: 5, ready_s: 0}\n")
    with started("fly", "--config", config, cwd=tmp_path) as process:
        read_until(process, "uav1: flying")
        (child,) = simulators_of(process)
        os.kill(child, signal.SIGKILL)
        lines = read_until(process, "run folder:")
        assert process.wait(timeout=30.0) == 1
    assert any(" signal 9 " in line and line.endswith("[simulator-ended]") for line in lines)
    assert any(line.startswith("uav1: ") and line.endswith("[simulator-ended]") for line in lines)


def simulators_of(process: subprocess.Popen[str]) -> list[int]:
    """Return the process ids of the simulators that a ground station has started."""
    found, mark = [], f"--parent-pid\0{process.pid}\0"
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):  # the process has ended meanwhile
            if mark in path.read_text(errors="replace"):
                found.append(int(path.parent.name))
    return found


def has_ended(pid: int) -> bool:
    """Return whether a process ends within 10 s."""
    try:
        process = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        return bool(select.select([process], [], [], 10.0)[0])
    finally:
        os.close(process)
