"""Access of the message builders to the fleet's columns."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.geodesy import Floats
from sim_vehicle.physics.world import World
from sim_vehicle.wire.status import Status

Ints = npt.NDArray[np.int64]
Columns = Mapping[str, Any]
UNKNOWN_U16 = 65_535
UNKNOWN_I16 = 32_767
UNKNOWN = -1


def vectors(x: str, y: str, z: str, values: Floats) -> Columns:
    """Return vectors (n, 3) as columns with three names."""
    return {x: values[:, 0], y: values[:, 1], z: values[:, 2]}


def north_east_down(north: str, east: str, down: str, east_north_up: Floats) -> Columns:
    """Return vectors east, north, up, (n, 3), as columns with three names for north, east and down."""
    return {north: east_north_up[:, 1], east: east_north_up[:, 0], down: -east_north_up[:, 2]}


@dataclass(slots=True)
class View:
    """The fleet's columns at one time, for a selection of vehicles."""

    world: World
    status: Status
    i: Ints  # indices of the selected vehicles
    now: float  # [s]

    def since_boot_s(self) -> Floats:
        """Return the time since each vehicle's boot by its own clock [s]."""
        status, i = self.status, self.i
        ahead_s = status.clock_offset_s[i] + (self.now - status.clock_since_s[i]) * status.clock_drift[i]
        return np.asarray(self.now - status.boot_s[i] + ahead_s, dtype=np.float64)

    def since_boot_ms(self) -> Floats:
        return self.since_boot_s() * 1000.0

    def since_boot_us(self) -> npt.NDArray[np.uint64]:
        return np.rint(self.since_boot_s() * 1e6).clip(0).astype(np.uint64)

    def e7(self) -> tuple[Ints, Ints]:
        """Return estimated latitude and longitude [1e-7 deg]; 0, 0 before the first fix."""
        lat_deg, lon_deg = self.world.estimated_geodetic()
        seen = self.status.gps_seen[self.i]
        lat = np.rint(np.where(seen, lat_deg[self.i], 0.0) * 1e7).astype(np.int64)
        return lat, np.rint(np.where(seen, lon_deg[self.i], 0.0) * 1e7).astype(np.int64)

    def is_px4(self) -> npt.NDArray[np.bool_]:
        return np.asarray(self.status.autopilot[self.i] == mavlink.MAV_AUTOPILOT_PX4)

    def heading_deg(self) -> Floats:
        return np.asarray(np.rad2deg(self.world.dynamics.attitude_rad[self.i, 2]) % 360.0)

    def height_m(self) -> Floats:
        """Return the height above home, or above the ground before home is set [m]."""
        status = self.status
        reference_m = np.where(
            status.has_home[self.i], status.home_amsl_m[self.i], self.world.dynamics.ground_m[self.i]
        )
        return np.asarray(self.world.estimate_m[self.i, 2] - reference_m)
