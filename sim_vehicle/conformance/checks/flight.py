"""Flying by command: take-off, going places, holding, coming back."""

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.guard import ARM
from sim_vehicle.conformance.peer import Peer, known
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import Skip, equal, holds, near, result_name

GO_M = 40.0
REPOSITION = mavlink.MAV_CMD_DO_REPOSITION
STOPS_S = 10.0
TURN_S = 20.0


# -- take-off --------------------------------------------------------------------------------------------


@check("flight.takeoff.leaves_the_ground", needs=[ARM], kind="copter", limit_s=400)
def takeoff_landed_state(peer: Peer) -> str:
    """landed_state goes from ON_GROUND over TAKEOFF, where it is told, to IN_AIR."""
    flying.come_down(peer)
    peer.set_interval("EXTENDED_SYS_STATE", 10)
    mark = peer.mark()
    flying.be_up(peer)
    states = [m.landed_state for m in peer.since(mark, "EXTENDED_SYS_STATE")]
    seen = [s for i, s in enumerate(states) if i == 0 or s != states[i - 1]]
    holds(seen[0] == mavlink.MAV_LANDED_STATE_ON_GROUND, f"began with {seen[0]}")
    holds(seen[-1] == mavlink.MAV_LANDED_STATE_IN_AIR, f"ended with {seen[-1]}")
    holds(mavlink.MAV_LANDED_STATE_LANDING not in seen, f"saw LANDING: {seen}")
    return " ".join(mavlink.enums["MAV_LANDED_STATE"][s].name.removeprefix("MAV_LANDED_STATE_") for s in seen)


@check("flight.status_is_active", airborne=True, limit_s=300)
def status_active(peer: Peer) -> str:
    """In the air system_status is ACTIVE and the armed flag is set."""
    peer.expect("HEARTBEAT", within_s=3)
    peer.wait(1.0)
    equal(peer.heartbeat.system_status, mavlink.MAV_STATE_ACTIVE, "system_status")
    holds(peer.armed, "not armed")
    return "ACTIVE"


@check("flight.disarm_is_refused", airborne=True, limit_s=300, pins="AUTOPILOTS 1.14: Disarm in flight")
def disarm_refused(peer: Peer) -> str:
    """Disarming in flight without force is refused."""
    if peer.dialect.disarm_refused is None:
        raise Skip("nobody knows what this autopilot would do")
    result = peer.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
    peer.wait(1.5)
    holds(peer.armed, "it disarmed in flight")
    equal(result_name(result), result_name(peer.dialect.disarm_refused), "disarming")
    return result_name(result)


# -- holding ---------------------------------------------------------------------------------------------


@check(
    "flight.hold.keeps_its_place",
    airborne=True,
    kind="copter",
    limit_s=300,
    pins="AUTOPILOTS 1.6: BRAKE, GUIDED hold altitude",
)
def hold_keeps(peer: Peer) -> str:
    """In the hold mode the vehicle stays within two metres, and at its height, for ten seconds."""
    flying.set_mode(peer, "hold")
    peer.until(lambda: flying.speed_m_s(peer) < 0.5, "a standstill", STOPS_S)
    place, height = flying.place(peer), flying.height_m(peer)
    peer.wait(10.0)
    holds(flying.away_m(peer, place) < 2.5, f"drifted {flying.away_m(peer, place):.1f} m")
    near(flying.height_m(peer), height, 1.0, "height")
    return f"{flying.away_m(peer, place):.2f} m"


@check("flight.hold.circles", airborne=True, kind="plane", limit_s=300)
def hold_circles(peer: Peer) -> str:
    """In the hold mode a plane circles: it stays near, keeps flying, and keeps its height."""
    flying.set_mode(peer, "hold")
    peer.wait(5.0)
    place, height = flying.place(peer), flying.height_m(peer)
    farthest = 0.0
    for _ in range(40):
        peer.wait(1.0)
        farthest = max(farthest, flying.away_m(peer, place))
        holds(flying.speed_m_s(peer) > 3.0, f"slowed to {flying.speed_m_s(peer):.1f} m/s")
    holds(20 < farthest < 600, f"expected a circle, saw at most {farthest:.0f} m from its place")
    near(flying.height_m(peer), height, 15.0, "height")
    return f"within {farthest:.0f} m"


@check(
    "flight.mode.loiter_without_rc",
    airborne=True,
    needs=["simulator"],
    dialects=("ardupilot",),
    kind="copter",
    limit_s=300,
    pins="AUTOPILOTS 1.6: LOITER descended into the ground",
)
def loiter_sinks(peer: Peer) -> str:
    """LOITER without an RC throttle goes down at about 2.5 m/s."""
    height = flying.height_m(peer)
    flying.set_mode(peer, "loiter")
    peer.wait(3.0)
    sunk = height - flying.height_m(peer)
    flying.set_mode(peer, "hold")
    holds(sunk > 3.0, f"expected it to sink, saw {sunk:.1f} m in 3 s")
    return f"{sunk:.1f} m in 3 s"


# -- going somewhere -------------------------------------------------------------------------------------


