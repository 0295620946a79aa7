"""The heartbeat and the framing of everything the vehicle sends."""

from itertools import pairwise

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.facts import Heard
from sim_vehicle.conformance.flying import mode_name
from sim_vehicle.conformance.peer import Peer
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import CheckFailed, Skip, equal, holds

LISTEN_S = 8.0
LOST_SHARE = 0.05  # what a real link may lose


def _beats(peer: Peer, seconds: float = LISTEN_S) -> list[Heard]:
    mark = peer.wait(seconds)
    component = peer.facts.component
    return [e for e in peer.heard[mark:] if e.kind == "HEARTBEAT" and e.component == component]


def _enough(seen: int, least: int) -> None:
    """A vehicle that says nothing says nothing wrong either."""
    holds(seen >= least, f"expected at least {least} frames to look at, saw {seen}")


@check("heartbeat.arrives")
def arrives(peer: Peer) -> str:
    """A heartbeat comes within three seconds."""
    peer.expect("HEARTBEAT", within_s=3.0)
    return f"system {peer.facts.sysid}, component {peer.facts.component}"


@check("heartbeat.once_a_second", pins="AUTOPILOTS 1.1: HEARTBEAT (1 Hz)")
def once_a_second(peer: Peer) -> str:
    """The mean rate is 1 Hz."""
    beats = _beats(peer)
    rate_hz = (len(beats) - 1) / (beats[-1].at_s - beats[0].at_s) if len(beats) > 1 else 0.0
    holds(0.8 <= rate_hz <= 1.25, f"expected 1 Hz within a quarter, saw {rate_hz:.2f} Hz")
    return f"{rate_hz:.2f} Hz"


@check("heartbeat.no_gaps")
def no_gaps(peer: Peer) -> str:
    """No two heartbeats are more than two seconds apart."""
    beats = _beats(peer)
    gaps = [b.at_s - a.at_s for a, b in pairwise(beats)]
    holds(bool(gaps) and max(gaps) < 2.0, f"expected gaps below 2 s, saw {max(gaps, default=LISTEN_S):.2f} s")
    return f"longest gap {max(gaps):.2f} s"


@check("heartbeat.ids_in_range")
def ids_in_range(peer: Peer) -> str:
    """A vehicle's system id is 1 to 254, an autopilot's component id is 1."""
    sysid, component = peer.target
    holds(1 <= sysid <= 254, f"expected a system id of 1 to 254, saw {sysid}")
    equal(component, mavlink.MAV_COMP_ID_AUTOPILOT1, "component id")
    return f"{sysid}, {component}"


@check("heartbeat.says_protocol_version")
def says_protocol_version(peer: Peer) -> str:
    """mavlink_version is 3."""
    equal(peer.expect("HEARTBEAT", within_s=3).mavlink_version, 3, "mavlink_version")
    return "3"


@check("heartbeat.type_is_a_vehicle")
def type_is_a_vehicle(peer: Peer) -> str:
    """The type is a known MAV_TYPE of something that moves."""
    kind = peer.heartbeat.type
    entry = mavlink.enums["MAV_TYPE"].get(kind)
    holds(entry is not None, f"expected a MAV_TYPE, saw {kind}")
    holds(kind not in (mavlink.MAV_TYPE_GCS, mavlink.MAV_TYPE_GIMBAL), f"saw {entry.name}")
    return str(entry.name)


@check("heartbeat.autopilot_is_known")
def autopilot_is_known(peer: Peer) -> str:
    """The autopilot is a known MAV_AUTOPILOT, and not INVALID."""
    entry = mavlink.enums["MAV_AUTOPILOT"].get(peer.heartbeat.autopilot)
    holds(entry is not None, f"expected a MAV_AUTOPILOT, saw {peer.heartbeat.autopilot}")
    return str(entry.name)


@check("heartbeat.custom_mode_flag")
def custom_mode_flag(peer: Peer) -> str:
    """base_mode says that custom_mode counts."""
    flags = peer.heartbeat.base_mode
    holds(
        flags & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, f"base_mode {flags:#04x} lacks CUSTOM_MODE_ENABLED"
    )
    return f"base_mode {flags:#04x}"


