"""The identity of the vehicle under test."""

from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.dialects import PLANE_TYPES

SIMULATOR_MARK = b"sim_vehicle"  # first bytes of the simulator's uid2
SIGNED = 0x01  # MAVLink 2 incompatibility flag of a signed frame


@dataclass(frozen=True, slots=True)
class VehicleIdentity:
    """The identity of a vehicle, from HEARTBEAT and, if received, AUTOPILOT_VERSION."""

    sysid: int
    component: int
    autopilot: int  # MAV_AUTOPILOT
    vehicle_type: int  # MAV_TYPE
    capabilities: int = 0  # MAV_PROTOCOL_CAPABILITY bits
    software: int = 0  # flight_sw_version
    uid2: bytes = b""

    @property
    def simulator(self) -> bool:
        return self.uid2.startswith(SIMULATOR_MARK)

    @property
    def kind(self) -> str:
        return "plane" if self.vehicle_type in PLANE_TYPES else "copter"

    def claims(self, capability: str) -> bool:
        bit: int = getattr(mavlink, f"MAV_PROTOCOL_CAPABILITY_{capability}")
        return bool(self.capabilities & bit)
