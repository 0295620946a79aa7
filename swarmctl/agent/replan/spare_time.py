"""Spare time: a copter that is early for a simultaneous arrival flies a less exposed route. Pure."""

from __future__ import annotations

import math

from swarmctl.agent.arrival.common_time import least_m_s
from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.length_bounds import TimeBound
from swarmctl.agent.state import AgentState, Task
from swarmctl.core.records import replace
from swarmctl.planners import window
from swarmctl.planners.base import Method

MIN_EARLY_S = 10.0
"""Spare time above which a less exposed route is planned [s]; up to it, the vehicle only flies slower."""
LAST_MARGIN_S = 0.5
"""Greatest spare time of the last vehicle [s]; the last vehicle determines the common time."""
RESERVE_S = 5.0
"""Spare time kept for delays [s], so that this vehicle does not become the last vehicle."""
LEAST_EXPOSED = Method("window", window, window.Params())
"""Planning method for the least exposed route."""


def with_spare_time(state: AgentState, task: Task) -> Task:
    """Return the task; for an early copter, replace its method and its time bound.

    The new method finds the least exposed route. The new bound allows routes on which the copter arrives at
    its due time at a permitted speed.
    """
    vehicle, due_s = state.vehicle, state.common_arrival.due_s
    if task.arrival_group is None or state.common_arrival.spare_time_due_s is None or due_s is None:
        return task
    if task.wings is not None or state.phase is not Phase.FLYING:
        return task
    if state.launch.armed_boot_s is None or due_s - RESERVE_S <= vehicle.time_boot_s:
        return task
    remaining_s = due_s - vehicle.time_boot_s
    full_m_s = task.speed_m_s
    # Time at full speed for the distance that the vehicle flies at its least speed until its due time.
    least_s = remaining_s * least_m_s(full_m_s, task.arrival_group.slowest_m_s) / full_m_s
    elapsed_s = vehicle.time_boot_s - state.launch.armed_boot_s
    arrival = TimeBound(
        full_m_s,
        after_s=elapsed_s + min(least_s, remaining_s - RESERVE_S),
        within_s=elapsed_s + remaining_s - RESERVE_S,
        approach_m=task.arrival.approach_m,
    )
    return replace(task, arrival=arrival, method=LEAST_EXPOSED)


def update_spare_time(state: AgentState, due_s: float, soonest_s: float) -> AgentState:
    """Mark the plan dirty if spare time is new, its due time has changed, or the vehicle is the last one."""
    new_due_s = due_s if due_s - soonest_s > MIN_EARLY_S else None
    previous_due_s = state.common_arrival.spare_time_due_s
    if new_due_s is None:
        # The less exposed route uses up the spare time. Only the last vehicle gives this route up.
        is_last = due_s - soonest_s <= LAST_MARGIN_S and previous_due_s is not None
        return _planning_with(state, None) if is_last else state
    if previous_due_s is not None and math.isclose(previous_due_s, new_due_s, abs_tol=MIN_EARLY_S):
        return state
    return _planning_with(state, new_due_s)


def _planning_with(state: AgentState, spare_time_due_s: float | None) -> AgentState:
    arrival = replace(state.common_arrival, spare_time_due_s=spare_time_due_s)
    return replace(state, common_arrival=arrival, plans=state.plans.due())
