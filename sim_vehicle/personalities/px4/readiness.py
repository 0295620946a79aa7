"""Arming checks of PX4, and the feasibility of missions."""

import math
from collections.abc import Sequence
from itertools import pairwise

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.geodesy import distance_m
from sim_vehicle.vehicle.behaviour import Behaviour
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.mission import LANDINGS, TAKEOFFS, Item
from sim_vehicle.vehicle.numbers import finite

_POSITION_COMMANDS = TAKEOFFS | {
    mavlink.MAV_CMD_NAV_WAYPOINT,
    mavlink.MAV_CMD_NAV_LOITER_UNLIM,
    mavlink.MAV_CMD_NAV_LOITER_TIME,
    mavlink.MAV_CMD_NAV_LOITER_TO_ALT,
    *LANDINGS,
}
SLOPE_TOLERANCE_DEG = 0.1
MIN_DESCENT_M = 1e-6
_ABOVE_SEA = frozenset({mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT})
TAKEOFF_REQUIRED, LANDING_REQUIRED, BOTH_REQUIRED, BOTH_OR_NONE = 1, 2, 3, 4  # MIS_TKO_LAND_REQ

_UNHEALTHY_TEXTS = {
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO: "No valid data from Gyro 0",
    mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL: "No valid data from Accel 0",
    mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG: "No valid data from Compass 0",
    mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE: "No valid data from Baro 0",
    mavlink.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE: "Airspeed invalid",
    mavlink.MAV_SYS_STATUS_SENSOR_GPS: "GPS fix too low",
    mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER: "No manual control input",
    mavlink.MAV_SYS_STATUS_AHRS: "ekf2 missing data",
    mavlink.MAV_SYS_STATUS_LOGGING: "Logger not running",
    mavlink.MAV_SYS_STATUS_SENSOR_BATTERY: "Battery unhealthy",
}


def refusals(vehicle: Vehicle, now: float) -> list[str]:
    """Return all reasons against arming in the present mode, as PX4's texts."""
    return [*_position_refusals(vehicle, now), *_mode_refusals(vehicle, now), *_system_refusals(vehicle)]


def _position_refusals(vehicle: Vehicle, now: float) -> list[str]:
    if vehicle.params["COM_ARM_WO_GPS"] == 0 and not (
        vehicle.readiness.gps_fix_ready(now) and vehicle.body.gps_fix
    ):
        return ["GPS fix too low"]
    if not vehicle.mode.needs_position or vehicle.position_known(now):
        return []
    if not vehicle.readiness.gps_fix_ready(now):
        return ["ekf2 missing data"]
    return ["No valid global position estimate"]


def _mode_refusals(vehicle: Vehicle, now: float) -> list[str]:
    mode = vehicle.mode
    if not mode.armable:
        return ["Mode not suitable for takeoff"]
    if mode.needs_pilot and vehicle.remote.missing(now):
        return ["No manual control input"]
    if mode.setpoints_only and not vehicle.setpoints.streaming(now):
        return ["No offboard signal"]
    if mode.behaviour is Behaviour.MISSION and not vehicle.modes.mission_ready(now):
        return ["No valid mission available"]
    return []


def _battery_refusals(vehicle: Vehicle) -> list[str]:
    """Return the refusal of a charge below COM_ARM_BAT_MIN (if negative: below BAT_CRIT_THR)."""
    share = vehicle.body.battery_remaining
    _, low, critical = vehicle.flight_parameters.battery.levels
    minimum_share = vehicle.params["COM_ARM_BAT_MIN"]
    if share >= (minimum_share if minimum_share >= 0 else low.below_share):
        return []
    if share < critical.below_share:
        return ["Emergency battery level"]
    return ["Critical battery" if share < low.below_share else "Low battery"]


def _system_refusals(vehicle: Vehicle) -> list[str]:
    reasons = []
    if vehicle.failsafes.gcs_missing:
        reasons.append("No connection to the ground control station")
    reasons += _battery_refusals(vehicle)
    if vehicle.params["COM_ARM_MIS_REQ"] == 1 and vehicle.mission.empty:
        reasons.append("No valid mission")
    unhealthy = vehicle.injected_faults.effect.unhealthy_sensors
    return reasons + [reason for bit, reason in _UNHEALTHY_TEXTS.items() if unhealthy & bit]


def feasible(vehicle: Vehicle, items: Sequence[Item]) -> bool:
    """Return True if PX4 can fly the mission; send the reason against a mission with items as a text."""
    refusal = _distance_refusal(vehicle, items)
    if refusal is None and vehicle.body.plane:
        refusal = _fence_refusal(vehicle, items)
    if refusal is None and vehicle.body.plane:
        home_m = vehicle.flight.home().alt_amsl_m
        refusal = _wing_refusal(items, home_m, vehicle.params["FW_LND_ANG"])
    refusal = (
        refusal
        or _takeoff_refusal(items)
        or _required_items_refusal(items, int(vehicle.params["MIS_TKO_LAND_REQ"]))
    )
    if refusal is not None:
        vehicle.send_text(mavlink.MAV_SEVERITY_CRITICAL, refusal)
    return refusal is None and bool(items)


def _distance_refusal(vehicle: Vehicle, items: Sequence[Item]) -> str | None:
    """Return the refusal of a first position too far from the vehicle; 0, 0 counts as a position."""
    limit_m = vehicle.params["MIS_DIST_1WP"]
    first = next((item for item in items if item.command in _POSITION_COMMANDS), None)
    if first is None or limit_m <= 0 or not vehicle.position_known(vehicle.now):
        return None
    away_m = distance_m((first.x * 1e-7, first.y * 1e-7), vehicle.body.lat_lon_deg)
    return f"First waypoint too far away: {int(away_m)}m, {int(limit_m)} max" if away_m >= limit_m else None


def _fence_refusal(vehicle: Vehicle, items: Sequence[Item]) -> str | None:
    """Return the refusal of a position outside the fence, for every value of GF_ACTION.

    The check applies only to fixed wings: PX4 was not observed to refuse such a mission of a multicopter.
    """
    for number, item in enumerate(items, start=1):
        place_deg = item.place_deg if item.command in _POSITION_COMMANDS else None
        alt_amsl_m = vehicle.flight.altitude_amsl_m(item.frame, item.z)
        if place_deg is not None and vehicle.fence_watch.find(*place_deg, alt_amsl_m):
            return f"Geofence violation for waypoint {number}"
    return None


def _takeoff_refusal(items: Sequence[Item]) -> str | None:
    placed = [item.command in TAKEOFFS for item in items if item.command in _POSITION_COMMANDS]
    return "Mission rejected: takeoff not first waypoint item" if any(placed[1:]) else None


def _required_items_refusal(items: Sequence[Item], required: int) -> str | None:
    if not items:
        return None
    takeoff = any(item.command in TAKEOFFS for item in items)
    landing = any(item.command in LANDINGS for item in items)
    if required in (TAKEOFF_REQUIRED, BOTH_REQUIRED) and not takeoff:
        return "Mission rejected: Takeoff waypoint required."
    if required in (LANDING_REQUIRED, BOTH_REQUIRED) and not landing:
        return "Mission rejected: Landing waypoint/pattern required."
    if required == BOTH_OR_NONE and takeoff != landing:
        missing = "Landing item" if takeoff else "Takeoff item"
        return f"Mission rejected: Add {missing} or remove the other."
    return None


# -- approach of a fixed wing (MissionFeasibility/FeasibilityChecker.cpp) ------------------------------------


def _wing_refusal(items: Sequence[Item], home_amsl_m: float, steepest_deg: float) -> str | None:
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
