"""Identity and claimed capabilities of the vehicle."""

import struct
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.assertions import ACCEPTED, Skip, equal, holds, within
from sim_vehicle.conformance.dialects import version_text
from sim_vehicle.conformance.frames import PROTOCOL_VERSION
from sim_vehicle.conformance.registry import CheckFunction, check
from sim_vehicle.conformance.vehicle import VehicleUnderTest

PROTOCOL = struct.Struct("<HHH")  # the first fields of PROTOCOL_VERSION on the wire
RELEASES = {0: "development", 64: "alpha", 128: "beta", 192: "candidate", 255: "official"}


def _version(vehicle: VehicleUnderTest) -> Any:
    return vehicle.request("AUTOPILOT_VERSION")


@check("version.by_request_message")
def by_request_message(vehicle: VehicleUnderTest) -> str:
    """The vehicle sends AUTOPILOT_VERSION for REQUEST_MESSAGE."""
    return f"capabilities {_version(vehicle).capabilities:#x}"


@check("version.by_request_capabilities")
def by_request_capabilities(vehicle: VehicleUnderTest) -> str:
    """The vehicle sends AUTOPILOT_VERSION for an accepted REQUEST_AUTOPILOT_CAPABILITIES."""
    mark = vehicle.mark()
    result = vehicle.command(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1)
    if result != ACCEPTED:
        raise Skip(f"the vehicle answers the deprecated command with {result}")
    vehicle.expect("AUTOPILOT_VERSION", mark=mark)
    return "AUTOPILOT_VERSION"


@check("version.by_old_message")
def by_old_message(vehicle: VehicleUnderTest) -> str:
    """ArduPilot answers AUTOPILOT_VERSION_REQUEST with AUTOPILOT_VERSION, PX4 not at all."""
    answered = vehicle.known(ardupilot=True, px4=False)
    mark = vehicle.send(mavlink.MAVLink_autopilot_version_request_message(*vehicle.target))
    version = vehicle.wait_for("AUTOPILOT_VERSION", within_s=2.0, mark=mark)
    equal(version is not None, answered, "AUTOPILOT_VERSION is sent")
    return "answered" if answered else "not answered"


@check("version.same_every_time")
def same_every_time(vehicle: VehicleUnderTest) -> str:
    """Two AUTOPILOT_VERSION messages are equal."""
    first = _version(vehicle).to_dict()
    equal(_version(vehicle).to_dict(), first, "AUTOPILOT_VERSION")
    return "equal"


@check("version.software_is_named")
def software_is_named(vehicle: VehicleUnderTest) -> str:
    """flight_sw_version has a version above 0 and a known kind of release."""
    value = _version(vehicle).flight_sw_version
    holds(value >> 8 != 0, f"expected a version above 0.0.0, saw flight_sw_version {value:#x}")
    holds(value & 0xFF in RELEASES, f"expected a FIRMWARE_VERSION_TYPE, saw {value & 0xFF}")
    return f"{version_text(value)} {RELEASES[value & 0xFF]}"


@check("version.has_an_identity")
def has_an_identity(vehicle: VehicleUnderTest) -> str:
    """uid or uid2 is not 0."""
    version = _version(vehicle)
    holds(version.uid != 0 or any(version.uid2), "uid and uid2 are 0")
    return bytes(version.uid2).hex() if any(version.uid2) else f"{version.uid:#x}"


def _claims_check(*capabilities: str) -> CheckFunction:
    def run(vehicle: VehicleUnderTest) -> str:
        missing = [name for name in capabilities if not vehicle.identity.claims(name)]
        holds(not missing, f"not claimed: {' and '.join(missing)}")
        return ", ".join(capabilities)

    run.__doc__ = f"{' and '.join(capabilities)} {'is' if len(capabilities) == 1 else 'are'} claimed."
    return run


check("version.claims_mavlink2")(_claims_check("MAVLINK2"))
check("version.claims_integer_missions")(_claims_check("MISSION_INT"))
check("version.claims_command_int", dialects=("ardupilot", "px4"))(_claims_check("COMMAND_INT"))
check(
    "version.claims_fence_and_rally",
    dialects=("ardupilot", "px4"),
    source="AUTOPILOTS 2: fence, types 2/3/255",
)(_claims_check("MISSION_FENCE", "MISSION_RALLY"))


@check("version.claims_a_parameter_encoding", source="AUTOPILOTS 1.16")
def claims_a_parameter_encoding(vehicle: VehicleUnderTest) -> str:
    """An encoding of parameters is claimed and agrees with the known encoding of the autopilot."""
    as_bytes = vehicle.identity.claims("PARAM_ENCODE_BYTEWISE")
    by_value = vehicle.identity.claims("PARAM_FLOAT") or vehicle.identity.claims("PARAM_ENCODE_C_CAST")
    holds(as_bytes or by_value, "no encoding of parameters is claimed")
    if vehicle.dialect.byte_wise is not None:
        equal(as_bytes, vehicle.dialect.byte_wise, "PARAM_ENCODE_BYTEWISE")
    return "byte-wise" if as_bytes else "float"


@check("version.protocol_version")
def protocol_version(vehicle: VehicleUnderTest) -> str:
    """PROTOCOL_VERSION, where supported, has version 200 (2.0) within its range."""
    version, lowest, highest = vehicle.request_fields(PROTOCOL_VERSION, PROTOCOL)
    within(equal(version, 200, "version"), lowest, highest, "version within its range")
    return f"{lowest} to {highest}"
