"""The proof that a vehicle still does what its agent last told it to, before a new program takes it over.

Pure: the record, and what was found on the vehicle, decide. Without a proof the vehicle is let go.
"""

from __future__ import annotations

import msgspec

from swarmctl.agent.own_modes import own_mode_roles
from swarmctl.agent.phases import ENDED, ON_GROUND, Phase
from swarmctl.agent.progress import planned_legs
from swarmctl.agent.state import AgentState
from swarmctl.core import events as ev
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.mavlink.events import Identity
from swarmctl.mavlink.procedures.recognise import Recognised
from swarmctl.report.unfinished_run import RecordedVehicle

MAX_OFF_ROUTE_M = 150.0
"""greatest distance of a fixed wing from its route, as in a turn or a circle of its plan"""
SETTLED_S = 3.0
"""time after a mission change from which on the recorded current item is one of the new mission"""


class Finding(msgspec.Struct, frozen=True):
    """The present state of a vehicle, and the result of the read-back."""

    identity: Identity
    state: VehicleState
    unix_s: float
    """wall time of `state`"""
    stored: Recognised
    """result of the read-back; its `plan_id` is None for a mission that is not the program's"""


def candidates(state: AgentState) -> list[int]:
    """Return the numbers of the plans that the vehicle may fly: one being uploaded, or the one before."""
    return list(_possible_missions(state))


def _possible_missions(state: AgentState) -> dict[int, PlannedMission]:
    """Return the missions that the vehicle may fly by the numbers of their plans, the most likely first."""
    missions = (state.plans.pending, state.plans.mission, state.interrupted, state.plans.accepted)
    return {mission.plan_id: mission for mission in missions if mission is not None}


def is_undecided(state: AgentState, vehicle: VehicleState) -> bool:
    """Return whether a launch was interrupted: the vehicle soon takes off, or disarms itself."""
    return state.phase is Phase.LAUNCHING and vehicle.armed and vehicle.landed is Landed.ON_GROUND


def take_over(recorded: RecordedVehicle, found: Finding, speedup: float) -> list[ev.Event]:
    """Return the events with which the agent goes on; after `Restarted` with a reason it lets the vehicle go.

    `speedup` is seconds of the vehicle's clock in one second of the wall clock.
    """
    state, vehicle = recorded.state, found.state
    begins: list[ev.Event] = [ev.LinkRestored(), ev.TelemetryReceived(vehicle)]
    on_ground = not vehicle.armed and vehicle.landed is Landed.ON_GROUND
    if state.phase in ENDED or (on_ground and state.phase in ON_GROUND | {Phase.LAUNCHING}):
        return [ev.Restarted(on_ground), *begins]
    reason = _other_vehicle(recorded, found) or _rebooted(recorded, found, speedup)
    if not on_ground:
        reason = reason or _strange(recorded, found)
    if reason:
        return [ev.Restarted(on_ground, reason=reason), *begins]
    if is_undecided(state, vehicle):
        # An order during a launch ends the launch: the vehicle is disarmed.
        return [ev.Restarted(), *begins, ev.OperatorCommand(ev.FlightOrder.HOLD)]
    lands = found.stored.lands and vehicle.mode_role == "mission"
    events: list[ev.Event] = [ev.Restarted(on_ground, lands), ev.LinkRestored()]
    if state.plans.pending is not None:
        events.append(_end_of_swap(state.plans.pending.plan_id, found))
    if state.phase is Phase.LAUNCHING:
        events.append(ev.OrderDone(ev.FlightOrder.LAUNCH))
    if state.order.given is ev.FlightOrder.FORMATION and not state.order.is_followed:
        events.append(
            ev.OrderFailed(ev.FlightOrder.FORMATION, "the program died while the vehicle joined its group")
        )
    return [*events, ev.TelemetryReceived(vehicle)]


def _end_of_swap(plan_id: int, found: Finding) -> ev.Event:
    if found.stored.plan_id == plan_id:
        return ev.MissionAccepted(plan_id)
    flying: ev.PlanAfterFailure = "hold" if found.state.mode_role == "hold" else "old"
    return ev.MissionFailed(plan_id, flying, "the program died during the mission change")


