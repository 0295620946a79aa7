"""Collision avoidance: alarms by positions, and evasive holds and climbs. Pure.

An alarm predicts that this vehicle and another come too close within `look_ahead_s` (default 10 s). The table
says which vehicle gives way.

| the other vehicle | gives way |
|---|---|
| flies its mission and acknowledges this vehicle's state | the vehicle with the higher system id |
| cannot change its plan: lands, returns, holds by order, is released | this vehicle |
| does not acknowledge this vehicle's state | this vehicle, so possibly both |

The evasive action is a hold. A fixed wing climbs instead, and so does a copter if `separation.action` is
`climb` or a hold is too close. A copter in hold plans again when its route is clear. Every 60 s it tries to
pass above the other vehicles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from swarmctl.agent.orders import StepResult, command
from swarmctl.agent.phases import IN_FLIGHT, Phase
from swarmctl.agent.replan.copter_trajectory import at_height, with_level_off
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.give_way import GiveWay
from swarmctl.agent.traffic.prediction import (
    SILENT_S,
    hold_trajectory,
    own_trajectory,
    position_of,
    predictions,
    silent_neighbours,
)
from swarmctl.agent.traffic.separation.approach import Limits, closest, intervals
from swarmctl.agent.traffic.separation.clash import HEIGHT_TOLERANCE_M
from swarmctl.agent.traffic.separation.trajectory import Trajectory
from swarmctl.agent.traffic.separation.watch import (
    NeighbourReport,
    ProximityAlarm,
    alarm_heights_m,
    clear_height_m,
    gives_way_by_id,
    gives_way_to,
    update_alarms,
)
from swarmctl.core import events as ev
from swarmctl.core.mission import Waypoint
from swarmctl.core.records import replace

RESUME_AFTER_S = (0.0, 2.0, 4.0, 6.0)
"""Delays with which a resumed route has to be clear [s]: a vehicle follows a new plan after some seconds."""
RETRY_HEIGHT_AFTER_S = 60.0
"""Interval at which a vehicle that holds tries another height [s]."""
CEILING_MARGIN_M = 3.0
"""Distance kept below the fence's ceiling [m]."""
MAX_TOLERANCE_SHARE = 1.0 / 3.0
"""Greatest tolerance in height, as a share of the vertical limit."""


def avoid_collisions(state: AgentState) -> StepResult:
    """Update the alarms, report new alarms, and give way or resume. Called for each telemetry."""
    if not (state.neighbours or state.alarms or state.give_way.plan):
        return state, []
    if state.give_way.plan is not None and state.phase not in (Phase.FLYING, Phase.LANDING):
        state = end_give_way(state)  # another order came in between
    before = {alarm.other for alarm in state.alarms}
    own = own_trajectory(state)
    if own is None or state.phase not in IN_FLIGHT:
        return replace(end_give_way(state), alarms=()), []
    rules, now_s = state.task.separation, state.vehicle.time_boot_s
    near = predictions(state, alarm_heights_m(own, rules))
    alarms = update_alarms(state.alarms, own, near, rules, now_s)
    new = [alarm for alarm in alarms if alarm.other not in before]
    if alarms or state.alarms:
        state = replace(state, alarms=alarms, n_alarms=state.n_alarms + len(new))
    messages: list[ev.Effect] = [
        ev.NotifyOperator(f"{_alarm_text(state, alarm)}{_reaction(state, alarm)}") for alarm in new
    ]
    effects: list[ev.Effect] = []
    if state.give_way.plan is not None and state.phase is Phase.LANDING:
        pass  # `landing_queue` ends this hold
    elif state.give_way.plan is not None:
        state, effects = _resume_if_clear(state, own)
    else:
        higher_ids = [alarm for alarm in alarms if not gives_way_by_id(state.task.uav, alarm.other)]
        to_avoid = [alarm for alarm in (*new, *higher_ids) if _has_to_give_way(state, alarm.other)]
        state, effects = _give_way(state, to_avoid)
    return state, [*messages, *effects]


def end_give_way(state: AgentState) -> AgentState:
    """Return the state after a hold to give way, with the fields of the hold reset."""
    return replace(state, give_way=GiveWay())


def _has_to_give_way(state: AgentState, other: int) -> bool:
    """Return whether this vehicle gives way to another, by the table of the module."""
    report = state.neighbours.get(other)
    other_may_change = report is None or (report.state.phase == Phase.FLYING and _acknowledges(state, report))
    return gives_way_to((True, state.task.uav), (other_may_change, other))


def _acknowledges(state: AgentState, other: NeighbourReport) -> bool:
    """Return whether another vehicle acknowledges this vehicle's state."""
    return state.task.uav in other.state.hears


