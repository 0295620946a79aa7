"""Belief updates from the vehicle's own sensor and from other vehicles' observations. Pure."""

from __future__ import annotations

from dataclasses import replace

from swarmctl.agent.orders import StepResult
from swarmctl.agent.state import AgentState
from swarmctl.core import events as ev
from swarmctl.core.observation import MAX_CELLS, BeliefItem, Checkpoint, Observation


def learn_from_sensor(state: AgentState, event: ev.Observed, now: float) -> StepResult:
    # DEVIATION: the paper's UAVs do not sense known cells again. Here a vehicle that sees the contrary of a
    # received observation publishes it: one of the two sensors errs, or a sender lies.
    against = state.belief.contradicted(event.cells)
    new = (*state.belief.uncertain(event.cells), *against)
    effects: list[ev.Effect] = []
    for i in range(0, len(new), MAX_CELLS):
        seen = Observation(state.task.uav, state.next_seq, now, new[i : i + MAX_CELLS], state.incarnation)
        state = _learn(replace(state, next_seq=state.next_seq + 1), (seen,))
        effects.append(ev.Publish(seen, tuple((r, c) for r, c, _ in against)))
    return state, effects


def learn_from_others(state: AgentState, event: ev.ObservationsReceived, _now: float) -> StepResult:
    try:
        return _learn(state, event.items), []
    except ValueError:  # a cell outside the area, or one name with two contents: merge the valid ones singly
        pass
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
    learned = tuple((*t.source, t.upto if isinstance(t, Checkpoint) else t.seq) for t in items)
    return replace(state, belief=belief, dirty=True, because=(*state.because, *learned))
