"""Identity and claimed capabilities of the vehicle."""

import struct

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import frames
from sim_vehicle.conformance.assertions import Skip, equal, holds, result_name
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest, known_behaviour

PROTOCOL = struct.Struct("<HHH")  # the first fields of PROTOCOL_VERSION on the wire
RELEASES = {0: "development", 64: "alpha", 128: "beta", 192: "candidate", 255: "official"}


@check("version.by_request_message")
def by_request_message(vehicle: VehicleUnderTest) -> str:
    """The vehicle sends AUTOPILOT_VERSION for REQUEST_MESSAGE."""
    version = vehicle.request("AUTOPILOT_VERSION")
    return f"capabilities {version.capabilities:#x}"


@check("version.by_request_capabilities")
def by_request_capabilities(vehicle: VehicleUnderTest) -> str:
    """The vehicle sends AUTOPILOT_VERSION for an accepted REQUEST_AUTOPILOT_CAPABILITIES."""
    mark = vehicle.mark()
    result = vehicle.command(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1)
    if result != mavlink.MAV_RESULT_ACCEPTED:
        raise Skip(f"the vehicle answers the deprecated command with {result_name(result)}")
    vehicle.expect("AUTOPILOT_VERSION", mark=mark)
    return "AUTOPILOT_VERSION"


@check("version.by_old_message")
def by_old_message(vehicle: VehicleUnderTest) -> str:
    """ArduPilot answers AUTOPILOT_VERSION_REQUEST with AUTOPILOT_VERSION, PX4 not at all."""
    answered = known_behaviour(vehicle, ardupilot=True, px4=False)
    mark = vehicle.mark()
    vehicle.send(mavlink.MAVLink_autopilot_version_request_message(*vehicle.target))
    version = vehicle.wait_for("AUTOPILOT_VERSION", within_s=2.0, mark=mark)
    equal(version is not None, answered, "AUTOPILOT_VERSION is sent")
    return "answered" if answered else "not answered"


@check("version.same_every_time")
def same_every_time(vehicle: VehicleUnderTest) -> str:
    """Two AUTOPILOT_VERSION messages are equal."""
    first, second = (vehicle.request("AUTOPILOT_VERSION").to_dict() for _ in range(2))
    equal(second, first, "AUTOPILOT_VERSION")
    return "equal"


@check("version.software_is_named")
def software_is_named(vehicle: VehicleUnderTest) -> str:
    """flight_sw_version has a version above 0 and a known kind of release."""
    value = vehicle.request("AUTOPILOT_VERSION").flight_sw_version
    holds(value >> 8 != 0, f"expected a version above 0.0.0, saw flight_sw_version {value:#x}")
    holds(value & 0xFF in RELEASES, f"expected a FIRMWARE_VERSION_TYPE, saw {value & 0xFF}")
    major, minor, patch = value >> 24, value >> 16 & 0xFF, value >> 8 & 0xFF
    return f"{major}.{minor}.{patch} {RELEASES[value & 0xFF]}"


@check("version.has_an_identity")
def has_an_identity(vehicle: VehicleUnderTest) -> str:
    """uid or uid2 is not 0."""
    version = vehicle.request("AUTOPILOT_VERSION")
    holds(version.uid != 0 or any(version.uid2), "uid and uid2 are 0")
    return bytes(version.uid2).hex() if any(version.uid2) else f"{version.uid:#x}"


@check("version.claims_mavlink2")
def claims_mavlink2(vehicle: VehicleUnderTest) -> str:
    """MAVLINK2 is claimed."""
    holds(vehicle.identity.claims("MAVLINK2"), "MAVLINK2 is not claimed")
    return "MAVLINK2"


@check("version.claims_integer_missions")
def claims_integer_missions(vehicle: VehicleUnderTest) -> str:
    """MISSION_INT is claimed."""
    holds(vehicle.identity.claims("MISSION_INT"), "MISSION_INT is not claimed")
    return "MISSION_INT"


@check("version.claims_a_parameter_encoding", source="AUTOPILOTS 1.16")
def claims_a_parameter_encoding(vehicle: VehicleUnderTest) -> str:
    """An encoding of parameters is claimed and agrees with the known encoding of the autopilot."""
    as_bytes = vehicle.identity.claims("PARAM_ENCODE_BYTEWISE")
    by_value = vehicle.identity.claims("PARAM_FLOAT") or vehicle.identity.claims("PARAM_ENCODE_C_CAST")
    holds(as_bytes or by_value, "no encoding of parameters is claimed")
    if vehicle.dialect.byte_wise is not None:
        equal(as_bytes, vehicle.dialect.byte_wise, "PARAM_ENCODE_BYTEWISE")
    return "byte-wise" if as_bytes else "float"


@check("version.claims_command_int", dialects=("ardupilot", "px4"))
def claims_command_int(vehicle: VehicleUnderTest) -> str:
    """COMMAND_INT is claimed."""
    holds(vehicle.identity.claims("COMMAND_INT"), "COMMAND_INT is not claimed")
    return "COMMAND_INT"


@check(
    "version.claims_fence_and_rally",
    dialects=("ardupilot", "px4"),
    source="AUTOPILOTS 2: fence, types 2/3/255",
)
def claims_fence_and_rally(vehicle: VehicleUnderTest) -> str:
    """MISSION_FENCE and MISSION_RALLY are claimed."""
    missing = [c for c in ("MISSION_FENCE", "MISSION_RALLY") if not vehicle.identity.claims(c)]
    holds(not missing, f"{' and '.join(missing)} not claimed")
    return "MISSION_FENCE, MISSION_RALLY"


@check("version.protocol_version")
def protocol_version(vehicle: VehicleUnderTest) -> str:
    """PROTOCOL_VERSION, where supported, has version 200 (2.0) within its range."""
    version, lowest, highest = frames.request_fields(vehicle, frames.PROTOCOL_VERSION, PROTOCOL)
    equal(version, 200, "version")
    holds(lowest <= 200 <= highest, f"expected a range that includes 200, saw {lowest} to {highest}")
    return f"{lowest} to {highest}"
