"""Positions of this vehicle, and predicted trajectories of its neighbours. Pure.

Points are in the area's local frame [m]. Heights are above the sea, except where a docstring says above home.
"""

from __future__ import annotations

import math

from swarmctl.agent.phases import ENDED, Phase
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.separation.other_vehicles import NeighbourReport
from swarmctl.agent.traffic.separation.trajectory import Bounds, LocalPoint, Trajectory, extrapolate
from swarmctl.core.frames import StateShared

HEARD_S = 3.0
"""Time without a state of any vehicle nearby after which a vehicle hears no other vehicle any more [s]."""
MAX_AGE_S = 90.0
"""Greatest age of a state or an intent in use [s]: others keep clear of a silent vehicle's last one."""
AIRBORNE_M = 1.0
"""Height above home below which a vehicle counts as on the ground [m]."""


def position_of(state: AgentState) -> LocalPoint | None:
    """Return this vehicle's position, height above home; None if the last telemetry has none."""
    vehicle = state.vehicle
    if vehicle.lat_lon is None or vehicle.alt_rel_m is None:
        return None
    return (*state.task.grid.frame.to_local(*vehicle.lat_lon), vehicle.alt_rel_m)


def position_amsl(state: AgentState) -> LocalPoint | None:
    """Return this vehicle's position; None if the last telemetry has none."""
    vehicle = state.vehicle
    if vehicle.lat_lon is None or vehicle.alt_amsl_m is None:
        return None
    return (*state.task.grid.frame.to_local(*vehicle.lat_lon), vehicle.alt_amsl_m)


def home_amsl_m(state: AgentState) -> float:
    """Return the height of this vehicle's home above the sea; 0 without a position."""
    vehicle = state.vehicle
    return (vehicle.alt_amsl_m or 0.0) - (vehicle.alt_rel_m or 0.0)


def predict(state: AgentState, report: NeighbourReport) -> Trajectory | None:
    """Return another vehicle's extrapolated trajectory; None on the ground, or if the state is too old."""
    reported, now_s = report.state, state.vehicle.time_boot_s
    if not report.is_recent(now_s) or reported.alt_rel_m < AIRBORNE_M:
        return None
    for_s = now_s - report.at_s + state.task.separation.look_ahead_s
    return extrapolate(report.position_m, reported.velocity_m_s, report.at_s, for_s)


def predictions(state: AgentState, within: Bounds) -> dict[int, Trajectory]:
    """Return the extrapolated trajectories of the neighbours that come within bounds."""
    (_, west_m, south_m, low_m), (_, east_m, north_m, high_m) = within.least, within.most
    until_s = state.vehicle.time_boot_s + state.task.separation.look_ahead_s
    found = {}
    for uav, report in state.neighbours.items():
        # Most neighbours are at other heights or far away, and need no trajectory.
        lasts_s, (at_east_m, at_north_m, up_m) = until_s - report.at_s, report.position_m
        east_m_s, north_m_s, up_m_s = report.state.velocity_m_s
        to_up_m = up_m + up_m_s * lasts_s
        if (up_m > high_m and to_up_m > high_m) or (up_m < low_m and to_up_m < low_m):
            continue
        if (
            _passes(at_east_m, east_m_s * lasts_s, west_m, east_m)
            and _passes(at_north_m, north_m_s * lasts_s, south_m, north_m)
            and (path := predict(state, report))
        ):
            found[uav] = path
    return found


def _passes(begin_m: float, way_m: float, low_m: float, high_m: float) -> bool:
    """Return whether a movement along one axis comes between two positions."""
    if way_m > 0.0:
        return begin_m <= high_m and begin_m + way_m >= low_m
    return begin_m >= low_m and begin_m + way_m <= high_m


def hears_nobody(state: AgentState) -> bool:
    """Return whether the vehicle hears none of the vehicles nearby any more: they do not hear it either.

    The others keep clear of its flight as announced, so this vehicle does not deviate from it to give way.
    """
    if state.phase is Phase.FORMATION:  # the members of its group are no neighbours
        return False
    now_s = state.vehicle.time_boot_s
    ages_s = [now_s - report.at_s for report in state.neighbours.values() if not _is_down(report.state)]
    return bool(ages_s) and HEARD_S < min(ages_s) <= MAX_AGE_S


def _is_down(reported: StateShared) -> bool:
    lands = reported.phase in (Phase.LANDING, Phase.LEAVING)
    return reported.phase in ENDED or (lands and reported.alt_rel_m < AIRBORNE_M)


def acknowledged_s(state: AgentState) -> float:
    """Return the time of the last message by which another vehicle acknowledges to hear this one [s]."""
    reports = state.neighbours.values()
    return max((r.at_s for r in reports if r.hears(state.task.uav)), default=-math.inf)
