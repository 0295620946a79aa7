"""MAVSDK's action, offboard, geofence and failure plug-ins with copters of both autopilots."""

import math
from collections.abc import Iterator

import pytest
from mavsdk.plugins.action import OrbitYawBehavior
from mavsdk.plugins.failure import Failure, FailureType, FailureUnit
from mavsdk.plugins.geofence import Circle, FenceType, GeofenceData, Point, Polygon
from mavsdk.plugins.offboard import (
    AccelerationNed,
    Attitude,
    AttitudeRate,
    PositionGlobalYaw,
    PositionNedYaw,
    VelocityBodyYawspeed,
    VelocityNedYaw,
)
from mavsdk.plugins.telemetry import FlightMode, LandedState
from mavsdk_peer import COPTERS, MavsdkPeer, Vehicle, connected, refusal, side_by_side

pytestmark = pytest.mark.interop
OFFBOARD = FlightMode.OFFBOARD


@pytest.fixture(scope="module")
def fast() -> Iterator[MavsdkPeer]:
    with connected("--personality", "ardupilot:3,px4:2", "--speedup", "25", *COPTERS) as peer:
        yield peer


@pytest.fixture(scope="module")
def slow() -> Iterator[MavsdkPeer]:
    """Connect at a speed that MAVSDK's 20 set-points a second of wall time and its transfers allow."""
    with connected("--personality", "ardupilot:3,px4:4", "--speedup", "10", *COPTERS) as peer:
        yield peer


# -- action ----------------------------------------------------------------------------------------------


@pytest.mark.autopilots("1.14", "MAVSDK 5 goto_location", "MAVSDK 5 set_current_speed", "MAVSDK 5 hold")
@pytest.mark.autopilots(
    "1.14", "MAVSDK 5 goto_location", "MAVSDK 5 set_current_speed", "MAVSDK 5 hold", of="px4"
)
@side_by_side
def test_takeoff_goto_speed_orbit_hold_return_and_landing(fast: MavsdkPeer, personality: str) -> None:
    vehicle = fast.take(personality)
    action, telemetry = vehicle.action, vehicle.telemetry
    vehicle.take_off(8.0)
    vehicle.until(lambda: telemetry.landed_state() == LandedState.IN_AIR, "in the air", 10)
    assert telemetry.in_air()
    assert refusal(action.disarm) == ("COMMAND_DENIED" if vehicle.px4 else "FAILED")
    up_m = telemetry.position().absolute_altitude_m
    action.goto_location(*vehicle.place_deg(40, 0), up_m + 4, math.nan)
    vehicle.until(lambda: vehicle.near(40, 0), "40 m north")
    vehicle.until(lambda: abs(vehicle.height_m - 12) < 1, "12 m high")
    if not vehicle.px4:
        assert refusal(action.set_current_speed, -1.0) == "FAILED"
    action.goto_location(*vehicle.place_deg(40, 60), up_m + 4, 90.0)
    action.set_current_speed(2.0)
    vehicle.until(lambda: vehicle.near(40, 20), "20 m east")
    assert vehicle.ground_speed_m_s == pytest.approx(2.0, abs=0.4)
    if vehicle.px4:
        orbit(vehicle)
    action.hold()
    vehicle.in_mode(FlightMode.HOLD)
    vehicle.until(lambda: vehicle.ground_speed_m_s < 0.3, "standing")
    action.return_to_launch()
    vehicle.in_mode(FlightMode.RETURN_TO_LAUNCH)
    vehicle.disarmed()
    assert vehicle.near(0, 0, 2.0)
    vehicle.until(lambda: telemetry.landed_state() == LandedState.ON_GROUND, "on the ground", 10)


def orbit(vehicle: Vehicle) -> None:
    """Wait for an orbit with a radius of 15 m around a point 20 m north."""
    centre = vehicle.place_deg(60, 20)
    height_m = vehicle.telemetry.position().absolute_altitude_m
    vehicle.action.do_orbit(15.0, 4.0, OrbitYawBehavior.HOLD_FRONT_TO_CIRCLE_CENTER, *centre, height_m)
    for place in ((75, 20), (60, 5), (45, 20)):
        vehicle.until(lambda place=place: vehicle.near(*place, 4.0), f"round to {place}")
    assert vehicle.mode not in (FlightMode.HOLD, FlightMode.MISSION)


# -- geofence --------------------------------------------------------------------------------------------


@pytest.mark.full
@pytest.mark.autopilots("MAVSDK 5 geofence", "2 fence")
@pytest.mark.autopilots("MAVSDK 5 geofence", "2 fence", of="px4")
@side_by_side
def test_a_geofence_is_stored_kept_and_cleared(slow: MavsdkPeer, personality: str) -> None:
    vehicle = slow.take(personality)
    vehicle.ready()
    fence = vehicle.geofence
    corners = [(-40, -40), (-40, 40), (40, 40), (40, -40)]
    square = Polygon([Point(*vehicle.place_deg(*corner)) for corner in corners], FenceType.INCLUSION)
    hole = Circle(Point(*vehicle.place_deg(0, 25)), 5.0, FenceType.EXCLUSION)
    fence.upload_geofence(GeofenceData([square], [hole]))
    kept = fence.download_geofence()
    (polygon,), (circle,) = kept.polygons, kept.circles
    assert (polygon.fence_type, circle.fence_type) == (FenceType.INCLUSION, FenceType.EXCLUSION)
    for sent, found in zip((*square.points, hole.point), (*polygon.points, circle.point), strict=True):
        assert found.latitude_deg == pytest.approx(sent.latitude_deg, abs=1e-6)
        assert found.longitude_deg == pytest.approx(sent.longitude_deg, abs=1e-6)
    assert circle.radius == pytest.approx(5.0)
    fence.clear_geofence()
    assert not fence.download_geofence().polygons


