"""Streams in flight: set-points to the vehicle, telemetry from it."""

import math
from contextlib import nullcontext
from functools import partial
from statistics import fmean

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, parameters, plans
from sim_vehicle.conformance.assertions import at_least, at_most, equal, near, refused, within
from sim_vehicle.conformance.outcomes import ACCEPTED, Skip
from sim_vehicle.conformance.registry import KNOWN, check
from sim_vehicle.conformance.vehicle import VehicleUnderTest

# type masks of the set-point messages
POSITION_ONLY, VELOCITY_ONLY, POSITION_AND_VELOCITY = 0x0DF8, 0x0DC7, 0x0DC0
MAX_BEHIND_M = 4.0  # twice the time between set-points, and the delay of the reported position
MAX_STOP_S = 10.0  # longest time to a stop
_any_copter_check = partial(check, airborne=True, kind="copter")
_copter_check = partial(_any_copter_check, dialects=KNOWN)
_ardupilot_check = partial(_any_copter_check, dialects=("ardupilot",))
_px4_check = partial(_any_copter_check, dialects=("px4",))


@_ardupilot_check("flight.setpoint")
def position(vehicle: VehicleUnderTest) -> str:
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
    if vehicle.known(ardupilot=False, px4=True):
        _stream_velocity(vehicle, 0.0, 2.0)
        equal(flying.try_mode(vehicle, "offboard"), ACCEPTED, "OFFBOARD")


@_copter_check("flight.setpoint")
def velocity(vehicle: VehicleUnderTest) -> str:
    """The vehicle follows velocity set-points of 3 m/s north, sent at 5 Hz."""
    _follow_setpoints(vehicle)
    _stream_velocity(vehicle, 3.0, 15.0)  # PX4's SIH reaches its speed slowly, against drag
    message = flying.position(vehicle)
    _stream_velocity(vehicle, 0.0, 3.0)
    flying.hold(vehicle)
    near(message.vx / 100, 3.0, 0.6, "north [m/s]")
    near(message.vy / 100, 0.0, 0.6, "east [m/s]")
    return f"{message.vx / 100:.2f} m/s north"


@_copter_check("flight.setpoint")
def follows(vehicle: VehicleUnderTest) -> str:
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
    return f"{at_most(away_m, MAX_BEHIND_M, 'distance from the position [m]'):.1f} m"


@_copter_check("flight.setpoint")
def unknown_frame(vehicle: VehicleUnderTest) -> str:
    """A velocity in BODY_FRD, which neither autopilot knows, is not flown."""
    _follow_setpoints(vehicle)
    place = flying.last_position(vehicle)
    _stream_velocity(vehicle, 4.0, 3.0, mavlink.MAV_FRAME_BODY_FRD)
    away_m = flying.distance_to_m(vehicle, place)
    flying.hold(vehicle)
    return f"{at_most(away_m, 3.0, 'movement [m]'):.2f} m"


@_copter_check("flight.setpoint")
def times_out(vehicle: VehicleUnderTest) -> str:
    """The vehicle stops within 10 s after the last velocity set-point (PX4: COM_OBL_RC_ACT 5, hold)."""
    # By default PX4 enters its position mode, which without manual control does not brake.
    with vehicle.known(ardupilot=nullcontext(), px4=parameters.changed(vehicle, "COM_OBL_RC_ACT", 5)):
        _follow_setpoints(vehicle)
        _stream_velocity(vehicle, 3.0, 4.0)
        took_s = flying.wait_until_still(vehicle, MAX_STOP_S, 0.7)
        return f"after {took_s:.1f} s"


@_copter_check("flight.setpoint")
def needs_its_mode(vehicle: VehicleUnderTest) -> str:
    """In the hold mode the vehicle ignores velocity set-points."""
    flying.set_mode(vehicle, "hold")
    vehicle.wait(2.0)
    place = flying.last_position(vehicle)
    _stream_velocity(vehicle, 4.0, 3.0)
    return f"{at_most(flying.distance_to_m(vehicle, place), 2.5, 'movement [m]'):.2f} m"


@_px4_check("flight.offboard")
def returns(vehicle: VehicleUnderTest) -> str:
    """Without set-points the vehicle leaves OFFBOARD, and returns to it when set-points return."""
    _follow_setpoints(vehicle)
    _stream_velocity(vehicle, 0.0, 2.0)  # until the heartbeat shows OFFBOARD
    entered = vehicle.mode
    vehicle.wait_until(lambda: vehicle.mode != entered, "another mode", MAX_STOP_S)
    _stream_velocity(vehicle, 0.0, 3.0)
    equal(vehicle.mode, entered, "custom_mode")
    flying.hold(vehicle)
    return f"custom_mode {entered:#x}"


