"""Flight modes on the ground: setting them, refusing them, telling them."""

import struct
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, frames
from sim_vehicle.conformance.peer import Peer, known
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import CheckFailed, Skip, equal, holds, result_name

ROLES = (
    "manual",
    "altitude",
    "position",
    "guided",
    "loiter",
    "circle",
    "hold",
    "return",
    "land",
    "stabilized",
)
NO_SUCH_MODE = 99
AVAILABLE = struct.Struct("<IIBBB35s")  # AVAILABLE_MODES as it travels
CURRENT = struct.Struct("<IIB")  # CURRENT_MODE as it travels


def _can_be_set(role: str) -> Callable[[Peer], str]:
    def run(peer: Peer) -> str:
        flying.mode_number(peer, role)
        flying.wait_ready(peer)
        flying.set_mode(peer, role)
        return flying.mode_name(peer, peer.mode)

    run.__doc__ = f"DO_SET_MODE for {role} is accepted on the ground, and the heartbeat follows."
    return run


for _role in ROLES:
    check(f"modes.set.{_role}", pins="AUTOPILOTS 1.5", limit_s=200)(_can_be_set(_role))


@check("modes.set.mission_when_empty", dialects=("ardupilot",), pins="AUTOPILOTS 1.9: an empty mission")
def mission_when_empty(peer: Peer) -> str:
    """AUTO without a mission is accepted while disarmed."""
    peer.send(mavlink.MAVLink_mission_clear_all_message(*peer.target, 0))
    peer.expect("MISSION_ACK")
    flying.set_mode(peer, "mission")
    return "ACCEPTED"


@check("modes.acks_are_true", limit_s=120)
def acks_are_true(peer: Peer) -> str:
    """A mode that is accepted shows in the heartbeat, one that is refused does not."""
    flying.ready_mode(peer)
    outcomes = []
    for role, number in peer.dialect.modes.items():
        before = peer.mode
        accepted = flying.try_mode(peer, role) == mavlink.MAV_RESULT_ACCEPTED
        peer.wait(flying.HEARTBEAT_LAG_S)
        if accepted and peer.mode != number:
            raise CheckFailed(f"{role} was accepted, the heartbeat says {flying.mode_name(peer, peer.mode)}")
        if not accepted and peer.mode != before:
            raise CheckFailed(f"{role} was refused, the heartbeat says {flying.mode_name(peer, peer.mode)}")
        outcomes.append(accepted)
    flying.ready_mode(peer)
    if not outcomes:
        raise Skip("the modes of this autopilot are not known")
    return f"{sum(outcomes)} accepted, {len(outcomes) - sum(outcomes)} refused"


@check("modes.unknown")
def unknown_mode(peer: Peer) -> str:
    """A mode number nobody has changes nothing, and is refused; PX4 accepts a main mode it does not know."""
    before = peer.mode
    result = peer.command(mavlink.MAV_CMD_DO_SET_MODE, 1, NO_SUCH_MODE)
    if peer.dialect.name != "px4":
        holds(result != mavlink.MAV_RESULT_ACCEPTED, "expected a refusal, saw ACCEPTED")
    peer.wait(flying.HEARTBEAT_LAG_S)
    equal(peer.mode, before, "mode")
    return result_name(result)


@check("modes.without_custom_flag", dialects=("ardupilot",))
def without_custom_flag(peer: Peer) -> str:
    """DO_SET_MODE without CUSTOM_MODE_ENABLED is refused: base modes mean nothing here."""
    before = peer.mode
    result = peer.command(mavlink.MAV_CMD_DO_SET_MODE, 0, flying.mode_number(peer, "return"))
    holds(result != mavlink.MAV_RESULT_ACCEPTED, "expected a refusal, saw ACCEPTED")
    equal(peer.mode, before, "mode")
    return result_name(result)


@check("modes.by_command_int")
def by_command_int(peer: Peer) -> str:
    """DO_SET_MODE works as COMMAND_INT."""
    flying.ready_mode(peer)
    command = flying.mode_command(peer, flying.mode_number(peer, "manual"))
    as_int = peer.command_int(command.command, command.param1, command.param2, command.param3)
    equal(result_name(peer.result(as_int)), "ACCEPTED", "COMMAND_INT")
    peer.until(flying.in_mode(peer, "manual"), "the mode in the heartbeat", flying.HEARTBEAT_LAG_S)
    return "ACCEPTED"


@check("modes.set_mode_message", pins="AUTOPILOTS 1.5: the SET_MODE message is not acked (PX4 does ack it)")
def set_mode_message(peer: Peer) -> str:
    """The message SET_MODE changes the mode; PX4 acknowledges it, ArduPilot does not."""
    acked = known(peer, ardupilot=False, px4=True)
    flying.ready_mode(peer)
    number, mark = flying.mode_number(peer, "manual"), peer.mark()
    flag = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    peer.send(mavlink.MAVLink_set_mode_message(peer.facts.sysid, flag, number))
    peer.until(lambda: peer.mode == number, "the mode in the heartbeat", flying.HEARTBEAT_LAG_S)
    equal(bool(peer.since(mark, "COMMAND_ACK")), acked, "acknowledged")
    return "acknowledged" if acked else "not acknowledged"


@check("modes.heartbeat_follows", pins="AUTOPILOTS 1.5: the heartbeat lags the ack by up to 1 s")
def heartbeat_follows(peer: Peer) -> str:
    """The heartbeat shows a new mode within a second and a half of the acknowledgement."""
    flying.ready_mode(peer)
    equal(result_name(flying.try_mode(peer, "manual")), "ACCEPTED", "manual")
    took_s = peer.until(flying.in_mode(peer, "manual"), "the mode in the heartbeat", 1.5)
    return f"{took_s:.2f} s"


@check("modes.survives_silence", limit_s=40)
def survives_silence(peer: Peer) -> str:
    """On the ground a mode stays while the station is silent."""
    flying.ready_mode(peer)
    before = peer.mode
    peer.quiet = True
    peer.wait(8.0)
    equal(peer.mode, before, "mode")
    return flying.mode_name(peer, before)


@check("modes.current_mode_message")
def current_mode_message(peer: Peer) -> str:
    """CURRENT_MODE, where it is told, agrees with the heartbeat."""
    custom_mode, _, _ = frames.requested(peer, frames.CURRENT_MODE, CURRENT)
    equal(custom_mode, peer.mode, "custom_mode")
    return flying.mode_name(peer, custom_mode)


@check("modes.available_modes")
def available_modes(peer: Peer) -> str:
    """AVAILABLE_MODES, where they are told, are numbered through and include the current mode."""
    frames.requested(peer, frames.AVAILABLE_MODES, AVAILABLE, 0)
    peer.wait(3.0)
    entries = [e for e in peer.heard if e.kind == f"UNKNOWN_{frames.AVAILABLE_MODES}"]
    modes = [frames.fields(entry, AVAILABLE) for entry in entries]
    total = modes[0][2]
    equal({mode[3] for mode in modes}, set(range(1, total + 1)), "mode_index")
    holds(peer.mode in {mode[0] for mode in modes}, f"the current mode {peer.mode} is not among them")
    return f"{total} modes"
