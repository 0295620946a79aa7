"""Alarms, evasive climbs and holds of one agent, as stories."""

from __future__ import annotations

import math
from typing import Any

import pytest
from agent_stories import (
    AMSL_M,
    GRID,
    MID_M,
    ApproachStory,
    codes,
    intent_path,
    operator_texts,
    orders,
    publications,
)
from msgspec import structs

from swarmctl.agent.failsafes.base import Fence
from swarmctl.agent.phases import Phase
from swarmctl.agent.traffic.known_flights import known_flights
from swarmctl.agent.traffic.own_flight import planned_flight
from swarmctl.agent.traffic.separation.watch import AvoidanceAction
from swarmctl.core import events as ev
from swarmctl.core.frames import IntentShared, StateShared
from swarmctl.core.records import replace
from swarmctl.core.vehicle import Landed
from swarmctl.report.separation import SeparationStatistics

STILL: dict[str, Any] = {"ground_speed_m_s": 0.0, "east_m_s": 0.0, "mode": "GUIDED", "mode_role": "hold"}


def acknowledged(effects: list[ev.Effect]) -> tuple[int, ...]:
    (state,) = publications(effects, StateShared)
    return state.hears


def gives_way(action: AvoidanceAction, uav: int, **changes: Any) -> bool:
    """Return whether vehicle 2 climbs or stops for a vehicle that crosses its way in 10 s."""
    story = ApproachStory(action)
    story.crossing(uav, **changes)
    effects = story.at(125.0)
    climbs, holds = story.state.height_offset_m > 0.0, orders(effects) == [ev.FlightOrder.HOLD]
    assert not (holds if action == "climb" else climbs)
    return climbs or holds


@pytest.mark.parametrize("action", ["climb", "hold"])
def test_the_higher_system_id_gives_way(action: AvoidanceAction) -> None:
    assert gives_way(action, 1)
    assert not gives_way(action, 3)


@pytest.mark.parametrize("action", ["climb", "hold"])
def test_a_vehicle_gives_way_to_one_that_does_not_receive_it(action: AvoidanceAction) -> None:
    assert gives_way(action, 3, hears=(1, 4))


@pytest.mark.parametrize(
    ("action", "uav", "changes", "expected"),
    [
        ("climb", 1, {}, ["alarm-yields"]),
        ("climb", 3, {}, ["alarm-other-yields"]),
        ("climb", 3, {"hears": ()}, ["alarm-not-heard"]),
        ("hold", 1, {}, ["alarm-yields", "stops-in-time"]),
        ("hold", 3, {"hears": ()}, ["alarm-not-heard", "stops-in-time"]),
        ("none", 1, {}, ["alarm"]),
    ],
)
def test_an_alarm_tells_the_reaction(
    action: AvoidanceAction, uav: int, changes: dict[str, Any], expected: list[str]
) -> None:
    story = ApproachStory(action)
    story.crossing(uav, **changes)
    assert codes(story.at(125.0)) == expected


def test_a_returning_vehicle_tells_that_it_cannot_climb_out_of_the_way() -> None:
    story = ApproachStory(action="climb")
    story(ev.OperatorCommand(ev.FlightOrder.RETURN))
    story(ev.OrderDone(ev.FlightOrder.RETURN))
    story.other(1, 200.0, MID_M[1], (0.0, 0.0, 0.0))
    assert codes(story.at(130.0, mode="RTL", mode_role="return")) == ["alarm-cannot-yield"]


@pytest.mark.parametrize("hovers", [True, False])
def test_a_vehicle_that_climbs_stops_at_its_last_moment(hovers: bool) -> None:
    """The vehicle ahead does not move, and its height has no room above it."""
    story = ApproachStory(action="climb", fence=Fence((), 36.0))
    stops = []
    for east_m in range(100, 220, 10):
        story.other(1, 230.0, MID_M[1], (0.0, 0.0, 0.0), phase="holding", hovers=hovers)
        stops += [east_m] * (orders(story.at(float(east_m))) == [ev.FlightOrder.HOLD])
    assert 40.0 < 230.0 - stops[0] < 90.0


@pytest.mark.parametrize("phase", ["landing", "leaving", "holding", "released"])
def test_a_vehicle_gives_way_to_one_that_cannot(phase: str) -> None:
    assert gives_way("hold", 3, phase=phase)


