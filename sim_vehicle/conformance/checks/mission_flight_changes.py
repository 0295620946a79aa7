"""Missions that are changed, interrupted or jumped about in while they are flown."""

from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, missions, plans
from sim_vehicle.conformance.peer import Peer, known
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import equal, holds, mission_result_name, near, result_name

FLY_S = 300.0
PASS_M = 4.0
SET_CURRENT = mavlink.MAV_CMD_DO_SET_MISSION_CURRENT


@check("mission-flight.jump_by_message", airborne=True, kind="copter", limit_s=FLY_S)
def jump_by_message(peer: Peer) -> str:
    """MISSION_SET_CURRENT in flight sends it to another waypoint."""
    seq = missions.under_way(peer)
    place = plans.download(peer)[seq - 1]
    peer.send(mavlink.MAVLink_mission_set_current_message(*peer.target, seq - 1))
    peer.until(lambda: missions.current(peer) == seq - 1, f"item {seq - 1} to be current", 5.0)
    took_s = peer.until(lambda: flying.away_m(peer, (place.x, place.y)) < PASS_M, "the waypoint", 60)
    return f"item {seq - 1} after {took_s:.0f} s"


@check(
    "mission-flight.jump_by_command",
    airborne=True,
    kind="copter",
    dialects=("ardupilot",),
    limit_s=FLY_S,
    pins="AUTOPILOTS 2: DO_SET_MISSION_CURRENT (224)",
)
def jump_by_command(peer: Peer) -> str:
    """DO_SET_MISSION_CURRENT in flight makes another item current."""
    seq = missions.under_way(peer)
    peer.accepted(SET_CURRENT, seq - 1)
    peer.until(lambda: missions.current(peer) == seq - 1, f"item {seq - 1} to be current", 3.0)
    return f"item {seq - 1}"


@check(
    "mission-flight.pause_and_go_on",
    airborne=True,
    kind="copter",
    limit_s=FLY_S,
    pins="AUTOPILOTS 2: pause/continue (193) ACCEPTED, mission_state 4",
)
def pause_and_go_on(peer: Peer) -> str:
    """DO_PAUSE_CONTINUE stops ArduPilot and lets it go on; for PX4 it is the hold and mission modes."""
    by_command = known(peer, ardupilot=True, px4=False)
    seq = missions.under_way(peer)
    if by_command:
        peer.accepted(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0)
    else:
        equal(
            result_name(peer.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0)),
            "UNSUPPORTED",
            "DO_PAUSE_CONTINUE",
        )
        flying.set_mode(peer, "hold")
    peer.until(lambda: flying.speed_m_s(peer) < 0.6, "a standstill", 15)
    if by_command:
        peer.wait(1.0)
        state = peer.last["MISSION_CURRENT"].message.mission_state
        equal(state, mavlink.MISSION_STATE_PAUSED, "mission_state")
        peer.accepted(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 1)
    else:
        flying.set_mode(peer, "mission")
    peer.until(lambda: flying.speed_m_s(peer) > 1.0, "it to go on", 15)
    equal(missions.current(peer) in (seq, seq + 1), True, "the same item")
    return "stopped, and went on"


@check(
    "mission-flight.clear_in_flight",
    airborne=True,
    kind="copter",
    limit_s=FLY_S,
    pins="AUTOPILOTS 2: CLEAR_ALL while flying the mission",
)
def clear_in_flight(peer: Peer) -> str:
    """Clearing in flight: ERROR from ArduPilot in AUTO; PX4 accepts and loiters."""
    expected = known(peer, ardupilot="ERROR", px4="ACCEPTED")
    missions.under_way(peer)
    seen = mission_result_name(plans.clear(peer))
    equal(seen, expected, "MISSION_CLEAR_ALL")
    if seen == "ACCEPTED":
        peer.until(flying.in_mode(peer, "hold"), "the hold mode", 5.0)
    else:
        peer.wait(2.0)
        equal(peer.mode, flying.mode_number(peer, "mission"), "mode")
    holds(peer.armed, "it disarmed")
    return seen


@check(
    "mission-flight.count_zero_in_flight",
    airborne=True,
    kind="copter",
    dialects=("ardupilot",),
    limit_s=FLY_S,
    pins="AUTOPILOTS 2: COUNT 0 is accepted in AUTO, vehicle then loiters",
)
def count_zero_in_flight(peer: Peer) -> str:
    """An empty upload in AUTO is accepted, and the vehicle stays in the air."""
    missions.under_way(peer)
    plans.put(peer, [])
    peer.wait(5.0)
    height = flying.height_m(peer)
    peer.wait(8.0)
    near(flying.height_m(peer), height, 2.0, "height")
    holds(flying.speed_m_s(peer) < 1.0, f"moves at {flying.speed_m_s(peer):.1f} m/s")
    return "ACCEPTED, loiters"


@check(
    "mission-flight.upload_in_flight",
    airborne=True,
    kind="copter",
    limit_s=FLY_S,
    pins="AUTOPILOTS 2: re-upload in AUTO/mission mode",
)
def upload_in_flight(peer: Peer) -> str:
    """A new mission in flight is accepted, the index is kept, and it flies what now sits there."""
    known(peer, ardupilot=True, px4=True)
    seq = missions.under_way(peer)
    place = plans.here(peer)
    old = plans.download(peer)
    items = [
        replace(plans.waypoint(place, 0, 0), command=i.command, x=i.x, y=i.y, z=i.z, frame=i.frame)
        for i in old
    ]
    target = plans.moved(place, -40.0, -30.0)
    items[seq] = replace(items[seq], x=target[0], y=target[1])
    plans.put(peer, items)
    peer.wait(1.5)
    equal(missions.current(peer), seq, "index")
    took_s = peer.until(lambda: flying.away_m(peer, target) < PASS_M, "the new waypoint", 90)
    return f"index {seq} kept, there after {took_s:.0f} s"


@check(
    "mission-flight.shorter_upload_in_flight",
    airborne=True,
    kind="copter",
    dialects=("px4",),
    limit_s=FLY_S,
    pins="AUTOPILOTS 2: shorter mission than the current index: index moved to last item",
)
def shorter_upload(peer: Peer) -> str:
    """A shorter mission in flight moves the index to its last item."""
    missions.under_way(peer)
    items = missions.items(peer, landing=False)[:2]
    plans.put(peer, items)
    peer.until(lambda: missions.current(peer) == len(items) - 1, f"item {len(items) - 1} to be current", 5.0)
    return f"index {len(items) - 1}"


@check(
    "mission-flight.abandoned_upload_in_flight",
    airborne=True,
    kind="copter",
    dialects=("px4",),
    limit_s=FLY_S,
    pins="AUTOPILOTS 2: upload is atomic? Yes: the old mission stays",
)
def abandoned_in_flight(peer: Peer) -> str:
    """An upload that dies in flight changes nothing of the flight."""
    seq = missions.under_way(peer)
    mark = peer.mark()
    peer.send(plans.count_message(peer, 4))
    plans.next_request(peer, plans.MISSION, mark=mark)
    peer.wait(7.0)
    holds(missions.current(peer) >= seq, f"expected item {seq} or later, saw {missions.current(peer)}")
    equal(peer.mode, flying.mode_number(peer, "mission"), "mode")
    return f"item {missions.current(peer)}"
