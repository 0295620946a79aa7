"""STATUSTEXT messages of the run, and the answers of the vehicle at the end."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.assertions import Skip, holds
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest


def _texts(vehicle: VehicleUnderTest) -> list[tuple[float, int, str]]:
    if not vehicle.texts:
        raise Skip("the vehicle sent no texts")
    return vehicle.texts


@check("endurance.texts.severities")
def severities(vehicle: VehicleUnderTest) -> str:
    """Every STATUSTEXT has a MAV_SEVERITY."""
    wrong = [
        (severity, text)
        for _, severity, text in _texts(vehicle)
        if severity not in mavlink.enums["MAV_SEVERITY"]
    ]
    holds(not wrong, f"saw {wrong[:2]}")
    return f"{len(vehicle.texts)} texts"


@check("endurance.texts.are_readable")
def readable(vehicle: VehicleUnderTest) -> str:
    """Every STATUSTEXT is printable, apart from tabs; PX4 also sends a mere tab."""
    wrong = [text for _, _, text in _texts(vehicle) if not text.replace("\t", " ").isprintable()]
    holds(not wrong, f"saw {wrong[:2]!r}")
    return f"{len(vehicle.texts)} texts"


@check("endurance.still_answers")
def still_answers(vehicle: VehicleUnderTest) -> str:
    """At the end of the run the vehicle sends a heartbeat and AUTOPILOT_VERSION."""
    vehicle.expect("HEARTBEAT", within_s=3.0)
    vehicle.request("AUTOPILOT_VERSION")
    return f"mode {vehicle.mode}"