@pytest.mark.parametrize("change", [{"hears": ()}, {"phase": "leaving"}])
def test_a_vehicle_climbs_as_soon_as_the_other_cannot_give_way_any_more(change: dict[str, Any]) -> None:
    story = ApproachStory(action="climb")
    story.crossing(3)
    assert codes(story.at(125.0)) == ["alarm-other-yields"]
    story.other(3, MID_M[0], MID_M[1] - 95.0, (0.0, 10.0, 0.0), **change)
    story.at(135.0)
    assert story.state.height_offset_m > 0.0


def test_the_state_lists_the_recently_received_vehicles() -> None:
    story = ApproachStory()
    story.crossing(1)
    story.other(3, MID_M[0], MID_M[1] + 60.0, (10.0, 0.0, 0.0))
    story.other(4, 9000.0, 9000.0, (0.0, 0.0, 0.0))
    story.at(110.0)
    assert acknowledged(story.at(111.0)) == (1, 3)
    for _ in range(4):
        story.other(3, MID_M[0], MID_M[1] + 60.0, (10.0, 0.0, 0.0))
        story.at(112.0)
    assert acknowledged(story.at(113.0)) == (3,), "the last state of vehicle 1 has expired"


def test_an_alarm_is_reported_once() -> None:
    story = ApproachStory()
    story.crossing(3)
    assert operator_texts(story.at(125.0)) != []
    story.crossing(3)
    assert operator_texts(story.at(130.0)) == []


def test_a_landed_vehicle_does_not_count_as_silent() -> None:
    story = ApproachStory()
    story.stopped()
    story.other(1, MID_M[0], MID_M[1] + 90.0, (0.0, 0.0, 0.0), alt_rel_m=30.0)
    story.at(140.0)
    story.other(1, MID_M[0], MID_M[1] + 90.0, (0.0, 0.0, 0.0), alt_rel_m=0.0, phase="done")
    for _ in range(8):
        story.at(140.0)
    assert known_flights(story.state) == {}


def test_a_vehicle_on_the_ground_shares_no_alarm() -> None:
    story = ApproachStory(action="none")
    story.crossing(1)
    story.at(125.0)
    down = {"armed": False, "landed": Landed.ON_GROUND}
    (shared,) = publications(story.at(126.0, **down), StateShared)
    assert "vehicle 1" not in shared.trouble


def test_a_vehicle_with_a_lost_link_shows_no_alarm() -> None:
    story = ApproachStory(action="none")
    story.crossing(1)
    story.at(125.0)
    assert story.state.alarm != ""
    story(ev.LinkLost(5.0))
    assert story.state.alarm == ""


def test_a_holding_vehicle_plans_again_and_resumes_after_the_crossing() -> None:
    story = ApproachStory()
    story.stopped()
    for second in range(30):
        story.other(1, MID_M[0], MID_M[1] - 90.0 + 10.0 * second, (0.0, 10.0, 0.0))
        effects = story.at(140.0, **STILL)
        if operator_texts(effects):
            break
        assert orders(effects) == []
    assert codes(effects) == ["resumes"]
    assert (story.state.conflicts.counts.climbs, story.state.conflicts.counts.holds) == (0, 1)
    assert 1 <= second <= 12  # about the time of the crossing, 85 m ahead
    assert story.swap().plan.track
    story.accept()
    story.at(141.0)
    assert story.state.phase is Phase.FLYING
    assert story.state.ended is False


def test_a_climb_clears_all_vehicles_nearby() -> None:
    story = ApproachStory(action="climb")
    story.other(3, 150.0, MID_M[1] + 15.0, (10.0, 0.0, 0.0), alt_rel_m=34.0)
    story.crossing(1)
    story.at(125.0)
    assert story.swap().plan.track[-1].alt_rel_m == pytest.approx(37.6)
    assert (story.state.conflicts.counts.climbs, story.state.conflicts.counts.holds) == (1, 0)


def test_heights_are_compared_above_the_sea() -> None:
    for amsl_m, alarmed in ((330.0, True), (336.0, False)):
        story = ApproachStory()
        story.crossing(1, alt_amsl_m=amsl_m)
        assert bool(operator_texts(story.at(125.0, alt_amsl_m=330.0))) is alarmed


@pytest.mark.parametrize("changes", [{"alt_rel_m": 0.2}, {"alt_rel_m": 34.0}])
def test_a_vehicle_on_the_ground_or_high_enough_raises_no_alarm(changes: dict[str, float]) -> None:
    story = ApproachStory()
    story.crossing(1, **changes)
    assert operator_texts(story.at(125.0)) == []


