"""pymavlink's connection, log tools and signing with `python -m sim_vehicle`."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil, mavwp
from simulator_process import LIMIT_S, free_tcp_port, line, simulator

pytestmark = pytest.mark.interop
PLAN = [(16, 0, 0.0, 0.0, 300.0), (22, 3, 0.0, 0.0, 20.0), (16, 3, 46.0494, 14.5062, 20.0), (20, 3, 0, 0, 0)]


@contextmanager
def connected(device: str) -> Iterator[Any]:
    connection = mavutil.mavlink_connection(device, source_system=255, dialect="ardupilotmega")
    try:
        yield connection
    finally:
        connection.close()


def until(connection: Any, kind: str, condition: Callable[[Any], bool]) -> Any:
    end_s = time.monotonic() + LIMIT_S
    while True:
        left_s = end_s - time.monotonic()
        message = connection.recv_match(type=kind, blocking=True, timeout=max(left_s, 0.01))
        assert message is not None, f"no {kind} as wanted within {LIMIT_S} s"
        if condition(message):
            return message


def tool(name: str, *arguments: str) -> str:
    command = [sys.executable, str(Path(sys.executable).with_name(name)), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def upload(connection: Any) -> None:
    connection.mav.mission_count_send(1, 1, len(PLAN))
    for expected, (command, frame, lat_deg, lon_deg, z) in enumerate(PLAN):
        request = until(connection, "MISSION_REQUEST", lambda m: True)
        assert request.seq == expected
        x, y = round(lat_deg * 1e7), round(lon_deg * 1e7)
        connection.mav.mission_item_int_send(1, 1, expected, frame, command, 0, 1, 0, 0, 0, 0, x, y, z)
    assert until(connection, "MISSION_ACK", lambda m: True).type == 0


def download(connection: Any) -> list[int]:
    connection.mav.mission_request_list_send(1, 1)
    count = until(connection, "MISSION_COUNT", lambda m: True).count
    commands = []
    for seq in range(count):
        connection.mav.mission_request_int_send(1, 1, seq)
        commands.append(until(connection, "MISSION_ITEM_INT", lambda m, seq=seq: m.seq == seq).command)
    connection.mav.mission_ack_send(1, 1, 0)
    return commands


def test_mavutil_flies_a_copter_and_the_log_tools_read_its_log(tmp_path: Path) -> None:
    port = free_tcp_port()
    # Down in a hurry: by default the last ten metres alone take twenty seconds.
    brisk = ("--param", "LAND_SPEED=150", "--param", "RTL_LOIT_TIME=0", "--param", "DISARM_DELAY=0")
    more = ("--speedup", "25", *brisk, "--url", f"tcpin:127.0.0.1:{port}", "--tlog", str(tmp_path))
    with simulator(*more) as process:
        assert line(process)
        with connected(f"tcp:127.0.0.1:{port}") as vehicle:
            assert vehicle.wait_heartbeat(timeout=LIMIT_S) is not None
            assert vehicle.target_system == 1
            assert vehicle.mode_mapping()["GUIDED"] == 4
            vehicle.param_fetch_one("RTL_ALT")
            assert until(vehicle, "PARAM_VALUE", lambda m: m.param_id == "RTL_ALT").param_value == 1500
            upload(vehicle)
            assert download(vehicle) == [command for command, *_ in PLAN]
            vehicle.set_mode_apm("GUIDED")
            until(vehicle, "HEARTBEAT", lambda m: mavutil.mode_string_v10(m) == "GUIDED")
            vehicle.arducopter_arm()
            until(vehicle, "HEARTBEAT", lambda m: vehicle.motors_armed())
            vehicle.mav.command_long_send(1, 1, 300, 0, 0, 0, 0, 0, 0, 0, 0)
            until(vehicle, "HEARTBEAT", lambda m: vehicle.flightmode == "AUTO")
            until(vehicle, "MISSION_ITEM_REACHED", lambda m: m.seq == 2)
            until(vehicle, "HEARTBEAT", lambda m: not vehicle.motors_armed())
    (log,) = map(str, tmp_path.glob("*.tlog"))
    beats = tool("mavlogdump.py", "--types", "HEARTBEAT", log)
    assert beats.count("custom_mode : 3") > 5
    assert beats.count("autopilot : 3") == len(beats.splitlines())
    assert "AUTO" in tool("mavflightmodes.py", log)
    plan = tmp_path / "plan.txt"
    tool("mavmission.py", "--output", str(plan), log)
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(plan)) == len(PLAN)
    assert [loader.wp(i).command for i in range(len(PLAN))] == [command for command, *_ in PLAN]
