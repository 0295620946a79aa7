"""The heartbeat, the framing of all messages, the identity of the vehicle."""

from itertools import pairwise
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.assertions import at_least, at_most, equal, holds, within
from sim_vehicle.conformance.dialects import version_text
from sim_vehicle.conformance.flying import mode_name
from sim_vehicle.conformance.outcomes import ACCEPTED, Skip
from sim_vehicle.conformance.registry import KNOWN, check, checks, row
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.definitions import MAVLINK2
from sim_vehicle.station.frames import ReceivedFrame

RELEASES = {0: "development", 64: "alpha", 128: "beta", 192: "candidate", 255: "official"}
LISTEN_S = 8.0
MAX_LOST_SHARE = 0.05  # share of frames that a real link may lose


def _heartbeats(vehicle: VehicleUnderTest, seconds: float = LISTEN_S) -> list[ReceivedFrame]:
    return [e for e in _own(vehicle, _frames(vehicle, seconds)) if e.kind == "HEARTBEAT"]


def _own(vehicle: VehicleUnderTest, frames: list[ReceivedFrame]) -> list[ReceivedFrame]:
    """Return the frames of the autopilot itself."""
    return [entry for entry in frames if entry.component == vehicle.identity.component]


def _frames(vehicle: VehicleUnderTest, seconds: float, least: int = 0) -> list[ReceivedFrame]:
    """Return the frames of some seconds; raise CheckFailed for fewer than `least`: silence must not pass."""
    found = vehicle.wait(seconds)
    at_least(len(found), least, "frames")
    return found


def _name(enum: str, number: int) -> str:
    """Return the name of a number in the heartbeat; raise CheckFailed if it has none."""
    entry = mavlink.enums[enum].get(number)
    holds(entry is not None, f"expected a {enum}, saw {number}")
    return str(entry.name)


@check("heartbeat")
def arrives(vehicle: VehicleUnderTest) -> str:
    """A heartbeat arrives within 3 s."""
    vehicle.expect("HEARTBEAT", within_s=3.0)
    return f"system {vehicle.identity.sysid}, component {vehicle.identity.component}"


@check("heartbeat", source="AUTOPILOTS 1.1: HEARTBEAT (1 Hz)")
def once_a_second(vehicle: VehicleUnderTest) -> str:
    """The mean rate is 1 Hz."""
    beats = _heartbeats(vehicle)
    rate_hz = (len(beats) - 1) / (beats[-1].at_s - beats[0].at_s) if len(beats) > 1 else 0.0
    return f"{within(rate_hz, 0.8, 1.25, 'rate [Hz]'):.2f} Hz"


@check("heartbeat")
def no_gaps(vehicle: VehicleUnderTest) -> str:
    """The gap between two heartbeats is less than 2 s."""
    gap_s = max((b.at_s - a.at_s for a, b in pairwise(_heartbeats(vehicle))), default=LISTEN_S)
    return f"longest gap {at_most(gap_s, 2.0, 'longest gap [s]'):.2f} s"


@check("heartbeat")
def ids_in_range(vehicle: VehicleUnderTest) -> str:
    """A vehicle's system id is 1 to 254, an autopilot's component id is 1."""
    sysid, component = vehicle.target
    within(sysid, 1, 254, "system id")
    equal(component, mavlink.MAV_COMP_ID_AUTOPILOT1, "component id")
    return f"{sysid}, {component}"


@check("heartbeat")
def type_is_a_vehicle(vehicle: VehicleUnderTest) -> str:
    """The type is a known MAV_TYPE, and neither GCS nor GIMBAL."""
    name = _name("MAV_TYPE", vehicle.heartbeat.type)
    holds(name not in ("MAV_TYPE_GCS", "MAV_TYPE_GIMBAL"), f"expected the type of a vehicle, saw {name}")
    return name


@check("heartbeat")
def custom_mode_flag(vehicle: VehicleUnderTest) -> str:
    """base_mode has the flag for custom modes."""
    flags = vehicle.heartbeat.base_mode
    holds(flags & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, f"base_mode {flags:#04x}")
    return f"base_mode {flags:#04x}"


