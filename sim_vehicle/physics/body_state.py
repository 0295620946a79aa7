"""The airframe and the battery of one vehicle, as its autopilot reads them."""

import math

from sim_vehicle.physics.motion import MotionOrder
from sim_vehicle.physics.world import World


class BodyState:
    """One vehicle's state in the world; positions are east, north, up above mean sea level [m]."""

    def __init__(self, world: World, index: int) -> None:
        self._world = world
        self._motion = world.dynamics
        self._index = index
        self.plane = bool(world.dynamics.planes[index])

    @property
    def position_m(self) -> tuple[float, float, float]:
        """Estimated east, north, up [m]."""
        east, north, up = self._motion.estimate_m[self._index].tolist()
        return east, north, up

    @property
    def velocity_m_s(self) -> tuple[float, float, float]:
        """Estimated east, north, up [m/s]."""
        east, north, up = self._motion.estimate_velocity_m_s[self._index].tolist()
        return east, north, up

    @property
    def lat_lon_deg(self) -> tuple[float, float]:
        lat_deg, lon_deg = self._world.estimated_geodetic()
        return float(lat_deg[self._index]), float(lon_deg[self._index])

    @property
    def alt_amsl_m(self) -> float:
        return float(self._motion.estimate[2, self._index])

    @property
    def ground_amsl_m(self) -> float:
        return float(self._motion.ground_m[self._index])

    @property
    def heading_rad(self) -> float:
        """Heading clockwise from north, in [0, 2 pi) [rad]."""
        return float(self._motion.attitude[2, self._index]) % (2 * math.pi)

    @property
    def attitude_rad(self) -> tuple[float, float, float]:
        """Roll, pitch and yaw [rad]."""
        roll, pitch, yaw = self._motion.attitude[:, self._index].tolist()
        return roll, pitch, yaw

    @property
    def airborne(self) -> bool:
        return bool(self._motion.airborne[self._index])

    @property
    def armed(self) -> bool:
        """True if the motors are armed."""
        return bool(self._motion.armed[self._index])

    @property
    def spools_up(self) -> bool:
        """True while a copter on the ground is ordered to fly, and does not lift off yet."""
        i, motion = self._index, self._motion
        is_ordered = self.armed and not self.airborne and motion.order[i] != MotionOrder.GROUNDED
        return bool(is_ordered and motion.armed_s[i] < motion.lift_off_s[i])

    @property
    def reached(self) -> bool:
        """True once the vehicle has reached the present target."""
        return bool(self._motion.reached[self._index])

    @property
    def crashed(self) -> bool:
        """True after a ground contact hard enough to break the airframe."""
        return bool(self._motion.crashed[self._index])

    @property
    def position_ok(self) -> bool:
        """True if the position estimate is good enough for navigation."""
        return bool(self._world.position_ok[self._index])

    @property
    def gps_fix(self) -> bool:
        return not bool(self._world.gps.lost[self._index])

    @property
    def target_m(self) -> tuple[float, float, float]:
        east, north, up = self._motion.target_m[self._index].tolist()
        return east, north, up

    @property
    def voltage_v(self) -> float:
        return float(self._world.batteries.voltage_v[self._index])

    @property
    def current_a(self) -> float:
        return float(self._world.batteries.current_a[self._index])

    @property
    def used_mah(self) -> float:
        return float(self._world.batteries.used_mah[self._index])

    @property
    def battery_remaining(self) -> float:
        """Remaining share of the charge, in [0, 1]."""
        return float(self._world.batteries.remaining[self._index])

    def take_touchdown_m_s(self) -> float:
        """Return the speed of a touchdown since the last call [m/s]; 0: no touchdown."""
        speed = float(self._motion.touchdown_m_s[self._index])
        self._motion.touchdown_m_s[self._index] = 0.0
        return speed

    def take_events(self) -> bool:
        """Return True if an event happened since the last call."""
        happened = bool(self._motion.has_event[self._index])
        self._motion.has_event[self._index] = False
        return happened

    def locate(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        """Return east and north [m] of a position [deg].

        The present position replaces a position outside the projection (the antipode).
        """
        east_m, north_m = self._world.frame.point_to_local(lat_deg, lon_deg)
        if not (math.isfinite(east_m) and math.isfinite(north_m)):
            east_m, north_m, _ = self.position_m
        return east_m, north_m

    def place_deg(self, east_m: float, north_m: float) -> tuple[float, float]:
        """Return latitude and longitude of a position [deg]."""
        return self._world.frame.point_to_geodetic(east_m, north_m)