# -- offboard --------------------------------------------------------------------------------------------


@pytest.mark.full
@pytest.mark.autopilots("MAVSDK 5 offboard")
@pytest.mark.autopilots("MAVSDK 5 offboard", of="px4")
@side_by_side
def test_offboard_positions_velocities_and_attitudes(slow: MavsdkPeer, personality: str) -> None:
    vehicle = slow.take(personality)
    offboard, telemetry = vehicle.offboard, vehicle.telemetry
    telemetry.set_rate_position_velocity_ned(10.0)
    vehicle.take_off(10.0)
    assert refusal(offboard.start) == "NO_SETPOINT_SET"
    offboard.set_position_ned(PositionNedYaw(15.0, 10.0, -12.0, 90.0))
    offboard.start()
    vehicle.in_mode(OFFBOARD)
    assert offboard.is_active()
    vehicle.until(lambda: vehicle.near(15, 10, 1.0), "at a local position")
    vehicle.until(lambda: abs(telemetry.heading().heading_deg - 90) < 3, "facing east")
    local = telemetry.position_velocity_ned().position
    assert (local.north_m, local.east_m, local.down_m) == pytest.approx((15, 10, -12), abs=2)

    place = vehicle.place_deg(0, 10)
    offboard.set_position_global(
        PositionGlobalYaw(*place, 14.0, 90.0, PositionGlobalYaw.AltitudeType.REL_HOME)
    )
    vehicle.until(lambda: vehicle.near(0, 10) and abs(vehicle.height_m - 14) < 1, "at a place")

    offboard.set_velocity_ned(VelocityNedYaw(2.0, -1.0, 0.0, 0.0))
    vehicle.until(lambda: moves(vehicle, 2.0, -1.0), "moving north and west")
    vehicle.until(lambda: abs((telemetry.heading().heading_deg + 180) % 360 - 180) < 3, "facing north")
    offboard.set_velocity_body(VelocityBodyYawspeed(3.0, 0.0, 0.0, 20.0))
    vehicle.until(lambda: 40 < telemetry.heading().heading_deg < 60, "turning")
    vehicle.until(lambda: telemetry.heading().heading_deg > 120, "going on to turn")
    heading = math.radians(telemetry.heading().heading_deg)
    velocity = telemetry.velocity_ned()
    forward = velocity.north_m_s * math.cos(heading) + velocity.east_m_s * math.sin(heading)
    assert forward == pytest.approx(3.0, abs=0.7)

    offboard.set_attitude(Attitude(0.0, 0.0, 0.0, 0.5))
    vehicle.until(lambda: abs(telemetry.attitude_euler().yaw_deg) < 3, "level and north")
    offboard.set_attitude(Attitude(0.0, 10.0, 0.0, 0.5))
    vehicle.until(lambda: abs(telemetry.attitude_euler().pitch_deg - 10) < 1, "nose up")
    vehicle.until(lambda: telemetry.velocity_ned().north_m_s < -2, "backward")
    offboard.set_attitude_rate(AttitudeRate(0.0, 0.0, 30.0, 0.5))
    vehicle.until(lambda: 60 < telemetry.attitude_euler().yaw_deg < 120, "yawing")
    offboard.set_acceleration_ned(AccelerationNed(1.0, 0.0, 0.0))
    vehicle.until(lambda: telemetry.velocity_ned().north_m_s > 2, "accelerating north")
    offboard.stop()
    vehicle.in_mode(FlightMode.HOLD)
    assert not offboard.is_active()
    vehicle.until(lambda: vehicle.ground_speed_m_s < 0.3, "standing")


def moves(vehicle: Vehicle, north_m_s: float, east_m_s: float) -> bool:
    velocity = vehicle.telemetry.velocity_ned()
    return math.hypot(velocity.north_m_s - north_m_s, velocity.east_m_s - east_m_s) < 0.4


# -- failure ---------------------------------------------------------------------------------------------


@pytest.mark.full
@pytest.mark.autopilots("MAVSDK 5 failure", of="px4")
def test_px4_loses_and_regains_its_satellites(slow: MavsdkPeer) -> None:
    vehicle = slow.take("px4")
    vehicle.take_off(6.0)
    refused = refusal(vehicle.plugin(Failure).inject, FailureUnit.SENSOR_GPS, FailureType.OFF, 0)
    assert refused in ("DENIED", "DISABLED")
    vehicle.param.set_param_int("SYS_FAILURE_EN", 1)
    failure, telemetry = vehicle.plugin(Failure), vehicle.telemetry  # reads the parameter once
    failure.inject(FailureUnit.SENSOR_GPS, FailureType.OFF, 0)
    vehicle.until(lambda: telemetry.gps_info().num_satellites == 0, "no satellites")
    vehicle.until(lambda: not telemetry.health().is_global_position_ok, "no global position")
    vehicle.in_mode(FlightMode.LAND)
    failure.inject(FailureUnit.SENSOR_GPS, FailureType.OK, 0)
    vehicle.until(lambda: telemetry.gps_info().num_satellites == 10, "satellites")
    vehicle.until(lambda: telemetry.health().is_global_position_ok, "a global position")
    assert refusal(failure.inject, FailureUnit.SYSTEM_SERVO, FailureType.OFF, 0) == "UNSUPPORTED"
