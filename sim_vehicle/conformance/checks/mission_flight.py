"""Missions that are flown, and changed while they are."""

from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, missions, parameters, plans
from sim_vehicle.conformance.checks.fence import fence_in_force, polygon
from sim_vehicle.conformance.guard import ARM
from sim_vehicle.conformance.peer import Peer, known
from sim_vehicle.conformance.plans import FENCE, Item
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import Skip, equal, holds, near, result_name

FLY_S = 300.0
PASS_M = 4.0


@check("mission-flight.flies_it_all", needs=[ARM], kind="copter", limit_s=FLY_S, pins="AUTOPILOTS 1.7")
def flies_it_all(peer: Peer) -> str:
    """A mission takes off, passes each waypoint, tells its progress, lands where it should, and disarms."""
    items = missions.items(peer)
    plans.put(peer, items)
    place = plans.here(peer)
    missions.start(peer)
    mark = peer.mark()
    targets = [plans.moved(place, n, e) for n, e in missions.CORNERS]
    nearest = [float("inf")] * len(targets)

    def done() -> bool:
        for i, target in enumerate(targets):
            nearest[i] = min(nearest[i], flying.away_m(peer, target))
        return not peer.armed

    took_s = peer.until(done, "landed and disarmed", FLY_S - 30)
    for i, distance_m in enumerate(nearest):
        holds(distance_m < PASS_M, f"passed waypoint {i + 1} at {distance_m:.1f} m")
    holds(flying.away_m(peer, targets[-1]) < 4, f"landed {flying.away_m(peer, targets[-1]):.1f} m off")
    reached = [m.seq for m in peer.since(mark, "MISSION_ITEM_REACHED")]
    first = missions.first_waypoint(peer)
    wanted = set(range(first, first + len(missions.CORNERS)))
    holds(wanted <= set(reached), f"expected MISSION_ITEM_REACHED {sorted(wanted)}, saw {reached}")
    equal(reached, sorted(reached), "order of MISSION_ITEM_REACHED")
    return f"{took_s:.0f} s, reached {reached}"


@check("mission-flight.counts_on", airborne=True, kind="copter", limit_s=FLY_S)
def counts_on(peer: Peer) -> str:
    """MISSION_CURRENT goes through the items without a step back."""
    plans.put(peer, missions.items(peer, landing=False))
    first = missions.first_waypoint(peer)
    missions.resume(peer, first)
    peer.until(lambda: missions.current(peer) == first, f"item {first} to be current", 5.0)
    mark, last = peer.mark(), first + len(missions.CORNERS) - 1
    missions.until_current(peer, last, 200)
    seen = [m.seq for m in peer.since(mark, "MISSION_CURRENT")]
    equal(seen, sorted(seen), "order of MISSION_CURRENT")
    return f"{seen[0]} to {seen[-1]}"


@check(
    "mission-flight.state_is_active",
    airborne=True,
    kind="copter",
    limit_s=FLY_S,
    pins="AUTOPILOTS 2: mission_state is 0 always (PX4)",
)
def state_is_active(peer: Peer) -> str:
    """mission_state is ACTIVE in flight for ArduPilot, 0 for PX4."""
    expected = known(peer, ardupilot=mavlink.MISSION_STATE_ACTIVE, px4=0)
    missions.under_way(peer)
    peer.wait(1.0)
    equal(peer.last["MISSION_CURRENT"].message.mission_state, expected, "mission_state")
    return str(expected)


@check(
    "mission-flight.after_landing",
    needs=[ARM],
    kind="copter",
    dialects=("ardupilot",),
    limit_s=FLY_S,
    pins="AUTOPILOTS 1.12: after landing+disarm MISSION_CURRENT goes back to seq 0, state 5",
)
def after_landing(peer: Peer) -> str:
    """After the landing MISSION_CURRENT is 0, COMPLETE, and the heartbeat stays in AUTO."""
    place = plans.here(peer)
    plans.put(
        peer,
        plans.plan(
            peer, plans.takeoff(place, 6.0), plans.waypoint(place, 8, 0, 6.0), plans.land(place, 8, 0)
        ),
    )
    missions.start(peer)
    peer.until(lambda: not peer.armed, "landed and disarmed", 200)
    peer.wait(2.0)
    message = peer.request("MISSION_CURRENT")
    equal((message.seq, message.mission_state), (0, mavlink.MISSION_STATE_COMPLETE), "seq, mission_state")
    equal(peer.mode, flying.mode_number(peer, "mission"), "mode")
    return "seq 0, COMPLETE"


@check(
    "mission-flight.without_takeoff",
    needs=[ARM],
    kind="copter",
    dialects=("ardupilot",),
    limit_s=FLY_S,
    pins="AUTOPILOTS 1.8: Auto: Missing Takeoff Cmd",
)
def without_takeoff(peer: Peer) -> str:
    """On the ground, armed, a mission that does not begin with a take-off is refused with a text."""
    place = plans.here(peer)
    plans.put(peer, plans.plan(peer, plans.waypoint(place, 30, 0), plans.waypoint(place, 30, 30)))
    flying.arm(peer)
    began_s = peer.now
    seen = result_name(flying.try_mode(peer, "mission"))
    peer.wait(0.5)
    texts = [text for at_s, _, text in peer.texts if at_s >= began_s]
    flying.disarm(peer)
    equal(seen, "FAILED", "AUTO")
    holds(any("Missing Takeoff" in text for text in texts), f"expected 'Missing Takeoff Cmd', saw {texts}")
    return "FAILED, Auto: Missing Takeoff Cmd"


