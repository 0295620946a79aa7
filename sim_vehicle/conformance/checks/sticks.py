"""Sticks: overrides of RC channels, and a joystick's MANUAL_CONTROL, on the ground and in the air.

Each check releases the sticks at its end. PX4 lands after a flight by joystick, because the loss of the
joystick is a failsafe in each later mode.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying
from sim_vehicle.conformance.assertions import at_least, at_most, equal, near
from sim_vehicle.conformance.guard import ARM
from sim_vehicle.conformance.outcomes import ACCEPTED
from sim_vehicle.conformance.registry import KNOWN, check
from sim_vehicle.conformance.traffic import SECOND_STATION
from sim_vehicle.conformance.vehicle import VehicleUnderTest

CENTRE = (0, 0, 500, 0)  # x, y, z, r of MANUAL_CONTROL
STICK_INTERVAL_S = 0.1
KEPT = 0xFFFF  # of RC_CHANNELS_OVERRIDE
ARM_COMMAND = mavlink.MAV_CMD_COMPONENT_ARM_DISARM


def _override(vehicle: VehicleUnderTest, *pulses_us: int) -> Any:
    values = [*pulses_us, *[KEPT] * (8 - len(pulses_us)), *[0] * 10]
    return mavlink.MAVLink_rc_channels_override_message(*vehicle.target, *values)


def _control(vehicle: VehicleUnderTest, *axes: int) -> None:
    vehicle.send(mavlink.MAVLink_manual_control_message(vehicle.target[0], *axes, 0))


def _hold(vehicle: VehicleUnderTest, seconds: float, *axes: int) -> None:
    for _ in range(round(seconds / STICK_INTERVAL_S)):
        _control(vehicle, *axes)
        vehicle.wait(STICK_INTERVAL_S)


@contextmanager
def _released(vehicle: VehicleUnderTest) -> Iterator[None]:
    """Release the overridden channels at the end."""
    try:
        yield
    finally:
        with vehicle.extra_time():
            vehicle.send(_override(vehicle, 0, 0, 0, 0))
            vehicle.wait(0.3)


def _roll_us(vehicle: VehicleUnderTest) -> int:
    vehicle.wait(0.3)
    return int(vehicle.request("RC_CHANNELS").chan1_raw)


_override_check = partial(check, "arming", needs=[ARM], dialects=("ardupilot",))


@_override_check(source="MAVLink: RC_CHANNELS_OVERRIDE")
def override_is_shown(vehicle: VehicleUnderTest) -> None:
    """RC_CHANNELS shows an override; 65535 keeps it and 0 releases it."""
    before = _roll_us(vehicle)
    with _released(vehicle):
        vehicle.send(_override(vehicle, 1600, 1400))
        equal(_roll_us(vehicle), 1600, "channel 1")
        vehicle.send(_override(vehicle, KEPT, 1450))
        equal(_roll_us(vehicle), 1600, "channel 1 after 65535")
        vehicle.send(_override(vehicle, 0))
        equal(_roll_us(vehicle), before, "channel 1 after 0")


@_override_check(source="ArduPilot: RC_OVERRIDE_TIME")
def override_ends(vehicle: VehicleUnderTest) -> None:
    """An override ends 3 s after its last message."""
    before = _roll_us(vehicle)
    with _released(vehicle):
        vehicle.send(_override(vehicle, 1600))
        vehicle.wait(1.5)
        equal(_roll_us(vehicle), 1600, "channel 1 after 1.8 s")
        vehicle.wait(2.0)
        equal(_roll_us(vehicle), before, "channel 1 after 4.1 s")


@_override_check(source="GCS_Common.cpp, handle_rc_channels_override")
def override_by_another(vehicle: VehicleUnderTest) -> None:
    """An override by another system than the own ground station has no effect."""
    before = _roll_us(vehicle)
    vehicle.send(_override(vehicle, 1600), SECOND_STATION)
    equal(_roll_us(vehicle), before, "channel 1")


@_override_check(source="GCS_Common.cpp, manual_override")
def joystick_sets_channels(vehicle: VehicleUnderTest) -> None:
    """MANUAL_CONTROL sets the channels of the sticks; 32767 releases an axis."""
    before = _roll_us(vehicle)
    with _released(vehicle):
        _control(vehicle, 0, 500, 0, 0)
        near(_roll_us(vehicle), 1750, 2, "channel 1 for y = 500")
        _control(vehicle, 0, 0x7FFF, 0, 0)
        equal(_roll_us(vehicle), before, "channel 1 for y = 32767")


@check(
    "arming",
    needs=[ARM],
    kind="copter",
    dialects=KNOWN,
    source="AP_Arming.cpp, rc_arm_checks; Commander.cpp, arm",
)
def throttle_is_up(vehicle: VehicleUnderTest) -> str:
    """A copter refuses arming while the throttle is up."""
    flying.wait_ready(vehicle)
    flying.set_mode(vehicle, vehicle.known(ardupilot="altitude", px4="position"))
    with _released(vehicle):
        _hold(vehicle, 0.6, 0, 0, 900, 0)
        seen = vehicle.result(vehicle.command_long(ARM_COMMAND, 1), attempts=1)
        if seen == ACCEPTED:
            vehicle.command(ARM_COMMAND, 0)
    vehicle.wait(1.0)
    flying.set_ready_mode(vehicle)
    return equal(seen, vehicle.dialect.refusal, "arming with the throttle at 90 %")


@contextmanager
def _by_joystick(vehicle: VehicleUnderTest, role: str) -> Iterator[None]:
    """Fly in a mode with the sticks in the middle; hold (PX4: land) at the end."""
    with _released(vehicle):
        _hold(vehicle, 1.0, *CENTRE)
        equal(flying.try_mode(vehicle, role), ACCEPTED, f"mode {role}")
        _hold(vehicle, 2.0, *CENTRE)
        equal(vehicle.mode, flying.mode_number(vehicle, role), "mode")
        try:
            yield
        finally:
            with vehicle.extra_time():
                vehicle.known(ardupilot=flying.hold, px4=flying.ensure_landed)(vehicle)


_flight_check = partial(check, "flight.sticks", airborne=True, kind="copter")


@_flight_check(dialects=KNOWN, source="ArduPilot: PILOT_SPEED_UP, ANGLE_MAX; PX4: MPC_*")
def altitude(vehicle: VehicleUnderTest) -> str:
    """The full throttle climbs at 2.5 m/s (PX4: 3 m/s), the full roll stick leans by 30 (35) degrees."""
    climb_m_s, lean_deg = vehicle.known(ardupilot=(2.5, 30.0), px4=(3.0, 35.0))
    with _by_joystick(vehicle, "altitude"), vehicle.streaming({"ATTITUDE": 10.0}):
        _hold(vehicle, 5.0, 0, 0, 1000, 0)
        climb = -flying.position(vehicle).vz / 100
        _hold(vehicle, 3.0, *CENTRE)
        rest = -flying.position(vehicle).vz / 100
        _hold(vehicle, 2.0, 0, 1000, 500, 0)
        roll_deg = math.degrees(vehicle.last["ATTITUDE"].roll)
        _hold(vehicle, 1.0, *CENTRE)
    near(climb, climb_m_s, 0.5, "climb by the full throttle [m/s]")
    near(rest, 0.0, 0.4, "climb by the middle [m/s]")
    near(roll_deg, lean_deg, 3.0, "roll [deg]")
    return f"{climb:.1f} m/s, {roll_deg:.0f} degrees"


@_flight_check(dialects=KNOWN, source="ArduPilot: LOITER; PX4: Position")
def brake(vehicle: VehicleUnderTest) -> str:
    """In the position mode the pitch stick flies; after its release the copter stops."""
    with _by_joystick(vehicle, vehicle.known(ardupilot="loiter", px4="position")):
        _hold(vehicle, 4.0, 1000, 0, 500, 0)
        fast = flying.speed_m_s(vehicle)
        _hold(vehicle, 8.0, *CENTRE)
        slow = flying.speed_m_s(vehicle)
    at_least(fast, 4.0, "speed after 4 s [m/s]")
    at_most(slow, 0.6, "speed 8 s after the release [m/s]")
    return f"{fast:.1f} m/s, then {slow:.1f} m/s"


@_flight_check(dialects=("px4",), source="PX4: COM_RC_OVERRIDE")
def take_over(vehicle: VehicleUnderTest) -> str:
    """Resting sticks leave Hold alone, moving sticks end it."""
    with _by_joystick(vehicle, "hold"):
        _hold(vehicle, 0.5, 900, 0, 500, 0)
        _hold(vehicle, 2.0, *CENTRE)
        seen = vehicle.mode
    equal(seen, flying.mode_number(vehicle, "position"), "mode")
    return flying.mode_name(vehicle, seen)


@_flight_check(dialects=("px4",), source="PX4: COM_RC_LOSS_T, NAV_RCL_ACT")
def lost(vehicle: VehicleUnderTest) -> str:
    """After the loss of the joystick the vehicle holds, and returns after COM_FAIL_ACT_T."""
    with _by_joystick(vehicle, "position"):
        flying.wait_for_mode(vehicle, "hold", 3.5)
        took_s = flying.wait_for_mode(vehicle, "return", 12.0)
    near(took_s, 5.0, 2.0, "from Hold to Return [s]")
    return f"Hold for {took_s:.1f} s"
