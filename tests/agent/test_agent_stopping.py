"""Stories of a vehicle that brakes to a stop before it flies a new plan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import pytest
from agent_stories import GRID, Story, publications
from flown_legs import START_LOSS_S
from hypothesis import example, given
from hypothesis import strategies as st

from swarmctl.agent.arrival.common_time import ArrivalGroup
from swarmctl.agent.commands import RETRY_AFTER_S
from swarmctl.agent.replan.climb import CLIMB_M_S
from swarmctl.agent.replan.copter_trajectory import FlightPart, fly_along, fly_through_change, land_from
from swarmctl.agent.replan.stopping import MissionChange
from swarmctl.agent.replan.travel_time import ACCELERATION_M_S2, timed_track
from swarmctl.agent.traffic.own_flight import planned_flight
from swarmctl.agent.traffic.separation.trajectory import Trajectory, brake
from swarmctl.core import events as ev
from swarmctl.core.frames import IntentShared, StateShared
from swarmctl.core.planar import PlanarPoint
from swarmctl.core.vehicle import BRAKING_M_S2
from swarmctl.mavlink.dialects import dialect_for
from swarmctl.mavlink.telemetry.vehicle_state import Telemetry

ROW_M = GRID.centre_m((4, 4))[1]
STOP_COST_S = 10.0 / (2.0 * 2.5) + START_LOSS_S
"""Time lost by braking from 10 m/s at 2.5 m/s² and by speeding up again [s]."""
DELAY_S = 1.9
"""Delay of a start from a stand [s]."""


class StopStory(Story):
    """A flight east along row 4 at 10 m/s; with `brakes_m_s2=None` the vehicle turns without a stop."""

    def __init__(self, brakes_m_s2: float | None, **changes: Any) -> None:
        super().__init__(**{"arrival_group": ArrivalGroup({1: 0, 2: 1}), **changes})
        self.flying()
        self.brakes_m_s2 = brakes_m_s2
        self.at(75.0)

    def at(self, east_m: float, speed_m_s: float = 10.0, **changes: Any) -> list[ev.Effect]:
        moves = {"ground_speed_m_s": speed_m_s, "east_m_s": speed_m_s, "brakes_m_s2": self.brakes_m_s2}
        return super().at(east_m, **{**moves, **changes})

    def new_plan(self) -> list[ev.Effect]:
        """Report a hostile ahead on the row."""
        self.hear((4, 6, True), observer=9)
        return self.tick()

    def accept_plan(self) -> None:
        assert self.state.plans.pending is not None
        self(ev.MissionAccepted(self.state.plans.pending.plan_id, 0.5, 0.0))


def published_intent(effects: list[ev.Effect]) -> IntentShared:
    (intent,) = publications(effects, IntentShared)
    return intent


def lands_in_s(intent: IntentShared) -> float:
    """Return the time until the descent at the goal [s]."""
    return next(a.in_s for a, b in pairwise(intent.points) if b.alt_amsl_m < a.alt_amsl_m)


def flight(intent: IntentShared) -> Trajectory:
    points = tuple((*GRID.frame.to_local(p.lat_deg, p.lon_deg), p.alt_amsl_m) for p in intent.points)
    return Trajectory(tuple(p.in_s for p in intent.points), points)


def earliest_in_s(effects: list[ev.Effect]) -> float:
    (message,) = publications(effects, StateShared)
    assert message.earliest_in_s is not None
    return message.earliest_in_s


def test_the_intent_of_a_new_plan_is_later_by_the_cost_of_the_stop() -> None:
    brakes, turns = published_intent(StopStory(2.5).new_plan()), published_intent(StopStory(None).new_plan())
    assert lands_in_s(brakes) == pytest.approx(lands_in_s(turns) + STOP_COST_S, abs=0.1)


def test_the_intent_before_a_swap_flies_on_and_then_brakes_to_a_stop() -> None:
    story = StopStory(2.5)
    on_s = story.state.plans.swap_times.likely_s
    path = flight(published_intent(story.new_plan()))
    at = path.times_s.index
    assert path.points[at(on_s)] == pytest.approx((75.0 + 10.0 * on_s, ROW_M, 330.0), abs=0.01)
    stop = path.points[at(on_s + 4.0)]
    assert stop == pytest.approx((75.0 + 10.0 * on_s + 20.0, ROW_M, 330.0), abs=0.01)


def landing_delay_s(*stories: Story) -> float:
    """Return the difference between the landing times of the two vehicles [s]."""
    lands_s = []
    for story in stories:
        path = planned_flight(story.state)
        assert path is not None
        lands_s.append(path.times_s[-1])
    return lands_s[0] - lands_s[1]


def pair(**changes: Any) -> tuple[StopStory, StopStory]:
    """Return a vehicle that brakes and one that does not, each with a pending plan."""
    stories = StopStory(2.5, **changes), StopStory(None, **changes)
    for story in stories:
        story.new_plan()
    return stories


def test_the_stop_stays_ahead_while_the_plan_is_pending() -> None:
    stories = pair()
    for east_m in (85.0, 95.0, 105.0):
        for story in stories:
            story.at(east_m)
        # A leg that begins at the stop is shorter, and so a little slower.
        assert STOP_COST_S - 0.1 < landing_delay_s(*stories) < STOP_COST_S + 0.6


def test_the_intent_continues_the_braking_and_then_speeds_up_from_the_stop() -> None:
    stories = pair()
    for story in stories:
        story.at(85.0, 7.5)
        story.accept_plan()
    # 3 s for 11.25 m, and 3.9 s lost by speeding up from a stop; 0.125 s from 7.5 m/s.
    assert landing_delay_s(*stories) == pytest.approx(3.0 - 1.125 + START_LOSS_S - 0.125, abs=0.1)
    for story in stories:
        story.at(98.0, 2.0, time_boot_s=story.state.plans.swaps.done_boot_s + 3.1)
    assert landing_delay_s(*stories) == pytest.approx(0.0, abs=1e-6)


def test_a_plan_that_is_sent_during_a_stop_is_announced_from_this_stop_on() -> None:
    story = StopStory(2.5)
    story.new_plan()
    story.at(85.0)
    story.accept_plan()
    story.at(94.0, 7.5)
    assert story.state.plans.mission is not None
    ahead = next(cell for cell in story.state.plans.mission.cells if cell[1] > 6)
    story.hear((*ahead, True), observer=9, seq=2)
    effects = story.tick()
    assert story.state.plans.pending is not None
    assert flight(published_intent(effects)).at(3.0) == pytest.approx((94.0 + 11.25, ROW_M, 330.0), abs=0.1)


HOME_LAT_DEG, HOME_LON_DEG = GRID.frame.to_geodetic(-50.0, ROW_M)
HOME = {"home_lat_deg": HOME_LAT_DEG, "home_lon_deg": HOME_LON_DEG}
"""125 m behind the vehicle"""


@pytest.mark.parametrize("order", [ev.FlightOrder.RETURN, ev.FlightOrder.LAND])
def test_an_ordered_return_or_landing_begins_with_a_stop_straight_ahead(order: ev.FlightOrder) -> None:
    story = StopStory(2.5)
    story.at(75.0, **HOME)
    story(ev.OperatorCommand(order))
    path, stops_s = planned_flight(story.state), 10.0 / BRAKING_M_S2
    assert path is not None
    stop = path.at(story.state.vehicle.time_boot_s + stops_s)
    assert stop == pytest.approx((75.0 + 0.5 * 10.0 * stops_s, ROW_M, 330.0), abs=0.1)


def test_a_vehicle_that_flies_home_is_announced_at_its_speed() -> None:
    story = StopStory(2.5)
    story.at(75.0, **HOME)
    story(ev.OperatorCommand(ev.FlightOrder.RETURN))
    story.at(75.0, -10.0, ground_speed_m_s=10.0, **HOME)
    path = planned_flight(story.state)
    assert path is not None
    at = path.at(story.state.vehicle.time_boot_s + 2.0)
    assert at == pytest.approx((55.0, ROW_M, 330.0), abs=0.5)


def test_a_failed_swap_adds_no_stop_to_the_intent() -> None:
    stories = pair()
    for story in stories:
        assert story.state.plans.pending is not None
        story(ev.MissionFailed(story.state.plans.pending.plan_id, "old", "refused"))
        story.at(85.0)
    assert landing_delay_s(*stories) == 0.0


def test_the_earliest_arrival_includes_the_stop() -> None:
    brakes, turns = (story.at(85.0) for story in pair())
    assert earliest_in_s(brakes) == pytest.approx(earliest_in_s(turns) + STOP_COST_S, abs=0.1)


def test_a_holding_vehicle_needs_no_stop() -> None:
    plans = []
    for story in pair():
        assert story.state.plans.pending is not None
        story(ev.MissionFailed(story.state.plans.pending.plan_id, "hold", "not read back"))
        story.now += RETRY_AFTER_S
        story.at(85.0, 0.0, mode_role="hold")
        plans.append(lands_in_s(published_intent(story.tick())))
    assert plans[0] == plans[1]


HERE, EAST = (0.0, 0.0, 30.0), (10.0, 0.0)
"""position and velocity before a mission change"""
FAR: list[PlanarPoint] = [(400.0, 0.0)]


def changing(
    in_s: float,
    present: Sequence[PlanarPoint],
    new: Sequence[PlanarPoint],
    *,
    velocity_m_s: PlanarPoint = EAST,
    brakes_m_s2: float | None = 2.5,
    heights_m: tuple[float, float] = (30.0, 30.0),
    leaves_ahead: bool = False,
) -> Trajectory:
    """Return the flight of a vehicle at HERE with a mission change after `in_s`."""
    change = MissionChange(in_s, 10.0 * in_s, 10.0, brakes_m_s2)
    before, after = FlightPart(heights_m[0], present), FlightPart(heights_m[1], new)
    return fly_through_change(
        HERE, velocity_m_s, before, change, after, 10.0, start_delay_s=DELAY_S, leaves_ahead=leaves_ahead
    )


def test_a_change_after_the_landing_has_no_effect() -> None:
    present = [(60.0, 0.0), (60.0, 30.0)]
    assert changing(30.0, present, FAR) == fly_along(HERE, 30.0, present, 10.0, 10.0, start_delay_s=DELAY_S)


def test_the_vehicle_turns_by_its_present_plan_and_stops_straight_ahead() -> None:
    present = [(100.0, 0.0), (100.0, 400.0)]
    planned, flight = (
        fly_along(HERE, 30.0, present, 10.0, 10.0, start_delay_s=DELAY_S),
        changing(16.0, present, FAR),
    )
    for t in (5.0, 9.0, 12.0, 16.0):
        assert flight.at(t) == pytest.approx(planned.at(t))
    changes_at, stops_at = planned.at(16.0), flight.at(20.0)
    assert changes_at is not None
    assert stops_at == pytest.approx((100.0, changes_at[1] + 20.0, 30.0), abs=0.5)


def test_a_vehicle_flies_back_to_the_waypoint_behind_its_stop() -> None:
    flight = changing(2.0, FAR, [(30.0, 0.0), (30.0, 400.0)])
    stops = flight.points.index((40.0, 0.0, 30.0))
    assert (30.0, 0.0, 30.0) in flight.points[stops:]


def test_a_vehicle_at_a_waypoint_climbs_there_to_the_height_of_its_new_plan() -> None:
    flight = changing(2.0, FAR, [(41.0, 0.0), (141.0, 0.0)], heights_m=(30.0, 45.0))
    climbed_s = next(t for t, point in zip(flight.times_s, flight.points, strict=True) if point[2] == 45.0)
    assert flight.at(climbed_s) == pytest.approx((41.0, 0.0, 45.0))
    assert climbed_s > 15.0 / CLIMB_M_S


@given(up_m=st.floats(0.0, 200.0), boot_s=st.floats(0.0, 1e6))
@example(up_m=math.nextafter(10.0, 11.0), boot_s=214.2)
def test_the_times_of_a_landing_increase_on_every_clock(up_m: float, boot_s: float) -> None:
    landing = land_from([(0.0, 0.0, up_m)], [0.0]).later(boot_s)
    assert all(later > earlier for earlier, later in pairwise(landing.times_s))


@pytest.mark.parametrize(
    ("rise_m", "climbs_s"), [(4.0, 4.0), (25.0, 12.5), (-4.0, 3.0 + 7.0 / 6.0), (-15.0, 11.5)]
)
def test_a_climb_speeds_up_and_slows_down_at_1_m_s2(rise_m: float, climbs_s: float) -> None:
    """At 2.5 m/s up and 1.5 m/s down, the defaults of ArduCopter's WPNAV_SPEED_UP and WPNAV_SPEED_DN."""
    flight = fly_along(
        (0.0, 0.0, 30.0), 30.0 + rise_m, [(4.0, 0.0), (400.0, 0.0)], 10.0, start_delay_s=DELAY_S
    )
    assert flight.at(climbs_s) == pytest.approx((4.0, 0.0, 30.0 + rise_m))


