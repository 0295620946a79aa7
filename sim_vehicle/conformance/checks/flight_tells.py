"""What a vehicle tells while it flies."""

import math

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.peer import Peer
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import Skip, holds, near


@check("flight.tells.velocity", airborne=True, kind="copter", limit_s=300)
def tells_velocity(peer: Peer) -> str:
    """vx and vy [cm/s] are how the position changes."""
    flying.reposition(peer, plans.moved(flying.place(peer), 60.0, 60.0), 20.0)
    peer.wait(3.0)
    mark = peer.wait(4.0)
    messages = peer.since(mark, "GLOBAL_POSITION_INT")
    seconds = (messages[-1].time_boot_ms - messages[0].time_boot_ms) / 1000
    first, last = ((m.lat, m.lon) for m in (messages[0], messages[-1]))
    flown_m = plans.distance_m(first, last)
    told_m = sum(math.hypot(m.vx, m.vy) / 100 for m in messages) / len(messages) * seconds
    holds(flown_m > 3.0, f"it hardly moved: {flown_m:.1f} m")
    near(told_m, flown_m, 0.15 * flown_m + 1.0, "metres by velocity")
    return f"{flown_m:.1f} m flown, {told_m:.1f} m told"


@check("flight.tells.local_position", airborne=True, kind="copter", limit_s=300)
def tells_local(peer: Peer) -> str:
    """LOCAL_POSITION_NED moves with GLOBAL_POSITION_INT, z is down."""
    rates = {"LOCAL_POSITION_NED": 5.0, "GLOBAL_POSITION_INT": 5.0}
    begin = {k: v[-1] for k, v in peer.sample(rates, 1.0).items()}
    flying.stream_flight(peer)
    flying.reposition(peer, plans.moved(flying.place(peer), -30.0, 30.0), 28.0)
    peer.wait(20.0)
    end = {k: v[-1] for k, v in peer.sample(rates, 1.0).items()}
    flying.stream_flight(peer)
    local_a, local_b = begin["LOCAL_POSITION_NED"], end["LOCAL_POSITION_NED"]
    global_a, global_b = begin["GLOBAL_POSITION_INT"], end["GLOBAL_POSITION_INT"]
    local_m = math.hypot(local_b.x - local_a.x, local_b.y - local_a.y)
    near(
        local_m,
        plans.distance_m((global_a.lat, global_a.lon), (global_b.lat, global_b.lon)),
        2.0,
        "metres moved",
    )
    near(local_a.z - local_b.z, (global_b.alt - global_a.alt) / 1000, 1.5, "metres climbed")
    return f"{local_m:.1f} m"


@check("flight.tells.climb", airborne=True, kind="copter", limit_s=300)
def tells_climb(peer: Peer) -> str:
    """While it climbs vz is negative and VFR_HUD.climb positive."""
    place, height = flying.place(peer), flying.height_m(peer)
    flying.reposition(peer, place, height + 15.0)
    with peer.streaming({"VFR_HUD": 5.0}):
        peer.wait(4.0)
        hud, position = peer.last["VFR_HUD"].message, peer.last["GLOBAL_POSITION_INT"].message
    holds(position.vz < -30, f"vz is {position.vz} cm/s")
    holds(hud.climb > 0.3, f"climb is {hud.climb} m/s")
    near(hud.climb, -position.vz / 100, 0.6, "climb")
    flying.reposition(peer, place, 20.0)
    peer.wait(8.0)
    return f"{hud.climb:.2f} m/s"


@check("flight.tells.airspeed", airborne=True, kind="plane", limit_s=300)
def tells_airspeed(peer: Peer) -> str:
    """A plane's airspeed is that of a plane, and the throttle a percentage."""
    hud = peer.sample({"VFR_HUD": 5.0}, 2.0)["VFR_HUD"][-1]
    holds(5 < hud.airspeed < 60, f"airspeed {hud.airspeed:.1f} m/s")
    holds(0 <= hud.throttle <= 100, f"throttle {hud.throttle}")
    return f"{hud.airspeed:.1f} m/s, {hud.throttle} %"


@check("flight.tells.battery", airborne=True, limit_s=300)
def tells_battery(peer: Peer) -> str:
    """In the air the battery drains: current flows, consumption grows, the rest does not."""
    first = peer.request("BATTERY_STATUS")
    peer.wait(10.0)
    second = peer.request("BATTERY_STATUS")
    if second.current_battery < 0:
        raise Skip("the current is not measured")
    holds(second.current_battery > 50, f"current {second.current_battery} cA")
    holds(second.current_consumed > first.current_consumed, f"consumed {second.current_consumed} mAh")
    holds(second.battery_remaining <= first.battery_remaining, "the rest grew")
    used_mah = second.current_consumed - first.current_consumed
    return f"{second.current_battery / 100:.1f} A, {used_mah} mAh in 10 s"
