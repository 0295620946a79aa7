"""Exchange of knowledge: observations learned and published, and the state broadcast each second. Pure."""

from __future__ import annotations

from swarmctl.agent.arrival.simultaneous import earliest_in_s
from swarmctl.agent.commands import StepResult
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.neighbours import received_neighbours
from swarmctl.agent.traffic.returning import return_target
from swarmctl.core import events as ev
from swarmctl.core.belief import news
from swarmctl.core.frames import MAX_TEXT, StateShared
from swarmctl.core.observation import MAX_CELLS, BeliefItem, Checkpoint, Observation
from swarmctl.core.records import replace

SHARE_STATE_EVERY_S = 1.0


def learn_from_sensor(state: AgentState, event: ev.Observed, now: float) -> StepResult:
    """Merge and publish the own observations that add to the belief or contradict it."""
    # DEVIATION: the paper's UAVs do not sense known cells again. Here a vehicle publishes an observation that
    # contradicts a received observation: a sensor errs, or a sender lies.
    contradicting = state.belief.contradicted(event.cells)
    new = news(state.belief, state.own, event.cells)
    effects: list[ev.Effect] = []
    for i in range(0, len(new), MAX_CELLS):
        seen = Observation(state.task.uav, state.next_seq, now, new[i : i + MAX_CELLS], state.incarnation)
        state = _learn(replace(state, next_seq=state.next_seq + 1), (seen,))
        effects.append(ev.Publish(seen, tuple((r, c) for r, c, _ in contradicting)))
    return state, effects


def learn_from_others(state: AgentState, event: ev.ObservationsReceived, _now: float) -> StepResult:
    """Merge received observations, and count the impossible ones."""
    try:
        return _learn(state, event.items), []
    except ValueError:  # a cell outside the area, or two different observations with one name
        pass  # merge the items one by one
    for item in event.items:
        try:
            state = _learn(state, (item,))
        except ValueError as error:
            state = replace(state, refused=state.refused + 1, trouble=str(error))
    return state, []


def _learn(state: AgentState, items: tuple[BeliefItem, ...]) -> AgentState:
    belief = state.belief.merge(items)
    if belief is state.belief:
        return state
    if state.own is not None:
        seen = [item for item in items if item.observer == state.task.uav]
        state = replace(state, own=state.own.merge(seen))
    learned = tuple((*item.source, item.upto if isinstance(item, Checkpoint) else item.seq) for item in items)
    return replace(state, belief=belief, plans=state.plans.due(learned))


def share_state(state: AgentState) -> StepResult:
    """Publish the vehicle's state once a second, with the last known position and its age."""
    vehicle, last = state.vehicle, state.last_position
    if last.lat_lon is None or last.alt_rel_m is None or last.alt_amsl_m is None:
        return state, []
    # The vehicle's clock restarts at 0 after a reboot.
    elapsed_s = vehicle.time_boot_s - state.sent.state_boot_s
    if 0.0 <= elapsed_s < SHARE_STATE_EVERY_S:
        return state, []
    message = StateShared(
        time_s=vehicle.time_boot_s,
        lat_deg=last.lat_lon[0],
        lon_deg=last.lat_lon[1],
        alt_rel_m=last.alt_rel_m,
        alt_amsl_m=last.alt_amsl_m,
        phase=state.phase,
        n_observed=state.belief.n_observed,
        n_found=state.belief.n_found,
        mode=vehicle.mode[:MAX_TEXT],
        plan_id=0 if state.plans.mission is None else state.plans.mission.plan_id,
        replans=state.plans.replans,
        late_s=state.plans.late_s,
        outcome=state.outcome[:MAX_TEXT],
        trouble=(state.alarm or state.trouble)[:MAX_TEXT],
        earliest_in_s=earliest_in_s(state),
        velocity_m_s=(last.east_m_s, last.north_m_s, last.climb_m_s),
        hears=received_neighbours(state),
        returns_to=return_target(state),
        age_s=max(vehicle.time_boot_s - last.time_boot_s, 0.0)
        + (vehicle.delay_s if state.telemetry_is_late else 0.0)
        + state.silent_s,
        battery_percent=vehicle.battery_percent,
        strikes=vehicle.strikes,
        to_go_m=None if state.progress is None else state.progress.to_last_waypoint_m,
        waits=_waits(state),
        group=state.group[:MAX_TEXT],
        weights=_changed_weights(state),
        hovers=state.task.wings is None,
    )
    return replace(state, sent=replace(state.sent, state_boot_s=vehicle.time_boot_s)), [ev.Publish(message)]


def _waits(state: AgentState) -> str:
    if state.wait is None or not state.wait.is_on:
        return ""
    return state.wait.description(state.now_boot_s, state.task.name_of)[:MAX_TEXT]


def _changed_weights(state: AgentState) -> tuple[float, float, float, float] | None:
    """Return w and the firing strengths if an operator has changed them."""
    if state.w == state.task.w and state.strength == state.task.strength:
        return None
    strength = state.strength
    return state.w, strength.direct, strength.first_neighbour, strength.second_neighbour
