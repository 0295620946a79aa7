"""Broadcast the intent: the trajectory that the own vehicle flies from now on. Pure.

| situation | intent is sent |
|---|---|
| a new plan or order, a take-off, or the arrival over the goal | at once |
| the vehicle is off its announced position | at most once a second |
| until the take-off | every second: vehicles with the same order have to know before they arm |
| within 3 s of these, or of the first message of another vehicle | every second: messages are lost |
| without a link: the flight from the last telemetry on | as above |
| otherwise | every 5 s, for late joiners and against losses |

`own_flight` computes the trajectory, `received_intents` stores those of other vehicles.
"""

from __future__ import annotations

import math

import numpy as np

from swarmctl.agent.commands import StepResult
from swarmctl.agent.phases import EN_ROUTE, IN_FLIGHT, Phase
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.own_flight import planned_flight
from swarmctl.agent.traffic.prediction import position_amsl
from swarmctl.agent.traffic.separation.trajectory import (
    Trajectory,
)
from swarmctl.core import events as ev
from swarmctl.core.frames import MAX_AHEAD_S, MAX_POINTS, IntentPoint, IntentShared
from swarmctl.core.records import replace

REPEAT_EVERY_S = 5.0
"""Interval between unchanged intents [s]."""
MIN_INTERVAL_S = 1.0
"""Least interval, while the intent is new, or the vehicle is off its announced position [s]."""
NEW_FOR_S = 3.0
"""Time for which an intent counts as new [s]."""
OWN_TOLERANCE_S, OWN_TOLERANCE_M = 1.0, 3.0
"""Horizontal tolerance of the announced position: the distance flown in this time, and its least value."""
MAX_UNCERTAINTY_M = 60.0
"""Greatest horizontal uncertainty of an announced position [m]."""


def share_intent(state: AgentState) -> StepResult:
    """Send the own intent if it is due. Called for each telemetry, and after each new plan or order."""
    now_s = state.now_boot_s
    if state.ended and state.sent.intent is None:
        return state, []
    if not (state.ended or state.phase in IN_FLIGHT or state.phase is Phase.LAUNCHING):
        return state, []
    since_s = now_s - state.sent.intent_boot_s
    is_new = state.phase is Phase.LAUNCHING or 0.0 <= now_s - state.sent.intent_new_boot_s < NEW_FOR_S
    every_s = MIN_INTERVAL_S if is_new else REPEAT_EVERY_S
    is_due = not 0.0 <= since_s < every_s or state.ended
    if not is_due and (since_s < MIN_INTERVAL_S or not _is_off_intent(state)):
        return state, []
    return publish_intent(state, None if state.ended else planned_flight(state))


def publish_intent(state: AgentState, flight: Trajectory | None) -> StepResult:
    """Send a flight as the own intent; None: the vehicle does not fly."""
    swap = state.plans.pending or state.plans.mission
    message = IntentShared(
        plan_id=0 if swap is None or flight is None else swap.plan_id,
        points=() if flight is None else _points(state, flight),
        may_change=may_change(state),
        around_m=(0.0, 0.0) if flight is None else _uncertainty_m(state),
        on_ground=state.phase is Phase.LAUNCHING,
        age_s=min(state.silent_s, MAX_AHEAD_S),
    )
    sent = replace(state.sent, intent=flight, intent_boot_s=state.now_boot_s)
    return replace(state, sent=sent), [ev.Publish(message)]


def may_change(state: AgentState) -> bool:
    """Return whether the vehicle can change its plan, now or after take-off; False while it waits."""
    is_en_route = state.phase in EN_ROUTE or state.phase is Phase.LAUNCHING
    has_telemetry = state.vehicle.has_position and not state.lost
    return is_en_route and not state.is_waiting and has_telemetry


def _points(state: AgentState, flight: Trajectory) -> tuple[IntentPoint, ...]:
    now_s = state.vehicle.time_boot_s
    ahead = [t - now_s for t in flight.times_s[:MAX_POINTS] if t - now_s <= MAX_AHEAD_S]
    east_m, north_m, up_m = np.array(flight.points[: len(ahead)]).T
    lat_deg, lon_deg = state.task.grid.frame.to_geodetic(east_m, north_m)
    return tuple(map(IntentPoint, ahead, lat_deg.tolist(), lon_deg.tolist(), up_m.tolist()))


def _is_off_intent(state: AgentState) -> bool:
    """Return whether the vehicle is off the position that its last intent announced for now.

    If there is no last intent, the result is True for a vehicle that has a flight to announce.
    """
    intent, here = state.sent.intent, position_amsl(state)
    if intent is None or here is None:
        return intent is None and planned_flight(state) is not None
    at = intent.at(state.vehicle.time_boot_s)
    if at is None:
        return state.phase in IN_FLIGHT
    tolerance_m = max(OWN_TOLERANCE_M, OWN_TOLERANCE_S * state.vehicle.ground_speed_m_s)
    limits = state.task.separation.limits
    return math.dist(at[:2], here[:2]) > tolerance_m or abs(at[2] - here[2]) > limits.vertical_m


def _uncertainty_m(state: AgentState) -> tuple[float, float]:
    last = state.last_position
    if state.vehicle.has_position or last.alt_rel_m is None:
        return 0.0, 0.0
    away_m = last.ground_speed_m_s * (state.vehicle.time_boot_s - last.time_boot_s)
    return min(away_m, MAX_UNCERTAINTY_M), 0.5 * max(last.alt_rel_m, 0.0)
