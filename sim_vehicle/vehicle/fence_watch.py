"""Enforcement of one vehicle's geofence: breaches, texts and actions.

The fence acts once at the start of a breach, so that a pilot can override the action. Beyond a circle or an
altitude limit the fence acts again NEXT_BREACH_M farther out. A breach without an action is counted too.
"""

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.geodesy import distance_m
from sim_vehicle.vehicle.flight_parameters import FailsafeAction, FenceParameters
from sim_vehicle.vehicle.interface import Vehicle

ALTITUDE_MAX, CIRCLE, POLYGON, ALTITUDE_MIN = "altitude_max", "circle", "polygon", "altitude_min"
NAMES = {ALTITUDE_MAX: "Max Alt", CIRCLE: "Circle", POLYGON: "Polygon", ALTITUDE_MIN: "Min Alt"}
NEXT_BREACH_M = 20.0  # distance farther out at which the fence acts again
NEXT_BREACH_PLANE_M = 100.0  # the same distance for a plane beyond the circle around home
RECOVERY_S = 10.0  # time without actions after a mode change by a ground station
_FENCE_BREACHES = (  # FENCE_STATUS reports the first of several breaches
    ({CIRCLE, POLYGON}, int(mavlink.FENCE_BREACH_BOUNDARY)),
    ({ALTITUDE_MAX}, int(mavlink.FENCE_BREACH_MAXALT)),
    ({ALTITUDE_MIN}, int(mavlink.FENCE_BREACH_MINALT)),
)


def names_of(breaches: frozenset[str]) -> str:
    """Return the names of breached limits, as in "Max Alt, Circle and Polygon fences"."""
    names = [name for limit, name in NAMES.items() if limit in breaches]
    listed = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    return f"{listed} fence{'s' if len(names) > 1 else ''}"


