"""Feasibility of a fixed wing's mission on PX4 (MissionFeasibility/FeasibilityChecker.cpp)."""

import math
from collections.abc import Sequence
from itertools import pairwise

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.vehicle.mission import LANDINGS, Item
from sim_vehicle.vehicle.numbers import finite
from sim_vehicle.vehicle.rally import distance_m

SLOPE_TOLERANCE_DEG = 0.1
MIN_DESCENT_M = 1e-6
_ABOVE_SEA = frozenset({mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT})


def refusal(items: Sequence[Item], home_amsl_m: float, steepest_deg: float) -> str | None:
    """Return PX4's text of a refusal, or None for a feasible mission; `steepest_deg` is FW_LND_ANG."""
    return _order_error(items) or next(
        (
            text
            for before, item in pairwise(items)
            if item.command == mavlink.MAV_CMD_NAV_LAND
            and before.place_deg is not None
            and (text := _approach_error(before, item, home_amsl_m, steepest_deg)) is not None
        ),
        None,
    )


def _order_error(items: Sequence[Item]) -> str | None:
    starts = [i for i, item in enumerate(items) if item.command == mavlink.MAV_CMD_DO_LAND_START]
    ends = [i for i, item in enumerate(items) if item.command in LANDINGS]
    if len(starts) > 1:
        return "Mission rejected: more than one land start."
    if ends and ends[0] == 0:
        return "Mission rejected: starts with land waypoint."
    returns = [i for i, item in enumerate(items) if item.command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH]
    if starts and returns and starts[0] < returns[-1]:
        return "Mission rejected: land start item before RTL item not possible."
    if starts and starts[0] > (ends[-1] - 1 if ends else -1):
        return "Mission rejected: invalid land start."
    return None


def _approach_error(before: Item, land: Item, home_amsl_m: float, steepest_deg: float) -> str | None:
    """Return the error in the approach to a landing, or None."""
    down_m = _amsl_m(before, home_amsl_m) - _amsl_m(land, home_amsl_m)
    if down_m < MIN_DESCENT_M:
        return "Mission rejected: the approach waypoint must be above the landing point."
    assert before.place_deg is not None
    approach_m = distance_m(before.place_deg, land.place_deg or (0.0, 0.0))
    if before.command == mavlink.MAV_CMD_NAV_LOITER_TO_ALT:
        radius_m = abs(finite(before.param2))
        if approach_m <= radius_m:
            return "Mission rejected: the landing point must be outside the orbit radius."
        approach_m = math.sqrt(approach_m**2 - radius_m**2)
    elif before.command != mavlink.MAV_CMD_NAV_WAYPOINT:
        return (
            "Mission rejected: unsupported landing approach entrance waypoint type. "
            "Only ORBIT_TO_ALT or WAYPOINT allowed."
        )
    if down_m > math.tan(math.radians(steepest_deg + SLOPE_TOLERANCE_DEG)) * approach_m:
        return (
            "Mission rejected: the landing glide slope is steeper than the vehicle setting of "
            f"{steepest_deg:.1f} degrees."
        )
    return None


def _amsl_m(item: Item, home_amsl_m: float) -> float:
    return item.z if item.frame in _ABOVE_SEA else home_amsl_m + item.z
