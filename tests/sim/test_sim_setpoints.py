"""Set-points that tilt the vehicle: attitudes, body rates and accelerations, on both autopilots."""

import math
from collections.abc import Callable
from typing import Any

import pytest
from px4_station import QuietPx4Station
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import Station, setpoint

ATTITUDE = mavlink.MAVLINK_MSG_ID_ATTITUDE
HOVER = 0.5
WITHOUT_RATES, WITHOUT_ATTITUDE = 0x07, 0x80
IDENTITY = (1.0, 0.0, 0.0, 0.0)


def attitude(roll_deg: float, pitch_deg: float, yaw_deg: float, thrust: float = HOVER) -> Any:
    roll, pitch, yaw = (math.radians(angle) / 2 for angle in (roll_deg, pitch_deg, yaw_deg))
    (cr, cp, cy), (sr, sp, sy) = map(math.cos, (roll, pitch, yaw)), map(math.sin, (roll, pitch, yaw))
    q = (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
    return mavlink.MAVLink_set_attitude_target_message(0, 1, 1, WITHOUT_RATES, q, 0, 0, 0, thrust)


def rates(roll: float, pitch: float, yaw: float) -> Any:
    """Body rates [deg/s]."""
    wanted = (math.radians(rate) for rate in (roll, pitch, yaw))
    return mavlink.MAVLink_set_attitude_target_message(0, 1, 1, WITHOUT_ATTITUDE, IDENTITY, *wanted, HOVER)


def acceleration(north: float, east: float, down: float) -> Any:
    return setpoint(acceleration=(north, east, down))


def ardupilot() -> Station:
    station = Station()
    station.fly(30)
    return station


def px4() -> Station:
    station = QuietPx4Station()
    station.fly(30)
    station.hold(acceleration(0, 0, 0), 1)
    assert station.set_mode("Offboard") == 0
    return station


BOTH = pytest.mark.parametrize("flying", [ardupilot, px4])


@BOTH
def test_an_attitude_accelerates_a_copter_by_its_tilt(flying: Callable[[], Station]) -> None:
    station = flying()
    station.hold(attitude(0, 0, 0), 4)
    station.hold(attitude(0, -10, 0), 3)
    shown = station.ask(ATTITUDE)
    assert math.degrees(shown.pitch) == pytest.approx(-10, abs=0.5)
    assert math.degrees(shown.roll) == pytest.approx(0, abs=0.5)
    north_m_s, east_m_s, _ = station.velocity_m_s
    # g tan(10 deg) for 3 s, less the drag of the air
    assert 4.0 < north_m_s < 3 * 9.81 * math.tan(math.radians(10))
    assert abs(east_m_s) < 0.2
    assert station.height_m == pytest.approx(30, abs=0.5)


@BOTH
def test_a_roll_pushes_to_the_right_of_the_heading(flying: Callable[[], Station]) -> None:
    station = flying()
    station.hold(attitude(0, 0, 90), 4)
    station.hold(attitude(15, 0, 90), 2)
    position = station.ask(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
    assert position.hdg / 100 == pytest.approx(90, abs=1)
    assert position.vx / 100 < -3
    assert abs(position.vy) < 30


@BOTH
def test_thrust_above_hovering_climbs_and_below_sinks(flying: Callable[[], Station]) -> None:
    station = flying()
    station.hold(attitude(0, 0, 0, 0.75), 4)
    high_m = station.height_m
    assert high_m > 33
    station.hold(attitude(0, 0, 0, 0.25), 6)
    assert station.height_m < high_m - 1


@BOTH
def test_body_rates_turn_and_tilt_the_vehicle(flying: Callable[[], Station]) -> None:
    station = flying()
    station.hold(attitude(0, 0, 0), 4)
    station.hold(rates(0, 0, 30), 2)
    assert math.degrees(station.ask(ATTITUDE).yaw) == pytest.approx(60, abs=6)
    station.hold(rates(10, 0, 0), 1.5)
    shown = station.ask(ATTITUDE)
    assert math.degrees(shown.roll) == pytest.approx(14, abs=2.5)
    assert math.degrees(shown.yaw) == pytest.approx(60, abs=8)


@BOTH
def test_an_acceleration_is_flown(flying: Callable[[], Station]) -> None:
    station = flying()
    station.hold(attitude(0, 0, 0), 4)
    station.hold(acceleration(0, 1.5, 0), 2)
    north_m_s, east_m_s, _ = station.velocity_m_s
    assert (north_m_s, east_m_s) == (pytest.approx(0, abs=0.2), pytest.approx(3.0, abs=0.4))
    station.hold(acceleration(0, 0, -0.5), 2)
    assert station.velocity_m_s[2] == pytest.approx(1.0, abs=0.3)


def test_a_vehicle_stops_after_its_last_attitude_setpoint() -> None:
    station = ardupilot()
    station.hold(attitude(0, -10, 0), 3)
    station.wait(12)
    assert math.hypot(*station.velocity_m_s[:2]) < 0.2


@pytest.mark.parametrize(
    "message",
    [
        mavlink.MAVLink_set_attitude_target_message(0, 1, 1, WITHOUT_RATES, [math.nan] * 4, 0, 0, 0, HOVER),
        mavlink.MAVLink_set_attitude_target_message(0, 1, 1, WITHOUT_RATES, [0.0] * 4, 0, 0, 0, HOVER),
        mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 0x87, IDENTITY, 1, 1, 1, HOVER),
        mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 0x80, IDENTITY, math.inf, 0, 0, HOVER),
        acceleration(math.nan, 0, 0),
    ],
)
def test_an_invalid_setpoint_changes_nothing(message: Any) -> None:
    station = ardupilot()
    before = station.fleet.truth()
    station.hold(message, 2)
    after = station.fleet.truth()
    assert abs(after.lat_deg[0] - before.lat_deg[0]) < 1e-6
    assert after.height_m[0] == pytest.approx(before.height_m[0], abs=0.3)
    assert station.mode == "GUIDED"


def test_a_plane_turns_toward_its_roll() -> None:
    """A roll to the right turns a plane to the right."""
    station = QuietPx4Station("plane")
    assert station.arm() == 0
    assert station.command(mavlink.MAV_CMD_NAV_TAKEOFF, *[math.nan] * 6, 360) == 0
    station.until(lambda: station.mode == "Hold", 120)
    station.hold(acceleration(0, 0, 0), 1)
    assert station.set_mode("Offboard") == 0
    before = station.ask(ATTITUDE).yaw
    station.hold(attitude(25, 0, math.degrees(before)), 3)
    turned = (station.ask(ATTITUDE).yaw - before + math.pi) % (2 * math.pi) - math.pi
    assert math.degrees(turned) > 20
