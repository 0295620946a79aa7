"""COMMAND_LONG and COMMAND_INT: acknowledgement, targets, repetition, progress."""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, frames
from sim_vehicle.conformance.assertions import CheckFailed, Skip, equal, holds, id_of, result_name
from sim_vehicle.conformance.guard import ALTER, CRASH
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.traffic import SECOND_STATION
from sim_vehicle.conformance.vehicle import VehicleUnderTest, known_behaviour
from sim_vehicle.station.frames import STATION
from sim_vehicle.station.messages import set_mode

NO_SUCH_COMMAND = 31_999
VERSION = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
REQUEST = mavlink.MAV_CMD_REQUEST_MESSAGE
FOREIGN = "PX4 mavlink_receiver.cpp, handle_message_command_both: FAILED unless the target was seen"
CALIBRATION_S = 60.0  # longest wait for the end of a calibration


@check("commands.ack.names_the_command")
def names_the_command(vehicle: VehicleUnderTest) -> str:
    """The acknowledgement carries the number of the command."""
    ack = vehicle.ask(vehicle.command_long(REQUEST, VERSION), "COMMAND_ACK")
    equal(ack.command, REQUEST, "command")
    return "REQUEST_MESSAGE"


@check("commands.ack.names_the_station")
def names_the_station(vehicle: VehicleUnderTest) -> str:
    """The acknowledgement is addressed to the commanding station, or to all systems."""
    ack = vehicle.ask(vehicle.command_long(REQUEST, VERSION), "COMMAND_ACK")
    holds((ack.target_system, ack.target_component) in (STATION, (0, 0), (STATION[0], 0)),
          f"expected {STATION}, saw {(ack.target_system, ack.target_component)}")  # fmt: skip
    return f"{ack.target_system}, {ack.target_component}"


@check("commands.ack.comes_once")
def comes_once(vehicle: VehicleUnderTest) -> str:
    """One command brings one acknowledgement."""
    mark = vehicle.mark()
    vehicle.send(vehicle.command_long(REQUEST, VERSION))
    vehicle.wait(1.5)
    acks = [m for m in vehicle.since(mark, "COMMAND_ACK") if m.command == REQUEST]
    equal(len(acks), 1, "acknowledgements")
    return "1"


@check("commands.ack.is_quick")
def is_quick(vehicle: VehicleUnderTest) -> str:
    """At least four of five short commands are acknowledged within 1 s; a link may lose one."""
    took_s = []
    for _ in range(5):
        began_s, mark = vehicle.now, vehicle.mark()
        vehicle.send(vehicle.command_long(REQUEST, VERSION))
        if vehicle.wait_for("COMMAND_ACK", lambda m: m.command == REQUEST, within_s=1.0, mark=mark):
            took_s.append(vehicle.now - began_s)
    holds(len(took_s) >= 4, f"expected 4 acknowledgements within 1 s each, saw {len(took_s)}")
    return f"up to {max(took_s) * 1000:.0f} ms"


@check("commands.unknown.long")
def unknown_long(vehicle: VehicleUnderTest) -> str:
    """An unknown command is UNSUPPORTED."""
    equal(result_name(vehicle.command(NO_SUCH_COMMAND)), "UNSUPPORTED", f"command {NO_SUCH_COMMAND}")
    return "UNSUPPORTED"


@check("commands.unknown.int")
def unknown_int(vehicle: VehicleUnderTest) -> str:
    """An unknown COMMAND_INT is UNSUPPORTED."""
    equal(result_name(vehicle.result(vehicle.command_int(NO_SUCH_COMMAND))), "UNSUPPORTED", "COMMAND_INT")
    return "UNSUPPORTED"


@check("commands.int.same_as_long")
def int_same_as_long(vehicle: VehicleUnderTest) -> str:
    """A command without a position has the same result as COMMAND_INT and COMMAND_LONG."""
    as_long = vehicle.command(REQUEST, VERSION)
    as_int = vehicle.result(vehicle.command_int(REQUEST, VERSION))
    equal(result_name(as_int), result_name(as_long), "COMMAND_INT")
    return result_name(as_int)


@check("commands.repeated.confirmation")
def repeated_confirmation(vehicle: VehicleUnderTest) -> str:
    """A repeated command with a higher confirmation number is acknowledged like the first command."""
    results = []
    for confirmation in range(3):
        message = vehicle.command_long(REQUEST, VERSION, confirmation=confirmation)
        results.append(vehicle.ask(message, "COMMAND_ACK", lambda m: m.command == REQUEST).result)
    equal(set(results), {mavlink.MAV_RESULT_ACCEPTED}, "results")
    return "3 times ACCEPTED"


