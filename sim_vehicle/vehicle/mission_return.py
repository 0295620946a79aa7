"""A return that ends as the mission says: its items are flown in the mode that returns."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.vehicle.manoeuvres import Landing, Manoeuvre
from sim_vehicle.vehicle.mission import LANDINGS, Item
from sim_vehicle.vehicle.mission_pilot import circle_to_altitude, target_of

if TYPE_CHECKING:
    from sim_vehicle.vehicle.flight import Flight


class ReturnByMission:
    """Climb where it is, if it is below an altitude; then fly items one after another, and land by the last.

    Each has a place; they are flown to without a stop, but for circles in which a plane changes its altitude.
    """

    def __init__(self, flight: "Flight", items: Sequence[Item], least_amsl_m: float) -> None:
        self._flight = flight
        self._left = list(items)
        self._machine: Manoeuvre | None = None
        if flight.body.alt_amsl_m < least_amsl_m:
            east_m, north_m, _ = flight.body.position_m
            flight.body.loiter(east_m, north_m, least_amsl_m)
        else:
            self._go_on()

    @property
    def lands(self) -> bool:
        """It comes down already."""
        return isinstance(self._machine, Landing)

    def _go_on(self) -> None:
        flight, item = self._flight, self._left.pop(0)
        if item.command in LANDINGS:
            self._machine = Landing(flight, item.place_deg)
        elif item.command == mavlink.MAV_CMD_NAV_LOITER_TO_ALT:
            self._machine = circle_to_altitude(flight, item, self._left[0] if self._left else None)
        else:
            self._machine = None
            flight.body.fly_to(*target_of(flight, item), flight.tuning.speed_m_s)

    def update(self, now: float) -> bool:
        done = self._flight.body.reached if self._machine is None else self._machine.update(now)
        if not done or self.lands or not self._left:
            return done
        self._go_on()
        return False