def test_the_least_distance_includes_vehicles_of_other_processes() -> None:
    story, closeness = ApproachStory(), SeparationStatistics()
    for second in range(8):
        story.other(1, 130.0, MID_M[1] + 5.0, (0.0, 0.0, 0.0), alt_rel_m=38.0, age_s=0.0)
        story.at(100.0 + 10.0 * second)
        closeness.moved(story.state, float(second), story.now)
        seen = [(1, story.state.neighbours[1].state)]
        closeness.neighbours_moved(story.state, seen, float(second), story.now)
    least = closeness.summary({2: story.state})["least_distance"]
    assert least["vehicles"] == ["vehicle 1", "uav1"]
    assert (least["horizontal_m"], least["vertical_m"]) == pytest.approx((5.0, 8.0), abs=0.01)


def test_an_operators_order_ends_the_hold() -> None:
    story = ApproachStory()
    story.stopped()
    assert orders(story(ev.OperatorCommand(ev.FlightOrder.RETURN))) == [ev.FlightOrder.RETURN]
    story.other(1, MID_M[0], MID_M[1] + 20.0, (0.0, 10.0, 0.0))
    story.at(130.0, mode="RTL", mode_role="return")
    assert not story.state.is_waiting
    assert story.state.phase is Phase.LEAVING


def test_a_returning_vehicle_without_a_known_home_is_not_stopped() -> None:
    story = ApproachStory()
    story(ev.OperatorCommand(ev.FlightOrder.RETURN))
    story(ev.OrderDone(ev.FlightOrder.RETURN))
    story.other(1, 200.0, MID_M[1], (0.0, 0.0, 0.0))
    effects = story.at(130.0, mode="RTL", mode_role="return")
    assert len(operator_texts(effects)) == 1
    assert orders(effects) == []
    assert story.state.phase is Phase.LEAVING


def test_an_evasive_climb_respects_the_ceiling() -> None:
    story = ApproachStory(action="climb", fence=Fence((), 36.0))
    story.crossing(1)
    story.at(125.0)
    assert story.tick() == []
    assert story.state.height_offset_m == 0.0


def codes_while_holding(story: ApproachStory, seconds: int, **standing: Any) -> list[str]:
    """Return the codes of the messages while vehicle 2 holds 25 m away from vehicle 1 on its route."""
    found_codes = []
    for _ in range(seconds):
        story.other(1, 185.0, MID_M[1], (0.0, 0.0, 0.0), **standing)
        found_codes += codes(story.at(160.0, **STILL))
    return found_codes


def test_a_vehicle_resumes_above_the_blocking_vehicle_after_a_long_hold() -> None:
    story = ApproachStory()
    story.stopped()
    assert codes_while_holding(story, 55) == []
    assert codes_while_holding(story, 10) == ["resumes-higher"]
    assert story.swap().plan.landing.alt_rel_m == pytest.approx(33.6)


def test_a_vehicle_in_the_way_of_one_that_cannot_give_way_climbs_at_once() -> None:
    story, still = ApproachStory(), {**STILL, "alt_amsl_m": 330.0}
    story.stopped()
    story.at(160.0, **still)
    path = intent_path((0.0, 160.0, MID_M[1] - 120.0, AMSL_M), (24.0, 160.0, MID_M[1] + 120.0, AMSL_M))
    story.told(intents=((3, 0.0, IntentShared(1, path, may_change=False)),))
    story.other(1, 185.0, MID_M[1], (0.0, 0.0, 0.0))
    assert codes(story.at(160.0, **still))[0] == "resumes-higher"
    climb, *_ = story.swap().plan.track
    east_m, north_m = GRID.frame.to_local(climb.lat_deg, climb.lon_deg)
    assert math.dist((east_m, north_m), (160.0, MID_M[1])) < 0.1
    assert climb.alt_rel_m == pytest.approx(33.6)


