"""A new start of the agent's program while its vehicle flies. Pure.

The state comes from the record of the earlier program. The fold of `Restarted` makes it fit for the new
program; the events after it tell how a mission change, an order or a launch has ended.
"""

from __future__ import annotations

import math

from swarmctl.agent.commands import StepResult, release_vehicle
from swarmctl.agent.phases import ON_GROUND, Phase
from swarmctl.agent.state import AgentState
from swarmctl.core import events as ev
from swarmctl.core.records import replace
from swarmctl.core.vehicle import VehicleState


def restart(state: AgentState, event: ev.Restarted, now: float) -> StepResult:
    """Continue the flight, release the vehicle, or prepare a vehicle on the ground again."""
    state = _on_new_clock(state, now)
    if state.ended:
        return state, []
    if event.reason:
        return release_vehicle(state, event.reason)
    if event.on_ground and (state.phase in ON_GROUND or state.phase is Phase.LAUNCHING):
        return state.enter(
            Phase.WAITING,
            vehicle=VehicleState(),
            last_position=VehicleState(),
            plans=state.plans.forgotten(),
            order=replace(
                state.order,
                given=None if state.order.given is ev.FlightOrder.LAUNCH else state.order.given,
            ),
            launch=state.launch.withdrawn().not_begun(),
        ), []
    if event.lands and state.phase in (Phase.LAUNCHING, Phase.FLYING):
        # It has passed its goal cell unseen. The time of its arrival is unknown.
        return state.enter(Phase.LANDING, plans=state.plans.not_due()).with_new_flight(), []
    return state, []


def _on_new_clock(state: AgentState, now: float) -> AgentState:
    """Return the state with all times by the run's clock reset.

    The new program's clock may have another origin. Memories of failsafe rules hold such times; they stay
    valid if the clock went on, as on the same machine.
    """
    last_s = state.vehicle.heartbeat_s
    if last_s is not None and now < last_s:
        state = replace(state, memories=())
    return replace(
        state,
        plans=state.plans.not_before(-math.inf),
        order=state.order.repeated(math.inf),
        disarmed_since_s=None,
    )
