"""Arming and disarming on the ground."""

from collections.abc import Callable
from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, parameters, plans
from sim_vehicle.conformance.assertions import at_most, equal, holds, near, refused
from sim_vehicle.conformance.checks.fence import CLAIMS, fence_in_force, polygon
from sim_vehicle.conformance.guard import ARM
from sim_vehicle.conformance.outcomes import ACCEPTED, Skip, result_name
from sim_vehicle.conformance.registry import KNOWN, check, checks, row
from sim_vehicle.conformance.traffic import SECOND_STATION
from sim_vehicle.conformance.vehicle import VehicleUnderTest

ARM_COMMAND = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
FORCE = 21_196  # value of parameter 2 for arming or disarming without checks
REFUSAL_S = 2.0  # longest wait for the reason of a refusal
_check = partial(check, "arming", needs=[ARM])
_known_check = partial(check, "arming", needs=[ARM], dialects=KNOWN)
_copter_check = partial(check, "arming", needs=[ARM], dialects=("ardupilot",), kind="copter")


def _by_command(vehicle: VehicleUnderTest, value: int) -> str:
    return vehicle.command(ARM_COMMAND, value)


def _arms(
    vehicle: VehicleUnderTest,
    send: Callable[[VehicleUnderTest, int], str] = _by_command,
    within_s: float = flying.HEARTBEAT_LAG_S,
) -> str:
    """Arm and disarm the vehicle, and wait for both in the heartbeat; `send` returns the MAV_RESULT."""
    flying.wait_ready(vehicle)
    equal(send(vehicle, 1), ACCEPTED, "arming")
    took_s = flying.wait_until_armed(vehicle, within_s)
    equal(send(vehicle, 0), ACCEPTED, "disarming")
    flying.wait_until_disarmed(vehicle)
    return f"armed after {took_s:.2f} s"


checks(
    "arming", _arms,
    row("arms_and_disarms", "COMPONENT_ARM_DISARM arms and disarms, and the heartbeat shows both."),
    row("heartbeat_follows", "The heartbeat shows the arming within 1.5 s of the acknowledgement.",
        _by_command, 1.5),
    row("by_command_int", "Arming works as COMMAND_INT.",
        lambda v, value: v.result(v.command_int(ARM_COMMAND, value))),
    row("by_second_station", "A second station can arm and disarm.",
        lambda v, value: v.result(v.command_long(ARM_COMMAND, value), source=SECOND_STATION),
        source="AUTOPILOTS 1.15"),
    row("by_force", "Forced arming and disarming (parameter 2 = 21196) are accepted.",
        lambda v, value: v.command(ARM_COMMAND, value, FORCE),
        dialects=KNOWN, source="AUTOPILOTS 1.14: p2=21196"),
    needs=[ARM],
)  # fmt: skip


@_check()
def is_idempotent(vehicle: VehicleUnderTest) -> None:
    """Arming an armed vehicle and disarming a disarmed vehicle are accepted."""
    with flying.armed(vehicle):
        vehicle.expect_accepted(ARM_COMMAND, 1)
    vehicle.expect_accepted(ARM_COMMAND, 0)


@_check(source="PX4 Commander.cpp, VEHICLE_CMD_COMPONENT_ARM_DISARM: a text, and no acknowledgement")
def strange_parameter(vehicle: VehicleUnderTest) -> str:
    """COMPONENT_ARM_DISARM with 2 as parameter 1 does not arm; PX4 sends a text, others refuse."""
    flying.wait_ready(vehicle)
    mark = vehicle.mark()
    vehicle.send(vehicle.command_long(ARM_COMMAND, 2))
    vehicle.wait(flying.HEARTBEAT_LAG_S)
    was_armed = vehicle.armed
    flying.disarm(vehicle)
    seen = [result_name(m.result) for m in vehicle.since(mark, "COMMAND_ACK") if m.command == ARM_COMMAND]
    holds(not was_armed and ACCEPTED not in seen, f"expected a refusal, saw {seen}, armed: {was_armed}")
    if vehicle.dialect.name == "px4":
        equal(seen, [], "acknowledgements")
        return str(vehicle.expect_text("Unsupported", mark).strip())
    equal(len(seen), 1, "acknowledgements")
    return seen[0]


@_known_check(source="AUTOPILOTS 1.13")
def system_status(vehicle: VehicleUnderTest) -> str:
    """On the ground an armed vehicle reports STANDBY (ArduPilot) or ACTIVE (PX4)."""
    expected = vehicle.known(ardupilot="MAV_STATE_STANDBY", px4="MAV_STATE_ACTIVE")
    with flying.armed(vehicle):
        vehicle.wait(1.2)
        seen = mavlink.enums["MAV_STATE"][vehicle.heartbeat.system_status].name
    return str(equal(seen, expected, "system_status"))