@check("heartbeat", source="AUTOPILOTS 1.5")
def mode_is_known(vehicle: VehicleUnderTest) -> str:
    """custom_mode is in the range of this autopilot's mode numbers."""
    if not vehicle.dialect.modes:
        raise Skip("the modes of this autopilot are not known")
    if vehicle.dialect.name == "px4":
        equal(vehicle.mode & 0xFFFF, 0, "the low half of custom_mode")
        within(vehicle.mode >> 16 & 0xFF, 1, 10, "main mode")
    else:
        within(vehicle.mode, 0, 40, "mode number")
    return mode_name(vehicle, vehicle.mode)


@check("heartbeat")
def disarmed_on_the_ground(vehicle: VehicleUnderTest) -> None:
    """The armed flag is clear before arming."""
    holds(not vehicle.armed, "the vehicle is armed")


@check("heartbeat", source="AUTOPILOTS 1.13")
def system_status(vehicle: VehicleUnderTest) -> str:
    """Before arming, system_status is a known MAV_STATE, and not ACTIVE."""
    name = _name("MAV_STATE", vehicle.heartbeat.system_status)
    holds(name != "MAV_STATE_ACTIVE", "saw ACTIVE on a disarmed vehicle")
    return name


@check("heartbeat")
def says_protocol_version(vehicle: VehicleUnderTest) -> str:
    """mavlink_version is 3."""
    return str(equal(vehicle.expect("HEARTBEAT", within_s=3).mavlink_version, 3, "mavlink_version"))


@check("heartbeat")
def autopilot_is_known(vehicle: VehicleUnderTest) -> str:
    """The autopilot is a known MAV_AUTOPILOT."""
    return _name("MAV_AUTOPILOT", vehicle.heartbeat.autopilot)


@check("heartbeat")
def goes_on_without_a_station(vehicle: VehicleUnderTest) -> str:
    """The vehicle sends heartbeats while the station is silent."""
    vehicle.heartbeats_off = True
    return f"{at_least(len(_heartbeats(vehicle, 6.0)), 4, 'heartbeats in 6 s')} in 6 s"


@check("heartbeat")
def frames_are_mavlink2(vehicle: VehicleUnderTest) -> str:
    """The vehicle sends only MAVLink 2 frames to a station that sends MAVLink 2."""
    frames = _frames(vehicle, 3.0, 2)
    equal(sorted({entry.kind for entry in frames if entry.raw[0] != MAVLINK2}), [], "MAVLink 1 frames")
    return f"{len(frames)} frames"


@check("heartbeat")
def sequence_numbers_count(vehicle: VehicleUnderTest) -> str:
    """Sequence numbers of the autopilot increase by one; at most 5 % of the numbers are missing."""
    with vehicle.streaming({"ATTITUDE": 10.0}):
        frames = _own(vehicle, _frames(vehicle, 4.0, 20))
    missing = sum((b.seq - a.seq - 1) % 256 for a, b in pairwise(frames))
    at_most(missing, MAX_LOST_SHARE * (len(frames) + missing), "missing sequence numbers")
    return f"{len(frames)} frames, {missing} missing"


@check("heartbeat")
def payloads_are_trimmed(vehicle: VehicleUnderTest) -> str:
    """MAVLink 2 payloads have no trailing zeros, as the specification demands."""
    with vehicle.streaming({"ATTITUDE": 5.0, "SYS_STATUS": 5.0}):
        frames = [e for e in _frames(vehicle, 2.0, 8) if e.raw[0] == MAVLINK2]
    padded = sorted({e.kind for e in frames if len(e.payload) > 1 and e.payload[-1] == 0})
    equal(padded, [], "messages with a payload that ends in 0")
    return f"{len(frames)} frames"


@check("heartbeat")
def nothing_but_mavlink(vehicle: VehicleUnderTest) -> None:
    """Between boots the link carries only frames."""
    vehicle.wait(3.0)
    noise = bytes(vehicle.noise)
    holds(not noise, f"saw {len(noise)} bytes outside of frames: {noise[:20]!r}")


def _version(vehicle: VehicleUnderTest) -> Any:
    return vehicle.request("AUTOPILOT_VERSION")


@check("version")
def by_request_message(vehicle: VehicleUnderTest) -> str:
    """The vehicle sends AUTOPILOT_VERSION for REQUEST_MESSAGE."""
    return f"capabilities {_version(vehicle).capabilities:#x}"