@check("commands.repeated.mode")
def repeated_mode(vehicle: VehicleUnderTest) -> str:
    """A command for the present mode is accepted."""
    flying.set_ready_mode(vehicle)
    equal(
        result_name(vehicle.result(set_mode(vehicle.target, vehicle.mode))),
        "ACCEPTED",
        "the present mode",
    )
    return "ACCEPTED"


@check("commands.target.another_vehicle", source=FOREIGN)
def another_vehicle(vehicle: VehicleUnderTest) -> str:
    """A command to another system is not executed; ArduPilot does not answer it, PX4 answers FAILED."""
    return _not_executed(vehicle, vehicle.command_long(REQUEST, VERSION, to=(vehicle.unused_sysid(), 1)))


@check("commands.target.another_vehicle_int", source=FOREIGN)
def another_vehicle_int(vehicle: VehicleUnderTest) -> str:
    """A COMMAND_INT to another system is not executed; ArduPilot is silent, PX4 answers FAILED."""
    message = vehicle.command_int(REQUEST, VERSION)
    message.target_system = vehicle.unused_sysid()
    return _not_executed(vehicle, message)


def _not_executed(vehicle: VehicleUnderTest, message: Any) -> str:
    allowed = [[]] if vehicle.dialect.name == "ardupilot" else [[], ["FAILED"]]
    mark = vehicle.mark()
    vehicle.send(message)
    vehicle.wait(1.5)
    equal(vehicle.since(mark, "AUTOPILOT_VERSION"), [], "AUTOPILOT_VERSION")
    seen = [result_name(m.result) for m in vehicle.since(mark, "COMMAND_ACK") if m.command == message.command]
    holds(seen in allowed, f"expected one of the answers {allowed}, saw {seen}")
    return ", ".join(seen) or "no answer"


@check("commands.target.broadcast")
def all_systems(vehicle: VehicleUnderTest) -> str:
    """A command to system 0 reaches the vehicle; PX4 executes only a few such commands."""
    command = known_behaviour(vehicle, ardupilot=REQUEST, px4=mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES)
    params = (VERSION,) if command == REQUEST else (1,)
    mark = vehicle.mark()
    vehicle.send(vehicle.command_long(command, *params, to=(0, 0)))
    vehicle.expect("AUTOPILOT_VERSION", mark=mark)
    return "AUTOPILOT_VERSION"


@check("commands.target.all_components")
def all_components(vehicle: VehicleUnderTest) -> str:
    """A command to component 0 reaches the autopilot."""
    vehicle.ask(vehicle.command_long(REQUEST, VERSION, to=(vehicle.identity.sysid, 0)), "COMMAND_ACK")
    return "answered"


@check("commands.target.other_component", source=f"AUTOPILOTS 1.15: target_component is ignored; {FOREIGN}")
def other_component(vehicle: VehicleUnderTest) -> str:
    """A command to component 77 is executed by ArduPilot; PX4 answers FAILED."""
    expected = known_behaviour(vehicle, ardupilot=("ACCEPTED", True), px4=("FAILED", False))
    mark = vehicle.mark()
    vehicle.send(vehicle.command_long(REQUEST, VERSION, to=(vehicle.identity.sysid, 77)))
    ack = vehicle.expect("COMMAND_ACK", lambda m: m.command == REQUEST, mark=mark)
    vehicle.wait(0.5)
    executed = bool(vehicle.since(mark, "AUTOPILOT_VERSION"))
    equal((result_name(ack.result), executed), expected, "result, executed")
    return result_name(ack.result)


@check("commands.station.any_is_obeyed", source="AUTOPILOTS 1.15: commands from any GCS sysid are obeyed")
def any_station(vehicle: VehicleUnderTest) -> str:
    """The command of a second ground station is acknowledged, to that station or to all systems."""
    ack = vehicle.ask(vehicle.command_long(REQUEST, VERSION), "COMMAND_ACK", source=SECOND_STATION)
    expected = (0, SECOND_STATION[0])
    holds(ack.target_system in expected, f"expected one of {expected}, saw {ack.target_system}")
    return f"acknowledged to {ack.target_system}"


@check("commands.station.two_at_once")
def two_at_once(vehicle: VehicleUnderTest) -> str:
    """The vehicle acknowledges two commands that two stations send at the same moment."""
    mark = vehicle.mark()
    for source in (STATION, SECOND_STATION):
        vehicle.send(vehicle.command_long(REQUEST, VERSION), source)
    vehicle.wait(1.5)
    targets = [m.target_system for m in vehicle.since(mark, "COMMAND_ACK") if m.command == REQUEST]
    equal(len(targets), 2, "acknowledgements")
    return f"to {targets}"


@check("commands.parameters.nan_is_unset")
def nan_is_unset(vehicle: VehicleUnderTest) -> str:
    """NaN in unused parameters of a command has no effect."""
    message = vehicle.command_long(REQUEST, VERSION, *[math.nan] * 5)
    equal(result_name(vehicle.result(message)), "ACCEPTED", "REQUEST_MESSAGE")
    return "ACCEPTED"


