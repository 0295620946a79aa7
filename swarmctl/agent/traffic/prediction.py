"""Predicted trajectories of this vehicle and its neighbours. Pure.

Points are in the area's local frame [m], with heights above this vehicle's home.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from swarmctl.agent.phases import Phase
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.separation.trajectory import LocalPoint, Trajectory, extrapolate
from swarmctl.agent.traffic.separation.watch import NeighbourReport
from swarmctl.core.frames import StateShared
from swarmctl.core.vehicle import BRAKING_M_S2, VehicleState

MAX_REPORT_AGE_S = 5.0
"""Greatest age of a state from which another vehicle's position is predicted [s]."""
SILENT_S = 180.0
"""Time for which a vehicle that gave way stays clear of the last position of a silent vehicle [s]."""
AIRBORNE_M = 1.0
"""Height above home below which a vehicle counts as on the ground [m]."""


def own_trajectory(state: AgentState, for_s: float | None = None) -> Trajectory | None:
    """Return the own trajectory for the next `for_s` seconds (default: the look-ahead time).

    A flying vehicle follows its plan at the present speed, or its interrupted plan at cruise speed. In other
    phases, and during a mission change, the vehicle flies straight on. None: the position is unknown.
    """
    vehicle, rules = state.vehicle, state.task.separation
    here = position_of(state)
    if here is None:
        return None
    now_s, for_s = vehicle.time_boot_s, rules.look_ahead_s if for_s is None else for_s
    swap = state.give_way.plan or (state.route if state.pending is None else None)
    if swap is None or state.phase is not Phase.FLYING:
        return extrapolate(here, (vehicle.east_m_s, vehicle.north_m_s, vehicle.climb_m_s), now_s, for_s)
    speed_m_s = state.task.arrival.speed_m_s if state.give_way.plan else max(vehicle.ground_speed_m_s, 0.5)
    progress = state.progress_on(swap)
    ahead = progress.points_ahead if progress is not None else ()
    return _along([here, *((*point, swap.plan.height_m) for point in ahead)], speed_m_s, now_s, for_s)


def position_of(state: AgentState) -> LocalPoint | None:
    """Return this vehicle's position; None if the last telemetry has none."""
    vehicle = state.vehicle
    if vehicle.lat_deg is None or vehicle.lon_deg is None or vehicle.alt_rel_m is None:
        return None
    return (*state.task.grid.frame.to_local(vehicle.lat_deg, vehicle.lon_deg), vehicle.alt_rel_m)


def _along(points: Sequence[LocalPoint], speed_m_s: float, from_s: float, for_s: float) -> Trajectory:
    """Return the trajectory from point to point for `for_s` seconds; the vehicle stops at the last point."""
    times_s, passed = [from_s], [points[0]]
    for point in points[1:]:
        takes_s = math.dist(passed[-1][:2], point[:2]) / speed_m_s
        remaining_s = from_s + for_s - times_s[-1]
        if takes_s >= remaining_s > 0.0:
            share = remaining_s / takes_s
            passed.append(tuple(a + share * (b - a) for a, b in zip(passed[-1], point, strict=True)))  # type: ignore[arg-type]
            times_s.append(from_s + for_s)
            break
        if takes_s > 0.0:
            times_s.append(times_s[-1] + takes_s)
            passed.append(point)
    if times_s[-1] < from_s + for_s:
        times_s.append(from_s + for_s)
        passed.append(passed[-1])
    return Trajectory(tuple(times_s), tuple(passed))


def hold_trajectory(state: AgentState) -> Trajectory | None:
    """Return the trajectory of a hold for the look-ahead time; None if the position is unknown."""
    here, rules = position_of(state), state.task.separation
    if here is None:
        return None
    still = (0.0, 0.0, 0.0)
    return extrapolate(stopping_point(state, here), still, state.vehicle.time_boot_s, rules.look_ahead_s)


def stopping_point(state: AgentState, here: LocalPoint) -> LocalPoint:
    """Return the point at which the vehicle stops if it holds now."""
    vehicle = state.vehicle
    braking_s = vehicle.ground_speed_m_s / (2.0 * BRAKING_M_S2)
    return here[0] + vehicle.east_m_s * braking_s, here[1] + vehicle.north_m_s * braking_s, here[2]


def predict(state: AgentState, report: NeighbourReport) -> Trajectory | None:
    """Return another vehicle's extrapolated trajectory; None on the ground, or if the state is too old."""
    reported, now_s = report.state, state.vehicle.time_boot_s
    if not 0.0 <= now_s - report.at_s <= MAX_REPORT_AGE_S or reported.alt_rel_m < AIRBORNE_M:
        return None
    for_s = now_s - report.at_s + state.task.separation.look_ahead_s
    return extrapolate(_reported_position(state, reported), reported.velocity_m_s, report.at_s, for_s)


def predictions(
    state: AgentState, heights_m: tuple[float, float] = (-math.inf, math.inf)
) -> dict[int, Trajectory]:
    """Return the extrapolated trajectories of the neighbours that come between two heights above home."""
    low_m, high_m = heights_m
    now_s, vehicle, ahead_s = state.vehicle.time_boot_s, state.vehicle, state.task.separation.look_ahead_s
    found = {}
    for uav, report in state.neighbours.items():
        # Most neighbours fly at other heights, so this test comes before the projection.
        up_m = _up_m(vehicle, report.state)
        later_m = up_m + report.state.velocity_m_s[2] * (now_s - report.at_s + ahead_s)
        if low_m <= max(up_m, later_m) and min(up_m, later_m) <= high_m and (path := predict(state, report)):
            found[uav] = path
    return found


def _reported_position(state: AgentState, reported: StateShared) -> LocalPoint:
    east_m, north_m = state.task.grid.frame.to_local(reported.lat_deg, reported.lon_deg)
    return east_m, north_m, _up_m(state.vehicle, reported)


def _up_m(vehicle: VehicleState, other: StateShared) -> float:
    """Return the height of another vehicle above this vehicle's home; the two homes may differ in height."""
    if vehicle.alt_amsl_m is None or vehicle.alt_rel_m is None or other.alt_amsl_m is None:
        return other.alt_rel_m
    return other.alt_amsl_m - vehicle.alt_amsl_m + vehicle.alt_rel_m


def silent_neighbours(state: AgentState) -> dict[int, Trajectory]:
    """Return the last positions, as trajectories, of silent vehicles to which this vehicle gave way."""
    now_s = state.vehicle.time_boot_s
    return {
        uav: extrapolate(_reported_position(state, report.state), (0.0, 0.0, 0.0), now_s, SILENT_S)
        for uav, report in state.give_way.to.items()
        if MAX_REPORT_AGE_S < now_s - report.at_s <= SILENT_S and report.state.alt_rel_m >= AIRBORNE_M
    }
