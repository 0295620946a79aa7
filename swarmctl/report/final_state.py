"""The final state of each vehicle in words."""

from __future__ import annotations

import math

from swarmctl.agent.own_modes import ROLE_OF_ORDER
from swarmctl.agent.phases import Phase
from swarmctl.agent.state import ARRIVED, AgentState
from swarmctl.agent.touchdown import may_be_armed
from swarmctl.core.vehicle import Landed, VehicleState

HEARTBEATS_END = "heartbeats end now, which may trigger the GCS failsafe"


def is_released_in_air(state: AgentState) -> bool:
    """Return whether the agent gives no more orders to a vehicle that may be armed."""
    return state.ended and may_be_armed(state)


def has_ended_disarmed(state: AgentState) -> bool:
    """Return whether a vehicle has ended its flight and is disarmed."""
    return state.ended and not may_be_armed(state)


def is_lost_in_air(state: AgentState) -> bool:
    """Return whether the link is lost and the vehicle may have been armed at its last telemetry."""
    return state.lost and may_be_armed(state)


def final_phase(state: AgentState) -> str:
    """Return the vehicle's phase, or "lost" for a vehicle that is lost in flight."""
    return "lost" if is_lost_in_air(state) and not state.ended else str(state.phase)


def describe_outcome(state: AgentState) -> str:
    """Return the outcome as text, with the last mode of a released vehicle, and "lost" for a lost vehicle.

    The text names an order that the vehicle has never acknowledged or followed.
    """
    outcome = state.outcome or str(state.phase)
    if is_unacknowledged(state):
        outcome = (
            f"{outcome}; the vehicle never acknowledged the order ({state.order.given}) [not-acknowledged]"
        )
    mode = state.vehicle.mode or "unknown"
    if state.phase is Phase.RELEASED and f"in mode {mode}," not in outcome:
        outcome = f"{outcome}; last in mode {mode}"
    if not state.lost or has_ended_disarmed(state):
        return outcome
    return f"lost; {outcome}" if state.outcome else f"lost; last in mode {mode}"


def is_unacknowledged(state: AgentState) -> bool:
    """Return whether the last order to hold, return or land had no acknowledgement and no effect."""
    is_ordered = state.order.given in ROLE_OF_ORDER and not state.order.is_followed
    return is_ordered and state.phase is not Phase.RELEASED and state.outcome != ARRIVED


def describe_final_state(state: AgentState, vehicle: VehicleState, age_s: float) -> str:
    """Return a line with the final state of a vehicle, so that an operator can recover the vehicle.

    vehicle, age_s: the last telemetry and its age [s], infinite without any
    """
    name = state.task.name
    if age_s == math.inf:
        return f"{name}: no telemetry received"
    if state.lost and not has_ended_disarmed(state):
        where = height_text(vehicle) if may_be_armed(state) else "on the ground, disarmed"
        text = f"{name}: lost, last telemetry {age_s:.0f} s ago in mode {vehicle.mode or '?'}, {where}"
        return f"{text}; the vehicle may still be in the air [lost-in-air]" if may_be_armed(state) else text
    if state.ended and not vehicle.armed and state.outcome:
        return f"{name}: {describe_outcome(state)}{_landed_note(state)}"
    if not vehicle.armed:
        return f"{name}: on the ground, disarmed"
    how = state.outcome or state.trouble or str(state.phase)
    if is_unacknowledged(state):
        how = f"{how}, not confirmed by telemetry"
    mode = vehicle.mode or "?"
    if vehicle.landed is Landed.ON_GROUND:
        return f"{name}: armed on the ground, mode {mode} ({how})"
    return f"{name}: in the air, {height_text(vehicle)}, mode {mode} ({how}); {HEARTBEATS_END} [in-air]"


def _landed_note(state: AgentState) -> str:
    return "; on the ground, disarmed" if state.phase is Phase.RELEASED and state.launch.armed_seen else ""


def height_text(vehicle: VehicleState) -> str:
    """Return the height above home in words."""
    return "at unknown height" if vehicle.alt_rel_m is None else f"{vehicle.alt_rel_m:.0f} m above home"