@check(
    "commands.parameters.no_number",
    needs=[CRASH],
    source="ArduPilot GCS_Common.cpp, handle_command_request_message: converts the id without a check",
)
def no_number(vehicle: VehicleUnderTest) -> str:
    """A message id of NaN, infinity or 1e30 is answered, and the next command works.

    ArduPilot SITL ends with a floating point exception, unless SIM_FLOAT_EXCEPT is 0.
    """
    seen = [result_name(vehicle.command(REQUEST, value)) for value in (math.nan, math.inf, -math.inf, 1e30)]
    equal(result_name(vehicle.command(REQUEST, VERSION)), "ACCEPTED", "the next command")
    return ", ".join(seen)


@check(
    "commands.parameters.message_interval_nan",
    needs=[CRASH],
    source="ArduPilot GCS_Common.cpp, handle_command_set_message_interval: converts without a check",
)
def interval_nan(vehicle: VehicleUnderTest) -> str:
    """An interval of NaN for ATTITUDE causes at most 200 messages in 2 s."""
    vehicle.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, id_of("ATTITUDE"), math.nan)
    vehicle.wait(0.5)
    mark = vehicle.wait(2.0)
    count = len(vehicle.since(mark, "ATTITUDE"))
    vehicle.set_interval("ATTITUDE", 0)
    holds(count <= 200, f"expected at most 200 ATTITUDE in 2 s, saw {count}")
    return f"{count} in 2 s"


@check("commands.progress.ends_in_a_result", needs=[ALTER], limit_s=120)
def ends_in_a_result(vehicle: VehicleUnderTest) -> str:
    """A gyroscope calibration has one final acknowledgement, and it comes last, within 60 s."""
    command, mark = mavlink.MAV_CMD_PREFLIGHT_CALIBRATION, vehicle.mark()
    vehicle.send(vehicle.command_long(command, 1))
    final = vehicle.wait_for(
        "COMMAND_ACK",
        lambda m: m.command == command and m.result != mavlink.MAV_RESULT_IN_PROGRESS,
        within_s=CALIBRATION_S,
        mark=mark,
    )
    vehicle.wait(3.0)
    results = [result_name(m.result) for m in vehicle.since(mark, "COMMAND_ACK") if m.command == command]
    if results == ["UNSUPPORTED"]:
        raise Skip("the vehicle does not calibrate on command")
    holds(final is not None, f"expected a result within {CALIBRATION_S:g} s, saw {results}")
    finals = [name for name in results if name != "IN_PROGRESS"]
    equal(results[-1:], finals, "final results, one and last")
    return " then ".join(results)


@check("commands.progress.can_be_cancelled", needs=[ALTER], limit_s=120)
def can_be_cancelled(vehicle: VehicleUnderTest) -> str:
    """After COMMAND_CANCEL, a command in progress has a final acknowledgement within 60 s."""
    command = mavlink.MAV_CMD_PREFLIGHT_CALIBRATION
    mark = vehicle.mark()
    vehicle.send(vehicle.command_long(command, 1))
    first = vehicle.expect("COMMAND_ACK", lambda m: m.command == command, within_s=CALIBRATION_S, mark=mark)
    if first.result != mavlink.MAV_RESULT_IN_PROGRESS:
        raise Skip(f"the calibration ended at once with {result_name(first.result)}: nothing to cancel")
    vehicle.send_raw(frames.command_cancel(vehicle, command))
    final = vehicle.wait_for(
        "COMMAND_ACK",
        lambda m: m.command == command and m.result != mavlink.MAV_RESULT_IN_PROGRESS,
        within_s=CALIBRATION_S,
        mark=mark,
    )
    if final is None:
        raise CheckFailed(f"expected a final acknowledgement within {CALIBRATION_S:g} s, saw none")
    return result_name(final.result)


@check("commands.progress.nothing_to_cancel")
def nothing_to_cancel(vehicle: VehicleUnderTest) -> str:
    """After COMMAND_CANCEL without a command in progress, the next command is accepted."""
    vehicle.send_raw(frames.command_cancel(vehicle, REQUEST))
    vehicle.wait(0.5)
    equal(result_name(vehicle.command(REQUEST, VERSION)), "ACCEPTED", "the next command")
    return "the next command is ACCEPTED"


@check("commands.target.broadcast_is_refused", dialects=("px4",), source=FOREIGN)
def px4_refuses_system_0(vehicle: VehicleUnderTest) -> str:
    """PX4 does not execute REQUEST_MESSAGE to system 0."""
    return _not_executed(vehicle, vehicle.command_long(REQUEST, VERSION, to=(0, 0)))
