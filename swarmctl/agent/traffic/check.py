"""The trajectory check: a flight, the known flights of other vehicles, and limits give the clashes. Pure.

Launch, new plans, holds and landings ask `clashes_with` about `known_flights`, the flown plan about
`known_intents`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

from swarmctl.agent.phases import EN_ROUTE, ENDED
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.prediction import (
    MAX_AGE_S,
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
SEPARATES_WITHIN_S = 6.0
"""Time from the first motion within which two close vehicles have to separate [s]: a climb takes as long."""
WAIT_WITHIN_S = 15.0
"""Time within which a conflict with a vehicle that cannot change its plan causes a wait [s]."""
ENOUGH = 1.1
"""Share of the limits that two near vehicles keep if they can: they drift, and brake early or late."""
CLOSER_BY = 0.1
"""Share of their distance by which two close vehicles may come closer before they separate."""
BETTER_PLAN_SHARE = 0.3
"""Least improvement, as a share of the limits, of a plan that is still too close to another vehicle."""

PLACES_EVERY_S = 0.5
"""Time between two places on a flight that are compared [s]."""

OFF_INTENT_S, OFF_INTENT_M, OFF_INTENT_UP_M = 1.5, 4.0, 2.0
"""Distances from the announced position beyond which a vehicle is off its intent: over ground the distance
flown in OFF_INTENT_S, at least OFF_INTENT_M, and in height [m]."""


def clashes_with(flight: Trajectory, others: Others, limits: Limits) -> tuple[Clash, ...]:
    """Return the clashes of a flight with the flights of `others`, soonest first.

    Flights keep MARGIN times the horizontal limit, because vehicles drift in wind and stop late.
    """
    return _soonest_of_each([clash for clash, _ in _clashes_with_each(flight, others, limits)])


def _clashes_with_each(
    flight: Trajectory, others: Others, limits: Limits
) -> Iterator[tuple[Clash, NeighbourIntent]]:
    """Yield the first clash with each flight that another vehicle may take: its intent, or straight on."""
    limits = Limits(MARGIN * limits.horizontal_m, limits.vertical_m)
    near = near_flights(flight, others, limits)
    straight = {uav: intent.straight_on() for uav, intent in near.items() if intent.straight is not None}
    for part in (near, straight):
        wider = {uav: intent.limits(limits) for uav, intent in part.items() if any(intent.uncertainty_m)}
        late = {uav for uav, intent in part.items() if intent.may_be_late}
        flights = {uav: intent.flight for uav, intent in part.items()}
        for clash in find_clashes(flight, flights, limits, wider=wider, late=late):
            yield clash, part[clash.other]


def _soonest_of_each(clashes: Sequence[Clash]) -> tuple[Clash, ...]:
    """Return the first clash with each vehicle, soonest first."""
    found = sorted(clashes, key=lambda clash: (clash.at_s, clash.other))
    first = {clash.other: clash for clash in reversed(found)}
    return tuple(clash for clash in found if first[clash.other] is clash)


def describe_clashes(state: AgentState, clashes: Sequence[Clash]) -> str:
    """Return as text the other vehicles, and the time until each clash."""
    now_s, name_of = state.vehicle.time_boot_s, state.task.name_of
    return " and ".join(
        f"{name_of(clash.other)} in {max(clash.at_s - now_s, 0.0):.0f} s" for clash in clashes
    )


def near_flights(flight: Trajectory, others: Others, limits: Limits) -> dict[int, NeighbourIntent]:
    """Return those of `others` that may clash with a flight, by bounding boxes."""
    at = TIME_TOLERANCE_S, limits.horizontal_m, limits.horizontal_m, limits.vertical_m
    mine = Bounds.of(flight).wider(at)
    return {uav: intent for uav, intent in others.items() if mine.meets(intent.bounds)}


def clashes_of_route(
    state: AgentState, flight: Trajectory, others: Others, present_flight: Trajectory | None = None
) -> tuple[Clash, ...]:
    """Return the clashes of a flight up to its landing, as `clashes_if_changed`."""
    return clashes_if_changed(state, until_landing(flight), others, present_flight)


def clashes_if_changed(
    state: AgentState, flight: Trajectory, others: Others, present: Trajectory | None
) -> tuple[Clash, ...]:
    """Return the clashes of a flight that replaces the present flight.

    A flight that separates two close vehicles does not clash.
    """
    limits = state.task.separation.limits
    near_s = flight.times_s[0] + (TIME_TOLERANCE_S if present is None else SEPARATES_WITHIN_S)

    def separates(intent: NeighbourIntent) -> bool:
        # Over a goal a vehicle has no other way than down: there the planned times of a late vehicle count.
        if intent.may_be_late and state.phase in EN_ROUTE:
            return _separates_from_late(flight, intent.flight, intent.limits(limits))
        return _separates(flight, present, intent.flight, intent.limits(limits))

    found = _clashes_with_each(flight, others, limits)
    return _soonest_of_each([clash for clash, of in found if clash.at_s > near_s or not separates(of)])


def _leads_away(flight: Trajectory, other: Trajectory, limits: Limits, *, is_late: bool = False) -> bool:
    """Return whether a flight keeps the limits SEPARATES_WITHIN_S after its first motion, and from then on.

    A vehicle in hold moves only after its upload. `is_late`: the other may be late.
    """
    after = flight.since(flight.moves_from_s + SEPARATES_WITHIN_S)
    late = frozenset({0} if is_late else ())
    return after is None or not find_clashes(after, {0: other}, limits, late=late)


def _separates(flight: Trajectory, present: Trajectory | None, other: Trajectory, limits: Limits) -> bool:
    """Return whether a flight separates two vehicles that are close now.

    It has to lead away (`_leads_away`). Until then the vehicles may be closer than ENOUGH in three cases:

    - they keep the limits;
    - they are nearer than the limits already, and hardly come closer than now;
    - the present flight comes closer by BETTER_PLAN_SHARE.
    """
    begin_s = flight.times_s[0]
    if not _leads_away(flight, other, limits):
        return False
    here, there = flight.at(begin_s), other.at(begin_s)
    least = _least_share(flight, other, limits)
    if least is None or here is None or there is None:
        return True
    now = limits.share(math.dist(here[:2], there[:2]), abs(here[2] - there[2]))
    # A vehicle that brakes now may come as near as the limits.
    allowed = min((1.0 - CLOSER_BY) * now, 1.0 if present is None else ENOUGH)
    if least >= (max(allowed, 1.0) if now >= 1.0 else allowed) - 1e-6:
        return True
    present_least = None if present is None else _least_share(present, other, limits)
    return present_least is not None and least >= present_least + BETTER_PLAN_SHARE


def _separates_from_late(flight: Trajectory, other: Trajectory, limits: Limits) -> bool:
    """Return whether a flight separates a vehicle from one that may be anywhere on its flight.

    It comes no nearer to any place of the other flight than now, if that is nearer than the limits.
    """
    here = flight.points[0]
    now = min(limits.share(math.dist(here[:2], at[:2]), abs(here[2] - at[2])) for at in _places(other))
    share = min(now, 1.0) - 1e-6
    nearer = Limits(share * limits.horizontal_m, share * limits.vertical_m)
    is_nearer = bool(find_clashes(flight, {0: other}, nearer, late=frozenset({0})))
    return not is_nearer and _leads_away(flight, other, limits, is_late=True)


def _places(flight: Trajectory) -> Iterator[LocalPoint]:
    """Yield places on a flight, at most PLACES_EVERY_S apart."""
    for (a, b), (from_s, to_s) in zip(pairwise(flight.points), pairwise(flight.times_s), strict=True):
        n = max(math.ceil((to_s - from_s) / PLACES_EVERY_S), 1)
        for k in range(n):
            share = k / n
            yield (
                a[0] + share * (b[0] - a[0]),
                a[1] + share * (b[1] - a[1]),
                a[2] + share * (b[2] - a[2]),
            )
    yield flight.points[-1]


def _least_share(flight: Trajectory, other: Trajectory, limits: Limits) -> float | None:
    """Return the least distance of two flights, as a share of the limits; None if they share no time."""
    at = closest(flight, other, limits)
    return None if at is None else limits.share(at.horizontal_m, at.vertical_m)


def known_flights(state: AgentState, near: Bounds | None = None) -> dict[int, NeighbourIntent]:
    """Return the known flights of other vehicles: intents, extrapolated positions, or last positions.

    A vehicle off its intent counts with both: the intent, and its extrapolated position. `near`: leave out
    the vehicles that keep away from this box by the limits, as announced and straight on. Most of the time no
    vehicle is near in height, so this is quick.
    """
    known = {uav: as_intent(path) for uav, path in silent_neighbours(state).items()}
    known |= known_intents(state)
    announced, reports = state.intents, state.neighbours
    if near is not None:
        limits = state.task.separation.limits
        wide_m, high_m = MARGIN * limits.horizontal_m, MARGIN * limits.vertical_m
        box = near.wider((TIME_TOLERANCE_S, wide_m, wide_m, high_m))
        come_near = predictions(state, box).keys() | {uav for uav, of in known.items() if of.may_meet(box)}
        known = {uav: intent for uav, intent in known.items() if uav in come_near}
        reports = {uav: report for uav, report in reports.items() if uav in come_near}
    for uav, report in reports.items():
        intent = known.get(uav) if uav in announced else None
        if intent is not None and not _is_off(report, intent):
            continue
        if (path := predict(state, report)) is not None:
            straight = as_intent(path)
            known[uav] = straight if intent is None else intent.and_straight_on(straight.flight)
    return known


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


def _is_off(report: NeighbourReport, intent: NeighbourIntent) -> bool:
    """Return whether a vehicle is not where its intent says; False for a state older than the intent."""
    if report.at_s < intent.sent_s:
        return False
    planned = intent.flight.at(report.at_s)
    if planned is None:
        return True
    at, (east_m_s, north_m_s, _) = report.position_m, report.state.velocity_m_s
    off_m = max(OFF_INTENT_M, OFF_INTENT_S * math.hypot(east_m_s, north_m_s))
    return math.dist(at[:2], planned[:2]) > off_m or abs(at[2] - planned[2]) > OFF_INTENT_UP_M


def known_intents(state: AgentState) -> dict[int, NeighbourIntent]:
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


def as_intent(path: Trajectory) -> NeighbourIntent:
    """Return a predicted path as a flight that its vehicle cannot change."""
    return NeighbourIntent(path, Bounds.of(path), may_change=False, sent_s=path.times_s[0])


def standing_of(state: AgentState, uav: int, intent: NeighbourIntent) -> Standing:
    """Return another vehicle's standing for the rule of priority."""
    activity = Activity.EN_ROUTE if intent.may_change else Activity.LANDING
    if intent.on_ground:
        activity = Activity.CLIMBING
    return Standing(activity, intent.may_change, uav, _height_now_m(state, intent))


def _height_now_m(state: AgentState, intent: NeighbourIntent) -> float:
    now_s, flight = state.vehicle.time_boot_s, intent.straight or intent.flight
    at = flight.at(min(max(now_s, flight.times_s[0]), flight.times_s[-1]))
    return flight.points[-1][2] if at is None else at[2]
