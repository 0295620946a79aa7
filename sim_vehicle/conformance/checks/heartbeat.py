"""The heartbeat, and the framing of all messages."""

from itertools import pairwise

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.assertions import CheckFailed, Skip, equal, holds
from sim_vehicle.conformance.flying import mode_name
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.frames import ReceivedFrame

LISTEN_S = 8.0
MAX_LOST_SHARE = 0.05  # share of frames that a real link may lose


def _heartbeats(vehicle: VehicleUnderTest, seconds: float = LISTEN_S) -> list[ReceivedFrame]:
    mark = vehicle.wait(seconds)
    component = vehicle.identity.component
    return [e for e in vehicle.received[mark:] if e.kind == "HEARTBEAT" and e.component == component]


def _require_count(seen: int, least: int) -> None:
    """Raise CheckFailed for fewer than `least` frames, because a silent vehicle must not pass."""
    holds(seen >= least, f"expected at least {least} frames, saw {seen}")


@check("heartbeat.arrives")
def arrives(vehicle: VehicleUnderTest) -> str:
    """A heartbeat arrives within 3 s."""
    vehicle.expect("HEARTBEAT", within_s=3.0)
    return f"system {vehicle.identity.sysid}, component {vehicle.identity.component}"


@check("heartbeat.once_a_second", source="AUTOPILOTS 1.1: HEARTBEAT (1 Hz)")
def once_a_second(vehicle: VehicleUnderTest) -> str:
    """The mean rate is 1 Hz."""
    beats = _heartbeats(vehicle)
    rate_hz = (len(beats) - 1) / (beats[-1].at_s - beats[0].at_s) if len(beats) > 1 else 0.0
    holds(0.8 <= rate_hz <= 1.25, f"expected 0.8 to 1.25 Hz, saw {rate_hz:.2f} Hz")
    return f"{rate_hz:.2f} Hz"


@check("heartbeat.no_gaps")
def no_gaps(vehicle: VehicleUnderTest) -> str:
    """The gap between two heartbeats is less than 2 s."""
    beats = _heartbeats(vehicle)
    gaps = [b.at_s - a.at_s for a, b in pairwise(beats)]
    holds(bool(gaps) and max(gaps) < 2.0, f"expected gaps below 2 s, saw {max(gaps, default=LISTEN_S):.2f} s")
    return f"longest gap {max(gaps):.2f} s"


@check("heartbeat.ids_in_range")
def ids_in_range(vehicle: VehicleUnderTest) -> str:
    """A vehicle's system id is 1 to 254, an autopilot's component id is 1."""
    sysid, component = vehicle.target
    holds(1 <= sysid <= 254, f"expected a system id of 1 to 254, saw {sysid}")
    equal(component, mavlink.MAV_COMP_ID_AUTOPILOT1, "component id")
    return f"{sysid}, {component}"


@check("heartbeat.says_protocol_version")
def says_protocol_version(vehicle: VehicleUnderTest) -> str:
    """mavlink_version is 3."""
    equal(vehicle.expect("HEARTBEAT", within_s=3).mavlink_version, 3, "mavlink_version")
    return "3"


@check("heartbeat.type_is_a_vehicle")
def type_is_a_vehicle(vehicle: VehicleUnderTest) -> str:
    """The type is a known MAV_TYPE, and neither GCS nor GIMBAL."""
    kind = vehicle.heartbeat.type
    entry = mavlink.enums["MAV_TYPE"].get(kind)
    holds(entry is not None, f"expected a MAV_TYPE, saw {kind}")
    is_vehicle = kind not in (mavlink.MAV_TYPE_GCS, mavlink.MAV_TYPE_GIMBAL)
    holds(is_vehicle, f"expected the type of a vehicle, saw {entry.name}")
    return str(entry.name)


@check("heartbeat.autopilot_is_known")
def autopilot_is_known(vehicle: VehicleUnderTest) -> str:
    """The autopilot is a known MAV_AUTOPILOT."""
    entry = mavlink.enums["MAV_AUTOPILOT"].get(vehicle.heartbeat.autopilot)
    holds(entry is not None, f"expected a MAV_AUTOPILOT, saw {vehicle.heartbeat.autopilot}")
    return str(entry.name)


@check("heartbeat.custom_mode_flag")
def custom_mode_flag(vehicle: VehicleUnderTest) -> str:
    """base_mode has the flag for custom modes."""
    flags = vehicle.heartbeat.base_mode
    holds(
        flags & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, f"base_mode {flags:#04x} lacks CUSTOM_MODE_ENABLED"
    )
    return f"base_mode {flags:#04x}"


