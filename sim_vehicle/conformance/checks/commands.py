"""COMMAND_LONG and COMMAND_INT: acknowledgement, targets, repetition, progress."""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, frames
from sim_vehicle.conformance.guard import ALTER
from sim_vehicle.conformance.peer import SECOND_STATION, STATION, Peer, known
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import CheckFailed, Skip, equal, holds, id_of, result_name

NO_SUCH_COMMAND = 31_999
VERSION = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
REQUEST = mavlink.MAV_CMD_REQUEST_MESSAGE
CALIBRATION_S = 60.0


@check("commands.ack.names_the_command")
def names_the_command(peer: Peer) -> str:
    """The acknowledgement carries the number of the command."""
    ack = peer.ask(peer.command_long(REQUEST, VERSION), "COMMAND_ACK")
    equal(ack.command, REQUEST, "command")
    return "REQUEST_MESSAGE"


@check("commands.ack.names_the_station")
def names_the_station(peer: Peer) -> str:
    """The acknowledgement is addressed to the station that commanded, or to everybody."""
    ack = peer.ask(peer.command_long(REQUEST, VERSION), "COMMAND_ACK")
    holds((ack.target_system, ack.target_component) in (STATION, (0, 0), (STATION[0], 0)),
          f"expected {STATION}, saw {(ack.target_system, ack.target_component)}")  # fmt: skip
    return f"{ack.target_system}, {ack.target_component}"


@check("commands.ack.comes_once")
def comes_once(peer: Peer) -> str:
    """One command brings one acknowledgement."""
    mark = peer.mark()
    peer.send(peer.command_long(REQUEST, VERSION))
    peer.wait(1.5)
    acks = [m for m in peer.since(mark, "COMMAND_ACK") if m.command == REQUEST]
    equal(len(acks), 1, "acknowledgements")
    return "1"


@check("commands.ack.is_quick")
def is_quick(peer: Peer) -> str:
    """The acknowledgement of a quick command comes within a second."""
    began_s = peer.now
    peer.ask(peer.command_long(REQUEST, VERSION), "COMMAND_ACK", within_s=1.0)
    return f"{(peer.now - began_s) * 1000:.0f} ms"


@check("commands.unknown.long")
def unknown_long(peer: Peer) -> str:
    """A command nobody has is UNSUPPORTED."""
    equal(result_name(peer.command(NO_SUCH_COMMAND)), "UNSUPPORTED", f"command {NO_SUCH_COMMAND}")
    return "UNSUPPORTED"


@check("commands.unknown.int")
def unknown_int(peer: Peer) -> str:
    """As COMMAND_INT, too."""
    equal(result_name(peer.result(peer.command_int(NO_SUCH_COMMAND))), "UNSUPPORTED", "COMMAND_INT")
    return "UNSUPPORTED"


@check("commands.int.same_as_long")
def int_same_as_long(peer: Peer) -> str:
    """A command without a place gives the same as COMMAND_INT as COMMAND_LONG."""
    as_long = peer.command(REQUEST, VERSION)
    as_int = peer.result(peer.command_int(REQUEST, VERSION))
    equal(result_name(as_int), result_name(as_long), "COMMAND_INT")
    return result_name(as_int)


@check("commands.repeated.confirmation")
def repeated_confirmation(peer: Peer) -> str:
    """A repetition with a higher confirmation is acknowledged like the first."""
    results = []
    for confirmation in range(3):
        message = peer.command_long(REQUEST, VERSION, confirmation=confirmation)
        results.append(peer.ask(message, "COMMAND_ACK", lambda m: m.command == REQUEST).result)
    equal(set(results), {mavlink.MAV_RESULT_ACCEPTED}, "results")
    return "3 times ACCEPTED"


@check("commands.repeated.mode")
def repeated_mode(peer: Peer) -> str:
    """Commanding the mode the vehicle is in is accepted."""
    flying.ready_mode(peer)
    equal(result_name(peer.result(flying.mode_command(peer, peer.mode))), "ACCEPTED", "the mode it is in")
    return "ACCEPTED"


@check("commands.target.another_vehicle")
def another_vehicle(peer: Peer) -> str:
    """A command to another system is neither executed nor answered."""
    return _unanswered(peer, peer.command_long(REQUEST, VERSION, to=(peer.stranger(), 1)))


@check("commands.target.another_vehicle_int")
def another_vehicle_int(peer: Peer) -> str:
    """A COMMAND_INT to another system is neither executed nor answered."""
    message = peer.command_int(REQUEST, VERSION)
    message.target_system = peer.stranger()
    return _unanswered(peer, message)


def _unanswered(peer: Peer, message: Any) -> str:
    mark = peer.mark()
    peer.send(message)
    peer.none("COMMAND_ACK", during_s=1.5, mark=mark)
    equal(peer.since(mark, "AUTOPILOT_VERSION"), [], "AUTOPILOT_VERSION")
    return "no answer"


@check("commands.target.everybody")
def everybody(peer: Peer) -> str:
    """A command to system 0 reaches every system; PX4 takes only a few of them so."""
    command = known(peer, ardupilot=REQUEST, px4=mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES)
    params = (VERSION,) if command == REQUEST else (1,)
    mark = peer.mark()
    peer.send(peer.command_long(command, *params, to=(0, 0)))
    peer.expect("AUTOPILOT_VERSION", mark=mark)
    return "AUTOPILOT_VERSION"


@check("commands.target.all_components")
def all_components(peer: Peer) -> str:
    """Component 0 is every component."""
    peer.ask(peer.command_long(REQUEST, VERSION, to=(peer.facts.sysid, 0)), "COMMAND_ACK")
    return "answered"


