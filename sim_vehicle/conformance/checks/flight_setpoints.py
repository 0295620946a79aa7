"""Set-points: streams of positions and velocities."""

from contextlib import nullcontext
from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, parameters, plans
from sim_vehicle.conformance.assertions import ACCEPTED, equal, holds, near, refused
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest

# type masks of the set-point messages
POSITION_ONLY, VELOCITY_ONLY, POSITION_AND_VELOCITY = 0x0DF8, 0x0DC7, 0x0DC0
MAX_BEHIND_M = 4.0  # twice the time between set-points, and the delay of the reported position
MAX_STOP_S = 10.0  # longest time to a stop
_copter_check = partial(check, airborne=True, kind="copter", dialects=("ardupilot", "px4"), limit_s=300)
_ardupilot_check = partial(check, airborne=True, kind="copter", dialects=("ardupilot",), limit_s=300)
_px4_check = partial(check, airborne=True, kind="copter", dialects=("px4",), limit_s=300)


@_ardupilot_check("flight.setpoint.position")
def setpoint_position(vehicle: VehicleUnderTest) -> str:
    """SET_POSITION_TARGET_GLOBAL_INT in GUIDED moves the vehicle to a position."""
    target = plans.offset(flying.last_position(vehicle), 20.0, -20.0)
    setpoint = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, POSITION_ONLY, *target, 20.0, *[0.0] * 8
    vehicle.send(mavlink.MAVLink_set_position_target_global_int_message(0, *vehicle.target, *setpoint))
    return f"arrived after {flying.wait_until_near(vehicle, target):.0f} s"


def _stream_velocity(
    vehicle: VehicleUnderTest, north_m_s: float, seconds: float, frame: int = mavlink.MAV_FRAME_LOCAL_NED
) -> None:
    setpoint = frame, VELOCITY_ONLY, 0, 0, 0, north_m_s, *[0.0] * 7
    for _ in range(int(seconds / 0.2)):
        vehicle.send(mavlink.MAVLink_set_position_target_local_ned_message(0, *vehicle.target, *setpoint))
        vehicle.wait(0.2)


def _follow_setpoints(vehicle: VehicleUnderTest) -> None:
    """Prepare the vehicle to follow velocities: PX4 needs a stream of velocities, then OFFBOARD."""
    if vehicle.dialect.name == "px4":
        _stream_velocity(vehicle, 0.0, 2.0)
        equal(flying.try_mode(vehicle, "offboard"), ACCEPTED, "OFFBOARD")


@_copter_check("flight.setpoint.velocity")
def setpoint_velocity(vehicle: VehicleUnderTest) -> str:
    """The vehicle follows velocity set-points of 3 m/s north, sent at 5 Hz."""
    _follow_setpoints(vehicle)
    _stream_velocity(vehicle, 3.0, 15.0)  # PX4's SIH reaches its speed slowly, against drag
    message = vehicle.last["GLOBAL_POSITION_INT"].message
    _stream_velocity(vehicle, 0.0, 3.0)
    flying.hold(vehicle)
    near(message.vx / 100, 3.0, 0.6, "north [m/s]")
    near(message.vy / 100, 0.0, 0.6, "east [m/s]")
    return f"{message.vx / 100:.2f} m/s north"


