"""Flights by mission, and changes of a mission in flight."""

from dataclasses import replace
from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, missions, parameters, plans
from sim_vehicle.conformance.assertions import at_least, at_most, equal, holds, near, one_of
from sim_vehicle.conformance.checks.fence import CLAIMS, fence_in_force, polygon
from sim_vehicle.conformance.guard import ARM
from sim_vehicle.conformance.outcomes import ACCEPTED, Skip
from sim_vehicle.conformance.registry import KNOWN, check
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.messages import PlanItem

FLY_S = 270.0  # longest flight of the mission
PASS_M = 4.0  # a waypoint within this distance counts as passed
PAUSE_S, MAX_DRIFT_M = 5.0, 3.0  # length of a pause, and the longest way of a vehicle that stands still
_ground_check = partial(check, "mission-flight", needs=[ARM], kind="copter")
_ardupilot_check = partial(_ground_check, dialects=("ardupilot",))
_air_check = partial(check, "mission-flight", airborne=True, kind="copter")
_ardupilot_air_check = partial(_air_check, dialects=("ardupilot",))
_px4_air_check = partial(_air_check, dialects=("px4",))


@_ground_check(source="AUTOPILOTS 1.7")
def flies_every_item(vehicle: VehicleUnderTest) -> str:
    """By mission the vehicle takes off, passes the waypoints in order and height, reports them, and lands."""
    items = missions.items(vehicle)
    plans.upload_or_fail(vehicle, items)
    place = plans.current_position(vehicle)
    missions.start(vehicle)
    mark = vehicle.mark()
    targets = [plans.offset(place, n, e) for n, e in missions.CORNERS]
    heights_m: list[float] = []  # of the waypoints passed so far, in their order

    def done() -> bool:
        upcoming = targets[len(heights_m) :]
        if upcoming and flying.distance_to_m(vehicle, upcoming[0]) < PASS_M:
            heights_m.append(flying.height_m(vehicle))
        return not vehicle.armed

    took_s = vehicle.wait_until(done, "landed and disarmed", FLY_S)
    equal(len(heights_m), len(targets), f"waypoints passed in order within {PASS_M:g} m")
    for height_m in heights_m:
        near(height_m, missions.HEIGHT_M, 2.0, "height at a waypoint [m]")
    at_most(flying.distance_to_m(vehicle, targets[-1]), 4, "distance of the landing [m]")
    reached = [m.seq for m in vehicle.since(mark, "MISSION_ITEM_REACHED")]
    first = missions.first_waypoint(vehicle)
    waypoints = set(range(first, first + len(missions.CORNERS)))
    holds(waypoints <= set(reached), f"expected MISSION_ITEM_REACHED {sorted(waypoints)}, saw {reached}")
    equal(reached, sorted(reached), "order of MISSION_ITEM_REACHED")
    return f"{took_s:.0f} s, reached {reached}"


@_air_check()
def counts_upwards(vehicle: VehicleUnderTest) -> str:
    """MISSION_CURRENT does not decrease during a mission."""
    plans.upload_or_fail(vehicle, missions.items(vehicle, landing=False))
    first = missions.first_waypoint(vehicle)
    missions.resume(vehicle, first)
    missions.wait_until_current(vehicle, first, 5.0)
    mark, last = vehicle.mark(), first + len(missions.CORNERS) - 1
    missions.wait_until_current(vehicle, last, 200)
    seen = [m.seq for m in vehicle.since(mark, "MISSION_CURRENT")]
    equal(seen, sorted(seen), "order of MISSION_CURRENT")
    return f"{seen[0]} to {seen[-1]}"


@_air_check(source="AUTOPILOTS 2: mission_state is 0 always (PX4)")
def state_is_active(vehicle: VehicleUnderTest) -> None:
    """During a mission, mission_state is ACTIVE on ArduPilot and 0 on PX4."""
    expected = vehicle.known(ardupilot=mavlink.MISSION_STATE_ACTIVE, px4=0)
    missions.under_way(vehicle)
    vehicle.wait(1.0)
    equal(vehicle.last["MISSION_CURRENT"].mission_state, expected, "mission_state")


@_ardupilot_check(
    source="AUTOPILOTS 1.12: after landing+disarm MISSION_CURRENT goes back to seq 0, state 5; "
    "AP_Arming_Copter::disarm resets a mission that is not yet complete, which then begins at 1",
)
def after_landing(vehicle: VehicleUnderTest) -> str:
    """After a landing by mission, MISSION_CURRENT is back at seq 0, COMPLETE (or 1, ACTIVE), in AUTO."""
    place = plans.current_position(vehicle)
    items = plans.takeoff(place, 6.0), plans.waypoint(place, 8, 0, 6.0), plans.land(place, 8, 0)
    plans.upload_or_fail(vehicle, plans.plan(vehicle, *items))
    missions.start(vehicle)
    flying.wait_until_disarmed(vehicle, 200)
    vehicle.wait(2.0)
    message = vehicle.request("MISSION_CURRENT")
    expected = (0, mavlink.MISSION_STATE_COMPLETE), (1, mavlink.MISSION_STATE_ACTIVE)
    one_of((message.seq, message.mission_state), expected, "seq, mission_state")
    equal(vehicle.mode, flying.mode_number(vehicle, "mission"), "mode")
    return f"seq {message.seq}"