def test_a_vehicle_does_not_fly_back_to_waypoints_of_both_plans_before_the_change() -> None:
    flight = changing(3.0, FAR, [(20.0, 0.0), (100.0, 0.0), (100.0, 50.0)], leaves_ahead=True)
    assert [east_m for east_m, _, _ in flight.points] == sorted(east_m for east_m, _, _ in flight.points)


def test_a_vehicle_that_brakes_now_stops_in_the_direction_of_its_velocity() -> None:
    assert changing(0.0, FAR, FAR, velocity_m_s=(0.0, -10.0)).at(4.0) == (0.0, -20.0, 30.0)


@given(st.floats(0.0, 15.0), st.floats(-1.5, 2.5), st.sampled_from([0.0, 0.75]))
def test_a_stop_follows_the_way_of_a_braking_vehicle(
    speed_m_s: float, climb_m_s: float, reacts_s: float
) -> None:
    flight = brake((0.0, 0.0, 40.0), (0.0, -speed_m_s, climb_m_s), 100.0, reacts_s, 1.75)
    stops_s = max(speed_m_s / 1.75, abs(climb_m_s))
    for twentieths in range(20):
        t = 0.05 * twentieths * stops_s
        at_m_s, up_m_s = (
            max(speed_m_s - 1.75 * t, 0.0),
            math.copysign(max(abs(climb_m_s) - t, 0.0), climb_m_s),
        )
        along_m = reacts_s * speed_m_s + (speed_m_s**2 - at_m_s**2) / 3.5
        rise_m = reacts_s * climb_m_s + math.copysign(climb_m_s**2 - up_m_s**2, climb_m_s) / 2.0
        at = flight.at(100.0 + reacts_s + t) or flight.points[-1]
        assert at == pytest.approx((0.0, -along_m, 40.0 + rise_m), abs=4.1)
    north_m, up_m = reacts_s * speed_m_s + speed_m_s**2 / 3.5, climb_m_s * (reacts_s + abs(climb_m_s) / 2.0)
    assert flight.points[-1] == pytest.approx((0.0, -north_m, 40.0 + up_m), abs=0.2)