@check(
    "mission-flight.auto_alone_stays",
    needs=[ARM],
    kind="copter",
    dialects=("ardupilot",),
    limit_s=FLY_S,
    pins="AUTOPILOTS 1.7: Arm + mode AUTO alone does not take off",
)
def auto_alone_stays(peer: Peer) -> str:
    """Armed and put into AUTO, it sits on the ground and disarms by itself."""
    plans.put(peer, missions.items(peer))
    flying.stream_flight(peer)
    flying.arm(peer)
    flying.set_mode(peer, "mission")
    peer.wait(5.0)
    holds(flying.height_m(peer) < 1.0, f"it took off: {flying.height_m(peer):.1f} m")
    took_s = peer.until(lambda: not peer.armed, "disarmed by itself", 20)
    return f"disarmed after {took_s + 5:.0f} s"


@check(
    "mission-flight.starts_when_armed",
    needs=[ARM],
    kind="copter",
    dialects=("px4",),
    limit_s=FLY_S,
    pins="AUTOPILOTS 2: armed in mission mode it starts by itself",
)
def starts_when_armed(peer: Peer) -> str:
    """In the mission mode arming alone begins the flight."""
    plans.put(peer, missions.items(peer))
    missions.rewind(peer)
    flying.stream_flight(peer)
    flying.wait_ready(peer)
    flying.set_mode(peer, "mission")
    peer.accepted(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    took_s = peer.until(lambda: flying.height_m(peer) > 3, "it to take off", 30)
    return f"3 m after {took_s:.0f} s"


@check("mission-flight.speed_item", airborne=True, kind="copter", limit_s=FLY_S)
def speed_item(peer: Peer) -> str:
    """DO_CHANGE_SPEED in a mission sets the speed of the legs behind it."""
    place = plans.here(peer)
    frame = mavlink.MAV_FRAME_MISSION
    slow = Item(mavlink.MAV_CMD_DO_CHANGE_SPEED, frame=frame, params=(1, 3, -1, 0))
    legs = [
        plans.waypoint(place, 10, 0, missions.HEIGHT_M),
        slow,
        plans.waypoint(place, 100, 0, missions.HEIGHT_M),
    ]
    plans.put(peer, plans.plan(peer, plans.takeoff(place, missions.HEIGHT_M), *legs))
    missions.resume(peer, missions.first_waypoint(peer))
    peer.until(lambda: flying.away_m(peer, place) > 30, "it to be on its way", 100)
    speeds = []
    for _ in range(6):
        peer.wait(0.5)
        speeds.append(flying.speed_m_s(peer))
    mean = sum(speeds) / len(speeds)
    near(mean, 3.0, 0.7, "m/s")
    return f"{mean:.2f} m/s"


@check(
    "mission-flight.fence_breach",
    needs=[ARM],
    kind="copter",
    dialects=("ardupilot",),
    limit_s=FLY_S,
    pins="AUTOPILOTS 2: fence use: fly until the breach -> RTL",
)
def fence_breach(peer: Peer) -> str:
    """A mission out of the fence is accepted and flown up to the fence; then it returns, and says so."""
    plans.need(peer, FENCE)
    if not parameters.has(peer, "FENCE_ACTION") or parameters.read(peer, "FENCE_ACTION").value != 1:
        raise Skip("FENCE_ACTION is not RTL (1)")
    place = plans.here(peer)
    fence = polygon(peer, ((-60, -60), (-60, 60), (60, 60), (60, -60)))
    plans.put(peer, plans.plan(peer, plans.takeoff(place, missions.HEIGHT_M), plans.waypoint(place, 200, 0)))
    with fence_in_force(peer, fence):
        missions.start(peer)
        began_s = peer.now
        peer.until(flying.in_mode(peer, "return"), "the return mode", 120)
        out_m = flying.away_m(peer, place)
        peer.wait(1.0)
        texts = [text for at_s, _, text in peer.texts if at_s >= began_s]
        holds(any("breached" in text for text in texts), f"expected '... fence breached', saw {texts[-4:]}")
        near(out_m, 60.0, 25.0, "metres from the start")
        flying.set_mode(peer, "land")
        peer.until(lambda: not peer.armed, "landed and disarmed", 120)
    return f"RTL at {out_m:.0f} m"


def _passes(peer: Peer, target: tuple[int, int], near_m: float) -> bool:
    return flying.away_m(peer, target) < near_m


@check("mission-flight.plane_flies_it", needs=[ARM], kind="plane", limit_s=500)
def plane_flies_it(peer: Peer) -> str:
    """A plane passes the waypoints of a mission in their order and goes on flying."""
    flying.be_up(peer)
    home = peer.request("HOME_POSITION")
    base = home.latitude, home.longitude
    legs = ((400.0, 0.0), (400.0, 400.0), (0.0, 400.0))
    targets = [plans.moved(base, n, e) for n, e in legs]
    items = plans.plan(peer, plans.takeoff(base, 50.0), *[plans.waypoint(base, n, e, 60.0) for n, e in legs])
    plans.put(peer, items)
    begin = missions.first_waypoint(peer)
    peer.send(mavlink.MAVLink_mission_set_current_message(*peer.target, begin))
    flying.set_mode(peer, "mission")
    for target in targets:
        peer.until(partial(_passes, peer, target, 120.0), "a waypoint within 120 m", 150)
    holds(peer.armed and flying.height_m(peer) > 20, "it came down")
    return f"{len(targets)} waypoints"