@check("version")
def by_request_capabilities(vehicle: VehicleUnderTest) -> None:
    """The vehicle sends AUTOPILOT_VERSION for an accepted REQUEST_AUTOPILOT_CAPABILITIES."""
    mark = vehicle.mark()
    result = vehicle.command(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1)
    if result != ACCEPTED:
        raise Skip(f"the vehicle answers the deprecated command with {result}")
    vehicle.expect("AUTOPILOT_VERSION", mark=mark)


@check("version")
def by_old_message(vehicle: VehicleUnderTest) -> None:
    """ArduPilot answers AUTOPILOT_VERSION_REQUEST with AUTOPILOT_VERSION, PX4 not at all."""
    answered = vehicle.known(ardupilot=True, px4=False)
    vehicle.send(mavlink.MAVLink_autopilot_version_request_message(*vehicle.target))
    version = vehicle.wait_for("AUTOPILOT_VERSION", within_s=2.0)
    equal(version is not None, answered, "AUTOPILOT_VERSION is sent")


@check("version")
def same_every_time(vehicle: VehicleUnderTest) -> None:
    """Two AUTOPILOT_VERSION messages are equal."""
    first = _version(vehicle).to_dict()
    equal(_version(vehicle).to_dict(), first, "AUTOPILOT_VERSION")


@check("version")
def software_is_named(vehicle: VehicleUnderTest) -> str:
    """flight_sw_version has a version above 0 and a known kind of release."""
    value = _version(vehicle).flight_sw_version
    holds(value >> 8 != 0, f"expected a version above 0.0.0, saw flight_sw_version {value:#x}")
    holds(value & 0xFF in RELEASES, f"expected a FIRMWARE_VERSION_TYPE, saw {value & 0xFF}")
    return f"{version_text(value)} {RELEASES[value & 0xFF]}"


@check("version")
def has_an_identity(vehicle: VehicleUnderTest) -> str:
    """uid or uid2 is not 0."""
    version = _version(vehicle)
    holds(version.uid != 0 or any(version.uid2), "uid and uid2 are 0")
    return bytes(version.uid2).hex() if any(version.uid2) else f"{version.uid:#x}"


def _claims(vehicle: VehicleUnderTest, *capabilities: str) -> None:
    missing = [name for name in capabilities if not vehicle.identity.claims(name)]
    holds(not missing, f"not claimed: {' and '.join(missing)}")


checks(
    "version", _claims,
    row("claims_mavlink2", "MAVLINK2 is claimed.", "MAVLINK2"),
    row("claims_integer_missions", "MISSION_INT is claimed.", "MISSION_INT"),
    row("claims_command_int", "COMMAND_INT is claimed.", "COMMAND_INT", dialects=KNOWN),
    row("claims_fence_and_rally", "MISSION_FENCE and MISSION_RALLY are claimed.",
        "MISSION_FENCE", "MISSION_RALLY",
        dialects=KNOWN, source="AUTOPILOTS 2: fence, types 2/3/255"),
)  # fmt: skip


@check("version", source="AUTOPILOTS 1.16")
def claims_a_parameter_encoding(vehicle: VehicleUnderTest) -> str:
    """An encoding of parameters is claimed and agrees with the known encoding of the autopilot."""
    as_bytes = vehicle.identity.claims("PARAM_ENCODE_BYTEWISE")
    by_value = vehicle.identity.claims("PARAM_FLOAT") or vehicle.identity.claims("PARAM_ENCODE_C_CAST")
    holds(as_bytes or by_value, "no encoding of parameters is claimed")
    if vehicle.dialect.byte_wise is not None:
        equal(as_bytes, vehicle.dialect.byte_wise, "PARAM_ENCODE_BYTEWISE")
    return "byte-wise" if as_bytes else "float"


@check("version")
def protocol_version(vehicle: VehicleUnderTest) -> str:
    """PROTOCOL_VERSION, where supported, has version 200 (2.0) within its range."""
    seen = vehicle.request("PROTOCOL_VERSION")
    lowest, highest = seen.min_version, seen.max_version
    within(equal(seen.version, 200, "version"), lowest, highest, "version within its range")
    return f"{lowest} to {highest}"