class FenceWatch:
    """Breaches of one vehicle (altitude_max, circle, polygon, altitude_min), their count and last time."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        # set by MAV_CMD_DO_FENCE_ENABLE; overrides the parameter until the parameter changes
        self._enabled_by_command: bool | None = None
        self.breached: frozenset[str] = frozenset()
        self.count = 0
        self.last_s = 0.0  # start of the latest breach
        self._enabled_by_parameter = self._parameters.enabled
        # limits set when the fence was enabled; only these are enforced if `fence_limits_latch`
        self._limits_at_enabling = self._configured()
        self._floor_enforced = False  # the minimum altitude is enforced
        # breached limit -> distance beyond the limit at which the fence acts again
        self._next_breach_m: dict[str, float] = {}
        self._recovers_until_s = -math.inf

    @property
    def _parameters(self) -> FenceParameters:
        return self._vehicle.flight_parameters.fence

    @property
    def enabled(self) -> bool:
        by_command = self._enabled_by_command
        return self._parameters.enabled if by_command is None else by_command

    def parameters_changed(self) -> None:
        by_parameter = self._parameters.enabled
        if by_parameter != self._enabled_by_parameter:
            self._enabled_by_parameter, self._enabled_by_command = by_parameter, None
            self._limits_at_enabling = self._configured()

    def set_enabled(self, *, on: bool) -> None:
        """Enable or disable the fence by command; a change of the parameter ends the override."""
        self._enabled_by_command = on
        self._limits_at_enabling = self._limits_at_enabling | self._configured() if on else frozenset()

    def _configured(self) -> frozenset[str]:
        """Return the limits set by the parameters, except the minimum altitude."""
        limits = self._parameters
        is_set = {
            ALTITUDE_MAX: math.isfinite(limits.max_height_m),
            CIRCLE: math.isfinite(limits.radius_m),
            POLYGON: limits.polygons,
        }
        return frozenset(limit for limit, has_value in is_set.items() if has_value)

    @property
    def active(self) -> bool:
        """True while the vehicle has to check its position often."""
        vehicle = self._vehicle
        return self.enabled and vehicle.armed and vehicle.body.airborne and self.has_limits

    @property
    def has_limits(self) -> bool:
        """True if any limit is set."""
        limits = self._parameters
        return (
            math.isfinite(limits.max_height_m)
            or math.isfinite(limits.radius_m)
            or math.isfinite(limits.min_height_m)
            or (limits.polygons and bool(self._vehicle.fence.zones))
        )

    @property
    def ceiling_amsl_m(self) -> float:
        """Highest altitude of a return if `returning.under_fence` [m above mean sea level]; inf: no limit."""
        limits = self._parameters
        if not self.enabled:
            return math.inf
        above_home_m = limits.max_height_m - limits.margin_m
        return self._vehicle.home_and_rally.home_or_here.alt_amsl_m + above_home_m

    @property
    def kind(self) -> int:
        """FENCE_BREACH of the present breach."""
        return next(
            (kind for limits, kind in _FENCE_BREACHES if limits & self.breached),
            int(mavlink.FENCE_BREACH_NONE),
        )

    def find(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> frozenset[str]:
        """Return the limits that a position breaches, also while the fence is disabled."""
        height_m = alt_amsl_m - self._vehicle.home_and_rally.home_or_here.alt_amsl_m
        return frozenset(self._beyond_m(lat_deg, lon_deg, height_m))

    def refusal(self) -> str | None:
        """Return the fence's reason against arming at the present position; None: no reason."""
        found = self._beyond_here_m() if self.enabled else {}
        return f"Vehicle breaching {names_of(frozenset(found))}" if found else None

    def mode_changed_by_station(self, now: float) -> None:
        """In a breach, suspend actions for RECOVERY_S after a mode change by a ground station."""
        if self.breached:
            self._recovers_until_s = now + RECOVERY_S
            self._vehicle.announce("fence_recovery")

    def update(self, now: float) -> None:
        """Check the position; called about ten times a second while `active`."""
        vehicle = self._vehicle
        before = self.breached
        if not (self.enabled and self.has_limits):
            self.breached, self._floor_enforced = frozenset(), False
            self._next_breach_m.clear()
            return
        self._update_floor()
        found = self._beyond_here_m()
        self.breached = frozenset(found)
        if not found and not before:
            self._next_breach_m.clear()
            return
        new = frozenset(
            limit
            for limit, beyond_m in found.items()
            if beyond_m >= self._next_breach_m.get(limit, -math.inf)
        )
        self._next_breach_m = {
            limit: beyond_m + self._to_next_breach_m(limit) if limit in new else self._next_breach_m[limit]
            for limit, beyond_m in found.items()
        }
        if new:
            self._record({limit: found[limit] for limit in new}, before, now)
        elif before and not found and vehicle.flight.flying:
            vehicle.announce("fence_cleared")

    def _update_floor(self) -> None:
        """Enforce the minimum altitude after the vehicle has exceeded it by the margin, until the landing."""
        vehicle, limits = self._vehicle, self._parameters
        if vehicle.flight.landing_now or not vehicle.flight.flying:
            self._floor_enforced = False
        elif vehicle.home_and_rally.height_above_home_m >= limits.min_height_m + limits.margin_m:
            self._floor_enforced = True

    def _beyond_here_m(self) -> dict[str, float]:
        vehicle = self._vehicle
        return self._beyond_m(*vehicle.body.lat_lon_deg, vehicle.home_and_rally.height_above_home_m)

    def _beyond_m(self, lat_deg: float, lon_deg: float, height_m: float) -> dict[str, float]:
        """Return the distance of a position beyond each breached limit [m]."""
        vehicle, limits = self._vehicle, self._parameters
        beyond_m: dict[str, float] = {}
        if (above_m := height_m - limits.max_height_m) >= 0:
            beyond_m[ALTITUDE_MAX] = above_m
        if math.isfinite(limits.radius_m):
            away_m = distance_m(vehicle.home_and_rally.home_or_here.lat_lon_deg, (lat_deg, lon_deg))
            if away_m >= limits.radius_m:
                beyond_m[CIRCLE] = away_m - limits.radius_m
        if self._floor_enforced and height_m <= limits.min_height_m:
            beyond_m[ALTITUDE_MIN] = limits.min_height_m - height_m
        if limits.polygons and vehicle.fence.breaches(lat_deg, lon_deg):
            beyond_m[POLYGON] = 0.0
        if not beyond_m or not vehicle.personality.failsafes.fence_limits_latch:
            return beyond_m
        enforced = self._limits_at_enabling | {ALTITUDE_MIN}
        return {limit: distance for limit, distance in beyond_m.items() if limit in enforced}

    def _to_next_breach_m(self, limit: str) -> float:
        """Return the distance from a breach to the next action [m]; inf: no further action."""
        if limit == POLYGON:
            return math.inf
        return NEXT_BREACH_PLANE_M if limit == CIRCLE and self._vehicle.body.plane else NEXT_BREACH_M

    def _record(self, new: dict[str, float], before: frozenset[str], now: float) -> None:
        """Count, announce and act on new breaches; `new`: distance beyond each limit [m]."""
        vehicle = self._vehicle
        self.count += len(new)
        if not before:
            self.last_s = now
        if not vehicle.flight.flying or now < self._recovers_until_s:
            return
        vehicle.announce("fence_breached", names=names_of(frozenset(new)))
        for limit in sorted(new):
            vehicle.announce(f"fence_{limit}")
        action = self._parameters.action
        is_too_far = max(new.values()) > self._parameters.give_up_m
        acts = action not in (FailsafeAction.NOTHING, FailsafeAction.WARN)
        vehicle.failsafes.act(FailsafeAction.LAND if acts and is_too_far else action, now)
