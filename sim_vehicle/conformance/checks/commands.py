"""COMMAND_LONG and COMMAND_INT: acknowledgement, targets, repetition, progress."""

import math
import struct
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying
from sim_vehicle.conformance.assertions import ACCEPTED, Skip, equal, holds, id_of, result_name
from sim_vehicle.conformance.frames import COMMAND_CANCEL, COMMAND_CANCEL_EXTRA, frame
from sim_vehicle.conformance.guard import ALTER, CRASH
from sim_vehicle.conformance.registry import check, checks
from sim_vehicle.conformance.traffic import SECOND_STATION
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.frames import STATION, Source
from sim_vehicle.station.messages import set_mode

NO_SUCH_COMMAND = 31_999
VERSION = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
REQUEST, CALIBRATE = mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_PREFLIGHT_CALIBRATION
FOREIGN = "PX4 mavlink_receiver.cpp, handle_message_command_both: FAILED unless the target was seen"
CALIBRATION_S = 60.0  # longest wait for the end of a calibration


def _request(vehicle: VehicleUnderTest, **fields: Any) -> Any:
    """Return the command of most checks: a request for AUTOPILOT_VERSION."""
    return vehicle.command_long(REQUEST, VERSION, **fields)


def _ack(vehicle: VehicleUnderTest, source: Source = STATION) -> Any:
    return vehicle.ask(_request(vehicle), "COMMAND_ACK", source=source)


def _results(vehicle: VehicleUnderTest, mark: int, command: int = REQUEST) -> list[str]:
    """Return the results of a command that have arrived since a mark."""
    return [result_name(m.result) for m in vehicle.since(mark, "COMMAND_ACK") if m.command == command]


def _next_is_accepted(vehicle: VehicleUnderTest) -> str:
    return equal(vehicle.result(_request(vehicle)), ACCEPTED, "the next command")


# -- acknowledgement -------------------------------------------------------------------------------------


def _names_the_station(vehicle: VehicleUnderTest) -> str:
    ack = _ack(vehicle)
    seen = ack.target_system, ack.target_component
    holds(seen in (STATION, (0, 0), (STATION[0], 0)), f"expected {STATION}, saw {seen}")
    return f"{ack.target_system}, {ack.target_component}"


def _comes_once(vehicle: VehicleUnderTest) -> str:
    mark = vehicle.send(_request(vehicle))
    vehicle.wait(1.5)
    return str(equal(len(_results(vehicle, mark)), 1, "acknowledgements"))


def _is_quick(vehicle: VehicleUnderTest) -> str:
    took_s = []
    for _ in range(5):
        began_s, mark = vehicle.now, vehicle.send(_request(vehicle))
        if vehicle.wait_for("COMMAND_ACK", lambda m: m.command == REQUEST, within_s=1.0, mark=mark):
            took_s.append(vehicle.now - began_s)
    holds(len(took_s) >= 4, f"expected 4 acknowledgements within 1 s each, saw {len(took_s)}")
    return f"up to {max(took_s) * 1000:.0f} ms"


def _confirmation(vehicle: VehicleUnderTest) -> str:
    for number in range(3):
        ack = vehicle.ask(
            _request(vehicle, confirmation=number), "COMMAND_ACK", lambda m: m.command == REQUEST
        )
        equal(result_name(ack.result), ACCEPTED, f"confirmation {number}")
    return "3 times ACCEPTED"


def _same_mode(vehicle: VehicleUnderTest) -> str:
    flying.set_ready_mode(vehicle)
    return equal(vehicle.result(set_mode(vehicle.target, vehicle.mode)), ACCEPTED, "the present mode")


