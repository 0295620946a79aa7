"""A small mission that is flown, from the ground or from the air."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.peer import Peer
from sim_vehicle.conformance.plans import Item

CORNERS = ((40.0, 0.0), (40.0, 40.0), (0.0, 40.0))  # metres north and east of the start
HEIGHT_M = 12.0


def items(peer: Peer, *, landing: bool = True) -> list[Item]:
    """A take-off and three corners from where the vehicle is, with a landing at the last or without."""
    place = plans.here(peer)
    flown = [plans.takeoff(place, HEIGHT_M), *[plans.waypoint(place, n, e, HEIGHT_M) for n, e in CORNERS]]
    if landing:
        flown.append(plans.land(place, *CORNERS[-1]))
    return plans.plan(peer, *flown)


def rewind(peer: Peer) -> None:
    """Make the first item current: the index of a mission before may have outlived it."""
    first = int(peer.dialect.home_item)
    peer.send(mavlink.MAVLink_mission_set_current_message(*peer.target, first))


def start(peer: Peer) -> None:
    """Begin the stored mission from the ground."""
    flying.stream_flight(peer)
    rewind(peer)
    flying.arm(peer)
    if peer.dialect.name == "ardupilot":
        peer.accepted(mavlink.MAV_CMD_MISSION_START)
    else:
        flying.set_mode(peer, "mission")
    peer.until(flying.in_mode(peer, "mission"), "the mission mode", flying.HEARTBEAT_LAG_S)


def resume(peer: Peer, seq: int) -> None:
    """Fly the stored mission from an item on, from the air."""
    peer.send(mavlink.MAVLink_mission_set_current_message(*peer.target, seq))
    flying.set_mode(peer, "mission")


def current(peer: Peer) -> int:
    """The current item, as last told; -1 before that."""
    return int(peer.last["MISSION_CURRENT"].message.seq) if "MISSION_CURRENT" in peer.last else -1


def first_waypoint(peer: Peer) -> int:
    """Sequence number of the first waypoint behind the take-off."""
    return 2 if peer.dialect.home_item else 1


def until_current(peer: Peer, seq: int, within_s: float = 120.0) -> float:
    """Wait until an item or a later one is current; how long it took [s]."""
    return peer.until(lambda: current(peer) >= seq, f"item {seq} to be current", within_s)


def under_way(peer: Peer) -> int:
    """From the air, between the first and the second waypoint of a mission; the number of the second."""
    place = plans.here(peer)
    plans.put(peer, items(peer, landing=False))
    seq = first_waypoint(peer) + 1
    resume(peer, seq - 1)
    until_current(peer, seq)
    passed = plans.moved(place, *CORNERS[0])
    peer.until(lambda: flying.away_m(peer, passed) > 10.0, "it to leave the first waypoint", 20.0)
    return seq
