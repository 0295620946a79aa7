"""Landing queue: a copter over its goal, as stories."""

from __future__ import annotations

from typing import Any

import pytest
from agent_stories import GRID, Story, codes, intent_path, operator_texts, orders, publications, swaps

from swarmctl.agent.failsafes import low_battery
from swarmctl.agent.failsafes.base import ActiveRule
from swarmctl.agent.phases import Phase
from swarmctl.agent.traffic.route_hold import hold
from swarmctl.agent.traffic.separation.watch import SeparationRules
from swarmctl.agent.traffic.wait import GOES_SECOND_AFTER_S, PASSES_WITHIN_S, RULES, WaitFor
from swarmctl.core import events as ev
from swarmctl.core.frames import IntentShared, StateShared
from swarmctl.core.records import replace
from swarmctl.core.vehicle import Landed

HOME_AMSL_M = 300.0
GOAL = (4, 8)
SPOT_M = GRID.centre_m(GOAL)
"""Landing spot of vehicle 2, alone in its cell, as (east, north) [m]."""
STILL: dict[str, Any] = {"ground_speed_m_s": 0.0, "east_m_s": 0.0}
HOLDS: dict[str, Any] = {**STILL, "mode": "GUIDED", "mode_role": "hold"}


class LandingStory(Story):
    """The arrival of vehicle 2 at its goal at 30 m."""

    def __init__(self, **changes: Any) -> None:
        super().__init__(**{"uav": 2, **changes})
        self.flying()

    def at(self, before_m: float, up_m: float = 30.0, **changes: Any) -> list[ev.Effect]:
        """Report vehicle 2 one second later, `before_m` before its landing spot, at 2 m/s."""
        lat_deg, lon_deg = GRID.frame.to_geodetic(SPOT_M[0] - before_m, SPOT_M[1])
        here = {"lat_deg": lat_deg, "lon_deg": lon_deg, "ground_speed_m_s": 2.0, "east_m_s": 2.0}
        here |= {"alt_rel_m": up_m, "alt_amsl_m": HOME_AMSL_M + up_m}
        return self.over(GOAL, **{**here, **changes})

    def other(self, uav: int, *points: tuple[float, float, float], **changes: Any) -> None:
        """Send an intent of vehicle `uav`, also over the goal: points (seconds from now, metres east of
        the landing spot, height above home)."""
        path = ((t, SPOT_M[0] + east_m, SPOT_M[1], HOME_AMSL_M + up_m) for t, east_m, up_m in points)
        intent = IntentShared(1, intent_path(*path), **{"may_change": False, **changes})
        self.tell(intents=((uav, 0.0, intent),))

    def passing_below(self, uav: int = 1, in_s: float = 6.0, up_m: float = 22.0, **changes: Any) -> None:
        """Send an intent that passes the landing spot and lands beside it."""
        points = (
            (0.0, -5.0 * in_s, up_m),
            (in_s, 0.0, up_m),
            (in_s + 2.4, 12.0, up_m),
            (in_s + 60.0, 12.0, 0.0),
        )
        self.other(uav, *points, **changes)

    def waiting(self) -> LandingStory:
        """Hold for a vehicle that hovers below."""
        self.at(10.0)
        self.other(1, (0.0, 2.0, 22.0), (30.0, 2.0, 22.0))
        assert orders(self.at(4.0)) == [ev.FlightOrder.HOLD]
        self(ev.OrderDone(ev.FlightOrder.HOLD))
        return self


def test_the_higher_vehicle_waits_over_its_landing_spot() -> None:
    story = LandingStory()
    story.at(10.0)
    assert story.state.phase is Phase.LANDING
    story.passing_below()
    effects = story.at(4.0)
    assert orders(effects) == [ev.FlightOrder.HOLD]
    assert codes(effects) == ["landing-queue"]
    assert "vehicle 1 " in operator_texts(effects)[0]
    (intent,) = publications(effects, IntentShared)
    assert {round(point.alt_amsl_m, 1) for point in intent.points} == {HOME_AMSL_M + 30.0}
    assert (story.state.conflicts.counts.predicted, story.state.conflicts.counts.by_waiting) == (1, 1)


