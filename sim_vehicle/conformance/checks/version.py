"""Who the vehicle says it is, and what it claims to be able to do."""

import struct

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import frames
from sim_vehicle.conformance.peer import Peer
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import Skip, equal, holds, result_name

PROTOCOL = struct.Struct("<HHH")  # the head of PROTOCOL_VERSION as it travels
RELEASES = {0: "development", 64: "alpha", 128: "beta", 192: "candidate", 255: "official"}


@check("version.by_request_message")
def by_request_message(peer: Peer) -> str:
    """REQUEST_MESSAGE brings AUTOPILOT_VERSION."""
    version = peer.request("AUTOPILOT_VERSION")
    return f"capabilities {version.capabilities:#x}"


@check("version.by_request_capabilities")
def by_request_capabilities(peer: Peer) -> str:
    """REQUEST_AUTOPILOT_CAPABILITIES, where it is still served, brings AUTOPILOT_VERSION."""
    mark = peer.mark()
    result = peer.command(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1)
    if result != mavlink.MAV_RESULT_ACCEPTED:
        raise Skip(f"deprecated, answered {result_name(result)}")
    peer.expect("AUTOPILOT_VERSION", mark=mark)
    return "AUTOPILOT_VERSION"


@check("version.same_every_time")
def same_every_time(peer: Peer) -> str:
    """Two answers are equal."""
    first, second = (peer.request("AUTOPILOT_VERSION").to_dict() for _ in range(2))
    equal(second, first, "AUTOPILOT_VERSION")
    return "equal"


@check("version.software_is_named")
def software_is_named(peer: Peer) -> str:
    """flight_sw_version carries a version and a known kind of release."""
    value = peer.request("AUTOPILOT_VERSION").flight_sw_version
    holds(value >> 8 != 0, "flight_sw_version is 0")
    holds(value & 0xFF in RELEASES, f"expected a FIRMWARE_VERSION_TYPE, saw {value & 0xFF}")
    major, minor, patch = value >> 24, value >> 16 & 0xFF, value >> 8 & 0xFF
    return f"{major}.{minor}.{patch} {RELEASES[value & 0xFF]}"


@check("version.has_an_identity")
def has_an_identity(peer: Peer) -> str:
    """uid or uid2 tells one vehicle from another."""
    version = peer.request("AUTOPILOT_VERSION")
    holds(version.uid != 0 or any(version.uid2), "uid and uid2 are 0")
    return bytes(version.uid2).hex() if any(version.uid2) else f"{version.uid:#x}"


@check("version.claims_mavlink2")
def claims_mavlink2(peer: Peer) -> str:
    """What speaks MAVLink 2 claims it."""
    holds(peer.facts.claims("MAVLINK2"), "MAVLINK2 is not claimed")
    return "MAVLINK2"


@check("version.claims_integer_missions")
def claims_integer_missions(peer: Peer) -> str:
    """MISSION_INT is claimed: positions travel at full precision."""
    holds(peer.facts.claims("MISSION_INT"), "MISSION_INT is not claimed")
    return "MISSION_INT"


@check("version.claims_a_parameter_encoding", pins="AUTOPILOTS 1.16")
def claims_a_parameter_encoding(peer: Peer) -> str:
    """The claimed encoding of parameters is the one the autopilot uses."""
    as_bytes = peer.facts.claims("PARAM_ENCODE_BYTEWISE")
    by_value = peer.facts.claims("PARAM_FLOAT") or peer.facts.claims("PARAM_ENCODE_C_CAST")
    holds(as_bytes or by_value, "no encoding is claimed")
    if peer.dialect.byte_wise is not None:
        equal(as_bytes, peer.dialect.byte_wise, "PARAM_ENCODE_BYTEWISE")
    return "byte-wise" if as_bytes else "float"


@check("version.claims_command_int", dialects=("ardupilot", "px4"))
def claims_command_int(peer: Peer) -> str:
    """COMMAND_INT is claimed."""
    holds(peer.facts.claims("COMMAND_INT"), "COMMAND_INT is not claimed")
    return "COMMAND_INT"


@check(
    "version.claims_fence_and_rally", dialects=("ardupilot", "px4"), pins="AUTOPILOTS 2: fence, types 2/3/255"
)
def claims_fence_and_rally(peer: Peer) -> str:
    """MISSION_FENCE and MISSION_RALLY are claimed."""
    missing = [c for c in ("MISSION_FENCE", "MISSION_RALLY") if not peer.facts.claims(c)]
    holds(not missing, f"{' and '.join(missing)} not claimed")
    return "MISSION_FENCE, MISSION_RALLY"


@check("version.protocol_version")
def protocol_version(peer: Peer) -> str:
    """PROTOCOL_VERSION, where it is told, says 2.0 within a range that has it."""
    version, lowest, highest = frames.requested(peer, frames.PROTOCOL_VERSION, PROTOCOL)
    equal(version, 200, "version")
    holds(lowest <= 200 <= highest, f"{lowest} to {highest}")
    return f"{lowest} to {highest}"
