"""Getting a vehicle ready, into the air and down again."""

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import plans
from sim_vehicle.conformance.peer import Peer
from sim_vehicle.conformance.words import CheckFailed, Skip, equal, result_name

HEIGHT_M, PLANE_HEIGHT_M = 20.0, 50.0
READY_S, CLIMB_S, DOWN_S = 150.0, 90.0, 240.0
PREARM_BIT = 0x10000000  # MAV_SYS_STATUS_PREARM_CHECK
HEARTBEAT_LAG_S = 2.5  # a heartbeat a second, and one that was under way
REPOSITION_CHANGES_MODE = 1  # MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
FLIGHT_RATES_HZ = {"GLOBAL_POSITION_INT": 5.0, "EXTENDED_SYS_STATE": 5.0, "MISSION_CURRENT": 2.0}


def mode_number(peer: Peer, role: str) -> int:
    """The vehicle's mode for a purpose; Skip where it has none that is known."""
    if role not in peer.dialect.modes:
        raise Skip(f"no mode of this autopilot is known for {role!r}")
    return peer.dialect.modes[role]


def mode_name(peer: Peer, number: int) -> str:
    names = {value: role for role, value in peer.dialect.modes.items()}
    return f"{names[number]} ({number})" if number in names else str(number)


def mode_command(peer: Peer, number: int) -> Any:
    """DO_SET_MODE for a custom mode, in the autopilot's way of numbering."""
    if peer.dialect.name == "px4":
        return peer.command_long(mavlink.MAV_CMD_DO_SET_MODE, 1, number >> 16 & 0xFF, number >> 24)
    return peer.command_long(mavlink.MAV_CMD_DO_SET_MODE, 1, number)


def try_mode(peer: Peer, role: str) -> int:
    """Command a mode; the MAV_RESULT."""
    return peer.result(mode_command(peer, mode_number(peer, role)))


def in_mode(peer: Peer, role: str) -> Callable[[], bool]:
    number = mode_number(peer, role)
    return lambda: peer.mode == number


def set_mode(peer: Peer, role: str) -> None:
    """A mode that has to be accepted, and shown by the heartbeat."""
    number = mode_number(peer, role)
    # PX4 refuses its mission mode for a moment after an upload.
    for _ in range(5):
        result = try_mode(peer, role)
        if result == mavlink.MAV_RESULT_ACCEPTED:
            break
        peer.wait(1.0)
    equal(result_name(result), "ACCEPTED", f"mode {role}")
    peer.until(
        lambda: peer.mode == number, f"mode {mode_name(peer, number)} in the heartbeat", HEARTBEAT_LAG_S
    )


def ready_mode(peer: Peer) -> None:
    """The mode to arm in."""
    if peer.dialect.ready_mode is not None:
        set_mode(peer, peer.dialect.ready_mode)


def is_ready(peer: Peer) -> bool:
    """What the vehicle's own bits say of arming: pre-arm checks passed, and a position where it tells one."""
    status = peer.request("SYS_STATUS")
    if status.onboard_control_sensors_present & PREARM_BIT:
        if not status.onboard_control_sensors_health & PREARM_BIT:
            return False
        if peer.dialect.name == "ardupilot":
            flags = peer.request("EKF_STATUS_REPORT").flags
            return bool(flags & mavlink.EKF_POS_HORIZ_ABS)
    return True


def wait_ready(peer: Peer) -> float:
    """Wait until the vehicle would arm; how long it took [s]."""
    ready_mode(peer)
    began_s = peer.now
    while not is_ready(peer):
        if peer.now - began_s > READY_S:
            raise CheckFailed(f"expected the vehicle to be ready within {READY_S:g} s; {last_texts(peer)}")
        if "In landing sequence" in last_texts(peer):  # of an ArduPlane that has landed by its mission
            peer.send(mavlink.MAVLink_mission_set_current_message(*peer.target, 1))
        peer.wait(1.0)
    return peer.now - began_s


def last_texts(peer: Peer, count: int = 3) -> str:
    """The last things it said, for a report."""
    said = [text for _, _, text in peer.texts[-count:]]
    return "last texts: " + " | ".join(said) if said else "it said nothing"


def arm(peer: Peer) -> None:
    """Ready, armed, and shown by the heartbeat."""
    wait_ready(peer)
    result = peer.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    if result != mavlink.MAV_RESULT_ACCEPTED:
        raise CheckFailed(f"arming: expected ACCEPTED, saw {result_name(result)}; {last_texts(peer)}")
    peer.until(lambda: peer.armed, "armed in the heartbeat", HEARTBEAT_LAG_S)


