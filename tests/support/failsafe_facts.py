"""Facts for failsafe rules: a vehicle without a fault, unless a test changes a fact."""

from __future__ import annotations

from typing import Any

from swarmctl.agent.failsafes.base import Demand, FailsafeFacts, Rule
from swarmctl.core.geo import LocalFrame
from swarmctl.core.mission import FlightPlan, Waypoint
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.records import replace
from swarmctl.core.vehicle import Landed, VehicleState

FRAME = LocalFrame(46.0, 14.4)


def at(east_m: float, north_m: float, **changes: Any) -> VehicleState:
    """Return a copter that flies its mission, at this offset from the frame's origin."""
    lat_deg, lon_deg = FRAME.to_geodetic(east_m, north_m)
    flies = VehicleState(
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        alt_rel_m=30.0,
        alt_amsl_m=330.0,
        ground_speed_m_s=10.0,
        mode="AUTO",
        mode_role="mission",
        armed=True,
        landed=Landed.IN_AIR,
        battery_percent=90,
    )
    return replace(flies, **changes)


def route_over(plan_id: int, *points_m: tuple[float, float]) -> PlannedMission:
    """Return a plan over these points (east, north) [m]."""
    *track, landing = (Waypoint(*FRAME.to_geodetic(*point), 30.0) for point in points_m)
    return PlannedMission(plan_id, FlightPlan(30.0, tuple(track), landing), (), (), 0.0, 0.0, 1.0, 0.0)


def facts(vehicle: VehicleState | None = None, **changes: Any) -> FailsafeFacts:
    """Return the facts of a vehicle that flies its mission to the east, along the frame's axis."""
    known = FailsafeFacts(
        vehicle or at(0.0, 0.0),
        FRAME,
        activity="mission",
        own_roles=frozenset({"mission"}),
        mission=route_over(1, (100.0, 0.0), (1000.0, 0.0)),
    )
    return replace(known, **changes)


class RuleRunner:
    """A rule with its memory, evaluated on one set of facts after the other."""

    def __init__(self, rule: Rule, **params: Any) -> None:
        self._rule, self._params = rule, rule.Params(**params)
        self._memory: Any = None

    def __call__(self, now: float, known: FailsafeFacts, **stamps: Any) -> Demand | None:
        """Return the rule's demand on facts received at `now`, or at the times in `stamps`."""
        young = {"heartbeat_s": now, "status_s": now, "position_s": now, **stamps}
        known = replace(known, vehicle=replace(known.vehicle, **young))
        self._memory, demand = self._rule.evaluate(self._params, self._memory, known, now)
        return demand