def test_a_conflict_of_the_descent_stops_the_vehicle_near_its_landing_spot() -> None:
    """The vehicle below is hardly farther away than the vertical limit."""
    story = LandingStory()
    story.at(16.0)
    for before_m in (14.0, 12.0, 10.0):
        story.other(1, (0.0, 2.0, 26.5), (30.0, 2.0, 26.5))
        assert codes(story.at(before_m)) == []
    assert codes(story.at(4.0)) == ["landing-queue"]


def test_a_landing_is_announced_at_once_as_fixed() -> None:
    (intent,) = publications(LandingStory().at(10.0), IntentShared)
    assert not intent.may_change


def test_a_flight_over_the_landing_spot_is_announced_to_the_end_of_its_route_before_its_descent() -> None:
    story = LandingStory(landing_index=0, landing_count=2)
    before_m = SPOT_M[0] - GRID.frame.to_local(*story.state.task.landing_spot(GOAL))[0]
    story.at(before_m + 10.0)
    (intent,) = publications(story.at(before_m), IntentShared)
    flown_m = [GRID.frame.to_local(point.lat_deg, point.lon_deg)[0] for point in intent.points]
    assert before_m == pytest.approx(6.0, abs=0.1)
    assert max(flown_m) == pytest.approx(SPOT_M[0], abs=0.1)
    assert flown_m[-1] == pytest.approx(SPOT_M[0] - before_m, abs=0.1)


def test_a_descent_is_announced_from_the_landing_spot_on() -> None:
    story = LandingStory()
    story.at(3.0)
    (intent,) = publications(story.at(0.5), IntentShared)
    assert intent.points[1].alt_amsl_m < intent.points[0].alt_amsl_m


@pytest.mark.parametrize(
    ("what", "changes"),
    [
        ("above", {"up_m": 38.0}),
        ("vehicle past the spot by then", {"in_s": 1.0, "up_m": 15.0}),
        ("vehicle with time to give way", {"may_change": True, "in_s": 15.0, "up_m": 14.0}),
    ],
)
def test_a_landing_does_not_wait_for_vehicles_outside_the_descent(what: str, changes: dict[str, Any]) -> None:
    story = LandingStory()
    story.at(10.0)
    story.passing_below(**changes)
    assert orders(story.at(4.0)) == [], what


def test_a_copter_does_not_wait_in_the_way_of_the_landing_vehicle() -> None:
    story = LandingStory()
    story.at(10.0)
    story.passing_below(up_m=29.0)
    assert orders(story.at(4.0)) == []


def test_a_copter_does_not_wait_just_below_a_silent_vehicle() -> None:
    story = LandingStory()
    story.at(10.0)
    story.other(1, (0.0, -200.0, 30.0), (20.0, 0.0, 30.0), (22.0, 12.0, 30.0), (90.0, 12.0, 0.0))
    story.now += 25.0
    assert orders(story.at(0.0, 28.5, **STILL, climb_m_s=-1.5)) == []


@pytest.mark.parametrize(
    ("up_m", "changes"),
    [
        (30.0, {"separation": replace(SeparationRules(), action="none")}),
        (4.0, {"altitude_m": 4.0}),
    ],
)
def test_a_copter_does_not_wait_without_permission_or_near_the_ground(
    up_m: float, changes: dict[str, Any]
) -> None:
    story = LandingStory(**changes)
    story.at(10.0, up_m)
    story.passing_below(up_m=max(up_m - 8.0, 0.5), in_s=3.0)
    assert orders(story.at(4.0, up_m)) == []


