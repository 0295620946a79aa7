"""Home, the origin of local coordinates, and rally points of one vehicle."""

import math
from collections.abc import Sequence

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.geodesy import GeodeticPosition, distance_m
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.mission import Item


class Rally:
    """The stored rally points of one vehicle, as mission items."""

    def __init__(self) -> None:
        self.items: tuple[Item, ...] = ()

    def replace(self, items: Sequence[Item]) -> None:
        self.items = tuple(items)

    def nearest(
        self,
        here_deg: tuple[float, float],
        home_deg: tuple[float, float],
        *,
        limit_m: float = math.inf,
        include_home: bool = True,
    ) -> Item | None:
        """Return the nearest rally point closer than `limit_m`, or None for home.

        include_home: only points closer than home count.
        """
        if include_home:
            limit_m = min(limit_m, distance_m(here_deg, home_deg))
        distances_m = [distance_m(here_deg, (item.x * 1e-7, item.y * 1e-7)) for item in self.items]
        nearest_m = min(distances_m, default=math.inf)
        return self.items[distances_m.index(nearest_m)] if nearest_m < limit_m else None


class HomeAndRally:
    """Home, origin and rally points; a reboot forgets home and origin."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self.rally = Rally()
        self.reset()

    def reset(self) -> None:
        """Forget home and origin, as a reboot does."""
        self.home: GeodeticPosition | None = None
        self.home_locked = False  # home was set by a ground station or a mission; arming does not move home
        self.origin: GeodeticPosition | None = None
        self.origin_m = (0.0, 0.0, 0.0)  # east, north, up in the fleet's frame

    def update(self, now: float) -> None:
        """Set the origin and home as soon as `Readiness` (and, if required, the position) permits."""
        vehicle = self._vehicle
        if self.origin is None and vehicle.readiness.home_ready(now):
            self.set_origin(vehicle.here(), now)
        needs_position = vehicle.personality.home.with_position
        ready = vehicle.position_known(now) if needs_position else vehicle.readiness.home_ready(now)
        if self.home is None and ready:
            self.set_home(vehicle.here(), now)

    def set_origin(self, place: GeodeticPosition, now: float) -> None:
        """Set and report the origin of local coordinates."""
        vehicle = self._vehicle
        self.origin = place
        self.origin_m = (*vehicle.body.locate(*place.lat_lon_deg), place.alt_amsl_m)
        vehicle.announce("origin_set")
        vehicle.send_now(mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, now)

    def set_home(self, place: GeodeticPosition, now: float, *, locked: bool = False) -> None:
        self.home, self.home_locked = place, self.home_locked or locked
        self._vehicle.send_now(mavlink.MAVLINK_MSG_ID_HOME_POSITION, now)

    @property
    def home_or_here(self) -> GeodeticPosition:
        """Home, or the present position while home is not set."""
        return self.home or self._vehicle.here()

    @property
    def height_above_home_m(self) -> float:
        body = self._vehicle.body
        return body.alt_amsl_m - (self.home.alt_amsl_m if self.home else body.ground_amsl_m)

    def home_item(self) -> Item:
        """Return home as item 0 of a mission; zeros while home is not set."""
        home = self.home or GeodeticPosition(0.0, 0.0, 0.0)
        return Item(
            mavlink.MAV_CMD_NAV_WAYPOINT,
            x=round(home.lat_deg * 1e7),
            y=round(home.lon_deg * 1e7),
            z=round(home.alt_amsl_m, 2),
        )

    def return_place(self) -> GeodeticPosition:
        """Return the nearest rally point within the limit, or home."""
        vehicle, home = self._vehicle, self.home_or_here
        parameters = vehicle.flight_parameters.rally
        point = self.rally.nearest(
            vehicle.body.lat_lon_deg,
            home.lat_lon_deg,
            limit_m=parameters.limit_m,
            include_home=parameters.includes_home,
        )
        if point is None or point.place_deg is None:
            return home
        return GeodeticPosition(*point.place_deg, vehicle.flight.altitude_amsl_m(point.frame, point.z))