def _other_vehicle(recorded: RecordedVehicle, found: Finding) -> str:
    expected, answers = (
        (recorded.firmware, recorded.uid2),
        (found.identity.firmware, found.identity.uid2.hex()),
    )
    if not recorded.firmware:
        return "the record has no identity of the vehicle"
    if expected != answers:
        return (
            f"another vehicle answers: expected {expected[0]}, uid {expected[1]}, found {answers[0]}, "
            f"uid {answers[1]}"
        )
    return ""


def _rebooted(recorded: RecordedVehicle, found: Finding, speedup: float) -> str:
    """Return a reason if the vehicle's clock did not run on.

    Without a reboot the clock has advanced by the time since the last telemetry; after a reboot it shows less
    than this time. Half of the last reading separates the two, whatever the wall clock did meanwhile.
    """
    before_s, now_s = recorded.state.vehicle.time_boot_s, found.state.time_boot_s
    elapsed_s = max(found.unix_s - recorded.last_unix_s, 0.0) * speedup
    if now_s < before_s or now_s < elapsed_s + before_s / 2.0:
        return (
            f"the vehicle has rebooted: {elapsed_s:.0f} s after its clock showed {before_s:.0f} s, it shows "
            f"{now_s:.0f} s"
        )
    return ""


def _strange(recorded: RecordedVehicle, found: Finding) -> str:
    """Return what shows that another party has changed mode, mission or flight of a vehicle in the air."""
    state, vehicle = recorded.state, found.state
    if state.phase in ON_GROUND:
        if not vehicle.armed:
            return f"the vehicle does not report that it is on the ground, in mode {vehicle.mode}"
        return f"another operator has armed the vehicle, in mode {vehicle.mode}"
    if not vehicle.armed:
        return ""  # landed, by its own report in a moment
    own = own_mode_roles(state)
    if vehicle.mode_role not in own:
        return f"the vehicle is in mode {vehicle.mode}, which this program has not ordered"
    if vehicle.mode_role == "hold" and not _holds_by_command(recorded, found):
        return f"the vehicle is in mode {vehicle.mode}, and the record does not show that this program set it"
    if vehicle.mode_role != "mission":
        return ""
    if found.stored.plan_id is None:
        return f"the vehicle flies another mission than recorded: {found.stored.difference}"
    return "" if is_undecided(state, vehicle) else _off_plan(state, found)


def _holds_by_command(recorded: RecordedVehicle, found: Finding) -> bool:
    was_holding = recorded.state.vehicle.mode_role == "hold"
    params = found.stored.hold_params
    return was_holding or (bool(params) and recorded.mode_params[: len(params)] == params)


def _off_plan(state: AgentState, found: Finding) -> str:
    """Return what shows that a vehicle in mission mode was moved off its plan, or back on it."""
    vehicle, task = found.state, state.task
    assert found.stored.plan_id is not None
    plan = _possible_missions(state)[found.stored.plan_id].plan
    home = vehicle.takeoff_lat_lon if vehicle.home_lat_deg is not None else state.vehicle.takeoff_lat_lon
    assert vehicle.lat_deg is not None
    assert vehicle.lon_deg is not None
    here = task.grid.frame.to_local(vehicle.lat_deg, vehicle.lon_deg)
    off_m = planned_legs(task.grid, plan, home).locate(here).cross_track_m
    limit_m = task.grid.cell_size_m if task.wings is None else max(MAX_OFF_ROUTE_M, task.grid.cell_size_m)
    if off_m > limit_m:
        return f"the vehicle is {off_m:.0f} m off its route, more than {limit_m:.0f} m"
    before = state.vehicle
    is_settled = (
        before.time_boot_s - state.plans.swaps.done_boot_s > SETTLED_S and state.plans.pending is None
    )
    if task.wings is not None or not is_settled or before.mission_seq is None or vehicle.mission_seq is None:
        return ""
    if vehicle.mission_seq < before.mission_seq:
        return (
            f"the vehicle went back from item {before.mission_seq} of its mission to item "
            f"{vehicle.mission_seq}"
        )
    return ""
