"""What an agent does about others that come too close, told as stories."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from agent_stories import orders, publications
from watching_stories import MID_M, Watching, told

from swarmctl.agent.failsafes.base import Fence
from swarmctl.agent.state import Phase
from swarmctl.agent.step import wants_tick
from swarmctl.core import events as ev
from swarmctl.core.frames import StateShared
from swarmctl.report.separation import SeparationStatistics


def heard(effects: list[ev.Effect]) -> tuple[int, ...]:
    (state,) = (message for message in publications(effects) if isinstance(message, StateShared))
    return state.hears


def test_the_higher_system_id_holds_and_says_why() -> None:
    story = Watching()
    story.crossing(1)
    effects = story.at(125.0)
    assert orders(effects) == [ev.FlightOrder.HOLD]
    (said,) = told(effects)
    assert said.startswith("too close to vehicle 1 in ")
    assert said.endswith(" m in height; it gives way")
    assert story.state.phase is Phase.FLYING
    assert not wants_tick(replace(story.state, dirty=True), story.now)


def test_the_lower_system_id_flies_on_and_says_so() -> None:
    story = Watching()
    story.crossing(3)
    effects = story.at(125.0)
    assert orders(effects) == []
    assert told(effects)[0].endswith("; the other gives way")


@pytest.mark.parametrize("hears", [(), (1, 4)])
def test_the_lower_system_id_gives_way_to_one_that_does_not_say_that_it_hears_it(
    hears: tuple[int, ...],
) -> None:
    """What that does not hear it cannot give way to: of two that hear each other one alone does."""
    story = Watching()
    story.crossing(3, hears=hears)
    effects = story.at(125.0)
    assert orders(effects) == [ev.FlightOrder.HOLD]
    assert told(effects)[0].endswith("; it gives way, for that does not say that it hears it")


def test_it_gives_way_as_soon_as_the_other_says_no_more_that_it_hears_it() -> None:
    story = Watching()
    story.crossing(3)
    assert orders(story.at(125.0)) == []
    story.other(3, MID_M[0], MID_M[1] - 95.0, (0.0, 10.0, 0.0), hears=())
    assert orders(story.at(135.0)) == [ev.FlightOrder.HOLD]


def test_it_tells_whom_it_hears_of_late() -> None:
    story = Watching()
    story.crossing(1)
    story.other(3, MID_M[0], MID_M[1] + 60.0, (10.0, 0.0, 0.0))
    story.other(4, 9000.0, 9000.0, (0.0, 0.0, 0.0))
    story.at(110.0)
    assert heard(story.at(111.0)) == (1, 3)
    for _ in range(4):
        story.other(3, MID_M[0], MID_M[1] + 60.0, (10.0, 0.0, 0.0))
        story.at(112.0)
    assert heard(story.at(113.0)) == (3,), "of 1 nothing was heard for longer than a state is trusted"


def test_it_says_so_once() -> None:
    story = Watching()
    story.crossing(3)
    assert told(story.at(125.0)) != []
    story.crossing(3)
    assert told(story.at(130.0)) == []


def test_with_no_action_there_is_the_alarm_alone() -> None:
    story = Watching(action="none")
    story.crossing(1)
    effects = story.at(125.0)
    assert orders(effects) == []
    assert len(told(effects)) == 1


def test_when_the_other_is_past_it_plans_anew_and_flies_on() -> None:
    story = Watching()
    story.crossing(1)
    story.at(125.0)
    story(ev.OrderDone(ev.FlightOrder.HOLD))
    still = {"ground_speed_m_s": 0.0, "east_m_s": 0.0, "mode": "GUIDED", "mode_role": "hold"}
    for second in range(30):
        story.other(1, MID_M[0], MID_M[1] - 90.0 + 10.0 * second, (0.0, 10.0, 0.0))
        effects = story.at(140.0, **still)
        if told(effects):
            break
        assert orders(effects) == []
    assert told(effects) == ["clear of the others: it flies on"]
    assert 3 <= second <= 12  # about when it crosses; 85 m are left to there
    assert story.swap().plan.track
    story.accept()
    story.at(141.0)
    assert story.state.phase is Phase.FLYING
    assert story.state.ended is False


def test_where_holding_would_leave_it_in_the_way_it_climbs() -> None:
    story = Watching()
    story.other(1, 230.0, MID_M[1], (-10.0, 0.0, 0.0))  # head-on
    effects = story.at(125.0)
    assert orders(effects) == []
    swap = story.swap()
    assert swap.plan.track[-1].alt_rel_m == pytest.approx(33.6)


def test_climbing_it_passes_clear_of_all_who_are_near() -> None:
    story = Watching(action="climb")
    story.other(3, 150.0, MID_M[1] + 15.0, (10.0, 0.0, 0.0), alt_rel_m=34.0)
    story.crossing(1)
    story.at(125.0)
    assert story.swap().plan.track[-1].alt_rel_m == pytest.approx(37.6)


def test_heights_are_compared_above_the_sea_where_both_tell_them() -> None:
    for amsl_m, alarmed in ((330.0, True), (336.0, False)):
        story = Watching()
        story.crossing(1, alt_amsl_m=amsl_m)
        assert bool(told(story.at(125.0, alt_amsl_m=330.0))) is alarmed


@pytest.mark.parametrize("changes", [{"alt_rel_m": 0.2}, {"alt_rel_m": 34.0}])
def test_who_is_on_the_ground_or_high_enough_is_no_danger(changes: dict[str, float]) -> None:
    story = Watching()
    story.crossing(1, **changes)
    assert told(story.at(125.0)) == []


def test_the_least_distance_to_one_that_is_flown_elsewhere_is_known_too() -> None:
    story, closeness = Watching(), SeparationStatistics()
    for second in range(8):
        story.at(100.0 + 10.0 * second)
        closeness.moved(story.state, float(second), story.now)
        story.other(1, 130.0, MID_M[1] + 5.0, (0.0, 0.0, 0.0), alt_rel_m=38.0)
        closeness.heard(story.state, [(1, story.state.neighbours[1].state)], float(second), story.now)
    least = closeness.summary({2: story.state})["least_distance"]
    assert least["vehicles"] == ["vehicle 1", "uav1"]
    assert (least["horizontal_m"], least["vertical_m"]) == pytest.approx((5.0, 8.0), abs=0.01)


def test_an_operator_who_orders_otherwise_is_obeyed() -> None:
    story = Watching()
    story.crossing(1)
    story.at(125.0)
    assert orders(story(ev.OperatorCommand(ev.FlightOrder.RETURN))) == [ev.FlightOrder.RETURN]
    story.at(130.0, mode="RTL", mode_role="return")
    assert story.state.interrupted_plan is None
    assert story.state.phase is Phase.LEAVING


@pytest.mark.parametrize("phase", ["landing", "leaving", "holding", "released"])
def test_the_lower_system_id_gives_way_to_one_that_cannot(phase: str) -> None:
    story = Watching()
    story.crossing(3, phase=phase)
    effects = story.at(125.0)
    assert orders(effects) == [ev.FlightOrder.HOLD]
    assert told(effects)[0].endswith("; it gives way")


def test_also_where_the_other_could_when_the_alarm_was_raised() -> None:
    story = Watching()
    story.crossing(3)
    assert orders(story.at(125.0)) == []
    story.other(3, MID_M[0], MID_M[1] - 95.0, (0.0, 10.0, 0.0), phase="leaving")
    assert orders(story.at(135.0)) == [ev.FlightOrder.HOLD]


def test_who_returns_is_not_stopped_on_its_way() -> None:
    story = Watching()
    story(ev.OperatorCommand(ev.FlightOrder.RETURN))
    story(ev.OrderDone(ev.FlightOrder.RETURN))
    story.other(1, 200.0, MID_M[1], (0.0, 0.0, 0.0))
    effects = story.at(130.0, mode="RTL", mode_role="return")
    assert len(told(effects)) == 1
    assert orders(effects) == []
    assert story.state.phase is Phase.LEAVING


def test_it_climbs_no_higher_than_its_fence_lets_it() -> None:
    story = Watching(action="climb", fence=Fence((), 36.0))
    story.crossing(1)
    story.at(125.0)
    assert story.tick() == []
    assert story.state.height_offset_m == 0.0


def holds_for(story: Watching, seconds: int, **standing: Any) -> list[str]:
    """What is said while vehicle 1 stands in the way of vehicle 2, which holds 25 m before it."""
    said = []
    still = {"ground_speed_m_s": 0.0, "east_m_s": 0.0, "mode": "GUIDED", "mode_role": "hold"}
    for _ in range(seconds):
        story.other(1, 185.0, MID_M[1], (0.0, 0.0, 0.0), **standing)
        said += told(story.at(160.0, **still))
    return said


def test_who_has_held_for_long_flies_on_above_the_other() -> None:
    story = Watching()
    story.crossing(1)
    story.at(125.0)
    story(ev.OrderDone(ev.FlightOrder.HOLD))
    assert holds_for(story, 55) == []
    assert holds_for(story, 10) == ["it has held for 60 s: it flies on at 34 m, above the others"]
    assert story.swap().plan.landing.alt_rel_m == pytest.approx(33.6)


def test_where_no_height_is_clear_it_holds_on_and_says_so_again_and_again() -> None:
    story = Watching(fence=Fence((), 36.0))
    story.crossing(1)
    story.at(125.0)
    story(ev.OrderDone(ev.FlightOrder.HOLD))
    assert holds_for(story, 130) == ["it has held for 60 s, and no height is clear: it holds on"] * 2
    assert story.state.interrupted_plan is not None


def test_who_holds_for_another_keeps_clear_of_where_that_fell_silent() -> None:
    story = Watching()
    story.crossing(1)
    story.at(125.0)
    story(ev.OrderDone(ev.FlightOrder.HOLD))
    still = {"ground_speed_m_s": 0.0, "east_m_s": 0.0, "mode": "GUIDED", "mode_role": "hold"}
    # It was told to hold over the crossing, is heard once more, and then nothing is.
    story.other(1, MID_M[0], MID_M[1], (0.0, 0.0, 0.0))
    said = [told(story.at(140.0, **still)) for _ in range(50)]
    assert not any(said)
    later = [text for _ in range(150) for text in told(story.at(140.0, **still))]
    assert any("it has held for 60 s" in text for text in later)
    assert story.state.interrupted_plan is None, "it flies on, above that place or after three minutes"


@pytest.mark.parametrize(
    ("uav", "east_m", "north_m", "up_m", "goes_on"),
    [(3, 134.0, 3.0, 32.9, True), (1, 134.0, 3.0, 32.9, False), (3, 146.0, 0.0, 30.0, False)],
    ids=["beside", "of a lower id", "ahead"],
)
def test_of_two_that_hold_for_a_third_and_stand_too_near_each_other_the_lower_system_id_goes_on(
    uav: int, east_m: float, north_m: float, up_m: float, goes_on: bool
) -> None:
    """Where its way leads apart: it flies east."""
    story = Watching()
    story.crossing(4, phase="landing")
    story.at(125.0)
    story(ev.OrderDone(ev.FlightOrder.HOLD))
    still = {"ground_speed_m_s": 0.0, "east_m_s": 0.0, "mode": "GUIDED", "mode_role": "hold"}
    said = []
    for _ in range(50):
        story.other(4, MID_M[0], MID_M[1], (0.0, 0.0, 0.0), alt_rel_m=0.0)  # it is down
        place = (east_m, MID_M[1] + north_m)
        story.other(uav, *place, (0.0, 0.0, 0.0), alt_rel_m=up_m)  # it holds as well
        said += told(story.at(140.0, **still))
    assert ("clear of the others: it flies on" in said) is goes_on
