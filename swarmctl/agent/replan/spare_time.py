"""A vehicle that is early for the others uses its time: for a safer way, or a longer one. Pure."""

from __future__ import annotations

import math
from dataclasses import replace

from swarmctl.agent.arrival.common_time import least_m_s
from swarmctl.agent.replan.length_bounds import TimeBound
from swarmctl.agent.state import AgentState, Phase, Task
from swarmctl.planners import window
from swarmctl.planners.base import Method

EARLY_S = 10.0
"""Who is less early flies slower, and no other way."""
LAST_S = 0.5
"""Who can be there no sooner than that before it is due sets the time for all."""
KEPT_S = 5.0
"""of what it has, for what comes in between: it must not become the last"""
LEAST_EXPOSED = Method("window", window, window.Params())


def is_early(due_s: float, soonest_s: float) -> bool:
    """Whether it could be there so much sooner than it is due that another way may be worth it."""
    return due_s - soonest_s > EARLY_S


def with_spare_time(state: AgentState, task: Task) -> Task:
    """The task of a vehicle that is early: the least exposed way that brings it there when it is due, at a
    speed that it may fly. Its own task where it is not early, or arrives by itself."""
    vehicle, due_s = state.vehicle, state.due_s
    if (
        task.arrival_group is None
        or state.spare_time_due_s is None
        or due_s is None
        or task.wings is not None
    ):
        return task
    if state.phase is not Phase.FLYING:
        return task
    if state.launched_boot_s is None or due_s - KEPT_S <= vehicle.time_boot_s:
        return task
    left_s = due_s - vehicle.time_boot_s
    full_m_s = task.arrival.speed_m_s
    # What it flies at its slowest until it is due takes so long at its fastest.
    least_s = left_s * least_m_s(full_m_s, task.arrival_group.slowest_m_s) / full_m_s
    begun_s = vehicle.time_boot_s - state.launched_boot_s
    arrival = TimeBound(
        full_m_s,
        after_s=begun_s + min(least_s, left_s - KEPT_S),
        within_s=begun_s + left_s - KEPT_S,
        approach_m=task.arrival.approach_m,
    )
    return replace(task, arrival=arrival, method=LEAST_EXPOSED)


def update_spare_time(state: AgentState, due_s: float, soonest_s: float) -> AgentState:
    """With each look at the others: whether it is to plan anew, for it is early, or no more so."""
    wanted = due_s if is_early(due_s, soonest_s) else None
    had = state.spare_time_due_s
    if wanted is None:
        # The way it has taken for that is late enough: it keeps it as long as it is not the last.
        is_last = due_s - soonest_s <= LAST_S and had is not None
        return replace(state, spare_time_due_s=None, dirty=True) if is_last else state
    if had is not None and math.isclose(had, wanted, abs_tol=EARLY_S):
        return state
    return replace(state, spare_time_due_s=wanted, dirty=True)
