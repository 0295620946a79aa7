"""MAVProxy, scripted, flies `python -m sim_vehicle` over loopback."""

import math
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from mavproxy_process import LIMIT_S, MAVProxy, mavproxy
from simulator_process import free_tcp_port, line, simulator

pytestmark = pytest.mark.interop

ANSWER_S = 2.0
# Down in a hurry: by default the last ten metres alone take twenty seconds.
BRISK = (
    "--param", "LAND_SPEED=150", "--param", "WPNAV_SPEED_DN=300", "--param", "RTL_LOIT_TIME=0",
    "--param", "DISARM_DELAY=0",
)  # fmt: skip
PLAN = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t46.049\t14.506\t300\t1
1\t0\t3\t22\t0\t0\t0\t0\t0\t0\t20\t1
2\t0\t3\t16\t0\t0\t0\t0\t46.0495\t14.5065\t20.3\t1
3\t0\t3\t21\t0\t0\t0\t0\t46.0495\t14.5065\t0\t1
"""
FENCE = """QGC WPL 110
0\t0\t3\t5001\t4\t0\t0\t0\t46.048\t14.505\t0\t1
1\t0\t3\t5001\t4\t0\t0\t0\t46.050\t14.505\t0\t1
2\t0\t3\t5001\t4\t0\t0\t0\t46.050\t14.507\t0\t1
3\t0\t3\t5001\t4\t0\t0\t0\t46.048\t14.507\t0\t1
"""


def test_mavproxy_sets_up_and_flies_an_ardupilot_copter(tmp_path: Path) -> None:
    port = free_tcp_port()
    (tmp_path / "plan.txt").write_text(PLAN)
    (tmp_path / "fence.txt").write_text(FENCE)
    with simulator("--speedup", "10", "--url", f"tcpin:127.0.0.1:{port}", *BRISK) as process:
        assert line(process)
        with mavproxy(f"tcp:127.0.0.1:{port}", tmp_path) as proxy:
            proxy.expect(r"online system 1")
            proxy.expect(r"Mode STABILIZE")
            proxy.expect(r"AP: ArduCopter V4\.6")
            count = int(proxy.expect(r"Received (\d+) parameters")[1])
            assert count > 50
            proxy.ask("param show WPNAV_SPEED", r"WPNAV_SPEED +1000\.0")
            proxy.command("param set WPNAV_SPEED 700")
            asked(proxy, "param fetch WPNAV_SPEED", r"WPNAV_SPEED = ([\d.]+)", lambda value: value == 700)

            proxy.ask("wp load plan.txt", r"Sent all 4 waypoints")
            proxy.expect(r"TYPE_MISSION: ACCEPTED")
            proxy.ask("wp list", r"Requesting 4 waypoints")
            proxy.expect(r"^22 3 .* 20\.000000 p1")
            proxy.expect(r"^16 3 46\.0495000000 14\.5065000000 20\.29\d* p1")  # truncated to centimetres
            proxy.expect(r"Saved 4 waypoints")

            proxy.ask("fence load fence.txt", r"Sent all 4 fence items")
            proxy.expect(r"TYPE_FENCE: ACCEPTED")
            proxy.ask("fence list", r"Requesting 4 fence items")
            for corner in (r"46\.048\d* 14\.505", r"46\.050\d* 14\.505", r"46\.050\d* 14\.507"):
                proxy.expect(rf"^5001 0 {corner}")
            proxy.ask("fence enable", r"DO_FENCE_ENABLE: ACCEPTED")

            # MAVProxy's prompt shows every mode; its announcements are limited to one in 2 s.
            proxy.ask("mode GUIDED", r"GUIDED> ")
            proxy.ask("arm throttle", r"\bARMED")
            proxy.ask("takeoff 15", r"NAV_TAKEOFF: ACCEPTED")
            height = r"GLOBAL_POSITION_INT .*relative_alt : (-?\d+)"
            asked(proxy, "status GLOBAL_POSITION_INT", height, lambda value: value > 14_500)
            proxy.ask("rtl", r"RTL> ")
            proxy.expect(r"\bDISARMED")


def asked(proxy: MAVProxy, command: str, pattern: str, condition: Callable[[float], bool]) -> None:
    """Request a number until it has the expected value; early answers may be missing."""
    end_s = time.monotonic() + LIMIT_S
    value = math.nan
    while not condition(value):
        assert time.monotonic() < end_s, f"{command}: still {value} after {LIMIT_S} s"
        proxy.command(command)
        found = proxy.look(pattern, ANSWER_S)
        value = math.nan if found is None else float(found[1])