@_ardupilot_check(source="AUTOPILOTS 1.8: Auto: Missing Takeoff Cmd")
def without_takeoff(vehicle: VehicleUnderTest) -> None:
    """An armed vehicle on the ground refuses AUTO, with a text, if the mission has no take-off."""
    place = plans.current_position(vehicle)
    items = plans.waypoint(place, 30, 0), plans.waypoint(place, 30, 30)
    plans.upload_or_fail(vehicle, plans.plan(vehicle, *items))
    flying.arm(vehicle)
    mark = vehicle.mark()
    seen = flying.try_mode(vehicle, "mission")
    vehicle.wait(0.5)
    flying.disarm(vehicle)
    equal(seen, "FAILED", "AUTO")
    vehicle.expect_text("Missing Takeoff", mark)


@_ardupilot_check(source="AUTOPILOTS 1.7: Arm + mode AUTO alone does not take off")
def auto_mode_does_not_take_off(vehicle: VehicleUnderTest) -> str:
    """An armed vehicle in AUTO stays on the ground and disarms within 25 s."""
    plans.upload_or_fail(vehicle, missions.items(vehicle))
    flying.start_streams(vehicle)
    flying.arm(vehicle)
    flying.set_mode(vehicle, "mission")
    vehicle.wait(5.0)
    at_most(flying.height_m(vehicle), 1.0, "height [m]")
    took_s = flying.wait_until_disarmed(vehicle, 20)
    return f"disarmed after {took_s + 5:.0f} s"


