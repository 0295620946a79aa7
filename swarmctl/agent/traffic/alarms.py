"""Alarms by positions, and evasive climbs. Pure.

An alarm predicts that this vehicle and another come too close within `look_ahead_s` (default 10 s). A fixed
wing, which cannot stop, gives way with a climb. So does a copter with `separation.action: climb`. The rule of
`priority` says which vehicle gives way. A vehicle that does not acknowledge this vehicle's state cannot give
way to it. `last_resort` stops a copter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from swarmctl.agent.commands import StepResult
from swarmctl.agent.phases import EN_ROUTE, IN_FLIGHT, Phase
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.last_resort import may_stop
from swarmctl.agent.traffic.own_flight import own_trajectory, reach
from swarmctl.agent.traffic.prediction import (
    hears_nobody,
    home_amsl_m,
    position_of,
    predict,
    predictions,
)
from swarmctl.agent.traffic.priority import Activity, Standing, gives_way, reported_standing
from swarmctl.agent.traffic.route_hold import (
    ceiling_m,
    climbs_to_give_way,
    may_give_way,
    reachable_heights_m,
)
from swarmctl.agent.traffic.separation.trajectory import Bounds
from swarmctl.agent.traffic.separation.watch import (
    ProximityAlarm,
    alarm_bounds,
    clear_height_m,
    update_alarms,
)
from swarmctl.core import events as ev
from swarmctl.core.records import replace


def raise_alarms(state: AgentState) -> StepResult:
    """Update and report the alarms; request a climb if the vehicle gives way by climbing."""
    if not (state.neighbours or state.alarms):
        return state, []
    if state.phase not in IN_FLIGHT:
        return (replace(state, alarms=()) if state.alarms else state), []
    rules, now_s = state.task.separation, state.vehicle.time_boot_s
    if not state.alarms and _is_alone(state):
        return state, []
    before = {alarm.other for alarm in state.alarms}
    own = own_trajectory(state)
    if own is None:
        return replace(state, alarms=()), []
    near = predictions(state, alarm_bounds(Bounds.of(own), rules))
    alarms = update_alarms(state.alarms, own, near, rules, now_s)
    new = [alarm for alarm in alarms if alarm.other not in before]
    if alarms or state.alarms:
        state = replace(state, alarms=alarms, conflicts=state.conflicts.counted(alarms=len(new)))
    messages: list[ev.Effect] = [
        ev.NotifyOperator(f"{_alarm_text(state, alarm)}{_reaction(state, alarm)}") for alarm in new
    ]
    return _climb(state) if _has_to_climb(state, new) else state, messages


def _has_to_climb(state: AgentState, new: Sequence[ProximityAlarm]) -> bool:
    """Return whether the vehicle climbs now: at a new alarm, or if the other cannot give way any more."""
    if not climbs_to_give_way(state) or state.is_waiting or not may_give_way(state) or hears_nobody(state):
        return False
    # These should give way, but may be unable to by now.
    higher_ids = (alarm for alarm in state.alarms if alarm.is_close and alarm.other > state.task.uav)
    return any(_has_to_give_way(state, alarm.other) for alarm in (*new, *higher_ids))


def _is_alone(state: AgentState) -> bool:
    """Return whether no vehicle comes near a copter within the look-ahead time: a quick test by boxes."""
    rules, plans = state.task.separation, state.plans
    follows_plan = state.phase is Phase.FLYING and plans.mission is not None and plans.pending is None
    straight_on_s = 0.0 if follows_plan else rules.look_ahead_s
    box = reach(state, rules.look_ahead_s, straight_on_s) if state.task.wings is None else None
    return box is not None and not predictions(state, alarm_bounds(box, rules))


def _has_to_give_way(state: AgentState, other: int) -> bool:
    """Return whether this vehicle gives way to another, by the rule of priority."""
    report = state.neighbours.get(other)
    theirs = Standing(Activity.EN_ROUTE, True, other)
    if report is not None:
        can_yield = report.state.phase in EN_ROUTE and report.hears(state.task.uav)
        theirs = reported_standing(other, report, can_yield=can_yield)
    return gives_way(Standing(Activity.EN_ROUTE, True, state.task.uav), theirs)


def _climb(state: AgentState) -> AgentState:
    """Request a new plan at a height clear of all nearby vehicles, if there is one below the ceiling."""
    here_m, home_m = state.vehicle.alt_rel_m or 0.0, home_amsl_m(state)
    paths = (predict(state, report) for report in state.neighbours.values())
    heights_m = [at[2] - home_m for path in paths if path and (at := path.at(state.vehicle.time_boot_s))]
    height_m = clear_height_m(max(here_m, state.height_m), heights_m, state.task.separation.limits)
    if not state.height_m < height_m <= min(ceiling_m(state), _reachable_m(state)):
        return state
    return replace(
        state,
        height_offset_m=height_m - state.task.altitude_m,
        conflicts=state.conflicts.counted(climbs=1),
        plans=state.plans.due(must_change=True),
    )


def _reachable_m(state: AgentState) -> float:
    """Return the greatest height that a copter reaches before its landing [m]; without a limit for planes."""
    here, progress = position_of(state), state.progress
    if here is None or progress is None or state.task.wings is not None:
        return math.inf
    return reachable_heights_m(state, here, progress.points_ahead)[1]


def _alarm_text(state: AgentState, alarm: ProximityAlarm) -> str:
    at, limits = alarm.approach, state.task.separation.limits
    in_s = max(at.t_s - state.vehicle.time_boot_s, 0.0)
    # Rounded down, so that a distance below its limit never looks equal to the limit.
    horizontal_m, vertical_m = math.floor(at.horizontal_m), math.floor(10.0 * at.vertical_m) / 10.0
    return (
        f"this vehicle is predicted to come too close to {state.task.name_of(alarm.other)} in {in_s:.0f} s "
        f"({horizontal_m} m horizontally, limit {limits.horizontal_m:g} m; "
        f"{vertical_m:.1f} m vertically, limit {limits.vertical_m:g} m)"
    )


def _reaction(state: AgentState, alarm: ProximityAlarm) -> str:
    other = state.task.name_of(alarm.other)
    if state.task.separation.action == "none":
        return "; separation.action is none, so order one vehicle to hold [alarm]"
    if climbs_to_give_way(state):
        can, does = may_give_way(state), "gives way"
        if not _has_to_give_way(state, alarm.other):
            return f"; {other} gives way [alarm-other-yields]"
    else:
        can, does = may_stop(state), "stops if that is necessary"
    if not (can or state.is_waiting):
        advice = f"if {other} does not give way, order it to hold"
        return f"; this vehicle cannot give way now; {advice} [alarm-cannot-yield]"
    report = state.neighbours.get(alarm.other)
    if report is None or report.state.phase not in EN_ROUTE or report.hears(state.task.uav):
        return f"; this vehicle {does} [alarm-yields]"
    return f"; this vehicle {does}; {other} does not acknowledge receiving its state [alarm-not-heard]"