@pytest.mark.parametrize("present_m", [24.0, 0.0, 50.0])
def test_until_the_change_the_vehicle_climbs_or_descends_by_its_present_plan(present_m: float) -> None:
    planned = fly_along(HERE, present_m, FAR, 10.0, 10.0, start_delay_s=DELAY_S)
    flight, changes_at = changing(4.0, FAR, FAR, heights_m=(present_m, 70.0)), planned.at(4.0)
    assert flight.at(2.0) == pytest.approx(planned.at(2.0))
    assert changes_at is not None
    assert flight.at(8.0) == pytest.approx((changes_at[0] + 20.0, 0.0, changes_at[2]), abs=0.5)


@pytest.mark.parametrize(
    ("autopilot", "vehicle_type", "brakes_m_s2", "start_delay_s"),
    [(3, 2, 2.5, 1.9), (3, 1, None, 0.0), (12, 2, None, 0.2), (12, 1, None, 0.0)],
)
def test_stops_and_starts_follow_from_the_firmware(
    autopilot: int, vehicle_type: int, brakes_m_s2: float | None, start_delay_s: float
) -> None:
    """Cases: copters and planes of ArduPilot and of PX4."""
    state = Telemetry(dialect_for(autopilot, vehicle_type)).state
    assert (state.brakes_m_s2, state.start_delay_s) == (brakes_m_s2, start_delay_s)