checks("commands", (
    ("ack.names_the_command", "The acknowledgement carries the number of the command.",
     lambda v: equal(_ack(v).command, REQUEST, "command") and "REQUEST_MESSAGE"),
    ("ack.names_the_station",
     "The acknowledgement is addressed to the commanding station, or to all systems.",
     _names_the_station),
    ("ack.comes_once", "One command brings one acknowledgement.", _comes_once),
    ("ack.is_quick", "At least four of five short commands are acknowledged within 1 s; a link may lose one.",
     _is_quick),
    ("unknown.long", "An unknown command is UNSUPPORTED.",
     lambda v: equal(v.command(NO_SUCH_COMMAND), "UNSUPPORTED", f"command {NO_SUCH_COMMAND}")),
    ("unknown.int", "An unknown COMMAND_INT is UNSUPPORTED.",
     lambda v: equal(v.result(v.command_int(NO_SUCH_COMMAND)), "UNSUPPORTED", "COMMAND_INT")),
    ("int.same_as_long", "A command without a position has the same result as COMMAND_INT and COMMAND_LONG.",
     lambda v: equal(v.result(v.command_int(REQUEST, VERSION)), v.result(_request(v)), "COMMAND_INT")),
    ("repeated.confirmation",
     "A repeated command with a higher confirmation number is acknowledged like the first command.",
     _confirmation),
    ("repeated.mode", "A command for the present mode is accepted.", _same_mode),
    ("parameters.nan_is_unset", "NaN in unused parameters of a command has no effect.",
     lambda v: equal(v.command(REQUEST, VERSION, *[math.nan] * 5), ACCEPTED, "REQUEST_MESSAGE")),
))  # fmt: skip


# -- targets and stations --------------------------------------------------------------------------------


def _not_executed(vehicle: VehicleUnderTest, message: Any) -> str:
    allowed = [[]] if vehicle.dialect.name == "ardupilot" else [[], ["FAILED"]]
    mark = vehicle.send(message)
    vehicle.wait(1.5)
    equal(vehicle.since(mark, "AUTOPILOT_VERSION"), [], "AUTOPILOT_VERSION")
    seen = _results(vehicle, mark)
    holds(seen in allowed, f"expected one of the answers {allowed}, saw {seen}")
    return ", ".join(seen) or "no answer"


def _another_vehicle_int(vehicle: VehicleUnderTest) -> str:
    message = vehicle.command_int(REQUEST, VERSION)
    message.target_system = vehicle.unused_sysid()
    return _not_executed(vehicle, message)


def _all_systems(vehicle: VehicleUnderTest) -> str:
    capabilities = mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES
    command, param = vehicle.known(ardupilot=(REQUEST, VERSION), px4=(capabilities, 1))
    mark = vehicle.send(vehicle.command_long(command, param, to=(0, 0)))
    return str(vehicle.expect("AUTOPILOT_VERSION", mark=mark).get_type())


def _all_components(vehicle: VehicleUnderTest) -> str:
    vehicle.ask(_request(vehicle, to=(vehicle.identity.sysid, 0)), "COMMAND_ACK")
    return "answered"


def _other_component(vehicle: VehicleUnderTest) -> str:
    expected = vehicle.known(ardupilot=(ACCEPTED, True), px4=("FAILED", False))
    mark = vehicle.send(_request(vehicle, to=(vehicle.identity.sysid, 77)))
    ack = vehicle.expect("COMMAND_ACK", lambda m: m.command == REQUEST, mark=mark)
    vehicle.wait(0.5)
    executed = bool(vehicle.since(mark, "AUTOPILOT_VERSION"))
    return equal((result_name(ack.result), executed), expected, "result, executed")[0]


def _any_station(vehicle: VehicleUnderTest) -> str:
    target, expected = _ack(vehicle, SECOND_STATION).target_system, (0, SECOND_STATION[0])
    holds(target in expected, f"expected one of {expected}, saw {target}")
    return f"acknowledged to {target}"


def _two_at_once(vehicle: VehicleUnderTest) -> str:
    mark = vehicle.send(_request(vehicle))
    vehicle.send(_request(vehicle), SECOND_STATION)
    vehicle.wait(1.5)
    targets = [m.target_system for m in vehicle.since(mark, "COMMAND_ACK") if m.command == REQUEST]
    equal(len(targets), 2, "acknowledgements")
    return f"to {targets}"


checks("commands", (
    ("target.another_vehicle",
     "A command to another system is not executed; ArduPilot does not answer it, PX4 answers FAILED.",
     lambda v: _not_executed(v, _request(v, to=(v.unused_sysid(), 1))), FOREIGN),
    ("target.another_vehicle_int",
     "A COMMAND_INT to another system is not executed; ArduPilot is silent, PX4 answers FAILED.",
     _another_vehicle_int, FOREIGN),
    ("target.broadcast", "A command to system 0 reaches the vehicle; PX4 executes only a few such commands.",
     _all_systems),
    ("target.all_components", "A command to component 0 reaches the autopilot.", _all_components),
    ("target.other_component", "A command to component 77 is executed by ArduPilot; PX4 answers FAILED.",
     _other_component, f"AUTOPILOTS 1.15: target_component is ignored; {FOREIGN}"),
    ("station.any_is_obeyed",
     "The command of a second ground station is acknowledged, to that station or to all systems.",
     _any_station, "AUTOPILOTS 1.15: commands from any GCS sysid are obeyed"),
    ("station.two_at_once",
     "The vehicle acknowledges two commands that two stations send at the same moment.", _two_at_once),
))  # fmt: skip


