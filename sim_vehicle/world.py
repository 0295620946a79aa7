"""The physical side of the fleet: airframes, batteries and the map, and one vehicle's handle on them."""

import math

import numpy as np
import numpy.typing as npt

from sim_vehicle.battery import Batteries
from sim_vehicle.dynamics import Dynamics, Vertical
from sim_vehicle.geodesy import Floats, LocalFrame

EMPTY_BATTERY_SINK_M_S = 3.0


class World:
    """Arrays of all vehicles: lat_deg, lon_deg, alt_amsl_m are (n,) start positions."""

    def __init__(self, frame: LocalFrame, lat_deg: Floats, lon_deg: Floats, alt_amsl_m: Floats) -> None:
        self.frame = frame
        east_m, north_m = frame.to_local(lat_deg, lon_deg)
        self.dynamics = Dynamics(np.column_stack([east_m, north_m, alt_amsl_m]))
        self.batteries = Batteries(len(lat_deg))
        self.armed: npt.NDArray[np.bool_] = np.zeros(len(lat_deg), dtype=bool)
        self._geodetic: tuple[Floats, Floats] | None = None

    def step(self, dt_s: float) -> None:
        """Physics of one tick [s]."""
        dynamics = self.dynamics
        steered = (dynamics.vertical == Vertical.POSITION) | (dynamics.vertical == Vertical.RATE)
        exhausted = self.batteries.empty() & steered
        if exhausted.any():  # an empty battery cannot hold a copter up, whatever its autopilot wants
            dynamics.vertical[exhausted] = Vertical.RATE
            dynamics.rate_m_s[exhausted] = -EMPTY_BATTERY_SINK_M_S
        dynamics.step(dt_s)
        self.batteries.step(dt_s, self.armed, dynamics.airborne, dynamics.velocity_m_s)
        self._geodetic = None

    def geodetic(self) -> tuple[Floats, Floats]:
        """Latitude and longitude of all vehicles now, (n,), (n,) [deg]."""
        if self._geodetic is None:
            position = self.dynamics.position_m
            self._geodetic = self.frame.to_geodetic(position[:, 0], position[:, 1])
        return self._geodetic