@pytest.mark.parametrize(("uav", "waits"), [(1, True), (3, False)])
def test_at_one_height_the_higher_system_id_waits(uav: int, waits: bool) -> None:
    story = LandingStory()
    story.at(30.0)
    story.other(uav, (0.0, 6.0, 30.0), (30.0, 6.0, 30.0))
    effects = story.at(24.0, ground_speed_m_s=8.0, east_m_s=8.0)
    assert ("landing-queue" in codes(effects)) is waits


def test_a_copter_with_a_clear_descent_lands_on_its_spot() -> None:
    story = LandingStory().waiting()
    for _ in range(3):
        assert orders(story.at(3.0, **HOLDS)) == []
    story.other(1, (0.0, 12.0, 20.0), (50.0, 12.0, 0.0))
    effects = story.at(3.0, **HOLDS)
    assert codes(effects) == ["descent-clear"]
    (swap,) = swaps(effects)
    assert swap.plan.track == ()
    assert swap.plan.landing.alt_rel_m == pytest.approx(30.0)
    place = GRID.frame.to_local(swap.plan.landing.lat_deg, swap.plan.landing.lon_deg)
    assert place == pytest.approx(SPOT_M, abs=0.1)
    assert swap.plan.from_hold
    story.accept()
    story.at(1.0, 20.0)
    story.over(GOAL, armed=False, alt_rel_m=0.0)
    assert (story.state.phase, story.state.outcome) == (Phase.DONE, "arrived")


def test_a_copter_over_its_landing_spot_lands_there() -> None:
    story = LandingStory().waiting()
    story.other(1, (0.0, 12.0, 0.2), (0.1, 12.0, 0.0))
    effects = [effect for _ in range(4) for effect in story.at(0.5, **HOLDS)]
    assert orders(effects) == [ev.FlightOrder.LAND]
    assert swaps(effects) == []
    assert story.state.phase is Phase.LANDING


def test_a_vehicle_that_stopped_on_its_way_into_the_goal_cell_has_waited_long_enough() -> None:
    story = LandingStory()
    held, _ = hold(story.state, story.state.plans.mission, frozenset())
    story.state, held_boot_s = held, story.state.vehicle.time_boot_s
    story(ev.OrderDone(ev.FlightOrder.HOLD))
    clear = [
        story.state.vehicle.time_boot_s for _ in range(8) if "descent-clear" in codes(story.at(10.0, **HOLDS))
    ]
    assert clear[0] - held_boot_s == pytest.approx(RULES[WaitFor.ROUTE].least_s, abs=1.0)


def test_a_vehicle_that_has_not_confirmed_its_hold_may_still_fly_on_into_its_goal_cell() -> None:
    story = LandingStory()
    story.state, _ = hold(story.state, story.state.plans.mission, frozenset())
    for _ in range(4):
        assert orders(story.over((GOAL[0], GOAL[1] - 1))) == []
    given = [orders(story.at(10.0)) for _ in range(8)]
    assert given[:3] == [[], [], []]
    assert [ev.FlightOrder.LAND] in given


@pytest.mark.parametrize(
    ("up_m", "waits", "later_s"),
    [(22.0, "", 0.0), (22.0, "for others", GOES_SECOND_AFTER_S), (38.0, "for others", 0.0)],
)
def test_of_two_vehicles_that_wait_for_each_other_the_higher_one_goes_on_later(
    up_m: float, waits: str, later_s: float
) -> None:
    story = LandingStory()
    story.at(10.0)
    lat_deg, lon_deg = GRID.frame.to_geodetic(SPOT_M[0] + 30.0, SPOT_M[1])
    other = StateShared(
        1.0, lat_deg, lon_deg, up_m, HOME_AMSL_M + up_m, "landing", 0, 0, waits=waits, hears=(2,)
    )
    story.other(1, (0.0, 2.0, 22.0), (30.0, 2.0, 22.0))
    assert orders(story.at(4.0)) == [ev.FlightOrder.HOLD]
    held_boot_s = story.state.vehicle.time_boot_s
    story(ev.OrderDone(ev.FlightOrder.HOLD))
    story.tell(intents=((1, 0.0, IntentShared(0)),))
    waited_s = []
    for _ in range(8):
        story.tell(neighbours=((1, other),))
        if "descent-clear" in codes(story.at(3.0, **HOLDS)):
            waited_s.append(story.state.vehicle.time_boot_s - held_boot_s)
    assert 0.0 <= waited_s[0] - (RULES[WaitFor.DESCENT].least_s + later_s) <= 1.0


