"""COMMAND_LONG and COMMAND_INT: acknowledgement, targets, repetition, progress."""

import math
from collections.abc import Callable, Iterable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying
from sim_vehicle.conformance.assertions import at_least, at_most, equal, holds, one_of
from sim_vehicle.conformance.guard import ALTER, CRASH
from sim_vehicle.conformance.outcomes import ACCEPTED, Skip, command_name, result_name
from sim_vehicle.conformance.registry import check, checks, row
from sim_vehicle.conformance.traffic import SECOND_STATION
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.definitions import COMMAND_CANCEL, DefinedMessage, id_of
from sim_vehicle.station.frames import STATION, ReceivedFrame, Source
from sim_vehicle.station.messages import set_mode

NO_SUCH_COMMAND = 31_999
VERSION = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
REQUEST, CALIBRATE = mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_PREFLIGHT_CALIBRATION
FOREIGN = "PX4 mavlink_receiver.cpp, handle_message_command_both: FAILED unless the target was seen"
CALIBRATION_S = 60.0  # longest wait for the end of a calibration


def _ack(vehicle: VehicleUnderTest, source: Source = STATION) -> Any:
    return vehicle.ask(vehicle.version_request(), "COMMAND_ACK", source=source)


def _acks(frames: Iterable[ReceivedFrame], command: int = REQUEST) -> list[Any]:
    return [f.message for f in frames if f.kind == "COMMAND_ACK" and f.message.command == command]


def _results(frames: Iterable[ReceivedFrame], command: int = REQUEST) -> list[str]:
    return [result_name(ack.result) for ack in _acks(frames, command)]


@check("commands.ack")
def names_the_command(vehicle: VehicleUnderTest) -> str:
    """The acknowledgement carries the number of the command."""
    return command_name(equal(_ack(vehicle).command, REQUEST, "command"))


@check("commands.ack")
def names_the_station(vehicle: VehicleUnderTest) -> str:
    """The acknowledgement is addressed to the commanding station, or to all systems."""
    ack = _ack(vehicle)
    seen = ack.target_system, ack.target_component
    one_of(seen, (STATION, (0, 0), (STATION[0], 0)), "target")
    return f"{ack.target_system}, {ack.target_component}"


@check("commands.ack")
def comes_once(vehicle: VehicleUnderTest) -> str:
    """One command brings one acknowledgement."""
    vehicle.send(vehicle.version_request())
    return str(equal(len(_acks(vehicle.wait(1.5))), 1, "acknowledgements"))


@check("commands.ack")
def is_quick(vehicle: VehicleUnderTest) -> str:
    """At least four of five short commands are acknowledged within 1 s; a link may lose one."""
    took_s = []
    for _ in range(5):
        began_s = vehicle.now
        vehicle.send(vehicle.version_request())
        if vehicle.wait_for("COMMAND_ACK", lambda m: m.command == REQUEST, within_s=1.0):
            took_s.append(vehicle.now - began_s)
    at_least(len(took_s), 4, "acknowledgements within 1 s")
    return f"up to {max(took_s) * 1000:.0f} ms"


@check("commands.repeated")
def confirmation(vehicle: VehicleUnderTest) -> None:
    """A repeated command with a higher confirmation number is acknowledged like the first command."""
    for number in range(3):
        ack = vehicle.ask(
            vehicle.version_request(confirmation=number), "COMMAND_ACK", lambda m: m.command == REQUEST
        )
        equal(result_name(ack.result), ACCEPTED, f"confirmation {number}")


@check("commands.repeated")
def mode(vehicle: VehicleUnderTest) -> str:
    """A command for the present mode is accepted."""
    flying.set_ready_mode(vehicle)
    return equal(vehicle.result(set_mode(vehicle.target, vehicle.mode)), ACCEPTED, "the present mode")


def _has_result(vehicle: VehicleUnderTest, build: Callable[[VehicleUnderTest], Any], expected: str) -> str:
    return equal(vehicle.result(build(vehicle)), expected, "result")