@_copter_check("flight.setpoint.follows")
def setpoint_follows(vehicle: VehicleUnderTest) -> str:
    """The vehicle keeps up with a position that moves south at 5 m/s, sent at 5 Hz with its velocity."""
    _follow_setpoints(vehicle)
    start, height_m = flying.last_position(vehicle), flying.height_m(vehicle)
    began_s = vehicle.now
    while (since_s := vehicle.now - began_s) < 15.0:
        north_m = since_s**2 if since_s < 2.5 else 5.0 * since_s - 6.25  # 2 m/s^2 up to 5 m/s
        place = plans.offset(start, -north_m, 0.0)
        speeds = -min(2.0 * since_s, 5.0), 0.0, 0.0
        setpoint = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, POSITION_AND_VELOCITY, *place, height_m
        vehicle.send(
            mavlink.MAVLink_set_position_target_global_int_message(
                0, *vehicle.target, *setpoint, *speeds, *[0.0] * 5
            )
        )
        vehicle.wait(0.2)
    north_m = 6.25 - 5.0 * (vehicle.now - began_s)
    away_m = flying.distance_to_m(vehicle, plans.offset(start, north_m, 0.0))
    _stream_velocity(vehicle, 0.0, 3.0)
    flying.hold(vehicle)
    holds(away_m < MAX_BEHIND_M, f"expected at most {MAX_BEHIND_M:g} m from the position, saw {away_m:.1f} m")
    return f"{away_m:.1f} m"


@_copter_check("flight.setpoint.unknown_frame")
def setpoint_unknown_frame(vehicle: VehicleUnderTest) -> str:
    """A velocity in BODY_FRD, which neither autopilot knows, is not flown."""
    _follow_setpoints(vehicle)
    place = flying.last_position(vehicle)
    _stream_velocity(vehicle, 4.0, 3.0, mavlink.MAV_FRAME_BODY_FRD)
    away_m = flying.distance_to_m(vehicle, place)
    flying.hold(vehicle)
    holds(away_m < 3.0, f"expected a movement of less than 3 m, saw {away_m:.1f} m")
    return f"{away_m:.2f} m"


@_copter_check("flight.setpoint.times_out")
def setpoint_times_out(vehicle: VehicleUnderTest) -> str:
    """The vehicle stops within 10 s after the last velocity set-point (PX4: COM_OBL_RC_ACT 5, hold)."""
    # By default PX4 enters its position mode, which without manual control does not brake.
    px4 = vehicle.dialect.name == "px4"
    with parameters.changed(vehicle, "COM_OBL_RC_ACT", 5) if px4 else nullcontext():
        _follow_setpoints(vehicle)
        _stream_velocity(vehicle, 3.0, 4.0)
        took_s = vehicle.wait_until(lambda: flying.speed_m_s(vehicle) < 0.7, "a stop", MAX_STOP_S)
        return f"after {took_s:.1f} s"


@_copter_check("flight.setpoint.needs_its_mode")
def setpoint_needs_mode(vehicle: VehicleUnderTest) -> str:
    """In the hold mode the vehicle ignores velocity set-points."""
    flying.set_mode(vehicle, "hold")
    vehicle.wait(2.0)
    place = flying.last_position(vehicle)
    _stream_velocity(vehicle, 4.0, 3.0)
    away_m = flying.distance_to_m(vehicle, place)
    holds(away_m < 2.5, f"expected a movement of less than 2.5 m, saw {away_m:.1f} m")
    return f"{away_m:.2f} m"


@_px4_check("flight.offboard.returns")
def offboard_returns(vehicle: VehicleUnderTest) -> str:
    """Without set-points the vehicle leaves OFFBOARD, and returns to it when set-points return."""
    _follow_setpoints(vehicle)
    _stream_velocity(vehicle, 0.0, 2.0)  # until the heartbeat shows OFFBOARD
    entered = vehicle.mode
    vehicle.wait_until(lambda: vehicle.mode != entered, "another mode", MAX_STOP_S)
    _stream_velocity(vehicle, 0.0, 3.0)
    equal(vehicle.mode, entered, "custom_mode")
    flying.hold(vehicle)
    return f"custom_mode {entered:#x}"


@_px4_check("flight.offboard.needs_setpoints")
def offboard_needs_setpoints(vehicle: VehicleUnderTest) -> str:
    """OFFBOARD without a stream of set-points is refused."""
    vehicle.wait(3.0)  # until earlier set-points have expired
    seen = flying.try_mode(vehicle, "offboard")
    return refused(seen)
