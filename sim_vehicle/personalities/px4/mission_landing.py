"""Landing sequence of a PX4 1.15 mission, and its use in a return (navigator/rtl.cpp, mission_base.cpp).

The sequence begins at DO_LAND_START and ends at the first landing of the list; a landing before DO_LAND_START
is a sequence alone. RTL_TYPE decides about its use in a return.
"""

import math
from collections.abc import Sequence

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.personalities.base import Vehicle
from sim_vehicle.vehicle.behaviour import Behaviour
from sim_vehicle.vehicle.mission import Item
from sim_vehicle.vehicle.numbers import finite
from sim_vehicle.vehicle.rally import distance_m

LANDINGS = frozenset({mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_VTOL_LAND})
HOME_OR_RALLY, LANDING_OR_RALLY, BY_MISSION, CLOSEST = 0, 1, 2, 3  # RTL_TYPE
TO_BE_CLOSER_M = 2.0  # MIN_DIST_THRESHOLD


def mission_landing(items: Sequence[Item]) -> tuple[int, int] | None:
    """Return the first and last index of the landing sequence; None without one."""
    ends = next((i for i, item in enumerate(items) if item.command in LANDINGS), None)
    if ends is None:
        return None
    starts = (i for i in range(ends) if items[i].command == mavlink.MAV_CMD_DO_LAND_START)
    return next(starts, ends), ends


def return_by_mission(vehicle: Vehicle) -> tuple[Sequence[Item], float] | None:
    """Return the mission items of a return and the altitude to climb to first [m above mean sea level]."""
    mission, kind = vehicle.mission, int(vehicle.params["RTL_TYPE"])
    landing = mission_landing(mission.items) if mission.flyable else None
    if landing is None or kind not in (LANDING_OR_RALLY, BY_MISSION, CLOSEST):
        return None
    begins, ends = landing
    least_amsl_m = -math.inf
    if _is_landing(vehicle, begins, ends) or (kind == BY_MISSION and _flies(vehicle)):
        begins = mission.index
    elif kind != BY_MISSION:
        if _is_elsewhere_nearer(vehicle, mission.items[ends], kind):
            return None
        ground_m = vehicle.flight.altitude_amsl_m(mission.items[ends].frame, mission.items[ends].z)
        least_amsl_m = ground_m + vehicle.flight_parameters.return_height_m
    flown = [item for item in mission.items[begins : ends + 1] if item.place_deg is not None]
    return (flown, least_amsl_m) if flown and flown[-1] is mission.items[ends] else None


def _flies(vehicle: Vehicle) -> bool:
    return vehicle.flight.behaviour is Behaviour.MISSION


def _is_elsewhere_nearer(vehicle: Vehicle, land: Item, kind: int) -> bool:
    """Return True if a rally point (or home, if it counts) is nearer than the landing of the mission."""
    here_deg = vehicle.body.lat_lon_deg
    places = [point.place_deg for point in vehicle.home_and_rally.rally.items]
    if kind == CLOSEST:
        places.append(vehicle.home_and_rally.home_deg)
    others_m = [distance_m(here_deg, place_deg) for place_deg in places if place_deg is not None]
    away_m = distance_m(here_deg, land.place_deg or (0.0, 0.0))
    return away_m + (TO_BE_CLOSER_M if kind == CLOSEST else 0.0) >= min(others_m, default=math.inf)


def _is_landing(vehicle: Vehicle, begins: int, ends: int) -> bool:
    """Return True during the mission landing: past its first position, or circling there."""
    mission = vehicle.mission
    if not _flies(vehicle) or not begins < mission.index <= ends:
        return False
    placed = (i for i in range(begins + 1, ends + 1) if mission.items[i].place_deg is not None)
    first = next(placed, ends)
    item = mission.items[first]
    if mission.index > first or item.command != mavlink.MAV_CMD_NAV_LOITER_TO_ALT:
        return mission.index > first
    radius_m = abs(finite(item.param2) or vehicle.flight_parameters.loiter_radius_m)
    away_m = distance_m(vehicle.body.lat_lon_deg, item.place_deg or (0.0, 0.0))
    return away_m <= radius_m + vehicle.flight_parameters.waypoint_radius_m
