"""MAVSDK's public examples with a PX4 copter: mission, manual control, follow me."""

import contextlib
import threading
import time
from collections.abc import Iterator

import pytest
from mavsdk.plugins.follow_me import Config, FollowMe, TargetLocation
from mavsdk.plugins.manual_control import ManualControl
from mavsdk.plugins.telemetry import FlightMode
from mavsdk_peer import COPTERS, MavsdkPeer, connected
from station import LAT_DEG, LON_DEG

pytestmark = [pytest.mark.interop, pytest.mark.full]
SPEEDUP = 5
SITE = ("--home", f"{LAT_DEG},{LON_DEG},300", "--speedup", str(SPEEDUP))
STICK_INTERVAL_S = 0.1 / SPEEDUP


@pytest.fixture(scope="module")
def copters() -> Iterator[MavsdkPeer]:
    with connected(
        "--personality", "ardupilot:1,px4:3", *SITE, *COPTERS, "--param", "COM_RC_LOSS_T=5"
    ) as peer:
        yield peer


@contextlib.contextmanager
def sticks(control: ManualControl, held: list[float]) -> Iterator[None]:
    """Send the sticks `held` (x, y, z, r) until the end of the block; the block changes the list."""
    done = threading.Event()

    def send() -> None:
        while not done.is_set():
            control.set_manual_control_input(*held)
            time.sleep(STICK_INTERVAL_S)

    sender = threading.Thread(target=send)
    sender.start()
    try:
        yield
    finally:
        done.set()
        sender.join()


def test_a_joystick_takes_off_and_flies_in_position_control(copters: MavsdkPeer) -> None:
    vehicle = copters.take("px4")
    vehicle.ready()
    control, held = vehicle.plugin(ManualControl), [0.0, 0.0, 0.5, 0.0]
    with sticks(control, held):
        vehicle.in_mode(FlightMode.POSCTL)
        vehicle.action.arm()
        held[2] = 1.0
        vehicle.until(lambda: vehicle.height_m > 10, "climbed by the throttle")
        held[2] = 0.5
        control.start_position_control()
        held[0] = 1.0
        vehicle.until(lambda: vehicle.offset_m()[0] > 40, "flown north by the pitch stick")
        held[0] = 0.0
        vehicle.until(lambda: vehicle.ground_speed_m_s < 0.3, "stopped")
        vehicle.action.land()
        vehicle.disarmed()


def test_follow_me_flies_behind_its_target(copters: MavsdkPeer) -> None:
    vehicle = copters.take("px4")
    vehicle.take_off(10.0)
    follow = vehicle.plugin(FollowMe)
    follow.set_config(Config(12.0, 6.0, 0.5, Config.FollowAltitudeMode.CONSTANT, 8.0, 180.0))
    follow.start()
    vehicle.in_mode(FlightMode.FOLLOW_ME)
    for north_m in (20, 40):
        vehicle.until(follow.is_active, "follow me active")
        follow.set_target_location(TargetLocation(*vehicle.place_deg(north_m, 0), 300.0, 0.0, 0.0, 0.0))
        vehicle.until(lambda north_m=north_m: vehicle.near(north_m - 6, 0, 2), f"behind {north_m} m")
    assert vehicle.height_m == pytest.approx(12, abs=1)
    follow.stop()
    vehicle.in_mode(FlightMode.HOLD)
