"""Landing sequence of a PX4 1.15 mission, and its use in a return (navigator/rtl.cpp, mission_base.cpp).

The sequence begins at DO_LAND_START and ends at the first landing of the mission. Without a DO_LAND_START
before the landing, the sequence is the landing alone. RTL_TYPE decides if a return uses the sequence.
"""

import math
from collections.abc import Sequence

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.geodesy import distance_m
from sim_vehicle.vehicle.behaviour import Behaviour
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.mission import LANDINGS, Item
from sim_vehicle.vehicle.numbers import finite

LANDING_OR_RALLY, BY_MISSION, CLOSEST = 1, 2, 3  # RTL_TYPE; 0: home or a rally point
MIN_DISTANCE_THRESHOLD_M = 2.0  # MIN_DIST_THRESHOLD in the source


def mission_landing(items: Sequence[Item]) -> tuple[int, int] | None:
    """Return the first and last index of the landing sequence, or None for a mission without a landing."""
    last = next((i for i, item in enumerate(items) if item.command in LANDINGS), None)
    if last is None:
        return None
    starts = (i for i in range(last) if items[i].command == mavlink.MAV_CMD_DO_LAND_START)
    return next(starts, last), last


def return_by_mission(vehicle: Vehicle) -> tuple[Sequence[Item], float] | None:
    """Return the mission items that a return flies, and the altitude of the climb before these items.

    The altitude is above mean sea level [m]; -inf: no climb. Return None for a return without the mission.
    """
    mission, rtl_type = vehicle.mission, int(vehicle.params["RTL_TYPE"])
    landing = mission_landing(mission.items) if mission.flyable else None
    if landing is None or rtl_type not in (LANDING_OR_RALLY, BY_MISSION, CLOSEST):
        return None
    first, last = landing
    minimum_amsl_m = -math.inf
    if _is_landing(vehicle, first, last) or (rtl_type == BY_MISSION and _flies_mission(vehicle)):
        first = mission.index
    elif rtl_type != BY_MISSION:
        if _other_place_is_preferred(vehicle, mission.items[last], rtl_type):
            return None
        ground_m = vehicle.flight.altitude_amsl_m(mission.items[last].frame, mission.items[last].z)
        minimum_amsl_m = ground_m + vehicle.flight_parameters.returning.height_m
    placed = [item for item in mission.items[first : last + 1] if item.place_deg is not None]
    return (placed, minimum_amsl_m) if placed and placed[-1] is mission.items[last] else None


def _flies_mission(vehicle: Vehicle) -> bool:
    return vehicle.flight.behaviour is Behaviour.MISSION


def _other_place_is_preferred(vehicle: Vehicle, land: Item, rtl_type: int) -> bool:
    """Return True if a rally point is not farther away than the landing of the mission.

    With CLOSEST, home counts too, and a place can be 2 m farther away.
    """
    here_deg = vehicle.body.lat_lon_deg
    places = [point.place_deg for point in vehicle.home_and_rally.rally.items]
    if rtl_type == CLOSEST:
        places.append(vehicle.flight.home().lat_lon_deg)
    distances_m = [distance_m(here_deg, place_deg) for place_deg in places if place_deg is not None]
    landing_m = distance_m(here_deg, land.place_deg or (0.0, 0.0))
    return landing_m + (MIN_DISTANCE_THRESHOLD_M if rtl_type == CLOSEST else 0.0) >= min(
        distances_m, default=math.inf
    )


def _is_landing(vehicle: Vehicle, first: int, last: int) -> bool:
    """Return True in the landing sequence: past its first position, or in the LOITER_TO_ALT circle there."""
    mission = vehicle.mission
    if not _flies_mission(vehicle) or not first < mission.index <= last:
        return False
    placed = (i for i in range(first + 1, last + 1) if mission.items[i].place_deg is not None)
    entry = next(placed, last)
    item = mission.items[entry]
    if mission.index > entry or item.command != mavlink.MAV_CMD_NAV_LOITER_TO_ALT:
        return mission.index > entry
    radius_m = abs(finite(item.param2) or vehicle.flight_parameters.limits.loiter_radius_m)
    centre_m = distance_m(vehicle.body.lat_lon_deg, item.place_deg or (0.0, 0.0))
    return centre_m <= radius_m + vehicle.flight_parameters.limits.acceptance_radius_m