class Body:
    """One vehicle's airframe and battery, as its autopilot sees and steers them."""

    def __init__(self, world: World, index: int) -> None:
        self._world = world
        self._dynamics = world.dynamics
        self._index = index

    # -- what the autopilot knows ------------------------------------------------------------------------

    @property
    def position_m(self) -> tuple[float, float, float]:
        """East, north, up (above mean sea level) [m]."""
        east, north, up = self._dynamics.position_m[self._index].tolist()
        return east, north, up

    @property
    def velocity_m_s(self) -> tuple[float, float, float]:
        """East, north, up [m/s]."""
        east, north, up = self._dynamics.velocity_m_s[self._index].tolist()
        return east, north, up

    @property
    def lat_lon_deg(self) -> tuple[float, float]:
        lat_deg, lon_deg = self._world.geodetic()
        return float(lat_deg[self._index]), float(lon_deg[self._index])

    @property
    def alt_amsl_m(self) -> float:
        return float(self._dynamics.position_m[self._index, 2])

    @property
    def ground_amsl_m(self) -> float:
        return float(self._dynamics.ground_m[self._index])

    @property
    def heading_rad(self) -> float:
        return float(self._dynamics.heading_rad[self._index])

    @property
    def airborne(self) -> bool:
        return bool(self._dynamics.airborne[self._index])

    @property
    def reached(self) -> bool:
        """Whether the present target has been reached since it was given."""
        return bool(self._dynamics.reached[self._index])

    @property
    def target_m(self) -> tuple[float, float, float]:
        east, north, up = self._dynamics.target_m[self._index].tolist()
        return east, north, up

    @property
    def horizontal_acceleration_m_s2(self) -> tuple[float, float]:
        east, north = self._dynamics.acceleration_m_s2[self._index].tolist()
        return east, north

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
        """Share left, in [0, 1]."""
        return float(self._world.batteries.remaining[self._index])

    def take_touchdown_m_s(self) -> float:
        """Speed of a ground contact since the last call, 0 if there was none."""
        speed = float(self._dynamics.touchdown_m_s[self._index])
        self._dynamics.touchdown_m_s[self._index] = 0.0
        return speed

    def locate(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        """East and north [m] of a place [deg]; where we are, if the map does not reach it (the antipode)."""
        east_m, north_m = self._world.frame.point_to_local(lat_deg, lon_deg)
        if not (math.isfinite(east_m) and math.isfinite(north_m)):
            east_m, north_m, _ = self.position_m
        return east_m, north_m

    # -- what it orders ----------------------------------------------------------------------------------

    def arm(self, armed: bool) -> None:
        """Start or stop the motors; stopped in the air, the vehicle falls."""
        self._world.armed[self._index] = armed
        if not armed:
            self._dynamics.vertical[self._index] = Vertical.FALL if self.airborne else Vertical.GROUNDED

    def rest(self) -> None:
        """Idle on the ground."""
        self._dynamics.vertical[self._index] = Vertical.GROUNDED

    def fly_to(self, east_m: float, north_m: float, up_m: float, pass_speed_m_s: float = 0.0) -> None:
        """Fly the straight leg from the target flown until now (if that was reached) or from here."""
        i, dynamics = self._index, self._dynamics
        continues = bool(dynamics.reached[i]) and dynamics.vertical[i] == Vertical.POSITION
        dynamics.leg_start_m[i] = dynamics.target_m[i, :2] if continues else dynamics.position_m[i, :2]
        dynamics.target_m[i] = (east_m, north_m, up_m)
        dynamics.pass_speed_m_s[i] = pass_speed_m_s
        dynamics.reached[i] = False
        dynamics.vertical[i] = Vertical.POSITION

    def stop(self) -> None:
        """Brake and hold the place and altitude where that ends."""
        i, dynamics = self._index, self._dynamics
        velocity = dynamics.velocity_m_s[i]
        speed = math.hypot(velocity[0], velocity[1])
        braking_s = speed / (2 * dynamics.acceleration_limit_m_s2[i])
        climb_s = abs(velocity[2]) / (2 * dynamics.vertical_acceleration_limit_m_s2[i])
        east, north = dynamics.position_m[i, :2] + velocity[:2] * braking_s
        self.fly_to(float(east), float(north), float(dynamics.position_m[i, 2] + velocity[2] * climb_s))

    def move_vertically(self, rate_m_s: float) -> None:
        """Climb (positive) or sink at a rate over the target's place."""
        self._dynamics.vertical[self._index] = Vertical.RATE
        self._dynamics.rate_m_s[self._index] = rate_m_s

    def limit(
        self,
        *,
        speed_m_s: float | None = None,
        climb_m_s: float | None = None,
        descent_m_s: float | None = None,
        acceleration_m_s2: float | None = None,
        vertical_acceleration_m_s2: float | None = None,
        radius_m: float | None = None,
    ) -> None:
        """Set the limits that are given."""
        i, dynamics = self._index, self._dynamics
        for array, value in (
            (dynamics.speed_m_s, speed_m_s),
            (dynamics.climb_m_s, climb_m_s),
            (dynamics.descent_m_s, descent_m_s),
            (dynamics.acceleration_limit_m_s2, acceleration_m_s2),
            (dynamics.vertical_acceleration_limit_m_s2, vertical_acceleration_m_s2),
            (dynamics.radius_m, radius_m),
        ):
            if value is not None:
                array[i] = value

    def corner_speed_m_s(self, turn_rad: float) -> float:
        """Speed at which a corner can be flown within the waypoint radius under the acceleration limit."""
        i, dynamics = self._index, self._dynamics
        speed = float(dynamics.speed_m_s[i])
        widening = 1.0 / max(math.cos(min(turn_rad, math.pi - 1e-6) / 2), 1e-6) - 1.0
        if widening < 1e-6:
            return speed
        turn_radius_m = float(dynamics.radius_m[i]) / widening
        return min(speed, math.sqrt(float(dynamics.acceleration_limit_m_s2[i]) * turn_radius_m))

    def set_battery(self, *, capacity_mah: float, full_v: float) -> None:
        self._world.batteries.capacity_mah[self._index] = capacity_mah
        self._world.batteries.full_v[self._index] = full_v
