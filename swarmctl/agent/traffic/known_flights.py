"""The known flights of other vehicles: intents, else extrapolated positions, else last positions. Pure."""

from __future__ import annotations

import math

from swarmctl.agent.phases import ENDED
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.check import HORIZONTAL_MARGIN
from swarmctl.agent.traffic.prediction import AIRBORNE_M, MAX_AGE_S, predict, predictions
from swarmctl.agent.traffic.separation.clash import TIME_TOLERANCE_S
from swarmctl.agent.traffic.separation.other_vehicles import MAX_REPORT_AGE_S, KnownFlight, NeighbourReport
from swarmctl.agent.traffic.separation.trajectory import Bounds, extrapolate

FRESH_S = 20.0
"""Age from which on an intent is the last of a silent vehicle [s]: three intents in a row may be lost."""
OFF_INTENT_S, OFF_INTENT_M, OFF_INTENT_UP_M = 1.5, 4.0, 2.0
"""Distances from the announced position beyond which a vehicle is off its intent: over ground the distance
flown in OFF_INTENT_S, at least OFF_INTENT_M, and in height [m]."""


def known_flights(state: AgentState, near: Bounds | None = None) -> dict[int, KnownFlight]:
    """Return the known flights of other vehicles: intents, extrapolated positions, or last positions.

    A vehicle off its intent counts with both: the intent, and its extrapolated position. `near`: leave out
    the vehicles that keep away from this box by the limits, as announced and straight on. Most of the time no
    vehicle is near in height, so this is quick.
    """
    known = _last_positions(state) | known_intents(state)
    announced, reports = state.intents, state.neighbours
    if near is not None:
        limits = state.task.separation.limits
        wide_m, high_m = HORIZONTAL_MARGIN * limits.horizontal_m, HORIZONTAL_MARGIN * limits.vertical_m
        box = near.wider((TIME_TOLERANCE_S, wide_m, wide_m, high_m))
        come_near = predictions(state, box).keys() | {uav for uav, of in known.items() if of.may_meet(box)}
        known = {uav: intent for uav, intent in known.items() if uav in come_near}
        reports = {uav: report for uav, report in reports.items() if uav in come_near}
    for uav, report in reports.items():
        intent = known.get(uav) if uav in announced else None
        if intent is not None and not _is_off(report, intent):
            continue
        if (path := predict(state, report)) is not None:
            known[uav] = KnownFlight.predicted(path) if intent is None else intent.and_straight_on(path)
    return known


def _is_off(report: NeighbourReport, intent: KnownFlight) -> bool:
    """Return whether a vehicle is not where its intent says; False for a state older than the intent."""
    if report.at_s < intent.sent_s:
        return False
    planned = intent.flight.at(report.at_s)
    if planned is None:
        return True
    at, (east_m_s, north_m_s, _) = report.position_m, report.state.velocity_m_s
    off_m = max(OFF_INTENT_M, OFF_INTENT_S * math.hypot(east_m_s, north_m_s))
    return math.dist(at[:2], planned[:2]) > off_m or abs(at[2] - planned[2]) > OFF_INTENT_UP_M


def known_intents(state: AgentState) -> dict[int, KnownFlight]:
    """Return the intents of other vehicles by system id, those of silent vehicles with their landings."""
    now_s, reports, known = state.vehicle.time_boot_s, state.neighbours, {}
    for uav, intent in state.intents.items():
        if not 0.0 <= (age_s := now_s - intent.sent_s) <= MAX_AGE_S:
            continue
        report = reports.get(uav)
        if report is not None and report.at_s > intent.sent_s and report.state.phase in ENDED:
            continue  # it has withdrawn its intent
        if age_s <= FRESH_S and (report is None or report.is_recent(now_s)):
            known[uav] = intent
            continue
        heard_s = intent.sent_s if report is None else max(intent.sent_s, report.at_s)
        if (silent := intent.of_silent_vehicle(heard_s, intent.sent_s + MAX_AGE_S)) is not None:
            known[uav] = silent
    return known


def _last_positions(state: AgentState) -> dict[int, KnownFlight]:
    """Return the last positions of silent vehicles, as flights; for vehicles without a known intent."""
    now_s = state.vehicle.time_boot_s
    return {
        uav: KnownFlight.predicted(extrapolate(report.position_m, (0.0, 0.0, 0.0), now_s, MAX_AGE_S))
        for uav, report in state.neighbours.items()
        if MAX_REPORT_AGE_S < now_s - report.at_s <= MAX_AGE_S and report.state.alt_rel_m >= AIRBORNE_M
    }