def disarm(peer: Peer) -> None:
    """On the ground: disarmed, and shown by the heartbeat."""
    if peer.armed:
        peer.accepted(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        peer.until(lambda: not peer.armed, "disarmed in the heartbeat", HEARTBEAT_LAG_S)


def position(peer: Peer) -> Any:
    """GLOBAL_POSITION_INT, now."""
    return peer.request("GLOBAL_POSITION_INT")


def height_m(peer: Peer) -> float:
    """Above home, as last told."""
    entry = peer.last.get("GLOBAL_POSITION_INT")
    return entry.message.relative_alt / 1000 if entry is not None else math.nan


def speed_m_s(peer: Peer) -> float:
    """Over the ground, as last told."""
    message = peer.last["GLOBAL_POSITION_INT"].message
    return math.hypot(message.vx, message.vy) / 100


def place(peer: Peer) -> tuple[int, int]:
    """Where it is, as last told, 1e-7 deg."""
    message = peer.last["GLOBAL_POSITION_INT"].message
    return message.lat, message.lon


def away_m(peer: Peer, target: tuple[int, int]) -> float:
    return plans.distance_m(place(peer), target)


def stream_flight(peer: Peer) -> None:
    """What a flight is watched by."""
    for kind, rate_hz in FLIGHT_RATES_HZ.items():
        peer.set_interval(kind, rate_hz)
    peer.until(lambda: "GLOBAL_POSITION_INT" in peer.last, "GLOBAL_POSITION_INT", 5.0)


def airborne(peer: Peer) -> bool:
    return peer.armed and height_m(peer) > 3.0


def takeoff_command(peer: Peer, height: float) -> Any:
    """NAV_TAKEOFF to a height above home, in the autopilot's idea of altitude."""
    if peer.dialect.name != "px4":
        return peer.command_long(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height)
    amsl_m = peer.request("HOME_POSITION").altitude / 1000 + height
    if peer.facts.kind == "plane":
        lat, lon = plans.moved(plans.here(peer), 300, 0)
        return peer.command_long(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, math.nan, lat / 1e7, lon / 1e7, amsl_m)
    return peer.command_long(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, *[math.nan] * 3, amsl_m)


def be_up(peer: Peer) -> None:
    """In the air, holding (a plane circles), watched by streams."""
    stream_flight(peer)
    if not airborne(peer):
        if peer.facts.kind == "plane":
            _launch_plane(peer)
        else:
            arm(peer)
            equal(result_name(peer.result(takeoff_command(peer, HEIGHT_M))), "ACCEPTED", "NAV_TAKEOFF")
            peer.until(lambda: height_m(peer) > HEIGHT_M - 1.0, f"a height of {HEIGHT_M:g} m", CLIMB_S)
            peer.wait(3.0)
    hold(peer)


def _launch_plane(peer: Peer) -> None:
    arm_role = "takeoff" if peer.dialect.name == "ardupilot" else None
    if arm_role is None:
        arm(peer)
        equal(result_name(peer.result(takeoff_command(peer, PLANE_HEIGHT_M))), "ACCEPTED", "NAV_TAKEOFF")
    else:
        wait_ready(peer)
        set_mode(peer, arm_role)
        peer.accepted(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    peer.until(lambda: height_m(peer) > PLANE_HEIGHT_M * 0.8, f"{PLANE_HEIGHT_M * 0.8:g} m up", CLIMB_S)
    peer.wait(5.0)


def hold(peer: Peer) -> None:
    """Stay where it is, then in the mode to be commanded from."""
    if peer.dialect.hold_mode is not None and peer.mode != mode_number(peer, peer.dialect.hold_mode):
        set_mode(peer, peer.dialect.hold_mode)
        if peer.facts.kind == "copter":
            peer.until(lambda: speed_m_s(peer) < 0.6, "a standstill", 20.0)
    ready_mode(peer)


def come_down(peer: Peer) -> None:
    """On the ground and disarmed, however that is done here."""
    if not peer.armed:
        return
    stream_flight(peer)
    peer.wait(0.5)
    if height_m(peer) < 0.5 and speed_m_s(peer) < 0.5:
        result = peer.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        if result == mavlink.MAV_RESULT_ACCEPTED:
            peer.until(lambda: not peer.armed, "disarmed in the heartbeat", HEARTBEAT_LAG_S)
            return
    if peer.facts.kind == "plane" and "land" not in peer.dialect.modes:
        _land_by_mission(peer)
    else:
        set_mode(peer, "land")
    peer.until(lambda: not peer.armed, "landed and disarmed", DOWN_S)


def _land_by_mission(peer: Peer) -> None:
    """A plane's approach: out, then down over half a kilometre."""
    home = peer.request("HOME_POSITION")
    base = home.latitude, home.longitude
    plans.put(
        peer,
        plans.plan(
            peer,
            plans.waypoint(base, -600, 0, 40),
            plans.waypoint(base, -350, 0, 25),
            plans.land(base),
        ),
    )
    peer.send(mavlink.MAVLink_mission_set_current_message(*peer.target, 1))
    set_mode(peer, "mission")


# -- going somewhere -------------------------------------------------------------------------------------


def base_amsl_m(peer: Peer) -> float:
    """Altitude of home above sea level, as last told."""
    message = peer.last["GLOBAL_POSITION_INT"].message
    return float(message.alt - message.relative_alt) / 1000


def reposition(peer: Peer, target: tuple[int, int], height: float, *, speed: float = -1.0) -> int:
    """DO_REPOSITION to a height above home [m] at a speed [m/s], as COMMAND_INT; the MAV_RESULT."""
    x, y = target
    amsl_m = base_amsl_m(peer) + height  # both autopilots take it above sea level in this frame
    command = peer.command_int(
        mavlink.MAV_CMD_DO_REPOSITION, speed, REPOSITION_CHANGES_MODE, 0, math.nan, x=x, y=y, z=amsl_m
    )
    return peer.result(command)


def gets_to(peer: Peer, target: tuple[int, int], within_s: float = 60.0, near_m: float = 3.0) -> float:
    """Wait until it is near a place; how long it took [s]."""
    return peer.until(lambda: away_m(peer, target) < near_m, f"less than {near_m:g} m to the place", within_s)