@pytest.mark.parametrize("start_delay_s", [0.2, 1.9])
def test_the_flight_of_a_standing_vehicle_has_the_delay_of_its_start(start_delay_s: float) -> None:
    stories = StopStory(None), StopStory(None)
    for story, delay_s in zip(stories, (start_delay_s, 0.0), strict=True):
        story.at(75.0, 0.0, start_delay_s=delay_s)
    assert landing_delay_s(*stories) == pytest.approx(start_delay_s, abs=0.01)


@pytest.mark.parametrize(("corner_m", "passes"), [(11.0 + 1e-13, 0), (31.0 - 1e-13, 1), (31.001, 1)])
def test_a_corner_on_the_braking_way_is_passed_once(corner_m: float, passes: int) -> None:
    """A vehicle that stops within 3 m of a corner does not fly back to it."""
    present = [(corner_m, 0.0), (corner_m, 400.0)]
    flight = changing(1.1, present, present).later(50_000.0)  # the clock of a vehicle booted long ago
    corners = [at for at in flight.points if at[:2] == pytest.approx((corner_m, 0.0), abs=1e-6)]
    assert len(corners) == passes
    assert flight.times_s[-1] > 50_045.0


@given(
    st.lists(st.tuples(st.floats(-300.0, 300.0), st.floats(-300.0, 300.0)), min_size=1, max_size=6),
    st.floats(1.0, 20.0),
    st.floats(0.0, 1.0),
)
@example([(2.0, 0.0)], 10.0, 1.0)
def test_a_timed_track_keeps_order_and_speed(path: list[PlanarPoint], speed_m_s: float, share: float) -> None:
    track = timed_track([(0.0, 0.0), *path], speed_m_s, initial_m_s=share * speed_m_s, start_delay_s=DELAY_S)
    for (a, b), (begin_s, end_s) in zip(pairwise(track.points), pairwise(track.times_s), strict=True):
        assert math.dist(a, b) <= 1.001 * speed_m_s * (end_s - begin_s) + 1e-6
    assert list(track.at_m) == sorted(track.at_m)
    assert track.after(track.times_s[-1])[0] == track.at_m[-1]
    for at_m in (0.25 * track.at_m[-1], 0.5 * track.at_m[-1], 0.9 * track.at_m[-1]):
        assert track.after(track.at(at_m)[1])[0] == pytest.approx(at_m, abs=1e-3 * max(track.at_m[-1], 1.0))