def _give_way(state: AgentState, to_avoid: Sequence[ProximityAlarm]) -> StepResult:
    rules = state.task.separation
    if not may_give_way(state) or not to_avoid:
        return state, []
    hold, others = hold_trajectory(state), predictions(state)
    blocked = (
        {alarm.other for alarm in update_alarms((), hold, others, rules, state.vehicle.time_boot_s)}
        if hold
        else set()
    )
    # A fixed wing would circle in hold, so it climbs.
    if rules.action == "hold" and not blocked and state.task.wings is None:
        # The vehicle has no route while it holds, and plans a new route when its old route is clear.
        now_s, n, reports = state.vehicle.time_boot_s, state.n_holds + 1, state.neighbours
        to = {alarm.other: reports[alarm.other] for alarm in to_avoid if alarm.other in reports}
        give_way = replace(state.give_way, plan=state.route, to=to, since_boot_s=now_s)
        return command(state, ev.FlightOrder.HOLD, give_way=give_way, n_holds=n, route=None)
    return _climb(state, others), []


def may_give_way(state: AgentState) -> bool:
    """Return whether the vehicle can give way: it flies its mission, not far below cruise height."""
    vehicle, task = state.vehicle, state.task
    if state.task.separation.action == "none" or state.phase is not Phase.FLYING or state.route is None:
        return False
    least_m = task.altitude_m - 2.0 * task.separation.limits.vertical_m
    return not state.lost and vehicle.alt_rel_m is not None and vehicle.alt_rel_m >= least_m


def _climb(state: AgentState, others: dict[int, Trajectory]) -> AgentState:
    """Request a new plan at a height clear of all nearby vehicles, if there is one below the ceiling."""
    now_s, here_m = state.vehicle.time_boot_s, state.vehicle.alt_rel_m or 0.0
    heights_m = [at[2] for path in others.values() if (at := path.at(now_s)) is not None]
    height_m = clear_height_m(max(here_m, state.height_m), heights_m, state.task.separation.limits)
    if not state.height_m < height_m <= ceiling_m(state):
        return state
    state = replace(state, height_offset_m=height_m - state.task.altitude_m, n_climbs=state.n_climbs + 1)
    return replace(state, dirty=True, must_change=True)


def ceiling_m(state: AgentState) -> float:
    """Return the greatest height above home for an evasive climb [m]."""
    fence = state.task.fence
    return math.inf if fence is None else fence.ceiling_m - CEILING_MARGIN_M


def _resume_if_clear(state: AgentState, own: Trajectory) -> StepResult:
    """Resume with a new plan if the route is clear; otherwise hold, or try another height."""
    now_s = state.vehicle.time_boot_s
    if now_s < state.give_way.earliest_end_boot_s:
        return state, []
    others = predictions(state)
    waits = any(_has_to_give_way(state, alarm.other) for alarm in state.alarms)
    if not waits and _is_clear(state, own, others) and not _passes_silent(state):
        text = "the interrupted route is clear of other vehicles; the vehicle holds until it has a new plan"
        return _resume(state, f"{text} [resumes]")
    if now_s - state.give_way.since_boot_s < RETRY_HEIGHT_AFTER_S:
        return state, []
    return _resume_above(state, others)


def _is_clear(state: AgentState, own: Trajectory, others: dict[int, Trajectory]) -> bool:
    limits = state.task.separation.limits
    starts = [own.later(seconds) for seconds in RESUME_AFTER_S]
    return not any(
        intervals(path, other, limits)
        and (_has_to_give_way(state, uav) or not _get_no_closer(path, other, limits))
        for path in starts
        for uav, other in others.items()
    )


def _get_no_closer(path: Trajectory, other: Trajectory, limits: Limits) -> bool:
    """Return whether two vehicles are already too close, and get no closer.

    Then the route counts as clear. Otherwise neither vehicle would ever resume its route.
    """
    here, there = path.at(path.times_s[0]), other.at(path.times_s[0])
    at = closest(path, other, limits)
    if at is None or here is None or there is None:
        return False
    beside = math.dist(here[:2], there[:2]) / limits.horizontal_m
    above = abs(here[2] - there[2]) / limits.vertical_m
    now = max(beside, above)
    # Heights have a tolerance; horizontal positions count as reported.
    tolerance = min(HEIGHT_TOLERANCE_M / limits.vertical_m, MAX_TOLERANCE_SHARE) if above >= beside else 1e-6
    least = limits.share(at.horizontal_m, at.vertical_m)
    return now < 1.0 + tolerance and least >= min(now, 1.0) - tolerance


