"""Set-points: streams of positions and velocities."""

from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.assertions import ACCEPTED, equal, holds, near, refused
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest

POSITION_ONLY, VELOCITY_ONLY = 0x0DF8, 0x0DC7  # type masks of the set-point messages
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


def _stream_velocity(vehicle: VehicleUnderTest, north_m_s: float, seconds: float) -> None:
    setpoint = mavlink.MAV_FRAME_LOCAL_NED, VELOCITY_ONLY, 0, 0, 0, north_m_s, *[0.0] * 7
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


@_copter_check("flight.setpoint.times_out")
def setpoint_times_out(vehicle: VehicleUnderTest) -> str:
    """The vehicle stops within 10 s after the last velocity set-point."""
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


@_px4_check("flight.offboard.needs_setpoints")
def offboard_needs_setpoints(vehicle: VehicleUnderTest) -> str:
    """OFFBOARD without a stream of set-points is refused."""
    vehicle.wait(3.0)  # until earlier set-points have expired
    seen = flying.try_mode(vehicle, "offboard")
    return refused(seen)
