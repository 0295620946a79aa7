"""Flight modes that the agent may have set. A pilot, another station or the autopilot set any other mode."""

from __future__ import annotations

from typing import get_args

from swarmctl.agent.phases import ON_GROUND, Phase
from swarmctl.agent.state import AgentState
from swarmctl.core import events as ev
from swarmctl.core.vehicle import ModeRole

ROLE_OF_ORDER = {ev.FlightOrder.HOLD: "hold", ev.FlightOrder.RETURN: "return", ev.FlightOrder.LAND: "land"}


def own_mode_roles(state: AgentState) -> frozenset[str]:
    """Return the roles of the modes that this agent may have set on the vehicle."""
    if state.phase is Phase.WAITING:
        return frozenset(get_args(ModeRole))  # a vehicle boots in any mode
    if state.phase in ON_GROUND or state.phase is Phase.LAUNCHING:
        return frozenset({"hold", "mission"})
    if state.order.given in (None, ev.FlightOrder.LAUNCH):
        # A swap may set hold. The swap checks for another operator's hold.
        in_hold = state.plans.pending is not None or state.plans.hold_is_own
        return frozenset({"mission", "hold"} if in_hold else {"mission"})
    if state.order.given is ev.FlightOrder.FORMATION:
        # The mode that follows set-points is also the hold mode of an ArduPilot.
        if state.order.is_followed:
            return frozenset({state.membership.setpoint_role})
        return state.order.previous_own_roles | {"setpoints", "hold"}
    ordered = {ROLE_OF_ORDER[state.order.given]}
    if state.task.wings is not None and state.order.given is not ev.FlightOrder.HOLD:
        # A fixed wing lands by its mission, on an order to land and after a return. The agent cannot notice
        # another operator's mission mode during that time.
        ordered.add("mission")
    return frozenset(ordered if state.order.is_followed else ordered | state.order.previous_own_roles)
