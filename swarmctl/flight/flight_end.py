"""The condition for the end of a flight."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from swarmctl.flight.own_vehicle import OwnVehicle
from swarmctl.report.final_state import has_ended_disarmed, height_text


class FlightEnd:
    """The condition for the end of a flight, with messages about lost and released vehicles."""

    def __init__(
        self, vehicles: Sequence[OwnVehicle], lost_timeout_s: float, say: Callable[[str], None]
    ) -> None:
        self._vehicles = vehicles
        self._lost_timeout_s = lost_timeout_s
        self._say = say
        self._given_up: set[str] = set()
        self._waits_for: list[str] = []

    def reached(self) -> bool:
        """Return whether every vehicle has ended its flight and is disarmed, or is given up.

        A released vehicle in the air delays the end: its failsafe needs the heartbeats of this station, and
        its pilot may use the forwarded link.
        """
        unfinished: list[str] = []
        released: list[str] = []
        for vehicle in self._vehicles:
            if has_ended_disarmed(vehicle.state):
                continue
            if vehicle.silent_for(self._lost_timeout_s):
                self._give_up(vehicle)
                continue
            self._given_up.discard(vehicle.name)
            (released if vehicle.state.ended else unfinished).append(vehicle.name)
        if not unfinished and released and released != self._waits_for:
            self._waits_for = released
            self._say(
                f"{', '.join(released)}: flown by a pilot or another station; the program sends heartbeats "
                "and records, but gives no orders, until the landing and disarming; Ctrl-C ends the wait "
                "[waiting-for-released]"
            )
        return not unfinished and not released

    def _give_up(self, vehicle: OwnVehicle) -> None:
        if vehicle.name in self._given_up:
            return
        self._given_up.add(vehicle.name)
        state = vehicle.runner.link.state()
        self._say(
            f"{vehicle.name}: no telemetry for {self._lost_timeout_s:g} s (flight.lost_timeout_s); last in "
            f"mode {state.mode or '?'}, {height_text(state)}; the program no longer waits for the "
            "vehicle, which may still be in the air; look for the vehicle with another ground station "
            "[given-up]"
        )
