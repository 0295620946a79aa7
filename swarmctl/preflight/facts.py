"""The facts of one vehicle that the checks read, and a check's finding. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import msgspec

from swarmctl.agent.traffic.separation.approach import Limits
from swarmctl.agent.traffic.separation.trajectory import Trajectory
from swarmctl.config.specs import Spec
from swarmctl.core.geo import LatLon, LocalFrame
from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.core.vehicle import VehicleState
from swarmctl.mavlink.events import Identity
from swarmctl.mavlink.telemetry.instruments import Instruments
from swarmctl.preflight.policy import RequiredParameter


class Answers(msgspec.Struct, frozen=True):
    """The answers of one vehicle; a missing answer has the default value."""

    instruments: Instruments = Instruments(None, None, None)
    parameters: Mapping[str, float] = {}
    """reported values, by name"""
    fence_items: tuple[MissionItem, ...] | None = None
    """items of the fence, read back"""
    fence_failure: str = ""
    """failure to make an ArduPilot enforce its fence, as text; empty if there is none"""
    rally_points: int | None = None
    """number of rally points on the vehicle"""
    failures: tuple[str, ...] = ()
    """reasons for missing answers, as texts"""


class OtherVehicle(msgspec.Struct, frozen=True):
    """Another vehicle of the swarm. A vehicle of another process has no identity and no trajectory here."""

    spec: Spec
    identity: Identity | None
    trajectory: Trajectory | None
    was_taken_over: bool = False
    """True for a vehicle in flight, or down again, that an earlier program launched"""


class PreflightFacts(msgspec.Struct, frozen=True):
    """The facts of one vehicle. None or an empty mapping: unknown."""

    spec: Spec
    """the configured vehicle"""
    identity: Identity | None
    sysid_conflict: str
    """another sender with the vehicle's system id, as text; empty if there is none"""
    state: VehicleState
    age_s: float
    """time since the last heartbeat"""
    position_age_s: float
    """time since the last position; infinite before the first"""
    status_age_s: float
    """time since the last SYS_STATUS (charge, readiness to arm); infinite before the first"""
    answers: Answers
    clock_offset_s: float | None
    """the vehicle's clock minus the reference clock"""
    clock_tolerance_s: float
    required_parameters: tuple[RequiredParameter, ...]
    no_table_because: str
    """reason why the required parameters are unknown; empty if they are known"""
    fly_sets: Mapping[str, float]
    """values that `swarmctl fly` sets before its checks, by name; empty in a run of `fly` itself"""
    may_set_parameters: bool
    """preflight.set_parameters"""
    fence: tuple[LatLon, ...]
    """configured corners"""
    ceiling_m: float
    """greatest allowed height above home"""
    plan: FlightPlan | None
    """first route, verified on the vehicle"""
    no_route_because: str
    """reason why the vehicle has no route, as text"""
    trajectory: Trajectory | None
    """positions over time on the first route; times count from the first launch"""
    endurance_s: float | None
    reserve_percent: float
    frame: LocalFrame
    """frame of metres east and north of the area's corner"""
    others: tuple[OtherVehicle, ...]
    limits: Limits
    """least distances from another vehicle"""


class Finding(msgspec.Struct, frozen=True):
    """The outcome of a check, for operators: the found value, the wanted value, and what to do."""

    ok: bool
    found: str
    wanted: str
    remedy: str = ""
    set_by_fly: bool = False
    """True if `swarmctl fly` removes the cause before arming"""

    @classmethod
    def remedied_by_fly(cls, found: str, wanted: str, facts: PreflightFacts) -> Finding:
        """Return a failure that ends with the parameters of `fly_sets`."""
        return cls(
            False, found, wanted, f"`fly` sets: {changes(facts.fly_sets, facts.answers.parameters)}", True
        )


def changes(new: Mapping[str, float], found: Mapping[str, float]) -> str:
    """Return changes of parameters as text."""
    return ", ".join(f"{name} {found[name]:g} → {value:g}" for name, value in new.items())


def without_route(facts: PreflightFacts, wanted: str) -> tuple[str, str, str]:
    """Return found, wanted and remedy of a check that needs a route, for a vehicle without a route."""
    found = "no verified route on the vehicle"
    if facts.no_route_because:
        return f"{found} ({facts.no_route_because})", wanted, "first remove the cause in parentheses"
    return found, wanted, "upload the mission"


MAX_AGE_S = 5.0
"""greatest age of a value that is sent every second; an older value counts as unknown"""


class Check(Protocol):
    """A module of `swarmctl.preflight.checks`."""

    NAME: str
    WAIVABLE: bool
    """True if an operator may waive a failure"""

    def check(self, facts: PreflightFacts) -> Finding: ...