@_ground_check(dialects=("px4",), source="AUTOPILOTS 2: armed in mission mode it starts by itself")
def starts_when_armed(vehicle: VehicleUnderTest) -> str:
    """In the mission mode, arming starts the flight."""
    plans.upload_or_fail(vehicle, missions.items(vehicle))
    missions.rewind(vehicle)
    flying.start_streams(vehicle)
    flying.wait_ready(vehicle)
    flying.set_mode(vehicle, "mission")
    vehicle.expect_accepted(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    took_s = flying.wait_until_above(vehicle, 3, 30)
    return f"3 m after {took_s:.0f} s"


@_air_check()
def speed_item(vehicle: VehicleUnderTest) -> str:
    """DO_CHANGE_SPEED in a mission sets the speed of the next leg."""
    place = plans.current_position(vehicle)
    slow = PlanItem(mavlink.MAV_CMD_DO_CHANGE_SPEED, frame=mavlink.MAV_FRAME_MISSION, params=(1, 3, -1, 0))
    first, last = (plans.waypoint(place, north_m, 0, missions.HEIGHT_M) for north_m in (10, 100))
    items = plans.plan(vehicle, plans.takeoff(place, missions.HEIGHT_M), first, slow, last)
    plans.upload_or_fail(vehicle, items)
    missions.resume(vehicle, missions.first_waypoint(vehicle))
    vehicle.wait_until(lambda: flying.distance_to_m(vehicle, place) > 60, "60 m from the start", 100)
    return f"{near(flying.mean_speed_m_s(vehicle, 3.0), 3.0, 0.7, 'mean speed [m/s]'):.2f} m/s"


@_ardupilot_check(claims=CLAIMS, source="AUTOPILOTS 2: fence use: fly until the breach -> RTL")
def fence_breach(vehicle: VehicleUnderTest) -> str:
    """A mission that leaves the fence is accepted; after the breach the vehicle sends a text and returns."""
    if not parameters.has(vehicle, "FENCE_ACTION") or parameters.read(vehicle, "FENCE_ACTION").value != 1:
        raise Skip("FENCE_ACTION is not RTL (1)")
    place = plans.current_position(vehicle)
    fence = polygon(vehicle, ((-60, -60), (-60, 60), (60, 60), (60, -60)))
    items = plans.takeoff(place, missions.HEIGHT_M), plans.waypoint(place, 200, 0)
    plans.upload_or_fail(vehicle, plans.plan(vehicle, *items))
    with fence_in_force(vehicle, fence):
        missions.start(vehicle)
        mark = vehicle.mark()
        flying.wait_for_mode(vehicle, "return", 120)
        out_m = flying.distance_to_m(vehicle, place)
        vehicle.wait(1.0)
        vehicle.expect_text("breached", mark)
        near(out_m, 60.0, 25.0, "distance from the start [m]")
        flying.set_mode(vehicle, "land")
        flying.wait_until_disarmed(vehicle, 120)
    return f"RTL at {out_m:.0f} m"


@check("mission-flight", needs=[ARM], kind="plane")
def plane_flies_every_item(vehicle: VehicleUnderTest) -> None:
    """A plane passes the waypoints of a mission in order and continues to fly."""
    flying.ensure_airborne(vehicle)
    place = flying.home(vehicle)
    corners = ((400.0, 0.0), (400.0, 400.0), (0.0, 400.0))
    targets = [plans.offset(place, n, e) for n, e in corners]
    items = plans.plan(
        vehicle, plans.takeoff(place, 50.0), *[plans.waypoint(place, n, e, 60.0) for n, e in corners]
    )
    plans.upload_or_fail(vehicle, items)
    missions.resume(vehicle, missions.first_waypoint(vehicle))
    for target in targets:
        flying.wait_until_near(vehicle, target, 150, 120.0)
    holds(vehicle.armed and flying.height_m(vehicle) > 20, "the vehicle descended or disarmed")


@_air_check()
def jump_by_message(vehicle: VehicleUnderTest) -> str:
    """MISSION_SET_CURRENT in flight sends the vehicle back to the previous waypoint."""
    seq = missions.under_way(vehicle)
    item = plans.download(vehicle)[seq - 1]
    flying.set_current(vehicle, seq - 1)
    missions.wait_until_current(vehicle, seq - 1, 5.0)
    took_s = flying.wait_until_near(vehicle, (item.x, item.y), 60, PASS_M)
    return f"item {seq - 1} after {took_s:.0f} s"


@_ardupilot_air_check(source="AUTOPILOTS 2: DO_SET_MISSION_CURRENT (224)")
def jump_by_command(vehicle: VehicleUnderTest) -> None:
    """DO_SET_MISSION_CURRENT in flight makes the previous waypoint current."""
    seq = missions.under_way(vehicle)
    vehicle.expect_accepted(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, seq - 1)
    missions.wait_until_current(vehicle, seq - 1, 3.0)


@_air_check(source="AUTOPILOTS 2: pause/continue (193) ACCEPTED, mission_state 4")
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
    moved_m = at_most(flying.distance_to_m(vehicle, place), MAX_DRIFT_M, "metres flown in the pause")
    if by_command:
        state = vehicle.last["MISSION_CURRENT"].mission_state
        equal(state, mavlink.MISSION_STATE_PAUSED, "mission_state")
        vehicle.expect_accepted(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 1)
    else:
        flying.set_mode(vehicle, "mission")
    equal(missions.current(vehicle), seq, "current item after the pause")
    took_s = flying.wait_until_near(vehicle, waypoint, 60, PASS_M)
    return f"stood within {moved_m:.1f} m, arrived {took_s:.0f} s later"


@_air_check(source="AUTOPILOTS 2: CLEAR_ALL while flying the mission")
def clear_in_flight(vehicle: VehicleUnderTest) -> None:
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


@_ardupilot_air_check(source="AUTOPILOTS 2: COUNT 0 is accepted in AUTO, vehicle then loiters")
def count_zero_in_flight(vehicle: VehicleUnderTest) -> None:
    """An empty upload in AUTO is accepted, and the vehicle stops at its height."""
    missions.under_way(vehicle)
    plans.upload_or_fail(vehicle, [])
    vehicle.wait(5.0)
    before_m = flying.height_m(vehicle)
    vehicle.wait(8.0)
    near(flying.height_m(vehicle), before_m, 2.0, "height [m]")
    at_most(flying.speed_m_s(vehicle), 1.0, "speed [m/s]")


@_air_check(dialects=KNOWN, source="AUTOPILOTS 2: re-upload in AUTO/mission mode")
def upload_in_flight(vehicle: VehicleUnderTest) -> str:
    """An upload in flight is accepted and keeps the current index; the vehicle flies to the new waypoint."""
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


@_px4_air_check(source="AUTOPILOTS 2: shorter mission than the current index: index moved to last item")
def shorter_upload_in_flight(vehicle: VehicleUnderTest) -> str:
    """The upload of a shorter mission in flight makes its last item current, and the vehicle flies there."""
    missions.under_way(vehicle)
    items = missions.items(vehicle, landing=False)[:2]
    target = plans.offset(flying.last_position(vehicle), -40.0, -30.0)
    items[1] = replace(items[1], x=target[0], y=target[1])
    plans.upload_or_fail(vehicle, items)
    missions.wait_until_current(vehicle, len(items) - 1, 5.0)
    took_s = flying.wait_until_near(vehicle, target, 90, PASS_M)
    return f"index {len(items) - 1}, arrived after {took_s:.0f} s"


@_px4_air_check(source="AUTOPILOTS 2: upload is atomic? Yes: the old mission stays")
def abandoned_upload_in_flight(vehicle: VehicleUnderTest) -> None:
    """An abandoned upload in flight does not interrupt the mission."""
    seq = missions.under_way(vehicle)
    vehicle.send(plans.count_message(vehicle, 4))
    plans.next_request(vehicle)
    vehicle.wait(7.0)
    at_least(missions.current(vehicle), seq, "current item")
    equal(vehicle.mode, flying.mode_number(vehicle, "mission"), "mode")
