"""The trajectory check: a flight, the known flights of other vehicles, and limits give the clashes. Pure.

Launch, new plans, holds, landings and the flown plan ask `clashes_with` about `known_flights`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set

from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.prediction import (
    EVERYWHERE,
    MAX_REPORT_AGE_S,
    home_amsl_m,
    predict,
    predictions,
    silent_neighbours,
)
from swarmctl.agent.traffic.priority import Activity, Standing
from swarmctl.agent.traffic.separation.approach import Limits, closest, intervals
from swarmctl.agent.traffic.separation.clash import TIME_TOLERANCE_S, Clash, find_clashes
from swarmctl.agent.traffic.separation.trajectory import Bounds, LocalPoint, Trajectory, until_landing
from swarmctl.agent.traffic.separation.watch import NeighbourIntent, NeighbourReport

Others = Mapping[int, NeighbourIntent]
"""flights of other vehicles by system id"""

MARGIN = 1.15
"""Multiple of the horizontal limit that planned flights keep; landing spots are 1.2 limits apart."""
FRESH_S = 20.0
"""Age from which on an intent is the last of a silent vehicle [s]: three intents in a row may be lost."""
MAX_AGE_S = 90.0
"""Greatest age of an intent in use [s]: a silent vehicle probably flies on by its last plan."""
SEPARATES_WITHIN_S = 6.0
"""Time within which two close vehicles have to separate [s]; a climb or a turn takes this long."""
WAIT_WITHIN_S = 15.0
"""Time within which a conflict with a vehicle that cannot change its plan causes a wait [s]."""
BETTER_BY = 0.3
"""Least improvement, as a share of the limits, of a plan that is still too close to another vehicle."""

OFF_INTENT_S, OFF_INTENT_M, OFF_INTENT_UP_M = 1.5, 4.0, 2.0
"""Distances from the announced position beyond which a vehicle is off its intent: over ground the distance
flown in OFF_INTENT_S, at least OFF_INTENT_M, and in height [m]."""


def clashes_with(flight: Trajectory, others: Others, limits: Limits) -> tuple[Clash, ...]:
    """Return the clashes of a flight with the flights of `others`, soonest first.

    Flights keep MARGIN times the horizontal limit, because vehicles drift in wind and stop late.
    """
    limits = Limits(MARGIN * limits.horizontal_m, limits.vertical_m)
    near = near_flights(flight, others, limits)
    wider = {uav: intent.limits(limits) for uav, intent in near.items() if any(intent.uncertainty_m)}
    return find_clashes(flight, {uav: intent.flight for uav, intent in near.items()}, limits, wider=wider)


def near_flights(flight: Trajectory, others: Others, limits: Limits) -> dict[int, NeighbourIntent]:
    """Return those of `others` that may clash with a flight, by bounding boxes."""
    at = TIME_TOLERANCE_S, limits.horizontal_m, limits.horizontal_m, limits.vertical_m
    mine = Bounds.of(flight).wider(at)
    return {uav: intent for uav, intent in others.items() if mine.meets(intent.bounds)}


def clashes_of_route(
    state: AgentState, flight: Trajectory, others: Others, present_flight: Trajectory | None = None
) -> tuple[Clash, ...]:
    """Return the clashes of a flight up to its landing.

    A flight that separates two close vehicles does not clash. `present_flight`: flight of the present plan.
    """
    limits, flight = state.task.separation.limits, until_landing(flight)
    near_s = flight.times_s[0] + (TIME_TOLERANCE_S if present_flight is None else SEPARATES_WITHIN_S)

    def separates(intent: NeighbourIntent) -> bool:
        return _separates(flight, present_flight, intent.flight, intent.limits(limits))

    found = clashes_with(flight, others, limits)
    return tuple(clash for clash in found if clash.at_s > near_s or not separates(others[clash.other]))


def _separates(flight: Trajectory, present: Trajectory | None, other: Trajectory, limits: Limits) -> bool:
    """Return whether a flight separates two vehicles that are close now.

    From SEPARATES_WITHIN_S on, the flight has to keep the limits. Until then the vehicles may be closer than
    the limits if they come no closer than now, or if the present flight comes closer by BETTER_BY.
    """
    begin_s = flight.times_s[0]
    after = flight.since(begin_s + SEPARATES_WITHIN_S)
    if after is not None and find_clashes(after, {0: other}, limits):
        return False
    here, there = flight.at(begin_s), other.at(begin_s)
    least = _least_share(flight, other, limits)
    if least is None or here is None or there is None:
        return True
    now = limits.share(math.dist(here[:2], there[:2]), abs(here[2] - there[2]))
    if least >= min(now, 1.0) - 1e-6:
        return True
    present_least = None if present is None else _least_share(present, other, limits)
    return present_least is not None and least >= present_least + BETTER_BY


def _least_share(flight: Trajectory, other: Trajectory, limits: Limits) -> float | None:
    """Return the least distance of two flights, as a share of the limits; None if they share no time."""
    at = closest(flight, other, limits)
    return None if at is None else limits.share(at.horizontal_m, at.vertical_m)


def known_flights(state: AgentState) -> dict[int, NeighbourIntent]:
    """Return the known flights of other vehicles: intents, extrapolated positions, or last positions."""
    intents = known_intents(state)
    silent = {uav: as_intent(state, path) for uav, path in silent_neighbours(state).items()}
    known = silent | _extrapolated(state, state.neighbours.keys() - intents.keys())
    return intents | {uav: flight for uav, flight in known.items() if uav not in intents}


def may_meet_anyone(state: AgentState, box: Bounds) -> bool:
    """Return whether a known flight may come into a box, with heights above home, and the limits around it.

    It is a quick test for `current_flights`: most of the time no vehicle is near in height.
    """
    limits, home_m = state.task.separation.limits, home_amsl_m(state)
    wide_m, high_m = MARGIN * limits.horizontal_m, MARGIN * limits.vertical_m
    box = box.wider((TIME_TOLERANCE_S, wide_m, wide_m, high_m))
    if predictions(state, box) or silent_neighbours(state):
        return True
    box = box.higher(home_m)
    return any(
        box.meets(intent.bounds) and (any(intent.uncertainty_m) or intent.flight.may_meet(box))
        for intent in known_intents(state).values()
    )


def share_of(mine: Sequence[Trajectory], others: Sequence[Trajectory], limits: Limits) -> float:
    """Return the least distance of any of two flights, as a share of the limits."""
    found = (_least_share(one, other, limits) for one in mine for other in others)
    return min((share for share in found if share is not None), default=math.inf)


def come_within(
    mine: Sequence[Trajectory], others: Sequence[Trajectory], limits: Limits, share: float
) -> bool:
    """Return whether any two flights come closer than a share of the limits: quicker than `share_of`."""
    wider = Limits(share * limits.horizontal_m, share * limits.vertical_m)
    sides = 0.0, wider.horizontal_m, wider.horizontal_m, wider.vertical_m
    boxes = [(one, Bounds.of(one).wider(sides)) for one in mine]
    return any(other.may_meet(box) and intervals(one, other, wider) for other in others for one, box in boxes)


def current_flights(state: AgentState, paths: Sequence[Trajectory] = ()) -> dict[int, NeighbourIntent]:
    """Return the known flights; vehicles off their intents count with their extrapolated positions.

    With `paths`, a vehicle that does not come near them is not compared with its intent.
    """
    flights, home_m = known_flights(state), home_amsl_m(state)
    within = _bounds_of(paths, state.task.separation.limits, home_m) if paths else EVERYWHERE
    for uav, path in predictions(state, within).items():
        if (intent := flights.get(uav)) is None:
            continue
        report, (east_m, north_m, up_m) = state.neighbours[uav], path.points[0]
        planned = intent.flight.at(report.at_s)
        if planned is None or _is_off((east_m, north_m, up_m + home_m), planned, report):
            flights[uav] = as_intent(state, path)
    return flights


def _bounds_of(paths: Sequence[Trajectory], limits: Limits, home_m: float) -> Bounds:
    """Return the box around paths and their limits, heights above home."""
    boxes = [Bounds.of(path.higher(-home_m)) for path in paths]
    least = [min(sides) for sides in zip(*(box.least for box in boxes), strict=True)]
    most = [max(sides) for sides in zip(*(box.most for box in boxes), strict=True)]
    horizontal_m, vertical_m = MARGIN * limits.horizontal_m, MARGIN * limits.vertical_m
    at = TIME_TOLERANCE_S, horizontal_m, horizontal_m, vertical_m
    return Bounds((least[0], least[1], least[2], least[3]), (most[0], most[1], most[2], most[3])).wider(at)


def _is_off(at: LocalPoint, planned: LocalPoint, report: NeighbourReport) -> bool:
    east_m_s, north_m_s, _ = report.state.velocity_m_s
    off_m = max(OFF_INTENT_M, OFF_INTENT_S * math.hypot(east_m_s, north_m_s))
    return math.dist(at[:2], planned[:2]) > off_m or abs(at[2] - planned[2]) > OFF_INTENT_UP_M


def alarmed_flights(state: AgentState) -> dict[int, NeighbourIntent]:
    """Return the extrapolated flights of vehicles with an alarm: they may be off their intents."""
    return _extrapolated(state, {alarm.other for alarm in state.alarms})


def _extrapolated(state: AgentState, uavs: Set[int]) -> dict[int, NeighbourIntent]:
    """Return the extrapolated flights of those of `uavs` that were received recently."""
    reports = ((uav, report) for uav, report in state.neighbours.items() if uav in uavs)
    return {uav: as_intent(state, path) for uav, report in reports if (path := predict(state, report))}


def known_intents(state: AgentState) -> dict[int, NeighbourIntent]:
    """Return the intents of other vehicles by system id, those of silent vehicles with their landings."""
    now_s, known = state.vehicle.time_boot_s, {}
    for uav, intent in state.intents.items():
        if 0.0 <= (age_s := now_s - intent.sent_s) <= MAX_AGE_S:
            report = state.neighbours.get(uav)
            is_silent = age_s > FRESH_S or (report is not None and now_s - report.at_s > MAX_REPORT_AGE_S)
            known[uav] = intent.of_silent_vehicle() if is_silent else intent
    return known


def as_intent(state: AgentState, path: Trajectory) -> NeighbourIntent:
    """Return a predicted path, with heights above home, as a flight that its vehicle cannot change."""
    flight = path.higher(home_amsl_m(state))
    return NeighbourIntent(flight, Bounds.of(flight), may_change=False, sent_s=path.times_s[0])


def standing_of(state: AgentState, uav: int, intent: NeighbourIntent) -> Standing:
    """Return another vehicle's standing for the rule of priority."""
    activity = Activity.EN_ROUTE if intent.may_change else Activity.LANDING
    if intent.on_ground:
        activity = Activity.CLIMBING
    return Standing(activity, intent.may_change, uav, _height_now_m(state, intent))


def _height_now_m(state: AgentState, intent: NeighbourIntent) -> float:
    now_s, flight = state.vehicle.time_boot_s, intent.flight
    at = flight.at(min(max(now_s, flight.times_s[0]), flight.times_s[-1]))
    return flight.points[-1][2] if at is None else at[2]
