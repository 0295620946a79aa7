"""Set-points of position and velocity: what each autopilot accepts, and how its copter follows."""

import math
from typing import Any

import pytest
from px4_station import QuietPx4Station
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import (
    ALT_M,
    BODY,
    BODY_FRD,
    BODY_OFFSET,
    LAT_DEG,
    LON_DEG,
    NONE,
    OFFSET,
    Station,
    place_m,
    setpoint,
)

RELATIVE, ABSOLUTE = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, mavlink.MAV_FRAME_GLOBAL_INT
FLOAT_RELATIVE, TERRAIN = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT
LOCAL_TARGET = mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED


def flying(autopilot: str, **params: float) -> Station:
    """Return a station whose copter hovers 30 m above home and obeys set-points."""
    station = Station() if autopilot == "ardupilot" else QuietPx4Station(params=params)
    station.fly(30)
    if autopilot == "px4":
        station.hold(setpoint(velocity=(0, 0, 0)), 0.5)
        assert station.set_mode("Offboard") == 0
        station.hold(setpoint(velocity=(0, 0, 0)), 3)
    return station


def motion(station: Station) -> Any:
    """Return LOCAL_POSITION_NED."""
    return station.ask(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED)


# -- following -----------------------------------------------------------------------------------------------


def lag_m(station: Station, hz: float, *, with_velocity: bool) -> float:
    """Return how far the copter is behind a leader that accelerates north to 10 m/s, after 30 s."""
    start, began_s = motion(station).x, station.now

    def leader() -> tuple[float, float]:
        t = station.now - began_s
        return (start + t * t, 2 * t) if t < 5 else (start + 25 + 10 * (t - 5), 10.0)

    for _ in range(round(30 * hz)):
        north_m, speed_m_s = leader()
        velocity = (speed_m_s, 0, 0) if with_velocity else NONE
        station.send(setpoint((north_m, 0, -30), velocity))
        station.wait(1 / hz)
    return leader()[0] - motion(station).x


@pytest.mark.parametrize(
    ("autopilot", "hz", "with_velocity", "expected_m"),
    [
        # ArduPilot moves the target on between two set-points; its velocity toward a resting target is the
        # root sqrt(2 a (d - a / 2)) with half of the acceleration of 2.5 m/s^2, so 40.6 m at 10 m/s
        ("ardupilot", 10, True, 0.0),
        ("ardupilot", 5, True, 0.0),
        ("ardupilot", 10, False, 40.6),
        # PX4 holds the target still: with 0.95 m/s per m it is 10 / 0.95 m behind without a velocity, and
        # on average half of an interval behind with one
        ("px4", 10, True, 0.5),
        ("px4", 5, True, 1.0),
        ("px4", 10, False, 10 / 0.95 + 0.5),
    ],
)
def test_a_follower_at_10_m_s_is_as_far_behind_as_its_position_control_says(
    autopilot: str, hz: float, with_velocity: bool, expected_m: float
) -> None:
    station = flying(autopilot)
    assert lag_m(station, hz, with_velocity=with_velocity) == pytest.approx(expected_m, abs=0.7)
    assert motion(station).vx == pytest.approx(10, abs=0.2)


def test_ardupilot_limits_acceleration_and_jerk() -> None:
    """2.5 m/s^2 and 5 m/s^3: after t < 0.5 s the speed is 2.5 t^2, after 1.5 s 0.625 + 2.5 * 1."""
    station = flying("ardupilot")
    station.hold(setpoint(velocity=(8, 0, 0)), 0.3)
    assert motion(station).vx == pytest.approx(2.5 * 0.3**2, abs=0.1)
    station.hold(setpoint(velocity=(8, 0, 0)), 1.2)
    assert motion(station).vx == pytest.approx(0.625 + 2.5, abs=0.2)


def test_px4_limits_the_tilt_only_and_the_speed_with_its_feed_forward() -> None:
    """The difference of velocity gives 1.8 times the acceleration; MPC_XY_VEL_MAX is 12 m/s."""
    station = flying("px4")
    station.hold(setpoint(velocity=(4, 0, 0)), 0.5)
    assert motion(station).vx == pytest.approx(4 * (1 - math.exp(-1.8 * 0.5)), abs=0.25)
    station.hold(setpoint(velocity=(20, 0, -9)), 10)
    assert motion(station).vx == pytest.approx(12, abs=0.2)
    assert motion(station).vz == pytest.approx(-3, abs=0.1)


