"""The current item of a mission."""

from functools import partial
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import plans
from sim_vehicle.conformance.peer import Peer, known
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import CheckFailed, equal, holds, result_name

NO_MISSION_TOTAL = 65_535


def _current(peer: Peer) -> Any:
    return peer.request("MISSION_CURRENT")


def _told(peer: Peer, mark: int, seq: int) -> bool:
    """Whether MISSION_CURRENT has said so since."""
    return any(message.seq == seq for message in peer.since(mark, "MISSION_CURRENT"))


@check("mission.current.total", pins="AUTOPILOTS 2: MISSION_CURRENT.total does not include home")
def current_total(peer: Peer) -> str:
    """MISSION_CURRENT.total is the number of items without home."""
    items = plans.sample_plan(peer)
    plans.put(peer, items)
    total = _current(peer).total
    if not peer.dialect.known and total == 0:
        return "not told"
    equal(total, len(items) - int(peer.dialect.home_item), "total")
    return str(total)


@check("mission.current.total_of_nothing", pins="AUTOPILOTS 2: total 65535 with no mission")
def total_of_nothing(peer: Peer) -> str:
    """With no mission total is 65535 for PX4; ArduPilot has 0 or 65535."""
    allowed = known(peer, ardupilot={0, NO_MISSION_TOTAL}, px4={NO_MISSION_TOTAL})
    plans.clear(peer)
    peer.wait(1.0)
    total = _current(peer).total
    holds(total in allowed, f"expected one of {sorted(allowed)}, saw {total}")
    return str(total)


@check("mission.current.state", pins="AUTOPILOTS 2: mission_state is 0 always (PX4)")
def current_state(peer: Peer) -> str:
    """mission_state: NO_MISSION and NOT_STARTED for ArduPilot, 0 always for PX4."""
    empty, waiting = known(peer, ardupilot=(1, 2), px4=(0, 0))
    plans.clear(peer)
    peer.wait(0.5)
    equal(_current(peer).mission_state, empty, "mission_state with no mission")
    plans.put(peer, plans.sample_plan(peer))
    peer.wait(0.5)
    state = _current(peer).mission_state
    holds(
        state == waiting or (peer.dialect.name == "ardupilot" and state == 5),
        f"expected {waiting}, saw {state}",
    )
    return f"{empty}, {state}"


@check("mission.current.set_by_message", pins="AUTOPILOTS 2: MISSION_SET_CURRENT (41) works")
def set_by_message(peer: Peer) -> str:
    """MISSION_SET_CURRENT makes an item current, and MISSION_CURRENT says so."""
    plans.put(peer, plans.sample_plan(peer))
    for seq in (2, 1):
        mark = peer.mark()
        peer.send(mavlink.MAVLink_mission_set_current_message(*peer.target, seq))
        peer.until(partial(_told, peer, mark, seq), f"MISSION_CURRENT {seq}", 3.0)
    return "2, then 1"


@check("mission.current.behind_the_end")
def set_behind_the_end(peer: Peer) -> str:
    """MISSION_SET_CURRENT of an item that is not there changes nothing."""
    items = plans.sample_plan(peer)
    plans.put(peer, items)
    peer.send(mavlink.MAVLink_mission_set_current_message(*peer.target, len(items) + 10))
    peer.wait(1.5)
    seq = _current(peer).seq
    holds(seq < len(items), f"expected an item below {len(items)}, saw {seq}")
    return f"seq {seq}"


@check("mission.current.set_by_command", pins="AUTOPILOTS 2: DO_SET_MISSION_CURRENT (224)")
def set_by_command(peer: Peer) -> str:
    """DO_SET_MISSION_CURRENT: ArduPilot accepts LONG and INT, PX4 has no such command."""
    expected = known(peer, ardupilot="ACCEPTED", px4="UNSUPPORTED")
    plans.put(peer, plans.sample_plan(peer))
    command = mavlink.MAV_CMD_DO_SET_MISSION_CURRENT
    equal(result_name(peer.command(command, 2)), expected, "COMMAND_LONG")
    equal(result_name(peer.result(peer.command_int(command, 3))), expected, "COMMAND_INT")
    if expected == "ACCEPTED":
        equal(_current(peer).seq, 3, "seq")
    return str(expected)


@check(
    "mission.current.command_behind_the_end",
    dialects=("ardupilot",),
    pins="AUTOPILOTS 2: out of range DENIED(2)",
)
def command_behind_the_end(peer: Peer) -> str:
    """DO_SET_MISSION_CURRENT of an item that is not there is DENIED."""
    items = plans.sample_plan(peer)
    plans.put(peer, items)
    result = peer.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, len(items) + 10)
    equal(result_name(result), "DENIED", "DO_SET_MISSION_CURRENT")
    return "DENIED"


@check(
    "mission.current.command_restart", dialects=("ardupilot",), pins="AUTOPILOTS 2: 0 = restart (goes to 1)"
)
def command_restart(peer: Peer) -> str:
    """DO_SET_MISSION_CURRENT 0 is accepted."""
    plans.put(peer, plans.sample_plan(peer))
    equal(result_name(peer.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 0)), "ACCEPTED", "index 0")
    seq = _current(peer).seq
    if seq > 1:
        raise CheckFailed(f"expected 0 or 1, saw {seq}")
    return f"seq {seq}"