def least_share(flight: Trajectory, other: Trajectory, limits: Limits) -> float | None:
    """Return the least distance of two flights, as a share of the limits; None if they share no time."""
    at = closest(flight, other, limits)
    return None if at is None else limits.share(at.horizontal_m, at.vertical_m)


def _passes_silent(state: AgentState) -> bool:
    """Return whether the route passes the last position of a silent vehicle to which this one gives way."""
    own, limits = own_trajectory(state, SILENT_S), state.task.separation.limits
    return own is not None and any(
        intervals(own, there, limits) for there in silent_neighbours(state).values()
    )


def _resume(state: AgentState, text: str) -> StepResult:
    # After a deferred plan, `route_deconfliction` reports when the new plan is clear.
    messages: list[ev.Effect] = [] if state.conflicts.deferred_for else [ev.NotifyOperator(text)]
    state = replace(
        state,
        give_way=replace(state.give_way, plan=None),
        order=state.order.noted(ev.FlightOrder.LAUNCH).followed(),
        hold_is_own=True,
        dirty=True,
    )
    return state, messages


def _resume_above(state: AgentState, others: dict[int, Trajectory]) -> StepResult:
    """Resume above the other vehicles if that height is clear; otherwise continue to hold."""
    assert state.give_way.plan is not None
    here, higher = position_of(state), _climb(state, others)
    plan = at_height(state.give_way.plan.plan, higher.height_m)
    if here is not None and state.task.wings is None:
        progress = state.progress_on(state.give_way.plan)
        n_passed = 0 if progress is None else progress.waypoint
        begins = Waypoint(*state.task.grid.frame.to_geodetic(*here[:2]), here[2])
        plan = replace(plan, track=plan.track[n_passed:], begins=begins)
        plan = with_level_off(state.task, plan, here, 0.0)
    interrupted = msgspec.structs.replace(state.give_way.plan, plan=plan)
    higher = replace(higher, give_way=replace(higher.give_way, plan=interrupted))
    own = own_trajectory(higher)
    text, now_s = f"the vehicle has held for at least {RETRY_HEIGHT_AFTER_S:.0f} s", state.vehicle.time_boot_s
    clear = own is not None and _is_clear(higher, own, others) and not _passes_silent(higher)
    if higher.height_m > state.height_m and clear:
        reported = replace(higher.give_way, since_boot_s=now_s)
        higher = replace(
            higher, give_way=reported, conflicts=replace(higher.conflicts, deferred_for=frozenset())
        )
        height = f"{higher.height_m:.0f} m, above the other vehicles"
        return _resume(higher, f"{text}; it resumes its route at {height} [resumes-higher]")
    return replace(state, give_way=replace(state.give_way, since_boot_s=now_s)), [
        ev.NotifyOperator(f"{text}; no height found is clear, so it continues to hold [keeps-holding]")
    ]


def _alarm_text(state: AgentState, alarm: ProximityAlarm) -> str:
    at, limits = alarm.approach, state.task.separation.limits
    in_s = max(at.t_s - state.vehicle.time_boot_s, 0.0)
    # Rounded down, so that a distance below its limit never looks equal to the limit.
    horizontal_m, vertical_m = math.floor(at.horizontal_m), math.floor(10.0 * at.vertical_m) / 10.0
    return (
        f"this vehicle is predicted to come too close to vehicle {alarm.other} in {in_s:.0f} s "
        f"({horizontal_m} m horizontally, limit {limits.horizontal_m:g} m; "
        f"{vertical_m:.1f} m vertically, limit {limits.vertical_m:g} m)"
    )


def _reaction(state: AgentState, alarm: ProximityAlarm) -> str:
    if state.task.separation.action == "none":
        return "; separation.action is none, so order one vehicle to hold [alarm]"
    if not _has_to_give_way(state, alarm.other):
        return f"; vehicle {alarm.other} gives way [alarm-other-yields]"
    if not (may_give_way(state) or state.give_way.plan):
        advice = f"if vehicle {alarm.other} does not give way, order vehicle {alarm.other} to hold"
        return f"; this vehicle cannot give way now; {advice} [alarm-cannot-yield]"
    action = "continues to hold" if state.give_way.plan else "gives way"
    report = state.neighbours.get(alarm.other)
    acknowledges = report is None or report.state.phase != Phase.FLYING or _acknowledges(state, report)
    if acknowledges or gives_way_by_id(state.task.uav, alarm.other):
        return f"; this vehicle {action} [alarm-yields]"
    cause = f"vehicle {alarm.other} does not acknowledge receiving its state"
    return f"; this vehicle {action}, because {cause} [alarm-not-heard]"