def test_an_acceleration_ahead_of_the_velocity_shortens_the_way_to_a_speed() -> None:
    """A leader on a circle of 40 m at 8 m/s: with its acceleration the follower keeps to the circle."""

    def error_m(*, with_acceleration: bool) -> float:
        station = flying("ardupilot")
        began_s, worst_m = station.now, 0.0
        for step in range(400):
            angle = (station.now - began_s) * 8 / 40
            sin, cos = math.sin(angle), math.cos(angle)
            push = (-1.6 * cos, -1.6 * sin, 0) if with_acceleration else NONE
            station.send(setpoint((40 * cos - 40, 40 * sin, -30), (-8 * sin, 8 * cos, 0), push))
            here = motion(station)
            if step > 300:
                worst_m = max(worst_m, math.hypot(here.x - 40 * cos + 40, here.y - 40 * sin))
            station.wait(0.1)
        return worst_m

    assert error_m(with_acceleration=True) < 0.4
    assert error_m(with_acceleration=False) > 0.8


# -- frames --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("autopilot", "frame", "moved"),
    [
        ("ardupilot", OFFSET, (9, 0)),
        ("ardupilot", BODY, (0, 9)),
        ("ardupilot", BODY_OFFSET, (0, 9)),
        ("px4", OFFSET, (0, 0)),
        ("px4", BODY, (0, 9)),
        ("px4", BODY_OFFSET, (0, 0)),
    ],
)
def test_a_velocity_is_flown_in_the_frames_of_the_firmware(
    autopilot: str, frame: int, moved: tuple[float, float]
) -> None:
    station = flying(autopilot, COM_OF_LOSS_T=60.0)
    station.hold(setpoint(velocity=(0, 0, 0), yaw=math.pi / 2), 4)  # to the east
    before = place_m(station)
    station.hold(setpoint(velocity=(3, 0, 0), frame=frame), 4)
    north_m, east_m = (now - then for now, then in zip(place_m(station), before, strict=True))
    assert (north_m, east_m) == pytest.approx(moved, abs=2.5)


@pytest.mark.parametrize(
    ("autopilot", "frame", "flies"),
    [
        ("ardupilot", RELATIVE, True),
        ("ardupilot", ABSOLUTE, True),
        ("ardupilot", FLOAT_RELATIVE, True),
        ("ardupilot", TERRAIN, False),  # with a velocity
        ("px4", RELATIVE, True),
        ("px4", ABSOLUTE, True),
        ("px4", TERRAIN, True),
        ("px4", FLOAT_RELATIVE, False),
    ],
)
def test_a_global_position_with_a_velocity_is_flown_in_the_frames_of_the_firmware(
    autopilot: str, frame: int, flies: bool
) -> None:
    station = flying(autopilot, COM_OF_LOSS_T=60.0)
    place = round((LAT_DEG + 10 / 111_195) * 1e7), round(LON_DEG * 1e7)
    up_m = ALT_M + 30 if frame == ABSOLUTE else 30
    station.hold(setpoint((*place, up_m), (0, 0, 0), frame=frame), 10)
    assert place_m(station)[0] == pytest.approx(10 if flies else 0, abs=1)


# -- type masks ----------------------------------------------------------------------------------------------

THERE = (12, 0, -30)


@pytest.mark.parametrize(
    ("autopilot", "message", "north_m"),
    [
        ("ardupilot", setpoint(THERE), 12),
        ("ardupilot", setpoint(THERE, acceleration=(0, 0, 0)), 0),
        ("ardupilot", setpoint((12, 0, None)), 0),
        ("ardupilot", setpoint((12, 0, None), (0, 2, 0)), 0),
        ("ardupilot", setpoint(yaw=1.0), 0),
        ("ardupilot", setpoint(THERE, (0, 0, 0), (0, 0, 0), force=True), 0),
        ("ardupilot", setpoint(THERE, (math.nan, 0, 0)), 0),
        ("ardupilot", setpoint(THERE, (1001.0, 0, 0)), 0),
        ("px4", setpoint(THERE), 12),
        ("px4", setpoint(THERE, acceleration=(0, 0, 0)), 12),
        ("px4", setpoint((12, 0, None), (None, None, 0)), 12),
        ("px4", setpoint((12, 0, None)), 0),
        ("px4", setpoint((12, None, -30), (None, 0, None)), 0),
        ("px4", setpoint(THERE, (math.nan, math.nan, math.nan)), 12),
    ],
)
def test_the_type_mask_decides_what_is_flown(autopilot: str, message: Any, north_m: float) -> None:
    station = flying(autopilot, COM_OF_LOSS_T=60.0)
    station.hold(message, 10)
    assert place_m(station)[0] == pytest.approx(north_m, abs=0.6)


