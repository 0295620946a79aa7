"""Each number of a flight in wind against the true value: units, signs, frames, for both autopilots."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest
from px4_station import Px4Station
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import ALT_M, LAT_DEG, LON_DEG, Station, home_item, land, setpoint, station_of, takeoff, waypoint

from sim_vehicle.station.messages import command_long

NAN = math.nan
WIND_M_S, WIND_FROM_DEG = 6.0, 300.0
HEIGHT_M, GOAL_HEIGHT_M = 20.0, 40.0
GOAL_NORTH_M, GOAL_EAST_M = 150.0, -80.0
NORTH_M_DEG, EAST_M_DEG = 111_160.0, 77_410.0  # here, by the ellipsoid
GOAL_LAT_DEG, GOAL_LON_DEG = LAT_DEG + GOAL_NORTH_M / NORTH_M_DEG, LON_DEG + GOAL_EAST_M / EAST_M_DEG
CAPACITY_MAH = {"ardupilot": 3300.0, "px4": 5000.0}
POSITION_ONLY = 0x0DF8
GLOBAL_TARGET = mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT
LOCAL_TARGET = mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED


@dataclass
class TrueState:
    """The true state in SI units; positions are metres from the start."""

    north_m: float
    east_m: float
    height_m: float
    north_m_s: float
    east_m_s: float
    up_m_s: float
    used_j: float  # by the reported voltage and current
    used_mah: float
    throttle: float  # share, as reported
    ampere: float  # as reported
    remaining: float
    capacity_mah: float

    @property
    def course_deg(self) -> float:
        return math.degrees(math.atan2(self.east_m_s, self.north_m_s)) % 360

    @property
    def yaw_rad(self) -> float:
        return math.atan2(self.east_m_s, self.north_m_s)

    @property
    def speed_m_s(self) -> float:
        return math.hypot(self.north_m_s, self.east_m_s)

    @property
    def wind_m_s(self) -> tuple[float, float]:
        """The velocity of the air, north and east."""
        towards = math.radians(WIND_FROM_DEG + 180)
        return WIND_M_S * math.cos(towards), WIND_M_S * math.sin(towards)

    @property
    def airspeed_m_s(self) -> float:
        north, east = self.wind_m_s
        return math.hypot(self.north_m_s - north, self.east_m_s - east, self.up_m_s)

    @property
    def goal_m(self) -> float:
        return math.hypot(GOAL_NORTH_M - self.north_m, GOAL_EAST_M - self.east_m)

    @property
    def goal_deg(self) -> float:
        return math.degrees(math.atan2(GOAL_EAST_M - self.east_m, GOAL_NORTH_M - self.north_m))


def _station(personality: str, kind: str = "copter", wind_m_s: float = WIND_M_S) -> Station:
    make = Px4Station if personality == "px4" else station_of
    return make(kind, wind={"speed_m_s": wind_m_s, "from_deg": WIND_FROM_DEG})


def _place_m(station: Station) -> tuple[float, float, float]:
    truth = station.fleet.truth()
    north_m = (truth.lat_deg[0] - LAT_DEG) * NORTH_M_DEG
    return north_m, (truth.lon_deg[0] - LON_DEG) * EAST_M_DEG, float(truth.height_m[0])


class Flight:
    """A vehicle that flies in wind to a higher goal, and its reports."""

    def __init__(self, personality: str) -> None:
        self.station = station = _station(personality)
        station.stream(mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, hz=10)
        station.fly(HEIGHT_M)
        goal = (round(GOAL_LAT_DEG * 1e7), round(GOAL_LON_DEG * 1e7), ALT_M + GOAL_HEIGHT_M)
        assert station.command_int(mavlink.MAV_CMD_DO_REPOSITION, 0, *goal, -1, 1, 0, NAN) == 0
        station.wait(5.0)
        before_m = _place_m(station)
        station.wait(0.1)
        here_m = _place_m(station)
        north_m_s, east_m_s, up_m_s = (
            (now - before) / 0.1 for before, now in zip(before_m, here_m, strict=True)
        )
        batteries = station.of("BATTERY_STATUS")
        ampere = [m.current_battery / 100 for m in batteries]
        self.true_state = TrueState(
            *here_m,
            north_m_s,
            east_m_s,
            up_m_s,
            used_j=sum(m.voltages[0] / 1000 * a * 0.1 for m, a in zip(batteries, ampere, strict=True)),
            used_mah=sum(a * 0.1 / 3.6 for a in ampere),
            throttle=self.report("VFR_HUD").throttle / 100,
            ampere=ampere[-1],
            remaining=float(station.fleet.truth().battery_remaining[0]),
            capacity_mah=CAPACITY_MAH[personality],
        )

    def report(self, name: str) -> Any:
        return self.station.ask(getattr(mavlink, f"MAVLINK_MSG_ID_{name}"))


@pytest.fixture(scope="module")
def flights() -> dict[str, Flight]:
    return {personality: Flight(personality) for personality in BOTH}


Expected = Callable[[TrueState], float]
BOTH, ARDUPILOT, PX4 = ("ardupilot", "px4"), ("ardupilot",), ("px4",)
# message, field, expected value, tolerance, autopilot
ROWS: tuple[tuple[str, str, Expected, float, tuple[str, ...]], ...] = (
    ("GLOBAL_POSITION_INT", "lat", lambda f: (LAT_DEG + f.north_m / NORTH_M_DEG) * 1e7, 10, BOTH),
    ("GLOBAL_POSITION_INT", "lon", lambda f: (LON_DEG + f.east_m / EAST_M_DEG) * 1e7, 10, BOTH),
    ("GLOBAL_POSITION_INT", "alt", lambda f: (ALT_M + f.height_m) * 1000, 50, BOTH),
    ("GLOBAL_POSITION_INT", "relative_alt", lambda f: f.height_m * 1000, 50, BOTH),
    ("GLOBAL_POSITION_INT", "vx", lambda f: f.north_m_s * 100, 15, BOTH),
    ("GLOBAL_POSITION_INT", "vy", lambda f: f.east_m_s * 100, 15, BOTH),
    ("GLOBAL_POSITION_INT", "vz", lambda f: -f.up_m_s * 100, 15, BOTH),
    ("GLOBAL_POSITION_INT", "hdg", lambda f: f.course_deg * 100, 200, BOTH),
    ("LOCAL_POSITION_NED", "x", lambda f: f.north_m, 0.3, BOTH),
    ("LOCAL_POSITION_NED", "y", lambda f: f.east_m, 0.3, BOTH),
    ("LOCAL_POSITION_NED", "z", lambda f: -f.height_m, 0.1, BOTH),
    ("LOCAL_POSITION_NED", "vx", lambda f: f.north_m_s, 0.15, BOTH),
    ("LOCAL_POSITION_NED", "vy", lambda f: f.east_m_s, 0.15, BOTH),
    ("LOCAL_POSITION_NED", "vz", lambda f: -f.up_m_s, 0.15, BOTH),
    ("GPS_RAW_INT", "vel", lambda f: f.speed_m_s * 100, 15, BOTH),
    ("GPS_RAW_INT", "cog", lambda f: f.course_deg * 100, 200, BOTH),
    ("GPS_RAW_INT", "alt", lambda f: (ALT_M + f.height_m) * 1000, 500, BOTH),
    ("GPS_RAW_INT", "eph", lambda _f: 121, 0, BOTH),  # a dilution of 1.21
    ("GPS_RAW_INT", "h_acc", lambda _f: 1210, 0, BOTH),
    ("GPS_RAW_INT", "v_acc", lambda _f: 1936, 0, BOTH),
    ("GPS_RAW_INT", "fix_type", lambda _f: mavlink.GPS_FIX_TYPE_RTK_FIXED, 0, ARDUPILOT),
    ("GPS_RAW_INT", "fix_type", lambda _f: mavlink.GPS_FIX_TYPE_3D_FIX, 0, PX4),
    ("VFR_HUD", "groundspeed", lambda f: f.speed_m_s, 0.15, BOTH),
    ("VFR_HUD", "airspeed", lambda f: f.airspeed_m_s, 0.5, BOTH),
    ("VFR_HUD", "climb", lambda f: f.up_m_s, 0.15, BOTH),
    ("VFR_HUD", "alt", lambda f: ALT_M + f.height_m, 0.1, BOTH),
    ("VFR_HUD", "heading", lambda f: f.course_deg, 2, BOTH),
    ("ATTITUDE", "yaw", lambda f: f.yaw_rad, 0.03, BOTH),
    ("NAV_CONTROLLER_OUTPUT", "wp_dist", lambda f: f.goal_m, 1.1, BOTH),
    ("NAV_CONTROLLER_OUTPUT", "target_bearing", lambda f: f.goal_deg, 1.1, BOTH),
    ("NAV_CONTROLLER_OUTPUT", "nav_bearing", lambda f: f.goal_deg, 1.1, BOTH),
    ("NAV_CONTROLLER_OUTPUT", "alt_error", lambda f: GOAL_HEIGHT_M - f.height_m, 0.1, BOTH),
    ("BATTERY_STATUS", "current_consumed", lambda f: f.used_mah, 3, BOTH),
    ("BATTERY_STATUS", "energy_consumed", lambda f: f.used_j / 100, 2, ARDUPILOT),  # in units of 100 J
    ("BATTERY_STATUS", "energy_consumed", lambda _f: -1, 0, PX4),
    ("BATTERY_STATUS", "battery_remaining", lambda f: f.remaining * 100, 0.6, BOTH),
    ("BATTERY_STATUS", "time_remaining", lambda f: f.remaining * f.capacity_mah * 3.6 / f.ampere, 5, BOTH),
    ("SYS_STATUS", "battery_remaining", lambda f: f.remaining * 100, 0.6, BOTH),
    ("SYS_STATUS", "current_battery", lambda f: f.ampere * 100, 1, BOTH),
    ("WIND", "direction", lambda _f: WIND_FROM_DEG - 360, 0.1, ARDUPILOT),
    ("WIND", "speed", lambda _f: WIND_M_S, 0.01, ARDUPILOT),
    ("WIND", "speed_z", lambda _f: 0, 0.01, ARDUPILOT),
    ("WIND_COV", "wind_x", lambda f: f.wind_m_s[0], 0.01, PX4),
    ("WIND_COV", "wind_y", lambda f: f.wind_m_s[1], 0.01, PX4),
    ("SERVO_OUTPUT_RAW", "servo1_raw", lambda f: 1100 + 800 * f.throttle, 8, BOTH),
    ("SERVO_OUTPUT_RAW", "servo4_raw", lambda f: 1100 + 800 * f.throttle, 8, BOTH),
    ("ALTITUDE", "altitude_relative", lambda f: f.height_m, 0.1, PX4),
    ("ALTITUDE", "altitude_amsl", lambda f: ALT_M + f.height_m, 0.1, PX4),
    ("HIL_STATE_QUATERNION", "vx", lambda f: f.north_m_s * 100, 15, PX4),
    ("HIL_STATE_QUATERNION", "vz", lambda f: -f.up_m_s * 100, 15, PX4),
    ("POSITION_TARGET_GLOBAL_INT", "lat_int", lambda _f: GOAL_LAT_DEG * 1e7, 10, BOTH),
    ("POSITION_TARGET_GLOBAL_INT", "lon_int", lambda _f: GOAL_LON_DEG * 1e7, 10, BOTH),
    ("POSITION_TARGET_GLOBAL_INT", "alt", lambda _f: ALT_M + GOAL_HEIGHT_M, 0.01, BOTH),
    ("POSITION_TARGET_GLOBAL_INT", "coordinate_frame", lambda _f: mavlink.MAV_FRAME_GLOBAL, 0, ARDUPILOT),
    ("POSITION_TARGET_GLOBAL_INT", "coordinate_frame", lambda _f: mavlink.MAV_FRAME_GLOBAL_INT, 0, PX4),
    ("POSITION_TARGET_GLOBAL_INT", "type_mask", lambda _f: 0xFDF8, 0, ARDUPILOT),
    ("POSITION_TARGET_GLOBAL_INT", "type_mask", lambda _f: 0, 0, PX4),
    ("POSITION_TARGET_GLOBAL_INT", "vx", lambda _f: 0, 0, ARDUPILOT),
    ("POSITION_TARGET_GLOBAL_INT", "vx", lambda f: f.north_m_s, 0.15, PX4),
    ("POSITION_TARGET_GLOBAL_INT", "vz", lambda f: -f.up_m_s, 0.15, PX4),
    ("POSITION_TARGET_GLOBAL_INT", "yaw", lambda f: f.yaw_rad, 0.03, PX4),
    ("POSITION_TARGET_LOCAL_NED", "coordinate_frame", lambda _f: mavlink.MAV_FRAME_LOCAL_NED, 0, BOTH),
    ("POSITION_TARGET_LOCAL_NED", "type_mask", lambda _f: POSITION_ONLY, 0, ARDUPILOT),
    ("POSITION_TARGET_LOCAL_NED", "type_mask", lambda _f: 0, 0, PX4),
    ("POSITION_TARGET_LOCAL_NED", "x", lambda _f: GOAL_NORTH_M, 0.3, BOTH),
    ("POSITION_TARGET_LOCAL_NED", "y", lambda _f: GOAL_EAST_M, 0.3, BOTH),
    ("POSITION_TARGET_LOCAL_NED", "z", lambda _f: -GOAL_HEIGHT_M, 0.1, BOTH),
    ("POSITION_TARGET_LOCAL_NED", "vy", lambda _f: 0, 0, ARDUPILOT),
    ("POSITION_TARGET_LOCAL_NED", "vy", lambda f: f.east_m_s, 0.15, PX4),
)


@pytest.mark.parametrize(
    ("message", "field", "expected", "near", "personality"),
    [
        pytest.param(*row[:4], personality, id=f"{row[0]}.{row[1]}-{personality}")
        for row in ROWS
        for personality in row[4]
    ],
)
def test_a_field_equals_the_true_value(
    flights: dict[str, Flight], message: str, field: str, expected: Expected, near: float, personality: str
) -> None:
    flight = flights[personality]
    assert getattr(flight.report(message), field) == pytest.approx(expected(flight.true_state), abs=near)


@pytest.mark.parametrize("personality", BOTH)
def test_values_of_the_flight_distinguish_signs_and_units(
    flights: dict[str, Flight], personality: str
) -> None:
    true_state = flights[personality].true_state
    assert true_state.north_m_s > 2
    assert true_state.east_m_s < -1
    assert true_state.up_m_s > 0.5
    assert 20 < true_state.goal_m < 160
    assert true_state.throttle > 0.1
    assert true_state.used_j > 1000


# -- reports of targets -----------------------------------------------------------------------------------


def _reports(station: Station, message_id: int) -> bool:
    replies = station.send(command_long((1, 0), mavlink.MAV_CMD_REQUEST_MESSAGE, message_id))
    return any(m.get_msgId() == message_id for m in replies)


@pytest.mark.parametrize("personality", BOTH)
def test_a_vehicle_on_the_ground_reports_no_target(personality: str) -> None:
    station = _station(personality)
    station.wait(1)
    assert not _reports(station, GLOBAL_TARGET)
    assert not _reports(station, LOCAL_TARGET)
    if personality == "ardupilot":
        assert station.set_mode("GUIDED") == 0  # GUIDED begins with a velocity of 0
        assert not _reports(station, GLOBAL_TARGET)
        target = station.ask(LOCAL_TARGET)
        assert (target.type_mask, target.x, target.y, target.z, target.vx) == (0x0C07, 0, 0, 0, 0)


def test_ardupilot_reports_a_target_in_modes_with_a_target() -> None:
    station = _station("ardupilot")
    station.fly_mission([takeoff(), waypoint(60, 0), land(60, 0)])
    station.wait(2)
    assert not _reports(station, GLOBAL_TARGET)  # during take-off
    station.until(lambda: station.speed_m_s > 3, 60)
    assert station.ask(GLOBAL_TARGET).lat_int == pytest.approx((LAT_DEG + 60 / NORTH_M_DEG) * 1e7, abs=30)
    assert not _reports(station, LOCAL_TARGET)
    assert station.set_mode("BRAKE") == 0  # BRAKE
    assert not _reports(station, GLOBAL_TARGET)
    assert station.set_mode("RTL") == 0  # RTL
    station.wait(5)
    assert station.ask(GLOBAL_TARGET).lat_int == pytest.approx(LAT_DEG * 1e7, abs=30)
    station.until(lambda: station.height_m < 5, 120)
    assert not _reports(station, GLOBAL_TARGET)  # during landing


@pytest.mark.parametrize("personality", BOTH)
def test_a_velocity_setpoint_is_the_local_target(personality: str) -> None:
    station = _station(personality)
    station.fly(HEIGHT_M)
    order = setpoint(velocity=(3.0, -2.0, -0.5))
    station.send(order)
    if personality == "px4":
        assert station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6) == 0  # Offboard
    station.send(order)
    station.wait(0.4)
    target = station.ask(LOCAL_TARGET)
    assert (target.vx, target.vy, target.vz) == (3.0, -2.0, -0.5)
    if personality == "px4":
        assert target.type_mask == 0x0007
        assert all(map(math.isnan, (target.x, target.y, target.z)))
    else:
        assert (target.type_mask, target.x, target.y, target.z) == (0x0C07, 0, 0, 0)
    assert not _reports(station, GLOBAL_TARGET)


def test_px4_reports_the_position_of_its_hold() -> None:
    station = _station("px4")
    station.fly(HEIGHT_M)
    station.wait(10)
    target = station.ask(GLOBAL_TARGET)
    assert target.alt == pytest.approx(ALT_M + HEIGHT_M, abs=0.5)
    assert target.lat_int == pytest.approx(LAT_DEG * 1e7, abs=100)


@pytest.mark.parametrize(("personality", "mask"), [("ardupilot", None), ("px4", POSITION_ONLY)])
def test_a_plane_reports_its_next_position(personality: str, mask: int | None) -> None:
    station = _station(personality, "plane", wind_m_s=0.0)
    assert not _reports(station, GLOBAL_TARGET)  # in MANUAL, or on the ground
    if personality == "ardupilot":
        station.fly_plane_mission([home_item(), takeoff(40), waypoint(500, 0, 40)])
    else:
        assert station.arm() == 0
        assert station.command(mavlink.MAV_CMD_NAV_TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, ALT_M + 40) == 0
    station.until(lambda: station.height_m > 20, 60)
    assert station.ask(GLOBAL_TARGET).alt > ALT_M + 20
    assert _reports(station, LOCAL_TARGET) == (mask is not None)
    if mask is not None:
        target = station.ask(LOCAL_TARGET)
        assert target.type_mask == mask
        assert all(map(math.isnan, (target.vx, target.yaw)))