def test_a_landing_does_not_wait_for_a_landed_silent_vehicle() -> None:
    story = LandingStory().waiting()
    story.tell(intents=((1, 0.0, IntentShared(0)),))
    found_codes = [code for _ in range(4) for code in codes(story.at(0.5, **HOLDS))]
    assert found_codes == ["descent-clear"]


def test_a_long_wait_is_reported_repeatedly() -> None:
    story, found_codes = LandingStory().waiting(), []
    for _ in range(130):
        story.other(1, (0.0, 2.0, 20.0), (30.0, 2.0, 20.0))
        found_codes += codes(story.at(3.0, **HOLDS))
    assert found_codes == ["landing-queue-long"] * 2


def test_the_mission_of_a_landing_copter_is_not_changed() -> None:
    story = LandingStory().waiting()
    story.other(1, (0.0, 12.0, 0.2), (0.1, 12.0, 0.0))
    for _ in range(5):
        assert swaps(story.at(3.0, landed=Landed.LANDING, **HOLDS)) == []
    assert len(swaps(story.at(3.0, **HOLDS))) == 1


def test_a_copter_without_a_mission_lands_at_its_position() -> None:
    story = LandingStory().waiting()
    story.tell(intents=((1, 0.0, IntentShared(0)),))
    while story.state.plans.pending is None:
        story.at(3.0, **HOLDS)
    plan_id = story.state.plans.pending.plan_id
    assert orders(story(ev.MissionFailed(plan_id, "old", "the vehicle is landing"))) == [ev.FlightOrder.LAND]
    assert story.state.phase is Phase.LANDING


def descending(story: LandingStory, *heights_m: float) -> list[ev.FlightOrder]:
    """Return the orders while the vehicle continues its descent, one height each half second."""
    down = {"landed": Landed.LANDING, "ground_speed_m_s": 0.0, "east_m_s": 0.0}
    return [order for up_m in heights_m for order in orders(story.at(0.5, up_m, **down))]


def test_an_unconfirmed_hold_is_not_repeated_when_useless() -> None:
    story = LandingStory()
    story.passing_below()
    assert orders(story.at(4.0)) == [ev.FlightOrder.HOLD]
    story(ev.OrderFailed(ev.FlightOrder.HOLD, "no answer"))
    story.tell(intents=((1, 0.0, IntentShared(0)),))
    assert set(descending(story, 28.0, 24.0, 20.0, 16.0, 12.0, 10.0, 9.0, 8.0)) == {ev.FlightOrder.LAND}
    assert not story.state.is_waiting


def test_a_low_battery_ends_the_wait_above_the_landing_spot() -> None:
    rules = (ActiveRule(low_battery, low_battery.Params(seconds=0.0)),)
    story = LandingStory(rules=rules).waiting()
    assert orders(story.at(3.0, battery_percent=24, **HOLDS)) == []
    assert orders(story.at(3.0, battery_percent=19, **HOLDS)) == [], "the other vehicle may just pass below"
    seconds = [s for s in range(15) if orders(story.at(3.0, battery_percent=19, **HOLDS))]
    assert PASSES_WITHIN_S - 5.0 <= seconds[0] <= PASSES_WITHIN_S
    fresh = LandingStory(rules=rules)
    fresh.at(10.0, battery_percent=9)
    fresh.passing_below()
    assert orders(fresh.at(4.0, battery_percent=9)) == []
