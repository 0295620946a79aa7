"""What a copter over its goal does about others there, told as stories."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from agent_stories import GRID, Story, orders, publications

from swarmctl.agent.failsafes import low_battery
from swarmctl.agent.failsafes.base import ActiveRule
from swarmctl.agent.state import Phase
from swarmctl.agent.traffic.separation.watch import SeparationRules
from swarmctl.core import events as ev
from swarmctl.core.frames import IntentPoint, IntentShared, StateShared
from swarmctl.core.vehicle import Landed

HOME_AMSL_M = 300.0
GOAL = (4, 8)
PLACE_M = GRID.centre_m(GOAL)
"""where vehicle 2, which lands alone in its cell, comes down"""
STILL: dict[str, Any] = {"ground_speed_m_s": 0.0, "east_m_s": 0.0}
HOLDS: dict[str, Any] = {**STILL, "mode": "GUIDED", "mode_role": "hold"}


def told(effects: list[ev.Effect]) -> list[str]:
    return [effect.text for effect in effects if isinstance(effect, ev.NotifyOperator)]


def swaps(effects: list[ev.Effect]) -> list[ev.SwapMission]:
    return [effect for effect in effects if isinstance(effect, ev.SwapMission)]


class OverGoal(Story):
    """Vehicle 2 comes to its goal at 30 m."""

    def __init__(self, **changes: Any) -> None:
        super().__init__(**{"uav": 2, **changes})
        self.flying()

    def at(self, before_m: float, up_m: float = 30.0, **changes: Any) -> list[ev.Effect]:
        """So far before its landing place, at 2 m/s, a second later."""
        lat_deg, lon_deg = GRID.frame.to_geodetic(PLACE_M[0] - before_m, PLACE_M[1])
        here = {"lat_deg": lat_deg, "lon_deg": lon_deg, "ground_speed_m_s": 2.0, "east_m_s": 2.0}
        here |= {"alt_rel_m": up_m, "alt_amsl_m": HOME_AMSL_M + up_m}
        return self.over(GOAL, **{**here, **changes})

    def other(self, uav: int, *points: tuple[float, float, float], **changes: Any) -> list[ev.Effect]:
        """Vehicle `uav`, which is over the goal, too, tells that it will be at (seconds from now, metres east
        of that landing place, height above home)."""
        path = tuple(
            IntentPoint(t, *GRID.frame.to_geodetic(PLACE_M[0] + east_m, PLACE_M[1]), HOME_AMSL_M + up_m)
            for t, east_m, up_m in points
        )
        intent = IntentShared(1, path, **{"may_change": False, **changes})
        effects = self(ev.Intents(((uav, 0.0, intent),)))
        self.now -= 1.0
        return effects

    def passing_below(self, uav: int = 1, in_s: float = 6.0, up_m: float = 22.0, **changes: Any) -> None:
        """By the landing place, and on to its own beside it."""
        points = (
            (0.0, -5.0 * in_s, up_m),
            (in_s, 0.0, up_m),
            (in_s + 2.4, 12.0, up_m),
            (in_s + 60.0, 12.0, 0.0),
        )
        self.other(uav, *points, **changes)

    def waiting(self) -> OverGoal:
        """For one that stands below."""
        self.at(10.0)
        self.other(1, (0.0, 2.0, 22.0), (30.0, 2.0, 22.0))
        assert orders(self.at(4.0)) == [ev.FlightOrder.HOLD]
        self(ev.OrderDone(ev.FlightOrder.HOLD))
        return self


def test_who_is_higher_waits_over_its_landing_place_for_who_passes_below() -> None:
    story = OverGoal()
    story.at(10.0)
    assert story.state.phase is Phase.LANDING
    story.passing_below()
    effects = story.at(4.0)
    assert orders(effects) == [ev.FlightOrder.HOLD]
    (text,) = told(effects)
    assert text.startswith("over its goal its way down meets that of vehicle 1 in ")
    assert text.endswith(": it waits above")
    (intent,) = (message for message in publications(effects) if isinstance(message, IntentShared))
    assert {round(point.alt_amsl_m, 1) for point in intent.points} == {HOME_AMSL_M + 30.0}
    assert (story.state.deconfliction.predicted, story.state.deconfliction.by_waiting) == (1, 1)


def test_it_is_told_at_once_that_it_lands_for_then_it_gives_way_to_nobody_on_its_way() -> None:
    (intent,) = (m for m in publications(OverGoal().at(10.0)) if isinstance(m, IntentShared))
    assert not intent.may_change


@pytest.mark.parametrize(
    ("what", "changes"),
    [
        ("who is above", {"up_m": 38.0}),
        ("who is past by then", {"in_s": 1.0, "up_m": 15.0}),
        ("who still has the time to give way", {"may_change": True, "in_s": 12.0, "up_m": 18.0}),
    ],
)
def test_it_waits_for_nobody_else(what: str, changes: dict[str, Any]) -> None:
    story = OverGoal()
    story.at(10.0)
    story.passing_below(**changes)
    assert orders(story.at(4.0)) == [], what


def test_nor_for_one_that_it_would_stand_in_the_way_of_all_the_same() -> None:
    story = OverGoal()
    story.at(10.0)
    story.passing_below(up_m=29.0)
    assert orders(story.at(4.0)) == []


@pytest.mark.parametrize(
    ("up_m", "changes"),
    [
        (30.0, {"separation": replace(SeparationRules(), action="none")}),
        (4.0, {"altitude_m": 4.0}),
    ],
)
def test_it_does_not_wait_where_it_may_not_or_is_all_but_down(up_m: float, changes: dict[str, Any]) -> None:
    story = OverGoal(**changes)
    story.at(10.0, up_m)
    story.passing_below(up_m=max(up_m - 8.0, 0.5), in_s=3.0)
    assert orders(story.at(4.0, up_m)) == []


@pytest.mark.parametrize(("uav", "waits"), [(1, True), (3, False)])
def test_of_two_at_one_height_the_one_with_the_higher_system_id_waits(uav: int, waits: bool) -> None:
    story = OverGoal()
    story.at(30.0)
    story.other(uav, (0.0, 6.0, 30.0), (30.0, 6.0, 30.0))
    effects = story.at(24.0, ground_speed_m_s=8.0, east_m_s=8.0)
    assert bool(orders(effects)) is waits


def test_when_the_way_down_is_clear_it_comes_down_on_its_landing_place() -> None:
    story = OverGoal().waiting()
    for _ in range(3):
        assert orders(story.at(3.0, **HOLDS)) == []
    story.other(1, (0.0, 12.0, 20.0), (50.0, 12.0, 0.0))
    effects = story.at(3.0, **HOLDS)
    assert told(effects) == ["clear below: it comes down"]
    (swap,) = swaps(effects)
    assert swap.plan.track == ()
    assert swap.plan.landing.alt_rel_m == pytest.approx(30.0)
    place = GRID.frame.to_local(swap.plan.landing.lat_deg, swap.plan.landing.lon_deg)
    assert place == pytest.approx(PLACE_M, abs=0.1)
    assert swap.plan.from_hold
    story.accept()
    story.at(1.0, 20.0)
    story.over(GOAL, armed=False, alt_rel_m=0.0)
    assert (story.state.phase, story.state.outcome) == (Phase.DONE, "arrived")


def test_over_that_place_it_comes_down_where_it_is() -> None:
    story = OverGoal().waiting()
    story.other(1, (0.0, 12.0, 0.2), (0.1, 12.0, 0.0))
    effects = [effect for _ in range(4) for effect in story.at(0.5, **HOLDS)]
    assert orders(effects) == [ev.FlightOrder.LAND]
    assert swaps(effects) == []
    assert story.state.phase is Phase.LANDING


def test_who_has_landed_and_tells_nothing_more_is_not_waited_for() -> None:
    story = OverGoal().waiting()
    story(ev.Intents(((1, 0.0, IntentShared(0)),)))
    said = [text for _ in range(4) for text in told(story.at(0.5, **HOLDS))]
    assert said == ["clear below: it comes down"]


def test_it_says_again_and_again_for_whom_it_waits() -> None:
    story, said = OverGoal().waiting(), []
    for _ in range(130):
        story.other(1, (0.0, 2.0, 20.0), (30.0, 2.0, 20.0))
        said += told(story.at(3.0, **HOLDS))
    assert len(said) == 2
    assert said[0].startswith(
        "it has waited over its goal for 60 s, and its way down meets that of vehicle 1 "
    )


def test_while_it_still_says_that_it_lands_its_mission_is_not_changed() -> None:
    story = OverGoal().waiting()
    story.other(1, (0.0, 12.0, 0.2), (0.1, 12.0, 0.0))
    for _ in range(5):
        assert swaps(story.at(3.0, landed=Landed.LANDING, **HOLDS)) == []
    assert len(swaps(story.at(3.0, **HOLDS))) == 1


def test_where_it_gets_no_mission_it_lands_where_it_stands() -> None:
    story = OverGoal().waiting()
    story(ev.Intents(((1, 0.0, IntentShared(0)),)))
    while story.state.pending is None:
        story.at(3.0, **HOLDS)
    plan_id = story.state.pending.plan_id
    assert orders(story(ev.MissionFailed(plan_id, "old", "it lands just now"))) == [ev.FlightOrder.LAND]
    assert story.state.phase is Phase.LANDING


def low(story: OverGoal, *heights_m: float) -> list[ev.FlightOrder]:
    """What it is told while it comes down all the same, half a second each."""
    down = {"landed": Landed.LANDING, "ground_speed_m_s": 0.0, "east_m_s": 0.0}
    return [order for up_m in heights_m for order in orders(story.at(0.5, up_m, **down))]


def test_who_was_not_heard_to_wait_is_not_told_again_when_it_is_low_or_nobody_is_below() -> None:
    story = OverGoal()
    story.passing_below()
    assert orders(story.at(4.0)) == [ev.FlightOrder.HOLD]
    story(ev.OrderFailed(ev.FlightOrder.HOLD, "no answer"))
    story(ev.Intents(((1, 0.0, IntentShared(0)),)))
    assert set(low(story, 28.0, 24.0, 20.0, 16.0, 12.0, 10.0, 9.0, 8.0)) == {ev.FlightOrder.LAND}
    assert story.state.interrupted_plan is None


def test_who_is_heard_again_when_it_is_low_is_not_told_to_wait_there() -> None:
    story = OverGoal()
    story.passing_below()
    assert orders(story.at(4.0)) == [ev.FlightOrder.HOLD]
    story(ev.LinkLost(6.0))
    low(story, 20.0, 15.0, 10.0)
    story(ev.LinkRestored())
    assert set(low(story, 3.0, 2.0, 1.5)) == {ev.FlightOrder.LAND}


def test_on_a_battery_that_is_all_but_spent_it_waits_no_longer() -> None:
    rules = (ActiveRule(low_battery, low_battery.Params(seconds=0.0)),)
    story = OverGoal(rules=rules).waiting()
    assert orders(story.at(3.0, battery_percent=24.0, **HOLDS)) == []
    effects = [e for _ in range(3) for e in story.at(3.0, battery_percent=19.0, **HOLDS)]
    assert orders(effects)[:1] == [ev.FlightOrder.LAND]
    fresh = OverGoal(rules=rules)
    fresh.at(10.0, battery_percent=9.0)
    fresh.passing_below()
    assert orders(fresh.at(4.0, battery_percent=9.0)) == []


def test_who_tells_no_plan_is_taken_to_fly_straight_on() -> None:
    story = OverGoal()
    story.at(10.0)
    lat_deg, lon_deg = GRID.frame.to_geodetic(PLACE_M[0], PLACE_M[1] - 40.0)
    passing = StateShared(
        time_s=1.0,
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        alt_rel_m=22.0,
        alt_amsl_m=HOME_AMSL_M + 22.0,
        phase="leaving",
        n_observed=0,
        n_found=0,
        velocity_m_s=(0.0, 7.0, 0.0),
        hears=(2,),
    )
    story(ev.Neighbours(((1, passing),)))
    story.now -= 1.0
    assert orders(story.at(4.0)) == [ev.FlightOrder.HOLD]