checks(
    "commands", _has_result,
    row("unknown.long", "An unknown command is UNSUPPORTED.",
        lambda v: v.command_long(NO_SUCH_COMMAND), "UNSUPPORTED"),
    row("unknown.int", "An unknown COMMAND_INT is UNSUPPORTED.",
        lambda v: v.command_int(NO_SUCH_COMMAND), "UNSUPPORTED"),
    row("parameters.nan_is_unset", "NaN in unused parameters of a command has no effect.",
        lambda v: v.command_long(REQUEST, VERSION, *[math.nan] * 5), ACCEPTED),
)  # fmt: skip


@check("commands.int")
def same_as_long(vehicle: VehicleUnderTest) -> str:
    """A command without a position has the same result as COMMAND_INT and COMMAND_LONG."""
    as_long = vehicle.result(vehicle.version_request())
    return equal(vehicle.result(vehicle.command_int(REQUEST, VERSION)), as_long, "COMMAND_INT")


def _not_executed(vehicle: VehicleUnderTest, build: Callable[[VehicleUnderTest], Any]) -> str:
    allowed = [[]] if vehicle.dialect.name == "ardupilot" else [[], ["FAILED"]]
    vehicle.send(build(vehicle))
    frames = vehicle.wait(1.5)
    holds(not any(f.kind == "AUTOPILOT_VERSION" for f in frames), "expected no AUTOPILOT_VERSION, saw one")
    return ", ".join(one_of(_results(frames), allowed, "answers")) or "no answer"


checks(
    "commands.target", _not_executed,
    row("another_vehicle",
        "A command to another system is not executed; ArduPilot does not answer it, PX4 answers FAILED.",
        lambda v: v.version_request(to=(v.unused_sysid(), 1))),
    row("another_vehicle_int",
        "A COMMAND_INT to another system is not executed; ArduPilot is silent, PX4 answers FAILED.",
        lambda v: v.command_int(REQUEST, VERSION, to=(v.unused_sysid(), 1))),
    row("broadcast_is_refused", "PX4 does not execute REQUEST_MESSAGE to system 0.",
        lambda v: v.version_request(to=(0, 0)), dialects=("px4",)),
    source=FOREIGN,
)  # fmt: skip


@check("commands.target")
def broadcast(vehicle: VehicleUnderTest) -> str:
    """A command to system 0 reaches the vehicle; PX4 executes only a few such commands."""
    capabilities = mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES
    command, param = vehicle.known(ardupilot=(REQUEST, VERSION), px4=(capabilities, 1))
    vehicle.send(vehicle.command_long(command, param, to=(0, 0)))
    return str(vehicle.expect("AUTOPILOT_VERSION").get_type())


@check("commands.target")
def all_components(vehicle: VehicleUnderTest) -> None:
    """A command to component 0 reaches the autopilot."""
    vehicle.ask(vehicle.version_request(to=(vehicle.identity.sysid, 0)), "COMMAND_ACK")


@check("commands.target", source=f"AUTOPILOTS 1.15: target_component is ignored; {FOREIGN}")
def other_component(vehicle: VehicleUnderTest) -> str:
    """A command to component 77 is executed by ArduPilot; PX4 answers FAILED."""
    expected = vehicle.known(ardupilot=(ACCEPTED, True), px4=("FAILED", False))
    mark = vehicle.mark()
    vehicle.send(vehicle.version_request(to=(vehicle.identity.sysid, 77)))
    ack = vehicle.expect("COMMAND_ACK", lambda m: m.command == REQUEST)
    vehicle.wait(0.5)
    executed = bool(vehicle.since(mark, "AUTOPILOT_VERSION"))
    return equal((result_name(ack.result), executed), expected, "result, executed")[0]


@check("commands.station", source="AUTOPILOTS 1.15: commands from any GCS sysid are obeyed")
def any_is_obeyed(vehicle: VehicleUnderTest) -> str:
    """The command of a second ground station is acknowledged, to that station or to all systems."""
    target = _ack(vehicle, SECOND_STATION).target_system
    return f"acknowledged to {one_of(target, (0, SECOND_STATION[0]), 'target')}"


