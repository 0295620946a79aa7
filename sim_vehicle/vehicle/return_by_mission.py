"""Return by the items of the mission, to its landing."""

from collections.abc import Sequence

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.vehicle.interface import FlightControl
from sim_vehicle.vehicle.manoeuvres import Landing, Manoeuvre
from sim_vehicle.vehicle.mission import LANDINGS, Item
from sim_vehicle.vehicle.mission_pilot import circle_to_altitude, target_of


class ReturnByMission:
    """Return by mission: a climb in place to `minimum_amsl_m`, then the items; the last item lands.

    Every item has a position. The vehicle does not stop at items; a plane can circle to change its altitude.
    """

    def __init__(self, flight: FlightControl, items: Sequence[Item], minimum_amsl_m: float) -> None:
        self._flight = flight
        self._remaining_items = list(items)
        self._manoeuvre: Manoeuvre | None = None
        if flight.body.alt_amsl_m < minimum_amsl_m:
            east_m, north_m, _ = flight.body.position_m
            flight.body.loiter(east_m, north_m, minimum_amsl_m)
        else:
            self._begin_next()

    @property
    def landing(self) -> bool:
        return isinstance(self._manoeuvre, Landing)

    def _begin_next(self) -> None:
        flight, item = self._flight, self._remaining_items.pop(0)
        if item.command in LANDINGS:
            self._manoeuvre = Landing(flight, item.place_deg)
        elif item.command == mavlink.MAV_CMD_NAV_LOITER_TO_ALT:
            following = self._remaining_items[0] if self._remaining_items else None
            self._manoeuvre = circle_to_altitude(flight, item, following)
        else:
            self._manoeuvre = None
            flight.body.fly_to(*target_of(flight, item), flight.flight_parameters.limits.speed_m_s)

    def update(self, now: float) -> bool:
        done = self._flight.body.reached if self._manoeuvre is None else self._manoeuvre.update(now)
        if not done or self.landing or not self._remaining_items:
            return done
        self._begin_next()
        return False
