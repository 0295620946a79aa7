"""Store the recent intents of other vehicles as trajectories by the own clock. Pure.

Without a recent intent of a vehicle, its reported position counts (`known_flights`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.intents import MAX_UNCERTAINTY_M
from swarmctl.agent.traffic.own_flight import HOLD_DURATION_S
from swarmctl.agent.traffic.prediction import AIRBORNE_M, MAX_AGE_S
from swarmctl.agent.traffic.separation.other_vehicles import KnownFlight
from swarmctl.agent.traffic.separation.trajectory import Bounds, Trajectory, brake, until_landing
from swarmctl.core.frames import IntentShared
from swarmctl.core.geo import LocalFrame
from swarmctl.core.records import replace
from swarmctl.planners.benevolence import OtherVehicle

LEAST_POINT_INTERVAL_S = 1e-6
"""Least time between two points of a received intent [s]; by a clock of many days, less is no time."""


def receive_intents(state: AgentState, intents: Sequence[tuple[int, float, IntentShared]]) -> AgentState:
    """Return the state with new intents of other vehicles: (UAV, age of the message [s], intent)."""
    now_s = state.vehicle.time_boot_s
    kept = dict(state.received.intents)
    for uav, age_s, intent in intents:
        announced = _announced_flight(state.task.grid.frame, intent)
        kept.pop(uav, None)
        if announced is not None and uav != state.task.uav:
            sent_s, (away_m, up_m) = now_s - age_s - intent.age_s, intent.around_m
            uncertainty = (min(away_m, MAX_UNCERTAINTY_M), up_m)  # a false sender must not block a wide area
            flight, bounds = announced[0].later(sent_s), announced[1].later(sent_s)
            bounds = bounds.wider((0.0, uncertainty[0], uncertainty[0], uncertainty[1]))
            # `landing_queue` handles the landing of a vehicle that can still change its plan.
            ahead = until_landing(flight) if intent.may_change else flight
            landing = flight if intent.may_change else None
            kept[uav] = KnownFlight(
                ahead, bounds, intent.may_change, sent_s, uncertainty, intent.on_ground, landing
            )
    fresh = {uav: known for uav, known in kept.items() if 0.0 <= now_s - known.sent_s <= MAX_AGE_S}
    others = _with_present_cells(state, [uav for uav, _, _ in intents], kept)
    return replace(state, others=others, received=replace(state.received, intents=fresh))


def with_reported_holds(state: AgentState) -> AgentState:
    """Return the state with the holds of copters that report a wait, where the intent of the hold is lost."""
    intents, reports, holds = state.received.intents, state.received.reports, {}
    for uav, intent in intents.items():
        report = reports.get(uav)
        if report is None or report.at_s <= intent.sent_s or intent.flight.ends_in_hold:
            continue
        shared = report.state
        if shared.waits and shared.hovers and shared.alt_rel_m >= AIRBORNE_M:
            flight = brake(report.position_m, shared.velocity_m_s, report.at_s).holding(HOLD_DURATION_S)
            holds[uav] = KnownFlight.predicted(flight)
    if not holds:
        return state
    return replace(state, received=replace(state.received, intents={**intents, **holds}))


def _with_present_cells(
    state: AgentState, senders: Sequence[int], kept: Mapping[int, KnownFlight]
) -> Mapping[int, OtherVehicle]:
    """Return `state.others` by new intents; a vehicle that has withdrawn its intent has ended its route."""
    if not state.task.others:
        return state.others
    grid, others = state.task.grid, dict(state.others)
    for uav in senders:
        if uav not in kept:
            others.pop(uav, None)
        elif uav in state.task.others:
            before = others.get(uav, state.task.others[uav])
            east_m, north_m, _ = kept[uav].flight.points[0]
            cell = grid.cell_at(*grid.frame.to_geodetic(east_m, north_m))
            others[uav] = before if cell is None else OtherVehicle(cell, before.goals)
    return others


def _announced_flight(frame: LocalFrame, intent: IntentShared) -> tuple[Trajectory, Bounds] | None:
    """Return the flight of an intent with times after its sending, and its box; None if it is unusable.

    The message keeps both, because every vehicle of a swarm receives it.
    """
    if frame not in intent.derived:
        intent.derived[frame] = _flight_in(frame, intent)
    announced: tuple[Trajectory, Bounds] | None = intent.derived[frame]
    return announced


def _flight_in(frame: LocalFrame, intent: IntentShared) -> tuple[Trajectory, Bounds] | None:
    announced = np.array([(p.in_s, p.lat_deg, p.lon_deg, p.alt_amsl_m) for p in intent.points])
    if len(announced) < 2 or np.diff(announced[:, 0]).min() < LEAST_POINT_INTERVAL_S:
        return None
    in_s, lat_deg, lon_deg, up_m = announced.T
    east_m, north_m = frame.to_local(lat_deg, lon_deg)
    if not (np.isfinite(east_m).all() and np.isfinite(north_m).all()):  # too far away for the local frame
        return None
    points = zip(east_m.tolist(), north_m.tolist(), up_m.tolist(), strict=True)
    flight = Trajectory(tuple(in_s.tolist()), tuple(points))
    return flight, Bounds.of(flight)
