"""Flight modes on the ground: setting, refusals, reports."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.assertions import equal, holds, refused
from sim_vehicle.conformance.outcomes import ACCEPTED, Skip
from sim_vehicle.conformance.registry import check, checks, row
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.messages import set_mode

# Roles of modes in `Dialect.modes`, each with its own check.
MODE_ROLES = (
    "manual", "altitude", "position", "guided", "loiter", "circle", "hold", "return", "land", "stabilized",
)  # fmt: skip
NO_SUCH_MODE = 99


def _sets_mode(vehicle: VehicleUnderTest, role: str) -> str:
    flying.mode_number(vehicle, role)
    flying.wait_ready(vehicle)
    flying.set_mode(vehicle, role)
    return flying.mode_name(vehicle, vehicle.mode)


checks(
    "modes.set",
    _sets_mode,
    *[
        row(
            role, f"DO_SET_MODE for {role} is accepted on the ground, and the heartbeat shows the mode.", role
        )
        for role in MODE_ROLES
    ],
    source="AUTOPILOTS 1.5",
)


@check(
    "modes.set",
    dialects=("ardupilot",),
    source="AUTOPILOTS 1.9: an empty mission; ArduPlane mode_auto.cpp, ModeAuto::update: then RTL",
)
def mission_when_empty(vehicle: VehicleUnderTest) -> str:
    """A disarmed vehicle without a mission accepts AUTO; a plane then changes to RTL."""
    vehicle.send(mavlink.MAVLink_mission_clear_all_message(*vehicle.target, 0))
    vehicle.expect("MISSION_ACK")
    flying.set_ready_mode(vehicle)
    equal(flying.try_mode(vehicle, "mission"), ACCEPTED, "AUTO")
    role = "return" if vehicle.identity.kind == "plane" else "mission"
    flying.wait_for_mode(vehicle, role)
    return f"ACCEPTED, {role}"


@check("modes")
def acks_are_true(vehicle: VehicleUnderTest) -> str:
    """An accepted mode appears in the heartbeat; a refused mode does not appear."""
    if vehicle.dialect.home_item:  # without a mission ArduPlane accepts AUTO and changes to RTL
        plans.store_sample(vehicle)
    flying.set_ready_mode(vehicle)
    outcomes = []
    for role, number in vehicle.dialect.modes.items():
        before = vehicle.mode
        accepted = flying.try_mode(vehicle, role) == ACCEPTED
        vehicle.wait(flying.HEARTBEAT_LAG_S)
        answer = "accepted" if accepted else "refused"
        seen = f"mode {role} was {answer}, but the heartbeat has {flying.mode_name(vehicle, vehicle.mode)}"
        holds(vehicle.mode == (number if accepted else before), seen)
        outcomes.append(accepted)
    flying.set_ready_mode(vehicle)
    if not outcomes:
        raise Skip("the modes of this autopilot are unknown")
    return f"{sum(outcomes)} accepted, {len(outcomes) - sum(outcomes)} refused"


@check("modes")
def unknown(vehicle: VehicleUnderTest) -> str:
    """An unknown mode number does not change the mode; autopilots other than PX4 must refuse it."""
    before = vehicle.mode
    result = vehicle.command(mavlink.MAV_CMD_DO_SET_MODE, 1, NO_SUCH_MODE)
    if vehicle.dialect.name != "px4":
        refused(result)
    vehicle.wait(flying.HEARTBEAT_LAG_S)
    equal(vehicle.mode, before, "mode")
    return result


@check("modes", dialects=("ardupilot",))
def without_custom_flag(vehicle: VehicleUnderTest) -> str:
    """DO_SET_MODE without CUSTOM_MODE_ENABLED is refused."""
    before = vehicle.mode
    result = refused(vehicle.command(mavlink.MAV_CMD_DO_SET_MODE, 0, flying.mode_number(vehicle, "return")))
    equal(vehicle.mode, before, "mode")
    return result


@check("modes")
def by_command_int(vehicle: VehicleUnderTest) -> None:
    """DO_SET_MODE as COMMAND_INT sets the mode."""
    flying.set_ready_mode(vehicle)
    command = set_mode(vehicle.target, flying.mode_number(vehicle, "manual"))
    as_int = vehicle.command_int(command.command, command.param1, command.param2, command.param3)
    equal(vehicle.result(as_int), ACCEPTED, "COMMAND_INT")
    flying.wait_for_mode(vehicle, "manual")


@check("modes", source="AUTOPILOTS 1.5: the SET_MODE message is not acked (PX4 does ack it)")
def set_mode_message(vehicle: VehicleUnderTest) -> None:
    """SET_MODE changes the mode; PX4 acknowledges the message, ArduPilot does not."""
    acked = vehicle.known(ardupilot=False, px4=True)
    flying.set_ready_mode(vehicle)
    number, mark = flying.mode_number(vehicle, "manual"), vehicle.mark()
    flag = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    vehicle.send(mavlink.MAVLink_set_mode_message(vehicle.identity.sysid, flag, number))
    vehicle.wait_until(lambda: vehicle.mode == number, "the mode in the heartbeat", flying.HEARTBEAT_LAG_S)
    equal(bool(vehicle.since(mark, "COMMAND_ACK")), acked, "acknowledged")


@check("modes", source="AUTOPILOTS 1.5: the heartbeat lags the ack by up to 1 s")
def heartbeat_follows(vehicle: VehicleUnderTest) -> str:
    """The heartbeat shows a new mode within 1.5 s of the acknowledgement."""
    flying.set_ready_mode(vehicle)
    equal(flying.try_mode(vehicle, "manual"), ACCEPTED, "manual")
    took_s = flying.wait_for_mode(vehicle, "manual", 1.5)
    return f"{took_s:.2f} s"


@check("modes")
def survives_silence(vehicle: VehicleUnderTest) -> str:
    """On the ground the mode does not change while the station is silent for 8 s."""
    flying.set_ready_mode(vehicle)
    before = vehicle.mode
    vehicle.heartbeats_off = True
    vehicle.wait(8.0)
    equal(vehicle.mode, before, "mode")
    return flying.mode_name(vehicle, before)


@check("modes")
def current_mode_message(vehicle: VehicleUnderTest) -> str:
    """CURRENT_MODE, where supported, agrees with the heartbeat."""
    seen = vehicle.request("CURRENT_MODE").custom_mode
    return flying.mode_name(vehicle, equal(seen, vehicle.mode, "custom_mode"))


@check("modes")
def available_modes(vehicle: VehicleUnderTest) -> str:
    """AVAILABLE_MODES, where supported, are numbered without gaps and include the current mode."""
    mark = vehicle.mark()
    total = vehicle.request("AVAILABLE_MODES", 0).number_modes
    vehicle.wait(3.0)
    modes = vehicle.since(mark, "AVAILABLE_MODES")
    equal({mode.mode_index for mode in modes}, set(range(1, total + 1)), "mode_index")
    is_listed = any(mode.custom_mode == vehicle.mode for mode in modes)
    holds(is_listed, f"the current mode {vehicle.mode} is not listed")
    return f"{total} modes"