@_check(source="AUTOPILOTS 1.3: readiness")
def prearm_bit(vehicle: VehicleUnderTest) -> None:
    """A vehicle with a set pre-arm bit can be armed."""
    flying.wait_ready(vehicle)
    status = vehicle.request("SYS_STATUS")
    if vehicle.dialect.name != "px4" and not status.onboard_control_sensors_present & flying.PREARM_BIT:
        raise Skip("the vehicle has no pre-arm bit")
    holds(status.onboard_control_sensors_health & flying.PREARM_BIT, "the pre-arm bit is clear")
    flying.arm(vehicle)
    flying.disarm(vehicle)


@_check(dialects=("ardupilot",), source="AUTOPILOTS 1.7")
def mode_not_armable(vehicle: VehicleUnderTest) -> None:
    """The vehicle refuses arming in AUTO, and sends the reason as a text."""
    flying.wait_ready(vehicle)
    if int(parameters.value_or_none(vehicle, "AUTO_OPTIONS") or 0) & 1 or vehicle.identity.kind == "plane":
        raise Skip("AUTO is armable on this vehicle")
    plans.store_sample(vehicle)
    flying.set_mode(vehicle, "mission")
    mark = vehicle.mark()
    equal(vehicle.command(ARM_COMMAND, 1), "FAILED", "arming in AUTO")
    vehicle.wait(0.5)
    vehicle.expect_text("not armable", mark)
    flying.set_ready_mode(vehicle)


@_check(claims=CLAIMS, dialects=("ardupilot",), source="AUTOPILOTS 1.3: reason only in STATUSTEXT")
def refusal_has_a_reason(vehicle: VehicleUnderTest) -> str:
    """Outside of an enabled fence arming is refused, and a text names the breach."""
    flying.wait_ready(vehicle)
    with fence_in_force(vehicle, polygon(vehicle, ((500, 500), (500, 600), (600, 600), (600, 500)))):
        vehicle.wait(1.5)
        mark = vehicle.mark()
        result = vehicle.command(ARM_COMMAND, 1)
        vehicle.wait(REFUSAL_S)
        holds(not vehicle.armed, "the vehicle armed outside of its fence")
        equal(result, vehicle.dialect.refusal, "result")
        return vehicle.expect_text("reach", mark)


@_known_check(source="AUTOPILOTS 1.11: home is re-set at every arming")
def sets_home(vehicle: VehicleUnderTest) -> str:
    """After arming, home is within 5 m of the vehicle."""
    with flying.armed(vehicle):
        vehicle.wait(1.0)
        away_m = plans.distance_m(flying.home(vehicle), plans.current_position(vehicle))
        height_m = vehicle.request("GLOBAL_POSITION_INT").relative_alt / 1000
    near(height_m, 0.0, 2.0, "relative_alt [m]")
    return f"{at_most(away_m, 5.0, 'distance to home [m]'):.2f} m"


@_known_check(kind="copter", source="AUTOPILOTS 1.7: auto-disarms after DISARM_DELAY 10 s")
def idle_disarms(vehicle: VehicleUnderTest) -> str:
    """An armed vehicle on the ground disarms after the configured delay."""
    parameter = vehicle.known(ardupilot="DISARM_DELAY", px4="COM_DISARM_PRFLT")
    delay_s = parameters.value_or_none(vehicle, parameter)
    if delay_s is None or not 0 < delay_s < 60:
        raise Skip(f"{parameter} is {delay_s}; the check needs a delay between 0 and 60 s")
    flying.arm(vehicle)
    took_s = flying.wait_until_disarmed(vehicle, delay_s + 5.0)
    near(took_s, delay_s, 3.0, "seconds until disarmed")
    return f"after {took_s:.1f} s"


@check("arming", needs=[ARM, "reboot"], dialects=KNOWN, source="AUTOPILOTS 2: reboot is DENIED when armed")
def reboot_is_refused(vehicle: VehicleUnderTest) -> str:
    """An armed vehicle does not reboot."""
    expected = vehicle.known(ardupilot="FAILED", px4="DENIED")
    with flying.armed(vehicle):
        result = vehicle.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
        vehicle.wait(2.5)
        holds(vehicle.armed, "the vehicle is no longer armed")
    return equal(result, expected, "PREFLIGHT_REBOOT_SHUTDOWN")


@_copter_check(
    source="AUTOPILOTS 1.7: MISSION_START on a disarmed vehicle is ACCEPTED, sets AUTO, and nothing flies",
)
def mission_start_disarmed(vehicle: VehicleUnderTest) -> None:
    """MISSION_START on a disarmed vehicle is accepted, and the vehicle stays disarmed."""
    flying.wait_ready(vehicle)
    plans.store_sample(vehicle)
    vehicle.expect_accepted(mavlink.MAV_CMD_MISSION_START)
    flying.wait_for_mode(vehicle, "mission")
    vehicle.wait(3.0)
    holds(not vehicle.armed, "the vehicle armed")
    flying.set_ready_mode(vehicle)


@_copter_check()
def takeoff_disarmed(vehicle: VehicleUnderTest) -> str:
    """NAV_TAKEOFF on a disarmed vehicle is refused."""
    flying.wait_ready(vehicle)
    result = vehicle.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10)
    holds(not vehicle.armed, "the vehicle armed")
    return refused(result)
