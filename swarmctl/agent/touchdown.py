"""End of a flight: the vehicle's disarming, by heartbeats, and the outcome of the flight. Pure."""

from __future__ import annotations

from swarmctl.agent.phases import IN_FLIGHT, Phase
from swarmctl.agent.replan.landing_pattern import ROLL_OUT_M
from swarmctl.agent.state import ARRIVED, AgentState
from swarmctl.core.events import FlightOrder
from swarmctl.core.geo import distance_m
from swarmctl.core.records import replace
from swarmctl.core.vehicle import Landed

DISARMED_FOR_S = 4.0
"""Time of disarmed heartbeats after which a vehicle in the air counts as disarmed [s]: a rebooted ArduPilot
sends its first message with a clock up to 3 s after its first heartbeat."""
AT_HOME_M = 15.0
"""Greatest distance from home at which a returned copter counts as at home [m]."""


def note_disarming(state: AgentState) -> AgentState:
    """Record the time of the first heartbeat that reports the vehicle disarmed."""
    since_s = state.vehicle.heartbeat_s if state.disarmed_since_s is None else state.disarmed_since_s
    disarmed_s = None if state.vehicle.armed else since_s
    return state if disarmed_s == state.disarmed_since_s else replace(state, disarmed_since_s=disarmed_s)


def may_be_armed(state: AgentState) -> bool:
    """Return whether the vehicle is or may be armed.

    Disarmed heartbeats in the air may be wrong, or come from a rebooted vehicle before its new clock. They
    count after DISARMED_FOR_S, or as soon as the vehicle also reports that it is on the ground.
    """
    vehicle, since_s = state.vehicle, state.disarmed_since_s
    now_s = vehicle.heartbeat_s
    is_recent = since_s is not None and now_s is not None and now_s - since_s < DISARMED_FOR_S
    is_uncertain = state.launch.armed_seen and vehicle.landed is not Landed.ON_GROUND and is_recent
    return vehicle.armed or is_uncertain


def has_touched_down(state: AgentState) -> bool:
    """Return whether the flight ends now: the vehicle is disarmed after its launch.

    A released vehicle ends its flight only at its goal; elsewhere the reason for its release stays.
    """
    if not state.launch.armed_seen or may_be_armed(state):
        return False
    return state.phase in IN_FLIGHT or (state.phase is Phase.RELEASED and _is_down_at_goal(state))


def end_at_touchdown(state: AgentState) -> AgentState:
    """Return the state with the outcome of the flight, for a vehicle that has touched down.

    A vehicle that landed at its goal has arrived, whatever order it got last.
    """
    state = replace(state, plans=state.plans.without_upload())
    # A hold that was ordered just above the ground does not prevent the touchdown.
    holds_over_goal = state.phase is Phase.HOLDING and state.arrived_boot_s is not None
    at_goal = state.phase is Phase.LANDING or holds_over_goal
    if _is_down_at_goal(state) or (at_goal and (state.cell in state.task.goals or _rolled_out(state))):
        return state.enter(Phase.DONE, outcome=ARRIVED)
    if state.phase is Phase.LEAVING:
        phase = Phase.FAILED if state.given_up else Phase.DONE
        cause = state.outcome or state.trouble
        return state.enter(phase, outcome=f"{cause}; disarmed{_distance_text(state)}")
    where = f"in cell {state.cell}" if state.cell is not None else "outside the area"
    battery = state.vehicle.battery_percent
    charge = "" if battery is None else f", battery {battery} %"
    mode = state.vehicle.mode or "unknown"
    reason = f"the vehicle disarmed {where}, not at its goal, in mode {mode}{charge} [disarmed-on-the-way]"
    return state.enter(Phase.FAILED, outcome=reason)


def _is_down_at_goal(state: AgentState) -> bool:
    """Return whether the vehicle is on the ground in its goal cell, after a flight."""
    is_down = state.vehicle.landed is Landed.ON_GROUND and not state.launch.is_aborted
    return is_down and state.cell in state.task.goals


def _distance_text(state: AgentState) -> str:
    """Return the distance from home as text for a return that ended elsewhere; "" for other flights."""
    here, home = state.vehicle.lat_lon, state.vehicle.home_lat_lon
    if here is None or home is None or state.order.given is not FlightOrder.RETURN:
        return ""
    away_m = distance_m(here, home)
    at_home_m = AT_HOME_M if state.task.wings is None else ROLL_OUT_M
    return f" {away_m:.0f} m from home" if away_m > at_home_m else ""


def _rolled_out(state: AgentState) -> bool:
    """Return whether a fixed wing is within its roll-out distance of the planned touchdown."""
    here, swap = state.vehicle.lat_lon, state.plans.mission
    if swap is None or swap.plan.approach is None or here is None:
        return False
    touchdown = swap.plan.approach.touchdown
    return distance_m(here, (touchdown.lat_deg, touchdown.lon_deg)) <= ROLL_OUT_M