@pytest.mark.parametrize("initial_m_s", [0.0, 6.0])
def test_a_flight_shows_where_a_vehicle_starts_speeds_up_and_brakes(initial_m_s: float) -> None:
    track = timed_track([(0.0, 0.0), (400.0, 0.0)], 14.0, initial_m_s=initial_m_s, start_delay_s=DELAY_S)
    flight = Trajectory(tuple(track.times_s), tuple((*point, 0.0) for point in track.points))
    begins_s, ends_s = DELAY_S if initial_m_s == 0.0 else 0.0, track.times_s[-1]
    for tenths in range(32):
        t = 0.1 * tenths
        speeding_s = max(t - begins_s, 0.0)
        flown_m = initial_m_s * speeding_s + 0.5 * ACCELERATION_M_S2 * speeding_s**2
        for at_s, east_m in ((t, flown_m), (ends_s - t, 400.0 - 0.5 * BRAKING_M_S2 * t**2)):
            at = flight.at(at_s)
            assert at is not None
            assert at[0] == pytest.approx(east_m, abs=4.1)


@pytest.mark.parametrize("first_m", [0.0, 0.005])
def test_after_a_climb_on_the_spot_a_start_has_its_delay(first_m: float) -> None:
    flight = fly_along((0.0, 0.0, 30.0), 36.0, [(first_m, 0.0), (200.0, 0.0)], 10.0, start_delay_s=DELAY_S)
    level_s = next(t for t, point in zip(flight.times_s, flight.points, strict=True) if point[2] == 36.0)
    assert flight.at(level_s + DELAY_S) == pytest.approx((0.0, 0.0, 36.0))


def test_a_vehicle_beside_its_route_does_not_stop_at_the_next_waypoint_of_a_straight_route() -> None:
    path = [(100.0, 0.0), (130.0, 0.0), (300.0, 0.0)]
    on_route, beside = (
        timed_track([(90.0, north_m), *path], 10.0, initial_m_s=10.0, start_delay_s=DELAY_S)
        for north_m in (0.0, 2.0)
    )
    assert beside.times_s[-1] == pytest.approx(on_route.times_s[-1], abs=0.1)