@_px4_check("flight.offboard")
def needs_setpoints(vehicle: VehicleUnderTest) -> str:
    """OFFBOARD without a stream of set-points is refused."""
    vehicle.wait(3.0)  # until earlier set-points have expired
    seen = flying.try_mode(vehicle, "offboard")
    return refused(seen)


@_any_copter_check("flight.telemetry")
def velocity_(vehicle: VehicleUnderTest) -> str:
    """The distance by vx and vy agrees with the change of the position."""
    flying.reposition(vehicle, plans.offset(flying.last_position(vehicle), 60.0, 60.0), 20.0)
    vehicle.wait(3.0)
    messages = vehicle.listen("GLOBAL_POSITION_INT", 4.0)
    seconds = (messages[-1].time_boot_ms - messages[0].time_boot_ms) / 1000
    first, last = ((m.lat, m.lon) for m in (messages[0], messages[-1]))
    flown_m = at_least(plans.distance_m(first, last), 3.0, "metres flown")
    reported_m = fmean(math.hypot(m.vx, m.vy) / 100 for m in messages) * seconds
    near(reported_m, flown_m, 0.15 * flown_m + 1.0, "metres by velocity")
    return f"{flown_m:.1f} m flown, {reported_m:.1f} m by velocity"


@_any_copter_check("flight.telemetry")
def local_position(vehicle: VehicleUnderTest) -> str:
    """LOCAL_POSITION_NED moves with GLOBAL_POSITION_INT; z is down."""
    rates = {"LOCAL_POSITION_NED": 5.0, "GLOBAL_POSITION_INT": 5.0}
    begin = {k: v[-1] for k, v in vehicle.sample(rates, 1.0).items()}
    flying.start_streams(vehicle)
    flying.reposition(vehicle, plans.offset(flying.last_position(vehicle), -30.0, 30.0), 28.0)
    vehicle.wait(20.0)
    end = {k: v[-1] for k, v in vehicle.sample(rates, 1.0).items()}
    flying.start_streams(vehicle)
    local_a, local_b = begin["LOCAL_POSITION_NED"], end["LOCAL_POSITION_NED"]
    global_a, global_b = begin["GLOBAL_POSITION_INT"], end["GLOBAL_POSITION_INT"]
    local_m = math.hypot(local_b.x - local_a.x, local_b.y - local_a.y)
    near(
        local_m,
        plans.distance_m((global_a.lat, global_a.lon), (global_b.lat, global_b.lon)),
        2.0,
        "metres moved",
    )
    near(local_a.z - local_b.z, (global_b.alt - global_a.alt) / 1000, 1.5, "metres climbed")
    return f"{local_m:.1f} m"


@_any_copter_check("flight.telemetry")
def climb(vehicle: VehicleUnderTest) -> str:
    """In a climb vz is negative, VFR_HUD.climb is positive, and both agree within 0.6 m/s."""
    place = flying.last_position(vehicle)
    flying.reposition(vehicle, place, flying.height_m(vehicle) + 15.0)
    with vehicle.streaming({"VFR_HUD": 5.0}):
        vehicle.wait(4.0)
        hud, position = vehicle.last["VFR_HUD"], flying.position(vehicle)
    at_most(position.vz, -30, "vz [cm/s]")
    at_least(hud.climb, 0.3, "climb [m/s]")
    near(hud.climb, -position.vz / 100, 0.6, "climb [m/s]")
    flying.reposition(vehicle, place, 20.0)
    vehicle.wait(8.0)
    return f"{hud.climb:.2f} m/s"


@check("flight.telemetry", airborne=True, kind="plane")
def airspeed(vehicle: VehicleUnderTest) -> str:
    """The airspeed of a plane is 5 to 60 m/s, and the throttle a percentage."""
    hud = vehicle.sample({"VFR_HUD": 5.0}, 2.0)["VFR_HUD"][-1]
    airspeed_m_s = within(hud.airspeed, 5, 60, "airspeed [m/s]")
    return f"{airspeed_m_s:.1f} m/s, {within(hud.throttle, 0, 100, 'throttle [%]')} %"


@check("flight.telemetry", airborne=True)
def battery(vehicle: VehicleUnderTest) -> str:
    """In the air a current above 0.5 A flows, the consumption grows, and the remaining charge does not."""
    first = vehicle.request("BATTERY_STATUS")
    vehicle.wait(10.0)
    second = vehicle.request("BATTERY_STATUS")
    if second.current_battery < 0:
        raise Skip("the current is not measured")
    current_a = at_least(second.current_battery / 100, 0.5, "current [A]")
    used_mah = at_least(second.current_consumed - first.current_consumed, 1, "consumption in 10 s [mAh]")
    at_most(second.battery_remaining, first.battery_remaining, "remaining charge [%]")
    return f"{current_a:.1f} A, {used_mah} mAh in 10 s"