@check("flight.reposition.goes_there", airborne=True, kind="copter", limit_s=300, pins="AUTOPILOTS 1.17")
def reposition_goes(peer: Peer) -> str:
    """DO_REPOSITION as COMMAND_INT takes it to a place and height."""
    target = plans.moved(flying.place(peer), GO_M, GO_M / 2)
    equal(result_name(flying.reposition(peer, target, 25.0)), "ACCEPTED", "DO_REPOSITION")
    took_s = flying.gets_to(peer, target)
    peer.until(lambda: abs(flying.height_m(peer) - 25.0) < 1.5, "a height of 25 m", 40)
    return f"{took_s:.0f} s for {GO_M:g} m"


@check("flight.reposition.circles_there", airborne=True, kind="plane", limit_s=300)
def reposition_plane(peer: Peer) -> str:
    """DO_REPOSITION takes a plane to circle around another place."""
    target = plans.moved(flying.place(peer), 400.0, 0.0)
    equal(result_name(flying.reposition(peer, target, 60.0)), "ACCEPTED", "DO_REPOSITION")
    took_s = flying.gets_to(peer, target, 120.0, 150.0)
    peer.wait(20.0)
    holds(flying.away_m(peer, target) < 300, f"{flying.away_m(peer, target):.0f} m away after a while")
    return f"there after {took_s:.0f} s"


@check("flight.reposition.as_long", airborne=True, limit_s=300, pins="AUTOPILOTS 1.17: LONG -> UNSUPPORTED")
def reposition_long(peer: Peer) -> str:
    """As COMMAND_LONG it is UNSUPPORTED for ArduPilot and accepted by PX4."""
    expected = known(peer, ardupilot="UNSUPPORTED", px4="ACCEPTED")
    lat, lon = plans.moved(flying.place(peer), 10, 0)
    amsl_m = flying.base_amsl_m(peer) + flying.height_m(peer)
    seen = result_name(
        peer.command(
            REPOSITION, -1, flying.REPOSITION_CHANGES_MODE, 0, math.nan, lat / 1e7, lon / 1e7, amsl_m
        )
    )
    equal(seen, expected, "COMMAND_LONG")
    return seen


@check("flight.reposition.impossible_place", airborne=True, dialects=("ardupilot",), limit_s=300)
def reposition_impossible(peer: Peer) -> str:
    """A latitude of 95 degrees is refused, and the vehicle stays."""
    place = flying.place(peer)
    seen = result_name(flying.reposition(peer, (950_000_000, place[1]), 20.0))
    holds(seen != "ACCEPTED", "expected a refusal, saw ACCEPTED")
    return seen


@check("flight.speed.is_kept", airborne=True, kind="copter", limit_s=300)
def speed_kept(peer: Peer) -> str:
    """DO_CHANGE_SPEED to 4 m/s is the speed it then flies at."""
    target = plans.moved(flying.place(peer), -90.0, 0.0)
    height = flying.height_m(peer)
    equal(result_name(flying.reposition(peer, target, height)), "ACCEPTED", "DO_REPOSITION")
    peer.accepted(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 4.0, -1)
    peer.wait(6.0)
    speeds = []
    for _ in range(8):
        peer.wait(0.5)
        speeds.append(flying.speed_m_s(peer))
    mean = sum(speeds) / len(speeds)
    peer.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 8.0, -1)
    near(mean, 4.0, 0.8, "m/s")
    return f"{mean:.2f} m/s"


@check("flight.speed.refuses_nonsense", airborne=True, kind="copter", dialects=("ardupilot",), limit_s=300)
def speed_nonsense(peer: Peer) -> str:
    """A speed that is no number or not positive is refused."""
    seen = result_name(peer.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, math.nan, -1))
    holds(seen != "ACCEPTED", "expected a refusal of NaN, saw ACCEPTED")
    return seen


@check("flight.yaw.turns", airborne=True, kind="copter", dialects=("ardupilot",), limit_s=300)
def yaw_turns(peer: Peer) -> str:
    """CONDITION_YAW in GUIDED turns the nose to a heading while the vehicle stays."""
    heading = peer.request("VFR_HUD").heading
    target = (heading + 90) % 360
    peer.accepted(mavlink.MAV_CMD_CONDITION_YAW, target, 30, 1, 0)
    with peer.streaming({"VFR_HUD": 5.0}):
        took_s = peer.until(
            lambda: abs((peer.last["VFR_HUD"].message.heading - target + 180) % 360 - 180) < 5,
            f"a heading of {target} deg",
            TURN_S,
        )
    return f"{heading} to {target} deg in {took_s:.1f} s"


@check("flight.pause", airborne=True, kind="copter", limit_s=300, pins="AUTOPILOTS 2: pause/continue (193)")
def pause(peer: Peer) -> str:
    """DO_PAUSE_CONTINUE stops ArduPilot in GUIDED too; PX4 has no such command."""
    expected = known(peer, ardupilot=None, px4="UNSUPPORTED")
    seen = result_name(peer.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0))
    if expected is not None:
        equal(seen, expected, "DO_PAUSE_CONTINUE")
        return seen
    if seen == "ACCEPTED":
        peer.until(lambda: flying.speed_m_s(peer) < 0.6, "a standstill", STOPS_S)
    return seen


@check(
    "flight.mission_mode_when_empty",
    airborne=True,
    dialects=("ardupilot",),
    limit_s=300,
    pins="AUTOPILOTS 1.9",
)
def empty_mission(peer: Peer) -> str:
    """AUTO with an empty mission is refused in the air."""
    plans.put(peer, [])
    seen = result_name(flying.try_mode(peer, "mission"))
    equal(seen, "FAILED", "AUTO")
    return seen
