"""Data on another vehicle: its last state, and its known flight. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec

from swarmctl.agent.traffic.separation.approach import Limits
from swarmctl.agent.traffic.separation.trajectory import Bounds, LocalPoint, Trajectory
from swarmctl.core.frames import StateShared
from swarmctl.core.records import replace

MAX_REPORT_AGE_S = 5.0
"""Greatest age of a state from which another vehicle's position is predicted [s]."""


class NeighbourReport(msgspec.Struct, frozen=True):
    """Last state received from another vehicle."""

    state: StateShared
    at_s: float
    """time of the state by the clock of the receiving vehicle [s]"""
    position_m: LocalPoint
    """reported position in the local frame of the area, height above the sea [m]"""

    def is_recent(self, now_s: float) -> bool:
        """Return whether a position can still be predicted from this state."""
        return 0.0 <= now_s - self.at_s <= MAX_REPORT_AGE_S

    def hears(self, uav: int) -> bool:
        """Return whether the other vehicle acknowledges receiving the states of `uav`."""
        return uav in self.state.hears


class KnownFlight(msgspec.Struct, frozen=True):
    """Present or next flight of another vehicle, as its intent announces it, or as predicted."""

    flight: Trajectory
    """times of the receiver's vehicle clock, local frame of the area, heights above the sea"""
    bounds: Bounds
    """bounds of the flight, with its uncertainty"""
    may_change: bool
    """True if the vehicle can change its plan"""
    sent_s: float
    """time of the intent, or start of a predicted flight [s]"""
    uncertainty_m: tuple[float, float] = (0.0, 0.0)
    """uncertainty of the flight, horizontal and vertical [m]"""
    on_ground: bool = False
    """True if the vehicle is about to take off"""
    landing: Trajectory | None = None
    """the flight with its landing; None if `flight` is the whole flight"""
    may_be_late: bool = False
    """True if the vehicle may have stopped anywhere on its flight, and may go on at any time"""
    straight: Trajectory | None = None
    """flight straight on for some seconds, if the vehicle is off its intent; else None"""

    @classmethod
    def predicted(cls, flight: Trajectory) -> KnownFlight:
        """Return a flight that its vehicle keeps to, as far as known."""
        return cls(flight, Bounds.of(flight), may_change=False, sent_s=flight.times_s[0])

    def and_straight_on(self, straight: Trajectory) -> KnownFlight:
        """Return the flight of a vehicle off its intent, which may also fly straight on."""
        return replace(self, straight=straight, bounds=self.bounds.joined(Bounds.of(straight)))

    def straight_on(self) -> KnownFlight:
        """Return the flight straight on alone."""
        assert self.straight is not None
        return replace(
            self,
            flight=self.straight,
            straight=None,
            landing=None,
            uncertainty_m=(0.0, 0.0),
            may_be_late=False,
        )

    def of_silent_vehicle(self, heard_s: float, until_s: float) -> KnownFlight | None:
        """Return the flight of a vehicle that is not heard any more since `heard_s`, for a time `until_s`.

        The vehicle flies and lands as announced, or stops on the way. The result is None if it has landed.
        """
        flight = self.landing or self.flight
        if flight.ends_in_hold:
            flight = flight.lasting(max(until_s, flight.times_s[-1]))
        ahead, (away_m, up_m) = flight.since(heard_s), self.uncertainty_m
        if ahead is None or len(ahead.times_s) < 2:
            return None
        bounds = Bounds.of(ahead).wider((math.inf, away_m, away_m, up_m))
        return replace(self, flight=ahead, bounds=bounds, may_change=False, landing=None, may_be_late=True)

    def may_meet(self, box: Bounds) -> bool:
        """Return whether the flight as announced may come into a box: a quick test."""
        return box.meets(self.bounds) and (any(self.uncertainty_m) or self.flight.may_meet(box))

    def limits(self, limits: Limits) -> Limits:
        """Return `limits` enlarged by the uncertainty of the flight."""
        horizontal_m, vertical_m = self.uncertainty_m
        return Limits(limits.horizontal_m + horizontal_m, limits.vertical_m + vertical_m)


Others = Mapping[int, KnownFlight]
"""flights of other vehicles by system id"""