# -- numbers that are none, and progress -----------------------------------------------------------------


@check(
    "commands.parameters.no_number",
    needs=[CRASH],
    source="ArduPilot GCS_Common.cpp, handle_command_request_message: converts the id without a check",
)
def no_number(vehicle: VehicleUnderTest) -> str:
    """A message id of NaN, infinity or 1e30 is answered, and the next command works.

    ArduPilot SITL ends with a floating point exception, unless SIM_FLOAT_EXCEPT is 0.
    """
    seen = [vehicle.command(REQUEST, value) for value in (math.nan, math.inf, -math.inf, 1e30)]
    _next_is_accepted(vehicle)
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
    count = len(vehicle.since(vehicle.wait(2.0), "ATTITUDE"))
    vehicle.set_interval("ATTITUDE", 0)
    holds(count <= 200, f"expected at most 200 ATTITUDE in 2 s, saw {count}")
    return f"{count} in 2 s"


def _wait_for_end(vehicle: VehicleUnderTest, mark: int) -> None:
    """Wait for the final acknowledgement of the calibration."""
    vehicle.expect(
        "COMMAND_ACK",
        lambda m: m.command == CALIBRATE and m.result != mavlink.MAV_RESULT_IN_PROGRESS,
        within_s=CALIBRATION_S,
        mark=mark,
        description="a final acknowledgement",
    )


@check("commands.progress.ends_in_a_result", needs=[ALTER], limit_s=120)
def ends_in_a_result(vehicle: VehicleUnderTest) -> str:
    """A gyroscope calibration has one final acknowledgement, and it comes last, within 60 s."""
    mark = vehicle.send(vehicle.command_long(CALIBRATE, 1))
    _wait_for_end(vehicle, mark)
    vehicle.wait(3.0)
    results = _results(vehicle, mark, CALIBRATE)
    if results == ["UNSUPPORTED"]:
        raise Skip("the vehicle does not calibrate on command")
    equal(results[-1:], [name for name in results if name != "IN_PROGRESS"], "final results, one and last")
    return " then ".join(results)


def _cancel(vehicle: VehicleUnderTest, command: int) -> None:
    payload = struct.pack("<HBB", command, *vehicle.target)
    vehicle.send_raw(frame(vehicle.sender, COMMAND_CANCEL, payload, COMMAND_CANCEL_EXTRA))


@check("commands.progress.can_be_cancelled", needs=[ALTER], limit_s=120)
def can_be_cancelled(vehicle: VehicleUnderTest) -> str:
    """After COMMAND_CANCEL, a command in progress has a final acknowledgement within 60 s."""
    mark = vehicle.send(vehicle.command_long(CALIBRATE, 1))
    vehicle.expect("COMMAND_ACK", lambda m: m.command == CALIBRATE, within_s=CALIBRATION_S, mark=mark)
    first = _results(vehicle, mark, CALIBRATE)[0]
    if first != "IN_PROGRESS":
        raise Skip(f"the calibration ended at once with {first}: nothing to cancel")
    _cancel(vehicle, CALIBRATE)
    _wait_for_end(vehicle, mark)
    return _results(vehicle, mark, CALIBRATE)[-1]


@check("commands.progress.nothing_to_cancel")
def nothing_to_cancel(vehicle: VehicleUnderTest) -> str:
    """After COMMAND_CANCEL without a command in progress, the next command is accepted."""
    _cancel(vehicle, REQUEST)
    vehicle.wait(0.5)
    return f"the next command is {_next_is_accepted(vehicle)}"


@check("commands.target.broadcast_is_refused", dialects=("px4",), source=FOREIGN)
def px4_refuses_system_0(vehicle: VehicleUnderTest) -> str:
    """PX4 does not execute REQUEST_MESSAGE to system 0."""
    return _not_executed(vehicle, _request(vehicle, to=(0, 0)))