def test_ardupilot_stops_at_a_set_point_that_it_cannot_use() -> None:
    station = flying("ardupilot")
    station.hold(setpoint(velocity=(5, 0, 0)), 4)
    station.send(setpoint(velocity=(5, 0, 0), frame=BODY_FRD))
    station.wait(2.5)  # less than GUID_TIMEOUT
    assert motion(station).vx < 1


def test_px4_names_a_set_point_that_it_does_not_know() -> None:
    station = flying("px4")
    before = len(station.of("STATUSTEXT"))
    station.send(setpoint(velocity=(1, 0, 0), frame=BODY_OFFSET))
    station.send(setpoint(yaw=1.0))
    station.wait(0.5)
    texts = "".join(message.text for message in station.of("STATUSTEXT")[before:])  # in pieces of 50
    assert "coordinate frame 9 unsupported" in texts
    assert "SET_POSITION_TARGET_LOCAL_NED invalid" in texts


# -- yaw -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("autopilot", "yaw_deg"), [("ardupilot", 90), ("px4", 0)])
def test_without_a_yaw_ardupilot_faces_its_course_and_px4_keeps_its_heading(
    autopilot: str, yaw_deg: float
) -> None:
    station = flying(autopilot)
    station.hold(setpoint(velocity=(0, 4, 0)), 5)
    yaw_rad = station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE).yaw
    assert math.degrees(yaw_rad) == pytest.approx(yaw_deg, abs=3)


# -- the end of set-points -----------------------------------------------------------------------------------


def test_ardupilot_keeps_on_for_guid_timeout_then_stays_where_the_target_was() -> None:
    station = flying("ardupilot")
    station.hold(setpoint((0, 0, -30), (0, 0, 0)), 1)
    for step in range(100):
        station.send(setpoint((0.3 * step, 0, -30), (3, 0, 0)))
        station.wait(0.1)
    station.wait(2.5)
    assert motion(station).vx == pytest.approx(3, abs=0.1)
    station.wait(15)
    assert station.mode == "GUIDED"
    # the last target, and 3 s with 3 m/s
    assert motion(station).x == pytest.approx(0.3 * 99 + 9, abs=0.7)


def test_px4_without_manual_control_sinks_in_the_position_mode_after_lost_set_points() -> None:
    """PX4 1.15.3 in software sank at 0.7 m/s (MPC_LAND_SPEED), and did not brake."""
    station = flying("px4", COM_OBL_RC_ACT=0)
    station.hold(setpoint(velocity=(3, 0, 0)), 4)
    station.until(lambda: station.mode == "Position", 3)
    station.wait(3)
    before_m = station.height_m
    station.wait(5)
    assert before_m - station.height_m == pytest.approx(5 * 0.7, abs=0.3)
    assert motion(station).vx > 1
    assert station.mode == "Position"


def test_px4_does_not_return_to_offboard_after_a_chosen_mode() -> None:
    station = flying("px4", COM_OBL_RC_ACT=5)
    station.wait(3)
    assert station.mode == "Hold"
    assert station.set_mode("Hold") == 0
    station.hold(setpoint(velocity=(2, 0, 0)), 3)
    assert station.mode == "Hold"
    assert motion(station).vx == pytest.approx(0, abs=0.1)


# -- targets told back ---------------------------------------------------------------------------------------


def test_ardupilot_tells_position_velocity_and_acceleration_back() -> None:
    station = flying("ardupilot")
    station.send(setpoint((5, 6, -31), (0.5, 0.25, 0), (0.125, 0, 0)))
    told = station.ask(LOCAL_TARGET)
    assert told.type_mask == 0xC00
    assert (told.x, told.y, told.z) == pytest.approx((5, 6, -31), abs=0.1)
    assert (told.vx, told.vy, told.vz) == pytest.approx((0.5, 0.25, 0), abs=0.02)
    assert (told.afx, told.afy, told.afz) == pytest.approx((0.125, 0, 0))


def test_px4_tells_the_velocity_of_its_position_control_back() -> None:
    station = flying("px4")
    station.hold(setpoint((None, None, -30), (2, 1, None)), 4)
    told = station.ask(LOCAL_TARGET)
    assert told.type_mask & 0x7 == 0x3
    assert told.z == pytest.approx(-30)
    assert (told.vx, told.vy) == pytest.approx((2, 1), abs=0.05)