@check("commands.target.other_component", pins="AUTOPILOTS 1.15: target_component is ignored")
def other_component(peer: Peer) -> str:
    """A command to component 77 is executed by ArduPilot, and by nobody else."""
    obeys = known(peer, ardupilot=True, px4=False)
    mark = peer.mark()
    peer.send(peer.command_long(REQUEST, VERSION, to=(peer.facts.sysid, 77)))
    seen = peer.maybe("COMMAND_ACK", mark=mark) is not None
    equal(seen, obeys, "answered")
    return "executed" if seen else "ignored"


@check("commands.station.any_is_obeyed", pins="AUTOPILOTS 1.15: commands from any GCS sysid are obeyed")
def any_station(peer: Peer) -> str:
    """Another ground station's command is executed, and acknowledged to that station."""
    ack = peer.ask(peer.command_long(REQUEST, VERSION), "COMMAND_ACK", source=SECOND_STATION)
    holds(ack.target_system in (0, SECOND_STATION[0]), f"acknowledged to {ack.target_system}")
    return f"acknowledged to {ack.target_system}"


@check("commands.station.two_at_once")
def two_at_once(peer: Peer) -> str:
    """Two stations that command at the same moment are both answered."""
    mark = peer.mark()
    for source in (STATION, SECOND_STATION):
        peer.send(peer.command_long(REQUEST, VERSION), source)
    peer.wait(1.5)
    targets = [m.target_system for m in peer.since(mark, "COMMAND_ACK") if m.command == REQUEST]
    equal(len(targets), 2, "acknowledgements")
    return f"to {targets}"


@check("commands.parameters.nan_is_unset")
def nan_is_unset(peer: Peer) -> str:
    """NaN in parameters a command does not use does no harm."""
    message = peer.command_long(REQUEST, VERSION, *[math.nan] * 5)
    equal(result_name(peer.result(message)), "ACCEPTED", "REQUEST_MESSAGE")
    return "ACCEPTED"


@check("commands.parameters.no_number")
def no_number(peer: Peer) -> str:
    """NaN, infinity and a huge number where a message id is needed are answered, and the vehicle lives on."""
    seen = [result_name(peer.command(REQUEST, value)) for value in (math.nan, math.inf, -math.inf, 1e30)]
    equal(result_name(peer.command(REQUEST, VERSION)), "ACCEPTED", "the next command")
    return ", ".join(seen)


@check("commands.parameters.message_interval_nan")
def interval_nan(peer: Peer) -> str:
    """An interval that is no number does not flood the link."""
    peer.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, id_of("ATTITUDE"), math.nan)
    peer.wait(0.5)
    mark = peer.wait(2.0)
    count = len(peer.since(mark, "ATTITUDE"))
    peer.set_interval("ATTITUDE", 0)
    holds(count <= 200, f"saw {count} ATTITUDE in 2 s")
    return f"{count} in 2 s"


@check("commands.progress.ends_in_a_result", needs=[ALTER], limit_s=120)
def ends_in_a_result(peer: Peer) -> str:
    """A gyroscope calibration is acknowledged, at once or after IN_PROGRESS, within a minute."""
    mark = peer.mark()
    result = peer.command(mavlink.MAV_CMD_PREFLIGHT_CALIBRATION, 1)
    ways = [result_name(m.result) for m in peer.since(mark, "COMMAND_ACK")]
    if result == mavlink.MAV_RESULT_UNSUPPORTED:
        raise Skip("does not calibrate on command")
    holds(result != mavlink.MAV_RESULT_IN_PROGRESS, "IN_PROGRESS was never followed by a result")
    return " then ".join(ways)


@check("commands.progress.can_be_cancelled", needs=[ALTER], limit_s=120)
def can_be_cancelled(peer: Peer) -> str:
    """COMMAND_CANCEL ends a command in progress with a final acknowledgement."""
    command = mavlink.MAV_CMD_PREFLIGHT_CALIBRATION
    mark = peer.mark()
    peer.send(peer.command_long(command, 1))
    first = peer.expect("COMMAND_ACK", lambda m: m.command == command, mark=mark)
    if first.result != mavlink.MAV_RESULT_IN_PROGRESS:
        raise Skip(f"answered {result_name(first.result)} at once: nothing to cancel")
    peer.send_raw(frames.command_cancel(peer, command))
    final = peer.maybe(
        "COMMAND_ACK",
        lambda m: m.command == command and m.result != mavlink.MAV_RESULT_IN_PROGRESS,
        within_s=CALIBRATION_S,
        mark=mark,
    )
    if final is None:
        raise CheckFailed(f"expected a final acknowledgement within {CALIBRATION_S:g} s")
    return result_name(final.result)


@check("commands.progress.nothing_to_cancel")
def nothing_to_cancel(peer: Peer) -> str:
    """COMMAND_CANCEL without a command in progress does no harm."""
    peer.send_raw(frames.command_cancel(peer, REQUEST))
    peer.wait(0.5)
    equal(result_name(peer.command(REQUEST, VERSION)), "ACCEPTED", "the next command")
    return "the next command is ACCEPTED"


@check("commands.target.everybody_is_not_px4", dialects=("px4",))
def everybody_is_not_px4(peer: Peer) -> str:
    """Any other command to system 0 PX4 neither executes nor answers, so that none arms a whole fleet."""
    return _unanswered(peer, peer.command_long(REQUEST, VERSION, to=(0, 0)))
