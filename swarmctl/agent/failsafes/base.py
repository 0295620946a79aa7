"""What a rule is: what it is told, what it may demand, and which of several demands wins."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Literal, Protocol

from swarmctl.core.geo import LatLon, LocalFrame
from swarmctl.core.section import Section
from swarmctl.core.vehicle import VehicleState


class DemandKind(StrEnum):
    """What a rule may demand, the weakest first."""

    WARN = "warn"
    """the operator is told, and nothing is done"""
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"
    LET_GO = "let_go"
    """nothing more is commanded: somebody else flies it"""


STRENGTH: dict[DemandKind, int] = {kind: rank for rank, kind in enumerate(DemandKind)}
"""The strongest demand is the one that is followed."""

Activity = Literal["ground", "launch", "mission", "goal", "hold", "return", "land"]
"""What an agent has its vehicle do; `goal`: it comes down over its goal, as its mission says."""

ACTIVITY_AS_DEMAND: dict[Activity, DemandKind] = {
    "mission": DemandKind.WARN,
    "hold": DemandKind.HOLD,
    "return": DemandKind.RETURN,
    "goal": DemandKind.LAND,
    "land": DemandKind.LAND,
}
"""What a vehicle in flight does already, as a demand: only a stronger one changes anything."""

IN_FLIGHT = frozenset(ACTIVITY_AS_DEMAND)


@dataclass(frozen=True, slots=True)
class Demand:
    """A demand."""

    kind: DemandKind
    why: str
    """for the operator: what was found, and what was expected"""
    urgent: bool = True
    """it waits for nobody; a return that is not holds until the way home is clear of others'"""


@dataclass(frozen=True, slots=True)
class ActiveRoute:
    """What a vehicle is to fly now."""

    plan_id: int
    points: tuple[LatLon, ...]
    """its waypoints and its landing spot, in order"""


@dataclass(frozen=True, slots=True)
class Fence:
    """What a vehicle has to stay inside of."""

    corners_m: tuple[tuple[float, float], ...]
    """(east, north) in the area's plane [m], in order"""
    ceiling_m: float
    """above home"""


@dataclass(frozen=True, slots=True)
class FailsafeFacts:
    """What rules go by."""

    vehicle: VehicleState
    frame: LocalFrame
    """a plane for lengths, in the area it flies in"""
    doing: Activity = "ground"
    ours: frozenset[str] = frozenset()
    """roles of the modes that its agent itself may have put it in"""
    orders: int = 0
    """how many its agent has given it"""
    lost: bool = False
    """nothing is heard of it: all else here is old"""
    way: ActiveRoute | None = None
    """None while its mission is being changed, or where it flies none"""
    fence: Fence | None = None
    turn_radius_m: float = 0.0
    """of what cannot stop; 0: it hovers"""

    @property
    def in_flight(self) -> bool:
        return self.doing in IN_FLIGHT

    @property
    def position_m(self) -> tuple[float, float] | None:
        """(east, north) in `frame` [m]."""
        vehicle = self.vehicle
        if vehicle.lat_deg is None or vehicle.lon_deg is None:
            return None
        return self.frame.to_local(vehicle.lat_deg, vehicle.lon_deg)


class Rule(Protocol):
    """A module. It keeps nothing: what it has to remember it returns, and is given again."""

    @property
    def NAME(self) -> str: ...  # noqa: N802

    @property
    def Params(self) -> type[Section]: ...  # noqa: N802

    def evaluate(
        self, params: Any, memory: Any, facts: FailsafeFacts, now: float, /
    ) -> tuple[Any, Demand | None]:
        """(memory, demand) at `now` [s]; `memory` is None the first time, and the demand None where all is
        well. A demand stands for as long as it is repeated."""


@dataclass(frozen=True, slots=True)
class ActiveRule:
    """A rule with its parameters."""

    rule: Rule
    params: Section


def holds_since(since_s: float | None, holds: bool, now: float) -> float | None:
    """Since when something holds without a break [s]; None where it does not."""
    if not holds:
        return None
    return now if since_s is None else since_s


def has_lasted(since_s: float | None, seconds: float, now: float) -> bool:
    """Whether what holds since `since_s` has held for `seconds`."""
    return since_s is not None and now - since_s >= seconds
