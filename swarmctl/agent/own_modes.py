"""Which modes are of an agent's own choosing: any other is somebody's will, and is not fought."""

from __future__ import annotations

from swarmctl.agent.state import ON_GROUND, AgentState, Phase
from swarmctl.core import events as ev

ROLE_OF_ORDER = {ev.FlightOrder.HOLD: "hold", ev.FlightOrder.RETURN: "return", ev.FlightOrder.LAND: "land"}


def own_mode_roles(state: AgentState) -> frozenset[str]:
    """The roles of modes that this agent itself may have put the vehicle in."""
    if state.phase is Phase.WAITING:
        return frozenset({"hold", "mission", "return", "land", "other"})  # a vehicle boots in any mode
    if state.phase in ON_GROUND or state.phase is Phase.LAUNCHING:
        return frozenset({"hold", "mission"})
    if state.ordered in (None, ev.FlightOrder.LAUNCH):
        # A swap may have it hold, and looks itself whether somebody else has.
        in_hold = state.pending is not None or state.hold_is_own
        return frozenset({"mission", "hold"} if in_hold else {"mission"})
    ordered = {ROLE_OF_ORDER[state.ordered]}
    if state.task.wings is not None and state.ordered is not ev.FlightOrder.HOLD:
        # It lands by its mission, whether it is told to or has returned for it. So who puts it into that
        # mode meanwhile is not noticed.
        ordered.add("mission")
    return frozenset(ordered if state.order_followed else ordered | state.previous_own_roles)