def test_two_vehicles_in_hold_within_the_limits_separate_by_a_climb_on_the_spot() -> None:
    story, away_m = ApproachStory(), 8.0
    story.stopped()
    story.swaps_took(4.0)
    found = []
    for _ in range(4):
        story.other(1, 160.0 + away_m, MID_M[1], (0.0, 0.0, 0.0))
        found += codes(story.at(160.0, **STILL))
    assert found == ["resumes-higher"]
    climb = story.swap()
    story(ev.MissionAccepted(climb.plan_id, 4.0, 0.0))
    # The wind has moved the vehicle past the spot; the announced flight stays there nevertheless.
    story.at(160.3, **STILL, alt_rel_m=31.0)
    levelling = story.state
    new = structs.replace(climb, plan_id=climb.plan_id + 1)
    changing = replace(levelling, plans=levelling.plans.changing_to(new, levelling.now_boot_s))
    for state in (levelling, changing):
        flight, now_s = planned_flight(state), state.vehicle.time_boot_s
        assert flight is not None
        places = [flight.at(now_s + in_s) for in_s in (1.0, 2.0, 3.0)]
        assert all(place is not None and math.dist(place[:2], (160.3, MID_M[1])) < 1.0 for place in places)


def test_a_vehicle_without_a_clear_height_keeps_holding_and_reports_repeatedly() -> None:
    story = ApproachStory(fence=Fence((), 36.0))
    story.stopped()
    assert codes_while_holding(story, 130) == ["keeps-holding"] * 2
    assert story.state.is_waiting


def test_a_holding_vehicle_stays_clear_of_a_silent_vehicle() -> None:
    story = ApproachStory()
    story.stopped()
    # Vehicle 1 holds over the crossing, sends one more state and then falls silent.
    story.other(1, MID_M[0], MID_M[1], (0.0, 0.0, 0.0))
    found_codes = [operator_texts(story.at(160.0, **STILL)) for _ in range(50)]
    assert not any(found_codes)
    later = [code for _ in range(150) for code in codes(story.at(160.0, **STILL))]
    assert {"keeps-holding", "resumes-higher"} & set(later)
    assert not story.state.is_waiting, "the vehicle resumes above that position or after three minutes"


def test_a_vehicle_that_hears_nobody_keeps_its_hold_until_it_is_heard_again() -> None:
    """The others keep clear of its flight as announced for 90 s, and do not learn of a new one."""
    story = ApproachStory()
    story.stopped()
    story.other(1, MID_M[0], MID_M[1] + 60.0, (0.0, 10.0, 0.0), age_s=3.0)
    found_codes = [code for _ in range(80) for code in codes(story.at(140.0, **STILL))]
    assert found_codes == ["keeps-holding"]
    story.other(1, MID_M[0], MID_M[1] + 900.0, (0.0, 10.0, 0.0))
    assert codes(story.at(140.0, **STILL)) == ["resumes"]


@pytest.mark.parametrize(("is_acknowledged", "holds"), [(False, True), (True, False)])
def test_a_vehicle_that_hears_nobody_stops_a_flight_that_nobody_knows(
    is_acknowledged: bool, holds: bool
) -> None:
    story = ApproachStory()
    story.other(1, 125.0, MID_M[1] - 100.0, (0.0, 0.0, 0.0))
    story.at(125.0)
    swaps = replace(story.state.plans.swaps, decided_boot_s=story.state.vehicle.time_boot_s)
    story.state = replace(story.state, plans=replace(story.state.plans, swaps=swaps))
    if is_acknowledged:
        story.at(135.0)
        story.other(1, 125.0, MID_M[1] - 100.0, (0.0, 0.0, 0.0))
    found = [order for i in range(6) for order in orders(story.at(145.0 + 10.0 * i))]
    assert (ev.FlightOrder.HOLD in found) is holds


@pytest.mark.parametrize(
    ("uav", "east_m", "north_m", "up_m", "goes_on"),
    [(3, 134.0, 3.0, 32.9, True), (1, 134.0, 3.0, 32.9, True), (3, 146.0, 0.0, 30.0, False)],
    ids=["vehicle beside", "vehicle with a lower id", "vehicle ahead"],
)
def test_a_vehicle_resumes_away_from_another_that_holds_too_close(
    uav: int, east_m: float, north_m: float, up_m: float, goes_on: bool
) -> None:
    """The route leads east, away from a vehicle beside it."""
    story = ApproachStory()
    story.stopped(4, phase="landing")
    found_codes = []
    for _ in range(50):
        story.other(4, MID_M[0], MID_M[1], (0.0, 0.0, 0.0), alt_rel_m=0.0)  # landed
        position_m = (east_m, MID_M[1] + north_m)
        story.other(uav, *position_m, (0.0, 0.0, 0.0), alt_rel_m=up_m)  # holds as well
        found_codes += codes(story.at(140.0, **STILL))
    assert ("resumes" in found_codes) is goes_on
