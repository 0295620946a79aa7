"""The real MAVSDK and pymavlink's own FTP client read logs, parameters and metadata over loopback."""

import json
import queue
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.component_metadata import ComponentMetadata, MetadataType
from mavsdk.plugins.ftp import Ftp, FtpResult
from mavsdk.plugins.log_files import LogFiles, LogFilesResult
from mavsdk.plugins.telemetry import Telemetry
from pymavlink import DFReader, mavftp, mavutil

pytestmark = pytest.mark.interop
SYSTEM_S, CALL_S, FLIGHT_S = 10.0, 20.0, 40.0


def free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def simulator(port: int, *arguments: str) -> Iterator[None]:
    command = [
        sys.executable,
        "-m",
        "sim_vehicle",
        "--url",
        f"udpout:127.0.0.1:{port}",
        "--no-table",
        *arguments,
    ]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        yield
    finally:
        process.terminate()
        _, errors = process.communicate(timeout=10)
        assert process.returncode == 0, errors


@contextmanager
def mavsdk_system(*arguments: str) -> Iterator[Any]:
    port = free_udp_port()
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    assert mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}") == ConnectionResult.SUCCESS
    try:
        with simulator(port, *arguments):
            system = mavsdk.first_autopilot(SYSTEM_S)
            assert system is not None
            yield system
    finally:
        mavsdk.destroy()


def finish(start: Callable[[Callable[..., None]], Any]) -> tuple[Any, ...]:
    """Begin something asynchronous; what its last callback says (0 and 1 are going on and done)."""
    said: queue.Queue[tuple[Any, ...]] = queue.Queue()
    start(lambda *values: said.put(values))
    while True:
        values = said.get(timeout=CALL_S)
        if values[0].name != "NEXT":
            return values


def until(condition: Callable[[], bool], limit_s: float) -> None:
    end = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end, f"not within {limit_s} s"
        time.sleep(0.05)


def hop(system: Any) -> None:
    """Up, down, disarmed."""
    action, telemetry = Action(system), Telemetry(system)
    telemetry.set_rate_position(5)
    telemetry.set_rate_health(5)
    telemetry.set_rate_in_air(5)
    until(lambda: telemetry.health_all_ok() and telemetry.health().is_armable, FLIGHT_S)
    action.set_takeoff_altitude(5.0)
    action.arm()
    action.takeoff()
    until(lambda: telemetry.position().relative_altitude_m > 4.0, FLIGHT_S)
    action.land()
    until(lambda: not telemetry.armed(), FLIGHT_S)


@pytest.mark.parametrize("personality", ["ardupilot", "px4"])
def test_mavsdk_lists_and_downloads_the_log_of_a_flight(personality: str, tmp_path: Path) -> None:
    with mavsdk_system("--speedup", "5", "--ready-s", "2", "--personality", personality) as system:
        hop(system)
        logs = LogFiles(system)
        result, entries = finish(lambda told: logs.get_entries_async(lambda *a: told(*a[:2])))
        assert result == LogFilesResult.SUCCESS
        assert len(entries) == 1
        path = tmp_path / "flight"
        done = finish(
            lambda told: logs.download_log_file_async(entries[0], str(path), lambda *a: told(*a[:2]))
        )
        assert done[0] == LogFilesResult.SUCCESS
        content = path.read_bytes()
        assert len(content) == entries[0].size_bytes > 5_000
        if personality == "ardupilot":
            reader = DFReader.DFReader_binary(str(path))
            heights = []
            while (message := reader.recv_match(type=["POS"])) is not None:
                heights.append(message.RelHomeAlt)
            reader.close()
            assert max(heights) > 4.0
        else:
            assert content.startswith(b"ULog")


@pytest.mark.parametrize("burst", [False, True])
def test_mavsdk_lists_reads_writes_and_compares_files(burst: bool, tmp_path: Path) -> None:
    with mavsdk_system("--personality", "px4", "--ready-s", "0") as system:
        ftp = Ftp(system)
        listed = finish(lambda told: ftp.list_directory_async("/etc/extras", lambda *a: told(*a[:2])))
        assert [entry.name for entry in listed[1].entries] == [
            "component_general.json.xz",
            "parameters.json.xz",
        ]
        remote = "/etc/extras/parameters.json.xz"
        told = finish(lambda told: ftp.download_async(remote, str(tmp_path), burst, lambda *a: told(*a[:2])))
        assert told[0] == FtpResult.SUCCESS
        local = tmp_path / "parameters.json.xz"
        assert ftp.are_files_identical(str(local), remote)
        ftp.create_directory("/fs/microsd/mine")
        done = finish(lambda told: ftp.upload_async(str(local), "/fs/microsd/mine", lambda *a: told(*a[:2])))
        assert done[0] == FtpResult.SUCCESS
        assert ftp.are_files_identical(str(local), "/fs/microsd/mine/parameters.json.xz")
        ftp.rename("/fs/microsd/mine/parameters.json.xz", "/fs/microsd/mine/other")
        ftp.remove_file("/fs/microsd/mine/other")
        ftp.remove_directory("/fs/microsd/mine")


def test_mavsdk_finds_the_parameter_metadata() -> None:
    with mavsdk_system("--personality", "px4", "--ready-s", "0") as system:
        metadata = ComponentMetadata(system)
        available: queue.Queue[Any] = queue.Queue()
        metadata.subscribe_metadata_available(lambda update, *_: available.put(update))
        metadata.request_autopilot_component()
        update = available.get(timeout=CALL_S)
        while update.type != MetadataType.PARAMETER:
            update = available.get(timeout=CALL_S)
        described = json.loads(update.json_metadata)
        assert "MIS_TAKEOFF_ALT" in {row["name"] for row in described["parameters"]}


def test_pymavlink_downloads_all_parameters_of_ardupilot_as_a_file(tmp_path: Path) -> None:
    port = free_udp_port()
    with simulator(port, "--ready-s", "0"):
        link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=255)
        try:
            assert link.wait_heartbeat(timeout=SYSTEM_S) is not None
            client = mavftp.MAVFTP(link, link.target_system, 1)
            values, defaults = tmp_path / "values.param", tmp_path / "defaults.param"
            client.cmd_getparams([str(values), str(defaults)])
            assert client.process_ftp_reply("getparams", timeout=CALL_S).error_code == mavftp.FtpError.Success
            assert "RTL_ALT,1500" in values.read_text()
            assert client.cmd_list(["/"]).error_code == mavftp.FtpError.Success
            assert {entry.name for entry in client.list_result} == {"@MISSION", "@PARAM", "APM"}
        finally:
            link.close()
