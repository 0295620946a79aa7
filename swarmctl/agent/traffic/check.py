"""The trajectory check: a flight, the known flights of other vehicles, and limits give the clashes. Pure.

Launch, new plans, holds, returns and landings ask about `known_flights.known_flights`, the flown plan about
`known_intents`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from swarmctl.agent.phases import EN_ROUTE
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.separation.approach import Limits, closest, intervals
from swarmctl.agent.traffic.separation.clash import TIME_TOLERANCE_S, Clash, find_clashes
from swarmctl.agent.traffic.separation.other_vehicles import KnownFlight, Others
from swarmctl.agent.traffic.separation.trajectory import Bounds, LocalPoint, Trajectory, until_landing
from swarmctl.core.records import replace

HORIZONTAL_MARGIN = 1.15
"""Multiple of the horizontal limit that planned flights keep; landing spots are 1.2 limits apart."""
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


def clashes_with(state: AgentState, flight: Trajectory, others: Others) -> tuple[Clash, ...]:
    """Return the clashes of a flight with the flights of `others`, soonest first.

    Flights keep HORIZONTAL_MARGIN times the horizontal limit, because vehicles drift in wind and stop late.
    """
    found = _clashes_with_each(flight, others, state.task.separation.limits)
    return _soonest_of_each([clash for clash, _ in found])


def _clashes_with_each(
    flight: Trajectory, others: Others, limits: Limits
) -> Iterator[tuple[Clash, KnownFlight]]:
    """Yield the first clash with each flight that another vehicle may take: as known, or straight on."""
    limits = Limits(HORIZONTAL_MARGIN * limits.horizontal_m, limits.vertical_m)
    near = near_flights(flight, others, limits)
    straight = {uav: known.straight_on() for uav, known in near.items() if known.straight is not None}
    for part in (near, straight):
        for clash in find_clashes(flight, part, limits):
            yield clash, part[clash.other]


def _soonest_of_each(clashes: Sequence[Clash]) -> tuple[Clash, ...]:
    """Return the first clash with each vehicle, soonest first."""
    found = sorted(clashes, key=lambda clash: (clash.at_s, clash.other))
    first = {clash.other: clash for clash in reversed(found)}
    return tuple(clash for clash in found if first[clash.other] is clash)


def waits_within_s(known: KnownFlight) -> float:
    """Return the time within which a conflict causes a wait [s].

    Farther ahead, a vehicle that can change its plan gives way.
    """
    return SEPARATES_WITHIN_S if known.may_change else WAIT_WITHIN_S


def describe_clashes(state: AgentState, clashes: Sequence[Clash]) -> str:
    """Return as text the other vehicles, and the time until each clash."""
    now_s, name_of = state.vehicle.time_boot_s, state.task.name_of
    return " and ".join(
        f"{name_of(clash.other)} in {max(clash.at_s - now_s, 0.0):.0f} s" for clash in clashes
    )


def near_flights(flight: Trajectory, others: Others, limits: Limits) -> dict[int, KnownFlight]:
    """Return those of `others` that may clash with a flight, by bounding boxes."""
    at = TIME_TOLERANCE_S, limits.horizontal_m, limits.horizontal_m, limits.vertical_m
    mine = Bounds.of(flight).wider(at)
    return {uav: known for uav, known in others.items() if mine.meets(known.bounds)}


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

    def separates(known: KnownFlight) -> bool:
        # Over a goal a vehicle has no other way than down: there the planned times of a late vehicle count.
        if known.may_be_late and state.phase in EN_ROUTE:
            return _separates_from_late(flight, known, limits)
        return _separates(flight, present, replace(known, may_be_late=False), limits)

    found = _clashes_with_each(flight, others, limits)
    return _soonest_of_each([clash for clash, of in found if clash.at_s > near_s or not separates(of)])


def _leads_away(flight: Trajectory, other: KnownFlight, limits: Limits) -> bool:
    """Return whether a flight keeps the limits SEPARATES_WITHIN_S after its first motion, and from then on.

    A vehicle in hold moves only after its upload.
    """
    after = flight.since(flight.moves_from_s + SEPARATES_WITHIN_S)
    return after is None or not find_clashes(after, {0: other}, limits)


def _separates(flight: Trajectory, present: Trajectory | None, other: KnownFlight, limits: Limits) -> bool:
    """Return whether a flight separates two vehicles that are close now.

    It has to lead away (`_leads_away`). Until then the vehicles may be closer than ENOUGH in three cases:

    - they keep the limits;
    - they are nearer than the limits already, and hardly come closer than now;
    - the present flight comes closer by BETTER_PLAN_SHARE.
    """
    begin_s, wide = flight.times_s[0], other.limits(limits)
    if not _leads_away(flight, other, limits):
        return False
    here, there = flight.at(begin_s), other.flight.at(begin_s)
    least = _least_share(flight, other.flight, wide)
    if least is None or here is None or there is None:
        return True
    now = wide.share(math.dist(here[:2], there[:2]), abs(here[2] - there[2]))
    # A vehicle that brakes now may come as near as the limits.
    allowed = min((1.0 - CLOSER_BY) * now, 1.0 if present is None else ENOUGH)
    if least >= (max(allowed, 1.0) if now >= 1.0 else allowed) - 1e-6:
        return True
    present_least = None if present is None else _least_share(present, other.flight, wide)
    return present_least is not None and least >= present_least + BETTER_PLAN_SHARE


def _separates_from_late(flight: Trajectory, other: KnownFlight, limits: Limits) -> bool:
    """Return whether a flight separates a vehicle from one that may be anywhere on its flight.

    It comes no nearer to any place of the other flight than now, if that is nearer than the limits.
    """
    here, wide = flight.points[0], other.limits(limits)
    now = min(wide.share(math.dist(here[:2], at[:2]), abs(here[2] - at[2])) for at in _places(other.flight))
    share = min(now, 1.0) - 1e-6
    nearer = Limits(share * wide.horizontal_m, share * wide.vertical_m)
    is_nearer = bool(find_clashes(flight, {0: replace(other, uncertainty_m=(0.0, 0.0))}, nearer))
    return not is_nearer and _leads_away(flight, other, limits)


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
