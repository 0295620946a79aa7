"""Flights by mission: progress, refusals, speed, fence."""

from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, missions, parameters, plans
from sim_vehicle.conformance.assertions import Skip, equal, holds, near
from sim_vehicle.conformance.checks.fence import fence_in_force, polygon
from sim_vehicle.conformance.guard import ARM
from sim_vehicle.conformance.plans import FENCE
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.messages import PlanItem

FLY_S = 300.0  # time limit of a check
PASS_M = 4.0  # a waypoint within this distance counts as passed
_ground_check = partial(check, needs=[ARM], kind="copter", limit_s=FLY_S)
_ardupilot_check = partial(check, needs=[ARM], kind="copter", dialects=("ardupilot",), limit_s=FLY_S)
_air_check = partial(check, airborne=True, kind="copter", limit_s=FLY_S)


@_ground_check("mission-flight.flies_every_item", source="AUTOPILOTS 1.7")
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

    took_s = vehicle.wait_until(done, "landed and disarmed", FLY_S - 30)
    equal(len(heights_m), len(targets), f"waypoints passed in order within {PASS_M:g} m")
    for height_m in heights_m:
        near(height_m, missions.HEIGHT_M, 2.0, "height at a waypoint [m]")
    off_m = flying.distance_to_m(vehicle, targets[-1])
    holds(off_m < 4, f"the vehicle landed {off_m:.1f} m from the last waypoint")
    reached = [m.seq for m in vehicle.since(mark, "MISSION_ITEM_REACHED")]
    first = missions.first_waypoint(vehicle)
    waypoints = set(range(first, first + len(missions.CORNERS)))
    holds(waypoints <= set(reached), f"expected MISSION_ITEM_REACHED {sorted(waypoints)}, saw {reached}")
    equal(reached, sorted(reached), "order of MISSION_ITEM_REACHED")
    return f"{took_s:.0f} s, reached {reached}"


@_air_check("mission-flight.counts_upwards")
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


@_air_check("mission-flight.state_is_active", source="AUTOPILOTS 2: mission_state is 0 always (PX4)")
def state_is_active(vehicle: VehicleUnderTest) -> str:
    """During a mission, mission_state is ACTIVE on ArduPilot and 0 on PX4."""
    expected = vehicle.known(ardupilot=mavlink.MISSION_STATE_ACTIVE, px4=0)
    missions.under_way(vehicle)
    vehicle.wait(1.0)
    equal(vehicle.last["MISSION_CURRENT"].message.mission_state, expected, "mission_state")
    return str(expected)


@_ardupilot_check(
    "mission-flight.after_landing",
    source="AUTOPILOTS 1.12: after landing+disarm MISSION_CURRENT goes back to seq 0, state 5; "
    "AP_Arming_Copter::disarm resets a mission that is not yet complete, which then begins at 1",
)
def after_landing(vehicle: VehicleUnderTest) -> str:
    """After a landing by mission, MISSION_CURRENT is back at seq 0, COMPLETE (or 1, ACTIVE), in AUTO."""
    place = plans.current_position(vehicle)
    items = plans.takeoff(place, 6.0), plans.waypoint(place, 8, 0, 6.0), plans.land(place, 8, 0)
    plans.upload_or_fail(vehicle, plans.plan(vehicle, *items))
    missions.start(vehicle)
    flying.wait_until_landed(vehicle, 200)
    vehicle.wait(2.0)
    message = vehicle.request("MISSION_CURRENT")
    seen = message.seq, message.mission_state
    expected = (0, mavlink.MISSION_STATE_COMPLETE), (1, mavlink.MISSION_STATE_ACTIVE)
    holds(seen in expected, f"seq, mission_state: expected one of {expected}, saw {seen}")
    equal(vehicle.mode, flying.mode_number(vehicle, "mission"), "mode")
    return f"seq {message.seq}"


@_ardupilot_check("mission-flight.without_takeoff", source="AUTOPILOTS 1.8: Auto: Missing Takeoff Cmd")
def without_takeoff(vehicle: VehicleUnderTest) -> str:
    """An armed vehicle on the ground refuses AUTO, with a text, if the mission has no take-off."""
    place = plans.current_position(vehicle)
    items = plans.waypoint(place, 30, 0), plans.waypoint(place, 30, 30)
    plans.upload_or_fail(vehicle, plans.plan(vehicle, *items))
    flying.arm(vehicle)
    began_s = vehicle.now
    seen = flying.try_mode(vehicle, "mission")
    vehicle.wait(0.5)
    texts = vehicle.texts_since(began_s)
    flying.disarm(vehicle)
    equal(seen, "FAILED", "AUTO")
    holds(any("Missing Takeoff" in text for text in texts), f"expected 'Missing Takeoff Cmd', saw {texts}")
    return "FAILED, Auto: Missing Takeoff Cmd"


@_ardupilot_check(
    "mission-flight.auto_mode_does_not_take_off",
    source="AUTOPILOTS 1.7: Arm + mode AUTO alone does not take off",
)
def auto_mode_does_not_take_off(vehicle: VehicleUnderTest) -> str:
    """An armed vehicle in AUTO stays on the ground and disarms within 25 s."""
    plans.upload_or_fail(vehicle, missions.items(vehicle))
    flying.start_streams(vehicle)
    flying.arm(vehicle)
    flying.set_mode(vehicle, "mission")
    vehicle.wait(5.0)
    holds(flying.height_m(vehicle) < 1.0, f"the vehicle took off: {flying.height_m(vehicle):.1f} m")
    took_s = vehicle.wait_until(lambda: not vehicle.armed, "an automatic disarming", 20)
    return f"disarmed after {took_s + 5:.0f} s"


@_ground_check(
    "mission-flight.starts_when_armed",
    dialects=("px4",),
    source="AUTOPILOTS 2: armed in mission mode it starts by itself",
)
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


@_air_check("mission-flight.speed_item")
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


@_ardupilot_check(
    "mission-flight.fence_breach", source="AUTOPILOTS 2: fence use: fly until the breach -> RTL"
)
def fence_breach(vehicle: VehicleUnderTest) -> str:
    """A mission that leaves the fence is accepted; after the breach the vehicle sends a text and returns."""
    plans.require_type(vehicle, FENCE)
    if not parameters.has(vehicle, "FENCE_ACTION") or parameters.read(vehicle, "FENCE_ACTION").value != 1:
        raise Skip("FENCE_ACTION is not RTL (1)")
    place = plans.current_position(vehicle)
    fence = polygon(vehicle, ((-60, -60), (-60, 60), (60, 60), (60, -60)))
    items = plans.takeoff(place, missions.HEIGHT_M), plans.waypoint(place, 200, 0)
    plans.upload_or_fail(vehicle, plans.plan(vehicle, *items))
    with fence_in_force(vehicle, fence):
        missions.start(vehicle)
        began_s = vehicle.now
        flying.wait_for_mode(vehicle, "return", 120)
        out_m = flying.distance_to_m(vehicle, place)
        vehicle.wait(1.0)
        texts = vehicle.texts_since(began_s)
        holds(any("breached" in text for text in texts), f"expected '... fence breached', saw {texts[-4:]}")
        near(out_m, 60.0, 25.0, "distance from the start [m]")
        flying.set_mode(vehicle, "land")
        flying.wait_until_landed(vehicle, 120)
    return f"RTL at {out_m:.0f} m"


@check("mission-flight.plane_flies_every_item", needs=[ARM], kind="plane", limit_s=500)
def plane_flies_every_item(vehicle: VehicleUnderTest) -> str:
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
    return f"{len(targets)} waypoints"
