"""What a check is told of one vehicle, and what it answers. Frozen, pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from swarmctl.agent.traffic.separation.approach import Limits
from swarmctl.agent.traffic.separation.trajectory import Trajectory
from swarmctl.core.geo import LatLon, LocalFrame
from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.core.vehicle import Airframe, VehicleState
from swarmctl.mavlink.events import Identity
from swarmctl.mavlink.telemetry.instruments import Instruments
from swarmctl.preflight.policy import RequiredParameter


@dataclass(frozen=True, slots=True)
class OtherVehicle:
    """Another vehicle of the swarm; what is flown by another process is not known here."""

    name: str
    sysid: int
    altitude_m: float
    identity: Identity | None
    flight: Trajectory | None
    airframe: Airframe = "copter"


@dataclass(frozen=True, slots=True)
class PreflightFacts:
    """None, and empty mappings: it has not told, or could not be asked."""

    name: str
    sysid: int
    """as configured"""
    identity: Identity | None
    conflict: str
    """another sender uses its system id: where"""
    state: VehicleState
    age_s: float
    """since its last heartbeat"""
    position_age_s: float
    """since it told where it is last; infinite where it never has"""
    status_age_s: float
    """since its last SYS_STATUS: charge, and whether it would arm; infinite where none was heard"""
    instruments: Instruments | None
    clock_offset_s: float | None
    """its clock before or behind the one it is to be in step with"""
    clock_tolerance_s: float
    wanted: tuple[RequiredParameter, ...]
    no_table: str
    """why nobody knows what is wanted of its parameters"""
    parameters: Mapping[str, float]
    fence: tuple[LatLon, ...]
    """wanted"""
    fence_items: tuple[MissionItem, ...] | None
    """found"""
    fence_failure: str
    """why an ArduPilot whose parameters name the limits as declared may not keep to them; empty: it does"""
    rally_points: int | None
    """so many"""
    ceiling_m: float
    plan: FlightPlan | None
    """its first route, verified on the vehicle"""
    no_route: str
    """what kept it from getting one, in words"""
    flight: Trajectory | None
    """where it is at what time on that route, from the launch of the first vehicle"""
    altitude_m: float
    speed_m_s: float
    endurance_s: float | None
    reserve_percent: float
    frame: LocalFrame
    """metres east and north of the area's corner"""
    others: tuple[OtherVehicle, ...]
    limits: Limits
    """closer than which to another it is not to fly"""
    airframe: Airframe = "copter"
    """as configured"""


@dataclass(frozen=True, slots=True)
class Finding:
    """For people: what was found, what is wanted, and what to do where that differs."""

    ok: bool
    found: str
    wanted: str
    cure: str = ""


def no_route(facts: PreflightFacts, wanted: str) -> tuple[str, str, str]:
    """Found, wanted and cure of a check that needs the first route, where there is none."""
    found = "no verified route is on it"
    if facts.no_route:
        return f"{found}: {facts.no_route}", wanted, "mend that first"
    return found, wanted, "upload its mission"


MAX_AGE_S = 5.0
"""What is told every second and was told longer ago is not known."""


class Check(Protocol):
    """A module of `swarmctl.preflight.checks`."""

    NAME: str
    WAIVABLE: bool
    """whether an operator may take it upon himself that it fails"""

    def check(self, facts: PreflightFacts) -> Finding: ...
