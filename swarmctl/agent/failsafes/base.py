"""Interface of a failsafe rule: input, demands, and the order of strength of the demands."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum
from typing import Any, Literal, Protocol

import msgspec

from swarmctl.core.geo import LocalFrame
from swarmctl.core.planar import PlanarPoint
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.section import Section
from swarmctl.core.vehicle import VehicleState


class DemandKind(StrEnum):
    """Kinds of demands, the weakest first."""

    WARN = "warn"
    """only a message to the operator"""
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"
    RELEASE = "release"
    """release to another operator; the agent sends no further commands"""


STRENGTH: dict[DemandKind, int] = {kind: rank for rank, kind in enumerate(DemandKind)}
"""Rank of each demand; the agent follows the strongest."""

FlightActivity = Literal["ground", "launch", "mission", "goal", "hold", "return", "land"]
"""Current activity of a vehicle; `goal`: landing at its goal by its mission."""

ACTIVITY_AS_DEMAND: dict[FlightActivity, DemandKind] = {
    "mission": DemandKind.WARN,
    "hold": DemandKind.HOLD,
    "return": DemandKind.RETURN,
    "goal": DemandKind.LAND,
    "land": DemandKind.LAND,
}
"""Demand that each activity in flight already fulfils; only a stronger demand changes the activity."""


class Demand(msgspec.Struct, frozen=True):
    kind: DemandKind
    reason: str
    """text for the operator: found and expected values"""
    urgent: bool = True
    """False: before a return, the vehicle holds until its return path is clear; True: it reacts at once"""


class Fence(msgspec.Struct, frozen=True):
    corners_m: tuple[tuple[float, float], ...]
    """(east, north) in the area's local frame [m], in order"""
    ceiling_m: float
    """greatest height above home [m]"""


class FailsafeFacts(msgspec.Struct, frozen=True):
    """Input of the rules."""

    vehicle: VehicleState
    frame: LocalFrame
    """local frame of the area, for lengths"""
    activity: FlightActivity = "ground"
    own_roles: frozenset[str] = frozenset()
    """roles of the modes that the agent may have set"""
    orders_given: int = 0
    """number of orders given by the agent"""
    lost: bool = False
    """True while the link is lost; `vehicle` is old then"""
    telemetry_is_late: bool = False
    """True while telemetry is too old to show another operator's action"""
    mission: PlannedMission | None = None
    """the mission that the vehicle has to fly now; None during a mission change, or if there is none"""
    fence: Fence | None = None
    turn_radius_m: float = 0.0
    """turn radius of a fixed wing; 0: a copter"""

    @property
    def in_flight(self) -> bool:
        return self.activity in ACTIVITY_AS_DEMAND

    @property
    def position_m(self) -> tuple[float, float] | None:
        """(east, north) in `frame` [m]; None if unknown."""
        lat_lon = self.vehicle.lat_lon
        return None if lat_lon is None else self.frame.to_local(*lat_lon)

    def track_m(self) -> tuple[PlanarPoint, ...]:
        """Return the waypoints and the landing spot of `mission` in `frame` [m]; empty without one."""
        if self.mission is None:
            return ()
        points = (*self.mission.plan.waypoints, self.mission.plan.landing)
        return tuple(self.frame.to_local(point.lat_deg, point.lon_deg) for point in points)


class Rule(Protocol):
    """A module without state: each call of `evaluate` receives the memory that the previous call returned."""

    @property
    def NAME(self) -> str: ...  # noqa: N802

    @property
    def Params(self) -> type[Section]: ...  # noqa: N802

    def evaluate(
        self, params: Any, memory: Any, facts: FailsafeFacts, now: float, /
    ) -> tuple[Any, Demand | None]:
        """Return (memory, demand) at `now` [s]; the demand is None if nothing is to be done.

        `memory` is None at first. A demand lasts while each evaluation repeats the demand.
        """


class OptionalRule(Rule, Protocol):
    """A rule that a configuration sets by its name, or turns off."""

    @property
    def DESCRIPTION(self) -> str:  # noqa: N802
        """One sentence for the configuration reference."""


class ActiveRule(msgspec.Struct, frozen=True):
    rule: Rule
    params: Section


def is_urgent(demands: Iterable[Demand | None]) -> bool:
    """Return whether an urgent demand is for a return, a landing or a release."""
    urgent = (demand for demand in demands if demand is not None and demand.urgent)
    return any(STRENGTH[demand.kind] >= STRENGTH[DemandKind.RETURN] for demand in urgent)


def urgent_reason(demands: Iterable[Demand | None], kind: DemandKind = DemandKind.RETURN) -> str:
    """Return the reason of the first urgent demand of a kind; "" if there is none."""
    urgent = (d.reason for d in demands if d is not None and d.kind is kind and d.urgent)
    return next(urgent, "")


def true_since(since_s: float | None, is_true: bool, now: float) -> float | None:
    """Return the time since which a condition is true without a break [s]; None if it is false."""
    if not is_true:
        return None
    return now if since_s is None else since_s


def has_lasted(since_s: float | None, seconds: float, now: float) -> bool:
    """Return whether a condition has lasted for `seconds` since `since_s`."""
    return since_s is not None and now - since_s >= seconds
