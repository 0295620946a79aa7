"""The ends of a flight: coming back, taking off, landing."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.guard import ARM
from sim_vehicle.conformance.peer import Peer
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import equal, holds, near, result_name


@check("flight.land.can_be_broken_off", airborne=True, kind="copter", limit_s=300)
def land_broken_off(peer: Peer) -> str:
    """Another mode ends a landing in the air."""
    flying.set_mode(peer, "land")
    peer.wait(3.0)
    flying.set_mode(peer, "hold")
    peer.wait(3.0)
    height = flying.height_m(peer)
    peer.wait(4.0)
    near(flying.height_m(peer), height, 1.0, "height")
    holds(peer.armed, "it disarmed")
    return f"at {height:.1f} m"


@check("flight.return.comes_home", airborne=True, kind="copter", limit_s=400)
def return_home(peer: Peer) -> str:
    """RETURN_TO_LAUNCH brings it to within five metres of home, down, and disarmed."""
    home = peer.request("HOME_POSITION")
    target = home.latitude, home.longitude
    away = plans.moved(target, 30.0, 0.0)
    flying.reposition(peer, away, 20.0)
    flying.gets_to(peer, away, 60, 5)
    peer.accepted(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    peer.until(flying.in_mode(peer, "return"), "the return mode", flying.HEARTBEAT_LAG_S)
    took_s = peer.until(lambda: not peer.armed, "landed and disarmed", 240)
    off_m = flying.away_m(peer, target)
    holds(off_m < 5, f"landed {off_m:.1f} m from home")
    return f"{off_m:.2f} m from home after {took_s:.0f} s"


@check("flight.return.circles_home", airborne=True, kind="plane", limit_s=400)
def return_plane(peer: Peer) -> str:
    """RETURN_TO_LAUNCH brings a plane back to circle near home."""
    home = peer.request("HOME_POSITION")
    target = home.latitude, home.longitude
    peer.accepted(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    took_s = flying.gets_to(peer, target, 200.0, 250.0)
    peer.wait(10.0)
    holds(flying.away_m(peer, target) < 400, f"{flying.away_m(peer, target):.0f} m from home")
    return f"near home after {took_s:.0f} s"


@check("flight.takeoff.reaches_the_height", needs=[ARM], kind="copter", limit_s=300)
def takeoff_height(peer: Peer) -> str:
    """NAV_TAKEOFF climbs to the height asked for and stays there."""
    flying.stream_flight(peer)
    flying.arm(peer)
    equal(result_name(peer.result(flying.takeoff_command(peer, 15.0))), "ACCEPTED", "NAV_TAKEOFF")
    took_s = peer.until(lambda: flying.height_m(peer) > 14.0, "a height of 14 m", 60)
    peer.wait(5.0)
    near(flying.height_m(peer), 15.0, 1.5, "height")
    return f"{flying.height_m(peer):.1f} m after {took_s:.0f} s"


@check("flight.land.comes_down", airborne=True, kind="copter", limit_s=300)
def land_comes_down(peer: Peer) -> str:
    """NAV_LAND brings it down where it is; then it disarms and says ON_GROUND."""
    place = flying.place(peer)
    peer.accepted(mavlink.MAV_CMD_NAV_LAND)
    took_s = peer.until(lambda: not peer.armed, "landed and disarmed", 120)
    off_m = flying.away_m(peer, place)
    holds(off_m < 4, f"landed {off_m:.1f} m away")
    near(flying.height_m(peer), 0.0, 2.0, "height")
    peer.wait(1.0)
    state = peer.request("EXTENDED_SYS_STATE").landed_state
    equal(state, mavlink.MAV_LANDED_STATE_ON_GROUND, "landed_state")
    return f"after {took_s:.0f} s, {off_m:.2f} m away"
