"""Changes of a mission in flight: jumps, pauses, clearing, uploads."""

from dataclasses import replace
from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, missions, plans
from sim_vehicle.conformance.assertions import ACCEPTED, equal, holds, near
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.messages import PlanItem

FLY_S = 300.0  # time limit of a check
PASS_M = 4.0  # a waypoint within this distance counts as reached
PAUSE_S, MAX_DRIFT_M = 5.0, 3.0  # length of a pause, and the longest way of a vehicle that stands still
SET_CURRENT = mavlink.MAV_CMD_DO_SET_MISSION_CURRENT
_check = partial(check, airborne=True, kind="copter", limit_s=FLY_S)
_ardupilot_check = partial(check, airborne=True, kind="copter", dialects=("ardupilot",), limit_s=FLY_S)
_px4_check = partial(check, airborne=True, kind="copter", dialects=("px4",), limit_s=FLY_S)


@_check("mission-flight.jump_by_message")
def jump_by_message(vehicle: VehicleUnderTest) -> str:
    """MISSION_SET_CURRENT in flight sends the vehicle back to the previous waypoint."""
    seq = missions.under_way(vehicle)
    item = plans.download(vehicle)[seq - 1]
    flying.set_current(vehicle, seq - 1)
    missions.wait_until_current(vehicle, seq - 1, 5.0)
    took_s = flying.wait_until_near(vehicle, (item.x, item.y), 60, PASS_M)
    return f"item {seq - 1} after {took_s:.0f} s"


@_ardupilot_check("mission-flight.jump_by_command", source="AUTOPILOTS 2: DO_SET_MISSION_CURRENT (224)")
def jump_by_command(vehicle: VehicleUnderTest) -> str:
    """DO_SET_MISSION_CURRENT in flight makes the previous waypoint current."""
    seq = missions.under_way(vehicle)
    vehicle.expect_accepted(SET_CURRENT, seq - 1)
    missions.wait_until_current(vehicle, seq - 1, 3.0)
    return f"item {seq - 1}"


@_check(
    "mission-flight.pause_and_go_on", source="AUTOPILOTS 2: pause/continue (193) ACCEPTED, mission_state 4"
)
def pause_and_go_on(vehicle: VehicleUnderTest) -> str:
    """DO_PAUSE_CONTINUE (ArduPilot) or a change of mode (PX4) stops a mission, and the vehicle then goes on.

    The pause lasts 5 s; afterwards the vehicle reaches the waypoint that was current before the pause.
    """
    by_command = vehicle.known(ardupilot=True, px4=False)
    seq = missions.under_way(vehicle)
    item = plans.download(vehicle)[seq]
    waypoint = item.x, item.y
    result = vehicle.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0)
    equal(result, ACCEPTED if by_command else "UNSUPPORTED", "DO_PAUSE_CONTINUE")
    if not by_command:
        flying.set_mode(vehicle, "hold")
    flying.wait_until_still(vehicle, 15)
    place = flying.last_position(vehicle)
    vehicle.wait(PAUSE_S)
    moved_m = flying.distance_to_m(vehicle, place)
    holds(moved_m < MAX_DRIFT_M, f"expected a standstill for {PAUSE_S:g} s, saw {moved_m:.1f} m flown")
    if by_command:
        state = vehicle.last["MISSION_CURRENT"].message.mission_state
        equal(state, mavlink.MISSION_STATE_PAUSED, "mission_state")
        vehicle.expect_accepted(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 1)
    else:
        flying.set_mode(vehicle, "mission")
    equal(missions.current(vehicle), seq, "current item after the pause")
    took_s = flying.wait_until_near(vehicle, waypoint, 60, PASS_M)
    return f"stood within {moved_m:.1f} m, arrived {took_s:.0f} s later"