@check("commands.station")
def two_at_once(vehicle: VehicleUnderTest) -> str:
    """The vehicle acknowledges two commands that two stations send at the same moment."""
    vehicle.send(vehicle.version_request())
    vehicle.send(vehicle.version_request(), SECOND_STATION)
    targets = [ack.target_system for ack in _acks(vehicle.wait(1.5))]
    equal(len(targets), 2, "acknowledgements")
    return f"to {targets}"


@check(
    "commands.parameters",
    needs=[CRASH],
    source="ArduPilot GCS_Common.cpp, handle_command_request_message: converts the id without a check",
)
def no_number(vehicle: VehicleUnderTest) -> str:
    """A message id of NaN, infinity or 1e30 is answered, and the next command works.

    ArduPilot SITL ends with a floating point exception, unless SIM_FLOAT_EXCEPT is 0.
    """
    seen = [vehicle.command(REQUEST, value) for value in (math.nan, math.inf, -math.inf, 1e30)]
    vehicle.expect_answer()
    return ", ".join(seen)


@check(
    "commands.parameters",
    needs=[CRASH],
    source="ArduPilot GCS_Common.cpp, handle_command_set_message_interval: converts without a check",
)
def message_interval_nan(vehicle: VehicleUnderTest) -> str:
    """An interval of NaN for ATTITUDE causes at most 200 messages in 2 s."""
    vehicle.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, id_of("ATTITUDE"), math.nan)
    vehicle.wait(0.5)
    count = len(vehicle.listen("ATTITUDE", 2.0))
    vehicle.set_interval("ATTITUDE", 0)
    return f"{at_most(count, 200, 'ATTITUDE in 2 s')} in 2 s"


def _wait_for_end(vehicle: VehicleUnderTest, mark: int) -> Any:
    """Return the final acknowledgement of the calibration that began at a mark."""
    return vehicle.expect(
        "COMMAND_ACK",
        lambda m: m.command == CALIBRATE and m.result != mavlink.MAV_RESULT_IN_PROGRESS,
        within_s=CALIBRATION_S,
        mark=mark,
        description="a final acknowledgement",
    )


@check("commands.progress", needs=[ALTER])
def ends_in_a_result(vehicle: VehicleUnderTest) -> str:
    """A gyroscope calibration has one final acknowledgement, and it comes last, within 60 s."""
    mark = vehicle.mark()
    vehicle.send(vehicle.command_long(CALIBRATE, 1))
    _wait_for_end(vehicle, mark)
    vehicle.wait(3.0)
    results = _results(vehicle.received[mark:], CALIBRATE)
    if results == ["UNSUPPORTED"]:
        raise Skip("the vehicle does not calibrate on command")
    equal(results[-1:], [name for name in results if name != "IN_PROGRESS"], "final results, one and last")
    return " then ".join(results)


def _cancel(vehicle: VehicleUnderTest, command: int) -> None:
    sysid, component = vehicle.target
    fields = {"command": command, "target_system": sysid, "target_component": component}
    vehicle.send(DefinedMessage(COMMAND_CANCEL, **fields))


@check("commands.progress", needs=[ALTER])
def can_be_cancelled(vehicle: VehicleUnderTest) -> str:
    """After COMMAND_CANCEL, a command in progress has a final acknowledgement within 60 s."""
    mark = vehicle.mark()
    vehicle.send(vehicle.command_long(CALIBRATE, 1))
    ack = vehicle.expect("COMMAND_ACK", lambda m: m.command == CALIBRATE, within_s=CALIBRATION_S)
    first = result_name(ack.result)
    if first != "IN_PROGRESS":
        raise Skip(f"the calibration ended at once with {first}: nothing to cancel")
    _cancel(vehicle, CALIBRATE)
    return result_name(_wait_for_end(vehicle, mark).result)


@check("commands.progress")
def nothing_to_cancel(vehicle: VehicleUnderTest) -> None:
    """After COMMAND_CANCEL without a command in progress, the next command is accepted."""
    _cancel(vehicle, REQUEST)
    vehicle.wait(0.5)
    vehicle.expect_answer()
