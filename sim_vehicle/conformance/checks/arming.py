"""Arming and disarming on the ground."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, parameters, plans
from sim_vehicle.conformance.checks.fence import fence_in_force, polygon
from sim_vehicle.conformance.guard import ARM
from sim_vehicle.conformance.peer import SECOND_STATION, Peer, known
from sim_vehicle.conformance.plans import FENCE
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import Skip, equal, holds, near, result_name

ARM_COMMAND = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
FORCE = 21_196
REFUSAL_S = 2.0
IDLE_DISARM_S = {"ardupilot": "DISARM_DELAY", "px4": "COM_DISARM_PRFLT"}


@check("arming.arms_and_disarms", needs=[ARM], limit_s=200)
def arms_and_disarms(peer: Peer) -> str:
    """COMPONENT_ARM_DISARM is accepted both ways, and the heartbeat follows."""
    flying.arm(peer)
    flying.disarm(peer)
    return "armed, then disarmed"


@check("arming.is_idempotent", needs=[ARM], limit_s=200)
def is_idempotent(peer: Peer) -> str:
    """Arming what is armed and disarming what is disarmed is accepted."""
    flying.arm(peer)
    peer.accepted(ARM_COMMAND, 1)
    flying.disarm(peer)
    peer.accepted(ARM_COMMAND, 0)
    return "ACCEPTED"


@check("arming.heartbeat_follows", needs=[ARM], limit_s=200)
def heartbeat_follows(peer: Peer) -> str:
    """The heartbeat says armed within a second and a half of the acknowledgement."""
    flying.wait_ready(peer)
    peer.accepted(ARM_COMMAND, 1)
    took_s = peer.until(lambda: peer.armed, "armed in the heartbeat", 1.5)
    flying.disarm(peer)
    return f"{took_s:.2f} s"


@check("arming.by_command_int", needs=[ARM], limit_s=200)
def by_command_int(peer: Peer) -> str:
    """Arming works as COMMAND_INT."""
    flying.wait_ready(peer)
    equal(result_name(peer.result(peer.command_int(ARM_COMMAND, 1))), "ACCEPTED", "COMMAND_INT")
    peer.until(lambda: peer.armed, "armed in the heartbeat", flying.HEARTBEAT_LAG_S)
    flying.disarm(peer)
    return "ACCEPTED"


@check("arming.by_second_station", needs=[ARM], limit_s=200, pins="AUTOPILOTS 1.15")
def by_second_station(peer: Peer) -> str:
    """Another station arms and disarms as well."""
    flying.wait_ready(peer)
    for value in (1, 0):
        seen = peer.result(peer.command_long(ARM_COMMAND, value), source=SECOND_STATION)
        equal(result_name(seen), "ACCEPTED", f"parameter 1 = {value}")
    return "ACCEPTED"


@check("arming.strange_parameter", needs=[ARM], limit_s=200)
def strange_parameter(peer: Peer) -> str:
    """A first parameter that is neither 0 nor 1 is refused."""
    flying.wait_ready(peer)
    result = peer.command(ARM_COMMAND, 2)
    armed = peer.armed
    flying.disarm(peer)
    holds(
        result != mavlink.MAV_RESULT_ACCEPTED and not armed, f"expected a refusal, saw {result_name(result)}"
    )
    return result_name(result)


@check(
    "arming.system_status", needs=[ARM], dialects=("ardupilot", "px4"), limit_s=200, pins="AUTOPILOTS 1.13"
)
def system_status(peer: Peer) -> str:
    """Armed on the ground is STANDBY for ArduPilot, ACTIVE for PX4."""
    expected = known(peer, ardupilot=mavlink.MAV_STATE_STANDBY, px4=mavlink.MAV_STATE_ACTIVE)
    flying.arm(peer)
    peer.wait(1.2)
    seen = peer.heartbeat.system_status
    flying.disarm(peer)
    equal(seen, expected, "system_status")
    return str(mavlink.enums["MAV_STATE"][seen].name)


@check("arming.prearm_bit", needs=[ARM], limit_s=200, pins="AUTOPILOTS 1.3: readiness")
def prearm_bit(peer: Peer) -> str:
    """A vehicle whose pre-arm bit is set arms."""
    flying.wait_ready(peer)
    status = peer.request("SYS_STATUS")
    if not status.onboard_control_sensors_present & flying.PREARM_BIT:
        raise Skip("has no pre-arm bit")
    holds(status.onboard_control_sensors_health & flying.PREARM_BIT, "the pre-arm bit is clear")
    flying.arm(peer)
    flying.disarm(peer)
    return "set, and it armed"


@check("arming.mode_not_armable", needs=[ARM], dialects=("ardupilot",), limit_s=200, pins="AUTOPILOTS 1.7")
def mode_not_armable(peer: Peer) -> str:
    """AUTO refuses arming, with the reason as a text."""
    flying.wait_ready(peer)
    if int(parameters.setting(peer, "AUTO_OPTIONS") or 0) & 1 or peer.facts.kind == "plane":
        raise Skip("AUTO is armable here")
    plans.put(peer, plans.sample_plan(peer))
    flying.set_mode(peer, "mission")
    began_s = peer.now
    equal(result_name(peer.command(ARM_COMMAND, 1)), "FAILED", "arming in AUTO")
    peer.wait(0.5)
    texts = [text for at_s, _, text in peer.texts if at_s >= began_s]
    holds(any("not armable" in text for text in texts), f"expected '... not armable', saw {texts}")
    flying.ready_mode(peer)
    return "FAILED, AUTO mode not armable"


@check(
    "arming.refusal_has_a_reason", needs=[ARM], limit_s=200, pins="AUTOPILOTS 1.3: reason only in STATUSTEXT"
)
def refusal_has_a_reason(peer: Peer) -> str:
    """A vehicle that refuses says why: here a fence it stands outside of."""
    known(peer, ardupilot=True)
    plans.need(peer, FENCE)
    flying.wait_ready(peer)
    with fence_in_force(peer, polygon(peer, ((500, 500), (500, 600), (600, 600), (600, 500)))):
        peer.wait(1.5)
        began_s = peer.now
        result = peer.command(ARM_COMMAND, 1)
        peer.wait(REFUSAL_S)
        texts = [text for at_s, _, text in peer.texts if at_s >= began_s]
        holds(result != mavlink.MAV_RESULT_ACCEPTED and not peer.armed, "it armed outside of its fence")
        equal(result, peer.dialect.arm_refused, "result")
        holds(any("reach" in text for text in texts), f"expected a text about the breach, saw {texts}")
    return texts[0]


@check("arming.sets_home", needs=[ARM], limit_s=200, pins="AUTOPILOTS 1.11: home is re-set at every arming")
def sets_home(peer: Peer) -> str:
    """Arming puts home where the vehicle stands."""
    known(peer, ardupilot=True, px4=True)
    flying.arm(peer)
    peer.wait(1.0)
    home = peer.request("HOME_POSITION")
    away_m = plans.distance_m((home.latitude, home.longitude), plans.here(peer))
    height = flying.position(peer).relative_alt / 1000
    flying.disarm(peer)
    holds(away_m < 5, f"home is {away_m:.1f} m away")
    near(height, 0.0, 2.0, "relative_alt")
    return f"{away_m:.2f} m"


@check(
    "arming.idle_disarms",
    needs=[ARM],
    kind="copter",
    dialects=("ardupilot", "px4"),
    limit_s=250,
    pins="AUTOPILOTS 1.7: auto-disarms after DISARM_DELAY 10 s",
)
def idle_disarms(peer: Peer) -> str:
    """An armed vehicle that does not take off disarms by itself after its delay."""
    delay_s = parameters.setting(peer, IDLE_DISARM_S[peer.dialect.name])
    if delay_s is None or not 0 < delay_s < 60:
        raise Skip(f"the delay is {delay_s}")
    flying.arm(peer)
    took_s = peer.until(lambda: not peer.armed, "disarmed by itself", delay_s + 5.0)
    near(took_s, delay_s, 3.0, "seconds until it disarmed")
    return f"after {took_s:.1f} s"


@check(
    "arming.by_force",
    needs=[ARM],
    dialects=("ardupilot", "px4"),
    limit_s=200,
    pins="AUTOPILOTS 1.14: p2=21196",
)
def by_force(peer: Peer) -> str:
    """Parameter 2 = 21196 arms and disarms."""
    flying.wait_ready(peer)
    peer.accepted(ARM_COMMAND, 1, FORCE)
    peer.until(lambda: peer.armed, "armed in the heartbeat", flying.HEARTBEAT_LAG_S)
    peer.accepted(ARM_COMMAND, 0, FORCE)
    peer.until(lambda: not peer.armed, "disarmed in the heartbeat", flying.HEARTBEAT_LAG_S)
    return "ACCEPTED"


@check(
    "arming.reboot_is_refused",
    needs=[ARM, "reboot"],
    dialects=("ardupilot", "px4"),
    limit_s=200,
    pins="AUTOPILOTS 2: reboot is DENIED when armed",
)
def reboot_is_refused(peer: Peer) -> str:
    """An armed vehicle does not reboot."""
    expected = known(peer, ardupilot="FAILED", px4="DENIED")
    flying.arm(peer)
    result = peer.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
    peer.wait(2.5)
    armed = peer.armed
    flying.disarm(peer)
    equal(result_name(result), expected, "PREFLIGHT_REBOOT_SHUTDOWN")
    holds(armed, "it is no longer armed")
    return str(expected)


@check(
    "arming.mission_start_disarmed",
    needs=[ARM],
    dialects=("ardupilot",),
    kind="copter",
    limit_s=200,
    pins="AUTOPILOTS 1.7: MISSION_START on a disarmed vehicle is ACCEPTED, sets AUTO, and nothing flies",
)
def mission_start_disarmed(peer: Peer) -> str:
    """MISSION_START on a disarmed vehicle is accepted, and nothing flies."""
    flying.wait_ready(peer)
    plans.put(peer, plans.sample_plan(peer))
    peer.accepted(mavlink.MAV_CMD_MISSION_START)
    peer.until(flying.in_mode(peer, "mission"), "AUTO in the heartbeat", flying.HEARTBEAT_LAG_S)
    peer.wait(3.0)
    holds(not peer.armed, "it armed")
    flying.ready_mode(peer)
    return "AUTO, disarmed"


@check("arming.takeoff_disarmed", needs=[ARM], dialects=("ardupilot",), kind="copter", limit_s=200)
def takeoff_disarmed(peer: Peer) -> str:
    """NAV_TAKEOFF on a disarmed vehicle is refused."""
    flying.wait_ready(peer)
    result = peer.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10)
    holds(result != mavlink.MAV_RESULT_ACCEPTED and not peer.armed, "expected a refusal, saw ACCEPTED")
    return result_name(result)
