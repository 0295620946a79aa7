"""Last resort: a vehicle stops in time, although another one follows it."""

from __future__ import annotations

import pytest
from agent_stories import AMSL_M, MID_M, ApproachStory, codes, intent_path, orders

from swarmctl.core import events as ev
from swarmctl.core.frames import IntentShared


def test_a_vehicle_stops_in_time_if_its_follower_can_stop_too() -> None:
    story, obstacle_m = ApproachStory(), 230.0
    for east_m in range(100, 190, 10):
        story.other(1, obstacle_m, MID_M[1], (0.0, 0.0, 0.0), phase="holding")
        story.other(3, east_m - 45.0, MID_M[1], (10.0, 0.0, 0.0))
        if "stops-in-time" in codes(story.at(east_m)):
            return
    raise AssertionError("the vehicle does not stop")


@pytest.mark.parametrize(("ahead_m_s", "then"), [(10.0, []), (7.0, [ev.FlightOrder.HOLD])])
def test_a_vehicle_keeps_far_enough_behind_a_copter_to_stop_if_the_copter_stops(
    ahead_m_s: float, then: list[ev.FlightOrder]
) -> None:
    """The other one announces a flight that leads away from this vehicle faster than this vehicle flies."""
    story, ahead_m = ApproachStory(), 132.0
    path = intent_path((0.0, ahead_m, MID_M[1], AMSL_M), (30.0, ahead_m + 360.0, MID_M[1], AMSL_M))
    story.tell(intents=((1, 0.0, IntentShared(1, path)),))
    story.other(1, ahead_m, MID_M[1], (ahead_m_s, 0.0, 0.0))
    assert orders(story.at(110.0)) == then


@pytest.mark.parametrize(("phase", "then"), [("launching", []), ("flying", [ev.FlightOrder.HOLD])])
def test_a_copter_that_climbs_after_its_take_off_counts_as_one_that_flies_on(
    phase: str, then: list[ev.FlightOrder]
) -> None:
    story, ahead_m = ApproachStory(), 155.0
    path = intent_path((0.0, ahead_m, MID_M[1], AMSL_M), (12.0, ahead_m, MID_M[1], AMSL_M + 12.0))
    story.tell(intents=((1, 0.0, IntentShared(1, path)),))
    story.other(1, ahead_m, MID_M[1], (0.0, 0.0, 1.0), phase=phase)
    assert orders(story.at(110.0)) == then


def test_a_vehicle_that_sinks_from_its_announced_height_counts_with_its_present_velocity() -> None:
    story, ahead_m = ApproachStory(), 152.0
    path = intent_path((0.0, ahead_m, MID_M[1], AMSL_M + 7.0), (30.0, ahead_m, MID_M[1], AMSL_M + 7.0))
    story.tell(intents=((1, 0.0, IntentShared(1, path)),))
    story.other(1, ahead_m, MID_M[1], (0.0, 0.0, -1.0), alt_rel_m=35.5)
    assert orders(story.at(110.0)) == [ev.FlightOrder.HOLD]


def test_a_vehicle_does_not_stop_where_a_faster_one_is_about_to_pass_by_its_announced_flight() -> None:
    story, east_m = ApproachStory(), 150.0
    story.other(1, east_m - 35.0, MID_M[1] + 9.0, (14.0, -1.8, 0.0))
    here = (0.0, east_m - 35.0, MID_M[1] + 9.0, AMSL_M)
    path = intent_path(here, (2.9, east_m + 5.0, MID_M[1] + 4.0, AMSL_M), (6.0, east_m, 300.0, AMSL_M))
    story.tell(intents=((1, 0.0, IntentShared(1, path)),))
    slow = {"ground_speed_m_s": 3.5, "east_m_s": 3.5}
    assert orders(story.at(east_m, **slow)) == []


@pytest.mark.parametrize(("hovers", "then"), [(True, ev.FlightOrder.HOLD), (False, None)])
def test_a_copter_that_reports_a_wait_has_stopped_although_its_announced_hold_was_lost(
    hovers: bool, then: ev.FlightOrder | None
) -> None:
    story, ahead_m = ApproachStory(), 45.0
    path = intent_path((0.0, 100.0 + ahead_m, MID_M[1], AMSL_M), (30.0, 400.0 + ahead_m, MID_M[1], AMSL_M))
    story.tell(intents=((1, 0.0, IntentShared(1, path)),))
    assert orders(story.at(100.0)) == []
    story.other(1, 100.0 + ahead_m, MID_M[1], (10.0, 0.0, 0.0))
    assert orders(story.at(110.0)) == []
    story.other(1, 110.0 + ahead_m, MID_M[1], (10.0, 0.0, 0.0), waits="in hold", hovers=hovers)
    story.tell(intents=((1, 3.0, IntentShared(1, path)),))  # late, and older than the wait
    found = [order for east_m in range(120, 160, 10) for order in orders(story.at(east_m))]
    assert found[:1] == ([] if then is None else [then])
