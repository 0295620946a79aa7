"""A small mission for flight checks, begun on the ground or in the air."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.messages import PlanItem

CORNERS = ((40.0, 0.0), (40.0, 40.0), (0.0, 40.0))  # metres north and east of the start
HEIGHT_M = 12.0  # above home


def items(vehicle: VehicleUnderTest, *, landing: bool = True) -> list[PlanItem]:
    """Return a take-off here and three waypoints, with or without a landing at the last waypoint."""
    place = plans.current_position(vehicle)
    found = [plans.takeoff(place, HEIGHT_M), *[plans.waypoint(place, n, e, HEIGHT_M) for n, e in CORNERS]]
    if landing:
        found.append(plans.land(place, *CORNERS[-1]))
    return plans.plan(vehicle, *found)


def rewind(vehicle: VehicleUnderTest) -> None:
    """Make the first item after home current, because the index of an earlier mission may remain."""
    flying.set_current(vehicle, int(vehicle.dialect.home_item))


def start(vehicle: VehicleUnderTest) -> None:
    """Arm the vehicle and start the stored mission from the ground."""
    flying.start_streams(vehicle)
    rewind(vehicle)
    flying.arm(vehicle)
    if vehicle.dialect.name == "ardupilot":
        vehicle.expect_accepted(mavlink.MAV_CMD_MISSION_START)
    else:
        flying.set_mode(vehicle, "mission")
    flying.wait_for_mode(vehicle, "mission")


def resume(vehicle: VehicleUnderTest, seq: int) -> None:
    """Set the mission mode in flight, with item `seq` as the current item."""
    flying.set_current(vehicle, seq)
    flying.set_mode(vehicle, "mission")


def current(vehicle: VehicleUnderTest) -> int:
    """Return the latest reported current item; -1 before the first report."""
    return int(vehicle.last["MISSION_CURRENT"].seq) if "MISSION_CURRENT" in vehicle.last else -1


def first_waypoint(vehicle: VehicleUnderTest) -> int:
    """Return the sequence number of the first waypoint after the take-off."""
    return 2 if vehicle.dialect.home_item else 1


def wait_until_current(vehicle: VehicleUnderTest, seq: int, within_s: float) -> float:
    """Wait until item `seq` is current; return the time taken [s]."""
    return vehicle.wait_until(lambda: current(vehicle) == seq, f"item {seq} to be current", within_s)


def under_way(vehicle: VehicleUnderTest) -> int:
    """Upload the mission and fly 10 m past the first waypoint; return seq of the second waypoint."""
    place = plans.current_position(vehicle)
    plans.upload_or_fail(vehicle, items(vehicle, landing=False))
    seq = first_waypoint(vehicle) + 1
    resume(vehicle, seq - 1)
    wait_until_current(vehicle, seq, 120.0)
    first = plans.offset(place, *CORNERS[0])
    vehicle.wait_until(
        lambda: flying.distance_to_m(vehicle, first) > 10.0, "10 m from the first waypoint", 20.0
    )
    return seq
