"""Set-points: positions and velocities that a station keeps sending."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.peer import Peer
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import equal, holds, near, result_name

POSITION_ONLY, VELOCITY_ONLY = 0x0DF8, 0x0DC7  # type masks of the set-point messages
STOPS_S = 10.0


@check("flight.setpoint.position", airborne=True, kind="copter", dialects=("ardupilot",), limit_s=300)
def setpoint_position(peer: Peer) -> str:
    """SET_POSITION_TARGET_GLOBAL_INT in GUIDED takes it to a place."""
    target = plans.moved(flying.place(peer), 20.0, -20.0)
    peer.send(
        mavlink.MAVLink_set_position_target_global_int_message(
            0,
            *peer.target,
            mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
            POSITION_ONLY,
            *target,
            20.0,
            *[0.0] * 8,
        )
    )
    return f"there after {flying.gets_to(peer, target):.0f} s"


def _velocity(peer: Peer, north_m_s: float, east_m_s: float) -> None:
    peer.send(
        mavlink.MAVLink_set_position_target_local_ned_message(
            0,
            *peer.target,
            mavlink.MAV_FRAME_LOCAL_NED,
            VELOCITY_ONLY,
            0,
            0,
            0,
            north_m_s,
            east_m_s,
            0,
            *[0.0] * 5,
        )
    )


def _stream_velocity(peer: Peer, north_m_s: float, seconds: float) -> None:
    for _ in range(int(seconds / 0.2)):
        _velocity(peer, north_m_s, 0.0)
        peer.wait(0.2)


def _follow_setpoints(peer: Peer) -> None:
    """Bring the vehicle into the mode in which it follows velocities, keeping them coming."""
    if peer.dialect.name == "px4":
        _stream_velocity(peer, 0.0, 2.0)
        equal(result_name(flying.try_mode(peer, "offboard")), "ACCEPTED", "OFFBOARD")


@check("flight.setpoint.velocity", airborne=True, kind="copter", dialects=("ardupilot", "px4"), limit_s=300)
def setpoint_velocity(peer: Peer) -> str:
    """A velocity of 3 m/s north, sent five times a second, is flown."""
    _follow_setpoints(peer)
    _stream_velocity(peer, 3.0, 5.0)
    message = peer.last["GLOBAL_POSITION_INT"].message
    _stream_velocity(peer, 0.0, 3.0)
    flying.hold(peer)
    near(message.vx / 100, 3.0, 0.6, "north m/s")
    near(message.vy / 100, 0.0, 0.6, "east m/s")
    return f"{message.vx / 100:.2f} m/s north"


@check("flight.setpoint.times_out", airborne=True, kind="copter", dialects=("ardupilot", "px4"), limit_s=300)
def setpoint_times_out(peer: Peer) -> str:
    """When velocities stop coming the vehicle stops by itself, within ten seconds."""
    _follow_setpoints(peer)
    _stream_velocity(peer, 3.0, 4.0)
    took_s = peer.until(lambda: flying.speed_m_s(peer) < 0.7, "a stop", STOPS_S)
    return f"after {took_s:.1f} s"


@check(
    "flight.setpoint.needs_its_mode", airborne=True, kind="copter", dialects=("ardupilot", "px4"), limit_s=300
)
def setpoint_needs_mode(peer: Peer) -> str:
    """In the hold mode set-points are not followed."""
    flying.set_mode(peer, "hold")
    peer.wait(2.0)
    place = flying.place(peer)
    _stream_velocity(peer, 4.0, 3.0)
    away_m = flying.away_m(peer, place)
    holds(away_m < 2.5, f"it moved {away_m:.1f} m")
    return f"{away_m:.2f} m"


@check("flight.offboard.needs_setpoints", airborne=True, kind="copter", dialects=("px4",), limit_s=300)
def offboard_needs_setpoints(peer: Peer) -> str:
    """OFFBOARD without a stream of set-points is refused."""
    peer.wait(3.0)  # what was streamed before is forgotten
    seen = result_name(flying.try_mode(peer, "offboard"))
    holds(seen != "ACCEPTED", "expected a refusal, saw ACCEPTED")
    return seen