@_check("mission-flight.clear_in_flight", source="AUTOPILOTS 2: CLEAR_ALL while flying the mission")
def clear_in_flight(vehicle: VehicleUnderTest) -> str:
    """ArduPilot in AUTO answers MISSION_CLEAR_ALL with ERROR; PX4 accepts the message and holds."""
    expected = vehicle.known(ardupilot="ERROR", px4=ACCEPTED)
    missions.under_way(vehicle)
    seen = plans.clear(vehicle)
    equal(seen, expected, "MISSION_CLEAR_ALL")
    if seen == ACCEPTED:
        flying.wait_for_mode(vehicle, "hold", 5.0)
    else:
        vehicle.wait(2.0)
        equal(vehicle.mode, flying.mode_number(vehicle, "mission"), "mode")
    holds(vehicle.armed, "the vehicle disarmed")
    return seen


@_ardupilot_check(
    "mission-flight.count_zero_in_flight",
    source="AUTOPILOTS 2: COUNT 0 is accepted in AUTO, vehicle then loiters",
)
def count_zero_in_flight(vehicle: VehicleUnderTest) -> str:
    """An empty upload in AUTO is accepted, and the vehicle stops at its height."""
    missions.under_way(vehicle)
    plans.upload_or_fail(vehicle, [])
    vehicle.wait(5.0)
    before_m = flying.height_m(vehicle)
    vehicle.wait(8.0)
    near(flying.height_m(vehicle), before_m, 2.0, "height [m]")
    holds(flying.speed_m_s(vehicle) < 1.0, f"the vehicle moves at {flying.speed_m_s(vehicle):.1f} m/s")
    return "ACCEPTED, loiters"


@_check("mission-flight.upload_in_flight", source="AUTOPILOTS 2: re-upload in AUTO/mission mode")
def upload_in_flight(vehicle: VehicleUnderTest) -> str:
    """An upload in flight is accepted and keeps the current index; the vehicle flies to the new waypoint."""
    vehicle.known(ardupilot=True, px4=True)
    seq = missions.under_way(vehicle)
    place = plans.current_position(vehicle)
    items = [PlanItem(i.command, i.x, i.y, i.z, i.frame) for i in plans.download(vehicle)]
    target = plans.offset(place, -40.0, -30.0)
    items[seq] = replace(items[seq], x=target[0], y=target[1])
    plans.upload_or_fail(vehicle, items)
    vehicle.wait(1.5)
    equal(missions.current(vehicle), seq, "current index")
    took_s = flying.wait_until_near(vehicle, target, 90, PASS_M)
    return f"index {seq} kept, new waypoint after {took_s:.0f} s"


@_px4_check(
    "mission-flight.shorter_upload_in_flight",
    source="AUTOPILOTS 2: shorter mission than the current index: index moved to last item",
)
def shorter_upload(vehicle: VehicleUnderTest) -> str:
    """The upload of a shorter mission in flight makes its last item current, and the vehicle flies there."""
    missions.under_way(vehicle)
    items = missions.items(vehicle, landing=False)[:2]
    target = plans.offset(flying.last_position(vehicle), -40.0, -30.0)
    items[1] = replace(items[1], x=target[0], y=target[1])
    plans.upload_or_fail(vehicle, items)
    missions.wait_until_current(vehicle, len(items) - 1, 5.0)
    took_s = flying.wait_until_near(vehicle, target, 90, PASS_M)
    return f"index {len(items) - 1}, arrived after {took_s:.0f} s"


@_px4_check(
    "mission-flight.abandoned_upload_in_flight",
    source="AUTOPILOTS 2: upload is atomic? Yes: the old mission stays",
)
def abandoned_in_flight(vehicle: VehicleUnderTest) -> str:
    """An abandoned upload in flight does not interrupt the mission."""
    seq = missions.under_way(vehicle)
    mark = vehicle.send(plans.count_message(vehicle, 4))
    plans.next_request(vehicle, mark=mark)
    vehicle.wait(7.0)
    holds(missions.current(vehicle) >= seq, f"expected item {seq} or later, saw {missions.current(vehicle)}")
    equal(vehicle.mode, flying.mode_number(vehicle, "mission"), "mode")
    return f"item {missions.current(vehicle)}"