@check("heartbeat.mode_is_known", source="AUTOPILOTS 1.5")
def mode_is_known(vehicle: VehicleUnderTest) -> str:
    """custom_mode is in the range of this autopilot's mode numbers."""
    number = vehicle.mode
    if not vehicle.dialect.modes:
        raise Skip("the modes of this autopilot are not known")
    if vehicle.dialect.name == "px4":
        equal(number & 0xFFFF, 0, "the low half of custom_mode")
        holds(1 <= (number >> 16 & 0xFF) <= 10, f"expected a main mode of 1 to 10, saw {number >> 16 & 0xFF}")
    else:
        holds(0 <= number <= 40, f"expected a mode number of 0 to 40, saw {number}")
    return mode_name(vehicle, number)


@check("heartbeat.disarmed_on_the_ground")
def disarmed_on_the_ground(vehicle: VehicleUnderTest) -> str:
    """The armed flag is clear before arming."""
    holds(not vehicle.armed, "the vehicle is armed")
    return "disarmed"


@check("heartbeat.system_status", source="AUTOPILOTS 1.13")
def system_status(vehicle: VehicleUnderTest) -> str:
    """Before arming, system_status is a known MAV_STATE, and not ACTIVE."""
    status = vehicle.heartbeat.system_status
    entry = mavlink.enums["MAV_STATE"].get(status)
    holds(entry is not None, f"expected a MAV_STATE, saw {status}")
    holds(status != mavlink.MAV_STATE_ACTIVE, "saw ACTIVE on a disarmed vehicle")
    return str(entry.name)


@check("heartbeat.goes_on_without_a_station", limit_s=30)
def goes_on_without_a_station(vehicle: VehicleUnderTest) -> str:
    """The vehicle sends heartbeats while the station is silent."""
    vehicle.heartbeats_off = True
    beats = _heartbeats(vehicle, 6.0)
    holds(len(beats) >= 4, f"expected at least 4 heartbeats in 6 s, saw {len(beats)}")
    return f"{len(beats)} in 6 s"


@check("heartbeat.frames_are_mavlink2")
def frames_are_mavlink2(vehicle: VehicleUnderTest) -> str:
    """The vehicle sends only MAVLink 2 frames to a station that sends MAVLink 2."""
    mark = vehicle.wait(3.0)
    _require_count(len(vehicle.received) - mark, 2)
    old = [e.kind for e in vehicle.received[mark:] if e.raw[0] != 0xFD]
    holds(not old, f"saw MAVLink 1 frames: {', '.join(sorted(set(old)))}")
    return f"{len(vehicle.received) - mark} frames"


@check("heartbeat.sequence_numbers_count")
def sequence_numbers_count(vehicle: VehicleUnderTest) -> str:
    """Sequence numbers of the autopilot increase by one; at most 5 % of the numbers are missing."""
    with vehicle.streaming({"ATTITUDE": 10.0}):
        mark = vehicle.wait(4.0)
    frames = [e for e in vehicle.received[mark:] if e.component == vehicle.identity.component]
    _require_count(len(frames), 20)
    missing = sum((b.seq - a.seq - 1) % 256 for a, b in pairwise(frames))
    holds(
        missing <= MAX_LOST_SHARE * (len(frames) + missing),
        f"{missing} of {len(frames) + missing} sequence numbers are missing",
    )
    return f"{len(frames)} frames, {missing} missing"


@check("heartbeat.payloads_are_trimmed")
def payloads_are_trimmed(vehicle: VehicleUnderTest) -> str:
    """MAVLink 2 payloads have no trailing zeros, as the specification demands."""
    with vehicle.streaming({"ATTITUDE": 5.0, "SYS_STATUS": 5.0}):
        mark = vehicle.wait(2.0)
    frames = [entry for entry in vehicle.received[mark:] if entry.raw[0] == 0xFD]
    _require_count(len(frames), 8)
    for entry in frames:
        payload = entry.payload
        if len(payload) > 1 and payload[-1] == 0:
            raise CheckFailed(f"the payload of {entry.kind} has {len(payload)} bytes, and the last is 0")
    return f"{len(frames)} frames"


@check("heartbeat.nothing_but_mavlink")
def nothing_but_mavlink(vehicle: VehicleUnderTest) -> str:
    """Between boots the link carries only frames."""
    vehicle.wait(3.0)
    holds(
        not vehicle.noise, f"saw {len(vehicle.noise)} bytes outside of frames: {bytes(vehicle.noise[:20])!r}"
    )
    return "no other bytes"