@check("heartbeat.mode_is_known", pins="AUTOPILOTS 1.5")
def mode_is_known(peer: Peer) -> str:
    """custom_mode is one of the autopilot's numbers."""
    number = peer.mode
    if not peer.dialect.modes:
        raise Skip("the modes of this autopilot are not known")
    if peer.dialect.name == "px4":
        equal(number & 0xFFFF, 0, "the low half of custom_mode")
        holds(1 <= (number >> 16 & 0xFF) <= 10, f"expected a main mode of 1 to 10, saw {number >> 16 & 0xFF}")
    else:
        holds(0 <= number <= 40, f"expected a mode number, saw {number}")
    return mode_name(peer, number)


@check("heartbeat.disarmed_on_the_ground")
def disarmed_on_the_ground(peer: Peer) -> str:
    """The armed flag is clear before anybody has armed."""
    holds(not peer.armed, "the vehicle is armed")
    return "disarmed"


@check("heartbeat.system_status", pins="AUTOPILOTS 1.13")
def system_status(peer: Peer) -> str:
    """system_status is a MAV_STATE that a vehicle on the ground may have."""
    status = peer.heartbeat.system_status
    entry = mavlink.enums["MAV_STATE"].get(status)
    holds(entry is not None, f"expected a MAV_STATE, saw {status}")
    holds(status != mavlink.MAV_STATE_ACTIVE, "saw ACTIVE on a disarmed vehicle")
    return str(entry.name)


@check("heartbeat.goes_on_without_a_station", limit_s=30)
def goes_on_without_a_station(peer: Peer) -> str:
    """The vehicle is heard also while the station says nothing."""
    peer.quiet = True
    beats = _beats(peer, 6.0)
    holds(len(beats) >= 4, f"expected at least 4 heartbeats in 6 s, saw {len(beats)}")
    return f"{len(beats)} in 6 s"


@check("heartbeat.frames_are_mavlink2")
def frames_are_mavlink2(peer: Peer) -> str:
    """A station that speaks MAVLink 2 is answered in MAVLink 2."""
    mark = peer.wait(3.0)
    _enough(len(peer.heard) - mark, 2)
    old = [e.kind for e in peer.heard[mark:] if e.raw[0] != 0xFD]
    holds(not old, f"saw MAVLink 1 frames: {', '.join(sorted(set(old)))}")
    return f"{len(peer.heard) - mark} frames"


@check("heartbeat.sequence_numbers_count")
def sequence_numbers_count(peer: Peer) -> str:
    """Sequence numbers of a component go up by one, but for what the link lost."""
    with peer.streaming({"ATTITUDE": 10.0}):
        mark = peer.wait(4.0)
    frames = [e for e in peer.heard[mark:] if e.component == peer.facts.component]
    _enough(len(frames), 20)
    lost = sum((b.seq - a.seq - 1) % 256 for a, b in pairwise(frames))
    holds(
        lost <= LOST_SHARE * (len(frames) + lost),
        f"{lost} of {len(frames) + lost} sequence numbers are missing",
    )
    return f"{len(frames)} frames, {lost} missing"


@check("heartbeat.payloads_are_trimmed")
def payloads_are_trimmed(peer: Peer) -> str:
    """MAVLink 2 payloads end without zero bytes, as the specification demands."""
    with peer.streaming({"ATTITUDE": 5.0, "SYS_STATUS": 5.0}):
        mark = peer.wait(2.0)
    frames = [entry for entry in peer.heard[mark:] if entry.raw[0] == 0xFD]
    _enough(len(frames), 8)
    for entry in frames:
        payload = entry.payload
        if len(payload) > 1 and payload[-1] == 0:
            raise CheckFailed(f"{entry.kind} carries {len(payload)} bytes, the last of them 0")
    return f"{len(frames)} frames"


@check("heartbeat.nothing_but_mavlink")
def nothing_but_mavlink(peer: Peer) -> str:
    """Between boots the link carries frames only."""
    peer.wait(3.0)
    holds(not peer.noise, f"saw {len(peer.noise)} bytes that are no frame: {bytes(peer.noise[:20])!r}")
    return "no other bytes"
